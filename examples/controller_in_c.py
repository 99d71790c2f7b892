"""A controller in C moves a flexible UR5: both are FMUs, and a fixed-step master couples them.

    python examples/controller_in_c.py

The robot is exported (`pf.export_fmu`), the controller is `loop/controller.c`, and FMPy calls both
at 1 kHz, as any tool that takes FMUs would. The same loop in Python, over `pf.Simulator`, ends
where they end. Needs a C compiler and FMPy (`pip install fmpy`).
"""

import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

import pinflex as pf

SOURCE = Path(__file__).parent / "loop" / "controller.c"
KINDS = ("q", "v", "goal", "hold", "k", "u")
DT, STEPS = 1e-3, 3000


def controller(folder: Path) -> Path:
    """The controller as an FMU for this machine."""
    place, ending = {"darwin": ("darwin64", "dylib"), "win32": ("win64", "dll")}.get(
        sys.platform, ("linux64", "so")
    )
    compiler = shutil.which("cc") or shutil.which("gcc")
    line = [compiler] if compiler else [sys.executable, "-m", "ziglang", "cc"]
    library = folder / f"controller.{ending}"
    subprocess.run([*line, "-O2", "-shared", "-fPIC", str(SOURCE), "-o", str(library)], check=True)
    variables = "".join(
        f'<ScalarVariable name="{kind}{j}" valueReference="{6 * i + j}" causality="{role}" '
        f'variability="{how}"><Real{start}/></ScalarVariable>'
        for i, kind in enumerate(KINDS)
        for role, how, start in [
            ("output", "continuous", "") if kind == "u"
            else ("input", "continuous", ' start="0"') if kind in "qv"
            else ("parameter", "fixed", ' start="0"')
        ]
        for j in range(6)
    )  # fmt: skip
    outputs = "".join(f'<Unknown index="{31 + j}"/>' for j in range(6))
    text = (
        '<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="2.0" '
        'modelName="controller" guid="{controller}"><CoSimulation modelIdentifier="controller"/>'
        f"<ModelVariables>{variables}</ModelVariables><ModelStructure><Outputs>{outputs}</Outputs>"
        f"<InitialUnknowns>{outputs}</InitialUnknowns></ModelStructure></fmiModelDescription>"
    )
    file = folder / "controller.fmu"
    with zipfile.ZipFile(file, "w") as fmu:
        fmu.writestr("modelDescription.xml", text)
        fmu.write(library, f"binaries/{place}/{library.name}")
    return file


def slave(file: Path, folder: Path) -> tuple[FMU2Slave, dict[str, int]]:
    """An FMU in initialization mode, and its variables by name."""
    about = read_model_description(str(file))
    one = FMU2Slave(
        guid=about.guid, unzipDirectory=extract(str(file), str(folder / file.stem)),
        modelIdentifier=about.coSimulation.modelIdentifier, instanceName=file.stem,
    )  # fmt: skip
    one.instantiate()
    one.setupExperiment(startTime=0.0)
    one.enterInitializationMode()
    return one, {v.name: v.valueReference for v in about.modelVariables}


robot = pf.load("ur5")
live = pf.Simulator(robot, dt=DT)
goal, stiff = live.motors.position + 0.1, np.array([400.0, 400.0, 200.0, 10.0, 10.0, 1.0])
hold = live.reset(dict(zip(robot.motors, goal, strict=True))).motors.torque  # carries the arm there
live.reset()

with tempfile.TemporaryDirectory() as held:
    folder = Path(held)
    arm, at = slave(pf.export_fmu(live, folder / "arm.fmu"), folder)
    pd, to = slave(controller(folder), folder)
    for kind, values in (("goal", goal), ("hold", hold), ("k", stiff)):
        pd.setReal([to[f"{kind}{j}"] for j in range(6)], values.tolist())
    arm.exitInitializationMode(), pd.exitInitializationMode()
    told = [at[f"{kind} {name}"] for kind in ("position", "velocity") for name in robot.motors]
    given = [at[f"command torque {name}"] for name in robot.motors]
    read = [to[f"{kind}{j}"] for kind in "qv" for j in range(6)]
    write = [to[f"u{j}"] for j in range(6)]
    for k in range(STEPS):  # what was read at the beginning of a step acts at its end
        pd.setReal(read, arm.getReal(told))
        pd.doStep(k * DT, DT)
        arm.setReal(given, pd.getReal(write))
        arm.doStep(k * DT, DT)
    there = np.array(arm.getReal(told)[:6])
    for one in (arm, pd):
        one.terminate(), one.freeInstance()

for _ in range(STEPS):
    now = live.motors
    live.step(torque=hold + stiff * (goal - now.position) - 0.1 * stiff * now.velocity)

apart, off = np.abs(there - live.motors.position).max(), np.abs(there - goal).max()
print(f"FMUs and loop in Python end {apart:.1e} rad apart, {1e3 * off:.2f} mrad off the goal")
assert apart < 1e-9  # round-off of another build of the same C, in a loop that forgets it
assert off < 1e-3  # what springs and dampers leave of 0.1 rad in 3 s
