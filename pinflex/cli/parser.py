"""The parser of the command line: commands, their help, what it says of a typing error."""

from __future__ import annotations

import argparse
import difflib
import re
from collections.abc import Sequence
from typing import Any, NoReturn

from pinflex.cli.commands import SUMMARIES
from pinflex.cli.options import SHARED, Command, add
from pinflex.errors import DescriptionError

_LONGEST = 15  # characters of a command's name, indented by four

Commands = Any  # argparse's private _SubParsersAction


class Parser(argparse.ArgumentParser):
    """A parser whose complaints are one line."""

    def error(self, message: str) -> NoReturn:
        """Raise what argparse prints with the usage."""
        typed = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message)
        choices = typed[2].replace("'", "").split(", ") if typed else []
        close = difflib.get_close_matches(typed[1], choices, 1) if typed else []
        hint = f' Did you mean "{close[0]}"?' if close else ""
        raise DescriptionError(f"{message}.{hint} See `{self.prog} --help`.")

    def refuse(self, rest: Sequence[str]) -> NoReturn:
        """Raise what arguments the command does not know, with the closest option."""
        first = rest[0].partition("=")[0]
        options = [name for name in self._option_string_actions if name.startswith("--")]
        close = difflib.get_close_matches(first, options, 1) if first.startswith("-") else []
        hint = f". Did you mean {close[0]}?" if close else "."
        raise DescriptionError(
            f"unrecognized arguments: {' '.join(rest)}{hint} See `{self.prog} --help`."
        )


class Layout(argparse.RawDescriptionHelpFormatter):
    """Help texts of 96 columns, broken as written."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=28, width=96)


class Overview(Layout):
    """The same for the list of all commands: a line each."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog)
        self._action_max_length = _LONGEST


def name_only(commands: Commands, name: str) -> None:
    """Add a command to the overview."""
    commands.add_parser(name, help=SUMMARIES[name])


def complete(commands: Commands, name: str, command: Command) -> None:
    """Add a command with its options, after those that all share."""
    summary = SUMMARIES[name]
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.\n{command.text}",
        epilog=f"example:\n  {command.example}",
        formatter_class=Layout,
        allow_abbrev=False,
    )
    parser.set_defaults(command_parser=parser, run=command.run)
    add(parser, [*command.shared, *SHARED, *command.options], command.function)
