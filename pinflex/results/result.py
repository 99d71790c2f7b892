"""What a run leaves behind: arrays, names and source texts, read by name, kept in one file."""

from __future__ import annotations

import csv
import json
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError, nearest
from pinflex.results import checked
from pinflex.results.archive import write_arrays
from pinflex.results.error_bars import ErrorBars, percent, time_error
from pinflex.results.lazy import Late
from pinflex.results.views import (
    Deviation,
    FrameView,
    JointView,
    LinkView,
    LoopView,
    peak,
    rms,
    rotation_vector,
)
from pinflex.text import short
from pinflex.writing import replaced

__all__ = ["Deviation", "Result", "peak", "rms", "same_grid"]

FORMAT = 1  # raised when an older pinflex could no longer read the file
_HEADER = "pinflex"  # the npz member that says whose file it is, and holds meta
_DAMAGE = (  # what a file with a wrong byte makes zipfile, zlib, numpy or json raise
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    OSError,
    RuntimeError,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    SyntaxError,
    tokenize.TokenError,
    NotImplementedError,
    OverflowError,
    RecursionError,
    IndexError,
    MemoryError,
    struct.error,
)
_WITHOUT_TIME = ("/x", "/mesh/nodes", "/mesh/triangles")
UNITS = {
    "torque": "N m",
    "joint/q": "rad",
    "joint/v": "rad/s",
    "joint/a": "rad/s^2",
    "frame": "m",
    "link": "m",
    "energy": "J",
    "residual/closure": "m",
}


