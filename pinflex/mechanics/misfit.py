"""Loops that close but for the last digits of a drawing: the gap that is built in.

A plane four-bar closed by a spatial hinge holds three rows that no joint of it moves: a pin 1e-6 m
beside its hole stays beside it, whatever the pose. Where the rows that joints do move close, and
the others are open by no more than a drawing's accuracy, the hinge is made to fit there: frame b is
moved on its link until the loop closes at home. What is built in so bears no force of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.mechanics import assembly
from pinflex.mechanics.closure import Closures, LogClosure, size_of
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.text import brief

# Gap over the size of the mechanism, and angle [rad], up to which loops are made to fit. A place
# may be off by the width of a line in a drawing. An angle also moves rows that nothing else moves,
# by as much as itself, and has to stay below any ratio at which a mechanism can be used: six digits
# of `rpy`, and 1.5708 for a right angle, both ways.
GAP, ANGLE = 1e-3, 1e-5
# Ratio below which rows count as dependent that `ANGLE` makes independent (see `assembly.RANK`).
RANK = 3 * ANGLE
_TURNS = 4  # Newton's steps that turn frame b; an angle of 1e-5 takes two


@dataclass(frozen=True)
class Misfit:
    """What makes loops fit that are open at home.

    Attributes:
        gaps: How far each loop is open, m and rad.
        shifts: Moves of frame b in its own axes, by loop.
        lengths: Distances as they are at home, by loop.
    """

    __repr__ = brief

    gaps: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    shifts: Mapping[str, pin.SE3] = field(default_factory=dict)
    lengths: Mapping[str, float] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.gaps)

    @property
    def rank(self) -> float:
        """Ratio of singular values below which rows count as dependent."""
        return RANK if self else assembly.RANK

    def built_in(self, closed: Closures) -> Closures:
        """Closures with frames b, and distances, that fit."""
        if not self:
            return closed
        local, lengths = closed.local.copy(), closed.lengths.copy()
        for name, shift in self.shifts.items():
            b = local[len(closed.names) + closed.names.index(name)]
            b[:, 3] += b[:, :3] @ shift.translation
            b[:, :3] = b[:, :3] @ shift.rotation
        for name, length in self.lengths.items():
            lengths[closed.loop_of[closed.distance_rows] == closed.names.index(name)] = length
        return replace(closed, local=local, lengths=lengths)


def nearly_closed(dynamics: Equations, guess: Array, moving: IntArray) -> Array | None:
    """A pose at which the rows close that joints move, the others to the drawing's accuracy.

    Returns:
        The pose; None where more stays open, or where rows are dependent in this pose only.
    """
    closed, size = dynamics.system.closed, _size(dynamics, guess)
    kept, _ = assembly.independent_rows(dynamics.close(guess).J, closed.labels, RANK)
    firm = Equations(replace(dynamics.system, closed=closed.select(kept)))
    pose, left = assembly.close_loops(firm, guess, moving) if len(kept) else (guess, 0.0)
    if left > 10 * assembly.CLOSED or not _fits(dynamics, pose, size):
        return None
    if assembly.rank_beside(firm, dynamics, pose, RANK) > len(kept):
        return None
    return pose


def _size(dynamics: Equations, pose: Array) -> float:
    """Size of the mechanism [m]; without a joint, from the base to the furthest loop."""
    closed = dynamics.system.closed
    if dynamics.n_rigid or not closed.names:
        return size_of(dynamics, pose)
    origins = closed.frames(dynamics.joint_poses(pose))[0, len(closed.names) :, :, 3]
    return float(np.max(np.linalg.norm(origins, axis=1)))


def _fits(dynamics: Equations, pose: Array, size: float) -> bool:
    """Whether all that stays open is a frame or a distance that can be made to fit."""
    closed, c = dynamics.system.closed, np.abs(dynamics.close(pose).c)
    angles = np.zeros(closed.n, dtype=bool)
    angles[closed.dot_rows] = True
    rigid = np.zeros(closed.n, dtype=bool)
    rigid[closed.coupled.rows] = True
    for one in closed.contacts:
        rigid[one.rows] = True
    limit = np.where(angles, ANGLE, GAP * size)
    return bool(np.all(c <= np.where(rigid, 10 * assembly.CLOSED, limit)))


def misfit(dynamics: Equations, pose: Array) -> Misfit:
    """What makes the loops fit at a pose; empty where they are closed."""
    closed = dynamics.system.closed
    frames_a, frames_b = np.split(closed.frames(dynamics.joint_poses(pose))[0], 2)
    c, _ = dynamics.close(pose)
    apart, turned = LogClosure(dynamics, 1.0).gaps(c)
    gaps: dict[str, tuple[float, float]] = {}
    shifts: dict[str, pin.SE3] = {}
    lengths: dict[str, float] = {}
    for k, name in enumerate(closed.names):
        gap = float(apart[k]), float(turned[k])
        if max(gap) < assembly.CLOSED:
            continue
        gaps[name] = gap
        if closed.kinds[k] == "distance":
            lengths[name] = float(np.linalg.norm(frames_b[k, :, 3] - frames_a[k, :, 3]))
            continue
        a, b = frames_a[k], frames_b[k]
        held = closed.point_axes[closed.loop_of[closed.point_rows] == k]
        u = a[:, held]
        move = -u @ (u.T @ (b[:, 3] - a[:, 3]))
        dots = closed.loop_of[closed.dot_rows] == k
        turn = _turn(a[:, :3], b[:, :3], closed.dot_a[dots], closed.dot_b[dots])
        shifts[name] = pin.SE3(b[:, :3].T @ turn @ b[:, :3], b[:, :3].T @ move)
    return Misfit(gaps, shifts, lengths)


def _turn(a: Array, b: Array, of_a: IntArray, of_b: IntArray) -> Array:
    """The least turn of axes b (3, 3), in the world, that makes e_a . e_b = 0 for some pairs."""
    turn = np.eye(3)
    for _ in range(_TURNS):
        e_a, e_b = a[:, of_a].T, (turn @ b)[:, of_b].T
        c = np.sum(e_a * e_b, axis=1)
        w = np.linalg.lstsq(np.cross(e_b, e_a), -c, rcond=None)[0]
        turn = pin.exp3(w) @ turn
    return turn
