"""The compiled library: found, checked and loaded, or the reason why there is none."""

from __future__ import annotations

import ctypes
import os
import warnings
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from pinflex.errors import KernelWarning
from pinflex.kernel import build, header

_FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Library:
    """The compiled functions, or why there are none.

    Attributes:
        functions: The loaded library; None where numpy and Pinocchio serve.
        said: Which build it is, or what is the matter.
    """

    functions: ctypes.CDLL | None
    said: str


def kernel() -> Library:
    """The library for this machine; PINFLEX_KERNEL=0 switches it off, at any time."""
    if os.environ.get("PINFLEX_KERNEL", "") == "0":
        return Library(None, "switched off by PINFLEX_KERNEL=0")
    return _load()


@cache
def warn_if_missing() -> None:
    """Warn, once a process, where there is no library although nobody switched it off."""
    library = kernel()
    if library.functions is None and os.environ.get("PINFLEX_KERNEL") != "0":
        warnings.warn(
            f"the compiled kernel does not run ({library.said}): results are the same, but runs "
            "with flexible links take several times as long.",
            KernelWarning,
            stacklevel=2,
        )


@cache
def _load() -> Library:
    """The best build that this processor can run."""
    target = build.here()
    if target not in build.TARGETS:
        return Library(None, f"none for {target}")
    builds = [name for name, _, _ in build.BUILDS[target.rpartition("-")[2]]]
    wanted = os.environ.get("PINFLEX_KERNEL", "")
    usable = [b for b in builds if b == wanted] or [b for b in builds if _runs(b)]
    said = "not built: python -m pinflex.kernel.build"
    for name in reversed(usable):
        path = _FOLDER / build.name_of(target, name)
        if not path.exists():
            continue
        try:
            functions = _declared(_opened(path))
        except (OSError, AttributeError) as error:
            said = f"not usable: {error}"
            continue
        if functions is not None:
            return Library(functions, f"{target} {name}")
        said = "built from other sources: python -m pinflex.kernel.build"
    return Library(None, said)


def _opened(path: Path) -> ctypes.CDLL:
    """A library that is whole.

    Raises:
        OSError: It is not there, or differs from what was compiled.
    """
    if path.exists() and not build.is_whole(path):
        raise OSError(f"{path.name} is damaged: python -m pinflex.kernel.build")
    return ctypes.CDLL(str(path))


def _declared(functions: ctypes.CDLL) -> ctypes.CDLL | None:
    """Types of the functions; None for a library of other sources."""
    functions.pinflex_fingerprint.restype = ctypes.c_char_p
    if functions.pinflex_fingerprint().decode() != build.fingerprint():
        return None
    for name, (answer, arguments) in header.functions().items():
        function = getattr(functions, name)
        function.restype, function.argtypes = answer, arguments
    return functions


def _runs(name: str) -> bool:
    """Whether this processor runs a build."""
    if name == "baseline":
        return True
    return _baseline_says("pinflex_has_v3")


def _baseline_says(question: str) -> bool:
    """An answer of the build that runs everywhere."""
    path = _FOLDER / build.name_of(build.here(), "baseline")
    try:
        return bool(getattr(_opened(path), question)())
    except (OSError, AttributeError):
        return False
