"""Exported functions of two arguments or more say what each of them is, with shape and unit."""

from __future__ import annotations

import ast
from pathlib import Path

import pinflex as pf

ROOT = Path(pf.__file__).parent
FILES = {name: Path(*module.split(".")) for name, module in pf._MODULE.items()}
WHERE = {name: ROOT.parent / f"{file}.py" for name, file in FILES.items()}


def lacking(path: Path, names: set[str] | None = None) -> list[str]:
    """Public functions and methods of a module, or those of some names, without `Args:`."""
    found = []
    for node in ast.parse(path.read_text("utf-8")).body:
        whole = isinstance(node, ast.ClassDef) and not node.name.startswith("_")
        if names is not None and getattr(node, "name", None) not in names:
            continue
        for item in node.body if isinstance(node, ast.ClassDef) and whole else [node]:
            if not isinstance(item, ast.FunctionDef) or item.name.startswith("_"):
                continue
            every = (*item.args.posonlyargs, *item.args.args, *item.args.kwonlyargs)
            if len([a for a in every if a.arg not in ("self", "cls")]) < 2:
                continue
            if "Args:" not in (ast.get_docstring(item) or ""):
                found.append(f"{path.name}: {item.name}")
    return found


def test_what_pinflex_exports_names_its_arguments() -> None:
    for path in {*WHERE.values()}:
        assert not lacking(path, {name for name, file in WHERE.items() if file == path})
