"""What a correction leaves, from how coefficients decay from degree to degree."""

from __future__ import annotations

import numpy as np
import pytest

from pinflex.solver.decay import Decay


def left(*sizes: tuple[float, float, float]) -> float:
    decay = Decay()
    decay.add(np.array(sizes[:2]).reshape(-1, 3))
    decay.add(np.array(sizes[2:]).reshape(-1, 3))
    return decay.left


def test_a_smooth_motion_leaves_a_part_and_what_rings_unresolved_more_than_all() -> None:
    assert left(*[(1.0, 0.05, 1.0)] * 4) == 0.35  # the least that is told
    assert left(*[(1.0, 0.3, 1.0)] * 4) == pytest.approx(1.0)
    assert left(*[(1.0, 0.9, 1.0)] * 4) == 3.0  # and the most


def test_odd_and_even_degrees_that_take_turns_are_one_decay() -> None:
    """A symmetric motion has no odd coefficients, or no even ones."""
    turns = [(1.0, 1e-3, 1.0), (1e-2, 0.1, 1.0)] * 6
    assert left(*turns) == 0.35


def test_steps_count_by_their_corrections() -> None:
    ringing, smooth = [(1.0, 1.0, 1e-6)] * 8, [(1.0, 0.05, 1.0)] * 8
    assert left(*ringing, *smooth) < left(*((a, b, 1.0) for a, b, _ in ringing), *smooth)


def test_without_steps_or_corrections_nothing_is_known() -> None:
    assert Decay().left == 1.0
    assert left((1.0, 0.1, 0.0), (1.0, 0.1, 0.0)) == 1.0
    assert left((1.0, 0.1, np.nan), (1.0, 0.1, 1.0)) == 1.0
