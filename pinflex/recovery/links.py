"""Deflection, section forces, stress and shape of flexible links, from the samples of a run."""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.contact import section_forces
from pinflex.mechanics.expanded import Attachment, Slot
from pinflex.recovery import solids, stress
from pinflex.recovery.kinematics import pose_of
from pinflex.recovery.samples import Samples
from pinflex.rotations import rotation_vector, zyx_matrix

# Per body: a smooth curve on the screen and every maximum within 0.1 % of a parabola.
SECTIONS = 21


def links(samples: Samples) -> dict[str, Array]:
    """Arrays link/NAME/... of a Result."""
    mechanism, run, poses = samples.mechanism, samples.run, samples.kinematics.poses
    reference = poses if samples.rigid_poses is None else samples.rigid_poses
    out = dict[str, Array]()
    bodies = {id(s.body): s.body for s in run.system.expansion.slots}
    cuts = {key: stress.cut(body, SECTIONS) for key, body in bodies.items()}
    for name, part in mechanism.parts.items():
        slots = [s for s in run.system.expansion.slots if s.link == name]
        roots = np.array([pose_of(poses, slot.root) for slot in slots])
        pieces = [
            _piece(samples, slot, cuts[id(slot.body)], (k, roots), out)
            for k, slot in enumerate(slots)
        ]
        # two bodies share the section between them
        x, resultant, line, turned = (
            np.concatenate([values[0], *(v[:, 1:] for v in values[1:])], axis=1)
            for values in zip(*pieces, strict=True)
        )
        x, home = x[0], pose_of(poses, slots[0].root)
        back = off_straight(line, x, home[:, :, :3], home[:, :, 3])
        spin = rotation_vector(np.swapaxes(home[:, None, :, :3], 2, 3) @ turned)
        key = f"link/{name}"
        out[f"{key}/x"] = x
        out[f"{key}/deflection"] = np.concatenate([back, spin], axis=2)
        out[f"{key}/resultant"] = resultant
        for kind, value in stress.stresses(part.spec.section, resultant).items():
            out[f"{key}/stress/{kind}"] = value
        out[f"{key}/centreline"] = line
        out[f"{key}/section_y"] = turned[:, :, :, 1]
        frame = mechanism.rigid.expansion.frames[name]
        rigid = pose_of(reference, Attachment(frame.joint, frame.placement * part.placement))
        out[f"{key}/centreline_rigid"] = (
            rigid[:, None, :, 3] + rigid[:, None, :, 0] * x[None, :, None]
        )
    return out


def _piece(
    samples: Samples,
    slot: Slot,
    section: stress.Cut,
    among: tuple[int, Array],
    out: dict[str, Array],
) -> tuple[Array, Array, Array, Array]:
    """Stations (1, nx), section forces, centre line and section rotations of one body of a link.

    A solid body adds the stress on its surface to `out`.

    Args:
        samples: Of the run. slot: The body. section: Where it is cut.
        among: Its number on the link, and the root frames of all, shape (bodies, nt, 3, 4).
        out: Arrays of the Result.
    """
    run = samples.run
    eta = run.y[:, int(run.system.rigid.nq) :][:, slot.eta]
    d = stress.deflections(section, eta)
    # A linear run has its forces on the undeformed link.
    deflected = (0.0 * d, 0.0 * eta) if run.linear else (d, eta)
    forces = _section_forces(samples, slot, section, *deflected, out)
    for contact, table in samples.forces.sleeves:
        if contact.sleeve.link == slot.link:
            forces += section_forces(section.x, table, *among)
    root = among[1][among[0]]
    line = centre_line(d, section.x, root[:, :, :3], root[:, :, 3])
    turned = root[:, None, :, :3] @ zyx_matrix(d[:, :, 3:])
    return (slot.offset + section.x)[None], forces, line, turned


def centre_line(d: Array, x: Array, R: Array, p: Array) -> Array:
    """Sections of a body in the world [m], shape (nt, nx, 3).

    Args:
        d: How far they are moved [m], the first three of shape (nt, nx, .).
        x: Where they are on the body [m], shape (nx,).
        R, p: Pose of its root, shapes (nt, 3, 3) and (nt, 3).
    """
    local = d[:, :, :3].copy()
    local[:, :, 0] += x
    return np.asarray(local @ R.swapaxes(1, 2) + p[:, None])


def off_straight(line: Array, x: Array, R: Array, p: Array) -> Array:
    """How far sections are off a straight link [m], in the frame of its root, shape (nt, nx, 3).

    Args:
        line: Of the sections in the world [m], shape (nt, nx, 3).
        x: Where they are on the link [m], shape (nx,).
        R, p: Pose of its root, shapes (nt, 3, 3) and (nt, 3).
    """
    back = (line - p[:, None]) @ R
    back[:, :, 0] -= x
    return np.asarray(back)


def _section_forces(
    samples: Samples, slot: Slot, section: stress.Cut, d: Array, eta: Array, out: dict[str, Array]
) -> Array:
    """Section forces (nt, nx, 6) under deflections d (nt, nx, 6) at coordinates eta (nt, n)."""
    g = samples.forces.g
    loads = [
        (i.x, *samples.interface_load(i.attachment.joint, i.force_rows)) for i in slot.interfaces
    ]
    if slot.body.solid is None:
        return stress.resultants(
            section, slot.body, d, g[:, slot.stations], g[:, slot.twists], loads, eta
        )
    solid, pull, hung = slot.body.solid, g[:, slot.stations], [load[1:] for load in loads]
    for key, value in solids.surface(solid, pull, hung).items():
        out[f"link/{slot.link}/mesh/{key}"] = value
    return solids.resultants(solid, d, pull, hung, eta)
