"""A link's inertia between its beam and what rides on it: nothing lost, as much as fits.

Claims:
    Equations
    - one flexible link, YAML of a newcomer: rigid torques are Pinocchio's rnea (ur5, panda, kinova;
      68 robots: `benchmarks/robots.py`) | Pinocchio | 1e-12 | 2e-16; 3.5e-16
    - beam and riders are the link: mass, centre, moments, on 40 random links and beams, 1 to 3
      segments | random mass points | 1e-12 | passes
    - no more of the beam fits: with 1e-6 more, the pseudo-inertia left over is indefinite |
      Wensing, Kim, Slotine 2018 | 1e-6 | passes
    - two motors at the ends of a tube come back, by the lever rule | by construction | 1e-9 |
      passes
    - a ball on a tube, from the sum of their inertias: sag of the tip | m g a^2 (3 L - a) / 6 EI +
      w L^4 / 8 EI | 1e-3 | passes
    - balanced torques of a flexible arm tend to rnea of the URDF like 1/E | Pinocchio | +- 0.02 |
      1.00
    - a thin wide panel as its drawing weighs it twists as with `inertia: beam`: (2 k - 1) / 4 L
      sqrt(G J / rho Ip) | Saint-Venant | 0.5 % of the first with one mode of twist, 0.01 % with
      three | 0.38 %; 0.00
    - the cut at the root of a stubby bar that is turned has the moment I times acceleration, about
      its span and across | closed form | 1e-4 | passes
    - mass matrix of the flexible model = crba of the URDF, 1 and 2 segments | Pinocchio | 1e-12 |
      passes
    - a beam beside the load path (PR2's upper arm; its forearm, which carries a camera) is refused,
      the right link named | - | - | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.bodies.basis import flexible_body
from pinflex.description.blocks.flexible import Basis, EndMass, FlexibleLink
from pinflex.description.blocks.material import named
from pinflex.description.description import read
from pinflex.description.section import from_spec
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.model import tree
from pinflex.recovery.validity import first_frequency
from pinflex.studies.checking.check import check
from tests.finite import slope
from tests.scenes import Body, load

JOINTS = ("link_joint", "hand_joint")
MOTION = ("position", "velocity", "acceleration")
SEEDS = range(40)
ROUNDING = 1e-12  # of the largest entry
TUBE = {"shape": "tube", "diameter": 0.05, "wall": 0.003}


def spec(**changes: object) -> FlexibleLink:
    return FlexibleLink("link", named("aluminium"), from_spec(TUBE), **changes)  # type: ignore[arg-type]


def cloud(rng: np.random.Generator, length: float, mass: float) -> pin.Inertia:
    """Inertia of random mass points along and around a span: physical by construction."""
    total = np.zeros((6, 6))
    for m in mass * rng.dirichlet(np.ones(12)):
        place = rng.uniform(-0.1, 1.1, 3) * [length, 0.1, 0.1]
        total += pin.Inertia(float(m), place, 1e-4 * float(m) * np.eye(3)).matrix()
    return inertia_of(total)


def inertia_of(spatial: Array) -> pin.Inertia:
    h = np.array([spatial[5, 1], spatial[3, 2], spatial[4, 0]])
    I = spatial[3:, 3:]  # noqa: E741
    upper = I[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return pin.Inertia.FromDynamicParameters(np.concatenate([[spatial[0, 0]], h, upper]))


def lowest(A: Array) -> float:
    return float(np.linalg.eigvalsh(A)[0])


@pytest.mark.parametrize("seed", SEEDS)
def test_beam_and_riders_are_the_link_and_the_beam_is_all_that_fits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    length, segments = float(rng.uniform(0.2, 1.0)), int(rng.integers(1, 4))
    link = spec(rotary_inertia=bool(seed % 2), segments=segments)
    bodies = (flexible_body(link, ("v", "w", "p"), length / segments),) * segments
    beam = sum(body.mass.sum() for body in bodies)
    urdf = cloud(rng, length, beam * float(rng.uniform(0.3, 4.0)))
    found = tree.split(urdf, bodies, length)
    points, turns = tree.travelling(bodies), tree.turning(bodies)
    # the spatial inertia of the stations, by Pinocchio, one by one
    for k in range(segments):
        for x, m in zip(bodies[k].x, bodies[k].mass, strict=True):
            at = np.array([x + k * length / segments, 0.0, 0.0])
            points = points - pin.Inertia(float(m), at, np.zeros((3, 3))).matrix()
    assert np.abs(points).max() < ROUNDING * beam
    points = tree.travelling(bodies)
    total = found.share * points + np.diag([0.0] * 3 + list(found.turning)) @ turns
    for rider in found.riders:
        place = pin.SE3(np.eye(3), np.array([rider.x, 0.0, 0.0]))
        total = total + place.act(rider.inertia).matrix()
        # kinetic energy of what rides is never negative
        assert lowest(rider.inertia.matrix()) > -ROUNDING * np.abs(urdf.matrix()).max()
        assert 0.0 <= rider.x <= length
    whole = urdf.matrix()
    assert np.abs(total - whole).max() < ROUNDING * np.abs(whole).max()
    # no more fits: with 1e-6 more, no mass distribution has what is left
    assert 0.0 < min(found.turning) <= max(found.turning) <= found.share <= 1.0
    size = np.diag([1 / length] * 3 + [1.0])
    left = size @ tree.pseudo(whole - found.share * points) @ size
    assert lowest(left) > -ROUNDING * urdf.mass
    if found.share < 1:
        more = size @ tree.pseudo(whole - (found.share + 1e-6) * points) @ size
        assert lowest(more) < 0


def test_two_motors_ride_at_the_ends_by_the_lever_rule() -> None:
    """A tube with 2 kg around its root and 1 kg at its tip gets them back."""
    bodies = (flexible_body(spec(), ("v", "w", "p"), 0.5),)
    motor = pin.Inertia(2.0, np.zeros(3), np.diag([4e-3, 3e-3, 2e-3]))
    whole = tree.travelling(bodies) + tree.turning(bodies) + motor.matrix()
    whole = whole + pin.Inertia(1.0, np.array([0.5, 0, 0]), np.zeros((3, 3))).matrix()
    found = tree.split(inertia_of(whole), bodies, 0.5)
    assert (found.share, *found.turning) == pytest.approx((1.0,) * 4, abs=1e-9)
    tip, root = found.riders
    assert (tip.x, tip.inertia.mass) == pytest.approx((0.5, 1.0), rel=1e-9)
    assert root.x == 0.0
    np.testing.assert_allclose(root.inertia.matrix(), motor.matrix(), atol=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_what_only_turns_rides_in_the_middle_whatever_round_off_makes_of_its_mass(
    seed: int,
) -> None:
    """A rod that weighs less than its beam, with a ring about its middle: no mass is left over.

    Round-off of 1e-11 of the mass put the ring 3e-6 to 1e-5 m beside, at each wall elsewhere.
    """
    rng = np.random.default_rng(seed)
    bodies = (flexible_body(spec(), ("v", "w", "p"), 0.5),)
    share = float(rng.uniform(0.5, 0.95))
    whole = share * tree.travelling(bodies)
    whole[3:, 3:] += np.diag([4e-3, 2e-3, 2e-3]) * whole[0, 0]
    found = tree.split(inertia_of(whole), bodies, 0.5)
    assert found.share == pytest.approx(share, rel=1e-9)
    (ring,) = found.riders
    # the middle to round-off of its own, not of what the mass left is divided by
    assert ring.x == pytest.approx(0.25, rel=1e-14)
    assert np.all(ring.inertia.lever == 0.0)


def test_moments_that_no_body_has_keep_their_kinetic_energy() -> None:
    """Estimated moments may break the triangle inequality: Izz > Ixx + Iyy."""
    bodies = (flexible_body(spec(), ("v", "w", "p"), 0.5),)
    urdf = pin.Inertia(2.0, np.array([0.25, 0.0, 0.0]), np.diag([0.02, 0.03, 0.06]))
    assert lowest(tree.pseudo(urdf.matrix())) < 0
    found = tree.split(urdf, bodies, 0.5)
    assert found.share == pytest.approx(1.0)
    for rider in found.riders:
        assert lowest(rider.inertia.matrix()) > -ROUNDING


def test_stations_give_the_mass_and_damping_matrix_of_the_beam() -> None:
    """M and D from the stations and riders are those of the integrals with end masses."""
    tip, damp = EndMass(0.3, (1e-3, 2e-3, 3e-3)), {"rayleigh": (0.1, 1e-4), "modal_damping": 0.02}
    for basis in (Basis(), Basis("assumed", boundary="free_free"), Basis("finite_element")):
        for rotary in (False, True):
            link = spec(basis=basis, rotary_inertia=rotary, root=tip, tip=tip, **damp)
            body = flexible_body(link, ("u", "v", "w", "p"), 0.5)
            whole = tree.Split(1.0, (1.0,) * 3, ())
            found = tree.weighed(body, link, whole, tree.end_riders(link, 0.5))
            # 1e-9: integrals over sine modes, twice by quadrature
            np.testing.assert_allclose(found.M, body.M, atol=1e-9 * np.abs(body.M).max())
            np.testing.assert_allclose(found.D, body.D, atol=1e-9 * np.abs(body.D).max())


def arm_bodies(link: Body | None = None) -> tuple[Body, Body]:
    link = link or Body("link", "base", "revolute", axis=(0, 1, 0), mass=2.0, com=(0.3, 0.01, 0.02),
                        inertia=(4e-3, 3.1e-2, 3e-2))  # fmt: skip
    hand = Body("hand", "link", "revolute", xyz=(0.5, 0, 0), mass=0.5, com=(0.05, 0, 0),
                inertia=(1e-3, 1e-3, 1e-3))  # fmt: skip
    return link, hand


def arm(folder: Path, *, inertia: str = "urdf", link: Body | None = None, more: str = "",
        overrides: tuple[str, ...] = ()) -> pf.Mechanism:  # fmt: skip
    """A tube on a motor, with a hand of 0.5 kg on a second motor at 0.5 m."""
    yaml = f"""
