"""The slider on a flexible beam: derivatives, variants, bases, forces, and what it refuses.

Claims:
    Machines
    - sleeve in space: rows, bias, tangent, six variants | differences | 1e-8 | passes
    - a rod drawn into its tube: P l^3/3EI, T l/GJ of what is out | beam theory | 1e-5 at nodes |
      passes; up to 12 % stiff between nodes of 5 cubic elements
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.mechanics.evaluation.equations import Equations
from tests.finite import by_configuration, by_time, close, random_state, slope
from tests.scenes import Body, load

# As in test_dynamics.py: differences are good to 1e-10 of a column's largest entry.
DIFFERENCES = 1e-8
ROUNDING = 1e-12

FREE = "flexible.beam.basis={kind: assumed, boundary: free_free, modes: 6}"
BASES = {
    "free-free modes": FREE,
    "clamped elements": "flexible.beam.basis={kind: finite_element, elements: 4, order: quintic}",
    "free elements": "flexible.beam.basis={kind: finite_element, elements: 3, boundary: free_free}",
    "Craig-Bampton": "flexible.beam.basis={kind: craig_bampton, internal: 3}",
}
SLEEVES = {
    "point": ("loops.sleeve.sleeve=0",),
    "three points": ("loops.sleeve.sleeve=0.03",),
    "pivoting": ("loops.sleeve.sleeve=0.03", "loops.sleeve.pivoting=true"),
}


def robot(*changes: str) -> pf.Mechanism:
    return pf.load("prprp", [FREE, *changes])


@pytest.mark.parametrize("sleeve", SLEEVES)
@pytest.mark.parametrize("basis", BASES)
def test_rows_bias_and_tangent_are_exact(basis: str, sleeve: str) -> None:
    m = robot(BASES[basis], *SLEEVES[sleeve])
    d = Equations(m.flexible)
    y, v, a, lam = random_state(m.flexible, m.undeformed(), 1)
    # Deflections of a per cent of the beam's length, half a metre.
    y[3:], v[3:] = 0.3 * y[3:], 0.3 * v[3:]
    J = d.close(y)[1].copy()
    close(J, by_configuration(d, lambda y: d.close(y)[0].copy(), y), DIFFERENCES)
    bias = by_time(d, lambda y, v: d.close(y)[1] @ v, y, v, 0.0 * a)
    np.testing.assert_allclose(d.closure_bias(y, v), bias, rtol=0, atol=1e-7 * np.abs(bias).max())
    d.system.K[:] = 0.0  # beside the beam's own stiffness all else would drown
    d.strain.stiffness[:] = 0.0
    K = d.tangent(y, v, a, lam, 0.0).K
    close(K, by_configuration(d, lambda y: d.residual(y, v, a, lam, 0.0).r, y), DIFFERENCES)


def test_a_load_beyond_the_sleeve_bends_the_beam_as_an_overhanging_one() -> None:
    # Quasistatic under gravity: moment at the sleeve mu g (L - x)^2 / 2, hinge free of moment.
    m = robot("flexible.beam.basis.modes=30", "motion={kind: hold, duration: 0.1}")
    r = pf.solve(m, level="quasistatic", samples=2)
    x, R = r.arrays["link/beam/x"], r.arrays["link/beam/resultant"][-1]
    moment = -0.2808 * 9.81 * (0.5 - x) ** 2 / 2
    beyond = x > 0.18
    # Foreshortening moves the load by w^2/L, 1e-4 of the arm.
    np.testing.assert_allclose(R[beyond, 5], moment[beyond], rtol=0, atol=2e-4 * 0.36)
    assert abs(R[0, 5]) < 1e-9
    across = r.arrays["reaction/slide_1"][-1, 2]
    assert across == pytest.approx(0.2808 * 9.81 * 0.5 * 0.25 / 0.18, rel=2e-4)


def test_the_frame_row_of_free_free_beams_carries_no_force() -> None:
    m = robot("flexible.beam.basis.modes=30", "motion={kind: hold, duration: 0.1}")
    r = pf.solve(m, level="quasistatic", samples=2)
    chord = m.flexible.closed.labels.index("sleeve: frame of the beam along its chord")
    # Third order: forces of 2 N times the square of slopes of 0.02.
    assert abs(r.arrays["multiplier"][-1, chord]) < 2.0 * 0.02**2


def test_a_rigid_slider_finds_the_angle_from_the_slides() -> None:
    m = robot("motion.joints.slide_2=0")
    r = pf.solve(m, level="rigid", samples=11)
    q = r.arrays["joint/q"]
    np.testing.assert_allclose(q[:, 2], np.arctan2(q[:, 0] - q[:, 1], 0.18), atol=ROUNDING)


@pytest.mark.parametrize("level", ["rigid", "coupled"])
def test_a_sleeve_that_leaves_the_beam_is_named_with_time_and_place(level: str) -> None:
    m = robot("motion.joints.slide_2=0", "loops.sleeve.sleeve=0.03")
    with pytest.raises(pf.MotionError, match=r'sleeve "sleeve" leaves the beam') as caught:
        pf.solve(m, level=level, until=1.5, dt=1e-3, samples=151)
    # The far end of the sleeve is at 0.18/cos(theta) + 0.015 = 0.5 m.
    time = np.sqrt(0.18 * np.tan(np.arccos(0.18 / 0.485)) / 0.3)
    found = float(caught.value.data["time"])
    assert time <= found <= time + 0.011
    assert f"t = {found:.6g} s" in str(caught.value)
    if level == "coupled":
        assert isinstance(caught.value.result, pf.Result)
        assert caught.value.result.t[-1] < found


def test_a_home_with_the_sleeve_off_the_beam_is_refused() -> None:
    with pytest.raises(pf.MotionError, match=r"home: .*leaves the beam"):
        robot("home={slide_1: 0.6, slide_2: 0, hinge: 1.28}")


WRONG: Sequence[tuple[str, str]] = (
    ("loops.sleeve.between=[carriage_1, beam]", "carriage_1 is not a flexible link"),
    ("loops.sleeve.sleeve=0.6", "not shorter than the beam"),
    ("loops.sleeve.sleeve=-1", "out of range"),
    ("loops.sleeve.pivoting=true", "Give `sleeve`"),
    ("flexible.beam.segments=2", r"move at its root, as free_free ones do"),
    (
        "loops.sleeve={kind: slider, between: [beam, carriage_1], sleeve: 0.03, pivoting: true, "
        "turning: false}",
        "lets the sleeve turn",
    ),
    ("loops.root.sleeve=0.1", "only for slider"),
)


@pytest.mark.parametrize(("change", "text"), WRONG)
def test_a_wrong_slider_is_refused(change: str, text: str) -> None:
    with pytest.raises(pf.DescriptionError, match=text):
        robot(change)


SPACE = """
actuated: []
loops:
  sleeve: {kind: slider, between: [rod, guide]}
