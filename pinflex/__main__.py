"""The command line: `pinflex check | modes | advise | solve | compare | sweep | map | bench ...`.

Exit codes: 0 done, 1 the scene cannot be solved, 2 bad input, 130 interrupted.
"""

from __future__ import annotations

import argparse
import math
import sys
import warnings
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from typing import Any, NoReturn

from pinflex.cli import advise, batch_arguments, bench_arguments, command, process
from pinflex.errors import DescriptionError, PinflexError, quoted

_ISSUES = "please report it with the model and the output of --debug"
_MOST_SAMPLES = 1_000_000  # of a run: 100 MB for each hundred columns
_TITLE = (
    "Rigid-flexible dynamics of robots: from a URDF and one YAML to torques, deviations, stress."
)


class _Parser(argparse.ArgumentParser):
    """A parser whose complaints are one line."""

    def error(self, message: str) -> NoReturn:
        raise DescriptionError(f"{message}. See `{self.prog} --help`.")


class _Layout(argparse.RawDescriptionHelpFormatter):
    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=28, width=96)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in arguments
    process.speakable()
    try:
        with process.ending() as end:
            args = _parser().parse_args(arguments)
            return _run(args)
    except KeyboardInterrupt as stop:
        return _complain(str(stop) or "interrupted", end.code)
    except BrokenPipeError:
        process.drop_stdout()
        return 141
    except PinflexError as error:
        if debug:
            raise
        return _complain(str(error), error.exit_code)
    except MemoryError:
        return _complain("not enough memory. Ask for fewer samples or a larger dt", 1)
    except OSError as error:
        if debug:
            raise
        process.drop_stdout()
        name = f"{error.filename}: " if error.filename else ""
        return _complain(f"{name}{error.strerror or error}. Check the path and the disk", 2)
    except Exception as error:
        if debug:
            raise
        text = quoted(" ".join(str(error).split()))[:300]
        return _complain(f"internal error, {type(error).__name__}: {text}; {_ISSUES}", 1)


def _run(args: argparse.Namespace) -> int:
    if not args.debug:
        # a diverging run overflows before it is stopped; its own message says so
        warnings.simplefilter("ignore")
    if getattr(args, "limit", None) is not None and hasattr(args, "set"):
        args.set.append(f"limit={args.limit!r}")
    code: int = import_module(f"pinflex.cli.{args.command}").run(args)
    sys.stdout.flush()
    return code


