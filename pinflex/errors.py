"""Everything pinflex raises on purpose, each error carrying the data it talks about.

Messages read: where: what is wrong, with the value. What is allowed or nearest. What to do.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from enum import Enum
from typing import Any

VARIABLE = "PINFLEX_TRACEBACK"  # of the environment: full shows every frame of an error
_LONGEST_WORD, _LONGEST = 240, 2000  # [characters] of a word (a path), of a message
_WORD = re.compile(rf"\S{{{_LONGEST_WORD},}}")


class Ending(Enum):
    """Why a run ends before its time; the value says what to do then.

    As `ending` it goes with the error that a run ends by, whose message says where and how far.
    """

    # steps that follow the motion
    RUNS_AWAY = (
        "A link without second_order softens as it turns or is compressed, up to that: set "
        "flexible.LINK.second_order: true; or the mechanism falls or buckles there."
    )
    STEPS_VANISH = (
        "Equal steps (--set solve.dt=1e-5) tell what it is: if they pass, round-off, and a larger "
        "tol passes too; if not, the mechanism is singular there or the links far too soft: see "
        "level=quasistatic up to that time."
    )
    NOT_CORRECTED = "Give a larger tol, or dt."
    # steps of given length
    NEWTON_STALLED = (
        "Halve dt, start from rest (start=static), or use level=ked if deflections are small."
    )
    STEP_UNSOLVED = "Give a smaller dt, or a larger tol."
    LINEAR_GROWS = "Use level=coupled, or a smaller dt."
    # a tolerance
    TOL_NOT_REACHED = "Give a larger tol, start=static, or damping for what rings;"
    ROUND_OFF = "give that or more."
    # equilibrium
    NO_EQUILIBRIUM = (
        "The mechanism may buckle or fall there: lock motors, add springs, or stiffen links."
    )
    SNAPS_THROUGH = (
        "The mechanism buckles or falls there: lock motors, add springs, or stiffen links."
    )
    # contacts
    CHATTERS = "Give it damping."
    STOPS_A_MOTOR = "Give the stop `stiffness`, or write drive: torque."
    # any
    NOT_FINITE = (
        "A mass, a speed or a load is too large, or nothing holds a joint that has no mass."
    )
    OTHER_BREAKS = "Compare it with runs in steps of its own."


class PinflexError(Exception):
    """Base of every error pinflex raises on purpose.

    Args:
        message: One clear text for the user. What a file brought into it stays on its line:
            line breaks become blanks, control characters are shown as such, endless words cut.
        **data: What the message talks about; each becomes an attribute.
    """

    exit_code = 1

    def __init__(self, message: str, **data: Any) -> None:
        super().__init__(quoted(message))
        self.data = data
        for key, value in data.items():
            setattr(self, key, value)


class DescriptionError(PinflexError):
    """A file, a key or a value of the description is wrong (exit code 2)."""

    exit_code = 2


class ModelNotFoundError(DescriptionError):
    """No model of that name or path."""


class SceneError(PinflexError):
    """The input is well formed, but the scene cannot be solved (exit code 1).

    Attributes:
        result: The run up to its last good step, or None.
        ending: Why a run ended before its time, or None.
    """

    result: Any = None
    ending: Ending | None = None


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


class KernelWarning(UserWarning):
    """Runs go without the compiled kernel, although nobody switched it off."""


def quoted(text: str) -> str:
    """Text of somebody else's on one line of bounded length, with nothing that acts on a screen."""
    if not text.isprintable():
        text = " ".join(text.split())
        text = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    if len(text) > _LONGEST_WORD:
        text = _WORD.sub(lambda found: found.group()[: _LONGEST_WORD - 3] + "...", text)
    half = _LONGEST // 2
    return text if len(text) <= _LONGEST else f"{text[:half]} ... {text[-half:]}"


# Words of other tools for keys that are spelled otherwise here.
_MEANT = {"ratio": "gear", "reduction": "gear", "radius": "diameter", "density": "rho"}
_MEANT |= {"poisson": "nu", "young": "E", "youngs_modulus": "E", "shear_modulus": "G"}


def nearest(name: str, names: Iterable[str], limit: int = 12) -> str:
    """Text that leads from a wrong name to the right one: the closest, then the list."""
    known = list(dict.fromkeys(str(n) for n in names))
    meant = [n for n in known if n == _MEANT.get(str(name))]
    close = meant or difflib.get_close_matches(
        str(name)[:80], [n for n in known if len(n) < 200], 1, 0.5
    )
    hint = f' Did you mean "{close[0]}"?' if close else ""
    shown = ", ".join(n[:80] for n in known[:limit]) + (", ..." if len(known) > limit else "")
    return f"{hint} Allowed: {shown or 'none'}."


def reason(error: PinflexError) -> str:
    """Why a run stopped, without what only a Python caller can use."""
    return str(error).replace(" error.result holds the run so far.", "")
