"""The best design: closed forms, first-order conditions, catalogues, resume.

Claims:
    Derivatives, designs, scatter, fits
    - cantilever of least mass for a tip deflection | closed form | 1e-5 | passes
    - thickness and width part by their prices; what one per cent of a limit or a bound buys |
      multipliers by hand | 1e-4; 1e-3 | passes
    - the lightest tube of a catalogue = every tube by hand | enumeration | 1e-9 | passes
    - front of two aims: mass^2 sag is one number | closed form | 1e-4 | passes
    - two frequencies that meet where the design is best: width and thickness, mass ~ f^2 | closed
      form | 4e-4, the smooth least margin; 5 % | 3.5e-4; 2.00
    - more starts of a design are never worse, over a peak with kinks | - | 1e-3 | passes
"""

from __future__ import annotations

import json

import numpy as np
import pytest

import pinflex as pf
from pinflex.__main__ import main
from pinflex.description.reading.parameters import parameters
from pinflex.variation.design import kkt
from pinflex.variation.evaluator import limits, measure
from tests.scenes import Body, load

THICKNESS = "flexible.*.section.thickness"
STIFF = ["flexible.beam.section.thickness=0.02"]


def test_a_cantilever_of_least_mass_for_its_tip_deflection():
    # under its own weight w = rho g A L^4 / (8 E I) = 3 rho g L^4 / (2 E t^2): t = sqrt(...)
    robot = pf.load("cantilever", STIFF)
    best = pf.design(robot, "mass", {THICKNESS: (5e-3, 5e-2)}, ["sag < 1e-4"], starts=1)
    part = robot.parts["beam"]
    rho, E, L = part.spec.material.rho, part.spec.material.E, part.length
    exact = np.sqrt(3 * rho * 9.81 * L**4 / (2 * E * 1e-4))
    # the sag of a straight beam is linear to the square of 1e-4; SLSQP stops at 1e-8
    assert best.best[0] == pytest.approx(exact, rel=1e-5)
    # mass ~ t, sag ~ t^-2: one per cent of deflection buys half a per cent of mass
    assert best.multipliers[0] == pytest.approx(0.5, rel=1e-3)
    assert best.residual < 1e-6


def test_thickness_and_width_part_by_their_prices():
    # least rho b t L with b t^3 = given and b >= b0: as narrow as the bound lets it be
    robot = pf.load("cantilever", [*STIFF, "gravity=[0, 0, 0]"])
    vary = {THICKNESS: (5e-3, 8e-2), "flexible.*.section.width": (1e-2, 4e-2)}
    best = pf.design(robot, "mass", vary, ["stiffness.z > base"], starts=1)
    t, b = best.best[::1] if "thickness" in best.parameters[0] else best.best[::-1]
    assert b == pytest.approx(1e-2, rel=1e-6)
    assert t == pytest.approx(0.02 * 2 ** (1 / 3), rel=1e-4)
    # d ln m = d ln b + d ln t, 0 = d ln b + 3 d ln t: a narrower bound buys two thirds
    assert [*best.at_bound.values()] == pytest.approx([2 / 3], rel=1e-3)


def test_two_frequencies_that_meet_where_the_design_is_best():
    # bending in two planes: f ~ thickness and f ~ width, mass ~ both: the least is a square
    planes = [f"flexible.beam.bending_{axis}=true" for axis in "yz"]
    wide = "flexible.beam.section.width=0.03"
    robot = pf.load("cantilever", [*STIFF, *planes, wide, "gravity=[0, 0, 0]"])
    vary = {THICKNESS: (1e-2, 4e-2), "flexible.*.section.width": (1e-2, 4e-2)}
    best = pf.design(robot, "mass", vary, ["frequency.1 > base"], starts=1)
    # where both meet the smooth least of their margins is ln(2) / 2000 = 3.5e-4 below
    assert best.best == pytest.approx([0.02, 0.02], rel=4e-4)
    assert best.after["frequency.1"] >= best.before["frequency.1"] * (1 - 1e-5)
    # mass ~ f^2, by the slope of the smooth least of two margins
    assert best.multipliers[0] == pytest.approx(2.0, rel=0.05)
    assert best.residual < 1e-2
    assert len(best.history) < 30  # 13: nothing turns back at the kink


