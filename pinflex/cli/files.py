"""`pinflex import`, `new`, `schema` and `completion`: files for pinflex, editors and shells."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pinflex.cli.commands import SHELLS
from pinflex.cli.console import answer
from pinflex.description.files import nameable
from pinflex.description.reading.schema import shown
from pinflex.errors import DescriptionError
from pinflex.writing import write_text

# what completes MODEL: a shipped name or a file
_MODELS = {
    "bash": '_pinflex_models() { compgen -W "%s" -- "$1"; compgen -f -- "$1"; }',
    "zsh": "_pinflex_models() { _alternative 'models:model:(%s)' 'files:file:_files'; }",
}


def run_import(args: argparse.Namespace) -> int:
    """Write the YAML of a robot's file."""
    from pinflex.studies.scenes.new_scene import new_scene

    source = Path(args.source)
    if not source.name or not nameable(source):
        raise DescriptionError(
            f"{shown(args.source)}: no robot's file. Give a URDF, MJCF, SDF or xacro."
        )
    name = args.source.rpartition(":")[2] if ":" in args.source else source.with_suffix("")
    out = Path(args.out) if args.out else Path(f"{name}.yaml")
    if out.suffix.lower() not in (".yaml", ".yml"):
        raise DescriptionError(f"{out}: a description ends in .yaml. Give -o NAME.yaml.")
    if out.exists() and (not args.force or out.resolve() == source.resolve()):
        raise DescriptionError(f"{out}: is there already. Give another -o FILE, or --force.")
    text, mechanism = new_scene(args.source, out, args.flexible, _arguments(args.arg))
    write_text(out, text)
    said = f"{out} written, but it does not load yet: see the remark in it"
    if mechanism is not None:
        motors = len(mechanism.motors)
        said = f"{out} written: mobility {mechanism.report.mobility}, {motors} motors"
        if "\n# loops:" in text:
            said += " while its loops are open; they are proposed behind #"
        if "\n# flexible:" in text:
            said += f".\nRemove the # of what is right, then: pinflex check {out}"
    answer(args, {"file": str(out), "closed": mechanism is not None}, f"{said}\n")
    return 0 if mechanism is not None else 1


def _arguments(texts: Sequence[str]) -> dict[str, str]:
    for text in texts:
        if not text.partition("=")[2]:
            raise DescriptionError(f"--arg {shown(text)}: no value. Give NAME=VALUE.")
    return {text.partition("=")[0].strip(): text.partition("=")[2] for text in texts}


def run_schema(args: argparse.Namespace) -> int:
    """Print or write the schema."""
    from pinflex.description.description import json_schema

    text = json.dumps(json_schema(), indent=1) + "\n"
    if args.out:
        write_text(args.out, text)
        text = f"{args.out} written\n"
    print(text, end="")
    return 0


def run_completion(args: argparse.Namespace) -> int:
    """Print the script of the shell."""
    print(script(args.whole(), args.shell))
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

    for parser in _commands(whole):
        for action in parser._actions:
            if action.dest == "model":
                action.complete = dict.fromkeys(SHELLS, "_pinflex_models")  # type: ignore[attr-defined]
            elif action.metavar and "FILE" in str(action.metavar):
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    # a text by shell, although shtab's annotation says one text
    models: Any = {name: text % " ".join(model_names()) for name, text in _MODELS.items()}
    return str(shtab.complete(whole, shell, preamble=models))


def _commands(whole: argparse.ArgumentParser) -> list[argparse.ArgumentParser]:
    groups = [a for a in whole._actions if isinstance(a, argparse._SubParsersAction)]
    return [*groups[0].choices.values()]
