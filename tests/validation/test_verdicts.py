"""`compare` and `advise` agree, and a proposal keeps its tolerance or says that it does not.

The rest of the scenes, among them a UR10 with gears and a Panda with its gripper, takes minutes:
`python -m tests.benchmarks.verdicts`.

Claims:
    Advice
    - compare and advise never contradict each other, and a proposal keeps its tolerance against a
      finer run or says NOT REACHED: a five-bar, a Panda with its gripper; `python -m
      tests.benchmarks.verdicts` for all | a third of what is allowed | passes
"""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import pytest

from tests.benchmarks.verdicts import judge, scenes

CHEAP = {"five-bar": 2, "panda": 1}  # motions: smooth, and one whose acceleration jumps


@pytest.mark.parametrize("name", CHEAP)
def test_two_commands_have_one_verdict(name: str, tmp_path: Path) -> None:
    for _, motion, robot in islice(scenes([name], tmp_path), CHEAP[name]):
        found = judge(robot)
        assert not found.wrong, (motion, found)
        if (name, motion) == ("panda", "smooth"):  # 2 um off, whatever its idle finger does
            assert found.compared == found.proposed == "rigid"
        if name == "five-bar":
            assert found.compared == "ked" and found.proposed == "coupled"
            assert found.error <= found.bar <= 1.0  # the bar covers what a finer run measures