def test_multipliers_of_a_problem_in_closed_form():
    # least x + 2 y with x >= 0, y >= 0 margins at (0, 0): multipliers 1 and 2
    slope, rates = np.array([1.0, 2.0]), np.eye(2)
    found = kkt(slope, rates, np.zeros(2), np.zeros(2), np.array([[-1.0, 1.0]] * 2))
    np.testing.assert_allclose(found[0], [1, 2], atol=1e-12)
    assert found[1] == {} and found[2] < 1e-12
    # downhill with nothing in the way: no least value
    assert kkt(slope, rates, np.ones(2), np.zeros(2), np.array([[-1.0, 1.0]] * 2))[2] == 1.0


def test_a_catalogue_gives_the_lightest_tube_that_holds():
    robot = pf.load("ur5", ["flexible={upper_arm_link: {material: aluminium, section: "
                            "{shape: tube, diameter: 0.1, wall: 0.004}}}"])  # fmt: skip
    tubes = [{"diameter": d, "wall": w} for d in (0.08, 0.1, 0.12) for w in (0.001, 0.002, 0.003)]
    key = "flexible.upper_arm_link.section"
    best = pf.design(robot, "mass", {}, ["frequency.1 > 0.9*base"], choose={key: tubes}, starts=1)
    base = measure(robot, ["frequency.1"])["frequency.1"]
    rows = []
    for tube in tubes:  # by hand: every tube
        built = f"{key[:-8]}.as_built={{section: {{shape: tube, diameter: 0.1, wall: 0.004}}}}"
        other = pf.load(robot.description, [built, *(f"{key}.{k}={v}" for k, v in tube.items())])
        found = measure(other, ["mass", "frequency.1"])
        if found["frequency.1"] > 0.9 * base:
            rows.append((found["mass"], tube["diameter"], tube["wall"]))
    lightest = min(rows)
    assert (best.after["mass"], *best.best) == pytest.approx(lightest, rel=1e-9)


@pytest.mark.parametrize(
    "text, said",
    [
        ("frequency.1 = 12", "not of the form"),
        ("mass < 2*yield", "only stress.peak"),
        ("mass < 0", "above 0"),
    ],
)
def test_bad_limits_say_what_to_write(text, said):
    with pytest.raises(pf.DescriptionError, match=said):
        limits([text])


def test_limits_that_cannot_be_kept_are_said():
    robot = pf.load("cantilever", STIFF)
    with pytest.raises(pf.SceneError, match="Nearest: sag = "):
        pf.design(robot, "mass", {THICKNESS: (5e-3, 1e-2)}, ["sag < 1e-5"], starts=1)


def test_the_command_writes_a_yaml_that_is_the_design_and_resumes(tmp_path, capsys):
    out = tmp_path / "best.yaml"
    call = ["design", "cantilever", "--set", STIFF[0], "--minimise", "mass", "--vary",
            f"{THICKNESS}=5e-3:5e-2", "--keep", "sag < 1e-4", "--starts", "1", "-o", str(out),
            "--plot", str(tmp_path / "search.png")]  # fmt: skip
    assert main(call) == 0
    text = capsys.readouterr().out
    assert "Held by sag < 0.0001: one per cent looser buys 0.50 % of mass." in text
    assert (tmp_path / "search.png").stat().st_size > 10_000
    found = measure(pf.load(out), ["mass", "sag"])
    lines = (tmp_path / "best.yaml.journal").read_bytes().splitlines()
    assert main([*call, "--json"]) == 0  # everything is in the journal
    told = json.loads(capsys.readouterr().out)["designs"][0]["after"]
    assert found == pytest.approx({name: told[name] for name in found}, rel=1e-9)
    assert (tmp_path / "best.yaml.journal").read_bytes().splitlines() == lines


def test_two_aims_give_a_front(capsys):
    # mass ~ t, sag ~ t^-2: mass^2 sag is one number along the front
    robot = pf.load("cantilever", STIFF)
    front = pf.pareto(robot, "mass", "sag", {THICKNESS: (1e-2, 4e-2)}, points=4)
    products = [found.after["mass"] ** 2 * found.after["sag"] for found in front]
    np.testing.assert_allclose(products, products[0], rtol=1e-4)
    masses = [found.after["mass"] for found in front]
    assert masses == sorted(masses) and masses[-1] == pytest.approx(4 * masses[0], rel=1e-3)


