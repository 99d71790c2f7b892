"""Measured natural frequencies and shapes against those of a scene.

Shapes are paired by the modal assurance criterion

    MAC = (m' c)^2 / (m' m) (c' c)

such that the sum over all measured modes is largest, so that modes that were not seen stay free and
curves that cross are followed. Without shapes column `mode` says which is which; without that
the lowest were measured, in any order.

Source: Allemang, Brown (1982), A correlation coefficient for modal vector analysis.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.errors import DescriptionError
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.frames import frame_jacobian
from pinflex.mechanics.mechanism import Mechanism
from pinflex.text import number, table
from pinflex.variation.comparison import Panel, differences
from pinflex.variation.derivatives import STEP, ModalState
from pinflex.variation.variants import Variants, keys

_AXES = ("x", "y", "z", "rx", "ry", "rz")
_NEAR = 0.05  # of a logarithm of frequency in MAC: parts shapes that few sensors see alike
_DOUBT = 0.7  # MAC below which two shapes are hardly one
_MORE = 6  # calculated modes beyond twice the measured ones, among which pairs are sought


@dataclass(frozen=True)
class ModalData:
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
    def told(self) -> bool:
        """Whether the standard deviations are known."""
        return self.std is not None

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

    def rows(self, mechanism: Mechanism, coarse: bool = False) -> Array:
        """Residuals of frequencies, then of shapes if they have a standard deviation.

        From afar shapes count as much as frequencies do.
        """
        state = ModalState(mechanism)
        places, _, calculated = self._paired(state, mechanism)
        f = state.frequencies[state.elastic][places]
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
        state = ModalState(mechanism)
        f = state.frequencies[state.elastic][self._paired(state, mechanism)[0]]
        return [("frequency", "Hz", self.frequencies / np.maximum(f, 1e-12))]

    def text(self, mechanism: Mechanism) -> str:
        """Measured and calculated frequencies, and how well shapes agree."""
        state = ModalState(mechanism)
        places, mac, _ = self._paired(state, mechanism)
        f = state.frequencies[state.elastic][places]
        rows = [
            [str(p + 1), number(a), number(b), f"{100 * (b / a - 1):+.2f} %",
             "-" if np.isnan(c) else f"{c:.3f}"]
            for p, a, b, c in zip(places, self.frequencies, f, mac, strict=True)
        ]  # fmt: skip
        text = table("Natural frequencies [Hz]", "mode|measured|model|apart|MAC", rows, (6,))
        doubt = [str(p + 1) for p, c in zip(places, mac, strict=True) if c < _DOUBT]
        if doubt:
            text += f"\nShapes that hardly agree: mode {', '.join(doubt)}. Look at these rows."
        return text

    def panels(self, mechanism: Mechanism) -> list[Panel]:
        """Measured and calculated frequencies."""
        state = ModalState(mechanism)
        f = state.frequencies[state.elastic][self._paired(state, mechanism)[0]]
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
