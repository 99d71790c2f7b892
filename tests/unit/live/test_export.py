"""FMUs and C sources beside the simulator, judged by FMPy where it is there.

Claims:
    In the loop, FMUs
    - FMU of delta, ur5, 3rrr by torque and motion | simulator, by FMPy | 1e-12 | 2e-16
    - FMI 3.0 as 2.0 | FMPy validates, simulates | same bits | passes
    - derivatives of every output by every input | central differences of a step taken again | 1e-4
      of each kind | passes
    - payload of 0.2 kg as a parameter of an FMU with 0.4 kg | the YAML's payload | 1e-8 | passes
    - stress of a beam | gauges at nine sections | 1e-6 | passes
    - libraries for Windows and macOS (ARM) export FMI 2.0 and 3.0 | PE and Mach-O tables | all
      functions | passes | also `PINFLEX_OTHER_MACHINES=1`
"""

from __future__ import annotations

import json
import os
import shutil
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import pinflex as pf
from pinflex.kernel import build
from pinflex.kernel.library import kernel
from pinflex.live.fmi import Description, Signal, commands, outputs_of

pytestmark = [
    pytest.mark.skipif(kernel().functions is None, reason="no kernel"),
    pytest.mark.skipif(not build.here().startswith("linux-x86_64"), reason="made for linux64"),
]
MODELS = ("delta", "ur5", "3rrr")
PUSH = {"delta": 0.5, "ur5": 0.5, "3rrr": 2e-3}  # N m


class Slave:
    """An FMU as FMPy runs it."""

    def __init__(self, file: Path, folder: Path, parameters: Mapping[str, float] = {}) -> None:
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
        for name, value in parameters.items():
            self.slave.setReal([self.at[name]], [value])
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


def fmu(model: str, folder: Path, inputs: str = "torque", version: int = 2) -> Path:
    file = folder / f"{model}_{inputs}_{version}.fmu"
    return pf.export_fmu(pf.Simulator(model), file, inputs, version=version)


