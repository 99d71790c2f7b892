"""Equal steps of a linear, time-varying system on closures.

    M(t) a + C(t) v + K(t) d + r(t) - J(t)' lam = 0,     J(t) d = 0

A method is a generator of states at equal steps; d, v and a are the free coordinates only. The
alpha family is here, one plain step; `kernel.linear` takes the same steps compiled. Others are
registered by users (`solve.register_integrator`), as those of `integrators.textbook` are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.integrators.collocation import AlphaScheme
from pinflex.linalg import saddle

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
    a, mass = np.zeros_like(d), np.abs(np.diag(now.M))
    heavy = mass > _MASSLESS * np.max(mass, initial=0.0)  # the others follow, whatever their a
    J, load = now.J[:, heavy], -(now.r + now.K @ d)[heavy]
    a[heavy], lam = saddle(now.M[np.ix_(heavy, heavy)], J, J, load, np.zeros(len(J)))
    return State(d, np.zeros_like(d), a, lam)


def alpha(scheme: AlphaScheme, at: At, count: int, h: float, d: Array) -> Iterator[State]:
    """Newmark, or another member of the alpha family (pinflex.integrators.collocation)."""
    factor, beta, gamma = scheme.mass_factor, scheme.beta, scheme.gamma
    by_a, by_v, by_d = scheme.weights(h)
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
        S = by_a * now.M + by_v * now.C + by_d * now.K
        ds, lam = saddle(S, now.J, now.J, -load, -gap / (beta * h * h))
        s, a = s + ds, factor * ds
        d, v = d + h * h * beta * ds, v + h * gamma * ds
        yield State(d, v, a, lam)


@dataclass(frozen=True)
class Alpha:
    """A member of the alpha family as a method."""

    scheme: AlphaScheme

    def __call__(self, at: At, count: int, h: float, d: Array) -> Iterator[State]:
        """States at equal steps."""
        return alpha(self.scheme, at, count, h, d)
