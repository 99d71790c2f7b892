"""The expanded model: where sections go, what they carry, to which order it is right.

Claims:
    Equations
    - a section of a bent beam is right to second order (error falls with the cube) | R' = R kappa^,
      integrated | slope 3 +- 0.25 | passes
    - second order off: with the square | same | slope 2 +- 0.25 | passes
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import pinflex as pf
from pinflex.arrays import Array
from pinflex.description.description import model_names
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.recovery.links import deflections
from tests.finite import slope
from tests.scenes import Body, load

ROUNDING = 1e-12
BEAM = """
actuated: []
flexible:
  beam:
    material: {E: 1.0e9, nu: 0.3, rho: 1000}
    section: {shape: rectangle, width: 0.05, thickness: 0.02}
    axial: true
    bending_y: true
    bending_z: true
    torsion: true
"""
STRAIGHT = (
    Body("beam", "base", xyz=(0.1, 0.2, 0.3), rpy=(0.3, -0.2, 0.5)),
    Body("ring", "beam", xyz=(0.6, 0.0, 0.1), rpy=(0.1, 0.2, 0.3), mass=0.2),
    Body("tip", "beam", xyz=(1.5, 0.0, 0.0), mass=0.1, inertia=(1e-3, 1e-3, 1e-3)),
)
END = "\n    end: tip\n"


@cache
def mechanism(name: str) -> pf.Mechanism:
    # 50 modes would prove nothing that 8 do not, at 20 times the cost.
    return pf.load(name, ["flexible.beam.basis.modes=8"] if name == "prprp" else [])


def pose(m: pf.Mechanism, frame: str, y: Array) -> pin.SE3:
    d = Equations(m.flexible)
    pin.forwardKinematics(d.model, d.data, d.at(y).Q[0])
    here = m.frame(frame)
    return d.data.oMi[here.joint] * here.placement


def bent(m: pf.Mechanism, eta: Array) -> Array:
    return np.concatenate([m.home, eta])


@pytest.mark.parametrize("name", model_names())
def test_undeformed_links_are_where_the_rigid_tree_has_them(name: str) -> None:
    m = mechanism(name)
    rng = np.random.default_rng(1)
    rigid = Equations(m.rigid)
    q = rigid.integrate(m.home, rng.uniform(-0.5, 0.5, m.rigid.nv))
    pin.forwardKinematics(rigid.model, rigid.data, q)
    flexible = Equations(m.flexible)
    y = np.concatenate([q, np.zeros(m.flexible.n_eta)])
    pin.forwardKinematics(flexible.model, flexible.data, flexible.at(y).Q[0])
    frames = m.flexible.expansion.frames
    assert len(frames) > 2
    for frame, there in frames.items():
        here = m.rigid.expansion.frames[frame]
        expected = rigid.data.oMi[here.joint] * here.placement
        found = flexible.data.oMi[there.joint] * there.placement
        np.testing.assert_allclose(found.homogeneous, expected.homogeneous, atol=1e-11)


@pytest.mark.parametrize("name", model_names())
def test_the_rigid_tree_is_the_urdf(name: str) -> None:
    m = mechanism(name)
    if any(extra.type for extra in m.description.joints.values()):
        pytest.skip("it has ball or universal joints, which no URDF can hold")
    model = pin.buildModelFromXML(m.description.urdf_text)
    assert m.coordinates == tuple(model.names[1:])
    q = pin.integrate(model, pin.neutral(model), np.linspace(-0.6, 0.7, model.nv))
    data, rigid = model.createData(), Equations(m.rigid)
    pin.framesForwardKinematics(model, data, q)
    pin.forwardKinematics(rigid.model, rigid.data, q)
    for frame, here in m.rigid.expansion.frames.items():
        expected = data.oMf[model.getFrameId(frame, pin.FrameType.BODY)]
        found = rigid.data.oMi[here.joint] * here.placement
        np.testing.assert_allclose(found.homogeneous, expected.homogeneous, atol=ROUNDING)


@pytest.mark.parametrize("name", model_names())
def test_the_expanded_model_weighs_what_the_rigid_one_does(name: str) -> None:
    m = mechanism(name)
    mass = [
        sum(i.mass for i in list(s.expansion.model.inertias)[1:]) for s in (m.rigid, m.flexible)
    ]
    if name == "cantilever":  # its rigid link is part of the world
        assert mass[1] == pytest.approx(0.157, rel=1e-9)
    else:
        assert mass[0] == pytest.approx(mass[1], rel=1e-12)


def exact(m: pf.Mechanism, eta: Array, x: float) -> pin.SE3:
    """Pose of a section in the link: R' = R kappa^, r' = R (1 + u', 0, 0), for linear strains."""
    body = m.flexible.expansion.slots[0].body

    def rate(s: float, state: Array) -> Array:
        f = body.fields(np.array([s]))
        strain = {k: float(f[k][0] @ eta) for k in ("axial", "curvature_v", "curvature_w", "twist")}
        R = state[3:].reshape(3, 3)
        kappa = np.array([strain["twist"], -strain["curvature_w"], strain["curvature_v"]])
        stretch = np.array([1.0 + strain["axial"], 0.0, 0.0])
        return np.concatenate([R @ stretch, (R @ pin.skew(kappa)).ravel()])

    start = np.concatenate([np.zeros(3), np.eye(3).ravel()])
    end = solve_ivp(rate, (0.0, x), start, rtol=1e-12, atol=1e-14, method="DOP853").y[:, -1]
    return pin.SE3(end[3:].reshape(3, 3), end[:3])


def deviations(second_order: bool, folder: Path, frame: str, x: float) -> tuple[Array, Array]:
    """Errors of a section's position and rotation for three sizes of one random shape."""
    yaml = BEAM + END + f"    second_order: {str(second_order).lower()}\n"
    m = load(folder, STRAIGHT, yaml)
    part = m.parts["beam"]
    root = pose(m, "beam", bent(m, np.zeros(m.flexible.n_eta))) * part.placement
    offset = {"tip": np.zeros(3), "ring": np.array([0.0, 0.0, 0.1])}[frame]
    local = pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))
    home = pose(m, frame, bent(m, np.zeros(m.flexible.n_eta)))
    arm = local.inverse() * root.inverse() * home  # the frame as it hangs on its section
    assert np.linalg.norm(arm.translation) == pytest.approx(np.linalg.norm(offset), abs=1e-9)
    shape = 0.3 * np.random.default_rng(7).uniform(-1, 1, m.flexible.n_eta)
    position, rotation = [], []
    for size in SIZES:
        expected = root * exact(m, size * shape, x) * arm
        error = expected.inverse() * pose(m, frame, bent(m, size * shape))
        position.append(np.linalg.norm(error.translation))
        rotation.append(np.linalg.norm(pin.log3(error.rotation)))
    return np.array(position), np.array(rotation)


