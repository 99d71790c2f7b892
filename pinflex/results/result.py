"""Result of a run: arrays, names and source texts, read by name, kept in one file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.doors import door, library
from pinflex.errors import DescriptionError, nearest
from pinflex.names import Names
from pinflex.report import card, pairs
from pinflex.results import archive, quantities
from pinflex.results.drives import DriveView
from pinflex.results.error_bars import ErrorBars, time_error
from pinflex.results.lazy import Late, plain_meta, read_only, timed
from pinflex.results.quantities import QUANTITIES, unit_of
from pinflex.results.views import (
    Deviation,
    Event,
    FrameView,
    JointView,
    LinkView,
    LoopView,
    Statistic,
    Worst,
    peak,
    rms,
    worst_section,
)
from pinflex.rotations import rotation_vector
from pinflex.text import percent, short
from pinflex.writing import write_csv

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Deviation", "Result", "peak", "rms", "same_grid"]


# What people write for an attribute of a run, and what is meant.
_MEANT = {
    **{"time": "t", "times": "t", "tau": "torque", "torques": "torque", "q": 'array("joint/q")'},
    **{"warnings": 'meta["warnings"]', "stress": 'link("NAME").von_mises'},
}
_OF_FRAMES = ("platform", "position", "pose", "tool", "tip", "end_effector")


@dataclass(frozen=True)
class Result:
    """One run at one level of fidelity.

    Attributes:
        t: Instants [s], shape (nt,), increasing.
        arrays: Read-only arrays by flat key ("joint/q", "link/distal_1/x"), time first, SI units.
        meta: Names, settings, cost, warnings and source texts, as plain JSON values.
        look: Function that measures the error of the model for `errors`; not stored.

    Of a run just solved, poses, forces, stresses and warnings are found when first asked for; a
    plain dictionary of all is dict(result.arrays), or dict(result.meta).
    """

    t: Array
    arrays: Mapping[str, Array]
    meta: Mapping[str, Any]
    look: Callable[[Result], ErrorBars] | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        t = read_only(self.t, "t")
        if t.ndim != 1 or len(t) == 0 or not np.all(np.diff(t) > 0):
            raise DescriptionError(
                f"result: t: shape {t.shape} is not a list of increasing instants. "
                "Give times [s] as a non-empty, strictly increasing vector."
            )
        object.__setattr__(self, "t", t)
        if not isinstance(self.arrays, Late):
            object.__setattr__(self, "arrays", {k: timed(k, x, t) for k, x in self.arrays.items()})
        if not isinstance(self.meta, Late):
            object.__setattr__(self, "meta", plain_meta(self.meta))

    def __getattr__(self, name: str) -> Any:
        """Only for what there is not: the attribute that a guess means."""
        said = f"result: no attribute {name!r}."
        if not name.startswith("_") and name not in self.__dataclass_fields__:
            platform = self.meta.get("platform")
            of_it = f"frame({platform!r})" if platform else "frames"
            meant = _MEANT.get(name, of_it if name in _OF_FRAMES else None)
            close = get_close_matches(name, dir(self), 1, 0.7)
            said += "".join(f" Did you mean run.{one}?" for one in ([meant] if meant else close))
        raise AttributeError(said, name=name, obj=None)  # else Python adds a guess of its own

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle with every array evaluated."""
        return Result, (self.t, dict(self.arrays), dict(self.meta))

    @cached_property
    def errors(self) -> ErrorBars:
        """Errors of time integration and of the model, by output; the model's is measured now."""
        known = self.meta.get("errors")
        if known:
            return ErrorBars(**known)
        if self.look is not None:
            return self.look(self)
        time, how = time_error(self.meta.get("settings", {}), self.level)
        return ErrorBars(time, {}, how, "not measured: a stored result has no model to look at")

    @property
    def events(self) -> tuple[Event, ...]:
        """Contacts, releases and bounces of a run with stops, backlash, cables or clearance."""
        return tuple(Event(**one) for one in self.meta.get("settings", {}).get("events", ()))

    @property
    def statistics(self) -> dict[str, Statistic]:
        """Torques of motors over runs whose histories part at contacts, by name; else empty.

        The other runs are made now, two more; a stored result has them if `with_errors` made it.
        """
        found = self.meta.get("statistics", {})
        return {name: Statistic(**one) for name, one in found.items()}

    def with_errors(self) -> Result:
        """The result with `errors` in its meta, so that a file of it has them too; `statistics`
        likewise, where there are some.
        """
        several = {name: one._asdict() for name, one in self.statistics.items()}
        more = {"errors": self.errors.plain(), **({"statistics": several} if several else {})}
        return replace(self, meta={**self.meta, **more})

    def __getitem__(self, key: str) -> Array:
        """The read-only array of a flat key: run["torque"], run["frame/platform/position"]."""
        return self.array(key)

    def __contains__(self, key: object) -> bool:
        """Whether there is an array of a key: "loop/elbow/wrench" in run."""
        return key in self.arrays or key in QUANTITIES

    def _ipython_key_completions_(self) -> list[str]:
        return [*self.arrays, *QUANTITIES]

    def array(self, key: str) -> Array:
        """The read-only array of a flat key; an unknown key leads to the nearest one."""
        if key in QUANTITIES:
            return QUANTITIES[key].of(self)
        if key not in self.arrays:
            known = (*self.arrays, *QUANTITIES)
            raise DescriptionError(
                f"result of level {self.level}: no array {key!r}." + nearest(key, known),
                key=key,
            )
        return self.arrays[key]

    def fresh(self, key: str) -> Array:
        """Array that is computed from the mechanism while a run is fresh, and not stored."""
        if key not in self.arrays:
            raise DescriptionError(
                f"result of level {self.level}: {key} is computed from the mechanism and not "
                "stored. Ask for it before the run is saved or copied, or solve again.",
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
    def joints(self) -> Names[JointView]:
        """Moving joints; run.joints["motor_1"].torque is an array over time."""
        return Names(self.meta.get("joints", ()), self.joint)

    @property
    def frames(self) -> Names[FrameView]:
        """Output frames; run.frames["platform"].position is an array over time."""
        return Names(self.meta.get("frames", ()), self.frame)

    @property
    def links(self) -> Names[LinkView]:
        """Flexible links that this result has fields for; none at the rigid level."""
        return Names(self.meta.get("links", ()), self.link)

    @property
    def loops(self) -> Names[LoopView]:
        """Loop joints; run.loops["pin_1"].force is an array over time."""
        return Names([x["name"] for x in self.meta.get("loops", ())], self.loop)

    @property
    def drives(self) -> Names[DriveView]:
        """Joints with a drive of which this result has both sides."""
        return Names(self.meta.get("drives", ()), self.drive)

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
        """Unit of a key: what meta["units"] says of it, else that of `keys.KEYS`."""
        own = self.meta.get("units", {})
        if key in own or key in QUANTITIES:
            return str(own[key] if key in own else QUANTITIES[key].unit)
        return unit_of(key) or ""

    @public
    def joint(self, name: str) -> JointView:
        """Coordinates, motor torque and reaction of one joint, a universal one as a whole too."""
        names = self.meta.get("joints", ())
        if f"{name}.2" in names and name not in names:
            return JointView(self, name)
        return JointView(self, _known("joint", name, names))

    @public
    def frame(self, name: str) -> FrameView:
        """Motion of one output frame; "platform" also names the frame of meta["platform"]."""
        frames = self.meta.get("frames", ())
        if name == "platform" and name not in frames:
            name = self.meta.get("platform") or name
        return FrameView(self, _known("frame", name, frames))

    @public
    def link(self, name: str) -> LinkView:
        """Deflection, section forces and stresses along one flexible link."""
        return LinkView(self, _known("flexible link", name, self.links))

    @public
    def drive(self, name: str) -> DriveView:
        """Torque, speed and power of one drive on the motor's side and on the joint's."""
        return DriveView(self, _known("drive", name, self.drives))

    @public
    def loop(self, name: str) -> LoopView:
        """Force and moment that one loop joint carries."""
        return LoopView(self, _known("loop", name, self.loops))

    @public
    def deviation_from(self, other: Result, frame: str = "platform") -> Deviation:
        """Deviation of a frame from its pose in another run, at the same instants.

        position = p - p_other, rotation = log(R R_other'), both in the world frame.

        Args:
            other: Usually the rigid run.
            frame: Name of an output frame of both runs.
        """
        same_grid(self, other)
        theirs = other.frame(frame)
        return self.frame(frame).away_from(theirs.position, theirs.rotation)

    def worst_stress(self, kind: str = "von_mises", link: str | None = None) -> Worst:
        """Largest stress over time, sections and links.

        Args:
            kind: normal, shear, von_mises, axial or bending (largest on each section).
            link: One link only.
        """
        return worst_section(self, kind, link)

    @property
    def shaking(self) -> Array:
        """Shaking force [N] and moment about the world origin [N m] on the frame, (nt, 6)."""
        return self.fresh("shaking")

    def load_all(self) -> Result:
        """Compute every array and every entry of meta now; returns the result itself."""
        for part in (self.arrays, self.meta):
            len(part)  # of a lazy mapping it takes all of them
        return self

    def save(self, path: str | Path, compact: bool = False) -> Path:
        """Write one .npz; a file already there is replaced only by a complete one.

        Args:
            path: The file.
            compact: A sixth of the size: states, torques and forces to the last digit, fields of
                links and bodies to 5e-7 of their largest value.
        """
        path = Path(path)
        archive.write(path, archive.contents(self.t, self.arrays, self.meta, compact))
        return path

    @classmethod
    @public
    def load(cls, path: str | Path, most: float = archive.MOST) -> Result:
        """Read a file written by `save`; nothing in it is ever executed (no pickle).

        Args:
            path: The .npz. most: Largest size of all arrays together [bytes].
        """
        return cls(*archive.read(path, most))

    def to_csv(self, path: str | Path) -> Path:
        """Write one wide table: a row per instant, a unit in every header."""
        table = columns(self)
        cells = (map(repr, column.tolist()) for column in table.values())
        return write_csv(path, table, zip(*cells, strict=True))

    def summary(self) -> str:
        """The run in a few aligned lines of text."""
        return summary(self)

    @property
    def known_errors(self) -> ErrorBars | None:
        """`errors` without those that would have to be measured; None if nothing is known."""
        stored = self.meta.get("errors")
        found = self.__dict__.get("errors")
        return found if isinstance(found, ErrorBars) else ErrorBars(**stored) if stored else None

    __str__ = summary

    def to_pandas(self) -> Any:
        """The table of `to_csv` as a pandas DataFrame: index t [s], units in `attrs`."""
        return run_frame(self)

    def to_xarray(self) -> Any:
        """Every array as an xarray Dataset: time, names and places as coordinates, units.

        Keys have dots: ds["frame.platform.position"] has the dimensions (t, xyz).
        """
        return run_dataset(self)

    def plot(self, quantity: str | None = None, ax: Axes | None = None) -> Any:
        """Draw a quantity over time; returns the matplotlib axes.

        run.plot("torque"); run.plot("frame/platform"); run.plot("stress")

        Args:
            quantity: A key or its head; default: torques, else a frame or joint.
            ax: Where to draw; default: axes of a new figure.
        """
        return door("viewer.plots.axes", "plot_run")(self, quantity, ax)

    def plot_spectrum(self, quantity: str, ax: Axes | None = None, **options: Any) -> Any:
        """Draw an amplitude spectrum; returns the matplotlib axes.

        Args:
            quantity: torque/MOTOR, joint/JOINT, frame/FRAME/x, link/LINK/v, or one registered.
            ax: Where to draw; default: axes of a new figure.
            **options: after, peaks, natural, reference of `pinflex.viewer.plot.spectrum`.
        """
        return door("viewer.plots.axes", "plot_spectrum")(self, quantity, ax, **options)

    def _repr_html_(self) -> str:
        heading, *lines = self.summary().splitlines()
        cells = [(line[2:20].strip(), line[20:]) for line in lines]
        names = [("torque", ", ".join(self.motors)), ("frames", ", ".join(self.frames))]
        return card(heading, pairs([*cells, *names, ("links", ", ".join(self.links))]))

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


def _known(kind: str, name: str, names: Iterable[str]) -> str:
    names = list(names)
    if name not in names:
        raise DescriptionError(f"result: no {kind} {name!r}." + nearest(name, names), name=name)
    return name


# A result in words and as a table.


def columns(result: Result) -> dict[str, Array]:
    """Columns of the table of a run, shape (nt,) each, by header with unit."""
    table: dict[str, Array] = {"t [s]": result.t}
    for i, motor in enumerate(result.motors):
        table[f"torque {motor} [{result.unit('torque/' + motor)}]"] = result.torque[:, i]
    for motor in result.motors:
        joint = result.joint(motor)
        table[f"velocity {motor} [{result.unit('joint/v/' + motor)}]"] = joint.velocity
        table[f"acceleration {motor} [{result.unit('joint/a/' + motor)}]"] = joint.acceleration
    for name in result.meta.get("joints", ()):
        unit, position = result.unit(f"joint/q/{name}"), result.joint(name).position
        if position.ndim == 1 or position.shape[1] == 2:  # 2: cosine and sine
            unit = "rad" if position.ndim == 2 else unit
            table[f"position {name} [{unit}]"] = result.joint(name).angle
            continue
        units = unit.split(", ") if unit.count(",") == position.shape[1] - 1 else None
        for i, column in enumerate(position.T):
            table[f"position {name}[{i}] [{units[i] if units else unit}]"] = column
    if result.meta.get("platform"):
        platform = result.frame(result.meta["platform"])
        turn = rotation_vector(platform.rotation)
        for i, axis in enumerate("xyz"):
            table[f"platform {axis} [m]"] = platform.position[:, i]
        for i, axis in enumerate("xyz"):
            table[f"platform r{axis} [rad]"] = turn[:, i]
    for name in result.links:
        table[f"max von Mises {name} [Pa]"] = result.link(name).von_mises.max(axis=1)
    return table


def summary(result: Result) -> str:
    """The run in a few aligned lines of text."""
    cost, balance = result.meta.get("cost", {}), result.meta.get("energy_balance")
    rows = [("level", result.level)]
    if result.meta.get("status", "complete") != "complete":
        rows.append(("status", f"{result.meta['status']}: {result.meta.get('message', '')}"))
    rows.append(("time", f"{result.t[0]:g} to {result.t[-1]:g} s, {len(result.t)} instants"))
    if "steps" in cost:
        several = cost.get("runs", 1) > 1
        last = f" in {cost.get('runs')} runs, {cost.get('last_steps')} in the last"
        rows.append(("steps", f"{cost['steps']}{last if several else ''}"))
    if "newton" in cost:
        each = f" ({cost['newton'] / cost['steps']:.2f} a step)" if cost.get("steps") else ""
        rows.append(("Newton iterations", f"{cost['newton']}{each}"))
    rows += [("contacts", f"{len(result.events)} events (run.events)")] if result.events else []
    rows += [("wall time", f"{cost['seconds']:.3g} s")] if "seconds" in cost else []
    by = str(result.meta.get("evaluated_by", ""))
    rows += [("equations", by)] if by.startswith("numpy") else []  # not by the compiled kernel
    time, how = time_error(result.meta.get("settings", {}), result.level)
    errors = result.known_errors or ErrorBars(
        time, {}, how, "not measured (run.errors measures it)"
    )
    for line in errors.lines():
        what, _, text = line.partition(": ")
        rows.append((what, f"error {text}"))
    graded = {k: f", {word}" for k, word in result.meta.get("grades", {}).items()}
    rows.append(("worst closure", f"{result.worst_closure:.2e}{graded.get('closure', '')}"))
    known = "not computed" if balance is None else f"{balance:.2e}{graded.get('energy', '')}"
    rows.append(("energy balance", known))
    rows += [("file", str(result.meta["rounded"]))] if "rounded" in result.meta else []
    rows += [("warning", text) for text in result.meta.get("warnings", ())]
    return "\n".join([_first_line(result)] + [f"  {a:<18}{b}" for a, b in rows])


def _first_line(result: Result) -> str:
    """Its name; and a model error above the tolerance asked, where that has been looked at."""
    name, advised = str(result.meta.get("name", "result")), result.meta.get("advice")
    tol = (advised or result.meta.get("settings", {})).get("tol")
    errors = result.known_errors
    worst = None if errors is None else errors.worst()
    if worst is None or tol is None or worst[1] <= tol:
        return name
    return (
        f"{name}: the model is off by up to {percent(worst[1])} ({worst[0]}), more than "
        f"tol = {tol:g}{'' if advised else ', which bounds time integration only'}"
    )


# A run as a pandas DataFrame or an xarray Dataset, with units as attributes.

_AXES = {  # dimensions behind time, by the last word of a key
    "position": ("xyz",),
    "rotation": ("row", "column"),
    "velocity": ("twist",),
    "acceleration": ("twist",),
    "wrench": ("component",),
}
_LABELS = {
    "xyz": list(quantities.XYZ),
    "twist": list(quantities.TWIST),
    "component": list(quantities.WRENCH),
    "displacement": list(quantities.BENT),
    "resultant": list(quantities.SECTION),
}
_FIELDS = {"deflection": ("displacement",), "resultant": ("resultant",)}
_FIELDS |= dict.fromkeys(("centreline", "centreline_rigid", "section_y"), ("xyz",))


def run_frame(result: Result) -> Any:
    """The wide table of a run: one row for each instant."""
    pandas = library("pandas", "to_pandas")
    table = columns(result)
    heads = {head: head.rpartition(" [") for head in table}
    frame = pandas.DataFrame({heads[head][0]: values for head, values in table.items()})
    frame.attrs["units"] = {name: unit.rstrip("]") for name, _, unit in heads.values()}
    frame.attrs |= {"name": str(result.meta.get("name", "")), "level": result.level}
    return frame.set_index("t")


def run_dataset(result: Result) -> Any:
    """Every array of a run by its key, with a dot for every slash."""
    xarray = library("xarray", "to_xarray")
    variables: dict[str, Any] = {}
    labels: dict[str, Any] = {"t": ("t", result.t, {"units": "s"})}
    for key, values in result.arrays.items():
        name = key.replace("/", ".")
        if key.startswith("link/") and key.endswith("/x"):
            place = name.removesuffix(".x")
            labels[place] = (place, values, {"units": "m"})
            continue
        dims = _dimensions(key, values.shape)
        labels |= {d: _LABELS[d] for d in dims if d in _LABELS}
        if key == "torque":
            labels["motor"] = list(result.motors)
        unit = result.unit(key)
        variables[name] = (dims, values, {"units": unit} if unit else {})
    about = {"name": str(result.meta.get("name", "")), "level": result.level}
    return xarray.Dataset(variables, labels, about)


def _dimensions(key: str, shape: tuple[int, ...]) -> tuple[str, ...]:
    """Names of the dimensions of an array; of one not known, numbered after its key."""
    parts = key.split("/")
    if key == "torque":
        return ("t", "motor")
    fallback = tuple(f"{'.'.join(parts)}.{k}" for k in range(1, len(shape)))
    if parts[0] == "link" and len(parts) > 2:
        if "mesh" in parts:
            return _of_mesh(parts, shape)
        dims = ("t", f"link.{parts[1]}", *_FIELDS.get(parts[2], ()))
        return dims if len(shape) == len(dims) else ("t", *fallback)
    if parts[0] in ("frame", "loop") and len(_AXES.get(parts[-1], ())) == len(shape) - 1:
        return ("t", *_AXES[parts[-1]])
    return ("t", *fallback)


def _of_mesh(parts: list[str], shape: tuple[int, ...]) -> tuple[str, ...]:
    """Numbered dimensions of a mesh, whose nodes and triangles have no time."""
    first = () if parts[-1] in ("nodes", "triangles") else ("t",)
    name = ".".join(parts)
    return (*first, *(f"{name}.{k}" for k in range(len(first), len(shape))))
