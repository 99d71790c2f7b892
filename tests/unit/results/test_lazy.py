"""What a result holds is found when asked for, once, and is the same as all of it at once.

Claims:
    Levels, energy, steps
    - a result found group by group = found at once; torques cost no pass over the samples | 1e-12;
      counted | passes
    Pages, pictures, figures
    - doors of a result: joint reactions in world axes and shaking = replay of the stored states;
      point stress at a fibre = largest normal stress, from a file too | 1e-12; 1e-9 | passes | also
      `validation/test_paper_001.py`
"""

from __future__ import annotations

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from time import sleep

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.recovery import kinematics
from pinflex.recovery.kinematics import run_of
from pinflex.recovery.recover import joint_reactions, recover, shaking
from pinflex.results.lazy import Late


def test_a_group_is_found_once_by_the_head_of_its_keys():
    asked = []

    def group(name):
        asked.append(name)
        return {f"{name}/x": 1, f"{name}/y": 2}

    groups = {("a",): lambda: group("a"), ("b", "c"): lambda: group("b")}
    late = Late({"now": 0}, groups)
    assert late["now"] == 0 and not asked
    assert late["a/x"] == 1 and late["a/y"] == 2 and "a/z" not in late and asked == ["a"]
    with pytest.raises(KeyError):
        late["c/x"]
    assert asked == ["a", "b"]
    assert list(late) == ["now", "a/x", "a/y", "b/x", "b/y"] and asked == ["a", "b"]
    late = Late({"now": 0}, {**groups, (): lambda: {"other": 3}})
    assert late["other"] == 3 and asked == ["a", "b"] and len(late) == 6


def test_a_key_that_a_glob_fits_asks_no_other_group():
    asked = []

    def group(kind):
        asked.append(kind)
        return {f"a/one/{kind}/x": 1}

    late = Late({}, {("a/*/stress/*",): lambda: group("stress"), ("a",): lambda: group("line")})
    assert late["a/one/stress/x"] == 1 and asked == ["stress"]
    assert late["a/one/line/x"] == 1 and asked == ["stress", "line"]
    assert list(late) == ["a/one/stress/x", "a/one/line/x"] and len(asked) == 2


def test_forces_in_joints_of_a_rigid_run_are_those_of_rnea():
    """Pinocchio's recursion, joint by joint, from the run's states; 1e-12: round-off."""
    robot = pf.load("ur5")
    run, model = pf.solve(robot, level="rigid", samples=7), robot.rigid.rigid
    data = model.createData()
    for k in range(len(run.t)):
        pin.rnea(model, data, *(run[f"joint/{x}"][k] for x in "qva"))
        for number, name in enumerate(list(model.names)[1:], start=1):
            f = data.f[number].vector
            apart = run[f"reaction/{name}"][k] - f
            assert np.max(np.abs(apart)) < 1e-12 * np.max(np.abs(f))


def test_several_threads_find_a_group_once():
    asked = []

    def slow():
        asked.append(1)
        sleep(0.02)
        return {"a/x": 1}

    late = Late({}, {("a",): slow})
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda _: late["a/x"], range(4))) == [1] * 4
    assert asked == [1]


def test_what_could_not_be_found_is_tried_again():
    left = [RuntimeError("not yet")]

    def group():
        if left:
            raise left.pop()
        return {"a/x": 1}

    late = Late({}, {("a",): group})
    with pytest.raises(RuntimeError):
        late["a/x"]
    assert late["a/x"] == 1


@pytest.fixture
def passes(monkeypatch):
    """The passes over the samples that were made, by name."""
    made = []
    for name in ("kinematics", "forces"):
        done = getattr(kinematics, name)
        monkeypatch.setattr(
            kinematics, name, lambda *given, n=name, f=done: (made.append(n), f(*given))[1]
        )
    return made


def test_torques_cost_no_pass_over_the_samples_and_poses_one(passes):
    robot = pf.load("race_r2")
    run = pf.solve(robot, level="quasistatic", tol=1e-2, samples=41)
    assert run.torque.shape == (41, 3) and run.links and run.level == "quasistatic"
    assert run.motors and run.array("eta").shape[0] == 41 and not passes
    assert run.frame("platform").position.shape == (41, 3) and passes == ["kinematics"]
    assert np.max(run.link(run.links[0]).von_mises) > 0 and passes == ["kinematics", "forces"]
    assert run.meta["warnings"] == [] and run.worst_closure < 1e-6
    assert passes == ["kinematics", "forces"]  # nothing is done twice