ARM = (
    Body("hub", "base", "revolute", mass=0.5, inertia=(1e-3, 1e-3, 1e-3)),
    Body("arm", "hub", mass=0.1, com=(0.2, 0, 0)),
    Body("tip", "arm", xyz=(0.4, 0, 0), mass=0.02),
)
SHAKEN = """
actuated: [hub_joint]
gravity: [0, 0, 0]
platform: tip
flexible:
  arm:
    material: {like: steel}
    section: {shape: rectangle, width: 20 mm, thickness: 0.002}
    damping: {modal: 0.02}
    end: tip
motion: {kind: harmonic, joints: {hub_joint: 0.05}, frequency: 12, duration: 0.3}
solve: {level: coupled, dt: 0.001}
"""


def test_more_starts_are_never_worse_where_a_peak_has_kinks(tmp_path):
    # Driven through its resonance: the peak over time has kinks and several lows over thickness.
    robot = load(tmp_path, ARM, SHAKEN)
    vary = {"flexible.arm.section.thickness": (1.2e-3, 5e-3)}
    peaks = [
        pf.design(robot, "deviation.peak", vary, level="coupled", starts=n).after["deviation.peak"]
        for n in (1, 2, 4)
    ]
    assert peaks[1] <= peaks[0] * (1 + 1e-3)  # what a design is better by, at least
    assert peaks[2] <= peaks[1] * (1 + 1e-3)
    assert peaks[0] > 2 * peaks[1]  # the first descent ends in another low


def test_a_peak_is_least_where_two_instants_are_equally_high(tmp_path):
    # Thinner, one peak over time grows; thicker, another: secants of both meet in the kink.
    robot, key = load(tmp_path, ARM, SHAKEN), "flexible.arm.section.thickness"

    def peak(thickness: float) -> float:
        scene = pf.load(robot.description, [f"{key}={thickness!r}"])
        return measure(scene, ["deviation.peak"], "coupled")["deviation.peak"]

    left, right = (
        [(t, peak(t)) for t in pair] for pair in ((1.576e-3, 1.577e-3), (1.578e-3, 1.579e-3))
    )
    (a, b), (c, d) = (np.polyfit(*zip(*pair, strict=True), 1) for pair in (left, right))
    kink = (d - b) / (a - c)
    assert a < 0 < c
    found = pf.design(robot, "deviation.peak", {key: (1.5e-3, 1.9e-3)}, level="coupled", starts=1)
    # What a curve bends within a micrometre: some 1e-7 of either.
    assert found.best[0] == pytest.approx(kink, rel=1e-5)
    assert found.after["deviation.peak"] == pytest.approx(a * kink + b, rel=1e-6)
    assert found.residual < 1e-6  # 1 where the peak is one number: no gradient vanishes there
    light = pf.design(
        robot, "mass", {key: (1.5e-3, 1.9e-3)}, [f"deviation.peak < {peak(1.56e-3)!r}"],
        level="coupled", starts=1,
    )  # fmt: skip
    assert light.best[0] == pytest.approx(1.56e-3, rel=2e-5)  # what limits are kept to
    assert light.multipliers[0] > 0.1 and light.residual < 1e-6


def test_sag_is_that_under_loads_too():
    load_ = "forces={push: {at: tip, force: [0, 0, -0.1]}}"
    robot = pf.load("cantilever", ["gravity=[0, 0, 0]", load_])
    EI = 2.1e11 * 0.02 * 0.002**3 / 12
    # F L^3 / 3 EI, less what a bend of 3 mrad shortens: its square
    assert measure(robot, ["sag"])["sag"] == pytest.approx(0.1 * 0.5**3 / (3 * EI), rel=2e-5)


def test_a_first_design_that_cannot_be_solved_says_why():
    robot = pf.load("cantilever")
    weightless = robot.description.with_overrides(["gravity=[0, 0, 0]"])
    with pytest.raises(pf.SceneError, match="cannot be solved: .*sag: the scene has none"):
        pf.design(weightless, "mass", {THICKNESS: (1e-3, 3e-3)}, ["sag < 1e-3"])


@pytest.mark.parametrize("material", ["aluminum", "{like: aluminium}", "{like: steel, E: 7.0e10}"])
def test_a_named_material_has_every_number(material):
    robot = pf.load("ur5", [f"flexible.*.material={material}"])
    _, (E,) = parameters(robot.description, ["flexible.forearm_link.material.E"])
    assert E.value == 7.0e10
    stiffer = parameters(robot.description, ["flexible.forearm_link.material.E"])[0]
    made = pf.load(stiffer.with_overrides(E.overrides(8.0e10))).description.flexible[-1].material
    assert pytest.approx((8.0e10, 8.0e10 / 2.6)) == (made.E, made.G)
