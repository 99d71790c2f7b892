"""Newton's iteration on the stages of a collocation step, compiled.

The fields follow those of `Stages` in source/stages.h, which says what they hold. The arrays of a
step are those of this object: they change with every call.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, fields

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.kernel.evaluate import Evaluator
from pinflex.kernel.memory import Block

_COUNTS = ("s", "values", "free", "motors", "prescribed", "plain", "circles", "balls")
_ARRAYS = (
    *("free_at", "motor_v", "motor_q", "motor_paired"),
    *("plain_q", "plain_v", "circle_q", "circle_v", "ball_q", "ball_v"),
    *("c", "A", "A2", "A2_inverse", "value", "forward", "back"),
    *("M", "C", "K", "J", "lu", "part", "pivot"),
    *("y0", "v0", "position", "velocity", "scale", "a", "lam", "turn"),
    *("y", "v", "move", "r", "open", "da", "dlam", "change"),
)


class _Stages(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int64) for name in _COUNTS),
        *((name, ctypes.c_void_p) for name in _ARRAYS),
        ("h", ctypes.c_double),
    ]


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
        free_at: Velocity rows that the steps solve for.
        motor_v, motor_q, motor_paired: Prescribed motors: velocity row, coordinate, and whether
            that is a cosine with its sine behind it; none where motors give torques.
        plain_q, plain_v: Coordinates and rows of rigid joints that move by addition.
        circle_q, circle_v: Of joints that keep (cos, sin). ball_q, ball_v: Of balls.
    """

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


class StageKernel:
    """The stages of one step at a time.

    Attributes:
        y0, v0: Start. position, velocity: Motors at the stages. scale: Of the loads there.
        a, lam, turn: Unknowns, shapes (s, nv), (s, rows), (s, nv).
        y, v, move: What follows from them, (s, nq), (s, nv), (s, nv).
        r, open: Residuals (s, nv) and closures (s, rows) that the last correction was for.
        da, dlam, change: That correction: (s, free), (s, rows), and of the displacement (s, nv).
        counts: Sizes by name. functions: The C code. tables, work, address: Of the system, its
            workspace, and the C structure of the stages. size: Of all arrays in bytes.
    """

    def __init__(self, evaluator: Evaluator, scheme: Scheme, rows: Rows) -> None:
        self._evaluator = evaluator
        n, s, values = evaluator.tables.counts, len(scheme.c), len(scheme.values)
        nq, nv, closures, forces = (n[name] for name in ("nq", "nv", "closures", "forces"))
        free, motors = len(rows.free_at), len(rows.motor_v)
        size = free + closures
        names = (field.name for field in fields(Rows))
        integers = Block(
            {"pivot": ((values + 2) * size + 1,)}, {k: getattr(rows, k) for k in names}, np.int64
        )
        shapes = {
            "M": (free, free), "C": (free, free), "K": (free, free), "J": (closures, free),
            "lu": (values, 2, size, size), "part": (2 * values * size + nv,), "y0": (nq,),
            "v0": (nv,),
            "position": (s, motors), "velocity": (s, motors), "scale": (s, forces),
            "a": (s, nv), "lam": (s, closures), "turn": (s, nv), "y": (s, nq), "v": (s, nv),
            "move": (s, nv), "r": (s, nv), "open": (s, closures), "da": (s, free),
            "dlam": (s, closures), "change": (s, nv),
        }  # fmt: skip
        real = {name: getattr(scheme, name) for name in ("c", "A", "A2", "A2_inverse")}
        pairs = {"value": scheme.values, "forward": scheme.forward, "back": scheme.back}
        numbers = Block(shapes, real | {name: _pairs(x) for name, x in pairs.items()})
        self._keep, self.size = (integers, numbers), integers.size + numbers.size
        self._arrays = arrays = numbers.arrays
        pointers = numbers.addresses | integers.addresses
        self._structure = _Stages(
            s, values, free, motors, int(motors > 0), len(rows.plain_v), len(rows.circle_v),
            len(rows.ball_v), **pointers,
        )  # fmt: skip
        self.y0, self.v0, self.scale = arrays["y0"], arrays["v0"], arrays["scale"]
        self.position, self.velocity = arrays["position"], arrays["velocity"]
        self.a, self.lam, self.turn = arrays["a"], arrays["lam"], arrays["turn"]
        self.y, self.v, self.move = arrays["y"], arrays["v"], arrays["move"]
        self.r, self.open, self.change = arrays["r"], arrays["open"], arrays["change"]
        self.da, self.dlam = arrays["da"], arrays["dlam"]
        self.counts = {**n, "s": s, "free": free, "motors": motors}
        self.functions, self.work = evaluator.functions, evaluator.work
        self.tables, self.address = evaluator.tables.address, ctypes.addressof(self._structure)
        self._c, self._both = self.functions, (self.tables, self.address)
        states = (pointers[name] for name in ("y", "v", "a", "lam", "scale", "r", "open"))
        self._states = (self.tables, self.work, s, *states)

    def place(self, h: float) -> None:
        """y, v and move from a and turn, for a step h (s)."""
        self._structure.h = h
        self._c.pinflex_place(*self._both)

    def residual(self) -> None:
        """r and open from y, v, a, lam and scale."""
        self._c.pinflex_residuals(*self._states)

    def factor(self, M: Array, C: Array, K: Array, J: Array, h: float) -> bool:
        """Factors of Newton's matrices; False where one is singular.

        Args:
            M, C, K: Tangent in the free rows and columns. J: Shape (rows, free). h: Step in s.
        """
        self._structure.h = h
        for name, part in zip("MCKJ", (M, C, K, J), strict=True):
            self._arrays[name][...] = part
        return bool(self._c.pinflex_factor(*self._both))

    def solve(self) -> None:
        """dlam, and dz in the free rows of `change`, from r and open."""
        self._c.pinflex_solve(*self._both)

    def correct(self) -> None:
        """da, dlam and change from r and open; a and lam move by them."""
        self._c.pinflex_correct(*self._both)


def _pairs(x: Array) -> Array:
    """Real and imaginary parts side by side."""
    return np.ascontiguousarray(x, dtype=complex).view(float)
