"""Axial load near and beyond buckling, speeds beyond divergence: right, or said.

Claims:
    Hard cases
    - axial load -0.8 to 0.999 of buckling; imaginary from 1 + 1e-6 on | 1e-5 / (1 - share) | passes
    - an equilibrium on an unstable branch is said to be (`UnstableWarning`, quasistatic, `check`) |
      between 1 -+ 1e-5 of Euler's load | exact
    - two columns under one table, the slender one at 0.75 of its own buckling load (all of the load
      is 3 times that): its bending across, level ked, linear statics | clamped beam-column | 1e-3 |
      1.6e-4 (it was called unstable)
    - a linear body beyond its divergence speed is warned of, with ratio and time | - | passes |
      also `hard/test_validity.py`
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.recovery.links import deflections
from tests.analytical import compressed_cantilever
from tests.scenes import UNIT_BEAM, Body, load

CRITICAL = np.pi**2 / 4  # [EI/L^2] of a cantilever


def column(folder: Path, push: float, segments: int = 1, side: float = 0.0) -> pf.Mechanism:
    yaml = f"""
gravity: [0, 0, 0]
actuated: []
forces: {{push: {{at: tip, force: [{-push!r}, {side!r}, 0]}}}}
flexible:{UNIT_BEAM}
    basis: {{kind: craig_bampton, internal: 4}}
    segments: {segments}
"""
    return load(folder, (Body("beam", "base"), Body("tip", "beam", xyz=(1, 0, 0))), yaml)


@pytest.mark.parametrize("share", [-0.8, 0.5, 0.9, 0.99, 0.999])
def test_frequencies_follow_the_axial_load_up_to_the_buckling_load(
    share: float, tmp_path: Path
) -> None:
    omega = 2 * np.pi * pf.modes(column(tmp_path, share * CRITICAL)).frequencies[0]
    # 1e-6 of the square at every load; near buckling it is divided by what is left of it.
    assert omega == pytest.approx(compressed_cantilever(share * CRITICAL), rel=1e-5 / (1 - share))


def test_the_first_frequency_turns_imaginary_at_the_buckling_load_and_is_shown_so(
    tmp_path: Path,
) -> None:
    below, above = (
        pf.modes(column(tmp_path, share * CRITICAL)).frequencies[0]
        for share in (1 - 1e-6, 1 + 1e-6)
    )
    assert below > 0 > above


def test_columns_that_share_a_load_are_softened_by_what_each_bears(tmp_path: Path) -> None:
    """Closures hold the table twice: how its weight parts, the columns' stretch alone decides."""
    E, L, width, thin, thick = 7e10, 0.4, 0.02, 0.002, 0.006
    inertia, share = width * thin**3 / 12, thin / (thin + thick)
    push = 0.75 * 4 * np.pi**2 * E * inertia / L**2  # on the slender one
    column = f"material: {{E: {E}, nu: 0.3, rho: 1}}, up: z, axial: true, basis: {{internal: 6}}"
    bodies = [Body("table", "base", "prismatic", (0, L, 0), axis=(0, 1, 0), mass=1.0,
                   inertia=(0.01, 0.01, 0.01))]  # fmt: skip
    for name, x in (("a", 0.0), ("b", 0.1)):
        bodies += [Body(name, "base", xyz=(x, 0, 0), rpy=(0, 0, np.pi / 2)),
                   Body(f"{name}_end", name, xyz=(L, 0, 0)),
                   Body(f"{name}_seat", "table", xyz=(x, 0, 0), rpy=(0, 0, np.pi / 2))]  # fmt: skip
    yaml = f"""
gravity: [1, 0, 0]
actuated: []
loops:
  a: {{kind: weld, between: [a_seat, a_end]}}
  b: {{kind: weld, between: [b_seat, b_end]}}
flexible:
  a: {{{column}, section: {{shape: rectangle, width: {width}, thickness: {thin}}}}}
  b: {{{column}, section: {{shape: rectangle, width: {width}, thickness: {thick}}}}}
forces: {{push: {{at: table, force: [0, {-push / share!r}, 0]}}}}
motion: {{kind: hold, duration: 0.01}}
"""
    m = load(tmp_path, bodies, yaml)
    u = 0.5 * L * np.sqrt(push / (E * inertia))
    straight = width * thin * 1.0 * L**4 / (384 * E * inertia)  # under its weight, 1 m/s^2 across
    expected = straight * 24 / u**4 * (u * np.tan(u / 2) - u**2 / 2)
    run = pf.solve(m, level="ked")
    assert run.meta["settings"]["start"] == "static"
    middle = len(run.link("a").x) // 2
    # Six modes of a beam without a load along it: 1.6e-4 with a load so near to buckling.
    bent = run["link/a/deflection"][:, middle, 1]
    np.testing.assert_allclose(np.abs(bent), expected, rtol=1e-3)
    y = pf.linear_statics(m, loaded=True).y
    _, moved = deflections(Equations(m.flexible), y[None])["a"]
    np.testing.assert_allclose(np.abs(moved[0, middle, 1]), expected, rtol=1e-3)


