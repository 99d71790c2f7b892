"""Kinematics of the expanded model at the samples of a run: poses, rates, energies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinflex.actuation.nominal import Nominal
from pinflex.arrays import Array
from pinflex.integrators.run import Run
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.expanded import Attachment
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.poses import as_matrices
from pinflex.recovery.load_work import load_work, without_potential
from pinflex.text import brief


@dataclass(frozen=True)
class Kinematics:
    """Kinematics of one run.

    Attributes:
        poses: Of the joints that outputs look at, shape (nt, 3, 4) each.
        arrays: Those of a Result, by flat key: reported frames and energies.
        spins: Angular speeds [rad/s] of the joints that carry a flexible body, shape (nt,) each.
    """

    __repr__ = brief

    poses: Mapping[int, Array]
    arrays: dict[str, Array]
    spins: dict[int, Array]


def kinematics(mechanism: Mechanism, run: Run) -> Kinematics:
    """Kinematics of a run."""
    dynamics, nt, expansion = Equations(run.system), len(run.t), run.system.expansion
    frames = {name: expansion.frames[name] for name in mechanism.description.reported}
    working = without_potential(run.system.loads)
    bearing = {slot.root.joint for slot in expansion.slots}
    joints = run.system.looked_at
    found = dynamics.motions(run.y, run.v, run.a, joints)
    poses, rates = (dict(zip(joints, each, strict=True)) for each in found)
    energies = dynamics.energies(run.y, run.v, run.t)
    arrays = {f"energy/{name}": x for name, x in energies._asdict().items()}
    for name, frame in frames.items():
        seen = motion_of(poses[frame.joint], rates[frame.joint], frame.placement)
        keys = ("position", "rotation", "velocity", "acceleration")
        arrays |= {f"frame/{name}/{key}": x for key, x in zip(keys, seen, strict=True)}
    if working:
        arrays["energy/loads"] = sum(
            (
                load_work(force, run.t, *motion_of(poses[at.joint], rates[at.joint], at.placement))
                for force, at in working
            ),
            np.zeros(nt),
        )
    spins = {joint: np.linalg.norm(rates[joint][:, 0, 3:], axis=1) for joint in bearing}
    return Kinematics(poses, arrays, spins)


def motion_of(poses: Array, rates: Array, placement: pin.SE3) -> tuple[Array, Array, Array, Array]:
    """Of a frame: position, rotation, velocity and classical acceleration in the world."""
    turn, p = poses[:, :, :3], np.asarray(placement.translation)
    (v, w), (a, spin) = (x.reshape(-1, 2, 3).swapaxes(0, 1) for x in rates.swapaxes(0, 1))
    speed = v + np.cross(w, p)
    linear = a + np.cross(spin, p) + np.cross(w, speed)

    def world(*vectors: Array) -> Array:
        return np.concatenate([(turn @ x[..., None])[..., 0] for x in vectors], axis=1)

    position = turn @ p + poses[:, :, 3]
    return position, turn @ placement.rotation, world(speed, w), world(linear, spin)


def joint_poses(mechanism: Mechanism, path: Nominal) -> Mapping[int, Array]:
    """Poses of the rigid joints along a nominal motion, shape (nt, 3, 4) each."""
    dynamics = Equations(mechanism.rigid)
    return dict(enumerate(as_matrices(dynamics.joint_poses(path.q)).swapaxes(0, 1)))


def pose_of(poses: Mapping[int, Array], here: Attachment) -> Array:
    """Poses (nt, 3, 4) of something attached to a joint."""
    joint = poses[here.joint]
    local = np.column_stack([here.placement.rotation, here.placement.translation])
    moved: Array = joint[:, :, :3] @ local
    moved[:, :, 3] += joint[:, :, 3]
    return moved
