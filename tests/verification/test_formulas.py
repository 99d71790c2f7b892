"""Formulas of the textbook behind single outputs: stress, forces, work, shapers, rotations.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - bending adds to tension and to compression; second strength theory in pure torsion, (1 + nu)
      t; twist of a shaft that spins up, rho Ip a (L - x); weight, load and their moments on the
      frame | textbook; statics | 1e-12; 1e-6 | passes
    - a tee under pull or push and bend: N / A - M z / I at the foot or the flange | statics | 1e-6
      | passes
    - von Mises of a shaft; root moment with the arm of the bent beam; work of a load that turns,
      order of the rule; damped EI shaper; second order of three turns | textbook; statics;
      quadrature; differences | 1e-12; 1e-6; 4; 4 % of 5 %; 1e-4 | passes
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

import pinflex as pf
from pinflex.bodies.superelement import _second_rotation
from pinflex.description.blocks.external import FrameForce
from pinflex.description.motions.trajectory import shaper
from pinflex.description.section import from_spec
from pinflex.recovery.kinematics import load_work
from pinflex.recovery.links import stresses
from pinflex.recovery.recover import shaking
from pinflex.results.views import point_stress
from tests.finite import slope
from tests.scenes import Body, load
from tests.verification.test_beams import BEAM, scene


def test_a_shaft_under_bending_and_torsion() -> None:
    """sqrt(s^2 + 3 t^2) with s = 32 M / pi d^3, t = 16 T / pi d^3 (von Mises 1913)."""
    d, M, T = 0.02, 30.0, 50.0
    shaft = from_spec({"shape": "circle", "diameter": d}, "section")
    of = stresses(shaft, np.array([[[0.0, 0.0, 0.0, T, 0.6 * M, 0.8 * M]]]))
    bending, shear = 32 * M / (math.pi * d**3), 16 * T / (math.pi * d**3)
    assert of["shear"].item() == pytest.approx(shear, rel=1e-12)  # round-off
    # The worst fibre is one of a polygon of the rim: 24 places, cos(pi / 24) = 0.9914 at worst.
    assert bending * 0.991 <= of["bending"].item() <= bending * (1 + 1e-12)
    expected = math.sqrt(of["bending"].item() ** 2 + 3 * shear**2)
    assert of["von_mises"].item() == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("axial", [-500.0, 500.0])
def test_bending_adds_to_the_axial_stress_whatever_their_signs(axial: float) -> None:
    """|N| / A + 6 M / (b h^2) at the worst fibre, of a strut as of a tie."""
    width, height, M = 0.02, 0.01, 3.0
    strip = from_spec({"shape": "rectangle", "width": width, "thickness": height}, "section")
    flat = min((0, 1), key=lambda k: (strip.Iy, strip.Iz)[k])  # bent about its weaker axis
    for turn in (-M, M):
        forces = np.zeros((1, 1, 6))
        forces[0, 0, 0], forces[0, 0, 4 + flat] = axial, turn
        expected = abs(axial) / (width * height) + 6 * M / (width * height**2)
        assert stresses(strip, forces)["normal"].item() == pytest.approx(expected, rel=1e-12)


# A tee of 20 x 20 x 3 mm, flange upwards, about its own centroid: [m], z up.
WIDE, WALL = 0.02, 0.003
PARTS = ((WIDE * WALL, 0.0185, WIDE * WALL**3 / 12), (0.017 * WALL, 0.0085, WALL * 0.017**3 / 12))
AREA = sum(A for A, _, _ in PARTS)
CENTROID = sum(A * z for A, z, _ in PARTS) / AREA  # above the foot
TOP, FOOT = WIDE - CENTROID, -CENTROID
IY = sum(own + A * (z - CENTROID) ** 2 for A, z, own in PARTS)  # Steiner
TEE = f"""{{shape: given, A: {AREA}, Iy: {IY}, Iz: 2e-9, J: 3e-10, fibres: [
      [-0.01, {TOP}], [0.01, {TOP}], [0.0015, {FOOT}], [-0.0015, {FOOT}]]}}"""


@pytest.mark.parametrize(("pull", "lift"), [(500, 2), (500, -2), (-500, 2), (-500, -2)])
def test_a_tee_is_strained_most_where_pull_and_bend_meet(
    pull: float, lift: float, tmp_path: Path
) -> None:
    """N / A - M z / I, at the foot or the flange: whether N pulls or pushes decides which."""
    head = f"forces: {{load: {{at: tip, force: [{pull}, 0, {lift}]}}}}\nframes: [tip]\n"
    text = scene("{kind: craig_bampton, internal: 2}", head, section=TEE)
    text = text.replace("E: 1,", "E: 2e11,").replace("bending_z: false", "bending_z: true")
    run = pf.solve(load(tmp_path, BEAM, text), pf.hold(duration=1.0), "quasistatic", samples=2)
    x, _, z = run.frame("tip").position[0]
    M = lift * x - pull * z  # of the tip's load about the root, as the beam stands
    expected = max(abs(pull / AREA - M * at / IY) for at in (TOP, FOOT))
    # 1e-6: equilibrium to Newton's tolerance
    assert run.link("beam").stress("normal")[0, 0] == pytest.approx(expected, rel=1e-6)


ROD, DIAMETER = 0.8, 0.01  # [m], of steel
SHAFT = f"""
  shaft:
    material: {{E: 2.1e11, nu: 0.3, rho: 7800}}
    section: {{shape: circle, diameter: {DIAMETER}}}
    end: tip
    bending_y: true
    bending_z: true
    torsion: true
    axial: true
