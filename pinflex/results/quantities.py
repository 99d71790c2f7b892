"""Output quantities added from outside: computed from a Result when read by name, never stored."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinflex import registered
from pinflex.arrays import Array
from pinflex.errors import DescriptionError
from pinflex.results.keys import KEYS

if TYPE_CHECKING:
    from pinflex.results.result import Result

# Heads of the keys that every result has of itself.
_OWN = {"t", *(one.key.partition("/")[0] for one in KEYS)}


@dataclass(frozen=True)
class Quantity:
    """An output with a name.

    Attributes:
        key: Flat key under which `Result.array` gives it, as in "power" or "power/total".
        unit: Of its values, as figures and tables write it.
        label: In words, for axes and headings.
        function: From a result to values, shape (nt,) or (nt, ...), time first.
        colour: Of its curve, or None: the first of the palette.
    """

    key: str
    unit: str
    label: str
    function: Callable[[Result], Array]
    colour: str | None = None

    def of(self, result: Result) -> Array:
        """Its values in a result, read-only.

        Raises:
            DescriptionError: The function gives something that has not the instants of the result.
        """
        values = np.array(self.function(result), dtype=np.float64)
        if values.shape[:1] != result.t.shape:
            raise DescriptionError(
                f"quantity {self.key}: shape {values.shape} does not start with the "
                f"{len(result.t)} instants of t. Arrays are time first.",
                key=self.key,
            )
        values.setflags(write=False)
        return values


QUANTITIES: dict[str, Quantity] = {}


def register_quantity(quantity: Quantity) -> None:
    """Add an output; from then on every result answers to its key, and `plot.spectrum` draws it.

    Args:
        quantity: The output.
    Raises:
        DescriptionError: The key is taken, or that of an array that runs store.
    """
    if quantity.key in QUANTITIES or quantity.key.partition("/")[0] in _OWN:
        raise DescriptionError(f"quantity {quantity.key}: the key is taken. Choose another.")
    QUANTITIES[quantity.key] = quantity
    registered.note(register_quantity, quantity.key, quantity)
