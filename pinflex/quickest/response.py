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
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pinflex.advice.solve import solve
from pinflex.arrays import Array, IntArray
from pinflex.description.motions.motion import Motion
from pinflex.errors import ConvergenceError
from pinflex.integrators.collocation import generalized_alpha
from pinflex.integrators.problem import Run, states_of
from pinflex.kernel.evaluate import Tangent
from pinflex.levels.quasistatic import static_equilibrium
from pinflex.linalg import lapack, saddle_matrix
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import Frame, frame_jacobian, frame_pose, frame_poses
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism
from pinflex.quickest.limits import Limits, Profile, RigidPath, basis
from pinflex.recovery.kinematics import Samples, run_of
from pinflex.recovery.links import resultants, stresses
from pinflex.results.error_bars import time_error
from pinflex.results.result import Result, peak

_NONE = np.zeros(0, np.intp)
_SMALL = 1e-5  # change of what is differenced, over itself: so much of the derivative is off
_NEAREST = 6  # Newton steps to the nearest place of a path
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

    def finer(self, parts: int) -> Grid:
        """With each step cut into so many parts."""
        return Grid(self.n, parts * self.each, parts * self.after)


class Response(NamedTuple):
    """Derivatives by the profile's numbers and, last, by its duration.

    Attributes:
        torque: Of the motors before the end, (instants, nm, numbers + 1).
        platform: Place of the platform after it, then of motors that push, (instants, axes,
            numbers + 1).
        rate: Speed of the platform along a direction before it, (instants, numbers + 1).
        strain: Of what `Strains` finds before it, at instants that are near its limits, (near,
            links + 1, numbers + 1).
    """

    torque: Array
    platform: Array
    rate: Array
    strain: Array


def response(
    mechanism: Mechanism, along: RigidPath, run: Result, profile: Profile, grid: Grid, forces: bool,
    pushed: RigidPath | None = None, far: Array | None = None, strains: Strains | None = None,
    near: IntArray = _NONE,
) -> Response:  # fmt: skip
    """Derivatives about a run of a profile; torques only where `forces`.

    `pushed`: the path of the robot whose rigid torques the motors push with. `far`: displacement of
    a platform on a straight line, (3,), along which its speed is looked at. `near`: instants at
    which `strains` are looked at.
    """
    march = _March(mechanism, along, run, profile, grid, pushed)
    march.near = near
    found = march.go(forces, far)
    if strains is None or not len(near):
        return found
    moved = (np.stack(x) for x in zip(*march.moved, strict=True))
    return found._replace(strain=strains.by(strains.states_of(run).at(2 * near + 1), *moved))


