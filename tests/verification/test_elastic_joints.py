"""Passive joints with a spring: held at rest by level rigid, elastic at every other.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - shares of springs in the energy of a mode | k x^2 of the eigenvectors | 1e-9 | passes
    - elastic joint: angle under gravity, frequency with and without preload, sag, holding torque |
      closed form | 1e-12, 1e-10 | passes
    - elastic joint: every level tends to rigid like 1/k (k^-1/2 where the jerk jumps); rigid = rnea
      | limit; Pinocchio | slope +- 0.1; 1e-12 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

import pinflex as pf
from pinflex.lab.scene import urdf
from pinflex.studies.checking.check import check
from tests.finite import slope
from tests.scenes import Body, load

# A motor, a gear behind it and a link of mass M at L with the inertia J_C about its centre.
M, L, J_C, K, G = 2.0, 0.5, 0.03, 400.0, 9.81
GEARED = (
    Body("rotor", "base", "revolute", axis=(0, 1, 0)),
    Body("arm", "rotor", "revolute", axis=(0, 1, 0), mass=M, com=(L, 0, 0), inertia=(0, J_C, 0)),
    Body("tip", "arm", xyz=(L, 0, 0)),
)


def yaml(k: float = K, more: str = "") -> str:
    return f"""
actuated: [rotor_joint]
joints: {{rotor_joint: {{rotor_inertia: 0.1}}, arm_joint: {{spring: {k!r}}}}}
platform: tip
{more}
"""


def test_the_angle_under_gravity_and_the_frequency_are_the_closed_forms(tmp_path: Path) -> None:
    m = load(tmp_path, GEARED, yaml())
    assert m.elastic_joints == ("arm_joint",)
    assert m.report.mobility == 1
    # About +y a positive angle lowers the arm: k a = m g l cos(a).
    angle = brentq(lambda a: K * a - M * G * L * np.cos(a), 0.0, 1.0, xtol=1e-15)
    rest = pf.static_equilibrium(m)
    assert rest.y[1] == pytest.approx(angle, abs=1e-12)
    assert rest.r[0] == pytest.approx(-K * angle, rel=1e-12)  # the motor holds the spring's torque
    J = J_C + M * L**2
    stiff = K + M * G * L * np.sin(angle)
    for preload, k in (("none", K), ("gravity", stiff)):
        found = pf.modes(m, preload=preload)
        assert found.frequencies[0] == pytest.approx(np.sqrt(k / J) / (2 * np.pi), rel=1e-10)
        assert found.links == ("arm_joint",)
        assert found.share[0, 0] == 1.0


def test_check_shows_sag_and_holding_torque(tmp_path: Path) -> None:
    found = check(load(tmp_path, GEARED, yaml()))
    assert found.statics.linear is not None
    # A whole turn of the spring's a = m g l / k at the lever l, straight down.
    assert found.statics.linear.position[2] == pytest.approx(-M * G * L / K * L, rel=1e-12)
    assert found.statics.holding_rigid == pytest.approx((-M * G * L,), rel=1e-12)
    text = str(found)
    assert "mobility  1 = 2 joint coordinates - 1 elastic joint" in text
    assert "; joints arm_joint" in text


MOVE = pf.cycloid(joints={"rotor_joint": 0.8}, duration=0.3)


def test_every_level_runs_and_tends_to_the_rigid_one_as_springs_stiffen(tmp_path: Path) -> None:
    """Rigid is Pinocchio's rnea with the gear at rest; the deviation falls like 1/k.

    A cycloid's jerk jumps, which rings with jerk/omega in the torque: like k^-1/2.
    """
    slopes = {"quasistatic": -1.0, "ked": -0.5, "coupled": -0.5}
    stiffness, apart = (1e4, 1e5, 1e6), {level: list[float]() for level in slopes}
    for k in stiffness:
        m = load(tmp_path, GEARED, yaml(k))
        rigid = pf.solve(m, MOVE, level="rigid", samples=61)
        for level, found in apart.items():
            step = {} if level == "quasistatic" else {"dt": 2e-4}
            r = pf.solve(m, MOVE, level=level, samples=61, **step)
            found.append(float(np.abs(r.torque - rigid.torque).max()))
    model = m.rigid.rigid
    q, v, a = (rigid.arrays[f"joint/{x}"] for x in "qva")
    tau = [pin.rnea(model, model.createData(), *state)[0] for state in zip(q, v, a, strict=True)]
    np.testing.assert_allclose(rigid.torque[:, 0], tau, rtol=0, atol=1e-12)
    assert not np.any(q[:, 1])
    for level, found in apart.items():
        assert slope(stiffness, found) == pytest.approx(slopes[level], abs=0.1)


def test_levels_agree_where_they_should(tmp_path: Path) -> None:
    """Small angles: ked is coupled to second order; the run rings at the frequency of the gear."""
    m = load(tmp_path, GEARED, yaml(4e4))
    ked, coupled = (
        pf.solve(m, MOVE, level=level, samples=201, until=0.5, dt=2e-4)
        for level in ("ked", "coupled")
    )
    scale = np.abs(coupled.joint("arm_joint").position).max()
    apart = ked.joint("arm_joint").position - coupled.joint("arm_joint").position
    assert np.abs(apart).max() < 5e-3 * scale  # the largest angle is 5e-3 rad
    assert coupled.meta["energy_balance"] < 1e-3


def test_compare_takes_a_robot_whose_joints_are_all_that_gives_way(tmp_path: Path) -> None:
    head = "motion: {kind: cycloid, joints: {rotor_joint: 0.8}, duration: 0.3}\n"
    m = load(tmp_path, GEARED, yaml(4e4, head))
    done = pf.compare(m, levels=("quasistatic", "coupled"))
    assert set(done.flexible) == {"quasistatic", "coupled"}
    apart = done.runs["coupled"].deviation_from(done.runs["rigid"], "tip")
    # The gear's largest angle at the lever of the tip.
    turned = done.runs["coupled"].joint("arm_joint").position
    assert np.linalg.norm(apart.position, axis=1).max() == pytest.approx(
        L * np.abs(turned).max(), rel=1e-4
    )


def test_rest_is_where_the_rigid_level_holds_it_unless_home_says_otherwise(tmp_path: Path) -> None:
    text = yaml().replace("spring: 400.0", "spring: 400.0, rest: 0.2")
    assert load(tmp_path, GEARED, text).home[1] == 0.2
    assert load(tmp_path, GEARED, text + "home: {arm_joint: 0.3}\n").home[1] == 0.3


def test_a_sprung_joint_that_the_loop_moves_is_not_an_elastic_one(tmp_path: Path) -> None:
    bodies = (
        Body("crank", "base", "revolute", mass=1.0, com=(0.1, 0, 0), inertia=(1e-3,) * 3),
        Body("rod", "crank", "revolute", (0.2, 0, 0), mass=1.0, inertia=(1e-3,) * 3),
        Body("rod_end", "rod", xyz=(0.5, 0, 0)),
        Body("rocker", "base", "revolute", (0.5, 0, 0), mass=1.0, inertia=(1e-3,) * 3),
        Body("rocker_end", "rocker", xyz=(0, 0.4, 0)),
    )
    text = """
