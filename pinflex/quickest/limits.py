"""What a motion may ask: along its path, of the motors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motions.motion import Motion
from pinflex.description.robots.urdf import Limits as UrdfLimits
from pinflex.description.robots.urdf import limits as urdf_limits
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.mechanism import Mechanism

KEYS = ("speed", "acceleration", "jerk", "torque", "motor_speed")
_OF_PATH = KEYS[:3]


@dataclass(frozen=True)
class Limits:
    """Limits of a motion with one profile; infinite where there is none.

    Attributes:
        speed, acceleration, jerk: Along the path, where it is 1 long [1/s, 1/s^2, 1/s^3]; nan: a
            jerk that follows from the others.
        torque: Of each motor [N m | N], shape (nm,).
        motor_speed: Of each motor [rad/s | m/s], shape (nm,).
    """

    speed: float
    acceleration: float
    jerk: float
    torque: Array
    motor_speed: Array

    @property
    def jumps(self) -> bool:
        """Whether acceleration may jump."""
        return self.jerk == np.inf


def limits_of(
    mechanism: Mechanism, target: str, moves: Mapping[str, float], given: Mapping[str, Any] | None
) -> Limits:
    """Those that are given, over those of the URDF.

    Raises:
        DescriptionError: A limit or a name that there is not, or a number that is none.
    """
    asked = dict(given or {})
    for key in asked:
        if key not in KEYS:
            raise DescriptionError(f"fastest: limits.{key}: no such limit.{nearest(key, KEYS)}")
    known = urdf_limits(mechanism.description.urdf_text)
    urdf = [known.get(name, UrdfLimits()) for name in mechanism.motors]
    torque = np.array([x.effort or np.inf for x in urdf])
    speed = np.array([x.velocity or np.inf for x in urdf])
    if target == "joints" and "speed" in asked:
        asked.setdefault("motor_speed", asked["speed"])
    path = {key: _along(key, asked.get(key), moves) for key in _OF_PATH}
    if asked.get("jerk") is None:
        path["jerk"] = np.nan
    return Limits(
        **path,
        torque=_each("torque", asked.get("torque"), mechanism.motors, torque),
        motor_speed=_each("motor_speed", asked.get("motor_speed"), mechanism.motors, speed),
    )


def of_motion(mechanism: Mechanism, motion: Motion, jerk: float = 6.0) -> dict[str, Any]:
    """The limits that a motion just keeps: speed, `jerk` times its jerk, torque of the coupled run.

    One number for all motors and one for all coordinates, as of equal motors.
    """
    from pinflex.advice.solve import solve

    t = np.linspace(0.0, motion.duration, 4001)
    _, v, a = motion.evaluate(t)
    run = solve(mechanism, motion, level="coupled", tol=1e-5, until=motion.duration, samples=1601)
    far = int(np.argmax(np.abs(v).max(axis=0)))
    return {
        "speed": float(np.abs(v[:, far]).max()),
        "jerk": jerk * float(np.abs(np.gradient(a[:, far], t)).max()),
        "torque": float(np.abs(run.torque).max()),
    }


def _number(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0.0:
        raise DescriptionError(f"fastest: limits.{key}: {value!r}. Give a number above 0, in SI.")
    return float(value)


def _along(key: str, value: Any, moves: Mapping[str, float]) -> float:
    """A limit of every coordinate as one along the path."""
    if value is None:
        return np.inf
    by_name = value if isinstance(value, Mapping) else dict.fromkeys(moves, value)
    for name in by_name:
        if name not in moves:
            raise DescriptionError(f"fastest: limits.{key}.{name}: it does not move."
                                   f"{nearest(name, moves)}")  # fmt: skip
    every = [
        _number(f"{key}.{name}", one) / abs(moves[name])
        for name, one in by_name.items()
        if moves[name]
    ]
    return min(every, default=np.inf)


def _each(key: str, value: Any, motors: tuple[str, ...], known: Array) -> Array:
    """A limit of every motor, over those of the URDF."""
    if value is None:
        return known
    by_name = value if isinstance(value, Mapping) else dict.fromkeys(motors, value)
    for name in by_name:
        if name not in motors:
            raise DescriptionError(f"fastest: limits.{key}.{name}: not a motor."
                                   f"{nearest(name, motors)}")  # fmt: skip
    mine = {name: _number(f"{key}.{name}", one) for name, one in by_name.items()}
    return np.array([mine.get(name, x) for name, x in zip(motors, known, strict=True)])


def with_jerk(limits: Limits, jerk: float) -> Limits:
    """The same with a jerk where none was given."""
    return replace(limits, jerk=jerk) if np.isnan(limits.jerk) else limits
