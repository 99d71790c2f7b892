"""Loops that are open by the last digits of a drawing, in directions that no joint moves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinflex as pf
from tests.scenes import Body, load

ROD: dict[str, Any] = {"mass": 0.3, "com": (0.2, 0, 0), "inertia": (1e-4, 1e-3, 1e-3)}
SIZE = 0.6  # [m]
SWING = pf.cycloid(joints={"crank_joint": 1.0}, duration=0.4)
SOFT = """
flexible:
  "coupler, rocker":
    material: aluminium
    section: {shape: tube, diameter: 0.02, wall: 0.002}
"""


def four_bar(
    folder: Path,
    off: tuple[float, float, float] = (0, 0, 0),
    tilt: tuple[float, float, float] = (0, 0, 0),
    kind: str = "revolute",
    more: str = "",
) -> pf.Mechanism:
    """Crank, coupler and rocker in the plane, closed by a spatial joint off its place by `off`."""
    bodies = (
        Body("crank", "base", "revolute", **ROD),
        Body("coupler", "crank", "revolute", xyz=(0.2, 0, 0), **ROD),
        Body("coupler_end", "coupler", xyz=(0.5, 0, 0)),
        Body("rocker", "base", "revolute", xyz=(SIZE, 0, 0), rpy=tilt, **ROD),
        Body("rocker_end", "rocker", xyz=(0.4 + off[0], off[1], off[2])),
    )
    yaml = f"""
gravity: [0, -9.81, 0]
actuated: [crank_joint]
loops: {{pin: {{kind: {kind}, between: [coupler_end, rocker_end]}}}}
home: {{crank_joint: 1.0, coupler_joint: -0.5, rocker_joint: 1.8}}
{more}"""
    return load(folder, bodies, yaml)


@pytest.mark.parametrize("gap", [1e-9, 1e-6, 1e-4])
def test_a_pin_beside_its_hole_moves_like_the_pin_in_the_plane(tmp_path: Path, gap: float) -> None:
    """The reference holds two rows only (`planar`), which never see the gap."""
    m = four_bar(tmp_path, (0, 0, gap))
    assert m.report.gaps["pin"] == pytest.approx((gap, 0.0), rel=1e-6, abs=1e-15)
    assert m.report.mobility == 1
    plane = four_bar(tmp_path, (0, 0, gap), kind="planar")
    assert not plane.report.gaps
    runs = [pf.solve(x, SWING, level="rigid", samples=21) for x in (m, plane)]
    np.testing.assert_allclose(runs[0].torque, runs[1].torque, atol=1e-11)
    np.testing.assert_allclose(m.home, plane.home, atol=1e-11)
    worth = gap > 1e-8  # less is what the digits of a file leave
    for warnings in (runs[0].meta["warnings"], pf.check(m).warnings):
        assert any("open at home" in said and "pin" in said for said in warnings) == worth


@pytest.mark.parametrize("gap", [1e-9, 1e-6, 1e-4])
def test_a_gap_that_is_built_in_bears_no_force_of_its_own(tmp_path: Path, gap: float) -> None:
    """Pulled shut the rods would bear EI gap / L^3, N; the plane's forces an arm of the gap."""
    exact, open_ = (four_bar(tmp_path, (0, 0, e), more=SOFT) for e in (0.0, gap))
    runs = [pf.solve(m, SWING, level="quasistatic", samples=21) for m in (exact, open_)]
    pulls = [run.loop("pin").wrench for run in runs]
    largest = float(np.abs(pulls[0]).max())
    # 1 N in the plane at arms of `gap`, and what these bend: a few times gap / m of it.
    np.testing.assert_allclose(pulls[0], pulls[1], atol=3 * gap * largest + 1e-9)
    np.testing.assert_allclose(runs[0].torque, runs[1].torque, rtol=1e-6)


@pytest.mark.parametrize("more", ["", SOFT])
@pytest.mark.parametrize(("off", "said"), [(1e-2 * SIZE, "0.006 m"), (0.2, "0.2 m")])
def test_a_gross_gap_is_refused_with_its_number(
    tmp_path: Path, off: float, said: str, more: str
) -> None:
    with pytest.raises(pf.AssemblyError, match=said) as caught:
        four_bar(tmp_path, (0, 0, off), more=more)
    assert caught.value.gap == pytest.approx(off, rel=1e-6)


