"""Two small models written to a folder, and one call of the command line, for tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pytest

from pinflex.__main__ import main

# The moments are small for these lengths: no beam fits into them, hence `inertia: beam` below.
_LINK = """\
  <link name="{name}"><inertial><origin xyz="{half} 0 0"/><mass value="{mass}"/>
    <inertia ixx="1e-6" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial></link>
"""
_JOINT = """\
  <joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{x} 0 0"/><axis xyz="0 0 1"/>{more}</joint>
"""


def _link(name: str, length: float, mass: float) -> str:
    return _LINK.format(name=name, half=length / 2, mass=mass)


def _joint(name: str, kind: str, parent: str, child: str, x: float, more: str = "") -> str:
    return _JOINT.format(name=name, kind=kind, parent=parent, child=child, x=x, more=more)


# Ground pivots 0.30 m apart; crank 0.10 m, coupler 0.25 m, rocker 0.20 m: a Grashof crank rocker.
FOURBAR_URDF = (
    '<robot name="fourbar">\n  <link name="base"/>\n'
    + _link("crank", 0.10, 0.1)
    + _link("coupler", 0.25, 0.0675)
    + _link("rocker", 0.20, 0.1)
    + '  <link name="coupler_tip"/>\n  <link name="rocker_tip"/>\n'
    + _joint("motor", "continuous", "base", "crank", 0.0)
    + _joint("elbow", "continuous", "crank", "coupler", 0.10, '<dynamics damping="0.1"/>')
    + _joint("tip", "fixed", "coupler", "coupler_tip", 0.25)
    + _joint("pivot", "continuous", "base", "rocker", 0.30)
    + _joint("rocker_end", "fixed", "rocker", "rocker_tip", 0.20)
    + "</robot>\n"
)
FOURBAR_YAML = """\
urdf: fourbar.urdf
gravity: [0, -9.81, 0]
actuated: [motor]
loops:
  pin: {kind: planar, between: [coupler_tip, rocker_tip], axis: z}
home: {motor: 1.2, elbow: -0.9, pivot: 1.9}
platform: coupler_tip
flexible:
  coupler:
    material: {like: aluminium_7075, rho: 2700}
    section: {shape: rectangle, width: 0.02, thickness: 0.005}
    inertia: beam
motion: {kind: cycloid, joints: {motor: 0.5}, duration: 0.1}
solve: {level: coupled, samples: 41, dt: 2.5e-4}
use_urdf_dynamics: false
"""
ARM_URDF = (
    '<robot name="arm">\n  <link name="base"/>\n'
    + _link("upper", 0.5, 0.5)
    + '  <link name="hand"><inertial><mass value="0.5"/>'
    + '<inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>\n'
    + _joint("shoulder", "continuous", "base", "upper", 0.0)
    + _joint("wrist", "fixed", "upper", "hand", 0.5)
    + "</robot>\n"
)
ARM_YAML = """\
urdf: arm.urdf
gravity: [0, -9.81, 0]
platform: hand
flexible:
  upper:
    material: {like: steel, rho: urdf}
    section: {shape: rectangle, width: 0.03, thickness: 0.004}
    inertia: beam
motion: {kind: cycloid, joints: {shoulder: 1.0}, duration: 0.2}
solve: {level: coupled, samples: 41, dt: 2.5e-4}
"""


class Answer(NamedTuple):
    """What one call of the command line gave."""

    code: int
    out: str
    err: str


def write_model(
    folder: Path, name: str, changes: Sequence[tuple[str, str]] = (), where: str = "yaml"
) -> str:
    """Write "fourbar" or "arm", texts of the YAML (or URDF) replaced; returns the YAML's path."""
    texts = {
        "fourbar": {"urdf": FOURBAR_URDF, "yaml": FOURBAR_YAML},
        "arm": {"urdf": ARM_URDF, "yaml": ARM_YAML},
    }[name]
    for suffix, text in texts.items():
        for old, new in changes if suffix == where else ():
            assert old in text, old  # a change that changes nothing would test nothing
            text = text.replace(old, new)
        (folder / f"{name}.{suffix}").write_text(text)
    return str(folder / f"{name}.yaml")


def call(capsys: pytest.CaptureFixture[str], *arguments: object) -> Answer:
    """Run `pinflex ARGUMENTS` in this process."""
    capsys.readouterr()
    code = main([str(a) for a in arguments])
    said = capsys.readouterr()
    return Answer(code, said.out, said.err)
