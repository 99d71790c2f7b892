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
from pathlib import Path
from typing import Any

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
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.progress import Progress, barred, callback
from pinflex.solver.step_length import default_step
from pinflex.threads import one_blas_thread
from pinflex.variation.data import history_data, modal_data, response_data
from pinflex.variation.fitted import Fit
from pinflex.variation.measured import Comparison, columns, differences, wrong_units
from pinflex.variation.profile import Best, covariance, ends, hidden, quantile, sentences, unseen
from pinflex.variation.variants import Variants, keys, variants

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
            x = self._least(x)
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

    def _least(self, x: Array) -> Array:
        return self._search(x, self.rows, self.jacobian, _STOP)

    def _search(
        self, x: Array, rows: Callable[[Array], Array], slope: Callable[[Array], Array], stop: float
    ) -> Array:
        from scipy.optimize import least_squares

        low, high = self.bounds.T
        inside = np.clip(x, low + 1e-9, high - 1e-9)
        found = least_squares(
            rows, inside, jac=slope, bounds=(low, high), xtol=stop,
            ftol=1e-13, gtol=1e-13, max_nfev=60,
        )  # fmt: skip
        return np.asarray(found.x)


def _scale(rows: Array, n: int) -> float:
    """Standard deviation of residuals of n parameters."""
    return max(math.sqrt(float(np.sum(rows**2)) / max(len(rows) - n, 1)), _LEAST)


def _fitted(problem: _Problem, x: Array, rows: Array, J: Array, simultaneous: bool) -> Fit:
    """What is told of a fit."""
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
