"""Damping matrices given from Python."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from tests.scenes import UNIT_BEAM, Body, load

BEAM = (Body("beam", "base"), Body("tip", "beam", xyz=(1, 0, 0)))
YAML = (
    f"gravity: [0, 0, 0]\nactuated: []\nmotion: {{kind: hold, duration: 1}}\nflexible:{UNIT_BEAM}"
)


def test_a_matrix_of_ones_own_damps_as_the_same_matrix_of_the_file(tmp_path: Path) -> None:
    beta = "flexible.beam.damping.rayleigh=[0, 0.02]"
    said = load(tmp_path, BEAM, YAML, [beta])
    K = said.parts["beam"].bodies[0].K
    path = tmp_path / "scene.yaml"
    given = pf.load(path, ["flexible.beam.inertia=beam"], damping={"beam": 0.02 * K})
    np.testing.assert_allclose(given.flexible.D, said.flexible.D, rtol=1e-15)
    decay = [pf.modes(robot, at=0.0, count=2).growth for robot in (said, given)]
    # s = -b w^2 / 2 of the first mode; 1e-4: what two internal modes leave of it
    assert decay[1] is not None
    assert decay[1][0] == pytest.approx(-0.01 * 1.87510407**4, rel=1e-4)
    np.testing.assert_allclose(*decay, rtol=1e-12)


def test_it_may_couple_segments(tmp_path: Path) -> None:
    robot = load(tmp_path, BEAM, YAML, ["flexible.beam.segments=2"])
    n = robot.flexible.n_eta
    d = np.zeros(n)
    d[0], d[-1] = 1.0, -1.0
    damped = pf.load(
        tmp_path / "scene.yaml", ["flexible.beam.segments=2", "flexible.beam.inertia=beam"],
        damping={"beam": np.outer(d, d)},
    )  # fmt: skip
    np.testing.assert_array_equal(damped.flexible.D[-n:, -n:], np.outer(d, d))
    assert (robot.flexible.D == 0).all()


@pytest.mark.parametrize(
    ("link", "matrix", "said"),
    [
        ("bean", np.eye(4), 'bean is not flexible. Did you mean "beam"'),
        ("beam", np.eye(3), "shape (3, 3). Allowed: finite numbers of shape (4, 4)"),
        ("beam", np.triu(np.ones((4, 4))), "is not symmetric"),
        ("beam", -np.eye(4), "would make energy"),
    ],
)
def test_a_matrix_that_cannot_be_is_refused(
    link: str, matrix: np.ndarray, said: str, tmp_path: Path
) -> None:
    load(tmp_path, BEAM, YAML)
    with pytest.raises(pf.DescriptionError) as error:
        pf.load(tmp_path / "scene.yaml", damping={link: matrix})
    assert said in str(error.value)
