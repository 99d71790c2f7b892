"""Rigid against flexible in one table: torques, platform, stress, frequencies, cost."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pinflex.errors import DescriptionError
from pinflex.result import Result, peak, rms, same_grid

_COLUMNS = 100  # width that every block of the text fits


@dataclass(frozen=True)
class TorqueRow:
    """One motor at one level against the rigid run [N m | N]; percents are of the rigid peak."""

    motor: str
    unit: str
    level: str
    rigid_peak: float
    rigid_rms: float
    peak: float
    rms: float
    max_difference: float
    rms_difference: float
    max_percent: float | None  # None where the rigid torque is zero
    rms_percent: float | None


@dataclass(frozen=True)
class PlatformRow:
    """Largest distance [m] and angle [rad] of the platform from the rigid run, with times [s]."""

    level: str
    frame: str
    position: float
    position_time: float
    rotation: float
    rotation_time: float


@dataclass(frozen=True)
class StressRow:
    """Largest von Mises stress [Pa] of a link, where along it (x [m], x / length) and when [s]."""

    level: str
    link: str
    von_mises: float
    x: float
    fraction: float
    time: float


@dataclass(frozen=True)
class CostRow:
    """What a level cost: wall time [s], steps, Newton iterations; None where not recorded."""

    level: str
    seconds: float | None
    steps: int | None
    newton: int | None


@dataclass(frozen=True)
class Comparison:
    """The table of one scene; `text` for people, `to_json` for machines (SI units)."""

    name: str
    torques: tuple[TorqueRow, ...]
    platform: tuple[PlatformRow, ...]
    stresses: tuple[StressRow, ...]
    frequencies: tuple[float, ...]  # [Hz]
    costs: tuple[CostRow, ...]

    def to_json(self) -> str:
        """The same numbers as JSON with stable keys; absent numbers are null."""
        return json.dumps(asdict(self), indent=2, allow_nan=False)

    def text(self) -> str:
        """Aligned plain text of at most 100 columns."""
        units = " | ".join(dict.fromkeys(r.unit for r in self.torques)) or "N m"
        blocks = [
            _table(
                f"Motor torque [{units}], difference from rigid in % of the rigid peak",
                "motor|level|rigid peak|rigid rms|peak|rms|max diff|rms diff|max %|rms %",
                [_torque_cells(r, " | " in units) for r in self.torques],
                names=(14, 12),  # with eight numbers of full width: 100 columns
            ),
            _table(
                "Platform, largest deviation from rigid",
                "frame|level|position [mm]|at [s]|rotation [mrad]|at [s]",
                [
                    [r.frame, r.level]
                    + [_number(1e3 * r.position), f"{r.position_time:.4f}"]
                    + [_number(1e3 * r.rotation), f"{r.rotation_time:.4f}"]
                    for r in self.platform
                ],
            ),
            _table(
                "Flexible links, largest von Mises stress",
                "link|level|stress [MPa]|x [m]|x / length|at [s]",
                [
                    [r.link, r.level, _number(r.von_mises / 1e6)]
                    + [f"{r.x:.4f}", f"{r.fraction:.3f}", f"{r.time:.4f}"]
                    for r in self.stresses
                ],
            ),
            _table(
                "Natural frequencies",
                "mode||frequency [Hz]",
                [[str(i), "", _number(f)] for i, f in enumerate(self.frequencies, 1)],
            ),
            _table(
                "Cost",
                "level||wall [s]|steps|Newton",
                [
                    [r.level, "", "-" if r.seconds is None else _number(r.seconds)]
                    + ["-" if n is None else str(n) for n in (r.steps, r.newton)]
                    for r in self.costs
                ],
            ),
        ]
        return "\n\n".join([f"{self.name}: rigid against flexible", *filter(None, blocks)]) + "\n"

    __str__ = text


def comparison(
    rigid: Result,
    others: Mapping[str, Result],
    frequencies: Iterable[float] = (),
    first: int = 6,
) -> Comparison:
    """Compare runs of one scene with its rigid run, instant by instant.

    Args:
        rigid: The reference run.
        others: Runs to compare, by the label they carry in the table ("ked", "coupled").
        frequencies: Natural frequencies [Hz] to list, ascending.
        first: How many of them to list.
    """
    torques: list[TorqueRow] = []
    for label, run in others.items():
        same_grid(run, rigid)
        if run.motors != rigid.motors:
            raise DescriptionError(
                f"comparison: {label} has the motors {', '.join(run.motors) or 'none'}, the rigid "
                f"run {', '.join(rigid.motors) or 'none'}. Compare runs of one model."
            )
        torques += [_torque_row(label, rigid, run, i) for i in range(len(rigid.motors))]
    torques.sort(key=lambda row: rigid.motors.index(row.motor))
    return Comparison(
        name=str(rigid.meta.get("name", "scene")),
        torques=tuple(torques),
        platform=tuple(_platform_row(label, rigid, run) for label, run in others.items())
        if rigid.meta.get("platform")
        else (),
        stresses=tuple(
            _stress_row(label, run, link) for label, run in others.items() for link in run.links
        ),
        frequencies=tuple(float(f) for f in frequencies)[:first],
        costs=tuple(_cost_row(label, run) for label, run in {"rigid": rigid, **others}.items()),
    )


def _torque_row(label: str, rigid: Result, run: Result, i: int) -> TorqueRow:
    motor, reference, torque = rigid.motors[i], rigid.torque[:, i], run.torque[:, i]
    difference, scale = torque - reference, peak(reference)
    # below round-off of the largest torque a percentage means nothing
    scaled = scale > 1e-12 * max(peak(rigid.torque), peak(run.torque))
    return TorqueRow(
        motor=motor,
        unit=rigid.unit(f"torque/{motor}"),
        level=label,
        rigid_peak=scale,
        rigid_rms=rms(reference),
        peak=peak(torque),
        rms=rms(torque),
        max_difference=peak(difference),
        rms_difference=rms(difference),
        max_percent=100 * peak(difference) / scale if scaled else None,
        rms_percent=100 * rms(difference) / scale if scaled else None,
    )


def _platform_row(label: str, rigid: Result, run: Result) -> PlatformRow:
    frame = str(rigid.meta["platform"])
    deviation = run.deviation_from(rigid, frame)
    far, turned = int(np.argmax(deviation.norm)), int(np.argmax(deviation.angle))
    return PlatformRow(
        level=label,
        frame=frame,
        position=float(deviation.norm[far]),
        position_time=float(run.t[far]),
        rotation=float(deviation.angle[turned]),
        rotation_time=float(run.t[turned]),
    )


def _stress_row(label: str, run: Result, link: str) -> StressRow:
    view = run.link(link)
    when, where = np.unravel_index(int(np.argmax(view.von_mises)), view.von_mises.shape)
    return StressRow(
        level=label,
        link=link,
        von_mises=float(view.von_mises[when, where]),
        x=float(view.x[where]),
        fraction=float(view.x[where] / view.length),
        time=float(run.t[when]),
    )


def _cost_row(label: str, run: Result) -> CostRow:
    cost: dict[str, Any] = run.meta.get("cost", {})
    seconds, steps, newton = (cost.get(key) for key in ("seconds", "steps", "newton"))
    return CostRow(
        level=label,
        seconds=None if seconds is None else float(seconds),
        steps=None if steps is None else int(steps),
        newton=None if newton is None else int(newton),
    )


def _torque_cells(row: TorqueRow, mixed_units: bool) -> list[str]:
    motor = f"{_short(row.motor, 10)} {row.unit}" if mixed_units else row.motor
    numbers = (row.rigid_peak, row.rigid_rms, row.peak, row.rms)
    differences = (row.max_difference, row.rms_difference)
    percents = (row.max_percent, row.rms_percent)
    return [
        motor,
        row.level,
        *(_number(x) for x in (*numbers, *differences)),
        *("-" if x is None else f"{x:.2f}" if x < 1e4 else f"{x:.1e}" for x in percents),
    ]


def _number(x: float) -> str:
    """Four significant digits in at most eight characters (nine if negative)."""
    return "0" if x == 0 else f"{x:#.4g}".rstrip(".") if 1e-3 <= abs(x) < 1e4 else f"{x:.2e}"


def _short(name: str, width: int) -> str:
    """A long name keeps both ends, which carry the side and the number."""
    if len(name) <= width:
        return name
    tail = (width - 2) // 2
    return f"{name[: width - 2 - tail]}..{name[-tail:]}"


def _table(
    title: str, header: str, rows: Sequence[Sequence[str]], names: tuple[int, int] = (18, 18)
) -> str:
    """Two left-aligned columns, shortened to `names`, then numbers; empty without rows."""
    if not rows:
        return ""
    named = [[_short(c, w) for c, w in zip(r, names, strict=False)] + [*r[2:]] for r in rows]
    cells = [header.split("|"), *named]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    gap = "  " if sum(widths) + 2 * len(widths) <= _COLUMNS else " "
    lines = [
        gap.join(
            cell.ljust(width) if i < 2 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    ]
    rule = "-" * max(map(len, [title, *lines]))
    return "\n".join([title, rule, lines[0], rule, *lines[1:], rule])
