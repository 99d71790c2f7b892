"""Tables that a phone can show: a long cell keeps its first sentences, the rest follows below."""

from __future__ import annotations

import re
from collections.abc import Iterator

_LONG = 300  # [characters] of a cell
_KEPT = 200  # of it, in whole sentences; the first one always
_SENTENCE = re.compile(r"(?<=[.;])\s+(?=[A-Z`*\[])")


def shortened(text: str) -> str:
    """A page whose long cells are paragraphs under their table, each with a link to it."""
    lines: list[str] = []
    below: list[str] = []
    heading = ""
    for line in [*text.splitlines(), ""]:
        if line.startswith("#"):
            heading = _slug(line)
        if line.startswith("|"):
            line = "|".join(_cells(line, heading, below))
        elif below:
            lines += ["", *below]
            below = []
        lines.append(line)
    return "\n".join(lines)


def _cells(line: str, heading: str, below: list[str]) -> Iterator[str]:
    first = line.split("|")[1].strip()
    for cell in line.split("|"):
        sentences = _SENTENCE.split(cell.strip())
        if len(cell) <= _LONG or len(sentences) < 2:
            yield cell
            continue
        kept = 1
        while len(" ".join(sentences[: kept + 1])) <= _KEPT:
            kept += 1
        name = f"{heading}-{_slug(first)}-more"
        below += [f"{first}: {cell.strip()}", f"{{: #{name} }}", ""]
        yield f" {' '.join(sentences[:kept])} [More below](#{name}) "


def _slug(text: str) -> str:
    return "-".join(re.findall(r"[a-z0-9_]+", text.lower()))
