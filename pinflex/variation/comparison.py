"""How measurements are compared with a scene: residuals and their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.mechanism import Mechanism
from pinflex.variation.variants import Variants, keys

_STEP = 1e-3  # of a logarithm: truncation 1e-6, noise of a solved output 1e-6


@dataclass(frozen=True)
class Panel:
    """Measured and calculated values of one quantity, for a plot.

    Attributes:
        title, along, unit: Of the panel, of its axis x, of its values.
        x, measured, model: Shape (n,). std: Standard deviations, shape (n,), or None.
    """

    title: str
    along: str
    unit: str
    x: Array
    measured: Array
    model: Array
    std: Array | None = None


class Comparison(Protocol):
    """Measurements of one kind."""

    @property
    def told(self) -> bool:
        """Whether the standard deviations are known."""

    @property
    def leads(self) -> bool:
        """Whether there are other rows that lead to the right place from afar."""

    def rows(self, mechanism: Mechanism, coarse: bool = False) -> Array:
        """Residuals (model - measured) in standard deviations, or in shares of a size.

        Args:
            mechanism: The model.
            coarse: Those that lead from afar, if there are others for that.
        """

    def jacobian(self, designs: Variants, values: Mapping[str, float], base: Mechanism) -> Array:
        """Derivatives of the rows by the logarithms of the parameters, shape (rows, n).

        Args:
            designs: The parameters.
            values: Where, by key. base: The design there.
        """

    def text(self, mechanism: Mechanism) -> str:
        """Measured and calculated numbers, for people."""

    def panels(self, mechanism: Mechanism) -> list[Panel]:
        """The same for a plot."""


def differences(
    rows: Callable[[Mechanism], Array], designs: Variants, values: Mapping[str, float]
) -> Array:
    """Central differences of rows by the logarithms of the parameters, shape (rows, n).

    Args:
        rows: Of a design.
        designs: The parameters.
        values: Where, by key.
    """
    found = []
    for key in keys(designs.parameters):
        below, above = (
            rows(designs.at({**values, key: values[key] * float(np.exp(h))}))
            for h in (-_STEP, _STEP)
        )
        found.append((above - below) / (2 * _STEP))
    return np.array(found).T
