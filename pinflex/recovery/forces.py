"""Forces of a run: of the expanded model, of joints, loops and sleeves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.integrators.run import Run
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.evaluated import JointForces
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.slider import Contact
from pinflex.text import brief


@dataclass(frozen=True)
class Forces:
    """Forces of one run.

    Attributes:
        g: Expanded forces rnea - J_Q' lam, shape (nt, nV).
        f: Forces of the joints that are reported or load a section, shape (nt, joints, 6).
        sleeves: Sleeves, each with its contact forces, shape (nt, 3, 8).
        arrays: Those of a Result, by flat key: loops, reactions and what the equations leave.
    """

    __repr__ = brief

    g: Array
    f: Array
    sleeves: tuple[tuple[Contact, Array], ...]
    arrays: dict[str, Array]


def forces(mechanism: Mechanism, run: Run) -> Forces:
    """Forces of a run.

    Args:
        mechanism: Mechanism that was solved.
        run: Its states.
    """
    equations, nt, system = Equations(run.system), len(run.t), run.system
    model, joints = equations.model, _joints_with_forces(mechanism, run)
    y, v = run.y, run.v
    if run.linear:
        y, v = (np.array(x) for x in zip(*(run.acting(k) for k in range(nt)), strict=True))
    u = None if run.signals is None else run.signals.u @ run.signals.B.T
    found = equations.joint_forces(y, v, run.a, run.lam, run.t, joints, u)
    f = np.empty((nt, int(model.njoints), 6))
    f[:, joints] = found.f
    c = equations.close(run.y).c if run.linear else found.c
    out: dict[str, Array] = {
        f"loop/{name}/wrench": found.wrenches[:, k]
        for k, (name, kind) in enumerate(zip(system.closed.names, system.closed.kinds, strict=True))
        if kind != "coupling"
    }
    for name in mechanism.rigid.rigid.names[1:]:
        out[f"reaction/{name}"] = f[:, model.getJointId(name)]
    out["residual/closure"] = np.abs(c).max(axis=1, initial=0.0)
    left = _left(mechanism, equations, run, found)
    out["residual/newton"] = np.abs(left[:, system.free]).max(axis=1, initial=0.0)
    contacts = system.closed.contacts if system.n_eta else ()
    sleeves = tuple((one, found.sleeves[:, k]) for k, one in enumerate(contacts))
    return Forces(found.g, f, sleeves, out)


def _left(mechanism: Mechanism, equations: Equations, run: Run, found: JointForces) -> Array:
    """What the equations leave, shape (nt, nv); a linear run has forces of its own."""
    if not run.linear:
        return found.r
    linear = [_linear_forces(mechanism, equations, run, k) for k in range(len(run.t))]
    return found.r + np.array(linear)


def _linear_forces(mechanism: Mechanism, equations: Equations, run: Run, k: int) -> Array:
    """Elastic and damping forces of the deviation of a linear run, shape (nv,)."""
    y, v = run.acting(k)
    d, dv = equations.difference(y, run.y[k]), run.v[k] - v
    K = equations.structural_stiffness(y)
    alpha, beta = mechanism.description.system_damping
    force = K @ (d + beta * dv) + run.system.D @ dv
    return np.asarray(force + alpha * equations.mass(y) @ dv) if alpha else force


def _joints_with_forces(mechanism: Mechanism, run: Run) -> list[int]:
    """Joints whose forces are reported or load a section."""
    model = run.system.expansion.model
    joints = {int(model.getJointId(name)) for name in mechanism.rigid.rigid.names[1:]}
    for slot in run.system.expansion.slots:
        joints.update(slide(model, i.attachment.joint, i.force_rows) for i in slot.interfaces)
    return sorted(joints)


def slide(model: pin.Model, joint: int, rows: IntArray) -> int:
    """The translation at the bottom of an interface's chain of joints.

    Its force has all six components, about the displaced section, in the beam frame.

    Args:
        model: Expanded model.
        joint: The last joint of the chain.
        rows: Velocity rows of the interface's forces, the first at the bottom.
    """
    while model.joints[joint].idx_v != rows[0]:
        joint = int(model.parents[joint])
    return joint
