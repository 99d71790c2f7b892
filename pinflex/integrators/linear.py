"""Direct integration and mode superposition of a linear, time-varying system on closures.

    M(t) a + C(t) v + K(t) d + r(t) - J(t)' lam = 0,     J(t) d = 0

Each method is a generator of states at equal steps; d, v and a are the free coordinates only. The
closures hold at every step (in `wilson_theta` at the end of its longer step).

Source: Bathe (1996), Finite Element Procedures, sections 9.2 to 9.4, for the schemes; the closures
and the time-varying matrices are added here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError
from pinflex.integrators.schemes import AlphaScheme, newmark
from pinflex.linalg import eigh, lapack, null_space, saddle

_MASSLESS = 1e-24  # of the largest mass: round-off of a coordinate that has none


@dataclass(frozen=True)
class Instant:
    """The system at one time: M, C, K (n, n), load r (n,) on the left side, J (rows, n)."""

    M: Array
    C: Array
    K: Array
    r: Array
    J: Array

    def toward(self, other: Instant, part: float) -> Instant:
        """Straight line through two instants, at `part` of the way (beyond 1: extrapolated).

        Args:
            other: The instant that part 1 is.
            part: 0 to 1, or beyond.
        """
        pairs = ((self.M, other.M), (self.C, other.C), (self.K, other.K))
        M, C, K = (a + part * (b - a) for a, b in pairs)
        r = self.r + part * (other.r - self.r)
        return Instant(M, C, K, r, self.J + part * (other.J - self.J))


@dataclass(frozen=True)
class State:
    """Deviation d, its rate v and acceleration a, each (n,), and multipliers lam (rows,)."""

    d: Array
    v: Array
    a: Array
    lam: Array


At = Callable[[int], Instant]
March = Callable[[At, int, float, Array], Iterator[State]]


class _Factored:
    """`saddle` at instants in turn: one that stays the same object keeps its factors."""

    def __init__(self) -> None:
        self._factor, self._solve = lapack().dgetrf, lapack().dgetrs
        self._now: Instant | None = None

    def __call__(
        self, now: Instant, A: Callable[[Instant], Array], b: Array, c: Array
    ) -> tuple[Array, Array]:
        """x and lam for A(now) on the closures of now."""
        if not len(b):  # every coordinate is a motor
            return b, c
        if now is not self._now:
            n, rows = len(now.M), len(now.J)
            S = np.zeros((n + rows, n + rows), order="F")
            S[:n, :n], S[:n, n:], S[n:, :n] = A(now), now.J.T, now.J
            self._lu, self._pivots, self._info = self._factor(S, overwrite_a=True)
            self._now = now
        if self._info > 0:
            return saddle(A(now), now.J, now.J, b, c)
        x, _ = self._solve(self._lu, self._pivots, np.concatenate([b, c]), overwrite_b=True)
        return x[: len(b)], -x[len(b) :]


def start_at_rest(now: Instant, d: Array) -> State:
    """State at rest in d: the acceleration that balances the first instant.

    Args:
        now: The first instant.
        d: Deviation, shape (n,).
    """
    a, mass = np.zeros_like(d), np.abs(np.diag(now.M))
    heavy = mass > _MASSLESS * np.max(mass, initial=0.0)  # the others follow, whatever their a
    J, load = now.J[:, heavy], -(now.r + now.K @ d)[heavy]
    a[heavy], lam = saddle(now.M[np.ix_(heavy, heavy)], J, J, load, np.zeros(len(J)))
    return State(d, np.zeros_like(d), a, lam)


def alpha(scheme: AlphaScheme, at: At, count: int, h: float, d: Array) -> Iterator[State]:
    """Newmark, or another member of the alpha family (pinflex.integrators.schemes).

    Args:
        scheme: Coefficients.
        at: The system at step k.
        count: Number of steps.
        h: Step [s].
        d: First deviation, at rest, shape (n,).
    """
    factor, beta, gamma = scheme.mass_factor, scheme.beta, scheme.gamma
    solve = _Factored()

    def full(now: Instant) -> Array:
        return factor * now.M + gamma * h * now.C + beta * h * h * now.K

    state = start_at_rest(at(0), d)
    yield state
    v, a, s = state.v, state.a, state.a
    for k in range(1, count):
        now = at(k)
        d = d + h * v + h * h * (0.5 - beta) * s
        v = v + h * (1 - gamma) * s
        s = (-scheme.alpha_m * s + scheme.alpha_f * a) / (1 - scheme.alpha_m)
        d, v = d + h * h * beta * s, v + h * gamma * s
        load, gap = now.r + now.C @ v + now.K @ d, now.J @ d
        ds, lam = solve(now, full, -load, -gap / (beta * h * h))
        s, a = s + ds, factor * ds
        d, v = d + h * h * beta * ds, v + h * gamma * ds
        yield State(d, v, a, lam)


@dataclass(frozen=True)
class Alpha:
    """A march by a member of the alpha family."""

    scheme: AlphaScheme

    def __call__(self, at: At, count: int, h: float, d: Array) -> Iterator[State]:
        """States at equal steps.

        Args:
            at: The system at step k. count: Number of steps. h: Step [s].
            d: First deviation, at rest, shape (n,).
        """
        return alpha(self.scheme, at, count, h, d)


def central_difference(at: At, count: int, h: float, d: Array) -> Iterator[State]:
    """Explicit: balance at t, d at t + h on its closures; stable for h < 2 / omega_max.

    Args:
        at: The system at step k.
        count: Number of steps.
        h: Step [s].
        d: First deviation, at rest, shape (n,).
    Raises:
        DescriptionError: The step is too long, with the longest one that is stable.
    """
    limit = stable_step(at(0))
    if h > limit:
        raise DescriptionError(
            f"solve.dt: {h:.3g} s: central_difference is stable below 2 / omega_max = {limit:.3g} "
            "s only. Take a smaller dt, fewer elements, or integrator: newmark.",
            limit=limit,
        )
    start = start_at_rest(at(0), d)
    history = [d - h * start.v + 0.5 * h * h * start.a]
    for k in range(count):
        now, before = at(k), history[-1]
        if k == count - 1:
            yield with_multipliers(now, *_last([*history[-3:], d], h)) if k else start
            return
        A = now.M / h**2 + now.C / (2 * h)
        b = 2 * now.M @ d / h**2 - now.K @ d - now.r
        b -= (now.M / h**2 - now.C / (2 * h)) @ before
        after, lam = saddle(A, now.J, at(k + 1).J, b, np.zeros(len(now.J)))
        yield State(d, (after - before) / (2 * h), (after - 2 * d + before) / h**2, lam)
        history = [*history[-3:], d]
        d = after


def _last(d: list[Array], h: float) -> tuple[Array, Array, Array]:
    """d, v, a of the last step, by one-sided differences of second order."""
    if len(d) < 4:
        raise DescriptionError("solve.dt: central_difference needs three steps or more a run.")
    v = (3 * d[-1] - 4 * d[-2] + d[-3]) / (2 * h)
    a = (2 * d[-1] - 5 * d[-2] + 4 * d[-3] - d[-4]) / h**2
    return d[-1], v, a


def stable_step(now: Instant) -> float:
    """2 / omega_max of the instant, s; zero when a coordinate has no mass."""
    Z = null_space(now.J)
    M, K = Z.T @ now.M @ Z, Z.T @ now.K @ Z
    try:
        squares, _ = eigh(0.5 * (K + K.T), 0.5 * (M + M.T), vectors=False)
    except np.linalg.LinAlgError:
        return 0.0
    return float(2.0 / np.sqrt(max(squares[-1], 1e-300)))


def houbolt(at: At, count: int, h: float, d: Array) -> Iterator[State]:
    """Third-order backward differences; two Newmark steps (1/2, 1/4) start it.

    Args:
        at: The system at step k.
        count: Number of steps.
        h: Step [s].
        d: First deviation, at rest, shape (n,).
    """
    past: list[Array] = []
    for state in alpha(newmark(), at, min(3, count), h, d):
        past.append(state.d)
        yield state
    for k in range(3, count):
        now, (d3, d2, d1) = at(k), past[-3:]
        older_a = (-5 * d1 + 4 * d2 - d3) / h**2
        older_v = (-18 * d1 + 9 * d2 - 2 * d3) / (6 * h)
        A = 2 * now.M / h**2 + 11 * now.C / (6 * h) + now.K
        b = -now.r - now.M @ older_a - now.C @ older_v
        d, lam = saddle(A, now.J, now.J, b, np.zeros(len(now.J)))
        past = [d2, d1, d]
        yield State(d, older_v + 11 * d / (6 * h), older_a + 2 * d / h**2, lam)


def wilson_theta(at: At, count: int, h: float, d: Array, theta: float = 1.4) -> Iterator[State]:
    """Linear acceleration over a step theta h; unconditionally stable from theta = 1.37 on.

    Args:
        at: The system at step k.
        count: Number of steps.
        h: Step [s].
        d: First deviation, at rest, shape (n,).
        theta: Length over h of the step on which the acceleration is linear [-].
    """
    if theta < 1.37:
        raise DescriptionError(
            f"solve.theta: {theta}: Wilson's method is unconditionally stable from 1.37 on. "
            "Usual: 1.4."
        )
    state = start_at_rest(at(0), d)
    yield state
    v, a, long = state.v, state.a, theta * h
    for k in range(1, count):
        now = at(k - 1).toward(at(k), theta)
        older_a = -6 / long**2 * d - 6 / long * v - 2 * a
        older_v = -3 / long * d - 2 * v - long / 2 * a
        A = 6 / long**2 * now.M + 3 / long * now.C + now.K
        b = -now.r - now.M @ older_a - now.C @ older_v
        ahead, _ = saddle(A, now.J, now.J, b, np.zeros(len(now.J)))
        old, a = a, a + (6 / long**2 * ahead + older_a - a) / theta
        d = d + h * v + h * h / 6 * (a + 2 * old)
        v = v + h / 2 * (a + old)
        yield with_multipliers(at(k), d, v, a)


def with_multipliers(now: Instant, d: Array, v: Array, a: Array) -> State:
    """The state with the multipliers that balance it best, each row weighted by its mass.

    Args:
        now: The system at this time.
        d, v, a: Deviation and its rates, shape (n,).
    """
    if not len(now.J):
        return State(d, v, a, np.zeros(0))
    load = now.M @ a + now.C @ v + now.K @ d + now.r
    mass = np.diag(now.M)
    scale = 1.0 / np.sqrt(np.maximum(mass, 1e-12 * np.max(mass)))
    lam = np.linalg.lstsq((now.J * scale).T, load * scale, rcond=None)[0]
    return State(d, v, a, np.asarray(lam, dtype=float))
