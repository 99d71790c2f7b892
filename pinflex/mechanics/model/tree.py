"""The links of a Pinocchio model, with the inertia each brings, as a tree that can be built anew.

Pinocchio merges links that hang on fixed joints into one body. A flexible link has to be taken out
of that sum, and what is attached to it has to move with its deflected sections, so the merged model
is undone here into one record per link.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.description.blocks.joints import JointExtra
from pinflex.description.description import Description
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.model.loads import Springs
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.description.payload import Payload


@dataclass(frozen=True)
class JointStep:
    """One Pinocchio joint of a link's parent joint (a universal joint has two)."""

    __repr__ = brief

    name: str
    model: pin.JointModel


@dataclass(frozen=True)
class Link:
    """A link with its own inertia and how it hangs on its parent link.

    Attributes:
        name: URDF link name.
        parent: Index of the parent link in the tree, -1 for a root.
        joint: Name of the URDF joint that carries the link, "" for a root.
        placement: Pose of the joint in the parent link's frame.
        steps: The moving joints, empty for a fixed joint.
        inertia: The link's own inertia in its own frame.
    """

    __repr__ = brief

    name: str
    parent: int
    joint: str
    placement: pin.SE3
    steps: tuple[JointStep, ...]
    inertia: pin.Inertia

    @property
    def weighs(self) -> bool:
        """Whether it has mass, or moments of inertia alone."""
        return _weighs(self.inertia)


def model_of(description: Description) -> pin.Model:
    """The URDF as Pinocchio reads it, with the gravity and the base of the YAML."""
    where = description.urdf_name
    try:
        if description.base == "free_flyer":
            model = pin.buildModelFromXML(description.urdf_text, pin.JointModelFreeFlyer())
        else:
            model = pin.buildModelFromXML(description.urdf_text)
    except Exception as error:
        raise DescriptionError(
            f"{where}: Pinocchio cannot read this URDF: {str(error).strip()}. "
            "Check it with a URDF checker; the names of links and joints must be unique."
        ) from error
    model.gravity.linear = np.array(description.gravity, float)
    if description.payload is not None:
        _carry(model, description.payload)
    return model


def _carry(model: pin.Model, payload: Payload) -> None:
    """Hang a payload on its frame, as the link of a fixed joint would."""
    above = model.getFrameId(payload.frame, pin.FrameType.BODY)
    at = model.frames[above]
    inertia = pin.Inertia(payload.mass, np.array(payload.centre), payload.tensor)
    joint, fixed, body = at.parentJoint, pin.FrameType.FIXED_JOINT, pin.FrameType.BODY
    carrier = pin.Frame(f"{payload.name}_joint", joint, above, at.placement, fixed, inertia)
    under = model.addFrame(carrier)
    model.addFrame(pin.Frame(payload.name, joint, under, at.placement, body))


def link_tree(
    model: pin.Model, extras: Mapping[str, JointExtra], coupled: Collection[str] = ()
) -> tuple[Link, ...]:
    """Undo Pinocchio's merging of fixed joints: one record per link, parents first.

    Returns:
        The links in depth-first order.
    """
    frames = model.frames
    own = _own_inertias(model)
    links: list[Link] = []
    index: dict[int, int] = {}
    no_steps: tuple[JointStep, ...] = ()
    for number, frame in enumerate(frames):
        if frame.type != pin.FrameType.BODY:
            continue
        above = frame.parentFrame
        carrier = frames[above]
        if carrier.type == pin.FrameType.BODY or above == 0:
            parent, joint = -1, ""
            placement, steps = frame.placement, no_steps
        else:
            body_above = carrier.parentFrame
            parent, joint = index.get(body_above, -1), carrier.name
            steps = _steps(model, carrier, extras.get(joint))
            if joint in coupled:
                steps = tuple(replace(step, model=_angle(step.model)) for step in steps)
            placement = _placement(model, carrier, frames[body_above])
        index[number] = len(links)
        links.append(Link(frame.name, parent, joint, placement, steps, own[number]))
    return tuple(links)


def _placement(model: pin.Model, carrier: pin.Frame, above: pin.Frame) -> pin.SE3:
    """Pose of a joint frame in the frame of the link above it."""
    if carrier.type == pin.FrameType.JOINT:
        return above.placement.actInv(model.jointPlacements[carrier.parentJoint])
    return above.placement.actInv(carrier.placement)


def _steps(model: pin.Model, carrier: pin.Frame, extra: JointExtra | None) -> tuple[JointStep, ...]:
    name = carrier.name
    if extra is not None and extra.type == "fixed":
        return ()
    if extra is not None and extra.type == "spherical":
        return (JointStep(name, pin.JointModelSpherical()),)
    if extra is not None and extra.type == "universal":
        # Two plain revolutes: their axes are constant in their own frames, which the analytic
        # derivatives of Pinocchio rely on (JointModelUniversal's are not).
        first, second = (np.array(axis, float) for axis in extra.axes or ((1, 0, 0), (0, 1, 0)))
        return (
            JointStep(f"{name}.1", pin.JointModelRevoluteUnaligned(first)),
            JointStep(f"{name}.2", pin.JointModelRevoluteUnaligned(second)),
        )
    if carrier.type == pin.FrameType.JOINT:
        return (JointStep(name, model.joints[carrier.parentJoint]),)
    return ()


def _angle(joint: pin.JointModel) -> pin.JointModel:
    """The same joint with its angle for a coordinate."""
    if joint.nq == joint.nv:
        return joint
    data = joint.createData()
    joint.calc(data, np.array([1.0, 0.0]))
    return pin.JointModelRevoluteUnaligned(np.array(data.S).reshape(-1)[3:])


def _own_inertias(model: pin.Model) -> dict[int, pin.Inertia]:
    """Each link's own inertia: its joint's, less what fixed joints merged into it."""
    frames = model.frames
    own: dict[int, pin.Inertia] = {}
    for number, frame in enumerate(frames):
        if frame.type != pin.FrameType.BODY:
            continue
        carrier = frames[frame.parentFrame]
        if carrier.type == pin.FrameType.FIXED_JOINT:
            own[number] = carrier.inertia if frame.parentFrame else pin.Inertia.Zero()
            continue
        inertia = model.inertias[frame.parentJoint]
        merged = [
            f.placement.act(f.inertia)
            for f in frames
            if f.type == pin.FrameType.FIXED_JOINT
            and f.parentJoint == frame.parentJoint
            and _weighs(f.inertia)
        ]
        for part in merged:
            inertia = inertia - part
        own[number] = frame.placement.actInv(inertia) if frame.parentJoint else pin.Inertia.Zero()
    return own


def _weighs(inertia: pin.Inertia) -> bool:
    return inertia.mass > 0 or bool(np.any(inertia.inertia))


# The joints of a scene on Pinocchio's rows: names, motors, rotors, springs and dampers.

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
