"""Six pages to look at, one for each kind of answer: moves, vibration, modes, a beam spun up.

Writes them to the folder given, or to ./gallery.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import pinflex as pf
from pinflex.__main__ import main as command


@dataclass(frozen=True)
class Scene:
    """A picture of the gallery.

    Attributes:
        title, text: What it shows.
        model: A shipped model. level: That it is solved at; `modes` for its mode shapes.
    """

    title: str
    text: str
    model: str
    level: str = "coupled"


SCENES = {
    "delta": Scene(
        "A delta robot picks and places",
        "Tubes of aluminium and carbon, twelve balls, 0.3 s for 305 mm. The plate is 0.38 mm off on"
        " the way and still shakes after the stop.",
        "delta",
    ),
    "3rrr": Scene(
        "A planar 3-RRR with thin distal links",
        "Blades of 2 mm: the published test bench of a robot with piezoelectric damping.",
        "3rrr",
    ),
    "ur5": Scene(
        "A UR5 whose upper arm and forearm bend",
        "The robot's own meshes, coloured by the stress of the beams inside them.",
        "ur5",
    ),
    "race_r2": Scene(
        "A spatial 3-RRS with soft links",
        "One body a link, bending in two planes, twisting and foreshortened.",
        "race_r2",
    ),
    "hexapod": Scene(
        "Mode shapes of a hexapod",
        "Six legs with motors locked: what resonates, and how it moves.",
        "hexapod",
        "modes",
    ),
    "spinning_beam": Scene(
        "A beam spun up",
        "Ten metres of it lag half a metre behind and stiffen as they turn; one body.",
        "spinning_beam",
    ),
}


def main(folder: str = "gallery") -> int:
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    for name, scene in SCENES.items():
        page = out / f"{name}.html"
        if scene.level == "modes":
            command(["modes", scene.model, "--count", "6", "--view", str(page)])
        else:
            pf.view(pf.solve(pf.load(scene.model), level=scene.level, samples=161), page)
    sizes = [(out / f"{name}.html").stat().st_size for name in SCENES]
    print(f"{len(sizes)} pages, {sum(sizes) / 1e6:.1f} MB, in {out}")
    assert max(sizes) < 3e6  # [bytes] each can be mailed
    return len(sizes)


if __name__ == "__main__":
    main(*sys.argv[1:2])
