"""Equal steps of the alpha family, compiled.

The fields are those of `Alpha`, `State` and `Rows` in source/alpha.c, which says what they hold.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import PinflexError
from pinflex.kernel.header import names, structure
from pinflex.kernel.law import LawKernel
from pinflex.kernel.memory import Block
from pinflex.kernel.stages import StageKernel

_Alpha, _State, _Rows = (structure(name) for name in ("Alpha", "State", "Rows"))
_STATE = names("State", ctypes.c_void_p)
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
        self._rows = (*(np.ascontiguousarray(x, dtype=np.float64) for x in path), *found)
        for x, width in zip(self._rows, widths, strict=True):
            if x.shape != (steps, width) or x.dtype != float or not x.flags.c_contiguous:
                raise PinflexError(f"kernel: {x.shape} numbers, not {(steps, width)} in one piece.")
        state = dict(zip(_STATE, (nq, nv, nv, nv, rows), strict=True))
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
        self._first = tuple(x.ctypes.data for x in self._rows)
        where = self._numbers.addresses
        self.at = _Alpha(
            most=given.most, stale=1, joints=stages.address, predict=where["predict"],
            law=None if law is None else law.address,
            **self._integers.addresses, mass=given.mass, by_v=given.by_v,
            by_y=given.by_y, tolerance=given.tolerance, farthest=given.farthest, rate=1.0,
            usual=np.inf, **{name: where[name] for name in _ROOM},
        )  # fmt: skip

    def begin(self, now: Sequence[Array], last: Sequence[Array]) -> None:
        """Go on from a state, with a new tangent."""
        arrays, where = self._numbers.arrays, self._numbers.addresses
        for which in _STATES:  # they have changed places
            setattr(self.at, which, _State(*(where[f"{which}_{name}"] for name in _STATE)))
        for which, state in (("now", now), ("last", last)):
            for name, values in zip(_STATE, state, strict=True):
                arrays[f"{which}_{name}"][...] = values
        self.at.stale = 1

    def march(self, first: int, count: int) -> int:
        """Up to so many steps, the first to instant `first`; the number of steps taken."""
        if not (first > 0 and count >= 0 and first + count <= self._steps):
            raise PinflexError(f"kernel: {count} steps from {first}, of {self._steps}.")
        rows = _Rows(*(
            at + 8 * first * width for at, width in zip(self._first, self._widths, strict=True)
        ))  # fmt: skip
        stages = self._stages
        return int(stages.functions.pinflex_alpha(
            stages.tables, stages.work, ctypes.addressof(self.at), count, ctypes.addressof(rows)
        ))  # fmt: skip
