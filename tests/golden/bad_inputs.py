"""What bad input is told: every message of over 300 inputs, kept in messages.txt.

`python -m tests.golden.bad_inputs` writes the file anew; read its difference before a commit.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pinflex as pf
from pinflex.description import description, section
from pinflex.description.blocks import material
from pinflex.description.description import read
from pinflex.description.motions import motion
from pinflex.errors import PinflexError
from pinflex.studies.scenes import home
from tests.unit.description.test_description import BAD_URDFS, BAD_VALUES, URDF, YAML, write

FILE = Path(__file__).with_name("messages.txt")
JOINTS = """\
cross: {spring: 1}
tip: {damper: 1}
motor: {spring: 2}
motor: {spring: 1, parallel_spring: 2}
motor: {rotor_inertia: 1e20}
elbow: {spring: -1}
elbow: {spring: yes}
elbow: {rest: 1}
elbow: {stiffness: 1}
elbow: 3
motor: {drive: 3}
motor: {drive: {gears: 100}}
motor: {drive: {ratio: 100}}
motor: {drive: {gear: 0}}
motor: {drive: {stiffness: 0}}
motor: {drive: {damping: 1}}
motor: {drive: {efficiency: 1.2}}
motor: {drive: {limit_curve: [[0, 1]]}}
motor: {drive: {limit_curve: [[1, 1], [0, 1]]}}
motor: {drive: {stiffness: 1}, parallel_spring: 1}
motor: {drive: {motor_inertia: 1}, rotor_inertia: 1}
motor: {drive: {friction: {coulomb: 1}}, friction: {coulomb: 1}}
elbow: {drive: {stiffness: 1}}
motor: {friction: {coulomb: 2, breakaway: 1}}
motor: {friction: {stribeck: 1}}
motor: {friction: {coulomb: 1, breakaway: 2, stribeck: 1e-4}}
cross: {friction: {coulomb: 1}}
ball: {type: spherical, drive: {gear: 3}}
ball: {type: floating}
ball: {type: universal, axes: [x]}
ball: {type: universal, axes: 3}
ball: {type: universal, axes: [x, q]}
""".splitlines()
LOOPS = """\
pin: {kind: weld, between: [rod_tip, plate], axis: z}
pin: {kind: prismatic, between: [rod_tip, plate], stiffness: {along: 1e5}}
pin: {kind: prismatic, between: [rod_tip, plate], stiffness: {across: 0}}
pin: {kind: distance, between: [rod_tip, plate], stiffness: {across: 1e5}}
pin: {kind: planar, between: [rod_tip, plate], stiffness: 1e5}
pin: {kind: spherical, between: [rod_tip, plate], axis: z}
pin: {kind: revolute, between: [rod_tip, plate], axis_b: z}
pin: {kind: revolute, between: [rod_tip, plate], length: 1}
pin: {kind: universal, between: [rod_tip, plate], axis_b: 7}
pin: {kind: revolute, between: [rod_tip, plate], sleeve: 1}
pin: {kind: spin, between: [rod_tip, plate]}
pin: {kind: slider, between: [rod_tip, plate], sleeve: -1}
pin: {kind: slider, between: [rod_tip, plate], pivoting: true}
pin: {kind: slider, between: [rod_tip, plate], pivoting: 1}
pin: {kind: slider, between: [rod_tip, plate], sleeve: 0.1, pivoting: true, turning: false}
pin: {kind: distance, between: [rod_tip, plate], length: 1e9}
pin: {kind: revolute, between: plate}
pin: {kind: revolute}
pin: revolute
pin: {kind: revolute, between: [rod_tip, plate], axes: z}
pin: {kind: 3, between: [rod_tip, plate]}
""".splitlines()
SOLVE = """\
{level: auto}
{integrator: rk4}
{ked: structural}
{ked: half, level: ked}
{drive: velocity}
{start: bent}
{until: 0}
{until: -1}
{until: 1e12}
{dt: fast}
{tol: 1e-3, dt: 1e-3}
{tol: 1}
{tol: 0}
{tol: 1e-12}
{asked: torque}
{asked: [torques]}
{asked: [torque, torque]}
{samples: 1.5}
{samples: 10000000000}
{newmark: [0.5]}
{newmark: [2, 0.5]}
{newmark: [-1, 0.5]}
{rho_inf: 1.5}
{kp: 1}
{kd: -1, drive: torque}
{kp: 1e40, drive: torque}
{steps: 3}
[]
{level: ked, integrator: newmark, newmark: 0.5}
""".splitlines()
LINKS = """\
basis: {kind: assumed, boundary: fixed}
basis: {kind: assumed, modes: 0}
basis: {kind: assumed, stretch: cosines}
basis: {kind: assumed, elements: 3}
basis: {kind: finite_element, order: linear}
basis: {kind: finite_element, boundary: clamped_clamped}
basis: {kind: finite_element, elements: 0}
basis: {kind: finite_element, elements: 20000}
basis: {kind: finite_element, modes: 3}
basis: {kind: ritz8, modes: 3}
basis: {internal: -1}
basis: {internal: 1000}
basis: {modes: 3}
basis: {kind: 3}
basis: cubic
basis: {kinds: assumed}
inertia: mesh
start: nowhere
end: 3
length: 0
length: 1e9
up: q
up: [0, 0]
up: [0, 0, 0]
axial: 1
axial: maybe
rotary_inertia: 1
second_order: maybe
third_order: 2
temperature: warm
temperature: 1e9
temperature: 50, axial: false
segments: -1
segments: 2.5
root: {mass: a}
tip: {inertia: [1, 2]}
tip: {masses: 1}
damping: {modal: -1}
damping: {rayleigh: 1}
damping: {rayleigh: [1, 2], modal: 0.1}
damping: {scope: system}
patches: 3
colour: red
""".splitlines()
SOLIDS = """\
{kind: mesh}
{kind: mesh, file: a.msh}
{kind: mesh, file: a.msh, rod: {diameters: [1]}}
{kind: mesh, rod: {diameters: [1, 2]}}
{kind: mesh, rod: {diameters: 1}}
{kind: mesh, rod: {diameters: [1]}, scale: 2}
{kind: mesh, file: 3, interfaces: {root: a}}
{kind: mesh, file: a.msh, interfaces: {root: [1, 2]}}
{kind: mesh, file: a.msh, modes: 0, interfaces: {root: a}}
{kind: mesh, file: a.msh, internal: 0, interfaces: {root: a}}
{kind: matrices, mass: m.mtx}
{kind: matrices, file: a.npz, size: 1}
""".splitlines()
SOLID_LINKS = (
    *("torsion: true", "inertia: urdf", "segments: 2", "section: {shape: circle}"),
    "temperature: 50",
)
SECTIONS = """\
3
{}
{shape: square}
{shape: rectangle, width: 1}
{shape: rectangle, width: 1, thickness: -1}
{shape: rectangle, width: 1, thickness: 1, diameter: 1}
{shape: circle, diameter: a}
{shape: tube, diameter: 0.02, wall: 0.01}
{shape: tube, diameter: 0.02}
{shape: i, width: 0.02, height: 0.02, flange: 0.01, web: 0.001}
{shape: i, width: 0.02, height: 0.02, flange: 0.001, web: 0.02}
{shape: given, A: 1, Iy: 1, Iz: 1}
{shape: given, A: 1, Iy: 1, Iz: 1, J: 3}
{shape: given, A: 1, Iy: 1, Iz: 1, J: 1, fibres: [[0, 0]]}
{shape: given, A: 1, Iy: 1, Iz: 1, J: 1, fibres: [[0, 0], [1], [2, 2]]}
{shape: circle, diameter: 0.01, ky: 0}
{shape: circle, diameter: 0.01, Wt: 1}
{shape: circle, diameter: 0.01, J: 1e40}
""".splitlines()
MATERIALS = """\
unobtainium
3
{}
{E: 1e9}
{nu: 0.3}
{E: 1e9, nu: 0.6}
{E: 1e9, nu: -1}
{E: 0, nu: 0.3}
{E: 1e9, G: 1e6}
{like: stel}
{like: steel, rho: 0}
{like: steel, rho: pdf}
{like: steel, yield_strength: -1}
{like: steel, thermal_expansion: 1}
{like: steel, name: 3}
{E: 1e9, nu: 0.3, colour: 1}
{E: 1e40, nu: 0.3}
""".splitlines()
MOTIONS = """\
3
{kind: 3, duration: 1}
{kind: cycloid}
{kind: cycloid, duration: 1}
{kind: cycloid, duration: 1, joints: 3}
{kind: cycloid, duration: 1, joints: {a: b}}
{kind: cycloid, duration: 1, joints: {a: 1}, platform: {x: 1}}
{kind: cycloid, duration: 1, platform: {w: 1}}
{kind: cycloid, duration: 0, joints: {a: 1}}
{kind: cycloid, duration: 1, speed: 1, joints: {a: 1}}
{kind: hold}
{kind: trapezoid, ramp: 1, joints: {a: 1}}
{kind: trapezoid, ramp: 1, duration: 1, joints: {a: 1}}
{kind: trapezoid, ramp: 2, speed: 1, joints: {a: 1}}
{kind: trapezoid, velocity: 1, joints: {a: 1}}
{kind: trapezoid, ramp: 1, duration: 3, velocity: 1, joints: {a: 1}}
{kind: scurve, velocity: 1, acceleration: 1, joints: {a: 1}}
{kind: scurve, velocity: 1, acceleration: 1, jerk: 0, joints: {a: 1}}
{kind: scurve, velocity: {b: 1}, acceleration: 1, jerk: 1, joints: {a: 1}}
{kind: scurve, velocity: 1, acceleration: 1, jerk: 1, joints: {a: 0}}
{kind: trajectory}
{kind: trajectory, file: none.csv}
{kind: trajectory, file: none.txt}
{kind: trajectory, joint_names: [a], points: 3}
{kind: trajectory, joint_names: [a], points: [{positions: [1], time_from_start: 0}]}
{kind: trajectory, joint_names: [a], points: [{positions: [1, 2], time_from_start: 1}]}
{kind: trajectory, joint_names: [a], points: [{positions: [1], time_from_start: 1}], start: {b: 1}}
{kind: harmonic, frequency: 0, joints: {a: 1}}
{kind: circle, center: 3, radius: 1, omega: 1}
{kind: circle, center: [0, 0], radius: 0, omega: 1}
{kind: circle, center: [0, 0], radius: 1, omega: 1, plane: [x]}
{kind: circle, center: [0, 0], radius: 1, omega: 1, direction: 2}
{kind: circle, center: [0, 0], radius: 1, omega: 1, fixed: {x: 1}}
{kind: circle, center: [0, 0], radius: 1, omega: 1, fixed: {q: 1}}
{kind: formula, duration: 1, joints: 3}
{kind: formula, duration: 1, joints: {a: "q + 1"}}
{kind: formula, duration: 1, joints: {a: "1/t"}}
{kind: formula, duration: 1, joints: {a: "t"}, absolute: 1}
{kind: moves, moves: {x: 1}}
{kind: moves, moves: [{platform: {x: 1}, duration: 1}, {joints: {a: 1}, duration: 1}]}
{kind: moves, moves: [{platform: {x: 1}, start: -1, duration: 1}]}
{kind: moves, moves: [{platform: {x: 1}, from: 1, duration: 1}]}
{kind: moves, moves: [{platform: {x: 1}, start: 1}]}
{kind: moves, moves: [{platform: {x: 1}, duration: 1}], duration: 0.5}
{kind: adept, duration: 0.3, across: y, up: y}
{kind: adept, duration: 0.3, up: w}
{kind: adept, duration: 0.3, width: a}
{kind: cycloid, duration: 1, joints: {a: 1}, shaper: zdv}
{kind: cycloid, duration: 1, joints: {a: 1}, shaper: {frequencies: 3}}
{kind: cycloid, duration: 1, joints: {a: 1}, shaper: {kind: zv, frequencies: [3, -1]}}
{kind: cycloid, duration: 1, joints: {a: 1}, shaper: {kind: zv, frequencies: 3, damping: 2}}
{kind: cycloid, duration: 1, joints: {a: 1}, shaper: {kind: zv, damping: 0.1}}
{kind: cycloid, duration: 1, joints: {a: 1}, shaper: {kind: zv, modes: 0}}
{kind: sampled}
{kind: sampled, t: [0, 1, 2, 3], joints: [a]}
{kind: sampled, t: [0, 1, 2], joints: {a: [0, 1, 2]}}
{kind: sampled, t: [1, 2, 3, 4], joints: {a: [0, 1, 2, 3]}}
{kind: sampled, t: [0, 1, 1, 2], joints: {a: [0, 1, 2, 3]}}
{kind: sampled, t: [0, 1, 2, 3], joints: {a: [0, 1, 2]}}
{kind: sampled, t: [0, 1, 2, 3], joints: {a: [0, 1, 2, b]}}
{kind: sampled, t: [0, 1, 2, 3], joints: {a: [0, 1, 2, 3]}, periodic: true}
{kind: sampled, t: [0, 1, 2, 3], joints: {a: [0, 1, 2, 0]}, periodic: 1}
{kind: sampled, t: [0, 1, 2, 3], platform: {q: [0, 1, 2, 0]}}
{kind: sampled, file: nothing.csv}
{kind: sampled, t: [0, 1, 2, 3], file: nothing.csv}
""".splitlines()
TOP = """\
limit: 0
allow: [tall]
base: [1]
idle: kept
platform: plat
frames: [crank, crank]
home: {cross: 0.1}
home: {ball: [0, 0]}
home: 3
damping: 3
damping: {modal: 0.1, scope: system}
damping: {modal: 0.1, scope: all}
forces: {push: {at: nowhere}}
springs: {coil: {between: [crank, crank]}}
payload: 3
payload: {at: crank}
payload: {at: crnk, mass: 1}
payload: {at: crank, mass: 1, weight: 1}
payload: {at: crank, mass: 1, inertia: 2}
payload: {at: crank, mass: 1, from: -0.5}
payload: {at: crank, mass: 1, from: 0.5, until: 0.5}
added_masses: {water: {at: crank}}
added_masses: {water: {at: crank, mass: [1, -1, 0]}}
added_masses: {water: {at: crnk, mass: [1, 1, 0]}}
added_masses: {water: {mass: [1, 1, 0]}}
control: 3
control: {period: 0.1}
control: {delay: 0.1, hub: {measure: {joint: crank}, drive: {joint: crank}, kp: 1}}
control: {period: fast, hub: {measure: {joint: crank}, drive: {joint: crank}, kp: 1}}
control: {hub: {measure: {joint: crank}, drive: {joint: crank}, kp: 1, limit: 3}}
control: {period: 0.1, hub: {measure: {joint: motor}, drive: {joint: motor}, limit: 3}}
control: {period: 0.1, hub: {measure: {joint: elbow}, drive: {joint: motor}, kp: 1, target: motion}}
motion: {kind: cycloid, platform: {z: 1}, duration: 1}
motion: {kind: cycloid, joints: {cross: 1}, duration: 1}
motion: {kind: sampled, file: no.csv}
flexible: {"x*": 3}
""".splitlines()
BROKEN = (  # YAML that cannot be read
    "",
    "- urdf",
    "urdf: a\nbase: fixed\nurdf: b\n",
    "urdf: [a\nbase: fixed\n",
    "urdf: a\n\tbase: fixed\n",
    "urdf: a\n3: b\n",
    "urdf: none.urdf\n",
)
OPTIONS: tuple[dict[str, Any], ...] = (
    {"level": "stiff"},
    {"level": 3},
    {"levle": "rigid"},
    {"until": 0.0},
    {"until": "long"},
    {"until": float("nan")},
    {"dt": -1.0},
    {"dt": float("inf")},
    {"dt": "1e-3"},
    {"dt": 1e-3, "tol": 1e-3},
    {"tol": 1.0},
    {"tol": "tight"},
    {"tol": 0.0},
    {"samples": 1},
    {"samples": 1.5},
    {"asked": ["torques"]},
    {"asked": "torque"},
    {"integrator": "rk4"},
    {"integrator": "newmark", "rho_inf": 0.5},
    {"ked": "half", "level": "ked"},
    {"drive": "velocity"},
    {"drive": "torque", "level": "ked"},
    {"start": "bent"},
    {"kp": -1.0},
    {"kd": "much"},
    {"rho_inf": "x"},
    {"newmark": 0.5},
    {"newmark": [-1, 2]},
)


def under(key: str, line: str) -> str:
    """The YAML with `key` holding one line; its own block of that name is left out."""
    rows, out, skip = YAML.splitlines(), [], False
    for row in rows:
        skip = row.startswith(f"{key}:") or (skip and row.startswith(" "))
        if not skip:
            out.append(row)
    return "\n".join([*out, f"{key}: {line}", ""])


def texts() -> Iterator[tuple[str, str, str]]:
    """Name, YAML and URDF of every bad description."""
    for old, new, _ in BAD_VALUES:
        yield f"{old} -> {new}", YAML.replace(old, new, 1), URDF
    for old, new, _ in BAD_URDFS:
        yield f"urdf: {old} -> {new}", YAML, URDF.replace(old, new, -1 if old == "robot" else 1)
    for key, lines in (("joints", JOINTS), ("loops", LOOPS)):
        for line in lines:
            yield f"{key}: {line}", under(key, f"{{{line}}}"), URDF
    for line in SOLVE:
        yield f"solve: {line}", under("solve", line), URDF
    for line in LINKS:
        spec = "material: steel, section: {shape: circle, diameter: 0.01}"
        yield line, under("flexible", f"{{crank: {{{spec}, {line}}}}}"), URDF
    for line in SOLIDS:
        yield (
            f"basis: {line}",
            under("flexible", f"{{crank: {{material: steel, basis: {line}}}}}"),
            URDF,
        )
    for line in SOLID_LINKS:
        spec = "material: steel, basis: {kind: mesh, rod: {diameters: [0.01]}}"
        yield f"solid, {line}", under("flexible", f"{{crank: {{{spec}, {line}}}}}"), URDF
    for text in BROKEN:
        yield repr(text), text, URDF
    for line in TOP:
        key, _, rest = line.partition(": ")
        text = "urdf: bar4.urdf\n" + line + "\n" if key == "motion" else under(key, rest)
        yield line, text, URDF


def message(of: Callable[[], object]) -> str:
    """What a call raises; a call that raises nothing is part of the record too."""
    try:
        of()
    except PinflexError as error:
        return f"{type(error).__name__}: {error}"
    return "no error"


def messages() -> str:
    """Every input and what it is told, two lines each."""
    rows: list[str] = []

    def add(name: str, of: Callable[[], object]) -> None:
        rows.extend((f"# {name}", message(of), ""))

    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for name, yaml_text, urdf in texts():
            path = write(root, yaml_text, urdf)
            add(name, lambda path=path: read(path))
        scene = pf.load("cantilever")
        for option in OPTIONS:
            shown = ", ".join(f"{k}={v!r}" for k, v in option.items())
            add(f"solve({shown})", lambda option=option: _solved(scene, option))
        load = description.yaml_text.load
        for title, lines, reader in (
            ("section", SECTIONS, section.from_spec),
            ("material", MATERIALS, material.from_spec),
            ("motion", MOTIONS, lambda spec: motion.from_spec(spec, "motion")),
        ):
            for line in lines:
                spec = load(line, "x")
                add(f"{title}: {line}", lambda reader=reader, spec=spec: reader(spec))
        shared = "urdf: x\nhome: &a {m: 1}\nsolve: *a\n"
        add("home of an anchor", lambda: home.with_home(shared, {"m": 2.0}, "x.yaml"))
        return "\n".join(rows).replace(str(root), "FOLDER")


def _solved(scene: pf.Mechanism, options: dict[str, Any]) -> None:
    pf.solve(scene, **{"samples": 3, "until": 1e-3, **options})


if __name__ == "__main__":
    FILE.write_text(messages(), "utf-8")
