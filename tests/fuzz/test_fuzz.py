"""The first two hundred mangled inputs: one clear error or a right result answers each.

Claims:
    Bad input, costs, signals
    - 200 mangled YAMLs, URDFs, overrides, stored runs, commands and calls (`python -m tests.fuzz
      3000` for more): a right result or one clear line, none over 20 s without progress or over 2
      GB | - | 0 faults | 0
"""

from __future__ import annotations

from tests.fuzz.__main__ import SEED, fuzz, report


def test_two_hundred_mangled_inputs_are_answered() -> None:
    found = fuzz(SEED, 0, 200)
    assert len(found) == 200
    assert not any(one["fault"] for one in found), report(found)
    assert max(one["memory"] for one in found) < 2e9
