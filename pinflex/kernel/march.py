"""The steps of a run, compiled: the arrays of a batch of steps and where the run is."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array, IntArray
from pinflex.errors import PinflexError
from pinflex.kernel.evaluate import Evaluator
from pinflex.kernel.library import Record, constant, names, structure

Given = Mapping[str, npt.NDArray[Any]]
_LANES = constant("LANES")  # factors of so many eigenvalues stand side by side, see newton.c


class StageKernel(Record):
    """The stages of one step at a time: `Stages` in source/stages.h.

    Attributes:
        evaluator: The system. counts: Sizes by name. functions: The C code. tables, work: Addresses
            of the system and its workspace.
        table: What the last run prescribed, and of what its table was made.
    """

    def __init__(
        self, evaluator: Evaluator, scheme: Given, prescribed: bool, rows: Mapping[str, IntArray]
    ) -> None:
        """`scheme`: see `Collocation.arrays`. `prescribed`: whether motors follow their motion.

        `rows`: places of coordinates, by name.
        """
        n, s, values = evaluator.tables.counts, len(scheme["c"]), len(scheme["forward"])
        size = len(rows["free_at"]) + n["closures"]
        order = (17 + 2 * ((size + 63) // 64)) * size + 1  # sparsity.h
        joined = int(evaluator.tables.arrays["joined_at"][-1])
        self.counts = {
            **n, "s": s, "free": len(rows["free_at"]), "motors": len(rows["motor_v"]),
            "joined": joined,
        }  # fmt: skip
        sizes = self.counts | {
            "values": values, "prescribed": int(prescribed), "plain": len(rows["plain_v"]),
            "circles": len(rows["circle_v"]), "balls": len(rows["ball_v"]),
            "bodies": len(rows["body_v"]),
            "size": size, "sets": -(-values // _LANES), "lanes": _LANES,
            "part": 2 * (_LANES + 1) * size + n["nv"], "pivots": values * size + order,
        }  # fmt: skip
        super().__init__("Stages", sizes, {**rows, **scheme})
        self.evaluator, self.functions, self.work = evaluator, evaluator.functions, evaluator.work
        self.tables = evaluator.tables.address
        self.table: tuple[tuple[object, ...], Table | None] = ((), None)
        self._march: tuple[tuple[int, ...], MarchKernel] | None = None

    def march(self, given: Given, table: Table | None, room: tuple[int, int]) -> MarchKernel:
        """The arrays of a run by these stages: those of the last one, where they fit.

        `room`: for steps and tangents. Without a table inputs are given stage by stage.
        """
        table = table or _no_table(columns_of(self.counts))
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


class LawKernel(Record):
    """A continuous linear feedback in equal steps, and where it is: `Law` in source/law.h.

    Attributes:
        x, e: States and errors where the last step ended. target: What errors are counted from.
    """

    def __init__(self, tables: Mapping[str, Array], nq: int, nv: int) -> None:
        """`tables`: S, B, home, target, x_of_x, x_of_e, C, D and E by name."""
        sizes = {"measures": len(tables["S"]), "states": len(tables["x_of_x"]), "nq": nq, "nv": nv}
        super().__init__("Law", sizes | {"drives": tables["B"].shape[1]}, tables)
        if any(x.shape != self.arrays[name].shape for name, x in tables.items()):
            raise PinflexError("kernel: a law whose tables do not fit each other.")
        self.x, self.e = self.arrays["x_before"], self.arrays["e_before"]
        self.target = tables["target"]


# Equal steps of the alpha family, compiled (`Alpha` and `Rows` in source/alpha.h).

_Rows, _STATES = structure("Rows"), ("now", "last", "next")
_OF_STATE = names("State", ctypes.c_void_p)


class AlphaKernel:
    """The steps of one run, and where it is.

    Attributes:
        at: The C structure: settings, scales and counts. law: A feedback, or None.
        rows: What is prescribed at the instants, and the states there, each (steps, n).
        residual: What a step that failed has left last, shape (nv,); nan where it ran away.
    """

    def __init__(
        self,
        stages: StageKernel,
        predict: Array,
        path: Sequence[Array],
        found: Sequence[Array],
        law: LawKernel | None = None,
        **settings: float,
    ) -> None:
        """Nothing is taken yet. `settings`: of the iteration, fields of the C structure."""
        n = stages.counts
        nq, nv, rows, motors = (n[name] for name in ("nq", "nv", "closures", "motors"))
        size, steps = n["free"] + rows, len(found[0])
        widths = [*(motors,) * 3, n["forces"], nq, nv, nv, nv, rows, motors, 2]
        widths += [] if law is None else [law.sizes["drives"], law.sizes["measures"]]
        self.rows = (*(np.ascontiguousarray(x, dtype=np.float64) for x in path), *found)
        for x, width in zip(self.rows, widths, strict=True):
            if x.shape != (steps, width) or x.dtype != float or not x.flags.c_contiguous:
                raise PinflexError(f"kernel: {x.shape} numbers, not {(steps, width)} in one piece.")
        self._stages, self._steps, self._widths, self.law = stages, steps, widths, law
        self._first = tuple(x.ctypes.data for x in self.rows)
        sizes = n | {"size": size, "order": 3 * size + 1, "wide": nv * (3 * nv + rows)}
        self._states = {which: Record("State", n, {}) for which in _STATES}
        self._room = Record(
            "Alpha", sizes, {"predict": predict}, stale=1, joints=stages.address, rate=1.0,
            usual=np.inf, stopped=-1, law=None if law is None else law.address, **settings,
        )  # fmt: skip
        self.at, self.residual = self._room.at, self._room.arrays["r"]
        self._blocks = (self._room.raw, *(state.raw for state in self._states.values()))
        self._fresh = bytes(self.at)

    def begin(self, now: Sequence[Array], last: Sequence[Array]) -> None:
        """Go on from a state, with a new tangent."""
        for which, state in self._states.items():  # they have changed places
            setattr(self.at, which, state.at)
        for which, given in (("now", now), ("last", last)):
            for name, values in zip(_OF_STATE, given, strict=True):
                self._states[which].arrays[name][...] = values
        self.at.stale, self.at.curved = 1, -1

    def march(self, first: int, count: int) -> int:
        """Up to so many steps, the first to instant `first`; the number of steps taken."""
        return self.marcher(first, count)()

    def marcher(self, first: int, count: int) -> Callable[[], int]:
        """`march`, ready to be called again and again with nothing to be made for a call."""
        if not (first > 0 and count >= 0 and first + count <= self._steps):
            raise PinflexError(f"kernel: {count} steps from {first}, of {self._steps}.")
        rows = _Rows(*(
            at + 8 * first * width for at, width in zip(self._first, self._widths, strict=True)
        ))  # fmt: skip
        stages, at = self._stages, ctypes.addressof(self.at)
        given = stages.tables, stages.work, at, count, ctypes.addressof(rows)
        function = stages.functions.pinflex_alpha

        def march(_: object = rows) -> int:  # which lives as long as the function
            return int(function(*given))

        return march

    def forget(self) -> None:
        """Scales and counts as of a run that has not begun."""
        ctypes.memmove(ctypes.addressof(self.at), self._fresh, len(self._fresh))

    def kept(self) -> tuple[bytes, ...]:
        """All that the steps go on with: state, factors, scales and counts."""
        return (bytes(self.at), *(x.tobytes() for x in (*self._blocks, *self.rows)))

    def go_back(self, kept: tuple[bytes, ...]) -> None:
        """Be as at the time of `kept`, to the last bit."""
        for array, was in zip((*self._blocks, *self.rows), kept[1:], strict=True):
            array[...] = np.frombuffer(was, array.dtype).reshape(array.shape)
        ctypes.memmove(ctypes.addressof(self.at), kept[0], ctypes.sizeof(self.at))

    def limit(self, tangents: int, every: int, most: int, stops: Sequence[Array] | None) -> None:
        """Bound what a step costs, and where the motors go.

        `tangents`: new ones in a step, `every`: steps between two (0: as it takes, both);
        `most`: iterations; `stops`: lowest and highest positions of the motors.
        """
        self.at.allowed, self.at.every, self.at.most = tangents, every, most
        if stops is not None:
            self._stops = tuple(np.array(x, dtype=np.float64) for x in stops)
            self.at.low, self.at.high = (x.ctypes.data for x in self._stops)
        self._fresh = bytes(self.at)


FULL, INPUTS, START, STUCK, PAUSED, SAMPLE, EVENT = (
    constant(name) for name in ("FULL", "INPUTS", "START", "STUCK", "PAUSED", "SAMPLE", "EVENT")
)
RESTARTS, HOLDS, ON = (constant(name) for name in ("RESTARTS", "HOLDS", "ON"))
MOST_STAGES, MOST_NODES = constant("MOST_STAGES"), constant("MOST_NODES")
_STATE = ("y", "v", "a", "lam", "torque")


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


def _no_table(columns: int) -> Table:
    """Inputs that are given stage by stage."""
    none = np.zeros(0)
    values = np.zeros((0, 0, columns))
    return Table(none, none, none, none, none, values, none, np.zeros((0, columns)), 0.0)


class MarchKernel:
    """The arrays of one run, and where it is: `March`, `Steps` and `Inputs` in source/march.h.

    Step 0 of the arrays is the last one before the batch.

    Attributes:
        at: The C structure: where the run is, its settings and counts.
        steps: Arrays of the steps by name, shape (capacity + 1, ...).
        y, v, a, lam, torque: The state that the next step starts from.
        input: Inputs of the stages, shape (s, columns), where they are given.
        piece, hit: Of laws of pieces, that each is in, and the speed it came there with, (kinks,).
        size: Of all arrays in bytes.
    """

    def __init__(
        self, stages: StageKernel, given: Given, table: Table, capacity: int,
        tangents: int,
    ) -> None:  # fmt: skip
        """`given`: what `March` reads of the run; without `weight` norms are of the mass matrix.

        `capacity`: steps of a batch; `tangents`: room for those that they are solved by.
        """
        n, nv, rows = stages.counts, stages.counts["nv"], stages.counts["closures"]
        size, measured, columns = n["free"] + rows, given["measured_at"], columns_of(n)
        if n["s"] > MOST_STAGES:
            raise PinflexError(f"kernel: {n['s']} stages, at most {MOST_STAGES}.")
        _require_rows(measured, nv)
        sizes = n | {
            "capacity": capacity, "steps": capacity + 1, "tangents": tangents,
            "kept": tangents + 1, "wide": nv * (3 * nv + rows) + n["joined"],  # one more for starts
            "stops": len(given["stop_at"]), "measured": len(measured), "columns": columns,
            "size": size, "starts": 2 * size + 1, "starts_x": 2 * size + nv + rows,
        }  # fmt: skip
        self._steps, self._table = Record("Steps", sizes, {}), table
        self._inputs = _inputs(table, n)
        self._run = Record(
            "March", sizes, given, by_mass=int("weight" not in given), stale=1,
            stages=stages.address, inputs=self._inputs.address, steps=self._steps.at,
        )  # fmt: skip
        self.size = self._steps.raw.nbytes + self._run.raw.nbytes
        self.at, self.steps, arrays = self._run.at, self._steps.arrays, self._run.arrays
        self.input, self.piece, self.hit = (arrays[name] for name in ("input", "piece", "hit"))
        self.y, self.v, self.a, self.lam, self.torque = (arrays[name] for name in _STATE)
        self._functions, self._counts, self._tables = stages.functions, n, stages.tables
        self._keep = stages.at, stages.raw, stages.evaluator  # C reads there, without the stages:
        # these hold this march, and a circle would wait for the garbage collection with both.
        self._call = (stages.tables, stages.work, self._run.address)
        self._widths = (n["nq"], nv, nv, rows, n["motors"], 2)
        self._new = bytes(self.at)

    def begin_anew(self, given: Given, table: Table) -> None:
        """Take over another run of the same sizes, as if these arrays were new."""
        if table is not self._table:
            self._inputs, self._table = _inputs(table, self._counts), table
        ctypes.memmove(ctypes.byref(self.at), self._new, len(self._new))
        self.at.inputs = self._inputs.address
        _require_rows(given["measured_at"], self._counts["nv"])
        for name, array in given.items():
            self._run.arrays[name][...] = array.reshape(self._run.arrays[name].shape)

    def advance(self) -> int:
        """Steps until the batch is full, or something else has to answer."""
        return int(self._functions.pinflex_march(*self._call))

    def begin(self) -> bool:
        """Consistent a, lam and torque at t, y and v; False where they are not unique."""
        return bool(self._functions.pinflex_begin(*self._call))

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


def _require_rows(measured: IntArray, nv: int) -> None:
    if np.any(measured < 0) or np.any(measured >= nv):
        raise PinflexError("kernel: measured: a row that is none.")


def columns_of(counts: Mapping[str, int]) -> int:
    """Columns of the inputs: three of each motor, and a share of each load."""
    return 3 * counts["motors"] + counts["forces"]


def _inputs(table: Table, counts: Mapping[str, int]) -> Record:
    pieces, nodes, _ = table.value.shape
    if nodes > MOST_NODES:
        raise PinflexError(f"kernel: {nodes} nodes of a piece, at most {MOST_NODES}.")
    sizes = {"pieces": pieces, "nodes": nodes, "corners": len(table.corner)}
    return Record("Inputs", sizes | {"columns": columns_of(counts)}, vars(table), gap=table.gap)


def _numbers(x: Array | Sequence[float]) -> Array:
    return np.ascontiguousarray(x, dtype=np.float64)