@dataclass(frozen=True)
class Result:
    """One run at one level of fidelity.

    Attributes:
        t: Instants [s], shape (nt,), increasing.
        arrays: Read-only arrays by flat key ("joint/q", "link/distal_1/x"), time first, SI units.
        meta: Names, settings, cost, warnings and source texts, as plain JSON values.
        look: What measures the error of the model when `errors` is asked for; not stored.

    Of a run just solved, poses, forces, stresses and warnings are found when first asked for; a
    plain dictionary of all is dict(result.arrays), or dict(result.meta).
    """

    t: Array
    arrays: Mapping[str, Array]
    meta: Mapping[str, Any]
    look: Callable[[Result], ErrorBars] | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        t = _read_only(self.t, "t")
        if t.ndim != 1 or len(t) == 0 or not np.all(np.diff(t) > 0):
            raise DescriptionError(
                f"result: t: shape {t.shape} is not a list of increasing instants. "
                "Give times [s] as a non-empty, strictly increasing vector."
            )
        object.__setattr__(self, "t", t)
        if not isinstance(self.arrays, Late):
            object.__setattr__(self, "arrays", {k: _timed(k, x, t) for k, x in self.arrays.items()})
        if not isinstance(self.meta, Late):
            object.__setattr__(self, "meta", plain(self.meta))

    def __reduce__(self) -> tuple[Any, ...]:
        """Whole into another process."""
        return Result, (self.t, dict(self.arrays), dict(self.meta))

    @cached_property
    def errors(self) -> ErrorBars:
        """Errors of time integration and of the model, by output; the model is looked at now."""
        known = self.meta.get("errors")
        if known:
            return ErrorBars(**known)
        if self.look is not None:
            return self.look(self)
        time, how = time_error(self.meta.get("settings", {}), self.level)
        return ErrorBars(time, {}, how, "not measured: a stored result has no model to look at")

    def with_errors(self) -> Result:
        """The result with `errors` in its meta, so that a file of it has them too."""
        return replace(self, meta={**self.meta, "errors": self.errors.plain()})

    def array(self, key: str) -> Array:
        """The read-only array of a flat key; an unknown key leads to the nearest one."""
        if key not in self.arrays:
            raise DescriptionError(
                f"result of level {self.level}: no array {key!r}." + nearest(key, self.arrays),
                key=key,
            )
        return self.arrays[key]

    @property
    def level(self) -> str:
        """Level of fidelity: rigid, quasistatic, ked or coupled."""
        return str(self.meta.get("level", "unknown"))

    @property
    def motors(self) -> tuple[str, ...]:
        """Actuated joints, in the order of the torque columns."""
        return tuple(self.meta.get("actuated", ()))

    @property
    def links(self) -> tuple[str, ...]:
        """Flexible links that this result has fields for; none at the rigid level."""
        return tuple(self.meta.get("links", ()))

    @property
    def torque(self) -> Array:
        """Motor torques [N m | N], shape (nt, nm)."""
        return self.array("torque")

    @property
    def worst_closure(self) -> float:
        """Largest closure residual of the run [m | rad]; 0 without loops."""
        closure = self.arrays.get("residual/closure")
        return 0.0 if closure is None else peak(closure)

    def unit(self, key: str) -> str:
        """Unit of a key, from the longest prefix that meta["units"] (or the default) knows."""
        units = {**UNITS, **self.meta.get("units", {})}
        known = [p for p in units if key == p or key.startswith(p + "/")]
        return str(units[max(known, key=len)]) if known else ""

    def joint(self, name: str) -> JointView:
        """Coordinates, motor torque and reaction of one joint."""
        return JointView(self, _known("joint", name, self.meta.get("joints", ())))

    def frame(self, name: str) -> FrameView:
        """Motion of one output frame; "platform" also names the frame of meta["platform"]."""
        frames = self.meta.get("frames", ())
        if name == "platform" and name not in frames:
            name = self.meta.get("platform") or name
        return FrameView(self, _known("frame", name, frames))

    def link(self, name: str) -> LinkView:
        """Deflection, section forces and stresses along one flexible link."""
        return LinkView(self, _known("flexible link", name, self.links))

    def loop(self, name: str) -> LoopView:
        """Force and moment that one loop joint carries."""
        return LoopView(self, _known("loop", name, [x["name"] for x in self.meta.get("loops", ())]))

    def deviation_from(self, other: Result, frame: str = "platform") -> Deviation:
        """How far a frame is from where another run has it, at the same instants.

        position = p - p_other, rotation = log(R R_other'), both in the world frame.

        Args:
            other: Usually the rigid run.
            frame: Name of an output frame of both runs.
        """
        same_grid(self, other)
        mine, theirs = self.frame(frame), other.frame(frame)
        turn = mine.rotation @ np.swapaxes(theirs.rotation, 1, 2)
        return Deviation(self.t, mine.position - theirs.position, rotation_vector(turn))

    def save(self, path: str | Path) -> Path:
        """Write one .npz; a file already there is replaced only by a complete one."""
        path = Path(path)
        header = {"program": "pinflex", "format": FORMAT, "meta": dict(self.meta)}
        contents = {_HEADER: np.array(json.dumps(header)), "t": self.t, **self.arrays}
        with replaced(path) as part, part.open("wb") as stream:
            write_arrays(stream, contents)
        return path

    @classmethod
    def load(cls, path: str | Path, most: float = checked.MOST) -> Result:
        """Read a file written by `save`; nothing in it is ever executed (no pickle).

        Args:
            path: The .npz. most: Largest size of all arrays together [bytes].
        """
        if not isinstance(path, (str, Path)):
            raise DescriptionError(f"result: {path!r:.80} is no path. Give that of a .npz.")
        path = Path(path)
        remake = "Give a file written by `pinflex solve -o` or Result.save."
        if not path.is_file():
            raise DescriptionError(f"{path}: no such result file. {remake}", path=path)
        try:
            with path.open("rb") as stream:
                if stream.read(4) != b"PK\x03\x04":
                    raise DescriptionError(f"{path}: not an .npz archive. {remake}", path=path)
                checked.require_size(path, most)
                stream.seek(0)
                archive = np.load(stream, allow_pickle=False)
                if _HEADER not in archive.files:
                    raise DescriptionError(
                        f"{path}: an .npz of another program (no {_HEADER!r} header). {remake}",
                        path=path,
                    )
                header = json.loads(str(archive[_HEADER]))
                if int(header["format"]) > FORMAT:
                    raise DescriptionError(
                        f"{path}: result format {header['format']}, this pinflex reads up to "
                        f"{FORMAT}. Update pinflex, or solve again with this version.",
                        path=path,
                    )
                arrays = {key: archive[key] for key in archive.files if key != _HEADER}
            t = arrays.pop("t")
            checked.check(header["meta"], arrays, np.atleast_1d(t))
            return cls(t, arrays, header["meta"])
        except DescriptionError as error:
            if str(path) in str(error):
                raise
            raise DescriptionError(f"{path}: {error}", path=path) from None
        except _DAMAGE as error:
            raise DescriptionError(
                f"{path}: truncated or damaged ({type(error).__name__}: {error}). "
                "Copy the file again, or repeat the run that wrote it.",
                path=path,
            ) from error

    def to_csv(self, path: str | Path) -> Path:
        """Write one wide table: a row per instant, a unit in every header."""
        columns: dict[str, Array] = {"t [s]": self.t}
        for i, motor in enumerate(self.motors):
            columns[f"torque {motor} [{self.unit('torque/' + motor)}]"] = self.torque[:, i]
        for name in self.meta.get("joints", ()):
            unit, position = self.unit(f"joint/q/{name}"), self.joint(name).position
            if position.ndim == 1 or position.shape[1] == 2:  # 2: cosine and sine
                unit = "rad" if position.ndim == 2 else unit
                columns[f"position {name} [{unit}]"] = self.joint(name).angle
                continue
            units = unit.split(", ") if unit.count(",") == position.shape[1] - 1 else None
            for i, column in enumerate(position.T):
                columns[f"position {name}[{i}] [{units[i] if units else unit}]"] = column
        if self.meta.get("platform"):
            platform = self.frame(self.meta["platform"])
            turn = rotation_vector(platform.rotation)
            for i, axis in enumerate("xyz"):
                columns[f"platform {axis} [m]"] = platform.position[:, i]
            for i, axis in enumerate("xyz"):
                columns[f"platform r{axis} [rad]"] = turn[:, i]
        for name in self.links:
            columns[f"max von Mises {name} [Pa]"] = self.link(name).von_mises.max(axis=1)
        path = Path(path)
        with replaced(path) as part, part.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(columns)
            writer.writerows(zip(*(map(repr, c.tolist()) for c in columns.values()), strict=True))
        return path

    def summary(self) -> str:
        """The run in a few aligned lines of text."""
        cost, balance = self.meta.get("cost", {}), self.meta.get("energy_balance")
        rows = [("level", self.level)]
        if self.meta.get("status", "complete") != "complete":
            rows.append(("status", f"{self.meta['status']}: {self.meta.get('message', '')}"))
        rows.append(("time", f"{self.t[0]:g} to {self.t[-1]:g} s, {len(self.t)} instants"))
        if "steps" in cost:
            several = cost.get("runs", 1) > 1
            last = f" in {cost.get('runs')} runs, {cost.get('last_steps')} in the last"
            rows.append(("steps", f"{cost['steps']}{last if several else ''}"))
        if "newton" in cost:
            each = f" ({cost['newton'] / cost['steps']:.2f} a step)" if cost.get("steps") else ""
            rows.append(("Newton iterations", f"{cost['newton']}{each}"))
        rows += [("wall time", f"{cost['seconds']:.3g} s")] if "seconds" in cost else []
        time, how = time_error(self.meta.get("settings", {}), self.level)
        errors = self._known_errors() or ErrorBars(time, {}, how, "not looked at (run.errors does)")
        for line in errors.lines():
            what, _, said = line.partition(": ")
            rows.append((what, f"error {said}"))
        graded = {k: f", {word}" for k, word in self.meta.get("grades", {}).items()}
        rows.append(("worst closure", f"{self.worst_closure:.2e}{graded.get('closure', '')}"))
        known = "not computed" if balance is None else f"{balance:.2e}{graded.get('energy', '')}"
        rows.append(("energy balance", known))
        rows += [("warning", text) for text in self.meta.get("warnings", ())]
        return "\n".join([self._first_line()] + [f"  {a:<18}{b}" for a, b in rows])

    def _first_line(self) -> str:
        """Its name; and a model error above the tolerance asked, where that has been looked at."""
        name, advised = str(self.meta.get("name", "result")), self.meta.get("advice")
        tol = (advised or self.meta.get("settings", {})).get("tol")
        errors = self._known_errors()
        worst = None if errors is None else errors.worst()
        if worst is None or tol is None or worst[1] <= tol:
            return name
        return (
            f"{name}: THE MODEL is off by up to {percent(worst[1])} ({worst[0]}), more than "
            f"tol = {tol:g}{'' if advised else ', which is of time integration only'}"
        )

    def _known_errors(self) -> ErrorBars | None:
        """`errors`, where somebody has asked for them."""
        stored = self.meta.get("errors")
        found = self.__dict__.get("errors")
        return found if isinstance(found, ErrorBars) else ErrorBars(**stored) if stored else None

    __str__ = summary

    def __repr__(self) -> str:
        name = self.meta.get("name", "no name")
        return f"Result({short(str(name), 60)}, {self.level}, {len(self.t)} instants)"