platform: hand
flexible:
  link:
    material: aluminium
    section: {{shape: tube, diameter: 0.05, wall: 0.003}}
    {more}
"""
    return load(folder, arm_bodies(link), yaml, overrides, inertia)


def torque_difference(m: pf.Mechanism, seed: int = 3) -> float:
    """Rigid torques against pin.rnea of the URDF alone, of the largest."""
    model = pin.buildModelFromXML(m.description.urdf_text)
    model.gravity.linear = np.array(m.description.gravity)
    data, rng = model.createData(), np.random.default_rng(seed)
    names = list(model.names)[1:]
    assert names == list(m.rigid.rigid.names)[1:]
    q = [pin.integrate(model, pin.neutral(model), x) for x in rng.uniform(-1, 1, (10, model.nv))]
    v, a = rng.uniform(-2, 2, (2, 10, model.nv))
    expected = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
    found = pf.inverse_dynamics(m, np.array(q), v, a)
    return float(np.abs(found - expected).max() / np.abs(expected).max())


@pytest.mark.parametrize(
    ("name", "link"),
    [("ur5", "upper_arm_link"), ("panda", "panda_link4"), ("kinova", "j2s6s200_link_2")],
)
def test_the_rigid_torques_of_a_flexible_robot_are_those_of_its_urdf(
    name: str, link: str, tmp_path: Path
) -> None:
    """Three of the robots of tests/benchmarks/robots.py, with the YAML of a newcomer."""
    path = tmp_path / "robot.yaml"
    path.write_text(
        f"urdf: example-robot-data:{name}\nuse_urdf_dynamics: false\nflexible:\n  {link}:\n"
        "    material: aluminium\n    section: {shape: tube, diameter: 0.04, wall: 0.004}\n"
    )
    assert torque_difference(pf.load(path)) < 1e-12


def test_the_flexible_model_has_the_urdfs_inertia_and_tends_to_its_torques(tmp_path: Path) -> None:
    factors, off = (1.0, 10.0, 100.0), []
    motion = pf.cycloid(joints={"link_joint": 0.4, "hand_joint": -0.3}, duration=0.5)
    for segments in (1, 2):
        m = arm(tmp_path, more=f"segments: {segments}")
        model = pin.buildModelFromXML(m.description.urdf_text)
        M = pin.crba(model, model.createData(), pin.neutral(model))
        ours = Equations(m.flexible).mass(m.undeformed())[:2, :2]
        np.testing.assert_allclose(ours, M, atol=ROUNDING)
    model.gravity.linear = np.array([0, 0, -9.81])
    data = model.createData()
    for factor in factors:
        m = arm(tmp_path, overrides=(f"flexible.link.material={{E: {7e10 * factor}, nu: 0.3, "
                                     "rho: 2700}",))  # fmt: skip
        run = pf.solve(m, motion, level="quasistatic", samples=11)
        q, v, a = (np.column_stack([getattr(run.joint(j), x) for j in JOINTS]) for x in MOTION)
        rows = [pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)]
        off.append(np.abs(run.torque - rows).max())
    assert slope(factors, off) == pytest.approx(-1.0, abs=0.02)
    assert off[-1] < 1e-5 * 12  # [N m] of 12


def test_what_rides_in_the_middle_bends_the_beam_as_statics_says(tmp_path: Path) -> None:
    """A tube with a heavy ball on it: m g a^2 (3 L - a) / 6 EI and rho A g L^4 / 8 EI."""
    L, a, m, g = 0.5, 0.3, 5.0, 9.81
    section = from_spec(TUBE)
    beam = 2700 * section.A * L
    mass, com = beam + m, (beam * L / 2 + m * a) / (beam + m)
    ball, twist = 0.4 * m * 0.01**2, 2700 * section.Ip * L
    across = ball + twist / 2 + beam * L**2 / 3 + m * a**2 - mass * com**2
    link = Body("link", "base", "revolute", axis=(0, 1, 0), mass=mass, com=(com, 0, 0),
                inertia=(ball + twist, across, across))  # fmt: skip
    text = """
