"""Relative sensitivities: closed forms, and implicit derivatives against differences of designs.

Claims:
    Derivatives, designs, scatter, fits
    - cantilever: frequencies go with thickness^1, width^0, E^1/2, rho^-1/2, length^-2 | closed form
      | 1e-8 | passes
    - implicit derivatives of six frequencies = differences of designs solved anew: 3rrs, 3rrr
      (three of one frequency), ur5, delta | extrapolated differences | 1e-5 | passes
    - a repeated frequency splits: of three equal rods one stiffer, one frequency moves | symmetry;
      differences of 5 % | 1e-3; 2.5e-3 | passes
    - sag, stiffness and mass of a cantilever by thickness and E | closed form | 1e-5 | passes
    - the rms torque of a quasistatic run | differences of runs | 1e-3 | passes
"""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import pinflex as pf
from pinflex.__main__ import main
from pinflex.description.reading.parameters import parameters
from pinflex.variation import sensitivity as module
from pinflex.variation.evaluator import measure
from pinflex.variation.peaks import extrapolated, of_frequencies
from pinflex.variation.variants import variants
from tests.scenes import Body, load

# Differences at a held state are good to 1e-9 (round-off over the step); 1e-8 leaves a digit.
IMPLICIT = 1e-8
# Frequencies of designs solved anew carry the 1e-9 at which Newton stops, over a step of 5e-3.
SOLVED = 1e-5


def test_a_cantilever_has_the_exponents_of_its_formula():
    # f ~ sqrt(E I / (rho A L^4)): thickness 1, width 0, E 1/2, rho -1/2, length -2 with its mass
    robot = pf.load("cantilever", ["gravity=[0, 0, 0]", "flexible.beam.length=1"])
    keys = {"section.thickness": 1, "section.width": 0, "material.E": 0.5, "material.rho": -0.5,
            "length": -2}  # fmt: skip
    by = [f"flexible.beam.{key}" for key in keys]
    found = pf.sensitivities(robot, by=by, of=["frequency.1", "frequency.3"])
    np.testing.assert_allclose(found.table, [[n, n] for n in keys.values()], atol=IMPLICIT)
    assert np.all(found.error < IMPLICIT)


@pytest.mark.parametrize(
    "model, key",
    [
        ("3rrs", "flexible.*.section.thickness"),  # near buckling, closed loops
        ("3rrr", "flexible.*.section.thickness"),  # frequencies repeated three times
        ("ur5", "flexible.upper_arm_link.section.diameter"),
        ("delta", "flexible.rod_??.section.diameter"),
    ],
)
def test_implicit_derivatives_are_those_of_designs_solved_anew(model, key):
    designs = variants(pf.load(model), [key])
    (parameter,) = designs.parameters

    def at(h):
        return designs.scaled(parameter, h)

    _, slopes, _ = of_frequencies(designs.base, at, 6)
    names = [f"frequency.{k}" for k in range(1, 7)]
    expected, _ = extrapolated(lambda h: measure(at(h), names))
    np.testing.assert_allclose(slopes, [expected[name] for name in names], atol=SOLVED)


def test_a_repeated_frequency_splits_by_its_subspace():
    # one of three equal rods stiffer: of three frequencies (103.363 twice, 103.368 Hz) one moves
    designs = variants(pf.load("3rrr"), ["flexible.distal_1.material.E"])
    (parameter,) = designs.parameters
    _, slopes, _ = of_frequencies(designs.base, lambda h: designs.scaled(parameter, h), 3)
    below, above = (pf.modes(designs.scaled(parameter, h)).frequencies[:3] for h in (-0.05, 0.05))
    assert abs(slopes[0]) < 1e-3 and slopes[1] > 0.3  # one of the pair moves, not both by halves
    # sorted frequencies cross where they are equal, but their sum is smooth: the step squared
    assert np.sum(slopes) == pytest.approx(np.sum(np.log(above / below)) / 0.1, abs=2.5e-3)