SIZES = (0.4, 0.2, 0.1, 0.05)


@pytest.mark.parametrize(("frame", "x"), [("tip", 1.5), ("ring", 0.6)])
def test_sections_are_right_to_second_order_in_the_deflection(
    frame: str, x: float, tmp_path: Path
) -> None:
    """Against the exact kinematics of a beam: errors fall with the cube, or with the square."""
    for second_order, power in ((True, 3), (False, 2)):
        for error in deviations(second_order, tmp_path, frame, x):
            # 0.25: the next power of the smallest shapes.
            assert slope(SIZES, error) == pytest.approx(power, abs=0.25)


def test_the_foreshortening_of_a_bent_beam_is_half_the_integral_of_its_slope_squared(
    tmp_path: Path,
) -> None:
    m = load(tmp_path, STRAIGHT, BEAM + END)
    body = m.flexible.expansion.slots[0].body
    eta = np.zeros(body.n)
    eta[body.slices["v"]] = [0.05, 0.1, 0.02, -0.01]
    root = pose(m, "beam", bent(m, 0 * eta)) * m.parts["beam"].placement
    tip = root.actInv(pose(m, "tip", bent(m, eta)).translation)
    x, w = np.polynomial.legendre.leggauss(20)
    rot = body.families["v"].evaluate(0.75 * (x + 1)).rot @ eta[body.slices["v"]]
    assert tip[0] - 1.5 == pytest.approx(-0.5 * 0.75 * (w @ rot**2), rel=1e-12)
    assert tip[1] == pytest.approx(eta[body.slices["v"]][0], rel=1e-12)  # the tip coordinate
    assert tip[2] == pytest.approx(0.0, abs=ROUNDING)


