"""What a proposal uses of what is allowed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scenes import Body, load

import pinflex as pf
from pinflex.advice import advise, reduced_models
from pinflex.advice.reduced_models import SAFETY, Advice


def test_a_proposal_is_judged_by_its_worst_output() -> None:
    made = Advice("robot", 0.01, ("torque",), allowed={"platform": 0.05})
    assert made.used({"torque": 0.002, "platform": 0.04}) == pytest.approx(0.8)
    assert made.used({"torque": 0.02, "platform": 0.04}) == pytest.approx(2.0)


@pytest.mark.parametrize("name", ["ur5", "delta"])
def test_prices_of_linear_motions_are_those_of_corrected_ones(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where corrections change little: the same proposal, and bars within what that is allowed."""
    share, robot = advise._LINEAR, pf.load(name)
    found = advise.advise(robot)
    with monkeypatch.context() as m:
        m.setattr(advise, "_LINEAR", 0.0)
        wanted = advise.advise(robot)
    assert (found.level, found.overrides) == (wanted.level, wanted.overrides)
    pairs = list(zip(found.left_out, wanted.left_out, strict=True))
    assert any(a.error != b.error for a, b in pairs)
    for a, b in pairs:
        assert (a.what, a.out) == (b.what, b.out)
        apart = {k: abs(e - b.error[k]) for k, e in a.error.items()}
        assert found.used(apart) <= share  # of the largest price there can be, which is one
    bars = {k: abs(e - wanted.error[k]) for k, e in found.error.items()}
    assert found.used(bars) <= SAFETY * share


@pytest.mark.parametrize("name", ["ur5", "delta"])
def test_what_equilibria_alone_rule_out_a_march_rules_out(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same proposal, to the last digit; prices of equilibria lack the vibration only."""
    robot = pf.load(name)
    found = advise.advise(robot)
    with monkeypatch.context() as m:
        m.setattr(reduced_models, "_PLAINLY", float("inf"))
        wanted = advise.advise(robot)
    assert (found.overrides, found.error) == (wanted.overrides, wanted.error)
    marched = [x for x in wanted.left_out if x.what in {y.what for y in found.left_out}]
    assert [(x.what, x.out) for x in found.left_out] == [(x.what, x.out) for x in marched]
    spared = [(a, b) for a, b in zip(found.left_out, marched, strict=True) if a.error != b.error]
    assert len(spared) >= 4
    for a, b in spared:
        assert not b.out
        for key, price in a.error.items():
            # deflections swing to twice those of rest at the most, where nothing resonates
            assert 0.5 * b.error[key] < price < 2.0 * b.error[key], (a.what, key)


def test_what_is_small_beside_a_resonance_is_not_ruled_out_at_rest(tmp_path: Path) -> None:
    """An arm sags by rho A g L^4 / 8 E I, and swings across by sixty times that at its frequency.

    All that a look without vibration sees is the sag: 0.6 of what the platform does there.
    """
    bodies = [Body("beam", "base", "revolute", axis=(0, 0, 1), mass=1.08, com=(0.5, 0, 0)),
              Body("tip", "beam", xyz=(1, 0, 0))]  # fmt: skip
    motion = "{{kind: harmonic, joints: {{beam_joint: 0.002}}, frequency: {}, duration: 1.5}}"
    robot = load(tmp_path, bodies, f"""
gravity: [0, 0, -9.81]
actuated: [beam_joint]
platform: tip
damping: {{modal: 0.01}}
flexible:
  beam:
    material: {{E: 7e10, nu: 0.3, rho: 2700}}
    section: {{shape: rectangle, width: 0.02, thickness: 0.02}}
    end: tip
motion: {motion.format(5)}
""")  # fmt: skip
    robot = robot.with_("motion=" + motion.format(pf.modes(robot).frequencies[0]))
    found = pf.advise(robot, tol=0.1)
    assert "flexible.*.bending_z=false" in found.overrides
    (price,) = [x.error["platform position"] for x in found.left_out if "out of" in x.what]
    run, rigid = (
        pf.solve(robot, level=level, until=1.5, samples=1501) for level in ("coupled", "rigid")
    )
    swing = np.abs(run.frame("tip").position - rigid.frame("tip").position).max()
    # seen: 5 % off; at rest the price is 0.63
    assert price == pytest.approx(1.08 * 9.81 / (8 * 7e10 * 0.02**4 / 12) / swing, rel=0.1)
