"""Terms that nothing else notices: each by a closed form of its own.

Claims:
    Bad input, costs, signals
    - centripetal acceleration of offset frames; both planes of an unsymmetric section; ramps; modes
      through two crossings | closed forms | 1e-3; 1e-2; 1e-4; 1e-9 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.studies import pose_map as maps
from tests.scenes import Body, load

ARM = [Body("beam", "base", "revolute"), Body("tip", "beam", xyz=(0.4, 0, 0))]
STEEL = "{E: 2.0e11, nu: 0.3, rho: 7850}"


def arm(folder: Path, section: str, more: str) -> pf.Mechanism:
    return load(
        folder,
        ARM,
        f"gravity: [0, 0, 0]\nframes: [tip]\nflexible:\n  beam:\n    material: {STEEL}\n"
        f"    section: {section}\n    end: tip\n    axial: false\n    torsion: false\n{more}",
    )


def test_a_frame_off_its_joint_has_the_centripetal_acceleration(tmp_path: Path) -> None:
    """At 5 rad/s a point at 0.4 m has omega^2 r = 10 m/s^2 towards the axis, rigid or nearly so."""
    robot = arm(tmp_path, "{shape: circle, diameter: 0.03}", "")
    spin = pf.spin_up(joints={"beam_joint": 5.0}, duration=0.1)
    for level in ("rigid", "quasistatic"):
        run = pf.solve(robot, spin, level=level, until=0.3, samples=7)
        tip = run.frame("tip")
        radius = tip.position[-1] / np.linalg.norm(tip.position[-1])
        # 1e-3: the beam stretches and bends by less
        assert tip.acceleration[-1, :3] @ radius == pytest.approx(-10.0, rel=1e-3)
        assert np.linalg.norm(tip.acceleration[-1, :3]) == pytest.approx(10.0, rel=1e-3)


def test_bending_stress_of_a_section_without_symmetry_adds_both_planes(tmp_path: Path) -> None:
    """A triangle of fibres under a tip load in both planes: sigma = My z/Iy - Mz y/Iz at each.

    With Mz = Fy (L - x) and My = -Fz (L - x) at the root; the other sign would give 160 %.
    """
    fibres = [(-0.004, -0.006), (0.008, -0.006), (-0.004, 0.012)]
    Iy, Iz, L, Fy, Fz = 2.0e-9, 3.0e-9, 0.4, 3.0, 2.0
    section = (
        f"{{shape: given, A: 1.0e-4, Iy: {Iy}, Iz: {Iz}, J: 4.0e-9, fibres: "
        f"{[list(f) for f in fibres]}}}"
    )
    more = (
        "    bending_y: true\n    bending_z: true\n"
        f"forces: {{push: {{at: tip, force: [0, {Fy}, {Fz}]}}}}\n"
        "motion: {kind: hold, duration: 1}\n"
    )
    run = pf.solve(arm(tmp_path, section, more), level="quasistatic", samples=2)
    link = run.link("beam")
    Mz, My = Fy * L, -Fz * L
    expected = max(abs(My * z / Iy - Mz * y / Iz) for y, z in fibres)
    other = max(abs(My * z / Iy + Mz * y / Iz) for y, z in fibres)
    assert abs(expected / other - 1) > 0.2  # the signs can be told apart
    # 1 %: the beam bends by 6 mm, which turns the load against its axis
    assert link.stress("bending")[-1, 0] == pytest.approx(expected, rel=0.01)


def test_a_ramp_brings_a_load_on_in_proportion_to_time(tmp_path: Path) -> None:
    """At a quarter, half and all of the ramp the tip is at these shares of its deflection."""
    push = (
        "    bending_y: true\n    bending_z: false\n"
        "forces: {push: {at: tip, force: [0, 0.5, 0], start: 0.2, ramp: 0.4}}\n"
        "motion: {kind: hold, duration: 1}\nsolve: {level: quasistatic, samples: 11}\n"
    )
    run = pf.solve(arm(tmp_path, "{shape: circle, diameter: 0.01}", push))
    share = run.frame("tip").position[:, 1] / run.frame("tip").position[-1, 1]
    ramp = np.clip((run.t - 0.2) / 0.4, 0.0, 1.0)
    # 1e-4: deflections of 0.1 mm in 0.4 m are linear to that
    assert share == pytest.approx(ramp, abs=1e-4)


def test_modes_are_followed_through_two_crossings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two shapes whose frequencies cross twice: 10 + 4 sin and 10 - 4 sin of one and a half turns.

    Each column keeps its shape from pose to pose, so neither is the lower one all along.
    """
    robot = pf.load("cantilever")
    n, count, calls = int(robot.flexible.nv), 13, iter(range(100))
    real = pf.modes(robot, preload="none", count=n)
    basis = real.shapes[:, :2]

    def crossing(*unused: object, **more: object) -> pf.Modes:
        swing = 4.0 * np.sin(3.0 * np.pi * next(calls) / (count - 1))
        frequencies = np.array([10.0 + swing, 10.0 - swing])
        order = np.argsort(frequencies)
        shapes = basis[:, order]
        return pf.Modes(frequencies[order], shapes, real.y, real.share, real.links, "none", False)

    monkeypatch.setattr(maps, "modes", crossing)
    found = maps.pose_map(robot, along=pf.hold(duration=1.0), count=2, instants=count)
    swing = 4.0 * np.sin(3.0 * np.pi * np.arange(count) / (count - 1))
    first = found.frequencies[:, 0]
    assert first == pytest.approx(10.0 + swing, abs=1e-9) or first == pytest.approx(10.0 - swing)
