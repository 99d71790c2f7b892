"""The reference of the YAML: models/README.md with what the readers accept beside each key.

What a key takes comes from the tables that read it (`pinflex schema`); a key of a reader that the
text does not explain stops the build.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import claims
import long_cells

from pinflex.description.description import json_schema

Form = dict[str, Any]
_HEADING = re.compile(r"#+ (?:`(\w+)[^`]*`|(Top level))")
_HEADER = re.compile(r"\| key \|")
_HEAD_CELL = re.compile(r"^\| (\w+) \|")  # a table with a row for each word of that key
_KEYS = re.compile(r"`(\w+)[`:]")


class MissingKey(Exception):
    """A reader takes a key that models/README.md does not explain."""


def page() -> str:
    """The text with a column `takes` in every table of keys."""
    text, known = claims.page("models/README.md"), blocks(json_schema())
    explained: dict[str, set[str]] = defaultdict(set)
    lines, block, table = [], "", False
    for line in text.splitlines():
        if heading := _HEADING.match(line):
            block = heading[1] or ""
        table = bool(line.startswith("|") and (table or _HEADER.match(line)))
        explained[block] |= {*_KEYS.findall(line), *_HEAD_CELL.findall(line)}
        lines.append(_widened(line, known.get(block, {})) if table else line)
    _check(known, explained, set(re.findall(r"\w+", text)))
    return long_cells.shortened("\n".join(lines))


def blocks(schema: Form) -> dict[str, dict[str, list[Form]]]:
    """Forms of every key by the name of its block; the top level is ''."""
    found: dict[str, dict[str, list[Form]]] = defaultdict(lambda: defaultdict(list))
    for block, key, form in _walk(schema, ""):
        found[block][key].append(form)
    return found


def _walk(form: Form, block: str) -> Iterator[tuple[str, str, Form]]:
    for option in form.get("anyOf", ()):
        yield from _walk(option, block)
    if isinstance(form.get("additionalProperties"), dict):
        yield from _walk(form["additionalProperties"], block)
    for key, inner in form.get("properties", {}).items():
        yield block, key, inner
        yield from _walk(inner, key)


def _check(
    known: dict[str, dict[str, list[Form]]], explained: dict[str, set[str]], words: set[str]
) -> None:
    """Every key is explained: in its block's section, or where that block is a row of another."""
    for block, keys in known.items():
        where = explained.get(block, words)
        missing = sorted(set(keys) - where - set(explained))  # a block has its own section
        if missing:
            place = block or "the top level"
            raise MissingKey(f"models/README.md: {place}: not explained: {', '.join(missing)}")


def _widened(line: str, keys: dict[str, list[Form]]) -> str:
    """The row of a table with one cell more, the second."""
    _, first, rest = line.split("|", 2)
    if first.strip() == "key":
        return f"|{first}| takes |{rest}"
    if set(first.strip()) == {"-"}:
        return f"|{first}|---|{rest}"
    forms = [form for key in _KEYS.findall(first) for form in keys.get(key, ())]
    phrases = dict.fromkeys(phrase for form in forms if (phrase := takes(form)))
    return f"|{first}| {'; '.join(phrases)} |{rest}"


def takes(form: Form) -> str:
    """A form in words: `one of ...`, `number, 0 or more`, `true or false`."""
    if "anyOf" in form:
        options = [takes(one) for one in form["anyOf"] if one.get("type") != "null"]
        unit = (
            " (or with its unit)" if options[0].startswith("number") and "text" in options else ""
        )
        words = [word for word in options if not (unit and word == "text")]
        return " or ".join(dict.fromkeys(filter(None, words))) + unit
    if "enum" in form or "const" in form:
        values = form.get("enum", [form.get("const")])
        return ", ".join(f"`{_plain(value)}`" for value in values)
    kind = {"number": "number", "integer": "whole number", "string": "text", "array": "list"}
    if form.get("type") == "boolean":
        return "`true`, `false`"
    if form.get("type") == "object":
        return "block"
    return ", ".join(filter(None, (kind.get(form.get("type", ""), ""), _bounds(form))))


def _bounds(form: Form) -> str:
    said = []
    if "exclusiveMinimum" in form:
        said.append(f"above {form['exclusiveMinimum']:g}")
    if "minimum" in form and "maximum" in form:
        return f"{form['minimum']:g} to {form['maximum']:g}"
    if "minimum" in form:
        said.append(f"{form['minimum']:g} or more")
    if "maximum" in form:
        said.append(f"up to {form['maximum']:g}")
    return ", ".join(said)


def _plain(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
