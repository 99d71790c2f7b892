"""What steps of a robot in the loop cost, one by one: before a loop is built on them."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import numpy as np

from pinflex.actuation.drive import motor_path
from pinflex.arrays import Array, IntArray
from pinflex.boundary import public
from pinflex.errors import DescriptionError
from pinflex.integrators.plain.alpha import MAX_ITERATIONS
from pinflex.levels.modes import default_motion
from pinflex.live.simulator import Simulator
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.text import frozen

_SHARES = (50.0, 99.0, 99.9, 99.99)  # percentiles
_SAME = 1e-6  # of the largest: two ends of a motion that are one
_WARM = 200  # steps, after which the length of a step is known
_REST = 0.2  # of the motion: at rest before it comes back


@frozen
class StepCost:
    """Thread CPU time of single steps, the call from Python among it.

    Attributes:
        name: Of the model. dt: Step [s]. steps: Their number.
        percentiles: By share of the steps [%], s. largest: Of all, s.
        same: The same of one and the same arithmetic, about as long as a step, in turn with the
            steps: what of the rare ones is the machine's. same_largest: Its largest, s.
        empty: Largest of as many empty calls in the same run, s.
        left_alone: Largest of steps in which the system took no processor away, s; preempted:
            number of the others; faults: pages that had to be found in a step. None: unknown here.
        iterations: Newton iterations of a step: mean and most.
        tangents: New tangents: in all, and most of a step.
    """

    name: str
    dt: float
    steps: int
    percentiles: dict[float, float]
    largest: float
    same: dict[float, float]
    same_largest: float
    empty: float
    left_alone: float | None
    preempted: int | None
    faults: int | None
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
    at, move, now = engine.march.at, engine.path, time.thread_time_ns
    times, counts = np.zeros((3, steps), np.int64), np.zeros((4, steps + 1), np.int64)
    length, seen = path.shape[1], _disturbances()
    same: Callable[[], object] = _empty_call
    counts[:, 0] = at.iterations, at.refreshed, *seen()
    collects = gc.isenabled()
    gc.disable()  # garbage collections are no part of a step
    try:
        for k in range(steps):
            if k == min(_WARM, steps // 2):
                same = _arithmetic(live, float(np.median(times[0, :k])) if k else 0.0)
            move.position[1], move.velocity[1], move.acceleration[1] = path[:, k % length]
            lost = seen()
            begun = now()
            taken = engine.take()
            times[0, k] = now() - begun
            counts[2:, k + 1] = np.subtract(seen(), lost)
            if not taken:
                raise live._stuck(engine, (k + 1) * dt)
            counts[:2, k + 1] = at.iterations, at.refreshed
            begun = now()
            same()
            times[1, k] = now() - begun
            begun = now()
            times[2, k] = now() - begun
    finally:
        if collects:
            gc.enable()
    return _told(mechanism.name, dt, times, counts)


def _empty_call() -> None:
    """No arithmetic."""


def _arithmetic(live: Simulator, wanted: float) -> Callable[[], object]:
    """Poses of so many states in a row as take `wanted` ns: always the same, in compiled code."""
    joints = range(1, 2)
    count = 8
    while True:
        again = partial(live._compiled.poses, np.repeat(live.y[None], count, axis=0), joints)
        spent = []
        for _ in range(9):
            begun = time.thread_time_ns()
            again()
            spent.append(time.thread_time_ns() - begun)
        if float(np.median(spent)) >= wanted:
            return again
        count += 1 + count // 4


def _disturbances() -> Callable[[], tuple[int, int]]:
    """How often this thread lost its processor, and how often it had to wait for a page."""
    with suppress(ImportError, AttributeError):  # of Linux alone
        import resource

        of, read = resource.RUSAGE_THREAD, resource.getrusage

        def told() -> tuple[int, int]:
            usage = read(of)
            return usage.ru_nivcsw, usage.ru_minflt + usage.ru_majflt

        return told
    return lambda: (-1, -1)


def _told(name: str, dt: float, times: IntArray, counts: IntArray) -> StepCost:
    seconds: Array = np.multiply(times, 1e-9)
    shares, same = ({p: float(np.percentile(x, p)) for p in _SHARES} for x in seconds[:2])
    iterations, tangents = np.diff(counts[:2])
    known = counts[2, 0] >= 0
    switches, faults = counts[2:, 1:]
    alone = seconds[0][switches == 0]
    return StepCost(
        name, dt, len(iterations), shares, float(seconds[0].max()), same,
        float(seconds[1].max()), float(seconds[2].max()),
        float(alone.max()) if known and len(alone) else None,
        int(np.count_nonzero(switches)) if known else None, int(faults.sum()) if known else None,
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
