"""How measurements are compared with a scene: residuals and their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.mechanism import Mechanism
from pinflex.variation.variants import Variants, keys

_ALIKE = 0.2  # of a logarithm, of values among each other
_NEAR = 0.6  # of a logarithm, to a factor of units: a scene may be so far off before its fit
# Units that are written by mistake, by that which is meant: their values over the right ones.
_UNITS = {
    "Hz": {"rad/s": 2 * np.pi, "kHz": 1e-3, "rpm": 60.0},
    "m": {"mm": 1e3},
    "rad": {"degrees": 180 / np.pi},
}
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

    def ratios(self, mechanism: Mechanism) -> list[tuple[str, str, Array]]:
        """What tells a wrong unit: name, unit that is meant, measured over calculated values."""

    def text(self, mechanism: Mechanism) -> str:
        """Measured and calculated numbers, for people."""

    def panels(self, mechanism: Mechanism) -> list[Panel]:
        """The same for a plot."""


def wrong_units(ratios: list[tuple[str, str, Array]]) -> list[str]:
    """Sentences for quantities that are all alike a factor of two units away from the scene's."""
    said = []
    for name, unit, shares in ratios:
        if len(shares) < 2 or np.any(shares <= 0):
            continue
        middle = float(np.exp(np.mean(np.log(shares))))
        alike = float(np.max(np.abs(np.log(shares / middle)))) < _ALIKE
        for other, factor in _UNITS.get(unit, {}).items():
            if alike and abs(np.log(middle / factor)) < _NEAR:
                said.append(
                    f"{name}: all values are some {middle:.3g} times those of the scene. Are they "
                    f"in {other}? {unit} is meant."
                )
    return said


def differences(
    rows: Callable[[Mechanism], Array], designs: Variants, values: Mapping[str, float]
) -> Array:
    """Central differences of rows by the logarithms of the parameters, shape (rows, n)."""
    found = []
    for key in keys(designs.parameters):
        below, above = (
            rows(designs.at({**values, key: values[key] * float(np.exp(h))}))
            for h in (-_STEP, _STEP)
        )
        found.append((above - below) / (2 * _STEP))
    return np.array(found).T
