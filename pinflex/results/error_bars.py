"""Error bars of a result: of time integration and of the model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from pinflex.text import percent

NOT_MEASURED, NONE = "not measured", "none"


@dataclass(frozen=True)
class ErrorBars:
    """Errors of the outputs of a run, relative to their largest values.

    Attributes:
        time: Of time integration, by output; empty: not measured.
        model: Of the model (few segments and modes, what the links cannot do), likewise.
        time_note, model_note: How they were found, or why they were not.
    """

    time: Mapping[str, float] = field(default_factory=dict)
    model: Mapping[str, float] = field(default_factory=dict)
    time_note: str = ""
    model_note: str = ""

    def worst(self) -> tuple[str, float] | None:
        """The output whose model is furthest off, and by how much."""
        return max(self.model.items(), key=lambda item: item[1]) if self.model else None

    def lines(self) -> tuple[str, str]:
        """Both in words."""
        return (
            f"time integration: {_named(self.time, self.time_note)}",
            f"model: {_named(self.model, self.model_note)}",
        )

    def plain(self) -> dict[str, Any]:
        """For machines."""
        return asdict(self)


def time_error(settings: Mapping[str, Any], level: str) -> tuple[dict[str, float], str]:
    """The error of time integration that a run has found of itself, and how or why not."""
    known = settings.get("error")
    if known:
        return dict(
            known
        ), f"by {settings.get('judged', 'two runs')}, tol = {settings.get('tol', 0):g}"
    if level in ("rigid", "quasistatic"):
        return {}, f"{NONE}: every instant is solved by itself"
    if known is not None:
        return {}, f"{NONE}: the mechanism stays at rest"
    return {}, f"{NOT_MEASURED}: equal steps; solve with tol to have it"


def _named(errors: Mapping[str, float], note: str) -> str:
    if not errors:
        return note or NOT_MEASURED
    known = ", ".join(f"{key} {percent(value)}" for key, value in errors.items())
    return f"{known} ({note})" if note else known
