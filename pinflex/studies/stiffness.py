"""Cartesian stiffness of the platform: how far it gives way to a small force or moment."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.errors import DescriptionError, SingularityError
from pinflex.levels.modes import allowed_motions, linearised
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.mechanism import Mechanism

AXES = ("x", "y", "z", "rx", "ry", "rz")
_LOOSE = 1e-13  # smallest over largest eigenvalue of a stiffness scaled to a unit diagonal
_HELD = 1e-13  # of the largest entry of a Jacobian: round-off of a product
_RIGID = 1e-9  # of the largest compliance, with the lengths scaled out: round-off


def platform_compliance(
    mechanism: Mechanism, q: Array | None = None, *, preload: str = "gravity"
) -> Array:
    """Displacement of the platform by unit forces and moments, motors locked.

    C = J Z (Z' K Z)^-1 Z' J', with K the tangent stiffness at the pose, Z what the closures leave
    free and J the Jacobian of the platform's origin.

    Args:
        mechanism: Mechanism with a platform.
        q: Rigid pose, default home.
        preload: As in `modes`: "gravity" about the static equilibrium, "none" about the undeformed
            pose with the structure's stiffness alone.

    Returns:
        C, shape (6, 6), symmetric: translation of the platform's origin (m) and small rotation
        (rad), by force at that origin (N) and moment (N m), all along the world axes.

    Raises:
        DescriptionError: No platform.
        SingularityError: Something moves without stiffness though the motors are locked.
        ConvergenceError: No static equilibrium.
    """
    name = mechanism.description.platform
    if name is None:
        raise DescriptionError(
            f"{mechanism.name}: stiffness needs the frame it is of. Write `platform: FRAME`."
        )
    dynamics = Dynamics(mechanism.flexible)
    y, K = linearised(mechanism, dynamics, q, preload)
    free = mechanism.flexible.free
    Z = allowed_motions(dynamics, y, free)
    every = _jacobian(mechanism, dynamics, name, y)[:, free]
    J = every @ Z
    # a platform that the closures hold moves by round-off, which is no compliance
    J[np.abs(J) < _HELD * np.max(np.abs(every), initial=0.0)] = 0.0
    S = Z.T @ K[np.ix_(free, free)] @ Z
    S = 0.5 * (S + S.T)
    size = np.sqrt(np.abs(np.diag(S)))
    if not len(S):
        return np.zeros((6, 6))
    if np.any(size == 0) or np.min(np.abs(np.linalg.eigvalsh(S / np.outer(size, size)))) < _LOOSE:
        raise SingularityError(
            f"{mechanism.name}: stiffness: something moves without any stiffness though the motors "
            "are locked. Actuate or spring the joints that are free."
        )
    C = J @ np.linalg.solve(S, J.T)
    return np.asarray(0.5 * (C + C.T))


def stiffness_of(compliance: Array) -> tuple[Array, int]:
    """Stiffness matrix of a compliance, and in how many directions it gives way.

    Where the platform gives way in fewer than six directions (a plane mechanism whose links bend
    in the plane), force = K displacement holds for the displacements that there are; the diagonal
    of an axis that does not give way at all is inf, and its other entries are zero.

    Args:
        compliance: Shape (6, 6), as from `platform_compliance`.

    Returns:
        K (N/m, N, N m/rad), shape (6, 6); and the number of directions.
    """
    C = np.asarray(compliance, float)
    # lengths in units in which turning and shifting are alike, so that round-off can be told
    turning, shifting = np.trace(C[3:, 3:]), np.trace(C[:3, :3])
    length = np.sqrt(shifting / turning) if turning > 0 and shifting > 0 else 1.0
    unit = np.array([1.0, 1.0, 1.0, length, length, length])
    scaled = C * np.outer(unit, unit)
    values, V = np.linalg.eigh(scaled)
    least = _RIGID * max(values[-1], 0.0)
    gives, rigid = values > least, np.diag(scaled) <= least
    K = (V[:, gives] / values[gives]) @ V[:, gives].T * np.outer(unit, unit)
    K[rigid], K[:, rigid] = 0.0, 0.0
    K[rigid, rigid] = np.inf
    return K, int(np.sum(gives))


def _jacobian(mechanism: Mechanism, dynamics: Dynamics, name: str, y: Array) -> Array:
    """Velocity of the frame's origin and its angular velocity in world axes, shape (6, nv)."""
    here = mechanism.frame(name)
    dynamics.place(y)
    pin.computeJointJacobians(dynamics.model, dynamics.data, dynamics.Q)
    J: Array = pin.getFrameJacobian(
        dynamics.model, dynamics.data, here.joint, here.placement,
        pin.ReferenceFrame.LOCAL_WORLD_ALIGNED,
    )  # fmt: skip
    return dynamics.times_map(J.reshape(6, -1))
