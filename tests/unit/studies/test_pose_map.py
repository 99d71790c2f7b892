"""Modes followed over a grid of poses, and the table and figures made of them.

Claims:
    Many cases
    - rigid axes of a map: inf, null in JSON, "rigid" in text and figure, no tick of more than 7
      letters | - | exact | passes
    - followed modes of two arms that share nothing depend on their own angle alone, over 36 poses
      with crossings | independence | 1e-9 | 0 (sorted ones: 0.08)
    - a 3-RRR turned until its three distal links point at the platform's centre: map and rigid run
      name the two poses, the two instants about it | geometry | exact | passes
    - a map has the frequencies and compliance of each pose alone | `modes` | 1e-9 | passes
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex import __main__
from pinflex.errors import ConvergenceError, DescriptionError, MotionError
from pinflex.results.pose_map import PoseMap
from pinflex.solver.solve import default_motion
from pinflex.studies.pose import moved, platform_compliance, pose, tracked
from pinflex.studies.pose_map import pose_map
from pinflex.viewer.plots.maps import axes_of_map, plot_map
from tests.scenes import Body, load, published

# Two arms that share nothing but the ground. Gravity stiffens a hanging arm and softens a standing
# one, so each has frequencies that depend on its own motor alone, and the two sets cross.
ARMS = tuple(
    body
    for k, name in enumerate("ab")
    for body in (
        Body(name, "base", "revolute", xyz=(0, 0, k)),
        Body(f"end_{name}", name, xyz=(1, 0, 0)),
    )
)
YAML = "gravity: [0, -9.81, 0]\nflexible:\n" + "".join(
    f"""
  {name}:
    material: {{E: {E}, nu: 0.3, rho: 1}}
    section: {{shape: given, A: 0.1, Iy: 1, Iz: 1, J: 1}}
    basis: {{kind: craig_bampton, internal: 1}}
    bending_y: true
    bending_z: false
    torsion: false
    axial: false
    end: end_{name}
    tip: {{mass: 1}}
"""
    for name, E in (("a", 40.0), ("b", 41.0))
)


@pytest.fixture(scope="module")
def arms(tmp_path_factory: pytest.TempPathFactory) -> pf.Mechanism:
    return load(tmp_path_factory.mktemp("arms"), ARMS, YAML)


def test_a_column_is_one_arm_through_every_crossing(arms: pf.Mechanism) -> None:
    """Columns depend on their own arm's angle alone, over a plane of poses; sorted, none does."""
    found = pose_map(arms, {"a_joint": "-1.3:1.2:6", "b_joint": "-1.2:1.3:6"}, count=4)
    f = found.frequencies
    # each column varies along one of the two coordinates only
    along = np.array([np.ptp(f, axis=axis).max(axis=0) for axis in (0, 1)]) / f[0, 0]
    still = np.sort(along, axis=0)
    assert np.all(still[1] > 0.02)
    # 1e-9: the same matrices of one arm, in whatever company
    assert np.all(still[0] < 1e-9)
    ordered = np.sort(f, axis=-1)
    both = np.min([np.ptp(ordered[..., 0], axis=axis).max() for axis in (0, 1)])
    assert both > 0.02 * f[0, 0, 0]
    assert np.all(found.agreement > 0.98)
    assert np.isnan(found.compliance).all()  # no platform


def test_the_map_has_the_numbers_of_each_pose() -> None:
    robot = pf.load("3rrs")
    found = pose_map(robot, {"z": [-0.02, 0.0, 0.01], "rx": [-0.05, 0.0]}, preload="none", jobs=2)
    for place, (z, rx) in {(0, 0): (-0.02, -0.05), (1, 1): (0, 0), (2, 0): (0.01, -0.05)}.items():
        q = moved(robot, {"z": z, "rx": rx})
        # sorted modes and the same linearisation: equal to the last digits
        alone = pf.modes(robot, q, count=6, preload="none").frequencies
        assert np.sort(found.frequencies[place]) == pytest.approx(alone, rel=1e-9)
        C = platform_compliance(robot, q, preload="none")
        assert found.compliance[place] == pytest.approx(C, rel=1e-9, abs=1e-12)


