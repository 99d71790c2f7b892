"""What makes a scene spatial: everything that acts out of the plane of the joints.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - axes of a base turned twice, and shares in them; stretch of two pieces counts together |
      Pinocchio; energies of a bar pushed beside its axis | 1e-12, 1e-9; decided | passes
    Many cases
    - an oblique section leaves the plane of the joints and twists, a round one does not; one
      bending off: plane; a following load along a bar is all stretch | by hand | exact | exact
    - a force along the joint of a plane arm sags F L^3/3EI, a moment about it twists M L/GJ, by
      default | closed form | 2e-5 (second order of 1 mm in 1 m); 1e-9 | passes (both were 0)
    - loads, springs, patches, added masses, start speeds: in the plane it stays plane, out of it
      not; a turned robot alike | symmetry | exact; 1e-9 m | passes
    - a slider-crank is plane; one whose slider leaves the plane is not. Its frequencies are among
      those of the same beams free to leave it, and torques are theirs | symmetry | 1e-9 | passes
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.mechanics.model.relevance import base_axes, shares
from tests.scenes import Body, load

E, IY, IZ, J = 7.0e10, 2.5e-9, 8.0e-10, 2.0e-9
G = E / 2.6
ARM = f"""
    material: {{E: {E}, nu: 0.3, rho: 2700}}
    section: {{shape: given, A: 4.0e-4, Iy: {IY}, Iz: {IZ}, J: {J}}}
    end: tip
