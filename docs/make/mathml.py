"""TeX between dollars as MathML: no script, no font and nothing fetched to read a formula."""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert

_FORMULA = re.compile(
    r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL
)  # as pymdownx.arithmatex leaves it

_ALIGNED = re.compile(r'<mtd columnalign="(left|right)"')


def drawn(page: str) -> str:
    """The page with its formulas converted."""
    return _FORMULA.sub(_converted, page)


def _converted(found: re.Match[str]) -> str:
    block = found[1] == "div"
    tex = html.unescape(found[2]).strip()
    drawn = convert(tex, display="block" if block else "inline")
    # MathML Core, which Chromium draws, has no `columnalign`: cells would be centred.
    return _ALIGNED.sub(r'\g<0> style="text-align: \1"', drawn)