def test_six_decimals_of_a_tilt_are_built_in_and_a_real_tilt_is_refused(tmp_path: Path) -> None:
    m = four_bar(tmp_path, tilt=(1e-6, 2e-6, 0), more=SOFT)
    assert m.report.gaps["pin"][1] == pytest.approx(np.hypot(1e-6, 2e-6), rel=1e-6)
    assert (m.report.mobility, m.flexible_report.rank) == (1, 2)
    exact = four_bar(tmp_path, more=SOFT)
    for level in ("rigid", "quasistatic"):
        torques = [pf.solve(x, SWING, level=level, samples=21).torque for x in (m, exact)]
        np.testing.assert_allclose(*torques, rtol=1e-5)
    with pytest.raises(pf.AssemblyError, match="0.000224 rad"):
        four_bar(tmp_path, tilt=(1e-4, 2e-4, 0))


def test_a_stretched_loop_that_is_short_by_a_micrometre_is_no_gap_to_build_in(
    tmp_path: Path,
) -> None:
    """Crank, coupler and rocker in one line from pivot to pivot, 1e-6 m too short: it cannot be."""
    bodies = (
        Body("crank", "base", "revolute", **ROD),
        Body("coupler", "crank", "revolute", xyz=(0.2, 0, 0), **ROD),
        Body("coupler_end", "coupler", xyz=(0.5, 0, 0)),
        Body("rocker", "base", "revolute", xyz=(1.1 + 1e-6, 0, 0), **ROD),
        Body("rocker_end", "rocker", xyz=(0.4, 0, 0)),
    )
    yaml = """
actuated: [crank_joint]
loops: {pin: {kind: revolute, between: [coupler_end, rocker_end]}}
home: {rocker_joint: 3.141592653589793}
"""
    with pytest.raises(pf.AssemblyError, match="stays open by 1e-06 m"):
        load(tmp_path, bodies, yaml)


def test_a_weld_between_two_clamped_beams_takes_up_the_gap_unstressed(tmp_path: Path) -> None:
    """No joint at all: a parallel flexure whose ends miss each other by 1 um and 1e-6 rad."""
    bodies = (
        Body("left", "base"),
        Body("plate", "left", xyz=(1, 0, 0), mass=1.0, inertia=(1, 1, 1)),
        Body("right", "base", xyz=(0, 0.3, 0)),
        Body("right_end", "right", xyz=(1, 0, 1e-6)),
        Body("plate_end", "plate", xyz=(0, 0.3, 0), rpy=(0, 1e-6, 0)),
    )
    yaml = """
actuated: []
gravity: [0, 0, 0]
loops: {weld: {kind: weld, between: [right_end, plate_end]}}
flexible:
  left: &beam
    material: {E: 1.0e+9, nu: 0.3, rho: 1.0e+3}
    section: {shape: given, A: 1.0e-4, Iy: 1.0e-9, Iz: 1.0e-9, J: 2.0e-9}
    axial: true
    bending_y: true
    bending_z: true
    torsion: true
    end: plate
  right: {<<: *beam, end: right_end}
"""
    m = load(tmp_path, bodies, yaml)
    assert m.report.gaps["weld"] == pytest.approx((1e-6, 1e-6), rel=1e-6)
    assert (m.report.rank, m.flexible_report.rank) == (0, 6)
    run = pf.solve(m, pf.hold(duration=0.1), level="quasistatic", samples=3)
    # Closed by force: 12 EI / L^3 1e-6 m / 2 = 6e-6 N.
    assert float(np.abs(run.loop("weld").wrench).max()) < 1e-12


def test_a_distance_between_parallel_links_is_taken_as_it_is(tmp_path: Path) -> None:
    """A parallelogram with a second coupling rod: its length is one too many, and 1 um too long."""
    bodies = (
        Body("crank", "base", "revolute", **ROD),
        Body("coupler", "crank", "revolute", xyz=(0, 0.3, 0), **ROD),
        Body("end", "coupler", xyz=(0.5, 0, 0)),
        Body("rocker", "base", "revolute", xyz=(0.5, 0, 0), **ROD),
        Body("rocker_end", "rocker", xyz=(0, 0.3, 0)),
        Body("low", "crank", xyz=(0, 0.15, 0)),
        Body("high", "rocker", xyz=(0, 0.15, 0)),
    )
    yaml = """
actuated: [crank_joint]
loops:
  pin: {kind: planar, between: [end, rocker_end]}
  rod: {kind: distance, between: [low, high], length: 0.500001}
home: {crank_joint: 0.3, coupler_joint: -0.3, rocker_joint: 0.3}
"""
    m = load(tmp_path, bodies, yaml)
    assert m.report.gaps["rod"][0] == pytest.approx(1e-6, rel=1e-3)
    assert m.report.mobility == 1
