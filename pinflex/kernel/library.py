"""The compiled library: found, checked and loaded, or the reason why there is none."""

from __future__ import annotations

import ctypes
import math
import os
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array
from pinflex.errors import KernelWarning, PinflexError
from pinflex.kernel import build
from pinflex.kernel.build import code

# Structures, functions and constants of the kernel as its C sources declare them, once.
#
# The sources travel with the library (a library of others is not loaded), so that Python reads
# there what it hands over: nothing is listed twice, and nothing can differ.

_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_STRUCTURE = re.compile(r"typedef struct \{(.*?)\} (\w+);", re.DOTALL)
_ARRAYS = re.compile(r"\b(Int|double) (\*[^;]*);\s*/\* \[([^\]]*)\]")  # their shape is behind
_ENUMERATION = re.compile(r"enum \{([^}]*)\};")  # begins with a word: found quickly
_FUNCTION = re.compile(r"\nEXPORT ([^({;]*?)(\w+)\(([^)]*)\) ?[{;]")  # begins with a line's end
_SCALARS = {"Int": ctypes.c_int64, "int": ctypes.c_int, "double": ctypes.c_double}
_TYPES: dict[str, npt.DTypeLike] = {"Int": np.int64, "double": np.float64}


@cache
def _commented() -> str:
    return code().decode()


@cache
def _text() -> str:
    return _COMMENT.sub("", _commented())


@cache
def _structures() -> dict[str, str]:
    """Their fields, with the comments, by name."""
    return {name: body for body, name in _STRUCTURE.findall(_commented())}


@cache
def structure(name: str) -> type[ctypes.Structure]:
    """The structure that the sources call so, with its fields in their order."""
    fields: list[tuple[str, Any]] = []
    for declaration in _COMMENT.sub("", _structures()[name]).split(";")[:-1]:
        kind, names = re.split(r"\s+", re.sub(r"\bconst ", "", declaration.strip()), maxsplit=1)
        for each in names.split(","):
            field = each.strip()
            fields.append((field.lstrip("*"), ctypes.c_void_p if "*" in field else _value(kind)))
    return type(name, (ctypes.Structure,), {"_fields_": fields})


def names(of: str, kind: type) -> tuple[str, ...]:
    """Names of the fields of a structure that are of one kind, such as `ctypes.c_void_p`."""
    fields: list[tuple[str, Any]] = structure(of)._fields_  # type: ignore[assignment]
    return tuple(name for name, type_ in fields if type_ is kind)


@cache
def shapes(of: str) -> dict[str, tuple[npt.DTypeLike, tuple[str, ...]]]:
    """Types and shapes of the arrays of a structure, from the brackets behind them."""
    return {
        name.strip().lstrip("*"): (_TYPES[kind], tuple(shape.split(", ")))
        for kind, names, shape in _ARRAYS.findall(_structures()[of])
        for name in names.split(",")
    }


_EVERY = 8  # numbers: each array starts at a multiple of 64 bytes


