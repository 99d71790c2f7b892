"""The advice itself: a proposal and what it rests on."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

from pinflex.advice.reduced_models import Errors, LeftOut
from pinflex.cards import Worded
from pinflex.results.residual import BAND
from pinflex.text import brief, percent


def error_bar(e: float) -> str:
    """An error bar in words: beyond the whole output it says only that nothing is right."""
    return "over 100 %" if 1.0 < e < inf else percent(e)


@dataclass(frozen=True)
class Advice(Worded):
    """A proposal and what it rests on.

    Attributes:
        name: Of the scene. tol: Relative error that every output asked for may have.
        asked: Some of torque, deflection, platform.
        band: Distance of the platform that does no harm [m].
        allowed: Errors that may be, by output: more than `tol` where they are within the band.
        level: rigid, quasistatic, ked or coupled.
        run_tol: `solve.tol` of the run (levels quasistatic and coupled), or None.
        overrides: "key=value" changes of the YAML, for `load` or --set.
        error: Error bar of each output if the proposal is followed.
        levels: Error bar of each output at each level of the richer model.
        left_out: Planes, modes and links that were tried.
        coordinates: Elastic coordinates: as loaded, of the richer model, proposed.
        why: The reason for the level.
        notes: What weakens the advice.
        seconds: What it cost.
    """

    __repr__ = brief

    name: str
    tol: float
    asked: tuple[str, ...]
    level: str = "coupled"
    band: float = BAND
    allowed: Errors = field(default_factory=dict)
    run_tol: float | None = None
    overrides: tuple[str, ...] = ()
    error: Errors = field(default_factory=dict)
    levels: dict[str, Errors] = field(default_factory=dict)
    left_out: tuple[LeftOut, ...] = ()
    coordinates: tuple[int, int, int] = (0, 0, 0)
    why: str = ""
    notes: tuple[str, ...] = ()
    seconds: float = 0.0

    def used(self, error: Errors) -> float:
        """The largest error, each as a share of what is allowed.

        Args:
            error: By output.
        """
        return max((e / self.allowed.get(k, self.tol) for k, e in error.items()), default=0.0)

    def text(self) -> str:
        """Proposal, how to follow it, its error bars, and the price of what is left out."""
        from pinflex.advice.text import write

        return write(self)
