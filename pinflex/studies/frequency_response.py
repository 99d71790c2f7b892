"""Frequency response from one input to some outputs, its zeros, and a measured one beside it.

Source: Bendat, Piersol (2010), Random Data, ch. 6 (H1 and coherence); Heylen, Lammens (1996),
frequency response assurance criterion; Preumont (2018), Vibration Control of Active Structures,
ch. 6 (collocated pairs, zeros).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.actuation.path import plain_motion
from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.motions.laws import table
from pinflex.description.motions.trajectory import (
    KINDS,
    TOLERATED,
    Shaper,
    most_modes,
    shaper,
)
from pinflex.errors import DescriptionError, nearest
from pinflex.inversion.linear_model import LinearModel, linearise
from pinflex.inversion.on_grid import zeros as internal_zeros
from pinflex.levels.modes import modes
from pinflex.levels.ringing import Ringing, ringing
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.text import frozen
from pinflex.viewer.plots.drawing import COLOURS, Drawing, Room, panels, title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_POINTS = 2000
_MODES = 6  # up to which the default range goes
_SAME = 1e-7  # relative: a zero and a pole that cancel
_BEYOND = 10.0  # times the fastest pole: a zero beyond is at infinity
_SEGMENTS = 8  # of a record, half overlapped
_RIGHT = 1e-6  # share of its size by which a zero lies right of the axis
_LOW = 1e-3  # of the slowest vibration: zeros so slow are those of rigid motion


@frozen
class Measured:
    """A measured frequency response.

    Attributes:
        output: Name. frequencies: [Hz], shape (n,). response: Complex, shape (n,).
        coherence: 0 to 1, shape (n,), or None where it is not known.
        agreement: Correlation of the model's response with it, 0 to 1.
    """

    output: str
    frequencies: Array
    response: Array
    coherence: Array | None
    agreement: float = 0.0


@frozen
class FrequencyResponse:
    """Responses of a linear model to one input.

    Attributes:
        name: Model. input, outputs: With units.
        frequencies: [Hz], shape (nf,). response: Complex, shape (nf, outputs).
        zeros: Finite transmission zeros of each pair [1/s].
        collocated: Whether each output is that of the input's own place and direction.
        natural: Undamped frequencies of the model [Hz].
        platform_zeros: From all motor torques to as many platform coordinates [1/s], or None.
        measured: Measured responses, if any.
    """

    name: str
    input: str
    outputs: tuple[str, ...]
    frequencies: Array
    response: Array
    zeros: tuple[Array, ...]
    collocated: tuple[bool, ...]
    natural: Array
    platform_zeros: Array | None
    measured: tuple[Measured, ...] = ()

    def plot(self, panel: str | None = None, ax: Axes | None = None) -> Any:
        """Draw magnitude and phase of every output; returns the matplotlib axes.

        Args:
            panel: One alone: "magnitude OUTPUT" or "phase OUTPUT", or of a single output
                "magnitude" or "phase".
            ax: Where to draw that; default: axes of a new figure.
        """
        return drawing(self).axes(panel, ax)


@public
@takes_model
def frequency_response(
    mechanism: Mechanism,
    q: Array | None = None,
    *,
    source: str | None = None,
    outputs: Sequence[str] = (),
    motors: str = "torque",
    span: tuple[float | None, float | None] = (None, None),
    measured: str | Path | None = None,
) -> FrequencyResponse:
    """Response of a mechanism about its static equilibrium to one input.

    Args:
        mechanism: Mechanism.
        q: Rigid pose, default home.
        source: The input: a motor, or a force or moment FRAME.x ... FRAME.rz; default: the first
            motor.
        outputs: As in `linearise`; default: the input's own motion, and the platform coordinate
            that it moves most.
        motors: "torque": the motors are free, "acceleration": prescribed.
        span: First and last frequency [Hz]; default: a tenth of the first to beyond the sixth.
        measured: CSV file with a measured response or record; see `read_measured`.
    """
    source = source or (mechanism.motors[0] if mechanism.motors else "")
    own = source in mechanism.motors
    if not source:
        raise DescriptionError(
            f"{mechanism.name}: input: there is no motor to take.{_another(mechanism, q)}"
        )
    if not own and "." not in source:
        hint = nearest(source, mechanism.motors)
        raise DescriptionError(f"input: {source}: no motor and no FRAME.AXIS.{hint}")
    given = {"motors": motors, "forces": () if own else (source,)}
    wanted = tuple(outputs) or _usual(mechanism, source, q, given)
    model = linearise(mechanism, q, outputs=wanted, **given)  # type: ignore[arg-type]
    column = mechanism.motors.index(source) if own else len(model.inputs) - 1
    pairs = [_pair(model, column, k) for k in range(len(wanted))]
    alive = model.frequencies[model.frequencies > 0.0]
    f = _range(mechanism, q, alive, span)
    response = model.response(f)[:, :, column]
    if not np.any(response):
        raise DescriptionError(
            f"{mechanism.name}: input: {source} moves nothing of {', '.join(wanted)}."
            f"{'' if own else _another(mechanism, q)}"
        )
    made = FrequencyResponse(
        name=mechanism.name,
        input=model.inputs[column],
        outputs=model.outputs,
        frequencies=f,
        response=response,
        zeros=tuple(_finite(one) for one in pairs),
        collocated=tuple(_bare(name) == source for name in wanted),
        natural=alive,
        platform_zeros=_platform_zeros(mechanism),
    )
    if measured is None:
        return made
    found = read_measured(measured, source, wanted)
    return replace(made, measured=tuple(_judged(one, model, column, wanted) for one in found))


def slowest_right(zeros: Array, slowest: float) -> float | None:
    """Size [Hz] of the slowest zero in the right half plane; None: minimum phase."""
    size = np.abs(zeros)
    counted = size > _LOW * 2.0 * np.pi * slowest
    right = size[counted & (zeros.real > _RIGHT * size)]
    return float(right.min()) / (2.0 * np.pi) if len(right) else None


def read_measured(path: str | Path, source: str, outputs: Sequence[str]) -> tuple[Measured, ...]:
    """Measured responses of a CSV file with names in its first line.

    Either `frequency` [Hz] with OUTPUT.magnitude and OUTPUT.phase [deg], or OUTPUT.real and
    OUTPUT.imag, and OUTPUT.coherence if known; or a record: `t` [s], the input and outputs by name,
    from which H1 and the coherence are estimated (Hann windows, eight segments).
    """
    try:
        written = table(path, "measured")
        columns = {name: np.array(x, dtype=np.float64) for name, x in written.items()}
    except ValueError as error:
        raise DescriptionError(f"{path}: a cell is no number ({error}).") from None
    if "frequency" in columns:
        found = [_tabulated(columns, name) for name in outputs]
    elif "t" in columns and source in columns:
        found = [_estimated(columns, source, name) for name in outputs if name in columns]
    else:
        raise DescriptionError(
            f"{path}: columns {', '.join(columns)}. Give frequency and OUTPUT.magnitude, "
            f"OUTPUT.phase; or t, {source} and outputs."
        )
    known = tuple(one for one in found if one is not None)
    if not known:
        raise DescriptionError(
            f"{path}: none of the outputs {', '.join(outputs)} among the columns "
            f"{', '.join(columns)}. Ask for one of these (--output)."
        )
    return known


def _tabulated(columns: dict[str, Array], name: str) -> Measured | None:
    f, coherence = columns["frequency"], columns.get(f"{name}.coherence")
    if f"{name}.magnitude" in columns and f"{name}.phase" in columns:
        phase = np.deg2rad(columns[f"{name}.phase"])
        return Measured(name, f, columns[f"{name}.magnitude"] * np.exp(1j * phase), coherence)
    if f"{name}.real" in columns and f"{name}.imag" in columns:
        response = columns[f"{name}.real"] + 1j * columns[f"{name}.imag"]
        return Measured(name, f, response, coherence)
    return None


def _estimated(columns: dict[str, Array], source: str, name: str) -> Measured:
    from scipy.signal import coherence, csd, welch

    t, x, y = columns["t"], columns[source], columns[name]
    step = np.diff(t)
    if len(t) < 2 * _SEGMENTS or np.ptp(step) > 1e-3 * np.mean(step):
        raise DescriptionError("measured: t: give 16 equal steps or more.")
    keys: dict[str, Any] = {"fs": 1.0 / float(np.mean(step))}
    keys["nperseg"] = 2 * len(t) // (_SEGMENTS + 1)
    f, cross = csd(x, y, **keys)
    response = cross / welch(x, **keys)[1]
    return Measured(name, f[1:], response[1:], coherence(x, y, **keys)[1][1:])


def _judged(one: Measured, model: LinearModel, column: int, wanted: Sequence[str]) -> Measured:
    """With the frequency response assurance criterion of model and measurement."""
    ours = model.response(one.frequencies)[:, wanted.index(one.output), column]
    good = np.isfinite(ours) & np.isfinite(one.response)
    a, b = ours[good], one.response[good]
    both = np.vdot(a, a).real * np.vdot(b, b).real
    return replace(one, agreement=float(abs(np.vdot(a, b)) ** 2 / both) if both > 0.0 else 0.0)


def _usual(
    mechanism: Mechanism, source: str, q: Array | None, given: dict[str, Any]
) -> tuple[str, ...]:
    """The input's own motion and the platform coordinate that it moves most at high rates."""
    frame = mechanism.description.platform
    if frame is None or source.startswith(f"{frame}."):
        return (source,)
    axes = tuple(f"{frame}.{axis}" for axis in "xyz")
    model = linearise(mechanism, q, outputs=[f"{a}.acceleration" for a in axes], **given)
    column = mechanism.motors.index(source) if source in mechanism.motors else -1
    return source, axes[int(np.argmax(_sizes(model)[:, column]))]


