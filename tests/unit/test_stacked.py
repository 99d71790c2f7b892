"""Residuals of several states at once are those of the states one by one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.description.description import model_names
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.stacked import Stacked
from pinflex.mechanics.system import System
from tests.finite import random_state
from tests.scenes import Body, load

# The same sums in another order: round-off of a few hundred terms.
ROUNDING = 1e-12
SIZES = (1, 5)

# Ball, universal and sliding joints, two loops, springs, dampers, links in two bases.
MANIFOLD = (
    Body("body", "base", mass=3.0, com=(0.1, 0.0, 0.05), inertia=(0.1, 0.2, 0.15)),
    Body("boom", "body", "continuous", xyz=(0.3, 0.0, 0.1), axis=(0, 1, 0), mass=0.5),
    Body("hand", "boom", xyz=(0.8, 0.0, 0.1), mass=0.3, inertia=(0.01, 0.02, 0.025)),
    Body("leg", "body", "continuous", xyz=(-0.3, 0.1, 0.0), mass=0.6),
    Body("foot", "leg", xyz=(0.2, 0.5, 0.0), mass=0.3, inertia=(0.01, 0.02, 0.025)),
    Body("grip", "body", "prismatic", xyz=(0.1, 0, 0), axis=(0, 0.6, 0.8), mass=0.1),
)
MANIFOLD_YAML = """
base: free_flyer
actuated: [boom_joint]
joints:
  hand_joint: {type: spherical}
  foot_joint: {type: universal, axes: [[1, 0, 0], [0, 0.6, 0.8]]}
  grip_joint: {spring: 30, rest: 0.05, damper: 2}
  leg_joint: {spring: 3, rest: 0.1, damper: 0.5, rotor_inertia: 0.02}
home: {foot_joint: [0.2, 0.3], hand_joint: [0.3, -0.2, 0.4]}
loops:
  rope: {kind: distance, between: [hand, foot]}
  bar: {kind: distance, between: [grip, hand]}
flexible:
  boom:
    material: {E: 2.0e9, nu: 0.3, rho: 800}
    section: {shape: rectangle, width: 0.03, thickness: 0.02}
    axial: true
    segments: 2
  leg:
    material: {E: 2.0e9, nu: 0.3, rho: urdf}
    section: {shape: tube, diameter: 0.03, wall: 0.002}
    basis: {kind: finite_element, elements: 2, order: quintic}
    damping: {modal: 0.02}
"""
FORCE = "forces: {pull: {at: hand, force: [1.0, 2.0, 3.0], follower: true, ramp: 2.0}}\n"


def disagreement(system: System, home: Array, size: int) -> tuple[float, float]:
    """Of residuals, relative to the largest force in play, and of closures, in m."""
    states = [random_state(system, home, seed) for seed in range(1, size + 1)]
    Y, V, A, lam = (np.array(part) for part in zip(*states, strict=True))
    t = 0.3 * np.arange(1, size + 1)
    stacked = Stacked(Dynamics(system), size)
    R = stacked.residual(Y, V, A, lam, t)
    worst = gap = 0.0
    for k in range(size):
        d = Dynamics(system)  # fresh: nothing left of another state
        d.loads.time = float(t[k])
        one = d.residual(Y[k], V[k], A[k], lam[k])
        scale = float(np.max(np.abs(one), initial=1e-300))
        worst = max(worst, float(np.max(np.abs(R[k] - one), initial=0.0)) / scale)
        gap = max(gap, float(np.max(np.abs(stacked.c[k] - d.closed.c), initial=0.0)))
    return worst, gap


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("which", ["rigid", "flexible"])
@pytest.mark.parametrize("name", model_names())
def test_stages_together_are_stages_one_by_one(name: str, which: str, size: int) -> None:
    # 50 modes would prove nothing that 8 do not, at 20 times the cost.
    m = pf.load(name, ["flexible.beam.basis.modes=8"] if name == "prprp" else [])
    system, home = (m.rigid, m.home) if which == "rigid" else (m.flexible, m.undeformed())
    force, gap = disagreement(system, home, size)
    assert force < ROUNDING
    assert gap < ROUNDING


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("loads", ["", FORCE])
def test_a_free_robot_with_every_kind_of_joint_too(loads: str, size: int, tmp_path: Path) -> None:
    m = load(tmp_path, MANIFOLD, MANIFOLD_YAML + loads)
    force, gap = disagreement(m.flexible, m.undeformed(), size)
    assert force < ROUNDING
    assert gap < ROUNDING


def test_a_second_call_remembers_nothing_of_the_first() -> None:
    m = pf.load("race_r2")
    system = m.flexible
    states = [random_state(system, m.undeformed(), seed) for seed in range(1, 5)]
    Y, V, A, lam = (np.array(part) for part in zip(*states, strict=True))
    stacked, t = Stacked(Dynamics(system), 2), np.zeros(2)
    first, second = slice(0, 2), slice(2, 4)
    R = stacked.residual(Y[first], V[first], A[first], lam[first], t).copy()
    c = stacked.c.copy()
    stacked.residual(Y[second], V[second], A[second], lam[second], t)
    again = stacked.residual(Y[first], V[first], A[first], lam[first], t)
    np.testing.assert_array_equal(again, R)
    np.testing.assert_array_equal(stacked.c, c)
