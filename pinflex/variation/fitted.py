"""A fit: numbers with confidence intervals, what was not told, and the YAML that has them."""

from __future__ import annotations

from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.description import Description
from pinflex.report import Report, Reported, Words, table
from pinflex.text import brief, plural
from pinflex.variation.measured import Panel
from pinflex.variation.variants import write_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_UNLIKELY = 0.01  # chance of so large residuals below which the model does not explain them
_AT_BOUND = 1e-4  # of a logarithm
_SIDES = ("lower", "upper")


@dataclass(frozen=True)
class Fit(Reported):
    """Numbers of a scene that explain what was measured.

    Attributes:
        parameters: Key paths; `first` and `best` values, shape (n,); `bounds`, shape (n, 2).
        intervals: 95 % confidence intervals of the parameters, shape (n, 2): 0 or infinite
            where the measurements tell no end within the bounds, NaN where as many numbers were
            measured as fitted and none with its standard deviation.
        profiled: Which of these are of the profile likelihood, shape (n,), see
            `pinflex.variation.profile`; the others are of straight residuals.
        leaning: Other parameters that are at a bound where an interval ends, of each, by place.
        unsure: Whether the search for a lower and an upper end gave up before the bound, of each.
        simultaneous: Whether the intervals hold all at once with that confidence, not each alone.
        covariance: Of straight residuals by logarithms, shape (n, n); infinite where these do not
            tell the parameter.
        residuals: At the best values, in standard deviations, shape (rows,).
        told: Whether standard deviations were measured; else one scale was estimated.
        freedom: Residuals and priors, less parameters.
        untold: What the measurements do not tell, in sentences.
        compared: Measured and fitted numbers, as text. panels: The same for a plot.
        solves: How many designs were compared.
        description: The scene with the best numbers.
    """

    __repr__ = brief

    parameters: tuple[str, ...]
    first: Array
    best: Array
    bounds: Array
    intervals: Array
    profiled: tuple[bool, ...]
    leaning: tuple[tuple[int, ...], ...]
    unsure: tuple[tuple[bool, bool], ...]
    simultaneous: bool
    covariance: Array
    residuals: Array
    told: bool
    freedom: int
    untold: tuple[str, ...]
    compared: str
    panels: tuple[Panel, ...]
    solves: int
    description: Description

    def __getitem__(self, key: str) -> float:
        """The best value of a parameter."""
        return float(self.best[self.parameters.index(key)])

    @property
    def misfit(self) -> float:
        """Root of the sum of squared residuals over the freedom: 1 where they are as told."""
        return float(np.sqrt(np.sum(self.residuals**2) / max(self.freedom, 1)))

    def as_report(self) -> Report:
        """Values, intervals, residuals, and what was not told."""
        columns = (self.first.tolist(), self.best.tolist(), self.intervals.tolist())
        confidence = "95 % confidence" + (", all at once" if self.simultaneous else "")
        count = f"{plural(len(self.residuals), 'residual')}, {plural(self.solves, 'comparison')}."
        return Report("fit", (
            table(
                "Parameters, SI units", zip(self.parameters, *columns, strict=True),
                ("parameter", itemgetter(0)), ("before", itemgetter(1)), ("fitted", itemgetter(2)),
                ("change", lambda row: f"{100 * (row[2] / row[1] - 1):+.2f} %"),
                (confidence, lambda row: _interval(*row[3])), names=(44,), prose=True,
            ),
            Words(self.compared),
            Words("\n".join([*self.sentences(), count])),
        ))  # fmt: skip

    def sentences(self) -> list[str]:
        """How well the scene explains the measurements, and what they do not tell."""
        said = [*self._explained(), *self.untold]
        for key, value, (low, high) in zip(self.parameters, self.best, self.bounds, strict=True):
            if min(abs(np.log(value / low)), abs(np.log(high / value))) < _AT_BOUND:
                said.append(f"{key} ended at its bound: widen it, or doubt the model.")
        said += self._open()
        ended = all(_told(end) for end in self.intervals.ravel())
        if not self.untold and ended and np.all(np.isfinite(np.diag(self.covariance))):
            said.append("Every parameter is told by the measurements.")
        return said + self._method()

    def _open(self) -> list[str]:
        """Intervals with one end, or with one that rests on a bound of another parameter."""
        said = []
        for k, (key, (low, high)) in enumerate(zip(self.parameters, self.intervals, strict=True)):
            ends, unsure = (_told(low), _told(high)), self.unsure[k]
            sides = [s for s, told, lost in zip(_SIDES, ends, unsure, strict=True) if lost > told]
            if sides:
                said.append(
                    f"{key}: the search for its {' and its '.join(sides)} end gave up. Fit with it "
                    "held at some values (keep it out of `by`) to see where it ends."
                )
            if any(ends) and not all(ends) and not any(unsure):
                other = "upper" if ends[0] else "lower"
                said.append(
                    f"{key}: {_interval(low, high)}; the measurements tell no {other} end within "
                    "its bounds."
                )
            if self.leaning[k]:
                held = ", ".join(self.parameters[j] for j in self.leaning[k])
                said.append(f"The interval of {key} ends where {held} is at a bound of its own.")
        return said

    def _method(self) -> list[str]:
        """How the intervals were found."""
        by = [key for key, profiled in zip(self.parameters, self.profiled, strict=True) if profiled]
        if np.any(np.isnan(self.intervals)):
            return []
        if not by:
            return ["Intervals are linear: residuals are straight over them."]
        every = len(by) == len(self.parameters)
        which = "Intervals" if every else f"The intervals of {', '.join(by)}"
        return [
            f"{which} are of the profile likelihood: residuals are not straight over them."
            + ("" if every else " The others are linear.")
        ]

    def _explained(self) -> list[str]:
        from scipy.stats import chi2

        if self.freedom <= 0:
            exact = "No number is left to check the fit"
            return [f"{exact}." if self.told else f"{exact}, nor to estimate its confidence."]
        if not self.told:
            return []
        total = float(np.sum(self.residuals**2))
        if chi2.sf(total, self.freedom) < _UNLIKELY:
            return [
                f"These parameters do not explain the measurements: residuals are {self.misfit:.3g}"
                " times the standard deviations told. Something else differs, or a mode is "
                "another one; the intervals do not hold."
            ]
        return [f"Residuals are {self.misfit:.2g} times the standard deviations told: explained."]

    def plot(
        self, path: str | Path | None = None, *, panel: str | None = None, ax: Axes | None = None
    ) -> Any:
        """Draw measured and fitted values, and their difference below; returns the axes.

        Args:
            path: Where to write it too, .png, .pdf or .svg.
            panel: One alone: the title of a panel, "difference TITLE" for what is below it.
            ax: Where to draw that; default: axes of a new figure.
        """
        from pinflex.viewer.plots.variation import residuals

        drawn = residuals([
            (p.title, p.along, p.unit, p.x, p.measured, p.model, p.std) for p in self.panels
        ])  # fmt: skip
        return drawn.axes(panel, ax, path)

    def write(self, path: str | Path) -> Path:
        """Write the scene with the fitted numbers as a YAML that loads as it is.

        Args:
            path: Its file; paths in it are relative to its folder.
        """
        lines = [
            f"{key}: {a:.6g} -> {b:.6g} ({_interval(low, high)})"
            for key, a, b, (low, high) in zip(
                self.parameters, self.first, self.best, self.intervals, strict=True
            )
        ]
        return write_scene(
            self.description, path, ["Fitted to measurements.", *lines, *self.sentences()]
        )

    def as_json(self) -> dict[str, Any]:
        """Plain lists and names, SI units; null for an interval or an end that is not told."""
        return {
            "parameters": {
                key: {
                    "first": float(a), "best": float(b), "interval": _plain(pair),
                    "by": "profile" if profiled else "linear",
                }
                for key, a, b, pair, profiled in zip(
                    self.parameters, self.first, self.best, self.intervals, self.profiled,
                    strict=True,
                )
            },
            "misfit": self.misfit,
            "freedom": self.freedom,
            "simultaneous": self.simultaneous,
            "said": self.sentences(),
            "solves": self.solves,
        }  # fmt: skip


def _told(end: float) -> bool:
    """Whether the end of an interval is told; else it is 0, infinite or not a number."""
    return bool(np.isfinite(end) and end != 0)


def _plain(pair: Array) -> list[float | None] | None:
    ends = [float(end) if _told(end) else None for end in pair]
    return ends if any(end is not None for end in ends) else None


def _interval(low: float, high: float) -> str:
    if np.isnan(low):
        return "not told"
    if _told(low) and _told(high):
        return f"{low:.5g} to {high:.5g}"
    if _told(low):
        return f"at least {low:.5g}"
    return f"at most {high:.5g}" if _told(high) else "any"