@pytest.mark.parametrize(
    ("level", "name"), [("coupled", "prprp"), ("ked", "race_r1"), ("rigid", "ur5")]
)
def test_found_late_is_found_at_once(level, name):
    robot = pf.load(name)
    run = pf.solve(robot, level=level, until=0.02, samples=5)
    again = recover(robot, run_of(robot, run), None)
    # Rigid poses need the motion, work of the motors every step.
    shared = [key for key in again if not key.endswith("_rigid") and key[:8] != "energy/w"]
    assert len(shared) > 10
    for key in shared:
        np.testing.assert_allclose(again[key], run.arrays[key], rtol=0, atol=1e-12, err_msg=key)
    with pytest.raises(ValueError, match="read-only"):
        run.arrays["frame/" + run.meta["frames"][0] + "/position"][0] = 0.0


def test_a_result_travels_whole():
    run = pf.solve(pf.load("spinning_beam"), level="quasistatic", until=0.1, samples=5)
    for other in (pickle.loads(pickle.dumps(run)), copy.deepcopy(run)):
        assert set(other.arrays) == set(run.arrays) and dict(other.meta) == dict(run.meta)
        assert all(np.array_equal(other.arrays[key], x) for key, x in run.arrays.items())


def test_unlisted_groups_are_found_by_name_alone():
    late = Late({"now": 0}, {}, {("more",): lambda: {"more/x": 1}})
    assert list(late) == ["now"] and len(late) == 1
    assert late["more/x"] == 1 and "more/y" not in late and list(late) == ["now"]


def test_doors_that_need_the_mechanism_are_open_while_the_run_is_fresh(tmp_path):
    robot = pf.load("3rrr")
    run = pf.solve(robot, level="quasistatic", samples=5)
    again = joint_reactions(robot, run)
    for name in ("motor_1", "knee_2"):
        wrench = run.joint(name).reaction_world
        scale = np.abs(again[name]).max()  # the same forces from the stored states
        np.testing.assert_allclose(wrench, again[name], atol=1e-12 * scale)
    np.testing.assert_allclose(run.shaking, shaking(robot, run), atol=1e-12)
    assert not any(key.startswith(("reaction_world", "shaking")) for key in run.arrays)
    stored = pf.Result.load(run.save(tmp_path / "run.npz"))
    with pytest.raises(pf.DescriptionError, match="reaction_world/motor_1 is computed from the"):
        _ = stored.joint("motor_1").reaction_world
    with pytest.raises(pf.DescriptionError, match="shaking is computed from the mechanism"):
        _ = stored.shaking


def test_stress_at_a_point_and_the_worst_one_come_from_a_file_too(tmp_path):
    run = pf.solve(pf.load("3rrr"), level="quasistatic", samples=5)
    stored = pf.Result.load(run.save(tmp_path / "run.npz"))
    link = run.links[0]
    fibre = run.meta["links"][link]["section"]["fibres"][0]
    point = stored.link(link).point_stress(*fibre)
    np.testing.assert_array_equal(point.sigma, run.link(link).point_stress(*fibre).sigma)
    normal = run.link(link).stress("normal")
    assert np.abs(point.sigma).max() == pytest.approx(normal.max(), rel=1e-9)
    worst = stored.worst_stress("normal", link)
    assert (worst.link, worst.value) == (link, normal.max())
    old = dict(stored.meta)
    old["links"] = {link: {**old["links"][link], "section": {"shape": "rectangle"}}}
    with pytest.raises(pf.DescriptionError, match="an older pinflex wrote it"):
        pf.Result(stored.t, dict(stored.arrays), old).link(link).point_stress(*fibre)
    with pytest.raises(pf.DescriptionError, match="rigid run has no stresses"):
        pf.solve(pf.load("3rrr"), level="rigid", samples=5).worst_stress()


def test_load_all_computes_everything_now():
    run = pf.solve(pf.load("3rrr"), level="rigid", samples=5)
    assert run.load_all() is run and "0 groups not yet" in repr(run.arrays)