flexible:
  link: {material: aluminium, section: {shape: tube, diameter: 0.05, wall: 0.003}, end: hand}
"""
    robot = load(tmp_path, (link, Body("hand", "link", xyz=(L, 0, 0))), text, inertia="urdf")
    (rider,) = robot.parts["link"].riders
    assert (rider.x, rider.inertia.mass) == pytest.approx((a, m), rel=1e-6)
    y = pf.linear_statics(robot).y
    slot = robot.flexible.expansion.slots[0]
    sag = slot.body.rows(L)[0][:3] @ y[slot.eta.start + robot.rigid.nq :]
    EI = 7e10 * section.Iy
    expected = m * g * a**2 * (3 * L - a) / (6 * EI) + beam * g * L**3 / (8 * EI)
    # 1e-3: a kink at the ball, from smooth shapes with two internal modes
    assert np.linalg.norm(sag) == pytest.approx(expected, rel=1e-3)


def test_the_first_frequency_of_a_link_is_that_with_what_rides_on_it(tmp_path: Path) -> None:
    """A tip mass M on a beam without mass: 3 EI / M L^3 (Rayleigh's 33/140 of the beam added)."""
    section, L = from_spec(TUBE), 0.5
    beam, M = 2700 * section.A * L, 20.0
    com, twist = M * L / (beam + M) + beam * L / 2 / (beam + M), 2700 * section.Ip * L
    across = M * L**2 + beam * L**2 / 3 - (beam + M) * com**2 + 1e-3 + twist
    link = Body("link", "base", "revolute", axis=(0, 1, 0), mass=beam + M, com=(com, 0, 0),
                inertia=(1e-3 + twist, across, across))  # fmt: skip
    part = arm(tmp_path, link=link).parts["link"]
    expected = np.sqrt(3 * 7e10 * section.Iy / (L**3 * (M + 33 / 140 * beam)))
    # 1 %: the ball of 1e-3 kg m^2 turns with the tip too
    assert first_frequency(part) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(("internal", "near"), [(2, 5e-3), (4, 1e-4)])
def test_a_panel_with_the_moments_of_its_drawing_twists_along_its_whole_span(
    internal: int, near: float, tmp_path: Path
) -> None:
    """Six digits of a drawing leave nothing across the panel, but all of what twists.

    The twist shared one factor with the rotary inertia across, of which nothing was left: its
    inertia sat in the middle, and the first torsion was 7.871 Hz, with four modes 7.636.
    """
    L, a, b, rho, E = 4.0, 1.0, 0.01, 625.0, 7e10
    m = rho * a * b * L
    panel = Body("link", "base", "revolute", axis=(1, 0, 0), mass=m, com=(L / 2, 0, 0),
                 inertia=(round(m * a**2 / 12, 6), round(m * L**2 / 12, 6),
                          round(m * (a**2 + L**2) / 12, 6)))  # fmt: skip
    yaml = f"""
gravity: [0, 0, 0]
flexible:
  link: {{material: {{E: {E}, nu: 0.3, rho: {rho}}}, end: hand, up: y,
    basis: {{internal: {internal}}}, section: {{shape: rectangle, width: {a}, thickness: {b}}}}}
"""
    robot = load(tmp_path, (panel, Body("hand", "link", xyz=(L, 0, 0))), yaml, inertia="urdf")
    J = a * b**3 * (1 / 3 - 0.21 * (b / a) * (1 - b**4 / (12 * a**4)))
    torsion = np.sqrt(E / 2.6 * J / (rho * (a**3 * b + a * b**3) / 12)) / (4 * L)
    found = np.array(pf.modes(robot).frequencies)
    # one mode of twist beside its static shape: 0.38 % above; Roark's J is the model's own
    assert found[np.abs(found - torsion).argmin()] == pytest.approx(torsion, rel=near)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 0, 1)])
