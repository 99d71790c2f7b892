"""A pin in a hole that is larger: loops that are held by contact, at level coupled.

The axes of pin and hole stay parallel where the loop's other rows hold them; across them nothing is
held until the distance e of the centres reaches the clearance c. From there on, with x = e - c,

    F = K x^(3/2) (1 + chi x' / v_0),     K = 4 / (3 (s_a + s_b)) sqrt(R_a R_b / (R_a - R_b))

where s = (1 - nu^2) / E, R_b the pin's radius, R_a = R_b + c, v_0 the speed of approach, and by the
coefficient of restitution e_r

    chi = 3 (1 - e_r^2) / 4        Lankarani and Nikravesh (1990), J. Mech. Design 112, eq. 18
    chi = 8 (1 - e_r) / (5 e_r)    Flores, Machado, Silva, Martins (2011), Multibody Syst. Dyn. 25

The first is for e_r near 1. There is no friction between pin and hole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description.blocks.external import FrameSpring
from pinflex.description.blocks.material import named
from pinflex.description.loops import Loop
from pinflex.mechanics.kinks import FROM, Piece, Row, made
from pinflex.mechanics.model.expanded import Attachment

if TYPE_CHECKING:
    from pinflex.mechanics.model.system import System

_ACROSS = (0, 1)  # axes of frame a that a pin is held along
_HERTZ = 1.5


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
    closed, springs, rows = system.closed, list(system.loads.springs), list(system.kinks.rows)
    names = [closed.names[k] for k in closed.loop_of]
    across = closed.point_rows[np.isin(closed.point_axes, _ACROSS)]
    kept = [r for r, name in enumerate(names) if not (name in cut and r in across)]
    for k, name in enumerate(closed.names):
        if name in cut:
            loop, ends = cut[name], (k, len(closed.names) + k)
            a, b = (_attachment(int(closed.bodies[i]), closed.local[i]) for i in ends)
            chi = damping(loop)
            rim = Piece(0.0, 0.0, 0.0, stiffness(loop), _HERTZ, 0.0, chi)
            law = Piece(FROM, 0.0, 0.0, 0.0), rim
            rows.append(Row(name, -1, 0, False, len(springs), law, pin=True))
            gap = float(loop.clearance or 0.0)
            spring = FrameSpring(name, loop.frame_a, loop.frame_b, 0.0, chi, gap)
            springs.append((spring, a, b))
    loads = replace(system.loads, springs=tuple(springs))
    return replace(system, closed=closed.select(kept), loads=loads, kinks=made(rows))


def pins(system: System, loops: Sequence[Loop], poses: Array) -> dict[str, tuple[Array, Array]]:
    """Where pins are in their holes, in axes of frame a, and the force on them in the world.

    `poses`: of the joints (n, joints, 12). Shapes (n, 3), m and N; without what impacts damp.
    """
    found, closed = {}, system.closed
    wide = {loop.name: loop.clearance for loop in loops if loop.clearance is not None}
    by_name = {row.name: k for k, row in enumerate(system.kinks.rows) if row.pin}
    frames = closed.frames(poses) if wide and by_name else np.zeros((0, 0, 3, 4))
    for k, name in enumerate(closed.names):
        if name in wide and name in by_name:
            a, b = frames[:, k], frames[:, len(closed.names) + k]
            way = b[:, :, 3] - a[:, :, 3]
            off = np.linalg.norm(way, axis=1)
            force = system.kinks.pull(by_name[name], off - (wide[name] or 0.0), 0.0 * off).force
            toward = way / np.maximum(off, 1e-300)[:, None]
            inside = (way[:, None] @ a[:, :, :3])[:, 0]
            found[name] = inside, -force[:, None] * toward
    return found


def _attachment(joint: int, pose: Array) -> Attachment:
    return Attachment(joint, pin.SE3(np.array(pose[:, :3]), np.array(pose[:, 3])))
