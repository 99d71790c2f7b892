"""A robot without Python: C sources with its tables, and an FMU of them (FMI 2.0, 3.0)."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.boundary import public
from pinflex.errors import DescriptionError, PinflexError, nearest
from pinflex.kernel import build
from pinflex.kernel.library import structure
from pinflex.live.engine import Engine
from pinflex.live.fmi import Description, Outputs, Signal, commands, outputs_of
from pinflex.live.simulator import Simulator
from pinflex.writing import replaced, write_text

# C text of a robot's tables and of its start: what `source/robot.c` steps without Python.

_PER_LINE = 6
_LISTS = (
    *("free_at", "motor_v", "motor_q", "motor_paired", "plain_q", "plain_v", "circle_q"),
    *("circle_v", "ball_q", "ball_v", "body_q", "body_v", "body_flat", "kp", "kd"),
)
_COUNTS = ("free", "motors", "prescribed", "plain", "circles", "balls", "bodies")
_SETTINGS = (
    *("most", "stale", "allowed", "every", "age", "due", "ready", "stopped", "curved"),
    *("mass", "by_v", "by_y"),
    *("tolerance", "farthest", "reference", "peak", "noise", "rate", "began", "previous", "second"),
    "usual",
)


def model_c(live: Simulator, engine: Engine, outputs: Outputs) -> str:
    """The file model.c of a simulator where it stands."""
    stages = engine.march.stages
    tables = stages.evaluator.tables
    arrays = {f"t_{name}": x for name, x in tables.arrays.items()}
    lists = {name: stages.arrays[name] for name in _LISTS}
    arrays |= {f"s_{name}": x for name, x in lists.items()}
    arrays |= {f"m_{name}": x for name, x in _start(engine, outputs).items()}
    stops = engine.bounds.stops
    if stops is not None:
        arrays |= {"m_low": stops[0], "m_high": stops[1]}
    parts = [
        f"/* {_comment(live.mechanism.name)}: written by pinflex, not to be edited. */",
        '#include "robot.h"\n#include <stddef.h>\n',
        *(_array(name, x) for name, x in arrays.items()),
        _structure("Tables", "tables", tables.counts, {k: f"t_{k}" for k in tables.arrays}),
        _structure(
            "Stages", "joints", {k: getattr(stages.at, k) for k in _COUNTS},
            {k: f"s_{k}" for k in lists},
        ),
        _structure("Alpha", "settings", _settings(engine), {}),
        _model(live, engine, outputs),
    ]  # fmt: skip
    return "\n".join(parts)


def _settings(engine: Engine) -> dict[str, float]:
    at = engine.march.at
    begun = {"stale": 1, "ready": 0, "stopped": -1, "curved": -1}
    return {name: getattr(at, name) for name in _SETTINGS} | begun


def _start(engine: Engine, outputs: Outputs) -> dict[str, npt.NDArray[Any]]:
    now = engine.kept()
    return {
        "predict": engine.march.predictor, "y": now.y, "v": now.v, "a": now.a, "s": now.s,
        "lam": now.lam, "torque": now.torque, "position": engine.path.position[1],
        "scale": engine.scale[1], **outputs.tables,
    }  # fmt: skip


def _model(live: Simulator, engine: Engine, outputs: Outputs) -> str:
    named = [*_start(engine, outputs)]
    named += [] if engine.bounds.stops is None else ["low", "high"]
    fields = [".tables = &tables", ".joints = &joints", ".settings = &settings"]
    fields += [f".{name} = m_{name}" for name in named]
    fields += [f".{key} = {_number(x)}" for key, x in {"dt": live.dt, **outputs.numbers}.items()]
    return f"const Model robot_model = {{{', '.join(fields)}}};\n"


def _structure(kind: str, name: str, values: Mapping[str, float], arrays: Mapping[str, str]) -> str:
    """A constant structure of C: numbers by field, and arrays that have been written."""
    known = {field for field, *_ in structure(kind)._fields_}
    fields = [f".{key} = {_number(x)}" for key, x in values.items() if key in known]
    fields += [f".{key} = {x}" for key, x in arrays.items() if key in known]
    return f"static const {kind} {name} = {{{', '.join(fields)}}};\n"


def _array(name: str, values: npt.NDArray[Any]) -> str:
    """A constant array; one without entries has one that nobody reads."""
    flat = np.ascontiguousarray(values).ravel()
    kind = "double" if flat.dtype.kind == "f" else "Int"
    # lists that a march may read are pointers to what it does not write
    items = [_number(x) for x in flat.tolist()] or ["0"]
    return f"static const {kind} {name}[] = {{\n{_lines(items)}}};"


def _lines(items: Sequence[str]) -> str:
    def each() -> Iterator[str]:
        for k in range(0, len(items), _PER_LINE):
            yield "  " + ", ".join(items[k : k + _PER_LINE])

    return ",\n".join(each()) + "\n"


def _number(x: float) -> str:
    """To the last bit."""
    if isinstance(x, int):
        return str(x)
    if not np.isfinite(x):
        return "NAN" if np.isnan(x) else "INFINITY" if x > 0 else "-INFINITY"
    return float(x).hex()


def _comment(text: str) -> str:
    """A name that ends no comment of C."""
    return text.replace("*/", "* /").replace("\\", "/")


SOURCE = Path(__file__).parent / "source"


@dataclass(frozen=True)
class Platform:
    """A kind of machine that an FMU has a library for.

    Attributes:
        here: As `build.here` has it. target: Of zig. ending: Of the library.
        third, second: Folders in an FMU of FMI 3.0 and 2.0, which knows no ARM.
    """

    here: str
    target: str
    ending: str
    third: str
    second: str = ""

    def folder(self, version: int) -> str:
        """Where its library is in an FMU; none: nowhere."""
        return self.second if version == 2 else self.third


PLATFORMS = {
    "linux64": Platform("linux-x86_64", "x86_64-linux-gnu.2.17", ".so", "x86_64-linux", "linux64"),
    "win64": Platform("windows-x86_64", "x86_64-windows-gnu", ".dll", "x86_64-windows", "win64"),
    "darwin64": Platform(
        "macos-x86_64", "x86_64-macos.11.0", ".dylib", "x86_64-darwin", "darwin64"
    ),
    "darwin-arm": Platform("macos-aarch64", "aarch64-macos.11.0", ".dylib", "aarch64-darwin"),
    "linux-arm": Platform("linux-aarch64", "aarch64-linux-gnu.2.17", ".so", "aarch64-linux"),
}
VERSIONS = (2, 3)  # of the standard
_KINDS = ("motion", "torque")


@public
def export_c(live: Simulator, folder: str | Path, inputs: str = "torque") -> Path:
    """Write the C sources of a robot, from where a simulator stands: they need a C compiler alone.

    `cc -O3 -DEXPORT= *.c -lm` makes a program of them; `robot.h` says what a loop calls.

    Args:
        live: At the start.
        folder: Where to.
        inputs: torque or motion: what moves the motors.
    Returns:
        The folder.
    Raises:
        DescriptionError: What cannot be told without Python: see `Simulator`, and loads that vary
            in time or sleeves.
    """
    engine, outputs = _ready(live, inputs)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "model.c", model_c(live, engine, outputs))
    for path in (*_kernel(), *(SOURCE / name for name in ("robot.c", "robot.h", "main.c"))):
        shutil.copyfile(path, folder / path.name)
    return folder


@public
def export_fmu(
    live: Simulator,
    file: str | Path,
    inputs: str = "torque",
    platforms: Sequence[str] = (),
    version: int = 2,
) -> Path:
    """Write an FMU (FMI 2.0 or 3.0, co-simulation) of a robot, from where a simulator stands.

    It steps as the simulator does, with no Python inside. Inputs are those at the end of a step;
    a communication step is a whole number of steps of dt. Variables have the names and units of the
    table of a result, `stress LINK` [Pa] is the largest normal stress by the strains of a beam.
    Parameters: `damping` multiplies the damping of joints and links; `payload` [kg] is the mass of
    what the YAML's payload is, or of a point at the platform (both start from the same pose and
    torques). Derivatives are those of the outputs of a step of dt by its inputs.

    Source: Modelica Association, Functional Mock-up Interface 2.0.4 (sections 2 and 4) and 3.0.1.

    Args:
        live: At the start.
        file: NAME.fmu.
        inputs: torque or motion: what moves the motors.
        platforms: linux64, win64, darwin64 and, of FMI 3, linux-arm and darwin-arm, made by the
            pip package ziglang; default: this machine's, by any C compiler.
        version: Of FMI, 2 or 3.
    Returns:
        The file.
    Raises:
        DescriptionError: As `export_c`. PinflexError: No compiler, or it fails.
    """
    file = Path(file)
    if file.suffix != ".fmu":
        raise DescriptionError(f"{file}: an FMU ends with .fmu.")
    if version not in VERSIONS:
        raise DescriptionError(f"export: FMI {version}. Allowed: {', '.join(map(str, VERSIONS))}.")
    known = _known(version)
    for name in platforms:
        if name not in known:
            raise DescriptionError(
                f"export: {name}: no such platform of FMI {version}.{nearest(name, known)}"
            )
    engine, outputs = _ready(live, inputs)
    text = model_c(live, engine, outputs)
    given = commands(live.mechanism, inputs == "torque")
    led = engine.path.position, engine.path.velocity, engine.path.acceleration
    at = [float(x) for part in (engine.found[5:6] if inputs == "torque" else led) for x in part[1]]
    about = Description(
        live.mechanism.name, live.dt, given, at, outputs.signals, _parameters(outputs),
        text, version,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as held:
        folder = Path(held)
        (folder / "model.c").write_text(text + about.identity(), "utf-8")
        made = {name: _library(folder, name) for name in platforms or [_here(version)]}
        with replaced(file) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as fmu:
            fmu.writestr("modelDescription.xml", about.xml())
            for name, library in made.items():
                one = PLATFORMS[name]
                where = f"binaries/{one.folder(version)}"
                fmu.write(library, f"{where}/{about.identifier}{one.ending}")
    return file


def _known(version: int) -> list[str]:
    return [name for name, one in PLATFORMS.items() if one.folder(version)]


def _parameters(outputs: Outputs) -> list[tuple[Signal, float]]:
    """What is set before the start, in the order of source/slave.h."""
    found = [
        (Signal("damping", "", "factor on the damping of joints and links, set at first"), 1.0)
    ]
    if outputs.carried is not None:
        frame, mass = outputs.carried
        found.append((Signal("payload", "kg", f"mass that {frame} carries, set at first"), mass))
    return found


def _ready(live: Simulator, inputs: str) -> tuple[Engine, Outputs]:
    """The steps of a simulator with what moves the motors, and what they tell."""
    mechanism = live.mechanism
    if inputs not in _KINDS:
        raise DescriptionError(f"export: inputs: {inputs}.{nearest(inputs, _KINDS)}")
    loads, closed = mechanism.loose.loads, mechanism.loose.closed
    what = "loads that vary in time" if loads.timed else "sleeves" if closed.contacts else ""
    if what:
        raise DescriptionError(f"{mechanism.name}: export: {what} are not in C yet. Use Simulator.")
    engine = live._engine(inputs == "motion", live.motors.torque)
    return engine, outputs_of(mechanism)


def _kernel() -> list[Path]:
    """The sources of the kernel, without what its library says of itself."""
    return [path for path in sorted(build.SOURCE.glob("*.[ch]")) if path.name != "about.c"]


def _here(version: int) -> str:
    """The platform that this machine is."""
    known = _known(version)
    for name in known:
        if PLATFORMS[name].here == build.here():
            return name
    raise DescriptionError(
        f"export: FMI {version} has no folder for {build.here()}. Name platforms: "
        f"{', '.join(known)}."
    )


def _library(folder: Path, platform: str) -> Path:
    """The shared library of an FMU, compiled."""
    one = PLATFORMS[platform]
    out = folder / f"{platform}{one.ending}"
    sources = [str(path) for path in _kernel() if path.suffix == ".c"]
    sources += [str(SOURCE / name) for name in ("robot.c", "slave.c", "fmi2.c", "fmi3.c")]
    sources.append(str(folder / "model.c"))
    flags = [*build.FLAGS, "-DEXPORT=", f"-I{build.SOURCE}", f"-I{SOURCE}"]
    said = []
    for compiler in _compilers(one):
        command = [*compiler, *flags, *sources, "-lm", "-o", str(out)]
        try:
            subprocess.run(command, check=True, capture_output=True, text=True, timeout=600)
        except (OSError, subprocess.SubprocessError) as error:
            said.append(f"{compiler[0]}: {build.in_short(error)}")
        else:
            return out
    raise PinflexError(
        f"export: no library for {platform}: {'; '.join(said) or 'no compiler'}. "
        "pip install 'pinflex[fmu]'."
    )


def _compilers(one: Platform) -> list[list[str]]:
    """Commands to try: those of the kernel for this machine, zig for others."""
    if one.here == build.here():
        _, *flags = build.BUILDS[one.here.rpartition("-")[2]][0]  # every processor of the kind
        found = build.compilers(build.here()) if build.here() in build.TARGETS else []
        return [[*each, *flags[0 if "ziglang" in each else 1]] for each in found]
    cpu = ["-mcpu=x86_64"] if one.here.endswith("x86_64") else []
    return [[*each, *cpu] for each in build.zig(one.target)]
