"""Collocation on the compiled kernel: stages, what is prescribed, batches of steps."""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from pinflex.actuation.path import MotorPath
from pinflex.arrays import Array, IntArray
from pinflex.errors import PinflexError, SceneError
from pinflex.integrators.collocation import Collocation
from pinflex.integrators.problem import Problem
from pinflex.kernel.evaluate import Evaluator
from pinflex.kernel.library import Record, constant, numbers, place
from pinflex.mechanics.manifold import sorts_of

Given = Mapping[str, npt.NDArray[Any]]
STATE = ("y", "v", "a", "lam", "torque")
_LANES = constant("LANES")  # factors of so many eigenvalues stand side by side, see newton.c
_MOST_STAGES = constant("MOST_STAGES")


class StageKernel(Record):
    """The stages of one step at a time: `Stages` in source/stages.h.

    Attributes:
        evaluator: The system. counts: Sizes by name. functions: The C code. tables, work: Addresses
            of the system and its workspace.
        table: Of what the last run's table was made, and it: `Inputs` in source/march.h, or None.
    """

    def __init__(
        self, evaluator: Evaluator, scheme: Collocation, prescribed: bool,
        rows: Mapping[str, IntArray],
    ) -> None:  # fmt: skip
        """`prescribed`: whether motors follow their motion.

        `rows`: places of coordinates, by name.
        """
        n, s, values = evaluator.tables.counts, scheme.s, len(scheme.value)
        size = len(rows["free_at"]) + n["closures"]
        order = (17 + 2 * ((size + 63) // 64)) * size + 1  # sparsity.h
        joined = int(evaluator.tables.arrays["joined_at"][-1])
        self.counts = {
            **n, "s": s, "free": len(rows["free_at"]), "motors": len(rows["motor_v"]),
            "joined": joined, "columns": 3 * len(rows["motor_v"]) + n["forces"],
        }  # fmt: skip
        sizes = self.counts | {
            "values": values, "prescribed": int(prescribed), "plain": len(rows["plain_v"]),
            "circles": len(rows["circle_v"]), "balls": len(rows["ball_v"]),
            "bodies": len(rows["body_v"]),
            "size": size, "sets": -(-values // _LANES), "lanes": _LANES,
            "part": 2 * (_LANES + 1) * size + n["nv"], "pivots": values * size + order,
        }  # fmt: skip
        super().__init__("Stages", sizes, {**rows, **vars(scheme)})
        self.evaluator, self.functions, self.work = evaluator, evaluator.functions, evaluator.work
        self.tables = evaluator.tables.address
        self.table: tuple[tuple[object, ...], Record | None] = ((), None)
        self._march: tuple[tuple[int, ...], MarchKernel] | None = None

    def march(self, given: Given, table: Record | None, room: tuple[int, int]) -> MarchKernel:
        """The arrays of a run by these stages: those of the last one, where they fit.

        `room`: for steps and tangents. Without a table inputs are given stage by stage.
        """
        fits = (*room, len(given["measured_at"]), int("weight" in given), len(given["stop_at"]))
        if self._march is not None and self._march[0] == fits:
            self._march[1].begin_anew(given, table)
        else:
            self._march = fits, MarchKernel(self, given, table, *room)
        return self._march[1]

    @property
    def size(self) -> int:
        """Bytes of its arrays."""
        return self.raw.nbytes + (0 if self._march is None else self._march[1].size)

    def take_hold(self, acts: bool) -> None:
        """Let a digital controller act, with no force at first, or none."""
        self.arrays["held"][...] = 0.0
        self.at.held = self.addresses["held"] if acts else None


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
            found = StageKernel(dynamics.compiled, method, drive is None, _rows(problem))
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
        return self._columns(*self.problem.inside(t, self.method.c))

    def _columns(self, path: MotorPath, seen: Array) -> Array:
        drive = self.problem.drive
        feed = path.acceleration if drive is None else drive.forward(path.t)
        scale = self.kernel.evaluator.scale(seen)
        return np.concatenate([path.position, path.velocity, feed, scale], axis=1)

    def table(self, ends: tuple[float, float], corners: Sequence[float]) -> Record | None:
        """What is prescribed in a run as polynomials between corners (s); None: it is not smooth.

        That of the last run, where it is the same.
        """
        problem, kernel = self.problem, self.kernel
        system, drive = problem.dynamics.system, problem.drive
        made_of, table = kernel.table
        asked_for = (problem.motion, drive and drive.forward, *ends, *corners)
        # A load that switches is another at the end of one step than at the start of the next.
        if system.loads.timed or made_of == asked_for:
            return table
        n, forces = len(system.motors), kernel.counts["forces"]
        kinds = [slice(*pair) for pair in pairwise(np.cumsum([0, n, n, n, forces]))]
        table = None
        with contextlib.suppress(SceneError):  # somewhere on the way: as far as it can
            pieces = getattr(problem.motion, "pieces", None)
            table = tabulated(self.at, kinds, *ends, corners, pieces)
        kernel.table = asked_for, table
        return table


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
) -> Record | None:
    """A function of time as `Inputs` in source/march.h; None: not smooth between its corners.

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
    node, weight, *_ = _points(count)
    arrays = {
        "node": node, "weight": weight, "middle": middle, "half": half, "value": value,
        "end": middle + half,  # between two pieces, in the gap of a corner, either holds
        "corner": whole, "corner_value": corner_value,
    }  # fmt: skip
    sizes = {"pieces": len(half), "nodes": count, "corners": len(whole), "columns": value.shape[2]}
    return Record("Inputs", sizes, arrays, gap=_AT_CORNER * span)


def read(table: Record, t: Array) -> Array:
    """Values of a table at times, as the kernel reads them (source/inputs.c).

    Returns:
        Columns, shape (k, n).
    """
    x = table.arrays
    piece = np.minimum(np.searchsorted(x["end"], t), len(x["end"]) - 1)
    piece[(piece > 0) & (t < x["middle"][piece] - x["half"][piece])] -= 1  # just before a corner
    away = ((t - x["middle"][piece]) / x["half"][piece])[:, None] - x["node"]
    hit = away == 0.0
    W = np.where(hit.any(axis=1, keepdims=True), hit, x["weight"] / np.where(hit, 1.0, away))
    W /= W.sum(axis=1, keepdims=True)
    found = np.einsum("kn,knj->kj", W, x["value"][piece])
    nearest = np.argmin(np.abs(t[:, None] - x["corner"]), axis=1)
    at = np.abs(t - x["corner"][nearest]) <= table.at.gap
    found[at] = x["corner_value"][nearest[at]]
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


# Steps as the kernel makes them, and the states that are read off them.


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


class MarchKernel:
    """The arrays of one run, and where it is: `March`, `Steps` and `Inputs` in source/march.h.

    Step 0 of the arrays is the last one before the batch.

    Attributes:
        at: The C structure: where the run is, its settings and counts.
        steps: Arrays of the steps by name, shape (capacity + 1, ...).
        table: What is prescribed; None: inputs are given stage by stage.
        y, v, a, lam, torque: The state that the next step starts from.
        input: Inputs of the stages, shape (s, columns), where they are given.
        piece, hit: Of laws of pieces, that each is in, and the speed it came there with, (kinks,).
        size: Of all arrays in bytes.
    """

    def __init__(
        self, stages: StageKernel, given: Given, table: Record | None, capacity: int, tangents: int
    ) -> None:
        """`given`: what `March` reads of the run; without `weight` norms are of the mass matrix.

        `capacity`: steps of a batch; `tangents`: room for those that they are solved by.
        """
        n, nv, rows = stages.counts, stages.counts["nv"], stages.counts["closures"]
        size, measured = n["free"] + rows, given["measured_at"]
        if n["s"] > _MOST_STAGES:
            raise PinflexError(f"kernel: {n['s']} stages, at most {_MOST_STAGES}.")
        _require_rows(measured, nv)
        sizes = n | {
            "capacity": capacity, "steps": capacity + 1, "tangents": tangents,
            "kept": tangents + 1, "wide": nv * (3 * nv + rows) + n["joined"],  # one more for starts
            "stops": len(given["stop_at"]), "measured": len(measured),
            "size": size, "starts": 2 * size + 1, "starts_x": 2 * size + nv + rows,
        }  # fmt: skip
        self._counts, self._steps = n, Record("Steps", sizes, {})
        self._prescribe(table)
        self._run = Record(
            "March", sizes, given, by_mass=int("weight" not in given), stale=1,
            stages=stages.address, inputs=self.prescribed.address, steps=self._steps.at,
        )  # fmt: skip
        self.size = self._steps.raw.nbytes + self._run.raw.nbytes
        self.at, self.steps, arrays = self._run.at, self._steps.arrays, self._run.arrays
        self.input, self.piece, self.hit = (arrays[name] for name in ("input", "piece", "hit"))
        self.y, self.v, self.a, self.lam, self.torque = (arrays[name] for name in STATE)
        self._functions = stages.functions
        self._keep = stages.at, stages.raw, stages.evaluator  # C reads there, without the stages:
        # these hold this march, and a circle would wait for the garbage collection with both.
        self._call = (stages.tables, stages.work, self._run.address)
        self._new = bytes(self.at)

    def _prescribe(self, table: Record | None) -> None:
        none = {"pieces": 0, "nodes": 0, "corners": 0, "columns": self._counts["columns"]}
        self.table, self.prescribed = table, table or Record("Inputs", none, {})
        if self.prescribed.sizes["columns"] != none["columns"]:
            raise PinflexError(f"kernel: {self.prescribed.sizes} for {none['columns']} inputs.")

    def begin_anew(self, given: Given, table: Record | None) -> None:
        """Take over another run of the same sizes, as if these arrays were new."""
        self._prescribe(table)
        ctypes.memmove(ctypes.byref(self.at), self._new, len(self._new))
        self.at.inputs = self.prescribed.address
        _require_rows(given["measured_at"], self._counts["nv"])
        for name in given.keys() & self._run.arrays.keys():
            array = self._run.arrays[name]
            array[...] = given[name].reshape(array.shape)

    def advance(self) -> int:
        """Steps until the batch is full, or something else has to answer."""
        return int(self._functions.pinflex_march(*self._call))

    def begin(self) -> bool:
        """Consistent a, lam and torque at t, y and v; False where they are not unique."""
        return bool(self._functions.pinflex_begin(*self._call))

    def correct(self, run: MarchKernel, W: Array, end_a: Array | None, given: Array | None) -> bool:
        """Steps of a run once more, from this state on; False where equations are singular."""
        (s, columns), count = self.input.shape, int(run.at.count)
        if W.shape != (s, len(run.input)) or count > self.at.capacity:
            raise PinflexError(f"kernel: {W.shape} weights for {count} steps.")
        shapes = (W.shape, (self._counts["nv"],), (count, s, columns))
        pairs = zip((W, end_a, given), shapes, strict=True)
        kept = [None if x is None else numbers(x, *shape) for x, shape in pairs]
        pointers = (None if x is None else x.ctypes.data for x in kept)
        (tables, work, at), of = self._call, run._call[2]
        return bool(self._functions.pinflex_correct_steps(tables, work, of, at, count, *pointers))

    def samples(self, t: Array, of: IntArray, inputs: Array | None, room: Sequence[Array]) -> None:
        """States at times: y, v, a, lam, torque and work."""
        of = np.ascontiguousarray(of, dtype=np.int64)
        # Taken without a sign, a negative number is large.
        if of.shape != t.shape or of.view(np.uint64).max(initial=0) > self.at.count:
            raise PinflexError("kernel: samples outside the steps.")
        given = None if inputs is None else numbers(inputs, len(t), self._counts["columns"])
        widths = (*(getattr(self, name).size for name in STATE), 2)
        places = [place(x, len(t), width) for x, width in zip(room, widths, strict=True)]
        t = numbers(t, len(t))
        self._functions.pinflex_samples(
            self._call[0], self._call[2], len(t), t.ctypes.data, of.ctypes.data,
            None if given is None else given.ctypes.data, *places,
        )  # fmt: skip


def _require_rows(measured: IntArray, nv: int) -> None:
    if np.any(measured < 0) or np.any(measured >= nv):
        raise PinflexError("kernel: measured: a row that is none.")


class Batch:
    """Steps that the kernel has made, until it makes others: read them off before.

    Attributes:
        stages: The method. kernel: Arrays of the steps, of which those from 1 on are meant.
    """

    def __init__(self, stages: Stages, kernel: MarchKernel, size: int) -> None:
        self.stages, self.kernel, self._size = stages, kernel, size

    def __len__(self) -> int:
        return self._size

    def upto(self, size: int) -> Batch:
        """The first of its steps."""
        return self if size == self._size else Batch(self.stages, self.kernel, size)

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

    def samples(self, t: Array, of: IntArray, room: States) -> None:
        """Read off states."""
        self.kernel.samples(
            t, of + 1, self.stages.at(t) if self.kernel.table is None else None, room
        )

    @cached_property
    def works(self) -> Array:
        """Work of the motors and of the damping in each step, J, shape (k, 2)."""
        power = self.kernel.steps["power"][1 : self._size + 1]
        return np.asarray(self.h[:, None] * (self.stages.method.A[-1] @ power))
