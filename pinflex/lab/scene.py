"""Scenes from a few numbers: a URDF as text, the YAML beside it, and runs from any state."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pinflex.actuation.drive import MotorPath, motor_path
from pinflex.arrays import Array
from pinflex.description.motion import hold
from pinflex.integrators.equal_steps import integrate
from pinflex.integrators.run import Run
from pinflex.integrators.schemes import generalized_alpha
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.frames import Frame
from pinflex.mechanics.mechanism import Mechanism, load

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
    """Write NAME.urdf and NAME.yaml to a passing folder and load them as a user would.

    Args:
        name: Of the model.
        bodies: Links with their joints.
        yaml: The YAML without its key `urdf`.
    """
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / f"{name}.urdf").write_text(urdf(bodies), encoding="utf-8")
        path = Path(folder) / f"{name}.yaml"
        path.write_text(f"urdf: {name}.urdf\n{yaml}", encoding="utf-8")
        return load(path)


def release(
    mechanism: Mechanism,
    until: float,
    dt: float,
    *,
    v: Array | None = None,
    y: Array | None = None,
    rho_inf: float = 0.8,
    path: MotorPath | None = None,
    tolerance: float = 1e-7,
) -> Run:
    """Coupled run from a state; motors rest unless a path is given.

    Args:
        mechanism: Mechanism.
        until: End time in s. dt: Step in s (rounded to a whole number of steps).
        v: Start velocity (nv,), default rest. y: Start pose (nq,), default home, undeformed.
        rho_inf: Spectral radius of the integrator. path: Motor motion.
        tolerance: Newton's.
    Returns:
        Every step of the run.
    """
    system = mechanism.flexible
    t = np.linspace(0.0, until, round(until / dt) + 1)
    path = motor_path(mechanism, hold(duration=until), t) if path is None else path
    start = mechanism.undeformed() if y is None else y
    speed = np.zeros(system.nv) if v is None else v
    return integrate(
        mechanism, Equations(system), (start, speed), path, generalized_alpha(rho_inf),
        tolerance=tolerance,
    )  # fmt: skip


def energy(mechanism: Mechanism, run: Run, every: int = 1) -> Array:
    """Kinetic and potential energy of a run, J, shape (nt,).

    Args:
        mechanism: Mechanism.
        run: A run of it.
        every: Instants between two values.
    """
    dynamics = Equations(run.system)
    return np.asarray(np.sum(dynamics.energies(run.y[::every], run.v[::every], 0.0), axis=0))


def frame_positions(mechanism: Mechanism, run: Run, name: str, steps: Sequence[int]) -> Array:
    """World positions of a frame at some steps, m, shape (len(steps), 3).

    Args:
        mechanism: Mechanism.
        run: A run of it.
        name: Of the frame.
        steps: Numbers of the instants.
    """
    dynamics = Equations(run.system)
    here = run.system.expansion.frames[name]
    _, p = Frame(dynamics.model, here).pose(dynamics.joint_poses(run.y[list(steps)]))
    return p
