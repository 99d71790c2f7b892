"""Forces of a run: of the expanded model, of joints, loops and sleeves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
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
        f: Forces of the joints that outputs look at, shape (nt, 6) each.
        sleeves: Sleeves, each with its contact forces, shape (nt, 3, 8).
        arrays: Those of a Result, by flat key: loops, reactions and what the equations leave.
    """

    __repr__ = brief

    g: Array
    f: Mapping[int, Array]
    sleeves: tuple[tuple[Contact, Array], ...]
    arrays: dict[str, Array]


def forces(mechanism: Mechanism, run: Run) -> Forces:
    """Forces of a run."""
    equations, nt, system = Equations(run.system), len(run.t), run.system
    model, joints = equations.model, system.looked_at[1:]
    y, v = run.y, run.v
    if run.linear:
        y, v = (np.array(x) for x in zip(*(run.acting(k) for k in range(nt)), strict=True))
    u = None if run.signals is None else run.signals.u @ run.signals.B.T
    found = equations.joint_forces(y, v, run.a, run.lam, run.t, joints, u)
    f = dict(zip(joints, found.f.swapaxes(0, 1), strict=True))
    c = equations.close(run.y).c if run.linear else found.c
    out: dict[str, Array] = {
        f"loop/{name}/wrench": found.wrenches[:, k]
        for k, (name, kind) in enumerate(zip(system.closed.names, system.closed.kinds, strict=True))
        if kind != "coupling"
    }
    for name in mechanism.rigid.rigid.names[1:]:
        out[f"reaction/{name}"] = f[model.getJointId(name)]
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
