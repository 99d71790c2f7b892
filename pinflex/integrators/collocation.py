"""Radau IIA collocation with s stages: its nodes, integrals and eigenvalues (order 2 s - 1).

Hairer and Wanner 1996, Solving Ordinary Differential Equations II, sections IV.5 and IV.8. The
accelerations of a step are the polynomial through s stages; velocities and positions are its
integrals. Newton's equations for all stages fall apart along the eigenvectors of A^-1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.errors import DescriptionError, nearest
from pinflex.linalg import saddle


@dataclass(frozen=True)
class Collocation:
    """Radau IIA with s stages on the unit interval, as the kernel reads it.

    Attributes:
        c: Nodes, shape (s,), the last one 1.
        A: Integrals of the stage polynomials up to the nodes, shape (s, s).
        A2: A A. A2_inverse: Its inverse.
        value: Eigenvalues of A^-1, one of each conjugate pair, shape (s/2 rounded up, 2): complex
            numbers are pairs.
        forward: Stages to eigenvectors, one row for each of `value`, shape (., s, 2).
        back: Eigenvectors to stages: stages = real(back @ parts), shape (s, ., 2).
        last: Weights of (0, stages) that give the last Legendre coefficient of the polynomial
            through them, without that of 0, shape (s,).
        basis: Values at the nodes to coefficients of powers, shape (s, s). basis_0: Those at 0 and
            the nodes, shape (s + 1, s + 1).
    """

    c: Array
    A: Array
    A2: Array
    A2_inverse: Array
    value: Array
    forward: Array
    back: Array
    last: Array
    basis: Array
    basis_0: Array

    def __repr__(self) -> str:
        return f"Collocation(s={self.s})"

    @property
    def s(self) -> int:
        """Number of stages."""
        return len(self.c)

    def at(self, x: Array) -> Array:
        """Weights of the stages for their polynomial at places x of the step, (len(x), s)."""
        return np.asarray(np.asarray(x, float)[:, None] ** np.arange(self.s) @ self.basis)

    def between(self, x: Array) -> tuple[Array, Array, Array]:
        """Weights at x of the stages for both integrals, and of the value at 0 and the stages.

        Returns:
            Shapes (len(x), s), (len(x), s) and (len(x), s + 1): the last for the polynomial itself.
        """
        places, powers = np.asarray(x, float)[:, None], np.arange(self.s + 1)
        rows = places**powers
        first = rows[:, 1:] / powers[1:]
        second = first * places / (powers[1:] + 1)
        return first @ self.basis, second @ self.basis, rows @ self.basis_0


def radau(s: int) -> Collocation:
    """The scheme with s stages (2 to 7: beyond that round-off shows in the eigenvectors)."""
    if not 2 <= s <= 7:
        raise ValueError(f"radau: {s} stages. Take 2 to 7.")
    return _tableau(s)


def implicit_euler() -> Collocation:
    """The scheme with one stage, whose equations are those of a single state."""
    return _tableau(1)


def with_one_more(method: Collocation) -> Collocation:
    """The scheme with one stage more, up to 9: good enough for a correction."""
    return _tableau(method.s + 1)


@cache
def _nodes(s: int) -> Array:
    """Zeros of P_(s-1) - P_s on the unit interval, the last one 1.

    By numpy: scipy's special functions take longer to import than a run.
    """
    of, legendre = np.zeros(s + 1), np.polynomial.legendre
    of[-2:] = 1.0, -1.0
    x = np.sort(legendre.legroots(of).real)[:-1]
    for _ in range(2):  # of Newton, to the last digit
        x = x - legendre.legval(x, of) / legendre.legval(x, legendre.legder(of))
    return np.append((x + 1.0) / 2.0, 1.0)


@cache
def _tableau(s: int) -> Collocation:
    c, powers = _nodes(s), np.arange(s)
    with_0 = np.append(0.0, c)
    basis, basis_0 = (np.linalg.inv(np.vander(x, increasing=True)) for x in (c, with_0))
    A = (c[:, None] ** (powers + 1) / (powers + 1)) @ basis
    values, vectors = np.linalg.eig(np.linalg.inv(A))
    inverse = np.linalg.inv(vectors)
    kept = np.flatnonzero(values.imag > -1e-9)
    # A pair counts twice: its other half is the conjugate.
    twice = np.where(values.imag[kept] > 1e-9, 2.0, 1.0)
    at_0 = np.linalg.inv(np.polynomial.legendre.legvander(2.0 * with_0 - 1.0, s))
    A2, parts = A @ A, (values[kept], inverse[kept], vectors[:, kept] * twice)
    value, forward, back = (_pairs(x) for x in parts)
    A2_inverse, last = np.asarray(np.linalg.inv(A2)), np.asarray(at_0[s, 1:])
    return Collocation(c, A, A2, A2_inverse, value, forward, back, last, basis, basis_0)


def _pairs(x: Array) -> Array:
    """Complex numbers as pairs, shape (..., 2)."""
    return np.ascontiguousarray(x, dtype=complex)[..., None].view(float)


# The alpha family: one-step schemes for M a + ... = 0 as four coefficients.
#
#     (1 - alpha_m) s1 + alpha_m s0 = (1 - alpha_f) a1 + alpha_f a0
#     y1 = y0 + h v0 + h^2 ((1/2 - beta) s0 + beta s1),     v1 = v0 + h ((1 - gamma) s0 + gamma s1)
#
# s is the algorithmic acceleration; a is the true one, which satisfies the equations at the new
# time, so that torques and multipliers keep second order (Arnold and Bruels 2007, eqs. 8 to 10).


@dataclass(frozen=True)
class AlphaScheme:
    """Coefficients of one member of the family.

    Attributes:
        name: For reports.
        alpha_m, alpha_f: Averages of inertia and of the other forces.
        beta, gamma: Newmark's coefficients.
    """

    name: str
    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float

    @property
    def order(self) -> int:
        """Power of the step that errors fall with: 2, or 1 where gamma damps by itself."""
        return 2 if abs(self.gamma - 0.5 - self.alpha_f + self.alpha_m) < 1e-9 else 1

    @property
    def mass_factor(self) -> float:
        """da/ds of the new step."""
        return (1.0 - self.alpha_m) / (1.0 - self.alpha_f)

    def weights(self, h: float) -> tuple[float, float, float]:
        """Of M, C and K in the matrix of a step of h (s): what ds adds to a, v and y."""
        return self.mass_factor, self.gamma * h, self.beta * h * h


@public
def generalized_alpha(rho_inf: float = 0.8) -> AlphaScheme:
    """Second order, spectral radius rho_inf at infinite frequency (Chung and Hulbert 1993).

    Args:
        rho_inf: 0 (annihilates what the step cannot resolve) to 1 (keeps it).
    """
    if not 0.0 <= rho_inf <= 1.0:
        raise DescriptionError(f"solve.rho_inf: {rho_inf} is outside [0, 1]. Usual: 0.5 to 0.9.")
    alpha_m = (2.0 * rho_inf - 1.0) / (rho_inf + 1.0)
    alpha_f = rho_inf / (rho_inf + 1.0)
    gamma = 0.5 + alpha_f - alpha_m
    return AlphaScheme("generalized_alpha", alpha_m, alpha_f, 0.25 * (gamma + 0.5) ** 2, gamma)


@public
def hht(rho_inf: float = 0.8) -> AlphaScheme:
    """Hilber, Hughes and Taylor 1977 with alpha = (1 - rho_inf)/(1 + rho_inf), at most 1/3."""
    alpha = (1.0 - rho_inf) / (1.0 + rho_inf)
    if not 0.0 <= alpha <= 1.0 / 3.0 + 1e-12:
        raise DescriptionError(
            f"solve.rho_inf: {rho_inf} is outside [0.5, 1], where HHT is second order and stable."
        )
    return AlphaScheme("hht", 0.0, alpha, 0.25 * (1.0 + alpha) ** 2, 0.5 + alpha)


@public
def newmark(gamma: float = 0.5, beta: float = 0.25) -> AlphaScheme:
    """Newmark 1959: gamma = 1/2, beta = 1/4 is the average-acceleration (trapezoidal) rule.

    Args:
        gamma: Weight of the new acceleration in the speed [-].
        beta: The same in the position [-].
    """
    if gamma < 0.5 or beta < 0.25 * (gamma + 0.5) ** 2 - 1e-12:
        raise DescriptionError(
            f"solve.newmark: [{gamma}, {beta}] is not unconditionally stable. "
            "Take gamma >= 1/2 and beta >= (gamma + 1/2)^2 / 4."
        )
    return AlphaScheme("newmark", 0.0, 0.0, beta, gamma)


def scheme(
    name: str, rho_inf: float = 0.8, coefficients: tuple[float, float] | None = None
) -> AlphaScheme:
    """A scheme by name, as `solve.integrator` of the YAML says it."""
    if name == "newmark":
        return newmark(*coefficients) if coefficients is not None else newmark()
    if name in ("generalized_alpha", "hht"):
        return generalized_alpha(rho_inf) if name == "generalized_alpha" else hht(rho_inf)
    names = ("generalized_alpha", "hht", "newmark")
    raise DescriptionError(f"solve.integrator: {name}.{nearest(name, names)}")


# Equal steps of a linear, time-varying system on closures.
#
#     M(t) a + C(t) v + K(t) d + r(t) - J(t)' lam = 0,     J(t) d = 0
#
# A method is a generator of states at equal steps; d, v and a are the free coordinates only. The
# alpha family is here, one plain step; `kernel.evaluate` takes the same steps compiled. Others are
# registered by users (`solve.register_integrator`).

_MASSLESS = 1e-24  # of the largest mass: round-off of a coordinate that has none


@dataclass(frozen=True)
class Instant:
    """The system at one time: M, C, K (n, n), load r (n,) on the left side, J (rows, n)."""

    M: Array
    C: Array
    K: Array
    r: Array
    J: Array


@dataclass(frozen=True)
class State:
    """Deviation d, its rate v and acceleration a, each (n,), and multipliers lam (rows,)."""

    d: Array
    v: Array
    a: Array
    lam: Array


At = Callable[[int], Instant]
Method = Callable[[At, int, float, Array], Iterator[State]]


def start_at_rest(now: Instant, d: Array) -> State:
    """State at rest in d: the acceleration that balances the first instant."""
    still = np.zeros_like(d)
    return start_anew(now, State(d, still, still, np.zeros(len(now.J))))


def start_anew(now: Instant, state: State) -> State:
    """A state with the acceleration that balances an instant; closures go on as they did."""
    a, mass = state.a.copy(), np.abs(np.diag(now.M))
    heavy = mass > _MASSLESS * np.max(mass, initial=0.0)  # the others follow, whatever their a
    J, load = now.J[:, heavy], -(now.r + now.C @ state.v + now.K @ state.d)[heavy]
    a[heavy], lam = saddle(now.M[np.ix_(heavy, heavy)], J, J, load, J @ a[heavy])
    return State(state.d, state.v, a, lam)


def collocated(method: Collocation, at: Sequence[Instant], h: float, now: State) -> State:
    """One step of length h (s) of the linear system, which is `at` the stages, by collocation."""
    m, n, rows = method, len(now.d), len(at[0].J)
    d = now.d + h * m.c[:, None] * now.v
    S = np.zeros((m.s, n + rows, m.s, n + rows))
    b = np.zeros((m.s, n + rows))
    for i, x in enumerate(at):
        for j in range(m.s):
            S[i, :n, j, :n] = h * m.A[i, j] * x.C + h * h * m.A2[i, j] * x.K
            S[i, n:, j, :n] = m.A2[i, j] * x.J
        S[i, :n, i, :n] += x.M
        S[i, :n, i, n:] = -x.J.T
        b[i] = np.append(-(x.r + x.C @ now.v + x.K @ d[i]), -(x.J @ d[i]) / (h * h))
    found = np.linalg.solve(S.reshape(b.size, b.size), b.ravel()).reshape(b.shape)
    a = found[:, :n]
    return State(
        d[-1] + h * h * m.A2[-1] @ a,
        now.v + h * m.A[-1] @ a,
        a[-1],
        np.asarray(found[-1, n:], float),
    )


Across = Mapping[int, Callable[[State], State]]


def alpha(
    scheme: AlphaScheme, at: At, count: int, h: float, d: Array, across: Across | None = None
) -> Iterator[State]:
    """Newmark, or another member of the alpha family (pinflex.integrators.collocation).

    `across`: steps by number that are taken in another way, behind which it begins anew.
    """
    factor, beta, gamma = scheme.mass_factor, scheme.beta, scheme.gamma
    by_a, by_v, by_d = scheme.weights(h)
    state = start_at_rest(at(0), d)
    yield state
    v, a, s, lam = state.v, state.a, state.a, state.lam
    for k in range(1, count):
        if across and k in across:
            state = across[k](State(d, v, a, lam))
            d, v, a, s = state.d, state.v, state.a, state.a
            yield state
            continue
        now = at(k)
        d = d + h * v + h * h * (0.5 - beta) * s
        v = v + h * (1 - gamma) * s
        s = (-scheme.alpha_m * s + scheme.alpha_f * a) / (1 - scheme.alpha_m)
        d, v = d + h * h * beta * s, v + h * gamma * s
        load, gap = now.r + now.C @ v + now.K @ d, now.J @ d
        S = by_a * now.M + by_v * now.C + by_d * now.K
        ds, lam = saddle(S, now.J, now.J, -load, -gap / (beta * h * h))
        s, a = s + ds, factor * ds
        d, v = d + h * h * beta * ds, v + h * gamma * ds
        yield State(d, v, a, lam)
