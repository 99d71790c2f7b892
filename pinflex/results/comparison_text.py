"""The report of a comparison: the answer in words, a table of levels, then all the rest."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from pinflex.report import Block, Report, Table, bullets, cell, lines, table
from pinflex.results import verdict
from pinflex.results.drives import drive_table
from pinflex.text import percent, short

if TYPE_CHECKING:
    from pinflex.results.comparison import Comparison, ResidualRow

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


def report(c: Comparison) -> Report:
    """Everything: the answer, the levels, then all the rest."""
    return Report(_title(c), (
        *_head(c), _torque_table(c), drive_table(c.drives), _platform_table(c), _residual_table(c),
        _stress_table(c), _frequency_table(c), _cost_table(c), _remarks(c),
    ))  # fmt: skip


def brief(c: Comparison) -> Report:
    """One screen: the answer in words, the table of levels, the first notes."""
    return Report(_title(c), (*_head(c), _remarks(c, _NOTES)))


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
        ("torque [%]", lambda x: _share(x["torque_percent"]), _brief(2)),
        (f"deviation [{unit}]", "deviation", _brief(3)), ("stress [MPa]", "stress", _brief(3)),
        ("CPU [s]", "cpu", _brief(2)), "verdict", names=(22,), prose=True,
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


def _brief(digits: int) -> Callable[[float | None], str]:
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
    notes = [f"{level} was not solved. {why}" for level, why in c.unsolved.items()] + [*c.notes]
    if most is not None and len(notes) > most:
        notes[most - 1 :] = [f"{len(notes) - most + 1} more notes are in comparison.txt."]
    return bullets(notes, "Notes")