def same_grid(a: Result, b: Result) -> None:
    """Raise unless both results hold the same instants, which every difference needs."""
    if len(a.t) != len(b.t) or not np.allclose(a.t, b.t, rtol=0.0, atol=1e-9 * (1 + abs(a.t[-1]))):
        raise DescriptionError(
            f"the {a.level} and {b.level} results have different instants: {len(a.t)} in "
            f"[{a.t[0]:g}, {a.t[-1]:g}] s against {len(b.t)} in [{b.t[0]:g}, {b.t[-1]:g}] s. "
            "Solve both with the same `until`, `dt` and `samples` (a stopped run is shorter)."
        )


def plain(meta: Any) -> dict[str, Any]:
    """A mapping as JSON has it."""
    try:
        found = json.loads(json.dumps(meta, default=_plain))
    except (TypeError, ValueError) as error:
        raise DescriptionError(
            f"result: meta: {error}. Use numbers, texts, lists and mappings only."
        ) from None
    if not isinstance(found, dict):
        raise DescriptionError(f"result: meta: {found!r} is not a mapping. Give names to values.")
    return found


def _timed(key: str, values: Any, t: Array) -> Array:
    array = _read_only(values, key)
    fixed = key.startswith("link/") and key.endswith(_WITHOUT_TIME)
    if not fixed and array.shape[:1] != t.shape:
        raise DescriptionError(
            f"result: {key}: shape {array.shape} does not start with the "
            f"{len(t)} instants of t. Arrays are time first.",
            key=key,
        )
    return array


def _read_only(values: Any, key: str) -> Array:
    try:
        array = np.array(values, dtype=np.float64)  # a copy: the caller's array stays writable
    except (TypeError, ValueError) as error:
        raise DescriptionError(
            f"result: {key}: {error}. Every array holds real numbers.", key=key
        ) from None
    array.setflags(write=False)
    return array


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"a {type(value).__name__} ({value!r}) is not plain data")


def _known(kind: str, name: str, names: Iterable[str]) -> str:
    names = list(names)
    if name not in names:
        raise DescriptionError(f"result: no {kind} {name!r}." + nearest(name, names), name=name)
    return name
