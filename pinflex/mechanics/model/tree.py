"""The links of a Pinocchio model, with the inertia each brings, as a tree that can be built anew.

Pinocchio merges links that hang on fixed joints into one body. A flexible link has to be taken out
of that sum, and what is attached to it has to move with its deflected sections, so the merged model
is undone here into one record per link.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.bodies.beam import damping
from pinflex.description.blocks.flexible import EndMass, FlexibleLink
from pinflex.description.blocks.joints import JointExtra
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.manifold import bounded
from pinflex.mechanics.model.loads import Springs
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.bodies.basis import FlexibleBody
    from pinflex.description.blocks.external import Payload
    from pinflex.description.description import Description


@frozen
class JointStep:
    """One Pinocchio joint of a link's parent joint (a universal joint has two)."""

    name: str
    model: pin.JointModel


@frozen
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


def poses_of(links: Sequence[Link]) -> list[pin.SE3]:
    """Poses of the links at zero joint angles, in the world."""
    poses: list[pin.SE3] = []
    for link in links:
        above = poses[link.parent] if link.parent >= 0 else pin.SE3.Identity()
        poses.append(above * link.placement)
    return poses


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
    if description.payload is not None and not description.payload.timed:
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
    """Undo Pinocchio's merging of fixed joints: one record per link, in depth-first order."""
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
                steps = tuple(replace(step, model=bounded(step.model)) for step in steps)
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


@frozen
class Joint:
    """A moving joint of a mechanism.

    Attributes:
        name: Of the joint.
        kind: Revolute, continuous, prismatic, spherical, free-flyer ... as Pinocchio has it.
        motor: Whether a motor drives it.
        home: Its coordinates at home [rad | m], shape (n,).
    """

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
            model.armature[joint_rows(model, name)] = extra.armature


def joint_springs(description: Description, model: pin.Model) -> tuple[Springs, Array]:
    """Springs, and the dampers' coefficients (nv,) [N m s/rad | N s/m], of the rigid joints."""
    damping = np.zeros(model.nv)
    found: list[tuple[int, int, int, float, float]] = []
    for name, extra in description.joints.items():
        if extra.viscous:
            damping[joint_rows(model, name)] = extra.viscous
        if extra.spring:
            rows = joint_rows(model, name)
            if len(rows) != 1:
                raise DescriptionError(
                    f"{description.name}: joints.{name}.spring: {len(rows)} axes in one joint. "
                    "Springs act on single-axis joints; split the joint in the URDF."
                )
            joint = model.joints[model.getJointId(name)]
            paired = int(joint.nq == 2)
            found.append((joint.idx_v, joint.idx_q, paired, extra.spring, extra.rest))
    at = np.array([f[:3] for f in found], dtype=np.intp).reshape(-1, 3).T
    law = np.array([f[3:] for f in found], dtype=float).reshape(-1, 2).T
    return Springs(*(x.copy() for x in (*at, *law))), damping


def joint_rows(model: pin.Model, name: str) -> list[int]:
    """Velocity rows of a URDF joint; a universal joint is two: NAME.1 and NAME.2."""
    rows: list[int] = []
    for joint_name in (name, f"{name}.1", f"{name}.2"):
        if model.existJointName(joint_name):
            joint = model.joints[model.getJointId(joint_name)]
            rows.extend(range(joint.idx_v, joint.idx_v + joint.nv))
    return rows


# How a beam and rigid riders on it share the inertia that the URDF gives a link.
#
# The beam gives a link its stiffness, the URDF its inertia: mass, centre and moments stay as they
# are. The beam carries as much of them as it can, and the rest (motors, covers) rides on it.
#
# What can be taken from a link is decided by its pseudo-inertia (Wensing, Kim, Slotine 2018)
#
#     J = [[Sigma, h], [h', m]],     Sigma = integral of r r' dm = 1/2 tr(I) 1 - I,
#
# which is positive semidefinite exactly if some positive mass distribution has it. So
#
# 1. the beam's mass points get the largest share s <= 1 of their density that leaves J - s J_points
#    positive semidefinite;
# 2. a point mass at the tip, by the lever rule, as far as the remainder stays positive
#    semidefinite;
# 3. what only turns gets the largest share up to s that leaves the kinetic energy of the remainder
#    positive semidefinite: the twist first, then the rotary inertia of bending, each on its own
#    (of a thin panel the mass points take all that there is across it, and it twists all the same);
# 4. the remainder rides on the section beside its own centre of mass, so that weight and inertia
#    load the beam with the right moment.
#
# Moments that were estimated often violate the triangle inequality, or nearly: then 1. and 2. would
# leave the beam next to nothing, and ask, as 3. does, for the kinetic energy alone.

