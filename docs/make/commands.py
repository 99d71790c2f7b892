"""The reference of the command line, from its parser."""

from __future__ import annotations

import argparse
import re

from pinflex.__main__ import build_parser


def page(parser: argparse.ArgumentParser | None = None) -> str:
    """One section for each command: what it does, its arguments, an example."""
    parser = parser or build_parser()
    actions = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    intro = (parser.description or "").strip()
    exits = (parser.epilog or "").rpartition("exit codes:")[2].strip()
    parts = [f"# Commands\n\n{intro}\n\nExit codes: {exits}.\n"]
    seen: set[int] = set()
    for name, one in actions.choices.items():
        if id(one) not in seen:  # a second name of the same command
            seen.add(id(one))
            names = [other for other, same in actions.choices.items() if same is one]
            parts.append(_command(name, names[1:], one))
    return "\n".join(parts)


def _command(name: str, others: list[str], parser: argparse.ArgumentParser) -> str:
    also = (
        f"\n\nAlso called {', '.join(f'`pinflex {other}`' for other in others)}." if others else ""
    )
    rows = [_row(action) for action in parser._actions if action.help != argparse.SUPPRESS]
    example = re.sub(r"(?m)^  ", "", (parser.epilog or "").removeprefix("example:\n")).rstrip()
    shown = f"\n\n```text\n{example}\n```" if example else ""
    usage = parser.format_usage().removeprefix("usage: ").rstrip()
    return (
        f"## pinflex {name}\n\n{_prose(parser.description or '')}{also}\n\n"
        f"```text\n{usage}\n```\n\n"
        f"| argument | meaning |\n|---|---|\n{chr(10).join(rows)}{shown}\n"
    )


def _prose(text: str) -> str:
    """A description as written; what is indented is laid out by hand."""
    lines = [f"    {line}" if line.startswith("  ") else line for line in text.strip().splitlines()]
    return re.sub(r"(?m)^([^ \n].*)\n(    )", r"\1\n\n\2", "\n".join(lines))


def _row(action: argparse.Action) -> str:
    names = ", ".join(f"`{option}`" for option in action.option_strings)
    value = ""
    if action.nargs != 0:
        choices = "{" + ",".join(map(str, action.choices)) + "}" if action.choices else None
        shown = action.metavar or choices
        shown = " ".join(shown) if isinstance(shown, tuple) else shown or action.dest.upper()
        value = f"`{shown}`"
    meaning = (action.help or "").replace("%(default)s", str(action.default)).replace("%%", "%")
    return f"| {' '.join(filter(None, (names, value)))} | {_cell(meaning)} |".replace("\n", " ")


def _cell(text: str) -> str:
    text = " ".join(text.split())
    return re.sub(r"([*_|<>\[\]])", r"\\\1", text)
