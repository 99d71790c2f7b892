"""Words of other tools in the documentation are theirs, and those of pinflex are its own."""

from __future__ import annotations

import re
from functools import reduce
from typing import Any

import pinocchio as pin
import pytest

import pinflex as pf
from tests.docs.blocks import PAGES, ROOT

_TEXT = (ROOT / "docs/coming_from.md").read_text("utf-8")


def words(tool: str) -> list[str]:
    """Code in the first column of a tool's table, without arguments."""
    section = _TEXT.split(f"\n## {tool}\n")[1].split("\n## ")[0]
    cells = [row.split("|")[1] for row in section.splitlines() if row.startswith("|")]
    return [word.partition("(")[0] for cell in cells for word in re.findall(r"`([^`]+)`", cell)]


def has(thing: Any, path: str) -> bool:
    try:
        reduce(getattr, path.split("."), thing)
    except AttributeError:
        return False
    return True


def test_words_of_pinocchio() -> None:
    from pinocchio import visualize

    model = pin.Model()
    homes = {"pin.": pin, "model.": model, "data.": model.createData()}
    plain = {"q"}  # what everybody calls it
    for word in set(words("Pinocchio")) - plain:
        head = next((head for head in homes if word.startswith(head)), "")
        path = word.removeprefix(head).partition("[")[0]
        assert has(homes.get(head, pin), path) or has(visualize, path), word


def test_words_of_exudyn() -> None:
    exudyn = pytest.importorskip("exudyn")
    from exudyn import FEM, itemInterface, utilities

    assert utilities
    system, settings = exudyn.MainSystem, exudyn.SimulationSettings()
    for word in words("Exudyn"):
        known = has(system, word.removeprefix("mbs.")) if word.startswith("mbs.") else False
        assert known or any(has(home, word) for home in (itemInterface, FEM, settings)), word


def test_names_of_pinflex_in_the_text_are_public() -> None:
    pages = [*PAGES, *(ROOT / "docs/tutorials").glob("*.py")]
    for page in pages:
        for name in re.findall(r"\bpf\.(\w+)", page.read_text("utf-8")):
            assert name in pf.__all__, f"{page.name}: pf.{name}"
