"""The kernel as WebAssembly: out of the wheel, or compiled on the first use and kept."""

from __future__ import annotations

import os
import tempfile
from functools import cache
from pathlib import Path

from pinflex.errors import PinflexError
from pinflex.kernel import build

_BESIDE = Path(build.__file__).parent


@cache
def wasm() -> bytes:
    """The kernel for a page, of the C sources as they are.

    Raises:
        PinflexError: It is neither there nor can be compiled.
    """
    name = build.wasm_name()
    for folder in (_BESIDE, _cache()):
        if (folder / name).exists():
            return (folder / name).read_bytes()
    folder = _BESIDE if os.access(_BESIDE, os.W_OK) else _cache()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        return build.compile_wasm(folder / name).read_bytes()
    except RuntimeError as error:
        raise PinflexError(
            f"a page that computes needs the kernel as WebAssembly, which is not there: {error}. "
            'Install it (pip install "pinflex[page]"), or write a page that plays.'
        ) from error


def _cache() -> Path:
    """A folder of this user's for what is compiled once."""
    home = os.environ.get("XDG_CACHE_HOME")
    if home or Path.home().is_dir():
        return (Path(home) if home else Path.home() / ".cache") / "pinflex"
    return Path(tempfile.gettempdir()) / "pinflex"
