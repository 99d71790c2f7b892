"""Matrices of the linear system between Chebyshev points are those evaluated at every step.

Claims:
    Advice
    - samples of level ked by interpolation = those of all its steps | 1e-8 | passes
    Levels, energy, steps
    - matrices of ked between Chebyshev points = at every step | 1e-8 | passes
    - the same along a sampled motion, cut at its samples; one object while the robot rests | 1e-8 |
      passes
    Tolerances, collocation
    - an entry of a linear system that starts to move between the first nodes is noticed | by hand |
      exact | passes
"""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.actuation.drive import nominal
from pinflex.integrators.chebyshev import varying
from pinflex.integrators.collocation import generalized_alpha
from pinflex.levels.ked import LinearMarch, method_of, solve_ked
from pinflex.levels.linearised import InterpolatedPath, LinearPath, Matrices, VaryingEntries, along
from pinflex.solver.solve import default_motion

# A cycloid that ends in the middle of the run; acceleration that jumps at the corners of a
# trapezoid, in space; gravity, and damping of the whole system; gyroscopic terms that cancel in the
# plane, so that C is round-off (nodes were doubled in vain there, and every step evaluated).
SCENES = {
    "race_r1": ([], 0.2, 401),
    "3tpt": ([], 0.7, 701),
    "3rrs": (["damping.scope=system", "solve.until=1"], 1.0, 301),
    "spinning_beam": ([], 20.0, 601),
}


@pytest.mark.parametrize("name", SCENES)
def test_interpolated_matrices_are_those_of_every_step(name):
    changes, end, steps = SCENES[name]
    robot = pf.load(name, changes)
    motion = default_motion(robot)
    path = nominal(robot, motion, np.linspace(0.0, end, steps))
    at, every = along(robot, motion, path, False, 1e-9), LinearPath(robot, path)
    assert isinstance(at, InterpolatedPath)
    n = len(robot.flexible.free)
    for k in (0, 1, 7, steps // 3, steps // 2 - 1, steps // 2, steps - 2, steps - 1):
        between, here = at.at(k), every.at(k)
        for a, b in zip(between[:5], here[:5], strict=True):
            for rows in (slice(0, n), slice(n, None)):  # free coordinates, and motors
                x, y = (m.T[rows] if m.shape == between.J.shape else m[rows] for m in (a, b))
                # `close` is what the last polynomials hold; the largest entries of the whole motion
                # scale it, so those of one step get ten times as much.
                assert np.max(np.abs(x - y), initial=0.0) <= 1e-8 * np.max(np.abs(y), initial=1.0)
        assert np.allclose(between.base, here.base, rtol=1e-8, atol=1e-8)


def test_few_steps_are_evaluated_each():
    robot = pf.load("race_r1")
    motion = default_motion(robot)
    path = nominal(robot, motion, np.linspace(0.0, 0.2, 31))
    at, every = along(robot, motion, path, False, 1e-9), LinearPath(robot, path)
    assert not isinstance(at, InterpolatedPath)
    assert np.array_equal(at.at(9).free.K, every.at(9).free.K)


def test_a_sampled_motion_is_cut_at_its_samples_and_rests_after_them():
    """Smooth only between its samples: over all of them no number of nodes would do."""
    robot = pf.load("race_r1")
    t = np.linspace(0.0, 0.1, 11)
    moves = {"motor_1": 0.2 * np.sin(0.5 * np.pi * t / 0.1) ** 2}
    motion = pf.sampled(t=t, joints=moves, absolute=False)
    path = nominal(robot, motion, np.linspace(0.0, 0.2, 1001))
    at, every = along(robot, motion, path, False, 1e-9), LinearPath(robot, path)
    assert isinstance(at, InterpolatedPath)
    for k in (1, 49, 50, 51, 320, 499, 500, 501, 600):
        a, b = at.at(k).free, every.at(k).free
        for x in "MCKrJ":
            gap = np.max(np.abs(getattr(a, x) - getattr(b, x)))
            assert gap <= 1e-8 * np.max(np.abs(getattr(b, x)), initial=1.0), (k, x)
    free = np.arange(len(robot.flexible.free))
    square = [x.picked(free, free) for x in at.parts[:3]]
    J = at.parts[3].picked(np.arange(at.parts[3].shape[0]), free)
    march = LinearMarch(generalized_alpha(), at.grid, (*square, J), 1e-3)
    # One system: a march keeps its factors while the robot rests.
    assert march._at[600] == march._at[700] != march._at[300]


@pytest.mark.parametrize("name", ["3rrr", "race_r2"])
def test_samples_of_the_linear_march_are_those_of_all_its_steps(name):
    """Between samples the nominal motion is not solved for: matrices are interpolated."""
    robot = pf.load(name)
    motion = default_motion(robot)
    t = np.linspace(0.0, motion.duration, 1201)
    march = method_of(robot.description.solve)
    each, few = (solve_ked(robot, motion, t, march, every=n) for n in (1, 6))
    assert len(few.t) == 201 and few.cost == each.cost and few.settings == each.settings
    for x in ("y", "v", "a", "lam", "torque"):
        whole, some = getattr(each, x), getattr(few, x)
        # two polynomials through nodes that Newton closes to 1e-12
        assert np.max(np.abs(whole[::6] - some)) <= 1e-8 * np.max(np.abs(whole), initial=1e-6)


def test_what_varies_late_is_noticed():
    """An entry that is constant at the first times and not at others is among those that vary."""
    t = np.array([0.0, 1.0, 0.25, 0.5])
    rows = np.stack([np.ones(4), 2.0 + t, t * (1.0 - t)], axis=1)
    first, then = rows[:2], rows[2:]
    none, load = np.zeros((3, 0)), np.zeros(3)
    like = Matrices(none, none, none, np.zeros((0, 3)), load, np.zeros(0))
    entries = VaryingEntries(lambda _: then, first, like)
    assert entries.at(t[2:]).shape == (2, 1)
    assert entries.varies.tolist() == [False, True, False]
    assert entries.late.tolist() == [False, False, True]
    both = VaryingEntries(lambda _: then, first, like, also=entries.varies | entries.late)
    assert np.array_equal(both.at(t[2:]), then[:, 1:]) and not np.any(both.late)
    found = varying(then)
    assert found.entries.tolist() == [1, 2] and np.array_equal(found.whole(), then)
