"""Everything pinflex raises on purpose, each error carrying the data it talks about.

Messages read: where: what is wrong, with the value. What is allowed or nearest. What to do.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any


class PinflexError(Exception):
    """Base of every error pinflex raises on purpose.

    Args:
        message: One clear text for the user.
        **data: What the message talks about; each becomes an attribute.
    """

    exit_code = 1

    def __init__(self, message: str, **data: Any) -> None:
        super().__init__(message)
        self.data = data
        for key, value in data.items():
            setattr(self, key, value)


class DescriptionError(PinflexError):
    """A file, a key or a value of the description is wrong (exit code 2)."""

    exit_code = 2


class ModelNotFoundError(DescriptionError):
    """No model of that name or path."""


class SceneError(PinflexError):
    """The input is well formed, but the scene cannot be solved (exit code 1)."""

    result: Any = None


class AssemblyError(SceneError):
    """The loops cannot be closed from the home guess."""


class SingularityError(SceneError):
    """The closures lose rank or the motors lose command of the mechanism."""


class MotionError(SceneError):
    """The motion cannot be followed, with the time and the reason."""


class ConvergenceError(SceneError):
    """An iteration stopped short; `result` holds the run up to the last good step."""


class RunInterrupted(KeyboardInterrupt):
    """Ctrl-C during a run; `result` holds it up to the last step."""

    def __init__(self, result: Any) -> None:
        super().__init__("interrupted")
        self.result = result


def nearest(name: str, names: Iterable[str], limit: int = 12) -> str:
    """Text that leads from a wrong name to the right one: the closest, then the list."""
    known = list(dict.fromkeys(str(n) for n in names))
    close = difflib.get_close_matches(str(name), known, n=1, cutoff=0.5)
    hint = f' Did you mean "{close[0]}"?' if close else ""
    shown = ", ".join(known[:limit]) + (", ..." if len(known) > limit else "")
    return f"{hint} Allowed: {shown or 'none'}."
