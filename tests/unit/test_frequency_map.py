"""Frequencies along a motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.errors import DescriptionError
from pinflex.studies.frequency_map import frequency_map, plot_frequency_map, save_frequency_map


def test_the_first_pose_has_the_frequencies_of_home() -> None:
    robot = pf.load("ur5")
    found = frequency_map(robot, count=4, instants=5)
    home = pf.modes(robot, count=4).frequencies
    # 1e-9: the same linearisation at the same pose, reached by one closure less
    assert found.frequencies[0] == pytest.approx(home, rel=1e-9)
    assert found.frequencies.shape == (5, 4)
    assert found.missing == ""


def test_a_line_follows_its_mode_where_frequencies_are_equal() -> None:
    """With the motors locked each leg of the 3-RRR swings alone, in every pose alike."""
    found = frequency_map(pf.load("3rrr"), count=6, instants=21)
    # 1 %: the platform couples the legs a little, differently in each pose
    assert np.ptp(found.frequencies, axis=0) / found.frequencies[0] == pytest.approx(0, abs=0.01)
    assert found.preload == "none"  # it lies on a table


def test_poses_without_an_equilibrium_are_left_out_and_told(tmp_path: Path) -> None:
    found = frequency_map(pf.load("3rrs"), count=3, instants=6)
    assert np.isfinite(found.frequencies[:3]).all()
    assert np.isnan(found.frequencies[-1]).all()
    assert found.missing.startswith("no equilibrium at 0.8 s: ")
    assert "no static equilibrium" in [
        t.get_text() for t in plot_frequency_map(found).axes[0].texts
    ]
    assert save_frequency_map(found, tmp_path / "map.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(DescriptionError, match="Allowed"):
        save_frequency_map(found, tmp_path / "map.gif")


def test_the_figure_names_the_lowest_frequency() -> None:
    found = frequency_map(pf.load("3rrs"), count=3, instants=5, preload="none")
    texts = [t.get_text() for t in plot_frequency_map(found).axes[0].texts]
    assert f"lowest {found.frequencies.min():.4g} Hz at 1 s" in texts
