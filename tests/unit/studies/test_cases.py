"""Values of a sweep and how they combine."""

from __future__ import annotations

import numpy as np
import pytest

from pinflex.description.reading.parameters import assignments
from pinflex.errors import DescriptionError
from pinflex.studies.sweep import combined, listed, parsed, values


@pytest.mark.parametrize(
    "text, expected",
    [
        ("1e-3:3e-3:5", [0.001, 0.0015, 0.002, 0.0025, 0.003]),
        ("1:1e4:5:log", [1, 10, 100, 1000, 10000]),
        ("-.05:.05:3", [-0.05, 0, 0.05]),
        ("1:4:4", [1, 2, 3, 4]),
        ("7", [7]),
        ("1e-3, 2e-3", [0.001, 0.002]),
        ("[0, 0, -9.81],[0, 0, 0]", [[0, 0, -9.81], [0, 0, 0]]),
        ("{crank: 1, rod: 2},{crank: 3}", [{"crank": 1, "rod": 2}, {"crank": 3}]),
        ("steel,example-robot-data:ur5", ["steel", "example-robot-data:ur5"]),
        ("null", [None]),
    ],
)
def test_a_text_names_its_values(text, expected):
    # ranges keep 15 digits, so that 0.0025 is written as it is said
    assert values(text, "here") == expected


def test_a_range_between_whole_numbers_has_whole_numbers():
    """segments: 2.0 is not a number of segments."""
    assert [type(x) for x in values("1:3:3", "here")] == [int] * 3
    assert [type(x) for x in values("1:2:3", "here")] == [float] * 3


@pytest.mark.parametrize(
    "text, said",
    [
        ("1:2", "not a range"),
        ("1:2:0", "not a range"),
        ("1:2:3:lo", "not a range"),
        ("-1:1:3:log", "cross zero"),
        ("", "no value"),
        ("1,,2", "here"),
    ],
)
def test_what_is_no_list_of_values_is_said(text, said):
    with pytest.raises(DescriptionError, match=said):
        values(text, "here")


def test_every_combination_the_last_parameter_fastest():
    cases = combined({"a": [1, 2], "b": ["x", "y"]})
    assert cases == [{"a": 1, "b": "x"}, {"a": 1, "b": "y"}, {"a": 2, "b": "x"}, {"a": 2, "b": "y"}]
    assert combined({}) == [{}]


def test_pairs_need_equal_numbers_or_one_for_all():
    assert combined({"a": [1, 2], "b": [3]}, paired=True) == [{"a": 1, "b": 3}, {"a": 2, "b": 3}]
    with pytest.raises(DescriptionError, match="a has 2, b has 3"):
        combined({"a": [1, 2], "b": [1, 2, 3]}, paired=True)
    with pytest.raises(DescriptionError, match="combinations are more"):
        combined({str(k): [0] * 1000 for k in range(4)})


def test_options_name_keys_once():
    assert parsed(["a.b=1,2"], "--set") == {"a.b": [1, 2]}
    for wrong, said in ((["a"], "KEY=VALUES"), (["a=1", "a=2"], "given twice")):
        with pytest.raises(DescriptionError, match=said):
            parsed(wrong, "--set")


def test_python_values_are_written_to_the_last_digit():
    third = 1 / 3
    given = {"a": np.array([third]), "b": [np.int64(2)], "c": "1:2:2", "d": third, "e": [[third]]}
    found = listed(given, "here")
    assert found == {"a": [third], "b": [2], "c": [1, 2], "d": [third], "e": [[third]]}
    assert assignments({"a.b": third, "c": "x"}) == [f"a.b={third!r}", 'c="x"']
    for wrong in ([], {}, {"a": 1}, [object()]):
        with pytest.raises(DescriptionError, match="no list of values"):
            listed({"a": wrong}, "here")
