"""Towards the least time: linear programmes about runs, each held against a run of its own.

A step that a run does not confirm is taken back and tried in a smaller radius (Fletcher and Sainz
de la Maza 1989: successive linear programming with a merit function).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pinflex.actuation.path import motor_axes
from pinflex.advice.solve import solve
from pinflex.arrays import Array, IntArray
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian, frame_poses
from pinflex.mechanics.mechanism import Mechanism
from pinflex.quickest.limits import Limits, Profile, RigidPath, basis
from pinflex.quickest.programme import (
    PUSH,
    SHAKE,
    Rows,
    end_rows,
    ends_by,
    of_path,
    places,
    shake_rows,
    solved,
    torque_rows,
)
from pinflex.quickest.response import Grid, Response, Strains, platform_of, response
from pinflex.recovery.kinematics import run_of
from pinflex.results.result import Result

_ROUND = 1e-12  # of a duration: round-off
_POINTS = 4  # in an interval, at which the rigid robot's torques are held
_POOR = 0.5  # of what a step hopes for: less of it is corrected once
_BEST = 1e-5  # of the duration: a step that gains less is the last
_RIGID_STEPS, _RADII = 60, (1e-4, 0.1)
_COARSE = 0.02  # of the first shake: what matters beside a duration until it is gone
_FINER, _JUMPY = 4, 1e-5  # steps for each instant; the tolerance where acceleration jumps
_OVER = 3e-3  # of a limit: between instants and by what equal steps miss
_LEAST_ROOM, _ROOM = 1e-4, 1e-2  # of a torque limit, for what it is off between instants
_FAST = 0.9  # of it, from which that is looked at
_CLOSE = 0.5  # of a limit of stress or path, from which a step looks at it
_SLOWER, _HARD = 4, 1.5  # times that a first profile is slowed down for them, if they are beyond
_BAND, _STILL = 0.96, 0.98  # of the band: what a step aims at; what equal steps must find
RESTART = 0.05  # radius at the least, where a search begins anew
_TOO_MUCH, _HELPS = 5e-4, 0.9  # of a torque limit; share of it that a dearer one must leave
_DEARER, DEAR = 2.0, 30.0  # times as dear; the most
_CUTS, _OUT = 4, 1.01  # programmes of a step, each with rows where the last left the band
_AFTER = 40  # instants after the end, beside peaks, that a step looks at
_WORTH = 4.0  # of `close`: what a step hopes for that is tried again however often it fails
_DEAREST = 0.02  # unit of shake, in bands, below which it becomes no dearer
_LONGEST = 0.1  # by how much of itself a duration may change in a step


@dataclass(frozen=True)
class Task:
    """What is asked: displacements by name, limits, and how still the platform must be.

    Attributes:
        target, moves: Joints or platform, displacements by name [rad | m].
        limits: Of the motion.
        band: Distance from rest that the platform keeps from the end on [m].
        models: The nominal robot, then those that must be as still.
        rigid: The path of each.
        rest: Where the platform of each comes to rest [m], (models, 3).
        box: Instead of a band: distance [m] and speed [m/s] along each axis at the end.
        pushed: Whether motors push with the rigid robot's torque of a profile instead of following
            it; the box holds for each of them too [rad | m].
        strains: What finds stress and distance from the path, where they are limited.
        over: Share of limits that runs may be beyond.
    """

    target: str
    moves: dict[str, float]
    limits: Limits
    band: float
    models: tuple[Mechanism, ...]
    rigid: tuple[RigidPath, ...]
    rest: Array
    box: tuple[float, float] | None = None
    pushed: bool = False
    strains: Strains | None = None
    over: float = _OVER

    @property
    def far(self) -> Array | None:
        """Displacement of a platform whose speed is limited [m], (3,); else None."""
        far = np.array([self.moves.get(axis, 0.0) for axis in "xyz"])
        straight = self.target == "platform" and np.any(far) and not self.pushed
        return far if straight and np.isfinite(self.limits.speed) else None

    @property
    def drive(self) -> dict[str, Any]:
        """How runs have motors driven."""
        return {"drive": "torque", "kp": 0.0, "kd": 0.0} if self.pushed else {}


@dataclass(frozen=True)
class _Bent:
    """What a programme did not foresee of a step: of the arrays of a look."""

    torque: Array | float = 0.0
    rates: Array | float = 0.0
    use: Array | float = 0.0
    place: Array | float = 0.0
    ends: Array | float = 0.0


def rigid_least(rigid: RigidPath, limits: Limits, first: Profile, best: float = _BEST) -> Profile:
    """The rigid robot's least time under the limits: no inputs but poses, and fast."""
    n = first.n
    u = (np.arange(_POINTS * n) + 0.5) / (_POINTS * n)
    B = basis(first.ends, first.jumps, u)

    def torques(p: Profile) -> tuple[Array, Array]:
        return rigid.torque_by(B, p.x, p.duration)

    def cost(p: Profile, tau: Array) -> float:
        over = np.max(limits.push(tau, *rigid.turning(B, p.x, p.duration)[:2]))
        return p.duration + PUSH * first.duration * max(float(over) - 1.0, 0.0)

    now, radius = first, _RADII[1]
    tau, by = torques(now)
    worth = cost(now, tau)
    for _ in range(_RIGID_STEPS):
        rows = Rows(len(now.x))
        of_path(rows, now, limits, rigid)
        torque_rows(rows, by, tau, limits.torque.tolist())
        v, a, v_by = rigid.turning(B, now.x, now.duration)
        for curve in limits.curves:
            curve.hold(rows, tau, by, v, v_by, a)
        after, *_ = solved(rows, now, limits, radius, _LONGEST)
        new, new_by = torques(after)
        gain = worth - cost(after, new)
        radius = 2.0 * radius if gain > 0.0 else 0.3 * radius
        if gain > 0.0:
            now, tau, by, worth = after, new, new_by, worth - gain
        if radius < _RADII[0] or 0.0 <= gain < best * now.duration:
            break
    return now