flexible:
  rod:
    material: steel
    section: {shape: rectangle, width: 0.02, thickness: 0.01}
    end: tip
    basis: {kind: craig_bampton, internal: 3}
"""
ROD = (
    Body("rod", "base", "floating"),
    Body("tip", "rod", xyz=(0.5, 0, 0), mass=0.1, inertia=(1e-4, 1e-4, 1e-4)),
    Body("carriage", "base", "revolute", xyz=(0.2, 0, 0), axis=(0.6, 0, 0.8), mass=0.1,
         inertia=(1e-4, 1e-4, 1e-4)),
    Body("guide", "carriage"),
)  # fmt: skip
FIXED = "loops.sleeve.turning=false"


@pytest.mark.parametrize(
    ("changes", "rows"),
    [
        ((), 2),
        ((FIXED,), 5),
        ((FIXED, "loops.sleeve.sleeve=0.04"), 9),
        (("loops.sleeve.sleeve=0.04",), 6),
        (("loops.sleeve.sleeve=0.04", "loops.sleeve.pivoting=true"), 4),
        ((FIXED, "flexible.rod.torsion=false", "flexible.rod.up=[0, 1, 1]"), 5),
    ],
)
def test_in_space_the_rows_hold_both_bendings_and_the_twist(
    changes: tuple[str, ...], rows: int, tmp_path: Path
) -> None:
    m = load(tmp_path, ROD, SPACE, changes)
    assert m.flexible_report.rank == rows
    d = Equations(m.flexible)
    y, v, a, lam = random_state(m.flexible, m.undeformed(), 2)
    y[8:], v[7:] = 0.5 * y[8:], 0.5 * v[7:]  # a per cent of the length
    J = d.close(y)[1].copy()
    close(J, by_configuration(d, lambda y: d.close(y)[0].copy(), y), DIFFERENCES)
    bias = by_time(d, lambda y, v: d.close(y)[1] @ v, y, v, 0.0 * a)
    np.testing.assert_allclose(d.closure_bias(y, v), bias, rtol=0, atol=1e-7 * np.abs(bias).max())
    d.system.K[:] = 0.0
    d.strain.stiffness[:] = 0.0
    K = d.tangent(y, v, a, lam, 0.0).K
    close(K, by_configuration(d, lambda y: d.residual(y, v, a, lam, 0.0).r, y), DIFFERENCES)


TUBE = """
gravity: [0, 0, 0]
actuated: [rod_joint]
loops:
  mouth: {kind: slider, between: [rod, mouth], turning: false}
frames: [tip]
flexible:
  rod:
    material: {E: 2.0e11, nu: 0.25, rho: 7800}
    section: {shape: circle, diameter: 0.01}
    end: tip
    basis: {kind: finite_element, elements: 5}
    second_order: false
