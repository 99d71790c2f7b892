"""Steps of a run corrected by a scheme of more stages, compiled, many in a call."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.kernel.stages import StageKernel

_COUNTS, _INTEGERS = ("count", "factored"), ("tangent", "times")
_NUMBERS = (
    *("h", "M", "C", "K", "J", "run_y", "run_v", "position", "velocity", "scale"),
    *("y", "v", "a", "lam", "turn", "move", "stage_v", "r", "da", "dlam", "change"),
)


class _Corrections(ctypes.Structure):
    # As in source/correct.c.
    _fields_ = [
        *((name, ctypes.c_int64) for name in _COUNTS),
        *((name, ctypes.c_void_p) for name in (*_INTEGERS, *_NUMBERS)),
    ]


@dataclass(frozen=True)
class Corrected:
    """Steps after their correction, arrays (n, s, .) but for y and v.

    Attributes:
        y, v: Where each step starts, and the end of the last, shapes (n + 1, nq), (n + 1, nv).
        a, lam, turn, move, velocity: The stages.
        r: Residuals before the last correction. da, dlam, change: That correction: of free rows,
            of closures, and of the displacement in all rows.
    """

    y: Array
    v: Array
    a: Array
    lam: Array
    turn: Array
    move: Array
    velocity: Array
    r: Array
    da: Array
    dlam: Array
    change: Array


def correct_steps(
    kernel: StageKernel,
    h: Array,
    tangent: IntArray,
    times: IntArray,
    tangents: Mapping[str, Array],
    run: tuple[Array, Array],
    start: tuple[Array, Array],
    inputs: tuple[Array, Array, Array],
    guess: tuple[Array, Array, Array],
    factored: bool,
) -> Corrected:
    """Correct n steps, each from the end of the corrected one before it.

    Args:
        kernel: Stages of the correcting scheme. h: Lengths in s, shape (n,).
        tangent: Which of the tangents each step was solved by, shape (n,).
        times: Corrections to make, shape (n,).
        tangents: "M", "C", "K" (k, free, free) and "J" (k, rows, free).
        run: Where the steps of the run start, y (n, nq) and v (n, nv).
        start: Where the first corrected step starts, y (nq,) and v (nv,).
        inputs: Positions and velocities of the motors, shares of the loads, each (n, s, .).
        guess: a (n, s, nv), lam (n, s, rows) and turn (n, s, nv).
        factored: Whether the factors at hand are those of the first step.
    Raises:
        LinAlgError: The equations of a step are singular.
    """
    n, s, nv = guess[0].shape
    free, rows = tangents["M"].shape[1], guess[1].shape[2]
    y, v = np.empty((n + 1, run[0].shape[1])), np.empty((n + 1, nv))
    y[0], v[0] = start
    given = {
        "h": h, **tangents, "run_y": run[0], "run_v": run[1],
        "position": inputs[0], "velocity": inputs[1], "scale": inputs[2],
        "a": guess[0], "lam": guess[1], "turn": guess[2],
    }  # fmt: skip
    arrays = {name: np.ascontiguousarray(x, dtype=np.float64) for name, x in given.items()}
    whole, of_free, of_rows = (n, s, nv), (n, s, free), (n, s, rows)
    arrays |= {"y": y, "v": v, "da": np.empty(of_free), "dlam": np.empty(of_rows)}
    arrays |= {name: np.zeros(whole) for name in ("move", "stage_v", "r", "change")}
    integers = [np.ascontiguousarray(x, dtype=np.int64) for x in (tangent, times)]
    pointers = [x.ctypes.data for x in (*integers, *(arrays[name] for name in _NUMBERS))]
    done = kernel.correct_steps(_Corrections(n, int(factored), *pointers))
    if done < n:
        raise np.linalg.LinAlgError("singular iteration matrix")
    last = ("move", "stage_v", "r", "da", "dlam", "change")
    return Corrected(y, v, arrays["a"], arrays["lam"], arrays["turn"], *(arrays[k] for k in last))
