"""Every shipped model, and a free robot with every joint there is, to check equations on."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pinflex as pf
from pinflex.arrays import Array
from pinflex.description.description import model_names
from pinflex.mechanics.model.system import System
from tests.scenes import Body, load

NAMES = model_names()
WHICH = ("rigid", "flexible")

# A tree on a free base with ball, universal, continuous and sliding joints and two bent links in
# two bases: every chart of the configuration manifold at once. Closed by two distances. One motor
# has an elastic gear, and two joints rub.
_BALL = {"mass": 0.3, "com": (0.1, 0.1, 0.05), "inertia": (0.01, 0.02, 0.025)}
_BODIES = (
    Body("body", "base", mass=3.0, com=(0.1, 0.0, 0.05), inertia=(0.1, 0.2, 0.15)),
    Body("boom", "body", "continuous", xyz=(0.3, 0.0, 0.1), axis=(0, 1, 0), mass=0.5),
    Body("hand", "boom", "fixed", xyz=(0.8, 0.0, 0.1), **_BALL),
    Body("grip", "hand", "prismatic", xyz=(0.1, 0, 0), axis=(0, 0.6, 0.8), **_BALL),
    Body("leg", "body", "continuous", xyz=(-0.3, 0.1, 0.0), axis=(0, 0, 1), mass=0.6),
    Body("foot", "leg", "fixed", xyz=(0.2, 0.5, 0.0), **_BALL),
    Body("eye", "grip", xyz=(0.0, 0.0, 0.1)),
)
_YAML = """
base: free_flyer
actuated: [boom_joint]
joints:
  hand_joint: {type: spherical}
  foot_joint: {type: universal, axes: [[1, 0, 0], [0, 0.6, 0.8]]}
  grip_joint: {spring: 30, rest: 0.05, damper: 2}
  leg_joint:
    {spring: 3, rest: 0.1, damper: 0.5, rotor_inertia: 0.02,
     friction: {coulomb: 0.4, breakaway: 0.7, stribeck: 0.5, speed: 0.2, viscous: 0.1}}
  boom_joint:
    drive: {gear: 40, motor_inertia: 1.0e-5, stiffness: 200, damping: 0.3,
            friction: {coulomb: 0.3, speed: 0.3}}
home: {foot_joint: [0.2, 0.3], hand_joint: [0.3, -0.2, 0.4]}
loops:
  rope: {kind: distance, between: [eye, foot]}
  bar: {kind: distance, between: [grip, leg]}
frames: [eye]
flexible:
  boom:
    material: {E: 2.0e9, nu: 0.3, rho: 800}
    section: {shape: rectangle, width: 0.03, thickness: 0.02}
    axial: true
    rotary_inertia: true
    shear: true
    segments: 2
    tip: {mass: 0.1, inertia: [1e-4, 2e-4, 3e-4]}
  leg:
    material: {E: 2.0e9, nu: 0.3, rho: urdf}
    section: {shape: tube, diameter: 0.03, wall: 0.002}
    basis: {kind: finite_element, elements: 2, order: quintic}
    axial: true
    damping: {modal: 0.02}
"""


@cache
def mechanism(name: str) -> pf.Mechanism:
    # 50 modes would prove nothing that 8 do not, at 20 times the cost.
    return pf.load(name, ["flexible.beam.basis.modes=8"] if name == "prprp" else [])


def manifold(folder: Path, more: str = "") -> pf.Mechanism:
    """The free robot, with more lines of YAML."""
    return load(folder, _BODIES, _YAML + more)


def at_home(m: pf.Mechanism, which: str) -> tuple[System, Array]:
    """The rigid or the flexible system and its undeformed home."""
    return (m.rigid, m.home) if which == "rigid" else (m.flexible, m.undeformed())
