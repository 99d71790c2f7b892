"""Step sizes, dissipation and long runs: conditioning, multipliers without zig-zag, no drift.

Claims:
    Hard cases
    - conditioning from 1e-2 to 1e-10 s: a plateau | 1.01 | 4.6e5, 1.1e6, 6e7 (race_r1, race_r2,
      3rrs)
    - rho_inf 0 to 0.95: multipliers without zig-zag; 1: it is there and warned of | 1e-3 | passes;
      2 to 3 %
    - 1e5 steps do not drift off the loop (a gap that grows would show) | 1e-10 m | passes
    - a step that resolves nothing ends in advice; a state ten lengths off never is an answer |
      named error | passes | also `hard/test_resume.py`
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.integrators.collocation import generalized_alpha
from pinflex.lab.loops import pendulum
from pinflex.lab.scene import energy, released
from pinflex.mechanics.evaluation.equations import Equations
from tests.scenes import Body, load

STEPS = [10.0**-k for k in range(2, 8)]


def condition(name: str, h: float) -> float:
    """Condition number of [M' J'; J 0], the matrix of a Newton step, diagonal and rows of one."""
    m = pf.load(name)
    system, d, scheme = m.flexible, Equations(m.flexible), generalized_alpha()
    zero, lam, free = np.zeros(system.nv), np.zeros(system.closed.n), system.free
    weights = (scheme.mass_factor, scheme.gamma * h, scheme.beta * h * h)
    S, J = d.iteration_matrix(m.undeformed(), zero, zero, lam, 0.0, weights)
    M, J = S[np.ix_(free, free)], J[:, free]
    scale = 1 / np.sqrt(np.abs(np.diag(M)))
    M, J = M * scale * scale[:, None], J * scale
    J /= np.linalg.norm(J, axis=1, keepdims=True)
    return float(np.linalg.cond(np.block([[M, J.T], [J, np.zeros((len(J), len(J)))]])))


@pytest.mark.parametrize("name", ["race_r1", "race_r2", "3rrs"])
def test_conditioning_reaches_a_plateau_as_the_step_shrinks(name: str) -> None:
    """Unscaled index-3 rows grow with 1/h^2, 1e10 from 1e-2 to 1e-7 s, and 1e6 more to 1e-10."""
    conds = [condition(name, h) for h in (*STEPS, 1e-9, 1e-10)]
    # Measured plateaus: 4.6e5, 1.1e6, 6e7: the saddle matrix of M and J itself.
    assert conds[-1] == pytest.approx(conds[-2], rel=1e-2)
    assert max(conds) <= 1.01 * conds[-1] < 1e8


@pytest.mark.parametrize("h", STEPS)
def test_a_few_steps_of_any_size_stay_on_the_loops_and_on_the_same_motion(h: float) -> None:
    m = pf.load("race_r1")
    r = pf.solve(m, level="coupled", until=20 * h, dt=h, samples=21)
    assert np.isfinite(r.torque).all()
    # Newton stops at 1e-7 of the acceleration: as a position that is 1e-7 a h^2/4, 7e-10 at 10 ms.
    assert r.arrays["residual/closure"].max() < 1e-11 + 1e-5 * h * h
    rigid = pf.solve(m, level="rigid", until=20 * h, samples=21)
    # Bending of a thin link in this scene is below a millimetre: joints follow within 1e-2 rad.
    np.testing.assert_allclose(r.arrays["joint/q"], rigid.arrays["joint/q"], atol=1e-2)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9, 0.95])
def test_multipliers_are_smooth_for_every_dissipation(rho: float) -> None:
    """The zig-zag of index 3 is the part of lambda that changes sign at every step."""
    r = released(pendulum(), 1.0, 2e-3, 501, rho_inf=rho)
    lam = r.array("multiplier")[:, 0]
    zigzag = np.abs(lam[2:] - 2 * lam[1:-1] + lam[:-2]) / 4
    # The smooth second difference is lam'' h^2/4, below 1e-3 of lambda's size at 2 ms.
    assert zigzag.max() < 1e-3 * np.abs(lam).max()
    y = r.array("joint/q")[:, 1]
    vx, vy = r.array("joint/v").T
    exact = -(vx * vx + vy * vy - 9.81 * y)
    # Second order at 2 ms; lambda is the pull of the rod (its row is scaled by the length, 1 m).
    assert np.abs(np.abs(lam) - np.abs(exact)).max() < 2e-3 * np.abs(exact).max()


def test_without_any_dissipation_the_zigzag_is_there_and_is_warned_of() -> None:
    """Index 3 and rho_inf = 1: the zig-zag grows slowly; 2 to 3 % of lambda after 500 steps."""
    lam = released(pendulum(), 1.0, 2e-3, 501, rho_inf=1.0).array("multiplier")[:, 0]
    zigzag = np.abs(lam[2:] - 2 * lam[1:-1] + lam[:-2]) / 4
    assert 5e-3 < zigzag.max() / np.abs(lam).max() < 0.1
    for options in ({"rho_inf": 1.0}, {"integrator": "newmark"}):
        r = pf.solve(pendulum(), pf.hold(duration=0.1), level="coupled", dt=2e-3, **options)
        assert any("zig-zag" in w for w in r.meta["warnings"])
    r = pf.solve(pendulum(), pf.hold(duration=0.1), level="coupled", dt=2e-3)
    assert not any("zig-zag" in w for w in r.meta["warnings"])


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_position_speed_and_multiplier_converge_with_order_two(rho: float) -> None:
    m = pendulum()
    errors = []
    for h in (4e-3, 2e-3, 1e-3):
        r = released(m, 1.0, h, 2, rho_inf=rho, tolerance=1e-9)
        exact = np.array([-0.986291751132, -0.165010853126])
        speed = np.sqrt(2 * 9.81 * -exact[1])
        pull = speed**2 - 9.81 * exact[1]
        errors.append(
            [
                np.linalg.norm(r.array("joint/q")[-1] - exact),
                abs(np.linalg.norm(r.array("joint/v")[-1]) - speed),
                abs(abs(r.array("multiplier")[-1, 0]) - pull),
            ]
        )
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    assert np.all(np.abs(orders[-1] - 2.0) < 0.25), orders


def test_a_hundred_thousand_steps_do_not_drift_off_the_loop() -> None:
    """200 s at 2 ms; with constraints on acceleration only the gap grows with t^2."""
    r = released(pendulum(), 200.0, 2e-3, 100001, rho_inf=0.9)
    q, v = r.array("joint/q"), r.array("joint/v")
    gap = np.abs(np.linalg.norm(q, axis=1) - 1)
    assert gap.max() < 1e-10
    assert gap[-10000:].max() < 3 * gap[:10000].max() + 1e-13  # it does not grow
    # The rod's direction of motion: speed stays on the tangent to the order of the step.
    assert np.abs(np.einsum("ti,ti->t", q, v)).max() < 1e-3


def test_energy_over_long_time_decays_with_dissipation_and_never_grows() -> None:
    for rho in (0.0, 0.5, 0.9):
        drift = energy(released(pendulum(), 40.0, 4e-3, 1001, rho_inf=rho))
        assert drift.max() < 2e-4  # [J] of 9.81
        assert drift[-1] < 1e-6


def test_a_step_that_resolves_nothing_is_sound_and_says_so_or_ends_in_advice(
    tmp_path: Path,
) -> None:
    """0.5 s steps on a beam that rings at 560 rad/s."""
    bodies = (Body("beam", "base", "revolute"), Body("tip", "beam", xyz=(1, 0, 0)))
    yaml = """
gravity: [0, -9.81, 0]
flexible:
  beam:
    material: {E: 2.0e11, nu: 0.3, rho: 7800}
    section: {shape: rectangle, width: 0.02, thickness: 0.01}
    end: tip
"""
    m = load(tmp_path, bodies, yaml)
    keys = {"dt": 0.5, "samples": 11, "until": 10.0, "level": "coupled", "start": "straight"}
    run = pf.solve(m, pf.quintic(joints={"beam_joint": 0.5}, duration=5.0), **keys)
    # The static sag is 5.0 mm at the end; what rings about it by as much is damped by the method.
    sag = np.abs(run.link("beam").deflection[:, :, :3]).max(axis=(1, 2))
    assert sag.max() < 0.011 and abs(sag[-1] - 0.0050) < 2e-4
    assert any("vibration is lost or shifted" in text for text in run.meta["warnings"])
    with pytest.raises(pf.ConvergenceError, match="Halve dt") as caught:
        pf.solve(m, pf.quintic(joints={"beam_joint": 100.0}, duration=5.0), **keys)
    assert len(caught.value.result.t) < 11
