"""Scenes from a few numbers: a URDF as text, the YAML beside it, and what is measured of runs."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description.motions.motion import hold
from pinflex.description.robots.tree_text import triple
from pinflex.integrators.problem import states_of
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.results.result import Result
from pinflex.solver.solve import solve_level

Vec = Sequence[float]

# Keys of a flexible link that has every strain of an exact beam in space, and in a plane.
SPACE_BEAM = "\n    ".join(
    f"{key}: true" for key in ("bending_y", "bending_z", "torsion", "axial", "shear")
)
PLANE_BEAM = """bending_y: true
    bending_z: false
    torsion: false
    axial: true
    shear: true
    rotary_inertia: true"""


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


def urdf(bodies: Sequence[Body]) -> str:
    """URDF on a link "base"; the joint of a body is called "NAME_joint"."""
    lines = ['<robot name="scene">', '<link name="base"/>']
    for b in bodies:
        lines.append(f'<link name="{b.name}">')
        if b.mass or any(b.inertia):
            x, y, z = (float(i) for i in b.inertia)
            lines.append(
                f'<inertial><origin xyz="{triple(b.com)}"/><mass value="{float(b.mass)!r}"/>'
                f'<inertia ixx="{x!r}" iyy="{y!r}" izz="{z!r}" ixy="0" ixz="0" iyz="0"/></inertial>'
            )
        lines.append(f'</link><joint name="{b.name}_joint" type="{b.joint}">')
        lines.append(f'<parent link="{b.parent}"/><child link="{b.name}"/>')
        lines.append(f'<origin xyz="{triple(b.xyz)}" rpy="{triple(b.rpy)}"/>')
        if b.joint != "fixed":
            lines.append(f'<axis xyz="{triple(b.axis)}"/>')
        if b.joint in ("revolute", "prismatic"):
            lines.append('<limit lower="-1e3" upper="1e3" effort="1e9" velocity="1e9"/>')
        lines.append("</joint>")
    return "\n".join([*lines, "</robot>"])


def scene(
    name: str, bodies: Sequence[Body], yaml: str, gravity: Vec = (0, 0, 0), motors: str = ""
) -> Mechanism:
    """Write NAME.urdf and NAME.yaml to a passing folder and load them as a user would."""
    head = f"urdf: {name}.urdf\ngravity: {[*gravity]}\nactuated: [{motors}]\n"
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / f"{name}.urdf").write_text(urdf(bodies), encoding="utf-8")
        path = Path(folder) / f"{name}.yaml"
        path.write_text(head + yaml, encoding="utf-8")
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
    y, v, _ = states_of(run)
    for here in (dynamics.at(*state, 0 * state[1]) for state in zip(y, v, strict=True)):
        h = pin.computeCentroidalMomentum(dynamics.model, data, here.Q[0], here.V[0])
        rows.append([data.com[0].copy(), h.linear, h.angular])
    return Momenta(*np.array(rows).transpose(1, 0, 2))


# What a benchmark gives: checked quantities, and a picture of measured against reference.


@dataclass(frozen=True)
class Check:
    """One quantity against its reference.

    Attributes:
        quantity: What it is, with its unit.
        measured: From pinflex.
        reference: Published, or from a closed form.
        tolerance: Largest error that passes.
        relative: The error is relative to the reference; else it is in the quantity's own unit.
        note: Why the tolerance is what it is, or why the reference cannot be reached.
        reported: It is known not to reach the tolerance, and the note says why: its error is shown,
            and it never counts as passed.
    """

    quantity: str
    measured: float
    reference: float
    tolerance: float
    relative: bool = True
    note: str = ""
    reported: bool = False

    @property
    def error(self) -> float:
        """Distance from the reference, as a fraction of it if `relative`."""
        distance = abs(self.measured - self.reference)
        return distance / abs(self.reference) if self.relative else distance

    @property
    def passed(self) -> bool:
        """Within tolerance; a number that is none never passes."""
        return bool(self.error <= self.tolerance) and not self.reported


def off(quantity: str, value: Any, tolerance: float, note: str = "") -> Check:
    """A distance, which should be zero."""
    return Check(quantity, float(value), 0.0, tolerance, False, note)


def worst(
    quantity: str, found: Array, exact: Any, tolerance: float, names: Any = None, note: str = ""
) -> Check:
    """That of several numbers that is farthest from its reference, as a fraction of it."""
    k = int(np.argmax(np.abs(found / exact - 1)))
    label = quantity if names is None else f"{quantity}{names[k]}"
    return Check(label, float(found[k]), float(exact[k]), tolerance, note=note)


@dataclass(frozen=True)
class Series:
    """One line of a picture; a reference is drawn as points."""

    label: str
    x: Array
    y: Array
    reference: bool = False


@dataclass(frozen=True)
class Picture:
    """Measured lines and reference points over one abscissa."""

    title: str
    x: str
    y: str
    series: tuple[Series, ...]


@dataclass(frozen=True)
class Outcome:
    """Checks of one case, and at most one picture."""

    checks: Sequence[Check]
    picture: Picture | None = None


@dataclass(frozen=True)
class Case:
    """A benchmark: its name, where its reference is from, and the function that runs it.

    Attributes:
        slow: It takes minutes, and runs when asked for.
    """

    name: str
    source: str
    run: Callable[[], Outcome]
    slow: bool = False


# Richardson's extrapolation: what runs of several fineness say about an infinitely fine one.


def extrapolated(sizes: Sequence[float], values: Sequence[Array], order: int) -> Array:
    """Value at size 0 of the polynomial x + a h^order + b h^(order + 1) + ... through all runs.

    Source: Richardson (1911); rows that use it say "extrapolated from" and the sizes.
    """
    h = np.asarray(sizes, float) / max(sizes)
    powers = np.append(0, order + np.arange(len(h) - 1))
    weights = np.linalg.inv(h[:, None] ** powers)[0]
    return np.asarray(np.tensordot(weights, np.array(values), 1))


def by_step(run: Callable[[float], Array], steps: Sequence[float]) -> tuple[Array, Array]:
    """What `run` gives with the finest of several steps, and extrapolated (order 2)."""
    values = [run(h) for h in steps]
    return values[int(np.argmin(steps))], extrapolated(steps, values, 2)


def by_count(run: Callable[[int], Array], counts: Sequence[int], order: int) -> Array:
    """What `run` gives with 1/count extrapolated to zero."""
    return extrapolated([1.0 / n for n in counts], [run(n) for n in counts], order)