@pytest.mark.parametrize("inertia", ["urdf", "beam"])
def test_what_sections_turn_with_is_in_the_moments_of_a_cut(
    axis: tuple[int, int, int], inertia: str, tmp_path: Path
) -> None:
    """A stubby bar is turned: at its root the cut has the whole torque, I times acceleration.

    With `rotary_inertia` the moments of the sections' own inertia were missing: of a panel that
    is turned about its span, all of the torsion and its stress.
    """
    L, a, b, rho, turn, time = 0.5, 0.2, 0.1, 2700.0, 0.5, 0.5
    m = rho * a * b * L
    moments = {0: m * (a**2 + b**2) / 12, 1: m * (L**2 + a**2) / 12, 2: m * (L**2 + b**2) / 12}
    bar = Body("link", "base", "revolute", axis=axis, mass=m, com=(L / 2, 0, 0),
               inertia=(moments[0], moments[1], moments[2]))  # fmt: skip
    yaml = f"""
gravity: [0, 0, 0]
flexible:
  link: {{material: {{E: 7e10, nu: 0.3, rho: {rho}}}, end: hand, up: z, rotary_inertia: true,
    section: {{shape: rectangle, width: {a}, thickness: {b}}}}}
"""
    robot = load(tmp_path, (bar, Body("hand", "link", xyz=(L, 0, 0))), yaml, inertia=inertia)
    motion = pf.cycloid(joints={"link_joint": turn}, duration=time)
    run = pf.solve(robot, motion, level="quasistatic", samples=401)
    about = moments[axis.index(1)] + (m * L**2 / 4 if axis[2] else 0.0)
    expected = about * 2 * np.pi * turn / time**2
    cut = run.link("link").resultant[:, 0, 3 + axis.index(1)]
    # 1e-4: samples beside the peak of a cycloid (pi^2 / 2 / 400^2 of it), and a small deflection
    assert np.abs(cut).max() == pytest.approx(expected, rel=1e-4)