def test_static_outputs_and_mass():
    # tip under its own weight, small: w ~ rho A g L^4 / (E I), mass ~ rho A
    robot = pf.load("cantilever", ["flexible.beam.section.thickness=0.02"])
    by = ["flexible.*.section.thickness", "flexible.*.material.E"]
    found = pf.sensitivities(robot, by=by, of=["mass", "sag", "stiffness.z"])
    base = robot.flexible.expansion.model
    share = robot.parts["beam"].mass / sum(i.mass for i in base.inertias)
    # a deflection of 1e-4 of the length changes the exponents by its square
    np.testing.assert_allclose(found.table[0], [share, -2, 3], atol=1e-5)
    np.testing.assert_allclose(found.table[1], [0, -1, 1], atol=1e-5)


def test_a_lighter_section_makes_a_lighter_link_that_keeps_its_fittings():
    robot = pf.load("ur5")
    designs = variants(robot, ["flexible.upper_arm_link.section.wall"])
    (wall,) = designs.parameters
    thin = designs.at({wall.key: 0.5 * wall.value})
    part, before = thin.parts["upper_arm_link"], robot.parts["upper_arm_link"]
    rest = sum(r.inertia.mass for r in part.riders)
    assert rest == pytest.approx(sum(r.inertia.mass for r in before.riders), rel=1e-12)
    # area of a thin tube: pi t (d - t)
    d, t = 0.1, wall.value
    assert part.mass / before.mass == pytest.approx(0.5 * (d - 0.5 * t) / (d - t), rel=1e-9)
    # and at its own values it is the robot itself
    same = designs.at({wall.key: wall.value})
    q = np.linspace(0.1, 0.6, 6)
    torque = [pf.inverse_dynamics(m, q[None], q[None], q[None]) for m in (robot, same)]
    np.testing.assert_allclose(torque[0], torque[1], rtol=1e-12)


def test_peaks_of_a_run_against_the_same_designs_in_short_steps():
    # 1e-3 is asked; steps of the run and of the differences are both quartered in the reference
    robot = pf.load("3rrr", ["solve.until=0.1", "motion.duration=0.1"])
    key = "flexible.*.section.thickness"
    found = pf.sensitivities(robot, by=[key], of=["torque.rms"], level="quasistatic")
    designs = variants(robot, [key])
    (parameter,) = designs.parameters
    values = [
        measure(designs.scaled(parameter, h), ["torque.rms"], "quasistatic")["torque.rms"]
        for h in (-2.5e-3, 2.5e-3)
    ]
    assert found["torque.rms", "flexible.distal_?.section.thickness"] == pytest.approx(
        np.log(values[1] / values[0]) / 5e-3, abs=1e-3
    )
    assert found.remarks == ()


def test_a_scene_that_keeps_no_given_steps_is_told_with_what_its_errors_leave_out(monkeypatch):
    def none(*_):
        raise pf.ConvergenceError("a given step cannot be solved")

    monkeypatch.setattr(module, "Peaks", none)
    robot = pf.load("cantilever", ["solve={level: coupled, dt: 1e-4, until: 2e-3}"])
    found = pf.sensitivities(robot, ["flexible.beam.section.thickness"], ["stress.peak", "mass"])
    assert "stress.peak: this scene does not keep to given steps" in found.remarks[0]
    assert "quarter of solve.dt" in found.text()
    assert found.as_json()["remarks"] == list(found.remarks)


