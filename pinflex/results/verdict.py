"""Verdict of a comparison: the simplest level that suffices, and the answer in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinflex.results.result import Result, peak
from pinflex.text import percent, short

if TYPE_CHECKING:
    from pinflex.results.comparison import Comparison
    from pinflex.results.comparison_rows import ResidualRow, TorqueRow

SHARE = 0.05  # of the largest torque or deviation, by which a level that suffices may differ
_IDLE = 1e-3  # of what its joint bears, which rolling bearings lose to friction: less is idling
_DEARER = 5.0  # times the cost of the last level: runs of a tenth of a second scatter by three


@dataclass(frozen=True)
class LevelRow:
    """One level: against rigid, and against the level that leaves out least.

    Attributes:
        torque_percent: Of the torque that is furthest from rigid, % of that motor's rigid peak.
        deviation: Largest distance of the platform from rigid [m]. stress: Largest [Pa].
        torque_off: Largest difference of a torque from the best level, share of the largest torque
            with the same unit, or of what idle motors' joints bear.
        platform_off: Of the platform's place from the best level [m].
        suffices: Torques within `SHARE`, the platform within the band or `SHARE` of the best level.
            None where there is nothing to judge by. What cannot be said is None.
    """

    level: str
    torque_percent: float | None
    deviation: float | None
    stress: float | None
    cpu: float | None
    torque_off: float | None
    platform_off: float | None
    suffices: bool | None


def off_best(run: Result, best: Result, frame: str | None) -> tuple[float | None, float | None]:
    """Difference of torques (share of the largest of their unit) and of the platform [m].

    Motors of one unit that idle, as those of a closed gripper, are judged by a thousandth of what
    their joints bear: their own torques are round-off, of which no share says anything.

    Args:
        run, best: Runs of one scene.
        frame: Of the platform, or None.
    """
    units = [best.unit(f"torque/{motor}") for motor in best.motors]
    torque = None
    for unit in dict.fromkeys(units):
        at = [i for i, own in enumerate(units) if own == unit]
        scale = max(peak(best.torque[:, at]), _IDLE * max(_borne(best, best.motors[i]) for i in at))
        if scale > 0:
            share = peak(run.torque[:, at] - best.torque[:, at]) / scale
            torque = max(share, torque or 0.0)
    if frame is None:
        return torque, None
    away = run.frame(frame).position - best.frame(frame).position
    return torque, float(np.linalg.norm(away, axis=1).max())


def _borne(run: Result, motor: str) -> float:
    """Largest force or moment of a motor's joint [N | N m], 0 where the run has none."""
    if f"reaction/{motor}" not in run.arrays:
        return 0.0
    force, moment = np.split(run.joint(motor).reaction, 2, axis=1)
    wrench = force if run.unit(f"torque/{motor}") == "N" else moment
    return float(np.linalg.norm(wrench, axis=1).max())


def level_rows(
    c: Comparison, runs: Mapping[str, Result], frame: str | None, cpu: Mapping[str, float]
) -> tuple[LevelRow, ...]:
    """A row for each run, simplest level first; the last run is the best one.

    Args:
        c: Comparison with its torques, platform and stresses.
        runs: By level.
        frame: Of the platform, or None.
        cpu: CPU time by level [s].
    """
    if not runs:
        return ()
    best = list(runs.values())[-1]
    return tuple(
        _level_row(c, level, run, off_best(run, best, frame), frame, cpu.get(level))
        for level, run in runs.items()
    )


def _level_row(
    c: Comparison,
    level: str,
    run: Result,
    off: tuple[float | None, float | None],
    frame: str | None,
    cpu: float | None,
) -> LevelRow:
    """`off`: torques and platform from the best run, as `off_best` gives them."""
    rigid, worst = level == "rigid", furthest(c, level)
    percent = 0.0 if rigid and run.motors else None
    far = [r.position for r in c.platform if r.level == level]
    stress = [r.von_mises for r in c.stresses if r.level == level]
    torque, platform = off
    fits = (torque or 0.0) <= SHARE and (platform or 0.0) <= allowed(c)
    return LevelRow(
        level=level,
        torque_percent=percent if worst is None else worst.max_percent,
        deviation=max(far, default=0.0 if rigid and frame else None),
        stress=max(stress, default=None),
        cpu=cpu,
        torque_off=torque,
        platform_off=platform,
        suffices=None if torque is None and platform is None else fits,
    )


def allowed(c: Comparison) -> float:
    """Largest distance of the platform from the best level at which a level suffices [m]."""
    return max([c.band, *(SHARE * row.position for row in c.platform[-1:])])


