"""Designs solved at points in logarithms of their parameters, each once."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.description import Description
from pinflex.errors import SceneError
from pinflex.studies.batch import keys as case_keys
from pinflex.studies.batch import run
from pinflex.variation.design import Design, kkt
from pinflex.variation.limits import Limit
from pinflex.variation.measures import RUNS, measure, units
from pinflex.variation.variants import Variants, keys, variants_of

_STEP = 5e-4  # of a logarithm: truncation 1e-6, noise of a solved output 1e-6 or less
_SHARP = 2e3  # per logarithm: frequencies nearer than its inverse count together
FEASIBLE = -1e-5  # a margin below this is a limit broken
_BEYOND = 10.0  # objective where a design cannot be solved


class Evaluator:
    """Designs solved at points x, each once.

    Attributes:
        designs, bounds: The variables. base: Outputs of the first design.
        history: Values, outputs and whether every limit is kept, in the order solved.
    """

    def __init__(
        self,
        designs: Variants,
        wanted: tuple[str, ...],
        given: tuple[Limit, ...],
        level: str | None,
        bounds: Array,
        jobs: int,
        journal: str | Path | None,
        progress: Callable[[int, int], None] | None,
    ) -> None:
        self.designs, self.minimise, self.limits, self.level = designs, wanted[0], given, level
        self.bounds, self.jobs, self.journal, self.progress = bounds, jobs, journal, progress
        above = _above(limit.output for limit in given if not limit.upper)
        self.names = tuple(dict.fromkeys([*wanted, *above]))
        self.history: list[tuple[dict[str, float], dict[str, float], bool]] = []
        self._told: set[bytes] = set()
        self._known: dict[bytes, dict[str, float] | None] = {}
        self._why = ""  # the last design could not be solved
        first = self([np.zeros(len(designs.parameters))])[0]
        if first is None:
            raise SceneError(f"{designs.base.name}: the first design cannot be solved: {self._why}")
        self.base = first

    def __call__(self, points: Sequence[Array]) -> list[dict[str, float] | None]:
        """Outputs at points x; None where a design cannot be solved."""
        new = {x.tobytes(): x for x in points if x.tobytes() not in self._known}
        if new:
            cases = [self.designs.values(x) for x in new.values()]
            description, patterns = self.designs.source, keys(self.designs.parameters)
            named = case_keys(description, cases, "design", self.level, self.names)
            records = run(
                partial(_solved, description, patterns, self.names, self.level),
                dict(zip(named, cases, strict=True)),
                jobs=self.jobs, journal=self.journal, progress=self.progress,
            )  # fmt: skip
            for x, key in zip(new, named, strict=True):
                record = records[key]
                self._why = record.error or self._why
                self._known[x] = None if record.error else dict(record.found)
        return [self._known[x.tobytes()] for x in points]

    def margins(self, found: Mapping[str, float] | None) -> Array:
        """Of every limit; of frequencies that must keep one together, a smooth least margin.

        Frequencies that come together bend where they meet, so that no step along the slope of the
        lowest raises it. -ln(sum exp(-s m)) / s is smooth there, and at most ln(count) / s less.

        Source: Kreisselmeier, Steinhauser (1979), Systematic control design by optimizing a vector
        performance index.
        """
        if found is None:
            return np.full(len(self.limits), -1.0)
        each = [self._each(limit, found) for limit in self.limits]
        return np.array([
            min(m) - math.log(sum(math.exp(_SHARP * (min(m) - x)) for x in m)) / _SHARP
            for m in each
        ])  # fmt: skip

    def keeps(self, found: Mapping[str, float] | None) -> bool:
        """Whether every limit is kept."""
        return found is not None and all(
            min(self._each(limit, found)) >= FEASIBLE for limit in self.limits
        )

    def kept(self) -> list[Array]:
        """Where the designs that keep every limit are, of all solved so far."""
        return [np.frombuffer(x) for x, found in self._known.items() if self.keeps(found)]

    def feasible(self, x: Array) -> bool:
        """Whether the design at x keeps every limit; it is kept in the history."""
        self.at(x)
        return self.keeps(*self([x]))

    def _each(self, limit: Limit, found: Mapping[str, float]) -> list[float]:
        """Margins of a limit, and of the frequencies above one that has a lower limit."""
        names = (limit.output, *(() if limit.upper else _above([limit.output])))
        return [limit.margin(found[name], self.base) for name in names]

    def objective(self, found: Mapping[str, float] | None) -> float:
        """ln of the minimised output."""
        return _BEYOND if found is None else math.log(max(found[self.minimise], 1e-300))

    def at(self, x: Array) -> tuple[float, Array]:
        """Objective and margins, kept in the history."""
        (found,) = self([x])
        margins = self.margins(found)
        if found is not None and x.tobytes() not in self._told:  # objective and margins ask apart
            self._told.add(x.tobytes())
            self.history.append((self.designs.values(x), found, self.keeps(found)))
        return self.objective(found), margins

    def slopes(self, x: Array) -> tuple[Array, Array]:
        """Gradients of objective, shape (n,), and margins, shape (limits, n)."""
        n = len(x)
        sides = [x + s * _STEP * np.eye(n)[k] for k in range(n) for s in (-1.0, 1.0)]
        found = self(sides)
        f = np.array([self.objective(each) for each in found]).reshape(n, 2)
        g = np.array([self.margins(each) for each in found]).reshape(n, 2, -1)
        return (f[:, 1] - f[:, 0]) / (2 * _STEP), (g[:, 1] - g[:, 0]).T / (2 * _STEP)

    def nearest(self) -> str:
        """The design whose worst margin is least bad, in words."""
        if not self.history:
            return "none could be solved"
        _, found, _ = max(self.history, key=lambda row: float(np.min(self.margins(row[1]))))
        limit = self.limits[int(np.argmin(self.margins(found)))]
        return f"{limit.output} = {found[limit.output]:.4g} where {limit} is asked"

    def design(self, x: Array, continuous: bool) -> Design:
        """What is told of the design at a point.

        Args:
            x: Logarithms of the parameters over their first values, shape (parameters,).
            continuous: Whether all of them are numbers between bounds, and not chosen from values.
        """
        (found,) = self([x])
        assert found is not None
        slope, rates = self.slopes(x)
        margins = np.array([min(self._each(limit, found)) for limit in self.limits])
        multipliers, ends, residual = kkt(slope, rates, margins, x, self.bounds)
        case, first = self.designs.values(x), self.designs.first
        return Design(
            self.minimise, keys(self.designs.parameters), first, np.array([*case.values()]),
            np.exp(self.bounds) * first[:, None], self.base, found,
            tuple(f"{limit.output} {'<' if limit.upper else '>'} {limit.number(self.base):.5g}"
                  for limit in self.limits),
            margins, multipliers, ends, residual, continuous, tuple(self.history),
            self.designs.described(case), units(found, self.designs.source),
        )  # fmt: skip


def _above(names: Iterable[str]) -> list[str]:
    """The two frequencies above each: sorted ones change places, and all must keep the limit."""
    found = []
    for name in names:
        head, _, rest = name.partition(".")
        if head == "frequency":
            found += [f"frequency.{int(rest) + k}" for k in (1, 2) if int(rest) + k <= 12]
    return found


def _solved(
    description: Description,
    patterns: tuple[str, ...],
    names: tuple[str, ...],
    level: str | None,
    case: Mapping[str, float],
) -> dict[str, Any]:
    runs = any(name.partition(".")[0] in RUNS for name in names)
    designs = variants_of(description, patterns)
    rigid = designs.rigid if any(name.startswith("deviation") for name in names) else None
    return measure(designs.at(case), names, level if runs else None, rigid)
