"""The page of a made-up run, and a browser to open it in."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import pytest

from pinflex.results.result import Result
from pinflex.viewer.view import write_html
from tests.browser.chromium import CHROMIUM, DRIVER, Browser
from tests.browser.made_up import half_bent
from tests.synthetic import synthetic_result

URDF = """<robot name="3rrr"><link name="base"/>{}</robot>""".format(
    "".join(
        f'<link name="crank_{i}"/><joint name="motor_{i}" type="revolute"><parent link="base"/>'
        f'<child link="crank_{i}"/><axis xyz="0 0 1"/></joint>'
        for i in (1, 2, 3)
    )
)


@pytest.fixture(scope="session")
def run() -> Result:
    """The made-up planar robot, with the URDF text that says what its motors move."""
    result = synthetic_result(samples=121)
    sources = {**result.meta["sources"], "3rrr.urdf": URDF}
    return dataclasses.replace(result, meta={**result.meta, "sources": sources})


@pytest.fixture(scope="session")
def page(run: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    rigid = synthetic_result("rigid", samples=121)
    return write_html(run, tmp_path_factory.mktemp("view") / "run.html", rigid=rigid)


@pytest.fixture(scope="session")
def levels(run: Result) -> dict[str, Result]:
    """The rigid robot, one that bends half as much and stops early, and the run itself."""
    rigid = synthetic_result("rigid", samples=121)
    return {"rigid": rigid, "quasistatic": half_bent(run), "coupled": run}


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    pytest.importorskip("selenium", reason="selenium is not installed")
    if CHROMIUM is None or DRIVER is None:
        pytest.skip("chromium or chromedriver is not installed")
    started = Browser(tmp_path_factory.mktemp("profile"))
    yield started
    started.driver.quit()
