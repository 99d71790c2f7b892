"""Keys of the block `flexible`: link names, lists of them, or globs, and the links they mean."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from fnmatch import fnmatchcase
from typing import Any

from pinflex.description import schema, yaml_text
from pinflex.description.source import Source
from pinflex.errors import DescriptionError, nearest


def expand(value: object, where: str, urdf: Source) -> dict[str, Any]:
    """One block per link, from keys that are link names, lists of them, or globs."""
    blocks = schema.mapping(value, where)
    links = groups(blocks, where, urdf)
    return {name: copy.deepcopy(blocks[key]) for key, names in links.items() for name in names}


def groups(blocks: Mapping[str, Any], where: str, urdf: Source) -> dict[str, list[str]]:
    """The links of every key of the block `flexible`."""
    found: dict[str, list[str]] = {}
    written: dict[str, str] = {}
    for key in blocks:
        found[key] = _links(key, schema.at(where, key), urdf)
        for name in found[key]:
            if name in written:
                raise DescriptionError(
                    f'{schema.at(where, key)}: the link "{name}" is already described under '
                    f'"{written[name]}". Describe each link once.'
                )
            written[name] = key
    return found


def gathered(blocks: Mapping[str, Any], links: Mapping[str, list[str]]) -> dict[str, Any]:
    """One block for the links of a key again, where theirs are still alike."""
    found, left = dict[str, Any](), dict(blocks)
    for key, names in links.items():
        alike: list[tuple[Any, list[str]]] = []
        for name in (name for name in names if name in left):
            block = left.pop(name)
            some = next((some for other, some in alike if other == block), None)
            if some is None:
                alike.append((block, [name]))
            else:
                some.append(name)
        found |= {
            key if len(some) == len(names) else ", ".join(some): block for block, some in alike
        }
    return found | left


def _links(key: str, where: str, urdf: Source) -> list[str]:
    links: list[str] = []
    for part in (p.strip() for p in key.split(",")):
        matches = [part] if part in urdf.links else []
        if not matches and yaml_text.WILD.search(part):
            matches = [link for link in urdf.links if fnmatchcase(link, part)]
        if not matches:
            raise DescriptionError(
                f"{where}: no such link in {urdf.file}.{nearest(part, urdf.links)}", link=part
            )
        links += matches
    return links
