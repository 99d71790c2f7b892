"""Designs solved at points in logarithms of their parameters, each once."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.description import Description
from pinflex.errors import DescriptionError, SceneError, nearest
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.pose_map import AXES, free_stiffness
from pinflex.results.result import Result
from pinflex.studies.batch import keys as case_keys
from pinflex.studies.batch import run
from pinflex.studies.checking.parts import statics
from pinflex.studies.outputs import prismatic, scene_outputs, unit
from pinflex.studies.pose import platform_compliance
from pinflex.variation.design import Design, kkt
from pinflex.variation.peaks import over_time
from pinflex.variation.variants import Variants, keys, variants_of

# Outputs of a scene by name, for derivatives, limits and fits.
#
# Peaks are over motors, links and time.
#
# - frequency.1 ...: natural frequencies at home, motors locked [Hz]
# - mass: of all moving links [kg]
# - sag: of the platform under gravity and loads, motors locked [m]
# - stiffness.AXIS: 1/C of the platform along x, y, z [N/m], rx, ry, rz [N m/rad]
# - deviation.peak: of the platform from the rigid run [m]; deviation.rotation [rad]
# - torque.peak, torque.rms: largest of any motor; torque.peak.MOTOR of one [N m | N]
# - stress.peak: von Mises [Pa]; stress.yield: share of the strength [-]

RUNS = ("deviation", "torque", "stress")
AT = " at "  # between a peak's name and the number of a sample
_SHORT = {"deviation.peak": "deviation.position"}
_FREQUENCIES = 12
DEFAULT = ("frequency.1", "mass", "sag", "deviation.peak", "torque.peak", "stress.peak")


def is_peak(name: str) -> bool:
    """Whether an output is the largest value of a run over time."""
    return of_a_run(name) and not name.startswith("torque.rms")


def of_a_run(name: str) -> bool:
    """Whether an output is one of a run, not of a pose."""
    return name.partition(".")[0] in RUNS


def units(names: Iterable[str], description: Description) -> dict[str, str]:
    """Units of outputs by name, as listed at the top of this file; "" for a pure number."""
    slides = prismatic(description)
    return {name: unit(name, slides, description.actuated) for name in names}


def check_names(names: Iterable[str], mechanism: Mechanism) -> tuple[str, ...]:
    """The names, each of which has to be an output."""
    allowed = [
        *(f"frequency.{k}" for k in range(1, _FREQUENCIES + 1)), "mass", "sag",
        *(f"stiffness.{axis}" for axis in AXES), "deviation.peak", "deviation.position",
        "deviation.rotation", "torque.peak", "torque.rms",
        *(f"torque.{kind}.{motor}" for kind in ("peak", "rms") for motor in mechanism.motors),
        "stress.peak", "stress.yield",
    ]  # fmt: skip
    found = tuple(names)
    for name in found:
        if name not in allowed:
            raise DescriptionError(f"output {name}: no such output.{nearest(name, allowed)}")
    if not found:
        raise DescriptionError(f"outputs: none. Give some of {', '.join(DEFAULT)}.")
    return found


def measure(
    mechanism: Mechanism,
    names: Iterable[str],
    level: str | None = None,
    rigid: Result | None = None,
    every: Iterable[str] = (),
    strict: bool = True,
) -> dict[str, float]:
    """The outputs of a scene by name, SI units, and peaks of `every` at each sample.

    One that the scene does not have is an error, or is left out where that is not `strict`.
    """

    def samples(run: Result, reference: Result | None) -> dict[str, float]:
        each = {name: over_time(name, mechanism, run, reference) for name in every}
        return {f"{name}{AT}{k}": x for name, c in each.items() for k, x in enumerate(c.tolist())}

    wanted = check_names(names, mechanism)
    heads = {name.partition(".")[0] for name in wanted}
    found: dict[str, float] = {}
    for head, values in _OF_HOME.items():
        if head in heads:
            found |= values(mechanism)
    groups = [group for group in ("frequency", *RUNS) if group in heads]
    if mechanism.description.motion is None and mechanism.description.solve.until is None:
        groups = [group for group in groups if group not in RUNS]
    if groups:
        found |= _plain_numbers(scene_outputs(mechanism, level, groups, rigid, samples))
    found |= {short: found[full] for short, full in _SHORT.items() if full in found}
    found |= _of_all_motors(found)
    each = {name: x for name, x in found.items() if AT in name}
    found = {name: found[name] for name in wanted if name in found} | each
    missing = [name for name in wanted if name not in found]
    if strict and missing:
        raise DescriptionError(
            f"{mechanism.name}: output {missing[0]}: the scene has none. Ask for what it has: "
            f"{', '.join(sorted(found)) or 'none of those asked'}."
        )
    return found


def _of_all_motors(found: Mapping[str, float]) -> dict[str, float]:
    """Largest torque of any motor, by kind."""
    each = {
        kind: [value for name, value in found.items() if name.startswith(f"{kind}.")]
        for kind in ("torque.peak", "torque.rms")
    }
    return {kind: max(values) for kind, values in each.items() if values}


def _stiffness(mechanism: Mechanism) -> dict[str, float]:
    values = free_stiffness(platform_compliance(mechanism))
    return {f"stiffness.{axis}": float(k) for axis, k in zip(AXES, values, strict=True)}


def _sag(mechanism: Mechanism) -> dict[str, float]:
    found = statics(mechanism)
    return {} if found.full is None else {"sag": float(np.linalg.norm(found.full.position))}


# Outputs that need neither modes nor a run.
_OF_HOME: dict[str, Callable[[Mechanism], dict[str, float]]] = {
    "mass": lambda m: {"mass": float(sum(x.mass for x in m.flexible.expansion.model.inertias))},
    "sag": _sag,
    "stiffness": _stiffness,
}


def _plain_numbers(values: Mapping[str, object]) -> dict[str, float]:
    return {
        name: float(value)
        for name, value in values.items()
        if isinstance(value, (int, float)) and not isinstance(value, bool)
    }


# Limits on outputs: "frequency.1 > 12", "stress.peak < 0.5*yield", "deviation.peak < base".

_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_LIMIT = re.compile(
    rf"\s*([\w.\-]+)\s*(<=|>=|<|>)\s*(?:({_NUMBER})\s*\*\s*(yield|base)|(yield|base)|({_NUMBER}))\s*"
)


@dataclass(frozen=True)
class Limit:
    """A limit on an output.

    Attributes:
        output: Its name. upper: Whether it is a largest value.
        value: The limit, SI units; a share of the first design's value where `relative`.
        relative: To the first design.
    """

    output: str
    upper: bool
    value: float
    relative: bool = False

    def number(self, base: Mapping[str, float]) -> float:
        """The limit in SI units, given the outputs of the first design."""
        return self.value * base[self.output] if self.relative else self.value

    def margin(self, value: float, base: Mapping[str, float]) -> float:
        """ln of how far a value keeps within the limit: 0.01 is one per cent, negative beyond."""
        sign = -1.0 if self.upper else 1.0
        limit = self.number(base)
        if value > 0 and limit > 0:
            return sign * math.log(value / limit)
        return sign * (value - limit) / max(abs(limit), 1e-300)

    def __str__(self) -> str:
        shown = f"{self.value:g} of the first design" if self.relative else f"{self.value:g}"
        return f"{self.output} {'<' if self.upper else '>'} {shown}"


def limits(texts: Iterable[str]) -> tuple[Limit, ...]:
    """Limits from texts."""
    return tuple(_limit(text) for text in texts)


def _limit(text: str) -> Limit:
    match = _LIMIT.fullmatch(text)
    if match is None:
        raise DescriptionError(
            f"keep {text!r}: not of the form OUTPUT < NUMBER or OUTPUT > NUMBER, such as "
            '"frequency.1 > 12", "deviation.peak < 1*base", "stress.peak < 0.5*yield".'
        )
    output, sign, share, unit, alone, number = match.groups()
    value, word = float(share or number or 1.0), unit or alone
    if word == "yield":
        if output not in ("stress.peak", "stress.yield"):
            raise DescriptionError(f"keep {text!r}: only stress.peak has a yield strength.")
        output = "stress.yield"
    if value <= 0:
        raise DescriptionError(f"keep {text!r}: a limit is a number above 0.")
    return Limit(output, sign.startswith("<"), value, word == "base")


_STEP = 5e-4  # of a logarithm: truncation 1e-6, noise of a solved output 1e-6 or less
_SHARP = 2e3  # per logarithm: frequencies nearer than its inverse count together
FEASIBLE = -1e-5  # a margin below this is a limit broken
_TIED = 1e-5  # of samples, as a logarithm: both are the peak, as far as a search can tell
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
        tops = [wanted[0], *(limit.output for limit in given if limit.upper)]
        self.sampled = tuple(dict.fromkeys(name for name in tops if is_peak(name)))
        self.history: list[tuple[dict[str, float], dict[str, float], bool]] = []
        self._told: set[bytes] = set()
        self._known: dict[bytes, dict[str, float] | None] = {}
        self._samples: dict[bytes, dict[str, Array]] = {}
        self._why = ""  # the last design could not be solved
        first = self([np.zeros(len(designs.parameters))])[0]
        if first is None:
            raise SceneError(f"{designs.base.name}: the first design cannot be solved: {self._why}")
        self.base = first
        begun = self._samples[np.zeros(len(designs.parameters)).tobytes()]
        self._counts = {name: len(values) for name, values in begun.items()}

    def __call__(self, points: Sequence[Array]) -> list[dict[str, float] | None]:
        """Outputs at points x; None where a design cannot be solved."""
        new = {x.tobytes(): x for x in points if x.tobytes() not in self._known}
        if new:
            cases = [self.designs.values(x) for x in new.values()]
            description, patterns = self.designs.source, keys(self.designs.parameters)
            about = self.names, self.sampled
            named = case_keys(description, cases, "design", self.level, *about)
            records = run(
                partial(_solved, description, patterns, *about, self.level),
                dict(zip(named, cases, strict=True)),
                jobs=self.jobs, journal=self.journal, progress=self.progress,
            )  # fmt: skip
            for x, key in zip(new, named, strict=True):
                record = records[key]
                self._why = record.error or self._why
                apart = _samples(record.found)
                found = {name: y for name, y in record.found.items() if AT not in name}
                self._known[x], self._samples[x] = None if record.error else found, apart
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

    def rows(self, x: Array, unit: float, limits: bool = True) -> tuple[Array, Array]:
        """What is to be least, the largest of shape (aims,), and all margins, shape (rows,).

        A peak has kinks where another instant takes over; each of its samples is smooth by itself.
        So each is an aim, or a margin, of its own.
        """
        self.at(x)
        return self._rows(x, unit, limits)

    def _rows(self, x: Array, unit: float, limits: bool = True) -> tuple[Array, Array]:
        (found,) = self([x])
        aims = np.array([self.objective(found)])
        if self.minimise in self.sampled:
            aims = self._graded(x, self.minimise, unit, aims[0])
        each = [
            -self._graded(x, limit.output, limit.number(self.base), -margin)
            if limits and self._by_samples(limit)
            else np.array([margin])
            for limit, margin in zip(self.limits, self.margins(found), strict=True)
        ]
        return aims, np.concatenate([np.zeros(0), *each])

    @property
    def limited_peaks(self) -> bool:
        """Whether a peak has a limit."""
        return any(map(self._by_samples, self.limits))

    def _by_samples(self, limit: Limit) -> bool:
        """Whether every sample of a peak is to keep a limit."""
        return limit.upper and limit.output in self.sampled

    def _graded(self, x: Array, name: str, unit: float, otherwise: float) -> Array:
        """Logarithms of a peak's samples over a unit, and straight on below a half of it.

        There is no logarithm where a history passes zero, and no need of one.
        """
        samples = self._samples[x.tobytes()].get(name)
        if samples is None or len(samples) != self._counts[name]:
            return np.full(self._counts[name], otherwise)
        share = samples / unit
        return np.where(
            share > 0.5, np.log(np.maximum(share, 0.5)), math.log(0.5) + 2.0 * (share - 0.5)
        )

    def slopes(self, x: Array, unit: float, limits: bool = True) -> tuple[Array, Array]:
        """Gradients of aims, shape (aims, n), and margins, shape (rows, n)."""
        n = len(x)
        sides = [x + s * _STEP * np.eye(n)[k] for k in range(n) for s in (-1.0, 1.0)]
        self(sides)  # many at a time
        pairs = (self._rows(side, unit, limits) for side in sides)
        f, g = (np.array(each).reshape(n, 2, -1) for each in zip(*pairs, strict=True))
        return (f[:, 1] - f[:, 0]).T / (2 * _STEP), (g[:, 1] - g[:, 0]).T / (2 * _STEP)

    def nearest(self) -> str:
        """The design whose worst margin is least bad, in words."""
        if not self.history:
            return "none could be solved"
        _, found, _ = max(self.history, key=lambda row: float(np.min(self.margins(row[1]))))
        limit = self.limits[int(np.argmin(self.margins(found)))]
        return f"{limit.output} = {found[limit.output]:.4g} where {limit} is asked"

    def design(self, x: Array, continuous: bool) -> Design:
        """The report of the design at a point."""
        (found,) = self([x])
        assert found is not None
        unit = found[self.minimise]
        (aims, rows), (slopes, rates) = self._rows(x, unit), self.slopes(x, unit)
        margins = np.array([min(self._each(limit, found)) for limit in self.limits])
        counts = [self._counts[x.output] if self._by_samples(x) else 1 for x in self.limits]
        owner = np.repeat(np.arange(len(counts)), counts)
        tops, least = (
            aims > np.max(aims) - _TIED,
            [min(rows[owner == k]) for k in range(len(counts))],
        )
        near = np.array([m < least[k] + _TIED for m, k in zip(rows, owner, strict=True)], bool)
        held, ends, residual = kkt(slopes[tops], rates[near], rows[near], x, self.bounds)
        multipliers = np.asarray(np.bincount(owner[near], held, len(counts)), float)
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


def _samples(found: Mapping[str, Any]) -> dict[str, Array]:
    """Peaks at every sample, by name."""
    histories: dict[str, list[float]] = {}
    for key, value in found.items():
        name, at, _ = key.partition(AT)
        if at:
            histories.setdefault(name, []).append(float(value))
    return {name: np.array(values) for name, values in histories.items()}


def _solved(
    description: Description,
    patterns: tuple[str, ...],
    names: tuple[str, ...],
    sampled: tuple[str, ...],
    level: str | None,
    case: Mapping[str, float],
) -> dict[str, Any]:
    runs = any(name.partition(".")[0] in RUNS for name in names)
    designs = variants_of(description, patterns)
    rigid = designs.rigid if any(name.startswith("deviation") for name in names) else None
    return measure(designs.at(case), names, level if runs else None, rigid, sampled)
