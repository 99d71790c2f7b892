"""Level ked where accelerations jump between its steps, against the exact answer.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - ked where accelerations jump, on and between steps: second order, states and force | sum of
      step responses | 4e-4; ratios above 3.5 | 3.2e-4; the first order had 8.8e-4
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

import pinflex as pf
from pinflex.arrays import Array
from pinflex.mechanics.evaluation.equations import Equations
from tests.scenes import UNIT_BEAM, Body, load

RAMP, END = 0.5, 3.0  # s: jumps at 0.5, 1.5 and 2 s
SPEED = 1.0 / 1.5  # m/s, of a way of 1 m


def carried(folder: Path) -> pf.Mechanism:
    """A beam across a slide that goes 1 m in 2 s, ramps of constant acceleration at both ends."""
    bodies = (
        Body("slide", "base", "prismatic", axis=(0, 1, 0), mass=1.0),
        Body("beam", "slide"),
        Body("tip", "beam", xyz=(1, 0, 0)),
    )
    yaml = (
        "gravity: [0, 0, 0]\nactuated: [slide_joint]\nplatform: tip\n"
        f"motion: {{kind: trapezoid, joints: {{slide_joint: 1}}, ramp: {RAMP}, duration: 2}}\n"
        f"flexible:{UNIT_BEAM}"
    )
    return load(folder, bodies, yaml, ["flexible.beam.basis.internal=0"])


def exact(robot: pf.Mechanism, t: Array) -> tuple[Array, Array]:
    """Elastic coordinates (nt, n) and motor force (nt,): sum of responses to three steps.

    The answer of an oscillator to an acceleration that sets in is (cos(w s) - 1) / w^2.
    """
    M = Equations(robot.flexible).mass(robot.undeformed())
    K = robot.flexible.K[1:, 1:]
    squares, V = scipy.linalg.eigh(K, M[1:, 1:])
    a = SPEED / RAMP
    eta, force = np.zeros((len(t), len(K))), np.zeros(len(t))
    for at, jump in ((0.0, a), (RAMP, -a), (2.0 - RAMP, -a), (2.0, a)):
        s = np.maximum(t - at, 0.0)[:, None]
        on = (t >= at)[:, None] * jump
        push = V.T @ M[1:, 0]
        eta += on * (push * (np.cos(np.sqrt(squares) * s) - 1.0) / squares) @ V.T
        swing = on * (-push * np.cos(np.sqrt(squares) * s)) @ V.T
        force += on[:, 0] * M[0, 0] + swing @ M[1:, 0]
    return eta, force


@pytest.mark.parametrize("samples", [1201, 1213])
def test_a_jump_between_two_steps_is_where_it_is(samples: int, tmp_path: Path) -> None:
    """Second order, at jumps on steps and between them: felt half a step off, it was the first."""
    robot, errors = carried(tmp_path), []
    for every in (1, 2, 4):
        dt = END / (samples - 1) / every
        run = pf.solve(robot, level="ked", until=END, samples=samples, dt=dt, rho_inf=1.0)
        eta, force = exact(robot, run.t)
        pairs = (run.array("eta"), eta), (run.torque[:, 0], force)
        errors.append([float(np.max(np.abs(x - y)) / np.max(np.abs(y))) for x, y in pairs])
    assert np.max(errors[-1]) < 4e-4, errors  # felt half a step off: 9e-4
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert np.all(ratios > 3.5), ratios  # 4 in the end; the first order has 2