@dataclass(frozen=True)
class Look:
    """A profile as runs of all models show it.

    Attributes:
        profile: Of the runs. runs: One a model.
        torque: Of the nominal model before the end, at instants and between, (samples, nm).
        place: Of each platform from rest after it, (models, instants, 3).
        ends: Of a box: each axis of platform, then of motors that push: how far from rest at the
            end and how fast, (models, axes, 2).
        rates: Of the nominal platform along a path of its places before the end, over that limit,
            (instants,). speed: Largest speed of it, likewise.
        use: Of limits of stress and path before the end, (instants, links + 1). strain: The most.
        push: Largest torque over its limit. shake: Largest distance from rest over the band.
        over: Share of limits that may be found beyond.
    """

    profile: Profile
    runs: tuple[Result, ...]
    torque: Array
    place: Array
    ends: Array
    rates: Array
    speed: float
    use: Array
    strain: float
    push: float
    shake: float
    over: float

    def cost(self, duration: float, unit: float, dear: float) -> float:
        """What the programme has as its cost: of a duration, a unit of shake, a price of torque."""
        more = SHAKE * max(self.shake - self.still, 0.0) / unit
        push = max(self.push, self.strain) - 0.5 * self.over
        more += dear * max(push - 1.0, self.speed - (1.0 + self.over), 0.0)
        return self.profile.duration / duration + more

    @property
    def still(self) -> float:
        """Share of the band, or of a box, that may be found."""
        return 1.0 if self.ends.size else _STILL

    @property
    def kept(self) -> bool:
        """Whether limits and band are."""
        most = max(self.push, self.strain, self.speed)
        return most <= 1.0 + self.over and self.shake <= self.still

    @property
    def broken(self) -> list[str]:
        """Which are not, in words; of the band all of it, not only what equal steps must find."""
        limits = (
            (self.shake, 1.0, "of what is allowed at the end"),
            (self.push, 1.0 + self.over, "of a limit of torque"),
            (self.strain, 1.0 + self.over, "of a limit of stress or path"),
            (self.speed, 1.0 + self.over, "of the limit of the platform's speed"),
        )
        return [f"takes {100 * x:.4g} % {what}" for x, most, what in limits if x > most]

    @property
    def near(self) -> IntArray:
        """Instants at which a step may reach a limit of stress or path."""
        return np.flatnonzero(np.any(self.use > _CLOSE, axis=1))


