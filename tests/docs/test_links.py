"""Links between the Markdown files of the repository lead to files and headings that exist.

Claims:
    Documentation, other systems
    - links between Markdown files lead to files and headings | the files | all | all
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from tests.docs.blocks import ROOT

sys.path.insert(0, str(ROOT / "docs/make"))
import checked

FILES = [
    path
    for pattern in ("*.md", "models/**/*.md", "tests/**/*.md")
    for path in sorted(ROOT.glob(pattern))
    if not {".docs", "site"} & {*path.relative_to(ROOT).parts}
]
_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def anchors(path: Path) -> set[str]:
    """Names of the headings as a forge makes them of their text."""
    heads = re.findall(r"^#+ (.*)$", _FENCE.sub("", path.read_text("utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.strip().lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_of_a_file_lead_somewhere(path: Path) -> None:
    for link in _LINK.findall(_FENCE.sub("", path.read_text("utf-8"))):
        if "://" in link:
            continue
        file, _, anchor = link.partition("#")
        target = path.parent / file if file else path
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


def test_the_check_of_the_site_finds_what_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text('<h1 id="top">a</h1><a href="b.html#x">b</a>')
    (tmp_path / "b.html").write_text('<p id="x"></p><a href="a.html#top">a</a>')
    assert not [*checked.faults(tmp_path)]
    (tmp_path / "c.html").write_text(
        '<a href="a.html#nowhere">1</a><iframe src="no.html"></iframe><a href="d.html">2</a>'
        '<script src="https://cdn.example/x.js"></script><math><mi>\\foo</mi></math>'
    )
    told = "\n".join(checked.faults(tmp_path, ("load",)))
    for fault in ("a.html#nowhere", "no.html", "d.html", "cdn.example", "formula", "load is"):
        assert fault in told
    assert len(told.splitlines()) == 6


def test_rows_of_an_aligned_formula_are_aligned_where_columnalign_is_unknown() -> None:
    """MathML Core (Chromium) centres every cell that no style aligns."""
    pytest.importorskip("latex2mathml")
    import mathml

    tex = r"\begin{align*} r &= K y \\ &\quad - f = 0 \\ c(y) &= 0 \end{align*}"
    drawn = mathml.drawn(f'<div class="arithmatex">\\[{tex}\\]</div>')
    cells = re.findall(r"<mtd[^>]*>", drawn)
    aligned = [re.search(r'text-align: (\w+)"', cell) for cell in cells]
    assert [found and found[1] for found in aligned] == ["right", "left"] * 3
