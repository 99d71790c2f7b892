"""FMUs and C sources beside the simulator, judged by FMPy where it is there."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import pinflex as pf
from pinflex.kernel import build
from pinflex.kernel.library import kernel
from pinflex.live.fmi import Description
from pinflex.live.outputs import Signal, commands, outputs_of

pytestmark = [
    pytest.mark.skipif(kernel().functions is None, reason="no kernel"),
    pytest.mark.skipif(not build.here().startswith("linux-x86_64"), reason="made for linux64"),
]
MODELS = ("delta", "ur5", "3rrr")
PUSH = {"delta": 0.5, "ur5": 0.5, "3rrr": 2e-3}  # N m


class Slave:
    """An FMU as FMPy runs it."""

    def __init__(self, file: Path, folder: Path, damping: float | None = None) -> None:
        fmi2 = pytest.importorskip("fmpy.fmi2")
        from fmpy import extract, read_model_description

        d = read_model_description(str(file))
        self.slave = fmi2.FMU2Slave(
            guid=d.guid, unzipDirectory=extract(str(file), str(folder)), instanceName="robot",
            modelIdentifier=d.coSimulation.modelIdentifier,
        )  # fmt: skip
        self.at = {v.name: v.valueReference for v in d.modelVariables}
        self.inputs = [v.valueReference for v in d.modelVariables if v.causality == "input"]
        self.outputs = [v.name for v in d.modelVariables if v.causality == "output"]
        self.slave.instantiate()
        self.slave.setupExperiment(startTime=0.0)
        self.slave.enterInitializationMode()
        if damping is not None:
            self.slave.setReal([self.at["damping"]], [damping])
        self.slave.exitInitializationMode()
        self.time = 0.0

    def step(self, given: np.ndarray, h: float = 1e-3) -> dict[str, float]:
        self.slave.setReal(self.inputs, given.tolist())
        self.slave.doStep(self.time, h)
        self.time += h
        return self.read()

    def read(self) -> dict[str, float]:
        values = self.slave.getReal([self.at[name] for name in self.outputs])
        return dict(zip(self.outputs, values, strict=True))


def fmu(model: str, folder: Path, inputs: str = "torque") -> Path:
    return pf.export_fmu(pf.Simulator(model), folder / f"{model}_{inputs}.fmu", inputs)


BESIDE = """
import json, sys
import numpy as np
import pinflex as pf
from pinflex.recovery.kinematics import motion_of
from pinflex.rotations import rotation_vector
from pathlib import Path
from tests.unit.live.test_export import MODELS, PUSH, Slave, fmu

folder, worst = Path(sys.argv[1]), {}
for model in MODELS:
    for inputs in ("torque", "motion"):
        file, live = fmu(model, folder, inputs), pf.Simulator(model)
        slave = Slave(file, folder / f"{model}_{inputs}")
        start, links = live.motors, live.mechanism.parts
        off, platform = 0.0, live.mechanism.description.platform
        for k in range(200):
            t = 1e-3 * (k + (inputs == "motion"))
            if inputs == "torque":
                given = start.torque + PUSH[model] * np.sin(30 * t) * (k > 0)
                live.step(torque=given)
            else:
                w, n = 12.0, len(start.torque)
                c, s = np.cos(w * t), np.sin(w * t)
                law = [0.02 * (1 - c) ** 2, 0.04 * w * (1 - c) * s,
                       0.04 * w * w * (c - np.cos(2 * w * t))]
                moves = [np.full(n, x) for x in law]
                moves[0] += start.position
                live.step(motion=tuple(moves))
                given = np.concatenate(moves)
            told, now = slave.step(given), live.motors
            for what in ("torque", "position", "velocity"):
                for motor, x in zip(live.mechanism.motors, getattr(now, what)):
                    off = max(off, abs(told[f"{what} {motor}"] - x))
            frame = live.frame(platform)
            pose = [*frame.position, *rotation_vector(frame.rotation)]
            for axis, x in zip(("x", "y", "z", "rx", "ry", "rz"), pose):
                off = max(off, abs(told[f"platform {axis}"] - x))
        for link in links:
            for d, x in zip("uvw", live.link(link).deflection[-1]):
                off = max(off, abs(told[f"deflection {link} {d}"] - x))
        worst[f"{model} {inputs}"] = [off, float(abs(now.position - start.position).max())]
