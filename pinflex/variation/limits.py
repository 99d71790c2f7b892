"""Limits on outputs: "frequency.1 > 12", "stress.peak < 0.5*yield", "deviation.peak < base"."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from pinflex.errors import DescriptionError

_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_LIMIT = re.compile(
    rf"\s*([\w.\-]+)\s*(<=|>=|<|>)\s*(?:({_NUMBER})\s*\*\s*(yield|base)|(yield|base)|({_NUMBER}))\s*"
)


@dataclass(frozen=True)
class Limit:
    """A limit on an output.

    Attributes:
        output: Its name. upper: Whether it is a largest value.
        value: The limit, SI units; a share of the first design's value where `relative`.
        relative: To the first design.
    """

    output: str
    upper: bool
    value: float
    relative: bool = False

    def number(self, base: Mapping[str, float]) -> float:
        """The limit in SI units, given the outputs of the first design."""
        return self.value * base[self.output] if self.relative else self.value

    def margin(self, value: float, base: Mapping[str, float]) -> float:
        """ln of how far a value keeps within the limit: 0.01 is one per cent, negative beyond."""
        sign = -1.0 if self.upper else 1.0
        limit = self.number(base)
        if value > 0 and limit > 0:
            return sign * math.log(value / limit)
        return sign * (value - limit) / max(abs(limit), 1e-300)

    def __str__(self) -> str:
        shown = f"{self.value:g} of the first design" if self.relative else f"{self.value:g}"
        return f"{self.output} {'<' if self.upper else '>'} {shown}"


def limits(texts: Iterable[str]) -> tuple[Limit, ...]:
    """Limits from texts.

    Raises:
        DescriptionError: Another form.
    """
    return tuple(_limit(text) for text in texts)


def _limit(text: str) -> Limit:
    match = _LIMIT.fullmatch(text)
    if match is None:
        raise DescriptionError(
            f"keep {text!r}: not of the form OUTPUT < NUMBER or OUTPUT > NUMBER, such as "
            '"frequency.1 > 12", "deviation.peak < 1*base", "stress.peak < 0.5*yield".'
        )
    output, sign, share, unit, alone, number = match.groups()
    value, word = float(share or number or 1.0), unit or alone
    if word == "yield":
        if output not in ("stress.peak", "stress.yield"):
            raise DescriptionError(f"keep {text!r}: only stress.peak has a yield strength.")
        output = "stress.yield"
    if value <= 0:
        raise DescriptionError(f"keep {text!r}: a limit is a number above 0.")
    return Limit(output, sign.startswith("<"), value, word == "base")