# Smallest share of its density that a beam may carry. Below it the modes of the beam alone lie
# seven times higher than those of the beam as described, and the section was not of this link.
LEAST = 0.02
_NONE = 1e-12  # of the link's mass and span: round-off
_MASSLESS = 1e-9  # of the link's mass: what the search for the largest share leaves of it is less
_SMALL = 1e-3  # of the link's mass: a tip mass not worth having
_PLACES = 7  # of the share of the span: what is beside it in the last digits rides on one section
_AT_END = 0.05  # of the span: a remainder so near an end rides on the end itself


@frozen
class Rider:
    """A rigid inertia on the section at x [m], in the section's frame (axes of the beam)."""

    x: float
    inertia: pin.Inertia


@dataclass(frozen=True)
class Split:
    """A link's inertia shared out.

    Attributes:
        share: Share of the beam's density that its stations carry, 0 to 1.
        turning: The same about x, y and z of the sections: twist and rotary inertia.
        riders: The rest. Beam and riders have the inertia of the URDF's link to round-off.
    """

    share: float
    turning: tuple[float, float, float]
    riders: tuple[Rider, ...]


def end_riders(spec: FlexibleLink, length: float) -> tuple[Rider, ...]:
    """The end masses `root` and `tip` of a description, as riders."""
    ends: tuple[tuple[float, EndMass | None], ...] = ((0.0, spec.root), (length, spec.tip))
    return tuple(
        Rider(x, pin.Inertia(end.mass, np.zeros(3), np.diag(np.array(end.inertia, float))))
        for x, end in ends
        if end is not None
    )


def travelling(bodies: Sequence[FlexibleBody]) -> Array:
    """Spatial inertia (6, 6) of the mass points of a beam, about its root [kg, kg m, kg m^2]."""
    total = np.zeros((6, 6))
    for k, body in enumerate(bodies):
        points = body.points + np.array([k * body.length, 0.0, 0.0])
        m, h = float(body.mass.sum()), body.mass @ points
        spread = points.T @ (body.mass[:, None] * points)
        total += _spatial(m, h, np.trace(spread) * np.eye(3) - spread)
    return total


def turning(bodies: Sequence[FlexibleBody]) -> Array:
    """Spatial inertia (6, 6) of what only turns: twist stations, rotary inertia of sections."""
    total = np.zeros((6, 6))
    for body in bodies:
        total[3, 3] += body.It.sum()
        if body.inertia is not None:
            total[3:, 3:] += np.diag(body.inertia.sum(axis=0))
    return total


def split(link: pin.Inertia, bodies: Sequence[FlexibleBody], length: float) -> Split:
    """Share a link's inertia between a beam and riders; 0 where no part of the beam fits."""
    units = np.append(np.ones(3), np.full(3, 1.0 / length)) / np.sqrt(link.mass)
    scale = np.outer(units, units)
    whole, points = scale * link.matrix(), scale * travelling(bodies)
    form: Callable[[Array], Array] = pseudo
    share = min(1.0, _largest(form(whole), form(points)))
    if share < LEAST:
        # Moments that no body has (a triangle inequality violated, in the last digits or by
        # estimation): what matters then is that kinetic energy stays positive.
        form, share = np.asarray, min(1.0, _largest(whole, points))
    rest = whole - share * points
    moment, mass = rest[5, 1], rest[0, 0]  # about the root, in units of mass and span
    end = np.array([1.0, 0.0, 0.0])
    tip = _spatial(1.0, end, np.diag([0.0, 1.0, 1.0]))
    at_tip = min(max(moment, 0.0), max(mass, 0.0), _largest(form(rest), form(tip)))
    at_tip = at_tip if at_tip > _SMALL else 0.0
    rest = rest - at_tip * tip
    turns = np.diag(scale * turning(bodies))
    spin = [share] * 3
    for axis, row in enumerate(range(3, 6)):
        if turns[row]:
            part = np.diag(np.where(np.arange(6) == row, turns, 0.0))
            spin[axis] = min(share, _largest(rest, part))
            rest = rest - spin[axis] * part
    riders = []
    if at_tip:
        riders.append(Rider(length, pin.Inertia(at_tip * link.mass, np.zeros(3), np.zeros((3, 3)))))
    if np.abs(rest).max() > _NONE:
        x = _beside_the_centre(rest, points) * length
        placed = pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))
        rider = placed.actInv(_inertia(rest / scale, _NONE * link.mass))
        if rest[0, 0] <= _MASSLESS:
            rider.lever = np.zeros(3)
        riders.append(Rider(x, rider))
    return Split(share, (spin[0], spin[1], spin[2]), tuple(riders))


