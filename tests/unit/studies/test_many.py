"""Many cases in one call: their numbers, whoever computes them, and what fails in between.

Claims:
    Many cases
    - cases in other weights and motions have the torques of a pendulum; divided among copies or
      threads, or made of another mechanism in place of the files, not a bit changes | tau = J q'' +
      S g cos q; - | 1e-12; exact | 1e-15; exact
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.description.reading.parameters import assignments
from pinflex.results.pose_map import Columns
from pinflex.results.result import Result
from pinflex.studies import batch, sweep
from tests.cli.small import ARM_YAML, write_model

ARM = "urdf: arm.urdf\ngravity: [0, -9.81, 0]\nactuated: [shoulder]\n"
SMALL = {"until": 0.05, "samples": 6, "tol": 1e-2}


@pytest.fixture(scope="module")
def fourbar(tmp_path_factory: pytest.TempPathFactory) -> pf.Mechanism:
    folder = tmp_path_factory.mktemp("many")
    return pf.load(write_model(folder, "fourbar", [(", dt: 2.5e-4", "")]))


def alike(a: Columns, b: Columns) -> bool:
    return [*a] == [*b] and all(
        np.array_equal(a[key], b[key], equal_nan=a[key].dtype.kind == "f") for key in a
    )


def test_a_pendulum_in_other_weights_and_motions(tmp_path: Path) -> None:
    """tau = J q'' + S g cos q, with moments J and S of the masses of a rigid arm."""
    arm = pf.load(write_model(tmp_path, "arm", [(ARM_YAML, ARM)]))
    J = 1e-5 + 0.5 * 0.25**2 + 1e-4 + 0.5 * 0.5**2
    S = 0.5 * 0.25 + 0.5 * 0.5
    cases, peaks = [], []
    for g in (0.0, 1.62, 9.81):
        for angle, T in ((1.0, 0.5), (-0.6, 0.3)):
            motion = pf.quintic(joints={"shoulder": angle}, duration=T)
            cases.append({"gravity": [0, -g, 0], "motion": motion, "level": "rigid"})
            u = np.linspace(0.0, 1.0, 401)
            q = angle * (10 * u**3 - 15 * u**4 + 6 * u**5)
            a = angle * (60 * u - 180 * u**2 + 120 * u**3) / T**2
            peaks.append(np.abs(J * a + S * g * np.cos(q)).max())
    table = pf.batch(arm, cases, threads=1)
    # sums of numbers near one
    np.testing.assert_allclose(table["torque.peak.shoulder"], peaks, rtol=1e-12)
    assert table["case"].tolist() == [*range(6)] and table.units["torque.peak.shoulder"] == "N m"


def test_by_how_many_they_are_divided_changes_no_bit(
    fourbar: pf.Mechanism, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(1)
    cases = [
        {
            "flexible.coupler.section.thickness": 5e-3 * rng.uniform(0.8, 1.2),
            "motion.duration": 0.1 * rng.uniform(0.9, 1.1),
            **SMALL,
        }
        for _ in range(5)
    ]
    cases += [SMALL, {"flexible.coupler.section.width": -1.0, **SMALL}, SMALL]
    wanted = "torque", "deviation", "stress"
    alone = pf.batch(fourbar, cases, outputs=wanted, threads=1)
    assert alone["status"].tolist() == [*["done"] * 6, "failed", "done"]
    assert "section.width: -1.0 is out of range" in alone["error"][6]
    assert alone["torque.peak.motor"][5] == alone["torque.peak.motor"][7]
    assert alike(pf.batch(fourbar, cases, outputs=wanted, threads=2), alone)
    monkeypatch.setattr(batch, "can_fork", lambda: False)
    threads = pf.batch(fourbar, cases, outputs=wanted, threads=3)
    assert alike(threads, alone)


def test_a_deviation_is_from_the_rigid_run(fourbar: pf.Mechanism) -> None:
    """Where no rigid torques are asked for, none are computed; 1e-12 of its size: round-off."""
    row = pf.batch(fourbar, [SMALL], outputs=("deviation",), threads=1)
    run = pf.solve(fourbar, asked=("platform",), **SMALL)  # as a batch of that alone asks
    rigid = pf.solve(fourbar, level="rigid", until=SMALL["until"], samples=SMALL["samples"])
    size = np.max(np.linalg.norm(run.frames["platform"].position, axis=1))
    far = np.max(run.deviation_from(rigid).norm)
    assert far > 1e-9 * size
    assert row["deviation.position"][0] == pytest.approx(far, rel=0, abs=1e-12 * size)


@pytest.mark.parametrize(
    "changes",
    [
        {"flexible.coupler.section.thickness": 4e-3, "flexible.coupler.material.rho": 2600.0},
        {"flexible.coupler.axial": True, "damping": {"rayleigh": [0.0, 1e-4]}},
        {"gravity": [0.0, -5.0, 0.0]},
        {"home": {"motor": 1.3, "elbow": -0.9, "pivot": 1.9}},
        {"motion.joints.motor": 0.3},
        {"joints": {"elbow": {"damper": 0.2}}},
        {"flexible": {}, "solve.level": "rigid"},
    ],
)
def test_what_two_mechanisms_share_changes_no_bit(
    fourbar: pf.Mechanism, changes: dict[str, object]
) -> None:
    """A mechanism made of another one, and one made of the files alone."""
    path = fourbar.description.path
    assert path is not None
    level = changes.get("solve.level", "coupled")
    options = {**SMALL, "level": level} if level == "coupled" else {"until": 0.05, "samples": 6}
    fresh = pf.solve(pf.load(path, assignments(changes)), **options)
    again = pf.solve(fourbar.with_(changes), **options)
    for key in ("torque", "joint/q", "joint/v"):
        np.testing.assert_array_equal(again.array(key), fresh.array(key))


DESIGNS: dict[str, dict[str, object]] = {
    "delta": {"flexible.arm_?.section.wall": 2.8e-3, "flexible.rod_??.material.E": 9e10},
    "3rrr": {"flexible.*.section.thickness": 2.1e-3, "flexible.*.damping": {"modal": 0.01}},
    "ur5": {"flexible.*.section.wall": 3e-3, "flexible.*.segments": 2},
    "race_r3": {"flexible.rod.material.E": 1.9e11, "flexible.rod.rotary_inertia": True},
    "cantilever": {"flexible.*.section.thickness": 1.9e-3},
}


@pytest.mark.parametrize("model", DESIGNS)
def test_designs_on_the_joints_of_others_are_those_that_load_makes(model: str) -> None:
    """Tables of the kernel have every number of the equations: as they are, to the last bit.

    Riders of ur5 sit elsewhere on every design, and analytic modes are made anew.
    """
    robot = pf.load(model)
    for share in (1.0, 0.6, 1.1, 0.9):  # lighter beams leave other riders, heavier ones fewer
        changes = {
            key: x * share if isinstance(x, float) else x for key, x in DESIGNS[model].items()
        }
        robot = robot.with_(changes)
        fresh = pf.load(model, assignments(changes))
        for one, other in ((robot.rigid, fresh.rigid), (robot.flexible, fresh.flexible)):
            assert one.tables.counts == other.tables.counts
            for key, array in other.tables.arrays.items():
                np.testing.assert_array_equal(one.tables.arrays[key], array, key)
            np.testing.assert_array_equal(one.K, other.K)
            assert one.closed.labels == other.closed.labels
        assert repr(robot.flexible_report) == repr(fresh.flexible_report)  # some are not numbers
    joints = robot.flexible.expansion.blocks
    again = robot.with_({k: 1.001 * x if isinstance(x, float) else x for k, x in changes.items()})
    assert (again.flexible.expansion.blocks is joints) == (model in ("delta", "3rrr", "cantilever"))


def test_another_motion_takes_the_same_model_and_is_judged_anew() -> None:
    """What `auto` leaves out is decided for each motion, of a model that is put together once."""
    robot = pf.load("delta")
    changes = {"motion.platform.z": 0.05, "motion.duration": 0.1, "solve.until": 0.1}
    fresh, again = pf.load("delta", assignments(changes)), robot.with_(changes)
    assert again.flexible is robot.flexible
    shares = [{k: part.left_out for k, part in x.parts.items()} for x in (fresh, again, robot)]
    assert shares[0] == shares[1] != shares[2]
    thicker = {"flexible.arm_?.section.wall": 3e-3}
    assert robot.with_(thicker).flexible is not robot.flexible
    options = {"level": "coupled", "dt": 1e-3, "until": 0.02, "samples": 6}
    torque = [pf.solve(x, **options).torque for x in (fresh, again)]
    np.testing.assert_array_equal(torque[0], torque[1])


def test_a_measure_of_ones_own_and_starts(fourbar: pf.Mechanism) -> None:
    """Starts off equilibrium: the run begins where it is told to."""
    y = fourbar.undeformed()
    starts = []
    for bend in (0.0, 1e-5):
        moved = y.copy()
        moved[-1] = bend
        starts.append((moved, np.zeros(fourbar.flexible.nv)))

    def first(run: Result) -> dict[str, float]:
        return {"bend": float(run.array("eta")[0, -1])}

    table = pf.batch(fourbar, [{"start": x, **SMALL} for x in starts], outputs=first, threads=1)
    assert table["bend"].tolist() == [0.0, 1e-5]


@pytest.mark.parametrize(
    "given, said",
    [
        ({"cases": []}, "no case"),
        ({"cases": [3]}, "case 0: int is no case"),
        ({"cases": [{"flexible.coupler.sektion": 1}]}, "section"),
        ({"cases": [{}], "threads": 0}, "threads: 0"),
        ({"cases": [{}], "outputs": ["torques"]}, "torque"),
    ],
)
def test_what_no_case_can_take_is_said_at_once(
    fourbar: pf.Mechanism, given: dict[str, object], said: str
) -> None:
    with pytest.raises(pf.DescriptionError, match=said):
        sweep.batch(fourbar, **given)  # type: ignore[arg-type]


def test_options_hold_for_every_case_that_has_none_of_its_own() -> None:
    cases = [{}, {"level": "quasistatic"}]
    by_option = pf.batch("3rrr", cases, level="rigid", until=0.02, samples=5)
    apart = [{"level": "rigid", **case, "until": 0.02, "samples": 5} for case in cases]
    by_case = pf.batch("3rrr", apart)
    names = [name for name in by_option if name.startswith("torque.")]
    assert names
    for name in names:
        assert np.array_equal(by_option[name], by_case[name])
    assert by_option[names[0]][0] != by_option[names[0]][1]  # links that sag take other torques
    with pytest.raises(pf.DescriptionError, match=r'no such option.*mean "samples"'):
        pf.batch("3rrr", cases, sampels=5)
