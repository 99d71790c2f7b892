"""A page to look at for each shipped model, and for a move, an orbit, a fit and one that computes.

Writes them to the folder given, or to ./gallery; `--pictures FOLDER` draws a small picture of each
(needs Chromium), as docs/assets/gallery has them.
"""

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pinflex as pf
from pinflex.__main__ import main as command


@dataclass(frozen=True)
class Scene:
    """A page of the gallery, of the shipped model of the same name.

    Attributes:
        title, text: What it shows.
        level: That it is solved at; `modes` for its mode shapes.
        made: Writes the page in place of a run of the shipped model.
        picture: Name of the picture of another page that stands for it.
    """

    title: str
    text: str
    level: str = "coupled"
    made: Callable[[Path], object] | None = None
    picture: str = ""


def fastest(page: Path) -> None:
    """The delta's move as short as limits of the plate's speed and jerk and of torques allow."""
    limits = {"speed": 1.906, "jerk": 4064, "torque": 18.98}  # those of the shipped quintic
    found = pf.fastest("delta", {"x": 0.305, "y": 0, "z": 0}, settle=50e-6, limits=limits)
    pf.view(pf.solve("delta", found.motion, level="coupled", until=0.45, samples=161), page)


def orbit(page: Path) -> None:
    """The planar 3-RRR with two pins of 5 mm in holes 50 um wider."""
    pins = [f"loops.pin_{k}.{key}" for k in (2, 3) for key in ("clearance=50 um", "pin=5 mm")]
    pf.view(pf.solve(pf.load("3rrr", pins), tol=1e-3, until=0.05, samples=401), page)


def fitted(page: Path) -> None:
    """The planar 3-RRR as shipped, and as four frequencies 7 % below its own tell."""
    shipped = pf.load("3rrr")
    measured = {"mode": [1, 2, 3, 4], "frequency": [96.1, 95.7, 96.4, 384.2]}  # [Hz]
    found = pf.fit(shipped, measured, ["flexible.distal_?.material.E"])
    runs = {
        "as shipped": pf.solve(shipped, level="coupled", samples=161),
        "as fitted": pf.solve(pf.load(found.description), level="coupled", samples=161),
    }
    pf.view(runs, page)


SCENES = {
    "delta_live": Scene(
        "Try it: a delta robot that answers",
        "Payload, speed, damping, walls of the rods: each move of a slider solves the flexible"
        " robot anew, in the page, offline.",
        made=lambda page: pf.live_page("delta", page),
        picture="delta",
    ),
    "delta": Scene(
        "A delta robot picks and places",
        "Tubes of aluminium and carbon, twelve balls, 0.3 s for 305 mm. The plate is 0.38 mm off on"
        " the way and still shakes after the stop.",
    ),
    "ur5": Scene(
        "A UR5 whose upper arm and forearm bend",
        "The robot's own meshes, coloured by the stress of the beams inside them.",
    ),
    "hexapod": Scene(
        "Mode shapes of a hexapod",
        "Six legs with motors locked: what resonates, and how it moves.",
        "modes",
    ),
    "3rrr": Scene(
        "A planar 3-RRR with thin distal links",
        "Blades of 2 mm: the published test bench of a robot with piezoelectric damping.",
    ),
    "3rrs": Scene(
        "A spatial 3-RRS that gives way",
        "Links of 1.5 mm steel under a platform that sinks and tilts: they buckle on the way.",
    ),
    "3tpt": Scene(
        "Three telescopic legs",
        "Rods that slide out of their tubes carry a hanging platform, and bend beyond the mouths.",
    ),
    "prprp": Scene(
        "A platform that slides through a sleeve",
        "A blade of 1.2 mm is the platform itself; a passive sleeve runs along it as it bends.",
    ),
    "cassie": Scene(
        "Cassie on a stand",
        "The leaf springs of both legs as elastic joints, loops and gears as its file has them.",
    ),
    "race_r1": Scene(
        "Race: a planar 3-RRR",
        "A fast move of three motors, then ringing without damping.",
    ),
    "race_r2": Scene(
        "Race: a spatial 3-RRS with soft links",
        "One body a link, bending in two planes, twisting and foreshortened.",
    ),
    "race_r3": Scene(
        "Race: a slider-crank at 150 rad/s",
        "Simeon's flexible rod, whose test set has the numbers.",
    ),
    "spinning_beam": Scene(
        "A beam spun up",
        "Ten metres of it lag half a metre behind and stiffen as they turn; one body.",
    ),
    "cantilever": Scene(
        "A strip of steel let go",
        "It starts straight, sags under its weight and rings: every number can be checked by hand.",
    ),
    "fastest": Scene(
        "The fastest move that does not shake",
        "The delta's way in 0.25 s where a quintic takes 0.3 s: the plate stays within 50 um.",
        made=fastest,
    ),
    "orbit": Scene(
        "Pins with clearance",
        "Two pins of the 3-RRR in holes 50 um wider: blows go through its links.",
        made=orbit,
    ),
    "fit": Scene(
        "A fit to measured frequencies",
        "A 3-RRR as shipped, and with the modulus that four frequencies 7 % below its own tell.",
        made=fitted,
    ),
}
SIZE = (480, 300)  # [px] of a small picture


def main(folder: str = "gallery") -> int:
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    for name, scene in SCENES.items():
        page = out / f"{name}.html"
        if scene.made:
            scene.made(page)
        elif scene.level == "modes":
            command(["modes", name, "--count", "6", "--view", str(page)])
        else:
            pf.view(pf.solve(pf.load(name), level=scene.level, samples=161), page)
    sizes = [(out / f"{name}.html").stat().st_size for name in SCENES]
    print(f"{len(sizes)} pages, {sum(sizes) / 1e6:.1f} MB, in {out}")
    assert max(sizes) < 3e6  # [bytes] each can be mailed
    return len(sizes)


def pictures(folder: str) -> None:
    """Draw the pages' robots, without what stands around them."""
    from PIL import Image

    from pinflex.viewer.export import pictures as capture

    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as made:
        for name, scene in SCENES.items():
            page = Path(made) / f"{name}.html"
            if scene.picture:
                continue
            if scene.made:
                scene.made(page)
                at = 0.03  # [s] of runs of 0.05 to 0.5 s
            else:
                run = pf.solve(pf.load(name), level="coupled", samples=161)
                pf.view(run, page)
                peak = max(run.links, key=lambda link: run.link(link).von_mises.max(), default=None)
                worst = run.link(peak).von_mises.max(axis=1).argmax() if peak else run.t.size // 2
                at = float(run.t[worst])
            shot = capture.picture(page, Path(made) / f"{name}.png", at)
            whole = Image.open(shot).convert("RGB")
            small = whole.resize((whole.width * SIZE[1] // whole.height, SIZE[1]))
            left = max(0, (small.width - SIZE[0]) // 2)
            small.crop((left, 0, left + SIZE[0], SIZE[1])).save(out / f"{name}.webp", quality=70)
            print(name, scene.title, (out / f"{name}.webp").stat().st_size)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--pictures"]:
        pictures(sys.argv[2])
    else:
        main(*sys.argv[1:2])
