"""Input that nobody means: it gets one sentence, at once, and nothing it names is run or lost.

Claims:
    Hard cases
    - a kernel library cut short or overwritten is left alone; cells of a CSV that a spreadsheet
      would compute are text; tags that lie, names too long, endless shapers | - | refused | passes
"""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import pinflex as pf
from pinflex.__main__ import main
from pinflex.description.motions import trajectory
from pinflex.description.reading import yaml_text
from pinflex.errors import ModelNotFoundError
from pinflex.kernel import build
from pinflex.kernel.library import kernel
from pinflex.writing import write_csv

ROOT = Path(__file__).parents[2]


def said(capsys: pytest.CaptureFixture[str], *command: str) -> str:
    """What a command that fails says on stderr."""
    assert main(list(command)) == 2
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("!!float ''", "'' is no float"),
        ("!!int ''", "'' is no int"),
        ("!!bool maybe", "'maybe' is no bool"),
        ("!!timestamp noon", "'noon' is no timestamp"),
    ],
)
def test_a_scalar_that_is_not_what_its_tag_says_is_named_by_line(value: str, words: str) -> None:
    with pytest.raises(pf.DescriptionError, match=f"scene.yaml, line 2: {words}"):
        yaml_text.load(f"a: 1\nb: {value}\n", "scene.yaml")


@pytest.mark.parametrize(("kind", "most"), [("zv", 11), ("zvd", 7), ("ei", 7)])
def test_a_shaper_of_endless_impulses_is_refused(kind: str, most: int) -> None:
    assert trajectory.shaper(kind, range(1, most + 1)).times.size <= trajectory.MOST
    with pytest.raises(pf.DescriptionError, match=rf"{most + 1} frequencies make \d\^{most + 1} "):
        trajectory.shaper(kind, range(1, most + 2))
    block = {"kind": kind, "frequencies": [*range(1, 21)]}
    with pytest.raises(pf.DescriptionError, match=f"Give at most {most}"):
        trajectory.read(block, "motion.shaper")


@pytest.mark.parametrize("source", ["a" * 5000, "a/" * 3000])
def test_a_name_that_no_file_can_have(tmp_path: Path, source: str) -> None:
    with pytest.raises(ModelNotFoundError, match="no model"):
        pf.load(source)
    (tmp_path / "scene.yaml").write_text(f"urdf: {source}\n")
    with pytest.raises(ModelNotFoundError, match="no file .* beside the YAML"):
        pf.load(tmp_path / "scene.yaml")


def test_a_source_without_a_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert "'': no robot's file" in said(capsys, "import", "")


def test_figures_of_unknown_kind_are_refused_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figure = str(tmp_path / "x.xyz")
    for command in (("command", "delta", "--verify", "--plot"), ("frf", "3rrr", "-o")):
        assert "no such kind of figure" in said(capsys, *command, figure)


def test_poses_beyond_any_robot(capsys: pytest.CaptureFixture[str]) -> None:
    assert "more than 1000 rad" in said(capsys, "frf", "ur5", "--pose", "elbow_joint=1e9")
    grid = f"elbow_joint={'9' * 400}"
    assert "no increasing numbers" in said(capsys, "map", "ur5", "--grid", grid)


def test_the_axis_of_a_fixed_joint_is_not_read(tmp_path: Path) -> None:
    text = (ROOT / "models/3rrr/3rrr.urdf").read_text()
    fixed = text.replace('type="fixed">', 'type="fixed"><axis xyz="a b c"/>', 1)
    assert fixed != text
    (tmp_path / "3rrr.urdf").write_text(fixed)
    shutil.copy(ROOT / "models/3rrr/3rrr.yaml", tmp_path)
    run = pf.solve(pf.load(tmp_path / "3rrr.yaml"), level="rigid", samples=21)
    pf.view(run, tmp_path / "page.html")
    assert (tmp_path / "page.html").stat().st_size > 1e5


def test_cells_that_a_spreadsheet_would_compute_are_text(tmp_path: Path) -> None:
    cells = ["=1+1", "+cmd|' /C calc'!A0", "-2.5", "-x", "@sum", "plain", "-inf"]
    path = write_csv(tmp_path / "t.csv", ["=a"], [[cell] for cell in cells])
    with path.open(newline="") as stream:
        read = [row[0] for row in csv.reader(stream)]
    assert read == ["'=a", "'=1+1", "'+cmd|' /C calc'!A0", "-2.5", "'-x", "'@sum", "plain", "-inf"]


@pytest.mark.parametrize("damage", ["cut", "zeros"])
@pytest.mark.skipif(kernel().functions is None, reason="no compiled kernel")
def test_a_damaged_kernel_is_left_alone(tmp_path: Path, damage: str) -> None:
    shutil.copytree(
        ROOT / "pinflex",
        tmp_path / "pinflex",
        ignore=shutil.ignore_patterns("__pycache__", "*.so*"),
    )
    for library in (ROOT / "pinflex/kernel").glob(f"*{build.TARGETS[build.here()][2]}"):
        whole = library.read_bytes()
        broken = whole[:60000] if damage == "cut" else whole[:60000] + bytes(len(whole) - 60000)
        (tmp_path / "pinflex/kernel" / library.name).write_bytes(broken)
        shutil.copy(build.digest_of(library), tmp_path / "pinflex/kernel")
    done = subprocess.run(
        [sys.executable, "-m", "pinflex", "--version"], capture_output=True, text=True, check=False,
        env=os.environ | {"PYTHONPATH": str(tmp_path)}, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "is damaged" in done.stdout
