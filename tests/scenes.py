"""Small scenes for tests: a URDF from a few lines, and the YAML beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pinflex as pf
from pinflex.lab.scene import Body, urdf

__all__ = ["UNIT_BEAM", "Body", "load", "published"]

# Below "flexible:", a plane beam of L = rho A = E I = 1 from its joint to the frame `tip`.
UNIT_BEAM = """
  beam:
    material: {E: 1, nu: 0.3, rho: 1}
    section: {shape: given, A: 1, Iy: 1, Iz: 1, J: 1}
    end: tip
    bending_y: true
    bending_z: false
    torsion: false
    axial: false
"""


def published(name: str) -> str:
    """The variant of a shipped model that has what its source has."""
    return str(Path(__file__).parents[1] / "models" / name / "published.yaml")


def load(
    folder: Path,
    bodies: Sequence[Body],
    yaml: str,
    overrides: Sequence[str] = (),
    inertia: str = "beam",
) -> pf.Mechanism:
    """Write scene.urdf and scene.yaml, and load them as a user would.

    The references that scenes are held against (closed forms, published numbers) know nothing but
    the beam, so here the default is `inertia: beam`.
    """
    if "flexible:" in yaml:
        overrides = (f"flexible.*.inertia={inertia}", *overrides)
    (folder / "scene.urdf").write_text(urdf(bodies))
    (folder / "scene.yaml").write_text("urdf: scene.urdf\n" + yaml)
    return pf.load(folder / "scene.yaml", overrides)
