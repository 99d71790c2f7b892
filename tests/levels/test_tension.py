"""`share: {tension: t_min}`: a plate on four cables, all pulled, as another programme has it.

Claims:
    Levels, energy, steps
    - `share: {tension}`: four cables, all above the least pull, the least sum of f^2/k; multipliers
      meet the conditions of Karush, Kuhn and Tucker | scipy's SLSQP; W df = 0 | 1e-5; 1e-10 |
      passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize

import pinflex as pf
from pinflex.arrays import Array
from pinflex.studies.checking.check import check
from tests.levels.test_redundant_motors import BASES, CORNERS, MASS, TURN, G, machine, wrenches

# Bases that surround the plate, so that some tension of all four is in balance with nothing.
AROUND = np.array([(-0.9, 0.7), (-0.7, -0.8), (0.8, -0.6), (1.0, 0.8)])
PULL = 20.0  # [N]
MOVE = pf.quintic(platform={"x": 0.1, "y": -0.05, "rz": 0.1}, duration=4.0)


def cables(folder: Path, monkeypatch: pytest.MonkeyPatch, more: str) -> pf.Mechanism:
    monkeypatch.setattr("tests.levels.test_redundant_motors.BASES", AROUND)
    return machine(folder, (1.0, 3.0, 0.5, 2.0), more=more)


def programme(W: Array, need: Array, c: Array) -> Array:
    """Forces f along struts, positive where they push: min sum c f^2, W f = need, f <= -PULL."""
    found = minimize(
        lambda f: 0.5 * f @ (c * f) / 1e3, np.full(4, -2 * PULL), jac=lambda f: c * f / 1e3,
        bounds=[(None, -PULL)] * 4, method="SLSQP", options={"ftol": 1e-15, "maxiter": 500},
        constraints={"type": "eq", "fun": lambda f: W @ f - need, "jac": lambda f: W},
    )  # fmt: skip
    assert found.success or found.status == 8  # 8: as low as round-off goes
    return np.asarray(found.x)


def test_cables_pull_as_an_independent_programme_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = cables(tmp_path, monkeypatch, f"share: {{tension: {PULL}}}")
    run = pf.solve(robot, MOVE, level="rigid", samples=9)
    assert np.all(run.torque <= -PULL * (1 - 1e-12))
    price = run.meta["settings"]["share"]["multipliers [N]"]
    u, c = run.t / 4.0, 1 / np.array([1.0, 3.0, 0.5, 2.0]) / 2.0
    s, dds = 10 * u**3 - 15 * u**4 + 6 * u**5, (60 * u - 180 * u**2 + 120 * u**3) / 16
    for k in range(9):
        W = wrenches(0.1 * s[k], -0.05 * s[k], 0.1 * s[k])
        need = np.array([MASS * 0.1 * dds[k], MASS * (G - 0.05 * dds[k]), TURN * 0.1 * dds[k]])
        # The motors of 1e-3 kg at 0.08 m/s^2; SLSQP ends at the root of its 1e-15.
        np.testing.assert_allclose(run.torque[k], programme(W, need, c), rtol=1e-5, atol=1e-3)
        # Karush, Kuhn and Tucker: c f = W' mu - price, and a price only where the bound is met.
        own = np.array([price[name][k] for name in robot.motors])
        assert np.all(own >= 0) and np.all((own > 0) <= (run.torque[k] > -PULL * (1 + 1e-9)))
        slope = c * run.torque[k] + own
        left = slope - W.T @ np.linalg.lstsq(W.T, slope, rcond=None)[0]
        assert np.max(np.abs(left)) < 1e-6 * np.max(np.abs(slope))
    assert max(max(each) for each in price.values()) > 0


def test_the_balance_is_kept_to_round_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What tension adds is in balance by itself: W (f - f_least) = 0."""
    given = [cables(tmp_path, monkeypatch, more) for more in (f"share: {{tension: {PULL}}}", "")]
    taut, least = (pf.solve(x, MOVE, level="rigid", samples=2).torque[0] for x in given)
    added = wrenches(0, 0, 0) @ (taut - least)
    assert np.max(np.abs(added)) < 1e-10 * np.max(np.abs(taut))


def test_a_plate_that_cables_cannot_hold_is_told(tmp_path: Path) -> None:
    """The platform of the other tests stands on its struts."""
    assert BASES[:3, 1].max() < CORNERS[:, 1].min()
    with pytest.raises(pf.MotionError, match="no torques that balance pull by 20 N"):
        pf.solve(machine(tmp_path, more="share: {tension: 20}"), MOVE, level="rigid", samples=3)


def test_check_says_that_only_level_rigid_knows_the_tension(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Elastic drives share the weight by their stiffness alone: W f = (0, m g, 0)."""
    found = check(cables(tmp_path, monkeypatch, f"share: {{tension: {PULL}}}"))
    W, c = wrenches(0, 0, 0), 1 / np.array([1.0, 3.0, 0.5, 2.0])
    least = (W.T / c[:, None]) @ np.linalg.solve((W / c) @ W.T, [0, MASS * G, 0])
    assert np.max(least) > 0  # some push
    assert found.statics.holding_linear is not None
    np.testing.assert_allclose(found.statics.holding_linear, least, rtol=1e-4)  # of light struts
    assert any("struts may push" in text for text in found.warnings)


@pytest.mark.parametrize("level", ["rigid", "quasistatic", "coupled"])
def test_each_run_says_who_knows_the_tension(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, level: str
) -> None:
    """At rest: rigid pulls by 20 N or more, elastic levels by what the weight alone makes."""
    robot = cables(tmp_path, monkeypatch, f"share: {{tension: {PULL}}}")
    run = pf.solve(robot, MOVE, level=level, until=0.02, start="straight", samples=2)
    assert (np.min(-run.torque[0]) >= PULL * (1 - 1e-9)) == (level == "rigid")
    said = [text for text in run.meta["warnings"] if "Level rigid alone keeps the tension" in text]
    assert len(said) == 1 and "`tension_only`" in said[0]