class _March:
    """The alpha family's steps of all columns at once."""

    def __init__(
        self, mechanism: Mechanism, along: RigidPath, run: Result, profile: Profile, grid: Grid,
        pushed: RigidPath | None,
    ) -> None:  # fmt: skip
        self.mechanism, self.grid, self.T = mechanism, grid, profile.duration
        self.dynamics = Equations(mechanism.flexible)
        self.scheme, self.h = generalized_alpha(_RHO), grid.step * profile.duration
        seen = run_of(mechanism, run).at(slice(1, None, 2))
        self.t, self.y, self.v, self.a, self.lam = seen.t, seen.y, seen.v, seen.a, seen.lam
        self.near: IntArray = _NONE
        self.moved: list[list[Array]] = []
        begins = np.append(profile.ends[:-1], profile.ends if profile.jumps else _NONE)
        # The duration, then numbers as they begin: what has not begun moves nothing.
        self.order = np.append(len(begins), np.argsort(begins, kind="stable"))
        self.begun = 1 + np.searchsorted(np.sort(begins), grid.u + 0.5 * grid.step, side="right")
        self.shape = np.moveaxis(basis(profile.ends, profile.jumps, grid.u), 0, 2)
        self.shape = self.shape[:, self.order[1:]]
        self.push = None if pushed is None else self._pushes(pushed, profile)
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
        from scipy.interpolate import CubicSpline

        system, grid, sc, h = self.mechanism.flexible, self.grid, self.scheme, self.h
        nv, motors, columns = system.nv, system.motors, len(self.order)
        free = np.arange(nv) if self.push is not None else system.free
        n, near = len(free), set(self.near.tolist())
        torque = np.zeros((grid.moving if forces else 0, columns, len(motors)))
        platform = self._platform()
        if self.push is not None:
            platform = np.vstack([platform, np.eye(nv)[motors]])
        place = np.zeros((grid.after, columns, len(platform)))
        rate, ahead = np.zeros((0, columns)), np.zeros((0, nv))
        if far is not None:
            size = float(np.linalg.norm(far))
            frame = self.mechanism.frame(str(self.mechanism.description.platform))
            some = np.linspace(0, grid.moving - 1, grid.n + 1).astype(int)  # as smooth as the path
            at = self.dynamics.kinematics(self.y[some], frame.joint)
            J = Frame(self.dynamics.model, frame).jacobian(at)
            ahead = np.einsum("i,kin->kn", far / size, J[:, :3])
            ahead = CubicSpline(some, ahead)(np.arange(grid.moving))
            rate = np.zeros((grid.moving, columns))
            rate[:, 1:] = size / self.T * self.shape[: grid.moving, :, 1]  # the rigid robot's
            rate[:, 0] = -np.einsum("kn,kn->k", ahead, self.v[: grid.moving]) / self.T
        every = np.zeros((4, columns, nv))  # motors that follow stay 0
        for k, now, step in self._systems(free):
            d, v, a, s = every[:, : self.begun[k]]
            load, gap = self._load(k, now)
            d += h * v + h * h * (0.5 - sc.beta) * s
            v += h * (1.0 - sc.gamma) * s
            s[:] = (-sc.alpha_m * s + sc.alpha_f * a) / (1.0 - sc.alpha_m)
            d += h * h * sc.beta * s
            v += h * sc.gamma * s
            left = (load + v @ now.C.T + d @ now.K.T).take(free, 1)
            open_by = (gap + d @ now.J.T) / (sc.beta * h * h)
            right = -np.concatenate([left, open_by], axis=1)
            x = lapack().dgetrs(*step, right.T, overwrite_b=1)[0].T
            ds, lam = np.zeros_like(d), x[:, n:]
            ds[:, free] = x[:, :n]
            s += ds
            a[:] = sc.mass_factor * ds
            d += h * h * sc.beta * ds
            v += h * sc.gamma * ds
            if k < len(rate):
                rate[k, : len(v)] += v @ ahead[k]
            if k in near:
                self.moved.append(self._whole(k, every[0], every[1], every[2], lam))
            if k >= grid.moving:
                place[k - grid.moving] = d @ platform.T
            elif forces and self.push is not None:
                torque[k] = self.push[k]
            elif forces:
                M, C, K, J = (x[..., motors] for x in (now.M.T, now.C.T, now.K.T, now.J))
                torque[k, : len(d)] = load[:, motors] + a @ M + v @ C + d @ K - lam @ J
        back = np.argsort(self.order)
        torque, place = (np.swapaxes(x[:, back], 1, 2) for x in (torque, place))
        self.moved = [[x[back].T for x in one] for one in self.moved]
        return Response(torque, place, rate[:, back], np.zeros((0, 0, columns)))

    def _whole(self, k: int, d: Array, v: Array, a: Array, lam: Array) -> list[Array]:
        """Changes of all coordinates, speeds, accelerations and multipliers at an instant."""
        found, slower = [], (0.0, self.v[k] / self.T, 2.0 * self.a[k] / self.T)
        for own, less, rigid in zip((d, v, a), slower, reversed(self.rigid), strict=True):
            change = own.copy()
            change[0] -= less
            if self.push is None:
                change[1:, : rigid.shape[1]] += self.shape[k] @ rigid[k].T
            found.append(change)
        multipliers = np.zeros((len(d), lam.shape[1]))
        multipliers[: len(lam)] = lam
        return [*found, multipliers]

    def _load(self, k: int, now: Tangent) -> tuple[Array, Array]:
        """Of instant k: forces (begun, nv), and by how much closures open (begun, rows)."""
        begun = self.begun[k]
        load, gap = np.zeros((begun, len(now.M))), np.zeros((begun, len(now.J)))
        load[0] = -(now.M @ (2.0 * self.a[k]) + now.C @ self.v[k]) / self.T
        if self.push is not None:
            if k < len(self.push):
                load[:, self.mechanism.flexible.motors] -= self.push[k, :begun]
            return load, gap
        j, shape = min(k, self.grid.moving), self.shape[k, : begun - 1]
        n = self.rigid[0].shape[1]
        a, v, q = (x[j] for x in self.rigid)
        load[1:] = shape @ (now.M[:, :n] @ a + now.C[:, :n] @ v + now.K[:, :n] @ q).T
        gap[1:] = shape @ (now.J[:, :n] @ q).T
        return load, gap

    def _pushes(self, path: RigidPath, profile: Profile) -> Array:
        """Torques by duration and numbers, in the mean of every step, (moving, numbers + 1, nm)."""
        u, jumps = np.linspace(0.0, 1.0, self.grid.moving + 1), profile.jumps
        v = basis(profile.ends, jumps, u)[1]
        B = basis(profile.ends, jumps, self.grid.u[: self.grid.moving])
        B[2] = np.diff(v, axis=0) / self.grid.step  # an acceleration may jump inside a step
        by = path.torque_by(B, profile.x, profile.duration)[1]
        return np.swapaxes(by[:, :, self.order], 1, 2)

    def _platform(self) -> Array:
        """How the platform's place moves with all coordinates at the end, shape (3, nv)."""
        frame = self.mechanism.frame(str(self.mechanism.description.platform))
        return np.asarray(frame_jacobian(self.dynamics, self.y[-1], frame)[:3])

    def _systems(self, free: IntArray) -> Iterator[tuple[int, Tangent, list[Array]]]:
        """Instant by instant: its number, its system, and the LU factors of its step."""
        grid = self.grid
        for k in range(grid.moving + 1):  # the last one stands for all at rest
            state = self.y[k], self.v[k], self.a[k], self.lam[k], float(self.t[k])
            now = self.dynamics.tangent(*state)
            *step, info = lapack().dgetrf(self._step(now, free), overwrite_a=1)
            if info:
                raise np.linalg.LinAlgError(f"dgetrf: info {info}")
            if k < grid.moving:
                yield k, now, step
        for k in range(grid.moving, grid.moving + grid.after):
            yield k, now, step

    def _step(self, now: Tangent, free: IntArray) -> Array:
        by_a, by_v, by_d = self.scheme.weights(self.h)
        S = by_a * now.M + by_v * now.C + by_d * now.K
        return saddle_matrix(S.take(free, 0).take(free, 1), now.J.take(free, 1))  # quicker than []


