"""What an object offers and a package below it, or another library, does: found when called."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from pinflex.errors import PinflexError


def door(module: str, name: str) -> Any:
    """A function of a package that stands below the caller's."""
    return getattr(import_module(f"pinflex.{module}"), name)


def library(name: str, use: str) -> Any:
    """A library that pinflex does without until it is asked for.

    Raises:
        PinflexError: It is not installed.
    """
    try:
        return import_module(name)
    except ImportError as error:
        raise PinflexError(
            f"{use} needs {name}, which is not installed. Run: pip install {name}"
        ) from error
