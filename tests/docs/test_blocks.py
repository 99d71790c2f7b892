"""Every code block of README.md and of the documentation runs.

Claims:
    Documentation, other systems
    - Python and shell blocks of README.md, models/README.md and docs run in their order; `pip
      install` and the site's own commands are held to pyproject.toml and `.ci/run` | the files |
      exit code 0 | all: 14 python, 17 shell
    - YAML blocks have keys, words and bounds that the readers know | `pinflex schema` | valid | 7
    - commands shown inside sentences have the options shown | the parser | all | over 40
"""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest

import pinflex as pf
from pinflex.__main__ import build_parser, main
from pinflex.description.description import json_schema
from pinflex.description.reading.yaml_text import load
from tests.docs.blocks import ELSEWHERE, PAGES, ROOT, Block, blocks

RUN = [block for block in blocks("python", "sh") if block.file not in ELSEWHERE]
FILES = sorted({block.file for block in RUN})
# names that a block takes from the sentence before it
GIVEN = {"models/README.md": lambda: {"description": pf.load("3rrr").description}}
# Words added here, so that the blocks together take seconds; `.ci/wheel` runs the first whole.
SHORTER = {
    "pinflex compare delta": ["--levels", "quasistatic"],
    "pinflex compare 3rrs": ["--levels", "ked", "--set", "solve.samples=41"],
    "pinflex sweep ur5": ["--set", "solve.samples=11", "--jobs", "1"],
    "pinflex map 3rrs": ["--jobs", "1"],
    "python -m pytest": [
        "-q",
        "-p",
        "no:cacheprovider",
        str(ROOT / "tests/unit/test_rotations.py"),
    ],
}
_ARM = """<mujoco model="arm"><worldbody><body name="upper">
  <joint name="shoulder" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .4 0 0"/>
  <body name="lower" pos=".4 0 0"><joint name="elbow" axis="0 1 0"/>
  <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/></body>
</body></worldbody><actuator><motor joint="shoulder"/><motor joint="elbow"/></actuator></mujoco>
"""
_URDF = """<robot name="my_robot"><link name="base"/><link name="upper">
<inertial><origin xyz=".2 0 0"/><mass value="1"/>
<inertia ixx="1e-4" iyy=".014" izz=".014" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><origin xyz=".2 0 0" rpy="0 1.5708 0"/><geometry><cylinder radius=".02" length=".4"/>
</geometry></visual></link>
<link name="lower"><inertial><origin xyz=".15 0 0"/><mass value=".5"/>
<inertia ixx="1e-4" iyy=".004" izz=".004" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit effort="50" velocity="3" lower="-2" upper="2"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="0 1 0"/>
<origin xyz=".4 0 0"/><limit effort="50" velocity="3" lower="-2" upper="2"/></joint></robot>
"""


def commands(block: Block) -> Iterator[tuple[list[str], str]]:
    """The command lines of a block: words without comments, and the line as it stands."""
    for line in block.code.replace("\\\n", " ").splitlines():
        for part in line.split(" && "):
            words = shlex.split(part, comments=True)
            if words:
                yield words, part


@pytest.fixture
def robots(tmp_path: Path) -> Path:
    """A folder with the files of one's own that blocks name."""
    (tmp_path / "robot.xml").write_text(_ARM)
    (tmp_path / "my_robot.urdf").write_text(_URDF)
    return tmp_path


def uncomment(file: Path) -> None:
    """Take the links that `pinflex new` proposes, as the text says."""
    text = file.read_text("utf-8")
    file.write_text(re.sub(r"^# (flexible:|  \w+: \{material)", r"\1", text, flags=re.M), "utf-8")


