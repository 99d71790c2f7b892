"""What the equations answer with, by name: values that nothing overwrites."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from pinflex.arrays import Array

if TYPE_CHECKING:
    from pinflex.mechanics.reference.coordinate_map import Configuration


# Named tuples: a frozen dataclass costs eight times as much to make, in every iteration of a step.
class Residual(NamedTuple):
    """Forces left to the motors r, shape (n, nv), and closure residuals c, shape (n, rows)."""

    r: Array
    c: Array


class Closure(NamedTuple):
    """Closure residuals c, shape (n, rows), and their Jacobian J = dc/dy, shape (n, rows, nv)."""

    c: Array
    J: Array


class Tangent(NamedTuple):
    """Derivatives of r by a, v, y, shape (nv, nv) each, and of c by y, shape (rows, nv)."""

    M: Array
    C: Array
    K: Array
    J: Array


class IterationMatrix(NamedTuple):
    """A weighted sum S of M, C and K, shape (nv, nv), and J, shape (rows, nv)."""

    S: Array
    J: Array


class Energies(NamedTuple):
    """Energies in J, shape (n,): that of dead loads is in `spring`."""

    kinetic: Array
    gravity: Array
    elastic: Array
    spring: Array


class JointForces(NamedTuple):
    """Forces at n states.

    Attributes:
        r, c: As in `Residual`. g: Expanded forces rnea - J_Q' lam, shape (n, nV).
        f: Forces of joints in their own frames, shape (n, joints, 6).
        wrenches: Of loops on their B, about the origin of frame b, shape (n, loops, 6).
        sleeves: (x, F, M, segment) of sleeves at three places, shape (n, contacts, 3, 8).
    """

    r: Array
    c: Array
    g: Array
    f: Array
    wrenches: Array
    sleeves: Array


class Kinematics(NamedTuple):
    """Joints at n states.

    Attributes:
        here: Expanded configurations and map.
        poses: Of joints, shape (n, joints, 12), see `pinflex.mechanics.poses`.
        J, dJ: World Jacobians of the joints and their rates, shape (n, 6, nV); dJ (0, 6, nV)
            without rates.
    """

    here: Configuration
    poses: Array
    J: Array
    dJ: Array
