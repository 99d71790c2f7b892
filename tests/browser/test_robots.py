"""Pages of the shipped robots: meshes that bend, real mode shapes, a notebook.

Claims:
    Pages, pictures, figures
    - page of the delta with all levels (401 instants, nine links); nothing on the console | 3 MB |
      2.5 MB
    - meshes of a UR5 in place, bent, in the page and live | 5e-6 m; 20 % of its radius | passes |
      also `unit/viewer/test_serve.py`
"""

from __future__ import annotations

import html
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.__main__ import main
from pinflex.results.result import Result
from pinflex.viewer.scene import build_scene
from pinflex.viewer.view import write_html
from tests.browser.chromium import Browser


@pytest.fixture(scope="session")
def arm() -> Result:
    """A UR5, whose URDF names meshes, early in its move."""
    pytest.importorskip("example_robot_data")
    return pf.solve(pf.load("ur5"), until=0.1, samples=121)


@pytest.fixture(scope="session")
def arm_page(arm: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_html(arm, tmp_path_factory.mktemp("arm") / "ur5.html")


def test_a_page_with_meshes_stays_small(arm: Result, arm_page: Path) -> None:
    assert arm_page.stat().st_size < 2e6  # 121 frames
    scene = build_scene(arm)
    assert [bool(link["mesh"]) for link in scene["links"]] == [True, True]
    assert sum(bool(body["mesh"]) for body in scene["bodies"]) == 5
    assert any("meshes are drawn with fewer triangles" in note for note in scene["notes"])
    plain = build_scene(arm, meshes=None)
    assert not any(x["mesh"] for x in plain["links"] + plain["bodies"])


def test_the_page_of_all_levels_of_the_delta_is_under_three_megabytes(
    browser: Browser, tmp_path: Path
) -> None:
    robot = pf.load("delta")
    runs = {level: pf.solve(robot, level=level) for level in pf.LEVELS}
    page = pf.view(runs, tmp_path / "delta.html").path
    assert page.stat().st_size < 3e6  # 2.5e6 of 401 instants, nine links and 21 forces
    browser.open(page)
    assert browser.run("return pinflex.state.run") == 3
    opened = browser.run("return pinflex.legend.max")
    worst = max(runs["coupled"].link(name).von_mises.max() for name in runs["coupled"].links)
    assert opened == pytest.approx(1e-6 * worst, rel=1e-5)
    arm, k = runs["coupled"].link("arm_1"), -1  # the last instant is on every page, others not
    away = arm.centreline - arm.centreline_rigid
    browser.run("pinflex.show(0); pinflex.seek(arguments[0])", runs["coupled"].t[k])
    browser.run("pinflex.set({other: '3'})")
    shown = browser.run("pinflex.set({field: 'difference'}); return pinflex.values('arm_1')")
    assert max(shown) == pytest.approx(1e3 * np.linalg.norm(away[k], axis=1).max(), rel=1e-3)
    assert browser.errors() == []


def test_a_saved_arm_gives_the_same_page_with_its_meshes(
    arm: Result, arm_page: Path, tmp_path: Path
) -> None:
    again = write_html(Result.load(arm.save(tmp_path / "run.npz")), tmp_path / "again.html")
    assert again.read_text("utf-8") == arm_page.read_text("utf-8")


def test_a_bent_mesh_is_in_the_place_of_its_link(
    browser: Browser, arm: Result, arm_page: Path
) -> None:
    """At magnification 0 it is the rigid link; at 1 it moves by what the centreline moves."""
    k = 60
    browser.open(arm_page, f"t={arm.t[k]}&mag=0")
    assert browser.errors() == []
    model = pf.load("ur5").rigid.rigid
    data = model.createData()
    q = np.array(arm.array("joint/q")[k])
    pin.forwardKinematics(model, data, q)
    carriers = {"upper_arm_link": "shoulder_lift_joint", "forearm_link": "elbow_joint"}
    for name in arm.links:
        shown = np.array(browser.run("return pinflex.surface(arguments[0])", name)).reshape(-1, 3)
        about = arm.meta["links"][name]
        mesh = next(x["mesh"] for x in build_scene(arm)["links"] if x["name"] == name)
        beam = mesh["points"] / 32767 * mesh["half"] + np.array(mesh["centre"])
        local = beam @ np.array(about["frame"]).T + np.array(about["origin"])
        pose = data.oMi[model.getJointId(carriers[name])]
        wanted = local @ pose.rotation.T + pose.translation
        gap = np.linalg.norm(shown[:, None] - wanted[None], axis=2).min(axis=1)
        assert (
            gap.max() < 5e-6
        )  # a step of 16 bits is 1e-5 of a half length of 0.27 m, plus float32


def test_a_bent_mesh_keeps_its_distance_from_the_centreline(
    browser: Browser, arm: Result, arm_page: Path
) -> None:
    browser.open(arm_page, f"t={arm.t[60]}")
    name = arm.links[1]
    rigid, bent = (
        np.array(
            browser.run(
                "pinflex.setMag(arguments[1]); return pinflex.surface(arguments[0])", name, m
            )
        ).reshape(-1, 3)
        for m in (0, 200)
    )
    moved = np.linalg.norm(bent - rigid, axis=1)
    lines = []
    for mag in (0, 200):
        browser.run("pinflex.setMag(arguments[0])", mag)
        lines.append(browser.centreline(name))
    most = np.linalg.norm(lines[1] - lines[0], axis=1).max()
    assert most > 1e-3
    assert 0.3 * most < moved.max() < 3 * most  # sections turn as well, at 0.06 m from the line


@pytest.mark.parametrize(("model", "count"), [("3rrr", 3), ("3rrs", 4), ("ur5", 2)])
def test_mode_shapes_of_a_model_are_played_with_their_frequencies(
    browser: Browser, tmp_path: Path, capsys: pytest.CaptureFixture[str], model: str, count: int
) -> None:
    page = tmp_path / "modes.html"
    assert main(["modes", model, "--count", str(count), "--view", str(page)]) == 0
    capsys.readouterr()
    found = pf.modes(pf.load(model), count=count)
    browser.open(page, "play=0")
    options = browser.run("return [...document.getElementById('run').options].map(o => o.text)")
    told = [float(re.findall(r"([\d.]+) Hz", text)[0]) for text in options]
    assert told == pytest.approx(found.frequencies, rel=1e-3)  # four digits are shown
    period = 1 / found.frequencies[0]
    rest = {n: browser.centreline(n) for n in browser.run("return pinflex.links")}
    browser.run("pinflex.seek(arguments[0])", period / 4)
    swung = {n: browser.centreline(n) for n in rest}
    size = max(np.ptp(np.concatenate(list(rest.values())), axis=0))
    largest = max(np.linalg.norm(swung[n] - rest[n], axis=1).max() for n in rest)
    assert 0.02 * size < largest < 0.3 * size  # plainly to be seen, and still the robot
    browser.run("pinflex.seek(arguments[0])", 3 * period / 4)
    for name, line in rest.items():
        back = browser.centreline(name)
        # a swing of 1e-3 of a radian is as large one way as the other to its square
        assert back - line == pytest.approx(line - swung[name], abs=5e-3 * largest)
    assert browser.errors() == []


def test_a_notebook_shows_the_page_in_place(browser: Browser, arm: Result, tmp_path: Path) -> None:
    page = pf.view(arm, tmp_path / "arm.html")
    assert Path(page) == tmp_path / "arm.html"
    shown = page._repr_html_()
    assert html.unescape(shown.split('srcdoc="')[1].split('"')[0]) == Path(page).read_text("utf-8")
    cell = tmp_path / "cell.html"
    cell.write_text(f"<!DOCTYPE html><meta charset='utf-8'>{shown}", encoding="utf-8")
    browser.driver.get(cell.as_uri())
    browser.driver.switch_to.frame(0)
    try:
        browser.wait()
        assert browser.run("return document.querySelector('h1').textContent") == "ur5"
        assert browser.run("return self.origin") == "null"  # the notebook is out of its reach
    finally:
        browser.driver.switch_to.default_content()
