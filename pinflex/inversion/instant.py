"""The equations of one instant of a flexible mechanism whose platform follows a path.

    r(y, v, a, lam) = 0 in the rows that no motor drives,   c(y) = 0,   p(y) = p_d(t)

With as many platform coordinates p as motors this is a square system for (y, lam) where v and a are
given; the motor torques are r in the motor rows, afterwards. With more motors than coordinates the
motions of the motors that do not move the platform stay on the rigid motion.

Source: Seifried (2014), Dynamics of Underactuated Multibody Systems, ch. 4 (servo constraints).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from pinflex.actuation.motors import motor_axes
from pinflex.arrays import Array
from pinflex.errors import ConvergenceError
from pinflex.inversion.target import Target
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.frames import PlatformCoordinates
from pinflex.mechanics.mechanism import Mechanism

_BALANCED = 1e-11  # m or rad: the last Newton correction; the next is round-off
_SLOW = 0.1  # contraction above which a new tangent pays
_LONGEST = 0.3  # m or rad of one Newton step
_MOST = 40


@dataclass(frozen=True)
class Tangents:
    """Derivatives of one instant's rows.

    Attributes:
        M, C, K: Of r in the rows that no motor drives, by a, v, y, each (free, nv).
        J: Of the closures, the imposed coordinates and what is held, shape (nv + rows - free, nv).
        lam: Of r by the multipliers, shape (free, rows).
    """

    M: Array
    C: Array
    K: Array
    J: Array
    lam: Array


class Instant:
    """Evaluates the rows of an instant and their derivatives."""

    def __init__(self, mechanism: Mechanism, target: Target) -> None:
        self.system = system = mechanism.flexible
        self.dynamics = Equations(system)
        self.target = target
        self.axes = motor_axes(mechanism)
        self.free = system.free
        self.rows = system.closed.n
        platform = mechanism.frame(str(mechanism.description.platform))
        self.platform = PlatformCoordinates(self.dynamics, platform, target.names)

    def residual(self, k: int, y: Array, v: Array, a: Array, lam: Array) -> tuple[Array, Array]:
        """Rows that have to vanish at instant k, shape (nv + rows,), and motor torques (nm,)."""
        d = self.dynamics
        r, c = d.residual(y, v, a, lam, float(self.target.t[k]))
        error = self.platform.error(
            self.platform.values(d.joint_poses(y))[0], self.target.position[k]
        )
        idle = self.target.idle[k] @ (self.axes.read(y) - self.target.motors[k])
        held = np.zeros(len(self.system.held))  # never moved: nothing is ever open there
        return np.concatenate([r[self.free], c, error, idle, held]), r[self.system.motors]

    def tangents(self, k: int, y: Array, v: Array, a: Array, lam: Array) -> Tangents:
        """Derivatives of the rows at instant k."""
        d = self.dynamics
        *parts, J = d.tangent(y, v, a, lam, float(self.target.t[k]))
        M, C, K = (x[self.free] for x in parts)
        idle = np.zeros((len(self.target.idle[k]), self.system.nv))
        idle[:, self.axes.v_at] = self.target.idle[k]
        held = np.eye(self.system.nv)[self.system.held]
        every = np.concatenate([J, self.platform.at(d.kinematics(y))[1][0], idle, held])
        return Tangents(M, C, K, every, -J[:, self.free].T)


@dataclass(frozen=True)
class Balanced:
    """Balanced poses along the path: y (nt, nq), lam (nt, rows), torque (nt, nm)."""

    y: Array
    lam: Array
    torque: Array


def balanced(instant: Instant, guess: Balanced, v: Array, a: Array) -> Balanced:
    """Solve the square system at every instant with given v and a, each (nt, nv).

    One factorised tangent serves as many instants as Newton contracts with.

    Raises:
        ConvergenceError: No pose found at an instant: the platform cannot be there.
    """
    d, n = instant.dynamics, instant.system.nv
    y, lam, torque = (np.array(x) for x in (guess.y, guess.lam, guess.torque))
    factor = None
    offset, force = np.zeros(n), np.zeros(instant.rows)
    for k in range(len(y)):
        pose, multipliers = d.integrate(guess.y[k], offset), guess.lam[k] + force
        e, tau = instant.residual(k, pose, v[k], a[k], multipliers)
        last = np.inf
        for _ in range(_MOST):
            if factor is None:
                factor = lu_factor(_square(instant.tangents(k, pose, v[k], a[k], multipliers)))
            step = -lu_solve(factor, e)
            size = float(np.max(np.abs(step[:n])))
            step *= min(1.0, _LONGEST / max(size, 1e-300))
            pose, multipliers = d.integrate(pose, step[:n]), multipliers + step[n:]
            e, tau = instant.residual(k, pose, v[k], a[k], multipliers)
            if not size < 1e3:  # not a number either
                break
            if size < _BALANCED:
                break
            if size > _SLOW * last:
                factor = None
            last = size
        if not size < 1e-8:
            raise ConvergenceError(
                f"t = {instant.target.t[k]:.6g} s: no balanced pose with the platform on its path. "
                "Slow the motion down, or stiffen the links.",
                time=float(instant.target.t[k]),
            )
        y[k], lam[k], torque[k] = pose, multipliers, tau
        offset, force = d.difference(guess.y[k], pose), multipliers - guess.lam[k]
    return Balanced(y, lam, torque)


def _square(found: Tangents) -> Array:
    rows = found.lam.shape[1]
    zero = np.zeros((len(found.J), rows))
    return np.block([[found.K, found.lam], [found.J, zero]])
