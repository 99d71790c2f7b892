"""Pictures and films, with a browser and without.

Claims:
    Pages, pictures, figures
    - .gif keeps the colours of path and legend | 12 of 255 | passes (111 with a palette by area)
    - .mp4: every picture reaches ffmpeg; one sentence without it | - | a stand-in for ffmpeg; with
      ffmpeg 9.0.2 tried by hand: 6 s, 0.4 MB
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from pinflex.__main__ import main
from pinflex.errors import DescriptionError, PinflexError
from pinflex.results.result import Result
from pinflex.viewer.export.pictures import captured_film as film
from pinflex.viewer.export.pictures import instant, picture
from tests.browser.chromium import CHROMIUM


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_pictures_and_films_are_saved(page: Path, tmp_path: Path) -> None:
    from PIL import Image

    with Image.open(picture(page, tmp_path / "at.png", at=0.03, size=(900, 600))) as still:
        assert still.size == (900, 600)
        assert np.asarray(still.convert("RGB"), float).std() > 5
    made = film(page, tmp_path / "run.gif", seconds=0.5, fps=10, size=(480, 320), ghost="off")
    with Image.open(made) as moving:
        assert moving.size == (480, 320)
        assert getattr(moving, "n_frames", 1) == 5
    with pytest.raises(DescriptionError, match=r"Allowed: \.gif"):
        film(page, tmp_path / "run.avi")


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_a_film_of_few_colours_keeps_those_of_the_path_and_of_the_legend(
    page: Path, tmp_path: Path
) -> None:
    """The path is a thousandth of the picture: a palette by area would turn it yellow."""
    from PIL import Image

    with Image.open(film(page, tmp_path / "run.gif", seconds=0.2, fps=10)) as moving:
        shown = np.asarray(moving.convert("RGB"), int).reshape(-1, 3)
    for colour in ((213, 94, 0), (253, 231, 37), (68, 1, 84)):  # path, ends of viridis
        assert np.abs(shown - colour).max(axis=1).min() < 12


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_an_mp4_is_every_picture_given_to_ffmpeg(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stand-in that keeps what it is told and given; the real one made a film of this by hand."""
    ffmpeg = tmp_path / "ffmpeg"
    ffmpeg.write_text('#!/bin/sh\nfor last; do :; done\necho "$@" > "$last.txt"\ncat > "$last"\n')
    ffmpeg.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    made = film(page, tmp_path / "run.mp4", seconds=0.3, fps=10, size=(481, 320))
    assert made.read_bytes().count(b"\x89PNG\r\n\x1a\n") == 3
    told = (tmp_path / "run.mp4.txt").read_text()
    assert "-framerate 10" in told
    assert "libx264" in told
    assert "yuv420p" in told  # what every player can show; it needs even sizes:
    assert "crop=trunc(iw/2)*2:trunc(ih/2)*2" in told
    ffmpeg.write_text("#!/bin/sh\necho no such codec >&2\nexit 3\n")
    with pytest.raises(PinflexError, match="ffmpeg failed: no such codec"):
        film(page, tmp_path / "run.mp4", seconds=0.2, fps=10, size=(480, 320))


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_without_ffmpeg_one_sentence_says_what_to_do(
    run: Result,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(
        "pinflex.viewer.export.pictures.shutil.which",
        lambda name: CHROMIUM if "chrom" in name else None,
    )
    assert main(["view", str(run.save(tmp_path / "run.npz")), "--mp4"]) == 1
    told = capsys.readouterr().err.strip().splitlines()
    assert told == [
        "pinflex: capture: run.mp4: ffmpeg was not found. Install it, or ask for a .gif."
    ]


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_the_command_saves_the_worst_instant(
    run: Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from PIL import Image

    file = run.save(tmp_path / "run.npz")
    assert main(["view", str(file), "--png", "worst"]) == 0
    assert capsys.readouterr().out.split() == [str(tmp_path / f"run.{x}") for x in ("html", "png")]
    with Image.open(tmp_path / "run.png") as still:
        assert still.size == (1280, 800)
    assert (tmp_path / "run.png").stat().st_size < 400_000


def test_without_a_browser_lines_are_drawn_and_it_is_said(
    run: Result,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from PIL import Image

    monkeypatch.setenv("PINFLEX_BROWSER", str(tmp_path / "none"))
    monkeypatch.setattr("pinflex.viewer.export.pictures.SECONDS", 0.5)
    file = str(run.save(tmp_path / "run.npz"))
    assert main(["view", file, "--png", "0.03", "--gif"]) == 0
    assert capsys.readouterr().out.count("no Chromium was found") == 2
    with Image.open(tmp_path / "run.png") as still:
        pixels = np.asarray(still.convert("RGB"), float)
    assert pixels.std() > 5
    assert np.ptp(pixels, axis=2).max() > 100  # stress in colour, on a robot in grey
    with Image.open(tmp_path / "run.gif") as moving:
        assert getattr(moving, "n_frames", 1) == 5
    assert main(["view", file, "--mp4"]) == 1
    assert "ask for --gif" in capsys.readouterr().err


def test_an_instant_is_a_time_of_the_run_or_the_worst_one(run: Result) -> None:
    stress = np.max([run.link(n).von_mises.max(axis=1) for n in run.links], axis=0)
    assert instant(run, "worst") == run.t[stress.argmax()]
    assert instant(run, "0.05") == 0.05
    for text in ("0.3", "-1", "nan", "soon"):
        with pytest.raises(DescriptionError, match="is no instant of the run"):
            instant(run, text)
