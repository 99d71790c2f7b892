"""The public boundary: an error leaves it without the frames below, a wrong keyword with the right.

PINFLEX_TRACEBACK=full shows every frame, as `--debug` does for a command.
"""

from __future__ import annotations

import builtins
import inspect
import os
import reprlib
from collections import abc
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import wraps
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from pinflex.errors import VARIABLE, DescriptionError, PinflexError, RunInterrupted, nearest

P = ParamSpec("P")
R = TypeVar("R")


def public(function: Callable[P, R]) -> Callable[P, R]:
    """A function that users call: what it raises on purpose shows their line and the message."""

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        __tracebackhide__ = True  # IPython and pytest leave this frame out too
        try:
            return function(*args, **kwargs)
        except (PinflexError, RunInterrupted) as error:
            if os.environ.get(VARIABLE) == "full":
                raise
            raise _shortened(error)  # noqa: B904
        except (TypeError, ValueError, AttributeError):
            wrong = _unknown(function, kwargs) or mistyped(function, args, kwargs)
            if wrong is None:
                raise
            raise wrong from None

    return called


def _shortened(error: BaseException) -> BaseException:
    """The error without its frames; what caused it stays in __context__, and is not printed."""
    cause = error.__cause__ or error.__context__
    error.__cause__, error.__context__ = None, cause
    error.__suppress_context__ = True
    return error.with_traceback(None)


def _unknown(
    function: Callable[..., object], given: Mapping[str, object]
) -> DescriptionError | None:
    """Error for a keyword that the function does not have; None where it has all."""
    known = inspect.signature(function).parameters
    wrong = [key for key in given if key not in known]
    if not wrong or any(p.kind is p.VAR_KEYWORD for p in known.values()):
        return None
    name = function.__name__
    return DescriptionError(
        f"{name}: {wrong[0]}: no such option.{nearest(wrong[0], known)}", key=wrong[0]
    )


# An argument that does not fit its annotation, in a sentence: asked once a call has failed.

_PLAIN = {  # of an annotation: what fits it, and how that is called
    str: (str, "text"),
    Path: (os.PathLike, "path"),
    float: (Real, "number"),
    int: (Integral, "whole number"),
    bool: ((bool, np.bool_), "True or False"),
    NoneType: (NoneType, "None"),
}
_MAPPINGS = (dict, abc.Mapping)
_LISTS = (list, set, frozenset, abc.Iterable, abc.Sequence, abc.Collection)


def mistyped(
    function: Callable[..., object], args: Iterable[object], kwargs: Mapping[str, object]
) -> DescriptionError | None:
    """Error for the first argument that does not fit its annotation; None where all fit."""
    try:
        bound = inspect.signature(function).bind(*args, **kwargs)
        hints = get_type_hints(function, localns=_Known(function))
    except TypeError:  # too many arguments, too few: Python says so itself
        return None
    for name, value in bound.arguments.items():
        wrong = next(_misfits(value, hints.get(name, Any), name), None)
        if wrong is not None:
            where, what, hint = wrong
            return DescriptionError(
                f"{function.__name__}: {where}: {reprlib.repr(what)} does not fit. Give "
                f"{_said(hint)}; help(pinflex.{function.__qualname__}) says more."
            )
    return None


class _Known(dict[str, Any]):
    """Names of annotations; those that only a type checker imports stand for anything."""

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(vars(builtins) | getattr(inspect.unwrap(function), "__globals__", {}))

    def __missing__(self, name: str) -> Any:
        return Any


def _misfits(value: Any, hint: Any, where: str) -> Iterator[tuple[str, Any, Any]]:
    """Place, value and annotation of what does not fit."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint in _PLAIN:
        fits = isinstance(value, _PLAIN[hint][0])  # type: ignore[arg-type]
        if not fits or (isinstance(value, bool) and hint is not bool):
            yield where, value, hint
    elif origin in (Union, UnionType):
        found = [next(_misfits(value, one, where), None) for one in inner]
        if all(one is not None for one in found):
            deeper = [one for one in found if one is not None and one[0] != where]
            yield deeper[0] if deeper else (where, value, hint)
    elif origin in _MAPPINGS:
        if not isinstance(value, Mapping):
            yield where, value, hint
            return
        for key, one in value.items():
            yield from _misfits(key, inner[0], f"{where}: the key")
            yield from _misfits(one, inner[1], f"{where}[{key!r}]")
    elif origin in _LISTS or origin is tuple:
        others = (Mapping, str) if origin is tuple else Mapping  # a text is a list of texts
        if not isinstance(value, Iterable) or isinstance(value, others):
            yield where, value, hint
            return
        several = [*value] if isinstance(value, abc.Collection) else []  # an iterator is used up
        kinds = [*inner] if origin is tuple and inner[-1] is not ... else [inner[0]] * len(several)
        if len(several) != len(kinds):
            yield where, value, hint
            return
        for k, (one, kind) in enumerate(zip(several, kinds, strict=True)):
            yield from _misfits(one, kind, f"{where}[{k}]")
    elif _is_ours(hint) and not isinstance(value, hint):
        yield where, value, hint


def _is_ours(hint: Any) -> bool:
    """Whether it is a class of pinflex whose objects are known by their type."""
    return (
        isinstance(hint, type)
        and hint.__module__.startswith("pinflex.")
        and not getattr(hint, "_is_protocol", False)
    )


def _said(hint: Any) -> str:
    """An annotation in words."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint in _PLAIN:
        return _PLAIN[hint][1]
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(map(_said, inner)))
    if origin is Literal:
        return " or ".join(map(repr, inner))
    if origin in _MAPPINGS:
        return f"{{{_said(inner[0])}: {_said(inner[1])}}}"
    if origin is tuple and inner[-1] is not ...:
        return f"({', '.join(map(_said, inner))})"
    if origin in _LISTS or origin is tuple:
        return f"[{_said(inner[0])}, ...]"
    return "anything" if hint in (Any, object) else getattr(hint, "__name__", str(hint))
