"""Beams under axial force and under their own weight: stiffness that loads bring, to buckling.

Every beam has L = rho A = E I = 1, as in test_beams.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - axial force P L^2/EI = -2 to 2, by a spring through a closure | closed form | 1e-6 | passes
    - a strip on edge tips over at 4.0126 sqrt(EI GJ)/L^2: default shapes; six modes | Prandtl | 2
      %; 2e-3 | 1.8 % (36 % before); 2e-5
    - Beck's column: frequencies at P = 5, 15, 19; flutter between 20.04 and 20.06, no buckling |
      closed form | 1e-5 | passes (-21 % at 5, "buckled" at 15 before)
    - own weight q L^3/EI = -5, 5, 7; buckling at 7.83734744 | printed | 1e-6 | 7e-10, 3e-8, 2e-7;
      6e-10
    - linear sag with the stiffness of what pulls, and what check says of it: a side force on a tip
      under P = 14; a load on a soft hinge at the tip | tie-beam column; straight below the tip |
      1e-4; 1e-3 | 1e-5; 7e-5
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import pinflex as pf
from pinflex.levels.quasistatic import rest
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.studies.checking.check import check
from tests import analytical
from tests.scenes import Body, load
from tests.verification.test_beams import BEAM, LIMIT, RICH, omega, scene

PRINTED_LOADED = {-2: 4.606570, -1: 4.110242, 0: 3.516015, 1: 2.753625, 2: 1.580913}


@pytest.mark.parametrize("force", PRINTED_LOADED)
def test_an_axial_force_softens_or_stiffens(force: int, tmp_path: Path) -> None:
    """A spring pushes a slider that the tip is pinned to; it slides across without friction."""
    slider = (
        Body("along", "base", "prismatic", xyz=(1, 0, 0), axis=(1, 0, 0)),
        Body("across", "along", "prismatic", axis=(0, 1, 0)),
    )
    head = f"""
joints: {{along_joint: {{spring: 1.0, rest: {-force}}}}}
loops: {{end: {{kind: planar, between: [tip, across]}}}}
"""
    m = load(tmp_path, (*BEAM, *slider), scene(head=head))
    exact = analytical.compressed_cantilever(force)
    assert exact == pytest.approx(PRINTED_LOADED[force], abs=6e-7)
    assert omega(m, "gravity")[0] == pytest.approx(exact, rel=LIMIT)
    assert omega(m, "none")[0] == pytest.approx(
        analytical.wave_numbers("clamped_free")[0] ** 2, rel=LIMIT
    )


PRINTED_COLUMN = {-5: 4.494313, 5: 2.118486, 7: 1.151553}


def column(weight: float, folder: Path, basis: str = RICH) -> float:
    """omega (negative: buckled) of a standing column; weight is q L^3/EI."""
    yaml = scene(basis).replace("gravity: [0, 0, 0]", f"gravity: [{-weight!r}, 0, 0]")
    return float(omega(load(folder, BEAM, yaml), "gravity")[0])


@pytest.mark.parametrize("weight", PRINTED_COLUMN)
def test_a_column_is_softened_by_its_own_weight(weight: float, tmp_path: Path) -> None:
    # Seven printed digits, and near buckling the error of omega^2 is divided by a small omega^2.
    assert column(weight, tmp_path) == pytest.approx(PRINTED_COLUMN[weight], rel=LIMIT)


def test_a_column_buckles_where_its_frequency_reaches_zero(tmp_path: Path) -> None:
    below, above = column(7.83, tmp_path), column(7.845, tmp_path)
    assert below > 0 > above
    square = [below**2, -(above**2)]
    critical = 7.83 + 0.015 * square[0] / (square[0] - square[1])  # omega^2 is linear in the load
    assert critical == pytest.approx(7.83734744, rel=1e-6)


def strip(force: float, folder: Path, more: str = "") -> float:
    """omega (negative: it has tipped over) of a strip 20 times as high as wide, loaded on edge."""
    yaml = f"""
