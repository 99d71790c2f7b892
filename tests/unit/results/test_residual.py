"""Vibration after a stop: read off decaying sines whose amplitude and settling time are known.

Claims:
    Pages, pictures, figures
    - amplitude and settling time of a decaying vibration, rest told or found; the verdict's words |
      1e-6 s told, 1e-3 s found | passes | also `unit/results/test_comparison.py`
"""

import numpy as np
import pytest

from pinflex.results.verdict import residual

RATE, OMEGA, HEIGHT, STOP = 8.0, 2 * np.pi * 40.0, 200e-6, 0.3  # [1/s], [rad/s], [m], [s]
PLACE = np.array([30e-6, 0.0, -80e-6])  # [m] off rigid at rest
T = np.linspace(0.0, 0.9, 3601)  # [s] a hundred instants a period


def ringing(t=T):
    """A decaying circle: its distance from rest has no ripple. Before the stop, a bump."""
    after = HEIGHT * np.exp(-RATE * (t - STOP)) * (t >= STOP)
    before = 5e-3 * np.sin(np.pi * t / STOP) * (t < STOP)
    circle = np.stack([np.cos(OMEGA * t), np.sin(OMEGA * t), 0 * t], axis=1)
    return PLACE + (before + after)[:, None] * circle


@pytest.mark.parametrize("band", [20e-6, 50e-6, 150e-6])
def test_a_decaying_vibration_settles_when_its_envelope_enters_the_band(band):
    amplitude, settling = residual(T, ringing(), STOP, band, PLACE)
    assert amplitude == pytest.approx(HEIGHT)
    # linear between instants 0.25 ms apart: second order in RATE * 0.25 ms
    assert settling == pytest.approx(np.log(HEIGHT / band) / RATE, abs=1e-6)


def test_where_it_comes_to_rest_is_found_without_being_told():
    amplitude, settling = residual(T, ringing(), STOP, 50e-6)
    # 24 periods: a Hann window leaves 1e-4 of the vibration in the mean
    assert amplitude == pytest.approx(HEIGHT, rel=1e-3)
    assert settling == pytest.approx(np.log(4) / RATE, abs=1e-3)


def test_one_that_never_leaves_the_band_has_settled_at_once():
    assert residual(T, ringing(), STOP, 250e-6, PLACE)[1] == 0.0


def test_one_that_may_leave_the_band_again_has_not_settled():
    line = PLACE + np.array([1.0, 0, 0]) * (HEIGHT * np.cos(OMEGA * (T - STOP)))[:, None]
    end = STOP + 0.1 + np.pi / OMEGA / 2 >= T  # ends a quarter of a period after a peak, at zero
    _, settling = residual(T[end], line[end], STOP, 50e-6, PLACE, period=2 * np.pi / OMEGA)
    assert settling is None
    assert residual(T[end], line[end], STOP, 50e-6, PLACE)[1] is not None  # seen too late


def test_what_happens_before_the_stop_does_not_count():
    assert residual(T, ringing(), STOP, 1e-6, PLACE)[0] < 1.001 * HEIGHT


@pytest.mark.parametrize(("periods", "settled"), [(0.4, False), (0.6, True)])
def test_half_a_period_within_the_band_is_what_it_takes_to_settle(periods, settled):
    period, enters = 2 * np.pi / OMEGA, STOP + np.log(4) / RATE
    seen = enters + periods * period > T
    _, settling = residual(T[seen], ringing()[seen], STOP, 50e-6, PLACE, period)
    assert (settling is not None) == settled
