"""Damping matrices given from Python.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - damping matrices from Python: the file's own, a mode's decay | closed form | 1e-4 | passes
    - every mode of a link with riders has its `modal` ratio, in 1, 2 and 5 segments | definition;
      Pinocchio's mass of all stations | 1e-7 | passes; by segments 1 / n
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

import pinflex as pf
from pinflex.mechanics.evaluation.equations import Equations
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


@pytest.mark.parametrize("segments", [1, 2, 5])
@pytest.mark.parametrize("thick", [False, True])
@pytest.mark.parametrize("inertia", ["urdf", "beam"])
def test_every_mode_of_a_link_has_its_ratio_in_however_many_segments(
    segments: int, thick: bool, inertia: str, tmp_path: Path
) -> None:
    """Modes of the held link by Pinocchio's mass of all stations and of what rides on them.

    In segments each of which had its ratio by itself, the first mode had 0.02 over their number.
    """
    # What rides is on the axis, so that it couples no directions, which damping takes one by one.
    heavy = Body("beam", "base", mass=6.0, com=(0.4, 0, 0), inertia=(0.02, 0.6, 0.6))
    tip = Body("tip", "beam", xyz=(1, 0, 0))
    every = ("axial", "torsion", "bending_y", "bending_z")
    keys = [f"flexible.beam.{key}=true" for key in every]
    keys += [f"flexible.beam.{key}={str(thick).lower()}" for key in ("shear", "rotary_inertia")]
    changes = ["flexible.beam.damping.modal=0.02", f"flexible.beam.segments={segments}"]
    section = "flexible.beam.section={shape: rectangle, width: 1, thickness: 0.5}"
    robot = load(tmp_path, (heavy, tip), YAML, [*keys, *changes, section], inertia=inertia)
    assert bool(robot.parts["beam"].riders) == (inertia == "urdf")  # else its sections twist
    system = robot.flexible
    squares, V = scipy.linalg.eigh(system.K, Equations(system).mass(robot.undeformed()))
    D = V.T @ system.D @ V
    # 1e-7: round-off of modes far apart
    np.testing.assert_allclose(D, np.diag(0.04 * np.sqrt(squares)), atol=1e-7 * D.max())
