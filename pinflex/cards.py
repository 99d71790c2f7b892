"""Small cards of HTML that a notebook shows of an object; every text is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

_ROWS, _CELL, _TEXT = 12, 120, 6000  # of a table, characters of a cell, of a text
_BOX = "border:1px solid #8884;border-radius:6px;padding:.5em .9em;display:inline-block"
_LEFT, _RIGHT = "text-align:left;padding:.1em .8em", "text-align:right;padding:.1em .8em"


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


def grid(heads: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table with its first rows."""
    top = "".join(f'<th style="{_RIGHT}">{_cut(x)}</th>' for x in heads[:_ROWS])
    body = "".join(
        "<tr>" + "".join(f'<td style="{_RIGHT}">{_cut(x)}</td>' for x in row[:_ROWS]) + "</tr>"
        for row in rows[:_ROWS]
    )
    left = [
        f"{len(all_) - _ROWS} more {what}"
        for all_, what in ((rows, "rows"), (heads, "columns"))
        if len(all_) > _ROWS
    ]
    more = f"<div>and {', '.join(left)}</div>" if left else ""
    return f"<table><tr>{top}</tr>{body}</table>{more}"


def words(text: str) -> str:
    """Aligned plain text as it is, cut where it is long."""
    cut = text if len(text) <= _TEXT else f"{text[:_TEXT].rpartition(chr(10))[0]}\n..."
    return f'<pre style="margin:.3em 0">{escape(cut)}</pre>'


def _cut(value: object) -> str:
    text = str(value)
    return escape(text if len(text) <= _CELL else f"{text[: _CELL - 3]}...")
