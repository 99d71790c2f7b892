"""Files that a description names: regular ones, of a size that can be meant."""

from __future__ import annotations

from pathlib import Path

from pinflex.errors import DescriptionError

MOST_TEXT = 50_000_000  # [bytes] of a YAML or URDF
MOST_TABLE = 500_000_000  # of samples of a motion
MOST_DATA = 2_000_000_000  # of a mesh or matrices


def nameable(path: Path) -> bool:
    """Whether a file can have this name at all: systems refuse to look for longer ones."""
    return len(str(path)) < 4000 and all(len(part) < 256 for part in path.parts)


def require_regular(path: Path, most: int, where: str) -> None:
    """Raise for a folder, device or pipe, which may never end, and for a file that is too large."""
    try:
        if not path.exists():
            return
        regular, size = path.is_file(), path.stat().st_size
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise DescriptionError(f"{where}: cannot be read ({why}). Give a file.") from None
    if not regular:
        raise DescriptionError(f"{where}: is no regular file. Give a file, no folder or device.")
    if size > most:
        raise DescriptionError(
            f"{where}: {size / 1e6:.4g} MB. Allowed: at most {most / 1e6:g} MB. Give a smaller one."
        )
