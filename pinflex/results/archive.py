"""File of a result: an .npz in which only arrays that shrink are compressed."""

from __future__ import annotations

import json
import math
import os
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array
from pinflex.description.reading.schema import shown
from pinflex.errors import DescriptionError
from pinflex.writing import replaced

# Arrays of a run as few bytes: states to the last digit, fields of links and bodies to 5e-7.
#
# Motion is smooth in time, and a beam along its axis, so that second differences are small: their
# high bytes, gathered, deflate to almost nothing. A field is kept in steps of a millionth of the
# largest value of each component. One that has a rigid counterpart is kept by its difference from
# that, so that a displacement of a micrometre in a robot of a metre stays as fine; of a state the
# bits themselves are differenced, and nothing is lost.

STEPS = 2**20  # of the largest magnitude of a component: an error of half a step is 4.8e-7 of it
FINE = 2**24  # of the rigid counterparts: a short link stays straight; differences fit 32 bits
ROUNDED = "fields of links and bodies are kept to 5e-7 of the largest value of each component"
FIELDS = ("link", "body")  # heads of keys that follow from the states
_PLAIN = ("x", "nodes", "triangles")  # of a link, without time

Bytes = npt.NDArray[np.uint8]
Codes = npt.NDArray[Any]


def encode(
    arrays: Mapping[str, Array], read: dict[str, Array] | None = None
) -> tuple[dict[str, Array | Bytes], dict[str, Any]]:
    """What to write of each array, and how to read back those that are not as they were."""
    members: dict[str, Array | Bytes] = {}
    coded: dict[str, Any] = {}
    exact: dict[str, Array] = {}
    for key, values in arrays.items():
        head, _, rest = key.partition("/")
        name = rest.rpartition("/")[2]
        if not values.size or values.ndim < 1 or (head == "link" and name in _PLAIN):
            members[key] = exact[key] = values
        elif head in FIELDS and np.all(np.isfinite(values)):
            along = head == "link" and "/mesh/" not in key and values.ndim > 1
            rigid = arrays.get(f"{key}_rigid")
            if rigid is not None:
                values = values - rigid
            step = _step(values, FINE if key.endswith("_rigid") else STEPS)
            rounded = values / step
            codes = np.rint(rounded, out=rounded).astype(np.int32)
            for axis in (0, 0, 1, 1) if along else (0, 0):  # of a beam's fields along it too
                codes = differences(codes, axis)
            members[key] = by_significance(codes)
            coded[key] = {"shape": list(values.shape), "step": step.tolist(), "along": along}
            coded[key] |= {} if rigid is None else {"beside": f"{key}_rigid"}
            if read is not None:
                read[key] = np.multiply(rounded, step, out=rounded)
        else:
            exact[key] = values
            bits = np.ascontiguousarray(values, np.float64).view(np.int64)
            members[key] = by_significance(differences(bits))
            coded[key] = {"shape": list(values.shape)}
    if read is not None:
        read |= exact | _with_rigid(read, coded)
    return members, coded


def decoded(stored: Mapping[str, Any], coded: Mapping[str, Any]) -> dict[str, Array]:
    """The arrays of a file."""
    arrays = {key: decode(key, stored[key], coded[key]) if key in coded else stored[key]
              for key in stored}  # fmt: skip
    return arrays | _with_rigid(arrays, coded)


def _with_rigid(arrays: Mapping[str, Array], coded: Mapping[str, Any]) -> dict[str, Array]:
    """Arrays that are kept by their difference from a rigid counterpart."""
    own = {key: how["beside"] for key, how in coded.items() if "beside" in how}
    return {key: arrays[key] + arrays[beside] for key, beside in own.items()}


def decode(key: str, stored: npt.NDArray[Any], how: Mapping[str, Any]) -> Array:
    """An array that `encode` wrote."""
    shape, field = tuple(int(n) for n in how["shape"]), "step" in how
    width = 4 if field else 8
    if stored.dtype != np.uint8 or stored.size != width * math.prod(shape) or not shape:
        raise DescriptionError(f"{key}: {stored.size} bytes are not an array of shape {shape}")
    codes = _codes(stored, shape, width)
    if not field:
        return np.cumsum(codes, axis=0, dtype=np.int64).view(np.float64)
    for axis in (1, 1, 0, 0) if how["along"] else (0, 0):
        codes = np.cumsum(codes, axis=axis, dtype=np.int32)
    return np.asarray(codes * np.asarray(how["step"], np.float64))