def aligned(numbers: int) -> Array:
    """Zeros that start at a multiple of 64 bytes."""
    raw = np.zeros(numbers + _EVERY)
    return raw[-raw.ctypes.data // 8 % _EVERY :][:numbers]


def numbers(x: npt.ArrayLike, *shape: int) -> Array:
    """Numbers of a shape as the C code reads them.

    Raises:
        PinflexError: They have another one.
    """
    array = np.ascontiguousarray(x, dtype=np.float64)
    if array.shape != shape:
        raise PinflexError(f"kernel: an array of {array.shape}, not {shape}.")
    return array


def place(x: Array, *shape: int) -> int:
    """Where an array of a shape is that the C code writes; a PinflexError where it cannot."""
    if x.shape != shape or x.dtype != np.float64 or not x.flags.c_contiguous:
        raise PinflexError(f"kernel: an array of {x.shape}, not {shape} numbers in one piece.")
    return x.ctypes.data


class Record:
    """A structure of the kernel with its arrays, given or zero, as the sources declare them.

    Attributes:
        at: The C structure. address: Where it is. arrays: By name. addresses: Where they are.
        raw: All of them in one. sizes: By name.
    """

    def __init__(
        self, kind: str, sizes: Mapping[str, int], given: Mapping[str, Any], **values: Any
    ) -> None:
        """`sizes`: of what shapes name. `values`: fields that are numbers or structures.

        Raises:
            PinflexError: An array that is given has other sizes.
        """
        self.sizes, places, end = sizes, dict[str, tuple[int, Any, Any, list[int]]](), 0
        for name, (dtype, shape) in shapes(kind).items():
            wanted, array = [_size(part, sizes, places) for part in shape], None
            if name in given:
                array = np.asarray(given[name], dtype=dtype)
                if array.size != math.prod(wanted):
                    raise PinflexError(f"kernel: {name}: {array.size} entries, not {wanted}.")
            places[name] = end, dtype, array, wanted
            end += -(-math.prod(wanted) // _EVERY) * _EVERY
        self.raw = whole = aligned(end)
        first = whole.ctypes.data
        self.arrays: dict[str, npt.NDArray[Any]] = {}
        for name, (at, dtype, array, wanted) in places.items():
            here = whole[at : at + math.prod(wanted)].view(dtype).reshape(wanted)
            if array is not None:
                here[...] = array.reshape(wanted)
            self.arrays[name] = here
        self.addresses = {name: first + 8 * at for name, (at, *_) in places.items()}
        numbers = {name: sizes[name] for name in names(kind, ctypes.c_int64) if name in sizes}
        self.at = structure(kind)(**numbers | self.addresses | values)
        self.address = ctypes.addressof(self.at)


def _size(part: str, sizes: Mapping[str, int], places: Mapping[str, Any]) -> int:
    """A number of a shape."""
    if part.isdecimal():
        return int(part)
    if part.startswith("*"):
        starts = places[part[1:]][2]
        return 0 if starts is None else int(starts[-1])
    return sizes[part[:-2]] + 1 if part.endswith("+1") else sizes[part]


@cache
def header_functions() -> dict[str, tuple[Any, tuple[Any, ...]]]:
    """Types of the answer and of the arguments of every function that the library has."""
    found = {}
    for answer, name, arguments in _FUNCTION.findall(_text()):
        each = [] if arguments.strip() == "void" else arguments.split(",")
        found[name] = (_type(answer), tuple(_type(argument) for argument in each))
    return found


def constant(name: str) -> int:
    """The number that an enumeration of the sources gives a name."""
    return _constants()[name]


@cache
def _constants() -> dict[str, int]:
    numbers: dict[str, int] = {}
    for names in _ENUMERATION.findall(_text()):
        number = 0
        for each in names.split(","):
            called, _, value = (part.strip() for part in each.partition("="))
            number = int(value) if value else number
            if called:
                numbers[called] = number
            number += 1
    return numbers


def _type(declaration: str) -> Any:
    """Of an answer or an argument."""
    kind = re.sub(r"\bconst\b", "", declaration).split()[0]
    if "*" in declaration:
        return ctypes.c_char_p if kind == "char" and "const" in declaration else ctypes.c_void_p
    return None if kind == "void" else _value(kind)


def _value(kind: str) -> Any:
    """A number, or a structure within another."""
    return _SCALARS[kind] if kind in _SCALARS else structure(kind)


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


def loaded() -> ctypes.CDLL:
    """The compiled functions; a PinflexError where there are none."""
    library = kernel()
    if library.functions is None:
        raise PinflexError(f"kernel: {library.said}.")
    return library.functions


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
    for name, (answer, arguments) in header_functions().items():
        function = getattr(functions, name)
        function.restype, function.argtypes = answer, arguments
    return functions


def _runs(name: str) -> bool:
    """Whether this processor runs a build; that which runs everywhere knows."""
    if name == "baseline":
        return True
    try:
        return bool(_opened(_FOLDER / build.name_of(build.here(), "baseline")).pinflex_has_v3())
    except (OSError, AttributeError):
        return False