"""


def shaft(folder: Path, head: str) -> pf.Mechanism:
    """A round bar on a motor that turns it about its own axis."""
    bodies = (
        Body("shaft", "base", "revolute", axis=(1, 0, 0)),
        Body("tip", "shaft", xyz=(ROD, 0, 0)),
    )
    acts = f"gravity: [0, 0, 0]\nactuated: [shaft_joint]\n{head}\nflexible:"
    return load(folder, bodies, acts + SHAFT)


def test_the_second_theory_knows_poissons_ratio(tmp_path: Path) -> None:
    """Pure torsion: s1 = -s3 = t = 16 T / pi d^3 on the rim, and s1 - nu s3 = (1 + nu) t."""
    robot = shaft(tmp_path, "forces: {turn: {at: tip, moment: [2.0, 0, 0]}}")
    run = pf.solve(robot, pf.hold(duration=1.0), "quasistatic", samples=2)
    found = point_stress(run, "shaft", 0.0, DIAMETER / 2)
    tau = 16 * 2.0 / (math.pi * DIAMETER**3)
    # 1e-6: equilibrium to Newton's tolerance
    np.testing.assert_allclose(found.tau[-1], tau, rtol=1e-6)
    np.testing.assert_allclose(found.equivalent("second")[-1], 1.3 * tau, rtol=1e-6)


def test_a_shaft_that_spins_up_is_twisted_by_its_own_inertia(tmp_path: Path) -> None:
    """T(x) = -rho Ip a (L - x) from its outer part, a the acceleration; the motor has -T(0)."""
    robot = shaft(tmp_path, "")
    spin = pf.formula(joints={"shaft_joint": "5 * t^2"}, duration=1.0)
    run = pf.solve(robot, spin, "quasistatic", samples=3)
    of, polar = run.link("shaft"), math.pi * DIAMETER**4 / 32
    expected = -7800 * polar * 10.0 * (ROD - of.x)
    # 1e-6 of the largest: equilibrium to Newton's tolerance, and differences of the motion
    np.testing.assert_allclose(of.resultant[1, :, 3], expected, atol=1e-6 * abs(expected[0]))
    assert run.torque[1, 0] == pytest.approx(-expected[0], rel=1e-6)


def test_the_frame_bears_what_is_laid_on_the_robot(tmp_path: Path) -> None:
    """At rest: weight and load, and their moments about the origin (Varignon)."""
    bodies = (
        Body("arm", "base", "revolute", xyz=(0, 0, 0.4), axis=(0, 1, 0), mass=2.0,
             com=(0.3, 0.1, 0), inertia=(0.01, 0.02, 0.02)),
        Body("tip", "arm", xyz=(0.7, 0, 0.1)),
    )  # fmt: skip
    push, turn = np.array([4.0, -3.0, 6.0]), np.array([0.5, 0.2, -0.7])
    load_text = f"forces: {{push: {{at: tip, force: {push.tolist()}, moment: {turn.tolist()}}}}}"
    robot = load(tmp_path, bodies, f"gravity: [0, 0, -10]\nactuated: [arm_joint]\n{load_text}\n")
    found = shaking(robot, pf.solve(robot, pf.hold(duration=1.0), "rigid", samples=2))[-1]
    weight = np.array([0, 0, -20.0])
    moment = np.cross([0.3, 0.1, 0.4], weight) + np.cross([0.7, 0, 0.5], push) + turn
    np.testing.assert_allclose(found, [*(weight + push), *moment], atol=1e-12)  # round-off


def test_the_root_moment_has_the_arm_of_the_bent_beam(tmp_path: Path) -> None:
    """M = F_y (L - shortening) + F_x w: statics of the beam as it stands, whatever bends it."""
    head = "forces: {load: {at: tip, force: [-0.8, 0.3, 0]}}\nframes: [tip]\n"
    robot = load(tmp_path, BEAM, scene("{kind: craig_bampton, internal: 4}", head))
    run = pf.solve(robot, pf.hold(duration=1.0), "quasistatic", samples=2)
    (x, y, _), root = run.frame("tip").position[0], run.link("beam").resultant[0, 0]
    assert y > 0.12  # against the straight beam's F_y L: a third more
    # Forces are those of equilibrium, to Newton's tolerance.
    assert abs(root[5]) == pytest.approx(0.3 * x + 0.8 * y, rel=1e-6)


def swept(force: FrameForce, count: int) -> float:
    """Work of a load on a point that moves and turns, from instants of position and rotation."""
    t = np.linspace(0.0, 1.0, count)
    p, R, rate, rise = (np.array([f(x) for x in t]) for f in (place, turn, rates, rises))
    return float(load_work(force, t, p, R, rate, rise)[-1])


def place(t: float) -> list[float]:
    return [math.sin(2 * t), 0.5 * t**2, math.cos(t)]


def turn(t: float) -> np.ndarray:
    return Rotation.from_euler("z", 3 * t + t**2).as_matrix()


def rates(t: float) -> list[float]:
    return [2 * math.cos(2 * t), t, -math.sin(t), 0, 0, 3 + 2 * t]


def rises(t: float) -> list[float]:
    return [-4 * math.sin(2 * t), 1, -math.cos(t), 0, 0, 2]


@pytest.mark.parametrize("follower", [True, False])
def test_work_of_a_load_converges_with_the_fourth_power(follower: bool) -> None:
    force = FrameForce("f", "tip", (3.0, -2.0, 1.0), (0.5, 0.2, 4.0), follower, ramp=2.0)

    def power(t: float) -> float:
        R = turn(t) if follower else np.eye(3)
        v = np.array(rates(t))
        return force.scale(t) * float((R @ force.force) @ v[:3] + (R @ force.moment) @ v[3:])

    exact = quad(power, 0.0, 1.0, epsabs=1e-13)[0]
    steps = np.array([8, 16, 32])
    gaps = [abs(swept(force, int(n) + 1) - exact) for n in steps]
    # Euler-Maclaurin: h^4 once the end correction has the true slope, h^2 with any other.
    assert slope(1.0 / steps, gaps) > 3.7


@pytest.mark.parametrize("damping", [0.05, 0.1, 0.2, 0.3])
def test_the_damped_ei_shaper_leaves_its_five_per_cent(damping: float) -> None:
    made = shaper("ei", 2.0, damping)
    # The published fit of the shares is good to 4 % of 5 % up to a damping of 0.3.
    assert made.residual(2.0, damping).item() == pytest.approx(0.05, rel=0.041)
    # At the edges of its range, some 20 % off in frequency, no more than that either.
    assert np.all(made.residual(np.linspace(1.75, 2.3, 12), damping) < 0.053)


def test_second_order_of_an_interface_is_that_of_three_turns() -> None:
    """d2/ds dt of Rz Ry Rx at the sum of two sets of angles, by differences."""
    rng, h = np.random.default_rng(3), 1e-3

    def R(angles: np.ndarray) -> np.ndarray:
        return Rotation.from_euler("ZYX", angles[::-1]).as_matrix()

    for _ in range(5):
        one, two = rng.normal(size=(2, 3))
        parts = [a * b * R(h * (a * one + b * two)) for a in (1, -1) for b in (1, -1)]
        expected = sum(parts) / (4 * h**2)
        assert np.allclose(_second_rotation(one, two), expected, atol=1e-4)  # of size one, h^2
