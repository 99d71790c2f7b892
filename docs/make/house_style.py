"""Docstrings as the house writes them, read by griffe: sections follow each other without a gap."""

from __future__ import annotations

import re
from typing import Any

import griffe

_SECTION = re.compile(r"(?m)(?<!\n)\n(?=(Args|Attributes|Returns|Raises|Yields|Source): ?)")


class Sections(griffe.Extension):
    """Adds the empty line that griffe wants before each section, and an indented text to it.

    And lets it see the dataclass that `frozen` makes.
    """

    def on_instance(self, *, obj: griffe.Object, **unused: Any) -> None:
        """One object of the package."""
        if isinstance(obj, griffe.Class):
            for decorator in obj.decorators:
                if str(decorator.value).startswith("frozen"):
                    decorator.value = griffe.ExprName("dataclass", parent="dataclasses")
                    obj.labels.add("dataclass")
        if obj.docstring is not None:
            obj.docstring.value = spaced(obj.docstring.value)


def spaced(text: str) -> str:
    """A docstring with its sections apart, and `Returns: text` on two lines."""
    text = _SECTION.sub("\n\n", text)
    text = re.sub(r"(?m)^(Returns|Raises|Yields): (?=\S)(.*)", r"\1:\n    \2", text)
    return re.sub(r"(?m)^Source: ", "**Source**: ", text)
