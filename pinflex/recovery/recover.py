"""From a run to a Result: arrays that need another pass over the samples are lazy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from pinflex.actuation.drive import Nominal
from pinflex.arrays import Array, spans
from pinflex.integrators.problem import Run
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import motion_of
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.loads import Loads
from pinflex.recovery.kinematics import Samples, joint_poses, pose_of, run_of, samples_of
from pinflex.recovery.links import forces, lines, sections
from pinflex.recovery.meta import ASSESSED, assess, describe, drives
from pinflex.results.lazy import Late, plain_meta
from pinflex.results.quantities import KEYS, Key
from pinflex.results.result import Result
from pinflex.rotations import cross
from pinflex.threads import one_blas_thread

# Joint reactions in one frame for tree joints and loops, and the shaking force on the frame.


def joint_reactions(mechanism: Mechanism, result: Result) -> dict[str, Array]:
    """Loads of every joint and loop, in the world frame, at the joint.

    Returns:
        By name of joint or loop: force (N) and moment (N m) on the child body (loop: on the body
        of frame b), (nt, 6). A motor's moment has its torque in it, less what turns its rotor.
    """
    samples = samples_of(mechanism, result)
    out = world_reactions(samples)
    for name in samples.run.system.closed.names:
        out[name] = samples.forces.arrays[f"loop/{name}/wrench"]
    return out


def world_reactions(samples: Samples) -> dict[str, Array]:
    """Wrench on the child of every tree joint, in world axes at the joint, (nt, 6), by name."""
    out: dict[str, Array] = {}
    for name, (joint, R) in _rotations(samples).items():
        force = samples.forces.f[joint].reshape(-1, 2, 3)
        out[name] = np.einsum("tij,tkj->tki", R, force).reshape(-1, 6)
    return out


def _rotations(samples: Samples) -> dict[str, tuple[int, Array]]:
    """Joint number and world rotations (nt, 3, 3) of the tree joints, where forces were taken."""
    mechanism, run = samples.mechanism, samples.run
    expanded, rigid = run.system.expansion.model, mechanism.rigid.rigid
    poses = samples.kinematics.poses
    nominal = joint_poses(mechanism, run.path) if run.linear and run.path is not None else None
    found = {}
    for number, name in enumerate(rigid.names[1:], start=1):
        joint = int(expanded.getJointId(name))
        R = poses[joint] if nominal is None else nominal[number]
        found[name] = (joint, R[:, :, :3])
    return found


def shaking(mechanism: Mechanism, result: Result) -> Array:
    """Shaking force and moment of a result; see `shaking_of`."""
    return shaking_of(run_of(mechanism, result))


def shaking_of(run: Run) -> Array:
    """Shaking force (N) and moment (N m, about the world origin) on the frame, shape (nt, 6).

    Weight, external loads and inertia of all that moves, motors' reactions included:
    -(dh/dt - gravity - loads). A rotor's own spin counts as inertia about its joint's axis.
    """
    system, nt = run.system, len(run.t)
    if (
        system.loads.springs or system.loads.touches
    ):  # which pull on the frame too: of these it is told
        system = replace(system, loads=Loads(system.loads.forces, ()))
    dynamics = Equations(system, marched=True)
    y, v = (np.array(x) for x in zip(*(run.acting(k) for k in range(nt)), strict=True))
    base = [int(joint) for joint in dynamics.model.children[0]]
    # What the first joints carry; multipliers, without which nothing balances, add none to it.
    carried = dynamics.joint_forces(y, v, run.a, 0.0 * run.lam, run.t, base).f
    out, poses = _rotors(dynamics, y, v, run.a), dynamics.joint_poses(y)
    for k, joint in enumerate(base):
        turn, origin = poses[:, joint, :, :3], poses[:, joint, :, 3]
        force, moment = ((turn @ carried[:, k, x, None])[:, :, 0] for x in (slice(3), slice(3, 6)))
        out[:, :3] -= force
        out[:, 3:] -= moment + cross(origin, force)
    return out


def _rotors(dynamics: Equations, y: Array, v: Array, a: Array) -> Array:
    """What the spins of rotors do to the frame, shape (nt, 6)."""
    out, armature = np.zeros((len(y), 6)), np.asarray(dynamics.model.armature)
    for s in spans(len(y)) if armature.any() else ():
        axes = dynamics.kinematics(y[s]).J[:, 3:]  # zero for joints that slide
        out[s, 3:] -= (axes @ (armature * dynamics.at(y[s], v[s], a[s]).A)[:, :, None])[:, :, 0]
    return out


# Linear deviation of frames from the nominal motion: the errors of kineto-elastodynamics.
#
# With the deviation d of the coordinates and the Jacobian J(t) of a frame along the nominal motion,
# e = J d is the displacement of its origin and its small rotation, in the world frame: the motion
# of the frame where the coordinates move by d.

# J d is differentiated along the motion over this time, s: its error, the square of it times the
# fourth rate of J, stays below 1e-6 of J d for motions slower than a millisecond.
_DELTA = 1e-5


def frame_deviations(mechanism: Mechanism, run: Run) -> dict[str, Array]:
    """Deviation, its rate and acceleration, of every reported frame.

    Returns:
        frame/NAME/deviation, deviation_rate, deviation_acceleration: (nt, 6), displacement of the
        origin (m) and rotation (rad) about the world axes, and their derivatives.
    """
    path, names = run.path, mechanism.description.reported
    if path is None or not names:
        return {}
    dynamics, system = Equations(run.system), run.system
    manifold, straight = Manifold(dynamics), path.straight(system.n_eta)
    rate, acceleration = np.zeros((2, len(run.t), system.nv))
    m, places = int(system.rigid.nv), [system.expansion.frames[name] for name in names]
    rate[:, :m], acceleration[:, :m] = path.v, path.a
    d = manifold.log(straight, run.y)
    dv, da = run.v - rate, run.a - acceleration

    def displaced(x: float) -> Array:
        """J d of every frame a time x [s] on, shape (frames, nt, 6)."""
        y = manifold.retract(straight, x * rate + 0.5 * x * x * acceleration)
        moved = d + x * dv + 0.5 * x * x * da
        joints = [place.joint for place in places]
        poses, rates = dynamics.motions(y, moved, 0.0 * moved, joints)
        each = zip(poses, rates, places, strict=True)
        return np.array([motion_of(R, V, place.placement)[2] for R, V, place in each])

    before, here, after = (displaced(x) for x in (-_DELTA, 0.0, _DELTA))
    error = (here, (after - before) / (2 * _DELTA), (after - 2 * here + before) / _DELTA**2)
    keys = ("deviation", "deviation_rate", "deviation_acceleration")
    return {
        f"frame/{name}/{key}": error[order][number]
        for number, name in enumerate(names)
        for order, key in enumerate(keys)
    }


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
    unasked: dict[tuple[str, ...], Callable[[], dict[str, Any]]] = {}
    if run.several is not None:
        unasked[("statistics",)] = told("statistics", run.several)
    return Result(run.t, arrays, Late({}, {ASSESSED: assessed, **described}, unasked or None))


def recover(mechanism: Mechanism, run: Run, rigid_path: Nominal | None) -> dict[str, Array]:
    """Arrays of a Result at once, by flat key."""
    return dict(_arrays(Samples(mechanism, run, lambda: rigid_path), run))


_OF_FORCES = ("link/*/resultant", "link/*/stress/*", "link/*/mesh/*")


def _arrays(samples: Samples, run: Run) -> Late[Array]:
    """Groups of arrays; "reaction_world" and "shaking" by name alone: neither listed nor stored."""

    def group(find: Callable[[Samples], dict[str, Array]]) -> Callable[[], dict[str, Array]]:
        return lambda: _read_only(find, samples)

    return Late(
        _read_only(_states, run),
        {
            **{(one.key,): group(partial(_row, one)) for one in KEYS if one.of is not None},
            ("frame", "energy"): group(_motion),
            ("body",): group(_body_poses),
            ("loop", "reaction", "residual"): group(lambda s: s.forces.arrays),
            ("link/*/x",): group(lambda s: sections(s) if s.run.system.n_eta else {}),
            _OF_FORCES: group(lambda s: forces(s) if s.run.system.n_eta else {}),
            ("link",): group(lambda s: lines(s) if s.run.system.n_eta else {}),
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


def _row(one: Key, samples: Samples) -> dict[str, Array]:
    """What stands under a key that says itself how it is computed."""
    values = None if one.of is None else one.of(samples)
    return {} if values is None else {one.key: values}


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
    """frame and energy; of a linear run, the deviations of frames too."""
    run = samples.run
    out = samples.kinematics.arrays | _energy_flow(run)
    return out if run.path is None else out | frame_deviations(samples.mechanism, run)


def _body_poses(samples: Samples) -> dict[str, Array]:
    mechanism, bodies = samples.mechanism, _bodies(samples.mechanism)
    frames = samples.run.system.expansion.frames
    out = _poses("pose", samples.kinematics.poses, bodies, frames)
    if samples.rigid_poses is None:
        return out | {f"body/{name}/pose_rigid": out[f"body/{name}/pose"] for name in bodies}
    frames = mechanism.rigid.expansion.frames
    return out | _poses("pose_rigid", samples.rigid_poses, bodies, frames)


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
