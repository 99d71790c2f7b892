"""What a benchmark gives: checked quantities, and a picture of measured against reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pinflex.arrays import Array


@dataclass(frozen=True)
class Check:
    """One quantity against its reference.

    Attributes:
        quantity: What it is, with its unit.
        measured: From pinflex.
        reference: Published, or from a closed form.
        tolerance: Largest error that passes.
        relative: The error is relative to the reference; else it is in the quantity's own unit.
        note: Why the tolerance is what it is, or why the reference cannot be reached.
        reported: It is known not to reach the tolerance, and the note says why: its error is shown,
            and it never counts as passed.
    """

    quantity: str
    measured: float
    reference: float
    tolerance: float
    relative: bool = True
    note: str = ""
    reported: bool = False

    @property
    def error(self) -> float:
        """Distance from the reference, as a fraction of it if `relative`."""
        distance = abs(self.measured - self.reference)
        return distance / abs(self.reference) if self.relative else distance

    @property
    def passed(self) -> bool:
        """Within tolerance; a number that is none never passes."""
        return bool(self.error <= self.tolerance) and not self.reported


@dataclass(frozen=True)
class Series:
    """One line of a picture; a reference is drawn as points."""

    label: str
    x: Array
    y: Array
    reference: bool = False


@dataclass(frozen=True)
class Picture:
    """Measured lines and reference points over one abscissa."""

    title: str
    x: str
    y: str
    series: tuple[Series, ...]


@dataclass(frozen=True)
class Outcome:
    """Checks of one case, and at most one picture."""

    checks: tuple[Check, ...]
    picture: Picture | None = None


@dataclass(frozen=True)
class Case:
    """A benchmark: its name, where its reference is from, and the function that runs it.

    Attributes:
        slow: It takes minutes, and runs when asked for.
    """

    name: str
    source: str
    run: Callable[[], Outcome]
    slow: bool = False
