"""Rigid against flexible in one table: torques, platform, stress, frequencies, cost."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from pinflex.boundary import public
from pinflex.errors import DescriptionError
from pinflex.report import Block, Report, Reported, Table, bullets, cell, lines, table
from pinflex.results import verdict
from pinflex.results.drives import DriveRow, drive_row, drive_table
from pinflex.results.result import Result, peak, rms, same_grid
from pinflex.results.verdict import BAND, TOL, residual, stops
from pinflex.results.views import Deviation
from pinflex.text import frozen, percent, short

# The report of a comparison: the answer in words, a table of levels, then all the rest.

# What a person should know of a level before trusting its numbers.
_LEFT_OUT = {
    "rigid": "all elasticity",
    "quasistatic": "vibration: links bend as if the motion were slow",
    "ked": "large deflection: linear vibration about the rigid motion",
    "coupled": "large strain; deflection beyond a tenth of a segment",
}
_UNSOLVED = "NOT SOLVED, see below"
_NOTES = 5  # notes on one screen
_ROUND_OFF = 1e-12  # [m | rad] of a metre-size mechanism: shown as zero


def _title(c: Comparison) -> str:
    return f"{c.name}: rigid against flexible"


def _head(c: Comparison) -> list[Block]:
    best = c.levels[-1].level if len(c.levels) > 1 else ""
    judged = f"Suffices: {verdict.criterion(c.tol, c.band, best)}." if best else ""
    answer = f"{c.name}: {c.verdict}" if c.verdict else _title(c)
    start = lines(c.start, indent="  ", first="! ")
    return [(answer, start), (judged, _level_table(c, best))]


def _level_table(c: Comparison, best: str) -> Table:
    unit = _unit("m", (x.deviation for x in c.levels), 1e-4)
    rows: list[dict[str, Any]] = [
        asdict(x) | {"verdict": "the reference" if x.level == best else verdict.miss(x, c)}
        for x in c.levels
    ]
    order = [*_LEFT_OUT]
    rows += [_unsolved(level, "torque_percent", "deviation", "stress", "cpu", "verdict")
             for level in c.unsolved]  # fmt: skip
    rows.sort(key=lambda x: order.index(x["level"]) if x["level"] in order else len(order))
    peaks = f", torque in % of the {best} peak" if best else ""
    return table(
        f"Levels, simplest first; differences from rigid{peaks}", rows, "level",
        ("torque [%]", lambda x: _share(x["torque_percent"]), _digits(2)),
        (f"deviation [{unit}]", "deviation", _digits(3)), ("stress [MPa]", "stress", _digits(3)),
        ("CPU [s]", "cpu", _digits(2)), "verdict", names=(22,), prose=True,
    )  # fmt: skip


def _unsolved(level: str, *keys: str) -> dict[str, Any]:
    """A row without numbers, its last cell the remark."""
    return {"level": level, **dict.fromkeys(keys), keys[-1]: _UNSOLVED}


def _unit(unit: str, values: Iterable[float | None], least: float) -> str:
    """mm or um, mrad or urad: the larger where a value reaches `least` [m | rad]."""
    most = max((x for x in values if x is not None), default=0.0)
    return f"{'m' if most >= least else 'u'}{unit}"


def _share(percents: float | None) -> float | None:
    return None if percents is None else percents / 100


def _digits(digits: int) -> Callable[[float | None], str]:
    def show(x: float | None) -> str:
        if x is None or x < 1e-12:
            return "-" if x is None else "0"
        return f"{x:.0f}" if 100 <= x < 1e4 else f"{x:.{digits}g}"

    return show


def _torque_table(c: Comparison) -> Table:
    units, rows = list(dict.fromkeys(r.unit for r in c.torques)), list[dict[str, Any]]()
    for r in c.torques:
        name = f"{short(r.motor, 15)} {r.unit}" if len(units) > 1 else r.motor
        row = asdict(r) | {"motor": name}
        if r.rigid_peak is not None and all(name != x["motor"] for x in rows):
            both = {"level": "rigid", "peak": r.rigid_peak, "rms": r.rigid_rms}
            rows.append(dict.fromkeys(row, "") | {"motor": name} | both)
        rows.append(row)

    def relative(x: Any) -> str:
        return cell(x) if x == "" else percent(_share(x), 3)

    return table(
        f"Motor torque [{' | '.join(units)}]; diff is from rigid, in % of the rigid peak", rows,
        "motor", "level", "peak", "rms", ("max diff", "max_difference"),
        ("rms diff", "rms_difference"), ("max", "max_percent", relative),
        ("rms", "rms_percent", relative), names=(20, 16), once=True,
    )  # fmt: skip


def _platform_table(c: Comparison) -> Table:
    length = _unit("m", (r.position for r in c.platform), 1e-5)
    angle = _unit("rad", (r.rotation for r in c.platform), 1e-5)

    def when(value: str) -> Callable[[Any], str]:
        return lambda r: (
            f"{getattr(r, f'{value}_time'):.4f}" if getattr(r, value) > _ROUND_OFF else "-"
        )

    def size(value: str) -> Callable[[Any], float]:
        return lambda r: float(getattr(r, value)) if getattr(r, value) > _ROUND_OFF else 0.0

    return table(
        "Platform, largest deviation from rigid", c.platform, "frame", "level",
        (f"position [{length}]", size("position")), ("at [s]", when("position")),
        (f"rotation [{angle}]", size("rotation")), ("at [s]", when("rotation")),
    )  # fmt: skip


def _residual_table(c: Comparison) -> Table:
    return table(
        "Vibration after the stop, about the place of rest", c.residuals, "frame", "level",
        ("stop [s]", "stop", "{:.4g}".format), ("amplitude [mm]", "amplitude"),
        (f"within {verdict.rounded_length(c.band)} after [s]", _settled), once=True,
    )  # fmt: skip


def _settled(row: ResidualRow) -> str:
    return f"not in {row.watched:.3g}" if row.settling is None else f"{row.settling:.4f}"


def _stress_table(c: Comparison) -> Table:
    order = list(dict.fromkeys(r.link for r in c.stresses))
    known = any(r.yield_share is not None for r in c.stresses)
    share = [("of yield", "yield_share", lambda x: percent(x, 3))] if known else []
    return table(
        "Flexible links, largest von Mises stress and where (x from the link's root)",
        sorted(c.stresses, key=lambda r: order.index(r.link)), "link", "level",
        ("stress [MPa]", "von_mises"), *share, ("x [mm]", "x"),
        ("x / length", "fraction", "{:.2f}".format), ("at [s]", "time", "{:.4f}".format), once=True,
    )  # fmt: skip


def _frequency_table(c: Comparison) -> Table:
    title = "Natural frequencies" + (f" ({c.frequency_note})" if c.frequency_note else "")
    return table(
        title, enumerate(c.frequencies, 1), ("mode", lambda x: x[0]),
        ("frequency [Hz]", lambda x: x[1]),
        ("period [s]", lambda x: 1 / x[1] if x[1] > 0 else None), names=(4,),
    )  # fmt: skip


def _cost_table(c: Comparison) -> Table:
    rows = [asdict(r) | {"out": _LEFT_OUT.get(r.level, "")} for r in c.costs]
    rows += [_unsolved(level, "cpu", "seconds", "steps", "newton", "out") for level in c.unsolved]
    return table(
        "Cost of each level", rows, "level", ("CPU [s]", "cpu"), ("wall [s]", "seconds"), "steps",
        ("Newton", "newton"), ("what it leaves out", "out"), names=(22,), prose=True,
    )  # fmt: skip


def _remarks(c: Comparison, most: int | None = None) -> Block:
    alike: dict[str, list[str]] = {}
    for level, why in c.unsolved.items():
        alike.setdefault(why, []).append(level)
    notes = [
        f"{' and '.join([*filter(None, [', '.join(levels[:-1])]), levels[-1]])} "
        f"{'were' if len(levels) > 1 else 'was'} not solved. {why}"
        for why, levels in alike.items()
    ] + [*c.notes]
    if most is not None and len(notes) > most:
        notes[most - 1 :] = [f"{len(notes) - most + 1} more notes are in comparison.txt."]
    return bullets(notes, "Notes")


# Rows of a comparison: each is one measurement of a run, or of a run against the rigid one.


@frozen
class TorqueRow:
    """One motor at one level against the rigid run [N m | N]; percents are of the rigid peak.

    Without a rigid run, or where its torque is zero, what cannot be said is None.
    """

    motor: str
    unit: str
    level: str
    rigid_peak: float | None
    rigid_rms: float | None
    peak: float
    rms: float
    max_difference: float | None
    rms_difference: float | None
    max_percent: float | None
    rms_percent: float | None


@frozen
class PlatformRow:
    """Largest distance [m] and angle [rad] of the platform from the rigid run, with times [s].

    `at_start` is the distance at the first instant: the sag of a start in equilibrium; `moved` how
    far the platform gets from there.
    """

    level: str
    frame: str
    position: float
    position_time: float
    rotation: float
    rotation_time: float
    at_start: float = 0.0
    moved: float = 0.0


@frozen
class StressRow:
    """Largest von Mises stress [Pa] of a link, where along it (x [m], x / length) and when [s].

    `yield_share` is that stress over the material's strength, None where that is not known.
    """

    level: str
    link: str
    von_mises: float
    x: float
    fraction: float
    time: float
    yield_share: float | None = None


@dataclass(frozen=True)
class ResidualRow:
    """Residual vibration; `settling` None: beyond the band to the end of the run.

    Attributes:
        stop: End of the motion [s]. watched: How long the run goes on after it [s].
        amplitude: Largest distance of the frame from where it comes to rest [m].
        settling: Time after the stop from which on it stays within `band` [m] of there [s].
    """

    level: str
    frame: str
    stop: float
    watched: float
    amplitude: float
    band: float
    settling: float | None


@frozen
class CostRow:
    """Cost of a level: wall and CPU time [s], steps, Newton iterations; None: not recorded."""

    level: str
    seconds: float | None
    steps: int | None
    newton: int | None
    cpu: float | None = None


def torque_row(label: str, rigid: Result | None, run: Result, i: int) -> TorqueRow:
    """A motor at one level."""
    motor, torque = run.motors[i], run.torque[:, i]
    row = TorqueRow(
        motor, run.unit(f"torque/{motor}"), label, None, None, peak(torque), rms(torque),
        None, None, None, None,
    )  # fmt: skip
    if rigid is None:
        return row
    reference = rigid.torque[:, i]
    difference, scale = torque - reference, peak(reference)
    # below round-off of the largest torque a percentage means nothing
    scaled = scale > 1e-12 * max(peak(rigid.torque), peak(run.torque))
    return replace(
        row,
        rigid_peak=scale,
        rigid_rms=rms(reference),
        max_difference=peak(difference),
        rms_difference=rms(difference),
        max_percent=100 * peak(difference) / scale if scaled else None,
        rms_percent=100 * rms(difference) / scale if scaled else None,
    )


def farthest(label: str, frame: str, deviation: Deviation) -> PlatformRow:
    """Largest deviations of a frame."""
    far, turned = int(np.argmax(deviation.norm)), int(np.argmax(deviation.angle))
    return PlatformRow(
        level=label,
        frame=frame,
        position=float(deviation.norm[far]),
        position_time=float(deviation.t[far]),
        rotation=float(deviation.angle[turned]),
        rotation_time=float(deviation.t[turned]),
        at_start=float(deviation.norm[0]),
        moved=float(np.linalg.norm(deviation.position - deviation.position[0], axis=1).max()),
    )


def stress_row(label: str, run: Result, link: str, strength: float | None) -> StressRow:
    """The largest stress of a link."""
    worst = run.worst_stress(link=link)
    return StressRow(
        level=label,
        link=link,
        von_mises=worst.value,
        x=worst.x,
        fraction=worst.x / run.link(link).length,
        time=worst.t,
        yield_share=None if strength is None else worst.value / strength,
    )


def cost_row(label: str, run: Result, cpu: float | None) -> CostRow:
    """What a run cost."""
    cost: dict[str, Any] = run.meta.get("cost", {})
    seconds, steps, newton = (cost.get(key) for key in ("seconds", "steps", "newton"))
    return CostRow(
        level=label,
        seconds=None if seconds is None else float(seconds),
        steps=None if steps is None else int(steps),
        newton=None if newton is None else int(newton),
        cpu=cpu,
    )


@frozen
class Comparison(Reported):
    """The table of one scene; `text` for people, `to_json` for machines (SI units).

    Attributes:
        frequencies: [Hz]. frequency_note: About which state, with which motors.
        notes: What a reader should know before trusting the numbers, one sentence each.
        residuals: Empty unless the platform rests from some instant on.
        band: Deviation that does no harm [m]. levels: Each against rigid and against the best.
        tol: Share of torques and deviations by which a level that suffices may differ.
        verdict: The answer in a few sentences. start: What to know of the start, "" for nothing.
        falls: Last instant with an equilibrium, where there is none to the end [s].
        drives: Both sides of each gear, by level.
        unsolved: Why a level is missing, by level.
    """

    name: str
    torques: tuple[TorqueRow, ...]
    platform: tuple[PlatformRow, ...]
    stresses: tuple[StressRow, ...]
    frequencies: tuple[float, ...]
    costs: tuple[CostRow, ...]
    frequency_note: str = ""
    notes: tuple[str, ...] = ()
    unsolved: dict[str, str] = field(default_factory=dict)
    residuals: tuple[ResidualRow, ...] = ()
    band: float = BAND
    levels: tuple[verdict.LevelRow, ...] = ()
    verdict: str = ""
    start: str = ""
    falls: float | None = None
    drives: tuple[DriveRow, ...] = ()
    tol: float = TOL

    def to_json(self) -> str:
        """The same numbers as JSON with stable keys; absent numbers are null."""
        return json.dumps(asdict(self), indent=2, allow_nan=False)

    def as_report(self) -> Report:
        """Everything: the answer, the levels, then all the rest."""
        return Report(_title(self), (
            *_head(self), _torque_table(self), drive_table(self.drives), _platform_table(self),
            _residual_table(self), _stress_table(self), _frequency_table(self), _cost_table(self),
            _remarks(self),
        ))  # fmt: skip

    def _screen(self) -> Report:
        return Report(_title(self), (*_head(self), _remarks(self, _NOTES)))

    def brief(self) -> str:
        """The answer on one screen: in words, one table of levels, notes."""
        return self._screen().text()

    def _repr_html_(self) -> str:
        return self._screen().html()


@public
def comparison(
    rigid: Result | None,
    others: Mapping[str, Result],
    frequencies: Iterable[float] = (),
    first: int = 6,
    *,
    frequency_note: str = "",
    yield_strengths: Mapping[str, float] | None = None,
    notes: Iterable[str] = (),
    unsolved: Mapping[str, str] | None = None,
    stop: float | None = None,
    band: float = BAND,
    cpu: Mapping[str, float] | None = None,
    start: str = "",
    falls: float | None = None,
    tol: float = TOL,
    name: str = "",
) -> Comparison:
    """Compare runs of one scene with its rigid run, instant by instant.

    Args:
        rigid: The reference run; None leaves differences out.
        others: Runs to compare, by the label they carry in the table ("ked", "coupled").
        frequencies: Natural frequencies [Hz] to list, ascending.
        first: How many of them to list.
        frequency_note: Of which state they are.
        yield_strengths: Strength of each link's material [Pa], where known.
        notes: Sentences to end with.
        unsolved: Why a level is missing, by level.
        stop: Instant from which on the motion rests, if it does [s].
        band: Deviation of the platform that does no harm [m].
        cpu: CPU time of each level [s], where known.
        start: What to know of the start.
        falls: Last instant with an equilibrium, where there is none to the end [s].
        tol: Share of torques and deviations by which a level that suffices may differ.
        name: Of the scene; default: that of the runs.
    """
    every = ({} if rigid is None else {"rigid": rigid}) | dict(others)
    strengths, times = yield_strengths or {}, cpu or {}
    listed = tuple(float(f) for f in frequencies)[:first]
    frame = None if rigid is None else str(rigid.meta.get("platform") or "") or None
    table = Comparison(
        name=name or next((str(run.meta.get("name", "scene")) for run in every.values()), "scene"),
        torques=_torque_rows(rigid, others),
        platform=_platform_rows(rigid, others, frame),
        stresses=tuple(
            stress_row(label, run, link, strengths.get(link))
            for label, run in others.items()
            for link in run.links
        ),
        frequencies=listed,
        costs=tuple(cost_row(label, run, times.get(label)) for label, run in every.items()),
        frequency_note=frequency_note,
        notes=tuple(notes),
        unsolved=dict(unsolved or {}),
        residuals=_residual_rows(rigid, others, frame, stop, band, listed),
        band=band,
        start=start,
        falls=falls,
        drives=_drive_rows(every),
        tol=tol,
    )
    table = replace(table, levels=verdict.level_rows(table, every, frame, times))
    return replace(table, verdict=verdict.words(table))


def _torque_rows(rigid: Result | None, others: Mapping[str, Result]) -> tuple[TorqueRow, ...]:
    """Motor by motor, in the order of the first run."""
    for label, run in others.items():
        if rigid is None:
            break
        same_grid(run, rigid)
        if run.motors != rigid.motors:
            raise DescriptionError(
                f"comparison: {label} has the motors {', '.join(run.motors) or 'none'}, the "
                f"rigid run {', '.join(rigid.motors) or 'none'}. Compare runs of one model."
            )
    rows = [
        torque_row(label, rigid, run, i)
        for label, run in others.items()
        for i in range(len(run.motors))
    ]
    motors = list(dict.fromkeys(motor for run in others.values() for motor in run.motors))
    return tuple(sorted(rows, key=lambda row: motors.index(row.motor)))


def _drive_rows(runs: Mapping[str, Result]) -> tuple[DriveRow, ...]:
    """Drive by drive, in the order of the first run."""
    names = dict.fromkeys(name for run in runs.values() for name in run.drives)
    return tuple(
        drive_row(label, run, name)
        for name in names
        for label, run in runs.items()
        if name in run.drives
    )


def _platform_rows(
    rigid: Result | None, others: Mapping[str, Result], frame: str | None
) -> tuple[PlatformRow, ...]:
    if rigid is None or frame is None:
        return ()
    return tuple(
        farthest(label, frame, run.deviation_from(rigid, frame)) for label, run in others.items()
    )


def _residual_rows(
    rigid: Result | None,
    others: Mapping[str, Result],
    frame: str | None,
    stop: float | None,
    band: float,
    frequencies: tuple[float, ...],
) -> tuple[ResidualRow, ...]:
    """Vibration after the stop, about where the quasistatic run ends: it does not vibrate."""
    if rigid is None or frame is None or stop is None or not stops(rigid, frame, stop):
        return ()
    period = next((1.0 / f for f in frequencies if f > 0), 0.0)
    still = others.get("quasistatic")
    rest = None if still is None else still.deviation_from(rigid, frame).position[-1]
    rows = []
    for label, run in others.items():
        if label != "quasistatic":
            away = run.deviation_from(rigid, frame)
            amplitude, settling = residual(away.t, away.position, stop, band, rest, period)
            watched = float(away.t[-1]) - stop
            rows.append(ResidualRow(label, frame, stop, watched, amplitude, band, settling))
    return tuple(rows)
