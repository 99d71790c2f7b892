"""File of a result: an .npz in which only arrays that shrink are compressed."""

from __future__ import annotations

import json
import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError
from pinflex.results import checked
from pinflex.results.compact import FIELDS, ROUNDED, decoded, encode
from pinflex.writing import replaced

FORMAT = 2  # that this pinflex reads: 1 has plain arrays, 2 those of `compact`
HEADER = "pinflex"  # the npz member that says whose file it is, and holds meta
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
_SAMPLE = 1 << 15  # bytes tried of each array
_CODED = 4  # level of deflate: that of zlib's default takes half as long again for 1 % less
_WORTH = 0.75  # digits of a motion shrink to 0.85 at most, for a second of a run's ten


def write_arrays(stream: IO[bytes], arrays: Mapping[str, Array]) -> None:
    """Write an archive that `numpy.load` reads."""
    with zipfile.ZipFile(stream, "w", compresslevel=1) as archive:
        for name, array in arrays.items():
            coded = array.dtype == np.uint8  # of `compact`: made to shrink
            kind = zipfile.ZIP_DEFLATED if coded or _shrinks(array) else zipfile.ZIP_STORED
            archive.compression, archive.compresslevel = kind, _CODED if coded else 1
            with archive.open(f"{name}.npy", "w", force_zip64=True) as part:
                if coded and name.partition("/")[0] in FIELDS:
                    _by_runs(part)
                np.lib.format.write_array(part, np.asanyarray(array), allow_pickle=False)


def _by_runs(part: Any) -> None:
    """Look for runs of equal bytes alone in what is written to a member of an archive.

    Of fields that is all that their high bytes have, and their low bytes have nothing: it takes
    two fifths of the time for 2 % more bytes. zipfile has no argument for it; where its writer
    keeps the compressor elsewhere, that stays as it is.
    """
    if hasattr(part, "_compressor"):
        part._compressor = zlib.compressobj(1, wbits=-zlib.MAX_WBITS, strategy=zlib.Z_RLE)


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
            checked.require_size(path, most)
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
        checked.check(header["meta"], arrays, np.atleast_1d(t))
        return t, arrays, header["meta"]
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
