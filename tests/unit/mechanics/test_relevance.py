"""What `auto` keeps and leaves out, against hand-made statics and against doing it.

Claims:
    Many cases
    - truss of two bars: compliance, and each bar's share in it; nothing out of the plane | by hand
      | 1e-12; 1e-9 | passes
    - a beam's stretch: all of the compliance along it, none across it | by hand | 1e-12; 1e-15 |
      passes
    - piston: the rod's stretch L/(EA)/cos^2, all of the block's sag, none of the motor's torque |
      by hand | 1e-9 | passes
    - three equal legs of a symmetric machine keep the same deformations, whatever their frames are
      called | symmetry | exact | passes (one plane of one leg was lost: 4 % in a frequency)
    - shares of an arm = what its compliance loses with a direction off: ur5, u, w, p | a second
      model | 1e-12 | passes
    - what auto leaves out costs less than 1e-3 and than its shares: race_r2 | a second model | its
      share | 1.0e-4 of 3.2e-4
    - a spring between frames across a beam, without preload: 8 + 50 N/m, 1.212 Hz, 1/58 m/N | by
      hand | 1e-9; 1e-5 | passes
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.mechanics.model.parts import FlexiblePart
from pinflex.mechanics.model.relevance import NEGLIGIBLE, shares
from pinflex.studies.checking.check import check
from pinflex.studies.pose import platform_compliance
from tests.scenes import Body, load

ON = "bending_y: true\n    bending_z: true\n    torsion: true\n    axial: true"
EA = 2.0e11 * 0.02 * 0.02  # of BAR
BAR = """
    material: {E: 2.0e11, nu: 0.3, rho: 7800}
    section: {shape: rectangle, width: 0.02, thickness: 0.02}
