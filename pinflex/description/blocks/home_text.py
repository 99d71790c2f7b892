"""A YAML text with another `home`; every other byte stays as its author wrote it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from pinflex.description.reading import yaml_text
from pinflex.errors import DescriptionError

_DIGITS = 1e-8  # relative or absolute; nine digits are written


def with_home(text: str, values: Mapping[str, float | list[float]], file: str) -> str:
    """The text with the block `home` replaced, or appended where there is none.

    Raises:
        DescriptionError: The block cannot be told from the rest (anchors shared with other blocks).
    """
    before = yaml_text.load(text, file)
    changed = _changed(text, values, before)
    if not _only_home_differs(changed, before, values, file):
        lines = _lines(values, "\r\n" if "\r\n" in text else "\n")
        raise DescriptionError(
            f"{file}: home: this file is written in a way that does not let the block be replaced "
            f"alone (an anchor, several documents). Write it yourself:\n{lines}"
        )
    return changed


def _changed(
    text: str, values: Mapping[str, float | list[float]], before: Mapping[str, Any]
) -> str:
    """The text with the block replaced, or with a new one at its end."""
    newline = "\r\n" if "\r\n" in text else "\n"
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    assert isinstance(root, yaml.MappingNode)
    lines = _lines(values, newline)
    for key, value in root.value:
        if key.value == "home":
            if isinstance(value, yaml.MappingNode) and value.value:
                return _edited(text, value, before["home"], values, newline)
            first, last = key.start_mark.index, max(_end(value), key.end_mark.index + 1)
            inner = _flow(values) if root.flow_style else lines
            return text[:first] + inner + text[last:]
    if root.flow_style:
        at = text.rindex("}", 0, root.end_mark.index)
        return f"{text[:at].rstrip().rstrip(',')}, {_flow(values)}{text[at:]}"
    at = max(_end(value) for pair in root.value for value in pair)
    line = text.find("\n", at)
    at = len(text) if line < 0 else line
    at -= at > 0 and text[at - 1 : at] == "\r"
    return text[:at] + newline + lines + (text[at:] or newline)


def _only_home_differs(
    changed: str,
    before: Mapping[str, Any],
    values: Mapping[str, float | list[float]],
    file: str,
) -> bool:
    """Whether the changed text says the values, and everything else as before."""
    try:
        after = yaml_text.load(changed, file)
        now = after.pop("home")
        if after != {k: v for k, v in before.items() if k != "home"}:
            return False
        return now.keys() >= values.keys() and all(_same(now[k], x) for k, x in values.items())
    except (DescriptionError, AttributeError, KeyError, TypeError):
        return False


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
