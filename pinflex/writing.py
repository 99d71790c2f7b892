"""Writing files whole or not at all, to regular files only, and of values that JSON knows."""

from __future__ import annotations

import contextlib
import csv
import math
import os
import stat
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from pinflex.errors import DescriptionError

_FAR = 2**30  # byte that stands for a whole file


def writable(path: str | Path | None) -> None:
    """Raise before a long run if its file cannot be written."""
    if path is None:
        return
    import tempfile

    try:
        target = _target(Path(path))
        with tempfile.TemporaryFile(dir=target.parent):
            pass
    except OSError as error:
        raise _unwritable(Path(path), error) from error


@contextmanager
def replaced(path: str | Path) -> Iterator[Path]:
    """A file beside `path` to write; it takes the place of `path` once it is complete.

    What was there before stays where writing fails. A link is followed; what is no regular file (a
    device, a pipe) is refused, as the new file would take its place.
    """
    try:
        target = _target(Path(path))
        part = target.with_name(f".{target.stem[:100]}.{os.getpid()}.part{target.suffix[:20]}")
    except OSError as error:
        raise _unwritable(Path(path), error) from error
    try:
        yield part
        if target.exists():
            os.chmod(part, stat.S_IMODE(target.stat().st_mode))
        part.replace(target)
    except OSError as error:
        raise _unwritable(Path(path), error) from error
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


def lock(stream: IO[bytes]) -> bool:
    """Keep every other process from locking an open file until it is closed; False if one has.

    Each system has its own lock: on Windows that of one byte, far behind what is written.
    """
    try:
        if sys.platform == "win32":
            import msvcrt

            stream.seek(_FAR)
            msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def write_text(path: str | Path, text: str) -> Path:
    """Write a text whole, in UTF-8 and with the line ends that it has."""
    with replaced(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")
    return Path(path)


def write_csv(path: str | Path, header: Iterable[str], rows: Iterable[Iterable[str]]) -> Path:
    """Write a table whole."""
    with replaced(path) as part, part.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([_as_text(cell) for cell in row] for row in [header, *rows])
    return Path(path)


def _as_text(cell: str) -> str:
    """A cell that a spreadsheet would compute (= + - @ first, and no number) marked as text."""
    if not cell.startswith(("=", "+", "-", "@", "\t", "\r")):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


def _target(path: Path) -> Path:
    """Resolve a path and make its folder; only a regular file may be there already."""
    if path.is_dir():
        raise DescriptionError(f"{path}: is a folder. Give the name of a file in it.")
    try:
        target = path.resolve()
    except RuntimeError:  # a link that leads to itself
        target = path
    if (target.exists() or target.is_symlink()) and not target.is_file():
        raise DescriptionError(
            f"{path}: is no regular file (a device, a pipe or a link to nowhere) and would be "
            "replaced by one. Give another name."
        )
    target.parent.mkdir(parents=True, exist_ok=True)
    return target


def _unwritable(path: Path, error: OSError) -> DescriptionError:
    return DescriptionError(
        f"{path}: cannot be written ({error.strerror or error}). Choose a folder you may write to."
    )


def plain(value: Any, finite: bool = True) -> Any:
    """Values as JSON has them.

    Raises:
        TypeError: Anything else.
    """
    if type(value) is float:  # most of a long table
        return value if not finite or math.isfinite(value) else None
    if isinstance(value, (list, tuple)):
        return [plain(v, finite) for v in value]
    if isinstance(value, np.generic | np.ndarray):
        return plain(value.tolist(), finite)
    if isinstance(value, float):
        return value if not finite or math.isfinite(value) else None
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, Mapping):
        return {str(k): plain(v, finite) for k, v in value.items()}
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"a {type(value).__name__} ({value!r}) is not plain data")
