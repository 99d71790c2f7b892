"""A pin of the kind planar whose ends can part along its axis: what that does, and the warning."""

from __future__ import annotations

from pathlib import Path

import pytest

import pinflex as pf
from tests import scenes
from tests.scenes import Body

LENGTH, WIDE, THICK = 0.5, 0.02, 0.01  # [m] of the rod, which lies across gravity
FOUR_BAR = [
    Body("crank", "base", "revolute", mass=1.0, com=(0, 0.2, 0), inertia=(0.01, 0.01, 0.01)),
    Body("rod", "crank", "revolute", xyz=(0, 0.4, 0)),
    Body("rod_tip", "rod", xyz=(LENGTH, 0, 0)),
    Body("rocker", "base", "revolute", xyz=(LENGTH, 0, 0), mass=1.0, com=(0, 0.2, 0),
         inertia=(0.01, 0.01, 0.01)),
    Body("rocker_tip", "rocker", xyz=(0, 0.4, 0)),
]  # fmt: skip
YAML = """
gravity: [%s]
actuated: [crank_joint]
loops: {pin: {kind: %s, between: [rod_tip, rocker_tip], axis: z}}
platform: rod_tip
flexible:
  rod:
    material: steel
    section: {shape: rectangle, width: 0.02, thickness: 0.01}
    end: rod_tip
"""


def seen(folder: Path, gravity: str, kind: str) -> tuple[float, bool]:
    """Sag [m] of the end of the rod along the pin, and whether `check` warns."""
    found = pf.check(scenes.load(folder, FOUR_BAR, YAML % (gravity, kind)))
    assert found.statics.linear is not None
    warned = any("holds nothing along its axis" in text for text in found.warnings)
    return found.statics.linear.position[2], warned


def test_a_pin_that_holds_nothing_along_its_axis_is_warned_of(tmp_path: Path) -> None:
    """Gravity along the pins: the rod hangs on the crank alone, as a cantilever of its weight."""
    sag, warned = seen(tmp_path, "0, 0, -9.81", "planar")
    alone = -7850 * WIDE * THICK * 9.81 * LENGTH**4 / (8 * 210e9 * THICK * WIDE**3 / 12)
    assert sag == pytest.approx(
        alone, rel=1e-6
    )  # static shapes are exact but for a load's own: 2 modes
    assert warned


def test_pins_of_a_plane_scene_and_hinges_are_not(tmp_path: Path) -> None:
    assert not seen(tmp_path, "0, -9.81, 0", "planar")[1]
    sag, warned = seen(tmp_path, "0, 0, -9.81", "revolute")
    assert abs(sag) < 1e-12 and not warned  # the rigid rocker holds it
