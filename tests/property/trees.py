"""Random trees with random flexible links, from one integer each."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import pinflex as pf
from tests.scenes import Body, load

PLANES = ("bending_y", "bending_z", "torsion", "axial")
# Slips of units are told by sizes in m and kg, which numbers in other units do not have.
ANY_UNIT = "allow: [large, heavy, wide]\n"


@dataclass(frozen=True)
class Recipe:
    """Bodies and the YAML of their flexible links, with gravity apart."""

    bodies: tuple[Body, ...]
    links: str
    gravity: tuple[float, ...]
    home: str

    def build(self) -> pf.Mechanism:
        g = ", ".join(f"{x:.17g}" for x in self.gravity)
        yaml = f"gravity: [{g}]\nhome: {{{self.home}}}\n{ANY_UNIT}"
        if self.links:
            yaml += f"flexible:\n{self.links}"
        with tempfile.TemporaryDirectory() as folder:
            return load(Path(folder), self.bodies, yaml)


def tree(seed: int, *, planar: bool = False, scale: Sequence[float] = (1.0, 1.0, 1.0)) -> Recipe:
    """Two to four links of a tree, each flexible or not; the same seed gives the same robot.

    Args:
        seed: What to draw. planar: Every axis z, every point at z = 0, gravity along y.
        scale: Units of length, mass and time: the numbers describe the same robot in other units.
    """
    rng = np.random.default_rng(seed)
    meter, kilogram, second = scale
    pascal = kilogram / meter / second**2
    count = int(rng.integers(2, 5))
    bodies, blocks, home = [], [], []
    for k in range(count):
        parent = "base" if k == 0 else f"link_{int(rng.integers(0, k))}"
        length = float(rng.uniform(0.3, 1.0)) * meter
        place = np.zeros(3)
        if k:
            reach = next(b.xyz[0] for b in bodies if b.name == f"{parent}_tip")
            place[0] = reach
        axis = np.array([0.0, 0.0, 1.0]) if planar else rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        rpy = rng.uniform(-1, 1, 3)
        if planar:
            rpy[:2] = 0.0
        mass = float(rng.uniform(0.5, 2.0)) * kilogram
        inertia = tuple(float(x) for x in rng.uniform(0.02, 0.03, 3) * kilogram * meter**2)
        kind = "prismatic" if k == count - 1 and rng.uniform() < 0.2 and not planar else "revolute"
        com = (float(rng.uniform(0.2, 0.4)) * meter, 0.0, 0.0)
        body = Body(f"link_{k}", parent, kind, tuple(place), tuple(rpy), tuple(axis), mass, com,
                    inertia)  # fmt: skip
        tip = Body(f"link_{k}_tip", f"link_{k}", xyz=(length, 0, 0),
                   mass=float(rng.uniform(0.1, 0.5)) * kilogram,
                   inertia=tuple(float(x) for x in rng.uniform(0.01, 0.015, 3)
                                 * kilogram * meter**2))  # fmt: skip
        bodies += [body, tip]
        home.append(f"link_{k}_joint: {float(rng.uniform(-1, 1)) * _unit(kind, meter)!r}")
        chosen = rng.uniform(size=4) < (0.8, 0.6, 0.5, 0.3)
        if planar:
            chosen[1:3] = False
        basis = int(rng.integers(0, 3))
        segments = int(rng.integers(1, 3))
        stiff = float(10 ** rng.uniform(3, 6)) * pascal * meter**4  # E I
        if not chosen.any():
            continue
        kinds = (
            f"{{kind: craig_bampton, internal: {int(rng.integers(0, 3))}}}",
            "{kind: finite_element, elements: 2}",
            "{kind: assumed, boundary: clamped_free, modes: 2}",
        )
        # Assumed modes have no twist or stretch at the end of a segment to pass on faithfully.
        block = f"""
  link_{k}:
    material: {{E: {2.0e9 * pascal!r}, nu: 0.3, rho: {1.0e3 * kilogram / meter**3!r}}}
    section: {{shape: given, A: {1.0e-3 * meter**2!r}, Iy: {stiff / (2.0e9 * pascal)!r},
      Iz: {0.7 * stiff / (2.0e9 * pascal)!r}, J: {0.5 * stiff / (2.0e9 * pascal)!r}}}
    basis: {kinds[basis]}
    end: link_{k}_tip
    up: [0, 0, 1]
    segments: {segments}
"""
        block += "".join(
            f"    {p}: {str(bool(c)).lower()}\n" for p, c in zip(PLANES, chosen, strict=True)
        )
        blocks.append(block.lstrip("\n"))
    gravity = rng.normal(size=3) * 5.0 * meter / second**2
    if planar:
        gravity[[0, 2]] = 0.0
    return Recipe(tuple(bodies), "".join(blocks), tuple(gravity), ", ".join(home))


def _unit(kind: str, meter: float) -> float:
    return meter if kind == "prismatic" else 1.0


def moved(recipe: Recipe, rotation: np.ndarray, shift: np.ndarray) -> Recipe:  # type: ignore[type-arg]
    """The same robot, and its gravity, placed elsewhere in the world."""
    r = rotation
    rpy = (
        float(np.arctan2(r[2, 1], r[2, 2])),
        float(-np.arcsin(r[2, 0])),
        float(np.arctan2(r[1, 0], r[0, 0])),
    )
    stand = Body("stand", "base", xyz=tuple(shift), rpy=rpy)
    bodies = tuple(replace(b, parent="stand") if b.parent == "base" else b for b in recipe.bodies)
    gravity = tuple(float(x) for x in r @ np.array(recipe.gravity))
    return replace(recipe, bodies=(stand, *bodies), gravity=gravity)


def mirrored(recipe: Recipe) -> Recipe:
    """A planar recipe seen in the mirror y -> -y."""
    bodies = tuple(
        replace(b, xyz=(b.xyz[0], -b.xyz[1], 0.0), rpy=(0.0, 0.0, -b.rpy[2]),
                com=(b.com[0], -b.com[1], 0.0))
        for b in recipe.bodies
    )  # fmt: skip
    gravity = (recipe.gravity[0], -recipe.gravity[1], 0.0)
    home = ", ".join(
        f"{name}: {-float(value)!r}"
        for name, value in (item.split(": ") for item in recipe.home.split(", "))
    )
    return replace(recipe, bodies=bodies, gravity=gravity, home=home)


def renumbered(recipe: Recipe, seed: int) -> Recipe:
    """The same robot with its links written in another order."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(recipe.bodies))
    return replace(recipe, bodies=tuple(recipe.bodies[k] for k in order))
