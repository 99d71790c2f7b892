"""Loops that close by themselves: no spurious half turns, limits, restarts, honest gaps.

Claims:
    Equations
    - loops close from afar: 8 kinds on the manifold; a weld half a turn off; the elbow inside the
      limits; other starts, always the same | geometry | 1e-9 | 1e-12
    - logarithm of the closure: its Jacobian | central differences | 2e-8 | passes
    - what cannot close: bars 50 mm too short, frames 0.3 rad apart | by hand | 1e-6 | passes
    - sigma_min of one five-bar at 0.1, 1 and 10 m | similarity | 1e-9 | passes
    - a wrong axis of a loop is told beside those of its neighbours | - | - | -
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.lab.scene import urdf
from pinflex.mechanics import assembly
from pinflex.mechanics.closure import LogClosure
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.studies.checking.check import check
from tests.scenes import Body, load

ROD = {"mass": 1.0, "inertia": (0.1, 0.1, 0.1)}


def limited(
    folder: Path, bodies: list[Body], yaml: str, limits: Mapping[str, tuple[float, float]]
) -> pf.Mechanism:
    """A scene whose revolute joints have limits."""
    text = urdf(bodies)
    for joint, (low, high) in limits.items():
        head, tail = text.split(f'<joint name="{joint}"')
        tail = tail.replace('lower="-1e3" upper="1e3"', f'lower="{low}" upper="{high}"', 1)
        text = f'{head}<joint name="{joint}"{tail}'
    (folder / "scene.urdf").write_text(text)
    (folder / "scene.yaml").write_text(f"urdf: scene.urdf\n{yaml}")
    return pf.load(folder / "scene.yaml")


def two_links(target: tuple[float, float]) -> list[Body]:
    """Two bars of 1 m in the plane, whose end is to meet a point."""
    return [
        Body("upper", "base", "revolute", **ROD),
        Body("lower", "upper", "revolute", (1, 0, 0), **ROD),
        Body("end", "lower", xyz=(1, 0, 0)),
        Body("goal", "base", xyz=(*target, 0)),
    ]


MEET = "actuated: []\nloops: {pin: {kind: planar, between: [end, goal]}}\n"

ARM = [  # seven freedoms that reach any pose near by, one of them a ball
    Body("j1", "base", "continuous", **ROD),
    Body("j2", "j1", "revolute", (0, 0, 0.3), axis=(0, 1, 0), **ROD),
    Body("j3", "j2", "revolute", (0, 0, 0.6), axis=(0, 1, 0), **ROD),
    Body("j4", "j3", "floating", (0.5, 0, 0), **ROD),
    Body("j5", "j4", "prismatic", (0.1, 0, 0), axis=(0.6, 0, 0.8), **ROD),
    Body("hand", "j5", xyz=(0, 0.05, 0), rpy=(0.3, 0.2, 0.1)),
    Body("hold", "base", xyz=(0.5, 0.1, 0.6), rpy=(0.4, 1.2, -2.0)),
]


@pytest.mark.parametrize(
    "kind",
    [
        "weld",
        "revolute",
        "prismatic",
        "cylindrical",
        "universal",
        "spherical",
        "planar",
        "distance",
    ],
)
def test_every_kind_closes_on_the_manifold_and_its_logarithm_has_the_right_jacobian(
    tmp_path: Path, kind: str
) -> None:
    more = ", length: 0.2" if kind == "distance" else ""
    yaml = f"""
