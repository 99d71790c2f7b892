"""A robot without Python: C sources with its tables, and an FMU of them (FMI 2.0)."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

from pinflex.boundary import public
from pinflex.errors import DescriptionError, PinflexError, nearest
from pinflex.kernel import build
from pinflex.live.c_text import model_c
from pinflex.live.engine import Engine
from pinflex.live.fmi import Description
from pinflex.live.outputs import Outputs, commands, outputs_of
from pinflex.live.simulator import Simulator
from pinflex.writing import replaced, write_text

SOURCE = Path(__file__).parent / "source"
# Folders of an FMU, the target of zig and the ending of the library there.
PLATFORMS = {
    "linux64": ("x86_64-linux-gnu.2.17", ".so"),
    "win64": ("x86_64-windows-gnu", ".dll"),
    "darwin64": ("x86_64-macos.11.0", ".dylib"),
}
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
    live: Simulator, file: str | Path, inputs: str = "torque", platforms: Sequence[str] = ()
) -> Path:
    """Write an FMU (FMI 2.0, co-simulation) of a robot, from where a simulator stands.

    It steps as the simulator does, with no Python inside. Inputs are those at the end of a step;
    a communication step is a whole number of steps of dt. Variables have the names and units of the
    table of a result; `damping` multiplies the damping of joints and links.

    Source: Modelica Association, Functional Mock-up Interface 2.0.4, sections 2 and 4.

    Args:
        live: At the start.
        file: NAME.fmu.
        inputs: torque or motion: what moves the motors.
        platforms: linux64, win64 or darwin64, made by the pip package ziglang; default: this
            machine's, by any C compiler.
    Returns:
        The file.
    Raises:
        DescriptionError: As `export_c`. PinflexError: No compiler, or it fails.
    """
    file = Path(file)
    if file.suffix != ".fmu":
        raise DescriptionError(f"{file}: an FMU ends with .fmu.")
    for name in platforms:
        if name not in PLATFORMS:
            raise DescriptionError(f"export: {name}: no such platform.{nearest(name, PLATFORMS)}")
    engine, outputs = _ready(live, inputs)
    text = model_c(live, engine, outputs)
    given = commands(live.mechanism, inputs == "torque")
    at = engine.found[5][1] if inputs == "torque" else _where(engine)
    about = Description(live.mechanism.name, live.dt, given, tuple(at), outputs.signals, text)
    with tempfile.TemporaryDirectory() as held:
        folder = Path(held)
        (folder / "model.c").write_text(text + about.identity(), "utf-8")
        made = {name: _library(folder, name) for name in platforms or [_here()]}
        with replaced(file) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as fmu:
            fmu.writestr("modelDescription.xml", about.xml())
            for name, library in made.items():
                ending = PLATFORMS[name][1]
                fmu.write(library, f"binaries/{name}/{about.identifier}{ending}")
    return file


def _where(engine: Engine) -> list[float]:
    """Position, velocity and acceleration of led motors at the start, one after the other."""
    path = engine.path
    return [float(x) for part in (path.position, path.velocity, path.acceleration) for x in part[1]]


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


def _here() -> str:
    """The folder of this machine in an FMU."""
    names = {"linux-x86_64": "linux64", "windows-x86_64": "win64", "macos-x86_64": "darwin64"}
    here = build.here()
    if here not in names:
        raise DescriptionError(
            f"export: FMI 2.0 has no folder for {here}. Name platforms: {', '.join(PLATFORMS)}."
        )
    return names[here]


def _library(folder: Path, platform: str) -> Path:
    """The shared library of an FMU, compiled."""
    target, ending = PLATFORMS[platform]
    out = folder / f"{platform}{ending}"
    sources = [str(path) for path in _kernel() if path.suffix == ".c"]
    sources += [str(SOURCE / "robot.c"), str(SOURCE / "fmi2.c"), str(folder / "model.c")]
    flags = [*build.FLAGS, "-DEXPORT=", f"-I{build.SOURCE}", f"-I{SOURCE}"]
    said = []
    for compiler in _compilers(platform, target):
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


def _compilers(platform: str, target: str) -> list[list[str]]:
    """Commands to try: those of the kernel for this machine, zig for others."""
    if platform == _here():
        cpu = build.BUILDS["x86_64"][0]  # every processor of the kind
        found = build.compilers(build.here()) if build.here() in build.TARGETS else []
        return [[*one, *(cpu[1] if "ziglang" in one else cpu[2])] for one in found]
    return [[*one, "-mcpu=x86_64"] for one in build.zig(target)]
