"""How much a YAML may become: counted on its nodes, before anything is built of them.

A name `*a` stands for all of `&a`, and `<<: [*a, *a]` copies its keys, so that a kilobyte may mean
more values than any memory holds.
"""

from __future__ import annotations

from typing import Any

import yaml

from pinflex.errors import DescriptionError

MOST_TEXT = 2_000_000  # [characters], some 20 s of reading
MOST_VALUES = 500_000  # of a description with all its aliases written out
_MERGE = "tag:yaml.org,2002:merge"


def refuse_endless(root: Any, file: str) -> None:
    """Raise where a YAML written out has too many values, or contains itself."""
    size: dict[int, int] = {}
    keys: dict[int, int] = {}  # pairs of a mapping once its merges are in it
    open_: set[int] = set()
    pending: list[tuple[Any, bool]] = [(root, False)]
    while pending:
        node, ready = pending.pop()
        if id(node) in size:
            continue
        below = _below(node)
        if not ready:
            if id(node) in open_:
                _refuse(node, file, "contains itself")
            open_.add(id(node))
            pending.append((node, True))
            pending += [(child, False) for child in below if id(child) not in size]
            continue
        open_.discard(id(node))
        if isinstance(node, yaml.MappingNode):
            keys[id(node)] = sum(
                _merged(value, keys) if key.tag == _MERGE else 1 for key, value in node.value
            )
        size[id(node)] = 1 + keys.get(id(node), 0) + sum(size[id(child)] for child in below)
        if size[id(node)] > MOST_VALUES:
            _refuse(node, file, f"has more than {MOST_VALUES} values, its aliases written out")


def _below(node: Any) -> list[Any]:
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


def _merged(node: Any, keys: dict[int, int]) -> int:
    """Pairs that a merge brings in."""
    if isinstance(node, yaml.SequenceNode):
        return sum(keys.get(id(child), 0) for child in node.value)
    return keys.get(id(node), 0)


def _refuse(node: Any, file: str, what: str) -> None:
    line = node.start_mark.line + 1
    raise DescriptionError(
        f"{file}, line {line}: the block {what}. Write what is meant without so many aliases.",
        line=line,
    )
