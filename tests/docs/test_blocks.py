"""Every code block of README.md and of the documentation runs, or says why it does not."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest

import pinflex as pf
from pinflex.__main__ import build_parser, main
from pinflex.description.json_schema import json_schema
from pinflex.description.yaml_text import load
from tests.docs.blocks import PAGES, ROOT, Block, blocks

RUN = [block for block in blocks("python", "sh") if not block.reason]
FILES = sorted({block.file for block in RUN})
# names that a block takes from the sentence before it
GIVEN = {"models/README.md": lambda: {"description": pf.load("3rrr").description}}


def commands(block: Block) -> Iterator[list[str]]:
    """The command lines of a block, without comments, continued lines in one piece."""
    for line in block.code.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words:
            yield words


@pytest.mark.parametrize("file", FILES)
def test_blocks_run_in_their_order(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for block in (block for block in RUN if block.file == file):
        if block.language == "python":
            names: dict[str, Any] = {"__name__": "block", **GIVEN.get(file, dict)()}
            code = compile(block.code, block.name, "exec")
            exec(code, names)
            continue
        for words in commands(block):
            assert words[0] == "pinflex", f"{block.name}: say why `{words[0]}` is not run"
            assert main(words[1:]) == 0, f"{block.name}: {words}: {capsys.readouterr().err}"


@pytest.mark.parametrize("block", [b for b in blocks("sh") if b.reason], ids=lambda b: b.name)
def test_what_is_not_run_is_understood_at_least(block: Block) -> None:
    assert len(block.reason) > 10
    for words in commands(block):
        for part in " ".join(shlex.quote(word) for word in words).split(" '&&' "):
            call = shlex.split(part)
            if call[0] == "pinflex":
                assert build_parser().parse_args(call[1:]).command, block.name


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
