"""Random parameters of a scene: their distributions, and the texts that give them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.description.description import Description
from pinflex.description.parameters import parameters
from pinflex.errors import DescriptionError

_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_PAIR, _SHARE = re.compile(rf"{_NUMBER}:{_NUMBER}"), re.compile(rf"(?:\+-|±)?{_NUMBER}\s*%")


@dataclass(frozen=True)
class Distribution:
    """A random parameter.

    Attributes:
        key: Key path, as of a `Parameter`.
        kind: normal (mean, standard deviation) or uniform (low, high).
        first, second: Its two numbers, SI units.
    """

    key: str
    kind: str
    first: float
    second: float

    def values(self, shares: Array) -> Array:
        """Values at cumulative probabilities 0 to 1, same shape."""
        if self.kind == "uniform":
            return np.asarray(self.first + shares * (self.second - self.first))
        from scipy.special import ndtri

        return np.asarray(self.first + self.second * ndtri(shares))

    def standard(self, values: Array) -> Array:
        """Values less their mean, over their standard deviation, same shape."""
        mean, std = self.first, self.second
        if self.kind == "uniform":
            mean, std = (self.first + self.second) / 2, (self.second - self.first) / math.sqrt(12)
        return np.asarray((values - mean) / std)


def distributions(
    description: Description, normal: Mapping[str, str], uniform: Mapping[str, str]
) -> tuple[Distribution, ...]:
    """Random parameters from texts.

    Raises:
        DescriptionError: No such number, a text that is no pair, a key given twice.
    """
    found: dict[str, Distribution] = {}
    for kind, given in (("normal", normal), ("uniform", uniform)):
        for pattern, text in given.items():
            _, every = parameters(description, [pattern])
            for parameter in every:
                if parameter.key in found:
                    raise DescriptionError(f"{parameter.key}: given twice. Keep one distribution.")
                where = f"--{kind} {pattern}"
                found[parameter.key] = _read(where, parameter.key, kind, text, parameter.value)
    if not found:
        raise DescriptionError(
            "random sweep: no random parameter. Give --normal KEY=MEAN:STD or --uniform KEY=A:B."
        )
    return tuple(found.values())


def _read(where: str, key: str, kind: str, text: str, value: float) -> Distribution:
    text = str(text).strip()
    share, pair = _SHARE.fullmatch(text), _PAIR.fullmatch(text)
    if share is not None:
        spread = abs(value) * float(share[1]) / 100.0
        first, second = (value, spread) if kind == "normal" else (value - spread, value + spread)
    elif pair is not None:
        first, second = float(pair[1]), float(pair[2])
    else:
        form = "MEAN:STD or 2%" if kind == "normal" else "LOW:HIGH or 2%"
        raise DescriptionError(f"{where}: {text!r}: not of the form {form}. Write one.")
    wrong = second <= 0 if kind == "normal" else second <= first
    if wrong:
        rule = "a standard deviation above 0" if kind == "normal" else "LOW below HIGH"
        raise DescriptionError(f"{where}: {text!r}. Give {rule}.")
    return Distribution(key, kind, first, second)