def _sizes(model: LinearModel) -> Array:
    """How much each input moves each output at half the first frequency, (outputs, inputs)."""
    alive = model.frequencies[model.frequencies > 0.0]
    low = 0.5 * float(alive[0]) if len(alive) else 1.0
    return np.asarray(np.abs(model.response(np.array([low]))[0]))


def _another(mechanism: Mechanism, q: Array | None) -> str:
    """A force that moves the platform, as advice; "" where there is none to name."""
    frames = (mechanism.description.platform, *mechanism.description.frames)
    frame = next(filter(None, frames), None)
    if frame is None:
        return " Give a force at a frame, FRAME.AXIS."
    axes = [f"{frame}.{axis}" for axis in "xyz"]
    model = linearise(mechanism, q, forces=axes, outputs=axes)
    own = np.diagonal(_sizes(model)[:, -len(axes) :])
    return f" Give a force that moves the platform: {axes[int(np.argmax(own))]}."


def _bare(name: str) -> str:
    return name.removesuffix(".velocity").removesuffix(".acceleration")


def _pair(model: LinearModel, column: int, row: int) -> LinearModel:
    """One input and one output of a model."""
    return replace(
        model, B=model.B[:, [column]], C=model.C[[row]], D=model.D[[row]][:, [column]],
        inputs=(model.inputs[column],), outputs=(model.outputs[row],),
    )  # fmt: skip


