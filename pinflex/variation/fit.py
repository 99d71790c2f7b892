"""Numbers of a scene from measurements: least squares in logarithms, x = ln(p / p0).

    least |r(x)|^2 + sum (x_k / s_k)^2,   low <= x <= high

with residuals r in standard deviations and s_k those of priors. Where no standard deviation is
measured, one scale of all residuals is estimated with the parameters; a prior needs its weight, so
that scale and parameters are then found in turn.

Source: Bard (1974), Nonlinear Parameter Estimation, ch. 4 and 7.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.description import Description
from pinflex.description.reading.parameters import parameters
from pinflex.errors import (
    ConvergenceError,
    DescriptionError,
    PinflexError,
    SceneError,
    SingularityError,
)
from pinflex.levels.modes import default_step
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.progress import Progress, barred, callback
from pinflex.report import Report, Reported, Words, table
from pinflex.text import frozen, plural
from pinflex.threads import one_blas_thread
from pinflex.variation.data import history_data, modal_data, response_data
from pinflex.variation.measured import Comparison, Panel, columns, differences, wrong_units
from pinflex.variation.profile import Best, covariance, ends, hidden, quantile, sentences, unseen
from pinflex.variation.variants import Variants, keys, variants, write_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# A fit: numbers with confidence intervals, what was not told, and the YAML that has them.

_UNLIKELY = 0.01  # chance of so large residuals below which the model does not explain them
_AT_BOUND = 1e-4  # of a logarithm
_SIDES = ("lower", "upper")


@frozen
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
                    "first": float(a), "best": float(b), "interval": _plain_pair(pair),
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


def _plain_pair(pair: Array) -> list[float | None] | None:
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


_LATE = 50.0  # times the end of the motion: no measurement goes on for so long
_FACTOR = 10.0  # of default bounds, up and down
_TURNS = 3  # of parameters and scale, where priors need the scale
_LEAST = 1e-6  # of an estimated scale: what solved outputs and differences carry
_STOP = 1e-9  # of a step in logarithms, relative
_NEAR = 1e-3  # the same on the way from afar


@public
@barred
@one_blas_thread()
def fit(
    model: str | Path | Description | Mechanism,
    measured: str | Path | Mapping[str, Any],
    vary: Iterable[str] | Mapping[str, tuple[float, float] | None],
    priors: Mapping[str, float] | None = None,
    *,
    shape_std: float | None = None,
    level: str | None = None,
    dt: float | None = None,
    nodes: Mapping[int, str] | None = None,
    simultaneous: bool = False,
    progress: Progress = None,
) -> Fit:
    """Fit numbers of a scene to what was measured.

        found = pf.fit("delta", "hammer.csv", ["flexible.*.material.E"])
        print(found.text())

    Args:
        model: A model, or what `load` takes; its numbers are the start.
        measured: A file of natural frequencies, frequency responses or time histories, or columns
            by name, see `pinflex.variation.measured`. Frequencies are those at home with locked
            motors; responses have motors free where one is an input.
        vary: Key paths, or (low, high) by key path (None: a tenth to ten times); links of one block
            of the YAML are one parameter.
        priors: Relative standard deviations of the first values, by key path: 0.05 for 5 %.
        shape_std: Standard deviation of a component of a shape of length one, to fit shapes too;
            default: they only say which mode is which.
        level: Of runs that are compared with time histories; default: that of the YAML.
        dt: Their step [s]; default: from the first frequencies.
        nodes: Frames by the node numbers of a universal file.
        simultaneous: Whether the intervals are to hold all at once with 95 % confidence, so that
            the designs in their box can be trusted; default: each alone, whatever the others are.
        progress: True: a bar; or a function called with (designs solved, most).

    Returns:
        The fit, with confidence intervals and what the measurements do not tell.

    Raises:
        DescriptionError: Bad files, names, bounds or priors; fewer numbers than parameters.
        SceneError: The first design cannot be solved.
    """
    robot = model if isinstance(model, Mechanism) else load(model)
    ranges = dict(vary) if isinstance(vary, Mapping) else _plain(vary)
    if not ranges:
        raise DescriptionError("fit: nothing varies. Say by what (--vary KEY).")
    where = "measured" if isinstance(measured, Mapping) else Path(measured).name
    data = _comparison(robot, columns(measured, nodes), where, shape_std, level, dt)
    designs = variants(robot, ranges)
    units = wrong_units(data.ratios(robot))
    problem = _Problem(
        designs, data, _bounds(robot, ranges), _spreads(robot, priors), callback(progress)
    )
    fitted = _fitted(problem, *problem.solved(), simultaneous)
    return replace(fitted, untold=(*units, *fitted.untold)) if units else fitted


def _plain(vary: Iterable[str]) -> dict[str, tuple[float, float] | None]:
    return dict.fromkeys([vary] if isinstance(vary, str) else vary)


def _comparison(
    robot: Mechanism,
    found: Mapping[str, Array],
    where: str,
    shape_std: float | None,
    level: str | None,
    dt: float | None,
) -> Comparison:
    """The measurements, by what their columns are."""
    if "t" in found:
        end, motion = float(found["t"][-1]), (robot.description.motion or {}).get("duration")
        if isinstance(motion, float | int) and end > _LATE * motion:
            raise DescriptionError(
                f"{where}: t: ends at {end:g} s, the motion at {motion:g} s. Is t in ms? Write "
                "seconds."
            )
        step = default_step(robot, end) if dt is None else dt
        return history_data(found, where, level, step)
    if any(name.endswith((".real", ".imag")) for name in found):
        return response_data(found, where)
    return modal_data(found, shape_std, where)


def _bounds(
    robot: Mechanism, ranges: Mapping[str, tuple[float, float] | None]
) -> dict[str, tuple[float, float]]:
    """Logarithms of the bounds over the first value, by key."""
    found = {}
    for pattern, pair in ranges.items():
        for parameter in parameters(robot.description, [pattern])[1]:
            if pair is None:
                found[parameter.key] = (-math.log(_FACTOR), math.log(_FACTOR))
                continue
            low, high = sorted(x / parameter.value for x in pair)
            if not 0 < low <= 1 <= high or low == high:
                raise DescriptionError(
                    f"{robot.name}: vary {parameter.key}: {pair[0]:g} to {pair[1]:g}. Give bounds "
                    f"of one sign about its value {parameter.value:g}."
                )
            found[parameter.key] = (math.log(low), math.log(high))
    return found


def _spreads(robot: Mechanism, priors: Mapping[str, float] | None) -> dict[str, float]:
    """Standard deviations of the logarithms, by key."""
    found = dict[str, float]()
    for pattern, share in (priors or {}).items():
        if not 0 < share < math.inf:
            raise DescriptionError(f"{robot.name}: prior {pattern}: {share:g}. Give it above 0.")
        found |= {p.key: share for p in parameters(robot.description, [pattern])[1]}
    return found


class _Problem:
    """Residuals of designs and their derivatives.

    Attributes:
        scale: Of the residuals: one where standard deviations were measured.
        solves: How many designs were compared.
    """

    def __init__(
        self,
        designs: Variants,
        data: Comparison,
        bounds: Mapping[str, tuple[float, float]],
        spreads: Mapping[str, float],
        progress: Callable[[int, int], None] | None,
    ) -> None:
        self.designs, self.data, self.progress = designs, data, progress
        self.names = keys(designs.parameters)
        stray = [key for key in spreads if key not in self.names]
        if stray:
            raise DescriptionError(f"prior {stray[0]}: it is not varied. Vary it too.")
        self.bounds = np.array([bounds[key] for key in self.names])
        self.prior = np.array([1.0 / spreads.get(key, math.inf) for key in self.names])
        self.scale, self.solves, self._last = 1.0, 0, np.zeros(0)
        self._designs: dict[bytes, Mechanism] = {}

    def design(self, x: Array) -> Mechanism:
        """The design at x; the last is kept, as residuals and derivatives share it."""
        key = x.tobytes()
        if key not in self._designs:
            self._designs = {key: self.designs.at(self.designs.values(x))}
        return self._designs[key]

    def data_rows(self, x: Array, coarse: bool = False) -> Array:
        """Residuals of the measurements."""
        self.solves += 1
        if self.progress is not None:
            self.progress(self.solves, 60)
        return self.data.rows(self.design(x), coarse)

    def rows(self, x: Array, coarse: bool = False) -> Array:
        """All residuals; far larger ones where a design cannot be solved."""
        try:
            found = self.data_rows(x, coarse) / self.scale
        except PinflexError:  # no equilibrium, or a wall thicker than its tube
            if not len(self._last):
                raise
            return 10.0 * self._last
        self._last = self.with_prior_rows(found, x)
        return self._last

    def rows_or_none(self, x: Array) -> Array | None:
        """All residuals; None where a design cannot be solved."""
        try:
            return self.with_prior_rows(self.data_rows(x) / self.scale, x)
        except PinflexError:
            return None

    def with_prior_rows(self, rows: Array, x: Array) -> Array:
        """Residuals of the priors below those of the measurements."""
        return np.concatenate([rows, (x * self.prior)[self.prior > 0]])

    def jacobian(self, x: Array) -> Array:
        """Derivatives of the residuals and of the priors."""
        J = self.data.jacobian(self.designs, self.designs.values(x), self.design(x)) / self.scale
        J[:, unseen(J)[0]] = 0.0  # round-off would lead them astray
        return self.with_priors(J)

    def with_priors(self, J: Array) -> Array:
        """Rows of the priors below those of the measurements."""
        return np.concatenate([J, np.diag(self.prior)[self.prior > 0]])

    def solved(self) -> tuple[Array, Array, Array]:
        """The best x, the residuals of the measurements and their derivatives there."""
        x = np.zeros(len(self.names))
        try:
            first = self.data_rows(x)
        except (ConvergenceError, SingularityError) as error:
            raise SceneError(
                f"{self.designs.base.name}: the first design cannot be solved: {error}"
            ) from error
        told, priors = self.data.told, bool(np.any(self.prior > 0))
        if len(first) < len(x) and not (told and priors):
            raise DescriptionError(
                f"fit: {len(first)} measured numbers for {len(x)} parameters. Vary fewer, or give "
                "standard deviations and priors."
            )
        x = self._led(x)
        for _ in range(1 if told or not priors else _TURNS):
            if not told and priors:
                self.scale = _scale(self.data_rows(x), len(x))
            x = self._search(x, self.rows, self.jacobian, _STOP)
        rows = self.data_rows(x)
        if not told:
            self.scale = _scale(rows, len(x))
        J = self.data.jacobian(self.designs, self.designs.values(x), self.design(x))
        return x, rows / self.scale, J / self.scale

    def _led(self, x: Array) -> Array:
        """From afar: rows that lead to the right place, where the measurements have others."""
        if not self.data.leads:
            return x

        def slope(x: Array) -> Array:
            coarse = partial(self.data.rows, coarse=True)
            return self.with_priors(
                differences(coarse, self.designs, self.designs.values(x)) / self.scale
            )

        return self._search(x, lambda x: self.rows(x, True), slope, _NEAR)

    def _search(
        self, x: Array, rows: Callable[[Array], Array], slope: Callable[[Array], Array], stop: float
    ) -> Array:
        from scipy.optimize import least_squares

        low, high = self.bounds.T
        inside = np.clip(x, low + 1e-9, high - 1e-9)
        self._last = np.zeros(0)  # from afar there were others, and their scale was another
        found = least_squares(
            rows, inside, jac=slope, bounds=(low, high), xtol=stop,
            ftol=1e-13, gtol=1e-13, max_nfev=60,
        )  # fmt: skip
        return np.asarray(found.x)


def _scale(rows: Array, n: int) -> float:
    """Standard deviation of residuals of n parameters."""
    return max(math.sqrt(float(np.sum(rows**2)) / max(len(rows) - n, 1)), _LEAST)


def _fitted(problem: _Problem, x: Array, rows: Array, J: Array, simultaneous: bool) -> Fit:
    """The fit at the best point, with intervals and remarks."""
    designs, data = problem.designs, problem.data
    values = designs.values(x)
    best, text = problem.design(x), data.text(problem.design(x))
    freedom = len(rows) + int(np.sum(problem.prior > 0)) - len(x)
    C = covariance(problem.with_priors(J), hidden(problem.with_priors(J)))
    found = ends(
        problem.rows_or_none, Best(x, problem.with_prior_rows(rows, x), problem.with_priors(J), C),
        problem.bounds, quantile(None if data.told else freedom, len(x) if simultaneous else 1),
    )  # fmt: skip
    return Fit(
        problem.names, designs.first, np.array([*values.values()]),
        np.exp(problem.bounds) * designs.first[:, None],
        np.sort(np.exp(found.x) * designs.first[:, None], axis=1), found.profiled, found.leaning,
        found.unsure,
        simultaneous, C, rows, data.told, freedom,
        tuple(sentences(J, C, problem.names, found.own)), text,
        tuple(data.panels(best)), problem.solves, designs.described(values),
    )  # fmt: skip