actuated: []
joints: {{j4_joint: {{type: spherical}}}}
loops: {{tie: {{kind: {kind}, between: [hand, hold]{more}}}}}
"""
    m = load(tmp_path, ARM, yaml)
    dynamics = Equations(m.rigid)
    assert np.max(np.abs(dynamics.close(m.home)[0])) < 1e-12
    log = LogClosure(dynamics, 0.7)
    random = np.random.default_rng(1)
    for _ in range(4):
        y = dynamics.integrate(m.home, random.uniform(-2, 2, dynamics.n_rigid))
        if kind in ("revolute", "cylindrical"):
            log.signs[:] = random.choice([-1.0, 1.0])
        J, h = log.at(y)[1], 1e-6
        for k, axis in enumerate(np.eye(dynamics.n_rigid)):
            right, left = (log.at(dynamics.integrate(y, s * h * axis))[0] for s in (1, -1))
            # central differences: h^2 of truncation, 1e-16 / h of round-off
            np.testing.assert_allclose(J[:, k], (right - left) / (2 * h), atol=2e-8)


def test_a_weld_is_found_where_newton_on_sines_ends_half_a_turn_off(tmp_path: Path) -> None:
    """From angle 0 the perpendicular axes already fit, with two of them reversed."""
    bodies = (
        Body("arm", "base", "revolute", axis=(1, 0, 0), **ROD),
        Body("hand", "arm", "revolute", axis=(0, 1, 0), **ROD),
        Body("wall", "base", rpy=(np.pi, 0, 0)),
    )
    m = load(tmp_path, bodies, "actuated: []\nloops: {glue: {kind: weld, between: [hand, wall]}}\n")
    # R_x(a) R_y(b) = R_x(pi) has one solution a = pi, b = 0, and a = 0, b = pi turns z only.
    assert abs(np.cos(m.home[0]) + 1) < 1e-12
    assert abs(np.cos(m.home[1]) - 1) < 1e-12


def test_a_hinge_pin_may_come_from_either_side_but_a_search_wants_axes_alike(
    tmp_path: Path,
) -> None:
    """In the plane axes that point against each other stay so: that closes, as it always did."""
    bodies = [*two_links((1.0, 1.0))[:3], Body("goal", "base", xyz=(1, 1, 0), rpy=(np.pi, 0, 0))]
    hinge = "actuated: []\nloops: {pin: {kind: revolute, between: [end, goal]}}\nhome: {%s}"
    near = load(tmp_path, bodies, hinge % "upper_joint: 0.1, lower_joint: 1.4")
    np.testing.assert_allclose(near.home, [0, np.pi / 2], atol=1e-9)
    assert near.report.starts == 0


def test_of_two_elbows_the_one_inside_the_limits_is_taken(tmp_path: Path) -> None:
    """The end at (1, 1): (0, 90) or (90, -90) degrees."""
    bodies = two_links((1.0, 1.0))
    up, down = np.array([0, np.pi / 2]), np.array([np.pi / 2, -np.pi / 2])
    free = limited(tmp_path, bodies, MEET + "home: {upper_joint: 0.2}", {})
    np.testing.assert_allclose(free.home, down, atol=1e-9)
    held = limited(
        tmp_path, bodies, MEET + "home: {upper_joint: 0.2}", {"lower_joint": (-1.5, 2.0)}
    )
    np.testing.assert_allclose(held.home, up, atol=1e-9)
    assert held.report.starts > 0


def test_a_given_home_outside_the_limits_keeps_working(tmp_path: Path) -> None:
    yaml = f"{MEET}home: {{upper_joint: 0.1, lower_joint: 1.5}}\n"
    m = limited(tmp_path, two_links((1.0, 1.0)), yaml, {"lower_joint": (-2.0, 1.0)})
    np.testing.assert_allclose(m.home, [0, np.pi / 2], atol=1e-9)
    assert m.report.starts == 0


def test_limits_that_no_closed_pose_keeps_do_not_refuse_one(tmp_path: Path) -> None:
    yaml = f"{MEET}home: {{upper_joint: 0.2}}\n"
    m = limited(tmp_path, two_links((1.0, 1.0)), yaml, {"lower_joint": (-1.4, 1.4)})
    np.testing.assert_allclose(m.home, [np.pi / 2, -np.pi / 2], atol=1e-9)


def test_a_loop_that_needs_other_starts_is_found_and_always_the_same(tmp_path: Path) -> None:
    """The way from zero ends at the limit of the first bar, and the loop is still open there."""
    bodies = two_links((-1.0, -1.0))  # (180, 90) or (-90, -90) degrees
    bounds = {"upper_joint": (-1.0, 3.4), "lower_joint": (-2.0, 2.0)}
    poses = [limited(tmp_path, bodies, MEET, bounds) for _ in range(2)]
    np.testing.assert_allclose(poses[0].home, [np.pi, np.pi / 2], atol=1e-9)
    assert poses[0].report.starts > 1
    assert poses[0].home.tobytes() == poses[1].home.tobytes()


def test_motors_stay_where_they_were_put(tmp_path: Path) -> None:
    """A five-bar far from closed: the rods move, and a joint outside the loops does not."""
    bodies = (
        Body("crank_1", "base", "revolute", **ROD),
        Body("rod_1", "crank_1", "revolute", (1, 0, 0), **ROD),
        Body("end_1", "rod_1", xyz=(1, 0, 0)),
        Body("crank_2", "base", "revolute", (1, 0, 0), **ROD),
        Body("rod_2", "crank_2", "revolute", (1, 0, 0), **ROD),
        Body("end_2", "rod_2", xyz=(1, 0, 0)),
        Body("flag", "base", "revolute", (0, 1, 0), **ROD),
    )
    yaml = """
