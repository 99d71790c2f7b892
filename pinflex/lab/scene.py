"""Scenes from a few numbers: a URDF as text, the YAML beside it, and what is measured of runs."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description.motions.motion import hold
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.results.result import Result
from pinflex.solver.solve import solve_level

Vec = Sequence[float]

# Keys of a flexible link that has every strain of an exact beam in a plane.
PLANE_BEAM = """bending_y: true
    bending_z: false
    torsion: false
    axial: true
    shear: true
    rotary_inertia: true"""


# Keys of one with those of a beam in space.
SPACE_BEAM = """bending_y: true
    bending_z: true
    torsion: true
    axial: true
    shear: true"""


@dataclass(frozen=True)
class Body:
    """A URDF link and the joint that carries it, NAME_joint; without mass it is a frame."""

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
    return " ".join(f"{float(x):.17g}" for x in values)


def urdf(bodies: Sequence[Body]) -> str:
    """URDF on a link "base"; the joint of a body is called "NAME_joint"."""
    lines = ['<robot name="scene">', '<link name="base"/>']
    for b in bodies:
        lines.append(f'<link name="{b.name}">')
        if b.mass or any(b.inertia):
            x, y, z = (float(i) for i in b.inertia)
            lines.append(
                f'<inertial><origin xyz="{_text(b.com)}"/><mass value="{float(b.mass)!r}"/>'
                f'<inertia ixx="{x!r}" iyy="{y!r}" izz="{z!r}" ixy="0" ixz="0" iyz="0"/></inertial>'
            )
        lines.append(f'</link><joint name="{b.name}_joint" type="{b.joint}">')
        lines.append(f'<parent link="{b.parent}"/><child link="{b.name}"/>')
        lines.append(f'<origin xyz="{_text(b.xyz)}" rpy="{_text(b.rpy)}"/>')
        if b.joint != "fixed":
            lines.append(f'<axis xyz="{_text(b.axis)}"/>')
        if b.joint in ("revolute", "prismatic"):
            lines.append('<limit lower="-1e3" upper="1e3" effort="1e9" velocity="1e9"/>')
        lines.append("</joint>")
    return "\n".join([*lines, "</robot>"])


def scene(name: str, bodies: Sequence[Body], yaml: str) -> Mechanism:
    """Write NAME.urdf and NAME.yaml to a passing folder and load them as a user would."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / f"{name}.urdf").write_text(urdf(bodies), encoding="utf-8")
        path = Path(folder) / f"{name}.yaml"
        path.write_text(f"urdf: {name}.urdf\n{yaml}", encoding="utf-8")
        return load(path)


def released(mechanism: Mechanism, until: float, dt: float, samples: int, **options: Any) -> Result:
    """Coupled run in equal steps, from rest at home unless a start is given, motors held."""
    return solve_level(
        mechanism, hold(duration=until), "coupled", dt=dt, samples=samples,
        **({"start": "straight"} | options),
    )  # fmt: skip


def energy(run: Result) -> Array:
    """Kinetic and potential energy of a run [J], shape (nt,)."""
    parts = ("kinetic", "gravity", "elastic", "spring")
    return np.asarray(sum(run.array(f"energy/{part}") for part in parts))


@dataclass(frozen=True)
class Momenta:
    """Centre of mass [m], momentum [kg m/s], angular momentum about it [kg m^2/s]; (nt, 3)."""

    centre: Array
    linear: Array
    angular: Array


def momenta(mechanism: Mechanism, run: Result) -> Momenta:
    """Momenta of a whole mechanism, which no output of a run tells."""
    dynamics, rows = Equations(mechanism.flexible), []
    data = dynamics.data
    y = np.hstack([run.array("joint/q"), run.array("eta")])
    v = np.hstack([run.array("joint/v"), run.array("eta_v")])
    for here in (dynamics.at(*state, 0 * state[1]) for state in zip(y, v, strict=True)):
        h = pin.computeCentroidalMomentum(dynamics.model, data, here.Q[0], here.V[0])
        rows.append([data.com[0].copy(), h.linear, h.angular])
    return Momenta(*np.array(rows).transpose(1, 0, 2))
