"""What steps of a robot in the loop cost, one by one: before a loop is built on them."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from pinflex.actuation.drive import motor_path
from pinflex.arrays import Array, IntArray
from pinflex.boundary import public
from pinflex.errors import DescriptionError
from pinflex.integrators.plain.alpha import MAX_ITERATIONS
from pinflex.levels.modes import default_motion
from pinflex.live.simulator import Simulator
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.text import brief

_SHARES = (50.0, 99.0, 99.9, 99.99)  # percentiles
_SAME = 1e-6  # of the largest: two ends of a motion that are one
_REST = 0.2  # of the motion: at rest before it comes back


@dataclass(frozen=True)
class StepCost:
    """Thread CPU time of single steps, the call from Python among it.

    Attributes:
        name: Of the model. dt: Step [s]. steps: Their number.
        percentiles: By share of the steps [%], s. largest: Of all, s.
        empty: Largest of as many empty calls in the same run, s: what the machine adds.
        iterations: Newton iterations of a step: mean and most.
        tangents: New tangents: in all, and most of a step.
    """

    __repr__ = brief

    name: str
    dt: float
    steps: int
    percentiles: dict[float, float]
    largest: float
    empty: float
    iterations: tuple[float, int]
    tangents: tuple[int, int]


@public
@takes_model
def step_cost(
    mechanism: Mechanism,
    steps: int = 1_000_000,
    dt: float = 1e-3,
    iterations: int = MAX_ITERATIONS,
    tangents: int | None = 1,
    every: int | None = None,
) -> StepCost:
    """Cost of the steps of a robot that goes along the motion of its YAML and back, on and on.

    Args:
        mechanism: Or what `pf.load` takes.
        steps: Number of steps.
        dt: Step [s].
        iterations, tangents, every: As of `pf.Simulator`.
    Raises:
        DescriptionError, SceneError: The simulator does not take the model, or a step.
    """
    if not isinstance(steps, int) or steps < 1:
        raise DescriptionError(f"step_cost: steps: {steps}. Give a whole number, 1 or more.")
    live = Simulator(
        mechanism, dt, iterations=iterations, tangents=tangents, every=every, stops=False
    )
    path = _on_and_on(mechanism, dt)
    engine = live.reset(motion=default_motion(mechanism))._engine(True, path[:, 0])
    at, move, now = engine.kernel.at, engine.path, time.thread_time_ns
    times, counts = np.zeros((2, steps), np.int64), np.zeros((2, steps + 1), np.int64)
    counts[:, 0] = at.iterations, at.refreshed
    length = path.shape[1]
    with _undisturbed():
        for k in range(steps):
            j = k % length
            move.position[1], move.velocity[1], move.acceleration[1] = path[:, j]
            begun = now()
            taken = engine.take()
            times[0, k] = now() - begun
            if not taken:
                raise live._stuck(engine, (k + 1) * dt)
            counts[0, k + 1], counts[1, k + 1] = at.iterations, at.refreshed
        for k in range(steps):
            begun = now()
            times[1, k] = now() - begun
    return _told(mechanism.name, dt, times, np.diff(counts))


def _told(name: str, dt: float, times: IntArray, counts: IntArray) -> StepCost:
    seconds = 1e-9 * times
    shares = {p: float(np.percentile(seconds[0], p)) for p in _SHARES}
    iterations, tangents = counts
    return StepCost(
        name, dt, len(iterations), shares, float(seconds[0].max()), float(seconds[1].max()),
        (float(iterations.mean()), int(iterations.max())),
        (int(tangents.sum()), int(tangents.max())),
    )  # fmt: skip


def _on_and_on(robot: Mechanism, dt: float) -> Array:
    """Position, velocity and acceleration of the motors, (3, n, nm), again and again.

    Of a motion that comes round, as it is; else there, rest, back, rest.
    """
    motion = default_motion(robot)
    count = max(round(motion.duration / dt), 1)
    t = dt * np.arange(count + 1, dtype=np.float64)
    path = motor_path(robot, motion, t)
    there = np.array([path.position, path.velocity, path.acceleration])
    off = np.abs(there[:, -1] - there[:, 0]).max(axis=1, initial=0.0)
    if (off <= _SAME * np.abs(there).max(axis=(1, 2), initial=0.0)).all():
        return there[:, 1:]
    if np.abs(there[1, [0, -1]]).max() > _SAME * np.abs(there[1]).max():
        raise DescriptionError(
            f"{robot.name}: step_cost: its motion neither comes to rest nor round in whole steps "
            f"of {dt:g} s. Give one that does with --set, or another step."
        )
    back = there[:, ::-1] * np.array([1.0, -1.0, 1.0])[:, None, None]
    ends = [np.repeat(x[:, -1:], max(round(_REST * count), 1), axis=1) for x in (there, back)]
    for end in ends:
        end[1:] = 0.0
    return np.concatenate([there[:, 1:], ends[0], back[:, 1:], ends[1]], axis=1)


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Without garbage collections, which are no part of a step."""
    on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if on:
            gc.enable()