def _complain(text: str, code: int) -> int:
    sys.stderr.write(f"pinflex: {text if text.endswith(('.', '!', '?')) else text + '.'}\n")
    return code


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="pinflex", description=_TITLE, formatter_class=_Layout, epilog=_EPILOG)
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = parser.add_subparsers(
        dest="command", metavar="COMMAND", required=True, parser_class=_Parser
    )

    p = _command(
        commands,
        "check",
        "what was understood of a model, before anything is solved",
        """
Mobility, loops with their rank and redundant rows, sigma_min, beam against URDF masses, the planes
in which links bend and why, static sag of the platform, holding torques, first natural frequencies,
and warnings.""",
        "pinflex check 3rrs\n  pinflex check arm/arm.yaml --set gravity.2=-1.62",
    )
    p.add_argument("--count", type=_count, default=6, metavar="N", help="frequencies (default 6)")
    p.add_argument(
        "--write-home",
        action="store_true",
        help="write the closed pose into the YAML as `home`; all other lines stay",
    )

    p = _command(
        commands,
        "modes",
        "natural frequencies and mode shapes at a pose",
        """
Linearises about the static equilibrium under gravity with the motors locked, unless told
otherwise.""",
        "pinflex modes 3rrs --preload none\n"
        "  pinflex modes 3rrr --pose motor_1=1.7,motor_2=3.5 --view modes.html",
    )
    p.add_argument("--count", type=_count, default=12, metavar="N", help="how many (default 12)")
    batch_arguments.preload(p)
    p.add_argument("--free-motors", action="store_true", help="let the motors swing")
    p.add_argument(
        "--pose",
        type=_pose,
        metavar="MOTOR=VALUE,...",
        help="motor positions in rad or m; loops are closed on the way from home",
    )
    p.add_argument("--view", metavar="FILE.html", help="write the shapes as a page for a browser")
    p.add_argument(
        "--map",
        metavar="FILE.png",
        help="write a figure of the frequencies along the motion (.png, .pdf, .svg)",
    )

    advise.add(partial(_command, commands), _positive, _names)
    command.add(partial(_command, commands), _positive)

    p = _command(
        commands,
        "solve",
        "one level of the scene",
        """
Levels, from cheap to faithful: rigid, quasistatic, ked (linear vibration), coupled (everything). A
run that stops early is saved up to its last good step.""",
        "pinflex solve 3rrr --level coupled --dt 1e-4 -o run.npz\n"
        "  pinflex solve arm.yaml --set flexible.*.section.thickness=1e-3 --csv run.csv",
    )
    p.add_argument("--level", help="rigid, quasistatic, ked, coupled or auto (default: the YAML's)")
    p.add_argument("--until", type=_positive, metavar="S", help="end time in s")
    step = p.add_mutually_exclusive_group()
    step.add_argument("--dt", type=_positive, metavar="S", help="largest step in s")
    step.add_argument(
        "--tol",
        type=_positive,
        metavar="E",
        help="relative error of time integration instead of a step, such as 1e-3",
    )
    p.add_argument("--samples", type=_samples, metavar="N", help="instants to keep (default 401)")
    p.add_argument(
        "--resume", metavar="RUN.npz", help="go on with a stopped or shorter run, to --until"
    )
    p.add_argument("-o", "--output", metavar="RUN.npz", help="save the run")
    p.add_argument(
        "--checkpoint",
        type=_positive,
        metavar="S",
        help="save the run to -o every S seconds; --resume goes on with it",
    )
    p.add_argument("--csv", metavar="FILE.csv", help="save the main columns as a table")

    p = _command(
        commands,
        "compare",
        "the main job: rigid against flexible",
        """
Solves the scene rigid and flexible and says what shakes by how much, how far the torques are off,
what the links bear and which level suffices; writes tables, figures, the runs and an animation. A
level that cannot be solved does not stop the others.""",
        "pinflex compare delta\n  pinflex compare arm.yaml -o out --levels ked,coupled --band 1e-5",
    )
    p.add_argument("-o", "--output", metavar="DIR", help="folder (default NAME-compare)")
    p.add_argument(
        "--levels",
        type=_names,
        metavar="A,B,...",
        help="beside rigid: quasistatic, ked, coupled (default all)",
    )
    p.add_argument(
        "--band",
        type=_positive,
        default=50e-6,
        metavar="M",
        help="platform deviation in m that does no harm: settling time, verdict (default 50e-6)",
    )
    p.add_argument(
        "--errors", action="store_true", help="error bars also of large models (some seconds)"
    )
    p.add_argument("-v", "--verbose", action="store_true", help="print the long tables too")

    batch_arguments.add(partial(_command, commands), _count)
    bench_arguments.add(partial(_command, commands))

    p = _command(
        commands,
        "view",
        "an animation of a saved run",
        """
Writes one page that plays in any browser, offline, and opens it.""",
        "pinflex view run.npz --field bending --scale 20\n  pinflex view run.npz --png worst --gif",
        model=False,
    )
    p.add_argument("run", metavar="RUN.npz", help="from `pinflex solve -o` or `pinflex compare`")
    p.add_argument("-o", "--output", metavar="FILE.html", help="default: beside the run")
    p.add_argument(
        "--field",
        default="von_mises",
        metavar="NAME",
        help="colour: von_mises, bending, axial, shear or displacement",
    )
    p.add_argument("--scale", default="auto", metavar="X", help="magnification (default auto)")
    p.add_argument("--limit", type=_positive, metavar="X", help="read runs of up to X times 2 GB")
    p.add_argument("--rigid", metavar="RUN.npz", help="rigid run to compare with")
    p.add_argument(
        "--meshes",
        action="append",
        default=[],
        metavar="DIR",
        help="folder with the URDF's meshes; may be repeated",
    )
    p.add_argument("--no-open", action="store_true", help="only write the page")
    p.add_argument("--png", metavar="T", help="also a picture at T s, or at the worst instant")
    p.add_argument("--gif", action="store_true", help="also a film as .gif")
    p.add_argument("--mp4", action="store_true", help="also a film as .mp4 (needs ffmpeg)")
    p.add_argument(
        "--serve",
        nargs="?",
        const=0,
        type=_port,
        metavar="PORT",
        help="serve the page to this machine only, until Ctrl-C (default: a free port)",
    )
    p.add_argument(
        "--live", action="store_true", help="play in meshcat, this machine only, until Ctrl-C"
    )

    p = _command(
        commands,
        "verify",
        "published benchmarks on this machine",
        """
Runs beams, rotating beams, closed loops and large deflection against published or exact references
and prints measured, reference, error and limit; takes about two minutes, with --long more.""",
        "pinflex verify\n  pinflex verify A02 Princeton -o verify.html",
        model=False,
    )
    p.add_argument("cases", nargs="*", metavar="CASE", help="parts of case names (default all)")
    p.add_argument("--long", action="store_true", help="also cases that take minutes")
    p.add_argument("-o", "--output", metavar="FILE.html", help="write a page with plots")
    return parser  # fmt: skip


