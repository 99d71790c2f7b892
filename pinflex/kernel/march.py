"""The steps of a run, compiled: the arrays of a batch of steps and where the run is.

The fields are those of `March`, `Steps` and `Inputs` in source/march.h, which says what they
hold. Step 0 of the arrays is the last one before the batch.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.errors import PinflexError
from pinflex.kernel.header import constant, structure
from pinflex.kernel.stages import Block, StageKernel

_March, _Steps, _Inputs = (structure(name) for name in ("March", "Steps", "Inputs"))
FULL, INPUTS, START, STUCK, PAUSED, SAMPLE, EVENT = (
    constant(name) for name in ("FULL", "INPUTS", "START", "STUCK", "PAUSED", "SAMPLE", "EVENT")
)
RESTARTS, HOLDS, ON = (constant(name) for name in ("RESTARTS", "HOLDS", "ON"))
MOST_STAGES = constant("MOST_STAGES")
_STATE = ("y", "v", "a", "lam", "torque")
_STARTS = ("t", "y0", "v0", "a0", "lam0", "torque0")
_STAGES = ("move", "turn", "a", "lam", "torque", "power", "position", "velocity")
_POINTS = ("next", "ceiling", "before", "refused", "scale")
_NUMBERS = (*_STARTS, "h", "coarseness", "rate", *_STAGES, *_POINTS)
_INTEGERS = ("number", "stop", "follows", "tangent", "serial")


@dataclass(frozen=True)
class Table:
    """What is prescribed in time: motors' position, velocity, acceleration, and shares of loads.

    Attributes:
        node, weight: Of every piece, on (-1, 1), shape (nodes,).
        end, middle, half: Of the pieces, s, shape (pieces,).
        value: At the nodes, shape (pieces, nodes, columns).
        corner: Times in s with values of their own. corner_value: Shape (corners, columns).
        gap: How near a corner a time is at it, s.
    """

    node: Array
    weight: Array
    end: Array
    middle: Array
    half: Array
    value: Array
    corner: Array
    corner_value: Array
    gap: float


def no_table(columns: int) -> Table:
    """Inputs that are given stage by stage."""
    none = np.zeros(0)
    values = np.zeros((0, 0, columns))
    return Table(none, none, none, none, none, values, none, np.zeros((0, columns)), 0.0)


@dataclass(frozen=True)
class Marched:
    """A system, as the steps of a run need it.

    Attributes:
        basis, basis_0: Values at the nodes, and at 0 and the nodes, to coefficients of powers.
        last: Stages to the last Legendre coefficient, shape (s,).
        measured: Velocity rows that norms count. weight: Their weight; None: the mass matrix.
        stops: Ends in s that steps have to meet. kind: How the run goes on from each, shape
            (stops,): RESTARTS, HOLDS (what a digital controller holds changes) or ON.
    """

    basis: Array
    basis_0: Array
    last: Array
    measured: IntArray
    weight: Array | None
    stops: Sequence[float]
    kind: IntArray


class MarchKernel:
    """The arrays of one run, and where it is.

    Attributes:
        at: The C structure: where the run is, its settings and counts.
        steps: Arrays of the steps by name, shape (capacity + 1, ...).
        tangents: M, C, K and J of each tangent, flat.
        y, v, a, lam, torque: The state that the next step starts from.
        input: Inputs of the stages, shape (s, columns), where they are given.
        piece, hit: Of laws of pieces, that each is in, and the speed it came there with, (kinks,).
        size: Of all arrays in bytes.
    """

    def __init__(
        self, stages: StageKernel, given: Marched, table: Table, capacity: int, tangents: int
    ) -> None:
        """`capacity`: steps of a batch; `tangents`: room for those that they are solved by."""
        n, s, steps = stages.counts, stages.counts["s"], capacity + 1
        nq, nv, rows, motors = (n[name] for name in ("nq", "nv", "closures", "motors"))
        size, count = n["free"] + rows, len(given.measured)
        _check(stages, given, table)
        self._stages = stages
        shapes = dict.fromkeys(("t", "h", "coarseness", "rate", *_POINTS), ()) | {
            "y0": (nq,), "v0": (nv,), "a0": (nv,), "lam0": (rows,), "torque0": (motors,),
            "move": (s, nv), "turn": (s, nv), "a": (s, nv), "lam": (s, rows),
            "torque": (s, motors), "power": (s, 2), "position": (s, motors),
            "velocity": (s, motors),
        }  # fmt: skip
        of_steps = Block({name: (steps, *shapes[name]) for name in _NUMBERS}, {})
        integers = Block(
            dict.fromkeys(_INTEGERS, (steps,))
            | {"start_pivot": (2 * size,), "piece": (n["kinks"],)},
            {"measured_at": given.measured, "kind": given.kind}, np.int64,
        )  # fmt: skip
        # One tangent more for starts.
        zeros = {
            "tangent_at": (tangents + 1, nv * (3 * nv + rows)), "input": (s, _columns(stages)),
            "start_lu": (2 * size + 1, size), "start_x": (2 * size + nv + rows,),
            "y": (nq,), "v": (nv,), "a": (nv,), "lam": (rows,), "torque": (motors,),
            "hit": (n["kinks"],), "placed": (s + 1, nq), "x": (s + 1, n["kinks"]),
        }  # fmt: skip
        weight = np.zeros((count, count)) if given.weight is None else given.weight
        values = {"stop_at": np.array(given.stops, dtype=float), "weight": weight}
        values |= {name: getattr(given, name) for name in ("basis", "basis_0", "last")}
        numbers, inputs = Block(zeros, values), _inputs(table)
        self._keep, self._inputs, self._table = (of_steps, integers, numbers), inputs, table
        self.size = sum(block.size for block in self._keep)
        self.steps, self.integers = of_steps.arrays, integers.arrays
        at = numbers.arrays
        self.tangents, self.input = at["tangent_at"], at["input"]
        self.y, self.v, self.a, self.lam, self.torque = (at[name] for name in _STATE)
        self.piece, self.hit = self.integers["piece"], at["hit"]
        own = ("measured_at", "kind", "start_pivot", "piece")
        pointers = numbers.addresses | {name: integers.addresses[name] for name in own}
        self.at = _March(
            capacity=capacity, tangents=tangents, stops=len(given.stops), measured=count,
            by_mass=int(given.weight is None), stale=1, stages=stages.address,
            inputs=ctypes.addressof(inputs[1]),
            steps=_Steps(
                **of_steps.addresses, **{name: integers.addresses[name] for name in _INTEGERS}
            ),
            **pointers,
        )  # fmt: skip
        self._functions, self._tables = stages.functions, stages.tables
        self._call = (stages.tables, stages.work, ctypes.addressof(self.at))
        self._widths = (nq, nv, nv, rows, motors, 2)
        self._new = bytes(self.at)

    def begin_anew(self, given: Marched, table: Table) -> None:
        """Take over another run of the same sizes, as if these arrays were new."""
        _check(self._stages, given, table)
        if table is not self._table:
            self._inputs, self._table = _inputs(table), table
        ctypes.memmove(ctypes.byref(self.at), self._new, len(self._new))
        self.at.inputs = ctypes.addressof(self._inputs[1])
        numbers, integers = self._keep[2].arrays, self._keep[1].arrays
        numbers["stop_at"][...], integers["measured_at"][...] = given.stops, given.measured
        integers["kind"][...] = given.kind
        if given.weight is not None:
            numbers["weight"][...] = given.weight
        for name in ("basis", "basis_0", "last"):
            numbers[name][...] = getattr(given, name)

    def advance(self) -> int:
        """Steps until the batch is full, or something else has to answer."""
        return int(self._functions.pinflex_march(*self._call))

    def begin(self) -> bool:
        """Consistent a, lam and torque at t, y and v; False where they are not unique."""
        return bool(self._functions.pinflex_begin(*self._call))

    def hold(self, force: Array) -> bool:
        """Go on under other forces (nv,) of a controller; False where a start is not unique."""
        if force.shape != self.v.shape or force.dtype != float or not force.flags.c_contiguous:
            raise PinflexError(f"kernel: forces of {force.shape}.")
        return bool(self._functions.pinflex_hold(*self._call, force.ctypes.data))

    def correct(self, run: MarchKernel, W: Array, end_a: Array | None, given: Array | None) -> bool:
        """Steps of a run once more, from this state on; False where equations are singular."""
        s, count = len(self.input), int(run.at.count)
        if W.shape != (s, len(run.input)) or count > self.at.capacity:
            raise PinflexError(f"kernel: {W.shape} weights for {count} steps.")
        if given is not None and given.shape != (count, *self.input.shape):
            raise PinflexError(f"kernel: inputs of {given.shape}.")
        arrays = (None if x is None else _numbers(x) for x in (W, end_a, given))
        kept = tuple(arrays)
        pointers = (None if x is None else x.ctypes.data for x in kept)
        tables, work, at = self._call
        done = self._functions.pinflex_correct_steps(
            tables, work, run._call[2], at, count, *pointers
        )
        return bool(done)

    def samples(self, t: Array, of: IntArray, inputs: Array | None, room: Sequence[Array]) -> None:
        """States at times: y, v, a, lam, torque and work."""
        t, of = _numbers(t), np.ascontiguousarray(of, dtype=np.int64)
        # Taken without a sign, a negative number is large.
        if of.shape != t.shape or of.view(np.uint64).max(initial=0) > self.at.count:
            raise PinflexError("kernel: samples outside the steps.")
        given = None if inputs is None else _numbers(inputs)
        if given is not None and given.shape != (len(t), self.input.shape[1]):
            raise PinflexError(f"kernel: inputs of {given.shape}.")
        for x, width in zip(room, self._widths, strict=True):
            if x.shape != (len(t), width) or x.dtype != float or not x.flags.c_contiguous:
                raise PinflexError(f"kernel: room of {x.shape} for {(len(t), width)} numbers.")
        self._functions.pinflex_samples(
            self._tables, self._call[2], len(t), t.ctypes.data, of.ctypes.data,
            None if given is None else given.ctypes.data, *(x.ctypes.data for x in room),
        )  # fmt: skip


def _columns(stages: StageKernel) -> int:
    return 3 * stages.counts["motors"] + stages.counts["forces"]


def _check(stages: StageKernel, given: Marched, table: Table) -> None:
    """Raise where sizes or rows are not those of the stages."""
    n, s, columns = stages.counts, stages.counts["s"], _columns(stages)
    if s > MOST_STAGES:
        raise PinflexError(f"kernel: {s} stages, at most {MOST_STAGES}.")
    if table.value.shape[2] != columns or table.corner_value.shape[1] != columns:
        raise PinflexError(f"kernel: inputs of {table.value.shape[2]} columns, not {columns}.")
    if np.any(given.measured < 0) or np.any(given.measured >= n["nv"]):
        raise PinflexError("kernel: measured: a row that is none.")
    count = len(given.measured)
    if given.weight is not None and given.weight.shape != (count, count):
        raise PinflexError(f"kernel: a weight of {given.weight.shape}, not {(count, count)}.")
    shapes = tuple(x.shape for x in (given.basis, given.basis_0, given.last))
    if shapes != ((s, s), (s + 1, s + 1), (s,)):
        raise PinflexError(f"kernel: {shapes} weights of {s} stages.")


def _inputs(table: Table) -> tuple[Block, ctypes.Structure]:
    names = ("node", "weight", "end", "middle", "half", "value", "corner", "corner_value")
    block = Block({}, {name: getattr(table, name) for name in names})
    pieces, nodes, columns = table.value.shape
    return block, _Inputs(
        columns=columns, pieces=pieces, nodes=nodes, corners=len(table.corner), gap=table.gap,
        **block.addresses,
    )  # fmt: skip


def _numbers(x: Array | Sequence[float]) -> Array:
    return np.ascontiguousarray(x, dtype=np.float64)
