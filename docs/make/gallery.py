"""The gallery: pages that examples/gallery.py makes, each behind its picture and description."""

from __future__ import annotations

import os
import runpy
from pathlib import Path

EXAMPLE = Path(__file__).parents[2] / "examples" / "gallery.py"
_INTRO = """# Gallery

One file each, which plays offline. Turn it with the mouse, drag the time, choose what is coloured;
the first one has sliders and [solves what you ask](delta_live.html). `examples/gallery.py` makes
them all in half a minute, and `pinflex compare NAME` makes one with all levels.

<div class="cards" markdown="0">
"""
_CARD = """<a class="card" href="{name}.html">
<img src="../assets/gallery/{picture}.webp" alt="{title}" width="480" height="300" loading="lazy">
<strong>{title}</strong><span>{text}</span><code>{name}</code></a>
"""


def make(made: Path) -> Path:
    """The folder with the gallery's page and its files; DOCS_GALLERY=0 keeps what is there."""
    folder = made / "gallery"
    folder.mkdir(parents=True, exist_ok=True)
    example = runpy.run_path(str(EXAMPLE))
    if os.environ.get("DOCS_GALLERY") != "0":
        example["main"](str(folder))
    cards = [
        _CARD.format(name=name, picture=scene.picture or name, title=scene.title, text=scene.text)
        for name, scene in example["SCENES"].items()
    ]
    (folder / "index.md").write_text("".join([_INTRO, *cards, "</div>\n"]), "utf-8")
    return folder
