"""A run of collocation steps on the compiled kernel: the loop of `pinflex.integrators.march` in C.

Python is asked where the kernel cannot know: motions and loads without a table, and what the keeper
of the steps says after each batch.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, overload

import numpy as np

from pinflex.actuation.drive import MotorPath, TorqueDrive
from pinflex.arrays import Array, IntArray
from pinflex.errors import PinflexError, SceneError
from pinflex.integrators.prescribed import tabulated
from pinflex.integrators.radau import Stages
from pinflex.integrators.stage_newton import Tangent
from pinflex.integrators.stages import StageEquations, Start, Step
from pinflex.integrators.step_control import GROWTH, HELD, SHORTEST, TOGETHER, stops_of, stuck
from pinflex.integrators.steps import States
from pinflex.kernel.march import (
    FULL,
    HOLDS,
    INPUTS,
    ON,
    RESTARTS,
    SAMPLE,
    START,
    STUCK,
    Marched,
    MarchKernel,
    Table,
    no_table,
)

_PATIENCE = 0.2  # s: so long the kernel marches on before signals are looked at
_RECORDED = 64  # steps of a batch that nobody judges
_ANY = 1e6  # coarseness of a step, where its length is given: more than any
_POINT = ("t", "h", "ceiling", "before", "refused", "scale", "number", "stop", "follows")
STATE = ("y", "v", "a", "lam", "torque")
_COPIED = (
    *("t", "y0", "v0", "a0", "lam0", "torque0", "h", "coarseness", "rate"),
    *("move", "turn", "a", "lam", "torque", "power", "position", "velocity"),
)


class CompiledSteps:
    """The steps of one method on the kernel, with what is prescribed in the run.

    Attributes:
        kernel: Their arrays. of: The method. table: What is prescribed, or None.
        tangents: Kernel of the run whose tangents they were solved by.
    """

    def __init__(
        self,
        of: StageEquations,
        marched: Marched,
        table: Table | None,
        room: tuple[int, int],
        tangents: MarchKernel | None = None,
    ) -> None:
        """`marched`: what the kernel has to know; `room`: steps of a batch, and tangents."""
        assert of.compiled is not None
        self.of, self._compiled, self.table = of, of.compiled, table
        n = of.compiled.kernel.counts
        table = table or no_table(3 * n["motors"] + n["forces"])
        self.kernel = of.compiled.march(marched, table, room)
        self.tangents = tangents or self.kernel

    def inputs(self, t: Array, seen: Array | None = None) -> Array:
        """Motors' position, velocity, acceleration (or torque) and shares of loads, (k, n).

        Args:
            t: Times in s. seen: Those of stages as loads see them, see `StageEquations.seen`.
        """
        scale, drive = self._compiled.compiled.scale, self.of.drive
        if seen is None:
            return _inputs(self.of.path(t), scale(t), drive)
        return _inputs(self.of.prescribed(t), scale(seen), drive)

    def batch(self) -> Batch:
        """The steps of the last call."""
        return Batch(self, int(self.kernel.at.count))

    def samples(self, t: Array, of: IntArray, room: States) -> None:
        """Read off states.

        Args:
            t: Times in s, shape (k,). of: The step of the batch that each lies in, shape (k,).
            room: Where the states go.
        """
        self.kernel.samples(t, of + 1, None if self.table else self.inputs(t), room)

    def works(self, count: int) -> Array:
        """Work of the motors and of the damping in each step, J, shape (count, 2)."""
        found, at = self.kernel.steps, slice(1, count + 1)
        return np.asarray(found["h"][at, None] * (self.of.method.A[-1] @ found["power"][at]))

    def step(self, k: int, arrays: Mapping[str, Array], tangent: Tangent) -> Step:
        """The k-th step of a batch, of copies of its arrays."""
        at = {name: arrays[name][k] for name in _COPIED}
        start = Start(float(at["t"]), *(at[f"{name}0"] for name in STATE))
        h, a = float(at["h"]), at["a"]
        prescribed = a[:, self.of.motors]
        times = start.t + h * self.of.method.c
        return Step(
            start, h, at["move"], at["turn"], a, at["lam"], at["torque"], at["power"],
            float(at["coarseness"]), MotorPath(times, at["position"], at["velocity"], prescribed),
            tangent, float(at["rate"]),
        )  # fmt: skip

    def tangent(self, slot: int) -> Tangent:
        """A copy of one that steps were solved by."""
        nv, rows = self.kernel.v.size, self.kernel.lam.size
        flat = self.tangents.tangents[slot].copy()
        M, C, K = flat[: 3 * nv * nv].reshape(3, nv, nv)
        J = flat[3 * nv * nv :].reshape(rows, nv)
        return Tangent(M, C, K, J, self.of.free, self.of.motors)


def steps_of(
    stages: Stages,
    ends: tuple[float, float],
    breaks: Sequence[float],
    room: tuple[int, int],
    instants: Sequence[float] = (),
    given: Sequence[float] = (),
) -> CompiledSteps:
    """The steps of a run from its start to its end (s), some of them ending at breaks (s).

    `instants`: ends too, where a digital controller acts (s). `given`: ends and nothing else (s).
    """
    stops, every = stops_of(ends, breaks), stops_of(ends, (*breaks, *instants, *given))
    assert stages.compiled is not None
    system, compiled, m = stages.dynamics.system, stages.compiled.compiled, stages.method
    drive = stages.drive
    n, forces = len(system.motors), stages.compiled.kernel.counts["forces"]

    def inputs(t: Array) -> Array:
        return _inputs(stages.path(t), compiled.scale(t), drive)

    widths = np.cumsum([0, n, n, n, forces])
    kinds = [slice(*pair) for pair in pairwise(widths)]
    weight = stages.dynamics.strain.stiffness if stages.by_energy else None
    close = SHORTEST * (ends[1] - ends[0])
    kind = np.full(len(every), ON)
    for what, at in ((HOLDS, instants), (RESTARTS, stops)):
        kind[_apart(np.array(every), np.array(at)) <= close] = what
    marched = Marched(*m.monomials, m.last, stages.measured_rows, weight, every, kind)
    made_of, table = stages.compiled.table
    asked_for = (stages.motion, drive and drive.forward, *ends, *stops)
    # A load that switches is another at the end of one step than at the start of the next.
    if not system.loads.timed and made_of != asked_for:
        table = None
        with contextlib.suppress(SceneError):  # somewhere on the way: as far as it can
            table = tabulated(inputs, kinds, *ends, stops)
        stages.compiled.table = asked_for, table
    return CompiledSteps(stages, marched, table, room)


def _apart(t: Array, others: Array) -> Array:
    """How far times are from the nearest of others, s."""
    at = np.concatenate([[-np.inf], np.sort(others), [np.inf]])
    after = np.searchsorted(at, t)
    return np.asarray(np.minimum(at[after] - t, t - at[after - 1]))


def _inputs(path: MotorPath, scale: Array, drive: TorqueDrive | None) -> Array:
    feed = path.acceleration if drive is None else drive.forward(path.t)
    return np.concatenate([path.position, path.velocity, feed, scale], axis=1)


class Batch(Sequence[Step]):
    """Steps that the kernel has made, until it makes others: read them off before.

    A slice from the first one on is a batch too.
    """

    def __init__(self, made: CompiledSteps, size: int, whole: Batch | None = None) -> None:
        self.made, self._size, self._whole = made, size, whole
        self._arrays: dict[str, Array] = {}
        self._found: dict[int, Step] = {}
        self._tangents: dict[int, Tangent] = {}

    def __len__(self) -> int:
        return self._size

    @overload
    def __getitem__(self, k: int) -> Step: ...
    @overload
    def __getitem__(self, k: slice) -> Sequence[Step]: ...
    def __getitem__(self, k: int | slice) -> Step | Sequence[Step]:
        if isinstance(k, slice):
            begin, end, every = k.indices(self._size)
            if begin == 0 and every == 1:
                return Batch(self.made, end, self._whole or self)
            return [self[i] for i in range(begin, end, every)]
        k = range(self._size)[k]
        if self._whole is not None:
            return self._whole[k]
        if k not in self._found:
            self._found[k] = self._step(k)
        return self._found[k]

    def _step(self, k: int) -> Step:
        if not self._arrays:
            steps, room = self.made.kernel.steps, self._size + 1
            self._arrays = {name: steps[name][:room].copy() for name in _COPIED}
        kernel = self.made.kernel
        slot = int(kernel.integers["tangent"][k + 1])
        if kernel.at.tangents == 1 and kernel.integers["serial"][k + 1] != kernel.at.refreshed:
            raise PinflexError("compiled steps: a tangent that was not kept.")
        if slot not in self._tangents:
            self._tangents[slot] = self.made.tangent(slot)
        return self.made.step(k + 1, self._arrays, self._tangents[slot])

    @property
    def spans(self) -> tuple[Array, Array]:
        """Starts and lengths of the steps, s, shape (k,) each."""
        found, at = self.made.kernel.steps, slice(1, self._size + 1)
        return found["t"][at], found["h"][at]


class CompiledMarch:
    """The steps of one run, as `pinflex.integrators.march` asks for them.

    Attributes:
        stages: The method. steps: Those that are pending. resolution: Of the steps to come.
    """

    def __init__(
        self,
        name: str,
        stages: Stages,
        start: tuple[Array, Array],
        t: Array,
        breaks: Sequence[float],
        first: float,
        unjudged: bool,
        recorded: bool = False,
        instants: Sequence[float] = (),
        given: Sequence[float] = (),
    ) -> None:
        """As `March`; `recorded`: all steps stay, so that batches may have any size.

        `instants`: times in s at which a digital controller acts. There a run goes on as it was.
        `given`: ends of the steps in s, which are not chosen then.
        """
        self._name, self.stages, self.resolution = name, stages, 0.0
        self.steps: Sequence[Step] = ()
        ends = float(t[0]), float(t[-1])
        room = (_RECORDED, 1) if recorded else (TOGETHER, TOGETHER + 1)
        self._made = steps_of(stages, ends, breaks, room, instants, given)
        self._recorded, self._given = recorded, len(given) > 0
        self._kernel, self._at = self._made.kernel, self._made.kernel.at
        self._repeated, at = 0, self._at
        at.shortest, at.held, at.growth = SHORTEST * (ends[1] - ends[0]), HELD, GROWTH
        at.idle_from, at.idle_to = (0.0, np.inf) if given else stages.idle
        at.order, at.patience = stages.order, _PATIENCE
        at.t, at.h, at.first, at.unjudged = ends[0], first, first, unjudged
        at.ceiling = at.refused = np.inf
        at.scale = stages.scale
        self._kernel.y[...], self._kernel.v[...] = start
        self._start()
        self._origin = self._point()

    @property
    def done(self) -> bool:
        """Whether the run is at its end."""
        return bool(self._at.stop >= self._at.stops)

    @property
    def now(self) -> Start:
        """The state that the run has come to."""
        k = self._kernel
        return Start(float(self._at.t), *(getattr(k, name).copy() for name in STATE))

    def cost(self) -> dict[str, float]:
        """What the run has cost so far."""
        at = self._at
        return {
            "steps": at.number, "rejected": at.rejected, "unresolved": at.unresolved,
            "repeated": self._repeated, "newton": at.iterations, "tangents": at.refreshed,
            "factorisations": at.factored,
        }  # fmt: skip

    def advance(self) -> None:
        """Some steps more, which are `steps` then; raises ConvergenceError where none is short."""
        at, stages = self._at, self.stages
        stages.resolve(self.resolution)
        self._follow(int(at.count))
        for name, value in stages.goals.items():
            setattr(at, name, value)
        if self._given:
            at.resolution = _ANY
        try:
            while (end := self._kernel.advance()) not in (FULL, STUCK):
                if end == INPUTS:
                    times = at.t + at.size * stages.method.c
                    given = self._made.inputs(times, stages.seen(times))
                    self._kernel.input[...], at.given = given, 1
                elif end == START:
                    self._start()
                elif end == SAMPLE:
                    self._hold()
                elif self._recorded:
                    break
        finally:
            stages.scale = float(at.scale)
            self.steps = self._made.batch()
        self._require_on_beams()
        if end == STUCK:
            raise stuck(self._name, self.now)

    def _require_on_beams(self) -> None:
        """Raise where a step has led off a beam; it is the last one then."""
        dynamics, steps, after = self.stages.dynamics, self._kernel.steps, len(self.steps) + 1
        if not dynamics.system.closed.contacts or after == 1:
            return
        Y = np.vstack([steps["y0"][2:after], self._kernel.y])
        if (k := dynamics.first_off(Y)) is not None:
            self.steps = self.steps[: k + 1]
            dynamics.require_on_beams(
                Y[k], self._name, float([*steps["t"][2:after], self._at.t][k])
            )

    def settle(self, good: int, resolution: float) -> None:
        """Let only the first of the steps stay, or none of all (-1); others are shorter."""
        at, count = self._at, len(self.steps)
        if good < count:
            before = int(at.number)
            finer = min(resolution / self.resolution, 1.0) ** (1.0 / self.stages.order)
            self._go_back(good)
            at.h *= finer
            at.stale = 1
            self._repeated += before - int(at.number)
            if good < 0:
                self._origin = self._point()
            self.stages.scale = float(at.scale)
        self.steps = ()

    def _follow(self, last: int) -> None:
        """Let the next batch begin behind a step of the one before it."""
        if last:
            for name in ("a", "lam", "h"):
                self._kernel.steps[name][0] = self._kernel.steps[name][last]
        self._at.count = 0

    def _start(self) -> None:
        """Consistent accelerations where the kernel has none."""
        k = self._kernel
        if self.stages.sampler is None and self._made.table and k.begin():
            return
        found = self.stages.first(float(self._at.t), k.y.copy(), k.v.copy())
        k.a[...], k.lam[...], k.torque[...] = found.a, found.lam, found.torque

    def _hold(self) -> None:
        """Let the controller act: accelerations jump by what its forces do."""
        k, at = self._kernel, self._at
        sampler = self.stages.sampler
        assert sampler is not None
        if not sampler.reach(at.t, k.y, k.v):
            return
        if not self._made.table:
            k.input[0], at.given = self._made.inputs(np.array([at.t]))[0], 1
        if not k.hold(sampler.held):
            at.follows = 0
            self._start()

    def _point(self) -> dict[str, Any]:
        """Where the run is: it can go on from here once more."""
        point = {name: getattr(self._at, name) for name in _POINT}
        return point | {name: getattr(self._kernel, name).copy() for name in STATE}

    def _go_back(self, good: int) -> None:
        """To where a step of the batch began, or to the start of the run."""
        k, at, steps = self._kernel, self._at, self._kernel.steps
        if good < 0:
            for name in STATE:
                getattr(k, name)[...] = self._origin[name]
            for name in _POINT:
                setattr(at, name, self._origin[name])
            at.count = 0
            return
        step = good + 1
        for name in STATE:
            getattr(k, name)[...] = steps[f"{name}0"][step]
        for name in ("t", "ceiling", "before", "refused", "scale"):
            setattr(at, name, float(steps[name][step]))
        at.h = float(steps["next"][step])
        for name in ("number", "stop", "follows"):
            setattr(at, name, int(k.integers[name][step]))
        at.count = good
