"""The damping that `check` shows is the machine's, not that of a link by itself.

Claims:
    Many cases
    - damping ratio of the machine that `check` shows: decay of a beam with a mass of 5 of its own
      at its tip | a run, one spring by hand | 1 %; 1e-9 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.description.motions.motion import from_spec
from pinflex.levels.ringing import ringing
from pinflex.studies.checking.check import check
from tests.scenes import UNIT_BEAM, Body, load


@pytest.mark.parametrize("mass", [0.0, 5.0])
def test_modal_damping_of_a_link_decays_as_check_says(mass: float, tmp_path: Path) -> None:
    """A beam of mass 1 with a ratio of 0.02, let go in its first shape; a point mass at its tip."""
    bodies = (Body("beam", "base"), Body("tip", "beam", xyz=(1, 0, 0), mass=mass))
    words = "gravity: [0, 0, 0]\nactuated: []\nplatform: tip\ndamping: {modal: 0.02}\nflexible:"
    m = load(tmp_path, bodies, f"{words}{UNIT_BEAM}")
    found, shown = pf.modes(m), check(m)
    ratio = shown.damping[0]
    if not mass:
        assert shown.damping == pytest.approx([0.02] * len(shown.damping), rel=1e-9)  # round-off
    else:
        assert ratio < 0.005
    y = m.undeformed() + 1e-4 * found.shapes[:, 0]
    until = 10 / found.frequencies[0]
    r = pf.solve(m, pf.hold(duration=until), level="coupled", tol=1e-5, samples=4001,
                 start=(y, 0 * found.shapes[:, 0]))  # fmt: skip
    x = r.frame("tip").position[:, 1]
    peaks = x[1:-1][(x[1:-1] > x[:-2]) & (x[1:-1] > x[2:])]
    decay = np.log(peaks[0] / peaks[-1]) / (2 * np.pi * (len(peaks) - 1))
    # 1 %: the release is in the shape, of which damping takes a little into the next modes
    assert decay == pytest.approx(ratio, rel=1e-2)
    assert "damping ratio of the machine's own modes" in str(shown)


def test_a_damper_on_a_spring_is_that_of_an_oscillator(tmp_path: Path) -> None:
    """zeta = d / (2 sqrt(k I)), of a joint and of a damper between frames alike."""
    bodies = (
        Body("arm", "base", "revolute", mass=2.0, com=(0.5, 0, 0), inertia=(1e-3, 0.1, 0.1)),
        Body("hand", "arm", xyz=(0, 1, 0)),
        Body("post", "base", xyz=(1, 1, 0)),
    )
    inertia = 0.1 + 2.0 * 0.25
    joint = "joints: {arm_joint: {spring: 40, damper: 1.5}}\n"
    m = load(tmp_path, bodies, f"gravity: [0, 0, 0]\nactuated: []\n{joint}")
    assert check(m).damping == pytest.approx([1.5 / (2 * np.sqrt(40 * inertia))], rel=1e-9)
    rope = "springs: {rope: {between: [hand, post], stiffness: 0, damper: 1.5, length: 1}}\n"
    spring = "joints: {arm_joint: {spring: 40}}\n"
    m = load(tmp_path, bodies, f"gravity: [0, 0, 0]\nactuated: []\n{spring}{rope}")
    assert check(m).damping == pytest.approx([1.5 / (2 * np.sqrt(40 * inertia))], rel=1e-9)
    plain = load(tmp_path, bodies, f"gravity: [0, 0, 0]\nactuated: []\n{spring}")
    assert check(plain).damping == (0.0,)
    assert "damping ratio" not in str(check(plain))


def test_the_ringing_of_a_motion_has_the_ratio_of_its_link(tmp_path: Path) -> None:
    """A beam on a motor, held there: its modes are those of the link, whose ratio is 0.02."""
    bodies = (Body("beam", "base", "revolute"), Body("tip", "beam", xyz=(1, 0, 0)))
    words = "gravity: [0, 0, 0]\nactuated: [beam_joint]\ndamping: {modal: 0.02}\n"
    move = "motion: {kind: quintic, joints: {beam_joint: 0.3}, duration: 1}\nflexible:"
    m = load(tmp_path, bodies, f"{words}{move}{UNIT_BEAM}")
    found = ringing(m, from_spec(m.description.motion, "motion", None))
    np.testing.assert_allclose(found.damping, 0.02, rtol=1e-6)
    # 1e-4: what two internal modes leave of 1.8751^2 / (2 pi)
    assert found.frequencies[0] == pytest.approx(1.87510407**2 / (2 * np.pi), rel=1e-4)
