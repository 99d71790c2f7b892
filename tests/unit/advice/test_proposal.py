"""What a proposal uses of what is allowed."""

from __future__ import annotations

import pytest

import pinflex as pf
from pinflex.advice import advise
from pinflex.advice.reduced_models import SAFETY, Advice


def test_a_proposal_is_judged_by_its_worst_output() -> None:
    made = Advice("robot", 0.01, ("torque",), allowed={"platform": 0.05})
    assert made.used({"torque": 0.002, "platform": 0.04}) == pytest.approx(0.8)
    assert made.used({"torque": 0.02, "platform": 0.04}) == pytest.approx(2.0)


@pytest.mark.parametrize("name", ["ur5", "delta"])
def test_prices_of_linear_motions_are_those_of_corrected_ones(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where corrections change little: the same proposal, and bars within what that is allowed."""
    share, robot = advise._LINEAR, pf.load(name)
    found = advise.advise(robot)
    with monkeypatch.context() as m:
        m.setattr(advise, "_LINEAR", 0.0)
        wanted = advise.advise(robot)
    assert (found.level, found.overrides) == (wanted.level, wanted.overrides)
    pairs = list(zip(found.left_out, wanted.left_out, strict=True))
    assert any(a.error != b.error for a, b in pairs)
    for a, b in pairs:
        assert (a.what, a.out) == (b.what, b.out)
        apart = {k: abs(e - b.error[k]) for k, e in a.error.items()}
        assert found.used(apart) <= share  # of the largest price there can be, which is one
    bars = {k: abs(e - wanted.error[k]) for k, e in found.error.items()}
    assert found.used(bars) <= SAFETY * share
