"""`pinflex import` and `pinflex new`: a commented YAML for a robot's file."""

from __future__ import annotations

import argparse
from pathlib import Path

from pinflex.cli import parser
from pinflex.cli.console import print_json
from pinflex.description.files import nameable
from pinflex.description.reading.schema import shown
from pinflex.errors import DescriptionError
from pinflex.writing import write_text

_TEXT = """
SOURCE is a URDF, an MJCF (MuJoCo), an SDF, a xacro, the robot.yaml of Gepetto's parallel robots,
or example-robot-data:NAME. The YAML lists the joints, motors, loops and the closed home pose,
names what is not taken over of the file, and proposes flexible links with guessed sections. It
loads as it is."""


def add(commands: parser.Commands) -> None:
    """Add both commands."""
    for name, summary, example in (
        ("import", "write a YAML for a robot of another format",
         "pinflex import cassie.xml -o cassie.yaml\n  pinflex import robot.urdf --flexible shin"),
        ("new", "begin a YAML for a URDF", "pinflex new robot.urdf"),
    ):  # fmt: skip
        p = parser.command(commands, name, summary, _TEXT, example, model=False)
        p.add_argument("source", metavar="SOURCE", help="the robot's file")
        p.add_argument(
            "-o",
            "--out",
            "--output",
            metavar="FILE",
            help="the YAML (default: NAME.yaml beside it)",
        )
        parser.repeated(p, "--flexible", "LINK", "let this link bend, with a guessed section")
        parser.repeated(p, "--arg", "NAME=VALUE", "argument of a xacro; may be repeated")
        p.add_argument("--force", action="store_true", help="replace FILE if it is there")
        p.set_defaults(module="importing")


def run(args: argparse.Namespace) -> int:
    """Write the YAML."""
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
    if args.json:
        print_json({"file": str(out), "closed": mechanism is not None})
    elif mechanism is None:
        print(f"{out} written, but it does not load yet: see the remark in it")
    else:
        motors = len(mechanism.motors)
        print(f"{out} written: mobility {mechanism.report.mobility}, {motors} motors")
    return 0 if mechanism is not None else 1


def _arguments(given: list[str]) -> dict[str, str]:
    for one in given:
        if not one.partition("=")[2]:
            raise DescriptionError(f"--arg {shown(one)}: no value. Give NAME=VALUE.")
    return {one.partition("=")[0].strip(): one.partition("=")[2] for one in given}
