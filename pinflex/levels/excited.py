"""Vibrations that a motion excites; the motion of the YAML, shaped so that it excites less."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinflex.actuation.motors import plain_motion
from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array, BoolArray, IntArray
from pinflex.boundary import public
from pinflex.description.motions.motion import Motion, hold
from pinflex.description.motions.shaping import MODES, shaped
from pinflex.description.motions.shaping import read as read_shaper
from pinflex.errors import DescriptionError
from pinflex.integrators.chebyshev import Interpolation
from pinflex.levels.modes import modes
from pinflex.mechanics.evaluation.equations import Equations, Followed
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.text import brief

_INSTANTS = 9
_LOOKED_AT = 9  # lowest modes
_SEEN = 0.05  # share of the largest energy at which a mode counts
_SAME = 0.05  # relative: modes so close are one to a shaper


@dataclass(frozen=True)
class Ringing:
    """Modes with locked motors that a motion excites, in the order of their frequencies.

    Attributes:
        frequencies: In the middle of their range along the motion [Hz], shape (k,).
        low, high: Ends of the range [Hz], shape (k,).
        damping: Damping ratio in the middle [-], shape (k,).
        energy: Elastic energy that the motion's inertia forces put into each at most [J], (k,).
    """

    __repr__ = brief

    frequencies: Array
    low: Array
    high: Array
    damping: Array
    energy: Array


@public
@takes_model
def ringing(mechanism: Mechanism, motion: Motion, most: int = MODES) -> Ringing:
    """The vibrations that a motion excites: of largest elastic energy under its inertia forces.

    Modes that lie within 5 % of each other count once.

    Args:
        mechanism: With a flexible link or an elastic joint.
        motion: Its motion.
        most: Number of modes at most.
    Raises:
        DescriptionError: Nothing vibrates, or the motion excites nothing.
        ConvergenceError, MotionError: No equilibrium, or the motion cannot be followed.
    """
    system = mechanism.flexible
    if not mechanism.compliant:
        raise DescriptionError(
            f"{mechanism.name}: nothing vibrates. Describe flexible links or elastic joints."
        )
    # inside, where accelerations are: at the ends a smooth motion has none
    t = motion.duration * (np.arange(_INSTANTS) + 0.5) / _INSTANTS
    path, dynamics, rows = nominal(mechanism, motion, t), Equations(system), []
    for q, acceleration in zip(path.q, path.a, strict=True):
        found = modes(mechanism, q, count=_LOOKED_AT, preload="none")
        alive = found.frequencies > 0.0
        shapes, omega = found.shapes[:, alive], 2.0 * np.pi * found.frequencies[alive]
        a = np.zeros(system.nv)
        a[: len(acceleration)] = acceleration
        energy = 0.5 * (shapes.T @ (dynamics.mass(found.y) @ a) / omega) ** 2
        damping = np.einsum("ik,ij,jk->k", shapes, system.D, shapes) / (2.0 * omega)
        rows.append(np.stack([omega / (2.0 * np.pi), damping, energy]))
    many = min(row.shape[1] for row in rows)
    f, damping, energy = np.stack([row[:, :many] for row in rows], axis=1)
    peak = energy.max(axis=0, initial=0.0)
    if not many or not np.any(peak > 0.0):
        raise DescriptionError(f"{mechanism.name}: the motion excites no vibration.")
    ranked = [k for k in np.argsort(-peak) if peak[k] >= _SEEN * peak.max()]
    low, high = f.min(axis=0), f.max(axis=0)
    middle = 0.5 * (low + high)
    kept: list[int] = []
    for k in ranked:
        if len(kept) < most and all(abs(middle[k] / middle[j] - 1.0) > _SAME for j in kept):
            kept.append(int(k))
    at = np.sort(np.array(kept))
    return Ringing(middle[at], low[at], high[at], damping.mean(axis=0)[at], peak[at])


def default_motion(mechanism: Mechanism) -> Motion:
    """The motion of the YAML, shaped where it says so; one second at rest where it has none.

    The same object each time: what is known of a motion is found by it.
    """
    found = mechanism.followed.motions  # modes of a shaped one are slow to find
    if not found:
        Followed.keep(found, _written(mechanism), 1)
    motion: Motion = found[0]
    return motion


def _written(mechanism: Mechanism) -> Motion:
    block = mechanism.description.motion
    if block is None:
        return hold(duration=1.0)
    motion, where = plain_motion(mechanism), f"{mechanism.name}.yaml: motion.shaper"
    asked = read_shaper(block.get("shaper"), where)
    if asked is None:
        return motion
    if asked.frequencies:
        return shaped(motion, asked.kind, asked.frequencies, asked.damping)
    found = ringing(mechanism, motion, asked.modes)
    return shaped(motion, asked.kind, found.frequencies.tolist(), found.damping.tolist())


# A matrix along a path: its constant entries once, and the varying ones at every node.
#
# Some six sevenths of the linear system of a mechanism are constant; stored in full at every node
# it would take hundreds of megabytes for some ten coordinates a link, and touching them takes
# longer than the marches that use them.

NOISE = 1e-12  # of the largest entry of a matrix: round-off of what is constant


@dataclass(frozen=True)
class Varying:
    """A matrix, or a vector, at the nodes of an interpolation.

    Attributes:
        constant: At the first node, any shape.
        entries: Flat numbers of those that vary, ascending, shape (m,).
        values: Of them at the nodes, shape (size, m).
    """

    constant: Array
    entries: IntArray
    values: Array

    def __len__(self) -> int:
        return len(self.values)

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the matrix."""
        return self.constant.shape

    @cached_property
    def noise(self) -> float:
        """Changes up to which an entry counts as constant."""
        sizes = (float(np.max(np.abs(x), initial=0.0)) for x in (self.constant, self.values))
        return NOISE * max(sizes)

    @cached_property
    def varies(self) -> BoolArray:
        """Which entries vary, in the shape of the matrix."""
        return self._numbers >= 0

    @cached_property
    def _numbers(self) -> IntArray:
        """Column of `values` of each entry, in the shape of the matrix; -1: it is constant."""
        column = np.full(self.constant.size, -1, dtype=np.intp)
        column[self.entries] = np.arange(len(self.entries))
        return column.reshape(self.shape)

    def whole(self) -> Array:
        """The matrix at every node, shape (size, ...)."""
        return self.filled(self.values)

    def along(self, grid: Interpolation, at: slice | IntArray = slice(None)) -> Array:
        """The matrix at steps, shape (steps, ...)."""
        return self.filled(grid.between(self.values, at))

    def filled(self, values: Array) -> Array:
        """The matrix from its varying entries, shape (k, m), as (k, ...)."""
        matrix = np.tile(self.constant.ravel(), (len(values), 1))
        matrix[:, self.entries] = values
        return matrix.reshape(len(values), *self.shape)

    def picked(self, *axes: IntArray) -> Varying:
        """Some rows, and columns where there are any, in their order."""
        block = np.ix_(*axes)
        numbers = self._numbers[block].ravel()
        entries = np.flatnonzero(numbers >= 0)
        return Varying(self.constant[block], entries, self.values[:, numbers[entries]])

    def entries_at(self, at: tuple[IntArray, ...]) -> Array:
        """Some entries at every node, shape (size, k)."""
        numbers = self._numbers[at]
        values = np.tile(self.constant[at], (len(self.values), 1))
        values[:, numbers >= 0] = self.values[:, numbers[numbers >= 0]]
        return values


def together(parts: Sequence[Varying], grid: Interpolation, at: slice | IntArray) -> list[Array]:
    """Several matrices at steps, shape (steps, ...) each."""
    return [x.along(grid, at) for x in parts]


def varying(x: Array) -> Varying:
    """A matrix that is known in full at every node, shape (size, ...)."""
    flat = x.reshape(len(x), -1)
    size = max(float(np.max(x, initial=0.0)), -float(np.min(x, initial=0.0)))
    entries = np.flatnonzero(np.ptp(flat, axis=0) > NOISE * size)
    return Varying(x[0].copy(), entries, flat[:, entries])
