"""Closure rows c(y), written once, on frames that carry their derivatives with them.

The same rows answer what is asked by what the frames move with: with unit velocities, c and
J = dc/dy; with time, c, J v and cdd at a = 0; with unit twists of B alone, what a multiplier is as
a wrench on B. The rows are those of `pinflex.mechanics.closure`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinflex.mechanics.poses import skew
from pinflex.mechanics.reference import sleeves
from pinflex.mechanics.reference.curve import PAST
from pinflex.mechanics.reference.jets import Jet, dot

if TYPE_CHECKING:
    from pinflex.arrays import Array, IntArray
    from pinflex.mechanics.closure import Closures


@dataclass(frozen=True, eq=False)
class Moves:
    """What n states move with, in m variables.

    Attributes:
        twists: Of A, then of B of every loop, at the world's origin, shape (n, 2 loops, 6, m).
        swept: Rates of these along one variable, time, shape (n, 2 loops, 6), or None.
        Q: Expanded velocities, shape (n, nV, m). eta: Elastic ones, shape (n, n_eta, m).
        A: Accelerations that belong to `swept`, shape (n, nV), or None.
    """

    twists: Array
    swept: Array | None
    Q: Array
    eta: Array
    A: Array | None = None


def by_velocities(closed: Closures, X: Array | None, J: Array, n_eta: int) -> Moves:
    """Every velocity of the n states is a variable."""
    supports = np.concatenate([closed.support_a, closed.support_b])
    twists, (n, _, nV) = J[:, None] * supports[:, None], J.shape
    if X is None:
        return Moves(twists, None, np.broadcast_to(np.eye(nV), (n, nV, nV)), np.zeros((n, 0, nV)))
    nv = X.shape[2]
    eta = np.broadcast_to(np.eye(nv)[nv - n_eta :], (n, n_eta, nv))
    return Moves(twists @ X[:, None], None, X, eta)


def by_time(closed: Closures, V: Array, A: Array, J: Array, dJ: Array, eta_rate: Array) -> Moves:
    """Time is the variable, with no accelerations in minimal coordinates."""
    supports = np.concatenate([closed.support_a, closed.support_b])
    speeds, swept = V[:, None] * supports, A[:, None] * supports  # (n, 2 loops, nV)
    twists = speeds @ J.swapaxes(1, 2)
    swept = speeds @ dJ.swapaxes(1, 2) + swept @ J.swapaxes(1, 2)
    return Moves(twists[..., None], swept, V[..., None], eta_rate[..., None], A)


def wrenches(
    closed: Closures, poses: Array, Q: Array, eta: Array, lam: Array
) -> tuple[Array, list[tuple[int, Array]]]:
    """What multipliers do to bodies at one state: how far rows change with the twist of B alone.

    Returns:
    On each B about the origin of frame b, shape (loops, 6), and about the world's origin by
    joint, A's opposite ones among them: (joint, (6,)).
    """
    loops = len(closed.names)
    twists = np.zeros((1, 2 * loops, 6, 6))
    twists[0, loops:] = np.eye(6)
    moves = Moves(twists, None, np.zeros((1, len(Q), 6)), np.zeros((1, len(eta), 6)))
    W = rows(closed, poses[None], Q[None], eta[None], moves).grad[0]
    on_b = np.zeros((loops, 6))
    np.add.at(on_b, closed.loop_of, lam[:, None] * W)
    sides = zip(closed.bodies.tolist(), [*-on_b, *on_b], strict=True)
    about_b = on_b.copy()
    about_b[:, 3:] -= np.cross(closed.frames(poses[None])[0, loops:, :, 3], on_b[:, :3])
    return about_b, [(joint, wrench) for joint, wrench in sides if joint]


def sleeves_at(closed: Closures, poses: Array, eta: Array) -> list[sleeves.Place]:
    """Where the sleeves are at one state."""
    loops, frames = len(closed.names), closed.frames(poses[None])[0].swapaxes(1, 2)
    a_b = Jet(frames, np.zeros((*frames.shape, 1)))
    z = Jet(eta, np.zeros((len(eta), 1)))
    return [sleeves.Place(one, a_b[one.loop], a_b[loops + one.loop], z) for one in closed.contacts]


def rows(closed: Closures, poses: Array, Q: Array, eta: Array, moves: Moves) -> Jet:
    """c of all rows, shape (n, rows)."""
    frames, (n, m) = _moving(closed.frames(poses), moves), (len(poses), moves.Q.shape[2])
    loops, timed = len(closed.names), moves.swept is not None
    value, grad = np.zeros((n, closed.n)), np.zeros((n, closed.n, m))
    out = Jet(value, grad, np.zeros((n, closed.n, m, m)) if timed else None)
    at: IntArray
    if len(at := closed.point_rows):
        a = closed.loop_of[at]
        apart = frames[:, loops + a, 3] - frames[:, a, 3]
        _write(out, at, dot(frames[:, a, closed.point_axes], apart))
    if len(at := closed.dot_rows):
        a = closed.loop_of[at]
        _write(out, at, dot(frames[:, a, closed.dot_a], frames[:, loops + a, closed.dot_b]))
    if len(at := closed.distance_rows):
        a, lengths = closed.loop_of[at], np.tile(closed.lengths, (n, 1))
        apart = frames[:, loops + a, 3] - frames[:, a, 3]
        _write(out, at, dot(apart, apart).plus(-(lengths**2)).over(2.0 * lengths))
    if len(at := (coupled := closed.coupled).rows):
        hess = None if moves.A is None else (moves.A @ coupled.J.T)[..., None, None]
        _write(out, at, Jet(coupled.value(Q), coupled.J @ moves.Q, hess))
    for k in range(n) if closed.contacts else ():
        z = Jet(eta[k], moves.eta[k], np.zeros((len(eta[k]), m, m)) if timed else None)
        for contact in closed.contacts:
            if not len(contact.rows):  # other loops hold all that it would
                continue
            loop = contact.loop
            sleeve = sleeves.Place(contact, frames[k, loop], frames[k, loops + loop], z)
            _write(out, (k, contact.rows), sleeve.rows())
    return out


def _write(out: Jet, at: object, found: Jet) -> None:
    """Put rows at their places."""
    key = at if isinstance(at, tuple) else (slice(None), at)
    out.value[key], out.grad[key] = found.value, found.grad
    if out.hess is not None:
        out.hess[key] = found.hess


def _moving(frames: Array, moves: Moves) -> Jet:
    """Frames of the loops, (n, 2 loops, 4, 3): three axes and the origin, with the twists' rates.

    x' = w x (.), of the origin + v, and once more for the second.
    """
    columns = frames.swapaxes(2, 3)
    arms = -skew(columns.reshape(-1, 3)).reshape(*columns.shape, 3)  # of (.) x column
    v, w = moves.twists[:, :, None, :3], moves.twists[:, :, None, 3:]
    grad = arms @ w
    grad[:, :, 3:] += v
    if moves.swept is None:
        return Jet(columns, grad)
    rate, spin = grad[..., 0], w[..., 0]
    hess = (arms @ moves.swept[:, :, None, 3:, None])[..., 0] + np.cross(spin, rate)
    hess[:, :, 3] += moves.swept[:, :, :3]
    return Jet(columns, grad, hess[..., None, None])


def on_segments(closed: Closures, poses: Array) -> Closures:
    """The closures of one state, each sleeve on the segment of its beam that it stands before.

    It has passed the root of a segment when it stands before the section there.
    """
    if not any(contact.sleeve.segments for contact in closed.contacts):
        return closed
    origins, numbers = closed.frames(poses[None])[0, :, :, 3], []
    for contact in closed.contacts:
        passed = 0
        for segment in contact.sleeve.segments[1:]:
            pose = poses[segment.root.joint].reshape(4, 3)
            axis = segment.root.placement.rotation[:, 0] @ pose[:3]
            root = segment.root.placement.translation @ pose[:3] + pose[3]
            ahead = origins[len(closed.names) + contact.loop] - root
            passed += bool(ahead @ axis >= PAST * segment.length)
        numbers.append(passed)
    return closed.on(numbers)
