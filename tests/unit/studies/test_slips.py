"""What `check` says of slips of sign and unit, of what comes too late, and of the branch taken."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import pinflex as pf
from tests.scenes import Body, load

ARM = [
    Body("upper", "base", "revolute", mass=2.0, com=(0.2, 0, 0), inertia=(0.01, 0.03, 0.03)),
    Body("fore", "upper", "revolute", (0.4, 0, 0), mass=1.0, com=(0.2, 0, 0),
         inertia=(0.01, 0.02, 0.02)),
    Body("hand", "fore", xyz=(0.4, 0, 0), mass=0.5),
]  # fmt: skip
BEND = """platform: hand
flexible: {fore: {material: steel, section: {shape: circle, diameter: 0.02}}}
motion: {kind: cycloid, joints: {upper_joint: 0.5}, duration: 0.5}
"""


def told(folder: Path, bodies: list[Body] = ARM, *changes: str, inertia: str = "urdf") -> str:
    return " ".join(pf.check(load(folder, bodies, BEND, changes, inertia=inertia)).warnings)


@pytest.mark.parametrize(("change", "said"), [
    ("gravity=[0, 0, 9.81]", "falls upward. Write [0, 0, -9.81]"),
    ("flexible.fore.material={E: 2e11, nu: 0.3, rho: 7.85}", "rho below 10 kg/m^3: fore"),
    ("payload={at: hand, mass: 1, from: 0.5}", "payload (0.5 s): not before the end of the run"),
    ("forces={push: {at: hand, force: [1, 0, 0], start: 2}}", "forces.push (2 s): not before"),
])  # fmt: skip
def test_values_that_are_mostly_slips_are_named(change: str, said: str, tmp_path: Path) -> None:
    assert said not in told(tmp_path)
    assert said in told(tmp_path, ARM, change)


@pytest.mark.parametrize(("slip", "said"), [
    ({"rpy": (0, 0, 90)}, "angles that look like degrees: upper_joint (rpy)"),
    ({"mass": 0.0, "inertia": (0, 0, 0)}, "no mass: upper (moved by upper_joint)"),
    ({"inertia": (1e4, 3e4, 3e4)}, "radii of gyration beyond the whole robot (0.8 m): upper 122 m"),
])  # fmt: skip
def test_so_are_those_of_the_urdf(slip: dict[str, object], said: str, tmp_path: Path) -> None:
    assert said not in told(tmp_path)
    assert said in told(tmp_path, [replace(ARM[0], **slip), *ARM[1:]])


def test_compare_says_it_too(tmp_path: Path) -> None:
    robot = load(tmp_path, ARM, BEND, ["gravity=[0, 0, 9.81]"], inertia="urdf")
    notes = pf.compare(robot, levels=("rigid", "ked")).table.notes
    assert any("falls upward" in note for note in notes)


def test_limits_in_degrees(tmp_path: Path) -> None:
    load(tmp_path, ARM, BEND, inertia="urdf")
    file = tmp_path / "scene.urdf"
    limits = re.compile('lower="[^"]*" upper="[^"]*"')
    file.write_text(limits.sub('lower="-170" upper="170"', file.read_text(), count=1))
    said = " ".join(pf.check(pf.load(tmp_path / "scene.yaml")).warnings)
    assert "angles that look like degrees: upper_joint (limits). " in said


def test_a_run_says_what_comes_after_its_end(tmp_path: Path) -> None:
    late = "payload={at: hand, mass: 1, from: 0.5}"
    run = pf.solve(load(tmp_path, ARM, BEND, [late]), level="rigid")
    assert any("payload (0.5 s): not before the end" in text for text in run.meta["warnings"])


@pytest.mark.parametrize(("guess", "side"), [(1.2, -1), (-1.2, 1)])
def test_the_branch_that_closing_takes_is_told(guess: float, side: int, tmp_path: Path) -> None:
    """A parallel five-bar, elbows 0.2 apart, couplers 0.4: both by the triangle that they make."""
    bar = {"mass": 0.1, "inertia": (1e-3, 1e-3, 1e-3)}
    bodies = [
        Body(f"{part}_{s}", on, "continuous", (x, 0, 0), com=(0.1, 0, 0), **bar)
        for s, x in (("l", -0.1), ("r", 0.1))
        for part, on, x in (("crank", "base", x), ("rod", f"crank_{s}", 0.25))
    ]
    bodies += [Body(f"end_{s}", f"rod_{s}", xyz=(0.4, 0, 0)) for s in "lr"]
    robot = load(tmp_path, bodies, (
        "actuated: [crank_l_joint, crank_r_joint]\nloops: {pin: {kind: revolute, between: "
        f"[end_l, end_r]}}}}\nhome: {{rod_l_joint: {guess}}}\n"
    ))  # fmt: skip
    inner = np.arccos(0.1 / 0.4)  # of the triangle 0.4, 0.4, 0.2 at its base
    found = pf.check(robot)
    assert found.moved == pytest.approx(
        {"rod_l_joint": -side * inner, "rod_r_joint": -side * (np.pi - inner)}, abs=1e-8
    )
    assert "`home` chooses" in str(found)
    there = pf.load(
        robot.description.with_overrides([f"home.{n}={x}" for n, x in found.moved.items()])
    )
    assert not pf.check(there).moved


def test_holding_torques_that_are_round_off_are_none(tmp_path: Path) -> None:
    """Hinges along gravity, their frames turned by angles of three digits: nothing to hold."""
    turn = Rotation.from_euler("xyz", (1.1, 0.3, 0.7)).as_matrix()
    axis = tuple(turn.T @ [0, 0, 1])
    links = [
        Body(f"arm_{k}", f"arm_{k - 1}" if k else "base", "revolute", (0.4 * (k > 0), 0, 0),
             rpy=(0, 0, 0) if k else (1.1, 0.3, 0.7), axis=axis, mass=50.0, com=(0.2, 0, 0),
             inertia=(0.1, 0.7, 0.7))
        for k in range(3)
    ]  # fmt: skip
    bars = "{material: steel, section: {shape: circle, diameter: 0.05}}"
    flexible = f"flexible: {{arm_0: {bars}, arm_1: {bars}}}\ngravity: [0, 0, -9.81]"
    rest = pf.check(load(tmp_path, links, f"platform: arm_2\n{flexible}", inertia="urdf")).statics
    for torques in (rest.holding_rigid, rest.holding_linear):
        assert torques == (0.0, 0.0, 0.0)
    assert rest.linear is not None
    assert rest.linear.position[2] < 0.0


def test_a_chain_on_springs_that_hangs_is_not_said_to_be_too_soft(tmp_path: Path) -> None:
    """Begun at 0.3 rad, it comes to rest where springs and weight are both at rest: at zero."""
    links = [
        Body("drum", "base", "revolute", axis=(0, 1, 0), mass=1.0, inertia=(0.1, 0.1, 0.1)),
        Body("rod", "drum", "revolute", axis=(0, 1, 0), mass=0.2, com=(0, 0, -0.25),
             inertia=(0.004, 0.004, 1e-4)),
        Body("hook", "rod", xyz=(0, 0, -0.5)),
    ]  # fmt: skip
    scene = """platform: hook
