"""Checks of a stored run before it is used: its file may be damaged or made by another program.

Only what is there is checked; what a reader needs and does not find it names itself.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.schema import shown
from pinflex.errors import DescriptionError

MOST = 2e9  # [bytes] of arrays that are read without asking

# Kinds of the values in meta: a type, [kind of each] or {name: kind} (None: any name).
_NUMBER = (int, float)
_JOINT = {"kind": str, "parent": str, "child": str, "origin": [_NUMBER], "axis": [_NUMBER]}
_VISUAL = {"file": str, "shape": str, **{k: [_NUMBER] for k in ("size", "scale", "rpy", "xyz")}}
_META: dict[str, Any] = {
    "name": str,
    "level": str,
    "status": str,
    "message": str,
    "evaluated_by": str,
    "joints": [str],
    "coordinates": [str],
    "actuated": [str],
    "frames": [str],
    "warnings": [str],
    "limits": [str],
    "gravity": [_NUMBER],
    "loops": [{"name": str, "kind": str, "between": [str], "rows": [str], "redundant": [str]}],
    "joint_index": {None: [int]},
    "settings": {None: object},
    "monitors": {None: {None: object}},
    "cost": {None: _NUMBER},
    "units": {None: str},
    "sources": {None: str},
    "versions": {None: str},
    "drives": {
        None: {"gear": _NUMBER, "efficiency": _NUMBER, "limit_curve": [[_NUMBER]]},
    },
    "drawing": {"joints": {None: _JOINT}, "visuals": {None: [_VISUAL]}},
    "bodies": {None: {"points": [[_NUMBER]], "mass": _NUMBER, "radius": _NUMBER}},
    "links": {
        None: {
            "length": _NUMBER,
            "mass": _NUMBER,
            "section": {"outline": [[_NUMBER]], "fibres": [[_NUMBER]], "shape": str},
            "material": {"E": _NUMBER, "G": _NUMBER, "name": str},
            "frame": [[_NUMBER]],
            "origin": [_NUMBER],
            "planes": [str],
            "reason": str,
            "basis": str,
        }
    },
}
_NEEDED = {"section", "length", "material"}  # of a link


def require_size(path: Path, most: float) -> None:
    """Raise where an archive says of itself that its arrays are larger than `most` [bytes]."""
    with zipfile.ZipFile(path) as archive:
        size = sum(member.file_size for member in archive.infolist())
    if size > most:
        raise DescriptionError(
            f"{path}: holds {size / 1e9:.3g} GB of arrays in {path.stat().st_size / 1e9:.3g} GB; "
            f"{most / 1e9:g} GB are read without asking. Allow more with --limit, or "
            "Result.load(path, most=BYTES).",
            path=path,
        )


def check(meta: Any, arrays: Mapping[str, Array], t: Array) -> None:
    """Raise where names, settings or shapes of a stored run cannot be what `save` wrote."""
    if not isinstance(meta, dict):
        raise _wrong("meta", meta)
    for key, kind in _META.items():
        if key in meta:
            _fit(meta[key], kind, f"meta.{key}")
    platform = meta.get("platform")
    if platform is not None and not isinstance(platform, str):
        raise _wrong("meta.platform", platform)
    for name, link in meta.get("links", {}).items():
        for key in sorted(_NEEDED - link.keys()):
            raise _wrong(f"meta.links.{name}.{key}", None)
    _check_drawing(meta.get("drawing", {}))
    _check_joints(meta.get("joint_index", {}), arrays)
    _check_shapes(meta, arrays, len(t))


def _check_drawing(drawing: Mapping[str, Any]) -> None:
    """Joints and visuals have all their keys, and three numbers where a vector is."""
    joints = [(f"joints.{name}", x) for name, x in drawing.get("joints", {}).items()]
    visuals = [
        (f"visuals.{link}[{k}]", x)
        for link, every in drawing.get("visuals", {}).items()
        for k, x in enumerate(every)
    ]
    for found, kinds in ((joints, _JOINT), (visuals, _VISUAL)):
        for where, x in found:
            for key, kind in kinds.items():
                vector = isinstance(kind, list) and key != "size"
                if key not in x or (vector and len(x[key]) != 3):
                    raise _wrong(f"meta.drawing.{where}.{key}", x.get(key))


def _check_joints(index: Mapping[str, list[int]], arrays: Mapping[str, Array]) -> None:
    """Columns [iq, nq, iv, nv] of each joint are there."""
    sizes = {}
    for key in ("joint/q", "joint/v"):
        array = arrays.get(key)
        sizes[key] = array.shape[1] if array is not None and array.ndim == 2 else 0
    for name, at in index.items():
        fits = len(at) == 4 and min(at) >= 0
        if not fits or at[0] + at[1] > sizes["joint/q"] or at[2] + at[3] > sizes["joint/v"]:
            raise _wrong(f"meta.joint_index.{name}", at)


def _check_shapes(meta: Mapping[str, Any], arrays: Mapping[str, Array], nt: int) -> None:
    """Torques and frames have the shapes that their names ask for."""
    wanted: dict[str, tuple[int, ...]] = {"torque": (nt, len(meta.get("actuated", ())))}
    for name in meta.get("frames", ()):
        wanted[f"frame/{name}/position"] = (nt, 3)
        wanted[f"frame/{name}/rotation"] = (nt, 3, 3)
    for key, shape in wanted.items():
        if key in arrays and arrays[key].shape != shape:
            raise _wrong(key, f"shape {arrays[key].shape} instead of {shape}")


def _fit(value: Any, kind: Any, where: str) -> None:
    if isinstance(kind, list):
        if not isinstance(value, list):
            raise _wrong(where, value)
        for k, item in enumerate(value):
            _fit(item, kind[0], f"{where}[{k}]")
    elif isinstance(kind, dict):
        if not isinstance(value, dict):
            raise _wrong(where, value)
        for key, item in value.items():
            _fit(item, kind.get(key, kind.get(None, object)), f"{where}.{key}")
    elif (
        not isinstance(value, kind)
        or (kind is int and isinstance(value, bool))
        or (kind is _NUMBER and not np.isfinite(value))
    ):
        raise _wrong(where, value)


def _wrong(where: str, value: Any) -> DescriptionError:
    return DescriptionError(
        f"{where}: {shown(value)} is not what a run has there. The file was changed or comes from "
        "another program: repeat the run that wrote it."
    )
