"""A run that leaves the theory says so, in words that tell what to change; a safe one is quiet.

Claims:
    Tolerances, collocation
    - ked: where the deflected links lose their stiffness (3rrs, 0.6 s); closure and energy graded |
      level quasistatic | 0.55 to 0.75 s | 0.7
    Hard cases
    - every flexible result has its monitors; the kinetic share of the fastest shape: 2 shapes / 5 |
      > 0.9 / < 1e-6 | 0.99 / 1e-9
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.recovery import validity
from tests.scenes import UNIT_BEAM, Body, load

ARM = (Body("beam", "base", "revolute"), Body("tip", "beam", xyz=(1, 0, 0)))


def arm(folder: Path, force: str, *, segments: int = 1, second_order: bool = True) -> pf.Mechanism:
    yaml = f"""
gravity: [0, 0, 0]
forces: {{load: {{at: tip, {force}}}}}
flexible:{UNIT_BEAM}
    segments: {segments}
    second_order: {str(second_order).lower()}
"""
    return load(folder, ARM, yaml)


def held(m: pf.Mechanism) -> list[str]:
    r = pf.solve(m, pf.hold(duration=1.0), level="quasistatic", samples=2)
    return [str(w) for w in r.meta["warnings"]]


def test_small_deflection_is_quiet_and_large_asks_for_segments(tmp_path: Path) -> None:
    assert not held(arm(tmp_path, "force: [0, 0.15, 0]"))  # 5 % of the length
    said = held(arm(tmp_path, "force: [0, 0.6, 0]"))  # 20 %
    assert len(said) == 1
    assert "flexible.beam.segments" in said[0]
    assert not held(arm(tmp_path, "force: [0, 0.6, 0]", segments=4))


def test_compression_is_measured_against_the_euler_load(tmp_path: Path) -> None:
    m = arm(tmp_path, "force: [-2.0, 0, 0]")
    assert validity.euler_load(m.parts["beam"]) == pytest.approx(np.pi**2)
    assert validity.first_frequency(m.parts["beam"]) == pytest.approx(3.51601527, rel=1e-8)
    assert not held(m)
    said = held(arm(tmp_path, "force: [-2.0, 0, 0]", second_order=False))
    assert any("does not see buckling" in w for w in said)


def test_the_speed_monitor_is_the_speed_over_the_first_frequency(tmp_path: Path) -> None:
    m = arm(tmp_path, "force: [0, 0, 0]", second_order=False)
    turn = pf.spin_up(joints={"beam_joint": 1.0}, duration=10.0)
    r = pf.solve(m, turn, level="coupled", dt=2e-2, until=15.0)
    said = [w for w in r.meta["warnings"] if "second_order" in w]
    assert len(said) == 1
    assert "0.28 of its first frequency" in said[0]  # 1/3.516
    assert "runs away" not in said[0]


def test_the_fastest_shape_says_whether_the_basis_suffices(tmp_path: Path) -> None:
    """Shaken at 35 rad/s, where two end shapes have a resonance and the beam (22.0, 61.7) none."""
    shake = pf.harmonic(joints={"beam_joint": 1e-3}, frequency=35 / (2 * np.pi))
    shares = []
    for internal in (0, 3):
        plain = arm(tmp_path, "force: [0, 0, 0]")
        m = pf.load(plain.description.path, [f"flexible.beam.basis.internal={internal}"])
        r = pf.solve(m, shake, level="coupled", until=2.0, dt=2e-3, samples=201)
        shares.append(r.meta["monitors"]["beam"]["fastest"])
        said = [w for w in r.meta["warnings"] if "flexible.beam.basis" in w]
        assert len(said) == (1 if internal == 0 else 0)
    # The second of two modes answers, 0.99; the fifth of five does not, 1e-9.
    assert shares[0] > 0.9
    assert shares[1] < 1e-6


@pytest.mark.parametrize("level", ["quasistatic", "ked", "coupled"])
def test_every_flexible_result_has_its_monitors(level: str) -> None:
    r = pf.solve(pf.load("race_r2"), level=level, until=0.02, dt=1e-3, samples=5)
    assert set(r.meta["monitors"]) == set(r.links)
    for found in r.meta["monitors"].values():
        numbers = [found[k] for k in ("deflection", "rotation", "speed", "compression", "fastest")]
        assert np.all(np.isfinite(numbers))
        assert np.all(np.array(numbers) >= 0)
    assert r.meta["energy_balance"] >= 0
    # A linear run opens the loops by the square of its deflection.
    assert r.worst_closure < 1e-5


def test_ked_says_where_the_links_buckle_and_that_it_is_wrong() -> None:
    """3rrs: level quasistatic finds no stable branch from 0.6 s on; ked marches on to 8.85 mm."""
    run = pf.solve(pf.load("3rrs"), level="ked", samples=401)
    said = next(text for text in run.meta["warnings"] if "static divergence" in text)
    assert 0.55 < float(said.split()[2]) <= 0.75
    assert run.meta["grades"] == {"closure": "wrong", "energy": "wrong"}  # 44 %, 9.5 %
    assert "wrong" in run.summary() and "leaves its loops open by up to 3.66 mm" in run.summary()


def test_small_deflections_are_graded_good() -> None:
    run = pf.solve(pf.load("race_r1"), level="ked", until=0.05)
    assert run.meta["grades"]["closure"] == "good"
    assert not any("divergence" in text for text in run.meta["warnings"])


def test_a_motion_that_runs_away_names_the_cause() -> None:
    """At 50 pi links without second order soften until forces are no numbers."""
    changes = ["flexible.*.second_order=false", "flexible.*.axial=false", "solve.start=straight"]
    robot = pf.load("3rrr", [*changes, "damping=null", "motion.omega=157.0796"])
    with pytest.raises(pf.ConvergenceError, match="has no second-order terms"):
        pf.solve(robot, level="coupled", until=0.02, dt=2e-5)


@pytest.mark.parametrize(("move", "said"), [(-0.4, ""), (0.1, ""), (0.3, "0.7"), (-1.2, "-0.8")])
def test_a_motion_beyond_the_urdfs_limits_is_told(move: float, said: str, tmp_path: Path) -> None:
    """Limits -0.5 and 0.5 rad, home 0.4 rad, a minimum-jerk move of one second."""
    urdf = """<robot name="one"><link name="base"/><link name="arm"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-0.5" upper="0.5" effort="9" velocity="9"/></joint></robot>"""
    (tmp_path / "one.urdf").write_text(urdf)
    (tmp_path / "one.yaml").write_text("urdf: one.urdf\nhome: {turn: 0.4}\nplatform: arm\n")
    motion = pf.quintic(joints={"turn": move}, duration=1.0)
    run = pf.solve(pf.load(tmp_path / "one.yaml"), motion, level="rigid", samples=1001)
    if not said:
        assert run.meta["warnings"] == []
        return
    (text,) = run.meta["warnings"]
    end = 0.5 if move > 0 else -0.5
    tau = np.linspace(0, 1, 1001)
    q = 0.4 + move * (10 * tau**3 - 15 * tau**4 + 6 * tau**5)
    first = tau[np.argmax(q > end if move > 0 else q < end)]
    # the first sample beyond the limit: all digits that the sentence has
    assert text.startswith(
        f"turn: leaves the URDF's limits at {first:.4g} s: it reaches {said} rad"
    )
    assert f"at 1 s, beyond {end:g} rad" in text
