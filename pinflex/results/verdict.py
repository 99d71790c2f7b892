"""Verdict of a comparison: the simplest level that suffices, and the answer in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.results.result import Result, peak
from pinflex.text import percent, short

if TYPE_CHECKING:
    from pinflex.results.comparison import Comparison, ResidualRow, TorqueRow


# Residual vibration after a motion: amplitude about the rest, and settling time.

BAND = 50e-6  # [m] a usual demand on the repeatability of handling robots
_LEAST = 8  # instants after the stop that a vibration can be read from
_STILL = 1e-9  # a rigid frame that moves by less of its way after the stop is at rest


def stops(rigid: Result, frame: str, stop: float) -> bool:
    """True if the rigid frame rests from the instant `stop` [s] to the end, long enough to read."""
    after = rigid.t >= stop * (1 - 1e-9)
    place = rigid.frame(frame).position
    way = float(np.ptp(place, axis=0).max(initial=0.0))
    moved = float(np.ptp(place[after], axis=0).max(initial=0.0)) if after.any() else 0.0
    return bool(np.count_nonzero(after) >= _LEAST and moved <= _STILL * way)


def residual(
    t: Array,
    away: Array,
    stop: float,
    band: float,
    rest: Array | None = None,
    period: float = 0.0,
) -> tuple[float, float | None]:
    """Amplitude about the rest [m] and settling time [s] of a deviation, see `ResidualRow`."""
    after = t >= stop * (1 - 1e-9)
    t, away = t[after], away[after]
    if rest is None:
        weights = np.hanning(len(t) + 2)[1:-1]
        rest = weights @ away / weights.sum()
    distance = np.linalg.norm(away - rest, axis=1)
    amplitude, beyond = float(distance.max()), np.flatnonzero(distance > band)
    if not len(beyond):
        return amplitude, 0.0
    k = int(beyond[-1])
    if k == len(t) - 1 or t[-1] - t[k] < period / 2:
        return amplitude, None
    share = (distance[k] - band) / (distance[k] - distance[k + 1])
    return amplitude, float(t[k] + share * (t[k + 1] - t[k]) - stop)


TOL = 0.05  # of the largest torque or deviation, by which a level that suffices may differ
_IDLE = 1e-3  # of what its joint bears, which rolling bearings lose to friction: less is idling
_MOSTLY = 0.8  # of the largest deviation: a sag so large hides what the motion adds
_SAG = 0.01  # of the largest deviation: what a start in equilibrium has less of is not told
_DEARER = 5.0  # times the cost of the last level: runs of a tenth of a second scatter by three


@dataclass(frozen=True)
class LevelRow:
    """One level: against rigid, and against the level that leaves out least.

    Torques are judged by the largest one with the same unit at the best level; those of motors
    that idle, by what their joints bear.

    Attributes:
        torque_percent: Largest difference of a torque from rigid [%].
        deviation: Largest distance of the platform from rigid [m]. stress: Largest [Pa].
        torque_off: Largest difference of a torque from the best level [-].
        platform_off: Of the platform's place from the best level [m].
        suffices: Torques within `tol`, the platform within the band or `tol` of the best level.
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


def criterion(tol: float = TOL, band: float = BAND, best: str = "coupled") -> str:
    """When a level suffices, in words that `compare` and `advise` share."""
    return (
        f"torque within {percent(tol)} of the {best} peak, platform within {rounded_length(band)} "
        f"or {percent(tol)} (--tol, --band)"
    )


def platform_allowed(deviation: float, tol: float = TOL, band: float = BAND) -> float:
    """Distance of the platform from the best level that suffices [m]."""
    return max(band, tol * deviation)


