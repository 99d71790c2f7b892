"""What a profile's numbers and its duration change: torques along it, the platform behind it.

About a run of the flexible robot, in scaled time u = t/T:

    M dv' + C dv + K dy - J' dlam = 0,    J dy = 0

with dy the rigid robot's change, which a change ds of the profile makes, and what links and joints
add. A change of T at the same s(u) makes rates smaller: dr = -(2 M a + C v) dT/T. M, C, K and J are
those of every instant of the run. All numbers are marched at once.

Where motors push with the rigid robot's torque tau(s, s', s'') instead, they are free too, and the
change of that torque is the load.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pinflex.advice.solve import solve
from pinflex.arrays import Array, IntArray
from pinflex.description.motions.motion import Motion
from pinflex.errors import ConvergenceError
from pinflex.integrators.collocation import generalized_alpha
from pinflex.kernel.evaluate import entries_of, linear_systems
from pinflex.linalg import lapack, saddle_matrix
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import Frame, frame_jacobian
from pinflex.mechanics.mechanism import Mechanism
from pinflex.quickest.limits import Profile, RigidPath, basis
from pinflex.results.error_bars import time_error
from pinflex.results.result import Result, peak

_WINDOW = 48  # instants whose matrices are held at a time: 10 MB of a delta's
_RHO = 0.7  # steps resolve the modes that shake, and let faster ones die


@dataclass(frozen=True)
class Grid:
    """Instants of scaled time: `each` inside every interval, and `after` its end.

    Ends of intervals, where acceleration may jump, lie in the middle between two of them: what a
    scheme of second order makes of a jump is right there.
    """

    n: int
    each: int
    after: int

    @property
    def step(self) -> float:
        """Of u."""
        return 1.0 / (self.n * self.each)

    @property
    def u(self) -> Array:
        """Shape (n each + after,)."""
        return np.asarray((np.arange(self.moving + self.after) + 0.5) * self.step)

    @property
    def moving(self) -> int:
        """Instants before the end."""
        return self.n * self.each

    @property
    def samples(self) -> int:
        """Of a run up to `until` T: at the start, in the middle of steps and between them."""
        return 2 * (self.moving + self.after) + 1

    @property
    def until(self) -> float:
        """End of such a run, of T."""
        return (self.moving + self.after) * self.step


class Response(NamedTuple):
    """Derivatives by the profile's numbers and, last, by its duration.

    Attributes:
        torque: Of the motors before the end, (instants, nm, numbers + 1).
        platform: Place of the platform after it, then of motors that push, (instants, axes,
            numbers + 1).
        rate: Speed of the platform along a direction before it, (instants, numbers + 1).
    """

    torque: Array
    platform: Array
    rate: Array


class _System(NamedTuple):
    """The linear system at one instant, in all coordinates."""

    M: Array
    C: Array
    K: Array
    J: Array


def response(
    mechanism: Mechanism, along: RigidPath, run: Result, profile: Profile, grid: Grid, forces: bool,
    pushed: RigidPath | None = None, far: Array | None = None,
) -> Response:  # fmt: skip
    """Derivatives about a run of a profile; torques only where `forces`.

    `pushed`: the path of the robot whose rigid torques the motors push with. `far`: displacement of
    a platform on a straight line, (3,), along which its speed is looked at.
    """
    return _March(mechanism, along, run, profile, grid, pushed).go(forces, far)


def states(run: Result) -> tuple[Array, Array, Array]:
    """Coordinates, velocities and accelerations of all freedoms at the samples."""
    y, v, a = (
        np.hstack([run.array(key) for key in (rigid, elastic) if key in run.arrays])
        for rigid, elastic in (("joint/q", "eta"), ("joint/v", "eta_v"), ("joint/a", "eta_a"))
    )
    return y, v, a


class _March:
    """The alpha family's steps of all columns at once."""

    def __init__(
        self, mechanism: Mechanism, along: RigidPath, run: Result, profile: Profile, grid: Grid,
        pushed: RigidPath | None,
    ) -> None:  # fmt: skip
        self.mechanism, self.grid, self.T = mechanism, grid, profile.duration
        self.dynamics = Equations(mechanism.flexible)
        self.scheme, self.h = generalized_alpha(_RHO), grid.step * profile.duration
        at = slice(1, None, 2)
        self.y, self.v, self.a = (x[at] for x in states(run))
        self.push = None if pushed is None else self._pushes(pushed, profile)
        self.t, self.lam = run.t[at], run.array("multiplier")[at]
        self.shape = basis(profile.ends, profile.jumps, grid.u)
        s, v, a = basis(profile.ends, profile.jumps, grid.u[: grid.moving + 1]) @ profile.x
        first, second, third = along(s)
        v, a, T = v[:, None], a[:, None], self.T
        # rigid acceleration, velocity and place by (s, ds/du, d^2s/du^2)
        self.rigid = (
            np.stack([second * a + third * v**2, 2.0 * second * v, first], axis=2) / T**2,
            np.stack([second * v, first, 0.0 * first], axis=2) / T,
            np.stack([first, 0.0 * first, 0.0 * first], axis=2),
        )

    def go(self, forces: bool, far: Array | None) -> Response:
        """March."""
        system, grid, sc, h = self.mechanism.flexible, self.grid, self.scheme, self.h
        free, motors = system.free, system.motors
        if self.push is not None:
            free = np.arange(system.nv)
        n, numbers = len(free), self.shape.shape[2]
        torque = np.zeros((grid.moving if forces else 0, len(motors), numbers + 1))
        platform = self._platform()[:, free]
        if self.push is not None:
            platform = np.vstack([platform, np.eye(system.nv)[motors]])
        place = np.zeros((grid.after, len(platform), numbers + 1))
        rate, ahead = np.zeros((0, numbers + 1)), np.zeros((0, n))
        if far is not None:
            size = float(np.linalg.norm(far))
            frame = self.mechanism.frame(str(self.mechanism.description.platform))
            here = self.dynamics.kinematics(self.y[: grid.moving])
            J = Frame(self.dynamics.model, frame).jacobian(here)[:, :3, free]
            ahead = np.einsum("i,kin->kn", far / size, J)
            rate = np.zeros((grid.moving, numbers + 1))
            rate[:, :-1] = size / self.T * self.shape[1, : grid.moving]  # the rigid robot's
            rate[:, -1] = -np.einsum("kn,kn->k", ahead, self.v[: grid.moving, free]) / self.T
        d, v, a, s = (np.zeros((n, numbers + 1)) for _ in range(4))
        for k, now, step in self._systems(free):
            M, C, K, J = (now.M[:, free], now.C[:, free], now.K[:, free], now.J[:, free])
            load, gap = self._load(k, now)
            d = d + h * v + h * h * (0.5 - sc.beta) * s
            v = v + h * (1.0 - sc.gamma) * s
            s = (-sc.alpha_m * s + sc.alpha_f * a) / (1.0 - sc.alpha_m)
            d, v = d + h * h * sc.beta * s, v + h * sc.gamma * s
            right = np.empty((n + len(gap), numbers + 1), order="F")
            right[:n] = -(load[free] + C[free] @ v + K[free] @ d)
            right[n:] = -(gap + J @ d) / (sc.beta * h * h)
            x, _ = lapack().dgetrs(*step, right, overwrite_b=1)
            ds, lam = x[:n], x[n:]
            s, a = s + ds, sc.mass_factor * ds
            d, v = d + h * h * sc.beta * ds, v + h * sc.gamma * ds
            if k < len(rate):
                rate[k] += ahead[k] @ v
            if k >= grid.moving:
                place[k - grid.moving] = platform @ d
            elif forces and self.push is not None:
                torque[k] = self.push[k]
            elif forces:
                torque[k] = load[motors] + M[motors] @ a + C[motors] @ v + K[motors] @ d
                torque[k] -= now.J[:, motors].T @ lam
        return Response(torque, place, rate)

    def _load(self, k: int, now: _System) -> tuple[Array, Array]:
        """Of instant k: forces (nv, numbers + 1), and by how much closures open (rows, same)."""
        slower = -(2.0 * now.M @ self.a[k] + now.C @ self.v[k]) / self.T
        if self.push is not None:
            numbers = self.push.shape[2]
            load = np.zeros((len(slower), numbers))
            load[:, -1] = slower
            if k < len(self.push):
                load[self.mechanism.flexible.motors] -= self.push[k]
            return load, np.zeros((len(now.J), numbers))
        j, shape = min(k, self.grid.moving), self.shape[:, k]
        n = self.rigid[0].shape[1]
        a, v, q = (x[j] for x in self.rigid)
        by_number = (now.M[:, :n] @ a + now.C[:, :n] @ v + now.K[:, :n] @ q) @ shape
        opened = (now.J[:, :n] @ q) @ shape
        return np.column_stack([by_number, slower]), np.column_stack([opened, 0.0 * opened[:, :1]])

    def _pushes(self, path: RigidPath, profile: Profile) -> Array:
        """Torques by numbers and duration, in the mean of every step, (moving, nm, numbers + 1)."""
        u, jumps = np.linspace(0.0, 1.0, self.grid.moving + 1), profile.jumps
        v = basis(profile.ends, jumps, u)[1]
        B = basis(profile.ends, jumps, self.grid.u[: self.grid.moving])
        B[2] = np.diff(v, axis=0) / self.grid.step  # an acceleration may jump inside a step
        return path.torque_by(B, profile.x, profile.duration)[1]

    def _platform(self) -> Array:
        """How the platform's place moves with all coordinates at the end, shape (3, nv)."""
        frame = self.mechanism.frame(str(self.mechanism.description.platform))
        return np.asarray(frame_jacobian(self.dynamics, self.y[-1], frame)[:3])

    def _systems(self, free: IntArray) -> Iterator[tuple[int, _System, list[Array]]]:
        """Instant by instant: its number, its system, and the LU factors of its step."""
        grid = self.grid
        for start in range(0, grid.moving + 1, _WINDOW):
            every = self._tangents(slice(start, min(start + _WINDOW, grid.moving + 1)))
            for i, now in enumerate(every):
                *step, info = lapack().dgetrf(self._step(now, free), overwrite_a=1)
                if info:
                    raise np.linalg.LinAlgError(f"dgetrf: info {info}")
                if start + i < grid.moving:
                    yield start + i, now, step
        for k in range(grid.moving, grid.moving + grid.after):
            yield k, now, step

    def _step(self, now: _System, free: IntArray) -> Array:
        by_a, by_v, by_d = self.scheme.weights(self.h)
        S = by_a * now.M + by_v * now.C + by_d * now.K
        return saddle_matrix(S[np.ix_(free, free)], now.J[:, free])

    def _tangents(self, some: slice) -> list[_System]:
        """The systems at some instants of the run; the last one stands for all at rest."""
        dynamics, n = self.dynamics, self.mechanism.flexible.nv
        t, y, v, a, lam = (x[some] for x in (self.t, self.y, self.v, self.a, self.lam))
        compiled = dynamics.compiled
        if compiled is None:
            found = [
                dynamics.tangent(*x[:4], float(x[4])) for x in zip(y, v, a, lam, t, strict=True)
            ]
            return [self._damped(_System(*x), y[i]) for i, x in enumerate(found)]
        rows, all_ = lam.shape[1], np.arange(n)
        at = entries_of("MCKJ", n, rows, all_, all_)
        result = np.empty((len(t), len(at)))
        linear_systems(compiled.evaluator, (y, v, a, lam, compiled.scale(t)), at, result)
        square = result[:, : 3 * n * n].reshape(-1, 3, n, n)
        J = result[:, 3 * n * n :].reshape(len(t), rows, n)
        return [self._damped(_System(x[0], x[1], x[2], J[i]), y[i]) for i, x in enumerate(square)]

    def _damped(self, now: _System, y: Array) -> _System:
        alpha, beta = self.mechanism.description.system_damping
        if not (alpha or beta):
            return now
        more = alpha * now.M + beta * self.dynamics.structural_stiffness(y)
        return now._replace(C=now.C + more)


