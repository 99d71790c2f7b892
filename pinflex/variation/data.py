"""Measured natural frequencies and shapes against those of a scene.

Shapes are paired by the modal assurance criterion

    MAC = (m' c)^2 / (m' m) (c' c)

such that the sum over all measured modes is largest, so that modes that were not seen stay free and
curves that cross are followed. Without shapes column `mode` says which is which; without that
the lowest were measured, in any order.

Source: Allemang, Brown (1982), A correlation coefficient for modal vector analysis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter

import numpy as np

from pinflex.advice.solve import solve
from pinflex.arrays import Array, IntArray
from pinflex.errors import DescriptionError, nearest
from pinflex.inversion.linear_model import linearise
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.tree import sliding
from pinflex.report import Table, table
from pinflex.results.result import Result
from pinflex.variation.measured import Comparison, Panel, differences
from pinflex.variation.peaks import STEP, ModalState
from pinflex.variation.variants import Variants, keys

_AXES = ("x", "y", "z", "rx", "ry", "rz")
_NEAR = 0.05  # of a logarithm of frequency in MAC: parts shapes that few sensors see alike
_DOUBT = 0.7  # MAC below which two shapes are hardly one
_MORE = 6  # calculated modes beyond twice the measured ones, among which pairs are sought


@dataclass(frozen=True)
class ModalData(Comparison):
    """Frequencies [Hz], shape (m,), and shapes (m, sensors).

    Attributes:
        frequencies: Measured.
        std: Standard deviations [Hz], shape (m,), or None.
        shapes: Displacements of `sensors` ("FRAME.x"), or None.
        shape_std: Standard deviation of a component of a shape of length one, and then relative one
            of frequencies without their own; None: shapes pair modes only.
        modes: Numbers of the modes from 0, where the file says them.
    """

    frequencies: Array
    std: Array | None
    sensors: tuple[str, ...]
    shapes: Array | None
    shape_std: float | None
    modes: IntArray | None

    @property
    def leads(self) -> bool:
        """Shapes lead to the right one of several scenes with these frequencies."""
        return self.shapes is not None and self.shape_std is None

    @property
    def _std(self) -> Array:
        if self.std is not None:
            return self.std
        return self.frequencies * (1.0 if self.shape_std is None else self.shape_std)

    def _paired(self, state: ModalState, mechanism: Mechanism) -> tuple[IntArray, Array, Array]:
        """Places among the elastic modes, MAC, and calculated shapes (modes, sensors)."""
        m = len(self.frequencies)
        found = state.frequencies[state.elastic][: max(2 * m + _MORE, self._last())]
        if len(found) < max(m, self._last()):
            raise DescriptionError(
                f"{mechanism.name}: {len(found)} natural frequencies, fewer than were measured. "
                "Give links more modes (basis), or leave rows of the file out."
            )
        if self.shapes is None:
            places = np.arange(m) if self.modes is None else self.modes
            return places, np.full(m, np.nan), np.zeros((len(found), 0))
        calculated = (_rows(state, mechanism, self.sensors) @ state.x[:, state.elastic]).T
        calculated = calculated[: len(found)]
        mac = _mac(self.shapes, calculated)
        if self.modes is not None:
            places = self.modes
        else:
            from scipy.optimize import linear_sum_assignment

            apart = np.abs(np.log(self.frequencies[:, None] / np.maximum(found, 1e-12)))
            places = linear_sum_assignment(1.0 - mac + _NEAR * apart)[1]
        return places, mac[np.arange(m), places], calculated

    def _last(self) -> int:
        return 0 if self.modes is None else int(np.max(self.modes)) + 1

    def _model(self, mechanism: Mechanism) -> tuple[Array, IntArray, Array, Array]:
        """Calculated frequencies [Hz], and what `_paired` gives."""
        state = ModalState(mechanism)
        places, mac, calculated = self._paired(state, mechanism)
        return state.frequencies[state.elastic][places], places, mac, calculated

    def rows(self, mechanism: Mechanism, coarse: bool = False) -> Array:
        """Residuals of frequencies, then of shapes if they have a standard deviation.

        From afar shapes count as much as frequencies do.
        """
        f, places, _, calculated = self._model(mechanism)
        first = (f - self.frequencies) / self._std
        shape_std = self.shape_std
        if coarse and shape_std is None:
            shape_std = float(np.median(self._std / self.frequencies))
        if self.shapes is None or shape_std is None:
            return np.asarray(first)
        c = calculated[places]
        size = np.einsum("ij,ij->i", c, c)
        factor = np.einsum("ij,ij->i", c, self.shapes) / np.where(size > 0, size, 1.0)
        apart = (factor[:, None] * c - self.shapes) / shape_std
        return np.concatenate([first, apart.ravel()])

    def jacobian(self, designs: Variants, values: Mapping[str, float], base: Mechanism) -> Array:
        """By logarithms of the parameters: implicit for frequencies, differences for shapes."""
        m = len(self.frequencies)
        state = ModalState(base)
        places = state.elastic[self._paired(state, base)[0]]
        found = np.zeros((m, len(values)))
        for k, key in enumerate(keys(designs.parameters)):

            def at(h: float, key: str = key) -> Mechanism:
                return designs.at({**values, key: values[key] * np.exp(h)})

            slope = np.zeros(len(state.omega2))
            for group, form in state.forms(at, 0.25 * STEP):  # its square is 1e-6
                slope[group] = np.mean(np.diag(form))  # a repeated frequency: of all together
            found[:, k] = slope[places] * state.frequencies[places] / self._std
        if self.shapes is None or self.shape_std is None:
            return found
        return np.concatenate([found, differences(self.rows, designs, values)[m:]])

    def ratios(self, mechanism: Mechanism) -> list[tuple[str, str, Array]]:
        """Measured over calculated frequencies."""
        return [
            ("frequency", "Hz", self.frequencies / np.maximum(self._model(mechanism)[0], 1e-12))
        ]

    def table(self, mechanism: Mechanism) -> Table:
        """Measured and calculated frequencies, and how well shapes agree."""
        f, places, mac, _ = self._model(mechanism)
        rows = zip(places + 1, self.frequencies, f, mac, strict=True)
        return table(
            "Natural frequencies [Hz]", rows, ("mode", itemgetter(0)), ("measured", itemgetter(1)),
            ("model", itemgetter(2)),
            ("apart", lambda row: f"{100 * (row[2] / row[1] - 1):+.2f} %"),
            ("MAC", lambda row: "-" if np.isnan(row[3]) else f"{row[3]:.3f}"), names=(6,),
        )  # fmt: skip

    def text(self, mechanism: Mechanism) -> str:
        """The table, and the modes whose shapes hardly agree."""
        made = self.table(mechanism)
        doubt = [str(place) for place, *_, mac in made.records if mac < _DOUBT]
        if not doubt:
            return made.text()
        modes = f"Shapes that hardly agree: mode {', '.join(doubt)}. Look at these rows."
        return f"{made.text()}\n{modes}"

    def panels(self, mechanism: Mechanism) -> list[Panel]:
        """Measured and calculated frequencies."""
        f = self._model(mechanism)[0]
        number_of = np.arange(1.0, len(f) + 1)
        return [Panel("natural frequencies", "row", "Hz", number_of, self.frequencies, f, self.std)]


def modal_data(found: Mapping[str, Array], shape_std: float | None, where: str) -> ModalData:
    """The modes of a file."""
    f = np.asarray(found["frequency"], float)
    sensors = tuple(name for name in found if name not in ("frequency", "std", "mode"))
    for name in sensors:
        if name.rpartition(".")[2] not in _AXES:
            raise DescriptionError(
                f"{where}: {name}: no column of modes. Allowed: frequency, std, mode, FRAME.x, "
                "FRAME.y ... FRAME.rz (a shape)."
            )
    if np.any(f <= 0):
        raise DescriptionError(f"{where}: frequency: {np.min(f):g}. Give values above 0 Hz.")
    modes = None
    if "mode" in found:
        modes = np.asarray(np.round(found["mode"]), int) - 1
        if np.any(modes < 0) or len(set(modes)) < len(modes):
            raise DescriptionError(f"{where}: mode: give numbers from 1, each once.")
    shapes = None
    if sensors:
        shapes = np.column_stack([found[name] for name in sensors])
        size = np.linalg.norm(shapes, axis=1, keepdims=True)
        if np.any(size == 0):
            raise DescriptionError(f"{where}: a shape is 0 everywhere. Leave its row out.")
        shapes = shapes / size
    std = found.get("std")
    if shapes is None and modes is None:  # the lowest, in any order
        order = np.argsort(f, kind="stable")
        f, std = f[order], None if std is None else std[order]
    return ModalData(f, std, sensors, shapes, shape_std, modes)


def _rows(state: ModalState, mechanism: Mechanism, sensors: tuple[str, ...]) -> Array:
    """How sensors move with the free coordinates, shape (sensors, free)."""
    system = Equations(mechanism.flexible)
    known: dict[str, Array] = {}
    rows = []
    for sensor in sensors:
        name, _, axis = sensor.rpartition(".")
        if name not in known:
            known[name] = frame_jacobian(system, state.y, mechanism.frame(name))
        rows.append(known[name][_AXES.index(axis), state.free])
    return np.array(rows)


def _mac(measured: Array, calculated: Array) -> Array:
    """Modal assurance criterion of every pair, shape (measured, calculated)."""
    size = np.linalg.norm(calculated, axis=1)
    most = np.max(size, initial=0.0)
    unit = calculated / np.where(size > 1e-9 * most, size, np.inf)[:, None]
    norm = np.linalg.norm(measured, axis=1, keepdims=True)
    return np.asarray(((measured / norm) @ unit.T) ** 2)


# Measured frequency responses and time histories against those of a scene.

_RATES = ("position", "velocity", "acceleration")
_LIKE = 0.5  # correlation of two histories from which their sizes can be compared
_SAMPLES = 41  # at least, of a run whose measured times are not equal: cubic between its steps


@dataclass(frozen=True)
class ResponseData(Comparison):
    """Frequency responses.

    Attributes:
        frequencies: Hz, shape (nf,). values: Complex, shape (nf, pairs).
        pairs: (output, input) as of `linearise`. std: Of a real part, shape (nf, pairs), or None.
    """

    frequencies: Array
    pairs: tuple[tuple[str, str], ...]
    values: Array
    std: Array | None

    @property
    def leads(self) -> bool:
        """Logarithms meet where peaks are far apart."""
        return True

    @cached_property
    def _std(self) -> Array:
        size = np.sqrt(np.mean(np.abs(self.values) ** 2, axis=0))
        return np.broadcast_to(size, self.values.shape) if self.std is None else self.std

    def _model(self, mechanism: Mechanism) -> Array:
        """Responses of a scene, its motors free where one is an input, locked otherwise."""
        outputs = tuple(dict.fromkeys(output for output, _ in self.pairs))
        inputs = tuple(dict.fromkeys(given for _, given in self.pairs))
        forces = [name for name in inputs if name not in mechanism.motors]
        motors = "acceleration" if len(forces) == len(inputs) else "torque"
        model = linearise(mechanism, motors=motors, forces=forces, outputs=outputs)
        place = [name.split(" [")[0] for name in model.inputs]
        H = model.response(self.frequencies)
        return np.stack([H[:, outputs.index(o), place.index(i)] for o, i in self.pairs], axis=1)

    def rows(self, mechanism: Mechanism, coarse: bool = False) -> Array:
        """Real and imaginary parts; from afar the logarithm of the magnitude and the phase."""
        H = self._model(mechanism)
        if coarse:
            least = 1e-6 * np.max(np.abs(self.values), axis=0)  # a zero has no logarithm
            apart = np.log((H + least) / (self.values + least))
        else:
            apart = (H - self.values) / self._std
        return np.concatenate([apart.real.ravel(), apart.imag.ravel()])

    def table(self, mechanism: Mechanism) -> Table:
        """How far the responses are apart."""
        apart, size = np.abs(self._model(mechanism) - self.values), np.abs(self.values)
        shares = np.sqrt(np.mean(apart**2, axis=0) / np.mean(size**2, axis=0))
        return table(
            "Frequency responses", zip(self.pairs, np.max(size, axis=0), shares, strict=True),
            ("response", lambda row: "/".join(row[0])), ("largest", itemgetter(1)),
            ("rms apart", lambda row: f"{100 * row[2]:.2g} %"), names=(36,),
        )  # fmt: skip

    def panels(self, mechanism: Mechanism) -> list[Panel]:
        """Magnitudes in dB."""
        measured, model = (20 * np.log10(np.abs(H)) for H in (self.values, self._model(mechanism)))
        return [
            Panel(f"{o}/{i}", "frequency [Hz]", "dB", self.frequencies, measured[:, k], model[:, k])
            for k, (o, i) in enumerate(self.pairs)
        ]


@dataclass(frozen=True)
class HistoryData(Comparison):
    """Time histories.

    Attributes:
        t: s, shape (nt,). names: As in `measured`. values: Shape (nt, names).
        std: Shape (nt, names), or None.
        level, dt: Of the runs; equal steps, as chosen steps are no smooth function.
    """

    t: Array
    names: tuple[str, ...]
    values: Array
    std: Array | None
    level: str | None
    dt: float | None

    @cached_property
    def _std(self) -> Array:
        size = np.sqrt(np.mean((self.values - np.mean(self.values, axis=0)) ** 2, axis=0))
        size = np.where(size > 0, size, np.maximum(np.max(np.abs(self.values), axis=0), 1e-12))
        return np.broadcast_to(size, self.values.shape) if self.std is None else self.std

    def _model(self, mechanism: Mechanism) -> Array:
        end = float(self.t[-1])
        equal = np.allclose(self.t, np.linspace(0.0, end, len(self.t)), atol=1e-6 * end)
        samples = len(self.t) if equal else max(math.ceil(end / (self.dt or end)) + 1, _SAMPLES)
        run = solve(mechanism, level=self.level, until=end, dt=self.dt, samples=samples, tol=None)
        found = np.stack([_signal(run, name) for name in self.names], axis=1)
        if equal:
            return found
        from scipy.interpolate import CubicSpline

        return np.asarray(CubicSpline(run.t, found)(self.t))

    def ratios(self, mechanism: Mechanism) -> list[tuple[str, str, Array]]:
        """Swings, and factors that fit histories best, of positions that the scene resembles."""
        model, found = self._model(mechanism), []
        for k, name in enumerate(self.names):
            one, other = (x[:, k] - np.mean(x[:, k]) for x in (self.values, model))
            size = float(np.linalg.norm(one) * np.linalg.norm(other))
            parts = name.split(".")
            if parts[0] == "torque" or parts[-1] in _RATES[1:] or one @ other < _LIKE * size:
                continue
            turned = parts[0] == "joint" and name[6:] not in sliding(mechanism.rigid.rigid)
            shares = np.array([np.ptp(one) / np.ptp(other), one @ other / (other @ other)])
            found.append((name, "rad" if turned else "m", shares))
        return found

    def rows(self, mechanism: Mechanism, coarse: bool = False) -> Array:
        """All samples of all columns."""
        return np.asarray(((self._model(mechanism) - self.values) / self._std).ravel())

    def table(self, mechanism: Mechanism) -> Table:
        """How far the histories are apart."""
        apart = np.sqrt(np.mean((self._model(mechanism) - self.values) ** 2, axis=0))
        return table(
            "Time histories, SI units",
            zip(self.names, np.ptp(self.values, axis=0), apart, strict=True),
            ("column", itemgetter(0)), ("swing", itemgetter(1)), ("rms apart", itemgetter(2)),
            names=(36,),
        )  # fmt: skip

    def panels(self, mechanism: Mechanism) -> list[Panel]:
        """The histories."""
        model = self._model(mechanism)
        return [
            Panel(name, "t [s]", "SI", self.t, self.values[:, k], model[:, k])
            for k, name in enumerate(self.names)
        ]


def response_data(found: Mapping[str, Array], where: str) -> ResponseData:
    """The frequency responses of a file."""
    names = list(dict.fromkeys(x.rpartition(".")[0] for x in found if x != "frequency"))
    for name in names:
        if "/" not in name or f"{name}.real" not in found or f"{name}.imag" not in found:
            raise DescriptionError(
                f"{where}: {name}: write columns OUTPUT/INPUT.real and OUTPUT/INPUT.imag, such as "
                "platform.x/platform.x.real."
            )
    values = np.column_stack([found[f"{x}.real"] + 1j * found[f"{x}.imag"] for x in names])
    pairs = tuple((x.partition("/")[0], x.partition("/")[2]) for x in names)
    return ResponseData(found["frequency"], pairs, values, _stds(found, names, where))


def history_data(
    found: Mapping[str, Array], where: str, level: str | None, dt: float | None
) -> HistoryData:
    """The time histories of a file."""
    t = found["t"]
    if len(t) < 2 or np.any(np.diff(t) <= 0) or t[0] < 0:
        raise DescriptionError(f"{where}: t: not rising from 0 or later. Sort the rows.")
    names = [x for x in found if x != "t" and x.rpartition(".")[2] != "std"]
    if not names:
        raise DescriptionError(f"{where}: only t. Give joint.NAME, torque.NAME or FRAME.x.")
    values = np.column_stack([found[x] for x in names])
    return HistoryData(t, tuple(names), values, _stds(found, names, where), level, dt)


def _stds(found: Mapping[str, Array], names: list[str], where: str) -> Array | None:
    given = [f"{name}.std" in found for name in names]
    if not any(given):
        return None
    if not all(given):
        raise DescriptionError(
            f"{where}: {names[given.index(False)]}.std: not there. Give it for every column, or "
            "for none."
        )
    return np.column_stack([found[f"{name}.std"] for name in names])


def _signal(run: Result, name: str) -> Array:
    """A column of a run, shape (nt,)."""
    head, _, rest = name.partition(".")
    if head == "joint":
        return run.joint(rest).angle
    if head == "torque":
        return run.joint(rest).torque
    parts = name.split(".")
    rate = parts.pop() if parts[-1] in _RATES else "position"
    frame, axis = ".".join(parts[:-1]), parts[-1]
    allowed = _AXES[:3] if rate == "position" else _AXES
    if not frame or axis not in allowed:
        raise DescriptionError(
            f"measured: {name}: write joint.NAME, torque.NAME, FRAME.x or FRAME.x.acceleration."
            f"{nearest(axis, allowed)}"
        )
    values: Array = getattr(run.frame(frame), rate)
    return values[:, allowed.index(axis)]