def torque_difference(run: Result, other: Result, best: Result) -> float | None:
    """Largest difference of torques, as a share of the best level's largest with the same unit.

    Motors of one unit that idle, as those of a closed gripper, are judged by a thousandth of what
    their joints bear: their own torques are round-off, of which no share says anything.
    """
    units = [best.unit(f"torque/{motor}") for motor in best.motors]
    found = None
    for unit in dict.fromkeys(units):
        at = [i for i, own in enumerate(units) if own == unit]
        scale = max(peak(best.torque[:, at]), _IDLE * max(_borne(best, best.motors[i]) for i in at))
        if scale > 0:
            found = max(peak(run.torque[:, at] - other.torque[:, at]) / scale, found or 0.0)
    return found


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
    """A row for each run, simplest level first; the last run is the best one."""
    return tuple(_level_row(c, level, runs, frame, cpu.get(level)) for level in runs)


def _level_row(
    c: Comparison, level: str, runs: Mapping[str, Result], frame: str | None, cpu: float | None
) -> LevelRow:
    run, rigid, best = runs[level], runs.get("rigid"), list(runs.values())[-1]
    far = [r.position for r in c.platform if r.level == level]
    stress = [r.von_mises for r in c.stresses if r.level == level]
    from_rigid = None if rigid is None else torque_difference(run, rigid, best)
    torque, platform = torque_difference(run, best, best), None
    if frame is not None:
        away = run.frame(frame).position - best.frame(frame).position
        platform = float(np.linalg.norm(away, axis=1).max())
    fits = (torque or 0.0) <= c.tol and (platform or 0.0) <= allowed(c)
    return LevelRow(
        level=level,
        torque_percent=None if from_rigid is None else 100 * from_rigid,
        deviation=max(far, default=0.0 if level == "rigid" and frame else None),
        stress=max(stress, default=None),
        cpu=cpu,
        torque_off=torque,
        platform_off=platform,
        suffices=None if torque is None and platform is None else fits,
    )


def allowed(c: Comparison) -> float:
    """Largest distance of the platform from the best level at which a level suffices [m]."""
    return platform_allowed(max((r.position for r in c.platform[-1:]), default=0.0), c.tol, c.band)


def furthest(c: Comparison, level: str) -> TorqueRow | None:
    """The motor whose torque is furthest from rigid."""
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
    text = (
        f"Frame {place.frame} deviates from the rigid motion by up to "
        f"{rounded_length(place.position)}"
    )
    if place.at_start > _SAG * place.position:
        most = place.at_start > _MOSTLY * place.position
        moved = f", from which it moves by up to {rounded_length(place.moved)}" if most else ""
        text += f" ({rounded_length(place.at_start)} of it static sag{moved})"
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
    scale = max(r.peak for r in c.torques if (r.level, r.unit) == (best, row.unit))
    share = f", {percent(most / scale)} of the {best} peak" if scale > 0 else ""
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
        tried = {*(row.level for row in c.levels), *c.unsolved}
        left = [x for x in ("quasistatic", "ked") if x not in tried and best.level == "coupled"]
        rest = f" of those that were run ({' and '.join(left)} were not)" if left else ""
        return f"No simpler level than {best.level} suffices{rest}."
    dearer = found.cpu is not None and best.cpu is not None and found.cpu > _DEARER * best.cpu
    return f"The simplest level that suffices is {found.level}" + (
        ", though it costs far more here." if dearer else "."
    )


def miss(row: LevelRow, c: Comparison) -> str:
    """Either "suffices", or by how much the level misses: "misses 0.2 mm, torque 7 %"."""
    if row.suffices is None:
        return ""
    if len(c.levels) < 2:
        return "alone: not judged"
    if row.suffices:
        return "suffices"
    parts = []
    if row.platform_off is not None and row.platform_off > allowed(c):
        parts.append(rounded_length(row.platform_off))
    if row.torque_off is not None and row.torque_off > c.tol:
        parts.append(f"torque {percent(row.torque_off)}")
    return f"misses {', '.join(parts)}"


def rounded_length(x: float) -> str:
    """Length [m] of two digits or more in a handy unit."""
    if x < 1e-12:
        return "0"
    units = ((1.0, "m", 1.0), (1e-4, "mm", 1e3), (1e-7, "um", 1e6), (0.0, "nm", 1e9))
    factor, unit = next((factor, unit) for least, unit, factor in units if x >= least)
    return f"{factor * x:.2g} {unit}" if factor * x < 100 else f"{factor * x:.0f} {unit}"