def _step(values: Array, count: int) -> Array:
    """Size of a step of each component, broadcast over the others; components are the last axis."""
    largest = np.abs(values.reshape(len(values), -1)).max(axis=0)  # over time: long rows
    components = values.shape[-1] if values.ndim > 2 else 1
    largest = largest.reshape(-1, components).max(axis=0)
    step = np.where(largest > 0, largest / count, 1.0)
    return step.reshape(*[1] * (values.ndim - 1), components)


def differences(codes: Codes, axis: int = 0) -> Codes:
    """Differences of entries in a row along an axis; the first stays as it is."""
    codes = codes.swapaxes(0, axis)
    found = np.empty_like(codes)
    found[:1] = codes[:1]
    np.subtract(codes[1:], codes[:-1], out=found[1:])
    return found.swapaxes(0, axis)


def by_significance(codes: Codes) -> Bytes:
    """Integers with the sign in the last bit, byte by byte of significance, series after series."""
    width = codes.dtype.itemsize
    folded = (codes << 1) ^ (codes >> (8 * width - 1))  # 0, -1, 1, -2, ... as 0, 1, 2, 3, ...
    series = np.ascontiguousarray(folded.reshape(len(codes), math.prod(codes.shape[1:])).T)
    found = np.empty((width, *series.shape), np.uint8)
    for k, place in enumerate(found):
        np.right_shift(series, 8 * k, out=place, casting="unsafe")  # its last byte
    return found.reshape(-1)


def _codes(stored: Bytes, shape: tuple[int, ...], width: int) -> Codes:
    flat = np.ascontiguousarray(stored.reshape(width, -1).T).reshape(-1).view(f"<u{width}")
    kind = np.int32 if width == 4 else np.int64
    sign = np.negative((flat & 1).astype(kind))
    unfolded = np.bitwise_xor((flat >> 1).astype(kind), sign)
    return np.ascontiguousarray(unfolded.reshape(-1, shape[0]).T).reshape(shape)


# Checks of a stored run before it is used: its file may be damaged or made by another program.
#
# Only what is there is checked; what a reader needs and does not find it names itself.

MOST = 2e9  # [bytes] of arrays that are read without asking

# Kinds of the values in meta: a type, [kind of each], [kinds one by one] or {name: kind} (None: any
# name).
_NUMBER = (int, float)
_PLACE = [_NUMBER] * 3


class _Whole(dict[str, Any]):
    """Kinds of a mapping that has all of these keys."""


_JOINT = _Whole(kind=str, parent=str, child=str, origin=_PLACE, axis=_PLACE)
_VISUAL = _Whole(file=str, shape=str, size=[_NUMBER], scale=_PLACE, rpy=_PLACE, xyz=_PLACE)
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
            _require_kind(meta[key], kind, f"meta.{key}")
    platform = meta.get("platform")
    if platform is not None and not isinstance(platform, str):
        raise _wrong("meta.platform", platform)
    for name, link in meta.get("links", {}).items():
        for key in sorted(_NEEDED - link.keys()):
            raise _wrong(f"meta.links.{name}.{key}", None)
    _check_joints(meta.get("joint_index", {}), arrays)
    _check_shapes(meta, arrays, len(t))


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
        if key in arrays and shape[1:] == (3, 3):
            _check_rotations(key, arrays[key])


def _check_rotations(key: str, R: Array) -> None:
    """No matrix is mirrored, stretched or empty: its determinant is 1."""
    with np.errstate(over="ignore", invalid="ignore"):
        volume = np.sum(np.cross(R[:, 0], R[:, 1]) * R[:, 2], axis=1)
        # compact files hold a rotation to 5e-7; nothing that a run writes is off by a thousandth
        wrong = np.flatnonzero(~(np.abs(volume - 1.0) < 1e-3))
    if len(wrong):
        raise _wrong(f"{key}[{wrong[0]}]", f"a matrix of determinant {volume[wrong[0]]:.3g}")


def _require_kind(value: Any, kind: Any, where: str) -> None:
    if isinstance(kind, list):
        if not isinstance(value, list) or len(kind) not in (1, len(value)):
            raise _wrong(where, value)
        for k, item in enumerate(value):
            _require_kind(item, kind[0], f"{where}[{k}]")
    elif isinstance(kind, dict):
        if not isinstance(value, dict):
            raise _wrong(where, value)
        for key in kind.keys() - value.keys() if isinstance(kind, _Whole) else ():
            raise _wrong(f"{where}.{key}", None)
        for key, item in value.items():
            _require_kind(item, kind.get(key, kind.get(None, object)), f"{where}.{key}")
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


