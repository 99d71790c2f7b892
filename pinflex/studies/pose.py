"""A pose other than home: motors at given positions, the loops closed along the way from home."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np
import pinocchio as pin

from pinflex.actuation.motors import motor_axes
from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array, IntArray
from pinflex.boundary import public
from pinflex.description.motions.motion import Motion
from pinflex.description.motions.motion_keys import PLATFORM_COORDINATES
from pinflex.errors import DescriptionError, SceneError, SingularityError, nearest
from pinflex.levels.modes import allowed_motions, linearised
from pinflex.linalg import null_space
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian, frame_pose
from pinflex.mechanics.mechanism import Mechanism, takes_model

_SAME = 1e-6  # two coordinates that a mechanism cannot move apart: far above round-off
_STRIDE = 0.05  # [rad | m] of a motor between two closures: small against any link's reach
_FAR = 1000  # [rad | m] from home; a closed pose is sought every stride


def pose(mechanism: Mechanism, motors: Mapping[str, float]) -> Array:
    """Rigid configuration with motors at given positions; the rest stay at home.

    The loops are followed in small moves from home, so the branch is kept, and a singular pose on
    the way is found.

    Returns:
        q of the rigid mechanism, shape (nq,).

    Raises:
        DescriptionError: Not a motor, or not a finite number.
        MotionError, SingularityError: The pose cannot be reached from home.
    """
    names = list(mechanism.description.actuated)
    for name, value in motors.items():
        if name not in names:
            raise DescriptionError(
                f"{mechanism.name}: pose: {name}: not a motor.{nearest(name, names)}"
            )
        if not np.isfinite(value):
            raise DescriptionError(
                f"{mechanism.name}: pose: {name}: {value}. Give a finite position in rad or m."
            )
    home = motor_axes(mechanism).read(mechanism.home)
    start = np.array([home[names.index(name)] for name in motors])
    return _reached(mechanism, "joints", start, motors)


def moved(mechanism: Mechanism, by: Mapping[str, float]) -> Array:
    """Rigid configuration with motors or platform coordinates displaced from home.

    Returns:
        q of the rigid mechanism, shape (nq,).

    Raises:
        DescriptionError: Neither motors nor platform coordinates, or no platform.
        MotionError, SingularityError: The pose cannot be reached from home.
    """
    motors = mechanism.description.actuated
    known = (*PLATFORM_COORDINATES, *motors)
    for name in by:
        if name not in known:
            raise DescriptionError(
                f"{mechanism.name}: pose: {name}: neither a motor nor a platform coordinate."
                f"{nearest(name, known)}"
            )
    if {*by} <= {*motors}:
        return _reached(mechanism, "joints", None, by)
    if {*by} & {*motors}:
        raise DescriptionError(
            f"{mechanism.name}: pose: {', '.join(by)}: motors and platform coordinates together. "
            "Displace one kind."
        )
    return _reached(mechanism, "platform", None, {**dict.fromkeys(_held(mechanism, by), 0.0), **by})


def _held(mechanism: Mechanism, named: Iterable[str]) -> list[str]:
    """Further platform coordinates that fix the pose: those of the YAML's motion come first."""
    description = mechanism.description
    if description.platform is None:
        return []
    system = Equations(mechanism.rigid)
    free = null_space(system.close(mechanism.home)[1]) if system.looped else np.eye(system.n_rigid)
    place = system.system.expansion.frames[description.platform]
    J = frame_jacobian(system, mechanism.home, place) @ free
    angles = pin.rpy.matrixToRpy(frame_pose(system, mechanism.home, place).rotation)
    aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    rates = pin.rpy.computeRpyJacobianInverse(angles, aligned) @ J[3:]
    rows = np.vstack([J[:3], rates[::-1]])  # x, y, z, rz, ry, rx
    moved_too = (description.motion or {}).get("platform", {})
    chosen = list(named)
    for name in (*moved_too, *PLATFORM_COORDINATES):
        trial = [PLATFORM_COORDINATES.index(n) for n in (*chosen, name)]
        if name not in chosen and np.linalg.matrix_rank(rows[trial], tol=_SAME) == len(trial):
            chosen.append(name)
    return chosen