def look(
    task: Task, profile: Profile, grid: Grid, how: dict[str, Any], runs: tuple[Result, ...] = ()
) -> Look:
    """Run all models with a profile, but those of which there are `runs`."""
    motion = profile.motion(task.target, task.moves)
    runs += tuple(
        solve(model, motion, level="coupled", until=grid.until * profile.duration,
              samples=grid.samples, **task.drive, **how)
        for model in task.models[len(runs) :]
    )  # fmt: skip
    after = 2 * grid.moving
    each = [*zip(task.models, runs, task.rest, strict=True)]
    place = np.array([platform_of(model, run)[after:] - x for model, run, x in each])
    torque = runs[0].torque[1:after]
    turn = motors_of(task.models[0], runs[0], after + 1)
    push = float(np.max(task.limits.push(runs[0].torque[: after + 1], *turn)))
    if task.pushed:  # what is asked of motors is known: it is largest where an interval ends
        B = basis(profile.ends, profile.jumps, places(profile))
        asked = task.rigid[0].torque_by(B, profile.x, profile.duration)[0]
        push = float(np.max(np.abs(asked) / task.limits.torque))
    ends = np.zeros((len(runs), 0, 2))
    if task.box is None:
        shake = float(np.linalg.norm(place, axis=2).max()) / task.band
    else:
        ends = np.array([
            end_of(task, model, run, path, after, rest)
            for (model, run, rest), path in zip(each, task.rigid, strict=True)
        ])  # fmt: skip
        shake = float(np.max(np.abs(ends) / task.box))
    rates, fast = platform_speed(task, runs[0], profile.duration)
    speed = float(fast.max())
    use = np.zeros((after + 1, 0))
    if task.strains is not None:
        use = task.strains.use(task.strains.states_of(runs[0]).at(slice(after + 1)))
    strain = float(use.max(initial=0.0))
    return Look(profile, runs, torque, place[:, 1::2], ends, rates[1:after:2], speed,
                use[1:after:2], strain, push, shake, task.over)  # fmt: skip


def motors_of(model: Mechanism, run: Result, until: int | None = None) -> tuple[Array, Array]:
    """Speeds and accelerations of the motors at the first samples, or at all."""
    states, motors = run_of(model, run), model.flexible.motors
    return states.v[:until, motors], states.a[:until, motors]


def platform_speed(task: Task, run: Result, end: float) -> tuple[Array, Array]:
    """Speed of the nominal platform along the path, and all of it, until the end over that limit.

    0 where there is none.
    """
    inside = run.t <= end * (1.0 + _ROUND)
    if (far := task.far) is None:
        return np.zeros_like(run.t[inside]), np.zeros_like(run.t[inside])
    place = platform_of(task.models[0], run)[inside]
    rate = np.gradient(place, run.t[inside], axis=0) / (np.linalg.norm(far) * task.limits.speed)
    return rate @ far / np.linalg.norm(far), np.linalg.norm(rate, axis=1)


def end_of(
    task: Task, model: Mechanism, run: Result, path: RigidPath, at: int, rest: Array
) -> Array:
    """Of each axis at a sample: how far from rest and how fast, (axes, 2)."""
    states = run_of(model, run)
    y, v = states.y[at], states.v[at]
    frame, dynamics = model.frame(str(model.description.platform)), Equations(model.flexible)
    place = frame_poses(dynamics, y[None], frame)[1][0] - rest
    rate = frame_jacobian(dynamics, y, frame)[:3] @ v
    if not task.pushed:
        return np.column_stack([place, rate])
    axes = motor_axes(model)
    away = -axes.behind(axes.read(path.end), y)
    return np.column_stack([np.append(place, away), np.append(rate, v[axes.v_at])])


