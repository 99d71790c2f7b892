"""`pinflex completion`: what makes a shell complete commands, options and models."""

from __future__ import annotations

import argparse
from typing import Any

from pinflex.cli import parser
from pinflex.errors import DescriptionError

SHELLS = ("bash", "zsh")
# what completes MODEL: a shipped name or a file
_MODELS = {
    "bash": '_pinflex_models() { compgen -W "%s" -- "$1"; compgen -f -- "$1"; }',
    "zsh": "_pinflex_models() { _alternative 'models:model:(%s)' 'files:file:_files'; }",
}


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "completion",
        "what makes a shell complete commands, options and models",
        """
Needs the package shtab: pip install "pinflex[completion]". The line of the example stays where it
stands in ~/.bashrc (zsh: with `zsh` in ~/.zshrc, behind compinit).""",
        'eval "$(pinflex completion bash)"',
        model=False,
    )
    p.add_argument("shell", choices=SHELLS, metavar="SHELL", help=f"{' or '.join(SHELLS)}")


def run(args: argparse.Namespace) -> int:
    """Print the script of the shell."""
    print(script(args.parser, args.shell))
    return 0


def script(whole: argparse.ArgumentParser, shell: str) -> str:
    """The script that a shell evaluates."""
    try:
        import shtab
    except ImportError as error:
        raise DescriptionError(
            'completion: the package shtab is not installed. pip install "pinflex[completion]".'
        ) from error
    from pinflex.description.description import model_names

    for one in _commands(whole):
        for action in one._actions:
            if action.dest == "model":
                action.complete = dict.fromkeys(SHELLS, "_pinflex_models")  # type: ignore[attr-defined]
            elif action.metavar and "FILE" in str(action.metavar):
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    # a text by shell, although shtab's annotation says one text
    models: Any = {name: text % " ".join(model_names()) for name, text in _MODELS.items()}
    return str(shtab.complete(whole, shell, preamble=models))


def _commands(whole: argparse.ArgumentParser) -> list[argparse.ArgumentParser]:
    found = [a for a in whole._actions if isinstance(a, argparse._SubParsersAction)]
    return [*found[0].choices.values()]