BESIDE = """
import json, sys
import numpy as np
import pinflex as pf
from pinflex.mechanics.evaluation.frames import motion_of
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
    """Its validation, and its own master, whose steps are a whole number of ours; FMI 3 as 2."""
    fmpy = pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    found = []
    for version in (2, 3):
        file = fmu("3rrr", tmp_path, "motion", version)
        assert validate_fmu(str(file)) == []
        options = {"stop_time": 0.1, "step_size": 5e-3, "output_interval": 5e-3}
        found.append(fmpy.simulate_fmu(str(file), **options))
    home = pf.Simulator("3rrr").motors.position
    for name, x in zip(pf.load("3rrr").motors, home, strict=True):
        np.testing.assert_allclose(found[0][f"position {name}"], x, atol=1e-12)
    assert found[0].dtype == found[1].dtype
    for name in found[0].dtype.names:
        np.testing.assert_array_equal(found[0][name], found[1][name])


# Round-off of positions, and what it makes over h = 1e-3 s of speeds, over h^2 of torques.
NOISE = {
    "position": 1e-14,
    "platform": 1e-14,
    "deflection": 1e-14,
    "velocity": 1e-11,
    "torque": 1e-8,
}


@pytest.mark.parametrize("inputs", ["torque", "motion"])
def test_derivatives_are_those_of_differences(inputs: str, tmp_path: Path) -> None:
    """Every output of a step by every input, beside the step taken again with others."""
    slave = Slave(fmu("3rrr", tmp_path, inputs), tmp_path / "a")
    one, n = slave.slave, 3
    start = np.array(one.getReal(slave.inputs))

    def given(k: int) -> np.ndarray:
        t, now = 1e-3 * k, start.copy()
        if inputs == "torque":
            return now + 2e-2 * np.sin(60 * t) * np.array([1.0, -0.5, 0.3])
        now[:n] += 5e-3 * (1 - np.cos(40 * t))
        now[n : 2 * n] = 0.2 * np.sin(40 * t)
        now[2 * n :] = 8.0 * np.cos(40 * t)
        return now

    for k in range(1, 40):
        slave.step(given(k))
    before, told = one.getFMUState(), [slave.at[name] for name in slave.outputs]

    def taken(change: np.ndarray) -> np.ndarray:
        one.setFMUState(before)
        return np.array([*slave.step(given(40) + change).values()])

    # Differences: Newton's tolerance of 1e-7 of the accelerations, over what the inputs change.
    size = {"position": 2e-5, "velocity": 2e-2, "acceleration": 20.0, "torque": 2e-2}
    for k, reference in enumerate(slave.inputs):
        name = next(key for key, x in slave.at.items() if x == reference)
        step = size[name.split()[1]] * np.eye(len(start))[k]
        want = (taken(step) - taken(-step)) / (2 * step[k])
        taken(0 * step)
        found = np.array(one.getDirectionalDerivative(told, [reference], [1.0]))
        kinds = np.array([key.split()[0] for key in slave.outputs])
        for kind, noise in NOISE.items():
            rows = kinds == kind
            allowed = 1e-4 * np.abs(want[rows]).max() + noise / step[k]
            assert np.abs(found[rows] - want[rows]).max() <= allowed, (name, kind)
    with pytest.raises(Exception, match=r"(?i)error|status"):
        one.getDirectionalDerivative([slave.inputs[0]], [slave.inputs[0]], [1.0])


def test_payload_and_stress(tmp_path: Path) -> None:
    """Half of a payload of the YAML as a parameter; a beam's stress under its weight as Euler's."""
    frame = str(pf.load("3rrr").description.platform)
    mass = [f"payload.at={frame}", "payload.centre=[0.01,0.02,0]"]
    heavy = [*mass, "payload.mass=0.4", "payload.inertia=[4e-4,4e-4,8e-4,0,0,0]"]
    light = [*mass, "payload.mass=0.2", "payload.inertia=[2e-4,2e-4,4e-4,0,0,0]"]
    file = pf.export_fmu(pf.Simulator(pf.load("3rrr", heavy)), tmp_path / "heavy.fmu")
    robot, push = pf.load("3rrr", light), np.array([0.05, -0.02, 0.03])
    live = pf.Simulator(robot)
    slaves = [
        Slave(file, tmp_path / name, parameters=given)
        for name, given in (("a", {"payload": 0.2}), ("b", {}))
    ]
    live.step(torque=0 * push)
    for one in slaves:
        one.step(0 * push)  # pushed by nothing, as FMUs begin
    for _ in range(60):
        live.step(torque=push)
        told = [one.step(push) for one in slaves]
    want = live.motors.velocity
    speeds = [np.array([x[f"velocity {m}"] for m in robot.motors]) for x in told]
    scale = np.abs(want).max()
    assert np.abs(speeds[0] - want).max() < 1e-8 * scale  # other instructions: round-off
    assert np.abs(speeds[1] - want).max() > 0.05 * scale
    # The strains that its gauges read, of the outermost fibres at nine sections.
    for link, part in robot.parts.items():
        section = part.spec.section
        gauges = {
            f"{k} {y} {z}": pf.StrainGauge(link, k * part.bodies[0].length / 8, y, z)
            for k in range(9) for y, z in section.fibres
        }  # fmt: skip
        again = pf.Simulator(robot, sensors=gauges)
        again._at = live._at
        read = [abs(float(again.sensor(name))) for name in gauges]
        assert told[0][f"stress {link}"] == pytest.approx(
            part.spec.material.E * max(read), rel=1e-6
        )


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
    twice, once = (
        Slave(file, tmp_path / "b", parameters={"damping": 2.0}),
        Slave(file, tmp_path / "c"),
    )
    live.step(torque=0 * push)  # pushed by nothing, as FMUs begin
    still = [one.step(0 * push) for one in (twice, once)]
    for name, x in still[0].items():
        noise = 1e-4 if name.startswith("stress") else 1e-12  # Pa: of E = 7e10
        assert x == pytest.approx(still[1][name], abs=noise), name
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
    factor = Signal("damping", "", "of joints")
    about = Description(name, 1e-3, [signal], [0.5], [signal], [(factor, 1.0)], "tables")
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
    assert len(shared) == 6 + 6 + 6 + 6  # torques, positions, speeds, platform
    assert all(told[name] == path.attrs["units"][name] for name in shared)
    assert {one.unit for one in commands(robot, True)} == {"N"}


def exports_of_pe(data: bytes) -> set[str]:
    """Names in the export directory of a 64-bit PE file (Microsoft PE format, section 6.3)."""

    def number(at: int, kind: str = "I") -> int:
        return int(struct.unpack_from("<" + kind, data, at)[0])

    head = number(0x3C)
    assert data[head : head + 4] == b"PE\0\0" and number(head + 4, "H") == 0x8664
    optional, sections = head + 24, head + 24 + number(head + 20, "H")

    def place(address: int) -> int:
        for k in range(number(head + 6, "H")):
            size, first, _, raw = struct.unpack_from("<4I", data, sections + 40 * k + 8)
            if first <= address < first + size:
                return int(raw + address - first)
        raise AssertionError(address)

    table = place(number(optional + 112))
    names = place(number(table + 32))
    starts = [place(number(names + 4 * k)) for k in range(number(table + 24))]
    return {data[at : data.index(b"\0", at)].decode() for at in starts}


def exports_of_macho(data: bytes) -> set[str]:
    """Names that a 64-bit Mach-O library defines for others (Apple, mach-o/nlist.h)."""
    magic, kind, _, _, count = struct.unpack_from("<5I", data)
    assert magic == 0xFEEDFACF and kind == 0x0100000C  # ARM64
    at, found = 32, set()
    for _ in range(count):
        command, size = struct.unpack_from("<2I", data, at)
        if command == 2:  # LC_SYMTAB
            symbols, number, strings, _ = struct.unpack_from("<4I", data, at + 8)
            for k in range(number):
                name, what, section = struct.unpack_from("<IBB", data, symbols + 16 * k)
                if what & 0x11 == 0x01 and section:  # external, not private, defined
                    begin = strings + name
                    found.add(data[begin : data.index(b"\0", begin)].decode())
        at += size
    return found


@pytest.mark.skipif(
    "PINFLEX_OTHER_MACHINES" not in os.environ,
    reason="zig makes libraries of C first, 80 s: set PINFLEX_OTHER_MACHINES=1",
)
def test_libraries_for_other_machines_export_the_standard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every function of FMI 2.0 and 3.0 that FMPy loads, and nothing of the kernel."""
    pytest.importorskip("ziglang")
    fmi2, fmi3 = pytest.importorskip("fmpy.fmi2"), pytest.importorskip("fmpy.fmi3")
    monkeypatch.setattr(build, "FLAGS", tuple("-O0" if x == "-O3" else x for x in build.FLAGS))
    live, wanted = pf.Simulator("cantilever"), ("win64", "darwin-arm")
    file = pf.export_fmu(live, tmp_path / "a.fmu", platforms=wanted, version=3)
    with zipfile.ZipFile(file) as fmu:
        dll, dylib = (
            fmu.read(f"binaries/{name}")
            for name in ("x86_64-windows/cantilever.dll", "aarch64-darwin/cantilever.dylib")
        )
    known = {
        name
        for one, prefix in ((fmi2.FMU2Slave, "fmi2"), (fmi3.FMU3Slave, "fmi3"))
        for name in dir(one) if name.startswith(prefix)
    }  # fmt: skip
    assert {"fmi2DoStep", "fmi3DoStep", "fmi3GetDirectionalDerivative"} <= known
    assert known <= exports_of_pe(dll)
    assert {f"_{name}" for name in known} <= exports_of_macho(dylib)
    assert not any(name.startswith("pinflex_") for name in exports_of_pe(dll))


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
