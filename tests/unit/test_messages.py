"""The messages of bad input are part of the interface: they stay as they were written down.

Claims:
    Equations
    - messages of over 300 bad inputs: files, options of `solve`, sections, materials, motions |
      `golden/messages.txt` | text | exact
"""

from __future__ import annotations

from tests.golden.bad_inputs import FILE, messages


def test_every_bad_input_is_told_what_it_was_told_before() -> None:
    before, now = (text.split("\n\n") for text in (FILE.read_text("utf-8"), messages()))
    assert [entry for entry in now if entry.endswith("\nno error")] == []
    assert [pair for pair in zip(before, now, strict=True) if pair[0] != pair[1]] == []
