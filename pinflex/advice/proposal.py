"""The advice itself: a proposal and what it rests on."""

from __future__ import annotations

from dataclasses import dataclass, field

from pinflex.advice.reduced_models import Errors, LeftOut
from pinflex.cards import Worded
from pinflex.text import brief


@dataclass(frozen=True)
class Advice(Worded):
    """A proposal and what it rests on.

    Attributes:
        name: Of the scene. tol: Relative error wanted of every output asked for.
        asked: Some of torque, deflection, platform.
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
    run_tol: float | None = None
    overrides: tuple[str, ...] = ()
    error: Errors = field(default_factory=dict)
    levels: dict[str, Errors] = field(default_factory=dict)
    left_out: tuple[LeftOut, ...] = ()
    coordinates: tuple[int, int, int] = (0, 0, 0)
    why: str = ""
    notes: tuple[str, ...] = ()
    seconds: float = 0.0

    def text(self) -> str:
        """Proposal, how to follow it, its error bars, and the price of what is left out."""
        from pinflex.advice.text import write

        return write(self)