motion: {kind: formula, joints: {rod_joint: -t}, duration: 0.2}
solve: {level: quasistatic, samples: 9}
"""
TELESCOPE = (
    Body("rod", "base", "prismatic", axis=(1, 0, 0)),
    Body("tip", "rod", xyz=(0.5, 0, 0)),
    Body("mouth", "base", xyz=(0.1, 0, 0)),
)
EI = 2.0e11 * np.pi * 0.01**4 / 64


def test_a_rod_drawn_into_its_tube_is_a_cantilever_of_the_length_that_is_out(
    tmp_path: Path,
) -> None:
    """Force across it both ways and a torque; held at x = 0.1 to 0.3 m by a mouth that is fixed."""
    load_ = "forces={pull: {at: tip, force: [0, 2.0e-3, -1.0e-3], moment: [5.0e-4, 0, 0]}}"
    m = load(tmp_path, TELESCOPE, TUBE, [load_])
    r = pf.solve(m)
    out = 0.4 - r.t  # [m]
    moved = r.frame("tip").position[:, 1:]
    exact = np.outer(out**3 / (3 * EI), [2e-3, -1e-3])
    ratio = moved / exact
    # At the nodes, every 0.1 m, cubic elements are exact; between them the kink of the curvature at
    # the mouth lies inside an element, which only stiffens it: an effective length h/8 shorter.
    np.testing.assert_allclose(ratio[::4], 1.0, rtol=1e-5)
    assert np.all(ratio < 1 + 1e-5)
    assert np.all(ratio > 0.8)
    turn = 5e-4 * out / (EI / 1.25)  # G J = E I / (1 + nu)
    rod = r.link("rod")
    np.testing.assert_allclose(rod.deflection[::4, -1, 3], turn[::4], rtol=1e-5)
    # Forces: the whole load outside the mouth, none inside it.
    forces, x = r.array("link/rod/resultant")[0], r.array("link/rod/x")
    outside = x > 0.1 + 1e-9
    np.testing.assert_allclose(forces[outside, 3], 5e-4, rtol=1e-6)
    np.testing.assert_allclose(forces[outside, 5], 2e-3 * (0.5 - x[outside]), atol=1e-9)
    np.testing.assert_allclose(forces[outside, 4], 1e-3 * (0.5 - x[outside]), atol=1e-9)
    # Force times slope, 2e-3 N times 1e-5, is of second order.
    np.testing.assert_allclose(forces[x < 0.1 - 1e-9], 0.0, atol=2e-8)


def test_a_turning_mouth_and_the_end_in_the_tube_carry_an_overhanging_rod(tmp_path: Path) -> None:
    load_ = "forces={pull: {at: tip, force: [0, 2.0, 0]}}"
    turning = "loops.mouth.turning=true"
    r = pf.solve(load(tmp_path, TELESCOPE, TUBE, [load_, turning]))
    # Clamped at x = 0 and propped at a: the tip of P gives P l^3/3EI + P l^2 a/4EI.
    out, inside = 0.4 - r.t, 0.1 + r.t
    exact = 2.0 * (out**3 / 3 + out**2 * inside / 4) / EI
    np.testing.assert_allclose(r.frame("tip").position[::4, 1], exact[::4], rtol=1e-5)


DRAWN = (
    "gravity=[0, -9.81, -4]",
    "flexible.rod.second_order=true",
    "flexible.rod.basis={kind: craig_bampton, internal: 4}",
    "motion={kind: cycloid, joints: {rod_joint: -0.15}, duration: 0.2}",
    "solve={level: coupled, samples: 201}",
)


def test_a_fixed_sleeve_does_no_work_while_the_rod_is_drawn_through(tmp_path: Path) -> None:
    m = load(tmp_path, TELESCOPE, TUBE, DRAWN)
    steps = (2e-4, 1e-4)
    runs = [pf.solve(m, dt=dt) for dt in steps]
    lost = [float(r.meta["energy_balance"]) for r in runs]
    # All of it is the error of the step: 1.4e-6 of the energy, of second order.
    assert slope(steps, lost) == pytest.approx(2.0, abs=0.2)
    linear = pf.solve(m, level="ked", dt=1e-4)
    gap = np.abs(linear.frame("tip").position - runs[1].frame("tip").position).max()
    # 0.33 mm on half a metre: what is not linear is of the square of 1e-3, measured 5e-6.
    assert gap < 1e-4 * np.abs(runs[1].frame("tip").position[:, 1]).max()


def test_a_solid_has_no_shapes_for_a_sleeve(tmp_path: Path) -> None:
    pytest.importorskip("skfem")
    solid = ["flexible.rod.section=null",
             "flexible.rod.basis={kind: mesh, rod: {diameters: [0.01]}}"]  # fmt: skip
    with pytest.raises(pf.DescriptionError, match="rod is a solid"):
        load(tmp_path, TELESCOPE, TUBE, solid)


def test_ked_tends_to_coupled_for_a_stiff_beam() -> None:
    m = robot("flexible.beam.material.E=2e13", "motion.joints.slide_2=0")
    rigid, ked, coupled = (
        pf.solve(m, level=level, until=0.3, dt=2e-4, samples=151).frame("tip").position
        for level in ("rigid", "ked", "coupled")
    )
    # What is left is quadratic in the deflection, 2e-4 m on half a metre.
    assert np.abs(ked - coupled).max() < 1e-4 * np.abs(coupled - rigid).max()
