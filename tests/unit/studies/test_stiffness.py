"""Cartesian stiffness of a platform, against closed forms and against differences of equilibria.

Claims:
    Many cases
    - 6x6 compliance of an oblique beam's end, every entry another | beam theory | 1e-12 | 1e-16
    - parallel flexure, a closed loop: 24 EI/L^3 | beam theory | 1e-5 | 1.3e-6
    - compliance under gravity = differences of `static_equilibrium` under loads that move the
      platform by 1e-4: 3rrs, ur5 | central differences | 1e-5 | 1.5e-6, 8e-8
    - legs that only bend hold the 3-RRR's platform; with stretch it gives way in 3 directions |
      statics | exact | exact
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.errors import DescriptionError, SingularityError
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.results.pose_map import stiffness_of
from pinflex.rotations import rotation_vector
from pinflex.studies.pose import platform_compliance
from tests.scenes import Body, load, published

# L = 2, E = 3, G = 1, A = 5, Iy = 7, Iz = 11, J = 13: every entry is another number
BEAM = """
    material: {E: 3, G: 1, rho: 1.0e-9}
    section: {shape: given, A: 5, Iy: 7, Iz: 11, J: 13}
    bending_y: true
    bending_z: true
    torsion: true
    axial: true
"""
WORDS = "gravity: [0, 0, 0]\nactuated: []\nplatform: tip\nflexible:\n  beam:"


def cantilever() -> Array:
    """Compliance of the end of that beam, in its own axes (Euler-Bernoulli, Saint-Venant)."""
    L, EA, EIy, EIz, GJ = 2.0, 15.0, 21.0, 33.0, 13.0
    C = np.diag([L / EA, L**3 / 3 / EIz, L**3 / 3 / EIy, L / GJ, L / EIy, L / EIz])
    C[1, 5] = C[5, 1] = L**2 / 2 / EIz
    C[2, 4] = C[4, 2] = -(L**2) / 2 / EIy
    return C


def test_the_end_of_an_oblique_beam_has_the_compliance_of_beam_theory(tmp_path: Path) -> None:
    rpy = (0.3, -0.7, 1.1)
    m = load(
        tmp_path,
        (Body("beam", "base", rpy=rpy), Body("tip", "beam", xyz=(2, 0, 0))),
        f"{WORDS}\n    up: z{BEAM}    end: tip\n",
    )
    turn = np.kron(np.eye(2), pin.rpy.rpyToMatrix(*rpy))
    C = platform_compliance(m)
    # 1e-12: cubic shapes hold the exact solution of a loaded end
    assert pytest.approx(turn @ cantilever() @ turn.T, abs=1e-12) == C
    K, directions = stiffness_of(C)
    assert directions == 6
    assert pytest.approx(np.eye(6), abs=1e-11) == K @ C


def test_a_parallel_flexure_has_24_EI_over_L_cubed(tmp_path: Path) -> None:
    """Two clamped beams and a plate that their ends carry: a closed loop."""
    bodies = (
        Body("left", "base"),
        Body("plate", "left", xyz=(1, 0, 0), mass=1.0),
        Body("right", "base", xyz=(0, 0.3, 0)),
        Body("right_end", "right", xyz=(1, 0, 0)),
        Body("plate_end", "plate", xyz=(0, 0.3, 0)),
    )
    beam = (
        BEAM.replace("E: 3", "E: 1")
        .replace("A: 5", "A: 1.0e8")
        .replace("Iz: 11, J: 13", "Iz: 1, J: 2")
    )
    m = load(
        tmp_path,
        bodies,
        "gravity: [0, 0, 0]\nactuated: []\nplatform: plate\n"
        "loops: {weld: {kind: weld, between: [right_end, plate_end]}}\n"
        f"flexible:\n  left:{beam}    end: plate\n  right:{beam}    end: right_end\n",
    )
    # 1e-5: EA = 1e8 EI / L^2 lets the plate turn a little, by 1e-7 of 12 / 0.3^2
    assert 1.0 / platform_compliance(m)[1, 1] == pytest.approx(24.0, rel=1e-5)


@pytest.mark.parametrize("name", ["3rrs", "ur5"])
def test_compliance_is_the_difference_of_equilibria_under_small_loads(name: str) -> None:
    """A spatial closed loop and an arm, about their sagging pose: preload and closure forces."""
    robot = pf.load(name)
    C = platform_compliance(robot)
    found = np.empty((6, 6))
    for k in range(6):
        size = 1e-4 / np.max(np.abs(C[:, k]))  # moves the platform by 1e-4 m or rad
        ends = [_pose_under(robot, np.eye(6)[k] * sign * size) for sign in (1, -1)]
        turn = rotation_vector((ends[0].rotation @ ends[1].rotation.T)[None])[0]
        shift = ends[0].translation - ends[1].translation
        found[:, k] = np.concatenate([shift, turn]) / (2 * size)
    scale = np.sqrt(np.outer(np.diag(C), np.diag(C)))
    # 1e-5: central differences leave the square of what moves, 1e-8, times the curvature of the
    # equilibrium path, which gravity near buckling makes large in 3rrs
    assert np.max(np.abs(found - C) / scale) < 1e-5


def _pose_under(robot: pf.Mechanism, wrench: Array) -> pin.SE3:
    frame = robot.description.platform
    load = f"{{at: {frame}, force: {wrench[:3].tolist()}, moment: {wrench[3:].tolist()}}}"
    robot = pf.load(robot.description, [f"forces={{probe: {load}}}"])
    dynamics, here = Equations(robot.flexible), robot.frame(str(frame))
    bent = dynamics.at(pf.static_equilibrium(robot).y)
    pin.forwardKinematics(dynamics.model, dynamics.data, bent.Q[0])
    return dynamics.data.oMi[here.joint] * here.placement


def test_what_does_not_give_way_is_infinitely_stiff() -> None:
    """Legs that only bend hold the platform of the 3-RRR; with stretch it moves in the plane."""
    K, directions = stiffness_of(platform_compliance(pf.load(published("3rrr"))))
    assert directions == 0 and np.all(np.diag(K) == np.inf)
    K, directions = stiffness_of(platform_compliance(pf.load("3rrr")))
    assert directions == 3
    assert np.isinf(np.diag(K)).tolist() == [False, False, True, True, True, False]


def test_a_platform_without_a_hold_or_a_name_is_said(tmp_path: Path) -> None:
    bodies = (Body("beam", "base", "revolute"), Body("tip", "beam", xyz=(2, 0, 0)))
    m = load(tmp_path, bodies, f"{WORDS}{BEAM}    end: tip\n")
    with pytest.raises(SingularityError, match="without any stiffness"):
        platform_compliance(m, preload="none")
    with pytest.raises(DescriptionError, match="platform: FRAME"):
        platform_compliance(pf.load(m.description.with_overrides(["platform=null"])))
