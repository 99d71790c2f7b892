"""The command line: `pinflex check | modes | advise | command | solve | compare | sweep ...`.

`pinflex.cli.commands` has what each says of itself, its options, and the function that runs it.
Exit codes: 0 done, 1 the scene cannot be solved, 2 bad input, 130 interrupted.
"""

from __future__ import annotations

import argparse
import contextlib
import difflib
import gc
import os
import re
import signal
import sys
import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from types import FrameType
from typing import Any, NoReturn

from pinflex.cli.commands import COMMANDS, SUMMARIES
from pinflex.cli.options import SHARED, Command, add
from pinflex.errors import VARIABLE, DescriptionError, KernelWarning, PinflexError, quoted

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
    escape_unprintable()
    try:
        with ending() as end:
            return _run(arguments, ends=argv is None)
    except KeyboardInterrupt as stop:
        return _complain(str(stop) or "interrupted", end.code)
    except BrokenPipeError:
        drop_stdout()
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
        warnings.showwarning = show_warning
    if getattr(args, "limit", None) is not None and hasattr(args, "set"):
        args.set.append(f"limit={args.limit!r}")
    module, function = args.run
    with settled(ends):
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
        drop_stdout()
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


# The parser: commands, their help, what it says of a typing error.

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


# The process: signals, warnings, garbage, streams that are closed.

# Sent by batch queues, `docker stop` and a terminal that closes; handled as Ctrl-C is.
_ENDING = tuple(
    getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGXCPU") if hasattr(signal, name)
)


@dataclass
class Ending:
    """Exit code of an interrupted command: 130 for Ctrl-C, 128 and its number for a signal."""

    code: int = 130


@contextmanager
def ending() -> Iterator[Ending]:
    """Signals that end a process become an interruption, so that what is done is saved."""
    end = Ending()

    def stop(number: int, _: FrameType | None) -> None:
        end.code = 128 + number
        raise KeyboardInterrupt

    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in _ENDING:
            if signal.getsignal(number) is signal.SIG_DFL:  # nohup ignores SIGHUP: so do we
                before[number] = signal.signal(number, stop)
    try:
        yield end
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def show_warning(message: Warning | str, *unused: object, **also_unused: object) -> None:
    """Write a warning as the command writes its errors: one line, without the place in the code."""
    sys.stderr.write(f"pinflex: {message}\n")


# Objects between two collections: twice those of a comparison; a case of a sweep leaves few
# in cycles, 200.
_SELDOM = 500_000


@contextmanager
def settled(ends: bool) -> Iterator[None]:
    """What is loaded by now is left out of garbage collections until the block ends; few come.

    It lives as long as the process; going over it, and over what the block loads, takes a
    twentieth of a comparison. Where the process `ends` with the block, so does everything: Python
    would look through all of it.
    """
    often = gc.get_threshold()
    gc.freeze()
    gc.set_threshold(_SELDOM, *often[1:])
    try:
        yield
    finally:
        if ends:
            gc.freeze()
        else:
            gc.set_threshold(*often)
            gc.unfreeze()


def escape_unprintable() -> None:
    """Every name can be printed, as an escape where the terminal has no such letter."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by who started us: the next file would take its place
            _occupy(1 if name == "stdout" else 2)
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif hasattr(stream, "reconfigure"):
            with contextlib.suppress(ValueError, OSError):
                stream.reconfigure(errors="backslashreplace")


def drop_stdout() -> None:
    """Forget what stdout did not take: at the end of Python it would be complained of again."""
    try:
        sys.stdout.flush()
    except (OSError, ValueError):
        with contextlib.suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _occupy(number: int) -> None:
    try:
        os.fstat(number)
    except OSError:
        null = os.open(os.devnull, os.O_WRONLY)
        if null != number:
            os.dup2(null, number)
            os.close(null)


if __name__ == "__main__":
    sys.exit(main())
