"""What a proposal uses of what is allowed."""

from __future__ import annotations

import pytest

from pinflex.advice.reduced_models import Advice


def test_a_proposal_is_judged_by_its_worst_output() -> None:
    made = Advice("robot", 0.01, ("torque",), allowed={"platform": 0.05})
    assert made.used({"torque": 0.002, "platform": 0.04}) == pytest.approx(0.8)
    assert made.used({"torque": 0.02, "platform": 0.04}) == pytest.approx(2.0)
