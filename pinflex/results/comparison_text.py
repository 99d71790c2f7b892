"""The comparison as text for people: the answer in short, then the tables, then the notes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pinflex.text import angle, length, number, paragraph, short, table

if TYPE_CHECKING:
    from pinflex.results.comparison import Comparison, PlatformRow

# What a person should know of a level before trusting its numbers.
_LEFT_OUT = {
    "rigid": "all elasticity",
    "quasistatic": "vibration: links bend as if the motion were slow",
    "ked": "large deflection: linear vibration about the rigid motion",
    "coupled": "large strain; deflection beyond a tenth of a segment",
}
_ROUND_OFF = 1e-12  # [m | rad] of a metre-size mechanism: shown as zero


def write(c: Comparison) -> str:
    """Aligned plain text of at most 100 columns."""
    blocks = [
        f"{c.name}: rigid against flexible",
        _in_short(c),
        _torque_table(c),
        _platform_table(c),
        _stress_table(c),
        _frequency_table(c),
        _cost_table(c),
        _remarks(c),
    ]
    return "\n\n".join(filter(None, blocks)) + "\n"


def _in_short(c: Comparison) -> str:
    """The answer in four lines, at the level that leaves out least."""
    levels = [row.level for row in c.costs if row.level != "rigid"]
    if not levels:
        return ""
    level, lines = levels[-1], []
    off = [(r.max_difference, r) for r in c.torques if r.level == level and r.max_difference]
    if off:
        most, row = max(off, key=lambda pair: pair[0])
        share = (
            "" if row.max_percent is None else f" ({_percent(row.max_percent)} of its rigid peak)"
        )
        motor = short(row.motor, 20)
        lines.append(f"motor torque  differs by up to {number(most)} {row.unit}{share}, in {motor}")
    for place in c.platform:
        if place.level == level:
            turned = place.rotation if place.rotation > _ROUND_OFF else 0.0
            away = length(place.position if place.position > _ROUND_OFF else 0.0)
            lines.append(f"{place.frame}  differs by up to {away} and {angle(turned)}")
    stresses = [r for r in c.stresses if r.level == level]
    if stresses:
        worst = max(stresses, key=lambda r: r.von_mises)
        share = "" if worst.yield_share is None else _of_yield(worst.yield_share)
        lines.append(
            f"stress  up to {number(worst.von_mises / 1e6)} MPa{share}, in {short(worst.link, 20)} "
            f"at x = {length(worst.x)}, t = {worst.time:.4g} s"
        )
    if c.frequencies:
        lines.append(f"first mode  {number(c.frequencies[0])} Hz")
    pairs = [line.split("  ", 1) for line in lines]
    width = max((len(name) for name, _ in pairs), default=0)
    return "\n".join(
        [f"In short, {level} against rigid:"] + [f"  {a:<{width}}  {b}" for a, b in pairs]
    )


def _torque_table(c: Comparison) -> str:
    units = list(dict.fromkeys(r.unit for r in c.torques))
    rows: list[list[str]] = []
    motor = None
    for r in c.torques:
        if r.motor != motor:
            motor = r.motor
            name = f"{short(motor, 15)} {r.unit}" if len(units) > 1 else motor
            if r.rigid_peak is not None and r.rigid_rms is not None:
                rows.append([name, "rigid", number(r.rigid_peak), number(r.rigid_rms)])
                rows[-1] += [""] * 4
                name = ""
        else:
            name = ""
        rows.append([name, r.level, number(r.peak), number(r.rms)])
        rows[-1] += ["-" if x is None else number(x) for x in (r.max_difference, r.rms_difference)]
        rows[-1] += ["-" if x is None else _percent(x) for x in (r.max_percent, r.rms_percent)]
    return table(
        f"Motor torque [{' | '.join(units)}]; diff is from rigid, in % of the rigid peak",
        "motor|level|peak|rms|max diff|rms diff|max|rms",
        rows,
        (20, 16),
    )


def _platform_table(c: Comparison) -> str:
    if not c.platform:
        return ""
    far = max(r.position for r in c.platform)
    turned = max(r.rotation for r in c.platform)
    mm, metres = ("mm", 1e3) if far >= 1e-5 else ("um", 1e6)
    mrad, radians = ("mrad", 1e3) if turned >= 1e-5 else ("urad", 1e6)
    rows = []
    for r in c.platform:
        values = [x if x > _ROUND_OFF else 0.0 for x in (r.position, r.rotation)]
        times = [f"{t:.4f}" if x else "-" for x, t in zip(values, _times(r), strict=True)]
        rows.append([r.frame, r.level, number(metres * values[0]), times[0]])
        rows[-1] += [number(radians * values[1]), times[1]]
    return table(
        "Platform, largest deviation from rigid",
        f"frame|level|position [{mm}]|at [s]|rotation [{mrad}]|at [s]",
        rows,
    )


def _stress_table(c: Comparison) -> str:
    order = list(dict.fromkeys(r.link for r in c.stresses))
    known = any(r.yield_share is not None for r in c.stresses)
    rows = [
        [r.link, r.level, number(r.von_mises / 1e6)]
        + ([_share(r.yield_share)] if known else [])
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
        [str(i), number(f), number(1 / f) if f > 0 else "-"] for i, f in enumerate(c.frequencies, 1)
    ]
    title = "Natural frequencies" + (f" ({c.frequency_note})" if c.frequency_note else "")
    return table(title, "mode|frequency [Hz]|period [s]", rows, (4,))


def _cost_table(c: Comparison) -> str:
    rows = [
        [r.level, "-" if r.seconds is None else number(r.seconds)]
        + ["-" if n is None else str(n) for n in (r.steps, r.newton)]
        + [_LEFT_OUT.get(r.level, "")]
        for r in c.costs
    ]
    rows += [[level, "-", "-", "-", "NOT SOLVED, see below"] for level in c.unsolved]
    header = "level|time [s]|steps|Newton|what it leaves out"
    return table("Cost of each level", header, rows, (22,), last_is_text=True)


def _remarks(c: Comparison) -> str:
    said = [f"{level} was not solved. {why}" for level, why in c.unsolved.items()]
    lines = [paragraph(text, "  ", "- ") for text in (*said, *c.notes)]
    return "\n".join(["Notes", *lines]) if lines else ""


def _times(row: PlatformRow) -> tuple[float, float]:
    return row.position_time, row.rotation_time


def _once(rows: list[list[str]]) -> list[list[str]]:
    """Rows in which a name that repeats the one above is left blank."""
    return [
        ["" if k and row[0] == rows[k - 1][0] else row[0], *row[1:]] for k, row in enumerate(rows)
    ]


def _percent(x: float) -> str:
    return f"{x:.2f} %" if x < 100 else f"{x:.0f} %" if x < 1e4 else f"{x:.1e} %"


def _share(x: float | None) -> str:
    return "-" if x is None else f"{100 * x:.1f} %" if x < 10 else f"{100 * x:.0f} %"


def _of_yield(share: float) -> str:
    return f" ({_share(share)} of the yield strength)"
