"""Kinematics of the expanded model at the samples of a run: poses, rates, energies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinflex.actuation.nominal import Nominal
from pinflex.arrays import Array
from pinflex.integrators.run import Run
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.expanded import Attachment
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.stacked import Stacked, spans
from pinflex.text import brief

TOGETHER = 64  # samples at a time: numpy's price for a call is spread, little memory is needed


@dataclass(frozen=True)
class Kinematics:
    """Kinematics of one run.

    Attributes:
        poses: Of the joints of the expanded model, shape (nt, joints, 3, 4).
        arrays: Those of a Result, by flat key: reported frames and energies.
    """

    __repr__ = brief

    poses: Array
    arrays: dict[str, Array]


def kinematics(mechanism: Mechanism, run: Run) -> Kinematics:
    """Kinematics of a run: Pinocchio takes the samples one after the other, numpy many at once.

    Args:
        mechanism: Mechanism that was solved.
        run: Its states.
    """
    dynamics, nt = Dynamics(run.system), len(run.t)
    model, data, here = dynamics.model, dynamics.data, dynamics.closed.poses
    reported = mechanism.description.reported
    frames = {name: run.system.expansion.frames[name] for name in reported}
    poses, energy = np.empty((nt, model.njoints, 3, 4)), np.zeros((nt, 4))
    rates = {frame.joint: np.empty((nt, 2, 6)) for frame in frames.values()}
    stacked = Stacked(dynamics, min(nt, TOGETHER))
    for at in spans(nt, TOGETHER):
        Q, V, A, _ = stacked.expanded(run.y[at], run.v[at], run.a[at])
        for k, (q, v, a) in enumerate(zip(Q, V, A, strict=True), start=at.start):
            pin.forwardKinematics(model, data, q, v, a)
            here.refresh()
            poses[k, :, :, :3], poses[k, :, :, 3] = here.rotation, here.translation
            for joint, table in rates.items():
                table[k] = data.v[joint].vector, data.a[joint].vector
            energy[k, 0] = pin.computeKineticEnergy(model, data)
            energy[k, 1] = pin.computePotentialEnergy(model, data)
            if dynamics.loaded:
                energy[k, 3] = dynamics.loads.energy(float(run.t[k]))
    eta = run.y[:, dynamics.nq_rigid :]
    energy[:, 2] = dynamics.elastic_energy(eta)
    if dynamics.sprung:
        s = run.system.springs
        stretch = np.array([dynamics.spring_angles(y) for y in run.y]) - s.rest
        energy[:, 3] += 0.5 * stretch**2 @ s.stiffness
    arrays = {
        f"energy/{name}": energy[:, k]
        for k, name in enumerate(("kinetic", "gravity", "elastic", "spring"))
    }
    for name, frame in frames.items():
        found = _frame(poses[:, frame.joint], rates[frame.joint], frame.placement)
        keys = ("position", "rotation", "velocity", "acceleration")
        arrays |= {f"frame/{name}/{key}": x for key, x in zip(keys, found, strict=True)}
    return Kinematics(poses, arrays)


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
    """Poses of the rigid joints along a nominal motion, shape (nt, joints, 3, 4).

    Args:
        mechanism: Mechanism that was solved.
        path: Motion of the rigid mechanism.
    """
    dynamics = Dynamics(mechanism.rigid)
    model, here = dynamics.model, dynamics.closed.poses
    poses = np.empty((len(path.t), model.njoints, 3, 4))
    for k, q in enumerate(path.q):
        pin.forwardKinematics(model, dynamics.data, q)
        here.refresh()
        poses[k, :, :, :3], poses[k, :, :, 3] = here.rotation, here.translation
    return poses


def pose_of(poses: Array, here: Attachment) -> Array:
    """Poses (nt, 3, 4) of something attached to a joint.

    Args:
        poses: Joint poses, shape (nt, joints, 3, 4).
        here: Joint and placement in its frame.
    """
    joint = poses[:, here.joint]
    local = np.column_stack([here.placement.rotation, here.placement.translation])
    moved: Array = joint[:, :, :3] @ local
    moved[:, :, 3] += joint[:, :, 3]
    return moved
