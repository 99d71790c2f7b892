"""Closing loops: which rows are redundant, which poses are singular, what cannot close.

Claims:
    Equations
    - plane four-bar, spatial hinge: 3 redundant rows by name; Bricard 6R: rank 4 of 5 | IFToMM A04
      | exact | exact
    - stretched and flat four-bars, open loops refused by name | geometry | - | -
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from tests.scenes import Body, load

L1, L2, L3, L4 = 0.2, 0.5, 0.4, 0.6  # [m] crank, coupler, rocker, ground
ROD = {"mass": 0.3, "inertia": (1e-4, 1e-3, 1e-3)}


def four_bar(
    folder: Path, kind: str, home: Sequence[float] = (1.0, -0.5, 1.8), **lengths: float
) -> pf.Mechanism:
    """Crank at the origin, coupler on it, rocker at (L4, 0); closed at the coupler's end."""
    size = {"crank": L1, "coupler": L2, "rocker": L3, "ground": L4} | lengths
    bodies = (
        Body("crank", "base", "revolute", **ROD),
        Body("coupler", "crank", "revolute", xyz=(size["crank"], 0, 0), **ROD),
        Body("coupler_end", "coupler", xyz=(size["coupler"], 0, 0)),
        Body("rocker", "base", "revolute", xyz=(size["ground"], 0, 0), **ROD),
        Body("rocker_end", "rocker", xyz=(size["rocker"], 0, 0)),
    )
    yaml = f"""
gravity: [0, -9.81, 0]
actuated: [crank_joint]
loops: {{pin: {{kind: {kind}, between: [coupler_end, rocker_end]}}}}
home: {{crank_joint: {home[0]}, coupler_joint: {home[1]}, rocker_joint: {home[2]}}}
"""
    return load(folder, bodies, yaml)


def test_a_plane_four_bar_closed_by_a_spatial_hinge_names_three_redundant_rows(
    tmp_path: Path,
) -> None:
    m = four_bar(tmp_path, "revolute")
    assert (m.report.rows, m.report.rank, m.report.mobility) == (5, 2, 1)
    assert set(m.report.redundant) == {
        "pin: position along z",
        "pin: rotation about x",
        "pin: rotation about y",
    }
    plane = four_bar(tmp_path, "planar")
    assert (plane.report.rows, plane.report.rank, plane.report.redundant) == (2, 2, ())
    np.testing.assert_allclose(plane.home, m.home, atol=1e-10)
    motion = pf.cycloid(joints={"crank_joint": 1.0}, duration=0.4)
    torque = [pf.solve(x, motion, level="rigid", samples=41).torque for x in (m, plane)]
    np.testing.assert_allclose(torque[0], torque[1], rtol=1e-9)  # same forces, fewer rows


def test_a_bricard_linkage_moves_although_counting_says_it_cannot(tmp_path: Path) -> None:
    """benchmarks.md E, A04: rank 4 of 5, mobility 1 with six hinges in one loop."""
    points = np.array([(0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1)], float)
    axes = np.eye(3)[[1, 2, 0, 1, 2, 0]]
    bodies = []
    for k in range(5):
        offset = points[k] - points[k - 1] if k else points[0]
        rod = {
            "mass": 1.0,
            "com": tuple((points[k + 1] - points[k]) / 2),
            "inertia": (0.1, 0.1, 0.1),
        }
        bodies.append(
            Body(
                f"rod_{k}",
                f"rod_{k - 1}" if k else "base",
                "revolute",
                xyz=offset,
                axis=axes[k],
                **rod,
            )
        )
    bodies.append(Body("end", "rod_4", xyz=points[5] - points[4]))
    bodies.append(Body("ground", "base", xyz=points[5]))
    yaml = "actuated: []\nloops: {last: {kind: revolute, between: [end, ground], axis: x}}\n"
    m = load(tmp_path, bodies, yaml)
    assert (m.report.rows, m.report.rank, m.report.mobility) == (5, 4, 1)
    assert len(m.report.redundant) == 1
    assert m.report.redundant[0].startswith("last: ")