"""
TILTED = (0.3, -0.7, 1.1)  # rad, roll pitch yaw of the whole robot


def arm(
    folder: Path,
    acts: str = "",
    rpy: tuple[float, ...] = (0, 0, 0),
    floor: tuple[float, ...] = (0, 0, 0),
) -> pf.Mechanism:
    """A bar of 1 m along x on a motor about y, welded to a base that may be turned, twice."""
    bodies = (
        Body("floor", "base", rpy=floor),
        Body("foot", "floor", rpy=rpy),
        Body("post", "foot", xyz=(1, 0, 0.5)),
        Body("aside", "foot", xyz=(1, 0.5, 0)),
        Body("arm", "foot", "revolute", axis=(0, 1, 0), mass=1.08, com=(0.5, 0, 0),
             inertia=(1e-5, 0.09, 0.09)),
        Body("tip", "arm", xyz=(1, 0, 0)),
    )  # fmt: skip
    words = f"gravity: [0, 0, 0]\nactuated: [arm_joint]\nplatform: tip\n{acts}\nflexible:\n  arm:"
    return load(folder, bodies, f"{words}{ARM}motion: {{kind: hold, duration: 0.1}}\n")


def rests(m: pf.Mechanism) -> tuple[np.ndarray, np.ndarray]:
    """Place and rotation of the tip in equilibrium."""
    pose = pf.solve(m, level="quasistatic", dt=0.05).frame("tip")
    return np.asarray(pose.position)[-1], np.asarray(pose.rotation)[-1]


def test_a_force_along_the_joint_sags(tmp_path: Path) -> None:
    place, _ = rests(arm(tmp_path, "forces: {push: {at: tip, force: [0, 0.5, 0]}}"))
    # 2e-5: the sag is 1 mm of 1 m, and its next term is of second order in that
    assert place[1] == pytest.approx(0.5 / (3 * E * IY), rel=2e-5)


def test_a_moment_about_the_beam_twists(tmp_path: Path) -> None:
    _, turn = rests(arm(tmp_path, "forces: {push: {at: tip, moment: [0.2, 0, 0]}}"))
    # 1e-9: Saint-Venant's twist is linear
    assert np.arctan2(turn[2, 1], turn[2, 2]) == pytest.approx(0.2 / (G * J), rel=1e-9)


@pytest.mark.parametrize(
    ("acts", "planar"),
    [
        ("", True),
        ("forces: {f: {at: tip, force: [3, 0, 5], moment: [0, 2, 0]}}", True),
        ("forces: {f: {at: tip, force: [3, 0, 5], follower: true, start: 0.1}}", True),
        ("forces: {f: {at: tip, force: [0, 5, 0], start: 0.1}}", False),
        ("forces: {f: {at: tip, force: [0, 5, 0], follower: true}}", False),
        ("forces: {f: {at: tip, moment: [0, 0, 1]}}", False),
        ("springs: {s: {between: [tip, post], stiffness: 10}}", True),
        ("springs: {s: {between: [tip, aside], stiffness: 10}}", False),
        ("springs: {s: {between: [tip, aside], stiffness: 0, damper: 3}}", False),
        ("added_masses: {water: {at: tip, mass: [1, 3, 2], inertia: [1, 2, 3]}}", True),
        ("added_masses: {water: {at: aside, mass: [1, 3, 2]}}", False),
        ("solve: {start_speeds: {tip: [0, null, 1]}}", True),
        ("solve: {start_speeds: {tip: [0, 1, 0]}}", False),
    ],
)
def test_all_that_acts_is_seen_and_nothing_else(tmp_path: Path, acts: str, planar: bool) -> None:
    part = arm(tmp_path, acts).parts["arm"]
    assert part.planes == (("u", "v") if planar else ("u", "v", "w", "p"))
    assert part.reason.startswith("planar" if planar else "spatial scene: ")


@pytest.mark.parametrize("along", [(0.0, 0.0, 5.0), (0.0, 5.0, 0.0)])
def test_a_turned_robot_is_decided_alike(tmp_path: Path, along: tuple[float, ...]) -> None:
    """A force that turns with the base: the same planes, the same deflection seen from there."""
    R = pin.rpy.rpyToMatrix(*TILTED)
    straight = arm(tmp_path, f"forces: {{f: {{at: tip, force: {list(along)}}}}}")
    turned = arm(tmp_path, f"forces: {{f: {{at: tip, force: {(R @ along).tolist()}}}}}", TILTED)
    assert straight.parts["arm"].planes == turned.parts["arm"].planes
    assert straight.parts["arm"].left_out == turned.parts["arm"].left_out
    # 1e-9 m: Newton's iteration of the balance stops there
    assert rests(turned)[0] == pytest.approx(R @ rests(straight)[0], abs=1e-9)


def test_a_base_turned_twice_is_turned_by_the_first_and_then_the_second(tmp_path: Path) -> None:
    """Axes of the foot by Pinocchio, and the same shares in all that those axes name."""
    floor = (0.4, 0.9, -0.5)
    m = arm(tmp_path, rpy=TILTED, floor=floor)
    R = pin.rpy.rpyToMatrix(*floor) @ pin.rpy.rpyToMatrix(*TILTED)
    np.testing.assert_allclose(base_axes(m.links, m.parts), R, atol=1e-12)
    every = [f"flexible.arm.{key}=true" for key in ("axial", "bending_y", "bending_z", "torsion")]
    both = [pf.load(x.description, every) for x in (m, arm(tmp_path))]
    turned, straight = (shares(x.description, x.links, x.parts, x.flexible, x.home) for x in both)
    for case in straight:
        for key, share in straight[case].items():
            assert turned[case][key] == pytest.approx(share, abs=1e-9), (case, key)


@pytest.mark.parametrize("middle", [0.5, 0.45])
@pytest.mark.parametrize(("share", "kept"), [(1.5e-3, True), (0.8e-3, False)])
def test_what_pieces_cost_together_counts(
    middle: float, share: float, kept: bool, tmp_path: Path
) -> None:
    """A bar of two pieces, alike or not, pushed beside its axis: each stretches by half of that.

    Under a push F at a distance h its stretch bears F^2 L / EA, its bending F^2 h^2 L / EI.
    """
    h = float(np.sqrt((1.0 / share - 1.0) * IZ / 4.0e-4))
    bodies = (
        Body("one", "base"),
        Body("two", "one", xyz=(middle, 0, 0)),
        Body("corner", "two", xyz=(1.0 - middle, 0, 0)),
        Body("tip", "corner", xyz=(0, h, 0)),
    )
    bar = f"{ARM}    bending_z: false\n    torsion: false\n    up: [0, 0, 1]\n"
    words = "gravity: [0, 0, 0]\nactuated: []\nplatform: tip\nflexible:\n"
    words += f"  one:{bar.replace('tip', 'two')}  two:{bar.replace('tip', 'corner')}"
    m = load(tmp_path, bodies, words)
    assert [("u" in part.planes) for part in m.parts.values()].count(True) == (
        0 if not kept else 2 if middle == 0.5 else 1  # the shorter one alone costs too little
    )


def test_a_patch_across_the_joints_is_seen(tmp_path: Path) -> None:
    m = arm(tmp_path).description
    patch = "flexible.arm.patches={p: {from: 0.1, to: 0.3, constant: 0.01}}"
    assert pf.load(m, [patch]).parts["arm"].planes == ("u", "v")
    across = pf.load(m, [patch, "flexible.arm.up=[0, 0, 1]"])
    assert across.parts["arm"].planes == ("u", "v", "w", "p")


def test_a_column_under_a_plane_arm_bends_and_twists(tmp_path: Path) -> None:
    """It stands across the plane of the joint: nothing of it may be left out by symmetry."""
    bodies = (
        Body("column", "base", mass=1.0, com=(0, 0, 0.5), inertia=(0.09, 0.09, 1e-5)),
        Body("arm", "column", "revolute", xyz=(0, 0, 1), mass=1.0, com=(0.3, 0, 0),
             inertia=(1e-4, 0.01, 0.01)),
    )  # fmt: skip
    bar = ARM.replace("tip", "arm")
    words = f"gravity: [0, 0, 0]\nactuated: [arm_joint]\nplatform: arm\nflexible:\n  column:{bar}"
    planes = load(tmp_path, bodies, words).parts["column"].planes
    assert {"v", "w", "p"} <= set(planes)


def test_an_oblique_section_leaves_the_plane_and_a_round_one_does_not(tmp_path: Path) -> None:
    """Bent in the plane, principal axes across it bend it out of it, and what bends so twists."""
    m = arm(tmp_path).description
    oblique = "flexible.arm.up=[0, 1, 2]"
    assert pf.load(m, [oblique]).parts["arm"].planes == ("u", "v", "w", "p")
    round_one = f"flexible.arm.section.Iz={IY}"
    assert "p" not in pf.load(m, [oblique, round_one]).parts["arm"].planes


def test_who_takes_a_bending_away_has_made_the_scene_plane(tmp_path: Path) -> None:
    m = arm(tmp_path, "forces: {f: {at: tip, force: [3, 5, 5]}}").description
    for value, planes in (("false", ("u", "v")), ("true", ("u", "v", "w", "p"))):
        assert pf.load(m, [f"flexible.arm.bending_z={value}"]).parts["arm"].planes == planes


def test_a_following_load_that_comes_later_pulls_along_its_frame(tmp_path: Path) -> None:
    """Along the bar, however the robot stands: all of its energy is stretch."""
    pull = "forces: {f: {at: tip, force: [7, 0, 0], follower: true, start: 0.05}}"
    m = arm(tmp_path, pull, TILTED)
    every = [f"flexible.arm.{key}=true" for key in ("axial", "bending_y", "bending_z", "torsion")]
    m = pf.load(m.description, every)
    found = shares(m.description, m.links, m.parts, m.flexible, m.home)["load f"]
    assert found["arm", "u"] == pytest.approx(1.0, rel=1e-9)
    assert max(abs(found["arm", d]) for d in "vwp") < 1e-9


SPATIAL = [f"flexible.rod.{key}=true" for key in ("axial", "bending_y", "bending_z", "torsion")]


def slider_crank(folder: Path, axis: tuple[float, ...], overrides: Sequence[str]) -> pf.Mechanism:
    """A crank of 0.2 m, a rod of 0.6 m, and a block that slides; gravity along -z."""
    bodies = (
        Body("crank", "base", "revolute", axis=(0, 1, 0), mass=0.4, com=(0.1, 0, 0),
             inertia=(1e-5, 2e-3, 2e-3)),
        Body("rod", "crank", "revolute", xyz=(0.2, 0, 0), axis=(0, 1, 0), mass=0.6),
        Body("tip", "rod", xyz=(0.6, 0, 0)),
        Body("block", "base", "prismatic", xyz=(0.7, 0, 0), axis=axis, mass=1.5,
             inertia=(1e-3, 1e-3, 1e-3)),
    )  # fmt: skip
    words = (
        "gravity: [0, 0, -9.81]\nactuated: [crank_joint]\n"
        "home: {crank_joint: -0.8, rod_joint: 1.1}\n"
        "loops: {pin: {kind: revolute, between: [tip, block], axis: y}}\n"
        "motion: {kind: quintic, joints: {crank_joint: -2.0}, duration: 0.2}\nflexible:\n  rod:"
    )
    return load(folder, bodies, words + ARM, overrides)


def test_sliders_in_the_plane_leave_it_plane(tmp_path: Path) -> None:
    """A reflection: the beam that may leave the plane has the same motions in it."""
    plane, spatial = (slider_crank(tmp_path, (1, 0, 0), more) for more in ((), SPATIAL))
    assert plane.parts["rod"].planes == ("u", "v")
    assert spatial.parts["rod"].planes == ("u", "v", "w", "p")
    own, every = (pf.modes(m, count=count).frequencies for m, count in ((plane, 4), (spatial, 12)))
    assert max(np.min(np.abs(every / f - 1.0)) for f in own) < 1e-9  # of round-off 1e-12
    for level in ("quasistatic", "coupled"):
        mine, theirs = (
            np.asarray(pf.solve(m, level=level, dt=1e-3).torque) for m in (plane, spatial)
        )
        assert np.max(np.abs(mine - theirs)) < 1e-9 * np.max(np.abs(theirs))


def test_a_slider_that_leaves_the_plane_makes_it_spatial(tmp_path: Path) -> None:
    bodies = (
        Body("arm", "base", "revolute", axis=(0, 1, 0), mass=1.08, com=(0.5, 0, 0),
             inertia=(1e-5, 0.09, 0.09)),
        Body("tip", "arm", xyz=(1, 0, 0)),
        Body("block", "tip", "prismatic", axis=(0.2, 0.1, 0), mass=1.5, inertia=(1e-3, 1e-3, 1e-3)),
    )  # fmt: skip
    words = f"gravity: [0, 0, 0]\nactuated: [arm_joint, block_joint]\nflexible:\n  arm:{ARM}"
    assert load(tmp_path, bodies, words).parts["arm"].reason == "spatial scene"
