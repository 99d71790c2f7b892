"""The stages of collocation steps on the compiled kernel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np

from pinflex.actuation.path import MotorPath
from pinflex.arrays import Array, IntArray
from pinflex.errors import PinflexError
from pinflex.integrators.collocation import Collocation
from pinflex.integrators.problem import Problem, seen_inside
from pinflex.kernel.library import constant
from pinflex.kernel.march import MarchKernel, StageKernel, Table
from pinflex.mechanics.manifold import sorts_of


class Stages:
    """The stages of one problem by one method, lent from the spare ones of the system.

    Attributes:
        problem: What is solved. method: The scheme. kernel: Their arrays.
    """

    def __init__(self, problem: Problem, method: Collocation) -> None:
        """Raises a PinflexError where the kernel does not serve."""
        dynamics, drive = problem.dynamics, problem.drive
        self.problem, self.method = problem, method
        self._kind = method.A.tobytes(), drive is None  # of spare ones
        if not dynamics.on_kernel or dynamics.compiled is None:
            raise PinflexError("kernel: it does not serve; plain steps do.")
        found: StageKernel | None = dynamics.system.spares.acquire(self._kind)
        if found is None:
            found = StageKernel(dynamics.compiled, method.arrays, drive is None, _rows(problem))
        self.kernel = found
        found.take_hold(problem.sampler is not None)
        if drive is not None:
            for name in ("kp", "kd"):
                found.arrays[name][...] = getattr(drive, name)

    def __del__(self) -> None:
        if (kernel := self.__dict__.get("kernel")) is not None:
            self.problem.dynamics.system.spares.release(self._kind, kernel, kernel.size)

    def at(self, t: Array) -> Array:
        """Motors' position, velocity, acceleration (or torque) and shares of loads, (k, n)."""
        return self._columns(self.problem.path(t), t)

    def inside(self, t: Array) -> Array:
        """The same at the stages of a step, shape (s, n), as they are inside it."""
        return self._columns(self.problem.path_inside(t), seen_inside(t, self.method.c))

    def _columns(self, path: MotorPath, seen: Array) -> Array:
        drive = self.problem.drive
        feed = path.acceleration if drive is None else drive.forward(path.t)
        scale = self.kernel.evaluator.scale(seen)
        return np.concatenate([path.position, path.velocity, feed, scale], axis=1)


def _rows(problem: Problem) -> dict[str, IntArray]:
    """Places of coordinates, as `Stages` in source/stages.h has them."""
    motors, axes = problem.motors, problem.axes
    paired = np.isin(np.arange(len(motors)), axes.paired).astype(np.intp)
    own = {"free_at": problem.free, "motor_v": motors, "motor_paired": paired}
    own["motor_q"] = np.asarray(axes.q_at, dtype=np.intp)
    return own | sorts_of(problem.dynamics.system.rigid)


# What a run prescribes in time as a table of polynomials, which the compiled march reads.
#
# Between corners motors and loads move smoothly: polynomials through Chebyshev points of pieces,
# that are halved until round-off is all they miss between the points. What is not so smooth
# (samples, other interpolations) has no table.

_NODES = constant("MOST_NODES")  # and as many less one between them
_FEW = 7  # where it is a polynomial of fifth degree on pieces that are known
_ROUND_OFF = 3e-14  # of the largest value of a kind: what may be missed; seen: 2e-15
# Of it: what may be missed where a half misses as much as its whole: the function's own round-off,
# or a kink so small.
_NOISE, _NO_BETTER = 1e-11, 0.5
_ROUNDS = 4  # of halving those that are not close, the first without
_CORNER_GAP = 1e-9  # of the whole: a piece ends just before its corner, where inputs may jump
_AT_CORNER = 1e-12  # of the whole: what round-off moves a corner by


def tabulated(
    function: Callable[[Array], Array],
    kinds: Sequence[slice],
    start: float,
    end: float,
    corners: Sequence[float],
    pieces: Array | None = None,
) -> Table | None:
    """The table of a function of time; None where it is not smooth between its corners.

    `pieces`: times (s) between which motors follow polynomials of fifth degree, where they do.
    """
    span = end - start
    gap = _CORNER_GAP * span
    inside = [c for c in sorted(set(corners)) if start + gap < c < end - gap]
    ends, count = np.array([start, *inside, end]), _NODES
    if pieces is not None:
        apart = np.abs(pieces[:, None] - ends).min(axis=1) > 10.0 * gap
        between = (pieces > start) & (pieces < end)
        ends, count = np.sort(np.concatenate([ends, pieces[apart & between]])), _FEW
    begin, until = ends[:-1] + gap, ends[1:] - gap
    whole = np.array([start, *(c for c in corners if start < c < end), end])
    size, corner_value = np.full(len(kinds), 1e-300), None
    done: list[tuple[Array, Array, Array]] = []
    before = np.full((len(kinds), len(begin)), np.inf)
    for _ in range(_ROUNDS):
        middle, half = 0.5 * (begin + until), 0.5 * (until - begin)
        more = whole if corner_value is None else whole[:0]
        values, missed, others = _pieces(function, middle, half, more, count)
        corner_value = others if corner_value is None else corner_value
        size = np.maximum(size, [np.abs(values[..., k]).max(initial=0.0) for k in kinds])
        worst = np.stack([missed[:, k].max(axis=1, initial=0.0) for k in kinds]) / size[:, None]
        noise = (worst <= _NOISE) & (worst > _NO_BETTER * before)
        good = np.all((worst <= _ROUND_OFF) | noise, axis=0)
        done.append((middle[good], half[good], values[good]))
        if good.all():
            break
        begin, until, middle = begin[~good], until[~good], middle[~good]
        begin, until = np.concatenate([begin, middle]), np.concatenate([middle, until])
        before = np.tile(worst[:, ~good], 2)
    else:
        return None
    middle, half, value = (np.concatenate(parts) for parts in zip(*done, strict=True))
    order = np.argsort(middle)
    middle, half, value = middle[order], half[order], value[order]
    # Between two pieces, in the gap of a corner, either holds.
    rest = (middle + half, middle, half, value, whole, corner_value, _AT_CORNER * span)
    node, weight, *_ = _points(count)
    return Table(node, weight, *rest)


