"""Masses that differ with the direction: what a fluid, or a guide, adds to the inertia of a frame.

With the twist v of a frame in its own axes and the diagonal M of added masses and moments, the
kinetic energy is v' M v / 2, and the body needs

    f = M a + v x* (M v)

a the spatial acceleration in the frame's axes. The second term has Munk's moment, by which a body
with two unlike masses turns broadside on. Nothing here has weight.

Source: Kirchhoff's equations of a body in an ideal fluid: Lamb, Hydrodynamics, art. 124.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pinflex.arrays import Array
from pinflex.description.external import AddedMass
from pinflex.mechanics.expanded import Attachment
from pinflex.text import brief


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
