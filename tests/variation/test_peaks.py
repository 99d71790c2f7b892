"""Sensitivities of the peaks of runs: a closed form, and designs run anew in steps of their own.

Claims:
    Derivatives, designs, scatter, fits
    - a cantilever pushed at its tip: its largest deflection goes with E^-1, thickness^-3, rho^0,
      its stress with thickness^-2, however many modes ring | closed form (similarity of the
      equations) | 1e-5; covered by what is told | 1e-9 and 4e-6
    - peaks of coupled runs (deviation, torque, stress): delta, 3rrr, the first 0.1 s of 3rrs, ur5
      with drives | designs run anew, each in steps of its own, peaks off its own samples | 1e-3;
      covered by what is told | 1e-6 on delta; on 3rrr 2e-6, 4e-5, 4e-6 (4e-3 with steps ten times
      as rough)
    - 3rrr without its damping: what nothing damps and no step resolves is said | - | said | said
    - which peak takes over at which change: delta | runs on both sides of it | 1e-3 s | passes
    - quasistatic peaks: 47 samples give the derivatives of 401 | - | 1e-5 | passes
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial

import pinflex as pf
from pinflex.results.comparison import comparison
from pinflex.variation.peaks import Peaks, Windows, around, highest, steps_around
from pinflex.variation.variants import variants

ASKED = 1e-3  # of coupled peaks
OUTPUTS = ["deviation.peak", "torque.peak", "stress.peak"]
PUSHED = ["gravity=[0, 0, 0]", "forces={push: {at: tip, force: [0, 0, -1e-3]}}",
          "solve={level: coupled, until: 0.4, start: straight}"]  # fmt: skip


@pytest.mark.parametrize("level", ["coupled", "ked"])
def test_a_pushed_cantilever_has_the_exponents_of_its_equations(level):
    # y = F L^3 / (E I) Y(t sqrt(E I / (rho A L^4))): a peak inside the run has the exponents of
    # what stands before Y, however many modes ring; its stress those of M / (w t^2)
    robot = pf.load("cantilever", PUSHED)
    exponents = {"section.thickness": (-3, -2), "material.rho": (0, 0)}
    by = [f"flexible.beam.{key}" for key in exponents]
    found = pf.sensitivities(robot, by, ["deviation.peak", "stress.peak"], level)
    exact = np.array(list(exponents.values()))
    assert np.all(np.abs(found.table - exact) <= found.error)
    if level == "coupled":  # ked, in equal steps of second order, is told to 0.01
        # deflections of 1e-4 of the length change the exponents by their square
        np.testing.assert_allclose(found.table, exact, atol=1e-5)


@pytest.mark.parametrize(
    "model, changes, key, tol, step, samples, noise",
    [
        ("delta", ["solve.until=0.1"], "flexible.arm_?.section.diameter", 1e-6, 1e-3, 401, 2e-5),
        # its deviation, of 2.5 um, still has 1e-5 of vibration where it is largest, whose phase
        # the thickness shifts by a thousand radians: a derivative of 0.004
        ("3rrr", ["solve.until=0.12"], "flexible.*.section.thickness", 3e-6, 4e-3, 1921, 5e-5),
        ("3rrs", ["solve.until=0.1"], "flexible.*.section.thickness", 5e-5, 4e-3, 401, 5e-4),
        ("models/ur5/geared.yaml", [], "joints.elbow_joint.drive.stiffness", 3e-5, 1e-2, 401, 2e-5),
    ],
)  # fmt: skip
def test_peaks_are_those_of_designs_run_in_steps_of_their_own(
    model, changes, key, tol, step, samples, noise
):
    # each design by a tolerance, so in other steps, and its peaks off its own samples
    robot = pf.load(model, changes)
    outputs = OUTPUTS if robot.parts else OUTPUTS[:2]
    found = pf.sensitivities(robot, [key], outputs, "coupled")
    designs = variants(robot, [key])
    (parameter,) = designs.parameters

    def difference(h):
        below, above = (_peaks(designs.scaled(parameter, s), tol, samples) for s in (-h, h))
        return np.array([np.log(above[name] / below[name]) / (2 * h) for name in outputs])

    wide, near = difference(step), difference(0.5 * step)
    expected = (4 * near - wide) / 3
    np.testing.assert_allclose(found.table[0], expected, atol=ASKED)
    # what is told covers it, but for the noise of runs by `tol` over the step
    own = noise + np.abs(near - expected)
    assert np.all(np.abs(found.table[0] - expected) <= found.error[0] + own)
    assert np.all(found.error < ASKED)


def _peaks(robot, tol, samples):
    """Peaks of a run by a tolerance, each by a polynomial through seven of its samples."""
    run = pf.solve(robot, level="coupled", tol=tol, samples=samples)
    rigid = pf.solve(robot, level="rigid", samples=samples)
    off = run.deviation_from(rigid, robot.description.platform).norm
    found = {"deviation.peak": _refined(off), "torque.peak": max(map(_refined, abs(run.torque).T))}
    stresses = [run.link(link).von_mises for link in run.links]
    if stresses:
        worst = max(stresses, key=np.max)
        found["stress.peak"] = _refined(worst[:, np.argmax(worst.max(axis=0))])
    return found


def _refined(curve):
    k = int(np.argmax(curve))
    if k in (0, len(curve) - 1):
        return curve[k]
    first = min(max(k - 3, 0), len(curve) - 7)
    line = Polynomial.fit(np.arange(first, first + 7), curve[first : first + 7], 6)
    tops = line.deriv().roots()
    near = tops[(abs(tops.imag) < 1e-9) & (abs(tops.real - k) <= 1)].real
    return float(line(near).max())


def test_the_3rrr_without_damping_says_what_its_steps_leave_out():
    (said,) = Peaks(pf.load("3rrr", ["damping={modal: 0}"]), ["deviation.peak"], None).remarks
    assert "too fast for the steps" in said and "damping: {modal: 0.01}" in said


def test_peaks_that_take_turns_are_told():
    # the largest torque of the delta is at 0.074 s; with thinner arms an earlier one overtakes it
    robot = pf.load("delta", ["solve.until=0.1"])
    key = "flexible.arm_?.section.diameter"
    found = pf.sensitivities(robot, [key], ["torque.peak"], "coupled")
    (said,) = found.remarks
    assert said.startswith(f"{key}: 0.65 % less of it makes another peak the largest of torque")
    designs = variants(robot, [key])

    def top(change):
        run = pf.solve(designs.at({key: 0.036 * (1 + change)}), level="coupled", tol=1e-4)
        return run.t[np.unravel_index(np.argmax(abs(run.torque)), run.torque.shape)[0]]

    assert top(-0.004) == pytest.approx(0.0742, abs=1e-3)
    assert top(-0.009) == pytest.approx(0.0492, abs=1e-3)


def test_peaks_stand_a_little_above_the_samples_of_a_table():
    robot = pf.load("cantilever", [*PUSHED, "solve.tol=1e-7", "solve.samples=61"])
    peaks = Peaks(robot, OUTPUTS, None)
    run, rigid = (pf.solve(robot, level=level) for level in ("coupled", "rigid"))
    (row,) = comparison(rigid, {"coupled": run}).platform
    # 61 samples of 0.4 s; the first mode, of 1.7 Hz, moves by (pi f dt)^2 / 2 between them
    assert 0 <= peaks.values["deviation.peak"] / row.position - 1 < 2e-3
    assert "torque.peak" not in peaks.values  # no motor


def test_quasistatic_peaks_between_samples():
    # a tenth of the samples gives the same derivative: they only say where to look
    key = "flexible.arm_?.section.wall"
    found = [
        pf.sensitivities(robot, [key], ["deviation.peak", "torque.peak"], "quasistatic")
        for robot in (pf.load("delta", [f"solve.samples={n}"]) for n in (401, 47))
    ]
    np.testing.assert_allclose(found[0].table, found[1].table, atol=1e-5)
    assert max(table.error.max() for table in found) < 1e-5


def test_windows_find_the_top_of_a_curve():
    nodes, closed = around(0.31, 0.05, (0.0, 1.0))
    ends, shut = around(0.99, 0.05, (0.0, 1.0))
    windows = Windows(np.array([nodes, ends]), np.array([closed, shut]))
    assert not closed.any() and shut.tolist() == [False, True] and ends[-1] == 1.0
    curves = [np.cos(3 * (nodes - 0.3)), np.exp(ends), np.exp(nodes)]
    top, fewer, inside = windows.tops(np.array([0, 1, 0]), np.array(curves))
    # 0.15 rad from the middle: the ninth and the fifth term of a cosine
    np.testing.assert_allclose(top[:2], [1.0, np.e], rtol=1e-12)
    np.testing.assert_allclose(fewer[:2], [1.0, np.e], rtol=1e-6)
    assert inside.tolist() == [True, True, False]  # an end of the run is one; a flank is not


def test_local_maxima_near_the_largest_and_windows_of_steps():
    curve = np.array([0.99, 0.5, 1.0, 0.9, 0.3, 0.985])
    assert highest(curve, 0.02, 5).tolist() == [2, 0, 5]
    assert highest(curve, 0.012, 1).tolist() == [2]
    t = np.linspace(0.0, 1.0, 21)
    nodes, closed = steps_around(20, t)
    assert nodes[-1] == 1.0 and len(nodes) == 9 and closed.tolist() == [False, True]
