"""Equilibrium of the flexible mechanism: static, or under the nominal motion's inertia forces."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pinflex.actuation.drive import nominal
from pinflex.arrays import Array, IntArray
from pinflex.boundary import public
from pinflex.description.motions.motion import Motion
from pinflex.errors import ConvergenceError, Ending
from pinflex.integrators.problem import Run
from pinflex.linalg import condensed, negative_directions, null_space, saddle_matrix
from pinflex.mechanics.assembly import CLOSED
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import FrozenLinks
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.mechanics.model.system import System
from pinflex.text import frozen, plural
from pinflex.threads import one_blas_thread

# Loads without a potential: followers, and moments that keep their direction in space.
#
# Their stiffness is not symmetric, so that modes may couple into flutter, s = a + i b, before or
# instead of buckling. In the modes x of the symmetric part, of unit mass and omega^2, it is
#
#     (diag(omega^2) + x' K_skew x) z = - s^2 z
#
# Source: Bolotin, Nonconservative Problems of the Theory of Elastic Stability (1963).

_REAL = 1e-7  # of |s|: round-off of a growth or a turn; at a double root it is its square root


def acts_without_potential(system: System, t: float = 0.0) -> bool:
    """Whether a load at a time t [s] follows its frame, is a moment, or a pin rubs in its hole."""
    loads = (force for force, _ in system.loads.forces if force.scale(t))
    rubs = any(touch.friction or touch.excess for touch in system.loads.touches)
    return rubs or any(force.follower or any(force.moment) for force in loads)


def coupled(skew: Array, x: Array, omega2: Array) -> tuple[Array, Array]:
    """Eigenvalues s [1/s], Im s >= 0, the growing one of a divergence, slowest first, and shapes.

    Returns:
        s (k,); real shapes (n, k) of unit mass: two that flutter are the real and the imaginary
        part of one.
    """
    values, z = np.linalg.eig(np.diag(omega2) + x.T @ skew @ x)
    s = 1j * np.sqrt(values.astype(complex))
    s = np.where(s.imag < 0, -s, s)
    s = np.where(np.abs(s.imag) <= _REAL * np.abs(s), np.abs(s.real), s)
    s = np.where(np.abs(s.real) <= _REAL * np.abs(s), 1j * s.imag, s)
    order = np.argsort(np.where(s.imag > 0, 1.0, -1.0) * np.abs(s), kind="stable")
    s, z = s[order], z[:, order]
    largest = z[np.argmax(np.abs(z), axis=0), np.arange(len(s))]
    z = z * (np.abs(largest) / largest)
    parts = np.where((s.imag > 0) & (s.real < 0), z.imag, z.real)
    return s, x @ (parts / np.linalg.norm(parts, axis=0))


# Newton on a balance of forces ends quadratically; its last correction, relative to the largest
# coordinate it moves, is then at round-off.
BALANCED = 1e-11
_ITERATIONS = 40  # of one Newton run
STIFFNESS = (0.0, 0.0, 1.0)  # of the derivatives by acceleration, velocity and position
_SLOW = 0.3  # contraction above which Newton has to know how rates change from pose to pose
_STRAIGHT = 10  # iterations beyond which Newton has gone astray before it found a balance
STABILITY_SAMPLES = 5  # instants of a run at which stability is looked at


@frozen
class Equilibrium:
    """A balanced pose y (nq,) with v and a (nv,) there, multipliers lam (rows,), forces r (nv,).

    r is what is left to the motors.
    """

    y: Array
    v: Array
    a: Array
    lam: Array
    r: Array
    iterations: int
    unstable: int = 0  # directions that give way, where that was looked at


class UnstableWarning(UserWarning):
    """An equilibrium that the mechanism leaves when it is touched."""


def balance(
    dynamics: Equations,
    y: Array,
    v: Array,
    a: Array,
    free: IntArray,
    t: float,
    lam: Array | None = None,
    where: str = "static equilibrium",
    patience: float = np.inf,
    links: FrozenLinks | None = None,
) -> Equilibrium:
    """Newton with step halving on r(y; v, a, lam, t) = 0 in the free rows and c(y) = 0.

    Where full Newton fails, the load is put on in parts, in so many iterations (`patience`) in all.

    Raises:
        ConvergenceError: No equilibrium found (a structure that buckles or a mechanism that falls).
    """
    lam = np.zeros(dynamics.system.closed.n) if lam is None else lam
    put_on = _Newton(dynamics, v, a, free, t, links)
    found = put_on(y, lam)
    if found is not None:
        return found
    state, _ = put_on.at(y, np.zeros_like(lam))
    start, done, part = state.r[free], 0.0, 0.25
    spent = _ITERATIONS
    while done < 1.0 and part > 1e-3 and spent < patience:
        goal = min(1.0, done + part)
        stage = put_on(state.y, state.lam, (1.0 - goal) * start)
        spent += _ITERATIONS if stage is None else stage.iterations
        if stage is None:
            part *= 0.5
            continue
        state, done, part = stage, goal, part * 1.5
    if done < 1.0:
        raise ConvergenceError(
            f"{where}: no equilibrium: the load can be put on to {100 * done:.0f} % only. "
            f"{Ending.NO_EQUILIBRIUM.value}",
            part=done,
            ending=Ending.NO_EQUILIBRIUM,
        )
    return replace(state, iterations=spent)


@dataclass(frozen=True)
class _Newton:
    """Newton runs on the balance of one instant, see `balance`."""

    dynamics: Equations
    v: Array
    a: Array
    free: IntArray
    t: float
    links: FrozenLinks | None

    def at(self, y: Array, lam: Array, iterations: int = 0) -> tuple[Equilibrium, Array]:
        """What is at a pose y (nq,) with multipliers lam (rows,), and how open the closures are."""
        v, a = self.v, self.a
        if self.links is not None:
            (v,), (a,) = self.links.rates(y[None], v[None], a[None])
        r, c = self.dynamics.residual(y, v, a, lam, self.t)
        return Equilibrium(y, v, a, lam, r, iterations), c

    def __call__(self, y: Array, lam: Array, left: float | Array = 0.0) -> Equilibrium | None:
        """One run on r = left in the free rows; None when it does not converge.

        Where links move, it first takes their rates for constant, and sees whether that is enough.
        Where play lets something go, it falls and comes to rest (`pinflex.levels.settled`).
        """
        if self.dynamics.system.kinks.rows:
            from pinflex.levels.settled import settle

            return settle(self.dynamics, self.at, y, lam, self.free, self.t, left)
        for links in (None, self.links) if self.links is not None else (None,):
            try:
                found = self._run(y, lam, left, links)
            except np.linalg.LinAlgError:
                found = None
            if found is not None:
                return found
        return None

    def _run(
        self, y: Array, lam: Array, left: float | Array, links: FrozenLinks | None
    ) -> Equilibrium | None:
        """The same by one sort of tangent: with what the rates of `links` add to it."""
        dynamics, free, n = self.dynamics, self.free, len(self.free)
        rough = self.links is not links
        previous, (now, c) = np.inf, self.at(y, lam)
        if not np.any(now.r[free] - left) and np.max(np.abs(c), initial=0.0) < CLOSED:
            return now  # nothing pushes, as without a load, where freedoms may lack stiffness too
        for iteration in range(1, _ITERATIONS):
            state = now.y, now.v, now.a, now.lam, self.t
            M, C, K, J = dynamics.tangent(*state)
            if links is not None:
                K = K + links.stiffness(now.y, now.v, now.a, M, C)
            S = saddle_matrix(K[np.ix_(free, free)], J[:, free])
            step = np.linalg.solve(S, -np.concatenate([now.r[free] - left, c]))
            if not np.all(np.isfinite(step)):
                return None
            turn = float(np.max(np.abs(step[:n]), initial=0.0))
            factor = min(1.0, 0.3 / max(turn, 1e-300))
            dy = np.zeros(dynamics.system.nv)
            dy[free] = factor * step[:n]
            y, lam = dynamics.integrate(now.y, dy), now.lam + factor * step[n:]
            now, c = self.at(y, lam, iteration)
            if not np.all(np.isfinite(now.r)):
                return None
            if turn < BALANCED or (turn < 1e-8 and turn >= 0.5 * previous):
                return now
            if rough and turn > _SLOW * previous:
                return None
            previous = turn
        return None


@public
@takes_model
@one_blas_thread()
def static_equilibrium(
    mechanism: Mechanism, q: Array | None = None, free_motors: bool = False
) -> Equilibrium:
    """Equilibrium under gravity at a rigid pose, with the motors locked (or free).

    Args:
        mechanism: Mechanism. q: Rigid pose, default home. free_motors: Let the motors go.
    Returns:
        The equilibrium; its r in the motor rows is the holding torque. Beyond buckling Newton may
        find the branch that gives way: its `unstable` is not 0, and an UnstableWarning says so.
    """
    found = rest(mechanism, q, free_motors)
    if found.unstable:
        warnings.warn(unstable_text(f"{mechanism.name}: static equilibrium"), UnstableWarning, 2)
    return found


def unstable_text(where: str) -> str:
    """What is said of an unstable equilibrium."""
    return (
        f"{where}: unstable, the stiffness is negative in some direction: the mechanism buckles or "
        "falls from there to another pose. Reduce the load, stiffen the links, add springs, or "
        "let a coupled run with damping find the pose that it ends in."
    )


def rest(
    mechanism: Mechanism,
    q: Array | None = None,
    free_motors: bool = False,
    dynamics: Equations | None = None,
) -> Equilibrium:
    """`static_equilibrium` for those who look at `unstable` themselves, on their workspace."""
    dynamics = dynamics or Equations(mechanism.standing)
    system = dynamics.system
    free = np.arange(system.nv) if free_motors else system.free
    still = np.zeros(system.nv)
    where = f"{mechanism.name}: static equilibrium"
    found = balance(dynamics, mechanism.undeformed(q), still, still, free, 0.0, None, where)
    return replace(
        found, unstable=unstable_directions(dynamics, found.y, still, still, found.lam, 0.0, free)
    )


def unstable_directions(
    dynamics: Equations, y: Array, v: Array, a: Array, lam: Array, t: float, free: IntArray
) -> int:
    """Number of directions that the closures allow in which the tangent stiffness is negative.

    Of loads that follow: in which the vibration diverges; a negative direction may hold there.
    """
    K, J = dynamics.iteration_matrix(y, v, a, lam, t, STIFFNESS)
    K, J = K[np.ix_(free, free)], J[:, free]
    negative = negative_directions(K, J)
    if not (negative and acts_without_potential(dynamics.system, t)):
        return negative
    Z = null_space(J)
    x, _, omega2 = condensed(Z.T @ K @ Z, Z.T @ dynamics.mass(y, t)[np.ix_(free, free)] @ Z)
    s, _ = coupled(0.5 * Z.T @ (K - K.T) @ Z, x, omega2)
    return int(np.sum((s.imag == 0) & (s.real > 0)))


def _snapped(
    dynamics: Equations, before: Equilibrium, found: Equilibrium, t: float, free: IntArray
) -> bool:
    """Whether Newton has lost a stable balance and ended in an unstable one further off."""
    if found.iterations <= _STRAIGHT:
        return False
    last, now = (
        unstable_directions(dynamics, x.y, x.v, x.a, x.lam, t, free) for x in (before, found)
    )
    return now > last


def solve_quasistatic(
    mechanism: Mechanism,
    motion: Motion,
    t: Array,
    progress: Callable[[int, int], None] | None = None,
) -> Run:
    """Balance eta and the free joints with the nominal inertia forces at each instant.

    v and a are those of the rigid motion, with the links as they are bent. A ConvergenceError has
    the run so far as its `.result`.
    """
    level = _Quasistatic(mechanism, motion, t)
    for k in range(len(t)):
        try:
            level.accept(k, level.correct(k, level.predict(k)))
        except ConvergenceError as error:
            error.result = level.run(k)
            raise
        if progress is not None and k % 16 == 0:
            progress(k, len(t))
    return level.run(len(t))


class _Quasistatic:
    """The level from instant to instant: r(y; v, a, lam, t) = 0 in the free rows, c(y) = 0.

    Prescribed are the motors and, but for what the bent links change, the rates of the rigid
    motion. Predicted is the deviation from it that the instant before had; Newton corrects it.
    """

    def __init__(self, mechanism: Mechanism, motion: Motion, t: Array) -> None:
        self._name, self._t, self.path = mechanism.name, t, nominal(mechanism, motion, t)
        system = self.system = mechanism.standing
        self.dynamics, n, m = Equations(system), len(t), int(system.rigid.nv)
        self.links = FrozenLinks(self.dynamics, mechanism, system.free)
        self.y, self.lam = np.empty((n, system.nq)), np.empty((n, system.closed.n))
        self.v, self.a = np.zeros((n, system.nv)), np.zeros((n, system.nv))
        self.v[:, :m], self.a[:, :m] = self.path.v, self.path.a
        self.torque, self.newton = np.empty((n, len(system.motors))), 0
        self.offset, self.force = np.zeros(system.nv), np.zeros(system.closed.n)
        self.last: Equilibrium | None = None
        self._looks = set(np.linspace(0, n - 1, STABILITY_SAMPLES).astype(int).tolist())
        self._said: dict[str, str] = {}

    def prescribe(self, k: int) -> Array:
        """The rigid pose (nq,) of an instant, its links straight."""
        return np.concatenate([self.path.q[k], np.zeros(self.system.n_eta)])

    def predict(self, k: int) -> Array:
        """The pose (nq,) where Newton starts."""
        return self.dynamics.integrate(self.prescribe(k), self.offset)

    def correct(self, k: int, y: Array) -> Equilibrium:
        """The equilibrium of an instant (`balance`); refused where it is not near that before."""
        now, free, where = float(self.path.t[k]), self.system.free, f"t = {self._t[k]:.6g} s"
        where = f"{self._name}: {where}"
        found = balance(
            self.dynamics, y, self.v[k], self.a[k], free, now, self.force, where, links=self.links
        )
        if self.last is not None and _snapped(self.dynamics, self.last, found, now, free):
            raise ConvergenceError(
                f"{where}: no equilibrium near that of the instant "
                f"before, only an unstable one further off. {Ending.SNAPS_THROUGH.value}",
                ending=Ending.SNAPS_THROUGH,
            )
        return found

    def accept(self, k: int, found: Equilibrium) -> None:
        """Record an equilibrium, and predict from there."""
        self.y[k], self.v[k], self.a[k], self.lam[k] = found.y, found.v, found.a, found.lam
        self.torque[k] = found.r[self.system.motors]
        self.offset, self.force = self.dynamics.difference(self.prescribe(k), found.y), found.lam
        self.offset[self.system.motors] = 0.0
        self.last, self.newton = found, self.newton + found.iterations
        if k in self._looks:
            self._look(k, found)

    def _look(self, k: int, found: Equilibrium) -> None:
        """See whether an equilibrium gives way, or leaves something loose; said once each."""
        d, free, now = self.dynamics, self.system.free, float(self.path.t[k])
        state = found.y, found.v, found.a, found.lam, now
        if "unstable" not in self._said and unstable_directions(d, *state, free):
            self._said["unstable"] = unstable_text(f"t = {now:.6g} s: equilibrium")
        if self.system.kinks.rows and "loose" not in self._said:
            from pinflex.levels.settled import loose_directions

            if loose := loose_directions(d, found, free, now):
                self._said["loose"] = (
                    f"t = {now:.6g} s: nothing holds what has play in {plural(loose, 'direction')}"
                    ": there the position is one of many, that of the instant before (at first "
                    "the middle of the play)."
                )

    def run(self, count: int) -> Run:
        """The first instants as a run."""
        cost: dict[str, float] = {"steps": count, "newton": self.newton}
        states = self.path.t, self.y, self.v, self.a, self.lam, self.torque
        if count < len(self._t):
            return Run(self.system, *states, cost).at(slice(0, count))
        return Run(self.system, *states, cost, warnings=tuple(self._said.values()))
