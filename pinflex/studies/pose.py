"""A pose other than home: motors at given positions, the loops closed along the way from home."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinflex.actuation.drive import Nominal, nominal
from pinflex.actuation.path import motor_axes
from pinflex.arrays import Array, IntArray
from pinflex.boundary import public
from pinflex.description.motions.laws import PLATFORM_COORDINATES
from pinflex.description.motions.motion import Motion
from pinflex.errors import DescriptionError, SceneError, SingularityError, nearest
from pinflex.integrators.problem import Run
from pinflex.levels.modes import Modes, allowed_motions, linearised
from pinflex.linalg import null_space
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian, frame_pose
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.recovery.meta import describe
from pinflex.recovery.recover import recover
from pinflex.results.result import Result
from pinflex.viewer.plots.motions import shape_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_SAME = 1e-6  # two coordinates that a mechanism cannot move apart: far above round-off
_STRIDE = 0.05  # [rad | m] of a motor between two closures: small against any link's reach
_FAR = 1000  # [rad | m] from home; a closed pose is sought every stride


def pose(mechanism: Mechanism, motors: Mapping[str, float]) -> Array:
    """Rigid configuration (nq,) with motors at given positions; the rest stay at home.

    The loops are followed in small moves from home, so the branch is kept, and a singular pose on
    the way is found.
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
    """Rigid configuration (nq,) with motors or platform coordinates displaced from home."""
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


# Shapes of modes as runs of one period, so that the player can show them.

_INSTANTS = 41  # of one period: smooth on the screen
_SWING = 1e-3  # [rad | m] largest coordinate of the drawn motion: small, so shapes stay linear


def mode_runs(mechanism: Mechanism, found: Modes) -> list[tuple[float, Result]]:
    """Each oscillating mode as (frequency [Hz], one period of its motion).

    Displacements are measured from the pose that was linearised about, sag included; fields that a
    shape without size does not have (stress, forces) are left out.
    """
    dynamics = Equations(mechanism.flexible)
    return [
        (float(f), _run(mechanism, dynamics, found, k, float(f)))
        for k, f in enumerate(found.frequencies)
        if f > 0
    ]


def plot_shape(found: Modes, mode: int, ax: Axes | None = None) -> Any:
    """Axes with the shape of one mode as lines, at both ends of its swing."""
    count = len(found.frequencies)
    if found.mechanism is None or found.growth is not None:
        why = "modes about a motion turn" if found.mechanism else "these modes know no mechanism"
        raise DescriptionError(f"modes.plot: {why}, so there is no one shape to draw.")
    if isinstance(mode, bool) or not isinstance(mode, int | np.integer) or not 1 <= mode <= count:
        raise DescriptionError(f"modes.plot: mode {mode!r:.80}. Allowed: 1 to {count}.")
    frequency = float(found.frequencies[mode - 1])
    dynamics = Equations(found.mechanism.flexible)
    period = 1.0 / abs(frequency) if frequency else 1.0
    run = _run(found.mechanism, dynamics, found, int(mode) - 1, 1.0 / period)
    heading = f"{found.mechanism.name}, mode {mode}: {frequency:.4g} Hz"
    return shape_axes(run, heading, ax)


def _run(
    mechanism: Mechanism, dynamics: Equations, found: Modes, k: int, frequency: float
) -> Result:
    system = dynamics.system
    t = np.linspace(0.0, 1.0 / frequency, _INSTANTS)
    swing = np.sin(2 * np.pi * frequency * t)
    shape = found.shapes[:, k] * (_SWING / np.max(np.abs(found.shapes[:, k])))
    y = np.array([dynamics.integrate(found.y, s * shape) for s in swing])
    still = np.zeros((len(t), system.nv))
    run = Run(
        system, t, y, still, still, np.zeros((len(t), system.closed.n)),
        np.zeros((len(t), len(system.motors))), {},
    )  # fmt: skip
    q = np.tile(found.y[: int(system.rigid.nq)], (len(t), 1))
    empty = np.zeros((len(t), int(system.rigid.nv)))
    arrays = recover(mechanism, run, Nominal(t, q, empty, empty))
    known = describe(mechanism, run, "coupled", {}, "")
    meta = {key: find() for key, find in known.items()}
    meta |= {"warnings": [], "limits": [], "monitors": {}, "energy_balance": None}
    drawn = {
        key: value
        for key, value in arrays.items()
        if key.startswith(("joint/q", "frame/", "body/", "link/"))
        and not key.endswith(("resultant", "/velocity", "/acceleration", "von_mises"))
        and "/stress/" not in key
    }
    # the pose at t = 0 is the one linearised about: the drawing's "undeformed"
    for key in list(drawn):
        moving = key.replace("centreline_rigid", "centreline").replace("pose_rigid", "pose")
        if moving != key:
            drawn[key] = np.broadcast_to(drawn[moving][:1], drawn[moving].shape)
    return Result(t, drawn, meta)