def test_a_flexible_loop_needs_the_rows_that_a_rigid_one_can_spare(tmp_path: Path) -> None:
    """Parallel flexure of two clamped beams: with rigid links all six rows are redundant."""
    bodies = (
        Body("left", "base"),
        Body("plate", "left", xyz=(1, 0, 0), mass=1.0, inertia=(1, 1, 1)),
        Body("right", "base", xyz=(0, 0.3, 0)),
        Body("right_end", "right", xyz=(1, 0, 0)),
        Body("plate_end", "plate", xyz=(0, 0.3, 0)),
    )
    yaml = """
actuated: []
loops: {weld: {kind: weld, between: [right_end, plate_end]}}
flexible:
  "left, right":
    material: {E: 1, nu: 0.3, rho: 1.0e-3}
    section: {shape: given, A: 1, Iy: 1, Iz: 1, J: 1}
    axial: true
    bending_y: true
    bending_z: true
    torsion: true
"""
    m = load(tmp_path, bodies, yaml)
    assert (m.report.rank, m.flexible_report.rank) == (0, 6)
    assert m.flexible_report.redundant == ()


def test_a_loop_that_cannot_close_is_named_with_its_gap(tmp_path: Path) -> None:
    with pytest.raises(pf.AssemblyError, match='loop "pin" does not close') as caught:
        four_bar(tmp_path, "planar", ground=2.0)
    # 0.2 + 0.5 + 0.4 of the 2.0 m can be covered.
    assert caught.value.gap == pytest.approx(0.9, abs=1e-6)


def test_a_stretched_four_bar_is_refused_as_singular_with_its_loop_and_motion(
    tmp_path: Path,
) -> None:
    """Crank in line with the coupler seen from the rocker's motor: the crank can move alone."""
    bodies = (
        Body("crank", "base", "revolute", **ROD),
        Body("coupler", "crank", "revolute", xyz=(0.2, 0, 0), **ROD),
        Body("coupler_end", "coupler", xyz=(0.5, 0, 0)),
        Body("rocker", "base", "revolute", xyz=(0.6, 0, 0), **ROD),
        Body("rocker_end", "rocker", xyz=(0.4, 0, 0)),
    )
    # Triangle 0.7, 0.4, 0.6: crank and coupler in line.
    angle = float(np.arccos((0.7**2 + 0.6**2 - 0.4**2) / (2 * 0.7 * 0.6)))
    rocker = float(np.arctan2(0.7 * np.sin(angle), 0.7 * np.cos(angle) - 0.6))
    yaml = f"""
actuated: [rocker_joint]
loops: {{pin: {{kind: planar, between: [coupler_end, rocker_end]}}}}
home: {{crank_joint: {angle!r}, coupler_joint: 0, rocker_joint: {rocker!r}}}
"""
    with pytest.raises(pf.SingularityError, match=r'loop "pin" can still move: .*crank') as caught:
        load(tmp_path, bodies, yaml)
    assert caught.value.loop == "pin"
    assert caught.value.sigma_min < 1e-6


def test_a_flat_parallelogram_is_refused_because_its_rank_drops_at_home(tmp_path: Path) -> None:
    """Change point: the rows of the pin are dependent there and nowhere near."""
    with pytest.raises(pf.SingularityError, match="rank 1 here and 2 beside it"):
        four_bar(tmp_path, "planar", (0, 0, 0), crank=0.2, coupler=0.6, rocker=0.2, ground=0.6)


def test_a_single_joint_can_be_in_a_loop(tmp_path: Path) -> None:
    """A hinged arm pinned at its end: one freedom, three rows of which one counts."""
    bodies = (
        Body("arm", "base", "revolute", axis=(0, 1, 0), mass=1.0, inertia=(1, 1, 1)),
        Body("end", "arm", xyz=(1, 0, 0)),
        Body("hook", "base", xyz=(1, 0, 0)),
    )
    yaml = "actuated: []\nloops: {pin: {kind: spherical, between: [end, hook]}}\n"
    m = load(tmp_path, bodies, yaml)
    assert (m.report.rank, m.report.mobility) == (1, 0)
