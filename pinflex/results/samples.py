"""Poses, forces and energies at the samples of a run: everything that needs Pinocchio.

Pinocchio takes the samples one after the other; what surrounds it runs on many of them at once.
Scenes with loads or sleeves, controls and linear runs take their forces sample by sample.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinflex.actuation.nominal import Nominal
from pinflex.arrays import Array, IntArray
from pinflex.levels.quasistatic import structural_stiffness
from pinflex.levels.run import Run
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.expanded import Attachment
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.stacked import Stacked, spans

_TOGETHER = 64  # samples at a time: numpy's price for a call is spread, little memory is needed


class Samples:
    """The samples of one run; after `collect` it holds

    Attributes:
        poses: Of the joints of the expanded model, shape (nt, joints, 3, 4).
        g: Expanded forces rnea - J_Q' lam, shape (nt, nV).
        f: Forces of the joints that are reported or load a section, shape (nt, joints, 6).
        sleeves: Contacts of sleeves, each with its forces, shape (nt, 3, 7).
        out: Arrays of a Result, by flat key.
    """

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
        self._frames = self._reported()
        self._rates = {here.joint: np.empty((nt, 2, 6)) for here in self._frames.values()}
        self._energy = np.zeros((nt, 4))
        self._wrench = np.empty((nt, len(run.system.closed.names), 6))
        self._gap, self._left = np.zeros(nt), np.empty((nt, run.system.nv))
        self._carrying = self._joints_with_forces()

    def collect(self) -> None:
        """Run through the samples; fills poses, g, f, sleeves and out."""
        run, nt = self.run, len(self.run.t)
        stacked = Stacked(self.dynamics, min(nt, _TOGETHER))
        plain = stacked.plain and not run.linear and run.signals is None
        for at in spans(nt, _TOGETHER):
            Q, V, A, maps = stacked.expanded(run.y[at], run.v[at], run.a[at])
            self._move(at.start, Q, V, A)
            if plain:
                loads = self._close(stacked, at) if self.dynamics.looped else {}
                self._forces(at.start, Q, V, A, loads)
                self._left[at] = stacked.projected(self.g[at], run.y[at], run.v[at], maps)
        if not plain:
            self._forces_one_by_one()
        self._write()

    def _move(self, first: int, Q: Array, V: Array, A: Array) -> None:
        """Poses, energies and rates of the reported frames' joints, from the sample `first` on."""
        dynamics, poses = self.dynamics, self.dynamics.closed.poses
        model, data = dynamics.model, dynamics.data
        for k, (q, v, a) in enumerate(zip(Q, V, A, strict=True), start=first):
            pin.forwardKinematics(model, data, q, v, a)
            poses.refresh()
            self.poses[k, :, :, :3], self.poses[k, :, :, 3] = poses.rotation, poses.translation
            for joint, table in self._rates.items():
                table[k] = data.v[joint].vector, data.a[joint].vector
            self._energy[k, 0] = pin.computeKineticEnergy(model, data)
            self._energy[k, 1] = pin.computePotentialEnergy(model, data)
            if dynamics.loaded:
                dynamics.loads.time = float(self.run.t[k])
                self._energy[k, 3] = dynamics.loads.energy()

    def _close(self, stacked: Stacked, at: slice) -> dict[int, Array]:
        """Gaps and wrenches of the loops; what they load joints with, in their own frames."""
        poses, closed, size = self.poses[at], stacked.closed, stacked.size
        rotation, origin = poses[..., :3], poses[..., 3]
        columns = rotation.swapaxes(-1, -2)
        flat = np.concatenate([columns.reshape(*origin.shape[:2], 9), origin], axis=2)
        closed.rows_from(flat.reshape(-1, 12))
        self._gap[at] = np.abs(closed.c.reshape(size, -1)).max(axis=1)
        F = closed.wrenches(self.run.lam[at].reshape(-1)).reshape(size, -1, 6)
        self._wrench[at] = _about(closed.frames_b[:, :, 3].reshape(size, -1, 3), F)
        bodies, total = self.run.system.closed.bodies, dict[int, Array]()
        for joint, wrench in zip(bodies, np.concatenate([-F, F], axis=1).swapaxes(0, 1),
                                 strict=True):  # fmt: skip
            total[int(joint)] = total.get(int(joint), 0.0) + wrench
        for joint, wrench in total.items():
            moved = _about(origin[:, joint], wrench).reshape(size, 2, 3, 1)
            total[joint] = (columns[:, joint, None] @ moved).reshape(size, 6)
        return total

    def _forces(self, first: int, Q: Array, V: Array, A: Array, loads: dict[int, Array]) -> None:
        """g and f under the loads of the loops, from the sample `first` on."""
        model, data = self.dynamics.model, self.dynamics.data
        pushed = pin.StdVec_Force([pin.Force.Zero() for _ in range(model.njoints)])
        for i, (q, v, a) in enumerate(zip(Q, V, A, strict=True)):
            for joint, wrench in loads.items():
                pushed[joint] = pin.Force(wrench[i])
            self.g[first + i] = pin.rnea(model, data, q, v, a, pushed)
            for j in self._carrying:
                self.f[first + i, j] = data.f[j].vector

    def _forces_one_by_one(self) -> None:
        run, dynamics, data = self.run, self.dynamics, self.dynamics.data
        for k in range(len(run.t)):
            y, a, lam = run.y[k], run.a[k], run.lam[k]
            dynamics.loads.time = float(run.t[k])
            if run.signals is not None:
                dynamics.push = run.signals.B @ run.signals.u[k]
            r = dynamics.joint_forces(*self._force_state(k), a, lam)
            self.g[k] = dynamics.g
            for j in self._carrying:
                self.f[k, j] = data.f[j].vector
            if dynamics.looped:
                at = dynamics.closed.frames_b[:, :, 3]
                self._wrench[k] = _about(at, dynamics.closed.wrenches(lam))
            for contact, table in self.sleeves:
                table[k] = contact.forces(lam)
            if run.linear:
                r += self._linear_forces(k)
                dynamics.close(y)
            self._left[k] = r
            if dynamics.looped:
                self._gap[k] = np.max(np.abs(dynamics.closed.c))

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

    def _write(self) -> None:
        """The arrays of a Result."""
        out, run, model = self.out, self.run, self.dynamics.model
        for name, here in self._frames.items():
            values = _frame(self.poses[:, here.joint], self._rates[here.joint], here.placement)
            for key, value in zip(("position", "rotation", "velocity", "acceleration"), values,
                                  strict=True):  # fmt: skip
                out[f"frame/{name}/{key}"] = value
        for k, name in enumerate(run.system.closed.names):
            out[f"loop/{name}/wrench"] = self._wrench[:, k]
        for name in self.mechanism.rigid.rigid.names[1:]:
            out[f"reaction/{name}"] = self.f[:, model.getJointId(name)]
        eta = run.y[:, self.dynamics.nq_rigid :]
        self._energy[:, 2] = 0.5 * np.sum(eta @ self.dynamics.stiffness * eta, axis=1)
        if self.dynamics.sprung:
            s = run.system.springs
            stretch = np.array([self.dynamics.spring_angles(y) for y in run.y]) - s.rest
            self._energy[:, 3] += 0.5 * stretch**2 @ s.stiffness
        for k, name in enumerate(("kinetic", "gravity", "elastic", "spring")):
            out[f"energy/{name}"] = self._energy[:, k]
        out["residual/closure"] = self._gap
        out["residual/newton"] = np.abs(self._left[:, run.system.free]).max(axis=1, initial=0.0)

    def _joints_with_forces(self) -> list[int]:
        """Joints whose forces are reported or load a section."""
        model = self.dynamics.model
        joints = {int(model.getJointId(name)) for name in self.mechanism.rigid.rigid.names[1:]}
        for slot in self.run.system.expansion.slots:
            joints.update(slide(model, i.attachment.joint, i.force_rows) for i in slot.interfaces)
        return sorted(joints)

    def _reported(self) -> dict[str, Attachment]:
        description = self.mechanism.description
        names: list[str] = list(description.frames)
        if description.platform is not None and description.platform not in names:
            names.insert(0, description.platform)
        return {name: self.run.system.expansion.frames[name] for name in names}


