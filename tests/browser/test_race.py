"""The page on which the fastest move races the usual ones.

Claims:
    Pages, pictures, figures
    - the fastest move beside the best of each usual profile; where each is still, marked in every
      plot; distance from rest | a run of the motion that is written | 0.2 mm of 1 m | passes
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.__main__ import main
from tests.browser.chromium import Browser
from tests.unit.quickest.test_fastest import TWO, YAML

BAND = 0.01  # m


def test_the_fastest_move_races_the_usual_ones(
    browser: Browser, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "two.urdf").write_text(TWO)
    (tmp_path / "two.yaml").write_text(YAML)
    page, table = tmp_path / "race.html", tmp_path / "move.csv"
    asked = ("move", tmp_path / "two.yaml", "--to", "drive=1", "--settle", BAND, "--json")
    assert main([*map(str, asked), "--page", str(page), "-o", str(table)]) == 0
    told = json.loads(capsys.readouterr().out)
    still = [told["settled"]] + [
        min(x["settled"] for name, x in told["baselines"].items()
            if name.partition(" + ")[0] == kind and x["settled"] is not None)
        for kind in ("quintic", "trapezoid", "jerk-limited", "exact command, nonic")
    ]  # fmt: skip
    assert min(still) == still[0]
    browser.open(page)
    names = browser.run("return [...document.querySelector('#run').options].map(x => x.text)")
    assert names[0] == f"fastest, still at {still[0]:.4g} s"
    assert {f"{t:.4g}" for t in still} <= {name.split()[-2] for name in names}
    marks = browser.run(
        "return [...document.querySelectorAll('#plots figure')].map(f => "
        "[f.querySelectorAll('.instant').length, "
        "f.querySelector('.instant.own title').textContent])"
    )
    assert len(marks) >= 2
    assert all(mark == [len(names), names[0]] for mark in marks)  # in every plot; its own is bold
    # the plot of distances against a run of the motion that was written, at a time of the page
    head, *rows = browser.run("return pinflex.curves")
    column = head.index("load from rest fastest [mm]")
    robot, motion = pf.load(tmp_path / "two.yaml"), pf.trajectory(table)
    end = rows[-1][0]
    run = pf.solve(robot, motion, level="coupled", tol=1e-4, until=end, samples=2001)
    near = [row for row in rows if row[column] < 5 * 1e3 * BAND]
    away = 1e3 * np.abs(run.frame("load").position[:, 0] - 1.0)
    own = np.interp([row[0] for row in near], run.t, away)
    # runs are right to 1e-4 of 1 m, the file is at 1 kHz
    assert [row[column] for row in near] == pytest.approx(own, abs=0.2)
    assert browser.errors() == []
