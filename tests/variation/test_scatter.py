"""Random designs: indices of a linear case in closed form, distributions, resume.

Claims:
    Derivatives, designs, scatter, fits
    - Sobol indices of a linear case; of a log-linear one by 400 designs, 8 seeds; of an interaction
      | closed form | 1e-12; 0.02; 3 standard errors | passes
    - a cantilever's frequencies scatter as its formula says | closed form | - | passes
    - stopped and resumed: the same table | - | exact | exact
"""

from __future__ import annotations

import json

import numpy as np
import pytest

import pinflex as pf
from pinflex.__main__ import main
from pinflex.variation import scatter as module
from pinflex.variation.scatter import Distribution, designs, distributions
from pinflex.variation.variants import variants_of

RANDOM = (
    Distribution("a", "normal", 0.0, 1.0),
    Distribution("b", "normal", 5.0, 2.0),
    Distribution("c", "uniform", -3.0, 3.0),
)


def standard(rows):
    return np.stack([x.standard(rows[:, k]) for k, x in enumerate(RANDOM)], 1).reshape(5, -1, 3)


def test_indices_of_a_linear_case_are_its_shares_of_variance():
    # y = a + b + c: the shares are 1 : 4 : 3, alone and with interactions
    rows = designs(RANDOM, 1000, seed=3)
    values = rows.sum(axis=1).reshape(5, -1)
    first, total, first_error, total_error = module._indices(values, standard(rows))
    exact = np.array([1.0, 4.0, 3.0]) / 8.0
    # Regression knows a linear case but for round-off.
    assert np.all(np.abs(first - exact) < 1e-12)
    assert np.all(np.abs(total - exact) < 1e-12)
    assert np.all(np.maximum(first_error, total_error) < 1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_a_nearly_linear_case_of_400_designs_is_within_two_hundredths(seed):
    # y = t sqrt(E) w^0, spreads 3, 5, 5 %: log-linear, shares 9 : 6.25 : 0
    of = [Distribution(k, "normal", 1.0, x) for k, x in (("t", 0.03), ("E", 0.05), ("w", 0.05))]
    rows = designs(of, 400, seed)
    values = (rows[:, 0] * np.sqrt(rows[:, 1])).reshape(5, -1)
    z = np.stack([x.standard(rows[:, k]) for k, x in enumerate(of)], 1).reshape(5, -1, 3)
    first, total, *_ = module._indices(values, z)
    exact = np.array([9.0, 6.25, 0.0]) / 15.25
    assert np.all(np.abs(first - exact) < 0.02)  # what is asked of shares in per cent
    assert np.all(np.abs(total - exact) < 0.02)
    assert np.all(first >= 0)


def test_an_interaction_shows_in_the_total_alone():
    # y = a (b - 5): no first-order share, all of it in both totals
    rows = designs(RANDOM, 2000, seed=1)
    values = (rows[:, 0] * (rows[:, 1] - 5.0)).reshape(5, -1)
    first, total, first_error, total_error = module._indices(values, standard(rows))
    assert np.all(np.abs(first) < 3 * first_error + 0.02)  # never negative: half of them 0
    assert np.all(np.abs(total - [1.0, 1.0, 0.0]) < 3 * total_error + 1e-12)


def test_a_sample_follows_its_distributions():
    rows = designs(RANDOM, 5000, seed=2)[:2000]  # rows A and B
    # a Latin hypercube meets means and spreads better than 1/sqrt(2000) = 0.022
    np.testing.assert_allclose(rows.mean(axis=0), [0, 5, 0], atol=0.02)
    np.testing.assert_allclose(rows.std(axis=0), [1, 2, 3 / np.sqrt(3)], rtol=0.02)
    np.testing.assert_array_equal(designs(RANDOM, 50, 7), designs(RANDOM, 50, 7))


def test_frequencies_of_a_cantilever_scatter_as_its_formula_says():
    # f ~ t E^0.5 / L^2 ...: relative spreads 2 % and 0.5 * 4 % add as squares
    robot = pf.load("cantilever", ["gravity=[0, 0, 0]"])
    found = pf.scatter(
        robot, 200, normal={"flexible.*.section.thickness": "2%", "flexible.*.material.E": "4 %"},
        outputs=["frequency"],
    )  # fmt: skip
    k = found.outputs.index("frequency.1")
    # the spread of 100 normal numbers is known to 1/sqrt(200): two standard errors
    assert found.std[k] / found.mean[k] == pytest.approx(np.hypot(0.02, 0.02), rel=0.14)
    assert np.all(np.abs(found.total[k] - 0.5) < 3 * found.total_error[k])


@pytest.mark.parametrize(
    "kind, text, said",
    [
        ("normal", "1e-3", "not of the form"),
        ("normal", "1:-1", "standard deviation above 0"),
        ("uniform", "2:1", "LOW below HIGH"),
        ("uniform", "0 %", "LOW below HIGH"),
    ],
)
def test_bad_distributions_say_what_to_write(kind, text, said):
    description = pf.load("cantilever").description
    given = {"normal": {}, "uniform": {}} | {kind: {"flexible.*.material.E": text}}
    with pytest.raises(pf.DescriptionError, match=said):
        distributions(description, **given)


def test_stopped_and_resumed_gives_the_same_table(tmp_path, capsys):
    out, again = tmp_path / "a.csv", tmp_path / "b.csv"
    options = ["--random", "24", "--normal", "flexible.*.section.thickness=2%", "--jobs", "1"]
    options += ["--uniform", "flexible.*.material.E=+-5%", "--outputs", "frequency,stress"]
    options += ["--level", "quasistatic"]
    picture = tmp_path / "scatter.png"
    call = ["sweep", "cantilever", *options, "--out", str(out), "--plot", str(picture)]
    assert main(call) == 0
    assert "frequency.1 scatters by" in capsys.readouterr().out
    assert picture.stat().st_size > 10_000
    assert not (tmp_path / "a.csv.journal").exists()  # every design has an answer
    journal = tmp_path / "kept"  # in Python it stays
    pf.scatter(
        "cantilever", 24, normal={"flexible.*.section.thickness": "2%"}, level="quasistatic",
        uniform={"flexible.*.material.E": "+-5%"}, outputs=["frequency", "stress"], journal=journal,
    )  # fmt: skip
    lines = journal.read_bytes().splitlines(keepends=True)
    (tmp_path / "b.csv.journal").write_bytes(b"".join(lines[:9]) + lines[9][:20])  # killed there
    assert main(["sweep", "cantilever", *options, "--out", str(again), "--json"]) == 0
    assert again.read_bytes() == out.read_bytes()
    assert len(json.loads(capsys.readouterr().out)["columns"]["status"]) == 24


def test_options_of_random_designs_need_random(capsys):
    assert main(["sweep", "cantilever", "--normal", "flexible.*.material.E=1%"]) == 2
    assert "Add --random N" in capsys.readouterr().err
    assert (
        main(["sweep", "cantilever", "--random", "5", "--normal", "flexible.*.material.E=1%"]) == 2
    )
    assert "at least 12 designs" in capsys.readouterr().err


def test_robots_of_one_yaml_and_two_urdfs_are_not_mixed_up():
    first = pf.load("cantilever").description
    second = first.replace(urdf_text=first.urdf_text.replace("</robot>", "<!-- other --></robot>"))
    patterns = ("flexible.*.material.E",)
    assert variants_of(first, patterns).source is first
    assert variants_of(second, patterns).source is second
    assert variants_of(second, patterns) is variants_of(second, patterns)
