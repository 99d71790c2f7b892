"""Closure rows c(y), written once, on complex frames; and the loads at given states.

The same rows answer what is asked by what the frames are moved by. An imaginary step along a
velocity makes the column of J = dc/dy of it, and one along a twist of B alone what a multiplier is
as a wrench on B, both exactly. Along time t the rows on a circle about now in the complex plane
tell cdd at a = 0: its mean with exp(-2 i phi) is the coefficient of t^2 (Lyness and Moler 1967,
Numerical Differentiation of Analytic Functions). The rows are those of `pinflex.mechanics.closure`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pinflex.mechanics.kinks import Kinks, Places, Pull, moving, relative_motion
from pinflex.mechanics.manifold import skew
from pinflex.mechanics.model.loads import DIRECTION, DISTANCE, POINT
from pinflex.mechanics.reference import sleeves
from pinflex.mechanics.reference.sleeves import PAST, TINY, dot

if TYPE_CHECKING:
    from pinflex.arrays import Array
    from pinflex.mechanics.closure import Closures
    from pinflex.mechanics.model.loads import Attachment, Loads, TouchForce

# Points of the circle, and how far it reaches [rad | m]. Any one will do for polynomials of so few
# degrees, as all rows here are of t but those on links in segments: a root must not get far.
_CIRCLE, _REACH, _NEAR = 32, 1.0, 3e-3


def by_velocities(
    closed: Closures, poses: Array, J: Array, X: Array | None, Q: Array, eta: Array
) -> tuple[Array, Array]:
    """c (n, rows) and J = dc/dy (n, rows, nv) of world Jacobians J (n, 6, nV) and the map X."""
    supports = np.concatenate([closed.support_a, closed.support_b])
    twists = J[:, None] * supports[:, None]
    if X is not None:
        twists = twists @ X[:, None]
    elastic = np.eye(twists.shape[3])[:, twists.shape[3] - eta.shape[1] :]
    c, grad = _stepped(closed, poses, twists, Q, eta, elastic)
    if len((coupled := closed.coupled).rows):
        grad[:, coupled.rows] = coupled.J if X is None else coupled.J @ X
    return c, grad


def by_time(
    closed: Closures, poses: Array, motion: tuple[Array, Array], Q: Array, eta: tuple[Array, Array],
    A: Array,
) -> Array:  # fmt: skip
    """gamma in cdd = J a + gamma, shape (n, rows).

    `motion`: twists of the loops' bodies at the world's origin and their rates at a = 0, each
    (n, 2 loops, 6). `eta`: elastic coordinates and rates. `A`: expanded accelerations at a = 0.
    """
    frames = closed.frames(poses).swapaxes(2, 3)
    first, second = (_rates(frames, x[..., None])[:, 0] for x in motion)
    second += np.cross(motion[0][:, :, None, 3:], first)
    size = np.abs(first).max(axis=(1, 2, 3), initial=0.0)
    size = np.maximum(size, np.abs(eta[1]).max(axis=1, initial=0.0))
    cut = any(contact.sleeve.segments for contact in closed.contacts)
    reach = (_NEAR if cut else _REACH) / np.where(size > 0.0, size, 1.0)
    turn = np.exp(2j * np.pi * np.arange(_CIRCLE) / _CIRCLE)
    t = np.append(0.0, turn) * reach[:, None]  # (n, 1 + circle)
    at = t[:, :, None, None, None]
    moved = frames[:, None] + at * first[:, None] + 0.5 * at**2 * second[:, None]
    c = rows(closed, moved, Q, eta[0][:, None] + t[:, :, None] * eta[1][:, None])
    gamma = 2.0 * np.mean(c[:, 1:] * turn[:, None] ** -2, axis=1).real / reach[:, None] ** 2
    if len(closed.coupled.rows):
        gamma[:, closed.coupled.rows] = A @ closed.coupled.J.T
    return np.asarray(gamma)


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
    _, W = _stepped(closed, poses[None], twists, Q[None], eta[None], np.zeros((6, len(eta))))
    on_b = np.zeros((loops, 6))
    np.add.at(on_b, closed.loop_of, lam[:, None] * W[0])
    sides = zip(closed.bodies.tolist(), [*-on_b, *on_b], strict=True)
    about_b = on_b.copy()
    about_b[:, 3:] -= np.cross(closed.frames(poses[None])[0, loops:, :, 3], on_b[:, :3])
    return about_b, [(joint, wrench) for joint, wrench in sides if joint]


def sleeves_at(closed: Closures, poses: Array, eta: Array) -> list[sleeves.Place]:
    """Where the sleeves are at one state."""
    loops, frames = len(closed.names), closed.frames(poses[None]).swapaxes(2, 3)
    return [
        sleeves.Place(one, frames[:, one.loop], frames[:, loops + one.loop], eta[None])
        for one in closed.contacts
    ]


def rows(closed: Closures, frames: Array, Q: Array, eta: Array) -> Array:
    """c of all rows, shape (n, k, rows), at k points near each of n states.

    `frames`: three axes and the origin of every A, then B, shape (n, k, 2 loops, 4, 3). `eta`:
    Shape (n, k, n_eta). Couplings are linear in Q (n, nQ), of the states themselves.
    """
    loops, out = len(closed.names), np.zeros((*frames.shape[:2], closed.n), complex)
    A, B = frames[:, :, :loops], frames[:, :, loops:]
    apart = B[:, :, :, 3] - A[:, :, :, 3]
    of = closed.loop_of[(at := closed.of(POINT))]
    out[:, :, at] = dot(A[:, :, of, closed.a[at]], apart[:, :, of])
    of = closed.loop_of[(at := closed.of(DIRECTION))]
    out[:, :, at] = dot(A[:, :, of, closed.a[at]], B[:, :, of, closed.b[at]])
    way, lengths = apart[:, :, closed.loop_of[(at := closed.of(DISTANCE))]], closed.lengths[at]
    out[:, :, at] = (dot(way, way) - lengths**2) / (2.0 * lengths)
    out[:, :, closed.coupled.rows] = closed.coupled.value(Q)[:, None]
    for k, contact in ((k, one) for k in range(len(Q)) for one in closed.contacts):
        if len(contact.rows):  # else other loops hold all that it would
            sleeve = sleeves.Place(contact, A[k, :, contact.loop], B[k, :, contact.loop], eta[k])
            out[k][:, contact.rows] = sleeve.rows()
    return out


def _stepped(
    closed: Closures, poses: Array, twists: Array, Q: Array, eta: Array, elastic: Array
) -> tuple[Array, Array]:
    """c (n, rows), and its derivatives (n, rows, m) along m variables.

    `twists`: of A, then of B of every loop by them, at the world's origin, (n, 2 loops, 6, m).
    `elastic`: elastic coordinates by them, (m, n_eta).
    """
    frames, eta = closed.frames(poses).swapaxes(2, 3)[:, None], eta[:, None]
    moved = np.concatenate([frames, frames + 1j * TINY * _rates(frames[:, 0], twists)], axis=1)
    c = rows(closed, moved, Q, np.concatenate([eta, eta + 1j * TINY * elastic], axis=1))
    return np.array(c[:, 0].real), np.array(c[:, 1:].imag.swapaxes(1, 2) / TINY)


def _rates(frames: Array, twists: Array) -> Array:
    """Rates of axes and origins (n, 2 loops, 4, 3) by twists (n, 2 loops, 6, m), the m in front.

    x' = w x (.), of the origin + v.
    """
    arms = -skew(frames.reshape(-1, 3)).reshape(*frames.shape, 3)  # of (.) x column
    found = arms @ twists[:, :, None, 3:]
    found[:, :, 3] += twists[:, :, :3]
    return np.moveaxis(found, 4, 1)


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
            pose, place = poses[segment.root.joint], segment.root.placement
            axis, root = pose[:, :3] @ place.rotation[:, 0], pose @ [*place.translation, 1.0]
            ahead = origins[len(closed.names) + contact.loop] - root
            passed += bool(ahead @ axis >= PAST * segment.length)
        numbers.append(passed)
    return closed.on(numbers)


# Forces from outside: loads at frames, springs and dampers between two, contacts.


class LoadStates:
    """Loads at n states, by where joints are and how they move."""

    def __init__(self, given: Loads, kinks: Kinks, places: Places) -> None:
        self._given, self._kinks, self._places = given, kinks, places

    def wrenches(self, t: Array) -> Mapping[int, Array]:
        """Forces and moments on joints in their own frames, (n, 6) each, at times t (n,)."""
        total = {joint: np.zeros((len(t), 6)) for joint in self._places}

        def push(end: Attachment, F: Array, M: Array | float = 0.0) -> None:
            """A force and a moment in the world, at an end."""
            R = self._places[end.joint][0][:, :, :3]
            force, moment = (((x + 0.0 * F)[:, None] @ R)[:, 0] for x in (F, M))
            moment = moment + np.cross(end.placement.translation, force)
            total[end.joint] += np.concatenate([force, moment], axis=1)

        for force, end in self._given.forces:
            turn = self._places[end.joint][0][:, :, :3] @ end.placement.rotation
            turn = turn if force.follower else np.eye(3)
            scale = np.array([[force.scale(float(x))] for x in t])
            push(end, *(scale * (turn @ np.array(x)) for x in (force.force, force.moment)))
        for k, (_, a, b) in enumerate(self._given.springs):
            u, pull = self._pulled(k)
            push(a, pull.force[:, None] * u)
            push(b, -pull.force[:, None] * u)
        for one in self._given.touches:
            R, motion, place = relative_motion(one, self._places)
            found = one.force(motion, self._kinks)
            F, M = ((R @ x[:, :, None])[:, :, 0] for x in (found.force, found.moment))
            push(one.b, F, M)
            arm = place - moving(one.a, self._places)[0]
            push(one.a, -F, -M - np.cross(arm, F))
        return total

    def energy(self, t: Array) -> Array:
        """Potential of springs, contacts and constant forces at times t (n,), shape (n,), J."""
        energy = np.zeros(len(t))
        for force, end in self._given.forces:
            if force.potential:
                scale = np.array([force.scale(float(x)) for x in t])
                energy -= scale * (moving(end, self._places)[0] @ np.array(force.force))
        for k in range(len(self._given.springs)):
            energy += self._pulled(k)[1].energy
        return energy + sum(found.energy for found in self._touched())

    def dissipation(self) -> Array | float:
        """Power that dampers and contacts take, W."""
        springs = enumerate(self._given.springs)
        damped = sum(self._pulled(k)[1].loss for k, (spring, *_) in springs if spring.damper)
        return damped + sum(found.loss for found in self._touched())

    def _touched(self) -> list[TouchForce]:
        every = ((one, relative_motion(one, self._places)[1]) for one in self._given.touches)
        return [one.force(motion, self._kinks) for one, motion in every]

    def _pulled(self, k: int) -> tuple[Array, Pull]:
        """Way of a spring from a to b (n, 3), of length one, and what it resists by."""
        law, a, b = self._given.springs[k]
        (p_a, v_a, _), (p_b, v_b, _) = (moving(end, self._places) for end in (a, b))
        length = np.linalg.norm(p_b - p_a, axis=1)
        u = (p_b - p_a) / np.maximum(length, 1e-300)[:, None]
        x, rate, kink = length - law.length, dot(u, v_b - v_a), self._kinks.of_spring(k)
        if kink >= 0:
            return u, self._kinks.pull(kink, x, rate)
        stiff, c = law.stiffness, law.damper
        parts = stiff * x + c * rate, stiff + 0 * x, c + 0 * x, 0.5 * stiff * x**2, c * rate**2
        return u, Pull(*parts)