gravity: [0, 0, 0]
actuated: []
platform: tip
forces: {{load: {{at: tip, force: [0, 0, {-force!r}]}}}}
flexible:
  beam:
    material: {{E: 1, G: 1, rho: 1}}
    section: {{shape: given, A: 1, Iy: 1, Iz: 0.0025, J: 0.01}}
    end: tip
{more}"""
    return float(omega(load(folder, BEAM, yaml), "gravity")[0])


def test_a_strip_on_edge_tips_over_at_prandtls_load(tmp_path: Path) -> None:
    """P = 4.0126 sqrt(EI GJ) / L^2 by the default shapes; one twist shape alone makes it 5.48."""
    critical = 4.0126 * (0.0025 * 0.01) ** 0.5
    # 2 %: Ritz, from above, by two twist shapes; six modes are good to 1e-4, and sag to 1e-5
    assert strip(0.98 * critical, tmp_path) > 0 > strip(1.025 * critical, tmp_path)
    rich = "    basis: {internal: 6}\n"
    below, above = (strip(k * critical, tmp_path, rich) for k in (0.998, 1.002))
    assert below > 0 > above


def beck(force: float, folder: Path) -> pf.Modes:
    """Modes of a cantilever that a force pushes along its tip."""
    follower = f"forces: {{push: {{at: tip, force: [{-force!r}, 0, 0], follower: true}}}}"
    m = load(folder, BEAM, scene("{kind: craig_bampton, internal: 6}", follower))
    return pf.modes(m)


def beck_exact(force: float, near: float) -> float:
    """omega of y'''' + P y'' = omega^2 y, y = y' = 0 at the root, y'' = y''' = 0 at the tip."""

    def misses(omega: float) -> float:
        root = np.sqrt(force**2 / 4 + omega**2)
        a, b = np.sqrt(root - force / 2), np.sqrt(root + force / 2)
        # cosh/sinh a x and cos/sin b x, with y(0) = y'(0) = 0
        rows = np.array([
            [a**2 * np.cosh(a) + b**2 * np.cos(b), a**2 * np.sinh(a) + a * b * np.sin(b)],
            [a**3 * np.sinh(a) - b**3 * np.sin(b), a**3 * np.cosh(a) + a * b**2 * np.cos(b)],
        ])  # fmt: skip
        return float(np.linalg.det(rows))

    return float(brentq(misses, 0.9 * near, 1.1 * near, xtol=1e-12))


@pytest.mark.parametrize("force", [5.0, 15.0, 19.0])
def test_a_follower_raises_the_frequency_of_becks_column(force: float, tmp_path: Path) -> None:
    found = beck(force, tmp_path)
    exact = beck_exact(force, {5.0: 4.217, 15.0: 6.627, 19.0: 8.64}[force])
    # 1e-5: six internal modes; near flutter both modes move by the root of what is left out
    assert 2 * np.pi * found.frequencies[0] == pytest.approx(exact, rel=1e-5)
    assert found.growth is None and np.isrealobj(found.shapes)
    M = Equations(found.mechanism.flexible).mass(found.y)  # type: ignore[union-attr]
    assert found.shapes[:, 0] @ M @ found.shapes[:, 0] == pytest.approx(1.0, rel=1e-9)


def test_becks_column_flutters_and_does_not_buckle(tmp_path: Path) -> None:
    """P_cr = 20.0509 (Beck 1952); below it nothing is unstable, though the symmetric part is."""
    below, above = beck(20.04, tmp_path), beck(20.06, tmp_path)
    assert below.growth is None and np.all(below.frequencies > 0)
    assert above.growth is not None and above.growth[0] == pytest.approx(-above.growth[1])
    assert np.max(above.growth) > 0 and above.frequencies[0] == above.frequencies[1]
    assert above.mechanism is not None
    assert not rest(below.mechanism).unstable and not rest(above.mechanism).unstable
    assert "flutter" in check(above.mechanism).frequency_note
    assert "flutter" not in check(below.mechanism).frequency_note


@pytest.mark.parametrize("hangs", [False, True], ids=["tie", "hook"])
def test_what_weight_stiffens_is_said_beside_linear_sag(hangs: bool, tmp_path: Path) -> None:
    """A tip under pull N and side force H: w = H/N (L - tanh(k L)/k), k^2 = N/EI; a load on a
    soft hinge stays below the tip. Linear statics have a third of H, and turn it with the tip.
    """
    pull, side, g, mass = 14.0, 1e-4, 1e-4, 5.0
    bodies = list(BEAM)
    head = f"forces: {{pull: {{at: tip, force: [{pull}, {side}, 0]}}}}\nplatform: tip\n"
    k, exact = np.sqrt(pull), np.array([0.0, -g * (mass / 3 + 1 / 8), 0.0])
    if hangs:
        bodies += [
            Body("load", "tip", "revolute", axis=(0, 0, 1), mass=mass, com=(0, -0.5, 0)),
            Body("hook", "load", xyz=(0, -0.5, 0)),
        ]
        head = "platform: hook\njoints: {load_joint: {spring: 1e-8}}\n"
    else:
        exact[1] = side / pull * (1 - np.tanh(k) / k)
    yaml = scene("{kind: craig_bampton, internal: 8}", head=head)
    if hangs:
        yaml = yaml.replace("gravity: [0, 0, 0]", f"gravity: [0, {-g}, 0]")
    found = check(load(tmp_path, bodies, yaml))
    sag = found.statics
    assert sag.loaded is not None and sag.linear is not None
    scale = abs(exact[1])
    # the stiffness is of home: the hook swings by the spring's 1e-8 / m g l of the tip's turn
    np.testing.assert_allclose(sag.loaded.position, exact, rtol=1e-4, atol=1e-3 * scale)
    assert np.abs(sag.linear.position - exact).max() > 0.2 * scale
    (said,) = [text for text in found.warnings if "linear statics" in text]
    assert "levels ked and coupled have it" in said


def test_large_sag_is_not_laid_on_weight(tmp_path: Path) -> None:
    yaml = scene(head="platform: tip\n").replace("gravity: [0, 0, 0]", "gravity: [0, -6, 0]")
    (said,) = [x for x in check(load(tmp_path, BEAM, yaml)).warnings if "linear statics" in x]
    assert "ked is off as well" in said
