"""Error bars beside the truth in four cheap scenes of the table of tests/benchmarks/BARS.md."""

from __future__ import annotations

import pytest

from tests.benchmarks.bars import HIGH, KNOWN, LOW, OWN, row

NAMES = ("arm_gravity", "arm_soft", "arm_stiff", "arm_side_only")


@pytest.mark.parametrize("name", NAMES)
def test_bars_are_half_to_ten_times_the_error(name: str) -> None:
    """Of time and of the model, of motion and of forces; errors below KNOWN are told as small."""
    found = row(name)
    assert found.told["model"], found.notes
    for of in ("time", "model"):
        ratios = found.ratios(of)
        assert all(LOW <= ratio <= HIGH for ratio in ratios.values()), ratios
        told, true = found.told[of], found.true[of]
        small = [key for key in told if key in true and true[key] <= KNOWN]
        assert all(told[key] <= 1e-5 for key in small)
    if name != "arm_side_only":  # at rest: nothing is integrated
        assert set(found.told["time"]) >= set(OWN)
