"""Forces of a run: of the expanded model, of joints, loops and sleeves.

Scenes with loads or sleeves, controls and linear runs take their forces sample by sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.integrators.run import Run
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.slider import Contact
from pinflex.mechanics.stacked import Stacked, spans
from pinflex.mechanics.structure import structural_stiffness
from pinflex.recovery.kinematics import TOGETHER
from pinflex.text import brief


@dataclass(frozen=True)
class Forces:
    """Forces of one run.

    Attributes:
        g: Expanded forces rnea - J_Q' lam, shape (nt, nV).
        f: Forces of the joints that are reported or load a section, shape (nt, joints, 6).
        sleeves: Sleeves, each with its contact forces, shape (nt, 3, 7).
        arrays: Those of a Result, by flat key: loops, reactions and what the equations leave.
    """

    __repr__ = brief

    g: Array
    f: Array
    sleeves: tuple[tuple[Contact, Array], ...]
    arrays: dict[str, Array]


def forces(mechanism: Mechanism, run: Run, poses: Array) -> Forces:
    """Forces of a run whose joints have the poses (nt, joints, 3, 4).

    Args:
        mechanism: Mechanism that was solved.
        run: Its states.
        poses: Joint poses, shape (nt, joints, 3, 4).
    """
    found = _Pass(mechanism, run, poses)
    found.collect()
    return Forces(found.g, found.f, tuple(found.sleeves), found.arrays())


class _Pass:
    """One pass over the samples."""

    def __init__(self, mechanism: Mechanism, run: Run, poses: Array) -> None:
        self.mechanism, self.run, self.poses = mechanism, run, poses
        self.dynamics = Dynamics(run.system)
        model, nt = self.dynamics.model, len(run.t)
        self.g = np.empty((nt, model.nv))
        self.f = np.empty((nt, model.njoints, 6))
        contacts = run.system.closed.contacts if run.system.n_eta else ()
        self.sleeves = [(contact, np.empty((nt, 3, 7))) for contact in contacts]
        self._wrench = np.empty((nt, len(run.system.closed.names), 6))
        self._gap, self._left = np.zeros(nt), np.empty((nt, run.system.nv))
        self._carrying = self._joints_with_forces()

    def collect(self) -> None:
        """Run through the samples."""
        run, nt = self.run, len(self.run.t)
        stacked = Stacked(self.dynamics, min(nt, TOGETHER))
        if not stacked.plain or run.linear or run.signals is not None:
            self._forces_one_by_one()
            return
        for at in spans(nt, TOGETHER):
            Q, V, A, maps = stacked.expanded(run.y[at], run.v[at], run.a[at])
            loads = self._close(stacked, Q, at) if self.dynamics.looped else {}
            self._forces(at.start, Q, V, A, loads)
            self.g[at] -= stacked.coupling_forces(run.lam[at])
            self._left[at] = stacked.projected(self.g[at], run.y[at], run.v[at], maps)

    def arrays(self) -> dict[str, Array]:
        """Arrays of a Result."""
        out, run, model = dict[str, Array](), self.run, self.dynamics.model
        closed = run.system.closed
        for k, (name, kind) in enumerate(zip(closed.names, closed.kinds, strict=True)):
            if kind == "coupling":
                continue
            out[f"loop/{name}/wrench"] = self._wrench[:, k]
        for name in self.mechanism.rigid.rigid.names[1:]:
            out[f"reaction/{name}"] = self.f[:, model.getJointId(name)]
        out["residual/closure"] = self._gap
        out["residual/newton"] = np.abs(self._left[:, run.system.free]).max(axis=1, initial=0.0)
        return out

    def _close(self, stacked: Stacked, Q: Array, at: slice) -> dict[int, Array]:
        """Gaps and wrenches of the loops; what they load joints with, in their own frames."""
        poses, closed, size = self.poses[at], stacked.closed, stacked.size
        rotation, origin = poses[..., :3], poses[..., 3]
        columns = rotation.swapaxes(-1, -2)
        flat = np.concatenate([columns.reshape(*origin.shape[:2], 9), origin], axis=2)
        closed.Q = Q
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
            u = None if run.signals is None else run.signals.B @ run.signals.u[k]
            r = dynamics.joint_forces(*run.acting(k), a, lam, float(run.t[k]), u)
            self.g[k] = dynamics.g
            for j in self._carrying:
                self.f[k, j] = data.f[j].vector
            if dynamics.looped:
                at = dynamics.closed.frames_b[:, :, 3]
                self._wrench[k] = _about(at, dynamics.closed.wrenches(lam))
            for (_, table), contact in zip(self.sleeves, dynamics.closed.contacts, strict=False):
                table[k] = contact.forces(lam)
            if run.linear:
                r += self._linear_forces(k)
                dynamics.close(y)
            self._left[k] = r
            if dynamics.looped:
                self._gap[k] = np.max(np.abs(dynamics.closed.c))

    def _linear_forces(self, k: int) -> Array:
        """Elastic and damping forces of the deviation of a linear run, shape (nv,)."""
        run, dynamics = self.run, self.dynamics
        y, v = run.acting(k)
        d, dv = dynamics.difference(y, run.y[k]), run.v[k] - v
        K = structural_stiffness(dynamics, y)
        alpha, beta = self.mechanism.description.system_damping
        force = K @ (d + beta * dv) + run.system.D @ dv
        return np.asarray(force + alpha * dynamics.mass(y) @ dv) if alpha else force

    def _joints_with_forces(self) -> list[int]:
        """Joints whose forces are reported or load a section."""
        model = self.dynamics.model
        joints = {int(model.getJointId(name)) for name in self.mechanism.rigid.rigid.names[1:]}
        for slot in self.run.system.expansion.slots:
            joints.update(slide(model, i.attachment.joint, i.force_rows) for i in slot.interfaces)
        return sorted(joints)


def _about(point: Array, wrench: Array) -> Array:
    """Wrenches (..., 6) about the origin, moved to points (..., 3)."""
    F = wrench[..., :3]
    return np.concatenate([F, wrench[..., 3:] - np.cross(point, F)], axis=-1)


def slide(model: pin.Model, joint: int, rows: IntArray) -> int:
    """The translation at the bottom of an interface's chain of joints.

    Its force has all six components, about the displaced section, in the beam frame.
    """
    while model.joints[joint].idx_v != rows[0]:
        joint = int(model.parents[joint])
    return joint
