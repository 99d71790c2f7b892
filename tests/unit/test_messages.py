"""The messages of bad input are part of the interface: they stay as they were written down.

Claims:
    Equations
    - messages of over 300 bad inputs: files, options of `solve`, sections, materials, motions |
      `golden/messages.txt` | text | exact
    Tolerances, collocation
    - every run that ends early says why from one list of endings | the sources | none left out |
      passes
"""

from __future__ import annotations

import ast
from pathlib import Path

import pinflex as pf
from pinflex.errors import Ending
from pinflex.text import percent
from tests.golden.bad_inputs import FILE, messages

MARCHING = ("solver", "levels", "integrators")


def test_every_bad_input_is_told_what_it_was_told_before() -> None:
    before, now = (text.split("\n\n") for text in (FILE.read_text("utf-8"), messages()))
    assert [entry for entry in now if entry.endswith("\nno error")] == []
    assert [pair for pair in zip(before, now, strict=True) if pair[0] != pair[1]] == []


def test_every_run_that_ends_early_says_why_from_one_list() -> None:
    """Each ConvergenceError of the marches names its ending, and no ending is left over."""
    named = set[str]()
    for path in (
        file for room in MARCHING for file in (Path(pf.__file__).parent / room).rglob("*.py")
    ):
        text = path.read_text("utf-8")
        named |= {
            node.attr for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Attribute)
        }
        for call in ast.walk(ast.parse(text)):
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "ConvergenceError":
                assert {"ending", None} & {word.arg for word in call.keywords}, path
    assert {ending.name for ending in Ending} <= named


def test_shares_just_below_one_read_as_100_percent() -> None:
    assert [percent(share) for share in (0.994, 0.997, 1.0)] == ["99 %", "100 %", "100 %"]
    assert percent(0.9996, 3) == "100 %"
