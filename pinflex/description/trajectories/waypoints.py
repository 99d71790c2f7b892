"""The motion of waypoints: a planner's trajectory, interpolated as its controller does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.motions import motion_keys as keys
from pinflex.description.motions.laws import Kinematics
from pinflex.description.motions.trajectory import Motion
from pinflex.description.reading.schema import shown
from pinflex.description.trajectories import messages
from pinflex.description.trajectories.messages import Waypoints
from pinflex.description.trajectories.pieces import Pieces, hermite

_RATES = ("positions", "velocities", "accelerations")
_FEW = 64  # waypoints at which steps end; of more those alone at which an acceleration jumps
_JUMP = 1e-3  # of the largest acceleration: less is round-off of samples


@public
def trajectory(
    file: str | Path | Mapping[str, Any] | None = None,
    *,
    joint_names: Sequence[str] | None = None,
    points: Sequence[Mapping[str, Any]] | None = None,
    header: Mapping[str, Any] | None = None,
    start: Mapping[str, float] | None = None,
) -> Motion:
    """The motion of a ROS JointTrajectory or of a CSV, interpolated as its controller does.

    Between points a quintic polynomial where they have accelerations, a cubic where velocities, as
    ros2_control's joint_trajectory_controller takes. Of positions alone that controller goes
    straight, with a jump of the speed at each point; here it is then a cubic spline from rest to
    rest. Before a first point later than 0 s it goes there from `start`, at rest.

    Args:
        file: .yaml, .yml or .json of the message, .csv with a header `t, NAME.position, ...` (units
            in brackets), or the message as plain data.
        joint_names: Names, without a file. points: Its points: positions, velocities,
            accelerations, time_from_start (seconds, or {sec, nanosec}).
        header: Of the message; not used.
        start: Positions at 0 s [rad | m] by joint; default: those of the first point.
    Raises:
        DescriptionError: A malformed message or table, with line and field.
    """
    if (file is None) == (points is None):
        raise keys.bad("trajectory", "give either file, or joint_names and points.")
    if isinstance(file, str | Path):
        found = messages.read(file)
    elif file is not None or points is not None:
        message: Any = file if file is not None else {"joint_names": joint_names, "points": points}
        found = messages.of_message(message, _inline)
    keys.names(found.names, "joints", "trajectory.joint_names")
    begin = _begin(found, start)
    law = _law(found, begin)
    inner = law.knots[1:-1].tolist() if len(law.knots) <= _FEW + 2 else law.corners(_JUMP)
    spec: dict[str, Any] = {
        "kind": "trajectory",
        "joint_names": [*found.names],
        "points": points_of(found),
    }
    if start is not None:
        spec["start"] = dict(zip(found.names, begin.tolist(), strict=True))
    end = float(found.t[-1])
    return Motion("trajectory", "joints", found.names, end, law, True, spec, tuple(inner))


def points_of(found: Waypoints) -> list[dict[str, Any]]:
    """The points of a message, times in seconds."""
    rows = {field: values.tolist() for field, values in found.values.items()}
    points: list[dict[str, Any]] = []
    for k, time in enumerate(found.t.tolist()):
        points.append({field: values[k] for field, values in rows.items()})
        points[-1]["time_from_start"] = time
    return points


def _inline(*path: str | int) -> str:
    return f"trajectory.{messages.dotted(path)}"


def _begin(found: Waypoints, start: Any) -> Array:
    """Positions at 0 s, shape (joints,)."""
    first: Array = found.values["positions"][0]
    if start is None:
        return first
    if not isinstance(start, Mapping):
        raise keys.bad("trajectory.start", f"{shown(start)} is no mapping. Write {{name: number}}.")
    given = keys.numbers(start, "trajectory.start")
    for name in given:
        if name not in found.names:
            raise keys.bad(f"trajectory.start.{name}", "no joint of the trajectory. Remove it.")
    if found.t[0] == 0.0:
        raise keys.bad("trajectory.start", "the first point is at 0 s. Remove start.")
    return np.array([given.get(name, x) for name, x in zip(found.names, first, strict=True)])


def _law(found: Waypoints, begin: Array) -> Pieces:
    """Pieces through the waypoints, from rest where the first is later than 0 s."""
    t, rows = found.t, [found.values[field] for field in _RATES if field in found.values]
    if t[0] > 0.0:
        t = np.concatenate([[0.0], t])
        rest = np.zeros((1, len(begin)))
        rows = [np.vstack([begin if k == 0 else rest, row]) for k, row in enumerate(rows)]
    if len(rows) > 1:
        return Pieces(t, hermite(t, *rows), rows[0][-1])
    from scipy.interpolate import CubicSpline

    powers = CubicSpline(t, rows[0], bc_type="clamped").c[::-1].swapaxes(0, 1)
    return Pieces(t, np.ascontiguousarray(powers), rows[0][-1])


def slowed(motion: Motion, factor: float) -> Motion:
    """The same path, `factor` times as long."""
    corners = tuple(factor * t for t in motion.switches)
    return replace(
        motion, kind=f"retimed {motion.kind}", law=partial(_stretched, motion.law, factor),
        duration=factor * motion.duration, spec={}, corners=corners,
    )  # fmt: skip


def _stretched(law: Callable[[Array], Kinematics], factor: float, t: Array) -> Kinematics:
    p, v, a = law(t / factor)
    return p, v / factor, a / factor**2
