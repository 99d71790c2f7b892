"""The paper keeps its journal's rules, and its numbers are those of the evidence."""

from __future__ import annotations

import re

from tests.docs.blocks import ROOT

PAPER = (ROOT / "paper/paper.md").read_text("utf-8")
BODY = PAPER.split("---\n", 2)[2]


def test_the_paper_has_the_sections_and_the_length_that_the_journal_asks_for() -> None:
    """JOSS, "Example paper and bibliography": sections by name; 750 to 1750 words."""
    heads = re.findall(r"^# (.*)$", BODY, re.M)
    assert heads == [
        "Summary", "Statement of need", "State of the field", "Software design",
        "Research impact statement", "AI usage disclosure", "Acknowledgements", "References",
    ]  # fmt: skip
    words = re.findall(r"[A-Za-z]{2,}", re.sub(r"^\|.*$|@\w+", "", BODY, flags=re.M))
    assert 750 <= len(words) <= 1750


def test_every_reference_is_cited_and_every_citation_is_there() -> None:
    entries = (ROOT / "paper/paper.bib").read_text("utf-8")
    known = re.findall(r"^@\w+\{(\w+),", entries, re.M)
    assert len(known) == len({*known})
    assert {*known} == {*re.findall(r"@(\w+)", BODY)}
    for entry in entries.split("\n\n"):
        assert re.search(r"doi = |url = |simeon1996|kane1987", entry), entry[:60]  # none confirmed


def test_figures_and_numbers_of_the_paper_are_those_of_the_repository() -> None:
    for figure in re.findall(r"\]\((\w+\.png)\)", BODY):
        assert (ROOT / "paper" / figure).is_file()
        assert figure in (ROOT / "paper/figures.py").read_text("utf-8")
    readme = (ROOT / "README.md").read_text("utf-8")
    assert "0.38 mm" in readme and "71 um of it static sag" in readme and "71 µm" in BODY
    rows = re.findall(r"^\| R\d.*? \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|", readme, re.M)
    whole, by_tol = ([float(row[k]) for row in rows] for k in (0, 1))
    assert f"{min(by_tol):g} to {max(by_tol):g} times" in BODY.replace("\n", " ")
    assert f"{min(whole):g} and {max(whole):g}" in BODY.replace("\n", " ")
    race = (ROOT / "tests/benchmarks/RACE.md").read_text("utf-8")
    measured = re.findall(r"^\| R\d \| [\d.]+ \| [\d.]+ \| ([\d.]+) \|", race, re.M)
    assert [float(f"{float(x):.2g}") for x in measured] == whole
