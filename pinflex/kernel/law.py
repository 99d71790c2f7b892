"""A continuous linear feedback in equal steps, compiled.

The fields are those of `Law` in source/law.h, which says what they hold.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import PinflexError
from pinflex.kernel.header import structure
from pinflex.kernel.memory import Block

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