print(json.dumps(worst))
"""


def test_fmus_equal_the_simulator(tmp_path: Path) -> None:
    """By the same instructions, that is the same build of the kernel: to 1e-12, in fact to 2e-16.

    (By others round-off differs, of which index 3 makes 1e-15 / h^2 in accelerations.)
    """
    pytest.importorskip("fmpy")
    env = {**os.environ, "PINFLEX_KERNEL": "baseline"}
    done = subprocess.run(
        [sys.executable, "-c", BESIDE, str(tmp_path)], env=env, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert len(found) == 2 * len(MODELS)
    for name, (off, moved) in found.items():
        assert off < 1e-12 and moved > 1e-4, name


def test_fmpy_finds_nothing_wrong(tmp_path: Path) -> None:
    """Its validation, and its own master, whose steps are a whole number of ours."""
    fmpy = pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    file = fmu("3rrr", tmp_path, "motion")
    assert validate_fmu(str(file)) == []
    found = fmpy.simulate_fmu(str(file), stop_time=0.1, step_size=5e-3, output_interval=5e-3)
    home = pf.Simulator("3rrr").motors.position
    for name, x in zip(pf.load("3rrr").motors, home, strict=True):
        np.testing.assert_allclose(found[f"position {name}"], x, atol=1e-12)


def pd(q: np.ndarray, v: np.ndarray, goal: np.ndarray, hold: np.ndarray) -> np.ndarray:
    stiff = np.array([400.0, 400.0, 200.0, 10.0, 10.0, 1.0])  # N m/rad, as the arm carries
    return np.asarray(hold + stiff * (goal - q) - 0.1 * stiff * v)


def test_a_master_closes_the_loop_over_it(tmp_path: Path) -> None:
    """A sampled PD controller at 1 kHz brings the arm to its goal, with both in the same way."""
    robot = pf.load("ur5")
    live, slave = pf.Simulator(robot), Slave(fmu("ur5", tmp_path), tmp_path / "x")
    start = live.motors
    goal = start.position + 0.1

    def read() -> tuple[np.ndarray, np.ndarray]:
        told = slave.read()
        q, v = (
            np.array([told[f"{k} {m}"] for m in robot.motors]) for k in ("position", "velocity")
        )
        return q, v

    live.step(torque=start.torque), slave.step(start.torque)
    for _ in range(1500):
        slave.step(pd(*read(), goal, start.torque))
        now = live.motors
        live.step(torque=pd(now.position, now.velocity, goal, start.torque))
    # Other instructions than the simulator's here: round-off, in a loop that forgets it.
    np.testing.assert_allclose(read()[0], live.motors.position, atol=1e-9)
    # It holds the weight of the start: its pose has another one, which these springs give way to.
    assert np.abs(read()[0] - goal).max() < 0.03


def test_states_come_back_and_damping_counts(tmp_path: Path) -> None:
    file = fmu("3rrr", tmp_path)
    slave, push = Slave(file, tmp_path / "a"), np.array([0.05, -0.02, 0.03])

    def on(one: Slave) -> list[float]:
        for _ in range(50):
            told = one.step(push)
        return [*told.values()]

    on(slave)
    state = slave.slave.getFMUState()
    first = on(slave)
    slave.slave.setFMUState(state)
    assert on(slave) == first
    slave.slave.freeFMUState(state)
    # Twice the modal damping, in the FMU and in the YAML: D is linear in it.
    live = pf.Simulator(pf.load("3rrr", ["damping.modal=0.02"]))
    twice, once = Slave(file, tmp_path / "b", damping=2.0), Slave(file, tmp_path / "c")
    live.step(torque=0 * push)  # pushed by nothing, as FMUs begin
    still = [one.step(0 * push) for one in (twice, once)]
    assert still[0] == pytest.approx(still[1], abs=1e-12)
    for _ in range(50):
        live.step(torque=push)
    want = live.motors.velocity
    told = [dict(zip(one.outputs, on(one), strict=True)) for one in (twice, once)]
    speeds = [np.array([x[f"velocity {m}"] for m in live.mechanism.motors]) for x in told]
    scale = np.abs(want).max()
    assert np.abs(speeds[0] - want).max() < 1e-8 * scale
    assert np.abs(speeds[1] - want).max() > 1e-6 * scale


def test_an_fmu_refuses_what_it_cannot_do(tmp_path: Path) -> None:
    slave = Slave(fmu("3rrr", tmp_path), tmp_path / "a")
    from fmpy.fmi1 import FMICallException

    before = slave.read()
    bad: dict[str, Callable[[], Any]] = {
        "nan": lambda: slave.step(np.array([np.nan, 0, 0])),
        "part of a step": lambda: slave.step(np.zeros(3), 2.5e-4),
        "an output": lambda: slave.slave.setReal([slave.at["platform x"]], [1.0]),
        "too much": lambda: slave.step(np.full(3, 1e12)),
    }
    for call in bad.values():
        with pytest.raises(FMICallException):
            call()
        assert slave.read() == before
    slave.step(np.zeros(3))


def test_names_are_escaped() -> None:
    name = 'two <arms> & "one" tool'
    signal = Signal(f"torque {name}", "N m", name)
    about = Description(name, 1e-3, [signal], [0.5], [signal], "tables")
    tree = ElementTree.fromstring(about.xml().encode())
    assert tree.get("modelName") == name and about.identifier.isidentifier()
    variables = tree.findall("ModelVariables/ScalarVariable")
    assert [v.get("name") for v in variables] == [signal.name, signal.name, "damping"]
    assert [v.get("valueReference") for v in variables] == ["0", "1", "2"]


def test_names_and_units_are_those_of_results() -> None:
    robot = pf.load("hexapod")  # whose motors slide
    told = {one.name: one.unit for one in outputs_of(robot).signals}
    path = pf.solve(robot, level="rigid", samples=3).to_pandas()
    shared = told.keys() & set(path.columns)
    assert len(shared) == 6 + 6 + 6  # torques, positions, platform
    assert all(told[name] == path.attrs["units"][name] for name in shared)
    assert {one.unit for one in commands(robot, True)} == {"N"}


COUNT = """
#include <stdio.h>
#include <stddef.h>
static long calls;
void *__libc_malloc(size_t); void *__libc_calloc(size_t, size_t);
void *__libc_realloc(void *, size_t);
void *malloc(size_t n) { calls++; return __libc_malloc(n); }
void *calloc(size_t n, size_t m) { calls++; return __libc_calloc(n, m); }
void *realloc(void *p, size_t n) { calls++; return __libc_realloc(p, n); }
__attribute__((destructor)) static void tell(void) { fprintf(stderr, "%ld", calls); }
"""


def test_c_sources_make_a_program_that_allocates_nothing_in_a_step(tmp_path: Path) -> None:
    compiler = shutil.which("gcc") or shutil.which("clang") or pytest.skip("no compiler")
    folder = pf.export_c(pf.Simulator("ur5"), tmp_path / "c")
    program, shim = tmp_path / "robot", tmp_path / "count.so"
    (tmp_path / "count.c").write_text(COUNT)
    sources = sorted(str(path) for path in folder.glob("*.c"))
    flags = ["-std=c11", "-O0", "-DEXPORT=", "-Wno-psabi"]
    for line in ([*flags, *sources, "-lm", "-o", str(program)],
                 ["-shared", "-fPIC", str(tmp_path / "count.c"), "-o", str(shim)]):  # fmt: skip
        subprocess.run([compiler, *line], check=True, capture_output=True)
    counts, tables = [], []
    for steps in (10, 1010):
        done = subprocess.run(
            [program, str(steps)], env={"LD_PRELOAD": str(shim)}, capture_output=True, text=True,
            check=True,
        )  # fmt: skip
        counts.append(int(done.stderr))
        tables.append(np.loadtxt(done.stdout.splitlines(), delimiter=","))
    assert counts[0] == counts[1] > 2
    # It stays where its torques hold it.
    assert len(tables[1]) == 1011
    np.testing.assert_allclose(tables[1][-1, 1:], tables[1][0, 1:], atol=1e-9)


def test_what_cannot_be_exported_is_said(tmp_path: Path) -> None:
    live = pf.Simulator("3rrr")
    for call, said in (
        (lambda: pf.export_fmu(live, tmp_path / "a.zip"), "ends with .fmu"),
        (lambda: pf.export_fmu(live, tmp_path / "a.fmu", "force"), "inputs: force"),
        (lambda: pf.export_fmu(live, tmp_path / "a.fmu", platforms=("amiga",)), "amiga: no such"),
    ):
        with pytest.raises(pf.DescriptionError, match=said):
            call()
    assert not list(tmp_path.iterdir())
    shutil.rmtree(tmp_path)
