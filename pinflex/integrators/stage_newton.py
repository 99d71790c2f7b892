"""Newton's equations of a collocation step: one factorisation for each eigenvalue of A^-1.

With dz = A^2 da the corrections of all stages obey, for each eigenvalue mu,

    [ mu^2 M + h mu C + h^2 K    J' ] [  dz  ]     [ r      ]
    [ J                          0  ] [ -dlam] = - [ c/h^2  ]
"""

from __future__ import annotations

import numpy as np

from pinflex.actuation.drive import TorqueDrive
from pinflex.arrays import Array, IntArray
from pinflex.integrators.collocation import Collocation
from pinflex.mechanics.equations import Equations


class StageNewton:
    """Tangent and factors of the stages, kept while they contract."""

    def __init__(
        self, dynamics: Equations, method: Collocation, free: IntArray, drive: TorqueDrive | None
    ) -> None:
        from scipy.linalg import lapack  # slow to import: only runs pay for it

        self._lapack = lapack
        self._dynamics, self._method, self._drive = dynamics, method, drive
        self.free, self.motors = free, dynamics.system.motors
        self.n = len(free)
        self.h = 0.0
        self.stale = True
        self.tangents = self.factors = 0

    def refresh(self, y: Array, v: Array, a: Array, lam: Array, t: float) -> None:
        """Tangent at a state at time t (s)."""
        *parts, J = self._dynamics.tangent(y, v, a, lam, t)
        if self._drive is not None:
            for part, gain in zip(parts[1:], (self._drive.kd, self._drive.kp), strict=True):
                part[self.motors, self.motors] += gain
        at = np.ix_(self.free, self.free)
        self.M, self.C, self.K = (np.asfortranarray(part[at]) for part in parts)
        self._motor_rows = tuple(part[np.ix_(self.motors, self.free)].T for part in parts)
        self.J, self._J_motors = J[:, self.free], J[:, self.motors]
        self.tangents += 1
        self.h, self.stale = 0.0, False

    def factor(self, h: float) -> None:
        """Factors for a step h; raises numpy's LinAlgError when one is singular."""
        n, size = self.n, self.n + len(self.J)
        self._lu = []
        for mu in self._method.values:
            real = abs(mu.imag) < 1e-9
            m = mu.real if real else mu
            S = np.zeros((size, size), order="F", dtype=float if real else complex)
            S[:n, :n] = (m * m) * self.M + (h * m) * self.C + (h * h) * self.K
            S[:n, n:], S[n:, :n] = self.J.T, self.J
            if size:
                lu, pivots, info = (self._lapack.dgetrf if real else self._lapack.zgetrf)(
                    S, overwrite_a=True
                )
                if info > 0 or not np.all(np.isfinite(lu)):
                    raise np.linalg.LinAlgError("singular iteration matrix")
                self._lu.append((lu, pivots, real))
        self.factors += 1
        self.h = h

    def step(self, r: Array, c: Array) -> tuple[Array, Array]:
        """dz (s, n) and dlam (s, rows) from residuals r (s, n) and closures c (s, rows)."""
        parts = self._method.forward @ np.concatenate([-r, c / -(self.h**2)], axis=1)
        for k, (lu, pivots, real) in enumerate(self._lu):
            if real:
                parts[k] = self._lapack.dgetrs(lu, pivots, parts[k].real)[0]
            else:
                parts[k] = self._lapack.zgetrs(lu, pivots, parts[k])[0]
        x = (self._method.back @ parts).real
        return x[:, : self.n], -x[:, self.n :]

    def motor_forces(self, da: Array, dv: Array, dy: Array, dlam: Array) -> Array:
        """What corrections of the stages change in the rows of the motors, shape (s, nm)."""
        by_a, by_v, by_y = self._motor_rows
        return np.asarray(da @ by_a + dv @ by_v + dy @ by_y - dlam @ self._J_motors)
