"""Kinematics and forces at the samples of a run, and a run again from a stored result."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np

from pinflex.actuation.nominal import Nominal
from pinflex.arrays import Array
from pinflex.errors import DescriptionError
from pinflex.integrators.run import Run, Settings
from pinflex.mechanics.clearance import pins
from pinflex.mechanics.evaluation.compiled import JointForces
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.expanded import Interface
from pinflex.mechanics.model.slider import Contact
from pinflex.recovery.kinematics import Kinematics, joint_poses, kinematics
from pinflex.results.result import Result
from pinflex.text import brief

# Forces of a run: of the expanded model, of joints, loops and sleeves.


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
    if system.kinks.rows and any(one.clearance for one in mechanism.description.loops):
        for name, (place, wrench) in pins(equations, y, v, run.a).items():
            out[f"loop/{name}/orbit"] = place
            out[f"loop/{name}/wrench"] = out[f"loop/{name}/wrench"] + wrench
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


class Samples:
    """Passes over the samples of one run, each made once, when a group of arrays needs it.

    Attributes:
        mechanism: Mechanism that was solved.
    """

    def __init__(
        self, mechanism: Mechanism, run: Run, rigid_path: Callable[[], Nominal | None] | None = None
    ) -> None:
        """Nothing is computed yet."""
        self.mechanism, self._run, self._rigid_path = mechanism, run, rigid_path

    @cached_property
    def run(self) -> Run:
        """States at the samples, with accelerations that solve the equations there."""
        return self._run if self._run.settle is None else self._run.settle(self._run)

    @cached_property
    def kinematics(self) -> Kinematics:
        """Poses, rates and energies."""
        return kinematics(self.mechanism, self.run)

    @cached_property
    def forces(self) -> Forces:
        """Expanded forces, and those of joints, loops and sleeves."""
        return forces(self.mechanism, self.run)

    @cached_property
    def rigid_poses(self) -> Mapping[int, Array] | None:
        """Joint poses of the rigid mechanism, (nt, 3, 4) each; None: the run is its own."""
        return None if self._path is None else joint_poses(self.mechanism, self._path)

    def said(self) -> list[str]:
        """Where the rigid mechanism is left out, as a warning."""
        return [self._path.said] if self._path is not None and self._path.said else []

    @cached_property
    def _path(self) -> Nominal | None:
        return None if self._rigid_path is None else self._rigid_path()

    def interface_load(self, interface: Interface) -> tuple[Array, Array]:
        """Force (N) and moment (N m), (nt, 3) each, that what hangs on an interface needs.

        Returns:
            In the beam frame.
        """
        joint = interface.bottom(self.run.system.expansion.model)
        f = self.forces.f[joint]
        return f[:, :3], f[:, 3:]


def run_of(mechanism: Mechanism, result: Result) -> Run:
    """The states of a result as a run of the mechanism that it came from.

    Raises:
        DescriptionError: Another mechanism: its coordinates differ.
    """
    flexible = "eta" in result.arrays
    system = mechanism.flexible if flexible else mechanism.rigid
    parts = [("q", "eta"), ("v", "eta_v"), ("a", "eta_a")]
    y, v, a = (
        np.hstack([result.array(f"joint/{x}"), result.array(e)]) if flexible
        else result.array(f"joint/{x}")
        for x, e in parts
    )  # fmt: skip
    lam = result.array("multiplier")
    sizes = (y.shape[1], v.shape[1], lam.shape[1])
    wanted = (system.nq, system.nv, system.closed.n)
    if sizes != wanted or result.meta["name"] != mechanism.name:
        raise DescriptionError(
            f"{result.meta['name']}: the result has {sizes} coordinates, rates and closure rows, "
            f"the mechanism {mechanism.name} has {wanted}. Give the mechanism that was solved."
        )
    path = None
    if "nominal/q" in result.arrays:
        rigid = [result.array(f"nominal/{x}") for x in "qva"]
        path = Nominal(result.t, rigid[0], rigid[1], rigid[2])
    settings = cast("Settings", dict(result.meta["settings"]))
    return Run(system, result.t, y, v, a, lam, result.torque, {}, settings, path=path)


def samples_of(mechanism: Mechanism, result: Result) -> Samples:
    """Kinematics and forces over a run that was stored."""
    return Samples(mechanism, run_of(mechanism, result))
