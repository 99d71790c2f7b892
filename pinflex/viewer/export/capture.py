"""Pictures and films of a page, by a headless Chromium where there is one.

One run of the browser makes one picture or a whole film: the page itself draws every instant and
leaves the pictures in its own text, which the browser prints. No port is opened, and no process
stays behind.
"""

from __future__ import annotations

import base64
import io
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from pinflex.errors import DescriptionError, PinflexError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
MACOS = "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome"
_GROUND = 48  # colours of a .gif kept for the background
FLAGS = (
    "--headless=new",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",  # software WebGL where there is no graphics card
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--hide-scrollbars",
)


def find_browser() -> str | None:
    """Path of a Chromium, or None; PINFLEX_BROWSER names the one to take."""
    wish = os.environ.get("PINFLEX_BROWSER")
    names = (wish,) if wish else (*BROWSERS, MACOS)
    return next((found for found in map(shutil.which, names) if found), None)


def browser() -> str:
    """Path of a Chromium."""
    found = find_browser()
    if found:
        return found
    raise PinflexError(
        f"capture: no Chromium was found (looked for {', '.join(BROWSERS)}). Pictures and films "
        "are drawn by it. Install chromium, or name one in PINFLEX_BROWSER; the page itself "
        "saves a picture or a film from its Display menu."
    )


def picture(
    page: str | Path,
    path: str | Path,
    at: float | None = None,
    size: tuple[int, int] = (1280, 800),
    **state: object,
) -> Path:
    """Save the whole page at one instant as a .png."""
    path = Path(path).resolve()
    path.parent.mkdir(parents=True, exist_ok=True)
    if at is not None:
        state["t"] = at
    _run(page, {"shadow": 1, "sharp": 2, **state}, size, [f"--screenshot={path}"])
    if not path.is_file():
        raise PinflexError(
            f"capture: {browser()} wrote no {path.name}. Open {page} in it to see why."
        )
    return path


def film(
    page: str | Path,
    path: str | Path,
    *,
    seconds: float = 6.0,
    fps: int = 20,
    size: tuple[int, int] = (960, 600),
    **state: object,
) -> Path:
    """Save the whole motion as a .gif, .mp4 or .webm with its legend."""
    path = Path(path)
    if path.suffix not in (".gif", ".mp4", ".webm"):
        raise DescriptionError(
            f"capture: {path.name}: {path.suffix!r} is no film. Allowed: .gif, .mp4, .webm."
        )
    ffmpeg = shutil.which("ffmpeg")
    if path.suffix != ".gif" and ffmpeg is None:
        raise PinflexError(
            f"capture: {path.name}: ffmpeg was not found. Install it, or ask for a .gif."
        )
    state |= {"shots": max(2, round(seconds * fps)), "size": f"{size[0]}x{size[1]}", "ui": 0}
    printed = _run(page, state, size, ["--dump-dom"])
    own = printed[printed.rfind('id="pinflex-shots"') :]  # before it: icons of the viewer
    found = re.findall(r"data:image/png;base64,([A-Za-z0-9+/=]+)", own)
    shots = [base64.b64decode(s) for s in found]
    if not shots:
        raise PinflexError(
            f"capture: {browser()} drew nothing of {page}. Open it there to see why."
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".gif":
        _gif(shots, path, fps)
    else:
        _encode(str(ffmpeg), shots, path, fps)
    return path


def _run(page: str | Path, state: dict[str, object], size: tuple[int, int], task: list[str]) -> str:
    page = Path(page).resolve()
    if not page.is_file():
        raise DescriptionError(f"capture: {page}: no such page. Write it with pinflex.view first.")
    address = f"{page.as_uri()}#{urlencode(state)}"
    sandbox = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
    with tempfile.TemporaryDirectory(
        prefix="pinflex-browser-", ignore_cleanup_errors=True
    ) as profile:
        command = [browser(), *FLAGS, *sandbox, f"--user-data-dir={profile}"]
        command += [f"--window-size={size[0]},{size[1]}", "--virtual-time-budget=10000"]
        try:
            done = subprocess.run(
                [*command, *task, address], capture_output=True, text=True, timeout=600, check=False
            )
        except subprocess.TimeoutExpired as error:
            raise PinflexError(
                f"capture: {command[0]} did not finish in {error.timeout:g} s. Ask for fewer or "
                "smaller pictures (fps, seconds, size)."
            ) from None
    if done.returncode:
        raise PinflexError(
            f"capture: {command[0]} failed ({done.returncode}): {done.stderr.strip()[-300:]}"
        )
    return done.stdout


def _gif(shots: list[bytes], path: Path, fps: int) -> None:
    from PIL import Image  # comes with matplotlib

    frames = [Image.open(io.BytesIO(shot)).convert("RGB") for shot in shots]
    palette = _palette(frames)
    still = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    still[0].save(path, save_all=True, append_images=still[1:], duration=round(1000 / fps), loop=0)


def _palette(frames: list[Any]) -> Any:
    """One palette for all pictures, so that nothing flickers.

    A palette by area would be spent on the background and lose the few pixels of a path or a peak;
    one by colour would leave steps in the background, so that has some of its own.
    """
    from PIL import Image

    some = frames[:: max(1, len(frames) // 4)]
    width, height = some[0].size
    sample = Image.new("RGB", (width, height * len(some)))
    for i, frame in enumerate(some):
        sample.paste(frame, (0, i * height))
    edge = some[0].crop((width - 2, 0, width, height))
    whole = edge.quantize(_GROUND).getpalette() or []
    whole = whole[: 3 * _GROUND]
    rest = sample.quantize(256 - _GROUND, method=Image.Quantize.MAXCOVERAGE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette((whole + rest)[: 3 * 256])
    return palette


def _encode(ffmpeg: str, shots: list[bytes], path: Path, fps: int) -> None:
    codec = (
        ["-c:v", "libx264", "-crf", "18"] if path.suffix == ".mp4" else ["-crf", "30", "-b:v", "0"]
    )
    command = [ffmpeg, "-y", "-loglevel", "error", "-f", "image2pipe", "-framerate", str(fps)]
    command += ["-c:v", "png", "-i", "-", *codec, "-pix_fmt", "yuv420p"]
    command += ["-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", str(path)]
    done = subprocess.run(command, input=b"".join(shots), capture_output=True, check=False)
    if done.returncode:
        raise PinflexError(f"capture: ffmpeg failed: {done.stderr.decode(errors='replace')[-300:]}")
