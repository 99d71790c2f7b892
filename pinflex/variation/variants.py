"""Designs of one robot that differ in a few numbers, so that their outputs can be subtracted.

What stays: which directions deform (`auto` is decided once, for the first design), what a flexible
link carries beside its beam (fittings, motors), and the home pose that closes the loops.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pinflex.advice.solve import solve
from pinflex.arrays import Array
from pinflex.description.description import Description
from pinflex.description.reading.parameters import Parameter, parameters
from pinflex.errors import DescriptionError, PinflexError
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.mechanics.model.parts import FlexiblePart
from pinflex.results.result import Result
from pinflex.solver.solve import scene_of
from pinflex.writing import replaced

_OF_BEAMS = re.compile(r"flexible\..*\.(section|material)\..*")
_SWITCHES = {"u": "axial", "v": "bending_y", "w": "bending_z", "p": "torsion"}


@dataclass(frozen=True)
class Variants:
    """A robot and the parameters that make others of it.

    Attributes:
        source: The description as given. base: The first design, made of it.
        parameters: What is varied, with its values there.
    """

    source: Description
    base: Mechanism
    parameters: tuple[Parameter, ...]

    def at(self, values: Mapping[str, float]) -> Mechanism:
        """The robot with other values of some parameters, by their keys."""
        return self.base.described(self.described(values))

    def described(self, values: Mapping[str, float]) -> Description:
        """The description with other values of some parameters, by their keys."""
        known = {parameter.key: parameter for parameter in self.parameters}
        changes = [c for key, value in values.items() for c in known[key].overrides(value)]
        return self.base.description.with_overrides(changes)

    @property
    def first(self) -> Array:
        """Values of the first design, shape (parameters,)."""
        return np.array([parameter.value for parameter in self.parameters])

    def values(self, x: Array) -> dict[str, float]:
        """Values by key at logarithms x of those over the first ones, shape (parameters,)."""
        found = (float(value) for value in self.first * np.exp(x))
        return dict(zip(keys(self.parameters), found, strict=True))

    @cached_property
    def rigid(self) -> Result | None:
        """The rigid run of every design, if no parameter changes it; None if one may.

        Sections and materials of links do not, where motors follow a given motion.
        """
        told, motion = self.base.description, self.base.description.motion or {}
        if (
            told.platform is None
            or told.control is not None
            or "shaper" in motion
            or not all(_OF_BEAMS.fullmatch(parameter.key) for parameter in self.parameters)
        ):
            return None
        try:
            run = solve(self.base, level="rigid")
        except PinflexError:
            return None  # each design says why
        return run if scene_of(self.base, "rigid").spec.drive == "prescribed" else None

    def scaled(self, parameter: Parameter, logarithm: float) -> Mechanism:
        """The robot with one parameter multiplied by e^logarithm."""
        return self.at({parameter.key: parameter.value * math.exp(logarithm)})


def variants(
    mechanism: Mechanism, patterns: Iterable[str], changes: Sequence[str] = ()
) -> Variants:
    """The designs that the numbers named by key paths span."""
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
    base = load(description.with_overrides([*held, *changes]))
    return Variants(mechanism.description, base, found)


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


_latest: list[tuple[tuple[str, ...], Variants]] = []


def variants_of(description: Description, patterns: tuple[str, ...]) -> Variants:
    """The designs of a description; the last are kept, as all cases of a process share them."""
    texts = (str(description.path), description.urdf_text, description.yaml_text, *patterns)
    for known, kept in _latest:
        if known == texts:
            return kept
    made = variants(load(description), patterns)
    _latest[:] = [(texts, made)]
    return made


# A scene with other numbers as a YAML that loads as it is.


def write_scene(description: Description, path: str | Path, notes: Iterable[str]) -> Path:
    """Write a scene with comments at its head."""
    path = Path(path)
    raw = yaml.safe_load(description.yaml_text)
    old = None if description.path is None else description.path.parent
    for block, key in ((raw, "urdf"), (raw.get("motion") or {}, "file")):
        if old is not None and isinstance(block.get(key), str) and (old / block[key]).is_file():
            block[key] = os.path.relpath(old / block[key], path.absolute().parent)
    head = "".join(f"# {line}\n" for line in notes)
    with replaced(path) as part:
        part.write_text(head + yaml.safe_dump(raw, sort_keys=False), "utf-8")
    return path