def test_keys_keep_the_blocks_of_the_yaml_and_refuse_what_is_no_number():
    description = pf.load("delta").description
    _, found = parameters(description, ["flexible.*.section.diameter", "flexible.arm_1.material.E"])
    assert [p.key for p in found] == [
        "flexible.arm_?.section.diameter", "flexible.rod_??.section.diameter",
        "flexible.arm_1.material.E",
    ]  # fmt: skip
    assert len(found[1].paths) == 6 and found[2].value == 6.89e10
    (part,) = parameters(description, ["flexible.rod_1?.section.wall"])[1]  # of a block of six
    assert parameters(description, [part.key])[1] == (part,)  # a key is a pattern of itself
    # an override of all links of a block leaves it one, of some of them parts it
    changed = pf.load("delta", ["flexible.*.shear=true", "flexible.rod_1?.section.wall=1e-3"])
    _, found = parameters(changed.description, ["flexible.*.section.wall"])
    assert [p.key for p in found] == [
        "flexible.arm_?.section.wall", "flexible.rod_1a, rod_1b.section.wall",
        "flexible.rod_2a, rod_2b, rod_3a, rod_3b.section.wall",
    ]  # fmt: skip
    assert [p.value for p in found] == [2.5e-3, 1e-3, 1.5e-3]
    for key, said in (
        ("flexible.arm_?.section.diametre", 'Did you mean "diameter"'),
        ("flexible.arm_?.section.shape", "no number there"),
        ("flexibel.x", 'Did you mean "flexible"'),
    ):
        with pytest.raises(pf.DescriptionError, match=said):
            parameters(description, [key])


def test_the_command_prints_a_table_and_draws_it(tmp_path, capsys):
    chart = tmp_path / "tornado.png"
    options = ["--by", "flexible.*.section.*", "--of", "frequency.1", "--of", "mass"]
    assert main(["sensitivity", "ur5", *options, "--plot", str(chart)]) == 0
    text = capsys.readouterr().out
    assert "answers most to flexible.upper_arm_link.section.diameter: 1 % more gives +0.81" in text
    assert chart.stat().st_size > 10_000
    assert main(["sensitivity", "ur5", *options, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["sensitivities"]) == 4 and found["units"]["mass"] == "kg"
    assert main(["sensitivity", "ur5", "--of", "frequenzy.1"]) == 2
    assert 'Did you mean "frequency.1"' in capsys.readouterr().err


def test_numbers_with_units_are_parameters():
    sizes = ["flexible.beam.section.width=20 mm", "flexible.beam.section.thickness=2 mm"]
    robot = pf.load("cantilever", sizes)
    found, plain = (pf.sensitivities(r, of=["mass"]) for r in (robot, pf.load("cantilever")))
    np.testing.assert_array_equal(found.table, plain.table)
    _, (width,) = parameters(robot.description, ["flexible.*.section.width"])
    assert width.value == 0.02


def test_outputs_of_motors_have_the_unit_of_each_motor(tmp_path):
    # a carriage is pushed [N] and carries an arm that is turned [N m]
    bodies = (
        Body("carriage", "base", "prismatic", axis=(1, 0, 0), mass=2.0, inertia=(1, 1, 1)),
        Body("arm", "carriage", "revolute", mass=0.3, inertia=(1e-3, 1e-2, 1e-2)),
        Body("tip", "arm", xyz=(0.4, 0, 0)),
    )
    yaml = """
actuated: [carriage_joint, arm_joint]
platform: tip
motion: {kind: quintic, joints: {carriage_joint: 0.1, arm_joint: 0.5}, duration: 0.4}
flexible: {arm: {material: steel, section: {shape: rectangle, width: 0.02, thickness: 0.004},
                 end: tip}}
"""
    robot = load(tmp_path, bodies, yaml)
    names = ("torque.peak", "torque.rms.carriage_joint", "torque.peak.arm_joint", "mass")
    found = pf.sensitivities(robot, ["flexible.*.material.rho"], names, level="rigid")
    assert dict(found.units) == dict(zip(names, ("N | N m", "N", "N m", "kg"), strict=True))
    assert "torque.rms.carriage_joint (" in (text := found.text())
    assert re.search(r"torque.rms.carriage_joint \([^ ]+ N\) answers", text)
    assert re.search(r"torque.peak.arm_joint \([^ ]+ N m\) answers", text)
    assert found.as_json()["units"]["torque.peak"] == "N | N m"
    scattered = pf.scatter(robot, 24, normal={"flexible.*.material.rho": "5 %"}, level="rigid",
                           outputs=["torque"])  # fmt: skip
    assert scattered.table.units["torque.peak.carriage_joint"] == "N"
    assert re.search(r"torque.peak.carriage_joint +N +\d", scattered.text())
