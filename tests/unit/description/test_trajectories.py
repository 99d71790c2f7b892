"""A JointTrajectory in and out, malformed ones by field and line, interpolation by hand.

Claims:
    Commands: motions that the platform follows
    - a JointTrajectory in and out; its polynomials; 16 malformed messages and 11 tables by line and
      field | itself; numpy | 1e-9; 1e-12 | passes
"""

from __future__ import annotations

import copy
import itertools
import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import pinflex as pf
from pinflex.description.motions.motion import from_spec

TEXT = """\
header:
  stamp: {sec: 0, nanosec: 0}
joint_names:
- a
- b
points:
- positions: [0.0, 0.1]
  velocities: [0.0, 0.0]
  accelerations: [0.5, -0.25]
  effort: []
  time_from_start: {sec: 0, nanosec: 0}
- positions: [0.5, 0.2]
  velocities: [0.5, -0.125]
  accelerations: [0.0, 1.0]
  time_from_start: {sec: 1, nanosec: 123456789}
- positions: [1.0, -0.3]
  velocities: [0, 0]
  accelerations: [0, 0]
  time_from_start: {sec: 3}
---
"""
MESSAGE = yaml.safe_load(TEXT.removesuffix("---\n"))
FIELDS = ("positions", "velocities", "accelerations")


def without(*fields: str) -> dict[str, Any]:
    """The message without some fields of its points."""
    message = copy.deepcopy(MESSAGE)
    for point in message["points"]:
        for name in fields:
            point.pop(name)
    return message


def seconds(time: Any) -> float:
    return time if isinstance(time, float) else time["sec"] + 1e-9 * time.get("nanosec", 0)


