"""Scatter: outputs of many designs whose parameters are random, and which of these matter.

Rows A and B are two independent samples (a Latin hypercube of 2 d dimensions); rows AB_i are those
of A with the i-th parameter of B. First-order and total indices follow from them, after the part
of an output that is linear in the parameters has been taken out: its variance is known exactly,
and few designs are enough for the rest.

Source: Saltelli et al. 2010, Variance based sensitivity analysis of model output, table 2 (c), (f);
linear regression as control variate; standard errors by the bootstrap.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.description import Description
from pinflex.description.reading.parameters import parameters
from pinflex.errors import DescriptionError
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.progress import Progress, barred, callback
from pinflex.report import Report, Reported, Words, table
from pinflex.results.pose_map import Columns
from pinflex.studies.batch import Record, keys, run
from pinflex.studies.outputs import check_outputs, prismatic, scene_outputs
from pinflex.studies.sweep import table_of
from pinflex.text import frozen
from pinflex.variation.variants import variants_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# Random parameters of a scene: their distributions, and the texts that give them.

_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_PAIR, _SHARE = re.compile(rf"{_NUMBER}:{_NUMBER}"), re.compile(rf"(?:\+-|±)?{_NUMBER}\s*%")


@dataclass(frozen=True)
class Distribution:
    """A random parameter.

    Attributes:
        key: Key path, as of a `Parameter`.
        kind: normal (mean, standard deviation) or uniform (low, high).
        first, second: Its two numbers, SI units.
    """

    key: str
    kind: str
    first: float
    second: float

    def values(self, shares: Array) -> Array:
        """Values at cumulative probabilities 0 to 1, same shape."""
        if self.kind == "uniform":
            return np.asarray(self.first + shares * (self.second - self.first))
        from scipy.special import ndtri

        return np.asarray(self.first + self.second * ndtri(shares))

    def standard(self, values: Array) -> Array:
        """Values less their mean, over their standard deviation, same shape."""
        mean, std = self.first, self.second
        if self.kind == "uniform":
            mean, std = (self.first + self.second) / 2, (self.second - self.first) / math.sqrt(12)
        return np.asarray((values - mean) / std)


def distributions(
    description: Description, normal: Mapping[str, str], uniform: Mapping[str, str]
) -> tuple[Distribution, ...]:
    """Random parameters from texts."""
    found: dict[str, Distribution] = {}
    for kind, given in (("normal", normal), ("uniform", uniform)):
        for pattern, text in given.items():
            _, every = parameters(description, [pattern])
            for parameter in every:
                if parameter.key in found:
                    raise DescriptionError(f"{parameter.key}: given twice. Keep one distribution.")
                where = f"--{kind} {pattern}"
                found[parameter.key] = _parsed(where, parameter.key, kind, text, parameter.value)
    if not found:
        raise DescriptionError(
            "random sweep: no random parameter. Give --normal KEY=MEAN:STD or --uniform KEY=A:B."
        )
    return tuple(found.values())


def _parsed(where: str, key: str, kind: str, text: str, value: float) -> Distribution:
    text = str(text).strip()
    share, pair = _SHARE.fullmatch(text), _PAIR.fullmatch(text)
    if share is not None:
        spread = abs(value) * float(share[1]) / 100.0
        first, second = (value, spread) if kind == "normal" else (value - spread, value + spread)
    elif pair is not None:
        first, second = float(pair[1]), float(pair[2])
    else:
        form = "MEAN:STD or 2%" if kind == "normal" else "LOW:HIGH or 2%"
        raise DescriptionError(f"{where}: {text!r}: not of the form {form}. Write one.")
    wrong = second <= 0 if kind == "normal" else second <= first
    if wrong:
        rule = "a standard deviation above 0" if kind == "normal" else "LOW below HIGH"
        raise DescriptionError(f"{where}: {text!r}. Give {rule}.")
    return Distribution(key, kind, first, second)


QUANTILES = (0.05, 0.5, 0.95)
OUTPUTS = ("frequency", "deviation", "torque", "stress")
_RESAMPLES = 200  # of the bootstrap: a standard error to 5 %
_LEAST = 4  # rows of a sample


@frozen
class Scatter(Reported):
    """Random designs of a scene.

    Attributes:
        table: Row per design: parameters, status, error, outputs.
        distributions: The random parameters.
        outputs: Names of the outputs that scatter.
        quantiles: At `QUANTILES`, shape (outputs, 3). mean, std: Shape (outputs,).
        first, total: Sobol indices, shape (outputs, parameters): share of the variance that a
            parameter makes alone, and with all its interactions; nan where too few designs ended.
        first_error, total_error: Their standard errors (bootstrap), same shape.
    """

    table: Columns
    distributions: tuple[Distribution, ...]
    outputs: tuple[str, ...]
    quantiles: Array
    mean: Array
    std: Array
    first: Array
    total: Array
    first_error: Array
    total_error: Array

    def as_report(self) -> Report:
        """Quantiles, and the share of each parameter in the variance."""
        rows = [
            (name, self.table.units.get(name, ""), *self.quantiles[k].tolist(), float(self.std[k]))
            for k, name in enumerate(self.outputs)
        ]
        heads = ("output", "unit", "5 %", "median", "95 %", "std")

        def share(k: int, output: int) -> str:
            alone, together = self.first[output, k], self.total[output, k]
            return f"{alone:.2f} / {together:.2f}" if np.isfinite(alone) else "-"

        shares = [
            (name, lambda k, output=output: share(k, output))
            for output, name in enumerate(self.outputs)
        ]
        worst = float(np.nanmax(self.total_error)) if np.any(np.isfinite(self.total_error)) else 0.0
        note = f"Standard error of these shares: at most {worst:.2g}."
        return Report("scatter", (
            table("Scatter", rows, *((head, itemgetter(k)) for k, head in enumerate(heads)),
                  names=(36, 8)),
            table(
                "Share of the variance: alone / with interactions", range(len(self.distributions)),
                ("parameter", lambda k: self.distributions[k].key), *shares, names=(44,),
            ),
            Words("\n".join([note, *self._sentences()])),
        ))  # fmt: skip

    def as_json(self) -> dict[str, Any]:
        """Plain lists and names, SI units."""
        return {
            "columns": {name: values.tolist() for name, values in self.table.arrays.items()},
            "parameters": [d.key for d in self.distributions],
            "outputs": {name: self._numbers(k) for k, name in enumerate(self.outputs)},
        }

    def _numbers(self, k: int) -> dict[str, Any]:
        return {
            "quantiles": dict(zip(map(str, QUANTILES), self.quantiles[k].tolist(), strict=True)),
            "mean": float(self.mean[k]),
            "std": float(self.std[k]),
            "first": self.first[k].tolist(),
            "total": self.total[k].tolist(),
            "total_error": self.total_error[k].tolist(),
        }

    def plot(
        self, path: str | Path | None = None, *, panel: str | None = None, ax: Axes | None = None
    ) -> Any:
        """Draw a histogram of each output, and what its variance comes from; returns the axes.

        Args:
            path: Where to write it too, .png, .pdf or .svg.
            panel: One alone: an output for its histogram, "variance OUTPUT" for the shares.
            ax: Where to draw that; default: axes of a new figure.
        """
        from pinflex.viewer.plots.variation import histograms

        samples = {name: self.table[name] for name in self.outputs}
        names = [d.key for d in self.distributions]
        drawn = histograms(samples, self.table.units, self.quantiles, names, self.total)
        return drawn.axes(panel, ax, path)

    def _sentences(self) -> list[str]:
        said = []
        for k, name in enumerate(self.outputs):
            if np.any(np.isfinite(self.total[k])):
                best = int(np.nanargmax(self.total[k]))
                share = 100.0 * min(float(self.total[k, best]), 1.0)
                error = 100.0 * float(self.total_error[k, best])
                by = self.distributions[best].key
                said.append(f"{name} scatters by {by} ({share:.0f} +- {max(error, 1):.0f} %).")
        return said


@public
@barred
def scatter(
    model: str | Path | Description | Mechanism,
    count: int = 500,
    *,
    normal: Mapping[str, str] | None = None,
    uniform: Mapping[str, str] | None = None,
    seed: int = 1,
    level: str | None = None,
    outputs: Iterable[str] = OUTPUTS,
    jobs: int = 1,
    scheduler: str | None = None,
    journal: str | Path | None = None,
    fresh: bool = False,
    progress: Progress = None,
) -> Scatter:
    """Solve random designs of a scene.

        found = pf.scatter("delta", 300, normal={"flexible.*.section.wall": "5 %"})
        print(found.text())

    What a flexible link carries beside its beam stays, so that a thinner wall is a lighter link.

    Args:
        model: A model, or what `load` takes.
        count: Designs at most; n (d + 2) of them are solved, with d random parameters.
        normal, uniform: See `distributions`.
        seed: Of the random numbers: the same seed gives the same designs.
        level: Default: the level of the YAML.
        outputs: Groups, see `pinflex.studies.outputs.scene_outputs`.
        jobs, scheduler, journal, fresh, progress: As in `pinflex.sweep`.

    Raises:
        DescriptionError: Bad distributions, or too few designs for the parameters.
    """
    robot = model if isinstance(model, Mechanism) else load(model)
    groups = check_outputs(outputs, level)
    random = distributions(robot.description, normal or {}, uniform or {})
    rows = designs(random, count, seed)
    cases = [dict(zip((d.key for d in random), map(float, row), strict=True)) for row in rows]
    named = keys(robot.description, cases, "scatter", level, groups)
    records = run(
        partial(_solved, robot.description, tuple(d.key for d in random), level, groups),
        dict(zip(named, cases, strict=True)),
        jobs=jobs, scheduler=scheduler, journal=journal, fresh=fresh, progress=callback(progress),
    )  # fmt: skip
    slides = prismatic(robot.description)
    return _evaluated(random, cases, [records[key] for key in named], slides)


def designs(random: Sequence[Distribution], count: int, seed: int) -> Array:
    """Rows A, B, then AB_1, AB_2, ... of the sample, shape (n (d + 2), d)."""
    from scipy.stats.qmc import LatinHypercube

    d = len(random)
    n = count // (d + 2)
    if n < _LEAST:
        raise DescriptionError(
            f"--random {count}: {d} random parameters need at least {_LEAST * (d + 2)} designs."
        )
    shares = np.clip(LatinHypercube(2 * d, rng=np.random.default_rng(seed)).random(n), 1e-12, None)
    A, B = (
        np.stack([x.values(part[:, k]) for k, x in enumerate(random)], axis=1)
        for part in (shares[:, :d], shares[:, d:])
    )
    mixed = [np.where(np.arange(d) == k, B, A) for k in range(d)]
    return np.concatenate([A, B, *mixed])


def _solved(
    description: Description,
    random: tuple[str, ...],
    level: str | None,
    groups: Sequence[str],
    case: Mapping[str, float],
) -> dict[str, Any]:
    return scene_outputs(variants_of(description, random).at(case), level, groups)


def _evaluated(
    random: tuple[Distribution, ...],
    cases: Sequence[Mapping[str, float]],
    records: list[Record],
    slides: frozenset[str],
) -> Scatter:
    names = _numbers(records)
    numbers = [
        replace(record, found={name: record.found.get(name) for name in names})
        for record in records
    ]
    whole = table_of(cases, numbers, slides)
    values = {name: whole[name] for name in names}
    n, d = len(cases) // (len(random) + 2), len(random)
    shown = tuple(name for name, x in values.items() if _scatters(x[: 2 * n]))
    quantiles = np.full((len(shown), len(QUANTILES)), np.nan)
    mean, std = np.full((2, len(shown)), np.nan)
    indices = np.full((4, len(shown), d), np.nan)
    standard = np.stack(
        [x.standard(np.array([case[x.key] for case in cases])) for x in random], axis=1
    ).reshape(d + 2, n, d)
    for k, name in enumerate(shown):
        sample = values[name][: 2 * n]
        quantiles[k] = np.nanquantile(sample, QUANTILES)
        mean[k], std[k] = np.nanmean(sample), np.nanstd(sample, ddof=1)
        indices[:, k] = _indices(values[name].reshape(d + 2, n), standard)
    return Scatter(whole, random, shown, quantiles, mean, std, *indices)


def _numbers(records: Sequence[Record]) -> list[str]:
    """Names of the outputs that are numbers wherever they were found."""
    names = dict.fromkeys(name for record in records for name in record.found)
    return [
        name
        for name in names
        if all(isinstance(r.found.get(name, 0.0), (int, float)) for r in records)
    ]


def _scatters(sample: Array) -> bool:
    finite = sample[np.isfinite(sample)]
    return len(finite) > 1 and float(np.ptp(finite)) > 1e-12 * float(np.max(np.abs(finite)))


def _indices(blocks: Array, standard: Array) -> Array:
    """First-order and total indices and their standard errors, shape (4, d)."""
    ended = np.all(np.isfinite(blocks), axis=0)  # designs that ended in all rows
    blocks, standard = blocks[:, ended], standard[:, ended]
    n = blocks.shape[1]
    if n < _LEAST:
        return np.full((4, len(blocks) - 2), np.nan)
    centred = blocks - np.mean(blocks[:2])  # the estimates are exact for it and lose fewer digits
    rng = np.random.default_rng(0)
    picks = rng.integers(n, size=(_RESAMPLES, n))
    every = np.array([_estimates(centred[:, pick], standard[:, pick]) for pick in picks])
    return np.concatenate([_estimates(centred, standard), np.nanstd(every, axis=0, ddof=1)])


def _estimates(f: Array, z: Array) -> Array:
    """First-order and total indices, shape (2, d), of values (d + 2, n) at parameters z.

    f = b . z + rest, where the regression makes the rest independent of b . z to first order: the
    variance is b . b + var(rest), of which parameter i has b_i^2 and its share of the rest.
    """
    d = z.shape[2]
    columns = np.concatenate([np.ones((z.shape[0] * z.shape[1], 1)), z.reshape(-1, d)], axis=1)
    b = np.linalg.lstsq(columns, f.ravel(), rcond=None)[0]
    rest = f - (columns @ b).reshape(f.shape)
    A, B, mixed = rest[0], rest[1], rest[2:]
    left = np.var(rest[:2])
    # A variance is not negative, and what a parameter does alone is part of all it does.
    alone = b[1:] ** 2 + np.maximum(left - 0.5 * np.mean((B - mixed) ** 2, axis=1), 0.0)
    total = np.maximum(b[1:] ** 2 + 0.5 * np.mean((A - mixed) ** 2, axis=1), alone)
    return np.stack([alone, total]) / (float(b[1:] @ b[1:]) + left or np.nan)
