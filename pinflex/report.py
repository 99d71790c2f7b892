"""Reports: paragraphs, lists and tables of records, shown as text, HTML, JSON or DataFrames.

A writer says which records a table has and what its columns are; how a cell, a unit, a width or a
note looks is decided here. Records hold SI units; the unit in the head of a column is the one that
people read, and the text is scaled to it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import Any

from pinflex import text
from pinflex.doors import library
from pinflex.text import paragraph

# Units that people read: the SI unit behind each, and its number of them.
_SCALED = {
    "mm": ("m", 1e3), "um": ("m", 1e6), "mrad": ("rad", 1e3), "urad": ("rad", 1e6),
    "MPa": ("Pa", 1e-6), "ms": ("s", 1e3), "us": ("s", 1e6), "%": ("", 100.0),
}  # fmt: skip

_ROWS, _CELL, _TEXT = 12, 120, 6000  # of a table, characters of a cell, of a text
_BOX = "border:1px solid #8884;border-radius:6px;padding:.5em .9em;display:inline-block"
_ABOVE = "margin-top:.6em"
_LEFT, _RIGHT = "text-align:left;padding:.1em .8em", "text-align:right;padding:.1em .8em"

Value = str | Callable[[Any], Any]  # a key or attribute of a record, or a function of it
Show = Callable[[Any], str]


def cell(value: Any) -> str:
    """A value as most columns show it: four digits of a number, "-" where there is none."""
    return text.number(value) if isinstance(value, float | None) else str(value)


@dataclass(frozen=True)
class Column:
    """A column of a table: its head, perhaps with a unit, what a record has there, and its look.

    Attributes:
        head: Name, and in brackets the unit that is shown.
        value: Of a record, in SI units.
        show: From the scaled value to the text of a cell.
    """

    head: str
    value: Value
    show: Show = cell

    @cached_property
    def unit(self) -> tuple[str, float]:
        """Unit of the values, "" for none, and the factor to that of the head."""
        found = re.search(r"\[([^\]]+)\]$", self.head)
        shown = found[1] if found else ""
        return _SCALED.get(shown, (shown, 1.0))

    @property
    def name(self) -> str:
        """The head without its unit."""
        return self.head.rpartition(" [")[0] or self.head

    def of(self, record: Any) -> Any:
        """The value of a record, in SI units."""
        if callable(self.value):
            return self.value(record)
        return record[self.value] if isinstance(record, Mapping) else getattr(record, self.value)

    def cell(self, record: Any) -> str:
        """The text of a record."""
        value, (_, factor) = self.of(record), self.unit
        return self.show(value if factor == 1.0 or value is None else factor * value)


@dataclass(frozen=True)
class Table:
    """A title and records in columns.

    Attributes:
        names: Widths to which the texts of the first columns are shortened.
        prose: Whether the last column is text, not a number.
        once: Whether a name that repeats the one above is left blank.
    """

    title: str
    columns: tuple[Column, ...]
    records: tuple[Any, ...]
    names: tuple[int, ...] = (18, 18)
    prose: bool = False
    once: bool = False

    def rows(self) -> list[list[str]]:
        """The cells as text."""
        rows = [[column.cell(record) for column in self.columns] for record in self.records]
        if self.once:
            firsts = [row[0] for row in rows]
            for row, first, above in zip(rows[1:], firsts[1:], firsts, strict=False):
                row[0] = "" if first == above else first
        return rows

    def text(self) -> str:
        """Aligned columns between rules; "" without records."""
        heads = "|".join(column.head for column in self.columns)
        return text.table(self.title, heads, self.rows(), self.names, self.prose)

    def html(self) -> str:
        """Its first rows and columns."""
        if not self.records:
            return ""
        heads = [column.head for column in self.columns]
        left = {*range(len(self.names)), *([len(heads) - 1] if self.prose else [])}
        title = f'<div style="{_ABOVE}">{escape(self.title)}</div>'
        return f"{title}{grid(heads, self.rows(), left)}"

    def plain(self) -> dict[str, Any]:
        """For machines: title, unit of each column, and the records in SI units."""
        return {
            "title": self.title,
            "units": {column.name: column.unit[0] for column in self.columns},
            "rows": [{c.name: c.of(record) for c in self.columns} for record in self.records],
        }

    def to_pandas(self) -> Any:
        """The records as a pandas DataFrame, in SI units; units in `attrs`."""
        data = self.plain()
        frame = library("pandas", "to_pandas").DataFrame(data["rows"])
        frame.attrs["units"] = data["units"]
        return frame


def table(
    title: str,
    records: Sequence[Any] | Iterator[Any],
    *columns: str | tuple[str, Value] | tuple[str, Value, Show],
    names: tuple[int, ...] = (18, 18),
    prose: bool = False,
    once: bool = False,
) -> Table:
    """A table; a column is (head, value, show), or one word that is head and key."""
    made = [Column(c, c) if isinstance(c, str) else Column(*c) for c in columns]
    return Table(title, tuple(made), tuple(records), names, prose, once)


@dataclass(frozen=True)
class Lines:
    """Paragraphs without empty lines between them, such as a title with names and values.

    Attributes:
        texts: Of the paragraphs.
        indent: Of every line but the first of each. first: Of these.
    """

    texts: tuple[str, ...]
    indent: str = ""
    first: str = ""

    def text(self) -> str:
        """The paragraphs, broken into lines that fit."""
        return "\n".join(paragraph(each, self.indent, self.first) for each in self.texts)

    def html(self) -> str:
        """The same as blocks of HTML."""
        before = f"{self.first.strip()} " if self.first.strip() else ""
        return "".join(f"<div>{escape(before + each)}</div>" for each in self.texts)


def lines(*texts: str, indent: str = "", first: str | None = None) -> Lines:
    """Paragraphs, each on lines of its own; empty ones are left out."""
    return Lines(tuple(filter(None, texts)), indent, indent if first is None else first)


@dataclass(frozen=True)
class Listing:
    """Names, of `width` characters, and the text of each; those without are left out."""

    rows: Mapping[str, str]
    width: int

    def text(self) -> str:
        """A paragraph each."""
        texts = tuple(f"{name:<{self.width}}{words}" for name, words in self.rows.items() if words)
        return Lines(texts, " " * (self.width + 2), "  ").text()

    def html(self) -> str:
        """A table of both."""
        return pairs((name, words) for name, words in self.rows.items() if words)


def bullets(texts: Sequence[str], title: str = "") -> Block:
    """A list, perhaps under a title."""
    listed = Lines(tuple(texts), "  ", "- ") if texts else ""
    return (title, listed) if title and texts else listed


@dataclass(frozen=True)
class Words:
    """Text that is laid out already."""

    laid_out: str

    def text(self) -> str:
        """As it is."""
        return self.laid_out

    def html(self) -> str:
        """As it is."""
        return words(self.laid_out)


# A text is a paragraph; between the blocks of a sequence there are no gaps.
Block = str | Table | Lines | Listing | Words | Sequence["Block"]


@dataclass(frozen=True)
class Report:
    """What is said of something, block by block.

    Attributes:
        title: Of its card.
        blocks: Paragraphs, lists and tables; empty ones are left out.
    """

    title: str
    blocks: tuple[Block, ...]

    def text(self) -> str:
        """Aligned plain text of at most 100 columns."""
        return text.report(*map(_text, self.blocks))

    def html(self) -> str:
        """A card for a notebook."""
        parts = filter(None, map(_html, self.blocks))
        return card(self.title, *(f'<div style="{_ABOVE}">{part}</div>' for part in parts))

    def tables(self) -> dict[str, Table]:
        """Its tables by title, without those that have no records."""
        return {each.title: each for each in _flat(self.blocks) if isinstance(each, Table)}

    def plain(self) -> list[dict[str, Any]]:
        """Its tables for machines, see `Table.plain`."""
        return [each.plain() for each in self.tables().values()]


def _text(block: Block) -> str:
    if isinstance(block, str):
        return paragraph(block)
    if isinstance(block, Sequence):
        return "\n".join(filter(None, map(_text, block)))
    return block.text()


def _html(block: Block) -> str:
    if isinstance(block, str):
        return f"<div>{escape(block)}</div>" if block else ""
    return "".join(map(_html, block)) if isinstance(block, Sequence) else block.html()


def _flat(blocks: Sequence[Block]) -> Iterator[Block]:
    for block in blocks:
        if isinstance(block, Sequence) and not isinstance(block, str):
            yield from _flat(block)
        elif not isinstance(block, Table) or block.records:
            yield block


class Reported:
    """What has a report: print(it) shows its text, a notebook its card."""

    def as_report(self) -> Report:
        """All that is to be said of it."""
        raise NotImplementedError

    def text(self) -> str:
        """The whole of it as aligned plain text of at most 100 columns."""
        return self.as_report().text()

    def __str__(self) -> str:
        return self.text()

    def _repr_html_(self) -> str:
        return self.as_report().html()


# HTML of a notebook's cards; every text is escaped ------------------------------------------


def card(title: str, *parts: str) -> str:
    """A heading and parts below it, each from `pairs`, `grid` or `words`."""
    return f'<div style="{_BOX}"><b>{_cut(title)}</b>{"".join(parts)}</div>'


def pairs(rows: Iterable[tuple[str, object]]) -> str:
    """Names and values, side by side."""
    body = "".join(
        f'<tr><td style="{_LEFT}">{_cut(name)}</td><td style="{_LEFT}">{_cut(value)}</td></tr>'
        for name, value in list(rows)[: 2 * _ROWS]
    )
    return f"<table>{body}</table>"


def grid(heads: Sequence[str], rows: Sequence[Sequence[object]], left: Container[int] = ()) -> str:
    """A table with its first rows; numbers of the columns of text in `left`."""
    sides = [_LEFT if k in left else _RIGHT for k in range(len(heads))][:_ROWS]

    def line(tag: str, cells: Sequence[object]) -> str:
        pairs = zip(sides, cells, strict=False)
        return "".join(f'<{tag} style="{side}">{_cut(x)}</{tag}>' for side, x in pairs)

    top = line("th", heads)
    body = "".join(f"<tr>{line('td', row)}</tr>" for row in rows[:_ROWS])
    rest = [
        f"{len(all_) - _ROWS} more {what}"
        for all_, what in ((rows, "rows"), (heads, "columns"))
        if len(all_) > _ROWS
    ]
    more = f"<div>and {', '.join(rest)}</div>" if rest else ""
    return f"<table><tr>{top}</tr>{body}</table>{more}"


def words(text: str) -> str:
    """Aligned plain text as it is, cut where it is long."""
    cut = text if len(text) <= _TEXT else f"{text[:_TEXT].rpartition(chr(10))[0]}\n..."
    return f'<pre style="margin:.3em 0">{escape(cut)}</pre>'


def _cut(value: object) -> str:
    text = str(value)
    return escape(text if len(text) <= _CELL else f"{text[: _CELL - 3]}...")
