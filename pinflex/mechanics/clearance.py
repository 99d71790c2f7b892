"""Joints with clearance: loops that are held by contact, at level coupled.

A pin in a larger hole, a ball in a larger socket, a slider in a wider guide. What the clearance
lets go is held by nothing until it is used up: until the distance e of the centres reaches the
clearance c, or a corner of the slider its wall. From there on, with x = e - c,

    F = K x^(3/2) (1 + chi x' / v_0),     K = 4 / (3 (s_a + s_b)) sqrt(R_a R_b / (R_a - R_b))

where s = (1 - nu^2) / E, R_b the pin's radius, R_a = R_b + c, v_0 the speed of approach, and by the
coefficient of restitution e_r

    chi = 3 (1 - e_r^2) / 4        Lankarani and Nikravesh (1990), J. Mech. Design 112, eq. 18
    chi = 8 (1 - e_r) / (5 e_r)    Flores, Machado, Silva, Martins (2011), Multibody Syst. Dyn. 25

The first is for e_r near 1. `rigid` is the limit of stiff bodies: x' is given back at once
(`pinflex.integrators.events`). Where it slides it is rubbed by mu F tanh(speed / v_s).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.description.blocks.material import named
from pinflex.description.loops import Loop
from pinflex.mechanics.kinks import FROM, Piece, Row, made, resting
from pinflex.mechanics.model.expanded import Attachment
from pinflex.mechanics.model.loads import BALL, PIN, WALL, Touch

if TYPE_CHECKING:
    from pinflex.mechanics.evaluation.equations import Equations
    from pinflex.mechanics.model.system import System

_HERTZ = 1.5
_SLIDING = 1e-3  # m/s: friction is smoothed below, as that of joints


def stiffness(loop: Loop) -> float:
    """K of the pin of a loop in its hole [N/m^1.5]."""
    assert loop.clearance is not None
    material, radius = named(loop.pin_material), 0.5 * (loop.pin or 0.0)
    softness = 2.0 * (1.0 - material.nu**2) / material.E
    apart = radius * (radius + loop.clearance) / loop.clearance
    return float(4.0 / (3.0 * softness) * apart**0.5)


def damping(loop: Loop) -> float:
    """chi of a loop."""
    e = loop.restitution
    if loop.contact == "flores":
        return 8.0 * (1.0 - e) / (5.0 * e)
    return 0.75 * (1.0 - e**2)


def with_clearance(system: System, loops: Sequence[Loop]) -> System:
    """A system whose loops with clearance are held by contact."""
    cut = {loop.name: loop for loop in loops if loop.clearance is not None}
    if not cut:
        return system
    closed, touches, rows = system.closed, list(system.loads.touches), list(system.kinks.rows)
    kept = np.ones(closed.n, dtype=bool)
    mass = sum(inertia.mass for inertia in system.expansion.model.inertias)
    for k, name in enumerate(closed.names):
        if name not in cut:
            continue
        loop, ends = cut[name], (k, len(closed.names) + k)
        a, b = (_attachment(int(closed.bodies[i]), closed.local[i]) for i in ends)
        kept[_let_go(system, k, loop)] = False
        for touch in _touches(loop, a, b):
            touches.append(touch._replace(law=len(rows)))
            back = loop.restitution if loop.contact == "rigid" else -1.0
            rows.append(Row(name, -1, 0, False, -1, _law(loop, mass), back, 0, touch.gap))
    loads = replace(system.loads, touches=tuple(touches))
    return replace(system, closed=closed.select(np.flatnonzero(kept)), loads=loads,
                   kinks=made(rows))  # fmt: skip


def _law(loop: Loop, mass: float) -> tuple[Piece, ...]:
    free = Piece(FROM, 0.0, 0.0, 0.0)
    if loop.contact == "rigid":
        return free, resting(0.0, mass)
    return free, Piece(0.0, 0.0, 0.0, stiffness(loop), _HERTZ, 0.0, damping(loop))


def _let_go(system: System, k: int, loop: Loop) -> IntArray:
    """Rows of the k-th loop that its clearance leaves."""
    closed = system.closed
    if loop.kind == "prismatic":
        axes, about = [0], (2, 0)  # across, and turning about the third axis
    else:
        axes = [0, 1, 2] if loop.kind == "spherical" or loop.axial is not None else [0, 1]
        about = (-1, -1)
    points = closed.point_rows[np.isin(closed.point_axes, axes)]
    turns = closed.dot_rows[(closed.dot_a == about[0]) & (closed.dot_b == about[1])]
    rows = np.concatenate([points, turns])
    mine: IntArray = rows[closed.loop_of[rows] == k]
    return mine


def _touches(loop: Loop, a: Attachment, b: Attachment) -> Iterator[Touch]:
    """Where the bodies of a loop may touch."""
    gap, mu, R = loop.clearance or 0.0, loop.friction, a.placement.rotation
    one = Touch(loop.name, PIN, a, b, _axis(R, 2), gap, 0.5 * (loop.pin or 0.0), mu, _SLIDING, 0)
    if loop.kind == "prismatic":
        x, z = np.array(_axis(b.placement.rotation, 0)), np.array(_axis(b.placement.rotation, 2))
        half, end = 0.5 * loop.height, 0.5 * (loop.length or 0.0)
        for side in (1.0, -1.0):
            for way in (1.0, -1.0):
                at = pin.SE3(b.placement)
                at.translation = at.translation + side * half * x + way * end * z
                corner, wall = Attachment(b.joint, at), _axis(side * R, 0)
                yield one._replace(shape=WALL, b=corner, axis=wall, gap=half + gap, radius=0.0)
        return
    yield one._replace(shape=BALL) if loop.kind == "spherical" else one
    if loop.axial is not None:
        for side in (1.0, -1.0):
            yield one._replace(shape=WALL, axis=_axis(side * R, 2), gap=loop.axial, radius=0.0)


def _axis(R: Array, k: int) -> tuple[float, float, float]:
    x, y, z = R[:, k].tolist()
    return x, y, z


def pins(equations: Equations, Y: Array, V: Array, A: Array) -> dict[str, tuple[Array, Array]]:
    """Where pins are in their holes, in axes of frame a, and the wrench on them in the world.

    Shapes (n, 3) and (n, 6), m, N and N m, about the origin of frame b; without what impacts damp.
    """
    system, found = equations.system, dict[str, tuple[Array, Array]]()
    touches, closed = system.loads.touches, system.closed
    if not touches:
        return found
    joints = sorted({end.joint for one in touches for end in (one.a, one.b)} - {0})
    poses, rates = equations.motions(Y, V, A, joints)
    places = dict(zip(joints, zip(poses, rates[:, :, 0], strict=True), strict=True))
    n = len(Y)
    places[0] = np.tile(np.eye(4)[:3], (n, 1, 1)), np.zeros((n, 6))
    frames = closed.frames(equations.joint_poses(Y))
    for one in touches:
        loop = closed.names.index(one.name)
        frame_a, frame_b = frames[:, loop], frames[:, len(closed.names) + loop]
        R, seen, corner = _seen(one, places)
        acts = one.force(seen, system.kinks)
        F, M = ((R @ x[:, :, None])[:, :, 0] for x in (acts.force, acts.moment))
        wrench = np.concatenate([F, M + np.cross(corner - frame_b[:, :, 3], F)], axis=1)
        way = frame_b[:, :, 3] - frame_a[:, :, 3]
        place = (way[:, None] @ frame_a[:, :, :3])[:, 0]
        before = found.get(one.name, (place, np.zeros((n, 6))))[1]
        found[one.name] = place, before + wrench
    return found


def _seen(one: Touch, places: dict[int, tuple[Array, Array]]) -> tuple[Array, Array, Array]:
    """Axes of A (n, 3, 3), the motion of B as A sees it (n, 9), and the place of b (n, 3)."""
    point, speed, spin = [], [], []
    for end in (one.a, one.b):
        pose, twist = places[end.joint]
        R, local = pose[:, :, :3], end.placement.translation
        point.append(pose[:, :, 3] + R @ local)
        own = twist[:, :3] + np.cross(twist[:, 3:], local)
        speed.append((R @ own[:, :, None])[:, :, 0])
        spin.append((R @ twist[:, 3:, None])[:, :, 0])
    R, d = places[one.a.joint][0][:, :, :3], point[1] - point[0]
    way = speed[1] - speed[0] - np.cross(spin[0], d)
    seen = [(x[:, None] @ R)[:, 0] for x in (d, way, spin[1] - spin[0])]
    return R, np.concatenate(seen, axis=1), point[1]


def _attachment(joint: int, pose: Array) -> Attachment:
    return Attachment(joint, pin.SE3(np.array(pose[:, :3]), np.array(pose[:, 3])))
