"""How large the house is: `python -m tests.benchmarks.house [--walk] [--chain] [--late]`.

Lines and modules of the package, folders of many files, the longest chain of imports, circles, and
imports inside functions, those that the house permits apart from others (`--late` names these).
`--walk`: the files that one answer enters, and the lines of Python that it executes:
`pf.solve(pf.load("3rrs"), level="coupled")`, every array read and the curves drawn. What bodies of
modules call, which are loaded when they are used, is counted apart.
"""

from __future__ import annotations

import argparse
import ast
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from inspect import CO_OPTIMIZED
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).parents[2] / "pinflex"
_MANY = 15  # files in a folder
# Imports inside functions that the house permits: a command imports what it runs when it runs, for
# `pinflex --help` would load everything; figures and pages are drawn by few, and published cases
# run by fewer. Libraries, optional ones and parts of scipy, are no modules of the package and not
# counted. Every other one hides a circle, or saves what should not cost so much.
_COMMANDS = ("pinflex.cli.", "pinflex.__main__")
_DRAWN_OR_VERIFIED = ("pinflex.viewer.", "pinflex.lab.")


def modules() -> dict[str, Path]:
    """Files of the package by the name that imports them."""
    names = {}
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT.parent).with_suffix("").parts
        names[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return names


class Imports(ast.NodeVisitor):
    """What one module imports of the package, at its top and inside functions.

    What only types need is not counted.
    """

    def __init__(self, path: Path, known: set[str]) -> None:
        self.top, self.late, self._known, self._inside = set[str](), list[str](), known, False
        self.visit(ast.parse(path.read_text("utf-8")))

    def visit_If(self, node: ast.If) -> None:
        if ast.unparse(node.test) != "TYPE_CHECKING":
            self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        before, self._inside = self._inside, True
        self.generic_visit(node)
        self._inside = before

    def visit_Import(self, node: ast.Import) -> None:
        self._add(alias.name for alias in node.names)

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        names = (f"{node.module}.{alias.name}" for alias in node.names)
        self._add(name if name in self._known else str(node.module) for name in names)

    def _add(self, names: Iterator[str]) -> None:
        of_us = dict.fromkeys(name for name in names if name in self._known)
        if self._inside:
            self.late += of_us
        else:
            self.top.update(of_us)


def permitted(module: str, imported: str) -> bool:
    """Whether a module may import another inside a function."""
    return module.startswith(_COMMANDS) or imported.startswith(_DRAWN_OR_VERIFIED)


def by_name(path: Path) -> int:
    """How often a module calls another by its name in a string (`pinflex.doors.door`)."""
    calls = (
        node for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.Call)
    )
    return sum(isinstance(call.func, ast.Name) and call.func.id == "door" for call in calls)


def longest(graph: dict[str, set[str]]) -> list[str]:
    """The longest chain of imports; the graph has no circle."""

    @cache
    def from_here(name: str) -> tuple[str, ...]:
        ways: list[tuple[str, ...]] = [from_here(each) for each in graph[name]]
        return (name, *max(ways, key=len, default=()))

    sys.setrecursionlimit(10_000)
    chains: list[tuple[str, ...]] = [from_here(name) for name in graph]
    most = max(chains, key=len)
    return list(most)


def walk() -> tuple[int, int, int]:
    """Files entered and lines executed for one answer, read and drawn; lines while modules load."""
    import matplotlib as mpl

    import pinflex as pf

    lines, loading = set[tuple[str, int]](), set[tuple[str, int]]()

    def ours(frame: FrameType) -> bool:
        return frame.f_code.co_filename.startswith(str(ROOT))

    def loads(frame: FrameType) -> bool:
        """Whether the body of a module or a class calls it, which is part of an import."""
        above = frame.f_back
        while above is not None and (not ours(above) or above.f_code.co_flags & CO_OPTIMIZED):
            above = above.f_back
        return above is not None

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        if not ours(frame) or not frame.f_code.co_flags & CO_OPTIMIZED:
            return None
        if event == "line":
            seen = loading if loads(frame) else lines
            seen.add((frame.f_code.co_filename, frame.f_lineno))
        return trace

    mpl.use("Agg")
    sys.settrace(trace)
    try:
        run = pf.solve(pf.load("3rrs"), level="coupled")
        for key in run.arrays:
            run.arrays[key]
        run.plot()
    finally:
        sys.settrace(None)
    return len({file for file, _ in lines}), len(lines), len(loading - lines)


def main() -> None:
    """Print the numbers."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--walk", action="store_true", help="files and lines of one answer")
    options.add_argument("--chain", action="store_true", help="name the longest chain")
    options.add_argument("--late", action="store_true", help="name late imports not permitted")
    asked = options.parse_args()
    files = modules()
    imports = {name: Imports(path, set(files)) for name, path in files.items()}
    graph = {name: each.top - {name} for name, each in imports.items()}
    folders = Counter(str(path.parent.relative_to(ROOT.parent)) for path in files.values())
    try:
        tuple(TopologicalSorter(graph).static_order())
        circles, chain = "none", longest(graph)
    except CycleError as error:
        circles, chain = " > ".join(error.args[1]), []
    lines = sum(len(path.read_text("utf-8").splitlines()) for path in files.values())
    code_c = sum(len(path.read_text("utf-8").splitlines()) for path in ROOT.rglob("*.[ch]"))
    print(f"Python lines        {lines}\nmodules             {len(files)}")
    print(f"lines of C          {code_c}")
    many = ", ".join(f"{name} {count}" for name, count in folders.most_common() if count > _MANY)
    print(f"folders above {_MANY}    {many or 'none'}\nlongest chain       {len(chain)}")
    print(f"circles             {circles}")
    late = [(name, to) for name, each in imports.items() for to in each.late]
    others = [(name, to) for name, to in late if not permitted(name, to)]
    print(f"late imports        {len(others)} and {len(late) - len(others)} permitted ones")
    print(f"called by name      {sum(map(by_name, files.values()))}")
    if asked.late:
        print("\n".join(f"  {name} imports {to}" for name, to in others))
    if asked.chain:
        print(" > ".join(name.removeprefix("pinflex.") for name in chain))
    if asked.walk:
        files, lines, loading = walk()
        print(
            f"one answer          {files} files, {lines} lines; {loading} more while modules load"
        )


if __name__ == "__main__":
    main()
