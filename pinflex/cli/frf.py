"""`pinflex frf`: frequency response, zeros, and a measured response beside them."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.cli import parser
from pinflex.cli.console import load_model, print_json, working
from pinflex.text import number, paragraph, table
from pinflex.writing import writable, write_csv

if TYPE_CHECKING:
    from pinflex.arrays import Array
    from pinflex.studies.frequency_response import FrequencyResponse

_SHOWN = 5  # zeros in the table
# Of the fastest natural frequency in the headline: a zero below is round-off (a double one has half
# the digits), and one that is slow beside the vibrations of the links.
_ROUND_OFF, _SLOW = 1e-6, 1e-3


def add(commands: parser.Commands) -> None:
    """Add the command."""
    p = parser.command(
        commands,
        "frf",
        "frequency response from a motor or force to motors and platform",
        """
Linearises about the static equilibrium. The zeros tell what feedback can do: a collocated pair
has its zeros left of the axis or on it (minimum phase) and can be damped; a zero right of it
limits the bandwidth. A measured response (CSV: frequency, OUTPUT.magnitude, OUTPUT.phase [deg];
or a record: t, INPUT, OUTPUT) is drawn beside it, with its coherence and how well they agree.""",
        "pinflex frf delta -o frf.png\n"
        "  pinflex frf ur5 --input tool0.z --outputs tool0.z.acceleration --motors acceleration",
    )
    p.add_argument(
        "--input",
        metavar="NAME",
        help="a motor, or a force FRAME.x ... FRAME.rz (default: the first motor)",
    )
    p.add_argument(
        "--outputs",
        type=parser.names,
        default=(),
        metavar="NAME,...",
        help="a joint or FRAME.AXIS, each with .velocity or .acceleration as wanted "
        "(default: the input's own motion, and the platform)",
    )
    p.add_argument(
        "--motors",
        choices=("torque", "acceleration"),
        default="torque",
        help="torque: motors are free (default); acceleration: they are prescribed",
    )
    parser.pose_option(p)
    for name, text in (("from", "first"), ("to", "last")):
        p.add_argument(
            f"--{name}",
            type=parser.positive,
            metavar="HZ",
            dest=f"{text}_frequency",
            help=f"{text} frequency in Hz (default: about the first six modes)",
        )
    p.add_argument("--measured", metavar="FILE.csv", help="a measured response or record")
    p.add_argument(
        "-o", "--output", metavar="FILE", help="write a figure (.png, .pdf, .svg) or .csv"
    )


def run(args: argparse.Namespace) -> int:
    """Frequency response of one input."""
    from pinflex.studies.frequency_response import frequency_response
    from pinflex.studies.pose import pose

    mechanism = load_model(args)
    if args.output and Path(args.output).suffix.lower() != ".csv":
        from pinflex.viewer.plots.drawing import check_figure

        check_figure(args.output)
    writable(args.output)
    with working("finding the response"):
        study = frequency_response(
            mechanism,
            pose(mechanism, args.pose),
            source=args.input,
            outputs=args.outputs,
            motors=args.motors,
            span=(args.first_frequency, args.last_frequency),
            measured=args.measured,
        )
    written = None if args.output is None else _write(study, Path(args.output))
    if args.json:
        print_json(_data(study) | {"files": [] if written is None else [written]})
        return 0
    print(_text(study))
    print(f"wrote {written}" if written else "nothing saved (-o FILE.png draws it)")
    return 0


def _write(study: FrequencyResponse, path: Path) -> Path:
    if path.suffix.lower() != ".csv":
        from pinflex.studies.frequency_response import figure
        from pinflex.viewer.plots.drawing import save

        return save(figure(study).axes, path)
    names = [name.split(" [")[0] for name in study.outputs]
    header = ["frequency", *(f"{n}.{part}" for n in names for part in ("magnitude", "phase"))]
    H = study.response
    columns = np.stack([np.abs(H), np.rad2deg(np.angle(H))], axis=2).reshape(len(H), -1)
    rows = np.column_stack([study.frequencies, columns])
    return write_csv(path, header, ([f"{x:.12g}" for x in row] for row in rows))


def _data(study: FrequencyResponse) -> dict[str, Any]:
    from pinflex.studies.frequency_response import slowest_right

    slowest = float(study.natural[0]) if len(study.natural) else 0.0
    pairs: dict[str, Any] = {
        name: {
            "collocated": collocated, "zeros": _plain(zeros),
            "right_half_plane": slowest_right(zeros, slowest),
        }
        for name, collocated, zeros in zip(
            study.outputs, study.collocated, study.zeros, strict=True
        )
    }  # fmt: skip
    platform = study.platform_zeros
    return {
        "name": study.name,
        "input": study.input,
        "natural": study.natural.tolist(),
        "outputs": pairs,
        "platform": None if platform is None else {
            "zeros": _plain(platform), "right_half_plane": slowest_right(platform, slowest),
        },
        "measured": {
            one.output: {
                "agreement": one.agreement,
                "coherence": None if one.coherence is None else float(np.mean(one.coherence)),
            }
            for one in study.measured
        },
    }  # fmt: skip


def _plain(zeros: Array) -> list[list[float]]:
    return [[float(z.real), float(z.imag)] for z in zeros]


def _text(study: FrequencyResponse) -> str:
    data, fastest = _data(study), float(max(study.natural[:6], default=1.0))
    none = _ROUND_OFF * fastest
    rows = [
        [name.split(" [")[0], "yes" if pair["collocated"] else "no", *_phase_words(pair, none)]
        for name, pair in data["outputs"].items()
    ]
    if data["platform"] is not None:
        rows.append(["platform, of all motors", "no", *_phase_words(data["platform"], none)])
    modes = ", ".join(number(f) for f in study.natural[:6])
    blocks = [
        paragraph(f"{study.name}: response to {study.input}, natural frequencies {modes} Hz"),
        table("Zeros", "output|collocated|minimum phase|zeros [Hz]", rows, (24, 10, 24),
              last_is_text=True),
    ]  # fmt: skip
    pairs = [*data["outputs"].values(), *([data["platform"]] if data["platform"] else [])]
    sizes = np.array([np.hypot(*z) for pair in pairs for z in pair["zeros"]]) / (2.0 * np.pi)
    if np.any((sizes > none) & (sizes < _SLOW * fastest)):
        blocks.append(paragraph(
            f"Zeros below {number(_SLOW * fastest)} Hz are those of joints that are free to move: "
            "weight, and how the sag changes with the pose, hold them, not the links."
        ))  # fmt: skip
    for name, one in data["measured"].items():
        coherence = "" if one["coherence"] is None else f", mean coherence {one['coherence']:.3f}"
        blocks.append(paragraph(f"measured {name}: agreement {one['agreement']:.4f}{coherence}"))
    return "\n\n".join(blocks) + "\n"


def _phase_words(pair: dict[str, Any], none: float) -> list[str]:
    """Whether it is minimum phase, and its slowest zeros [Hz], signed on the real axis."""
    right = pair["right_half_plane"]
    said = "yes" if right is None else f"no: from {number(right)} Hz on"
    shown: list[str] = []
    for real, imag in pair["zeros"]:
        size = float(np.hypot(real, imag)) / (2.0 * np.pi)
        if imag >= 0.0 and size > none:
            word = (
                number(size)
                if imag > abs(real) * 1e-9
                else f"{'+' if real > 0 else '-'}{number(size)}"
            )
            shown += [word] if word not in shown else []
    return [said, ", ".join(shown[:_SHOWN]) + (", ..." if len(shown) > _SHOWN else "") or "none"]