@dataclass
class Search:
    """Steps from a profile on.

    Attributes:
        task: What is asked. grid: Instants.
        tell: Told of every step.
        radius: Of the next step, in shares of what the numbers may be.
        unit: In which shake costs, in bands: less than that of the first look by far.
        push: What torques too much cost; dearer where that is too cheap.
        any_kept: Whether the first profile that keeps all will do.
        nearby: Responses about the last profile that a step was made from.
    """

    task: Task
    grid: Grid
    tell: Callable[[Look], None]
    radius: float = 0.05
    unit: float = 1.0
    push: float = 1.0
    any_kept: bool = False
    nearby: list[Response] = field(default_factory=list)

    def go(self, first: Profile, steps: int, close: float, runs: tuple[Result, ...] = ()) -> Look:
        """The best profile found; over when a step hopes for less than `close` of the duration.

        `runs`: of the first models with the first profile, if they are known. A search that goes
        on from another one makes its first step by what is `nearby`.
        """
        now = self._look(first, runs)
        for _ in range(_SLOWER):
            if now.strain <= _HARD:
                break
            now = self._look(replace(first, duration=now.profile.duration * now.strain**0.5))
        T = now.profile.duration
        self.unit = unit = max(1.0, _COARSE * now.shake)
        best = now if now.kept else None
        fresh = [] if self.task.strains else self.nearby  # these are about some instants alone
        old, stuck = bool(fresh), 0
        for _ in range(steps):
            if self.any_kept and best is not None:
                break
            self.tell(now)
            self.nearby = fresh = fresh or self._responses(now)
            new, foreseen = self._next(now, fresh, _Bent())
            slack = foreseen - 1.0 - (new.profile.duration / now.profile.duration - 1.0)
            hoped = now.cost(T, unit, self.push) - (new.profile.duration / T + slack)
            if now.cost(T, unit, self.push) - new.cost(T, unit, self.push) < _POOR * hoped:
                bent = self._bend(now, fresh, new)
                again, _ = self._next(now, fresh, bent)
                new = min(new, again, key=lambda x: x.cost(T, unit, self.push))
            gain = now.cost(T, unit, self.push) - new.cost(T, unit, self.push)
            if gain < 0.25 * hoped:
                self.radius *= 0.3
            elif gain > 0.7 * hoped:
                self.radius = min(2.0 * self.radius, 2.0)
            if new.kept and (best is None or new.profile.duration < best.profile.duration):
                best = new
            stuck = 0 if gain > 0.1 * hoped else stuck + 1
            now = now if stuck else new
            fresh = [] if old or not stuck else fresh
            old = False
            near = best is not None and best.profile.duration < (1.0 + close) * now.profile.duration
            over = (hoped < close and (near or best is None)) or self.radius < _RADII[0]
            if over or (stuck > 1 and near and hoped < _WORTH * close):
                if best is None and unit > _DEAREST:  # it stops short of the band: dearer shake
                    self.unit = unit = 0.1 * unit
                    stuck, self.radius = 0, RESTART
                    continue
                break
        return best or now

    def _look(self, profile: Profile, runs: tuple[Result, ...] = ()) -> Look:
        """In equal steps, whose errors limits and band leave room for; by tol across jumps."""
        how: dict[str, Any] = {"dt": profile.duration / (_FINER * self.grid.moving)}
        if self.task.limits.jumps:
            how = {"tol": _JUMPY, "asked": ("platform",)}  # torques jump
        return look(self.task, profile, self.grid, how, runs)

    def _responses(self, now: Look) -> list[Response]:
        task = self.task
        each = zip(task.models, task.rigid, now.runs, strict=True)
        pushed = task.rigid[0] if task.pushed else None
        return [
            response(
                model,
                rigid,
                run,
                now.profile,
                self.grid,
                k == 0,
                pushed,
                *((None,) if k else (task.far, task.strains, now.near)),
            )
            for k, (model, rigid, run) in enumerate(each)
        ]

    def _bend(self, now: Look, fresh: list[Response], new: Look) -> _Bent:
        """What the programme did not foresee of a step.

        Source: second-order corrections, Fletcher (1982), Math. Prog. Study 17.
        """
        step = np.append(new.profile.x - now.profile.x, new.profile.duration - now.profile.duration)
        place = np.array([now_ + (by.platform @ step)[:, :3]
                          for now_, by in zip(now.place, fresh, strict=True)])  # fmt: skip
        ends = new.ends - now.ends
        if self.task.box is not None:
            T = now.profile.duration
            h = self.grid.step * T
            ends = ends - [ends_by(by.platform, e, h, T) @ step
                           for by, e in zip(fresh, now.ends, strict=True)]  # fmt: skip
        torque = new.torque - now.torque - _between(fresh[0].torque) @ step
        rates = np.zeros(0)
        if (far := self.task.far) is not None:
            most = float(np.linalg.norm(far)) * self.task.limits.speed
            rates = new.rates - now.rates - fresh[0].rate @ step / most
        near = now.near
        use = new.use[near] - now.use[near] - fresh[0].strain @ step if len(near) else 0.0
        return _Bent(torque, rates, use, new.place - place, ends)

    def _next(self, now: Look, fresh: list[Response], bent: _Bent) -> tuple[Look, float]:
        task, limits, here = self.task, self.task.limits, now.profile
        torque, place, ends = now.torque + bent.torque, now.place + bent.place, now.ends + bent.ends
        rows, most = Rows(len(here.x)), limits.torque.tolist()
        of_path(rows, here, limits, task.rigid[0])
        if task.far is not None:
            near = np.abs(now.rates) > _FAST
            most_of = float(np.linalg.norm(task.far)) * limits.speed
            rates = (now.rates + bent.rates)[near]
            rows.both(fresh[0].rate[near] / most_of, rates, 1.0, slack=-1)
        if len(at := now.near):
            use = now.use[at] + bent.use
            between = now.strain - float(now.use.max())
            within = 1.0 - float(np.clip(between, _LEAST_ROOM, _ROOM))
            torque_rows(rows, fresh[0].strain, use, [1.0] * use.shape[1], within)
        if task.pushed:
            B = basis(here.ends, here.jumps, places(here))
            asked, by = task.rigid[0].torque_by(B, here.x, here.duration)
            torque_rows(rows, by, asked, most)
        else:
            by = _between(fresh[0].torque)
            B = basis(here.ends, here.jumps, _between(self.grid.u[: self.grid.moving]))
            v, a, v_by = task.rigid[0].turning(B, here.x, here.duration)
            seen = now.torque
            if limits.jumps:  # a torque is largest where an interval begins or ends
                by, torque, seen, v, a, v_by = (
                    np.concatenate([x[::2], _at_ends(x[::2], self.grid.each)])
                    for x in (by, torque, seen, v, a, v_by)
                )
            between = now.push - float(np.max(limits.push(seen, v, a)))
            within = 1.0 - float(np.clip(between, _LEAST_ROOM, _ROOM))
            torque_rows(rows, by, torque, most, within)
            for curve in limits.curves:
                curve.hold(rows, torque, by, v, v_by, a, within)
        for one, away, at_end in zip(fresh, place, ends, strict=True):
            if task.box is None:
                every = _instants_after(away)
                shake_rows(rows, one.platform[every], away[every], _BAND * task.band,
                                     self.unit * task.band)  # fmt: skip
            else:
                step = self.grid.step * here.duration
                by = ends_by(one.platform, at_end, step, here.duration)
                end_rows(rows, by, at_end, task.box, self.unit)
        for _ in range(_CUTS):
            after, foreseen, over = self._solved(rows, here)
            ball = (_BAND + self.unit * over[0]) * task.band
            change = np.append(after.x - here.x, after.duration - here.duration)
            if task.box is not None or not self._cut(rows, place, fresh, change, ball):
                break
        return self._look(after), foreseen

    def _solved(self, rows: Rows, here: Profile) -> tuple[Profile, float, tuple[float, float]]:
        """A step; torques too much become as dear as they must be for it to give them up.

        Source: steering of penalties, Byrd, Nocedal and Waltz (2008), Optim. Methods Softw. 23.
        """
        limits, longest = self.task.limits, min(_LONGEST, self.radius)
        found = solved(rows, here, limits, self.radius, longest, self.push)
        while found[2][1] > _TOO_MUCH and self.push < DEAR:
            again = solved(rows, here, limits, self.radius, longest, _DEARER * self.push)
            if again[2][1] > _HELPS * found[2][1]:
                break
            self.push, found = _DEARER * self.push, again
        return found

    def _cut(
        self, rows: Rows, place: Array, fresh: list[Response], step: Array, ball: float
    ) -> bool:
        """Hold |place| <= band where a step would leave the ball for its box; whether it would."""
        cut = False
        for one, away in zip(fresh, place, strict=True):
            then = away + (one.platform @ step)[:, :3]
            far = np.linalg.norm(then, axis=1)
            at = np.flatnonzero(far > _OUT * ball)
            at = np.intersect1d(at, _instants_after(then))
            toward = then[at] / far[at, None]
            rows.one(np.einsum("ki,kin->kn", toward, one.platform[at]),
                     np.einsum("ki,ki->k", toward, away[at]), _BAND * self.task.band, slack=-2,
                     unit=self.unit * self.task.band)  # fmt: skip
            cut |= bool(len(at))
        return cut


def _between(x: Array) -> Array:
    """Values at instants and, by their means, between these, (2 instants - 1, ...)."""
    found = np.repeat(x, 2, axis=0)[:-1]
    found[1::2] += 0.5 * np.diff(x, axis=0)
    return found


def _instants_after(away: Array) -> IntArray:
    """Instants after the end: some, and those at which a distance (instants, 3) is largest."""
    some, far = max(len(away) // _AFTER, 1), np.linalg.norm(away, axis=1)
    before, after = np.append(0.0, far[:-1]), np.append(far[1:], 0.0)
    peaks = np.flatnonzero((far >= before) & (far >= after))
    return np.union1d(np.arange(0, len(away), some), peaks)


def _at_ends(x: Array, each: int) -> Array:
    """Values at both ends of every interval, from the instants inside, (2 n, ...)."""
    x = x.reshape(-1, each, *x.shape[1:])
    first, last = 1.5 * x[:, 0] - 0.5 * x[:, 1], 1.5 * x[:, -1] - 0.5 * x[:, -2]
    return np.concatenate([first, last])
