"""The packages of pinflex stand in one line, and imports go one way along it.

Claims:
    Layout
    - packages import only those above them in the table of `pinflex/__init__.py`, late imports too
      | the code's own imports | exact | passes
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import pinflex as pf

ROOT = Path(pf.__file__).parent
TABLE = re.findall(r"^    (\w+)  +\w", (pf.__doc__ or "").split("Where the code is")[1], re.M)
BESIDE = (
    *("arrays", "boundary", "doors", "errors", "linalg", "names", "progress"),
    *("registered", "report", "rotations", "text", "threads", "writing"),
)
PACKAGES = sorted(path.parent.name for path in ROOT.glob("*/__init__.py"))


def imported(path):
    """What a file imports of pinflex, inside functions too: a package, or a module beside them."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        yield from (name.split(".")[1] for name in names if name.startswith("pinflex."))


def of_packages(package):
    """Top-level modules that the files of a package import, of pinflex the package."""
    for path in (ROOT / package).glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [str(node.module)]
            for name in names:
                parts = name.split(".")
                yield parts[1] if parts[0] == "pinflex" and len(parts) > 1 else parts[0]


@pytest.mark.parametrize("package", ["results", "viewer"])
def test_results_and_viewer_know_no_physics(package):
    assert not {"pinocchio", "mechanics", "bodies", "levels", "recovery"} & set(
        of_packages(package)
    )


def test_the_viewer_reads_no_urdf_and_no_yaml():
    """What it draws a run by is in its meta; only meshes in Collada are XML."""
    for path in (ROOT / "viewer").glob("*.py"):
        text = path.read_text("utf-8")
        parses = any(word in text for word in ("import yaml", "ElementTree"))
        assert parses == (path.name == "collada.py"), path


BLOCKED = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "pinocchio" or name.startswith("pinflex.mechanics"):
            raise ImportError(name)

sys.meta_path.insert(0, Blocked())
import pinflex as pf
pf.view(pf.Result.load(sys.argv[1]), sys.argv[2])
"""


@pytest.mark.parametrize("level, compact", [("rigid", False), ("quasistatic", True)])
def test_a_saved_run_becomes_a_page_without_pinocchio(level, compact, tmp_path):
    run = pf.solve(pf.load("3rrr"), level=level, samples=11)
    run.save(tmp_path / "run.npz", compact)
    page = tmp_path / "run.html"
    subprocess.run([sys.executable, "-c", BLOCKED, tmp_path / "run.npz", page], check=True)
    assert page.stat().st_size > 100_000  # three.js and the robot are in it


def test_every_public_name_is_found_where_the_package_says():
    assert {name for name in pf.__all__ if getattr(pf, name) is not None} == set(pf.__all__)
    assert set(pf.__all__) == set(pf._MODULE)


def test_the_unit_tests_have_the_folders_of_the_packages():
    folders = {path.parent.name for path in Path(__file__).parent.glob("*/test_*.py")}
    assert folders <= set(PACKAGES) and len(folders) > 9


def test_the_table_names_every_package():
    assert sorted(TABLE) == PACKAGES


@pytest.mark.parametrize("package", TABLE)
def test_a_package_imports_only_those_above_it(package):
    allowed = {*TABLE[: TABLE.index(package) + 1], *BESIDE}
    for path in (ROOT / package).glob("*.py"):
        assert set(imported(path)) <= allowed, path


def test_what_stands_beside_the_packages_imports_none_of_them():
    for name in BESIDE:
        assert set(imported(ROOT / f"{name}.py")) <= set(BESIDE), name


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_hides_no_public_name_and_imports_nothing_itself(package):
    assert package not in pf.__all__
    body = ast.parse((ROOT / package / "__init__.py").read_text("utf-8")).body
    assert len(body) == 1 and isinstance(body[0], ast.Expr)  # its docstring: import time counts
