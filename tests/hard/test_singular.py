"""Singular poses are named, redundant loops are solved: no wrong number, no traceback.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - a run goes on beyond a pose that is singular for the rigid mechanism only, whose poses are
      left out and said | - | 1e-9 (closed) | passes
    Hard cases
    - type 2: lost command named with its time, three levels; race_r2's singular variant | 0.02 rad;
      <= 0.103 s | passes
    - type 1, end of reach; a singular home; coupled through a lost command | named error | passes
    - change points of a free four-bar, 5 s at 1 ms | 2e-6 m | 2e-7
    - plane four-bars in 3-D: six redundant rows, motion as without, reactions flagged | 1e-9 |
      passes
    - Bricard: rank 4 of 5 along the path | 1e-9 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.lab.loops import SPEEDS, bricard, four_bars, four_bars_exact
from tests.scenes import Body, load

BAR = (1.0, (0.5, 0, 0), (1e-3, 1 / 12, 1 / 12))


def five_bar(folder: Path, home: str, extra: str = "") -> pf.Mechanism:
    """Two motors 1 m apart, four bars of 1 m."""
    mass, com, inertia = BAR
    bodies = []
    for side, x in (("left", 0.0), ("right", 1.0)):
        bodies += [
            Body(f"{side}_crank", "base", "revolute", (x, 0, 0), mass=mass, com=com,
                 inertia=inertia),
            Body(f"{side}_rod", f"{side}_crank", "revolute", (1, 0, 0), mass=mass, com=com,
                 inertia=inertia),
            Body(f"{side}_end", f"{side}_rod", xyz=(1, 0, 0)),
        ]  # fmt: skip
    yaml = f"""
gravity: [0, 0, 0]
actuated: [left_crank_joint, right_crank_joint]
loops: {{pin: {{kind: planar, between: [left_end, right_end]}}}}
platform: left_end
home: {{{home}}}
{extra}
"""
    return load(folder, bodies, yaml)


UPRIGHT = (
    "left_crank_joint: 1.5708, left_rod_joint: -1.0472, "
    "right_crank_joint: 1.5708, right_rod_joint: 1.0472"
)


def test_a_pose_where_locked_motors_do_not_hold_is_named_with_its_time(tmp_path: Path) -> None:
    """Type 2: the cranks part until the rods lie in one line, and the pin may go up or down."""
    m = five_bar(tmp_path, UPRIGHT)
    apart = pf.quintic(joints={"left_crank_joint": 1.2, "right_crank_joint": -1.2}, duration=1.0)
    for level in ("rigid", "ked", "quasistatic"):
        with pytest.raises(pf.SingularityError, match=r'loop "pin" can still move') as caught:
            pf.solve(m, apart, level=level, dt=1e-2, samples=101)
        # Elbows 2 m apart: 1 + 2 sin(turn) = 2 at a turn of 30 deg.
        turned = apart.evaluate(np.array([caught.value.time]))[0][0, 0]
        assert turned == pytest.approx(np.pi / 6, abs=0.02)
        assert caught.value.sigma_min < 1e-2


def test_a_pose_at_the_end_of_reach_is_named(tmp_path: Path) -> None:
    """Type 1: the platform is asked beyond the stretched left arm."""
    m = five_bar(tmp_path, UPRIGHT)
    up = pf.quintic(platform={"x": 0.0, "y": 1.0}, duration=1.0)
    with pytest.raises((pf.SingularityError, pf.MotionError), match=r"t = 0\.\d+ s"):
        pf.solve(m, up, level="rigid", samples=101)


def test_a_home_in_a_singular_pose_is_refused(tmp_path: Path) -> None:
    flat = (
        "left_crank_joint: 2.0943951023931953, left_rod_joint: -2.0943951023931953, "
        "right_crank_joint: 1.0471975511965976, right_rod_joint: 2.0943951023931953"
    )
    with pytest.raises(pf.SingularityError, match="rank 1 of 2"):
        five_bar(tmp_path, flat)


def test_the_singular_variant_of_race_r2_is_named_before_103_ms() -> None:
    changes = ["flexible.*.section.thickness=1.5e-3"]
    changes += [f"motion.joints.motor_{k}={x}" for k, x in ((1, 0.2), (2, -0.1), (3, 0.05))]
    m = pf.load("race_r2", changes)
    for level in ("rigid", "ked"):
        with pytest.raises(pf.SingularityError, match="can still move") as caught:
            pf.solve(m, level=level)
        assert 0.09 < caught.value.time <= 0.103


def test_coupled_through_a_lost_command_ends_in_a_named_error_or_closed_loops(
    tmp_path: Path,
) -> None:
    m = five_bar(tmp_path, UPRIGHT)
    apart = pf.quintic(joints={"left_crank_joint": 1.2, "right_crank_joint": -1.2}, duration=1.0)
    with pytest.raises(pf.SceneError) as caught:
        pf.solve(m, apart, level="coupled", dt=1e-3)
    assert "t = 0." in str(caught.value)


RODS = """flexible:
  "*_rod":
    material: {E: 2e9, nu: 0.3, rho: urdf}
    section: {shape: rectangle, width: 0.05, thickness: 0.02}
    axial: true
    damping: {modal: 0.05}
