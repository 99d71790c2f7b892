"""From states to what users ask for: frames, reactions, deflections, section forces, stresses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from pinflex.actuation.nominal import Nominal
from pinflex.arrays import Array, IntArray
from pinflex.levels.quasistatic import structural_stiffness
from pinflex.levels.run import Run
from pinflex.mechanics.contact import section_forces
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.expanded import Attachment
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results import mesh_stress, stress

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


class Samples:
    """One pass over the samples: everything that needs Pinocchio."""

    def __init__(self, mechanism: Mechanism, run: Run) -> None:
        self.mechanism, self.run = mechanism, run
        self.dynamics = Dynamics(run.system)
        model, nt = run.system.expansion.model, len(run.t)
        self.poses = np.empty((nt, model.njoints, 3, 4))
        self.g = np.empty((nt, model.nv))
        self.f = np.empty((nt, model.njoints, 6))
        contacts = self.dynamics.closed.contacts if run.system.n_eta else []
        self.sleeves = [(c, np.empty((nt, 3, 7))) for c in contacts]
        self.out: dict[str, Array] = {}

    def collect(self) -> None:
        """Run through the samples; fills poses, g, f and out."""
        run, dynamics = self.run, self.dynamics
        model, data, nt = dynamics.model, dynamics.data, len(run.t)
        frames = self._frames()
        place = {name: np.empty((nt, 3, 4)) for name in frames}
        rate = {name: np.empty((nt, 2, 6)) for name in frames}
        wrench = np.empty((nt, len(run.system.closed.names), 6))
        energy = np.empty((nt, 4))
        gap = np.zeros(nt)
        newton = np.zeros(nt)
        free, carrying, poses = run.system.free, self._carrying(), dynamics.closed.poses
        for k in range(nt):
            y, v, a, lam = run.y[k], run.v[k], run.a[k], run.lam[k]
            dynamics.loads.time = float(run.t[k])
            if run.signals is not None:
                dynamics.push = run.signals.B @ run.signals.u[k]
            r = dynamics.joint_forces(*self._force_state(k), a, lam)
            self.g[k] = dynamics.g
            for j in carrying:
                self.f[k, j] = data.f[j].vector
            if dynamics.looped:
                at = dynamics.closed.frames_b[:, :, 3]
                F = dynamics.closed.wrenches(lam)
                wrench[k, :, :3] = F[:, :3]
                wrench[k, :, 3:] = F[:, 3:] - np.cross(at, F[:, :3])
            for contact, table in self.sleeves:
                table[k] = contact.forces(lam)
            if run.linear:
                r += self._linear_forces(k)
                dynamics.close(y)
            newton[k] = np.max(np.abs(r[free]), initial=0.0)
            V, A = dynamics.expand_motion(v, a)
            pin.forwardKinematics(model, data, dynamics.Q, V, A)
            poses.refresh()
            self.poses[k, :, :, :3], self.poses[k, :, :, 3] = poses.rotation, poses.translation
            for name, here in frames.items():
                place[name][k], rate[name][k] = _frame(data, here)
            if dynamics.looped:
                gap[k] = np.max(np.abs(dynamics.closed.c))
            energy[k] = dynamics.energies(y, v)
        out = self.out
        for name in frames:
            out[f"frame/{name}/position"] = place[name][:, :, 3]
            out[f"frame/{name}/rotation"] = place[name][:, :, :3]
            out[f"frame/{name}/velocity"] = rate[name][:, 0]
            out[f"frame/{name}/acceleration"] = rate[name][:, 1]
        for k, name in enumerate(run.system.closed.names):
            out[f"loop/{name}/wrench"] = wrench[:, k]
        for name in self.mechanism.rigid.rigid.names[1:]:
            out[f"reaction/{name}"] = self.f[:, model.getJointId(name)]
        for k, name in enumerate(("kinetic", "gravity", "elastic", "spring")):
            out[f"energy/{name}"] = energy[:, k]
        out["residual/closure"], out["residual/newton"] = gap, newton

    def _force_state(self, k: int) -> tuple[Array, Array]:
        """Pose and velocity at which forces are evaluated: the nominal ones of a linear run."""
        run, path = self.run, self.run.path
        if path is None or not run.linear:
            return run.y[k], run.v[k]
        elastic = np.zeros(run.system.n_eta)
        return np.concatenate([path.q[k], elastic]), np.concatenate([path.v[k], elastic])

    def _linear_forces(self, k: int) -> Array:
        """Elastic and damping forces of the deviation of a linear run, shape (nv,)."""
        run, dynamics = self.run, self.dynamics
        y, v = self._force_state(k)
        d, dv = dynamics.difference(y, run.y[k]), run.v[k] - v
        K = structural_stiffness(dynamics)
        alpha, beta = self.mechanism.description.system_damping
        force = K @ (d + beta * dv) + run.system.D @ dv
        return np.asarray(force + alpha * dynamics.mass(y) @ dv) if alpha else force

    def _carrying(self) -> list[int]:
        """Joints whose forces are reported or load a section."""
        model = self.dynamics.model
        joints = {int(model.getJointId(name)) for name in self.mechanism.rigid.rigid.names[1:]}
        for slot in self.run.system.expansion.slots:
            joints.update(_slide(model, i.attachment.joint, i.force_rows) for i in slot.interfaces)
        return sorted(joints)

    def _frames(self) -> dict[str, Attachment]:
        description = self.mechanism.description
        names: list[str] = list(description.frames)
        if description.platform is not None and description.platform not in names:
            names.insert(0, description.platform)
        return {name: self.run.system.expansion.frames[name] for name in names}


def _frame(data: pin.Data, here: Attachment) -> tuple[Array, Array]:
    """Pose (3, 4) of a frame, and its velocity and classical acceleration (2, 6) in the world."""
    pose = data.oMi[here.joint] * here.placement
    R = pose.rotation
    v, a = here.placement.actInv(data.v[here.joint]), here.placement.actInv(data.a[here.joint])
    linear = a.linear + np.cross(v.angular, v.linear)
    place = np.column_stack([R, pose.translation])
    rates = np.array(
        [
            np.concatenate([R @ v.linear, R @ v.angular]),
            np.concatenate([R @ linear, R @ a.angular]),
        ]
    )
    return place, rates


def joint_poses(mechanism: Mechanism, path: Nominal) -> Array:
    """Poses of the rigid joints along a nominal motion, shape (nt, joints, 3, 4)."""
    model = mechanism.rigid.expansion.model
    data = model.createData()
    poses = np.empty((len(path.t), model.njoints, 3, 4))
    for k, q in enumerate(path.q):
        pin.forwardKinematics(model, data, q)
        for j in range(model.njoints):
            pose = data.oMi[j]
            poses[k, j, :, :3], poses[k, j, :, 3] = pose.rotation, pose.translation
    return poses


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
    for name, part in mechanism.parts.items():
        slots = [s for s in run.system.expansion.slots if s.link == name]
        cuts = [stress.cut(body, _SECTIONS) for body in part.bodies[:1]] * len(slots)
        pieces: dict[str, list[Array]] = {}
        home = pose_of(samples.poses, slots[0].root)
        for number, (slot, section) in enumerate(zip(slots, cuts, strict=True)):
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
            line = np.einsum("tij,txj->txi", root[:, :, :3], local) + root[:, None, :, 3]
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
        back = np.einsum("tji,txj->txi", home[:, :, :3], line - home[:, None, :, 3])
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
    joint = _slide(samples.dynamics.model, joint, rows)
    return samples.f[:, joint, :3], samples.f[:, joint, 3:]


def _slide(model: pin.Model, joint: int, rows: IntArray) -> int:
    """The translation at the bottom of an interface's chain of joints.

    Its force has all six components, about the displaced section, in the beam frame.
    """
    while model.joints[joint].idx_v != rows[0]:
        joint = int(model.parents[joint])
    return joint


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
    from scipy.spatial.transform import Rotation

    flat = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(flat.reshape(*R.shape[:-2], 3))
