"""Rows of a comparison: each is one measurement of a run, or of a run against the rigid one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pinflex.results.result import Result, peak, rms
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
    """Largest distance [m] and angle [rad] of the platform from the rigid run, with times [s].

    `at_start` is the distance at the first instant: the sag of a start in equilibrium.
    """

    __repr__ = brief

    level: str
    frame: str
    position: float
    position_time: float
    rotation: float
    rotation_time: float
    at_start: float = 0.0


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


@dataclass(frozen=True)
class CostRow:
    """Cost of a level: wall and CPU time [s], steps, Newton iterations; None: not recorded."""

    __repr__ = brief

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


def platform_row(label: str, rigid: Result, run: Result) -> PlatformRow:
    """Largest deviations of the platform from the rigid run."""
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
        at_start=float(deviation.norm[0]),
    )


def stress_row(label: str, run: Result, link: str, strength: float | None) -> StressRow:
    """The largest stress of a link."""
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
