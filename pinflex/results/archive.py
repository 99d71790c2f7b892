"""Arrays written as an .npz in which only those that shrink are compressed."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from typing import IO

import numpy as np

from pinflex.arrays import Array

_SAMPLE = 1 << 15  # bytes tried of each array
_WORTH = 0.75  # digits of a motion shrink to 0.85 at most, for a second of a run's ten


def write_arrays(stream: IO[bytes], arrays: Mapping[str, Array]) -> None:
    """Write an archive that `numpy.load` reads.

    Args:
        stream: A binary file.
        arrays: By name.
    """
    with zipfile.ZipFile(stream, "w", compresslevel=1) as archive:
        for name, array in arrays.items():
            archive.compression = zipfile.ZIP_DEFLATED if _shrinks(array) else zipfile.ZIP_STORED
            with archive.open(f"{name}.npy", "w", force_zip64=True) as part:
                np.lib.format.write_array(part, np.asanyarray(array), allow_pickle=False)


def _shrinks(array: Array) -> bool:
    flat = np.asanyarray(array).reshape(-1)
    count = max(_SAMPLE // max(flat.itemsize, 1), 1)
    middle = max((flat.size - count) // 2, 0)
    sample = flat[middle : middle + count].tobytes()
    return len(zlib.compress(sample, 1)) < _WORTH * len(sample)
