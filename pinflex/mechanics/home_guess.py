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
    return np.asarray(pin.normalize(model, q))


def given(description: Description, model: pin.Model) -> IntArray:
    """Places in q of the coordinates that `home` names."""
    joints = [model.joints[model.getJointId(name)] for name in description.home]
    places = [k for joint in joints for k in range(joint.idx_q, joint.idx_q + joint.nq)]
    return np.array(places, dtype=np.intp)
