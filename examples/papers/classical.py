"""Classical methods for the linear system of level ked, by the door that is open to every stepper.

Central differences, Houbolt, Wilson's theta and mode superposition, to compare with the literature:
`pf.solve(robot, level="ked", integrator=partial(wilson_theta, theta=1.5))`; after `register()`
scenes know their names too. The closures hold at every step (in `wilson_theta` at the end of its
longer step).

Modes: the closures are removed by d = Z(t) z, z a fixed choice of the coordinates, so that

    Z'M Z zdd + Z'(C Z + 2 M Zd) zd + Z'(K Z + C Zd + M Zdd) z = -Z' r.

On an interval the matrices are those of its middle; the lowest modes of (Z'K Z, Z'M Z) are used,
with whatever couples them, and the load is linear in time: the matrix exponential is exact. What
the other modes carry follows statically. Where stiff directions turn with the mechanism, a matrix
constant over an interval lets them turn in jumps: a small error stays however short the step (on
the 3-RRS 7e-4 of the largest platform error, on its smaller components). The direct methods have
none.

Source: Bathe (1996), Finite Element Procedures, sections 9.2 to 9.4, for the schemes; the closures
and the time-varying matrices are added here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.description.solve import Integrator, register_integrator
from pinflex.errors import DescriptionError
from pinflex.integrators.collocation import At, Instant, State, alpha, newmark, start_at_rest
from pinflex.linalg import eigh, lapack, null_space, saddle


def central_difference(at: At, count: int, h: float, d: Array) -> Iterator[State]:
    """Explicit: balance at t, d at t + h on its closures; stable for h < 2 / omega_max.

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
    """Third-order backward differences; two Newmark steps (1/2, 1/4) start it."""
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
    """Linear acceleration over a step theta h; unconditionally stable from theta = 1.37 on."""
    if theta < 1.37:
        raise DescriptionError(
            f"theta = {theta}: Wilson's method is unconditionally stable from 1.37 on. Usual: 1.4."
        )
    state = start_at_rest(at(0), d)
    yield state
    v, a, long = state.v, state.a, theta * h
    for k in range(1, count):
        now = _toward(at(k - 1), at(k), theta)
        older_a = -6 / long**2 * d - 6 / long * v - 2 * a
        older_v = -3 / long * d - 2 * v - long / 2 * a
        A = 6 / long**2 * now.M + 3 / long * now.C + now.K
        b = -now.r - now.M @ older_a - now.C @ older_v
        ahead, _ = saddle(A, now.J, now.J, b, np.zeros(len(now.J)))
        old, a = a, a + (6 / long**2 * ahead + older_a - a) / theta
        d = d + h * v + h * h / 6 * (a + 2 * old)
        v = v + h / 2 * (a + old)
        yield with_multipliers(at(k), d, v, a)


def _toward(one: Instant, other: Instant, part: float) -> Instant:
    """Straight line through two instants, at `part` of the way (beyond 1: extrapolated)."""
    pairs = (getattr(one, x) + part * (getattr(other, x) - getattr(one, x)) for x in "MCKrJ")
    return Instant(*pairs)


def with_multipliers(now: Instant, d: Array, v: Array, a: Array) -> State:
    """The state with the multipliers that balance it best, each row weighted by its mass."""
    if not len(now.J):
        return State(d, v, a, np.zeros(0))
    load = now.M @ a + now.C @ v + now.K @ d + now.r
    mass = np.diag(now.M)
    scale = 1.0 / np.sqrt(np.maximum(mass, 1e-12 * np.max(mass)))
    lam = np.linalg.lstsq((now.J * scale).T, load * scale, rcond=None)[0]
    return State(d, v, a, np.asarray(lam, dtype=float))


@dataclass(frozen=True)
class _Reduced:
    """The system in z at one time; Z, Zd, Zdd bring z back to d."""

    Z: Array
    Zd: Array
    Zdd: Array
    M: Array
    C: Array
    K: Array
    f: Array


