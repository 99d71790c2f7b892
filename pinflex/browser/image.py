"""What a run hands the kernel, its arrays and structures, laid out anew for WebAssembly.

Structures are those of the C sources (`pinflex.kernel.header`); there pointers take four bytes.
What they point to is found by its address, so that no field is listed here.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array

_WIDTH = {ctypes.c_int64: 8, ctypes.c_double: 8, ctypes.c_int: 4, ctypes.c_void_p: 4}
_KIND = {ctypes.c_int64: "i", ctypes.c_double: "d", ctypes.c_void_p: "p"}


class Image:
    """Arrays and structures of one scene.

    Attributes:
        arrays: Length, whether of whole numbers, and values or None (room), by number.
        names: Of arrays with values. structures: As page/heap.js reads them.
    """

    def __init__(self) -> None:
        self.arrays: list[tuple[int, str, Array | None]] = []
        self.names: dict[str, int] = {}
        self.structures: list[dict[str, Any]] = []
        self._array_at: dict[int, int] = {}
        self._structure_at: dict[int, int] = {}

    def add_arrays(
        self,
        arrays: Mapping[str, npt.NDArray[Any]],
        addresses: Mapping[str, int],
        given: Mapping[str, str],
    ) -> None:
        """Arrays by name where they lie; `given`: those with values, and what they are called."""
        for name, array in arrays.items():
            if not array.size:
                continue
            self._array_at[addresses[name]] = len(self.arrays)
            called = given.get(name)
            if called is not None:
                self.names[called] = len(self.arrays)
            values = None if called is None else np.array(array, dtype=float).ravel()
            kind = "i" if array.dtype.kind == "i" else "f"
            self.arrays.append((array.size, kind, values))

    def add_structure(self, structure: ctypes.Structure) -> int:
        """A structure whose arrays and structures are there already; its number."""
        address = ctypes.addressof(structure)
        if address in self._structure_at:
            return self._structure_at[address]
        laid: dict[str, Any] = {
            "integers": [], "numbers": [], "arrays": [], "structures": [], "fields": {}
        }  # fmt: skip
        laid["size"] = -(-self._lay(structure, laid, 0, "") // 8) * 8
        self._structure_at[address] = len(self.structures)
        self.structures.append(laid)
        return len(self.structures) - 1

    def _lay(self, structure: ctypes.Structure, laid: dict[str, Any], at: int, head: str) -> int:
        """Lay the fields from a place on; the place behind them."""
        fields: Any = structure._fields_
        for name, kind in fields:
            value = getattr(structure, name)
            if isinstance(value, ctypes.Structure):
                at = self._lay(value, laid, at, f"{head}{name}.")
                continue
            width = _WIDTH[kind]
            at = -(-at // width) * width
            laid["fields"][f"{head}{name}"] = at, _KIND.get(kind, "i")
            self._put(laid, at, kind, value)
            at += width
        return at

    def _put(self, laid: dict[str, Any], at: int, kind: Any, value: Any) -> None:
        if kind is ctypes.c_void_p:
            if value in self._array_at:
                laid["arrays"].append((at, self._array_at[value]))
            elif value in self._structure_at:
                laid["structures"].append((at, self._structure_at[value]))
        elif kind is ctypes.c_double:
            laid["numbers"].append((at, value if np.isfinite(value) else None))
        else:
            laid["integers"].append((at, int(value)))


def laid_out(image: Image) -> tuple[dict[str, Any], Array]:
    """The image as a header and one line of numbers, equal arrays once."""
    heads, parts, places, size = list[tuple[int, str, int]](), list[Array](), dict[bytes, int](), 0
    for n, kind, values in image.arrays:
        at = -1
        if values is not None:
            key = values.tobytes()
            if key not in places:
                places[key], size = size, size + n
                parts.append(values)
            at = places[key]
        heads.append((n, kind, at))
    line = np.concatenate(parts) if parts else np.zeros(0)
    return {"arrays": heads, "structures": image.structures}, line