actuated: [drum_joint]
joints: {rod_joint: {spring: 0.5}}
flexible: {rod: {material: aluminium, section: {shape: circle, diameter: 0.01}}}
gravity: [0, 0, -9.81]
home: {rod_joint: 0.3}
"""
    said = " ".join(pf.check(load(tmp_path, links, scene, inertia="urdf")).warnings)
    assert "home is not where it comes to rest" in said
    assert "rod_joint: " in said
    assert "too soft" not in said


def test_two_joints_in_one_entry_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(pf.DescriptionError, match="one entry for each: upper_joint, fore_joint"):
        load(tmp_path, ARM, BEND + 'joints: {"upper_joint, fore_joint": {damper: 1}}')


def test_a_comparison_of_a_scene_that_no_level_solves_has_its_name(tmp_path: Path) -> None:
    load(tmp_path, ARM, BEND, inertia="urdf")
    robot = pf.load((tmp_path / "scene.yaml").rename(tmp_path / "crane.yaml"))
    stuck = pf.cycloid(platform={"x": 5.0}, duration=0.5)  # beyond its reach
    done = pf.compare(robot, stuck, levels=("ked",))
    assert done.table.name == "crane"


@pytest.mark.parametrize("heavier", [1.0, 4.0])
def test_a_link_heavier_than_its_beam_is_told_what_that_may_cost(
    tmp_path: Path, heavier: float
) -> None:
    """A uniform cantilever, whose first frequencies are 1.8751^2 and 4.6941^2 of sqrt(EI / mu L^4).

    What is heavier than the beam rides at a third of it and at its end, where the second is 12 %
    lower.
    """
    mass = heavier * 7850 * np.pi * 0.01**2
    turning = mass / 12 + mass * 0.01**2 / 4
    links = [
        Body("bar", "base", "revolute", axis=(0, 0, 1), mass=mass, com=(0.5, 0, 0),
             inertia=(mass * 0.01**2 / 2, turning, turning)),
        Body("tip", "bar", xyz=(1, 0, 0)),
    ]  # fmt: skip
    bar = "{end: tip, material: steel, section: {shape: circle, diameter: 0.02}}"
    scene = f"platform: tip\nflexible: {{bar: {bar}}}\ngravity: [0, 0, 0]"
    robot = load(tmp_path, links, scene, inertia="urdf")
    said = [float(x) for x in re.findall(r"\(([\d.]+) Hz\)", " ".join(pf.check(robot).warnings))]
    stiff = robot.parts["bar"].spec.material.E * np.pi * 0.02**4 / 64
    exact = np.array([1.875104, 4.694091]) ** 2 * np.sqrt(stiff / mass) / (2 * np.pi)
    if heavier > 1:
        # the static shapes and two modes of the default basis leave 0.6 % to the second
        np.testing.assert_allclose(said[:2], exact, rtol=1e-2)
        found = pf.modes(robot, count=2, preload="none").frequencies
        assert found[1] < 0.9 * exact[1]
        spread = ["flexible.bar.material={like: steel, rho: urdf}"]
        robot = load(tmp_path, links, scene, spread, inertia="urdf")
        assert not [text for text in pf.check(robot).warnings if "heavier" in text]
    else:
        assert said == []