def test_poses_out_of_reach_say_so_and_leave_a_gap(tmp_path: Path) -> None:
    robot = pf.load(published("3rrr"))
    found = pose_map(robot, {"x": [-0.1, 0.0, 0.1, 0.3]}, journal=tmp_path / "journal")
    assert [bool(error) for error in found.errors] == [False, False, False, True]
    assert "singular pose" in found.errors[3] and np.isnan(found.frequencies[3]).all()
    again = pose_map(robot, {"x": [-0.1, 0.0, 0.1, 0.3]}, journal=tmp_path / "journal")
    assert np.array_equal(again.frequencies, found.frequencies, equal_nan=True)
    assert len((tmp_path / "journal").read_text().splitlines()) == 4
    table = found.table
    assert table["status"].tolist() == ["done"] * 3 + ["failed"]
    assert table.units["x"] == "m" and table.units["K_xrz (others held)"] == "N"
    for name in ("K_xx (others held)", "1/C_xx (others free)"):
        assert np.isinf(table[name][:3]).all()  # legs that only bend
    assert found.rigid == ("x", "y", "z", "rx", "ry", "rz")
    with pytest.raises(ConvergenceError, match="not one pose"):
        pose_map(robot, {"x": [0.3]})


def test_poses_are_displacements_of_one_kind() -> None:
    robot = pf.load("3rrr")
    q = moved(robot, {"x": 0.02})  # y and rz stay
    assert moved(robot, {"x": 0.02, "y": 0.0, "rz": 0.0}) == pytest.approx(q, abs=1e-12)
    home = dict(zip(robot.coordinates, robot.home, strict=True))
    there = pose(robot, {"motor_1": home["motor_1"] + 0.1})
    assert moved(robot, {"motor_1": 0.1}) == pytest.approx(there, abs=1e-12)
    for by, said in (
        ({"motor_1": 0.1, "x": 0.1}, "motors and platform coordinates together"),
        ({"motor_4": 0.1}, 'Did you mean "motor_'),
    ):
        with pytest.raises(DescriptionError, match=said):
            moved(robot, by)
    with pytest.raises(MotionError, match="mobility 3"):
        moved(robot, {"z": 0.1})


@pytest.mark.parametrize("wrong", [[0.1, 0.0], ["x"], [float("nan")]])
def test_a_grid_is_increasing_numbers(arms: pf.Mechanism, wrong: list[object]) -> None:
    with pytest.raises(DescriptionError, match="no increasing numbers"):
        pose_map(arms, {"a_joint": wrong})


def test_the_figure_has_a_panel_for_each_frequency_and_axis() -> None:
    line = pose_map("3rrs", {"z": "-.01:.01:3"}, preload="none")
    names = [t.get_text() for t in plot_map(line).axes[1].get_legend().get_texts()]
    assert names[0] == "1/C_xx (others free) [N/m]" and len(names) == 6
    plane = pose_map("ur5", {"z": "-.1:.1:3", "x": "0:.1:2", "y": "0:.1:2"}, count=2)
    titles = [ax.get_title(loc="left") for ax in plot_map(plane).axes]
    assert [t for t in titles if t][:3] == [
        "mode 1 [Hz]",
        "mode 2 [Hz]",
        "1/C_xx (others free)\n[MN/m]",
    ]
    with pytest.raises(DescriptionError, match="one pose makes no plot"):
        plot_map(pose_map("cantilever", {}))


def test_modes_are_followed_over_a_gap() -> None:
    rng = np.random.default_rng(0)
    perms = {place: rng.permutation(5) for place in [(0,), (1,), (3,), (4,)]}
    found = tracked({p: np.eye(5)[:, perm] for p, perm in perms.items()}, lambda p: np.eye(5), 5)
    assert len({tuple(perms[p][order]) for p, (order, _) in found.items()}) == 1
    assert all(agreement == 1.0 for _, agreement in found.values())
    assert tracked({}, lambda p: np.eye(5), 5) == {}


