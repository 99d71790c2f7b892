"""What a page holds, without a browser: size, policy, names, extremes.

Claims:
    Pages, pictures, figures
    - a page of 121 instants and six links; of 1200 instants | 1 MB, 1 s; 3 MB, 1 s (2 and 8 MB
      wanted) | 3rrs: 0.77 MB in 0.04 s; 2.2 MB in 0.3 s
    - longer runs, or many links: fewer instants, extremes kept, said on the page | extremes exact,
      8 MB | exact
"""

from __future__ import annotations

from pathlib import Path

import pytest

from pinflex.errors import DescriptionError
from pinflex.results.result import Result
from pinflex.viewer.scene import FRAMES, automatic_scale, build_scene
from pinflex.viewer.view import write_html, write_modes_html
from tests.browser.made_up import EVIL, renamed, six_links
from tests.synthetic import synthetic_result


def test_the_page_is_small(run: Result, tmp_path: Path) -> None:
    file = write_html(six_links(run), tmp_path / "six.html")
    assert file.stat().st_size < 1e6  # 121 frames, 6 links: 2 MB are allowed


def test_a_long_run_is_thinned_keeps_its_extremes_and_says_so(tmp_path: Path) -> None:
    result = synthetic_result(samples=3001)
    scene = build_scene(result)
    assert len(scene["t"]) <= FRAMES
    for link in scene["links"]:
        whole = result.link(link["name"]).von_mises
        assert link["fields"]["von_mises"].max() == whole.max()
    torque = scene["plots"][0]["curves"][0]["y"]
    assert (torque.min(), torque.max()) == (result.torque[:, 0].min(), result.torque[:, 0].max())
    assert any("of 3001 instants kept" in note for note in scene["notes"])
    assert write_html(result, tmp_path / "long.html").stat().st_size < 3e6  # 8 MB are allowed


def test_a_run_of_1200_instants_and_six_links_is_kept_whole(tmp_path: Path) -> None:
    result = six_links(synthetic_result(samples=1200))
    assert len(build_scene(result)["t"]) == 1200
    file = write_html(result, tmp_path / "long.html")
    assert file.stat().st_size < 3e6


def test_many_links_leave_room_for_fewer_instants(tmp_path: Path) -> None:
    result = synthetic_result(samples=601)
    arrays, links = dict(result.arrays), {}
    for n in range(40):
        links[f"more_{n}"] = result.meta["links"]["distal_1"]
        for key in [k for k in arrays if k.startswith("link/distal_1/")]:
            arrays[key.replace("distal_1", f"more_{n}")] = arrays[key]
    many = Result(result.t, arrays, {**result.meta, "links": result.meta["links"] | links})
    scene = build_scene(many)
    assert 100 < len(scene["t"]) < 601
    assert any("of 601 instants kept" in note for note in scene["notes"])
    assert write_html(many, tmp_path / "many.html").stat().st_size < 8e6


@pytest.mark.parametrize(
    ("largest", "scale"), [(0.5, 1), (0.03, 2), (6e-4, 100), (6.1e-5, 1000), (0.0, 1), (1e-3, 50)]
)
def test_automatic_magnification_is_1_2_5(largest: float, scale: float) -> None:
    assert automatic_scale(largest, 1.0) == scale  # 6 % of the size of the robot, rounded


def test_names_never_become_markup(run: Result, tmp_path: Path) -> None:
    text = write_html(renamed(run), tmp_path / "evil.html", title=EVIL).read_text("utf-8")
    assert text.count("<script") == 3  # data, viewer, player
    assert "window.evil=1</script>" not in text


def test_the_page_forbids_every_network_access(page: Path) -> None:
    policy = page.read_text("utf-8").split('Content-Security-Policy" content="')[1].split('">')[0]
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "http" not in policy
    assert "unsafe-eval" not in policy


def test_wrong_options_are_told_with_the_right_ones(run: Result, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match='Did you mean "bending"'):
        write_html(run, tmp_path / "x.html", field="bendng")
    with pytest.raises(DescriptionError, match="is no magnification"):
        write_html(run, tmp_path / "x.html", scale="huge")
    with pytest.raises(DescriptionError, match="no mode shape was given"):
        write_modes_html([], tmp_path / "x.html")


def test_a_saved_result_gives_the_same_page(run: Result, page: Path, tmp_path: Path) -> None:
    again = Result.load(run.save(tmp_path / "run.npz"))
    rigid = synthetic_result("rigid", samples=121)
    text = write_html(again, tmp_path / "again.html", rigid=rigid).read_text("utf-8")
    assert text == page.read_text("utf-8")
