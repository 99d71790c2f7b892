"""The command line: `pinflex check | modes | advise | command | solve | compare | sweep ...`.

`pinflex.cli.commands` has what each says of itself, its options, and the function that runs it.
Exit codes: 0 done, 1 the scene cannot be solved, 2 bad input, 130 interrupted.
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from pinflex.cli import process
from pinflex.cli.commands import COMMANDS
from pinflex.cli.parser import Overview, Parser, complete, name_only
from pinflex.errors import VARIABLE, KernelWarning, PinflexError, quoted

_ISSUES = "please report it with the model and the output of --debug"
_TITLE = (
    "Rigid-flexible dynamics of robots: from a URDF and one YAML to torques, deviations, stress."
)
_EPILOG = """\
A MODEL is a YAML file, its folder, or the name of a shipped model: delta, 3rrr, 3rrs, ur5, ...

Begin with `pinflex compare delta`. `pinflex COMMAND --help` says more, with an example.
exit codes: 0 done, 1 the scene cannot be solved, 2 bad input"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    process.escape_unprintable()
    try:
        with process.ending() as end:
            return _run(arguments, ends=argv is None)
    except KeyboardInterrupt as stop:
        return _complain(str(stop) or "interrupted", end.code)
    except BrokenPipeError:
        process.drop_stdout()
        return 141
    except Exception as error:
        if "--debug" in arguments and not isinstance(error, MemoryError):
            raise
        return _complain(*_explained(error))


def _run(arguments: list[str], ends: bool) -> int:
    parser = build_parser(next(iter(arguments), ""))
    if not arguments:
        parser.print_help()
        return 2
    args, rest = parser.parse_known_args(arguments)
    if rest:
        args.command_parser.refuse(rest)
    args.whole = build_parser  # `completion` describes every command
    if args.debug:
        os.environ[VARIABLE] = "full"
    else:
        # a diverging run overflows before it is stopped; its own message says so
        warnings.simplefilter("ignore")
        warnings.simplefilter("default", KernelWarning)
        warnings.showwarning = process.show_warning
    if getattr(args, "limit", None) is not None and hasattr(args, "set"):
        args.set.append(f"limit={args.limit!r}")
    module, function = args.run
    with process.settled(ends):
        code: int = getattr(import_module(f"pinflex.cli.{module}"), function)(args)
    sys.stdout.flush()
    return code


def _explained(error: Exception) -> tuple[str, int]:
    """Sentence and exit code for an error."""
    if isinstance(error, PinflexError):
        return str(error), error.exit_code
    if isinstance(error, MemoryError):
        return "not enough memory. Ask for fewer samples or a larger dt", 1
    if isinstance(error, OSError):
        process.drop_stdout()
        name = f"{error.filename}: " if error.filename else ""
        return f"{name}{error.strerror or error}. Check the path and the disk", 2
    text = quoted(" ".join(str(error).split()))[:300]
    return f"internal error, {type(error).__name__}: {text}; {_ISSUES}", 1


def _complain(text: str, code: int) -> int:
    sys.stderr.write(f"pinflex: {text if text.endswith(('.', '!', '?')) else text + '.'}\n")
    return code


def build_parser(typed: str | None = None) -> argparse.ArgumentParser:
    """The parser of all commands; sooner made, of that one whose name was typed.

    Where another word was typed, or none (""), it knows the names of the commands alone.
    """
    parser = Parser(prog="pinflex", description=_TITLE, formatter_class=Overview, epilog=_EPILOG)
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = parser.add_subparsers(
        dest="command", metavar="COMMAND", required=True, parser_class=Parser
    )
    for name, command in COMMANDS.items():
        if typed is None or name == typed:
            complete(commands, name, command)
        elif typed not in COMMANDS:
            name_only(commands, name)
    return parser


class _Version(argparse.Action):
    def __call__(self, parser: Any, *unused: Any) -> None:
        from pinflex.kernel.library import kernel
        from pinflex.recovery.meta import version

        print(f"pinflex {version()} (kernel: {kernel().said})")
        parser.exit()


if __name__ == "__main__":
    sys.exit(main())
