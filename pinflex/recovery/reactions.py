"""Joint reactions in one frame for tree joints and loops, and the shaking force on the frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pinflex.arrays import Array, spans
from pinflex.integrators.run import Run
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.loads import Loads
from pinflex.recovery.kinematics import joint_poses
from pinflex.recovery.samples import Samples, run_of, samples_of
from pinflex.results.result import Result


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
    dynamics = Equations(system)
    y, v = (np.array(x) for x in zip(*(run.acting(k) for k in range(nt)), strict=True))
    base = [int(joint) for joint in dynamics.model.children[0]]
    # What the first joints carry; multipliers, without which nothing balances, add none to it.
    carried = dynamics.joint_forces(y, v, run.a, 0.0 * run.lam, run.t, base).f
    out, poses = _rotors(dynamics, y, v, run.a), dynamics.joint_poses(y)
    for k, joint in enumerate(base):
        axes, origin = poses[:, joint, :9].reshape(-1, 3, 3), poses[:, joint, 9:]
        force, moment = ((x[:, None] @ axes)[:, 0] for x in (carried[:, k, :3], carried[:, k, 3:]))
        out[:, :3] -= force
        out[:, 3:] -= moment + np.cross(origin, force)
    return out


def _rotors(dynamics: Equations, y: Array, v: Array, a: Array) -> Array:
    """What the spins of rotors do to the frame, shape (nt, 6)."""
    out, armature = np.zeros((len(y), 6)), np.asarray(dynamics.model.armature)
    for s in spans(len(y)) if armature.any() else ():
        axes = dynamics.kinematics(y[s]).J[:, 3:]  # zero for joints that slide
        out[s, 3:] -= (axes @ (armature * dynamics.at(y[s], v[s], a[s]).A)[:, :, None])[:, :, 0]
    return out
