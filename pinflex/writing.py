"""What is settled before anything is written: a path that takes a file, values that JSON knows."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.errors import DescriptionError


def writable(path: str | Path | None) -> None:
    """Find out before a long run, not after it, that its file cannot be written."""
    if path is None:
        return
    path = Path(path)
    if path.is_dir():
        raise DescriptionError(f"{path}: is a folder. Give the name of a file in it.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise DescriptionError(
            f"{path}: cannot be written ({error.strerror}). Choose a folder you may write to."
        ) from error


def plain(value: Any) -> Any:
    """Only what JSON knows: a number that is none (nan, inf) becomes null."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value