"""


def test_a_run_goes_on_where_only_the_rigid_machine_is_stuck(tmp_path: Path) -> None:
    """The elbows part by half a millimetre more than two rods reach: flexible ones stretch."""
    m = five_bar(tmp_path, UPRIGHT, RODS)
    turn = float(np.arcsin((2.0005 - 1) / 2))
    apart = pf.quintic(joints={"left_crank_joint": turn, "right_crank_joint": -turn}, duration=1.0)
    run = pf.solve(m, apart, level="coupled", dt=2e-3, samples=101)
    assert run.t[-1] == 1.0 and run.array("residual/closure").max() < 1e-9
    (said,) = [w for w in run.meta["warnings"] if "rigid poses are left out" in w]
    assert 'at a singular pose of loop "pin"' in said and "from t = 0.96" in said
    # As long as there is a rigid machine, its pose is the one beside the run.
    rigid = pf.solve(m, apart, level="rigid", until=0.9, samples=91)
    poses = [r.array("body/left_crank/pose_rigid")[:91] for r in (run, rigid)]
    np.testing.assert_allclose(*poses, atol=1e-9)
    assert np.isfinite(run.link("left_rod").centreline_rigid).all()


@pytest.mark.parametrize("kind", ["planar", "revolute"])
def test_a_free_four_bar_passes_its_change_points_on_the_symmetric_branch(kind: str) -> None:
    m = four_bars(2, kind)
    # With Newton's usual 1e-7 the change points magnify what it leaves: 0.6 to 3e-6, by round-off.
    r = pf.solve(m, pf.hold(duration=5.0), "coupled", dt=1e-3, samples=2, start_speeds=SPEEDS,
                 tolerance=1e-10)  # fmt: skip
    found = r.frame("tip_0").position[-1, :2]
    # 9.7e-7 measured: second order at 1 ms through three change points.
    np.testing.assert_allclose(found, four_bars_exact(2, np.array([5.0]))[0], atol=2e-6)
    # Hinges in 3-D bring three redundant rows each, found by rank.
    assert len(m.report.redundant) == (6 if kind == "revolute" else 0)


def test_redundant_reactions_are_flagged_and_the_motion_is_that_without_them() -> None:
    plain, full = (four_bars(2, kind) for kind in ("planar", "revolute"))
    runs = [pf.solve(m, pf.hold(duration=0.3), level="coupled", dt=1e-3) for m in (plain, full)]
    np.testing.assert_allclose(runs[0].arrays["joint/q"], runs[1].arrays["joint/q"], atol=1e-9)
    assert any("not unique" in w for w in runs[1].meta["warnings"])
    assert not any("not unique" in w for w in runs[0].meta["warnings"])


def test_bricard_keeps_rank_four_of_five_along_the_whole_path() -> None:
    m = bricard()
    assert (m.report.rows, m.report.rank, m.report.mobility) == (5, 4, 1)
    from dataclasses import replace

    from pinflex.mechanics.closure import closures
    from pinflex.mechanics.evaluation.equations import Equations

    r = pf.solve(m, pf.hold(duration=2.0), "coupled", dt=2e-3, samples=21)
    # The row that was left out is in no output: closures as the file has them.
    every = closures(m.description.loops, m.flexible.expansion.frames, m.flexible.expansion.model)
    d = Equations(replace(m.flexible, closed=every))
    for y in r.array("joint/q"):
        c, J = d.close(y)
        sigma = np.linalg.svd(J, compute_uv=False)
        # The row that was left out stays closed too: the fifth value is round-off.
        assert sigma[4] < 1e-9 * sigma[0] < 1e-6 * sigma[3]
        assert np.abs(c).max() < 1e-9


def test_a_tight_tolerance_does_not_stop_at_the_round_off_of_a_flat_pose() -> None:
    """Step 1429 ends 7e-4 rad from it, where round-off of closures moves rods by 1e3 times that."""
    m = four_bars(2)
    r = pf.solve(m, pf.hold(duration=1.0), "coupled", dt=5e-4, samples=2, start_speeds=SPEEDS,
                 tolerance=1e-10)  # fmt: skip
    place = r.frame("tip_0").position[-1, :2]
    exact = four_bars_exact(2, np.array([0.0, 1.0]))[1]
    assert np.linalg.norm(place - exact) < 1e-6  # second order at 0.5 ms; measured 6e-8
