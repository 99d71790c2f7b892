"""A path that leaves the workspace names the links that are in line there.

Claims:
    Equations
    - a five-bar led out of reach: the arm that is stretched (sum of its links) or folded is named |
      geometry | 1e-6 m | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from tests.scenes import Body, load

CRANK, LEFT, RIGHT, APART = 0.144, 0.187, 0.214, 0.156  # [m]
ROD = {"mass": 0.1, "inertia": (1e-4, 1e-4, 1e-4)}


def five_bar(folder: Path, motion: str) -> pf.Mechanism:
    bodies = []
    for side, x, rod in (("l", -APART / 2, LEFT), ("r", APART / 2, RIGHT)):
        bodies += [
            Body(f"crank_{side}", "base", "revolute", (x, 0, 0), **ROD),
            Body(f"coupler_{side}", f"crank_{side}", "revolute", (CRANK, 0, 0), **ROD),
            Body(f"end_{side}", f"coupler_{side}", xyz=(rod, 0, 0)),
        ]
    yaml = f"""
actuated: [crank_l_joint, crank_r_joint]
platform: end_l
loops: {{pin: {{kind: planar, between: [end_l, end_r]}}}}
home: {{crank_l_joint: 2.2, coupler_l_joint: -1.2, crank_r_joint: 0.9, coupler_r_joint: 1.2}}
motion: {{kind: cycloid, {motion}, duration: 1}}
"""
    return load(folder, bodies, yaml)


@pytest.mark.parametrize("move", [(0.0, 0.3), (0.2, 0.0)])
def test_a_point_out_of_reach_names_the_links_that_are_stretched(
    move: tuple[float, float], tmp_path: Path
) -> None:
    m = five_bar(tmp_path, f"platform: {{x: {move[0]}, y: {move[1]}}}")
    with pytest.raises(
        pf.SingularityError, match="out of reach: crank_l and coupler_l are stretched"
    ) as caught:
        pf.solve(m, level="rigid", samples=21)
    start = (
        pf.solve(m, pf.hold(duration=0.1), level="rigid", samples=2).frame("end_l").position[0, :2]
    )
    s = caught.value.time  # a cycloid's share of the way at t of 1 s
    tip = start + (s - np.sin(2 * np.pi * s) / (2 * np.pi)) * np.array(move)
    # the left arm is as long as it can be; 24 halvings of a sample leave 1e-9 s
    assert np.hypot(*(tip - [-APART / 2, 0])) == pytest.approx(CRANK + LEFT, abs=1e-6)


def test_the_other_arm_is_named_through_its_loop_and_folded_arms_are_folded(tmp_path: Path) -> None:
    m = five_bar(tmp_path, "platform: {x: -0.3, y: 0.1}")
    with pytest.raises(pf.SingularityError, match="out of reach: .*r and .*r are stretched"):
        pf.solve(m, level="rigid", samples=21)
    # towards the left base: the inner limit of its arm is the difference of its links
    start = pf.solve(m, pf.hold(duration=0.1), level="rigid", samples=2).frame("end_l").position[0]
    inward = (np.array([-APART / 2, 0]) - start[:2]).tolist()
    m = five_bar(tmp_path, f"platform: {{x: {inward[0]!r}, y: {inward[1]!r}}}")
    with pytest.raises(pf.SingularityError, match="crank_l and coupler_l are folded"):
        pf.solve(m, level="rigid", samples=21)
