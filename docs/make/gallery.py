"""The gallery: pages that examples/gallery.py makes, each behind its description."""

from __future__ import annotations

import os
import runpy
from pathlib import Path

EXAMPLE = Path(__file__).parents[2] / "examples" / "gallery.py"
_INTRO = """# Gallery

Each of these is one file that plays offline: turn it with the mouse, drag the time, choose what is
coloured. `examples/gallery.py` makes them all in some ten seconds.
"""


def make(made: Path) -> Path:
    """The folder with the gallery's page and its files; DOCS_GALLERY=0 keeps what is there."""
    folder = made / "gallery"
    folder.mkdir(parents=True, exist_ok=True)
    example = runpy.run_path(str(EXAMPLE))
    scenes = example["SCENES"]
    if os.environ.get("DOCS_GALLERY") != "0":
        example["main"](str(folder))
    parts = [_INTRO]
    for name, scene in scenes.items():
        shown = f'src="{name}.html" loading="lazy" title="{scene.title}"'
        parts.append(
            f"## {scene.title}\n\n{scene.text}\n\n"
            f'<iframe class="scene" {shown}></iframe>'
            f'\n\n<a href="{name}.html">Open it alone</a>\n'
        )
    (folder / "index.md").write_text("\n".join(parts), "utf-8")
    return folder