FORMAT = 2  # that this pinflex reads: 1 has plain arrays, 2 those of `compact`
HEADER = "pinflex"  # the npz member that says whose file it is, and holds meta
_SAMPLE = 1 << 13  # bytes tried of each array
_WORTH = 0.75  # digits of a motion shrink to 0.85 at most, for a second of a run's ten


def write_arrays(stream: IO[bytes], arrays: Mapping[str, Array]) -> None:
    """Write an archive that `numpy.load` reads."""
    with zipfile.ZipFile(stream, "w", compresslevel=1) as archive:
        for name, array in arrays.items():
            coded = array.dtype == np.uint8  # of `compact`: made to shrink
            kind = zipfile.ZIP_DEFLATED if coded or _shrinks(array) else zipfile.ZIP_STORED
            archive.compression = kind
            with archive.open(f"{name}.npy", "w", force_zip64=True) as part:
                np.lib.format.write_array(part, np.asanyarray(array), allow_pickle=False)


def contents(
    t: Array,
    arrays: Mapping[str, Array],
    meta: Mapping[str, Any],
    compact: bool,
    read: dict[str, Array] | None = None,
) -> dict[str, Any]:
    """Members of the file of a run."""
    header: dict[str, Any] = {"program": "pinflex", "format": 1, "meta": dict(meta)}
    members: Mapping[str, Any] = arrays
    if compact:
        members, coded = encode(arrays, read)
        header |= {"format": FORMAT, "coded": coded}
        header["meta"] |= {"rounded": ROUNDED}
    elif read is not None:
        read |= arrays
    return {HEADER: np.array(json.dumps(header)), "t": t, **members}


def meta_of(members: Mapping[str, Any]) -> dict[str, Any]:
    """Names and settings as a file of these members has them."""
    meta: dict[str, Any] = json.loads(str(members[HEADER]))["meta"]
    return meta


def write(path: Path, members: Mapping[str, Any]) -> None:
    """Write a file; one that is there is replaced only by a complete one."""
    with replaced(path) as part, part.open("wb") as stream:
        write_arrays(stream, members)


def _shrinks(array: Array) -> bool:
    flat = np.asanyarray(array).reshape(-1)
    count = max(_SAMPLE // max(flat.itemsize, 1), 1)
    middle = max((flat.size - count) // 2, 0)
    sample = flat[middle : middle + count].tobytes()
    return len(zlib.compress(sample, 1)) < _WORTH * len(sample)


def read(path: str | Path, most: float) -> tuple[Array, dict[str, Array], dict[str, Any]]:
    """Instants, arrays and meta of a file; nothing in it is ever executed (no pickle)."""
    if not isinstance(path, (str, Path)):
        raise DescriptionError(f"result: {path!r:.80} is no path. Give that of a .npz.")
    path = Path(path)
    remake = "Give a file written by `pinflex solve -o` or Result.save."
    if not os.path.isfile(path):  # False for a name that is too long, too
        raise DescriptionError(f"{path}: no such result file. {remake}", path=path)
    try:
        with path.open("rb") as stream:
            if stream.read(4) != b"PK\x03\x04":
                raise DescriptionError(f"{path}: not an .npz archive. {remake}", path=path)
            require_size(path, most)
            stream.seek(0)
            npz = np.load(stream, allow_pickle=False)
            if HEADER not in npz.files:
                raise DescriptionError(
                    f"{path}: an .npz of another program (no {HEADER!r} header). {remake}",
                    path=path,
                )
            header = json.loads(str(npz[HEADER]))
            if int(header["format"]) > FORMAT:
                raise DescriptionError(
                    f"{path}: result format {header['format']}, this pinflex reads up to "
                    f"{FORMAT}. Update pinflex, or solve again with this version.",
                    path=path,
                )
            coded = header.get("coded", {})
            arrays = decoded({key: npz[key] for key in npz.files if key != HEADER}, coded)
        t = arrays.pop("t")
        check(header["meta"], arrays, np.atleast_1d(t))
        return t, arrays, header["meta"]
    except DescriptionError as error:
        if str(path) in str(error):
            raise
        raise DescriptionError(f"{path}: {error}", path=path) from None
    except Exception as error:  # what a wrong byte makes zipfile, zlib, numpy or json raise
        raise DescriptionError(
            f"{path}: truncated or damaged ({type(error).__name__}: {error}). "
            "Copy the file again, or repeat the run that wrote it.",
            path=path,
        ) from error
