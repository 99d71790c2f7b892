"""Where the formulas come from: every `Source:` line of the code's docstrings."""

from __future__ import annotations

import ast
import re
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "pinflex"
_SOURCE = re.compile(r"^\s*Source: (.+?)(?=\n\s*\n|\n\s*[A-Z]\w+:|\Z)", re.DOTALL | re.MULTILINE)
_INTRO = """# Sources

Where a formula was taken from somewhere, the docstring beside it says so. This is the list of all
of them, made from the code; [theory](../theory.md) puts them in one notation.

| code | source |
|---|---|
"""


def page() -> str:
    """A table of places and sources."""
    rows = []
    for file in sorted(PACKAGE.rglob("*.py")):
        place = file.relative_to(PACKAGE).as_posix()
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                text = ast.get_docstring(node) or ""
                where = place if isinstance(node, ast.Module) else f"{place}: {node.name}"
                rows += [f"| `{where}` | {_cell(found)} |" for found in _SOURCE.findall(text)]
    return _INTRO + "\n".join(rows) + "\n"


def _cell(text: str) -> str:
    return re.sub(r"([*_|<>\[\]])", r"\\\1", " ".join(text.split()))
