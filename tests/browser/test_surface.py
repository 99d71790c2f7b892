"""Links that were solved as solids show the stress on the surface of their mesh.

Claims:
    Pages, pictures, figures
    - stress on the surface of a solid: colours, legend, worst point, hover | 1e-5 of the largest |
      passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.results.result import Result
from pinflex.studies.pose import mode_runs
from pinflex.viewer.export.pictures import instant
from pinflex.viewer.links import MOST
from pinflex.viewer.scene import build_scene
from pinflex.viewer.view import write_html, write_modes_html
from tests.browser.chromium import Browser
from tests.browser.made_up import with_surface


@pytest.fixture(scope="session")
def solid(run: Result) -> Result:
    return with_surface(run)


@pytest.fixture(scope="session")
def solid_page(solid: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_html(solid, tmp_path_factory.mktemp("solid") / "solid.html")


def test_legend_and_colours_are_those_of_the_surface(
    browser: Browser, solid: Result, solid_page: Path
) -> None:
    stress, k = solid.array("link/distal_1/mesh/von_mises"), 60
    browser.open(solid_page, f"t={solid.t[k]}")
    assert browser.errors() == []
    largest = 1e-6 * stress.max()
    assert browser.run("return pinflex.legend.max") == pytest.approx(largest, rel=1e-6)
    shown = browser.run("return pinflex.values('distal_1')")
    assert sorted(shown) == pytest.approx(sorted(1e-6 * stress[k]), abs=1e-5 * largest)
    plot = build_scene(solid)["plots"][-1]["curves"][0]["y"]
    assert plot == pytest.approx(1e-6 * stress.max(axis=1))


def test_the_worst_instant_is_marked_where_the_surface_has_it(
    browser: Browser, solid: Result, solid_page: Path
) -> None:
    stress = solid.array("link/distal_1/mesh/von_mises")
    browser.open(solid_page, "mag=1")
    browser.run("pinflex.worst()")
    assert browser.run("return pinflex.state.t") == pytest.approx(instant(solid, "worst"))
    assert instant(solid, "worst") == solid.t[stress.max(axis=1).argmax()]
    marker = browser.run("return document.querySelector('.mark.peak').innerText")
    assert float(marker.split()[1]) == pytest.approx(1e-6 * stress.max(), rel=0.01)


def test_hover_tells_the_stress_of_the_point_of_the_surface(
    browser: Browser, solid: Result, solid_page: Path
) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    k = int(solid.array("link/distal_1/mesh/von_mises").max(axis=1).argmax())
    browser.open(solid_page, f"t={solid.t[k]}&mag=1&peak=0&path=0&ghost=off")
    x, y = browser.run("return pinflex.pixel('distal_1', 12)")  # beside the worst node, at x = L/2
    body = browser.driver.find_element("tag name", "body")
    move = ActionChains(browser.driver).move_to_element_with_offset
    move(body, round(x - body.size["width"] / 2), round(y - body.size["height"] / 2)).perform()
    text = browser.run("return document.getElementById('tip').innerText")
    told = float(text.split("von Mises stress")[1].split("MPa")[0])
    here = 1e-6 * solid.array("link/distal_1/mesh/von_mises")[k]
    assert np.abs(told / here - 1).min() < 0.005  # it is the value of one node, to three digits
    assert "bending stress" in text  # of the section there


def test_a_fine_mesh_is_thinned_and_keeps_its_worst_node(run: Result) -> None:
    fine = with_surface(run)
    n, m = 60, 400
    a, x = np.meshgrid(np.linspace(0, 2 * np.pi, n, endpoint=False), np.linspace(0, 0.22, m))
    nodes = np.stack([x, 0.01 * np.cos(a), 0.01 * np.sin(a)], axis=2).reshape(-1, 3)
    i = (np.arange(m - 1)[:, None] * n + np.arange(n)).ravel()
    j = i - i % n + (i + 1) % n
    faces = np.concatenate([np.stack([i, j, j + n], 1), np.stack([i, j + n, i + n], 1)])
    stress = np.outer(1 + np.sin(run.t), np.random.default_rng(0).uniform(1, 2, len(nodes)))
    stress[:, 7777] *= 5
    mesh = {"nodes": nodes, "triangles": faces.astype(float), "von_mises": stress}
    arrays = {**fine.arrays, **{f"link/distal_1/mesh/{k}": v for k, v in mesh.items()}}
    link = build_scene(Result(run.t, arrays, fine.meta))["links"][0]
    assert len(link["mesh"]["faces"]) <= MOST
    assert link["surface"]["von_mises"].shape == (len(run.t), len(link["mesh"]["points"]))
    assert link["surface"]["von_mises"].max() == stress.max()
    worst = link["surface"]["von_mises"].max(axis=0).argmax()
    at = link["mesh"]["points"][worst] / 32767 * link["mesh"]["half"] + link["mesh"]["centre"]
    assert np.linalg.norm(at - nodes[7777]) < 0.01


def test_a_solved_solid_is_drawn_by_its_mesh(browser: Browser, tmp_path: Path) -> None:
    pytest.importorskip("skfem")
    change = ["flexible.rod_?.section=null", "flexible.rod_?.axial=null",
              "flexible.rod_?.basis={kind: mesh, modes: 1, rod: {"
              "diameters: [0.020, 0.016], lengths: [0.30732312800049563, 0.04]}}"]  # fmt: skip
    result = pf.solve(pf.load("3tpt", change), level="quasistatic", samples=5, until=0.02)
    browser.open(write_html(result, tmp_path / "rods.html"), "t=0.02&mag=1")
    assert browser.errors() == []
    assert all(link["surface"] for link in build_scene(result)["links"])
    for name in result.links:
        stress = result.array(f"link/{name}/mesh/von_mises")[-1]
        shown = browser.run("return pinflex.values(arguments[0])", name)
        assert max(shown) == pytest.approx(1e-6 * stress.max(), rel=1e-5)
        points = np.array(browser.run("return pinflex.surface(arguments[0])", name)).reshape(-1, 3)
        line = browser.centreline(name)
        away = np.linalg.norm(points[:, None] - line[None], axis=2).min(axis=1)
        assert away.max() < 0.015  # its radius is 0.010 m, stations stand 0.014 m apart
    solid = pf.load("3tpt", change)
    shapes = mode_runs(solid, pf.modes(solid, count=1))
    browser.open(write_modes_html(shapes, tmp_path / "modes.html"), "play=0")
    assert browser.errors() == []
    drawn = browser.run("return pinflex.surface(arguments[0]).length", name)
    assert drawn == points.size  # the same mesh, though a shape has no stress
