"""From states to what users ask for: frames, reactions, deflections, section forces, stresses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pinflex.actuation.nominal import Nominal
from pinflex.arrays import Array, IntArray
from pinflex.levels.run import Run
from pinflex.mechanics.contact import section_forces
from pinflex.mechanics.expanded import Attachment
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results import mesh_stress, stress
from pinflex.results.samples import Samples, joint_poses, slide

_SECTIONS = (
    21  # per body: a smooth curve on the screen and every maximum within 0.1 % of a parabola
)


def recover(mechanism: Mechanism, run: Run, rigid_path: Nominal | None) -> dict[str, Array]:
    """Arrays of a Result, by flat key.

    Args:
        mechanism: Mechanism.
        run: States at the samples.
        rigid_path: The rigid mechanism at the same motor positions (None: the run is rigid itself).
    Returns:
        Arrays as documented in `pinflex.results.result`.
    """
    system = run.system
    nq, nv = int(system.rigid.nq), int(system.rigid.nv)
    out: dict[str, Array] = {
        "joint/q": run.y[:, :nq],
        "joint/v": run.v[:, :nv],
        "joint/a": run.a[:, :nv],
        "torque": run.torque,
        "multiplier": run.lam,
    }
    if system.n_eta:
        out["eta"], out["eta_v"] = run.y[:, nq:], run.v[:, nv:]
        out["eta_a"] = run.a[:, nv:]
    if run.path is not None:
        out |= {"nominal/q": run.path.q, "nominal/v": run.path.v, "nominal/a": run.path.a}
    samples = Samples(mechanism, run)
    samples.collect()
    out.update(samples.out)
    bodies = _bodies(mechanism)
    out.update(_poses("pose", samples.poses, bodies, system.expansion.frames))
    reference = samples.poses
    if rigid_path is not None:
        reference = joint_poses(mechanism, rigid_path)
        out.update(_poses("pose_rigid", reference, bodies, mechanism.rigid.expansion.frames))
    else:
        for name in bodies:
            out[f"body/{name}/pose_rigid"] = out[f"body/{name}/pose"]
    if system.n_eta:
        out.update(_links(mechanism, run, samples, reference))
    return out


def _bodies(mechanism: Mechanism) -> list[str]:
    return [
        link.name
        for link in mechanism.links
        if link.name not in mechanism.parts and link.name in mechanism.flexible.expansion.frames
    ]


def pose_of(poses: Array, here: Attachment) -> Array:
    """Poses (nt, 3, 4) of something attached to a joint."""
    joint = poses[:, here.joint]
    local = np.column_stack([here.placement.rotation, here.placement.translation])
    moved: Array = joint[:, :, :3] @ local
    moved[:, :, 3] += joint[:, :, 3]
    return moved


def _poses(key: str, poses: Array, names: Sequence[str], frames: Any) -> dict[str, Array]:
    return {f"body/{name}/{key}": pose_of(poses, frames[name]) for name in names}


def _links(mechanism: Mechanism, run: Run, samples: Samples, reference: Array) -> dict[str, Array]:
    """Deflection, section forces, stress and world shape of every flexible link."""
    out: dict[str, Array] = {}
    bodies = {id(s.body): s.body for s in run.system.expansion.slots}
    cuts = {key: stress.cut(body, _SECTIONS) for key, body in bodies.items()}
    for name, part in mechanism.parts.items():
        slots = [s for s in run.system.expansion.slots if s.link == name]
        pieces: dict[str, list[Array]] = {}
        home = pose_of(samples.poses, slots[0].root)
        for number, slot in enumerate(slots):
            section = cuts[id(slot.body)]
            eta = run.y[:, int(run.system.rigid.nq) :][:, slot.eta]
            d = stress.deflections(section, eta)
            # A linear run has its forces on the undeformed link.
            bent, moved = (0.0 * d, 0.0 * eta) if run.linear else (d, eta)
            loads = [
                (i.x, *interface_load(samples, i.attachment.joint, i.force_rows))
                for i in slot.interfaces
            ]
            if slot.body.solid is not None:
                solid, pull = slot.body.solid, samples.g[:, slot.stations]
                hung = [load[1:] for load in loads]
                forces = mesh_stress.resultants(solid, bent, pull, hung, moved)
                for key, value in mesh_stress.surface(solid, pull, hung).items():
                    out[f"link/{name}/mesh/{key}"] = value
            else:
                forces = stress.resultants(
                    section, slot.body, bent, samples.g[:, slot.stations],
                    samples.g[:, slot.twists], loads, moved,
                )  # fmt: skip
            for contact, table in samples.sleeves:
                if contact.contact.sleeve.link == name:
                    forces += section_forces(section.x, table)
            root = pose_of(samples.poses, slot.root)
            local = d[:, :, :3].copy()
            local[:, :, 0] += section.x
            line = local @ root[:, :, :3].swapaxes(1, 2) + root[:, None, :, 3]
            turned = root[:, None, :, :3] @ _turn(d[:, :, 3:])
            keep = slice(0 if number == 0 else 1, None)
            for key, value in (
                ("x", (slot.offset + section.x)[None]),
                ("resultant", forces),
                ("centreline", line),
                ("turned", turned),
            ):
                pieces.setdefault(key, []).append(value[:, keep])
        joined = {key: np.concatenate(value, axis=1) for key, value in pieces.items()}
        x, line, turned = joined["x"][0], joined["centreline"], joined["turned"]
        back = (line - home[:, None, :, 3]) @ home[:, :, :3]
        back[:, :, 0] -= x
        spin = _rotation_vectors(np.swapaxes(home[:, None, :, :3], 2, 3) @ turned)
        key = f"link/{name}"
        out[f"{key}/x"] = x
        out[f"{key}/deflection"] = np.concatenate([back, spin], axis=2)
        out[f"{key}/resultant"] = joined["resultant"]
        for kind, value in stress.stresses(part.spec.section, joined["resultant"]).items():
            out[f"{key}/stress/{kind}"] = value
        out[f"{key}/centreline"] = line
        out[f"{key}/section_y"] = turned[:, :, :, 1]
        frame = mechanism.rigid.expansion.frames[name]
        straight = pose_of(reference, Attachment(frame.joint, frame.placement * part.placement))
        out[f"{key}/centreline_rigid"] = (
            straight[:, None, :, 3] + straight[:, None, :, 0] * x[None, :, None]
        )
    return out


def interface_load(samples: Samples, joint: int, rows: IntArray) -> tuple[Array, Array]:
    """Force and moment, in the beam frame, that what hangs on an interface needs."""
    joint = slide(samples.dynamics.model, joint, rows)
    return samples.f[:, joint, :3], samples.f[:, joint, 3:]


def _turn(angles: Array) -> Array:
    """Rz(rz) Ry(ry) Rx(rx) for angles (..., 3)."""
    z, y, x = (angles[..., k] for k in range(3))
    cz, sz, cy, sy, cx, sx = np.cos(z), np.sin(z), np.cos(y), np.sin(y), np.cos(x), np.sin(x)
    R = np.empty((*angles.shape[:-1], 3, 3))
    R[..., 0, 0], R[..., 0, 1], R[..., 0, 2] = (
        cz * cy,
        cz * sy * sx - sz * cx,
        cz * sy * cx + sz * sx,
    )
    R[..., 1, 0], R[..., 1, 1], R[..., 1, 2] = (
        sz * cy,
        sz * sy * sx + cz * cx,
        sz * sy * cx - cz * sx,
    )
    R[..., 2, 0], R[..., 2, 1], R[..., 2, 2] = -sy, cy * sx, cy * cx
    return R


def _rotation_vectors(R: Array) -> Array:
    skew = 0.5 * (R - np.swapaxes(R, -1, -2))
    sine = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    if np.all(cosine > 0.0):
        size = np.linalg.norm(sine, axis=-1)
        ratio = np.where(size > 0.0, np.arctan2(size, cosine) / np.maximum(size, 1e-300), 1.0)
        return np.asarray(ratio[..., None] * sine)
    from scipy.spatial.transform import Rotation  # beyond a right angle it takes more care

    flat = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(flat.reshape(*R.shape[:-2], 3))
