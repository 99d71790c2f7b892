"""Pictures and films, with a browser and without."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pinflex.capture import film, picture
from pinflex.errors import DescriptionError
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
