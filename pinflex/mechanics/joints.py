"""The joints of a scene on Pinocchio's rows: names, motors, rotors, springs and dampers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.description.description import Description
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.system import Springs
from pinflex.text import brief

_HEADS = {"RU": "continuous", "R": "revolute", "P": "prismatic", "S": "spherical"}
_KINDS = {"Planar": "planar", "FreeFlyer": "free_flyer", "Translation": "translation"}


@dataclass(frozen=True)
class Joint:
    """A moving joint of a mechanism.

    Attributes:
        name: Of the joint.
        kind: Revolute, continuous, prismatic, spherical, free-flyer ... as Pinocchio has it.
        motor: Whether a motor drives it.
        home: Its coordinates at home [rad | m], shape (n,).
    """

    __repr__ = brief

    name: str
    kind: str
    motor: bool
    home: Array


def joint_of(model: pin.Model, home: Array, motors: tuple[str, ...], name: str) -> Joint:
    """A moving joint by its name."""
    names = list(model.names)[1:]
    if name not in names:
        raise DescriptionError(f"joints: {name}: no such moving joint.{nearest(name, names)}")
    joint = model.joints[model.getJointId(name)]
    short = joint.shortname().removeprefix("JointModel")
    kind = _KINDS.get(short, next((w for k, w in _HEADS.items() if short.startswith(k)), short))
    return Joint(name, kind, name in motors, home[joint.idx_q : joint.idx_q + joint.nq].copy())


def coordinate_names(model: pin.Model) -> tuple[str, ...]:
    """Name of every velocity row."""
    names: list[str] = []
    for joint, name in zip(model.joints[1:], model.names[1:], strict=True):
        names.extend([name] if joint.nv == 1 else [f"{name}[{k}]" for k in range(joint.nv)])
    return tuple(names)


def sliding(model: pin.Model) -> set[str]:
    """Prismatic joints."""
    pairs = zip(model.names, model.joints, strict=True)
    return {n for n, j in pairs if j.nv == 1 and j.shortname().startswith("JointModelP")}


def motor_rows(description: Description, model: pin.Model) -> IntArray:
    """Velocity rows of the actuated joints."""
    rows: list[int] = []
    for name in description.actuated:
        joint = model.joints[model.getJointId(name)] if model.existJointName(name) else None
        if joint is None:
            raise DescriptionError(
                f"{description.name}: actuated: {name} is not a moving joint."
                f"{nearest(name, list(model.names)[1:])}"
            )
        rows.extend(range(joint.idx_v, joint.idx_v + joint.nv))
    return np.array(rows, dtype=np.intp)


def add_rotors(model: pin.Model, description: Description) -> None:
    """Write the rotors' inertias to the model's armature."""
    for name, extra in description.joints.items():
        if extra.armature:
            model.armature[_rows_of(model, name)] = extra.armature


def joint_springs(description: Description, model: pin.Model) -> tuple[Springs, Array]:
    """Springs, and the dampers' coefficients (nv,) [N m s/rad | N s/m], of the rigid joints."""
    damping = np.zeros(model.nv)
    found: list[tuple[int, int, int, float, float]] = []
    for name, extra in description.joints.items():
        if extra.viscous:
            damping[_rows_of(model, name)] = extra.viscous
        if extra.spring:
            rows = _rows_of(model, name)
            if len(rows) != 1:
                raise DescriptionError(
                    f"{description.name}: joints.{name}.spring: {len(rows)} axes in one joint. "
                    "Springs act on single-axis joints; split the joint in the URDF."
                )
            joint = model.joints[model.getJointId(name)]
            paired = int(joint.nq == 2)
            found.append((joint.idx_v, joint.idx_q, paired, extra.spring, extra.rest))
    springs = Springs(
        np.array([f[0] for f in found], dtype=np.intp),
        np.array([f[1] for f in found], dtype=np.intp),
        np.array([f[2] for f in found], dtype=np.intp),
        np.array([f[3] for f in found], dtype=float),
        np.array([f[4] for f in found], dtype=float),
    )
    return springs, damping


def _rows_of(model: pin.Model, name: str) -> list[int]:
    """Velocity rows of a URDF joint; a universal joint is two: NAME.1 and NAME.2."""
    rows: list[int] = []
    for joint_name in (name, f"{name}.1", f"{name}.2"):
        if model.existJointName(joint_name):
            joint = model.joints[model.getJointId(joint_name)]
            rows.extend(range(joint.idx_v, joint.idx_v + joint.nv))
    return rows