def _finite(pair: LinearModel) -> Array:
    """Zeros but those of modes that the input does not move or the output does not see."""
    poles = pair.poles
    fastest = float(np.max(np.abs(poles), initial=0.0))
    zeros = pair.zeros()
    zeros = zeros[np.abs(zeros) < _BEYOND * fastest]
    for pole in poles:
        cancels = np.flatnonzero(np.abs(zeros - pole) < _SAME * abs(pole))
        zeros = np.delete(zeros, cancels[:1])
    return np.asarray(zeros)


def _platform_zeros(mechanism: Mechanism) -> Array | None:
    if mechanism.description.platform is None or not mechanism.compliant:
        return None
    if not len(mechanism.flexible.motors):
        return None
    return internal_zeros(mechanism)


def _range(
    mechanism: Mechanism, q: Array | None, alive: Array, span: tuple[float | None, float | None]
) -> Array:
    """Grid of frequencies [Hz], refined near the natural ones `alive`, to beyond six modes."""
    low, high = span
    if low is None or high is None:
        bends = mechanism.compliant
        held = modes(mechanism, q, count=_MODES).frequencies if bends else np.zeros(0)
        held = held[held > 0.0] if np.any(held > 0.0) else np.append(alive, 1.0)
        low, high = low or 0.1 * float(held[0]), high or 1.6 * float(held[-1])
    if low >= high:
        raise DescriptionError(f"frf: from {low:g} Hz to {high:g} Hz. Give an increasing range.")
    close = np.outer(alive, 1.0 + np.linspace(-0.02, 0.02, 40)).ravel()
    inside = close[(close > low) & (close < high)]
    return np.unique(np.concatenate([np.geomspace(low, high, _POINTS), inside]))


