"""A result in words and as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from pinflex.arrays import Array
from pinflex.doors import door, library
from pinflex.report import card, pairs
from pinflex.results import quantities
from pinflex.results.error_bars import ErrorBars, time_error
from pinflex.rotations import rotation_vector
from pinflex.text import percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pinflex.results.result import Result


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


# How a result is shown: figures, tables of other libraries, the card of a notebook.


class Display:
    """What a Result offers to look at it."""

    def to_pandas(self) -> Any:
        """The table of `to_csv` as a pandas DataFrame: index t [s], units in `attrs`."""
        return run_frame(cast("Result", self))

    def to_xarray(self) -> Any:
        """Every array as an xarray Dataset: time, names and places as coordinates, units.

        Keys have dots: ds["frame.platform.position"] has the dimensions (t, xyz).
        """
        return run_dataset(cast("Result", self))

    def plot(self, quantity: str | None = None, ax: Axes | None = None) -> Any:
        """Draw a quantity over time; returns the matplotlib axes.

        run.plot("torque"); run.plot("frame/platform"); run.plot("stress")
        """
        return door("viewer.plots.axes", "plot_run")(self, quantity, ax)

    def plot_spectrum(self, quantity: str, ax: Axes | None = None, **options: Any) -> Any:
        """Draw an amplitude spectrum; returns the matplotlib axes."""
        return door("viewer.plots.axes", "plot_spectrum")(self, quantity, ax, **options)

    def _repr_html_(self) -> str:
        run = cast("Result", self)
        heading, *lines = summary(run).splitlines()
        cells = [(line[2:20].strip(), line[20:]) for line in lines]
        names = [("torque", ", ".join(run.motors)), ("frames", ", ".join(run.frames))]
        names.append(("links", ", ".join(run.links)))
        return card(heading, pairs([*cells, *names]))