actuated: [crank_1_joint, crank_2_joint, flag_joint]
loops: {pin: {kind: planar, between: [end_1, end_2]}}
home: {crank_1_joint: 1.8, crank_2_joint: 1.2, rod_1_joint: 3.0}
"""
    m = load(tmp_path, bodies, yaml)
    at = dict(zip(m.coordinates, m.home, strict=True))
    assert (at["crank_1_joint"], at["crank_2_joint"], at["flag_joint"]) == (1.8, 1.2, 0.0)


LEFT, RIGHT, CRANK = 0.187, 0.214, 0.144


def stretched_five_bar(folder: Path, apart: float, more: str) -> dict[str, float]:
    """Cranks and couplers all along x at zero, their bases apart along x: closed home by name."""
    bodies = []
    for side, x, rod in (("l", -apart / 2, LEFT), ("r", apart / 2, RIGHT)):
        bodies += [
            Body(f"crank_{side}", "base", "revolute", (x, 0, 0), **ROD),
            Body(f"coupler_{side}", f"crank_{side}", "revolute", (CRANK, 0, 0), **ROD),
            Body(f"end_{side}", f"coupler_{side}", xyz=(rod, 0, 0)),
        ]
    yaml = f"""
actuated: [crank_l_joint, crank_r_joint]
loops: {{pin: {{kind: planar, between: [end_l, end_r]}}}}
{more}
"""
    m = load(folder, bodies, yaml)
    return dict(zip(m.coordinates, m.home, strict=True))


def test_motors_stay_at_zero_where_other_starts_of_the_rods_close(tmp_path: Path) -> None:
    """At zero the rods are in line, and no Newton step of theirs leaves the line."""
    at = stretched_five_bar(tmp_path, 0.156, "")
    assert (at["crank_l_joint"], at["crank_r_joint"]) == (0.0, 0.0)
    # the triangle of both rods over the 0.156 m between the cranks' ends
    right = np.arccos((LEFT**2 - RIGHT**2 - 0.156**2) / (2 * RIGHT * 0.156))
    assert abs(at["coupler_r_joint"]) == pytest.approx(right, abs=1e-9)


def test_of_closed_poses_the_nearest_is_taken_where_the_motors_have_to_move(tmp_path: Path) -> None:
    """Bases 0.6 m apart: against every pose that closes, on a grid of motor angles."""
    guess = np.array([1.0, 0.0, 0.0, 0.0])  # cranks, then rods, from the cranks' directions
    at = stretched_five_bar(tmp_path, 0.6, "home: {crank_l_joint: 1.0}")
    names = ("crank_l_joint", "crank_r_joint", "coupler_l_joint", "coupler_r_joint")
    weight = np.array([10.0, 10.0, 1.0, 1.0])  # a motor's way counts ten times
    found = np.linalg.norm(weight * (np.array([at[name] for name in names]) - guess))
    a, b = np.meshgrid(*2 * [np.linspace(-np.pi, np.pi, 361)])
    gap = 0.6 + CRANK * (np.exp(1j * b) - np.exp(1j * a))  # from the left crank's end
    size, nearest = np.abs(gap), np.inf
    closes = (size < LEFT + RIGHT) & (size > RIGHT - LEFT)
    a, b, gap, size = (values[closes] for values in (a, b, gap, size))
    cosine = (LEFT**2 + size**2 - RIGHT**2) / (2 * LEFT * size)
    for side in (1, -1):
        left = np.angle(gap) + side * np.arccos(cosine)
        right = np.angle(LEFT * np.exp(1j * left) - gap)
        turns = (np.angle(np.exp(1j * (left - a))), np.angle(np.exp(1j * (right - b))))
        ways = weight[:, None] * (np.stack([a, b, *turns]) - guess[:, None])
        nearest = min(nearest, np.linalg.norm(ways, axis=0).min())
    assert found < 1.02 * nearest  # steps of the grid of a degree: 10 * 0.017 of 22


def test_bars_too_short_by_five_centimetres_are_told_so(tmp_path: Path) -> None:
    with pytest.raises(pf.AssemblyError, match=r"stays open by 0\.05 m\.") as caught:
        load(tmp_path, two_links((2.05, 0.0)), MEET)
    assert (caught.value.loop, caught.value.turn) == ("pin", 0.0)
    assert caught.value.gap == pytest.approx(0.05, abs=1e-6)  # stretched, by hand
    assert caught.value.starts > 10


def test_a_rotation_that_cannot_close_is_told_in_radians(tmp_path: Path) -> None:
    """A hinge about z cannot undo a tilt of 0.3 rad about x."""
    bodies = (Body("arm", "base", "revolute", **ROD), Body("wall", "base", rpy=(0.3, 0, 0)))
    yaml = "actuated: []\nloops: {glue: {kind: weld, between: [arm, wall]}}\n"
    with pytest.raises(pf.AssemblyError, match=r"weld stays open by 0 m and 0\.3 rad\.") as caught:
        load(tmp_path, bodies, yaml)
    assert caught.value.turn == pytest.approx(0.3, abs=1e-6)


def five_bar(
    folder: Path, scale: float, loop: str = "kind: weld", pin: str = "revolute"
) -> pf.Mechanism:
    """Two motors, three hinges, closed by a weld: rows in m and in rad."""
    bodies = (
        Body("crank_1", "base", "revolute", **ROD),
        Body("rod_1", "crank_1", "revolute", (scale, 0, 0), **ROD),
        Body("pin", "rod_1", pin, (scale, 0, 0), **ROD),
        Body("crank_2", "base", "revolute", (scale, 0, 0), **ROD),
        Body("rod_2", "crank_2", "revolute", (scale, 0, 0), **ROD),
        Body("end", "rod_2", xyz=(scale, 0, 0)),
    )
    yaml = f"""
