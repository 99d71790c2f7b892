"""Spectra on the record's grid, and the simulated modal test."""

from __future__ import annotations

import numpy as np
import pytest
from papers.modal_test import identify, modal_test
from papers.spectra import spectrum

import pinflex as pf
from pinflex.errors import DescriptionError
from tests.scenes import published

ROBOT = "flexible.*.basis={kind: craig_bampton, internal: 4}"
DAMPING = {103.1: 0.056, 286.3: 0.032}


def test_the_grid_is_the_articles() -> None:
    t = np.linspace(0.0, 0.2, 201)
    found = spectrum(t, np.sin(2 * np.pi * 1000 / 201 * 5 * t) + 0.5)
    assert found.resolution == pytest.approx(1000 / 201, rel=1e-12)
    (f, height), *_ = found.peaks(1)
    assert round(f, 2) == 24.88
    assert height == pytest.approx(1.0, rel=1e-9)  # a line of the grid has no leakage
    assert found.amplitude[0] == pytest.approx(0.5, rel=1e-9)


def test_unequal_steps_and_scraps_are_refused() -> None:
    with pytest.raises(DescriptionError, match="steps differ"):
        spectrum(np.array([0.0, 0.1, 0.3, 0.4, 0.5]), np.zeros(5))
    with pytest.raises(DescriptionError, match="4 samples"):
        spectrum(np.array([0.0, 0.1]), np.zeros(2))


def test_without_noise_a_hammer_finds_what_was_put_in() -> None:
    test = modal_test(pf.load(published("3rrr"), [ROBOT]), "distal_1", DAMPING)
    first, second = identify(test, 2)
    # 1e-3: the first mode's window has the tail of the second beside it.
    assert first.frequency == pytest.approx(test.exact[0, 0], rel=1e-3)
    assert second.frequency == pytest.approx(test.exact[3, 0], rel=1e-3)
    assert (first.damping, second.damping) == pytest.approx((0.056, 0.032), rel=5e-3)
    half = np.sin(np.pi * test.x / test.x[-1])
    # 1 %: quadrature at one line keeps a little of the other mode.
    np.testing.assert_allclose(np.abs(first.shape), half, atol=0.01)
    # The largest of the 11 points is at 0.3 or 0.4 of the length, not at the crest at 0.25.
    full = np.sin(2 * np.pi * test.x / test.x[-1])
    np.testing.assert_allclose(np.abs(second.shape), np.abs(full) / np.abs(full).max(), atol=0.03)


def test_the_response_functions_are_symmetric_and_those_of_the_modes() -> None:
    """Hit at a measured point, measure at a hit point: the same (Maxwell), and the modal sum."""
    robot = pf.load(published("3rrr"), [ROBOT])
    test = modal_test(robot, "distal_1", 0.05, hits=(0.3, 0.6), rate=8192.0)
    i, j = 3, 6  # of 11 points: 0.3 and 0.6 of the length
    np.testing.assert_allclose(test.frf[0, j, 1:], test.frf[1, i, 1:], rtol=1e-9)
    # A record of one second holds the whole decay, so H1 is the modal sum but for the hold.
    k = int(np.argmin(np.abs(test.frequency - 103.0)))
    s = 2j * np.pi * test.frequency[k]
    mass = 0.029505  # [kg] of the link; half of it moves in sin(pi x / L)
    shape = np.sin(np.pi * 0.3) * np.sin(np.pi * 0.6) / (mass / 2)
    w, z = 2 * np.pi * test.exact[0, 0], 0.05
    main = shape * s**2 / (s**2 + 2 * z * w * s + w**2)
    # 5 %: the higher modes' tails.
    assert abs(test.frf[0, j, k] - main) < 0.05 * abs(main)


def test_noise_is_averaged_away() -> None:
    test = modal_test(pf.load(published("3rrr"), [ROBOT]), "distal_1", DAMPING, noise=0.02)
    first, second = identify(test, 2)
    assert first.frequency == pytest.approx(103.37, rel=2e-3)
    assert first.damping == pytest.approx(0.056, rel=0.02)
    assert second.damping == pytest.approx(0.032, rel=0.02)


def test_the_library_of_the_trade_agrees() -> None:
    pytest.importorskip("sdypy.EMA", reason="pinflex[ema] is not installed")
    test = modal_test(pf.load(published("3rrr"), [ROBOT]), "distal_1", DAMPING)
    first, second = identify(test, 2, method="lscf")
    assert first.frequency == pytest.approx(test.exact[0, 0], rel=1e-4)
    assert second.frequency == pytest.approx(test.exact[3, 0], rel=1e-4)
    assert (first.damping, second.damping) == pytest.approx((0.056, 0.032), rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"link": "distal_9"}, "distal_1"),
        ({"across": "x"}, "across"),
    ],
)
def test_wrong_arguments_are_named(changes: dict[str, str], message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        modal_test(pf.load(published("3rrr"), [ROBOT]), **{"link": "distal_1", **changes})  # type: ignore[arg-type]
