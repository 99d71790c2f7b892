"""From a run to a Result: arrays that need another pass over the samples are lazy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from pinflex.actuation.nominal import Nominal
from pinflex.arrays import Array
from pinflex.integrators.run import Run
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.deviation import frame_deviations
from pinflex.recovery.drives import drives
from pinflex.recovery.kinematics import pose_of
from pinflex.recovery.links import links
from pinflex.recovery.meta import ASSESSED, assess, describe
from pinflex.recovery.reactions import shaking_of, world_reactions
from pinflex.recovery.samples import Samples
from pinflex.results.given import plain_meta
from pinflex.results.lazy import Late
from pinflex.results.result import Result
from pinflex.threads import one_blas_thread

T = TypeVar("T")


def result_of(
    mechanism: Mechanism,
    run: Run,
    rigid_path: Callable[[], Nominal | None],
    level: str,
    cost: dict[str, float],
    stopped: str,
) -> Result:
    """The Result of a run, whose arrays and meta are computed on first use."""
    samples = Samples(mechanism, run, rigid_path)
    arrays = _arrays(samples, run)

    def assessed() -> dict[str, Any]:
        with one_blas_thread():
            found = assess(mechanism, samples.run, arrays, samples.kinematics.spins)
            return plain_meta(found | {"warnings": [*found["warnings"], *samples.said()]})

    def told(key: str, find: Callable[[], Any]) -> Callable[[], dict[str, Any]]:
        return lambda: plain_meta({key: find()})

    known = describe(mechanism, run, level, cost, stopped)
    described: dict[tuple[str, ...], Callable[[], dict[str, Any]]]
    described = {(key,): told(key, find) for key, find in known.items()}
    return Result(run.t, arrays, Late({}, {ASSESSED: assessed, **described}))


def recover(mechanism: Mechanism, run: Run, rigid_path: Nominal | None) -> dict[str, Array]:
    """Arrays of a Result at once, by flat key.

    Returns:
        Arrays as documented in `pinflex.results.result`.
    """
    return dict(_arrays(Samples(mechanism, run, lambda: rigid_path), run))


def _arrays(samples: Samples, run: Run) -> Late[Array]:
    """Groups of arrays; "reaction_world" and "shaking" by name alone: neither listed nor stored."""

    def group(find: Callable[[Samples], dict[str, Array]]) -> Callable[[], dict[str, Array]]:
        return lambda: _read_only(find, samples)

    return Late(
        _read_only(_states, run),
        {
            ("joint", "multiplier", "eta_a"): group(_accelerations),
            ("frame", "body", "energy"): group(_motion),
            ("loop", "reaction", "residual"): group(lambda s: s.forces.arrays),
            ("link",): group(lambda s: links(s) if s.run.system.n_eta else {}),
            ("drive",): group(lambda s: drives(s.mechanism, s.run)),
        },
        {
            ("reaction_world",): group(_world_reactions),
            ("shaking",): group(lambda s: {"shaking": shaking_of(s.run)}),
        },
    )


def _read_only(find: Callable[[T], dict[str, Array]], samples: T) -> dict[str, Array]:
    """Read-only arrays, found as runs are: on one BLAS thread."""
    with one_blas_thread():
        arrays = {key: np.asarray(x, float).view() for key, x in find(samples).items()}
    for x in arrays.values():
        x.setflags(write=False)
    return arrays


def _accelerations(samples: Samples) -> dict[str, Array]:
    """What solves the equations at the samples: joint/a, eta_a, multiplier."""
    run, nv = samples.run, int(samples.run.system.rigid.nv)
    out = {"joint/a": run.a[:, :nv], "multiplier": run.lam}
    return out | {"eta_a": run.a[:, nv:]} if run.system.n_eta else out


def _states(run: Run) -> dict[str, Array]:
    """States of the run itself: joint, torque, eta, nominal."""
    nq, nv = int(run.system.rigid.nq), int(run.system.rigid.nv)
    out: dict[str, Array] = {
        "joint/q": run.y[:, :nq],
        "joint/v": run.v[:, :nv],
        "torque": run.torque,
    }
    if run.system.n_eta:
        out["eta"], out["eta_v"] = run.y[:, nq:], run.v[:, nv:]
    if run.signals is not None:
        out |= run.signals.arrays()
    if run.path is not None:
        out |= {"nominal/q": run.path.q, "nominal/v": run.path.v, "nominal/a": run.path.a}
    return out


def _motion(samples: Samples) -> dict[str, Array]:
    """frame, body and energy; of a linear run, the deviations of frames too."""
    mechanism, run, motion = samples.mechanism, samples.run, samples.kinematics
    out, bodies = motion.arrays | _energy_flow(run), _bodies(mechanism)
    out.update(_poses("pose", motion.poses, bodies, run.system.expansion.frames))
    if samples.rigid_poses is None:
        out.update({f"body/{name}/pose_rigid": out[f"body/{name}/pose"] for name in bodies})
    else:
        frames = mechanism.rigid.expansion.frames
        out.update(_poses("pose_rigid", samples.rigid_poses, bodies, frames))
    return out if run.path is None else out | frame_deviations(mechanism, run)


def _world_reactions(samples: Samples) -> dict[str, Array]:
    wrenches = world_reactions(samples)
    return {f"reaction_world/{name}": wrench for name, wrench in wrenches.items()}


def _bodies(mechanism: Mechanism) -> list[str]:
    return [
        link.name
        for link in mechanism.links
        if link.name not in mechanism.parts and link.name in mechanism.flexible.expansion.frames
    ]


def _poses(
    key: str, poses: Mapping[int, Array], names: Sequence[str], frames: Any
) -> dict[str, Array]:
    return {f"body/{name}/{key}": pose_of(poses, frames[name]) for name in names}


def _energy_flow(run: Run) -> dict[str, Array]:
    """Work of the motors and energy taken by damping: of every step, or by the sampled power."""
    if run.work is not None:
        return {"energy/work": run.work[:, 0], "energy/dissipated": run.work[:, 1]}
    speed = run.v[:, run.system.motors]
    power = np.sum(run.torque * speed, axis=1)
    loss = Equations(run.system).losses(run.y, run.v)
    dt = np.diff(run.t)

    def total(p: Array) -> Array:
        return np.concatenate([[0.0], np.cumsum(0.5 * dt * (p[1:] + p[:-1]))])

    return {"energy/work": total(power), "energy/dissipated": total(loss)}
