"""The references of the site are made from the code: every command, option and key is in them.

Claims:
    Documentation, other systems
    - the reference of YAML has every key of every reader; one without explanation stops the build |
      `pinflex schema` | all | all
"""

from __future__ import annotations

import argparse
import re
import sys

import pytest

from pinflex.__main__ import build_parser
from tests.docs.blocks import ROOT

sys.path.insert(0, str(ROOT / "docs/make"))
import commands
import sources_of_formulas
import yaml_keys


def test_every_command_and_option_is_in_the_reference() -> None:
    text = commands.page()
    choices = next(a.choices for a in build_parser()._actions if isinstance(a.choices, dict))
    for name, parser in choices.items():
        assert f"pinflex {name}" in text
        for action in parser._actions:
            if action.help != argparse.SUPPRESS:
                assert all(f"`{option}`" in text for option in action.option_strings)


def test_keys_say_what_their_readers_take() -> None:
    text = yaml_keys.page()
    table = [row.split("|") for row in text.splitlines() if row.startswith("| `")]
    rows = {cells[1].strip(): cells[2] for cells in table}
    assert rows["`tol`"].strip() == "number, 1e-09 to 0.1"
    assert "`revolute`" in rows["`kind`"] or "`weld`" in text
    assert "above 0" in rows["`dt`"]
    assert rows["`inertia`"].strip() == "`urdf`, `beam`"


def test_a_table_of_keys_has_no_cell_of_paragraphs() -> None:
    """What is too long for a cell stands below its table, whole, where the cell leads."""
    text = yaml_keys.page()
    cells = [cell for row in text.splitlines() if row.startswith("|") for cell in row.split("|")]
    assert max(map(len, cells)) < 450  # a dozen lines of a column
    anchors = re.findall(r"\[More below\]\(#([\w-]+)\)", text)
    assert len(anchors) == len({*anchors}) > 5
    for anchor in anchors:
        assert text.count(f"{{: #{anchor} }}") == 1
    source = (ROOT / "models/README.md").read_text("utf-8")
    words = re.findall(r"[a-z]{4,}", source)
    assert not {*words} - {*re.findall(r"[a-z]{4,}", text)} - {"readme", "benchmarks"}


def test_a_key_without_explanation_stops_the_build(monkeypatch: pytest.MonkeyPatch) -> None:
    schema = yaml_keys.json_schema()
    schema["properties"]["solve"]["anyOf"][0]["properties"]["brand_new"] = {}
    monkeypatch.setattr(yaml_keys, "json_schema", lambda: schema)
    with pytest.raises(yaml_keys.MissingKey, match="solve: not explained: brand_new"):
        yaml_keys.page()


@pytest.mark.parametrize(
    ("form", "words"),
    [
        ({"type": "number", "exclusiveMinimum": 0}, "number, above 0"),
        ({"anyOf": [{"type": "number"}, {"type": "string"}]}, "number (or with its unit)"),
        ({"anyOf": [{"enum": ["a", True]}, {"type": "null"}]}, "`a`, `true`"),
        ({"type": "integer", "minimum": 1, "maximum": 9}, "whole number, 1 to 9"),
    ],
)
def test_a_form_in_words(form: dict, words: str) -> None:
    assert yaml_keys.takes(form) == words


def test_sources_are_those_of_the_docstrings() -> None:
    text = sources_of_formulas.page()
    assert "Craig, Kurdila (2006)" in text
    assert text.count("\n| `") > 35


def test_the_version_is_one_and_has_its_changes() -> None:
    found = re.findall(r'(?m)^version\W+"?([\d.]+)', (ROOT / "pyproject.toml").read_text("utf-8"))
    cited = re.findall(r"(?m)^version: ([\d.]+)", (ROOT / "CITATION.cff").read_text("utf-8"))
    assert found == cited
    assert f"## {found[0]}" in (ROOT / "CHANGELOG.md").read_text("utf-8")
