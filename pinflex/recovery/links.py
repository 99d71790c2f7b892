"""Deflection, section forces, stress and shape of flexible links, from the samples of a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.evaluation.equations import Equations, section_forces
from pinflex.mechanics.evaluation.frames import poses_of_frames
from pinflex.mechanics.model.expanded import Attachment, Slot
from pinflex.recovery import solids, stress
from pinflex.recovery.kinematics import pose_of
from pinflex.recovery.samples import Samples
from pinflex.rotations import rotation_vector, zyx_matrix


def links(samples: Samples) -> dict[str, Array]:
    """Arrays link/NAME/... of a Result."""
    mechanism, poses = samples.mechanism, samples.kinematics.poses
    reference, frames = samples.rigid_poses, mechanism.rigid.expansion.frames
    if reference is None:
        reference, frames = poses, samples.run.system.expansion.frames
    out = dict[str, Array]()
    for name, part in mechanism.parts.items():
        slots = _slots(samples, name)
        roots = np.array([pose_of(poses, slot.root) for slot in slots])
        pieces = [_piece(samples, slot, (k, roots), out) for k, slot in enumerate(slots)]
        x, resultant, line, turned = map(_joined, zip(*pieces, strict=True))
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
        frame = frames[name]
        rigid = pose_of(reference, Attachment(frame.joint, frame.placement * part.placement))
        out[f"{key}/centreline_rigid"] = (
            rigid[:, None, :, 3] + rigid[:, None, :, 0] * x[None, :, None]
        )
    return out


def resultants(samples: Samples) -> dict[str, Array]:
    """Section forces of each flexible link [N, N m], shape (nt, nx, 6), as `links` has them."""
    out, found = dict[str, Array](), dict[str, Array]()
    for name in samples.mechanism.parts:
        slots = _slots(samples, name)
        roots = np.array([pose_of(samples.kinematics.poses, slot.root) for slot in slots])
        found[name] = _joined([
            _forces(samples, slot, (k, roots), out)[1]
            for k, slot in enumerate(slots)
        ])  # fmt: skip
    return found


def _slots(samples: Samples, name: str) -> list[Slot]:
    return [slot for slot in samples.run.system.expansion.slots if slot.link == name]


def _joined(values: Sequence[Array]) -> Array:
    """Sections of the bodies of a link in a row; two bodies share the one between them."""
    return np.concatenate([values[0], *(v[:, 1:] for v in values[1:])], axis=1)


def _forces(
    samples: Samples, slot: Slot, among: tuple[int, Array], out: dict[str, Array]
) -> tuple[Array, Array]:
    """Deflections and section forces of one body of a link, each (nt, nx, 6).

    A solid body adds the stress on its surface to `out`.
    """
    run = samples.run
    eta = run.y[:, int(run.system.rigid.nq) :][:, slot.eta]
    d = stress.deflections(slot.body.cut, eta)
    # A linear run has its forces on the undeformed link.
    deflected = (0.0 * d, 0.0 * eta) if run.linear else (d, eta)
    forces = _section_forces(samples, slot, *deflected, out)
    for contact, table in samples.forces.sleeves:
        if contact.sleeve.link == slot.link:
            forces += section_forces(slot.body.cut.x, table, *among)
    return d, forces


def _piece(
    samples: Samples, slot: Slot, among: tuple[int, Array], out: dict[str, Array]
) -> tuple[Array, Array, Array, Array]:
    """Stations (1, nx), section forces, centre line and section rotations of one body of a link."""
    d, forces = _forces(samples, slot, among, out)
    root, x = among[1][among[0]], slot.body.cut.x
    line = centre_line(d, x, root[:, :, :3], root[:, :, 3])
    turned = root[:, None, :, :3] @ zyx_matrix(d[:, :, 3:])
    return (slot.offset + x)[None], forces, line, turned


def centre_line(d: Array, x: Array, R: Array, p: Array) -> Array:
    """Sections of a body in the world [m], shape (nt, nx, 3)."""
    local = d[:, :, :3].copy()
    local[:, :, 0] += x
    return np.asarray(local @ R.swapaxes(1, 2) + p[:, None])


def off_straight(line: Array, x: Array, R: Array, p: Array) -> Array:
    """How far sections are off a straight link [m], in the frame of its root, shape (nt, nx, 3)."""
    back = (line - p[:, None]) @ R
    back[:, :, 0] -= x
    return np.asarray(back)


def _section_forces(
    samples: Samples, slot: Slot, d: Array, eta: Array, out: dict[str, Array]
) -> Array:
    """Section forces (nt, nx, 6) under deflections d (nt, nx, 6) at coordinates eta (nt, n)."""
    g = samples.forces.g
    loads = [(i.x, *samples.interface_load(i)) for i in slot.interfaces]
    if slot.body.solid is None:
        forces = g[:, slot.stations], g[:, slot.twists]
        return stress.resultants(slot.body.cut, slot.body, d, *forces, loads, eta)
    solid, pull, hung = slot.body.solid, g[:, slot.stations], [load[1:] for load in loads]
    for key, value in solids.surface(solid, pull, hung).items():
        out[f"link/{slot.link}/mesh/{key}"] = value
    return solids.resultants(solid, d, pull, hung, eta)


# Deflections of the sections of flexible links, from elastic coordinates alone.


def deflections(dynamics: Equations, y: Array) -> dict[str, tuple[Array, Array]]:
    """By link: sections x (nx,), m, and how far they move in the link's root frame, (n, nx, 3).

    The sections and values are those of the first three columns of a Result's `deflection`.
    """
    slots = dynamics.system.expansion.slots
    by_link: dict[str, list[Slot]] = {}
    for slot in slots:
        by_link.setdefault(slot.link, []).append(slot)
    eta, found = y[:, int(dynamics.system.rigid.nq) :], {}
    for link, own in by_link.items():
        at, moved = [], []
        # Bodies beyond the first ride on the one before: where to, their roots say.
        roots = poses_of_frames(dynamics, y, [s.root for s in own]) if own[1:] else []
        for k, slot in enumerate(own):
            cut = slot.body.cut
            d = stress.deflections(cut, eta[:, slot.eta])[:, :, :3]
            if k:
                line = centre_line(d, cut.x, *roots[k])
                d = off_straight(line, slot.offset + cut.x, *roots[0])
            at.append(slot.offset + cut.x[min(k, 1) :])
            moved.append(d[:, min(k, 1) :])
        found[link] = np.concatenate(at), np.concatenate(moved, axis=1)
    return found
