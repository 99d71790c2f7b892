"""A sleeve on a link in segments: exact derivatives, no jump at a border, section forces.

Claims:
    Machines
    - sleeve over segments: rows, bias, tangent, five variants, ends on both sides of a border |
      differences | 1e-8 | passes
    - at a border both segments have the same place, residual and Jacobian | - | 1e-12 m, 1e-11,
      1e-12 | passes
    - a rod in five segments drawn into its tube: deflection, section forces | beam theory; one body
      of five elements | 5e-6; 2e-6 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.bodies.track import track
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.reference import closures
from tests.scenes import load
from tests.unit.mechanics.test_slider import EI, FIXED, ROD, SPACE, TELESCOPE, TUBE

CASES = {
    "point": (),
    "fixed": (FIXED,),
    "fixed and long, across a border": (FIXED, "loops.sleeve.sleeve=0.04"),
    "pivoting, across a border": ("loops.sleeve.sleeve=0.04", "loops.sleeve.pivoting=true"),
    "with shear": (FIXED, "loops.sleeve.sleeve=0.04", "flexible.rod.shear=true",
                   "flexible.rod.basis={kind: finite_element, elements: 2}"),
}  # fmt: skip
CUT = ("flexible.rod.segments=2",)
BORDER = 0.25
DIFFERENCES = 1e-8


def state(m: pf.Mechanism, x: float, seed: int = 0) -> tuple[Array, Array, Array]:
    """y, v and multipliers with the sleeve near x (m) of the rod, bent by a per cent."""
    rng = np.random.default_rng(seed)
    system = m.flexible
    y, n = m.undeformed().copy(), int(system.rigid.nv)
    y[1:4] = 0.2 - x, 2e-3, -1e-3  # the carriage turns first
    y[8:] = 2e-3 * rng.uniform(-1, 1, system.n_eta)
    v = np.concatenate([rng.uniform(-1, 1, n), 0.02 * rng.uniform(-1, 1, system.n_eta)])
    return y, v, rng.uniform(-1, 1, system.closed.n)


def along(f: object, y: Array, v: Array, d: Equations, h: float = 2e-6) -> Array:
    """Derivative of f(y) along v, from two central differences: h^4 and round-off over h."""

    def central(h: float) -> Array:
        ahead, behind = (np.asarray(f(d.integrate(y, s * v))) for s in (h, -h))  # type: ignore[operator]
        return np.asarray((ahead - behind) / (2 * h))

    return np.asarray((4 * central(h / 2) - central(h)) / 3)


@pytest.mark.parametrize("x", [0.1, BORDER + 0.01])  # an end of the long sleeves is beyond it
@pytest.mark.parametrize("case", CASES)
def test_rows_bias_and_tangent_are_exact(case: str, x: float, tmp_path: Path) -> None:
    m = load(tmp_path, ROD, SPACE, (*CASES[case], *CUT))
    d = Equations(m.flexible)
    y, v, lam = state(m, x)
    zero, no = 0.0 * v, 0.0 * lam
    moved = along(lambda y: d.close(y).c, y, v, d)
    np.testing.assert_allclose(d.close(y).J @ v, moved, atol=DIFFERENCES * np.abs(moved).max())
    bias = along(lambda y: d.close(y).J @ v, y, v, d)
    np.testing.assert_allclose(d.closure_bias(y, v), bias, atol=1e-6 * np.abs(bias).max())
    # What the multipliers make of the forces: beside the beam's stiffness it would drown.
    K = d.tangent(y, zero, zero, lam, 0.0).K - d.tangent(y, zero, zero, no, 0.0).K
    pushed = along(lambda y: -d.close(y).J.T @ lam, y, v, d)
    np.testing.assert_allclose(K @ v, pushed, atol=1e-6 * np.abs(pushed).max())
    assert np.abs(pushed).max() > 0.1


@pytest.mark.parametrize("case", [case for case in CASES if "shear" not in case])
def test_at_a_border_both_segments_write_the_same_rows(case: str, tmp_path: Path) -> None:
    """With the frame on the beam there; of fixed sleeves the gradient has the curvature, a jump."""
    m = load(tmp_path, ROD, SPACE, (*CASES[case], *CUT))
    d = Equations(m.flexible)
    closed, y = m.flexible.closed, state(m, BORDER)[0]
    root, loop = closed.contacts[0].sleeve.segments[1].root, closed.contacts[0].loop
    poses, loops = d.joint_poses(y), len(closed.names)
    y[1:4] += closed.frames(poses)[0, loops + loop, :, 3] - poses[0, root.joint, :, 3]
    at, eta, found = d.kinematics(y), y[8:], []
    for number in (0, 1):
        on = closed.on((number,))
        given = at.poses, at.J, at.here.X, at.here.Q, eta[None]
        residual, jacobian = closures.by_velocities(on, *given)
        (place,) = closures.sleeves_at(on, at.poses[0], eta)
        found.append((place.at, residual[0], jacobian[0]))
    place, residual, jacobian = (np.abs(a - b).max() for a, b in zip(*found, strict=True))
    assert place < 1e-12
    # The long sleeve's ends are held to first order where it is off its tangent: 1e-12 of slopes.
    assert residual < 1e-11
    if case == "point":
        assert jacobian < 1e-12 * np.abs(found[0][2]).max()


@pytest.mark.parametrize("second_order", ["true", "false"])
def test_the_series_of_a_body_are_its_rows(second_order: str, tmp_path: Path) -> None:
    """Inside by the beam's own formulas; beyond its ends they go on with three derivatives."""
    for basis in ("{kind: finite_element, elements: 2, order: quintic}",
                  "{kind: assumed, boundary: clamped_free, modes: 4}"):  # fmt: skip
        m = load(tmp_path, ROD, SPACE, (f"flexible.rod.basis={basis}", "flexible.rod.axial=true",
                                        f"flexible.rod.second_order={second_order}"))  # fmt: skip
        body = m.parts["rod"].bodies[0]
        series = track(body)
        size = np.abs(body.rows(0.5)[0]).max()
        for x in (0.0, 0.11, 0.25, 0.37, 0.5):
            Phi, G = body.rows(x)
            sections = series.at(x)
            np.testing.assert_allclose(sections.Phi[0], Phi, atol=1e-12 * size)
            if G is not None:
                np.testing.assert_allclose(sections.G[0], G, atol=1e-11 * size)
            ahead, behind = (series.at(x + h).Phi for h in (1e-5, -1e-5))
            slope = (ahead[0] - behind[0]) / 2e-5
            if x not in (0.0, 0.25, 0.5):  # third derivatives jump between elements and at ends
                scale = np.abs(sections.Phi[1]).max()
                np.testing.assert_allclose(sections.Phi[1], slope, atol=1e-6 * scale)


