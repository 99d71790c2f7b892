"""The structure by itself: its stiffness without what loads bring."""

from __future__ import annotations

import pinocchio as pin

from pinflex.arrays import Array
from pinflex.mechanics.dynamics import Dynamics


def structural_stiffness(dynamics: Dynamics, y: Array) -> Array:
    """K of links and springs alone, without the stiffness that loads bring, shape (nv, nv).

    Springs between frames resist along their line at the pose y; what their pull adds across it
    is a load's.
    """
    K = dynamics.system.K.copy()
    springs = dynamics.system.springs
    K[springs.v_at, springs.v_at] += springs.stiffness
    if dynamics.system.loads.springs:
        dynamics.place(y)
        pin.computeJointJacobians(dynamics.model, dynamics.data, dynamics.Q)
        K += dynamics.loads.stiffness(dynamics.times_map)
    return K