def test_a_chain_of_segments_turns_further_than_one_body_may(tmp_path: Path) -> None:
    """Six segments bent into a quarter of a circle: each of them is bent by 15 degrees only."""
    n, angle = 6, np.pi / 2
    m = load(tmp_path, STRAIGHT, BEAM + END + f"    segments: {n}\n")
    radius = 1.5 / angle
    eta = np.zeros(m.flexible.n_eta)
    for slot in m.flexible.expansion.slots:
        body, part = slot.body, eta[slot.eta]
        # Slope and deflection of an arc's end to first order: theta, L theta/2.
        part[body.slices["v"]][:2] = [body.length * angle / n / 2, angle / n]
    root = pose(m, "beam", bent(m, 0 * eta)) * m.parts["beam"].placement
    tip = root.inverse() * pose(m, "tip", bent(m, eta))
    expected = radius * np.array([np.sin(angle), 1 - np.cos(angle), 0.0])
    # An arc of 15 degrees is drawn to theta^3/24 of its length.
    np.testing.assert_allclose(tip.translation, expected, atol=1.5 * (angle / n) ** 3 / 24)
    assert np.arctan2(tip.rotation[1, 0], tip.rotation[0, 0]) == pytest.approx(angle, abs=1e-9)


def test_what_hangs_in_the_middle_rides_on_its_section(tmp_path: Path) -> None:
    """The ring's mass, by the kinetic energy of a motion of one bending coordinate."""
    with_ring = load(tmp_path, STRAIGHT, BEAM + END)
    v = np.zeros(with_ring.flexible.nv)
    body = with_ring.flexible.expansion.slots[0].body
    v[body.slices["v"].start] = 1.0  # the tip moves at 1 m/s
    y = bent(with_ring, np.zeros(body.n))
    energy = Equations(with_ring.flexible).energies(y, v, 0.0)[0]
    bare = load(tmp_path, (STRAIGHT[0], STRAIGHT[2]), BEAM + END)
    energy -= Equations(bare.flexible).energies(y, v, 0.0)[0]
    rows, _ = body.rows(0.6)
    speed, spin = rows[1] @ v, rows[3] @ v
    # A point mass 0.1 m above the axis: the bending rotation about z moves it along x only if it
    # had a lever in y, so just the section's speed counts.
    assert energy == pytest.approx(0.5 * 0.2 * speed**2, rel=1e-9)
    assert abs(spin) > 0.1


def test_a_massless_frame_nobody_asks_for_costs_no_section(tmp_path: Path) -> None:
    idle = (*STRAIGHT, Body("sticker", "beam", xyz=(0.9, 0, 0)))
    count = [
        load(tmp_path, b, BEAM + END).flexible.expansion.model.njoints for b in (STRAIGHT, idle)
    ]
    assert count[0] == count[1]
    asked = load(tmp_path, idle, BEAM + END + "frames: [sticker]\n")
    assert asked.flexible.expansion.model.njoints > count[0]


def test_rows_of_sections_are_the_small_deflections_of_a_result() -> None:
    """Of links in two bodies, the second of which rides on the tip of the first."""
    m = pf.load("delta", ["flexible.*.segments=2"])
    eta = 1e-7 * np.random.default_rng(4).standard_normal((3, m.flexible.n_eta))
    y = np.array([bent(m, x) for x in eta])
    moved = deflections(Equations(m.flexible), y).values()
    every = np.concatenate([x.reshape(3, -1) for _, x in moved], axis=1)
    found = eta @ m.flexible.expansion.sections.T
    away = [np.abs(every - row[:, None]).max(axis=0).min() for row in found.T]
    assert max(away) < 1e-5 * np.abs(every).max()  # beside it, what is of second order is 1e-7
    assert np.abs(found).max() > 0.9 * np.abs(every).max()  # a mode's peak may be between sections


def test_links_that_only_twist_have_rows_of_their_turns() -> None:
    planes = [f"flexible.*.{key}=false" for key in ("bending_y", "bending_z", "axial")]
    m = pf.load("ur5", [*planes, "flexible.*.torsion=true"])
    rows = m.flexible.expansion.sections
    assert m.flexible.n_eta == 2
    np.testing.assert_allclose(rows.max(axis=0), 1.0)  # coordinates are turns of tips