CUT_TUBE = ("flexible.rod.segments=5", "flexible.rod.basis={kind: finite_element, elements: 1}")
PULL = "forces={pull: {at: tip, force: [0, 2.0e-3, -1.0e-3], moment: [5.0e-4, 0, 0]}}"


@pytest.mark.parametrize("sleeve", [0.0, 0.04])
def test_a_rod_in_segments_is_drawn_into_its_tube_as_one_in_elements(
    sleeve: float, tmp_path: Path
) -> None:
    """Five segments of one element each, and one body of five: the same shapes, to second order."""
    changes = (PULL, f"loops.mouth.sleeve={sleeve}")
    one, five = (
        pf.solve(load(tmp_path, TELESCOPE, TUBE, (*changes, *more))) for more in ((), CUT_TUBE)
    )
    places = [r.frame("tip").position for r in (one, five)]
    # 4.7e-5 m of 0.4: second order is 1e-4 of it, and one body has none here.
    np.testing.assert_allclose(places[1][:, 1:], places[0][:, 1:], rtol=2e-6, atol=0)
    out = 0.4 - five.t
    if not sleeve:
        exact = np.outer(out**3 / (3 * EI), [2e-3, -1e-3])
        np.testing.assert_allclose(places[1][::4, 1:], exact[::4], rtol=5e-6)
    rod = five.link("rod")
    forces, x = five.array("link/rod/resultant")[4], five.array("link/rod/x")
    mouth = 0.1 + five.t[4]
    outside, inside = x > mouth + 0.5 * sleeve + 1e-9, x < mouth - 0.5 * sleeve - 1e-9
    np.testing.assert_allclose(forces[outside, 3], 5e-4, rtol=1e-6)
    np.testing.assert_allclose(forces[outside, 5], 2e-3 * (0.5 - x[outside]), atol=1e-8)
    np.testing.assert_allclose(forces[outside, 4], 1e-3 * (0.5 - x[outside]), atol=1e-8)
    # Inside the tube nothing but what the root holds: no torque, and no moment at a clamp.
    np.testing.assert_allclose(forces[inside, 3], 0.0, atol=1e-9)
    assert rod.deflection.shape[1] == len(x)


def test_a_sleeve_longer_than_its_segments_is_refused(tmp_path: Path) -> None:
    with pytest.raises(pf.DescriptionError, match=r"longer than a segment.*segments: 5 or fewer"):
        load(tmp_path, TELESCOPE, TUBE, (*CUT_TUBE, "flexible.rod.segments=8",
                                         "loops.mouth.sleeve=0.2"))  # fmt: skip


def test_a_sleeve_at_rest_on_a_border_has_an_equilibrium_there(tmp_path: Path) -> None:
    """The curvature jumps at a border: on either side by turns, no step would end."""
    m = load(tmp_path, TELESCOPE, TUBE, (
        "gravity=[0, -9.81, -4]", "flexible.rod.second_order=true", "flexible.rod.axial=true",
        "flexible.rod.basis={kind: craig_bampton, internal: 1}", "flexible.rod.segments=2",
        "motion={kind: cycloid, joints: {rod_joint: -0.15}, duration: 0.05}",
        "forces={push: {at: tip, force: [0, 5, 0]}}", "solve={level: coupled, samples: 3}",
    ))  # fmt: skip
    assert m.flexible.uncovered is None
    r = pf.solve(m, dt=5e-4, until=0.055)  # at 0.05 s the mouth is at 0.25 m, and stays
    assert r.t[-1] == pytest.approx(0.055)