# The figure of `pinflex frf`: magnitude, phase and coherence.

_HEIGHTS = {"magnitude": 2.0, "phase": 1.0, "coherence": 0.8}  # of the panels, relative
_WIDE = 200.0  # from the first to the last frequency: beyond, tens alone have numbers


def drawing(study: FrequencyResponse) -> Drawing:
    """The figure, and its panels by name."""
    parts = _parts(study)
    single = len(study.outputs) == 1
    each = {
        part if single else f"{part} {_without_unit(output)}": partial(
            _panel, study=study, k=k, part=part
        )
        for k, output in enumerate(study.outputs)
        for part in parts
    }
    return Drawing(partial(figure, study), each)


def figure(study: FrequencyResponse) -> Figure:
    """One column an output: magnitude, phase, and coherence where a measured one has it."""
    parts = _parts(study)
    heights = [_HEIGHTS[part] for part in parts]
    room = Room(left=0.8, bottom=0.45, between=(0.75, 0.12))
    n = len(study.outputs)
    fig, axes = panels(
        len(heights), n, 1.15 * sum(heights) + 1.0, room, sharex=True, height_ratios=heights
    )
    for k in range(n):
        for row, part in enumerate(parts):
            ax = axes[row, k]
            _panel(ax, study, k, part)
            if row:
                title(ax, "")
            if row < len(parts) - 1:
                ax.set_xlabel("")
            if row and k:
                ax.set_ylabel("")
    return fig


def _parts(study: FrequencyResponse) -> list[str]:
    coherent = any(one.coherence is not None for one in study.measured)
    return [part for part in _HEIGHTS if part != "coherence" or coherent]


def _without_unit(name: str) -> str:
    return name.split(" [")[0]


def _unit(name: str) -> str:
    return name.split("[")[-1].rstrip("]").split(" | ")[0]


def _panel(ax: Axes, study: FrequencyResponse, k: int, part: str) -> None:
    """Magnitude, phase or coherence of one output."""
    f, H, output = study.frequencies, study.response[:, k], study.outputs[k]
    of: dict[str, Callable[[Array], Array]] = {"magnitude": np.abs, "phase": _phase}
    if part in of:
        ax.semilogx(f, of[part](H), color=COLOURS[0], lw=1.2, label="model")
    for one in study.measured:
        inside = (one.frequencies >= f[0]) & (one.frequencies <= f[-1])
        shown = one.coherence if part == "coherence" else of[part](one.response)
        if one.output == _without_unit(output) and shown is not None:
            colour = COLOURS[2 if part == "coherence" else 1]
            ax.semilogx(
                one.frequencies[inside], shown[inside], color=colour, lw=0.8, label="measured"
            )
            if part == "magnitude":
                ax.legend(frameon=False, fontsize=8, title=f"agreement {one.agreement:.3f}",
                          title_fontsize=8)  # fmt: skip
    unit = f"{_unit(output)} per {_unit(study.input)}"
    labels = {"magnitude": f"magnitude [{unit}]", "phase": "phase [deg]"}
    ax.set_ylabel(labels.get(part, "coherence [-]"))
    ax.set_xlabel("frequency [Hz]")
    title(ax, f"{_without_unit(study.input)} to {_without_unit(output)}")
    _scale(ax, part)
    ax.set_xlim(f[0], f[-1])
    _decades(ax, f[-1] / f[0])
    ax.grid(True, which="major", color="0.9", lw=0.6)