def test_check_says_who_carries_what(tmp_path: Path) -> None:
    kept = str(check(arm(tmp_path)))
    assert "Mass, centre and inertia of the URDF are kept" in kept
    assert "the beam carries 29.9 % of the link's mass" in kept
    assert "motors and covers, rides rigidly" in kept
    assert "replaces" not in kept
    replaced = check(arm(tmp_path, inertia="beam"))
    (text,) = (w for w in replaced.warnings if "replaces" in w)
    assert "Write inertia: urdf" in text
    assert replaced.links[0].share is None


def test_end_masses_come_on_top_of_the_urdfs_inertia(tmp_path: Path) -> None:
    m = arm(tmp_path, more="tip: {mass: 0.7}")
    assert check(m).links[0].mass_difference == pytest.approx(0.7 / 2.0)
    assert sum(i.mass for i in m.rigid.rigid.inertias) == pytest.approx(2.0 + 0.5 + 0.7)


def test_a_link_without_mass_takes_the_beams_and_says_so(tmp_path: Path) -> None:
    m = arm(tmp_path, link=Body("link", "base", "revolute", axis=(0, 1, 0)))
    assert m.parts["link"].share is None
    assert any("gives no mass; the beam has its own" in w for w in check(m).warnings)


def test_an_inertia_that_no_beam_fits_into_is_refused_with_what_to_write(tmp_path: Path) -> None:
    lump = Body("link", "base", "revolute", axis=(0, 1, 0), mass=2.0, inertia=(1e-5, 1e-5, 1e-5))
    with pytest.raises(pf.DescriptionError, match=r"link.inertia: .* Write inertia: beam"):
        arm(tmp_path, link=lump)
    assert arm(tmp_path, link=lump, inertia="beam").parts["link"].mass > 0.5