actuated: [crank_1_joint, crank_2_joint]
loops: {{tie: {{{loop}, between: [pin, end]}}}}
home: {{crank_1_joint: 2.0, rod_1_joint: -1.3, crank_2_joint: 1.1, rod_2_joint: 1.3}}
"""
    return load(folder, bodies, yaml)


def test_the_measure_of_singular_poses_has_no_unit(tmp_path: Path) -> None:
    """The same five-bar at 0.1, 1 and 10 m: one number."""
    sizes = [five_bar(tmp_path, scale).report.sigma_min for scale in (0.1, 1.0, 10.0)]
    # round-off of assembly, 1e-14 relative, times a condition number of about ten
    np.testing.assert_allclose(sizes, sizes[1], rtol=1e-9)
    assert 0.02 < sizes[1] < 0.5


def test_a_jacobian_of_full_rank_is_never_called_singular(tmp_path: Path) -> None:
    m = five_bar(tmp_path, 1.0)
    names = ("rod_1_joint", "pin_joint", "rod_2_joint")
    for ratio, words in (
        (1e-9, r"home: singular pose: .* has rank 2 of 3 \(sigma_min = 1e-09"),
        (1e-4, r"home: nearly singular pose: .* is losing rank \(sigma_min = 0\.0001"),
    ):
        J = np.diag([1.0, ratio, 0.5])
        error = assembly.singularity(J, m.rigid.closed, names, "home")
        assert re.search(words, str(error)), error
        assert "rank 3 of 3" not in str(error)
        assert "Give a `home` away from this pose." in str(error)  # there is no path yet
        moving = assembly.singularity(J, m.rigid.closed, names, "way back home", 0.2)
        assert "Choose a path that avoids this pose" in str(moving)
        assert error.motion == "pin_joint"
        assert error.sigma_min == pytest.approx(ratio)


def test_a_wrong_axis_of_a_loop_is_compared_with_its_neighbours(tmp_path: Path) -> None:
    hint = (
        r'axis of loop "tie" is 90 deg off the axes of its neighbours \(.*rod_2_joint.*\), which '
        r"are all parallel\. Write loops\.tie\.axis: z\."
    )
    m = five_bar(tmp_path, 1.0, "kind: revolute, axis: x", "fixed")
    assert re.search(hint, " ".join(check(m).warnings))
    with pytest.raises(pf.SingularityError, match=hint):  # another home ends in a singular pose
        pf.load(tmp_path / "scene.yaml", ["home=null"])


def test_hinges_that_rounding_turned_are_told_so(tmp_path: Path) -> None:
    """A parallelogram whose rocker is mounted by 1.57 for a right angle: 8e-4 rad off parallel."""
    right = 1.57
    bodies = (
        Body("crank", "base", "revolute", **ROD),
        Body("coupler", "crank", "revolute", (0.5, 0, 0), **ROD),
        Body("coupler_end", "coupler", xyz=(1.0, 0, 0)),
        Body("rocker", "base", "revolute", (1.0, 0, 0), (-right, 0, 0), axis=(0, -1, 0), **ROD),
        Body("rocker_end", "rocker", xyz=(0.5, 0, 0), rpy=(np.pi / 2, 0, 0)),
    )
    yaml = """
actuated: [crank_joint]
loops: {pin: {kind: KIND, between: [coupler_end, rocker_end], axis: z}}
home: {crank_joint: 1.0, coupler_joint: -1.0, rocker_joint: 1.0}
"""
    said = (
        r'around loop "pin" \(.*rocker_joint.*\) are up to 0\.0008 rad off parallel.*kind: planar'
    )
    with pytest.raises(pf.AssemblyError, match=said):
        load(tmp_path, bodies, yaml.replace("KIND", "revolute"))
    assert load(tmp_path, bodies, yaml.replace("KIND", "planar")).report.mobility == 1
    turned = (*bodies[:-1], Body("rocker_end", "rocker", xyz=(0.5, 0, 0)))
    with pytest.raises(pf.AssemblyError, match="90 deg off the axes.*Turn one of the frames"):
        load(tmp_path, [replace(b, rpy=(-np.pi / 2, 0, 0)) if b.rpy == (-right, 0, 0) else b
                        for b in turned], yaml.replace("KIND", "revolute"))  # fmt: skip
