"""Equilibria many at a time are those found one after the other; interpolated ones keep a tol.

Claims:
    Levels, energy, steps
    - equilibria many at a time = one after the other, five scenes | 1e-10 | 1.5e-13
    - the same within tol 1e-2, 1e-4, at Chebyshev points | tol | 2.4e-3, 4.4e-6
    - swings of 5 to 13 periods, faster than the first nodes, are noticed | tol 1e-2 | passes
    - each piece of a motion gets the Chebyshev points that its coefficients ask for, none is
      evaluated twice | 10 times what was asked for | passes
"""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.description.motions.motion import harmonic
from pinflex.integrators.chebyshev import PiecewiseChebyshev
from pinflex.levels.outputs import Outputs
from pinflex.levels.quasistatic import solve_quasistatic
from pinflex.levels.quasistatic_smooth import solve_equilibria
from pinflex.solver.solve import default_motion

# Loops in space under gravity; loops in the plane whose platform moves by stretch alone; a tree; a
# large deflection; acceleration that jumps at the corners of a trapezoid.
SCENES = {
    "race_r2": ([], 0.4),
    "race_r1": (["flexible.*.axial=true"], 0.2),
    "ur5": ([], 0.8),
    "spinning_beam": ([], 20.0),
    "3tpt": ([], 0.7),
}


def scene(name: str) -> tuple[pf.Mechanism, pf.Motion, np.ndarray]:
    changes, end = SCENES[name]
    robot = pf.load(name, changes)
    return robot, default_motion(robot), np.linspace(0.0, end, 41)


@pytest.mark.parametrize("name", SCENES)
def test_many_at_a_time_is_one_after_the_other(name):
    """To what a balance to round-off leaves of the largest value."""
    robot, motion, t = scene(name)
    one, many = solve_quasistatic(robot, motion, t), solve_equilibria(robot, motion, t)
    assert many.cost["steps"] > len(t)  # nodes and samples: it was not left to the march
    for key in ("y", "lam", "torque"):
        a, b = getattr(one, key), getattr(many, key)
        assert np.max(np.abs(a - b), initial=0.0) <= 1e-10 * np.max(np.abs(a), initial=0.0), key


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("tol", [1e-2, 1e-4])
def test_a_tolerance_is_kept_with_fewer_instants(name, tol):
    robot, motion, t = scene(name)
    t = np.linspace(0.0, t[-1], 201)
    one = solve_quasistatic(robot, motion, t)
    few = solve_equilibria(robot, motion, t, tol)
    errors = Outputs(robot, motion, t).differences(few, one)
    print(name, tol, few.cost, {k: f"{e:.1e}" for k, e in errors.items()})
    assert max(errors.values()) <= tol
    if tol == 1e-2:
        assert few.cost["steps"] < len(t) / 2


def test_where_the_load_is_too_much_the_march_says_when():
    """Gravity buckles the thin links of the 3-RRS as it sinks."""
    robot = pf.load("3rrs", ["solve.integrator=generalized_alpha", "solve.newmark=null"])
    with pytest.raises(pf.ConvergenceError, match=r"3rrs: t = 0\.\d+ s: no equilibrium") as caught:
        pf.solve(robot, level="quasistatic", tol=1e-2, samples=101)
    good = caught.value.result
    assert 0.5 < good.t[-1] < 0.6 and np.all(np.isfinite(good.arrays["eta"]))


def test_pieces_interpolate_smooth_parts_to_round_off_and_keep_their_corner():
    pieces = PiecewiseChebyshev(0.0, 2.0, [1.0])
    f = lambda t: np.where(t < 1.0, np.sin(3 * t), 5 + np.cos(2 * t))  # noqa: E731
    nodes, t = pieces.nodes(16), np.linspace(0.0, 2.0, 97)
    found = pieces.between(f(nodes)[:, :, None], t)[:, 0]
    away = ~pieces.at_corner(t)
    assert np.sum(~away) == 3
    assert np.max(np.abs(found - f(t))[away]) < 1e-13
    assert np.all(pieces.nodes(32)[:, ::2] == nodes)


@pytest.mark.parametrize("speed", [1.0, 30.0, 200.0])
def test_each_piece_gets_the_nodes_that_its_coefficients_ask_for(speed):
    """cos(speed t) in the first, at rest in the second: entire, so that coefficients drop fast."""
    pieces, close = PiecewiseChebyshev(0.0, 2.0, [1.0]), 1e-9
    asked = []

    def f(t):
        asked.append(t)
        return np.where(t < 1.0, np.cos(speed * t), np.cos(speed))[:, None]

    n = [16, 8]
    first = np.split(f(pieces.times(n)), [17])
    values, missed = pieces.refined(first, f, lambda x: float(np.max(np.abs(x))), close, 1000, {1})
    assert missed < close and len(values[1]) == 9
    assert 0.5 * speed < len(values[0]) <= max(17, 4.0 * speed)
    assert sum(len(t) for t in asked) == sum(len(x) for x in values)  # none twice
    t = np.linspace(0.0, 2.0, 333)
    assert np.max(np.abs(pieces.between(values, t) - f(t))) < 10 * close
    few, missed = pieces.refined(first, f, lambda x: float(np.max(np.abs(x))), close, 26, {1})
    assert [len(x) for x in few] == [17, 9] and (missed < close) == (speed == 1.0)


def test_the_last_two_polynomials_are_left_out_of_the_coarser_values():
    pieces, n = PiecewiseChebyshev(0.0, 1.0, []), 8
    x = 2.0 * pieces.nodes(n)[0] - 1.0
    inside = (np.polynomial.Polynomial([1, -2, 0.5, 0, 0, 3, -1])(x))[None, :, None]
    whole = inside + (np.cos(7 * np.arccos(x)) - 2 * np.cos(8 * np.arccos(x)))[None, :, None]
    # The nodes end 1e-9 of the time inside the piece, which the steep last polynomials show.
    np.testing.assert_allclose(whole - pieces.last_two(whole), inside, atol=1e-6)


@pytest.mark.parametrize("periods", [5, 6, 7, 12, 13])
def test_a_motion_faster_than_the_nodes_is_noticed(periods):
    """Few points of a fast swing look like a slow one.

    Links that vibrate at 9 Hz are shaken up to half above: swings of twice the size fold there.
    """
    robot = pf.load("race_r2")
    t = np.linspace(0.0, 1.0, 401)
    motion = harmonic(
        joints=dict(zip(robot.motors, (0.005, 0.01, -0.005), strict=True)),
        frequency=float(periods),
        duration=1.0,
    )
    few = solve_equilibria(robot, motion, t, 1e-2)
    errors = Outputs(robot, motion, t).differences(few, solve_quasistatic(robot, motion, t))
    assert max(errors.values()) <= 1e-2


def test_a_hold_costs_one_balance():
    robot = pf.load("delta")
    run = pf.solve(robot, pf.hold(duration=1.0), level="quasistatic", samples=41)
    known = pf.static_equilibrium(robot)
    assert run.meta["cost"]["steps"] == 1
    assert run.torque.shape[0] == len(run.t) == 41
    # Newton ends at round-off of the coordinates
    assert np.allclose(run.torque, known.r[robot.flexible.motors], rtol=1e-9, atol=0)
