"""The best design: numbers of the YAML that make one output least while others keep their limits.

In logarithms, x = ln(p / p0): least ln f(x) with margins g(x) >= 0 and bounds, by SLSQP (Kraft
1988) from several starts, with central differences. Multipliers of what is active say what a looser
limit buys: d ln f / d ln limit = -multiplier for a largest value.

A peak over time has kinks where one instant takes over from another, and least peaks are mostly
there. Each sample of it is smooth: so the largest of them is made least, or kept within a limit, as
so many functions of the design.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.description import Description
from pinflex.description.reading.parameters import parameters
from pinflex.errors import DescriptionError, SceneError
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.progress import Progress, barred, callback
from pinflex.threads import one_blas_thread
from pinflex.variation.design import Design
from pinflex.variation.evaluator import Evaluator, check_names, limits
from pinflex.variation.variants import Variants, keys, variants

_SPARE = 1e-4  # of a limit along a front: its end is met to round-off only
_BETTER = 1e-3  # of ln of the output: far above what limits are kept to
_MOST = 256  # combinations of a catalogue that are tried
_NEAREST = 4  # rows of a catalogue about the continuous optimum


@public
@barred
@one_blas_thread()
def design(
    model: str | Path | Description | Mechanism,
    minimise: str,
    vary: Mapping[str, tuple[float, float]],
    keep: Iterable[str] = (),
    *,
    choose: Mapping[str, Sequence[Mapping[str, float] | float]] | None = None,
    report: Iterable[str] = (),
    level: str | None = "quasistatic",
    starts: int = 2,
    seed: int = 1,
    jobs: int = 1,
    journal: str | Path | None = None,
    progress: Progress = None,
) -> Design:
    """Find the numbers of a scene that make an output least.

        best = pf.design("delta", "mass", {"flexible.*.section.wall": (0.5e-3, 4e-3)},
                         keep=["frequency.1 > base", "deviation.peak < base"])

    Args:
        model: A model, or what `load` takes.
        minimise: Output, see `pinflex.variation.evaluator`.
        vary: (low, high) by key path; links of one block of the YAML are one variable.
        keep: Limits, see `pinflex.variation.evaluator`; one on frequency.1 holds for those above.
        choose: Values to choose from by key path, or rows of several numbers below it (a catalogue
            of tubes by "flexible.arm_?.section"): tried about the continuous optimum.
        report: Other outputs to tell of the design.
        level: Of the runs that outputs need; None: that of the YAML.
        starts: From the first design, and from so many others less one.
        seed: Of the other starts.
        jobs: Processes for the differences.
        journal: File that keeps every design solved; the same call goes on from there.
        progress: True: a bar; or a function called with (designs solved, those of this gradient).

    Returns:
        The design, with what limits it.

    Raises:
        DescriptionError: Bad names, bounds or limits.
        SceneError: No design keeps the limits.
    """
    robot = model if isinstance(model, Mechanism) else load(model)
    given = limits(keep)
    wanted = check_names([minimise, *(limit.output for limit in given), *report], robot)
    catalogue = _catalogue(choose or {})
    if not vary and not catalogue:
        raise DescriptionError(
            "design: nothing varies. Give (low, high) by key path in `vary` (--vary KEY=LOW:HIGH), "
            "or `choose` (--choose)."
        )
    hull = {key: _range(rows, key) for rows in catalogue for key in rows[0]}
    designs = variants(robot, [*vary, *hull])
    bounds = _bounds(robot, designs, dict(vary) | hull)
    evaluate = Evaluator(designs, wanted, given, level, bounds, jobs, journal, callback(progress))
    best = _best(evaluate, starts, seed)
    if catalogue:
        best = _chosen(evaluate, best, catalogue)
    if best is None:
        raise SceneError(
            f"{robot.name}: no design within the bounds keeps every limit. Nearest: "
            f"{evaluate.nearest()}. Widen a bound, or loosen a limit."
        )
    return evaluate.design(best, continuous=not catalogue)


@public
def pareto(
    model: str | Path | Description | Mechanism,
    minimise: str,
    against: str,
    vary: Mapping[str, tuple[float, float]],
    keep: Iterable[str] = (),
    points: int = 6,
    **options: Any,
) -> list[Design]:
    """Designs of which none is better in both aims, from the least of one to that of the other.

    Args:
        model, vary, keep, options: As of `design`.
        minimise, against: The two outputs.
        points: How many.
    """
    robot = model if isinstance(model, Mechanism) else load(model)
    kept, options = list(keep), {"starts": 1} | options
    told: dict[str, Any] = {"report": (minimise, against)}
    first = design(robot, minimise, vary, kept, **told, **options)
    last = design(robot, against, vary, kept, **told, **options)
    low, high = last.after[against], first.after[against]
    steps = np.geomspace(high, low, points)[1:] * (1.0 + _SPARE) if low < high else np.zeros(0)
    limited = [[*kept, f"{against} < {float(limit)!r}"] for limit in steps]
    return [first, *(design(robot, minimise, vary, keep, **told, **options) for keep in limited)]


def _bounds(robot: Mechanism, designs: Variants, vary: Mapping[str, tuple[float, float]]) -> Array:
    """Logarithms of the bounds over the first values, shape (parameters, 2)."""
    rows = []
    for pattern, pair in vary.items():
        low, high = (float(x) for x in pair)
        if not 0 < low < high:
            raise DescriptionError(
                f"{robot.name}: vary {pattern}: {low:g} to {high:g}. Give 0 < low < high."
            )
        count = len(parameters(robot.description, [pattern])[1])
        rows += [(low, high)] * count
    return np.asarray(np.log(np.array(rows) / designs.first[:, None]), float)


def _catalogue(
    choose: Mapping[str, Sequence[Mapping[str, float] | float]],
) -> list[list[dict[str, float]]]:
    """Rows of values by full key, one list per choice."""
    found = []
    for key, rows in choose.items():
        made = [
            {f"{key}.{name}": float(x) for name, x in row.items()}
            if isinstance(row, Mapping)
            else {key: float(row)}
            for row in rows
        ]
        if len(made) < 2 or any(row.keys() != made[0].keys() for row in made):
            raise DescriptionError(f"choose {key}: give two rows or more, with the same columns.")
        found.append(made)
    return found


def _range(rows: Sequence[Mapping[str, float]], key: str) -> tuple[float, float]:
    values = [row[key] for row in rows]
    low, high = min(values), max(values)
    return (low, high) if low < high else (0.999 * low, 1.001 * high)


def _best(evaluate: Evaluator, starts: int, seed: int) -> Array | None:
    """The best point that keeps every limit, of several starts.

    Starts are those of one sequence (Halton 1960), and every design that a descent passed counts:
    so more starts are never worse, also where a descent ends beside the kink of a peak.
    """
    from scipy.stats.qmc import Halton

    low, high = evaluate.bounds.T
    points = [np.clip(np.zeros(len(low)), low, high)]
    if starts > 1:
        rows = Halton(len(low), rng=np.random.default_rng(seed)).random(starts - 1)
        points += list(low + (high - low) * rows)
    ended = [x for x in (_descent(evaluate, x) for x in points) if x is not None]
    passed = [x for x in evaluate.kept() if np.all((low <= x) & (x <= high))]
    best = min(ended, key=lambda x: evaluate.at(x)[0], default=None)
    other = min(passed, key=lambda x: evaluate.at(x)[0], default=best)
    if best is None or other is None:
        return other
    # Designs beside an end differ from it by what limits are kept to: that is no better design.
    return other if evaluate.at(other)[0] < evaluate.at(best)[0] - _BETTER else best


def _descent(evaluate: Evaluator, x: Array) -> Array | None:
    """The end of a descent from a start; None where it is a design that breaks a limit.

    Peaks keep their limits as one number first, which a start far beyond them asks less of.
    """
    end = _sqp(evaluate, x, False)
    if evaluate.limited_peaks and evaluate.feasible(end):
        last = _sqp(evaluate, end, True)
        end = last if evaluate.feasible(last) else end
    return end if evaluate.feasible(end) else None


def _sqp(evaluate: Evaluator, x: Array, sampled: bool) -> Array:
    """The end of SLSQP from a start.

    Where a peak is minimised, every sample is an aim f(x): then z = (x, s) with least s >= f(x),
    which has no kinks.
    """
    from scipy.optimize import minimize

    n, unit = len(x), math.exp(evaluate.at(x)[0])
    aims, margins = evaluate.rows(x, unit, sampled)
    several = len(aims) > 1
    z = np.append(x, np.max(aims)) if several else x
    last = np.eye(len(z))[-1]

    def rows(z: Array) -> tuple[Array, Array]:
        return evaluate.rows(z[:n].copy(), unit, sampled)

    def slopes(z: Array) -> tuple[Array, Array]:
        return evaluate.slopes(z[:n].copy(), unit, sampled)

    def kept(z: Array) -> Array:
        aims, margins = rows(z)
        return np.append(z[n] - aims, margins) if several else margins

    def rates(z: Array) -> Array:
        steep, rates = slopes(z)
        if not several:
            return rates
        of_s = np.append(np.ones(len(steep)), np.zeros(len(rates)))
        return np.column_stack([np.concatenate([-steep, rates]), of_s])

    found = minimize(
        (lambda z: z[n]) if several else lambda z: rows(z)[0][0],
        z,
        jac=(lambda z: last) if several else lambda z: slopes(z)[0][0],
        method="SLSQP",
        bounds=[*evaluate.bounds, *[(None, None)] * several],
        constraints=[{"type": "ineq", "fun": kept, "jac": rates}]
        if several or len(margins)
        else [],
        options={"maxiter": 60, "ftol": 1e-6 if several else 1e-8},
    )
    return np.asarray(np.clip(found.x[:n], *evaluate.bounds.T), float)


def _chosen(
    evaluate: Evaluator, best: Array | None, catalogue: Sequence[Sequence[Mapping[str, float]]]
) -> Array | None:
    """The best rows of a catalogue about a point, the other variables as they are there."""
    names = keys(evaluate.designs.parameters)
    x = best if best is not None else np.zeros(len(names))

    def place(rows: Iterable[Mapping[str, float]]) -> Array:
        point = x.copy()
        for row in rows:
            for key, value in row.items():
                k = names.index(key)
                point[k] = math.log(value / evaluate.designs.first[k])
        return point

    every = math.prod(len(rows) for rows in catalogue) <= _MOST
    groups = [
        rows
        if every
        else sorted(rows, key=lambda row: float(np.sum((place([row]) - x) ** 2)))[:_NEAREST]
        for rows in catalogue
    ]
    points = [place(rows) for rows in itertools.islice(itertools.product(*groups), _MOST)]
    evaluate(points)  # many at a time
    good = [p for p in points if evaluate.feasible(p)]
    return min(good, key=lambda p: evaluate.at(p)[0], default=None)