actuated: [crank_joint]
joints: {rocker_joint: {spring: 5.0}}
loops: {pin: {kind: planar, between: [rod_end, rocker_end]}}
home: {crank_joint: 1.5}
"""
    m = load(tmp_path, bodies, text)
    assert m.elastic_joints == ()
    assert m.report.mobility == 1
    assert not m.compliant


def test_a_spring_on_a_motor_says_what_to_write(tmp_path: Path) -> None:
    beside = "actuated: [rotor_joint]\njoints: {rotor_joint: {%s: 50.0, rest: 0.1}, %s}\n"
    gear = "arm_joint: {spring: 400.0}"
    with pytest.raises(pf.DescriptionError, match="this joint has a motor.*`parallel_spring`"):
        load(tmp_path, GEARED, beside % ("spring", gear))
    with pytest.raises(pf.DescriptionError, match="beside `spring`"):
        load(tmp_path, GEARED, yaml().replace("spring:", "parallel_spring: 1, spring:"))
    # In an open chain that lists no motors every joint has one.
    with pytest.raises(pf.DescriptionError, match="this joint has a motor"):
        load(tmp_path, GEARED, "joints: {arm_joint: {spring: 400.0}}\n")
    # And the key that acts beside it does what `spring` did: the motor carries k (q - rest).
    plain = load(tmp_path, GEARED, yaml())
    m = load(tmp_path, GEARED, beside % ("parallel_spring", gear))
    extra = pf.static_equilibrium(m).r[0] - pf.static_equilibrium(plain).r[0]
    assert extra == pytest.approx(50.0 * (0.0 - 0.1), rel=1e-12)
    # In a joint without a motor there is nothing that it could be taken for but `spring`.
    other = load(tmp_path, GEARED, yaml().replace("spring:", "parallel_spring:"))
    np.testing.assert_array_equal(
        pf.modes(other, count=2).frequencies, pf.modes(plain, count=2).frequencies
    )


def test_a_rigid_robot_is_warned_of_its_effort_limits_too(tmp_path: Path) -> None:
    text = urdf(GEARED[1:2]).replace('parent link="rotor"', 'parent link="base"')
    (tmp_path / "one.urdf").write_text(text.replace('effort="1e9"', 'effort="5"'))
    (tmp_path / "one.yaml").write_text("urdf: one.urdf\n")
    m = pf.load(tmp_path / "one.yaml")
    assert not m.compliant
    assert any("holding needs 9.81 N m, more than the URDF" in w for w in check(m).warnings)


def test_springs_share_the_energy_of_a_mode_by_stiffness_and_square(tmp_path: Path) -> None:
    """Two sliders on each other: shares k_i x_i^2 / sum of the eigenvectors by hand."""
    k, masses = (300.0, 50.0), (1.0, 2.0)
    bodies = [
        Body("one", "base", "prismatic", axis=(1, 0, 0), mass=masses[0]),
        Body("two", "one", "prismatic", axis=(1, 0, 0), mass=masses[1]),
    ]
    m = load(tmp_path, bodies, "gravity: [0, 0, 0]\nactuated: []\njoints: {one_joint: "
             f"{{spring: {k[0]}}}, two_joint: {{spring: {k[1]}}}}}\n")  # fmt: skip
    _, x = eigh(np.diag(k), np.array([[sum(masses), masses[1]], [masses[1]] * 2]))
    energy = np.array(k) * x.T**2
    found = pf.modes(m)
    assert found.links == ("one_joint", "two_joint")
    expected = energy / energy.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(found.share, expected, rtol=1e-9)
