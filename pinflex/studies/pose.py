"""A pose other than home: motors at given positions, the loops closed along the way from home."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import pinocchio as pin

from pinflex.actuation.motors import motor_axes
from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array
from pinflex.description.motion import Motion
from pinflex.description.motion_keys import PLATFORM_COORDINATES
from pinflex.errors import DescriptionError, SceneError, nearest
from pinflex.linalg import null_space
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.frames import frame_jacobian, frame_pose
from pinflex.mechanics.mechanism import Mechanism

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
