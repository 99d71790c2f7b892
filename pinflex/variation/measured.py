"""What was measured: files of natural frequencies, frequency responses or time histories.

A CSV has a line of column names (units in brackets: SI, or deg, mm, kHz, ...) and a row per value:

- frequency [Hz], std [Hz], mode, FRAME.x ...: natural frequencies; all but the first optional
- frequency [Hz], OUTPUT/INPUT.real, OUTPUT/INPUT.imag, OUTPUT/INPUT.std: frequency responses
- t [s], joint.NAME, torque.NAME, FRAME.x, FRAME.x.acceleration ..., NAME.std: time histories

Universal files (.uff, .unv) hold frequency responses as data sets 58.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motions.laws import cells, headed
from pinflex.errors import DescriptionError
from pinflex.mechanics.mechanism import Mechanism
from pinflex.report import Table
from pinflex.variation.variants import Variants, keys

Columns = dict[str, Array]
_UNIVERSAL = (".uff", ".unv", ".uf")
_RESPONSE = 4  # function type of a frequency response function, data set 58
_SI = r"(?:rad|Hz|kg|Pa|N|m|s|V|A|1|-)(?:\^-?\d)?"
_MULTIPLES = {  # and what they are multiples of
    "deg": (math.pi / 180, "rad"), "mm": (1e-3, "m"), "um": (1e-6, "m"), "ms": (1e-3, "s"),
    "kHz": (1e3, "Hz"), "g": (9.80665, "m/s^2"),
}  # fmt: skip
_OF = {  # SI units of columns, by name or by its first word
    "t": ("s",), "frequency": ("Hz",), "std": ("Hz",), "mode": (),
    "joint": ("rad", "m", "rad | m"), "torque": ("N m", "Nm", "N", "N m | N"),
}  # fmt: skip
_PER = {"velocity": "/s", "acceleration": "/s^2"}
_AXES = ("x", "y", "z", "rx", "ry", "rz")
_RATES = {8: "", 11: ".velocity", 12: ".acceleration"}  # specific data types of an ordinate


def columns(
    source: str | Path | Mapping[str, Any], nodes: Mapping[int, str] | None = None
) -> Columns:
    """Columns by name."""
    if isinstance(source, Mapping):
        return _checked({k: np.asarray(v) for k, v in source.items()}, "measured")
    path = Path(source)
    if not path.is_file():
        raise DescriptionError(f"measured: {path}: no such file. Give a CSV or a universal file.")
    if path.suffix.lower() in _UNIVERSAL:
        return _universal(path, dict(nodes or {}))
    return _checked(_table(path), path.name)


def _table(path: Path) -> Columns:
    try:
        written = path.read_text(encoding="utf-8-sig").splitlines()
        rows = cells(x for x in written if x.strip() and not x.startswith("#"))
    except (UnicodeDecodeError, csv.Error) as error:
        raise DescriptionError(f"{path.name}: not a CSV: {error}. Give text in UTF-8.") from None
    if len(rows) < 2:
        raise DescriptionError(f"{path.name}: no rows. Give names in a line, then numbers below.")
    heads = [headed(cell) for cell in rows[0]]
    names = [name for name, _ in heads]
    factors = [_factor(unit, name, path.name) for name, unit in heads]
    found: dict[str, list[float]] = {name: [] for name in names}
    for line, row in enumerate(rows[1:], 2):
        if len(row) != len(names):
            raise DescriptionError(
                f"{path.name}: row {line}: {len(row)} values for {len(names)} columns. Give one "
                "for each."
            )
        for name, factor, text in zip(names, factors, row, strict=True):
            try:
                found[name].append(factor * float(text))
            except ValueError:
                raise DescriptionError(
                    f"{path.name}: row {line}: {name}: {text!r:.40} is no number. Write one."
                ) from None
    return {name: np.array(values) for name, values in found.items()}


def _factor(unit: str, name: str, where: str) -> float:
    """Of a column, to SI."""
    unit = re.sub(r"(?<=s)[2\u00b2]$", "^2", unit)
    first, over, rest = unit.partition("/")
    if "/" in name:  # of a response: an output over an input
        factor, known = _MULTIPLES.get(first, (1.0, first))
        parts = re.split(r"[\s|/*()]+", known + over + rest)
        allowed = f"SI, {', '.join(_MULTIPLES)}, also over SI"
        may = {unit: factor} if all(re.fullmatch(_SI, part) for part in parts if part) else {}
    else:
        may = _units(name)
        allowed = ", ".join(may) or "none"
    if unit in ("", "-", "1", *may):
        return may.get(unit, 1.0)
    raise DescriptionError(f"{where}: {name}: [{unit}] is no unit of it. Allowed: {allowed}.")


def _units(name: str) -> dict[str, float]:
    """Units that a column may have, with their factors to SI."""
    words = name.removesuffix(".std").split(".")
    rate = _PER.get(words[-1], "")
    axis = words[-2 if rate else -1]
    key = words[0] if words[0] in ("joint", "torque") else ".".join(words)
    si = _OF.get(key, (("rad" if axis.startswith("r") else "m") + rate,))
    return dict.fromkeys(si, 1.0) | {
        multiple + x.removeprefix(base): factor
        for x in si
        for multiple, (factor, base) in _MULTIPLES.items()
        if x == base or x.startswith(f"{base}/")
    }


def _checked(found: Columns, where: str) -> Columns:
    """The columns, if they are of one length, finite, and over frequency or time."""
    if "t" not in found and "frequency" not in found:
        raise DescriptionError(
            f"{where}: no column t and no column frequency. Name one of these: "
            f"{', '.join(found)[:200]}."
        )
    sizes = {len(values) for values in found.values()}
    if len(sizes) > 1 or 0 in sizes:
        raise DescriptionError(f"{where}: columns of {sorted(sizes)} values. Give all as many.")
    for name, values in found.items():
        if not np.all(np.isfinite(values)):
            raise DescriptionError(f"{where}: {name}: a value is not finite. Leave that row out.")
        if name.rpartition(".")[2] == "std" and np.any(values <= 0):
            raise DescriptionError(f"{where}: {name}: not above 0. Give a standard deviation.")
    return found


def _universal(path: Path, nodes: Mapping[int, str]) -> Columns:
    try:
        pyuff: Any = import_module("pyuff")
    except ImportError:
        raise DescriptionError(
            f"{path.name}: universal files need pyuff. pip install pyuff, or give a CSV."
        ) from None
    try:
        sets = pyuff.UFF(str(path)).read_sets()
    except Exception as error:  # its parser raises what its lines make it raise
        raise DescriptionError(f"{path.name}: pyuff cannot read it: {error}") from error
    every = sets if isinstance(sets, list) else [sets]
    return _responses([each for each in every if each.get("type") == 58], path.name, nodes)


def _responses(sets: list[Mapping[str, Any]], where: str, nodes: Mapping[int, str]) -> Columns:
    """Columns of data sets 58."""
    found: Columns = {}
    for each in sets:
        if each["func_type"] != _RESPONSE:
            continue
        x, values = np.asarray(each["x"], float), np.asarray(each["data"], complex)
        if "frequency" in found and not np.array_equal(found["frequency"], x):
            raise DescriptionError(f"{where}: responses at different frequencies. Write one each.")
        found["frequency"] = x
        output, sign = _place(each, "rsp", nodes, where)
        given, way = _place(each, "ref", nodes, where)
        rate = _RATES.get(int(each.get("ordinate_spec_data_type", 8)), "")
        name = f"{output}{rate}/{given}"
        found[f"{name}.real"] = sign * way * values.real
        found[f"{name}.imag"] = sign * way * values.imag
    if not found:
        raise DescriptionError(
            f"{where}: no frequency response function (data set 58, function type 4). Write some."
        )
    return _checked(found, where)


def _place(
    each: Mapping[str, Any], side: str, nodes: Mapping[int, str], where: str
) -> tuple[str, float]:
    """FRAME.AXIS of a node and its direction, and the sign of that."""
    node, way = int(each[f"{side}_node"]), int(each[f"{side}_dir"])
    entity = str(each.get(f"{side}_ent_name", "")).strip()
    name = nodes.get(node, entity if entity.upper() != "NONE" else "")
    if not name or not 1 <= abs(way) <= 6:
        raise DescriptionError(
            f"{where}: node {node}, direction {way}: which frame and axis? Say --node "
            f"{node}=FRAME; directions are 1 to 6 or their negatives."
        )
    return f"{name}.{_AXES[abs(way) - 1]}", float(np.sign(way))


# How measurements are compared with a scene: residuals and their derivatives.

_ALIKE = 0.2  # of a logarithm, of values among each other
_NEAR = 0.6  # of a logarithm, to a factor of units: a scene may be so far off before its fit
# Units that are written by mistake, by that which is meant: their values over the right ones.
_UNITS = {
    "Hz": {"rad/s": 2 * np.pi, "kHz": 1e-3, "rpm": 60.0},
    "m": {"mm": 1e3},
    "rad": {"degrees": 180 / np.pi},
}
_STEP = 1e-3  # of a logarithm: truncation 1e-6, noise of a solved output 1e-6


@dataclass(frozen=True)
class Panel:
    """Measured and calculated values of one quantity, for a plot.

    Attributes:
        title, along, unit: Of the panel, of its axis x, of its values.
        x, measured, model: Shape (n,). std: Standard deviations, shape (n,), or None.
    """

    title: str
    along: str
    unit: str
    x: Array
    measured: Array
    model: Array
    std: Array | None = None


class Comparison:
    """Measurements of one kind; `std`: standard deviations, or None."""

    std: Array | None

    @property
    def told(self) -> bool:
        """Whether the standard deviations are known."""
        return self.std is not None

    @property
    def leads(self) -> bool:
        """Whether there are other rows that lead to the right place from afar."""
        return False

    def rows(self, mechanism: Mechanism, coarse: bool = False) -> Array:
        """Residuals (model - measured) in standard deviations, or in shares of a size.

        `coarse`: those that lead from afar, if there are others for that.
        """
        raise NotImplementedError

    def jacobian(self, designs: Variants, values: Mapping[str, float], base: Mechanism) -> Array:
        """Derivatives of the rows by the logarithms of the parameters, shape (rows, n).

        `values`: where, by key; `base`: the design there.
        """
        return differences(self.rows, designs, values)

    def ratios(self, mechanism: Mechanism) -> list[tuple[str, str, Array]]:
        """For the check of units: name, expected unit, measured over calculated values."""
        return []

    def table(self, mechanism: Mechanism) -> Table:
        """Measured and calculated numbers, for people."""
        raise NotImplementedError

    def panels(self, mechanism: Mechanism) -> list[Panel]:
        """The same for a plot."""
        raise NotImplementedError

    def text(self, mechanism: Mechanism) -> str:
        """The same in words."""
        return self.table(mechanism).text()


def wrong_units(ratios: list[tuple[str, str, Array]]) -> list[str]:
    """Sentences for quantities that are all alike a factor of two units away from the scene's."""
    said = []
    for name, unit, shares in ratios:
        if len(shares) < 2 or np.any(shares <= 0):
            continue
        middle = float(np.exp(np.mean(np.log(shares))))
        alike = float(np.max(np.abs(np.log(shares / middle)))) < _ALIKE
        for other, factor in _UNITS.get(unit, {}).items():
            if alike and abs(np.log(middle / factor)) < _NEAR:
                said.append(
                    f"{name}: all values are some {middle:.3g} times those of the scene. Are they "
                    f"in {other}? {unit} is meant."
                )
    return said


def differences(
    rows: Callable[[Mechanism], Array], designs: Variants, values: Mapping[str, float]
) -> Array:
    """Central differences of rows by the logarithms of the parameters, shape (rows, n)."""
    found = []
    for key in keys(designs.parameters):
        below, above = (
            rows(designs.at({**values, key: values[key] * float(np.exp(h))}))
            for h in (-_STEP, _STEP)
        )
        found.append((above - below) / (2 * _STEP))
    return np.array(found).T
