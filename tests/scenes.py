"""Small scenes for tests: a URDF from a few lines, and the YAML beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pinflex as pf

Vec = Sequence[float]


@dataclass(frozen=True)
class Body:
    """A URDF link and the joint that carries it; without mass it is a frame."""

    name: str
    parent: str
    joint: str = "fixed"
    xyz: Vec = (0.0, 0.0, 0.0)
    rpy: Vec = (0.0, 0.0, 0.0)
    axis: Vec = (0.0, 0.0, 1.0)
    mass: float = 0.0
    com: Vec = (0.0, 0.0, 0.0)
    inertia: Vec = (0.0, 0.0, 0.0)


def _text(values: Vec) -> str:
    return " ".join(f"{x:.17g}" for x in values)


def urdf(bodies: Sequence[Body]) -> str:
    """URDF on a link "base"; the joint of a body is called "NAME_joint"."""
    lines = ['<robot name="scene">', '<link name="base"/>']
    for b in bodies:
        lines.append(f'<link name="{b.name}">')
        if b.mass or any(b.inertia):
            x, y, z = b.inertia
            lines.append(
                f'<inertial><origin xyz="{_text(b.com)}"/><mass value="{b.mass!r}"/>'
                f'<inertia ixx="{x!r}" iyy="{y!r}" izz="{z!r}" ixy="0" ixz="0" iyz="0"/></inertial>'
            )
        lines.append(f'</link><joint name="{b.name}_joint" type="{b.joint}">')
        lines.append(f'<parent link="{b.parent}"/><child link="{b.name}"/>')
        lines.append(f'<origin xyz="{_text(b.xyz)}" rpy="{_text(b.rpy)}"/>')
        if b.joint != "fixed":
            lines.append(f'<axis xyz="{_text(b.axis)}"/>')
        if b.joint in ("revolute", "prismatic"):
            lines.append('<limit lower="-9" upper="9" effort="1e6" velocity="1e6"/>')
        lines.append("</joint>")
    return "\n".join([*lines, "</robot>"])


def load(
    folder: Path, bodies: Sequence[Body], yaml: str, overrides: Sequence[str] = ()
) -> pf.Mechanism:
    """Write scene.urdf and scene.yaml, and load them as a user would."""
    (folder / "scene.urdf").write_text(urdf(bodies))
    (folder / "scene.yaml").write_text("urdf: scene.urdf\n" + yaml)
    return pf.load(folder / "scene.yaml", overrides)
