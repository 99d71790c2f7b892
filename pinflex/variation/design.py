"""A design found: before and after, what limits it, and the YAML that has it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.description import Description
from pinflex.report import Report, Reported, Words, table
from pinflex.text import frozen, number
from pinflex.variation.variants import write_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ACTIVE = 1e-3  # margin [ln] at which a limit holds the design
_AT_BOUND = 1e-4  # the same of a bound


@frozen
class Design(Reported):
    """The best numbers of a scene.

    Attributes:
        minimised: The output made least.
        parameters: Key paths; `first` and `best` values, shape (n,); `bounds`, shape (n, 2).
        before, after: Outputs of the first and of the best design, SI units.
        limits: In words; `margins` in ln, shape (limits,): 0.01 is one per cent to spare.
        multipliers: Per cent that one per cent of a looser limit buys, shape (limits,).
        at_bound: Parameters at a bound, with the per cent that one per cent of it buys.
        residual: Of the first-order conditions of a least value, over the gradient: 0 at one.
        continuous: Whether every parameter was free between its bounds.
        history: Values, outputs and whether all limits are kept, of each design tried.
        description: The scene with the best numbers.
        units: Of the outputs, by name.
    """

    minimised: str
    parameters: tuple[str, ...]
    first: Array
    best: Array
    bounds: Array
    before: Mapping[str, float]
    after: Mapping[str, float]
    limits: tuple[str, ...]
    margins: Array
    multipliers: Array
    at_bound: Mapping[int, float]
    residual: float
    continuous: bool
    history: tuple[tuple[dict[str, float], dict[str, float], bool], ...]
    description: Description
    units: Mapping[str, str]

    def as_report(self) -> Report:
        """Before and after, what limits the design and what a looser limit buys."""
        columns = (self.first.tolist(), self.best.tolist(), self.bounds.tolist())
        parameters = [*zip(self.parameters, *columns, strict=True)]
        outputs = [(name, self.before[name], value) for name, value in self.after.items()]
        both = (("before", itemgetter(1)), ("after", itemgetter(2)), ("change", _change))
        count = (
            f"{len(self.history)} designs; {sum(ok for *_, ok in self.history)} kept every limit."
        )
        return Report("design", (
            Words(self.sentence()),
            table(
                "Parameters, SI units", parameters, ("key", itemgetter(0)), *both,
                ("bounds", lambda row: " to ".join(map(number, row[3]))), names=(44,),
            ),
            table(
                "Outputs", outputs, ("output", itemgetter(0)),
                ("unit", lambda row: self.units[row[0]]), *both, names=(28, 8),
            ),
            Words("\n".join([*self._limited(), count])),
        ))  # fmt: skip

    def sentence(self) -> str:
        """How much better, in one sentence."""
        name = self.minimised
        change = 100 * (self.after[name] / self.before[name] - 1)
        value = f"{number(self.after[name])} {self.units[name]}".rstrip()
        if abs(change) < 0.05:
            return f"{name} stays at {value}: the first design is the best within the bounds."
        return f"{name} falls to {value}, {change:+.1f} %."

    def _limited(self) -> list[str]:
        said = []
        for name, margin, buys in zip(self.limits, self.margins, self.multipliers, strict=True):
            if margin < _ACTIVE and buys > 1e-4:
                said.append(
                    f"Held by {name}: one per cent looser buys {buys:.2f} % of {self.minimised}."
                )
            else:
                said.append(f"{name}: kept with {100 * np.expm1(margin):.2g} % to spare.")
        for k, buys in self.at_bound.items():
            said.append(
                f"At its bound: {self.parameters[k]}; one per cent beyond buys {buys:.2f} %."
            )
        if self.continuous:
            good = "a least value" if self.residual < 1e-2 else "not quite a least value"
            said.append(f"First-order conditions are met to {self.residual:.1g}: {good}.")
        return said

    def plot(
        self, path: str | Path | None = None, *, panel: str | None = None, ax: Axes | None = None
    ) -> Any:
        """Draw the minimised output over the designs, and what changed; returns the axes.

        Args:
            path: Where to write it too, .png, .pdf or .svg.
            panel: One alone: "search" or "change".
            ax: Where to draw that; default: axes of a new figure.
        """
        from pinflex.viewer.plots.variation import histories

        aims = np.array([found[self.minimised] for _, found, _ in self.history])
        kept = np.array([ok for *_, ok in self.history])
        label = f"{self.minimised} [{self.units[self.minimised]}]".removesuffix(" []")
        drawn = histories(aims, kept, label, self.parameters, self.first, self.best)
        return drawn.axes(panel, ax, path)

    def write(self, path: str | Path) -> Path:
        """Write the scene with the best numbers as a YAML that loads as it is.

        Args:
            path: Its file; paths in it are relative to its folder.
        """
        lines = [f"{key}: {a:.6g} -> {b:.6g}" for key, a, b in zip(
            self.parameters, self.first, self.best, strict=True)]  # fmt: skip
        return write_scene(self.description, path, [self.sentence(), *lines, *self._limited()])

    def as_json(self) -> dict[str, Any]:
        """Plain lists and names, SI units."""
        return {
            "minimised": self.minimised,
            "parameters": {
                key: {"first": float(a), "best": float(b), "bounds": list(map(float, pair))}
                for key, a, b, pair in zip(
                    self.parameters, self.first, self.best, self.bounds, strict=True
                )
            },
            "before": dict(self.before),
            "after": dict(self.after),
            "limits": [
                {"limit": name, "margin": float(m), "multiplier": float(x)}
                for name, m, x in zip(self.limits, self.margins, self.multipliers, strict=True)
            ],
            "at_bound": {self.parameters[k]: x for k, x in self.at_bound.items()},
            "residual": self.residual,
            "designs": len(self.history),
        }


def kkt(
    slopes: Array, rates: Array, margins: Array, x: Array, bounds: Array
) -> tuple[Array, dict[int, float], float]:
    """Multipliers of what is active, those of bounds, and the residual of the conditions.

    sum of share * slope = sum of multiplier * rate over the active margins, and of multipliers
    along the axes whose bound is reached; none is negative, and the shares add up to 1 (Karush
    1939; Kuhn, Tucker 1951).
    """
    from scipy.optimize import nnls

    slopes, n = np.atleast_2d(slopes), len(x)
    active = np.flatnonzero(margins < _ACTIVE)
    low = np.flatnonzero(x - bounds[:, 0] < _AT_BOUND)
    high = np.flatnonzero(bounds[:, 1] - x < _AT_BOUND)
    eye = np.eye(n)
    columns = np.concatenate([rates[active], eye[low], -eye[high]])
    multipliers, ends = np.zeros(len(margins)), dict[int, float]()
    size = float(np.max(np.linalg.norm(slopes, axis=1))) or 1.0
    # Least |sum| with shares that add up to 1: of any size first, since what is best scales.
    every = np.concatenate([-slopes, columns]).T
    sums = np.concatenate([np.full(len(slopes), size), np.zeros(len(columns))])
    found, _ = nnls(np.vstack([every, sums]), np.append(np.zeros(n), size))
    found /= np.sum(found[: len(slopes)])
    left = np.linalg.norm(every @ found)
    held = found[len(slopes) :]
    multipliers[active] = held[: len(active)]
    for k, value in zip((*low, *high), held[len(active) :], strict=True):
        if value > 1e-6:
            ends[int(k)] = float(value)
    return multipliers, ends, float(left) / size


def _change(row: Sequence[Any]) -> str:
    """Of a value after that before, in per cent."""
    return f"{100 * (row[2] / row[1] - 1):+.1f} %" if row[1] else "-"
