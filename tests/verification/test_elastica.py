"""The references of large static deflection, made again by shooting on the exact rod."""

from __future__ import annotations

import numpy as np
import pytest

from pinflex.lab import elastica
from pinflex.lab.scene import extrapolated
from tests.analytical import cosserat_tip


@pytest.mark.parametrize("angle", [0, 30, 45, 60, 90])
def test_the_princeton_table_is_that_of_the_exact_rod_to_its_last_digit(angle: int) -> None:
    stiffness = np.array([elastica.EA, elastica.GA, elastica.GA, elastica.GJ, *elastica.EI])
    turn = np.radians(angle)
    for load in (4.448, 13.345):
        force = np.array([0.0, load * np.cos(turn), load * np.sin(turn)])
        place, R = cosserat_tip(elastica.LENGTH, force, stiffness)
        twist = np.degrees(np.arctan2(-R[2, 1], R[1, 1]))
        found = np.array([*(1e3 * place[1:]), twist])
        assert found == pytest.approx(np.array(elastica.TIPS[load, angle]), abs=1e-4)


def test_the_rotation_vector_gives_another_twist_than_the_published_one() -> None:
    stiffness = np.array([elastica.EA, elastica.GA, elastica.GA, elastica.GJ, *elastica.EI])
    force = 8.896 * np.array([0.0, 1.0, 1.0]) / np.sqrt(2.0)
    _, R = cosserat_tip(elastica.LENGTH, force, stiffness)
    angle = np.arccos((np.trace(R) - 1) / 2)
    along_x = np.degrees(angle / (2 * np.sin(angle)) * (R[2, 1] - R[1, 2]))
    assert along_x == pytest.approx(-1.4767, abs=1e-4)
    assert np.degrees(np.arctan2(R[2, 1], R[1, 1])) == pytest.approx(-1.6650, abs=1e-4)


def test_the_bend_is_that_of_the_exact_curved_rod() -> None:
    stiffness = 1e7 * np.array([1, 5 / 12, 5 / 12, 1 / 12, 1 / 12, 1 / 12])
    force = np.array([0.0, 0.0, 600.0])
    place, _ = cosserat_tip(100 * np.pi / 4, force, stiffness, curvature=0.01)
    assert place == pytest.approx(np.array(elastica.BEND), abs=1e-6)


def test_extrapolation_is_exact_for_its_powers() -> None:
    sizes = [0.5, 0.25, 0.2]
    values = [np.array([1.0 + 3 * h**2 - 2 * h**3]) for h in sizes]
    assert extrapolated(sizes, values, 2) == pytest.approx(np.array([1.0]), abs=1e-14)