def test_beyond_buckling_the_straight_column_is_reported_unstable(tmp_path: Path) -> None:
    m = column(tmp_path, 1.2 * CRITICAL, segments=4)
    assert pf.modes(m).frequencies[0] < 0


def test_beyond_buckling_a_disturbed_column_is_bent_or_reported_unstable(tmp_path: Path) -> None:
    """P/Pc = 1.063: 40 deg on the elastica (Timoshenko, Gere). Newton finds the near, unstable one.

    Its stability is part of the answer: it is warned of, and `modes` shows the negative frequency.
    """
    m = column(tmp_path, 1.063 * CRITICAL, segments=6, side=1e-3)
    with pytest.warns(pf.UnstableWarning, match="buckles"):
        rest = pf.static_equilibrium(m)
    assert rest.unstable == 1
    turn = sum(
        float(s.body.rows(s.body.length)[0][3] @ rest.y[s.eta]) for s in m.flexible.expansion.slots
    )
    bent = abs(np.degrees(turn)) == pytest.approx(40, abs=4)
    assert bent or pf.modes(m).frequencies[0] < 0


def test_an_equilibrium_is_called_unstable_from_the_buckling_load_on(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert pf.static_equilibrium(column(tmp_path, (1 - 1e-5) * CRITICAL)).unstable == 0
    with pytest.warns(pf.UnstableWarning):
        # Four internal modes: Euler's load to 1e-9.
        assert pf.static_equilibrium(column(tmp_path, (1 + 1e-5) * CRITICAL)).unstable == 1
    with pytest.warns(pf.UnstableWarning):  # the second buckling load is nine times the first
        assert pf.static_equilibrium(column(tmp_path, 9.1 * CRITICAL)).unstable == 2


@pytest.mark.parametrize(("samples", "tol"), [(3, None), (41, None), (41, 1e-2)])
def test_a_quasistatic_run_on_an_unstable_branch_says_so(
    samples: int, tol: float | None, tmp_path: Path
) -> None:
    """From instant to instant, and many at a time."""
    still = pf.hold(duration=1.0)
    for share, expected in ((0.9, False), (1.2, True)):
        m = column(tmp_path, share * CRITICAL, segments=4)
        r = pf.solve(m, still, level="quasistatic", samples=samples, tol=tol)
        assert any("unstable" in w for w in r.meta["warnings"]) is expected


def spun(folder: Path, speed: float, second_order: bool) -> pf.Mechanism:
    yaml = f"""
gravity: [0, 0, 0]
flexible:{UNIT_BEAM}
    second_order: {str(second_order).lower()}
motion: {{kind: spin_up, joints: {{beam_joint: {speed}}}, duration: 20}}
"""
    return load(
        folder, (Body("beam", "base", "continuous"), Body("tip", "beam", xyz=(1, 0, 0))), yaml
    )


@pytest.mark.parametrize("speed", [3.0, 4.0, 8.0])
def test_a_spinning_beam_is_stable_at_any_speed_with_second_order(
    speed: float, tmp_path: Path
) -> None:
    r = pf.solve(spun(tmp_path, speed, True), until=40.0, dt=2e-2, level="coupled")
    tip = r.link("beam").deflection[:, -1, 1]
    # 0.4 rad/s^2 peak at 8 rad/s: a static lag of 11/120 alpha, stiffened.
    assert np.abs(tip).max() < 0.1
    assert np.abs(tip[r.t > 25]).max() < 0.02


def test_a_linear_body_beyond_its_divergence_speed_is_warned_of_or_stopped(
    tmp_path: Path,
) -> None:
    """Without second order mu^2 = 3.516^2 - Omega^2: from 3.516 rad/s on the answer is wrong."""
    m = spun(tmp_path, 5.0, False)
    try:
        r = pf.solve(m, until=40.0, dt=2e-2, level="coupled")
    except pf.ConvergenceError as error:
        warnings = error.result.meta["warnings"]
    else:
        warnings = r.meta["warnings"]
    assert any("second_order" in w and "beam" in w for w in warnings), warnings
    slow = pf.solve(spun(tmp_path, 0.5, False), until=30.0, dt=2e-2, level="coupled")
    assert not any("second_order" in w for w in slow.meta["warnings"])
