"""Numbers of a description as parameters: a key path, a value, and overrides that change it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from pinflex.description.blocks import flexible
from pinflex.description.blocks.material import from_spec
from pinflex.description.description import Description
from pinflex.description.reading import schema
from pinflex.errors import DescriptionError, nearest
from pinflex.writing import plain

# Changes of a description as texts: "key.path=value".


def assignments(*changes: str | Mapping[str, object]) -> list[str]:
    """Values by key path as overrides: "key.path=value", numbers to the last digit; texts stay."""
    found: list[str] = []
    for change in changes:
        pairs = {} if isinstance(change, str) else change
        found += [change] if isinstance(change, str) else []
        found += [f"{key}={json.dumps(plain(value))}" for key, value in pairs.items()]
    return found


_MATERIAL = ("E", "G", "rho", "nu", "yield_strength")


@dataclass(frozen=True)
class Parameter:
    """One number of a scene that is varied.

    Attributes:
        key: Key path as the YAML groups it, such as "flexible.arm_?.section.diameter".
        value: In the description, SI units.
        paths: The places that take the value together: links written in one block.
    """

    key: str
    value: float
    paths: tuple[str, ...]

    def overrides(self, value: float) -> list[str]:
        """The number changed, for `Description.with_overrides`."""
        return assignments(dict.fromkeys(self.paths, float(value)))


def parameters(
    description: Description, patterns: Iterable[str]
) -> tuple[Description, tuple[Parameter, ...]]:
    """The numbers that key paths name; each glob gives one parameter per block of the YAML.

    Links that the YAML writes in one block ("arm_?") stay one parameter, as their author meant. The
    description that comes back has named materials written out, so that their numbers can change.
    """
    if isinstance(patterns, str):
        patterns = (patterns,)
    raw, place = description.blocks(), f"{description.name}: flexible"
    groups = flexible.groups(raw.get("flexible") or {}, place, description.tree())
    named_materials, found = list[str](), dict[str, Parameter]()
    for pattern in patterns:
        segments = [part.strip() for part in str(pattern).split(".")]
        numbers = [
            (path, links, value)
            for path, links, value in _matches(raw, segments, groups)
            if len(path) == len(segments)
            and isinstance(value, (int, float)) and not isinstance(value, bool)
        ]  # fmt: skip
        if not numbers:
            raise _no_number(description.name, str(pattern), raw, segments, groups)
        for path, links, value in numbers:
            key, rest = ".".join(path), path[2:]
            paths = tuple(".".join(("flexible", link, *rest)) for link in links) or (key,)
            found[key] = Parameter(key, float(value), paths)
            if links and len(path) == 4 and path[2] == "material":
                named_materials += _written_out(raw, links, groups)
    return description.with_overrides(named_materials), tuple(found.values())


Match = tuple[tuple[str, ...], Sequence[str], Any]  # path as shown, flexible links, value


def _matches(
    raw: Mapping[str, Any], segments: Sequence[str], groups: Mapping[str, Sequence[str]]
) -> Iterator[Match]:
    """The values whose paths begin as a pattern says; of flexible links those that it names."""
    for path, value in _leaves(raw):
        links: Sequence[str] = ()
        if path[0] == "flexible" and len(path) > 1:
            group, *rest = path[1:]
            every = links = groups[group]
            if len(segments) > 1 and segments[1] != group:  # a part of a block is a list
                wanted = [one.strip() for one in segments[1].split(",")]
                links = [x for x in every if any(fnmatchcase(x, one) for one in wanted)]
                if not links:
                    continue
            name = group if len(links) == len(every) else ", ".join(links)
            path = "flexible", name, *rest
            steps = zip((path[0], *rest), (segments[0], *segments[2:]), strict=False)
        else:
            steps = zip(path, segments, strict=False)
        if len(path) >= len(segments) and all(fnmatchcase(*both) for both in steps):
            yield path, links, value


def _leaves(block: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every value below a block, with the path that leads to it."""
    if path[-1:] == ("material",):
        block = _numbers(block)
    if not block or not isinstance(block, dict | list):
        yield path, _si(block)
        return
    for name, value in enumerate(block) if isinstance(block, list) else block.items():
        yield from _leaves(value, (*path, str(name)))


def _si(value: Any) -> Any:
    """The number that a text with a unit means; any other value as it is."""
    for quantity in schema.UNITS if isinstance(value, str) else ():
        if not isinstance(number := schema.measured(value, quantity), str):
            return number
    return value


def _numbers(material: Any) -> Any:
    """A material with all numbers of the one that it names, or is like."""
    if not isinstance(material, str) and not (isinstance(material, dict) and "like" in material):
        return material
    try:
        whole = from_spec(material)
    except DescriptionError:
        return material
    values = {key: getattr(whole, key) for key in _MATERIAL}
    own = material if isinstance(material, dict) else {}
    return own | {key: value for key, value in values.items() if value is not None}


def _written_out(
    raw: Mapping[str, Any], links: Sequence[str], groups: Mapping[str, Sequence[str]]
) -> list[str]:
    """Overrides that turn named materials into blocks, of which one number can be changed."""
    written = {link: group for group, links in groups.items() for link in links}
    materials = {link: raw["flexible"][written[link]].get("material") for link in links}
    return [
        f"flexible.{link}.material={{like: {material}}}"
        for link, material in materials.items()
        if isinstance(material, str)
    ]


def _no_number(
    name: str, pattern: str, raw: Any, segments: Sequence[str], groups: Mapping[str, Sequence[str]]
) -> DescriptionError:
    """The error of a pattern without a number: what there is one level up."""
    for depth in range(len(segments) - 1, 0, -1):
        paths = [path for path, *_ in _matches(raw, segments[:depth], groups)]
        if keys := sorted({path[depth] for path in paths if len(path) > depth}):
            return DescriptionError(
                f'{name}: {pattern}: no number there: nothing matches "{segments[depth]}".'
                f"{nearest(segments[depth], keys)} A parameter is a number that the YAML writes."
            )
    return DescriptionError(
        f"{name}: {pattern}: no such key.{nearest(segments[0], [str(k) for k in raw])} A "
        "parameter is a number that the YAML writes."
    )
