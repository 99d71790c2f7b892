"""Deflection, section forces, stress and shape of flexible links, from the samples of a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.basis import Cut, FlexibleBody
from pinflex.bodies.superelement import Superelement
from pinflex.description.section import Section
from pinflex.mechanics.evaluation.equations import Equations, section_forces
from pinflex.mechanics.evaluation.frames import poses_of_frames
from pinflex.mechanics.model.loads import Attachment, Slot
from pinflex.recovery.kinematics import Samples, pose_of
from pinflex.rotations import cross, rotation_vector, zyx_matrix

# Section forces of a reduced solid, and von Mises stress on the surface of its mesh.


def solid_resultants(
    solid: Superelement,
    d: Array,
    station: Array,
    loads: Sequence[tuple[Array, Array]],
    eta: Array,
) -> Array:
    """Section forces N, Vy, Vz, T, My, Mz, shape (nt, nx, 6), as those of a beam.

    The mass beyond a section needs a force that is linear in the forces of the mass points; its
    moment arms are the undeformed ones.
    """
    force = np.einsum("xs,tsd->txd", solid.cut.outer, station, optimize=True)
    arm, pull = solid.outer_moment, station
    moment = np.empty_like(force)
    for a, (b, c) in enumerate(((1, 2), (2, 0), (0, 1))):
        moment[:, :, a] = pull[:, :, c] @ arm[:, :, b].T - pull[:, :, b] @ arm[:, :, c].T
    for node, (push, turn) in zip(solid.nodes, loads, strict=True):
        beyond = solid.cut.x <= max(node.place[0], 0.0) * (1.0 + 1e-9)
        at = node.place + eta @ node.Phi[:3].T
        force[:, beyond] += push[:, None]
        moment[:, beyond] += (turn + cross(at, push))[:, None]
    place = d[:, :, :3].copy()
    place[:, :, 0] += solid.cut.x
    moment -= cross(place, force)
    return -np.concatenate([force, moment], axis=2)


def surface(
    solid: Superelement, station: Array, loads: Sequence[tuple[Array, Array]]
) -> dict[str, Array]:
    """Arrays on the surface of the mesh, by name: nodes, triangles and von_mises.

    The stress is that of the solid under the forces that its mass and what hangs on it need, so it
    is in balance with them however few modes there are (mode acceleration). Rigid interfaces hold
    their faces flat: within a diameter of them the stress is that of this support.

    Returns:
        nodes (nc, 3) in the beam frame of the undeformed link (m), triangles (ntri, 3), von_mises
        (nt, nc) in Pa; nothing for a body without mesh.
    """
    if solid.stress is None:
        return {}
    need = [station.reshape(len(station), -1), *(part for load in loads for part in load)]
    s = np.einsum("cak,tk->tac", solid.stress, np.concatenate(need, axis=1), optimize=True)
    mises = np.sqrt(
        0.5 * ((s[:, 0] - s[:, 1]) ** 2 + (s[:, 1] - s[:, 2]) ** 2 + (s[:, 2] - s[:, 0]) ** 2)
        + 3.0 * (s[:, 3] ** 2 + s[:, 4] ** 2 + s[:, 5] ** 2)
    )
    nodes, triangles = solid.corners, solid.triangles.astype(float)
    return {"nodes": nodes, "triangles": triangles, "von_mises": mises}


# Section forces and stresses of a flexible body, from the forces that its stations need.
#
# Cut the link at x: the inner part must give the outer part the force R(x) and moment that its
# masses and whatever hangs on it need. That balance is exact where the shapes' own curvature (EI
# v'') is not yet converged, and it gives the axial force of links that have no axial mode.


_PLACES, _TURNS = slice(0, 3), slice(3, 6)
_AT_ONCE = 1 << 12  # sections over all fibres: they stay in the cache


def section_deflections(section: Cut, eta: Array, rows: slice = slice(None)) -> Array:
    """Rows (u, v, w, rz, ry, rx) over time, shape (nt, nx, 6), for eta of shape (nt, n).

    `rows`: only some of them.
    """
    Phi, G = section.Phi[:, rows], None if section.G is None else section.G[:, rows]
    (sections, height, n), count = Phi.shape, len(eta)
    d: Array = eta @ Phi.reshape(-1, n).T
    if G is not None:
        pairs = (eta[:, :, None] * eta[:, None]).reshape(count, n * n)
        d += 0.5 * (pairs @ G.reshape(-1, n * n).T)
    return d.reshape(count, sections, height)


def section_resultants(
    section: Cut,
    body: FlexibleBody,
    d: Array,
    needed: tuple[Array, Array, Array | None],
    loads: list[tuple[float, Array, Array]],
    eta: Array,
) -> Array:
    """Section forces N, Vy, Vz, T, My, Mz, shape (nt, nx, 6).

    `needed`: what stations need, see `needed_by_stations`.

    Returns:
        N > 0 in tension; V, T and M are what the inner part receives from the outer.
    """
    station, twist, about = needed
    (stations, axes, n), count = body.Phi.shape, len(eta)
    where: Array = (eta @ body.Phi.reshape(-1, n).T).reshape(count, stations, axes)
    where[:, :, 0] += body.x
    arm = cross(where, station) if about is None else cross(where, station) + about
    force, moment = section.outer @ station, section.outer @ arm
    if len(body.xt):
        moment[:, :, 0] += twist @ section.outer_twist.T
    place = d[:, :, :3].copy()
    place[:, :, 0] += section.x
    for x, pull, turn in loads:
        beyond = section.x <= x * (1 + 1e-12)
        k = int(np.argmin(np.abs(section.x - x)))
        at = place[:, k] + np.array([x - section.x[k], 0.0, 0.0])
        force[:, beyond] += pull[:, None]
        moment[:, beyond] += (turn + cross(at, pull))[:, None]
    moment -= cross(place, force)
    return -np.concatenate([force, moment], axis=2)


def stresses(section: Section, forces: Array) -> dict[str, Array]:
    """Largest stresses of each section, Pa, shapes (nt, nx).

    normal = axial + bending at the worst fibre; shear from torsion, largest on the section;
    von_mises = sqrt(normal^2 + 3 shear^2): an upper bound where the maxima are at two points.
    """
    N, _, _, T, My, Mz = np.moveaxis(forces, -1, 0)
    axial = N / section.A
    fibres = np.array(section.fibres)
    half = len(fibres) // 2
    rest = np.abs(fibres[:half] + fibres[-half:])
    opposite = 2 * half == len(fibres) and np.all(rest < 1e-12 * np.max(np.abs(fibres)))
    y, z = (fibres[:half] if opposite else fibres).T
    lever, moments = np.stack([-y / section.Iz, z / section.Iy], axis=1), np.stack([Mz, My])
    most, least = np.empty_like(axial), np.empty_like(axial)  # of bending, over the fibres
    for at in range(0, len(axial), step := -(-_AT_ONCE // max(axial.shape[1], 1))):
        s = slice(at, at + step)
        bent = np.tensordot(lever, moments[:, s], 1)
        np.max(bent, axis=0, initial=0.0, out=most[s])
        np.min(bent, axis=0, initial=0.0, out=least[s])
    bending = np.maximum(most, -least)
    if opposite:  # each stands for the one across too
        most, least = bending, -bending
    normal = np.maximum(axial + most, -(axial + least))
    shear = np.abs(T) / section.Wt
    return {
        "axial": axial,
        "bending": bending,
        "normal": normal,
        "shear": shear,
        "von_mises": np.hypot(normal, np.sqrt(3.0) * shear),
    }


def forces(samples: Samples) -> dict[str, Array]:
    """Arrays link/NAME/... of a Result that follow from forces: section forces and stresses."""
    out = dict[str, Array]()
    for name, resultant in resultants(samples, out).items():
        key, part = f"link/{name}", samples.mechanism.parts[name]
        out[f"{key}/resultant"] = resultant
        for kind, value in stresses(part.spec.section, resultant).items():
            out[f"{key}/stress/{kind}"] = value
    return out


def sections(samples: Samples) -> dict[str, Array]:
    """Where the sections of links are along their spans, by key of a Result [m]."""
    return {f"link/{n}/x": _stations(_slots(samples, n)) for n in samples.mechanism.parts}


def lines(samples: Samples) -> dict[str, Array]:
    """Arrays link/NAME/... of a Result that follow from poses: deflection and centre lines."""
    mechanism, poses = samples.mechanism, samples.kinematics.poses
    reference, frames = samples.rigid_poses, mechanism.rigid.expansion.frames
    if reference is None:
        reference, frames = poses, samples.run.system.expansion.frames
    out = dict[str, Array]()
    for name, part in mechanism.parts.items():
        slots = _slots(samples, name)
        home = pose_of(poses, slots[0].root)
        pieces = [_piece(samples, slot, home) for slot in slots]
        line, across, deflection = map(_joined, zip(*pieces, strict=True))
        x, key = _stations(slots), f"link/{name}"
        out[f"{key}/deflection"] = deflection
        out[f"{key}/centreline"] = line
        out[f"{key}/section_y"] = across
        frame = frames[name]
        rigid = pose_of(reference, Attachment(frame.joint, frame.placement * part.placement))
        out[f"{key}/centreline_rigid"] = (
            rigid[:, None, :, 3] + rigid[:, None, :, 0] * x[None, :, None]
        )
    return out


def resultants(samples: Samples, out: dict[str, Array] | None = None) -> dict[str, Array]:
    """Section forces of each flexible link [N, N m], shape (nt, nx, 6).

    Solid bodies add the stress on their surface to `out`.
    """
    found = dict[str, Array]()
    for name in samples.mechanism.parts:
        slots = _slots(samples, name)
        roots = np.array([pose_of(samples.kinematics.poses, slot.root) for slot in slots])
        found[name] = _joined([
            _forces(samples, slot, (k, roots), {} if out is None else out)
            for k, slot in enumerate(slots)
        ])  # fmt: skip
    return found


def _stations(slots: Sequence[Slot]) -> Array:
    """Sections of a link along its span [m], shape (nx,)."""
    return np.asarray(_joined([(slot.offset + slot.body.cut.x)[None] for slot in slots])[0])


def _slots(samples: Samples, name: str) -> list[Slot]:
    return [slot for slot in samples.run.system.expansion.slots if slot.link == name]


def _joined(values: Sequence[Array]) -> Array:
    """Sections of the bodies of a link in a row; two bodies share the one between them."""
    return np.concatenate([values[0], *(v[:, 1:] for v in values[1:])], axis=1)


def _forces(samples: Samples, slot: Slot, among: tuple[int, Array], out: dict[str, Array]) -> Array:
    """Section forces of one body of a link, (nt, nx, 6)."""
    eta = _coordinates(samples, slot)
    d = section_deflections(slot.body.cut, eta, _PLACES)
    # A linear run has its forces on the undeformed link.
    deflected = (0.0 * d, 0.0 * eta) if samples.run.linear else (d, eta)
    forces = _section_forces(samples, slot, *deflected, out)
    for contact, table in samples.forces.sleeves:
        if contact.sleeve.link == slot.link:
            forces += section_forces(slot.body.cut.x, table, *among)
    return forces


def _coordinates(samples: Samples, slot: Slot) -> Array:
    run = samples.run
    return run.y[:, int(run.system.rigid.nq) :][:, slot.eta]


def _piece(samples: Samples, slot: Slot, home: Array) -> tuple[Array, Array, Array]:
    """Centre line, y axes of sections and deflections of a body of a link with root `home`."""
    root, x = pose_of(samples.kinematics.poses, slot.root), slot.body.cut.x
    d = section_deflections(slot.body.cut, _coordinates(samples, slot))
    R, place, spin = root[:, :, :3], d[:, :, _PLACES], zyx_matrix(d[:, :, _TURNS])
    line, across = centre_line(d, x, R, root[:, :, 3]), spin[:, :, :, 1] @ R.swapaxes(1, 2)
    if slot.offset:  # it rides on another body
        place = off_straight(line, slot.offset + x, home[:, :, :3], home[:, :, 3])
        spin = (home[:, :, :3].swapaxes(1, 2) @ R)[:, None] @ spin
    return line, across, np.concatenate([place, rotation_vector(spin)], axis=2)


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


def needed_by_stations(samples: Samples, slot: Slot) -> tuple[Array, Array, Array | None]:
    """Forces of stations (nt, ns, 3), torques of twists (nt, n), moments of rotary inertia.

    The last have shape (nt, ns, 3); None where stations do not turn.
    """
    g, turn = samples.forces.g, [samples.forces.f[joint][:, 3:] for joint in slot.turning]
    return g[:, slot.stations], g[:, slot.twists], np.stack(turn, axis=1) if turn else None


def _section_forces(
    samples: Samples, slot: Slot, d: Array, eta: Array, out: dict[str, Array]
) -> Array:
    """Section forces (nt, nx, 6) under deflections d (nt, nx, 3) at coordinates eta (nt, n)."""
    loads = [(i.x, *samples.interface_load(i)) for i in slot.interfaces]
    needed = needed_by_stations(samples, slot)
    if slot.body.solid is None:
        return section_resultants(slot.body.cut, slot.body, d, needed, loads, eta)
    solid, pull, hung = slot.body.solid, needed[0], [load[1:] for load in loads]
    for key, value in surface(solid, pull, hung).items():
        out[f"link/{slot.link}/mesh/{key}"] = value
    return solid_resultants(solid, d, pull, hung, eta)


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
            d = section_deflections(cut, eta[:, slot.eta], _PLACES)
            if k:
                line = centre_line(d, cut.x, *roots[k])
                d = off_straight(line, slot.offset + cut.x, *roots[0])
            at.append(slot.offset + cut.x[min(k, 1) :])
            moved.append(d[:, min(k, 1) :])
        found[link] = np.concatenate(at), np.concatenate(moved, axis=1)
    return found
