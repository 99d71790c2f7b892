"""Newton's equations of a collocation step: one factorisation for each eigenvalue of A^-1.

With dz = A^2 da the corrections of all stages obey, for each eigenvalue mu,

    [ mu^2 M + h mu C + h^2 K    J' ] [  dz  ]     [ r      ]
    [ J                          0  ] [ -dlam] = - [ c/h^2  ]
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinflex.actuation.drive import TorqueDrive
from pinflex.arrays import Array, IntArray
from pinflex.integrators.collocation import Collocation
from pinflex.integrators.compiled_stages import CompiledStages
from pinflex.linalg import lapack
from pinflex.mechanics.equations import Equations


@dataclass(frozen=True)
class Tangent:
    """The equations linearised in one state.

    Attributes:
        by_a, by_v, by_y: M, C and K, all rows and columns, shape (nv, nv).
        by_closures: J, shape (rows, nv).
        free, motors: Rows that are solved for, and those of the motors.
    """

    by_a: Array
    by_v: Array
    by_y: Array
    by_closures: Array
    free: IntArray
    motors: IntArray

    @cached_property
    def M(self) -> Array:
        """By acceleration, free rows and columns, shape (n, n)."""
        return self._free(self.by_a)

    @cached_property
    def C(self) -> Array:
        """By velocity, likewise."""
        return self._free(self.by_v)

    @cached_property
    def K(self) -> Array:
        """By position, likewise."""
        return self._free(self.by_y)

    @cached_property
    def J(self) -> Array:
        """Closure rows, free columns, shape (rows, n)."""
        return self.by_closures[:, self.free]

    @cached_property
    def terms(self) -> Array:
        """Transposed, what mu^2, h mu, h^2 and 1 weigh in Newton's matrix, complex, (4, size^2)."""
        n, size = len(self.free), len(self.free) + len(self.by_closures)
        found = np.zeros((4, size, size), dtype=complex)
        for term, part in zip(found, (self.M, self.C, self.K), strict=False):
            term[:n, :n] = part.T
        found[3, :n, n:], found[3, n:, :n] = self.J.T, self.J
        return found.reshape(4, -1)

    def motor_forces(self, da: Array, dv: Array, dy: Array, dlam: Array) -> Array:
        """Change of the forces in the rows of the motors by corrections of stages, (s, nm).

        Args:
            da, dv, dy: Corrections, shape (s, nv). dlam: Shape (s, rows).
        """
        by_a, by_v, by_y, by_lam = self._of_motors
        return np.asarray(da.dot(by_a) + dv.dot(by_v) + dy.dot(by_y) - dlam.dot(by_lam))

    @cached_property
    def _of_motors(self) -> tuple[Array, ...]:
        """Rows of the motors in M, C, K, transposed, (nv, nm); their columns in J, (rows, nm)."""
        parts = (np.asarray(of[self.motors].T) for of in (self.by_a, self.by_v, self.by_y))
        return (*parts, self.by_closures[:, self.motors])

    def _free(self, matrix: Array) -> Array:
        return np.asfortranarray(matrix.take(self.free, axis=0).take(self.free, axis=1))


class StageNewton:
    """Tangent and factors of the stages, kept while they contract."""

    tangent: Tangent

    def __init__(
        self,
        dynamics: Equations,
        method: Collocation,
        free: IntArray,
        drive: TorqueDrive | None,
        compiled: CompiledStages | None = None,
    ) -> None:
        self._lapack, self._compiled = lapack(), compiled
        self._dynamics, self._drive = dynamics, drive
        mu, one = method.values, np.ones_like(method.values)
        self._weights, self._real = np.stack([mu * mu, mu, one, one], axis=1), abs(mu.imag) < 1e-9
        self._forward, self._back = -method.forward, method.back
        self.free, self.motors = free, dynamics.system.motors
        self.h = 0.0
        self.stale = True
        self.tangents = self.factors = 0

    def refresh(self, y: Array, v: Array, a: Array, lam: Array, t: float) -> None:
        """Tangent at a state at time t (s).

        Args:
            y: Coordinates, shape (nq,).
            v, a: Velocity and acceleration, shape (nv,).
            lam: Multipliers [N | N m], shape (rows,).
            t: Time [s].
        """
        *parts, J = self._dynamics.tangent(y, v, a, lam, t)
        if self._drive is not None:
            for part, gain in zip(parts[1:], (self._drive.kd, self._drive.kp), strict=True):
                part[self.motors, self.motors] += gain
        by_a, by_v, by_y = parts
        self.adopt(Tangent(by_a, by_v, by_y, J, self.free, self.motors))
        self.tangents += 1

    def adopt(self, tangent: Tangent) -> None:
        """Go on with a tangent, whoever found it."""
        self.tangent, self.h, self.stale = tangent, 0.0, False

    def factor(self, h: float) -> None:
        """Factors for a step h; raises numpy's LinAlgError when one is singular."""
        of = self.tangent
        if self._compiled is not None:
            if not self._compiled.kernel.factor(of.M, of.C, of.K, of.J, h):
                raise np.linalg.LinAlgError("singular iteration matrix")
            self.factors, self.h = self.factors + 1, h
            return
        size, wraps = len(self.free) + len(of.by_closures), self._lapack
        every = (self._weights * (1.0, h, h * h, 1.0)).dot(of.terms)
        if not np.isfinite(every).all():
            raise np.linalg.LinAlgError("iteration matrix without numbers")
        self._lu = []
        for S, real in zip(every, self._real, strict=True) if size else ():
            getrf, getrs = wraps.zgetrf, wraps.zgetrs
            if real:
                S, getrf, getrs = S.real.copy(), wraps.dgetrf, wraps.dgetrs
            # Of the transposed terms: column by column, as LAPACK reads.
            lu, pivots, info = getrf(S.reshape(size, size).T, overwrite_a=True)
            if info > 0:
                raise np.linalg.LinAlgError("singular iteration matrix")
            self._lu.append((getrs, lu, pivots, bool(real)))
        self.factors += 1
        self.h = h

    def step(self, r: Array, c: Array) -> tuple[Array, Array]:
        """dz (s, n) and dlam (s, rows) from residuals r (s, n) and closures c (s, rows).

        Args:
            r: Residual forces [N | N m], shape (s, n).
            c: Closures [m | rad], shape (s, rows).
        """
        n = len(self.free)
        if self._compiled is not None:
            return self._compiled.solve(r, c)
        b = np.empty((len(r), n + c.shape[1]), dtype=complex)
        b[:, :n] = r
        b[:, n:] = c / (self.h * self.h)
        parts = self._forward.dot(b)
        for part, (getrs, lu, pivots, real) in zip(parts, self._lu, strict=False):
            if real:
                part[:] = getrs(lu, pivots, part.real)[0]
            else:
                getrs(lu, pivots, part, overwrite_b=True)  # in its place
        x = self._back.dot(parts).real
        return x[:, :n], -x[:, n:]
