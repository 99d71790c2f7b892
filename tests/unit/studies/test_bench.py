"""Which points of a benchmark are worth taking, and what is said about them.

Claims:
    Work and precision
    - the Pareto set, the advice, a case that fails | by hand | exact | exact
"""

from __future__ import annotations

from pinflex.cli.bench import advice, report
from pinflex.studies.bench import Bench, Case, Point

POINTS = (
    Point(Case("rigid"), 0.1, 0.1, {"torque": 0.5}),
    Point(Case("ked", 1e-3), 0.4, 0.4, {"torque": 0.05}),
    Point(Case("alpha", 1e-3), 0.9, 0.9, {"torque": 0.06}),
    Point(Case("radau", 1e-3), 0.5, 0.5, {"torque": 5e-4}),
    Point(Case("alpha", 1e-4), 1.0, float("nan"), {}, "it diverged"),
)
FOUND = Bench("arm", POINTS, "coupled, radau", {"torque": 1e-6}, None)


def test_the_pareto_set_is_what_no_other_point_beats_in_both() -> None:
    assert [p.case.method for p in FOUND.pareto()] == ["rigid", "ked", "radau"]


def test_the_advice_names_the_cheapest_case_for_each_error() -> None:
    expected = "within 0.1 costs 0.4000 s by ked (dt 0.001 s); within 0.01 costs 0.5000 s by radau"
    assert expected in advice(FOUND)


def test_a_case_that_fails_is_named_with_its_reason() -> None:
    assert "it diverged" in report(FOUND, whole=True).text()


def test_one_screen_has_the_points_worth_taking_fastest_first_and_counts_the_rest() -> None:
    text = report(FOUND).text()
    table, said = text.split("\n\n")[:2]
    methods = [line.split()[0] for line in table.splitlines()[4:-1]]
    assert methods == ["rigid", "ked", "radau"]
    assert said.startswith("An error of every output within 0.1")
    assert "1 slower and worse than one of these; 1 failed: -v shows them." in text
    assert len(report(FOUND, whole=True).text().splitlines()) > len(text.splitlines())
