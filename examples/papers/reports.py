"""What the papers on flexible parallel robots tabulate: platform errors and torque statistics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError, nearest
from pinflex.results.result import Result, same_grid
from pinflex.results.views import worst_section
from pinflex.rotations import rotation_vector
from pinflex.text import brief

AXES = ("X", "Y", "Z")


@dataclass(frozen=True)
class PlatformErrors:
    """Flexible minus rigid motion of a frame, in the world frame.

    Attributes:
        t: Times, shape (nt,), s.
        frame: Its name.
        linear: Whether these are the linear deviations of kineto-elastodynamics.
        position: Errors of the origin X, Y, Z (m), and rotation: small rotation about X, Y, Z
            (rad), each (nt, 3).
        velocity, angular_velocity: Their rates (m/s, rad/s), each (nt, 3).
        acceleration, angular_acceleration: (m/s^2, rad/s^2), each (nt, 3).
    """

    __repr__ = brief

    t: Array
    frame: str
    linear: bool
    position: Array
    rotation: Array
    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array

    def groups(self) -> dict[str, tuple[Array, str]]:
        """The six groups of three curves with their units."""
        return {
            "position": (self.position, "m"),
            "rotation": (self.rotation, "rad"),
            "velocity": (self.velocity, "m/s"),
            "angular velocity": (self.angular_velocity, "rad/s"),
            "acceleration": (self.acceleration, "m/s^2"),
            "angular acceleration": (self.angular_acceleration, "rad/s^2"),
        }

    def extremes(self) -> dict[str, Array]:
        """Signed value of largest magnitude per axis, shape (3,), by group."""
        return {name: signed_peak(values) for name, (values, _) in self.groups().items()}

    def text(self) -> str:
        """The extremes as a table."""
        lines = [f"{'error of ' + self.frame:<24}" + "".join(f"{axis:>13}" for axis in AXES)]
        for name, (values, unit) in self.groups().items():
            cells = "".join(f"{x:13.4g}" for x in signed_peak(values))
            lines.append(f"{name + ' [' + unit + ']':<24}{cells}")
        return "\n".join(lines)


def platform_errors(
    result: Result, rigid: Result, frame: str | None = None, linear: bool | None = None
) -> PlatformErrors:
    """Six errors of a frame with their rates and accelerations: flexible minus rigid.

    Args:
        result: Flexible run. rigid: The same motion, rigid, on the same instants.
        frame: Default: the platform.
        linear: Take the linear deviation J d of level ked, as the papers do, instead of the
            difference of the poses (they differ by the square of the deviation). Default: where
            the run is linear (`ked="structural"`).
    Returns:
        The errors. Rotations are about the world axes, not differences of Euler angles.
    """
    same_grid(result, rigid)
    name = _frame(result, frame)
    key = f"frame/{name}/deviation"
    if linear is None:
        linear = key in result.arrays and result.meta["settings"].get("terms") == "structural"
    if linear:
        if key not in result.arrays:
            raise DescriptionError(
                f"platform_errors: a {result.level} run has no linear deviation. "
                'Solve with level="ked", or take linear=False.'
            )
        e, de, dde = (result.array(key + end) for end in ("", "_rate", "_acceleration"))
    else:
        mine, other = result.frame(name), rigid.frame(name)
        turn = rotation_vector(mine.rotation @ np.swapaxes(other.rotation, 1, 2))
        e = np.hstack([mine.position - other.position, turn])
        de = mine.velocity - other.velocity
        dde = mine.acceleration - other.acceleration
    halves = [x for value in (e, de, dde) for x in (value[:, :3], value[:, 3:])]
    return PlatformErrors(result.t, name, linear, *halves)


def _frame(result: Result, frame: str | None) -> str:
    if frame is not None:
        names = result.meta["frames"]
        if frame not in names:
            raise DescriptionError(
                f"platform_errors: {frame}: no such frame.{nearest(frame, names)}"
            )
        return frame
    if result.meta.get("platform") is None:
        raise DescriptionError(
            "platform_errors: the model has no platform. Give `frame`, or `platform:` in the YAML."
        )
    return str(result.meta["platform"])


def signed_peak(values: Array) -> Array:
    """Entry of largest magnitude of every column, with its sign."""
    at = np.argmax(np.abs(values), axis=0)
    return np.asarray(values[at, np.arange(values.shape[1])])


@dataclass(frozen=True)
class Statistics:
    """One curve in numbers: largest, smallest, mean of the magnitude (the papers' table 1)."""

    __repr__ = brief

    name: str
    max: float
    min: float
    mean_abs: float

    @property
    def max_abs(self) -> float:
        """Largest magnitude."""
        return max(abs(self.max), abs(self.min))


def statistics(name: str, values: Array) -> Statistics:
    """Statistics of one curve over its instants, the first one included."""
    mean = float(np.mean(np.abs(values)))
    return Statistics(name, float(np.max(values)), float(np.min(values)), mean)


def torque_statistics(result: Result) -> tuple[Statistics, ...]:
    """Statistics of every motor's torque."""
    torque = result.torque
    return tuple(statistics(name, torque[:, k]) for k, name in enumerate(result.motors))


def torque_table(flexible: Result, rigid: Result) -> str:
    """Flexible beside rigid torques: max, min, mean magnitude, and the ratio of the largest."""
    same_grid(flexible, rigid)
    head = f"{'torque [N m | N]':<18}{'max':>10}{'min':>10}{'mean |.|':>10}"
    lines = [head + f"{'rigid max':>11}{'rigid mean':>12}{'ratio':>8}"]
    for mine, other in zip(torque_statistics(flexible), torque_statistics(rigid), strict=True):
        ratio = mine.max_abs / other.max_abs if other.max_abs else float("inf")
        lines.append(
            f"{mine.name:<18}{mine.max:10.4f}{mine.min:10.4f}{mine.mean_abs:10.4f}"
            f"{other.max_abs:11.4f}{other.mean_abs:12.4f}{ratio:8.3f}"
        )
    return "\n".join(lines)


def worst_table(result: Result, kinds: tuple[str, ...] = ("normal", "shear", "von_mises")) -> str:
    """Worst section of every link, one line each.

    Args:
        result: A flexible run.
        kinds: Of stress, as in `worst_section`.
    """
    lines = [f"{'link':<14}{'stress':<11}{'MPa':>9}{'x [m]':>9}{'t [s]':>9}"]
    for name in result.links:
        for kind in kinds:
            w = worst_section(result, kind, name)
            lines.append(f"{name:<14}{kind:<11}{w.value / 1e6:9.3f}{w.x:9.4f}{w.t:9.4f}")
    return "\n".join(lines)