def written(folder: Path, text: str, name: str = "t.yaml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("out", ["out.yaml", "out.json"])
@pytest.mark.parametrize("lost", [(), ("accelerations",), ("accelerations", "velocities")])
def test_three_waypoints_come_in_go_out_and_are_the_same(
    lost: tuple[str, ...], out: str, tmp_path: Path
) -> None:
    message = without(*lost)
    motion = pf.trajectory(written(tmp_path, json.dumps(message).replace(",", ",\t"), "in.json"))
    data = motion.to_joint_trajectory(tmp_path / out)
    read = {".json": json.loads, ".yaml": yaml.safe_load}[Path(out).suffix]
    assert read((tmp_path / out).read_text()) == data
    assert data["joint_names"] == message["joint_names"]
    for mine, given in zip(data["points"], message["points"], strict=True):
        assert {*mine} == {*given} - {"effort"}
        for name in FIELDS[: 3 - len(lost)]:
            assert mine[name] == pytest.approx(given[name], abs=1e-9)
        assert seconds(mine["time_from_start"]) == pytest.approx(
            seconds(given["time_from_start"]), abs=1e-9
        )
    again = pf.trajectory(tmp_path / out)
    t = np.linspace(0.0, 3.5, 50)
    # Times are rounded to a nanosecond; the fastest goes 1 rad/s.
    assert again(t) == pytest.approx(motion(t), abs=1e-9)


def test_a_spreadsheet_parts_by_semicolons_and_has_decimal_commas(tmp_path: Path) -> None:
    rows = ["time [ms],b [deg],a", "0,0.5,0.25", "4,1.5,0.125", "8,2.5,0.0"]
    plain = written(tmp_path, "\n".join(rows), "a.csv")
    parted = [row.replace(",", ";").replace(".", ",") for row in rows]
    other = written(tmp_path, "\n".join(parted), "b.csv")
    assert pf.trajectory(other).spec == pf.trajectory(plain).spec
    half = pf.trajectory(other)(0.004)
    assert half == pytest.approx([np.radians(1.5), 0.125], rel=1e-12)  # a knot of the spline


def test_a_message_of_ros2_topic_echo_and_one_in_a_goal(tmp_path: Path) -> None:
    plain = pf.trajectory(MESSAGE)
    goal = {"goal": {"trajectory": [{"joint_trajectory": MESSAGE}]}}
    inline = pf.trajectory(joint_names=MESSAGE["joint_names"], points=MESSAGE["points"])
    old = copy.deepcopy(MESSAGE)
    for point in old["points"]:
        time = point["time_from_start"]
        point["time_from_start"] = {"secs": time["sec"], "nsecs": time.get("nanosec", 0)}
    for other in (pf.trajectory(written(tmp_path, TEXT)), pf.trajectory(goal), inline):
        assert other.spec == plain.spec
    assert pf.trajectory(old).spec == plain.spec
    assert from_spec(plain.spec, "motion").spec == plain.spec
    assert (pickle.loads(pickle.dumps(plain))(1.7) == plain(1.7)).all()


@pytest.mark.parametrize("degree, lost", [(5, ()), (3, ("accelerations",))])
def test_between_points_it_is_the_polynomial_of_the_controller(
    degree: int, lost: tuple[str, ...]
) -> None:
    """numpy solves for the coefficients that meet both ends, piece by piece."""
    motion, points = pf.trajectory(without(*lost)), MESSAGE["points"]
    for one, two in itertools.pairwise(points):
        t0, t1 = (seconds(p["time_from_start"]) for p in (one, two))
        rows, right = [], []
        for time, point in ((0.0, one), (t1 - t0, two)):
            for k, name in enumerate(FIELDS[: 3 - len(lost)]):
                basis = [np.poly1d([1.0] + [0.0] * i).deriv(k)(time) for i in range(degree + 1)]
                rows.append(basis)
                right.append(point[name])
        powers = np.linalg.solve(np.array(rows), np.array(right))
        t = np.linspace(t0, t1, 7)[1:-1]
        for k, found in enumerate(motion.evaluate(t)):
            expected = [
                [np.poly1d(column[::-1]).deriv(k)(time - t0) for column in powers.T] for time in t
            ]
            # Condition of the 6 by 6 systems: 1e3.
            assert found == pytest.approx(np.array(expected), abs=1e-12)
    p, v, a = motion.evaluate(np.array([3.0, 4.0]))
    assert (p == MESSAGE["points"][-1]["positions"]).all() and not v.any() and not a.any()


def test_positions_alone_are_a_cubic_spline_from_rest_to_rest() -> None:
    """Through 0, 1, 0 at 0, 1, 2 s from rest: s'' jumps nowhere, so s = 3 u^2 - 2 u^3, and back."""
    points = [{"positions": [x], "time_from_start": float(t)} for t, x in enumerate([0, 1, 0])]
    motion = pf.trajectory({"joint_names": ["a"], "points": points})
    u = np.linspace(0.0, 1.0, 11)
    assert motion(u)[:, 0] == pytest.approx(3 * u**2 - 2 * u**3, abs=1e-15)
    _, v, a = motion.evaluate(np.array([1.0, 1.0 - 1e-9]))
    assert v[:, 0] == pytest.approx([0, 0], abs=1e-8) and a[0] == pytest.approx(a[1], abs=1e-7)


def test_a_first_point_later_than_zero_is_gone_to_from_rest() -> None:
    late = without("accelerations")
    late["points"] = late["points"][1:]
    stay = pf.trajectory(late)
    p, v, _ = stay.evaluate(np.array([0.0, seconds(late["points"][0]["time_from_start"])]))
    assert p == pytest.approx(np.array([[0.5, 0.2], [0.5, 0.2]]), abs=1e-15)
    assert v == pytest.approx(np.array([[0.0, 0.0], [0.5, -0.125]]), abs=1e-15)
    gone = pf.trajectory(late, start={"a": -1.0})
    assert gone(0.0) == pytest.approx([-1.0, 0.2]) and gone(3.0) == pytest.approx([1.0, -0.3])
    assert from_spec(gone.spec, "motion")(0.7) == pytest.approx(gone(0.7), abs=0)


BAD = [  # what is replaced, by what, line, and what is said of it
    ("[1.0, -0.3]", "[1.0, x]", 16, r"points\[2\]\.positions\[1\]: 'x' is not a finite number"),
    ("[1.0, -0.3]", "[1.0, .nan]", 16, r"points\[2\]\.positions\[1\]: nan is not a finite"),
    ("[0.5, -0.125]", "[0.5]", 13, r"points\[1\]\.velocities: 1 numbers for 2 joints \(a, b\)"),
    ("  velocities: [0.5, -0.125]\n", "", 12, r"points\[1\]\.velocities: missing"),
    ("- positions: [0.5, 0.2]\n  v", "- v", 12, r"points\[1\]\.positions: missing"),
    ("{sec: 3}", "{sec: 1}", 19, r"points\[2\]\.time_from_start: 1 s follows 1\.12346 s"),
    ("{sec: 3}", "-3", 19, r"points\[2\]\.time_from_start: -3 s"),
    ("{sec: 3}", "{secs: 1.5}", 19, r"points\[2\]\.time_from_start\.secs: 1\.5 is out of range"),
    ("{sec: 3}", "{s: 3}", 19, r"points\[2\]\.time_from_start: \{'s': 3\} is no time"),
    ("velocities: [0, 0]", "velocities: [0, 0.1]", 17, r"velocities\[1\]: b ends at 0\.1"),
    ("effort", "torque", 10, r"points\[0\]\.torque: no such key of a point"),
    ("- b", "- a", 5, r'joint_names\[1\]: "a" is there twice'),
    ("joint_names", "names", 1, r"joint_names: missing"),
    ("points:", "waypoints:", 1, r"points: missing"),
    ("[0.5, 0.2]", "[0.5, 0.2", 13, r"expected ',' or '\]'"),
    ("joint_names:", "header:", 3, r'duplicate key "header"'),
]


@pytest.mark.parametrize("old, new, line, words", BAD)
def test_a_malformed_message_is_refused_by_field_and_line(
    old: str, new: str, line: int, words: str, tmp_path: Path
) -> None:
    assert old in TEXT
    with pytest.raises(pf.DescriptionError, match=rf"t\.yaml, line {line}: .*{words}"):
        pf.trajectory(written(tmp_path, TEXT.replace(old, new, 1)))


CSV = """# of a planner
t [s],a.position [deg],a.velocity [deg/s],b,b.velocity

0,0,0,1,0
1,90,45,2,0
2,180,0,1,0
"""
BAD_CSV = [
    ("1,90,45", "1,x,45", r"line 5: a\.positions: 'x' is not a finite number"),
    ("1,90,45,", "1,90,", r"line 5: 4 cells, the header has 5"),
    ("1,90", "0,90", r"line 5: t: 0 s follows 0 s"),
    ("2,180,0,", "2,180,1,", r"line 6: velocities: a ends at 0\.0174"),
    ("[deg]", "[kg]", r"line 2: a\.position: no unit of positions: \[kg\]"),
    ("[deg/s]", "[deg]", r"line 2: a\.velocity: no unit of velocities"),
    ("t [s]", "q", r"line 2: no column of time"),
    (",b,", ",c,", r"line 2: no column of positions of b"),
    (",b,", ",b.displacement,", r"line 2: b\.displacement: a displacement from home"),
    (",b,", ",a,", r"line 2: two columns of positions of a"),
    (",b.velocity", ",b.acceleration", r"line 2: no column of velocities of b"),
]


@pytest.mark.parametrize("old, new, words", BAD_CSV)
def test_a_malformed_table_is_refused_by_column_and_line(
    old: str, new: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(pf.DescriptionError, match=words):
        pf.trajectory(written(tmp_path, CSV.replace(old, new, 1), "t.csv"))


def test_a_table_is_read_in_its_units(tmp_path: Path) -> None:
    motion = pf.trajectory(written(tmp_path, CSV, "t.csv"))
    p, v, _ = motion.evaluate(np.array([1.0]))
    assert p[0] == pytest.approx([np.pi / 2, 2.0], rel=1e-15)
    assert v[0] == pytest.approx([np.pi / 4, 0.0], rel=1e-15)


def test_a_scene_moves_along_a_file_and_names_what_is_wrong_in_it(tmp_path: Path) -> None:
    plain = pf.load("3rrr")
    motors = plain.description.actuated
    home = [float(plain.joints[name].home[0]) for name in motors]
    points = [
        {"positions": home, "velocities": [0.0] * 3, "time_from_start": 0.0},
        {"positions": [home[0] + 0.1, *home[1:]], "velocities": [0] * 3, "time_from_start": 0.5},
    ]
    message = {"joint_names": [*motors], "points": points}
    path = written(tmp_path, json.dumps(message), "way.json")
    robot = pf.load("3rrr", [f"motion={{kind: trajectory, file: {path}}}"])
    run = pf.solve(robot, level="rigid", samples=3, until=0.5)
    # Half of a cubic from rest to rest.
    moved = run.joint(motors[0]).position - home[0]
    assert moved == pytest.approx([0, 0.05, 0.1], abs=1e-12)
    message["joint_names"] = ["motr_1", *motors[1:]]
    written(tmp_path, json.dumps(message), "way.json")
    with pytest.raises(pf.DescriptionError, match=r'joint with a motor: "motr_1"\. Did you mean'):
        pf.load("3rrr", [f"motion={{kind: trajectory, file: {path}}}"])
