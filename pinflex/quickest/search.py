"""Towards the least time: linear programmes about runs, each held against a run of its own.

A step that a run does not confirm is taken back and tried in a smaller radius (Fletcher and Sainz
de la Maza 1989: successive linear programming with a merit function).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinflex.advice.solve import solve
from pinflex.arrays import Array
from pinflex.mechanics.mechanism import Mechanism
from pinflex.quickest import programme
from pinflex.quickest.limits import Limits
from pinflex.quickest.profile import Profile, basis
from pinflex.quickest.response import Grid, Response, response
from pinflex.quickest.rigid import RigidPath
from pinflex.results.result import Result

_POINTS = 4  # in an interval, at which the rigid robot's torques are held
_BEST = 1e-5  # of the duration: a step that gains less is the last
_RIGID_STEPS, _RADII = 60, (1e-4, 0.1)
_COARSE = 0.02  # of the first shake: what matters beside a duration until it is gone
_FINER, _JUMPY = 4, 1e-5  # steps for each instant; the tolerance where acceleration jumps
_OVER = 1e-3  # of a torque limit: between instants and by what equal steps miss
_WITHIN = 0.998  # of a torque limit that a step aims at, as much as it is off between instants
_BAND = 0.97  # of the band that a step aims at
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
    """

    target: str
    moves: dict[str, float]
    limits: Limits
    band: float
    models: tuple[Mechanism, ...]
    rigid: tuple[RigidPath, ...]
    rest: Array
    box: tuple[float, float] | None = None


def rigid_least(rigid: RigidPath, limits: Limits, first: Profile) -> Profile:
    """The rigid robot's least time under the limits: no inputs but poses, and fast."""
    n = first.n
    u = (np.arange(_POINTS * n) + 0.5) / (_POINTS * n)
    B = basis(n, first.jumps, u)

    def torques(p: Profile) -> tuple[Array, Array]:
        s, v, a = B @ p.x
        T = p.duration
        tau, by_s, by_v, by_a = (x[:, :, None] for x in rigid.torque(s, v / T, a / T**2))
        by = by_s * B[0][:, None] + by_v * B[1][:, None] / T + by_a * B[2][:, None] / T**2
        slower = -(by_v[..., 0] * v[:, None] / T + 2.0 * by_a[..., 0] * a[:, None] / T**2) / T
        return tau[..., 0], np.concatenate([by, slower[:, :, None]], axis=2)

    def cost(p: Profile, tau: Array) -> float:
        over = np.max(np.abs(tau) / limits.torque)
        return p.duration + programme.PUSH * first.duration * max(float(over) - 1.0, 0.0)

    now, radius = first, _RADII[1]
    tau, by = torques(now)
    worth = cost(now, tau)
    for _ in range(_RIGID_STEPS):
        rows = programme.Rows(len(now.x))
        programme.of_path(rows, now, limits, rigid)
        programme.torque_rows(rows, by, tau, limits.torque.tolist())
        after, _ = programme.solved(rows, now, limits, radius, _LONGEST)
        new, new_by = torques(after)
        gain = worth - cost(after, new)
        radius = 2.0 * radius if gain > 0.0 else 0.3 * radius
        if gain > 0.0:
            now, tau, by, worth = after, new, new_by, worth - gain
        if radius < _RADII[0] or 0.0 <= gain < _BEST * now.duration:
            break
    return now


@dataclass(frozen=True)
class Look:
    """A profile as runs of all models show it.

    Attributes:
        profile: Of the runs. runs: One a model.
        torque: Of the nominal model before the end, (instants, nm).
        place: Of each platform from rest after it, (models, instants, 3).
        push: Largest torque over its limit. shake: Largest distance from rest over the band.
    """

    profile: Profile
    runs: tuple[Result, ...]
    torque: Array
    place: Array
    push: float
    shake: float

    def cost(self, duration: float, unit: float) -> float:
        """What the programme has as its cost, of a duration and a unit of shake in bands."""
        more = programme.SHAKE * max(self.shake - 1.0, 0.0) / unit
        more += programme.PUSH * max(self.push - 1.0, 0.0)
        return self.profile.duration / duration + more

    @property
    def kept(self) -> bool:
        """Whether limits and band are."""
        return self.push <= 1.0 + _OVER and self.shake <= 1.0