def test_what_is_rigid_is_said_in_figure_table_and_json(capsys: pytest.CaptureFixture[str]) -> None:
    grid = {"x": "-.02:.02:2", "y": "-.02:.02:2"}
    held = pose_map(published("3rrr"), grid, count=2)
    figure = plot_map(held)
    assert "rigid along x, y, z, rx, ry, rz" in figure.get_suptitle()
    assert not any("1/C" in ax.get_title(loc="left") for ax in figure.axes)
    figure.canvas.draw()
    for found in (held, pose_map("3rrr", grid, count=2)):
        figure = plot_map(found)
        figure.canvas.draw()
        ticks = [t.get_text() for ax in figure.axes for t in ax.get_yticklabels()]
        assert max(map(len, ticks)) < 8  # equal to 1e-9: no ticks of 13 digits
    assert __main__.main(["map", "3rrr", "--grid", "x=0:.01:2", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["columns"]["K_zz (others held)"] == [None, None]
    assert answer["columns"]["1/C_xx (others free)"][0] == pytest.approx(1 / 3.944e-8, rel=1e-3)
    assert "rigid along z, rx, ry" in answer["notes"][1]
    assert __main__.main(["map", "3rrr", "--grid", "x=0:.01:2"]) == 0
    text = capsys.readouterr().out
    assert "rigid along z, rx, ry" in text and "zz" not in text and "e+26" not in text
    assert __main__.main(["map", "3rrr", "--grid", "x=0:.01:2", "-v"]) == 0
    text = capsys.readouterr().out
    assert "K_zz (others held)" in text and "rigid" in text and "e+26" not in text


def along(robot: pf.Mechanism, instants: int, **options: object) -> PoseMap:
    """Frequencies along the motion of the model."""
    motion = default_motion(robot)
    return pose_map(robot, along=motion, instants=instants, stiffness=False, **options)


def test_the_first_pose_has_the_frequencies_of_home() -> None:
    robot = pf.load("ur5")
    found = along(robot, count=4, instants=5)
    home = pf.modes(robot, count=4).frequencies
    # 1e-9: the same linearisation at the same pose, reached by one closure less
    assert found.frequencies[0] == pytest.approx(home, rel=1e-9)
    assert found.frequencies.shape == (5, 4)
    assert not found.errors.any()


def test_a_line_follows_its_mode_where_frequencies_are_equal() -> None:
    """With the motors locked each leg of the 3-RRR swings alone, in every pose alike."""
    found = along(pf.load("3rrr"), count=6, instants=21)
    # 1 %: the platform couples the legs a little, differently in each pose
    assert np.ptp(found.frequencies, axis=0) / found.frequencies[0] == pytest.approx(0, abs=0.01)
    assert found.preload == "none"  # it lies on a table


def test_poses_without_an_equilibrium_are_left_out_and_told(tmp_path: Path) -> None:
    found = along(pf.load("3rrs"), count=3, instants=6)
    assert np.isfinite(found.frequencies[:3]).all()
    assert np.isnan(found.frequencies[-1]).all()
    assert not found.errors[3] and "static equilibrium: no equilibrium" in found.errors[4]
    assert "no answer" in [t.get_text() for t in plot_map(found).axes[0].texts]
    axes_of_map(found, path=tmp_path / "map.pdf")
    assert (tmp_path / "map.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(DescriptionError, match="Allowed"):
        axes_of_map(found, path=tmp_path / "map.gif")


def test_the_figure_names_the_lowest_frequency() -> None:
    found = along(pf.load("3rrs"), count=3, instants=5, preload="none")
    texts = [t.get_text() for t in plot_map(found).axes[0].texts]
    assert f"lowest {found.frequencies.min():.4g} Hz at 1 s" in texts


def test_a_singular_pose_between_two_is_told() -> None:
    """Forces along three links through one point turn nothing (Hunt 1978, ch. 10)."""
    robot, turn = pf.load("3rrr"), pf.quintic(platform={"x": 0, "y": 0, "rz": -1.0}, duration=1.0)
    run = pf.solve(robot, turn, level="rigid", until=1.0, samples=101)
    knee, pin = (run.array(f"body/{name}/pose")[:, :, 3] for name in ("elbow_1", "platform_c1"))
    # of the link's line about the centre
    arm = np.cross(pin - knee, run.frame("platform").position - knee)[:, 2]
    (k,) = np.flatnonzero(arm[1:] * arm[:-1] < 0.0)
    (said,) = [text for text in run.meta["warnings"] if "singular pose" in text]
    assert f"t = {run.t[k]:.4g} to {run.t[k + 1]:.4g} s" in said
    R = run.frame("platform").rotation
    rz = np.arctan2(R[k : k + 2, 1, 0], R[k : k + 2, 0, 0])
    found = pose_map(robot, {"rz": [rz[1] - 0.1, rz[1], rz[0], rz[0] + 0.1]}, count=1)
    assert found.passed == (f"rz = {rz[1]:.4g} and {rz[0]:.4g}",)
    assert pose_map(robot, {"x": [-0.05, 0.0, 0.05]}, count=1).passed == ()