def moved(split: Split, stretch: float) -> Split:
    """The same riders on a beam of another length, each at its share of it."""
    return replace(split, riders=tuple(replace(r, x=stretch * r.x) for r in split.riders))


def weighed(
    body: FlexibleBody, link: FlexibleLink, shares: Split, riders: Sequence[Rider]
) -> FlexibleBody:
    """A body with its share of mass, and its mass and damping matrix with the riders."""
    inertia = None if body.inertia is None else np.array(shares.turning) * body.inertia
    mass, It = shares.share * body.mass, shares.turning[0] * body.It
    M = np.einsum("k,kai,kaj->ij", mass, body.Phi, body.Phi)
    M += np.einsum("k,ki,kj->ij", It, body.Phi_t, body.Phi_t)
    if inertia is not None and body.Phi_r is not None:  # rows (rz, ry, rx), inertia (x, y, z)
        M += np.einsum("ka,kai,kaj->ij", inertia[:, ::-1], body.Phi_r, body.Phi_r)
    if link.segments == 1:  # one body stands for every segment; none of them owns the riders
        for rider in riders:
            Phi = body.rows(rider.x)[0][[0, 1, 2, 5, 4, 3]]
            M += Phi.T @ rider.inertia.matrix() @ Phi
    M = 0.5 * (M + M.T)
    D = damping(link, body.slices, body.K, M)
    return replace(body, mass=mass, It=It, inertia=inertia, M=M, D=D)


def pseudo(spatial: Array) -> Array:
    """Pseudo-inertia (4, 4) of a spatial inertia (6, 6); linear in it."""
    tensor = spatial[3:, 3:]
    h = np.array([spatial[5, 1], spatial[3, 2], spatial[4, 0]])
    Sigma = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    found = np.empty((4, 4))
    found[:3, :3], found[:3, 3], found[3, :3], found[3, 3] = Sigma, h, h, spatial[0, 0]
    return found


def _spatial(m: float, h: Array, tensor: Array) -> Array:
    """Spatial inertia (6, 6) of mass m, first moment h and inertia about the origin."""
    found = np.diag([m, m, m, 0.0, 0.0, 0.0])
    found[3:, 3:] = tensor
    found[3:, :3] = cross = [[0.0, -h[2], h[1]], [h[2], 0.0, -h[0]], [-h[1], h[0], 0.0]]
    found[:3, 3:] = np.transpose(cross)
    return found


def _inertia(spatial: Array, none: float) -> pin.Inertia:
    """Pinocchio's record of a spatial inertia; a mass up to `none` is taken as none."""
    m, tensor = float(spatial[0, 0]), 0.5 * (spatial[3:, 3:] + spatial[3:, 3:].T)
    if m <= none:
        m, h = 0.0, np.zeros(3)
        found = pin.Inertia.Zero()
        found.inertia = tensor
        return found
    h = np.array([spatial[5, 1], spatial[3, 2], spatial[4, 0]])
    upper = tensor[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]  # its constructor refuses round-off
    return pin.Inertia.FromDynamicParameters(np.concatenate([[m], h, upper]))


def _largest(A: Array, B: Array) -> float:
    """Largest s >= 0 with A - s B positive semidefinite, for A, B positive semidefinite."""
    w, V = np.linalg.eigh(A)
    some = w > _NONE * max(w[-1], _NONE)
    null = V[:, ~some]
    if w[0] < -_NONE * w[-1] or not np.any(some):
        return 0.0
    if null.size and np.linalg.norm(null.T @ B @ null) > _NONE * np.linalg.norm(B):
        return 0.0
    half = V[:, some] / np.sqrt(w[some])
    top = float(np.linalg.eigvalsh(half.T @ B @ half)[-1])
    return 1.0 / top if top > 0 else np.inf


def _beside_the_centre(rest: Array, beam: Array) -> float:
    """Section, as a share of the span, that is next to a remainder's centre of mass.

    Of a remainder that only turns it is the beam's: the same wherever round-off puts its own.
    """
    mass, moment = rest[0, 0], rest[5, 1]
    if mass <= _MASSLESS:
        mass, moment = beam[0, 0], beam[5, 1]
    x = round(float(np.clip(moment / mass, 0.0, 1.0)), _PLACES)
    return 0.0 if x < _AT_END else 1.0 if x > 1.0 - _AT_END else x
