"""Derivatives of outputs by the logarithm of a parameter: implicit, or extrapolated differences.

For a state of rest r(y, lam; p) = 0 on closures c(y; p) = 0 and modes of (K, M) on J x = 0:

    [K  -J'; J  0] (y', lam') = -(dr/dp, dc/dp)
    (omega^2)' = x' (K' - omega^2 M') x - 2 mu' J' x,     J' mu = (K - omega^2 M) x,  x'M x = 1

K', M', J' are taken along (y', lam'). Repeated frequencies: the eigenvalues of that form on their
subspace. dr/dp and the matrices' derivatives are differences at a held state, which need no Newton
iteration and follow no mode; those of whole outputs are differences of solved designs. Central
differences at h, h/2 and h/4 are extrapolated to h = 0 (Romberg); what the third one changed is the
estimated error.

Source: Nelson 1976, Simplified Calculation of Eigenvector Derivatives; Seyranian, Lund, Olhoff
1994, Multiple eigenvalues in structural optimization problems.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping

import numpy as np

from pinflex.arrays import Array
from pinflex.levels.modes import allowed_motions, vibrating
from pinflex.levels.quasistatic import rest
from pinflex.linalg import condensed, saddle_matrix
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism

STEP = 4e-3  # of the logarithm, at a held state: h^6 is 4e-15
SOLVED = 2e-2  # the same of solved designs, which carry more noise: h^6 is 6e-11
_PARTS = (1.0, 0.5, 0.25)
_ROUND_OFF = 1e-12  # of matrices at a held state
_NOISE = 2e-9  # of a solved output: Newton stops at 1e-9 of a turn
_SAME = 1e-6  # relative gap of frequencies that are one, repeated

At = Callable[[float], Mechanism]


def extrapolated(
    outputs: Callable[[float], Mapping[str, float]], step: float = SOLVED, steps: int = 3
) -> tuple[dict[str, float], dict[str, float]]:
    """d ln(output) / d ln(parameter) by central differences, extrapolated to h = 0.

    The difference is of logarithms, exact for a power law; of the values where they change sign.

    Returns:
        The derivatives and their estimated errors, by name.
    """
    sides = {h: (outputs(-h), outputs(h)) for h in (part * step for part in _PARTS[:steps])}
    slopes, errors = {}, {}
    for name in sides[step][1]:
        found = [_slope(below[name], above[name], h) for h, (below, above) in sides.items()]
        slope, error = _romberg([np.array(value) for value in found], step, _NOISE)
        slopes[name], errors[name] = float(slope), float(error)
    return slopes, errors


def _romberg(found: list[Array], step: float, noise: float) -> tuple[Array, Array]:
    """The limit of differences at h, h/2, ..., whose errors are even powers of h, and its error."""
    rows, power, last = found, 4.0, found[-1]
    while len(rows) > 1:
        last = rows[-1]
        rows = [(power * b - a) / (power - 1.0) for a, b in itertools.pairwise(rows)]
        power *= 4.0
    return rows[0], np.abs(rows[0] - last) + noise / (step * 0.5 ** (len(found) - 1))


def _slope(below: float, above: float, h: float) -> float:
    if below * above > 0 and np.isfinite(below * above):
        return float(np.log(above / below) / (2.0 * h))
    middle = 0.5 * (below + above)
    if below == above:
        return 0.0
    return float((above - below) / (2.0 * h * middle)) if middle else float("nan")


def of_frequencies(
    base: Mechanism, at: At, count: int, step: float = STEP
) -> tuple[Array, Array, Array]:
    """d ln(frequency) / d ln(parameter) of the lowest modes, implicitly.

    Returns:
        Frequencies [Hz], shape (count,); their derivatives and estimated errors, shape (count,).
    """
    state = ModalState(base)
    slope, error = _romberg(
        [state.derivatives(at, part * step) for part in _PARTS], step, _ROUND_OFF
    )
    shown = state.elastic[:count]
    return state.frequencies[shown], slope[shown], error[shown]


class ModalState:
    """The rest of a design and its modes.

    Attributes:
        y, lam: Rest: pose, shape (nq,), and multipliers.
        x: Unit-mass shapes of the free coordinates, shape (free, modes). omega2: (modes,).
        mu: Multipliers of the modes, shape (rows, modes).
        elastic: Places of the modes that are not rigid-body ones, lowest first.
    """

    def __init__(self, base: Mechanism) -> None:
        self.base, system = base, base.flexible
        dynamics = Equations(system)
        found = rest(base, dynamics=dynamics)
        self.still, self.free = np.zeros(system.nv), vibrating(base)
        self.y, self.lam = found.y, found.lam
        K, M, J = self._matrices(dynamics, self.y, self.lam)
        Z = allowed_motions(dynamics, self.y, self.free)
        x, _, omega2 = condensed(Z.T @ K @ Z, Z.T @ M @ Z)
        self.order = np.argsort(omega2)
        self.x, self.omega2 = Z @ x[:, self.order], omega2[self.order]
        left = K @ self.x - M @ self.x * self.omega2
        self.mu = (
            np.linalg.lstsq(J.T, left, rcond=None)[0] if len(J) else np.zeros((0, len(omega2)))
        )
        self.frequencies = np.sign(self.omega2) * np.sqrt(np.abs(self.omega2)) / (2 * np.pi)
        size = np.abs(self.frequencies)
        self.elastic = np.flatnonzero(size > 1e-7 * np.max(size, initial=0.0))
        self.saddle = saddle_matrix(K, J)

    def _matrices(self, dynamics: Equations, y: Array, lam: Array) -> tuple[Array, Array, Array]:
        """K, M and J of the free coordinates."""
        M, _, K, J = dynamics.tangent(y, self.still, self.still, lam, 0.0)
        square = np.ix_(self.free, self.free)
        return K[square], M[square], J[:, self.free]

    def derivatives(self, at: At, h: float) -> Array:
        """d ln(frequency) of all modes by differences of +-h at the held, then the led state."""
        found = np.zeros(len(self.omega2))
        for group, form in self.forms(at, h):
            found[group] = np.linalg.eigvalsh(form)
        return found

    def forms(self, at: At, h: float) -> list[tuple[Array, Array]]:
        """d ln(frequency) as a form on the shapes of each frequency, with their places."""
        designs = [at(s) for s in (-h, h)]
        sides = [Equations(design.flexible) for design in designs]
        held = [self._held(side, d) for side, d in zip(sides, designs, strict=True)]
        forces = [self._unbalanced(side, y) for side, y in zip(sides, held, strict=True)]
        n = len(self.free)
        right, fixed = -(forces[1] - forces[0]) / (2.0 * h), n == len(self.base.flexible.free)
        # A free base has no stiffness, and nothing pushes it: any of its poses will do.
        led = np.asarray(
            np.linalg.solve(self.saddle, right)
            if fixed
            else np.linalg.lstsq(self.saddle, right, rcond=None)[0],
            dtype=float,
        )
        below, above = (
            self._matrices(side, self._moved(side, y, s * led[:n]), self.lam + s * led[n:])
            for side, y, s in zip(sides, held, (-h, h), strict=True)
        )
        dK, dM, dJ = ((b - a) / (2.0 * h) for a, b in zip(below, above, strict=True))
        found = []
        for group in self._groups():
            x, value = self.x[:, group], float(np.mean(self.omega2[group]))
            closing = (dJ @ x).T @ self.mu[:, group]
            form = x.T @ (dK - value * dM) @ x - closing - closing.T
            found.append((group, 0.25 * (form + form.T) / value))
        return found

    def _held(self, dynamics: Equations, design: Mechanism) -> Array:
        """The pose held, moved as far as another design's home is."""
        if np.array_equal(design.home, self.base.home):
            return self.y
        moved = dynamics.difference(self.base.undeformed(), design.undeformed())
        return dynamics.integrate(self.y, moved)

    def _unbalanced(self, dynamics: Equations, y: Array) -> Array:
        """Residual and closures of another design at a held pose."""
        r, c = dynamics.residual(y, self.still, self.still, self.lam, 0.0)
        return np.concatenate([r[self.free], c])

    def _moved(self, dynamics: Equations, y: Array, step: Array) -> Array:
        dy = np.zeros(dynamics.system.nv)
        dy[self.free] = step
        return dynamics.integrate(y, dy)

    def _groups(self) -> list[Array]:
        """Places of the modes, those of one frequency together."""
        f = self.frequencies[self.elastic]
        if not len(f):
            return []
        cuts = np.flatnonzero(np.diff(f) > _SAME * np.abs(f[1:])) + 1
        return [np.asarray(group) for group in np.split(self.elastic, cuts)]
