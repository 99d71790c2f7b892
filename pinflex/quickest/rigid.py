"""The rigid robot along its path, by the place s on it from 0 to 1.

    tau = m(s) s'' + c(s) s'^2 + b(s) s' + g(s)

Source: Bobrow, Dubowsky and Gibson (1985): along a path the dynamics have one coordinate.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array
from pinflex.description.motions.laws import Kinematics
from pinflex.description.motions.motion import Motion
from pinflex.levels.rigid import multipliers
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism

_PLACES = 61  # between which all is interpolated; a path of a delta misses 1e-6 of its torque
_SPEEDS = (0.5, 1.0)  # of the typical one: what grows with its square, and with itself


class RigidPath:
    """How the rigid robot moves along a path, and what that takes."""

    def __init__(
        self, mechanism: Mechanism, target: str, moves: Mapping[str, float], typical: float
    ) -> None:
        """Displacements by name; `typical` is a speed of s [1/s]."""
        from scipy.interpolate import CubicSpline

        s = np.linspace(0.0, 1.0, _PLACES)
        far = np.array([*moves.values()], float)
        path = nominal(mechanism, Motion("straight", target, tuple(moves), 1.0,
                                         partial(_straight, far)), s)  # fmt: skip
        self.end = path.q[-1]
        self.motors = mechanism.rigid.motors
        self._first, self._second = CubicSpline(s, path.v), CubicSpline(s, path.a)
        dynamics = Equations(mechanism.rigid)
        J = dynamics.close(path.q).J

        def torque(v: float, a: float) -> Array:
            rates = path.v * v, path.a * v**2 + path.v * a
            return multipliers(mechanism, J, dynamics.open(path.q, *rates, 0.0 * s))[1]

        slow, fast = (torque(x * typical, 0.0) for x in _SPEEDS)
        m = (torque(typical, typical**2) - fast) / typical**2
        rest = torque(1e-9 * typical, 0.0)  # dry friction has the sign of the speed
        x, y = (_SPEEDS[0] * typical, _SPEEDS[1] * typical)
        c = ((fast - rest) / y - (slow - rest) / x) / (y - x)
        b = (slow - rest) / x - c * x
        self._terms = [CubicSpline(s, term) for term in (m, c, b, rest)]

    def __call__(self, s: Array) -> tuple[Array, Array, Array]:
        """dq/ds and its two derivatives by s, at s (k,), each (k, nv)."""
        s = np.clip(s, 0.0, 1.0)
        return self._first(s), self._second(s), self._second(s, 1)

    def torque(self, s: Array, v: Array, a: Array) -> tuple[Array, Array, Array, Array]:
        """Motor torques (k, nm) at s with rates v and a, (k,) each; and derivatives by s, v, a."""
        s, v, a = np.clip(s, 0.0, 1.0), v[:, None], a[:, None]
        m, c, b, g = (term(s) for term in self._terms)
        dm, dc, db, dg = (term(s, 1) for term in self._terms)
        tau = m * a + c * v**2 + b * v + g
        return tau, dm * a + dc * v**2 + db * v + dg, 2.0 * c * v + b, m

    def torque_by(self, B: Array, x: Array, T: float) -> tuple[Array, Array]:
        """Torques (k, nm) of numbers x, and by them and the duration T, (k, nm, numbers + 1).

        B: s, ds/du and d^2s/du^2 by the numbers, (3, k, numbers).
        """
        s, v, a = B @ x
        tau, by_s, by_v, by_a = (x[:, :, None] for x in self.torque(s, v / T, a / T**2))
        by = by_s * B[0][:, None] + by_v * B[1][:, None] / T + by_a * B[2][:, None] / T**2
        slower = -(by_v[..., 0] * v[:, None] / T + 2.0 * by_a[..., 0] * a[:, None] / T**2) / T
        return tau[..., 0], np.concatenate([by, slower[:, :, None]], axis=2)

    def motor_speed(self, s: Array) -> Array:
        """Of the motors by ds/dt, shape (k, nm)."""
        return np.asarray(self._first(np.clip(s, 0.0, 1.0))[:, self.motors])


def _straight(far: Array, t: Array) -> Kinematics:
    return t[:, None] * far, np.tile(far, (len(t), 1)), np.zeros((len(t), len(far)))