# How long a platform shakes after a motion, by a coupled run.

_EQUAL = 16000, 32000
_WATCHED = 6.0  # longest periods after the end
_SAMPLES = 24  # a period: what lies between is 1 % higher at the most


@dataclass(frozen=True)
class Settled:
    """A run, and when it is still.

    Attributes:
        time: From which the platform stays within the band, of what the run shows [s].
        residual: Largest distance from rest after the end [m]. bar: What that may be wrong by.
        run: It.
    """

    time: float
    residual: float
    bar: float
    run: Result


def settled(
    mechanism: Mechanism, motion: Motion, rest: Array, band: float, end: float, period: float,
    tol: float, until: float | None = None, how: Mapping[str, Any] | None = None,
) -> Settled:  # fmt: skip
    """Run a motion that ends at `end` [s], `how` as `solve` takes it, and watch the platform."""
    until = until or end + _WATCHED * period
    samples = int(np.clip(_SAMPLES * until / period, 1200, 6000)) + 1
    told: dict[str, Any] = {"until": until, "samples": samples, "level": "coupled"}
    told |= how or {}
    try:
        run = solve(mechanism, motion, tol=tol, **told)
        wrong, half = time_error(run.meta.get("settings", {}), run.level)[0], None
    except ConvergenceError:  # jumps of an acceleration: steps that end there, and twice as many
        half, run = (solve(mechanism, motion, dt=end / steps, **told) for steps in _EQUAL)
        wrong = {}
    frame = str(mechanism.description.platform)
    away = np.linalg.norm(run.frame(frame).position - rest, axis=1)
    out = np.flatnonzero(away > band)
    last = int(out[-1]) + 1 if len(out) else 0
    time = float(run.t[last]) if last < len(run.t) else np.inf
    after = away[run.t >= end * (1.0 - 1e-12)]
    if half is None:
        rigid = solve(mechanism, motion, level="rigid", until=until, samples=samples)
        bar = wrong.get("platform position", 0.0) * peak(run.deviation_from(rigid, frame).norm)
    else:
        bar = peak(run.deviation_from(half, frame).norm)
    return Settled(time, float(after.max(initial=0.0)), float(bar), run)
