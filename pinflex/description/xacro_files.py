"""Reading a xacro: expanded by the package xacro, where that is installed, then a URDF."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from pinflex.description import urdf
from pinflex.description.source import Source
from pinflex.errors import DescriptionError


def read(text: str, file: str, package_dirs: tuple[str, ...]) -> Source:
    """Expand a xacro and check the URDF that comes out.

    Args:
        text: The xacro. file: Its name. package_dirs: The first one is its folder.
    """
    try:
        import xacro  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError:
        raise DescriptionError(
            f"{file}: is a xacro, and the package xacro is not installed. Run `pip install xacro`, "
            f"or expand it: `xacro {file} > x.urdf`."
        ) from None
    folder = Path(package_dirs[0]) if package_dirs else Path()
    with tempfile.TemporaryDirectory() as place:
        path = folder / file
        if not path.is_file():
            path = Path(place) / file
            path.write_text(text, "utf-8")
        try:
            expanded = xacro.process_file(str(path)).toxml()
        except Exception as error:  # xacro raises what its macros run into
            first = (str(error).strip() or type(error).__name__).splitlines()[0]
            raise DescriptionError(
                f"{file}: xacro cannot expand it: {first}. Correct it, or expand it by hand."
            ) from None
    return replace(urdf.check(expanded, file, package_dirs), file=file)
