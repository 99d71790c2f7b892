"""Designs of one robot that differ in a few numbers, so that their outputs can be subtracted.

What stays: which directions deform (`auto` is decided once, for the first design), what a flexible
link carries beside its beam (fittings, motors), and the home pose that closes the loops.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pinflex.description.parameters import Parameter, parameters
from pinflex.errors import DescriptionError
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.mechanics.parts import FlexiblePart

_SWITCHES = {"u": "axial", "v": "bending_y", "w": "bending_z", "p": "torsion"}


@dataclass(frozen=True)
class Variants:
    """A robot and the parameters that make others of it.

    Attributes:
        base: The first design.
        parameters: What is varied, with its values there.
    """

    base: Mechanism
    parameters: tuple[Parameter, ...]

    def at(self, values: Mapping[str, float]) -> Mechanism:
        """The robot with other values of some parameters, by their keys."""
        changes = [
            change
            for parameter in self.parameters
            if parameter.key in values
            for change in parameter.overrides(values[parameter.key])
        ]
        return load(self.base.description.with_overrides(changes))

    def scaled(self, parameter: Parameter, logarithm: float) -> Mechanism:
        """The robot with one parameter multiplied by e^logarithm."""
        return self.at({parameter.key: parameter.value * math.exp(logarithm)})


def variants(
    mechanism: Mechanism, patterns: Iterable[str], changes: Sequence[str] = ()
) -> Variants:
    """The designs that the numbers named by key paths span.

    Args:
        mechanism: The first design.
        patterns: Key paths of the YAML, as in `pinflex.description.parameters`.
        changes: Overrides of all designs.

    Raises:
        DescriptionError: No such number, or one that is 0 and so has no relative change.
    """
    description, found = parameters(mechanism.description, patterns)
    for parameter in found:
        if not parameter.value or not math.isfinite(parameter.value):
            raise DescriptionError(
                f"{mechanism.name}: {parameter.key}: it is {parameter.value:g}, and relative "
                "changes of that are none. Give it another value first (--set)."
            )
    blocks = mechanism.description.flexible_blocks()
    held = [
        change for part in mechanism.parts.values() for change in _held(part, blocks[part.link])
    ]
    return Variants(load(description.with_overrides([*held, *changes])), found)


def _held(part: FlexiblePart, block: Mapping[str, Any]) -> list[str]:
    """Overrides that keep what a flexible link carries, and the directions in which it deforms."""
    if any(body.solid for body in part.bodies):
        return []
    found = [
        f"flexible.{part.link}.{key}={json.dumps(direction in part.planes)}"
        for direction, key in _SWITCHES.items()
    ]
    if part.share is not None and part.spec.as_built is None:
        built = {key: block[key] for key in ("material", "section")} | {"length": part.length}
        found.append(f"flexible.{part.link}.as_built={json.dumps(built)}")
    return found


def keys(found: Sequence[Parameter]) -> tuple[str, ...]:
    """The key paths of parameters."""
    return tuple(parameter.key for parameter in found)