def _decades(ax: Axes, ratio: float) -> None:
    """Plain numbers below a logarithmic axis, as many as there is room for."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    plain = FuncFormatter(lambda value, _: f"{value:g}")
    ax.xaxis.set_major_formatter(plain)
    ax.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0) if ratio < _WIDE else (5.0,)))
    ax.xaxis.set_minor_formatter(plain if ratio < _WIDE else FuncFormatter(lambda *_: ""))
    ax.tick_params(which="minor", labelsize=8, width=0.4)


def _scale(ax: Axes, part: str) -> None:
    if part == "magnitude":
        ax.set_yscale("log")
    elif part == "phase":
        ax.set_ylim(-190, 190)
        ax.set_yticks([-180, -90, 0, 90, 180])
    else:
        ax.set_ylim(0.0, 1.05)


def _phase(H: Any) -> Any:
    """In degrees, -180 where it is half a turn either way, which round-off decides."""
    degrees = np.rad2deg(np.angle(H))
    return np.where(degrees > 179.9, degrees - 360.0, degrees)


# Input shapers side by side: the time that each costs, and what a wrong frequency leaves.

ERRORS = (-0.2, -0.1, -0.05, 0.0, 0.05, 0.1, 0.2)  # of the frequency [-]
_FINE = np.linspace(-0.5, 0.5, 10001)


@frozen
class ShaperRow:
    """One shaper for the vibrations of a motion.

    Attributes:
        kind: zv, zvd or ei.
        time: By how much the motion gets longer [s].
        residual: Largest vibration left of a mode whose frequency is off by `ERRORS`, over that
            without a shaper [-], shape (errors,).
        along: The same where the frequency moves along the motion [-].
        width: Range of the frequency error in which at most 5 % is left [-].
    """

    kind: str
    time: float
    residual: Array
    along: float
    width: float


def shapers(
    mechanism: Mechanism, modes: int | None = None
) -> tuple[Ringing, tuple[ShaperRow, ...]]:
    """Effect of ZV, ZVD and EI on the modes that the motion excites; kinds that take so many."""
    found = ringing(mechanism, plain_motion(mechanism), modes)
    few = (kind for kind in KINDS if len(found.frequencies) <= most_modes(kind))
    return found, tuple(_shaper_row(kind, found) for kind in few)


def _shaper_row(kind: str, found: Ringing) -> ShaperRow:
    made = shaper(kind, found.frequencies.tolist(), found.damping.tolist())
    left = _residual(made, found, np.array(ERRORS))
    low, high = found.low / found.frequencies - 1.0, found.high / found.frequencies - 1.0
    ends = [_residual(made, found, np.array([e]), k)[0] for k, x in enumerate(zip(low, high,
            strict=True)) for e in x]  # fmt: skip
    good = _residual(made, found, _FINE) <= TOLERATED + 1e-9
    return ShaperRow(kind, made.duration, left, max(ends), float(np.mean(good)))


def _residual(made: Shaper, found: Ringing, errors: Array, only: int | None = None) -> Array:
    """Largest residual of the modes (or of one) with their frequencies off, shape (errors,)."""
    each = [
        made.residual(f * (1.0 + errors), float(z))
        for k, (f, z) in enumerate(zip(found.frequencies, found.damping, strict=True))
        if only in (None, k)
    ]
    return np.asarray(np.max(each, axis=0))
