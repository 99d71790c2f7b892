"""Input shapers against their closed forms, and on a mass with a spring."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import pinflex as pf
from pinflex.description.shaping import shaper


@pytest.mark.parametrize("damping", [0.0, 0.02, 0.1])
@pytest.mark.parametrize("kind", ["zv", "zvd"])
def test_no_vibration_is_left_at_the_frequency_of_the_shaper(kind: str, damping: float) -> None:
    made = shaper(kind, 3.0, damping)
    assert made.shares.sum() == pytest.approx(1.0, abs=1e-14)
    assert made.residual(3.0, damping)[0] < 1e-14  # round-off of a sum of three numbers


def test_undamped_shapers_have_the_published_curves() -> None:
    """|cos(pi r / 2)| and its square; EI: 5 % at r = 1, none at two frequencies beside it."""
    ratio = np.linspace(0.7, 1.3, 61)
    np.testing.assert_allclose(
        shaper("zv", 1.0).residual(ratio), np.abs(np.cos(np.pi * ratio / 2)), atol=1e-14
    )
    np.testing.assert_allclose(
        shaper("zvd", 1.0).residual(ratio), np.cos(np.pi * ratio / 2) ** 2, atol=1e-14
    )
    ei = shaper("ei", 1.0).residual(ratio)
    np.testing.assert_allclose(ei, np.abs((1.05 * np.cos(np.pi * ratio) + 0.95) / 2), atol=1e-14)
    below = ratio[ei <= 0.05 + 1e-12]
    # Singhose, Seering, Singer (1994): insensitivity of EI 0.399, of ZVD 0.286 at 5 %
    assert below[-1] - below[0] == pytest.approx(0.398, abs=0.02)


def test_the_fit_for_damped_ei_leaves_five_per_cent() -> None:
    made = shaper("ei", 2.0, 0.1)
    assert made.residual(2.0, 0.1)[0] == pytest.approx(0.05, abs=0.005)  # the fit's own error


def test_two_modes_are_cancelled_by_the_product_and_the_time_adds_up() -> None:
    made = shaper("zv", [3.0, 7.0])
    np.testing.assert_allclose(made.residual([3.0, 7.0]), 0.0, atol=1e-14)
    assert made.duration == pytest.approx(0.5 / 3.0 + 0.5 / 7.0)


def test_a_shaped_motion_leaves_an_oscillator_at_rest() -> None:
    """x'' = -w^2 (x - p(t)), integrated by scipy: no pinflex in it but the motion."""
    from scipy.integrate import solve_ivp

    frequency = 4.0
    w = 2 * np.pi * frequency
    plain = pf.cycloid(joints={"a": 1.0}, duration=0.1)
    made = plain.shaped("zv", frequency)
    assert made.duration == pytest.approx(0.1 + 0.125)

    def rest(motion: pf.Motion) -> float:
        end = motion.duration
        pieces = np.unique(np.append(np.linspace(0.0, end, 400), [0.1, 0.125]))
        state = np.zeros(2)
        for a, b in pairwise(pieces):
            state = solve_ivp(
                lambda t, x: [x[1], -(w**2) * (x[0] - motion.evaluate(t)[0][0, 0])],
                (a, b),
                state,
                rtol=1e-10,
                atol=1e-12,
            ).y[:, -1]
        return float(np.hypot(state[0] - 1.0, state[1] / w))

    assert rest(plain) > 0.5
    assert rest(made) < 1e-6


def test_bad_shapers_are_refused() -> None:
    with pytest.raises(pf.DescriptionError, match="shaper: zdv.*zvd"):
        shaper("zdv", 1.0)
    with pytest.raises(pf.DescriptionError, match="above 0 Hz"):
        shaper("zv", -1.0)
    with pytest.raises(pf.DescriptionError, match="below 1"):
        shaper("zv", 1.0, 1.0)
