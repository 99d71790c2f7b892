"""What publishes a release says the same as the package: version, dependencies, commands."""

from __future__ import annotations

import re
import runpy
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.docs.blocks import ROOT

WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
CONDA = {"matplotlib": "matplotlib-base", "meshcat": "meshcat-python", "pin": "pinocchio"}


def project() -> str:
    return (ROOT / "pyproject.toml").read_text("utf-8")


def test_the_version_is_one_everywhere() -> None:
    """A tag is refused by the same script where it is not."""
    version = re.search(r'^version = "(.*)"', project(), re.M)
    assert version is not None
    script = runpy.run_path(str(ROOT / ".ci/version"))
    assert {*script["versions"]().values()} == {version[1]}
    assert script["main"](f"v{version[1]}") == 0
    assert script["main"]("v99.0.0") == 1
    assert script["notes"](version[1]).startswith("### Added")


def test_the_conda_recipe_brings_what_pip_brings() -> None:
    recipe = yaml.safe_load((ROOT / "packaging/conda-forge/recipe.yaml").read_text("utf-8"))
    block = re.search(r"^dependencies = \[(.*?)^\]", project(), re.M | re.S)
    assert block is not None
    assert f'version = "{recipe["context"]["version"]}"' in project()
    bare = {name.split()[0] for name in recipe["requirements"]["run"]}
    names = re.findall(r'"([A-Za-z0-9-]+)>=', block[1])
    assert bare - {"python"} == {CONDA.get(name, name) for name in names}
    for text in recipe["requirements"]["run"][1:]:
        name, bound = text.split()
        own = next((k for k, v in CONDA.items() if v == name), name)
        assert f'"{own}{bound}"' in block[1]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_a_workflow_runs_what_is_there(path: Path) -> None:
    """Scripts of .ci exist and may be run; extras are those of the package; rights are few."""
    flow: dict[str, Any] = yaml.safe_load(path.read_text("utf-8"))
    assert flow["permissions"] == {"contents": "read"}
    extras = re.findall(r"^(\w+) = \[", project(), re.M)
    steps = [step for job in flow["jobs"].values() for step in job.get("steps", ())]
    lines = [shlex.split(step["run"]) for step in steps if "run" in step]
    assert lines
    for words in lines:
        for word in words:
            if word.startswith((".ci/", "tests/")):
                assert (ROOT / word).exists(), word
            if extra := re.fullmatch(r"\.\[(\w+)\]", word):
                assert extra[1] in extras
        if words[0].startswith(".ci/"):
            assert (ROOT / words[0]).stat().st_mode & 0o111, words[0]