"""


def look(m: pf.Mechanism) -> dict[str, dict[tuple[str, str], float]]:
    """Shares by case, of a mechanism whose every direction is on."""
    return shares(m.description, m.links, m.parts, m.flexible, m.home)


def truss(folder: Path, changes: Sequence[str] = ()) -> pf.Mechanism:
    """Two bars on pins, from (0, 0) and (1, 0), meet at (0.3, 0.4) m."""
    ends = np.array([[0.0, 0.0], [1.0, 0.0]])
    ways = np.array([0.3, 0.4]) - ends
    lengths, angles = np.linalg.norm(ways, axis=1), np.arctan2(ways[:, 1], ways[:, 0])
    bodies = []
    for k in (0, 1):
        name, L = f"bar_{k + 1}", float(lengths[k])
        bodies.append(Body(name, "base", "revolute", xyz=(*ends[k], 0.0), mass=1.0,
                           com=(L / 2, 0, 0), inertia=(1e-4, 0.01, 0.01)))  # fmt: skip
        bodies.append(Body(f"tip_{k + 1}", name, xyz=(L, 0, 0)))
    home = ", ".join(f"bar_{k + 1}_joint: {float(angles[k])!r}" for k in (0, 1))
    yaml = (
        "gravity: [0, 0, 0]\nactuated: []\nplatform: tip_1\n"
        "loops: {apex: {kind: planar, between: [tip_1, tip_2], axis: z}}\n"
        f"home: {{{home}}}\nflexible:\n"
        f"  bar_1:{BAR}    end: tip_1\n  bar_2:{BAR}    end: tip_2\n"
    )
    return load(folder, bodies, yaml, changes)


def test_a_truss_of_two_bars_stretches_and_does_nothing_else(tmp_path: Path) -> None:
    m = truss(tmp_path)
    ways = np.array([[0.3, 0.4], [-0.7, 0.4]])
    lengths = np.linalg.norm(ways, axis=1)
    n = ways / lengths[:, None]
    bars = np.diag(lengths / EA)
    forces = np.linalg.inv(n.T)  # of the bars, by unit forces along x and y
    by_hand = forces.T @ bars @ forces
    C = platform_compliance(m)
    # 1e-12: the two bars are exact, and the rest is round-off
    assert pytest.approx(by_hand, rel=1e-12) == C[:2, :2]
    assert not C[2:5].any()  # nothing gives way out of the plane: exactly nothing
    found = look(m)
    for k, axis in enumerate("xy"):
        case = found[f"compliance of tip_1 along {axis}"]
        for b in (0, 1):
            share = forces[b, k] ** 2 * bars[b, b] / by_hand[k, k]
            assert case[f"bar_{b + 1}", "u"] == pytest.approx(share, rel=1e-9)
            assert case[f"bar_{b + 1}", "v"] == pytest.approx(0.0, abs=1e-12)
    assert all("u" in part.planes for part in m.parts.values())


def test_a_beam_stretches_under_an_axial_unit_force_alone(tmp_path: Path) -> None:
    bodies = (Body("beam", "base"), Body("tip", "beam", xyz=(0.5, 0, 0)))
    words = (
        f"gravity: [0, 0, 0]\nactuated: []\nplatform: tip\nflexible:\n  beam:{BAR}    end: tip\n"
    )
    m = load(tmp_path, bodies, words)
    found = look(m)
    assert found["compliance of tip along x"]["beam", "u"] == pytest.approx(1.0, rel=1e-12)
    assert found["compliance of tip about x"]["beam", "p"] == pytest.approx(1.0, rel=1e-12)
    for axis in "yz":
        assert found[f"compliance of tip along {axis}"]["beam", "u"] < 1e-15
    assert m.parts["beam"].planes == ("u", "v", "w", "p") and not m.parts["beam"].left_out
    C = platform_compliance(m)
    assert C[0, 0] == pytest.approx(0.5 / EA, rel=1e-12)  # L / EA


def crank(folder: Path, changes: Sequence[str] = (), tail: str = "") -> pf.Mechanism:
    """Slider-crank: a rigid crank of 0.1 m at 90 deg, a rod of 0.5 m, a block that slides."""
    L = 0.5
    angle = float(np.arcsin(0.1 / L))
    bodies = (
        Body("crank", "base", "revolute", mass=0.2, com=(0.05, 0, 0), inertia=(1e-5, 1e-4, 1e-4)),
        Body("rod", "crank", "revolute", xyz=(0.1, 0, 0), mass=0.3, com=(L / 2, 0, 0),
             inertia=(1e-5, 1e-3, 1e-3)),
        Body("rod_tip", "rod", xyz=(L, 0, 0)),
        Body("block", "base", "prismatic", axis=(1, 0, 0), mass=1.0, inertia=(1e-3, 1e-3, 1e-3)),
    )  # fmt: skip
    yaml = (
        "gravity: [0, 0, 0]\nactuated: [crank_joint]\nplatform: block\n"
        "loops: {pin: {kind: planar, between: [rod_tip, block], axis: z}}\n"
        f"home: {{crank_joint: {np.pi / 2!r}, rod_joint: {-np.pi / 2 - angle!r}, "
        f"block_joint: {float(L * np.cos(angle))!r}}}\n"
        f"flexible:\n  rod:{BAR}    end: rod_tip\n{tail}"
    )
    return load(folder, bodies, yaml, changes)


def test_the_rod_of_a_piston_stretches(tmp_path: Path) -> None:
    m = crank(tmp_path, tail="forces: {gas: {at: block, force: [-1000, 0, 0]}}\n")
    assert "u" in m.parts["rod"].planes
    cos = np.sqrt(1 - 0.2**2)
    C = 0.5 / EA / cos**2  # the rod bears F / cos and moves the block by delta / cos
    assert platform_compliance(m, preload="none")[0, 0] == pytest.approx(C, rel=1e-9)
    found = look(m)
    assert found["sag of block"]["rod", "u"] == pytest.approx(1.0, rel=1e-9)
    # the torque follows from balance alone: no deformation has a part in it
    assert abs(found["holding torque of crank_joint"]["rod", "u"]) < 1e-9
    # the same with the rod that does not stretch: the block is rigid, and said so
    stiff = crank(tmp_path, ["flexible.rod.axial=false"])
    assert not platform_compliance(stiff).any()


@pytest.mark.parametrize("direction", ["u", "p", "w"])
def test_shares_are_what_switching_a_direction_off_costs(direction: str) -> None:
    """An arm is determinate: the share of a direction is exactly what the compliance loses."""
    key = {"u": "axial", "p": "torsion", "w": "bending_z"}[direction]
    every = [f"flexible.*.{k}=true" for k in ("axial", "torsion", "bending_y", "bending_z")]
    with_it = pf.load("ur5", every)
    without = pf.load("ur5", [*every, f"flexible.forearm_link.{key}=false"])
    C, D = (np.diag(platform_compliance(m, preload="none")) for m in (with_it, without))
    found = look(with_it)
    axes = ("along x", "along y", "along z", "about x", "about y", "about z")
    said = [found[f"compliance of tool0 {axis}"]["forearm_link", direction] for axis in axes]
    # 1e-12: the same linear equations, solved twice
    assert said == pytest.approx((C - D) / C, abs=1e-12)
    assert max(said) > NEGLIGIBLE


def test_what_auto_leaves_out_costs_less_than_it_says() -> None:
    auto = [f"flexible.*.{k}=auto" for k in ("axial", "torsion", "bending_y", "bending_z")]
    m = pf.load("race_r2", auto)
    out = {x.direction: x.share for part in m.parts.values() for x in part.left_out}
    assert set(out) == {"u"} and 0 < out["u"] < NEGLIGIBLE
    full = pf.load("race_r2", [*auto, "flexible.*.axial=true"])
    C, D = (np.diag(platform_compliance(x, preload="none")) for x in (full, m))
    assert 0 < np.max((C - D) / C) < len(m.parts) * out["u"]
    text = str(check(m))
    assert "axial left out: at most" in text and "of compliance, sag, torques" in text
    assert "left out" not in str(check(full))


def test_a_plane_scene_bends_in_its_plane_alone() -> None:
    m = pf.load("3rrr")
    assert all(part.planes == ("u", "v") and not part.left_out for part in m.parts.values())


def test_a_loose_structure_is_held_and_still_judged(tmp_path: Path) -> None:
    """A pendulum without a motor: its rotation is free; what the load along the rod does counts."""
    bodies = (
        Body("rod", "base", "revolute", axis=(0, 1, 0), mass=0.3, com=(0, 0, -0.25),
             inertia=(1e-3, 1e-3, 1e-5)),
        Body("bob", "rod", xyz=(0, 0, -0.5), mass=2.0, inertia=(1e-3, 1e-3, 1e-3)),
    )  # fmt: skip
    m = load(tmp_path, bodies, f"actuated: []\nplatform: bob\nflexible:\n  rod:{BAR}    end: bob\n")
    found = look(pf.load(m.description, ["flexible.rod.axial=true", "flexible.rod.bending_y=true"]))
    assert found["sag of bob"]["rod", "u"] == pytest.approx(1.0, rel=1e-6)
    assert "u" in m.parts["rod"].planes


def test_equal_links_stay_equal_whatever_their_frames_are_called() -> None:
    """Three sliders of one machine, 120 degrees apart: what each alone would bend is not equal."""
    beam = "material: steel, section: {shape: circle, diameter: 0.02}, inertia: beam, axial: false"
    m = pf.load(
        "3tpt",
        [f"flexible.slider_{k}={{start: slider_{k}_end, end: rod_{k}, {beam}}}"
         for k in (1, 2, 3)],
    )  # fmt: skip
    assert len({m.parts[f"slider_{k}"].planes for k in (1, 2, 3)}) == 1


def test_explicit_directions_are_never_changed_and_rigid_scenes_are_not_looked_at(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def none(*_: object) -> None:
        raise AssertionError("looked at")

    monkeypatch.setattr("pinflex.mechanics.model.relevance.shares", none)
    pf.load("ur5", ["flexible=null"])
    for name in ("race_r2", "spinning_beam"):
        assert not any(part.left_out for part in pf.load(name).parts.values())
    with pytest.raises(AssertionError, match="looked at"):
        pf.load("3rrr")


def test_springs_between_frames_belong_to_the_structure(tmp_path: Path) -> None:
    """A beam of 8 N/m and a spring of 50 N/m across its end: 58 N/m, without preload too."""
    bodies = (
        Body("beam", "base"),
        Body("tip", "beam", xyz=(1, 0, 0), mass=1.0, inertia=(1e-9, 1e-9, 1e-9)),
        Body("wall", "base", xyz=(1, 0.5, 0)),
    )
    yaml = (
        "gravity: [0, 0, 0]\nactuated: []\nplatform: tip\n"
        "springs: {side: {between: [wall, tip], stiffness: 50, length: 0.5}}\n"
        "flexible:\n  beam:\n    material: {E: 1, G: 1, rho: 1.0e-9}\n"
        "    section: {shape: given, A: 1.0e4, Iy: 2.6666666666666667, Iz: 2.6666666666666667, "
        f"J: 1}}\n    up: z\n    {ON}\n    end: tip\n"
    )
    m = load(tmp_path, bodies, yaml)
    C = platform_compliance(m, preload="none")
    assert C[1, 1] == pytest.approx(1 / 58, rel=1e-9)  # 0.0172 m/N
    assert C[2, 2] == pytest.approx(1 / 8, rel=1e-9)  # the spring is square to z
    y, z = np.sqrt([58.0, 8.0]) / (2 * np.pi)  # Hz, with the mass of 1 kg
    found = pf.modes(m, preload="none").frequencies
    # 1e-5: the beam weighs 1e-5 of the mass at its end
    assert found[:2] == pytest.approx([z, y], rel=1e-5)
    assert y == pytest.approx(1.212, abs=5e-4)
    sideways = pf.load(m.description, ["gravity=[0, -5.8, 0]"])
    sag = check(sideways).statics.linear
    assert sag is not None
    assert sag.position[1] == pytest.approx(-0.1, rel=1e-5)


@pytest.mark.parametrize("segments", [1, 3])  # more are judged by a coarse model
def test_a_link_in_segments_is_judged_as_one(segments: int, tmp_path: Path) -> None:
    """Pulled along x at h beside its line a bar stretches by F L/EA and bends by F h^2 L/EI."""
    length, side = 0.6, 0.02  # [m]

    def bar(h: float) -> FlexiblePart:
        bodies = (
            Body("bar", "base", "revolute", mass=0.5, com=(0.3, 0, 0), inertia=(1e-4, 0.1, 0.1)),
            Body("end", "bar", xyz=(length, 0, 0)),
            Body("tip", "bar", xyz=(length, h, 0)),
        )  # fmt: skip
        yaml = f"""
