"""From a run to a Result: arrays that need another pass over the samples are lazy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from pinflex.actuation.nominal import Nominal
from pinflex.arrays import Array
from pinflex.integrators.run import Run
from pinflex.mechanics import workspace
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.deviation import frame_deviations
from pinflex.recovery.drives import drives
from pinflex.recovery.kinematics import joint_poses, pose_of
from pinflex.recovery.links import links
from pinflex.recovery.meta import ASSESSED, assess, describe
from pinflex.recovery.reactions import shaking_of, world_reactions
from pinflex.recovery.samples import Samples
from pinflex.results.lazy import Late
from pinflex.results.result import Result, plain
from pinflex.threads import one_blas_thread


def result_of(
    mechanism: Mechanism,
    run: Run,
    rigid_path: Callable[[], Nominal | None],
    level: str,
    cost: dict[str, float],
    stopped: str,
) -> Result:
    """The Result of a run.

    Args:
        mechanism: Mechanism. run: States at the samples.
        rigid_path: The rigid mechanism at the same motor positions (None: the run is rigid itself).
        level, cost, stopped: For its meta: fidelity, counts and seconds, why it ended early.
    """
    find = Recovery(mechanism, run, rigid_path)
    arrays = Late(
        _found(find.states),
        {
            ("frame", "body", "energy"): lambda: _found(find.motion),
            ("loop", "reaction", "residual"): lambda: _found(find.forces),
            ("link",): lambda: _found(find.links),
            ("drive",): lambda: _found(find.drives),
        },
        {
            ("reaction_world",): lambda: _found(find.world_reactions),
            ("shaking",): lambda: _found(find.shaking),
        },
    )

    def assessed() -> dict[str, Any]:
        with one_blas_thread(), workspace.keep_alive():
            return plain(assess(mechanism, run, arrays))

    def described() -> dict[str, Any]:
        return plain(describe(mechanism, run, level, cost, stopped))

    return Result(run.t, arrays, Late({}, {ASSESSED: assessed, (): described}))


def _found(find: Callable[[], dict[str, Array]]) -> dict[str, Array]:
    """Read-only arrays, found as runs are: one BLAS thread, workspaces kept meanwhile."""
    with one_blas_thread(), workspace.keep_alive():
        arrays = {key: np.asarray(x, float).view() for key, x in find().items()}
    for x in arrays.values():
        x.setflags(write=False)
    return arrays


class Recovery:
    """The arrays of one run, in groups."""

    def __init__(
        self, mechanism: Mechanism, run: Run, rigid_path: Callable[[], Nominal | None]
    ) -> None:
        """`rigid_path`: the rigid mechanism at the same motor positions (None: the run is it)."""
        self._mechanism, self._run, self._rigid_path = mechanism, run, rigid_path
        self._samples = Samples(mechanism, run)

    def states(self) -> dict[str, Array]:
        """States of the run itself: joint, torque, multiplier, eta, nominal."""
        run = self._run
        nq, nv = int(run.system.rigid.nq), int(run.system.rigid.nv)
        out: dict[str, Array] = {
            "joint/q": run.y[:, :nq],
            "joint/v": run.v[:, :nv],
            "joint/a": run.a[:, :nv],
            "torque": run.torque,
            "multiplier": run.lam,
        }
        if run.system.n_eta:
            out["eta"], out["eta_v"] = run.y[:, nq:], run.v[:, nv:]
            out["eta_a"] = run.a[:, nv:]
        if run.signals is not None:
            out |= run.signals.arrays()
        if run.path is not None:
            out |= {"nominal/q": run.path.q, "nominal/v": run.path.v, "nominal/a": run.path.a}
        return out

    def motion(self) -> dict[str, Array]:
        """frame, body and energy; of a linear run, the deviations of frames too."""
        mechanism, found = self._mechanism, self._samples.kinematics
        out, bodies = found.arrays | _energy_flow(self._run), _bodies(mechanism)
        frames = self._run.system.expansion.frames
        out.update(_poses("pose", found.poses, bodies, frames))
        if self._reference is None:
            out.update({f"body/{name}/pose_rigid": out[f"body/{name}/pose"] for name in bodies})
        else:
            frames = mechanism.rigid.expansion.frames
            out.update(_poses("pose_rigid", self._reference, bodies, frames))
        return out if self._run.path is None else out | frame_deviations(mechanism, self._run)

    def forces(self) -> dict[str, Array]:
        """loop, reaction and residual."""
        return self._samples.forces.arrays

    def drives(self) -> dict[str, Array]:
        """drive."""
        return drives(self._mechanism, self._run)

    def world_reactions(self) -> dict[str, Array]:
        """reaction_world: of tree joints, in world axes."""
        found = world_reactions(self._mechanism, self._samples)
        return {f"reaction_world/{name}": wrench for name, wrench in found.items()}

    def shaking(self) -> dict[str, Array]:
        """shaking."""
        return {"shaking": shaking_of(self._run)}

    def links(self) -> dict[str, Array]:
        """link."""
        if not self._run.system.n_eta:
            return {}
        reference = self._samples.kinematics.poses if self._reference is None else self._reference
        return links(self._mechanism, self._run, self._samples, reference)

    @cached_property
    def _reference(self) -> Array | None:
        """Joint poses of the rigid mechanism, or None where the run is its own."""
        path = self._rigid_path()
        return None if path is None else joint_poses(self._mechanism, path)


def recover(mechanism: Mechanism, run: Run, rigid_path: Nominal | None) -> dict[str, Array]:
    """Arrays of a Result at once, by flat key.

    Args:
        mechanism: Mechanism.
        run: States at the samples.
        rigid_path: The rigid mechanism at the same motor positions (None: the run is rigid itself).
    Returns:
        Arrays as documented in `pinflex.results.result`.
    """
    all_of = Recovery(mechanism, run, lambda: rigid_path)
    found = all_of.states() | all_of.motion() | all_of.forces() | all_of.links()
    return found | all_of.drives()


def _bodies(mechanism: Mechanism) -> list[str]:
    return [
        link.name
        for link in mechanism.links
        if link.name not in mechanism.parts and link.name in mechanism.flexible.expansion.frames
    ]


def _poses(key: str, poses: Array, names: Sequence[str], frames: Any) -> dict[str, Array]:
    return {f"body/{name}/{key}": pose_of(poses, frames[name]) for name in names}


def _energy_flow(run: Run) -> dict[str, Array]:
    """Work of the motors and energy taken by damping: of every step, or by the sampled power."""
    if run.work is not None:
        return {"energy/work": run.work[:, 0], "energy/dissipated": run.work[:, 1]}
    speed = run.v[:, run.system.motors]
    power = np.sum(run.torque * speed, axis=1)
    loss = run.system.dissipation(run.v)
    dt = np.diff(run.t)

    def total(p: Array) -> Array:
        return np.concatenate([[0.0], np.cumsum(0.5 * dt * (p[1:] + p[:-1]))])

    return {"energy/work": total(power), "energy/dissipated": total(loss)}
