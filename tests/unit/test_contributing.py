"""CONTRIBUTING.md says where things are, and its examples are those that the tests run.

Claims:
    Equations
    - CONTRIBUTING.md: 12 concepts, 12 places, 5 examples are where and what it says | - | names,
      text | exact
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
PLACES = re.findall(r"`(pinflex/[\w/]+\.py)`: `(\w+)`", TEXT)
BLOCKS = re.findall(r"```python\n(.*?)\n```", TEXT, re.S)


def test_it_names_twelve_concepts_and_ten_things_or_more() -> None:
    assert len(PLACES) >= 22
    assert len(PLACES) == len({*PLACES})


@pytest.mark.parametrize(("file", "symbol"), PLACES)
def test_what_it_names_is_there(file: str, symbol: str) -> None:
    names = set()
    for node in ast.parse((ROOT / file).read_text("utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {target.id for target in targets if isinstance(target, ast.Name)}
    assert symbol in names


def test_files_that_it_names_beside_are_there() -> None:
    for path in re.findall(r"`((?:pinflex|tests|models)/[\w/]+\.\w+)`", TEXT):
        assert (ROOT / path).is_file(), path


def test_names_of_its_prose_are_in_the_files_beside_them() -> None:
    named = re.findall(r"`(\w+)`\s+(?:of|in)\s+`([\w/]+\.py)`", TEXT)
    assert len(named) >= 5
    for name, file in named:
        (path,) = (x for x in ROOT.glob("pinflex/**/*.py") if x.as_posix().endswith(f"/{file}"))
        assert re.search(rf"\b{name}\b", path.read_text("utf-8")), (name, file)


def test_its_five_examples_are_those_of_the_test() -> None:
    tested = (ROOT / "tests/unit/test_extensions.py").read_text("utf-8")
    parts = [part.partition("\n")[2].split("# ----")[0] for part in tested.split("# ---- ")[1:]]
    assert [part.rstrip() for part in parts] == BLOCKS
