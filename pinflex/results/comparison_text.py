"""The comparison as text for people: the answer in words, a table of levels, then all the rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pinflex.results import verdict
from pinflex.results.drives import drive_table
from pinflex.text import bullets, number, paragraph, percent, report, short, table

if TYPE_CHECKING:
    from pinflex.results.comparison import Comparison, ResidualRow

# What a person should know of a level before trusting its numbers.
_LEFT_OUT = {
    "rigid": "all elasticity",
    "quasistatic": "vibration: links bend as if the motion were slow",
    "ked": "large deflection: linear vibration about the rigid motion",
    "coupled": "large strain; deflection beyond a tenth of a segment",
}
_NOTES = 5  # notes on one screen
_ROUND_OFF = 1e-12  # [m | rad] of a metre-size mechanism: shown as zero


def write(c: Comparison) -> str:
    """Everything, as aligned plain text of at most 100 columns."""
    return report(
        *_head(c),
        _torque_table(c),
        drive_table(c.drives),
        _platform_table(c),
        _residual_table(c),
        _stress_table(c),
        _frequency_table(c),
        _cost_table(c),
        _remarks(c),
    )


def brief(c: Comparison) -> str:
    """One screen: the answer in words, the table of levels, the first notes."""
    return report(*_head(c), _remarks(c, _NOTES))


def _head(c: Comparison) -> list[str]:
    answer = paragraph(f"{c.name}: {c.verdict or 'rigid against flexible'}")
    start = "\n" + paragraph(c.start, "  ", "! ") if c.start else ""
    return [answer + start, _level_table(c)]


def _level_table(c: Comparison) -> str:
    far = [x.deviation for x in c.levels if x.deviation is not None]
    millimetres = max(far, default=0.0) >= 1e-4
    best = c.levels[-1].level if len(c.levels) > 1 else ""
    rows = []
    for x in c.levels:
        away = None if x.deviation is None else (1e3 if millimetres else 1e6) * x.deviation
        text = "the reference" if x.level == best else verdict.miss(x, c)
        cells = [(x.torque_percent, 2), (away, 3), (x.stress and 1e-6 * x.stress, 3), (x.cpu, 2)]
        rows.append([x.level, *(_brief(value, digits) for value, digits in cells), text])
    rows += [[level, "-", "-", "-", "-", "NOT SOLVED, see below"] for level in c.unsolved]
    order = [*_LEFT_OUT]
    rows.sort(key=lambda row: order.index(row[0]) if row[0] in order else len(order))
    unit = "mm" if millimetres else "um"
    judged = [paragraph(f"Suffices: {verdict.criterion(c.tol, c.band, best)}.")] if best else []
    peaks = f", torque in % of the {best} peak" if best else ""
    levels = table(
        f"Levels, simplest first; differences from rigid{peaks}",
        f"level|torque [%]|deviation [{unit}]|stress [MPa]|CPU [s]|verdict",
        rows,
        (22,),
        last_is_text=True,
    )
    return "\n".join([*judged, levels])


def _brief(x: float | None, digits: int) -> str:
    if x is None or x < 1e-12:
        return "-" if x is None else "0"
    return f"{x:.0f}" if 100 <= x < 1e4 else f"{x:.{digits}g}"


def _torque_table(c: Comparison) -> str:
    units = list(dict.fromkeys(r.unit for r in c.torques))
    rows: list[list[str]] = []
    rigid_listed = set[str]()
    for r in c.torques:
        name = f"{short(r.motor, 15)} {r.unit}" if len(units) > 1 else r.motor
        if r.motor not in rigid_listed and r.rigid_peak is not None:
            rows.append([name, "rigid", number(r.rigid_peak), number(r.rigid_rms), *[""] * 4])
        rigid_listed.add(r.motor)
        rows.append([name, r.level, number(r.peak), number(r.rms)])
        rows[-1] += [number(r.max_difference), number(r.rms_difference)]
        rows[-1] += [percent(x and x / 100, 3) for x in (r.max_percent, r.rms_percent)]
    return table(
        f"Motor torque [{' | '.join(units)}]; diff is from rigid, in % of the rigid peak",
        "motor|level|peak|rms|max diff|rms diff|max|rms",
        _once(rows),
        (20, 16),
    )


def _platform_table(c: Comparison) -> str:
    far = max((r.position for r in c.platform), default=0.0)
    turned = max((r.rotation for r in c.platform), default=0.0)
    mm, metres = ("mm", 1e3) if far >= 1e-5 else ("um", 1e6)
    mrad, radians = ("mrad", 1e3) if turned >= 1e-5 else ("urad", 1e6)
    rows = []
    for r in c.platform:
        rows.append([r.frame, r.level, *_largest(metres, r.position, r.position_time)])
        rows[-1] += _largest(radians, r.rotation, r.rotation_time)
    return table(
        "Platform, largest deviation from rigid",
        f"frame|level|position [{mm}]|at [s]|rotation [{mrad}]|at [s]",
        rows,
    )


def _residual_table(c: Comparison) -> str:
    rows = [
        [r.frame, r.level, f"{r.stop:.4g}", number(1e3 * r.amplitude), _settled(r)]
        for r in c.residuals
    ]
    return table(
        "Vibration after the stop, about the place of rest",
        f"frame|level|stop [s]|amplitude [mm]|within {verdict.rounded_length(c.band)} after [s]",
        _once(rows),
    )


def _settled(row: ResidualRow) -> str:
    return f"not in {row.watched:.3g}" if row.settling is None else f"{row.settling:.4f}"


def _stress_table(c: Comparison) -> str:
    order = list(dict.fromkeys(r.link for r in c.stresses))
    known = any(r.yield_share is not None for r in c.stresses)
    rows = [
        [r.link, r.level, number(r.von_mises / 1e6)]
        + ([percent(r.yield_share, 3)] if known else [])
        + [number(1e3 * r.x), f"{r.fraction:.2f}", f"{r.time:.4f}"]
        for r in sorted(c.stresses, key=lambda r: order.index(r.link))
    ]
    return table(
        "Flexible links, largest von Mises stress and where (x from the link's root)",
        f"link|level|stress [MPa]|{'of yield|' if known else ''}x [mm]|x / length|at [s]",
        _once(rows),
    )


def _frequency_table(c: Comparison) -> str:
    rows = [
        [str(i), number(f), number(1 / f if f > 0 else None)]
        for i, f in enumerate(c.frequencies, 1)
    ]
    title = "Natural frequencies" + (f" ({c.frequency_note})" if c.frequency_note else "")
    return table(title, "mode|frequency [Hz]|period [s]", rows, (4,))


def _cost_table(c: Comparison) -> str:
    rows = [
        [r.level, number(r.cpu), number(r.seconds)]
        + ["-" if n is None else str(n) for n in (r.steps, r.newton)]
        + [_LEFT_OUT.get(r.level, "")]
        for r in c.costs
    ]
    rows += [[level, "-", "-", "-", "-", "NOT SOLVED, see below"] for level in c.unsolved]
    header = "level|CPU [s]|wall [s]|steps|Newton|what it leaves out"
    return table("Cost of each level", header, rows, (22,), last_is_text=True)


def _remarks(c: Comparison, most: int | None = None) -> str:
    notes = [f"{level} was not solved. {why}" for level, why in c.unsolved.items()] + [*c.notes]
    if most is not None and len(notes) > most:
        notes[most - 1 :] = [f"{len(notes) - most + 1} more notes are in comparison.txt."]
    return f"Notes\n{bullets(notes)}" if notes else ""


def _largest(factor: float, value: float, time: float) -> list[str]:
    return [number(factor * value), f"{time:.4f}"] if value > _ROUND_OFF else ["0", "-"]


def _once(rows: list[list[str]]) -> list[list[str]]:
    """Rows in which a name that repeats the one above is left blank."""
    return [
        ["" if k and row[0] == rows[k - 1][0] else row[0], *row[1:]] for k, row in enumerate(rows)
    ]