def _reached(
    mechanism: Mechanism, target: str, start: Array | None, to: Mapping[str, float]
) -> Array:
    """The end of a straight way to values of coordinates; without start, to displacements."""
    if not to:
        return mechanism.home
    begin = np.zeros(len(to)) if start is None else start
    way = np.array(list(to.values()), float) - begin

    def straight(t: Array) -> tuple[Array, Array, Array]:
        part = np.outer(t, way)
        return begin + part, np.tile(way, (len(t), 1)), np.zeros_like(part)

    far = int(np.argmax(np.abs(way)))
    if abs(way[far]) > _FAR:
        raise DescriptionError(
            f"{mechanism.name}: pose: {list(to)[far]} = {begin[far] + way[far]:.4g}: more than "
            f"{_FAR} rad or m from home. Give a pose that the robot takes."
        )
    moves = 1 + int(np.ceil(np.max(np.abs(way)) / _STRIDE))
    line = Motion("straight", target, tuple(to), 1.0, straight, absolute=start is not None)
    try:
        return np.array(nominal(mechanism, line, np.linspace(0.0, 1.0, moves + 1)).q[-1])
    except SceneError as error:
        time = getattr(error, "time", None)
        if time is None:
            raise
        at = ", ".join(f"{n} = {x:.4g}" for n, x in zip(to, begin + time * way, strict=True))
        text = str(error).replace(f"t = {time:.6g} s", f"pose: on the way from home, at {at}")
        raise type(error)(text, **error.data) from None


# Tracking of modes from pose to pose, where frequencies cross.

Place = tuple[int, ...]  # of a pose in the grid


def matched(before: Array, now: Array, M: Array) -> tuple[IntArray, Array]:
    """Match shapes to those of a neighbouring pose by the largest sum of squared cosines.

    Cosines are those of the mass matrix: shapes of different frequencies are at right angles, and
    shapes of equal ones, which may turn among themselves, stay among themselves.

    Returns:
        Columns of now in the order of those before, and their squared cosines (the modal assurance
        criterion, 1 for the same shape), shape (min(k, m),) each.
    """
    from scipy.optimize import linear_sum_assignment

    size = np.sqrt(np.einsum("ik,ij,jk->k", before, M, before))
    agreement = np.square((before / size).T @ M @ now)
    rows, columns = linear_sum_assignment(-agreement)
    return np.asarray(columns), np.asarray(agreement[rows, columns])


def tracked(
    shapes: Mapping[Place, Array],
    mass: Callable[[Place], Array],
    count: int,
    first: Place | None = None,
) -> dict[Place, tuple[IntArray, float]]:
    """Follow modes over a grid of poses, away from the first, along the neighbours most alike.

    Of all poses that border on one already followed, the next is always the one whose modes agree
    best with that neighbour's. So a line of poses at which two frequencies (nearly) coincide, and
    shapes mix, is walked round where that is possible.

    Returns:
        By place: the columns in the common order, and the least squared cosine of the first
        `count` modes to the neighbour that they follow (1 at the first place).
    """
    if not shapes:
        return {}
    far = [max(place[axis] for place in shapes) for axis in range(len(next(iter(shapes))))]
    middle = tuple(n / 2 for n in far)
    place = min(shapes, key=lambda at: _distance(at, middle)) if first is None else first
    orders = {place: (np.arange(shapes[place].shape[1], dtype=np.intp), 1.0)}
    border: list[tuple[float, int, Place, IntArray]] = []
    number = itertools.count()  # of two that agree alike the earlier

    def look(place: Place, there: Place) -> None:
        order, agreement = matched(shapes[place][:, orders[place][0]], shapes[there], mass(there))
        least = float(np.min(agreement[:count], initial=1.0))
        heapq.heappush(border, (-least, next(number), there, order))

    while len(orders) < len(shapes):
        for there in _neighbours(place):
            if there in shapes and there not in orders:
                look(place, there)
        while border and border[0][2] in orders:
            heapq.heappop(border)
        if not border:
            # an island behind poses that do not exist: over the shortest gap
            look(*_shortest_gap(orders, [p for p in shapes if p not in orders]))
        least, _, place, order = heapq.heappop(border)
        orders[place] = (order, -least)
    return orders