def _about(point: Array, wrench: Array) -> Array:
    """Wrenches (..., 6) about the origin, moved to points (..., 3)."""
    F = wrench[..., :3]
    return np.concatenate([F, wrench[..., 3:] - np.cross(point, F)], axis=-1)


def _frame(poses: Array, rates: Array, placement: pin.SE3) -> tuple[Array, Array, Array, Array]:
    """Of a frame: position, rotation, velocity and classical acceleration in the world.

    Args:
        poses: Of its joint, shape (nt, 3, 4). rates: Spatial velocity and acceleration of the
            joint in its own frame, shape (nt, 2, 6). placement: Of the frame in the joint.
    """
    turn, p = poses[:, :, :3], np.asarray(placement.translation)
    (v, w), (a, spin) = (x.reshape(-1, 2, 3).swapaxes(0, 1) for x in rates.swapaxes(0, 1))
    speed = v + np.cross(w, p)
    linear = a + np.cross(spin, p) + np.cross(w, speed)

    def world(*vectors: Array) -> Array:
        return np.concatenate([(turn @ x[..., None])[..., 0] for x in vectors], axis=1)

    position = turn @ p + poses[:, :, 3]
    return position, turn @ placement.rotation, world(speed, w), world(linear, spin)


def joint_poses(mechanism: Mechanism, path: Nominal) -> Array:
    """Poses of the rigid joints along a nominal motion, shape (nt, joints, 3, 4)."""
    dynamics = Dynamics(mechanism.rigid)
    model, here = dynamics.model, dynamics.closed.poses
    poses = np.empty((len(path.t), model.njoints, 3, 4))
    for k, q in enumerate(path.q):
        pin.forwardKinematics(model, dynamics.data, q)
        here.refresh()
        poses[k, :, :, :3], poses[k, :, :, 3] = here.rotation, here.translation
    return poses


def slide(model: pin.Model, joint: int, rows: IntArray) -> int:
    """The translation at the bottom of an interface's chain of joints.

    Its force has all six components, about the displaced section, in the beam frame.
    """
    while model.joints[joint].idx_v != rows[0]:
        joint = int(model.parents[joint])
    return joint