gravity: [0, 0, 0]
actuated: [bar_joint]
platform: tip
flexible:
  bar:
    material: steel
    section: {{shape: rectangle, width: {side}, thickness: {side}}}
    end: end
    segments: {segments}
"""
        return load(tmp_path, bodies, yaml).parts["bar"]

    def share(h: float) -> float:
        return 1.0 / (1.0 + h**2 * side**2 / (side**4 / 12))

    assert NEGLIGIBLE < share(0.1153) < 3 * NEGLIGIBLE  # a third of it is negligible
    assert bar(0.1153).planes == ("u", "v")
    (out,) = bar(0.3).left_out
    assert (out.direction, out.of) == ("u", "compliance of tip along x")
    assert out.share == pytest.approx(share(0.3), rel=1e-9)


def test_a_link_that_is_described_deforms_somehow_though_nothing_of_it_matters(
    tmp_path: Path,
) -> None:
    """A block at the end of a reed: each of its directions makes less than 1e-3 of anything."""
    bodies = (
        Body("reed", "base", "revolute", mass=0.05, com=(0.2, 0, 0), inertia=(1e-6, 1e-3, 1e-3)),
        Body("block", "reed", "revolute", xyz=(0.4, 0, 0), mass=1.0, com=(0.05, 0, 0),
             inertia=(1e-3, 2e-3, 2e-3)),
        Body("tip", "block", xyz=(0.1, 0, 0)),
    )  # fmt: skip
    yaml = """
actuated: [reed_joint, block_joint]
gravity: [0, 0, -9.81]
platform: tip
flexible:
  reed: {material: steel, section: {shape: circle, diameter: 0.005}, end: block}
  block: {material: steel, section: {shape: circle, diameter: 0.1}, end: tip}
"""
    m = load(tmp_path, bodies, yaml)
    every = look(m)
    assert max(case.get(("block", d), 0.0) for case in every.values() for d in "vw") < NEGLIGIBLE
    assert len(m.parts["block"].planes) == 1
