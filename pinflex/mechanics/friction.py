"""Dry friction of joints, smooth in their speed, on Pinocchio's rows.

    F(v) = (F_c + E exp(-(v/v_s)^2)) tanh(v/v_0),     max F = F_b

Present only where a scene has it; the viscous part is among the dampers. F v >= 0: it takes energy.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.description.drives import Friction
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.description.description import Description

_NONE = np.zeros(0)
_SPEEDS, _ROUNDS = 3001, 5  # a maximum is flat: three digits of its place are six of its height


@dataclass(frozen=True)
class DryFriction:
    """Joints with dry friction.

    Attributes:
        rows: Velocity rows. coulomb: F_c [N m | N]. excess: E [N m | N].
        stribeck, speed: v_s and v_0 [rad/s | m/s].
    """

    __repr__ = brief

    rows: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    coulomb: Array = field(default_factory=lambda: _NONE)
    excess: Array = field(default_factory=lambda: _NONE)
    stribeck: Array = field(default_factory=lambda: _NONE)
    speed: Array = field(default_factory=lambda: _NONE)

    @property
    def present(self) -> bool:
        """Whether any joint rubs."""
        return len(self.rows) > 0

    def force(self, v: Array) -> Array:
        """Friction that the motion v (..., nv) has to overcome, in its rows (..., k) [N m | N]."""
        w = v[..., self.rows]
        level = self.coulomb + self.excess * np.exp(-np.square(w / self.stribeck))
        return np.asarray(level * np.tanh(w / self.speed))

    def slope(self, v: Array) -> Array:
        """Derivative of `force` by the speeds of its rows, shape (k,)."""
        w = v[self.rows]
        fall, smooth = np.exp(-np.square(w / self.stribeck)), np.tanh(w / self.speed)
        level = self.coulomb + self.excess * fall
        bend = -2.0 * self.excess * fall * w / self.stribeck**2
        return np.asarray(level * (1.0 - smooth**2) / self.speed + bend * smooth)

    def power(self, v: Array) -> Array:
        """Power that it takes (...), W, of speeds (..., nv)."""
        return np.asarray(np.sum(self.force(v) * v[..., self.rows], axis=-1))


def _excess(rubs: Friction) -> float:
    """E with which the largest friction is breakaway: smoothing would cut it by some per cent."""
    wanted = rubs.breakaway - rubs.coulomb
    if not wanted:
        return 0.0
    v = np.linspace(0.0, 3.0, _SPEEDS) * rubs.stribeck
    smooth = np.tanh(v / rubs.speed)
    falling, excess = np.exp(-np.square(v / rubs.stribeck)) * smooth, wanted
    for _ in range(_ROUNDS):
        at = int(np.argmax(rubs.coulomb * smooth + excess * falling))
        excess = (rubs.breakaway - rubs.coulomb * smooth[at]) / falling[at]
    return float(excess)


def joint_friction(description: Description, model: pin.Model) -> DryFriction:
    """Dry friction of the joints of a description."""
    found = []
    for name, extra in description.joints.items():
        rubs = extra.friction
        if rubs is not None and rubs.dry and model.existJointName(name):
            row = int(model.joints[model.getJointId(name)].idx_v)
            found.append((row, rubs.coulomb, _excess(rubs), rubs.stribeck, rubs.speed))
    if not found:
        return DryFriction()
    rows, *numbers = zip(*found, strict=True)
    return DryFriction(np.array(rows, dtype=np.intp), *(np.array(x, float) for x in numbers))
