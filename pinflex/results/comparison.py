"""Rigid against flexible in one table: torques, platform, stress, frequencies, cost."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from pinflex.errors import DescriptionError
from pinflex.results import comparison_text
from pinflex.results.result import Result, peak, rms, same_grid
from pinflex.text import brief


@dataclass(frozen=True)
class TorqueRow:
    """One motor at one level against the rigid run [N m | N]; percents are of the rigid peak.

    Without a rigid run, or where its torque is zero, what cannot be said is None.
    """

    __repr__ = brief

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


@dataclass(frozen=True)
class PlatformRow:
    """Largest distance [m] and angle [rad] of the platform from the rigid run, with times [s]."""

    __repr__ = brief

    level: str
    frame: str
    position: float
    position_time: float
    rotation: float
    rotation_time: float


@dataclass(frozen=True)
class StressRow:
    """Largest von Mises stress [Pa] of a link, where along it (x [m], x / length) and when [s].

    `yield_share` is that stress over the material's strength, None where that is not known.
    """

    __repr__ = brief

    level: str
    link: str
    von_mises: float
    x: float
    fraction: float
    time: float
    yield_share: float | None = None


@dataclass(frozen=True)
class CostRow:
    """What a level cost: wall time [s], steps, Newton iterations; None where not recorded."""

    __repr__ = brief

    level: str
    seconds: float | None
    steps: int | None
    newton: int | None


@dataclass(frozen=True)
class Comparison:
    """The table of one scene; `text` for people, `to_json` for machines (SI units).

    Attributes:
        frequencies: [Hz]. frequency_note: About which state, with which motors.
        notes: What a reader should know before trusting the numbers, one sentence each.
        unsolved: Why a level is missing, by level.
    """

    __repr__ = brief

    name: str
    torques: tuple[TorqueRow, ...]
    platform: tuple[PlatformRow, ...]
    stresses: tuple[StressRow, ...]
    frequencies: tuple[float, ...]
    costs: tuple[CostRow, ...]
    frequency_note: str = ""
    notes: tuple[str, ...] = ()
    unsolved: dict[str, str] = field(default_factory=dict)

    def to_json(self) -> str:
        """The same numbers as JSON with stable keys; absent numbers are null."""
        return json.dumps(asdict(self), indent=2, allow_nan=False)

    def text(self) -> str:
        """Aligned plain text of at most 100 columns."""
        return comparison_text.write(self)

    __str__ = text


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
    """
    torques: list[TorqueRow] = []
    for label, run in others.items():
        if rigid is not None:
            same_grid(run, rigid)
            if run.motors != rigid.motors:
                raise DescriptionError(
                    f"comparison: {label} has the motors {', '.join(run.motors) or 'none'}, the "
                    f"rigid run {', '.join(rigid.motors) or 'none'}. Compare runs of one model."
                )
        torques += [_torque_row(label, rigid, run, i) for i in range(len(run.motors))]
    every = {} if rigid is None else {"rigid": rigid}
    every |= others
    order = [motor for run in every.values() for motor in run.motors]
    torques.sort(key=lambda row: order.index(row.motor))
    strengths = yield_strengths or {}
    return Comparison(
        name=next((str(run.meta.get("name", "scene")) for run in every.values()), "scene"),
        torques=tuple(torques),
        platform=tuple(_platform_row(label, rigid, run) for label, run in others.items())
        if rigid is not None and rigid.meta.get("platform")
        else (),
        stresses=tuple(
            _stress_row(label, run, link, strengths.get(link))
            for label, run in others.items()
            for link in run.links
        ),
        frequencies=tuple(float(f) for f in frequencies)[:first],
        costs=tuple(_cost_row(label, run) for label, run in every.items()),
        frequency_note=frequency_note,
        notes=tuple(notes),
        unsolved=dict(unsolved or {}),
    )


def _torque_row(label: str, rigid: Result | None, run: Result, i: int) -> TorqueRow:
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


def _stress_row(label: str, run: Result, link: str, strength: float | None) -> StressRow:
    view = run.link(link)
    when, where = np.unravel_index(int(np.argmax(view.von_mises)), view.von_mises.shape)
    return StressRow(
        level=label,
        link=link,
        von_mises=float(view.von_mises[when, where]),
        x=float(view.x[where]),
        fraction=float(view.x[where] / view.length),
        time=float(run.t[when]),
        yield_share=None if strength is None else float(view.von_mises[when, where]) / strength,
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