def test_moments_without_mass_on_a_fixed_link_are_counted_once(tmp_path: Path) -> None:
    """As the feet of Bolt: 0 kg, but a moment of inertia."""
    foot = Body("foot", "hand", xyz=(0.1, 0, 0), inertia=(1e-3, 2e-3, 3e-3))
    yaml = "flexible:\n  link: {material: aluminium, section: {shape: circle, diameter: 0.02}}\n"
    bodies = (*arm_bodies(), foot)
    m = load(tmp_path, bodies, yaml, inertia="urdf")
    assert torque_difference(m) < 1e-12


def test_a_rod_without_moment_about_its_span_twists_without_inertia(tmp_path: Path) -> None:
    rod = Body("link", "base", "revolute", axis=(0, 1, 0), mass=2.0, com=(0.25, 0, 0),
               inertia=(0.0, 2 * 0.5**2 / 12, 2 * 0.5**2 / 12))  # fmt: skip
    m = arm(tmp_path, link=rod)
    assert m.parts["link"].share == pytest.approx(1.0)
    assert m.parts["link"].bodies[0].It.sum() == 0.0
    assert torque_difference(m) < 1e-12
    assert check(m).frequencies[0] > 10  # [Hz]


SPLIT_ARM = (  # as in the PR2: what turns and what carries the elbow are fixed to each other
    Body("roll", "base", "revolute", axis=(1, 0, 0), mass=2.0, com=(0.2, 0, 0),
         inertia=(1e-2, 5e-2, 5e-2)),
    Body("upper", "roll", mass=1.0, com=(0.2, 0, 0), inertia=(1e-2, 5e-2, 5e-2)),
    Body("lower", "upper", "revolute", xyz=(0.4, 0, 0), axis=(0, 1, 0), mass=1.0,
         inertia=(1e-2, 1e-2, 1e-2)),
)  # fmt: skip
SPLIT_YAML = """
platform: lower
flexible:
  {link}: {{material: aluminium, section: {{shape: tube, diameter: 0.05, wall: 0.003}}{more}}}
"""


