"""Finding the file of the key `urdf`, and the readers of its formats by suffix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from pinflex import registered
from pinflex.description import urdf
from pinflex.description.files import MOST_TEXT, require_regular
from pinflex.description.source import Source
from pinflex.errors import DescriptionError, ModelNotFoundError, nearest

# Text, file name and package folders of a file to what is in it.
Reader = Callable[[str, str, tuple[str, ...]], Source]
READERS: dict[str, Reader] = {".urdf": urdf.check}
_ROBOT_DATA = "example-robot-data:"


def register(suffix: str, reader: Reader) -> None:
    """Add an input format; from then on `urdf: NAME.suffix` is read by its reader.

    Args:
        suffix: Ending of its files, as in ".urdf".
        reader: From text, file name and package folders to a `Source`, whose `text` is URDF.
    Raises:
        DescriptionError: The suffix is none, or taken.
    """
    if not suffix.startswith(".") or len(suffix) < 2 or suffix != suffix.lower():
        raise DescriptionError(f"source {suffix!r}: Give a suffix in lower case, as in .urdf.")
    if suffix in READERS:
        raise DescriptionError(f"source {suffix}: there is a reader of it. Choose another suffix.")
    READERS[suffix] = reader
    registered.note(register, suffix, suffix, reader)


def read(text: str, file: str, package_dirs: tuple[str, ...] = ()) -> Source:
    """The contents of a robot's file by the reader of its suffix; of any other suffix as URDF."""
    reader = READERS.get(Path(file).suffix.lower(), urdf.check)
    source = reader(text, file, package_dirs)
    # The name says what the text is now, so that it can be read again.
    return source if reader is urdf.check else replace(source, file=f"{file}.urdf")


def find(source: str, folder: Path, where: str) -> Source:
    """Read and check the file of the key `urdf`.

    Args:
        source: A file, relative to `folder`, or "example-robot-data:NAME".
        folder: Folder of the YAML.
        where: Place of the key, for messages.
    """
    if source.startswith(_ROBOT_DATA):
        path, packages = _robot_data(source[len(_ROBOT_DATA) :].strip(), where)
        return read(read_text(path, where), path.name, packages)
    path = folder / source
    if not path.is_file():
        found = [p.name for p in sorted(folder.glob("*.urdf"))]
        raise ModelNotFoundError(
            f'{where}: no file "{source}" beside the YAML.{nearest(source, found)} Give a path '
            f"relative to the YAML, or {_ROBOT_DATA}NAME."
        )
    packages = tuple(dict.fromkeys((str(path.parent.resolve()), str(folder.resolve()))))
    return read(read_text(path, where), path.name, packages)


def read_text(path: Path, where: str) -> str:
    """The text of a file that must be readable UTF-8."""
    require_regular(path, MOST_TEXT, f"{where}: {path.name}")
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DescriptionError(
            f"{where}: {path.name} is not UTF-8 text (byte {error.start}). Save it as UTF-8."
        ) from None
    except OSError as error:
        raise DescriptionError(f"{where}: cannot read {path.name}: {error.strerror}.") from None


def _robot_data(name: str, where: str) -> tuple[Path, tuple[str, ...]]:
    """Path of a robot of the package example-robot-data, without loading its meshes."""
    try:
        from example_robot_data import (  # type: ignore[import-not-found,import-untyped,unused-ignore]
            ROBOTS,
            getModelPath,
        )
    except ImportError:
        raise DescriptionError(
            f'{where}: "{_ROBOT_DATA}{name}" needs the package example-robot-data-loaders, which '
            "is not installed. Run `pip install example-robot-data-loaders`, or give a URDF file."
        ) from None
    if name not in ROBOTS:
        raise ModelNotFoundError(
            f'{where}: no robot "{name}" in example-robot-data.{nearest(name, sorted(ROBOTS))}'
        )
    loader = ROBOTS[name]
    if not loader.urdf_filename:
        raise DescriptionError(
            f'{where}: the robot "{name}" of example-robot-data is an SDF, not a URDF. Choose '
            "another, or convert it."
        )
    part = f"{loader.path}/{loader.urdf_subpath}/{loader.urdf_filename}"
    try:
        root = Path(loader.model_path or getModelPath(part))
    except OSError:
        raise DescriptionError(
            f'{where}: the files of the robot "{name}" are missing. Install example-robot-data.'
        ) from None
    return root / part, (str((root / "../..").resolve()),)
