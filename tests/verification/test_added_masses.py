"""Masses that differ with the direction, against closed forms and a mass that does not differ.

Claims:
    Machines
    - added masses: tangents by rates and pose on a free body | differences | 1e-7, 1e-6 | passes
    - tip mass in one direction: both first frequencies, 1 and 2 segments | cos cosh equation | 1e-5
      | passes
    - two rigid links with unlike masses at the hand: torques | Lagrange by hand | 1e-13 | passes
    - like masses in all directions: every array of a coupled run, modes | a mass point in the URDF
      | 1e-7, 1e-9 | passes
    - thrown body with unlike masses: momentum, energy (Kirchhoff) | conservation | 1e-5, 1e-6 |
      passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import pinflex as pf
from pinflex.mechanics.evaluation.equations import Equations
from tests.finite import by_configuration, by_speed, close, random_state
from tests.scenes import Body, load

E, SIDE, RHO, LENGTH = 2.0e11, 0.01, 7800.0, 1.0
EI, RHO_A = E * SIDE**4 / 12, RHO * SIDE**2

ARM = (
    Body("rod", "base", "revolute", axis=(0, 0, 1)),
    Body("tip", "rod", xyz=(LENGTH, 0, 0)),
)
YAML = f"""
gravity: [0, 0, 0]
actuated: [rod_joint]
frames: [tip]
flexible:
  rod:
    material: {{E: {E}, nu: 0.3, rho: {RHO}}}
    section: {{shape: rectangle, width: {SIDE}, thickness: {SIDE}}}
    end: tip
    bending_y: true
    bending_z: true
    torsion: false
    axial: false
    basis: {{kind: craig_bampton, internal: 3}}
motion: {{kind: cycloid, joints: {{rod_joint: 0.5}}, duration: 0.2}}
"""


def first_frequency(mass: float) -> float:
    """First frequency (Hz) of a cantilever with a mass (kg) at its tip."""
    ratio = mass / (RHO_A * LENGTH)

    def left(b: float) -> float:
        bent = np.sin(b) * np.cosh(b) - np.cos(b) * np.sinh(b)
        return float(1 + np.cos(b) * np.cosh(b) - ratio * b * bent)

    b = brentq(left, 0.1, 1.9)
    return float(b**2 * np.sqrt(EI / (RHO_A * LENGTH**4)) / (2 * np.pi))


@pytest.mark.parametrize("level_of_cut", [1, 2])
def test_a_tip_mass_in_one_direction_lowers_the_mode_in_it(
    level_of_cut: int, tmp_path: Path
) -> None:
    water = "added_masses={water: {at: tip, mass: [0, 0, 1.2]}}"
    m = load(tmp_path, ARM, YAML, [water, f"flexible.rod.segments={level_of_cut}"])
    found = pf.modes(m).frequencies[:2]
    # Two internal modes or more: 1e-6 of the first frequency.
    np.testing.assert_allclose(found, [first_frequency(1.2), first_frequency(0.0)], rtol=1e-5)
    assert m.flexible.uncovered is None


TWO = (
    Body("upper", "base", "revolute", axis=(0, 0, 1), mass=1.0, inertia=(0.1, 0.1, 0.1)),
    Body("lower", "upper", "revolute", axis=(0, 0, 1), xyz=(0.7, 0, 0), mass=0.5,
         inertia=(0.1, 0.1, 0.1)),
    Body("hand", "lower", xyz=(0.4, 0, 0)),
)  # fmt: skip
RIGID = "gravity: [0, -9.81, 0]\nactuated: [upper_joint, lower_joint]\n"


def test_rigid_torques_are_those_of_lagrange(tmp_path: Path) -> None:
    """The hand's speed in its own axes: u = l1 sin q2 q1', w = (l1 cos q2 + l2) q1' + l2 q2'."""
    l1, l2, mx, my, Iz = 0.7, 0.4, 0.3, 2.0, 0.15
    block = f"added_masses={{water: {{at: hand, mass: [{mx}, {my}, 0], inertia: [0, 0, {Iz}]}}}}"
    rng = np.random.default_rng(4)
    q, v, a = rng.uniform(-1.5, 1.5, (3, 20, 2))
    found = [
        pf.inverse_dynamics(load(tmp_path, TWO, RIGID, more), q, v, a) for more in ([block], [])
    ]
    s, c = np.sin(q[:, 1]), np.cos(q[:, 1])
    (v1, v2), (a1, a2) = v.T, a.T
    u, w = l1 * s * v1, (l1 * c + l2) * v1 + l2 * v2
    du = l1 * (s * a1 + c * v1 * v2)
    dw = (l1 * c + l2) * a1 + l2 * a2 - l1 * s * v1 * v2
    turning = Iz * (a1 + a2)
    # d/dt (dT/dv1), and d/dt (dT/dv2) - dT/dq2, with T = (mx u^2 + my w^2 + Iz (v1 + v2)^2) / 2.
    first = mx * (du * l1 * s + u * l1 * c * v2)
    first += my * (dw * (l1 * c + l2) - w * l1 * s * v2) + turning
    second = my * dw * l2 + turning - mx * u * l1 * c * v1 + my * w * l1 * s * v1
    np.testing.assert_allclose(found[0] - found[1], np.column_stack([first, second]), atol=1e-13)


def test_it_has_no_weight(tmp_path: Path) -> None:
    block = "added_masses={water: {at: tip, mass: [1, 2, 3]}}"
    sags = []
    for more in ([block], []):
        m = load(tmp_path, ARM, YAML, ["gravity=[0, 0, -9.81]", *more])
        sags.append(pf.static_equilibrium(m).y)
    np.testing.assert_allclose(sags[0], sags[1], rtol=0, atol=1e-15)
    assert np.abs(sags[0]).max() > 1e-3


def test_the_same_mass_in_every_direction_is_a_mass_point(tmp_path: Path) -> None:
    """Every array of a coupled run, without gravity: motion, torque, reactions, section forces."""
    heavy = (ARM[0], Body("tip", "rod", xyz=(LENGTH, 0, 0), mass=0.4, inertia=(1e-3, 2e-3, 3e-3)))
    block = "added_masses={w: {at: tip, mass: [0.4, 0.4, 0.4], inertia: [1e-3, 2e-3, 3e-3]}}"
    runs = []
    for bodies, more in ((heavy, []), (ARM, [block])):
        m = load(tmp_path, bodies, YAML, [*more, "flexible.rod.segments=2"])
        runs.append((m, pf.solve(m, level="coupled", dt=1e-3, until=0.05, samples=6)))
    (one, body), (other, added) = runs
    for key, value in body.arrays.items():
        if not key.startswith("residual"):
            scale = float(np.abs(value).max(initial=1e-3))  # below it: round-off of newtons
            np.testing.assert_allclose(added.array(key), value, atol=1e-7 * scale, err_msg=key)
    np.testing.assert_allclose(*(pf.modes(m).frequencies for m in (one, other)), rtol=1e-9)


def test_a_thrown_body_with_unlike_masses_keeps_energy_and_momentum(tmp_path: Path) -> None:
    """Kirchhoff: nothing acts, and it turns all the same; R M v stays, v is what changes."""
    bodies = (Body("hull", "base", mass=1.0, inertia=(0.1, 0.2, 0.3)),)
    yaml = """
