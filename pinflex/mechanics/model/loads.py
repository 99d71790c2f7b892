"""Forces from outside: dead or following loads at a frame, springs and dampers between two frames.

Present only where a scene has them. A load is a world wrench W on a body; the residual gets -J' W.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description.blocks.external import AddedMass, FrameForce, FrameSpring
from pinflex.description.blocks.frames import WORLD
from pinflex.errors import AssemblyError
from pinflex.mechanics.model.expanded import Attachment
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.mechanics.kinks import Kinks

_FAINT = 1e-9  # of the speed that friction is smoothed at: there tanh(x) / x is 1
_MEET = 1e-9  # [m], far below what a drawing says


BALL, PIN, WALL = range(3)  # in a socket, in a hole, a corner at a wall: kernel/source/touch.c


class Touch(NamedTuple):
    """A contact of two bodies: where they are, the distance e that counts, and how it rubs.

    Attributes:
        name: Of its loop. shape: `BALL`, `PIN` or `WALL`. a, b: The middle of the hole and of the
            pin, or a point of the wall's body and the corner.
        axis: Unit vector in the joint of a: along the hole, or towards the wall.
        gap: e at which it touches [m]. radius: From b to what touches [m].
        friction: Coulomb's coefficient. speed: At which it is smoothed [m/s].
        law: Its law among those of the system.
    """

    name: str
    shape: int
    a: Attachment
    b: Attachment
    axis: tuple[float, float, float]
    gap: float
    radius: float
    friction: float
    speed: float
    law: int

    def outward(self, d: Array) -> tuple[Array, Array]:
        """Unit vectors u towards the rim (n, 3), and u . d (n,), of ways d from a to b (n, 3)."""
        s = np.array(self.axis)
        along = d @ s
        if self.shape == WALL:
            return np.tile(s, (len(d), 1)), along
        off = d if self.shape == BALL else d - along[:, None] * s
        length = np.linalg.norm(off, axis=1)
        return off / np.maximum(length, 1e-300)[:, None], length

    def force(self, motion: Array, kinks: Kinks) -> TouchForce:
        """On B at b and about it, in axes of A, of n motions d, d', W of B as A sees it (n, 9)."""
        way, turn = motion[:, 3:6], motion[:, 6:]
        out, length = self.outward(motion[:, :3])
        rate = np.sum(out * way, axis=1)
        pull = kinks.pull(self.law, length - self.gap, rate)
        slip = way + self.radius * np.cross(turn, out) - rate[:, None] * out
        fast = np.linalg.norm(slip, axis=1)
        held = self.friction * np.maximum(pull.force, 0.0)
        smooth = np.tanh(fast / self.speed) / np.maximum(fast, 1e-300)
        rub = (
            -(held * np.where(fast > _FAINT * self.speed, smooth, 1.0 / self.speed))[:, None] * slip
        )
        moment = self.radius * np.cross(out, rub)
        loss = pull.loss - np.sum(rub * slip, axis=1)
        return TouchForce(rub - pull.force[:, None] * out, moment, pull.energy, loss)


class TouchForce(NamedTuple):
    """Force and moment (n, 3), stored energy (n,), J, and power taken (n,), W, of a contact."""

    force: Array
    moment: Array
    energy: Array
    loss: Array


@dataclass(frozen=True)
class Loads:
    """Loads, springs and contacts of one model, with the frames they act on.

    Attributes:
        forces: Loads with their frame. springs: Springs with both frames. touches: Contacts.
    """

    forces: tuple[tuple[FrameForce, Attachment], ...]
    springs: tuple[tuple[FrameSpring, Attachment, Attachment], ...]
    touches: tuple[Touch, ...] = ()

    @property
    def present(self) -> bool:
        """Whether there is anything."""
        return bool(self.forces or self.springs or self.touches)

    @property
    def timed(self) -> bool:
        """Whether a load starts, ends or ramps in time."""
        return any(f.timed for f, _ in self.forces)


def loads(
    forces: Sequence[FrameForce], springs: Sequence[FrameSpring], frames: Mapping[str, Attachment]
) -> Loads:
    """Place the described loads and springs on a model."""
    return Loads(
        tuple((f, frames[f.frame]) for f in forces),
        tuple((s, _end(s, s.frame_a, frames), _end(s, s.frame_b, frames)) for s in springs),
    )


def _end(spring: FrameSpring, name: str, frames: Mapping[str, Attachment]) -> Attachment:
    """Where a spring is held: a frame, or a point of the ground."""
    if spring.at is None or name != WORLD:
        return frames[name]
    return Attachment(0, pin.SE3(np.eye(3), np.array(spring.at)))


def require_apart(given: Loads, model: pin.Model, home: Array, where: str) -> None:
    """Refuse a spring whose ends meet at home and that has a length or a damper: along which line?

    Raises:
        AssemblyError: Such a spring, with the way out.
    """
    if not given.springs:
        return
    data = model.createData()
    pin.forwardKinematics(model, data, home)
    for spring, a, b in given.springs:
        ends = [data.oMi[x.joint].act(x.placement.translation) for x in (a, b)]
        if np.linalg.norm(ends[1] - ends[0]) > _MEET or not (spring.length or spring.damper):
            continue
        key = "length" if spring.length else "damper"
        raise AssemblyError(
            f"{where}: springs.{spring.name}: its ends {spring.frame_a} and {spring.frame_b} meet "
            f"at home, so its {key} has no direction. Leave out {key} (a spring of length 0 pulls "
            "its ends together), or move one end."
        )


# Masses that differ with the direction: what a fluid, or a guide, adds to the inertia of a frame.
#
# With the twist v of a frame in its own axes and the diagonal M of added masses and moments, the
# kinetic energy is v' M v / 2, and the body needs
#
#     f = M a + v x* (M v)
#
# a the spatial acceleration in the frame's axes. The second term has Munk's moment, by which a body
# with two unlike masses turns broadside on. Nothing here has weight.
#
# Source: Kirchhoff's equations of a body in an ideal fluid: Lamb, Hydrodynamics, art. 124.


@dataclass(frozen=True)
class AddedMasses:
    """Added inertias of one model.

    Attributes:
        joints: That carry them. inertia: Of each, about the joint's origin in its axes, shape
            (joints, 6, 6).
    """

    __repr__ = brief

    joints: tuple[int, ...] = ()
    inertia: Array = field(default_factory=lambda: np.zeros((0, 6, 6)))


def added_masses(given: Sequence[AddedMass], frames: Mapping[str, Attachment]) -> AddedMasses:
    """Place the described masses on a model."""
    found: dict[int, Array] = {}
    for one in given:
        at = frames[one.frame]
        back = at.placement.toActionMatrixInverse()
        own = back.T @ np.diag([*one.mass, *one.inertia]) @ back
        found[at.joint] = found.get(at.joint, np.zeros((6, 6))) + own
    return AddedMasses(tuple(found), np.array([*found.values()]).reshape(-1, 6, 6))