class Strains:
    """How much of the limits of stress and path a run of the nominal robot uses.

    The path is where the platform would rest along the way: sag is none of it.
    """

    def __init__(self, mechanism: Mechanism, limits: Limits, along: RigidPath) -> None:
        from scipy.interpolate import CubicSpline

        self.mechanism, self.limits = mechanism, limits
        self.dynamics = Equations(mechanism.flexible)
        self.frame = mechanism.frame(str(mechanism.description.platform))
        self.names = [f"stress of {link}" for link in mechanism.parts] + ["distance from the path"]
        self._most = np.append(limits.stress, limits.path)
        still = [static_equilibrium(mechanism, q) for q in along.poses]
        s = np.linspace(0.0, 1.0, len(still))
        y, v, a, lam = (np.array([getattr(x, k) for x in still]) for k in ("y", "v", "a", "lam"))
        self._path = CubicSpline(s, frame_poses(self.dynamics, y, self.frame)[1])
        torque = np.zeros((len(s), len(along.motors)))
        self.resting = Run(mechanism.flexible, s, y, v, a, lam, torque, {})

    def states_of(self, run: Result) -> Run:
        """The states of a run."""
        return run_of(self.mechanism, run)

    def use(self, run: Run) -> Array:
        """Share of each limit at the instants of a run, shape (nt, links + 1)."""
        found = np.zeros((len(run.t), len(self._most)))
        if np.any(np.isfinite(self.limits.stress)):
            found[:, :-1] = np.column_stack([*worst_stress(self.mechanism, run).values()])
        if np.isfinite(self.limits.path):
            found[:, -1] = np.linalg.norm(self._away(run.y), axis=1)
        return np.asarray(found / self._most)

    def by(self, run: Run, *moved: Array) -> Array:
        """Derivatives of `use` by numbers by which (y, v, a, multipliers) move, by differences.

        `moved`: (nt, nv or rows, numbers). Returns shape (nt, links + 1, numbers).
        """
        y, v, a, lam = (np.swapaxes(x, 1, 2) for x in moved)  # (nt, numbers, nv)
        n, size = y.shape[1], np.abs(a).max(axis=(0, 2))
        step = _SMALL * np.abs(run.a).max() / np.where(size > 0.0, size, np.inf)
        again = np.repeat(np.arange(len(run.t)), n)
        then = run.at(again)

        def rows(x: Array) -> Array:
            return np.asarray((step[:, None] * x).reshape(len(again), x.shape[2]))

        place = Manifold(self.dynamics).retract(then.y, rows(y))
        v, a, lam = then.v + rows(v), then.a + rows(a), then.lam + rows(lam)
        then = replace(then, y=place, v=v, a=a, lam=lam)
        change = self.use(then) - self.use(run)[again]
        by = change / np.tile(np.where(step > 0.0, step, np.inf), len(run.t))[:, None]
        return np.swapaxes(by.reshape(len(run.t), n, -1), 1, 2)

    def _away(self, y: Array) -> Array:
        """From the nearest place of the path, (nt, 3)."""
        place = frame_poses(self.dynamics, y, self.frame)[1]
        rough = self.resting.t
        apart = np.linalg.norm(place[:, None] - self._path(rough), axis=2)
        s = rough[np.argmin(apart, axis=1)]
        for _ in range(_NEAREST):
            off, along = place - self._path(s), self._path(s, 1)
            s = np.clip(s + np.sum(off * along, axis=1) / np.sum(along**2, axis=1), 0.0, 1.0)
        return np.asarray(place - self._path(s))


