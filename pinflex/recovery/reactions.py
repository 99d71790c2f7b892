"""Joint reactions in one frame for tree joints and loops, and the shaking force on the frame."""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.integrators.run import Run
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.loads import LoadRows, Loads
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.kinematics import joint_poses
from pinflex.recovery.samples import Samples, run_of, samples_of
from pinflex.results.result import Result


def joint_reactions(mechanism: Mechanism, result: Result) -> dict[str, Array]:
    """Loads of every joint and loop, in the world frame, at the joint.

    Args:
        mechanism: The mechanism that was solved. result: A run at any level.
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
    """Shaking force and moment of a result; see `shaking_of`.

    Args:
        mechanism: The mechanism that was solved.
        result: A run at any level.
    """
    return shaking_of(run_of(mechanism, result))


def shaking_of(run: Run) -> Array:
    """Shaking force (N) and moment (N m, about the world origin) on the frame, shape (nt, 6).

    Weight, external loads and inertia of all that moves, motors' reactions included:
    -(dh/dt - gravity - loads). A rotor's own spin counts as inertia about its joint's axis.
    """
    dynamics = Equations(run.system)
    out = np.empty((len(run.t), 6))
    for k in range(len(run.t)):
        y, v = run.acting(k)
        out[k] = -_from_ground(dynamics, y, v, run.a[k], float(run.t[k]))
    return out


def _from_ground(dynamics: Equations, y: Array, v: Array, a: Array, t: float) -> Array:
    """Wrench about the origin that the moving bodies need from the ground at t, shape (6,)."""
    model, here = dynamics.model, dynamics.at(y, v, a)
    V, A = here.V[0], here.A[0]
    force, moment = dynamics.pinocchio.from_ground(here.Q[0], V, A)
    poses, J, _ = dynamics.pinocchio.jacobians(here.Q)
    axes = J[0, 3:]  # zero for joints that slide
    moment = moment + axes @ (model.armature * A)
    wrench = np.concatenate([force, moment])
    if dynamics.added is not None:
        wrench += dynamics.added.from_ground(here.Q[0], V, A)
    given = dynamics.system.loads.forces
    if given:
        loads = LoadRows(Loads(given, ()), model).at(poses[0], J[0])
        for joint, load in loads.wrenches(V, t).items():
            wrench -= load if joint else 0.0 * load
    return wrench