class _Choice:
    """z: coordinates that stay when the closures are solved for the others."""

    def __init__(self, at: At, count: int, h: float) -> None:
        self.at, self.count, self.h = at, count, h
        J = at(0).J
        rows, n = J.shape
        order = lapack().dgeqp3(J)[1] - 1 if rows else np.arange(n)
        self.solved: IntArray = np.sort(order[:rows])
        self.kept: IntArray = np.sort(order[rows:])

    def Z(self, J: Array) -> Array:
        Z = np.zeros((J.shape[1], len(self.kept)))
        Z[self.kept, np.arange(len(self.kept))] = 1.0
        if len(J):
            Z[self.solved] = -np.linalg.solve(J[:, self.solved], J[:, self.kept])
        return Z

    def reduced(self, k: int) -> _Reduced:
        """By central differences of Z inside, by one-sided ones of second order at the ends."""
        h, last = self.h, self.count - 1
        now, Z = self.at(k), self.Z(self.at(k).J)
        if last < 3 or not len(now.J):
            Zd = Zdd = np.zeros_like(Z)
        elif 0 < k < last:
            before, after = self.Z(self.at(k - 1).J), self.Z(self.at(k + 1).J)
            Zd, Zdd = (after - before) / (2 * h), (after - 2 * Z + before) / h**2
        else:
            way = 1 if k == 0 else -1
            Z1, Z2, Z3 = (self.Z(self.at(k + way * j).J) for j in (1, 2, 3))
            Zd = way * (-3 * Z + 4 * Z1 - Z2) / (2 * h)
            Zdd = (2 * Z - 5 * Z1 + 4 * Z2 - Z3) / h**2
        M, C, K = now.M, now.C, now.K
        return _Reduced(
            Z, Zd, Zdd, Z.T @ M @ Z, Z.T @ (C @ Z + 2 * M @ Zd),
            Z.T @ (K @ Z + C @ Zd + M @ Zdd), -Z.T @ now.r,
        )  # fmt: skip


def mode_superposition(at: At, count: int, h: float, d: Array, modes: int = 12) -> Iterator[State]:
    """March by modes."""
    choice = _Choice(at, count, h)
    n = len(choice.kept)
    keep = min(n, modes)
    left = choice.reduced(0)
    z, zd = d[choice.kept], np.zeros(n)
    for k in range(count):
        if k:
            right = choice.reduced(k)
            z, zd = _interval(left, right, z, zd, h, keep)
            left = right
        yield _state(at(k), left, z, zd, keep)


def _modes(K: Array, M: Array, keep: int) -> tuple[Array, Array, Array]:
    """Squared frequencies (m,), modes V (n, m) and the V^+ (m, n) that gives back V^+ V = 1.

    The modes of a mass matrix of condition 1e12 (curvatures beside displacements) are orthogonal to
    1e-4 only: V' M is not good enough.
    """
    from scipy.linalg import eigh

    last = min(keep, len(K)) - 1
    squares, V = eigh(0.5 * (K + K.T), 0.5 * (M + M.T), subset_by_index=[0, last])
    return squares, V, np.linalg.solve(V.T @ M @ V, V.T)


def _interval(
    left: _Reduced, right: _Reduced, z: Array, zd: Array, h: float, keep: int
) -> tuple[Array, Array]:
    """z and its rate at the end of an interval: modes of its middle, linear load."""
    from scipy.linalg import expm

    M, C, K = (0.5 * (getattr(left, x) + getattr(right, x)) for x in "MCK")
    squares, V, onto = _modes(K, M, keep)
    m = V.shape[1]
    # Rates in units of omega keep the exponent's entries of one size.
    unit = np.sqrt(np.maximum(np.abs(squares), h**-2))
    back = onto @ M
    A = np.zeros((2 * m + 2, 2 * m + 2))
    A[:m, m : 2 * m] = h * np.diag(unit)
    A[m : 2 * m, :m] = -h * (onto @ K @ V) / unit[:, None]
    A[m : 2 * m, m : 2 * m] = -h * (onto @ C @ V) * unit / unit[:, None]
    A[m : 2 * m, -2] = h * onto @ (right.f - left.f) / unit
    A[m : 2 * m, -1] = h * onto @ left.f / unit
    A[-2, -1] = 1.0
    x = expm(A) @ np.concatenate([back @ z, back @ zd / unit, [0.0, 1.0]])
    return V @ x[:m], V @ (unit * x[m : 2 * m])


def _state(now: Instant, here: _Reduced, z: Array, zd: Array, keep: int) -> State:
    """d, v, a and multipliers of z, with the static part of the modes left out."""
    if keep < len(z):
        _, V, onto = _modes(here.K, here.M, keep)
        zdd = V @ (onto @ (here.f - here.C @ zd - here.K @ z))
        # The part of the load that the kept modes do not take, and none of their own motion.
        rest = np.linalg.solve(here.K, here.f - here.M @ (V @ (onto @ here.f)))
        z = z + rest - V @ (onto @ (here.M @ rest))
    else:
        zdd = np.asarray(np.linalg.solve(here.M, here.f - here.C @ zd - here.K @ z))
    d, v = here.Z @ z, here.Z @ zd + here.Zd @ z
    a = here.Z @ zdd + 2 * here.Zd @ zd + here.Zdd @ z
    return with_multipliers(now, d, v, a)


def register() -> None:
    """Let scenes name them."""
    for method in (central_difference, houbolt, wilson_theta, mode_superposition):
        register_integrator(Integrator(method.__name__, only="ked", method=method))