def _command(
    commands: Any, name: str, summary: str, text: str, example: str, model: bool = True
) -> argparse.ArgumentParser:
    """A command with what all commands share."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.\n{text}",
        epilog=f"example:\n  {example}",
        formatter_class=_Layout,
        allow_abbrev=False,
    )
    if model:
        parser.add_argument(
            "model", metavar="MODEL", help="YAML file, its folder, or a shipped name"
        )
        parser.add_argument(
            "--set",
            action="append",
            default=[],
            metavar="KEY=VALUE",
            help="change the YAML, such as solve.dt=1e-4; may be repeated",
        )
        parser.add_argument(
            "--limit",
            type=_positive,
            metavar="X",
            help="take X times the memory and steps that are taken without asking",
        )
    parser.add_argument("--json", action="store_true", help="print one JSON object, SI units")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    return parser


_EPILOG = """\
A MODEL is a YAML file, its folder, or the name of a shipped model: delta, 3rrr, 3rrs, ur5, ...

examples:
  pinflex compare delta                what shakes, torques, stress, animation in ./delta-compare
  pinflex check 3rrr                   what was understood of the model
  pinflex modes ur5 --count 6          natural frequencies
  pinflex advise race_r1 --tol 0.02    what the scene needs for that
  pinflex command delta -o command.csv the motor motion with which the platform follows its path
  pinflex solve 3rrr -o run.npz        one run
  pinflex sweep ur5 --set flexible.*.material.E=5e10:9e10:5 --out table.csv
  pinflex map 3rrr --grid x=-.05:.05:5 --grid y=-.05:.05:5 --plot map.png
  pinflex bench 3rrs                   which level, modes and step buy which error
  pinflex view run.npz                 its animation
  pinflex verify                       published benchmarks on this machine

exit codes: 0 done, 1 the scene cannot be solved, 2 bad input"""


class _Version(argparse.Action):
    def __call__(self, parser: Any, *unused: Any) -> None:
        from pinflex.recovery.meta import version

        print(f"pinflex {version()}")
        parser.exit()


# Values of options ---------------------------------------------------------------------------


def _positive(text: str) -> float:
    value = _number(text)
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"{text} is not a finite number above zero")
    return value


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None


def _count(text: str) -> int:
    if not text.isdecimal() or len(text) > 5 or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number, 1 to 99999")
    return int(text)


def _port(text: str) -> int:
    if not text.isdecimal() or len(text) > 5 or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port, 0 to 65535")
    return int(text)


def _samples(text: str) -> int:
    if not text.isdecimal() or len(text) > 9 or not 2 <= int(text) <= _MOST_SAMPLES:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number, 2 to {_MOST_SAMPLES}")
    return int(text)


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _pose(text: str) -> dict[str, float]:
    pose = {}
    for item in _names(text):
        name, sign, value = item.partition("=")
        if not sign or not name.strip():
            raise argparse.ArgumentTypeError(f"{item!r} is not of the form MOTOR=VALUE")
        pose[name.strip()] = _number(value)
    return pose


if __name__ == "__main__":
    sys.exit(main())
