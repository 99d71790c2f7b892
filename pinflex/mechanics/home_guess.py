"""The home that a description gives: values of some coordinates of the rigid mechanism."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.description.description import Description
from pinflex.errors import DescriptionError, nearest


def home_guess(description: Description, model: pin.Model) -> Array:
    """q with the given values, shape (nq,); joints that are not named stand at zero."""
    q = pin.neutral(model)
    for name, value in description.home.items():
        if not model.existJointName(name):
            raise DescriptionError(
                f"{description.name}: home.{name}: not a moving joint."
                f"{nearest(name, list(model.names)[1:])}"
            )
        joint = model.joints[model.getJointId(name)]
        values = np.atleast_1d(np.array(value, float))
        if joint.nv == 1 and joint.nq == 2 and len(values) == 1:
            values = np.array([np.cos(values[0]), np.sin(values[0])])
        if len(values) != joint.nq:
            raise DescriptionError(
                f"{description.name}: home.{name}: {len(values)} values, the joint has {joint.nq} "
                "coordinates (a spherical joint takes a quaternion x, y, z, w)."
            )
        q[joint.idx_q : joint.idx_q + joint.nq] = values
    _follow(q, description, model)
    return np.asarray(pin.normalize(model, q))


def _follow(q: Array, description: Description, model: pin.Model) -> None:
    """Put joints that follow others where they belong; a leader that is not named goes along."""
    place = {
        name: model.joints[model.getJointId(name)].idx_q
        for one in description.couplings
        for name in (one.joint, one.leader)
        if name is not None
    }
    for one in reversed(description.couplings):
        alone = one.joint in description.home and one.leader not in description.home
        if one.leader is not None and one.ratio and alone:
            q[place[one.leader]] = (q[place[one.joint]] - one.offset) / one.ratio
    for _ in description.couplings:  # chains in any order
        for one in description.couplings:
            led = 0.0 if one.leader is None else one.ratio * q[place[one.leader]]
            q[place[one.joint]] = led + one.offset


def given(description: Description, model: pin.Model) -> IntArray:
    """Places in q of the coordinates that `home` names."""
    joints = [model.joints[model.getJointId(name)] for name in description.home]
    places = [k for joint in joints for k in range(joint.idx_q, joint.idx_q + joint.nq)]
    return np.array(places, dtype=np.intp)