def worst_stress(mechanism: Mechanism, run: Run) -> dict[str, Array]:
    """Largest von Mises stress of each flexible link, of sections and meshes [Pa], (nt,) each."""
    meshes, found = dict[str, Array](), dict[str, Array]()
    for link, forces in resultants(Samples(mechanism, run), meshes).items():
        worst = stresses(mechanism.parts[link].spec.section, forces)["von_mises"].max(axis=1)
        mesh = meshes.get(f"link/{link}/mesh/von_mises")
        found[link] = worst if mesh is None else np.maximum(worst, mesh.max(axis=1))
    return found


def rest_of(mechanism: Mechanism, pose: Array) -> Array:
    """Where the platform rests when the rigid robot would at a pose, shape (3,)."""
    found = static_equilibrium(mechanism, pose)
    frame = mechanism.frame(str(mechanism.description.platform))
    dynamics = Equations(mechanism.flexible)
    return np.array(frame_pose(dynamics, found.y, frame).translation)


def platform_of(mechanism: Mechanism, run: Result) -> Array:
    """Places of the platform [m], (nt, 3), without what accelerations at samples take."""
    frame = mechanism.frame(str(mechanism.description.platform))
    return frame_poses(Equations(mechanism.flexible), states_of(run)[0], frame)[1]


# How long a platform shakes after a motion, by a coupled run.

_EQUAL = 16000, 32000
_WATCHED = 6.0  # longest periods after the end
_SAMPLES = 24  # a period: what lies between is 1 % higher at the most
_FEWER = 4  # of them tell how far from rigid a run is


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
    samples = _FEWER * int(np.clip(_SAMPLES * until / period, 1200, 6000) / _FEWER) + 1
    told: dict[str, Any] = {"until": until, "samples": samples, "level": "coupled"}
    told |= how or {}
    try:
        run = solve(mechanism, motion, tol=tol, **told)
        half = None
    except ConvergenceError:  # jumps of an acceleration: steps that end there, and twice as many
        half, run = (solve(mechanism, motion, dt=end / steps, **told) for steps in _EQUAL)
    place = platform_of(mechanism, run)
    away = np.linalg.norm(place - rest, axis=1)
    out = np.flatnonzero(away > band)
    last = int(out[-1]) + 1 if len(out) else 0
    time = float(run.t[last]) if last < len(run.t) else np.inf
    after = away[run.t >= end * (1.0 - 1e-12)]
    some, share = place[::_FEWER], 1.0
    if half is None:
        rigid = solve(mechanism, motion, level="rigid", until=until, samples=len(some))
        other = rigid.frame(str(mechanism.description.platform)).position
        wrong = time_error(run.meta.get("settings", {}), run.level)[0]
        share = wrong.get("platform position", 0.0)
    else:
        other = platform_of(mechanism, half)[::_FEWER]
    bar = share * peak(np.linalg.norm(some - other, axis=1))
    return Settled(time, float(after.max(initial=0.0)), float(bar), run)
