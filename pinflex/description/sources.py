"""Finding the file of the key `urdf`, and the readers of its formats by suffix.

The readers of formats other than URDF are imported when a file asks for one.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path

from pinflex import registered
from pinflex.description.files import MOST_TEXT, Source, nameable, require_regular
from pinflex.description.robots import urdf
from pinflex.errors import DescriptionError, ModelNotFoundError, nearest

# Text, file name and package folders of a file to what is in it.
Reader = Callable[[str, str, tuple[str, ...]], Source]


def _late(module: str) -> Reader:
    """The function `read` of a module of this package, imported at its first call."""

    def read(text: str, file: str, package_dirs: tuple[str, ...]) -> Source:
        found: Reader = import_module(f"pinflex.description.robots.{module}").read
        return found(text, file, package_dirs)

    return read


_MJCF, _SDF, _GEPETTO = _late("mjcf"), _late("sdf"), _late("gepetto")


def _by_root(text: str, file: str, package_dirs: tuple[str, ...]) -> Source:
    """A .xml by its root element."""
    for tag, reader in (("mujoco(?:include)?", _MJCF), ("sdf", _SDF)):
        if re.search(rf"<{tag}[\s>]", text) and "<robot" not in text:
            return reader(text, file, package_dirs)
    return urdf.check(text, file, package_dirs)


READERS: dict[str, Reader] = {
    ".urdf": urdf.check,
    ".xml": _by_root,
    ".mjcf": _MJCF,
    ".sdf": _SDF,
    ".xacro": _late("xacro_files"),
    ".yaml": _GEPETTO,
    ".yml": _GEPETTO,
}
_ROBOT_DATA = "example-robot-data:"
_GEPETTO_KEYS = re.compile(r"^(closed_loop|name_mot|joint_type)\s*:", re.M)


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


def read(
    text: str,
    file: str,
    package_dirs: tuple[str, ...] = (),
    arguments: Mapping[str, str] | None = None,
) -> Source:
    """The contents of a robot's file by the reader of its suffix; of any other suffix as URDF."""
    reader = READERS.get(Path(file).suffix.lower(), urdf.check)
    if arguments:
        if Path(file).suffix.lower() != ".xacro":
            raise DescriptionError(f"xacro_args: {file} is no xacro. Remove the key.")
        reader = partial(
            import_module("pinflex.description.robots.xacro_files").read, arguments=arguments
        )
    source = reader(text, file, package_dirs)
    # The name says what the text is now, so that it can be read again.
    return source if reader is urdf.check else replace(source, file=f"{file}.urdf")


def rewritten(root: ET.Element, tree: Source) -> Source:
    """A robot whose URDF is another one now."""
    text = ET.tostring(root, encoding="unicode")
    return replace(read(text, tree.file, tree.package_dirs), notes=tree.notes)


def is_packaged(source: object) -> bool:
    """Whether a model is named as a robot of example-robot-data."""
    return isinstance(source, str) and source.startswith(_ROBOT_DATA)


def is_robot(path: Path) -> bool:
    """Whether a file is a robot by itself and not a description that names one."""
    suffix = path.suffix.lower()
    if suffix not in (".yaml", ".yml"):
        return suffix in READERS
    text = read_text(path, path.name)
    return bool(_GEPETTO_KEYS.search(text)) and not re.search(r"^urdf\s*:", text, re.M)


def find(
    source: str, folder: Path, where: str, arguments: Mapping[str, str] | None = None
) -> Source:
    """Read and check the file of the key `urdf`."""
    if is_packaged(source):
        path, packages = _robot_data(source[len(_ROBOT_DATA) :].strip(), where)
        return read(read_text(path, where), path.name, packages, arguments)
    path = folder / source
    if not nameable(path) or not path.is_file():
        found = [p.name for p in sorted(folder.glob("*.urdf"))]
        raise ModelNotFoundError(
            f'{where}: no file "{source[:200]}" beside the YAML.{nearest(source, found)} Give a '
            f"path relative to the YAML, or {_ROBOT_DATA}NAME."
        )
    packages = tuple(dict.fromkeys((str(path.parent.resolve()), str(folder.resolve()))))
    return read(read_text(path, where), path.name, packages, arguments)


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
    file = (loader.urdf_subpath, loader.urdf_filename)
    if not loader.urdf_filename:
        file = (loader.sdf_subpath, loader.sdf_filename)
    part = f"{loader.path}/{file[0]}/{file[1]}"
    try:
        root = Path(loader.model_path or getModelPath(part))
    except OSError:
        raise DescriptionError(
            f'{where}: the files of the robot "{name}" are missing. Install example-robot-data.'
        ) from None
    return root / part, (str((root / "../..").resolve()),)
