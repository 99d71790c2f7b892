"""XML whose elements know their line, for readers that name what they leave out."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator
from xml.parsers import expat

import numpy as np

from pinflex.arrays import Array
from pinflex.description.reading import schema
from pinflex.errors import DescriptionError, nearest

_DEEPEST = 500  # MuJoCo's limit too
_DOCTYPE = re.compile("<!(DOCTYPE|ENTITY)", re.I)


class Element(ET.Element):
    """An element with the line of its file on which it starts, and the file's name."""

    line: int = 0
    file: str = ""

    @property
    def place(self) -> str:
        """File and line, for messages."""
        return f"{self.file}, line {self.line}"

    def all(self, tag: str | None = None) -> Iterator[Element]:
        """The children, of one tag if given."""
        for child in self if tag is None else self.findall(tag):
            assert isinstance(child, Element)
            yield child

    def child(self, tag: str) -> Element | None:
        """The first child of a tag."""
        return next(self.all(tag), None)


def refuse_doctype(text: str, file: str, what: str) -> None:
    """A document type can hold entities that grow without bound, and robots have no use for one."""
    first, *rest = text.split("<!--")
    if _DOCTYPE.search(first + "".join(x.partition("-->")[2] for x in rest)):
        raise DescriptionError(f"{file}: holds a <!DOCTYPE>, which {what} must not. Remove it.")


def malformed(file: str, line: int, error: Exception) -> DescriptionError:
    """The refusal of text that is no XML."""
    return DescriptionError(
        f"{file}, line {line}: malformed XML: {str(error).split(':')[0]}. Correct the line.",
        line=line,
    )


def require_shallow(root: ET.Element, file: str) -> None:
    """Refuse elements in elements without end, which no robot has."""
    level = [root]
    for _ in range(_DEEPEST):
        level = [child for element in level for child in element]
        if not level:
            return
    raise DescriptionError(
        f"{file}: elements go more than {_DEEPEST} deep. Remove what is no part of a robot."
    )


def parse(text: str, file: str, tags: tuple[str, ...], what: str) -> Element:
    """The root element of an XML text."""
    refuse_doctype(text, file, what)
    builder = ET.TreeBuilder(element_factory=Element)
    parser = expat.ParserCreate()
    parser.buffer_text = True

    def start(name: str, attributes: dict[str, str]) -> None:
        element = builder.start(name, attributes)
        assert isinstance(element, Element)
        element.line, element.file = parser.CurrentLineNumber + lead, file

    lead = text[: len(text) - len(text.lstrip())].count("\n")
    parser.StartElementHandler = start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text.strip(), True)
    except expat.ExpatError as error:
        raise malformed(file, error.lineno + lead, error) from None
    except ValueError as error:
        raise DescriptionError(f"{file}: malformed XML: {error}. Correct it.") from None
    root = builder.close()
    assert isinstance(root, Element)
    require_shallow(root, file)
    if tags and root.tag not in tags:
        raise DescriptionError(f"{file}: the root element is <{root.tag}>, not <{tags[0]}>.")
    return root


def numbers(
    text: str | None, element: Element, key: str, size: int | None = None, of: str = "place"
) -> Array:
    """The finite numbers of a text, `size` of them if given."""
    where = f"{element.place}: <{element.tag}> {key}"
    try:
        values = np.array([float(part) for part in (text or "").split()])
    except ValueError:
        values = np.array([np.nan])
    if not np.all(np.isfinite(values)) or (size is not None and len(values) != size):
        count = "numbers" if size is None else f"{size} number{'s' if size > 1 else ''}"
        raise DescriptionError(f"{where}: {text!r} is not {count}. Correct it.")
    for value in values:
        schema.within(float(value), where, of)
    return values


def unused(element: Element, taken: Collection[str], children: bool = False) -> Iterator[str]:
    """Sentences on attributes (or children) of an element that are not among those taken."""
    own = f' "{element.get("name")}"' if element.get("name") else ""
    found = {child.tag: child.place for child in reversed([*element.all()])} if children else {}
    places = found if children else dict.fromkeys(element.attrib, element.place)
    for name, place in places.items():
        if name not in taken:
            word = f"<{name}>" if children else name
            yield f"{place}: {word} of <{element.tag}>{own} is not taken over."


def known(name: str, names: Collection[str], element: Element, what: str) -> str:
    """A name that the file defines."""
    if name not in names:
        raise DescriptionError(f'{element.place}: no such {what}: "{name}".{nearest(name, names)}')
    return name
