"""Result of a run: arrays, names and source texts, read by name, kept in one file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.errors import DescriptionError, nearest
from pinflex.names import Names
from pinflex.results import archive
from pinflex.results import summary as report
from pinflex.results.drives import DriveView
from pinflex.results.error_bars import ErrorBars, time_error
from pinflex.results.lazy import Late, plain_meta, read_only, timed
from pinflex.results.quantities import QUANTITIES, unit_of
from pinflex.results.summary import Display
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
from pinflex.text import short
from pinflex.writing import write_csv

__all__ = ["Deviation", "Result", "peak", "rms", "same_grid"]


# What people write for an attribute of a run, and what is meant.
_MEANT = {
    **{"time": "t", "times": "t", "tau": "torque", "torques": "torque", "q": 'array("joint/q")'},
    **{"warnings": 'meta["warnings"]', "stress": 'link("NAME").von_mises'},
}
_OF_FRAMES = ("platform", "position", "pose", "tool", "tip", "end_effector")


@dataclass(frozen=True)
class Result(Display):
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
        table = report.columns(self)
        cells = (map(repr, column.tolist()) for column in table.values())
        return write_csv(path, table, zip(*cells, strict=True))

    def summary(self) -> str:
        """The run in a few aligned lines of text."""
        return report.summary(self)

    @property
    def known_errors(self) -> ErrorBars | None:
        """`errors` as far as they are known without measuring."""
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


def _known(kind: str, name: str, names: Iterable[str]) -> str:
    names = list(names)
    if name not in names:
        raise DescriptionError(f"result: no {kind} {name!r}." + nearest(name, names), name=name)
    return name
