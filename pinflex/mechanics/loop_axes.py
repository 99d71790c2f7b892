"""A loop whose axis does not fit the joints around it: a wrong `axis` in a flat mechanism."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.description.loops import ALONG, Loop, loop_kind
from pinflex.rotations import axis_frame

if TYPE_CHECKING:
    from pinflex.mechanics.equations import Equations

_PARALLEL = 1e-6  # sine of the angle of two axes below which they are parallel
_TURNED = 1e-2  # sine of the angle from which a loop's axis is another one
_SHOWN = 4  # joints listed before "..."


def axis_hint(dynamics: Equations, loops: Sequence[Loop], pose: Array) -> str:
    """A sentence for each hinge of a loop whose axis crosses those of all its hinged neighbours.

    Returns:
        Text with a space before it, or "".
    """
    at, system = dynamics.kinematics(pose), dynamics.system
    closed, model = system.closed, system.rigid
    placed, turning = closed.frames(at.poses)[0, :, :, :3], at.J[0, 3:]
    hinged = {
        joint.idx_v: name
        for joint, name in zip(model.joints[1:], model.names[1:], strict=True)
        if joint.nv == 1 and np.linalg.norm(turning[:, joint.idx_v]) > 0.5
    }
    found = []
    for loop in loops:
        k = closed.names.index(loop.name)
        if loop_kind(loop.kind).directions != ALONG:
            continue
        moves = (closed.support_b[k] != closed.support_a[k]).nonzero()[0]
        beside = [int(v) for v in moves if int(v) in hinged]
        turned = [v for v in moves if np.linalg.norm(turning[:, v]) > 0.5]
        if len(beside) < 2 or len(turned) > len(beside):  # a ball or a universal joint turns too
            continue
        frames = placed[k], placed[len(closed.names) + k]
        names = [hinged[v] for v in beside]
        found.append(_hint(loop, frames, turning[:, beside], names))
    return "".join(found)


def _hint(loop: Loop, frames: tuple[Array, Array], axes: Array, names: Sequence[str]) -> str:
    """The sentence for one loop, "" where its axis fits."""
    normal, axis = axes[:, 0], frames[0][:, 2]
    bent = [float(np.linalg.norm(np.cross(normal, beside))) for beside in axes.T]
    if max(bent) > _PARALLEL or np.linalg.norm(np.cross(normal, axis)) < _TURNED:
        return ""
    angle = np.degrees(np.arccos(min(1.0, abs(float(normal @ axis)))))
    shown = f"{', '.join(names[:_SHOWN])}{', ...' if len(names) > _SHOWN else ''}"
    turn = axis_frame(loop.axis, None)
    own = [turn @ frame.T @ normal for frame in frames]
    advice = "Turn one of the frames in the URDF"
    if np.linalg.norm(np.cross(own[0], own[1])) < _PARALLEL:
        advice = f"Write loops.{loop.name}.axis: {_written(own[0])}"
    return (
        f' The axis of loop "{loop.name}" is {angle:.3g} deg off the axes of its neighbours '
        f"({shown}), which are all parallel. {advice}."
    )


def _written(axis: Array) -> str:
    """An axis as the YAML takes it; its sense does not matter."""
    largest = int(np.argmax(np.abs(axis)))
    if abs(axis[largest]) > 1 - _PARALLEL:
        return "xyz"[largest]
    return "[" + ", ".join(f"{x:.4g}" for x in axis) + "]"
