"""The compiled library: found, checked and loaded, or the reason why there is none."""

from __future__ import annotations

import ctypes
import os
import warnings
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from pinflex.errors import KernelWarning
from pinflex.kernel import build

_FOLDER = Path(__file__).parent
_POINTER, _INT = ctypes.c_void_p, ctypes.c_int64
# What the library has, with the types of answers and arguments.
FUNCTIONS = {
    "pinflex_work_size": (_INT, (_POINTER,)),
    "pinflex_residuals": (None, (_POINTER, _POINTER, _INT, *(_POINTER,) * 7)),
    "pinflex_losses": (None, (_POINTER, _POINTER, _INT, *(_POINTER,) * 3)),
    "pinflex_poses": (None, (_POINTER, _POINTER, _INT, _POINTER, _INT, _POINTER)),
    "pinflex_tangent": (None, (_POINTER, _POINTER, _INT, *(_POINTER,) * 9)),
    "pinflex_closure_motion": (None, (_POINTER, _POINTER, _INT, *(_POINTER,) * 6)),
    "pinflex_closures": (None, (_POINTER, _POINTER, _INT, *(_POINTER,) * 3)),
    "pinflex_motion": (None, (_POINTER,) * 10),
    "pinflex_place": (None, (_POINTER,) * 2),
    "pinflex_factor": (ctypes.c_int, (_POINTER,) * 2),
    "pinflex_balance": (None, (_POINTER,) * 3),
    "pinflex_solve": (None, (_POINTER,) * 2),
    "pinflex_correct": (None, (_POINTER,) * 2),
    "pinflex_march": (ctypes.c_int, (_POINTER,) * 3),
    "pinflex_begin": (ctypes.c_int, (_POINTER,) * 3),
    "pinflex_correct_steps": (ctypes.c_int, (*(_POINTER,) * 4, _INT, *(_POINTER,) * 3)),
    "pinflex_alpha": (_INT, (*(_POINTER,) * 3, _INT, _POINTER)),
    "pinflex_linear_march": (_INT, (_POINTER,)),
    "pinflex_samples": (None, (*(_POINTER,) * 2, _INT, *(_POINTER,) * 9)),
}


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
    for name, (result, arguments) in FUNCTIONS.items():
        function = getattr(functions, name)
        function.restype, function.argtypes = result, arguments
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
