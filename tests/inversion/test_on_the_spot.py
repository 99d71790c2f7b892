"""A platform that only turns on the spot: a panel's tip on the axis about which it is turned."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from tests.scenes import Body, load

L = 2.0  # m
YAML = """
gravity: [0, 0, 0]
platform: tip
damping: {modal: 0.02}
flexible:
  panel: {material: aluminium, end: tip, up: y,
    section: {shape: rectangle, width: 0.5, thickness: 0.01}}
motion: {kind: cycloid, joints: {panel_joint: 0.5}, duration: 2.0}
"""
TIP = Body("tip", "panel", xyz=(L, 0, 0))


def panel(folder: Path, overrides: tuple[str, ...] = ()) -> pf.Mechanism:
    return load(folder, (Body("panel", "base", "revolute", axis=(1, 0, 0)), TIP), YAML, overrides)


def test_a_command_follows_a_path_that_is_a_turn_alone(tmp_path: Path) -> None:
    """Rotations were weighed by the way of the platform: none, so none was chosen (ValueError)."""
    robot = panel(tmp_path)
    found = pf.command(robot)
    assert found.coordinates == ("rx",)
    run = pf.solve(robot, found.motion, level="coupled", start="static", tol=1e-4)
    R = run.frames["tip"].rotation
    turned = np.arctan2(R[:, 2, 1], R[:, 1, 1])
    s = np.clip((run.t - found.before) / 2.0, 0.0, 1.0)
    path = 0.5 * (s - np.sin(2 * np.pi * s) / (2 * np.pi))
    assert np.abs(turned - path).max() < found.error[0]  # the bar that it tells


def test_what_stays_zero_has_no_sensitivity(tmp_path: Path) -> None:
    """The tip does not leave its place: the other outputs are told, as they always are."""
    found = pf.sensitivities(panel(tmp_path), ["flexible.panel.section.thickness"])
    assert "deviation.peak" not in found.outputs
    assert {"frequency.1", "mass", "torque.peak", "stress.peak"} <= {*found.outputs}
    # a cantilever's first bending goes with its thickness
    slope = found["frequency.1", "flexible.panel.section.thickness"]
    assert slope == pytest.approx(1.0, abs=0.01)


def test_a_free_base_is_refused_with_what_to_write(tmp_path: Path) -> None:
    with pytest.raises(pf.DescriptionError, match="the base is free and drifts.*base: fixed"):
        pf.command(panel(tmp_path, ("base=free_flyer",)))
