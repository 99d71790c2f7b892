"""`pinflex schema`: the JSON Schema of the YAML, for editors."""

from __future__ import annotations

import argparse
import json

from pinflex.cli import parser
from pinflex.writing import write_text


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "schema",
        "the JSON Schema of a YAML file, for editors",
        """
An editor that knows YAML schemas completes keys and words and marks what is none: write
`# yaml-language-server: $schema=pinflex.schema.json` in the first line of a YAML.""",
        "pinflex schema -o pinflex.schema.json",
        model=False,
    )
    p.add_argument("-o", "--out", "--output", metavar="FILE", help="write it there")


def run(args: argparse.Namespace) -> int:
    """Print or write the schema."""
    from pinflex.description.reading.json_schema import json_schema

    text = json.dumps(json_schema(), indent=1) + "\n"
    if args.out:
        write_text(args.out, text)
        print(f"{args.out} written")
    else:
        print(text, end="")
    return 0
