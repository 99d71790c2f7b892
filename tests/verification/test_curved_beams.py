"""Beams along arcs and polylines against Castigliano's theorem.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - beams along an arc and a polyline: compliance of a quarter ring in and across its plane, of a
      bent lever; order 2 | Castigliano | 1e-4 (extrapolated), 1e-9 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.arrays import Array
from tests.finite import slope
from tests.scenes import Body, load

E, NU, D, R = 2.1e11, 0.3, 0.01, 0.5
EI, GJ = E * np.pi * D**4 / 64, E / (2 + 2 * NU) * np.pi * D**4 / 32
HALF = R * 0.5**0.5
# A quarter of a ring from the wall, up and over to the right; the URDF's own mass is replaced.
RING = (
    Body("hook", "base", mass=7.0, com=(0.1, 0, 0), inertia=(0.1, 0.1, 0.1)),
    Body("tool", "hook", xyz=(R, R, 0)),
)


def yaml(line: str, more: str = "") -> str:
    return f"""
actuated: []
gravity: [0, 0, 0]
platform: tool
flexible:
  hook:
    material: {{E: {E}, nu: {NU}, rho: 7800}}
    section: {{shape: circle, diameter: {D}}}
    basis: {{internal: 0}}
    {line}
{more}
"""


def ring(folder: Path, pieces: int) -> pf.Mechanism:
    arc = f"arc: {{through: [{R - HALF!r}, {HALF!r}, 0], to: [{R}, {R}, 0], pieces: {pieces}}}"
    return load(folder, RING, yaml(arc))


def compliance(robot: pf.Mechanism) -> Array:
    """Displacement of the tool by forces of 1 N along x, y, z, m/N, shape (3, 3)."""
    return pf.platform_compliance(robot)[:3, :3]


def test_a_quarter_ring_gives_way_as_castigliano_says(tmp_path: Path) -> None:
    """In its plane P R^3 / EI times 3 pi/4 - 2, pi/4 and 1/2; across it bending and torsion."""
    along, radial, both = 3 * np.pi / 4 - 2, np.pi / 4, -0.5
    exact = R**3 / EI * np.array([[along, both, 0], [both, radial, 0], [0, 0, radial]])
    exact[2, 2] += R**3 / GJ * along
    pieces, found = (4, 8, 16), []
    for n in pieces:
        found.append(compliance(ring(tmp_path, n)))
    errors = [float(np.abs(c - exact).max()) for c in found]
    assert slope(pieces, errors) == pytest.approx(-2.0, abs=0.05)  # corners on the circle
    best = found[2] + (found[2] - found[1]) / 3  # their error is even in 1/n
    # 1e-4: what is left of fourth order, (pi/2 / 16)^4 ~ 9e-5
    np.testing.assert_allclose(best, exact, atol=1e-4 * np.abs(exact).max())


def test_a_bent_lever_is_exact_with_one_piece_a_leg(tmp_path: Path) -> None:
    """Legs a and b at right angles: across their plane (a^3 + b^3) / 3 EI + a b^2 / GJ."""
    a, b = 0.4, 0.3
    bodies = (
        Body("hook", "base"),
        Body("knee", "hook", xyz=(a, 0.01, 0), mass=0.2, inertia=(1e-4, 1e-4, 1e-4)),
        Body("tool", "hook", xyz=(a, b, 0)),
    )
    robot = load(tmp_path, bodies, yaml(f"polyline: [[0, 0, 0], [{a}, 0, 0], [{a}, {b}, 0]]"))
    assert [*robot.parts] == ["hook_1", "hook_2"]
    c = compliance(robot)
    assert c[2, 2] == pytest.approx((a**3 + b**3) / (3 * EI) + a * b**2 / GJ, rel=1e-9)
    assert c[0, 0] == pytest.approx(b**3 / (3 * EI) + a * b**2 / EI, rel=1e-9)
    # The knee's mass hangs on the corner, ten millimetres aside.
    knee = next(link for link in robot.links if link.name == "knee")
    assert robot.links[knee.parent].name == "hook_2"
    assert knee.placement.translation == pytest.approx([0, 0.01, 0])
    masses = 7800 * np.pi * D**2 / 4 * (a + b) + 0.2
    assert sum(i.mass for i in robot.rigid.rigid.inertias) <= masses + 1e-12


def test_the_pieces_take_overrides_and_the_tip_its_mass(tmp_path: Path) -> None:
    robot = ring(tmp_path, 3)
    other = pf.load(robot.description, ["flexible.hook_*.section.diameter=0.02"])
    thin, thick = (compliance(m)[0, 0] for m in (robot, other))
    assert thin / thick == pytest.approx(16.0, rel=1e-9)  # d^4
    line = "polyline: [[0, 0, 0], [0, 0.2, 0], [0.1, 0.5, 0]]\n    tip: {mass: 0.5}"
    tipped = load(tmp_path, RING, yaml(line))
    assert [part.spec.tip is not None for part in tipped.parts.values()] == [False, True]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("polyline: [[0, 0, 0]]", "1 points. Allowed: 2 to"),
        ("polyline: [[0, 0, 0], [0, 0, 0], [1, 0, 0]]", "points 0 and 1 are one"),
        ("arc: {through: [1, 0, 0], to: [2, 0, 0]}", "lie on one line"),
        ("arc: {to: [2, 0, 0]}", "arc.through: missing"),
        ("polyline: [[0, 0, 0], [1, 0, 0]]\n    end: tool", "which has its own ends"),
        ("polyline: [[0, 0, 0], [1, 0, 0]]\n    inertia: urdf", "Write inertia: beam"),
    ],
)
def test_a_line_that_is_none_is_refused(line: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(pf.DescriptionError) as error:
        load(tmp_path, RING, yaml(line), inertia="beam")
    assert said in str(error.value)
