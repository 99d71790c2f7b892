"""Deflection, section forces, stress and shape of flexible links, from the samples of a run."""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.integrators.run import Run
from pinflex.mechanics.contact import section_forces
from pinflex.mechanics.expanded import Attachment
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery import solids as mesh_stress
from pinflex.recovery import stress
from pinflex.recovery.kinematics import pose_of
from pinflex.recovery.samples import Samples

# Per body: a smooth curve on the screen and every maximum within 0.1 % of a parabola.
_SECTIONS = 21


def links(mechanism: Mechanism, run: Run, samples: Samples, reference: Array) -> dict[str, Array]:
    """Arrays link/NAME/... of a Result.

    Args:
        mechanism: Mechanism. run: States. samples: What they move and take.
        reference: Joint poses of the rigid mechanism, shape (nt, joints, 3, 4).
    """
    out, g = dict[str, Array](), samples.forces.g
    bodies = {id(s.body): s.body for s in run.system.expansion.slots}
    cuts = {key: stress.cut(body, _SECTIONS) for key, body in bodies.items()}
    for name, part in mechanism.parts.items():
        slots = [s for s in run.system.expansion.slots if s.link == name]
        pieces: dict[str, list[Array]] = {}
        home = pose_of(samples.moves.poses, slots[0].root)
        for number, slot in enumerate(slots):
            section = cuts[id(slot.body)]
            eta = run.y[:, int(run.system.rigid.nq) :][:, slot.eta]
            d = stress.deflections(section, eta)
            # A linear run has its forces on the undeformed link.
            bent, moved = (0.0 * d, 0.0 * eta) if run.linear else (d, eta)
            loads = [
                (i.x, *samples.interface_load(i.attachment.joint, i.force_rows))
                for i in slot.interfaces
            ]
            if slot.body.solid is not None:
                solid, pull = slot.body.solid, g[:, slot.stations]
                hung = [load[1:] for load in loads]
                forces = mesh_stress.resultants(solid, bent, pull, hung, moved)
                for key, value in mesh_stress.surface(solid, pull, hung).items():
                    out[f"link/{name}/mesh/{key}"] = value
            else:
                forces = stress.resultants(
                    section, slot.body, bent, g[:, slot.stations],
                    g[:, slot.twists], loads, moved,
                )  # fmt: skip
            for contact, table in samples.forces.sleeves:
                if contact.sleeve.link == name:
                    forces += section_forces(section.x, table)
            root = pose_of(samples.moves.poses, slot.root)
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
