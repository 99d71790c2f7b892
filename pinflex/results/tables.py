"""A run as a pandas DataFrame or an xarray Dataset, with units as attributes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pinflex.doors import library
from pinflex.results import keys, report

if TYPE_CHECKING:
    from pinflex.results.result import Result

_AXES = {  # dimensions behind time, by the last word of a key
    "position": ("xyz",),
    "rotation": ("row", "column"),
    "velocity": ("twist",),
    "acceleration": ("twist",),
    "wrench": ("component",),
}
_LABELS = {
    "xyz": list(keys.XYZ),
    "twist": list(keys.TWIST),
    "component": list(keys.WRENCH),
    "displacement": list(keys.BENT),
    "resultant": list(keys.SECTION),
}
_FIELDS = {"deflection": ("displacement",), "resultant": ("resultant",)}
_FIELDS |= dict.fromkeys(("centreline", "centreline_rigid", "section_y"), ("xyz",))


def run_frame(result: Result) -> Any:
    """The wide table of a run: one row for each instant."""
    pandas = library("pandas", "to_pandas")
    table = report.columns(result)
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
