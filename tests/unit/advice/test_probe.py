"""The cheap look at a flexible motion: what it interpolates, corrects and leaves out.

Claims:
    Advice
    - interpolated matrices = level ked step by step | 1e-3 | passes (6e-3 before corners were kept)
    - each correction reduces the defect of forces and closures | fivefold | passes
    - a smaller basis is a subspace of the larger one | 1e-9 | passes
    - what a look balances is level quasistatic, but for what deflection adds to forces | Newton on
      the whole equations | 1e-3 | 5.8e-5
    - a probe of a motion that begins with an acceleration starts with the sag of rest | 1e-3 |
      2.4e-4
    Tolerances, collocation
    - corrections of a cheap look: what closes loops by joints alone and by least energy leads to
      the same motion | each other | 1e-5 | passes
"""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.actuation.drive import nominal
from pinflex.advice.probe import Probe, shapes_of
from pinflex.integrators.collocation import alpha, generalized_alpha
from pinflex.levels.ked import solve_ked
from pinflex.levels.quasistatic import solve_quasistatic
from pinflex.levels.start import linear_start
from pinflex.mechanics.model.parts import resolve
from pinflex.solver.solve import default_motion


@pytest.fixture(scope="module")
def robot() -> pf.Mechanism:
    """A planar arm of three loops whose links stretch, so that its platform moves."""
    return pf.load("race_r1", ["flexible.*.axial=true", "flexible.*.basis.internal=3"])


@pytest.fixture(scope="module")
def probe(robot) -> Probe:
    return Probe(robot, default_motion(robot), 0.2, static=False)


def largest(a: np.ndarray) -> float:
    return float(np.max(np.abs(a)))


def test_interpolated_matrices_give_the_vibration_of_level_ked(robot, probe):
    scheme = generalized_alpha(0.8)
    run = solve_ked(robot, default_motion(robot), probe.t, lambda *x: alpha(scheme, *x))
    fast = probe.linear(probe.march())
    # Cubics through 80 intervals of a cycloid that ends in the middle of the run, where the
    # third derivative of the motion jumps.
    assert largest(fast.torque - run.torque) < 1e-3 * largest(run.torque)
    n = robot.rigid.nq
    assert largest((fast.y - run.y)[:, n:]) < 1e-3 * largest(run.y[:, n:])


def test_each_correction_closes_the_loops_and_balances_the_forces_better(robot, probe):
    """The defect of the full equations falls at least fivefold each time."""
    sizes, gaps = [], []
    for found in probe.marched(2):
        left = probe.dynamics.residual(*probe._state(found), probe.t).r
        sizes.append(largest(left[:, robot.flexible.free]))
        gaps.append(largest(probe.dynamics.close(probe._poses(found)).c))
    assert sizes[1] < 0.2 * sizes[0] and sizes[2] < 0.2 * sizes[1]
    assert gaps[1] < 0.2 * gaps[0]


def test_fewer_shapes_are_a_subspace_of_more(robot):
    small = robot.description.with_overrides(["flexible.*.basis.internal=1"])
    parts = resolve(small, robot.links)
    B = shapes_of(robot.flexible, parts)
    m = robot.rigid.nv
    slot = robot.flexible.expansion.slots[0]
    few = parts[slot.link].bodies[0]
    first = B[m:][slot.eta][:, len(robot.flexible.free[robot.flexible.free < m]) :][:, : few.n]
    # Polynomials of a lower degree are polynomials of a higher one.
    for x in (0.3, 0.7, 1.0):
        at = x * few.length
        assert np.allclose(slot.body.rows(at)[0] @ first, few.rows(at)[0], atol=1e-9)


def test_a_rigid_link_has_no_columns(robot):
    parts = dict(robot.parts)
    gone = parts.pop("distal_1")
    every = shapes_of(robot.flexible, robot.parts)
    assert shapes_of(robot.flexible, parts).shape[1] == every.shape[1] - gone.bodies[0].n


def test_where_joints_alone_cannot_close_loops_least_energy_does(robot, probe):
    """Another part of the answer closes them, on the way to the same motion."""
    other = Probe(robot, default_motion(robot), probe.end, static=False, like=probe)
    other.__dict__["_straight"] = None
    for found, same in zip(other.marched(2), probe.marched(2), strict=True):
        # Both leave out what P's own rate brings, each its own: 8e-7 and 4e-6 are measured.
        assert largest(found.d - same.d) < 1e-5 * largest(same.d)
        assert largest(found.a - same.a) < 1e-4 * largest(same.a)


@pytest.mark.parametrize("name", ["ur5", "delta"])
def test_what_a_look_balances_is_level_quasistatic(name):
    """Deflections of up to 1e-3 of a length change loads, and their arms, by as much."""
    robot = pf.load(name)
    motion = default_motion(robot)
    probe = Probe(robot, motion, 0.2, static=True)
    at, n = np.arange(0, probe.steps, 16), robot.rigid.nq
    found = probe.still(at)
    whole = solve_quasistatic(robot, motion, probe.t[at])
    assert largest((found.y - whole.y)[:, n:]) < 1e-3 * largest(whole.y[:, n:])
    assert largest(found.torque - whole.torque) < 1e-3 * largest(whole.torque)


def test_a_motion_that_begins_with_an_acceleration_starts_with_the_sag_of_rest():
    """As level ked starts: what the acceleration bends is not there yet (it was: 29 % of a torque).

    The correction then starts in the nonlinear balance, off the linear one by second order.
    """
    robot = pf.load("ur5", ["motion.kind=trapezoid", "motion.ramp=0.1"])
    motion = default_motion(robot)
    probe = Probe(robot, motion, 0.2, static=True)
    linear, once = probe.marched(1)
    first = nominal(robot, motion, probe.t[:1])
    assert np.max(np.abs(first.a)) > 1.0  # rad/s^2, at once
    sag = linear_start(robot, first, False, "static", probe.dynamics).y
    free = robot.flexible.free
    # What the acceleration adds to the stiffness stays in: 2.4e-4 here.
    assert largest(linear.d[0, free] - sag) < 1e-3 * largest(sag)
    y, v, a, lam = (x[:1] for x in probe._state(once))
    left = probe.dynamics.residual(y, 0 * v, 0 * a, lam, probe.t[:1]).r[0, free]
    weight = largest(probe._at_rest(probe._none(1), slice(0, 1))[free])
    assert largest(left) < 1e-3 * weight  # deflections of 1e-3 of a length change a load as much
