"""A pose other than home: motors at given positions, the loops closed along the way from home."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError, SceneError, nearest
from pinflex.mechanism import Mechanism
from pinflex.motion import Motion
from pinflex.motors import motor_axes
from pinflex.nominal import nominal

_STRIDE = 0.05  # [rad | m] of a motor between two closures: small against any link's reach


def pose(mechanism: Mechanism, motors: Mapping[str, float]) -> Array:
    """Rigid configuration with motors at given positions; the rest stay at home.

    The loops are followed in small moves from home, so the branch is kept, and a singular pose on
    the way is found.

    Args:
        mechanism: Mechanism with its home pose.
        motors: Position (rad | m) by motor.

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
    if not motors:
        return mechanism.home
    home = motor_axes(mechanism).read(mechanism.home)
    start = np.array([home[names.index(name)] for name in motors])
    way = np.array(list(motors.values()), float) - start

    def straight(t: Array) -> tuple[Array, Array, Array]:
        part = np.outer(t, way)
        return start + part, np.tile(way, (len(t), 1)), np.zeros_like(part)

    moves = 1 + int(np.ceil(np.max(np.abs(way)) / _STRIDE))
    line = Motion("straight", "joints", tuple(motors), 1.0, straight, absolute=True)
    try:
        return np.array(nominal(mechanism, line, np.linspace(0.0, 1.0, moves + 1)).q[-1])
    except SceneError as error:
        time = getattr(error, "time", None)
        if time is None:
            raise
        at = ", ".join(f"{n} = {x:.4g}" for n, x in zip(motors, start + time * way, strict=True))
        text = str(error).replace(f"t = {time:.6g} s", f"pose: on the way from home, at {at}")
        raise type(error)(text, **error.data) from None
