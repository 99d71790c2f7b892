"""A YAML text with another `home`; every other byte stays as its author wrote it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from pinflex.description import schema
from pinflex.errors import DescriptionError

_DIGITS = 1e-8  # relative or absolute; nine digits are written


def with_home(text: str, values: Mapping[str, float | list[float]], file: str) -> str:
    """The text with the block `home` replaced, or appended where there is none.

    Args:
        text: A YAML that was read without an error.
        values: Value of each joint.
        file: Its name, for messages.
    Raises:
        DescriptionError: The block cannot be told from the rest (anchors shared with other blocks).
    """
    newline = "\r\n" if "\r\n" in text else "\n"
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    before = schema.load(text, file)
    assert isinstance(root, yaml.MappingNode)
    lines = _lines(values, newline)
    for key, value in root.value:
        if key.value == "home":
            if isinstance(value, yaml.MappingNode) and value.value:
                changed = _edited(text, value, before["home"], values, newline)
            else:
                first, last = key.start_mark.index, max(_end(value), key.end_mark.index + 1)
                inner = _flow(values) if root.flow_style else lines
                changed = text[:first] + inner + text[last:]
            break
    else:
        if root.flow_style:
            at = text.rindex("}", 0, root.end_mark.index)
            changed = f"{text[:at].rstrip().rstrip(',')}, {_flow(values)}{text[at:]}"
        else:
            at = max(_end(value) for pair in root.value for value in pair)
            line = text.find("\n", at)
            at = len(text) if line < 0 else line
            at -= at > 0 and text[at - 1 : at] == "\r"
            changed = text[:at] + newline + lines + (text[at:] or newline)
    try:
        after = schema.load(changed, file)
        now = after.pop("home")
        kept = after == {k: v for k, v in before.items() if k != "home"}
        kept = kept and now.keys() >= values.keys()
        kept = kept and all(_same(now[name], value) for name, value in values.items())
    except (DescriptionError, AttributeError, KeyError, TypeError):
        kept = False
    if not kept:
        raise DescriptionError(
            f"{file}: home: this file is written in a way that does not let the block be replaced "
            f"alone (an anchor, several documents). Write it yourself:\n{lines}"
        )
    return changed


def _data(values: Mapping[str, float | list[float]]) -> dict[str, Any]:
    return {name: list(v) if isinstance(v, list) else v for name, v in values.items()}


def _edited(
    text: str,
    block: yaml.MappingNode,
    old: Mapping[str, Any],
    values: Mapping[str, float | list[float]],
    newline: str,
) -> str:
    """The text with new values in the entries of a block, and entries that it lacks after them."""
    pieces: list[tuple[int, int, str]] = []
    for key, value in block.value:
        new = values.get(key.value)
        if new is not None and not _same(old.get(key.value), new):
            shown = _plain({"x": new}).partition(": ")[2]
            pieces.append((value.start_mark.index, _end(value), shown))
    more = [_plain({name: v}) for name, v in _data(values).items() if name not in old]
    last = _end(block.value[-1][1])
    if more and block.flow_style:
        pieces.append((last, last, "".join(f", {entry}" for entry in more)))
    elif more:
        indent = " " * block.value[0][0].start_mark.column
        line = text.find("\n", last)
        line = len(text) if line < 0 else line - (text[line - 1] == "\r")
        pieces.append((line, line, "".join(f"{newline}{indent}{entry}" for entry in more)))
    for first, after, shown in sorted(pieces, reverse=True):
        text = text[:first] + shown + text[after:]
    return text


def _same(a: object, b: float | list[float]) -> bool:
    """Values that are one to the digits written."""
    one, other = (x if isinstance(x, list) else [x] for x in (a, b))
    if len(one) != len(other) or not all(isinstance(x, int | float) for x in one):
        return False
    return all(abs(x - y) <= _DIGITS * max(1.0, abs(y)) for x, y in zip(one, other, strict=True))


def _lines(values: Mapping[str, float | list[float]], newline: str) -> str:
    if not values:
        return "home: {}"
    rows = [f"  {_plain({name: value})}" for name, value in _data(values).items()]
    return newline.join(["home:", *rows])


def _flow(values: Mapping[str, float | list[float]]) -> str:
    return _plain({"home": _data(values)})


def _plain(block: dict[str, Any]) -> str:
    """One line "key: value"."""
    dumped = yaml.safe_dump(block, default_flow_style=True, width=10**6, allow_unicode=True)
    return str(dumped).strip()[1:-1]


def _end(node: yaml.Node) -> int:
    """Where a value ends in the text; a block ends with its last entry, not with what follows."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[-1] if isinstance(last, tuple) else last)
    return int(node.end_mark.index)
