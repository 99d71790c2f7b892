"""Natural frequencies whose stiffness matrices are sums, K = K_0 + sum_k p_k K_k, at one rest.

Drive stiffnesses and moduli stand in K like that, and not in M. A second way to the frequencies of
a scene (to 4e-4 over factors of 1.5, which is how much the rest of the ur5 moves with the
parameters), without loading designs: 0.3 ms each, so that a thousand fits take a minute.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import least_squares, linear_sum_assignment

from pinflex.levels.modes import allowed_motions
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian
from pinflex.variation.peaks import ModalState

FAR = np.log(10.0)  # bounds of a fit
NEAR = 0.05  # of a logarithm of frequency in MAC, as a fit pairs modes


class Summed:
    """Fits of logarithms x of parameters over their values in a scene, for frequencies with shapes.

    Attributes:
        frequencies, shapes: At x = 0, shape (modes,) and (modes, sensors), of length one.
    """

    def __init__(self, designs, sensors, count=6):
        """Matrices of `designs`; sensors are frames, seen along x, y and z."""
        base = designs.base
        state = ModalState(base)
        K, M, _ = state._matrices(Equations(base.flexible), state.y, state.lam)
        Z = allowed_motions(Equations(base.flexible), state.y, state.free)
        self.n, parts = len(designs.parameters), []
        for k in range(self.n):
            twice = designs.at(designs.values(np.log(2.0) * np.eye(self.n)[k]))
            parts.append(state._matrices(Equations(twice.flexible), state.y, state.lam)[0] - K)
        self.parts = np.array([Z.T @ part @ Z for part in parts])
        self.K, self.M = Z.T @ K @ Z - self.parts.sum(axis=0), Z.T @ M @ Z
        self.rows = np.concatenate([
            frame_jacobian(Equations(base.flexible), state.y, base.frame(name))[:3]
            for name in sensors
        ])[:, state.free] @ Z  # fmt: skip
        self.modes = min(2 * count + 2, len(self.M))
        f, shapes, _ = self._modes(np.zeros(self.n))
        self.frequencies, self.shapes = f[:count], shapes[:count]

    def _modes(self, x):
        omega2, X = eigh(self.K + np.einsum("k,kij", np.exp(x), self.parts), self.M,
                         subset_by_index=[0, self.modes - 1])  # fmt: skip
        shapes = (self.rows @ X).T
        return (np.sqrt(np.abs(omega2)) / (2 * np.pi),
                shapes / np.linalg.norm(shapes, axis=1)[:, None], X)  # fmt: skip

    def residuals(self, x, measured, std):
        """Residuals of measured frequencies with the exact shapes, and their derivatives."""
        f, shapes, X = self._modes(x)
        apart = np.abs(np.log(measured[:, None] / f))
        pairs = linear_sum_assignment(1 - (self.shapes @ shapes.T) ** 2 + NEAR * apart)[1]
        X, f = X[:, pairs], f[pairs]
        slopes = np.einsum("im,kij,jm->mk", X, self.parts, X) * np.exp(x)
        return (f - measured) / std, slopes / (8 * np.pi**2 * f * std)[:, None]

    def least(self, measured, std, held=None, starts=()):
        """The least sum of squares and where; `held` is (k, value) of a logarithm."""
        k, value = (None, 0.0) if held is None else held
        free = [j for j in range(self.n) if j != k]
        base = np.full(self.n, value)

        def full(z):
            x = base.copy()
            x[free] = z
            return x

        found = []
        for start in (np.zeros(self.n), *starts):
            end = least_squares(
                lambda z: self.residuals(full(z), measured, std)[0], start[free],
                jac=lambda z: self.residuals(full(z), measured, std)[1][:, free],
                bounds=(-FAR, FAR), xtol=1e-6, ftol=1e-8, gtol=1e-8, max_nfev=40,
            )  # fmt: skip
            found.append((2.0 * end.cost, full(end.x)))
        return min(found, key=lambda row: row[0])
