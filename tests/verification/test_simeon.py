"""The references of Simeon's slider-crank, by an integration that shares nothing with pinflex."""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.lab import simeon
from tests import simeon as own

# rtol of DOP853; over 0.1 s it leaves 1e-7 of the axial amplitudes (measured against 1e-12).
STEP = 1e-9


def test_our_integration_gives_the_published_numbers() -> None:
    w, _, lam = own.run(simeon.UNTIL, simeon.SET_START, own.TEST_SET, STEP)
    assert np.concatenate([w, lam]) == pytest.approx(np.array(simeon.SET_END), rel=2e-7)


def test_our_integration_gives_the_consistent_reference() -> None:
    w, _, lam = own.run(simeon.UNTIL, simeon.SMOOTH_START, own.CONSISTENT, STEP)
    assert np.concatenate([w, lam]) == pytest.approx(np.array(simeon.SMOOTH_END), rel=2e-7)


def test_pinflex_accelerates_the_same_masses_in_both_conventions() -> None:
    """One instant in the middle of nowhere: accelerations to round-off."""
    q, dq = np.array([2e-3, -1e-3, 1e-4, 2e-4]), np.array([0.7, -0.4, 0.05, 0.1])
    for factor in (1.0, 15.0):
        scene = simeon.Scene(factor)
        y, v = scene.start(q, dq)
        run = pf.solve(scene.m, level="coupled", start=(y, v), until=1e-7, dt=1e-7, samples=2)
        a, deflected = run.array("joint/a")[0], run.array("eta_a")[0]
        w, wd = np.concatenate([[0.0, simeon.CRANK + simeon.ROD + q[3]], q]), np.zeros(6)
        wd[0], wd[1], wd[2:] = v[scene.rows[0]] + v[scene.rows[1]], dq[3], dq
        expected, _ = own.accelerate(0.0, w, wd, (factor, float(np.pi)))
        found = np.concatenate([[a[scene.rows[1]], a[scene.rows[2]]], scene.to_q @ deflected])
        assert found == pytest.approx(expected, rel=1e-8)


def test_a_body_given_as_data_needs_a_link_that_is_flexible() -> None:
    body = pf.load("race_r3").parts["rod"].bodies[0]
    with pytest.raises(pf.DescriptionError, match=r"bodies: crank is not flexible.*Allowed: rod"):
        pf.load("race_r3", bodies={"crank": body})
