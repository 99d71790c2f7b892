"""The public boundary: an error leaves it without the frames below, a wrong keyword with the right.

PINFLEX_TRACEBACK=full shows every frame, as `--debug` does for a command.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from typing import ParamSpec, TypeVar

from pinflex.errors import DescriptionError, PinflexError, RunInterrupted, nearest

P = ParamSpec("P")
R = TypeVar("R")
VARIABLE = "PINFLEX_TRACEBACK"


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
            wrong = _unknown(function, kwargs) or _mistyped(function, args, kwargs)
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


def _mistyped(
    function: Callable[..., object], args: Iterable[object], kwargs: Mapping[str, object]
) -> DescriptionError | None:
    """Error for an argument of another kind than the annotation says; None where all fit."""
    from pinflex.arguments import mistyped  # late: only a call that has failed asks

    said = mistyped(function, args, kwargs)
    return None if said is None else DescriptionError(said)


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