def furthest(c: Comparison, level: str) -> TorqueRow | None:
    """The motor whose torque is furthest from rigid.

    Args:
        c: Comparison.
        level: One of its levels.
    """
    off = [(r.max_difference, r) for r in c.torques if r.level == level and r.max_difference]
    return max(off, key=lambda pair: pair[0])[1] if off else None


def simplest(rows: tuple[LevelRow, ...]) -> LevelRow | None:
    """The first level that suffices, where there is a better one to judge it by."""
    return next((row for row in rows[:-1] if row.suffices), None)


def words(c: Comparison) -> str:
    """The answer in a few sentences, at the level that leaves out least."""
    if not c.levels or c.levels[-1].level == "rigid":
        return ""
    best = c.levels[-1].level
    sentences = [_falls(c), _shakes(c, best), _torques(c, best), _stress(c, best), _suffices(c)]
    return " ".join(filter(None, sentences))


def _falls(c: Comparison) -> str:
    if c.falls is None:
        return ""
    return f"No equilibrium exists beyond t = {c.falls:.4g} s: it buckles or falls there."


def _shakes(c: Comparison, best: str) -> str:
    place = next((r for r in c.platform if r.level == best), None)
    if place is None:
        return ""
    text = f"The {place.frame} is off by up to {rounded_length(place.position)}"
    after = next((r for r in c.residuals if r.level == best), None)
    return f"{text}{_after(after, c.band)}."


def _after(row: ResidualRow | None, band: float) -> str:
    if row is None:
        return ""
    start = f"; after the stop it still shakes by {rounded_length(row.amplitude)}"
    if row.settling is None:
        return f"{start} and does not settle to {rounded_length(band)} within {row.watched:.2g} s"
    if row.settling == 0:
        return f"{start}, within {rounded_length(band)} at once"
    return f"{start} and settles to {rounded_length(band)} in {row.settling:.2g} s"


def _torques(c: Comparison, best: str) -> str:
    row = furthest(c, best)
    if row is None or row.max_difference is None:
        return ""
    most = row.max_difference
    share = (
        "" if row.max_percent is None else f", {percent(row.max_percent / 100)} of the rigid peak"
    )
    kind = "forces" if row.unit == "N" else "torques"
    where = short(row.motor, 20)
    return f"Motor {kind} differ from rigid by up to {most:.3g} {row.unit}{share} ({where})."


def _stress(c: Comparison, best: str) -> str:
    stresses = [r for r in c.stresses if r.level == best]
    if not stresses:
        return ""
    worst = max(stresses, key=lambda r: r.von_mises)
    share = "" if worst.yield_share is None else f", {percent(worst.yield_share)} of yield"
    first = next((f for f in c.frequencies if f > 0), None)
    resonance = "" if first is None else f" First resonance: {first:.3g} Hz."
    where = short(worst.link, 20)
    return f"Links bear up to {1e-6 * worst.von_mises:.3g} MPa{share} ({where}).{resonance}"


def _suffices(c: Comparison) -> str:
    best, found = c.levels[-1], simplest(c.levels)
    if best.suffices is None or len(c.levels) < 2:
        return ""
    if found is None:
        return f"No simpler level than {best.level} suffices."
    dearer = found.cpu is not None and best.cpu is not None and found.cpu > _DEARER * best.cpu
    return f"The simplest level that suffices is {found.level}" + (
        ", though it costs far more here." if dearer else "."
    )


def miss(row: LevelRow, c: Comparison) -> str:
    """By how much a level is off that does not suffice, or that it does.

    Args:
        row: Of one level.
        c: Its comparison.
    """
    if row.suffices is None:
        return ""
    if len(c.levels) < 2:
        return "alone: not judged"
    if row.suffices:
        return "suffices"
    parts = []
    if row.platform_off is not None and row.platform_off > allowed(c):
        parts.append(rounded_length(row.platform_off))
    if row.torque_off is not None and row.torque_off > SHARE:
        parts.append(f"torque {percent(row.torque_off)}")
    return f"misses {', '.join(parts)}"


def rounded_length(x: float) -> str:
    """Length [m] of two digits or more in a handy unit."""
    if x < 1e-12:
        return "0"
    units = ((1.0, "m", 1.0), (1e-4, "mm", 1e3), (1e-7, "um", 1e6), (0.0, "nm", 1e9))
    factor, unit = next((factor, unit) for least, unit, factor in units if x >= least)
    return f"{factor * x:.2g} {unit}" if factor * x < 100 else f"{factor * x:.0f} {unit}"
