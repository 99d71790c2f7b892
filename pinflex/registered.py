"""Registrations from outside the package, so that other processes can repeat them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pinflex.errors import DescriptionError

Registration = tuple[Callable[..., None], str, tuple[Any, ...]]
_MADE: list[Registration] = []


def note(register: Callable[..., None], name: str, *values: Any) -> None:
    """Remember a registration that was made."""
    _MADE.append((register, name, values))


def packed() -> bytes:
    """Every registration, for `repeat` in another process; functions of a script by value.

    Raises:
        DescriptionError: One that cannot travel.
    """
    from joblib.externals.loky.backend.reduction import dumps

    for made in _MADE:
        try:
            dumps(made)
        except Exception as error:  # whatever its values hold
            raise DescriptionError(
                f"{made[0].__name__}: {made[1]}: cannot travel to another process ({error}). "
                "Register what a module defines, or solve with jobs=1."
            ) from error
    return bytes(dumps(_MADE))


def repeat(made: bytes) -> None:
    """Make the registrations of another process that this one does not have."""
    import pickle

    known = {(register.__name__, name) for register, name, _ in _MADE}
    for register, name, values in pickle.loads(made):
        if (register.__name__, name) not in known:
            register(*values)