def read(table: Table, t: Array) -> Array:
    """Values of a table at times, as the kernel reads them (source/inputs.c).

    Returns:
        Columns, shape (k, n).
    """
    piece = np.minimum(np.searchsorted(table.end, t), len(table.end) - 1)
    piece[(piece > 0) & (t < table.middle[piece] - table.half[piece])] -= 1  # just before a corner
    away = ((t - table.middle[piece]) / table.half[piece])[:, None] - table.node
    hit = away == 0.0
    W = np.where(hit.any(axis=1, keepdims=True), hit, table.weight / np.where(hit, 1.0, away))
    W /= W.sum(axis=1, keepdims=True)
    found = np.einsum("kn,knj->kj", W, table.value[piece])
    if len(table.corner):
        nearest = np.argmin(np.abs(t[:, None] - table.corner), axis=1)
        at = np.abs(t - table.corner[nearest]) <= table.gap
        found[at] = table.corner_value[nearest[at]]
    return np.asarray(found)


def _pieces(
    function: Callable[[Array], Array], middle: Array, half: Array, more: Array, count: int
) -> tuple[Array, Array, Array]:
    """Values at the nodes of pieces, (pieces, nodes, n), and misses between, (pieces, n).

    And values at times `more`, for every call of the function has its price.
    """
    node, _, between, W = _points(count)
    at = np.concatenate([node, between])
    times = (middle[:, None] + half[:, None] * at).ravel()
    found = function(np.concatenate([times, more]))
    inner, others = found[: len(times)].reshape(len(middle), len(at), -1), found[len(times) :]
    values, wanted = inner[:, :count], inner[:, count:]
    return values, np.abs(W @ values - wanted).max(axis=1, initial=0.0), others


@cache
def _points(count: int) -> tuple[Array, Array, Array, Array]:
    """Zeros of the Chebyshev polynomial, their barycentric weights, and points between them.

    And values at the zeros to those between, shape (count - 1, count).
    """
    angle = np.pi * (np.arange(count) + 0.5) / count
    node, weight = np.cos(angle), np.where(np.arange(count) % 2, -1.0, 1.0) * np.sin(angle)
    between = np.cos(angle[:-1] + 0.5 * np.pi / count)
    W = weight / (between[:, None] - node)
    return node, weight, between, np.asarray(W / W.sum(axis=1, keepdims=True))


# A batch of steps as the kernel leaves them, and the states that are read off it.

STATE = ("y", "v", "a", "lam", "torque")


class States(NamedTuple):
    """States at k instants, as they are recorded.

    Attributes:
        y: Shape (k, nq). v, a: Shape (k, nv). lam: Shape (k, rows). torque: Shape (k, nm).
        work: Of the motors and of the damping since the start of the step, J, shape (k, 2).
    """

    y: Array
    v: Array
    a: Array
    lam: Array
    torque: Array
    work: Array


class Batch:
    """Steps that the kernel has made, until it makes others: read them off before.

    Attributes:
        stages: The method. kernel: Arrays of the steps, of which those from 1 on are meant.
        table: What is prescribed, or None.
    """

    def __init__(self, stages: Stages, kernel: MarchKernel, table: Table | None, size: int) -> None:
        self.stages, self.kernel, self.table, self._size = stages, kernel, table, size

    def __len__(self) -> int:
        return self._size

    def upto(self, size: int) -> Batch:
        """The first of its steps."""
        return self if size == self._size else Batch(self.stages, self.kernel, self.table, size)

    @property
    def t(self) -> Array:
        """Starts of the steps, s, shape (k,)."""
        return self.kernel.steps["t"][1 : self._size + 1]

    @property
    def h(self) -> Array:
        """Their lengths, s, shape (k,)."""
        return self.kernel.steps["h"][1 : self._size + 1]

    @cached_property
    def ends(self) -> Array:
        """Their ends, s, a little later than they are: a sample that rounds to one is in it."""
        return np.asarray(self.t + (1.0 + 1e-9) * self.h)

    def states(self) -> States:
        """States at their ends, without work."""
        kernel, end = self.kernel, self._size + 2
        columns = [kernel.steps[f"{name}0"][2:end].copy() for name in STATE]
        if self._size == kernel.at.count:  # that of the last one is where the run is
            columns = [
                np.vstack([x[: end - 3], getattr(kernel, name)])
                for name, x in zip(STATE, columns, strict=True)
            ]
        y, v, a, lam, torque = columns
        return States(y, v, a, lam, torque, np.zeros((self._size, 2)))

    def end(self) -> dict[str, Array]:
        """The state at the end of the last one, without work."""
        if self._size == self.kernel.at.count:  # that is where the run is
            return {name: getattr(self.kernel, name).copy() for name in STATE}
        return {name: self.kernel.steps[f"{name}0"][self._size + 1].copy() for name in STATE}

    def samples(self, t: Array, of: IntArray, room: States) -> None:
        """Read off states."""
        self.kernel.samples(t, of + 1, None if self.table else self.stages.at(t), room)

    @cached_property
    def works(self) -> Array:
        """Work of the motors and of the damping in each step, J, shape (k, 2)."""
        power = self.kernel.steps["power"][1 : self._size + 1]
        return np.asarray(self.h[:, None] * (self.stages.method.A[-1] @ power))