base: free_flyer
gravity: [0, 0, 0]
frames: [base]
added_masses: {water: {at: hull, mass: [0.2, 3.0, 1.5], inertia: [0, 0.1, 0.2]}}
solve: {level: coupled, start_speeds: {root_joint: [2, 0.5, 0.3, 0.1, 0.2, -0.1]}}
"""
    m = load(tmp_path, bodies, yaml)
    r = pf.solve(m, level="coupled", tol=1e-7, until=1.0, samples=11)
    q, v = r.arrays["joint/q"], r.arrays["joint/v"]
    mass = np.array([1.2, 4.0, 2.5])
    x, y, z, w = q[:, 3:7].T
    R = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    momentum = np.einsum("ijt,tj->ti", R, mass * v[:, :3])
    np.testing.assert_allclose(momentum, np.tile(momentum[0], (11, 1)), atol=1e-5)
    turning = np.array([0.1, 0.3, 0.5])
    energy = 0.5 * (mass * v[:, :3] ** 2).sum(axis=1) + 0.5 * (turning * v[:, 3:] ** 2).sum(axis=1)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)
    assert np.abs(v[:, 3:] - v[0, 3:]).max() > 1.0  # Munk's moment turned it


def test_tangents_are_differences_of_the_equations(tmp_path: Path) -> None:
    """By rates and by pose, on a bent arm that rides on a free body."""
    bodies = (
        Body("hull", "base", mass=1.0, inertia=(0.1, 0.2, 0.3)),
        Body("rod", "hull", "revolute", axis=(0, 0.6, 0.8), rpy=(0.3, 0.2, 0.1)),
        ARM[1],
    )
    water = "added_masses: {water: {at: tip, mass: [0.2, 3.0, 1.5], inertia: [0.3, 0.1, 0.2]}}"
    m = load(tmp_path, bodies, f"base: free_flyer\n{water}{YAML.split('motion:')[0]}")
    d = Equations(m.flexible)
    y, v, a, lam = random_state(m.flexible, m.undeformed(), 5)
    _, C, K, _ = d.tangent(y, v, a, lam, 0.0)
    # Differences are good to 1e-11 of forces; stiffness makes them a thousand times larger.
    close(C, by_speed(lambda x: d.residual(y, x, a, lam, 0.0).r, v), 1e-7)
    close(K, by_configuration(d, lambda x: d.residual(x, v, a, lam, 0.0).r, y), 1e-6)


def test_a_mass_that_is_none_is_refused(tmp_path: Path) -> None:
    for block, words in (("{at: tip}", "no mass"), ("{at: tip, mass: [-1, 0, 0]}", "out of range"),
                         ("{at: tipp, mass: [1, 0, 0]}", 'Did you mean "tip"')):  # fmt: skip
        with pytest.raises(pf.DescriptionError, match=words):
            load(tmp_path, ARM, YAML, [f"added_masses={{water: {block}}}"])
