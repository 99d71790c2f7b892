"""Deviation of a frame at level ked: its rates are those of what is told."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

import pinflex as pf


def test_rates_of_a_deviation_are_its_derivatives():
    run = pf.solve(pf.load("delta"), level="ked", until=0.05, samples=2001)
    told = [
        run.arrays[f"frame/plate/{key}"][:, [0, 2, 4]]  # the others are none, by symmetry
        for key in ("deviation", "deviation_rate", "deviation_acceleration")
    ]
    for x, rate in pairwise(told):
        differences = (x[2:] - x[:-2]) / (2 * run.t[1])
        # central differences over 25 us: 4e-5 was seen of accelerations, 1e-5 of rates
        limit = 1e-4 * np.abs(rate).max(axis=0)
        assert np.all(np.abs(differences - rate[1:-1]) < limit)