def _shortest_gap(followed: Iterable[Place], rest: Sequence[Place]) -> tuple[Place, Place]:
    """The followed pose and the other one that are closest."""
    return min(((a, b) for a in followed for b in rest), key=lambda pair: _distance(*pair))


def _neighbours(place: Place) -> Iterator[Place]:
    for axis in range(len(place)):
        for step in (-1, 1):
            yield (*place[:axis], place[axis] + step, *place[axis + 1 :])


def _distance(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return float(np.sum(np.square(np.subtract(a, b))))


# Cartesian stiffness of the platform: how far it gives way to a small force or moment.

_LOOSE = 1e-13  # smallest over largest eigenvalue of a stiffness scaled to a unit diagonal
_HELD = 1e-13  # of the largest entry of a Jacobian: round-off of a product
_RIGID = 1e-9  # of the stiffest member's own compliance: what gives way less is round-off


@public
@takes_model
def platform_compliance(
    mechanism: Mechanism, q: Array | None = None, *, preload: str = "gravity"
) -> Array:
    """Displacement of the platform by unit forces and moments, motors locked.

    C = J Z (Z' K Z)^-1 Z' J', with K the tangent stiffness at the pose, Z what the closures leave
    free and J the Jacobian of the platform's origin.

    Args:
        mechanism: Mechanism with a platform.
        q: Rigid pose, default home.
        preload: As in `modes`: "gravity" about the static equilibrium, "none" about the undeformed
            pose with the structure's stiffness alone.

    Returns:
        C, shape (6, 6), symmetric: translation of the platform's origin (m) and small rotation
        (rad), by force at that origin (N) and moment (N m), all along the world axes. Rows and
        columns of an axis that does not give way are exactly 0: what is below 1e-9 of the
        stiffest member's own compliance is round-off.

    Raises:
        DescriptionError: No platform.
        SingularityError: Something moves without stiffness though the motors are locked.
        ConvergenceError: No static equilibrium.
    """
    name = mechanism.description.platform
    if name is None:
        raise DescriptionError(
            f"{mechanism.name}: stiffness needs the frame it is of. Write `platform: FRAME`."
        )
    dynamics = Equations(mechanism.flexible if preload == "none" else mechanism.standing)
    y, K = linearised(mechanism, dynamics, q, preload)
    free = mechanism.flexible.free
    Z = allowed_motions(dynamics, y, free)
    every = frame_jacobian(dynamics, y, mechanism.frame(name))[:, free]
    J = every @ Z
    # a platform that the closures hold moves by round-off, which is no compliance
    J[np.abs(J) < _HELD * np.max(np.abs(every), initial=0.0)] = 0.0
    S = Z.T @ K[np.ix_(free, free)] @ Z
    size = np.sqrt(np.abs(np.diag(S)))
    if not len(S):
        return np.zeros((6, 6))
    if (
        np.any(size == 0)
        or np.min(np.abs(np.linalg.eigvalsh(0.5 * (S + S.T) / np.outer(size, size)))) < _LOOSE
    ):
        raise SingularityError(
            f"{mechanism.name}: stiffness: something moves without any stiffness though the motors "
            "are locked. Actuate or spring the joints that are free."
        )
    C = J @ np.linalg.solve(S, J.T)
    rigid = np.abs(np.diag(C)) <= _RIGID * _stiffest(mechanism, every)
    C[rigid], C[:, rigid] = 0.0, 0.0
    return np.asarray(0.5 * (C + C.T))


def _stiffest(mechanism: Mechanism, J: Array) -> Array:
    """Compliance of the stiffest beam or spring alone along each axis, shape (6,)."""
    reach = float(np.max(np.abs(J[:3]), initial=0.0)) or 1.0  # levers of the machine, m
    alone = [p.length / (p.spec.material.E * p.spec.section.A) for p in mechanism.parts.values()]
    alone += [1.0 / s.stiffness for s in mechanism.description.springs if s.stiffness]
    k = mechanism.flexible.springs.stiffness
    alone += (min(reach, 1.0) ** 2 / k[k > 0]).tolist()
    return min(alone, default=0.0) * np.array([1.0] * 3 + [1.0 / reach**2] * 3)
