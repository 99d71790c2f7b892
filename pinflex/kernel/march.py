"""The steps of a run, compiled: the arrays of a batch of steps and where the run is.

The fields are those of `March`, `Steps` and `Inputs` in source/march.h, which says what they
hold. Step 0 of the arrays is the last one before the batch.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array, IntArray
from pinflex.errors import PinflexError
from pinflex.kernel.evaluate import Evaluator
from pinflex.kernel.library import constant, names, structure

# The stages of a collocation step, compiled.
#
# The fields are those of `Stages` in source/stages.h, which says what they hold. The arrays of a
# step are those of this object: they change with every call.

# Arrays for the C code in one block: numpy's answer to where an array lies takes 1 us each.

_ALIGNED = 64  # bytes


class Block:
    """Arrays of one type, zero or given, each at a multiple of 64 bytes.

    Attributes:
        arrays, addresses: By name. raw: All of them in one. size: Bytes.
    """

    def __init__(
        self,
        shapes: Mapping[str, tuple[int, ...]],
        given: Mapping[str, npt.NDArray[Any]],
        dtype: npt.DTypeLike = np.float64,
    ) -> None:
        """`shapes`: of arrays of zeros by name; `given`: what others hold."""
        wide = np.dtype(dtype).itemsize
        every = _ALIGNED // wide
        shapes = dict(shapes) | {name: array.shape for name, array in given.items()}
        sizes = [_size(shape) for shape in shapes.values()]
        self.raw = np.zeros(sum(sizes) + every * (len(sizes) + 1), dtype=dtype)
        self.size = self.raw.nbytes
        first = self.raw.ctypes.data
        at = -first % _ALIGNED // wide
        self.arrays: dict[str, npt.NDArray[Any]] = {}
        self.addresses: dict[str, int] = {}
        for (name, shape), size in zip(shapes.items(), sizes, strict=True):
            self.arrays[name] = self.raw[at : at + size].reshape(shape)
            self.addresses[name] = first + at * wide
            at += (size + every - 1) // every * every
        for name, array in given.items():
            self.arrays[name][...] = array


def _size(shape: tuple[int, ...]) -> int:
    size = 1
    for n in shape:
        size *= n
    return size


_Stages = structure("Stages")
_LANES = constant("LANES")


@dataclass(frozen=True)
class Scheme:
    """A collocation scheme in plain arrays (see `pinflex.integrators.collocation`)."""

    c: Array
    A: Array
    A2: Array
    A2_inverse: Array
    values: Array
    forward: Array
    back: Array


@dataclass(frozen=True)
class Rows:
    """Coordinates of a system by how they move.

    Attributes:
        prescribed: Whether the motors follow their motion exactly; else torques drive them.
        free_at: Velocity rows that the steps solve for.
        motor_v, motor_q, motor_paired: Motors: velocity row, coordinate, and whether that is a
            cosine with its sine behind it.
        plain_q, plain_v: Coordinates and rows of rigid joints that move by addition.
        circle_q, circle_v: Of joints that keep (cos, sin). ball_q, ball_v: Of balls.
        body_q, body_v, body_flat: Of free joints, and of planar ones (flat: 1).
    """

    prescribed: bool
    free_at: IntArray
    motor_v: IntArray
    motor_q: IntArray
    motor_paired: IntArray
    plain_q: IntArray
    plain_v: IntArray
    circle_q: IntArray
    circle_v: IntArray
    ball_q: IntArray
    ball_v: IntArray
    body_q: IntArray
    body_v: IntArray
    body_flat: IntArray


class StageKernel:
    """The stages of one step at a time, their arrays all in one block.

    Attributes:
        y0, v0: Start. a, turn: Unknowns, shape (s, nv). y, v, move: What follows from them.
        kp, kd: Gains of driven motors.
        held: Generalised forces of a digital controller, (nv,), where one acts (`take_hold`).
        lists: How its rows move, and the gains, by name.
        counts: Sizes by name. functions: The C code. tables, work, address: Of the system, its
            workspace, and the C structure of the stages. size: Of all arrays in bytes.
    """

    def __init__(self, evaluator: Evaluator, scheme: Scheme, rows: Rows) -> None:
        self._evaluator = evaluator
        n, s, values = evaluator.tables.counts, len(scheme.c), len(scheme.values)
        nq, nv, closures, forces = (n[name] for name in ("nq", "nv", "closures", "forces"))
        free, motors = len(rows.free_at), len(rows.motor_v)
        size = free + closures
        names = (field.name for field in fields(Rows) if field.name != "prescribed")
        order = (17 + 2 * ((size + 63) // 64)) * size + 1  # sparsity.h
        integers = Block(
            {"pivot": (values * size + order,)}, {k: getattr(rows, k) for k in names}, np.int64
        )
        shapes = {
            "M": (free, free), "C": (free, free), "K": (free, free), "J": (closures, free),
            "lu": (-(-values // _LANES), size, size, 2, _LANES),
            "part": (2 * (_LANES + 1) * size + nv,), "y0": (nq,),
            "v0": (nv,),
            "position": (s, motors), "velocity": (s, motors), "feed": (s, motors),
            "kp": (motors,), "kd": (motors,), "held": (nv,), "torque": (s, motors),
            "scale": (s, forces),
            "a": (s, nv), "lam": (s, closures), "turn": (s, nv), "y": (s, nq), "v": (s, nv),
            "move": (s, nv), "r": (s, nv), "open": (s, closures), "da": (s, free),
            "dlam": (s, closures), "change": (s, nv),
        }  # fmt: skip
        real = {name: getattr(scheme, name) for name in ("c", "A", "A2", "A2_inverse")}
        pairs = {"value": scheme.values, "forward": scheme.forward, "back": scheme.back}
        numbers = Block(shapes, real | {name: _pairs(x) for name, x in pairs.items()})
        self._keep, self.size = (integers, numbers), integers.size + numbers.size
        arrays = numbers.arrays
        pointers = numbers.addresses | integers.addresses
        self._structure = _Stages(
            s=s, values=values, free=free, motors=motors, prescribed=int(rows.prescribed),
            plain=len(rows.plain_v), circles=len(rows.circle_v), balls=len(rows.ball_v),
            bodies=len(rows.body_v),
            **pointers,
        )  # fmt: skip
        self.lists = {k: x for k, x in integers.arrays.items() if k != "pivot"}
        self.lists |= {k: arrays[k] for k in ("kp", "kd")}
        self.y0, self.v0, self.a, self.turn = (arrays[name] for name in ("y0", "v0", "a", "turn"))
        self.y, self.v, self.move = (arrays[name] for name in ("y", "v", "move"))
        self.kp, self.kd, self.held = arrays["kp"], arrays["kd"], arrays["held"]
        self._held = pointers["held"]
        joined = int(evaluator.tables.arrays["joined_at"][-1])
        self.counts = {**n, "s": s, "free": free, "motors": motors, "joined": joined}
        self.functions, self.work = evaluator.functions, evaluator.work
        self.tables, self.address = evaluator.tables.address, ctypes.addressof(self._structure)

    def field(self, name: str) -> int:
        """A number of the C structure."""
        return int(getattr(self._structure, name))

    def take_hold(self, acts: bool) -> None:
        """Let a digital controller act, with no force at first, or none."""
        self.held[...] = 0.0
        self._structure.held = self._held if acts else None

    def place(self, h: float) -> None:
        """y, v and move from a and turn, for a step h (s)."""
        self._structure.h = h
        self.functions.pinflex_place(self.tables, self.address)


def _pairs(x: Array) -> Array:
    """Real and imaginary parts side by side."""
    return np.ascontiguousarray(x, dtype=complex).view(float)


# A continuous linear feedback in equal steps, compiled.
#
# The fields are those of `Law` in source/law.h, which says what they hold.

_Law = structure("Law")


class LawKernel:
    """The tables of a feedback, and where it is.

    Attributes:
        address: Of the C structure. measures, drives: Their numbers.
        x, e: States and errors where the last step ended. target: What errors are counted from.
    """

    def __init__(self, tables: Mapping[str, Array], nq: int, nv: int) -> None:
        """`tables`: S, B, home, target, x_of_x, x_of_e, C, D and E by name."""
        n, m, u = len(tables["S"]), len(tables["x_of_x"]), tables["B"].shape[1]
        wanted = {
            "S": (n, nv), "B": (nv, u), "home": (nq,), "target": (n,), "x_of_x": (m, m),
            "x_of_e": (m, n), "C": (u, m), "D": (u, n), "E": (u, n),
        }  # fmt: skip
        for name, shape in wanted.items():
            if tables[name].shape != shape:
                raise PinflexError(f"kernel: {name} of {tables[name].shape}, not {shape}.")
        room = {"x_before": (m,), "e_before": (n,), "x": (m,), "e": (n,), "rate": (n,), "u": (u,)}
        given = {name: np.asarray(tables[name], dtype=np.float64) for name in wanted}
        self._numbers = Block({**room, "way": (nv,)}, given)
        self._at = _Law(measures=n, drives=u, states=m, **self._numbers.addresses)
        self.address, self.measures, self.drives = ctypes.addressof(self._at), n, u
        self.x, self.e = (self._numbers.arrays[name] for name in ("x_before", "e_before"))
        self.target = tables["target"]


# Equal steps of the alpha family, compiled.
#
# The fields are those of `Alpha`, `State` and `Rows` in source/alpha.c, which says what they hold.

_Alpha, _State, _Rows = (structure(name) for name in ("Alpha", "State", "Rows"))
_STAGE_STATE = names("State", ctypes.c_void_p)
_STATES = ("now", "last", "next")
_ROOM = ("move", "r", "open", "x", "tangent", "lu", "weight", "motor_rows", "motor_J",
         "narrow", "room")  # fmt: skip


@dataclass(frozen=True)
class Iteration:
    """What Newton's iteration of a step is about.

    Attributes:
        predict: From a, and the a, s and v before it, to s, v and the move, shape (3, 4).
        mass, by_v, by_y: Weights of M, C and K.
        tolerance: Error of the acceleration, of what it is at the time.
        most: Iterations of a step. farthest: m or rad that an elastic coordinate may go.
    """

    predict: Array
    mass: float
    by_v: float
    by_y: float
    tolerance: float
    most: int
    farthest: float


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
        given: Iteration,
        path: Sequence[Array],
        found: Sequence[Array],
        law: LawKernel | None = None,
    ) -> None:
        """Nothing is taken yet."""
        n = stages.counts
        nq, nv, rows, motors = (n[name] for name in ("nq", "nv", "closures", "motors"))
        free, steps = n["free"], len(found[0])
        size = free + rows
        widths = [*(motors,) * 3, n["forces"], nq, nv, nv, nv, rows, motors, 2]
        widths += [] if law is None else [law.drives, law.measures]
        self.rows = (*(np.ascontiguousarray(x, dtype=np.float64) for x in path), *found)
        for x, width in zip(self.rows, widths, strict=True):
            if x.shape != (steps, width) or x.dtype != float or not x.flags.c_contiguous:
                raise PinflexError(f"kernel: {x.shape} numbers, not {(steps, width)} in one piece.")
        state = dict(zip(_STAGE_STATE, (nq, nv, nv, nv, rows), strict=True))
        shapes: dict[str, tuple[int, ...]] = {
            f"{which}_{name}": (width,) for which in _STATES for name, width in state.items()
        }
        shapes |= {
            "move": (nv,), "r": (nv,), "open": (rows,), "x": (size,),
            "tangent": (nv * (3 * nv + rows),), "lu": (size, size), "weight": (free,),
            "motor_rows": (motors, free), "motor_J": (rows, motors),
            "narrow": (size, size), "room": (size,),
        }  # fmt: skip
        self._numbers = Block(shapes, {"predict": given.predict})
        self.residual = self._numbers.arrays["r"]
        self._integers = Block({"pivot": (size + 1,), "order": (3 * size + 1,)}, {}, np.int64)
        self._stages, self._steps, self._widths, self.law = stages, steps, widths, law
        self._first = tuple(x.ctypes.data for x in self.rows)
        where = self._numbers.addresses
        self.at = _Alpha(
            most=given.most, stale=1, joints=stages.address, predict=where["predict"],
            law=None if law is None else law.address,
            **self._integers.addresses, mass=given.mass, by_v=given.by_v,
            by_y=given.by_y, tolerance=given.tolerance, farthest=given.farthest, rate=1.0,
            usual=np.inf, stopped=-1, **{name: where[name] for name in _ROOM},
        )  # fmt: skip
        self._fresh = bytes(self.at)

    def begin(self, now: Sequence[Array], last: Sequence[Array]) -> None:
        """Go on from a state, with a new tangent."""
        arrays, where = self._numbers.arrays, self._numbers.addresses
        for which in _STATES:  # they have changed places
            setattr(self.at, which, _State(*(where[f"{which}_{name}"] for name in _STAGE_STATE)))
        for which, state in (("now", now), ("last", last)):
            for name, values in zip(_STAGE_STATE, state, strict=True):
                arrays[f"{which}_{name}"][...] = values
        self.at.stale = 1

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
        blocks = (block.raw.tobytes() for block in (self._numbers, self._integers))
        return (*blocks, bytes(self.at), *(x.tobytes() for x in self.rows))

    def go_back(self, kept: tuple[bytes, ...]) -> None:
        """Be as at the time of `kept`, to the last bit."""
        arrays = self._numbers.raw, self._integers.raw, *self.rows
        for array, was in zip(arrays, (*kept[:2], *kept[3:]), strict=True):
            array[...] = np.frombuffer(was, array.dtype).reshape(array.shape)
        ctypes.memmove(ctypes.addressof(self.at), kept[2], ctypes.sizeof(self.at))

    def limit(self, tangents: int, every: int, most: int, stops: Sequence[Array] | None) -> None:
        """Bound what a step costs, and where the motors go.

        `tangents`: new ones in a step, `every`: steps between two (0: as it takes, both);
        `most`: iterations; `stops`: lowest and highest positions of the motors.
        """
        self.at.allowed, self.at.every, self.at.most = tangents, every, most
        if stops is not None:
            names = ("low", "high")
            self._stops = Block({}, dict(zip(names, stops, strict=True)))
            for name in names:
                setattr(self.at, name, self._stops.addresses[name])
        self._fresh = bytes(self.at)


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
            "tangent_at": (tangents + 1, nv * (3 * nv + rows) + n["joined"]),
            "input": (s, _columns(stages)),
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
        self.input = at["input"]
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
