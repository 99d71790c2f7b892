"""Measured frequency responses and time histories against those of a scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinflex.advice.solve import solve
from pinflex.arrays import Array
from pinflex.errors import DescriptionError, nearest
from pinflex.inversion.linear_model import linearise
from pinflex.mechanics.joints import sliding
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.result import Result
from pinflex.text import number, table
from pinflex.variation.comparison import Panel, differences
from pinflex.variation.variants import Variants

_RATES = ("position", "velocity", "acceleration")
_AXES = ("x", "y", "z", "rx", "ry", "rz")
_LIKE = 0.5  # correlation of two histories from which their sizes can be compared
_SAMPLES = 41  # at least, of a run whose measured times are not equal: cubic between its steps


class _Sampled:
    """Measured samples, each with a residual of its own."""

    std: Array | None

    def rows(self, mechanism: Mechanism, coarse: bool = False) -> Array:
        """Residuals."""
        raise NotImplementedError

    @property
    def told(self) -> bool:
        """Whether the standard deviations are known."""
        return self.std is not None

    def ratios(self, mechanism: Mechanism) -> list[tuple[str, str, Array]]:
        """None."""
        return []

    def jacobian(self, designs: Variants, values: Mapping[str, float], base: Mechanism) -> Array:
        """By the logarithms of the parameters."""
        return differences(self.rows, designs, values)


@dataclass(frozen=True)
class ResponseData(_Sampled):
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

    def text(self, mechanism: Mechanism) -> str:
        """How far the responses are apart."""
        apart = np.abs(self._model(mechanism) - self.values)
        size = np.abs(self.values)
        rows = [
            [f"{o}/{i}", number(float(np.max(size[:, k]))),
             f"{100 * np.sqrt(np.mean(apart[:, k] ** 2) / np.mean(size[:, k] ** 2)):.2g} %"]
            for k, (o, i) in enumerate(self.pairs)
        ]  # fmt: skip
        return table("Frequency responses", "response|largest|rms apart", rows, (36,))

    def panels(self, mechanism: Mechanism) -> list[Panel]:
        """Magnitudes in dB."""
        measured, model = (20 * np.log10(np.abs(H)) for H in (self.values, self._model(mechanism)))
        return [
            Panel(f"{o}/{i}", "frequency [Hz]", "dB", self.frequencies, measured[:, k], model[:, k])
            for k, (o, i) in enumerate(self.pairs)
        ]


@dataclass(frozen=True)
class HistoryData(_Sampled):
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

    @property
    def leads(self) -> bool:
        """No other rows."""
        return False

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

    def text(self, mechanism: Mechanism) -> str:
        """How far the histories are apart."""
        apart = np.sqrt(np.mean((self._model(mechanism) - self.values) ** 2, axis=0))
        swing = np.ptp(self.values, axis=0)
        rows = [
            [name, number(float(s)), number(float(a))]
            for name, s, a in zip(self.names, swing, apart, strict=True)
        ]
        return table("Time histories, SI units", "column|swing|rms apart", rows, (36,))

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
