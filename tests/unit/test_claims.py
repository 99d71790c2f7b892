"""The tables of claims say what the test files do, no more and no less."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import claims
from tests.claims import README, Claim, of_tables, of_tests, tables, take

PAGE = """\
# Page

## Beams
| claim | test | source | tolerance | achieved |
|---|---|---|---|---|
| a sags | `unit/test_a.py` | w L^4 / 8 EI | 1e-6 | 2e-9 |
| a is \\|straight\\|, said at such length that one line is too short | same | by hand | 0 | 0 |
| timed | `python -m tests.benchmarks.cost` | - | - | - |

Text.
"""


def test_the_tables_are_those_of_the_test_files() -> None:
    """After a change: `python -m tests.claims`, with `--take` for rows written into the tables."""
    text = README.read_text("utf-8")
    assert tables(text, of_tests()) == text
    assert {*of_tables(text).values()} == {*of_tests()}


def test_rows_move_into_a_test_and_come_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "TESTS", tmp_path)
    test = tmp_path / "unit" / "test_a.py"
    test.parent.mkdir()
    test.write_text('"""A beam."""\n\nx = 1\n', "utf-8")
    assert take(PAGE) == [test] and take(PAGE) == []
    text = test.read_text("utf-8")
    assert (
        text.startswith('r"""A beam.\n\nClaims:\n    Beams\n    - a sags | w L^4')
        and "x = 1" in text
    )
    assert max(map(len, text.splitlines())) <= 100
    same = PAGE.replace("| same |", "| `unit/test_a.py` |")
    assert tables(PAGE, claims.of_tests()) == same
    fewer = claims.of_tests()[:1]
    assert "straight" not in tables(same, fewer) and "| timed |" in tables(same, fewer)
    new = Claim("Beams", "unit/test_a.py", ("a twists", "Saint-Venant", "1e-9", "exact"))
    lines = tables(same, [*claims.of_tests(), new]).splitlines()
    assert (
        lines.index(new.row())
        == lines.index("| timed | `python -m tests.benchmarks.cost` | - | - | - |") - 1
    )
    with pytest.raises(ValueError, match="no table 'Shells'"):
        tables(same, [Claim("Shells", "unit/test_a.py", ("x", "y", "1", "0"))])
