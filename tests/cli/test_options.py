"""Options of commands are those of the functions of `pf`: held to what Python says of these.

Claims:
    Layout
    - options of 14 commands: names, types, defaults and words, read from the source without
      importing it, are those of the function | `inspect` | exact | exact
"""

from __future__ import annotations

import inspect
import subprocess
import sys

import pytest

import pinflex as pf
from pinflex.cli.commands import COMMANDS
from pinflex.cli.options import parameters

FUNCTIONS = {name: command.function for name, command in COMMANDS.items() if command.function}


@pytest.mark.parametrize("command", FUNCTIONS)
def test_types_defaults_and_texts_are_those_of_the_function(command: str) -> None:
    function = getattr(pf, FUNCTIONS[command])
    known, signature = parameters(FUNCTIONS[command]), inspect.signature(function).parameters
    doc = " ".join(inspect.getdoc(function).split())
    assert [*known] == [*signature]
    for name, one in known.items():
        default = signature[name].default
        assert one.default == (None if default is inspect.Parameter.empty else default), name
        assert str(signature[name].annotation).removesuffix(" | None") == one.kind, name
        assert one.text in doc, name
    asked = (x for x in COMMANDS[command].options if isinstance(x, str))
    assert all(known[name].text for name in asked)


@pytest.mark.parametrize("command", ["solve", "frf", "sweep"])
def test_the_help_of_a_command_loads_no_numpy(command: str) -> None:
    code = (
        "import sys; from pinflex.__main__ import main\n"
        f"try: main([{command!r}, '--help'])\nexcept SystemExit: pass\n"
        "assert 'numpy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
