"""The stages of a collocation step, compiled.

The fields are those of `Stages` in source/stages.h, which says what they hold. The arrays of a
step are those of this object: they change with every call.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, fields

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.kernel.evaluate import Evaluator
from pinflex.kernel.header import structure
from pinflex.kernel.memory import Block

_Stages = structure("Stages")


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
        integers = Block(
            {"pivot": ((values + 2) * size + 1,)}, {k: getattr(rows, k) for k in names}, np.int64
        )
        shapes = {
            "M": (free, free), "C": (free, free), "K": (free, free), "J": (closures, free),
            "lu": (values, 2, size, size), "part": (2 * values * size + nv,), "y0": (nq,),
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
        self.y0, self.v0, self.a, self.turn = (arrays[name] for name in ("y0", "v0", "a", "turn"))
        self.y, self.v, self.move = (arrays[name] for name in ("y", "v", "move"))
        self.kp, self.kd, self.held = arrays["kp"], arrays["kd"], arrays["held"]
        self._held = pointers["held"]
        self.counts = {**n, "s": s, "free": free, "motors": motors}
        self.functions, self.work = evaluator.functions, evaluator.work
        self.tables, self.address = evaluator.tables.address, ctypes.addressof(self._structure)

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