def look(task: Task, profile: Profile, grid: Grid, how: dict[str, Any]) -> Look:
    """Run all models with a profile."""
    motion, frame = profile.motion(task.target, task.moves), task.models[0].description.platform
    runs = tuple(
        solve(model, motion, level="coupled", until=grid.until * profile.duration,
              samples=grid.samples, **how)
        for model in task.models
    )  # fmt: skip
    after = 2 * grid.moving
    place = np.array([r.frame(str(frame)).position[after:] - x
                      for r, x in zip(runs, task.rest, strict=True)])  # fmt: skip
    push = np.max(np.abs(runs[0].torque[: after + 1]) / task.limits.torque)
    if task.box is None:
        shake = np.linalg.norm(place, axis=2).max() / task.band
    else:
        velocity = np.array([r.frame(str(frame)).velocity[after, :3] for r in runs])
        shake = max(np.abs(place[:, 0]).max() / task.box[0], np.abs(velocity).max() / task.box[1])
    torque = runs[0].torque[1:after:2]
    return Look(profile, runs, torque, place[:, 1::2], float(push), float(shake))


@dataclass
class Search:
    """Steps from a profile on.

    Attributes:
        task: What is asked. grid: Instants.
        tell: Told of every step.
        radius: Of the next step, in shares of what the numbers may be.
        unit: In which shake costs, in bands: less than that of the first look by far.
    """

    task: Task
    grid: Grid
    tell: Callable[[Look], None]
    radius: float = 0.1
    unit: float = 1.0

    def go(self, first: Profile, steps: int, close: float) -> Look:
        """The best profile found; over when a step hopes for less than `close` of the duration."""
        now, T = self._look(first), first.duration
        self.unit = unit = max(1.0, _COARSE * now.shake)
        best = now if now.kept else None
        fresh: list[Response] = []
        for _ in range(steps):
            self.tell(now)
            fresh = fresh or self._responses(now)
            after, foreseen = self._next(now, fresh)
            new = self._look(after)
            slack = foreseen - 1.0 - (after.duration / now.profile.duration - 1.0)
            hoped = now.cost(T, unit) - (after.duration / T + slack)
            gain = now.cost(T, unit) - new.cost(T, unit)
            if gain < 0.25 * hoped:
                self.radius *= 0.3
            elif gain > 0.7 * hoped:
                self.radius = min(2.0 * self.radius, 2.0)
            if new.kept and (best is None or new.profile.duration < best.profile.duration):
                best = new
            if gain > 0.1 * hoped:
                now, fresh = new, []
            if (hoped < close and best is not None) or self.radius < _RADII[0]:
                break
        return best or now

    def _look(self, profile: Profile) -> Look:
        """In equal steps, whose errors limits and band leave room for; by tol across jumps."""
        how: dict[str, Any] = {"dt": profile.duration / (_FINER * self.grid.moving)}
        if self.task.limits.jumps:
            how = {"tol": _JUMPY, "asked": ("platform",)}  # torques jump
        return look(self.task, profile, self.grid, how)

    def _responses(self, now: Look) -> list[Response]:
        task = self.task
        each = zip(task.models, task.rigid, now.runs, strict=True)
        return [
            response(model, rigid, run, now.profile, self.grid, k == 0)
            for k, (model, rigid, run) in enumerate(each)
        ]

    def _next(self, now: Look, fresh: list[Response]) -> tuple[Profile, float]:
        task, limits = self.task, self.task.limits
        rows = programme.Rows(len(now.profile.x))
        programme.of_path(rows, now.profile, limits, task.rigid[0])
        within = 1.0 if limits.jumps else _WITHIN
        programme.torque_rows(rows, fresh[0].torque, now.torque, limits.torque.tolist(), within)
        if limits.jumps:  # a torque is largest where an interval begins or ends
            by, at = (_at_ends(x, self.grid.each) for x in (fresh[0].torque, now.torque))
            programme.torque_rows(rows, by, at, limits.torque.tolist())
        every = slice(0, None, max(self.grid.after // 40, 1))
        for one, place in zip(fresh, now.place, strict=True):
            if task.box is None:
                programme.shake_rows(rows, one.platform[every], place[every], _BAND * task.band,
                                     self.unit * task.band)  # fmt: skip
            else:
                T = now.profile.duration
                step = self.grid.step * T
                programme.end_rows(rows, one.platform, place, step, T, task.box, self.unit)
        return programme.solved(rows, now.profile, limits, self.radius,
                                min(_LONGEST, self.radius))  # fmt: skip


def _at_ends(x: Array, each: int) -> Array:
    """Values at both ends of every interval, from the instants inside, (2 n, ...)."""
    x = x.reshape(-1, each, *x.shape[1:])
    first, last = 1.5 * x[:, 0] - 0.5 * x[:, 1], 1.5 * x[:, -1] - 0.5 * x[:, -2]
    return np.concatenate([first, last])