@pytest.mark.parametrize("more", ["", ", end: lower"])
def test_a_beam_beside_the_load_is_refused_and_the_right_link_named(
    more: str, tmp_path: Path
) -> None:
    yaml = SPLIT_YAML.format(link="roll", more=more)
    with pytest.raises(pf.DescriptionError, match="Make upper flexible instead, or give `length`"):
        load(tmp_path, SPLIT_ARM, yaml)
    right = load(tmp_path, SPLIT_ARM, SPLIT_YAML.format(link="upper", more=more))
    assert right.parts["upper"].length == pytest.approx(0.4)
    assert not any("nothing hangs" in w for w in check(right).warnings)
    beside = load(tmp_path, SPLIT_ARM, SPLIT_YAML.format(link="roll", more=", length: 0.4"))
    assert any("nothing hangs on its beam" in w and "upper" in w for w in check(beside).warnings)


def test_a_camera_on_a_beam_beside_the_load_does_not_make_it_the_arm(tmp_path: Path) -> None:
    """As the PR2's forearm: 10 g beyond the root, and the arm itself fixed at the root."""
    camera, tool = (
        Body("extra", "roll", xyz=(0.13, 0, 0), mass=mass, inertia=(1e-5, 1e-5, 1e-5))
        for mass in (0.01, 1.0)
    )
    yaml = SPLIT_YAML.format(link="roll", more=", end: lower")
    with pytest.raises(
        pf.DescriptionError, match=r"carry 0.01 kg, beside a load of 2 kg: upper, .* Make upper"
    ):
        load(tmp_path, (*SPLIT_ARM, camera), yaml)
    assert load(tmp_path, (*SPLIT_ARM, tool), yaml).parts["roll"].length == pytest.approx(0.4)


def test_the_span_ends_where_a_fixed_child_takes_the_load_away(tmp_path: Path) -> None:
    bodies = (SPLIT_ARM[0], Body("sensor", "roll", xyz=(0.1, 0, 0), mass=0.1),
              Body("flange", "roll", xyz=(0.4, 0, 0)),
              Body("lower", "flange", "revolute", axis=(0, 1, 0), mass=1.0,
                   inertia=(1e-2, 1e-2, 1e-2)))  # fmt: skip
    m = load(tmp_path, bodies, SPLIT_YAML.format(link="roll", more=""))
    assert m.parts["roll"].length == pytest.approx(0.4)


def test_the_key_has_two_values() -> None:
    description = read("ur5")
    assert {link.inertia for link in description.flexible} == {"urdf"}
    with pytest.raises(pf.DescriptionError, match="inertia.*urdf, beam"):
        description.with_overrides(["flexible.*.inertia=rigid"])
    solid = "flexible.forearm_link={material: steel, basis: {kind: mesh, rod: {diameters: [0.1]}}"
    with pytest.raises(pf.DescriptionError, match="a solid has the mass of its mesh"):
        description.with_overrides([f"{solid}, inertia: urdf}}"])


def test_masses_at_the_same_end_are_named_as_one(tmp_path: Path) -> None:
    text = str(check(arm(tmp_path, more="tip: {mass: 0.7}")))
    assert text.count("at the tip") == 1