@pytest.mark.parametrize("file", FILES)
def test_blocks_run_in_their_order(
    file: str, robots: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(robots)
    for block in (block for block in RUN if block.file == file):
        if block.language == "python":
            names: dict[str, Any] = {"__name__": "block", **GIVEN.get(file, dict)()}
            code = compile(block.code, block.name, "exec")
            exec(code, names)
            continue
        for words, line in commands(block):
            if line == "pinflex compare my_robot.yaml":
                uncomment(robots / "my_robot.yaml")
            more = next((more for head, more in SHORTER.items() if line.startswith(head)), [])
            assert _run([*words, *more], line) == 0, (block.name, line, capsys.readouterr().err)


def _run(words: list[str], line: str) -> int:
    """Run one command; its exit status."""
    if words[0] == "pinflex":
        return main(words[1:])
    if words[0] == "eval":  # in a shell of its own, in which the name must complete
        own = shlex.join([sys.executable, "-m", "pinflex"])
        script = f'pinflex() {{ {own} "$@"; }}\n{line}\ncomplete -p pinflex'
        return subprocess.run(["bash", "-c", script], check=False, timeout=60).returncode
    if words[0] == "python":
        return subprocess.run([sys.executable, *words[1:]], check=False, timeout=60).returncode
    return _understood(line)


def _understood(line: str) -> int:
    """What changes the environment or never ends: 0 where it names what there is."""
    installed = re.fullmatch(r'pip install (?:-e )?"?(?:\.|pinflex)(?:\[(\w+)\])?"?', line)
    if installed:  # .ci/wheel and .ci/run install so, with the README's own lines
        extras = re.findall(r"^(\w+) = \[", (ROOT / "pyproject.toml").read_text("utf-8"), re.M)
        return not (installed[1] is None or installed[1] in extras)
    site = re.sub(r"^\w+=\S+ | *#.*", "", line)
    return not (site == "mkdocs serve" or site in (ROOT / ".ci/run").read_text("utf-8"))


def optional(form: Any) -> Any:
    """A schema of parts of a description: nothing is required."""
    if isinstance(form, dict):
        return {key: optional(value) for key, value in form.items() if key != "required"}
    return [optional(one) for one in form] if isinstance(form, list) else form


@pytest.mark.parametrize("block", blocks("yaml"), ids=lambda b: b.name)
def test_a_description_has_keys_that_exist(block: Block) -> None:
    found = load(block.code, block.name)
    schema = json_schema() if "urdf" in found else optional(json_schema())
    jsonschema.validate(found, schema)


def test_every_fence_is_of_a_known_language() -> None:
    for page in PAGES:
        fences = re.findall(r"^```+(\w*)$", page.read_text("utf-8"), re.MULTILINE)
        opened = fences[::2]  # a closing fence has no word
        assert {*opened} <= {"", "python", "sh", "yaml", "text"}, page
        assert not any(fences[1::2]), page


OPTIONS = {
    name: {option for action in one._actions for option in action.option_strings}
    for action in build_parser()._actions
    if isinstance(action.choices, dict)
    for name, one in action.choices.items()
}


def test_commands_in_the_text_have_the_options_that_they_show() -> None:
    seen = 0
    tutorials = sorted((ROOT / "docs/tutorials").glob("*.py"))
    for page in (*PAGES, *tutorials):
        text = re.sub(r"\n#? ?", " ", page.read_text("utf-8"))
        for span in re.findall(r"`pinflex ([a-z][^`]*)`", text):
            name, *words = span.split()
            for one in name.split("|"):
                assert one in OPTIONS, f"{page.name}: pinflex {span}"
                options = {word for word in words if re.fullmatch(r"--?[a-z][\w-]*", word)}
                assert options <= OPTIONS[one], f"{page.name}: pinflex {span}"
            seen += 1
    assert seen > 40


def test_the_notebook_for_colab_says_what_the_readme_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two cells of code: the first installs, the second is run here."""
    notebook = json.loads((ROOT / "examples/colab.ipynb").read_text("utf-8"))
    install, ask = ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "code"]
    assert install == "%pip install -q pinflex"
    monkeypatch.chdir(tmp_path)
    exec(compile(ask, "colab.ipynb", "exec"), {"__name__": "cell"})
    said = capsys.readouterr().out
    readme = (ROOT / "README.md").read_text("utf-8")
    off, stress = re.findall(r"up to ([\d.]+) mm.*?up to ([\d.]+) MPa", readme, re.S)[0]
    assert f"{off} mm" in said
    assert f"bears {float(stress):.1f} MPa" in said
    assert (tmp_path / "delta.html").stat().st_size > 1e5
