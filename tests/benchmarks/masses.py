"""What models weigh, and should: `python -m tests.benchmarks.masses [COUNT]`.

COUNT (500) random links in 1 to 9 segments, with children and riders, half of them on borders of
segments and an ulp beside; every shipped model; every robot of example-robot-data with one
flexible link. Printed is the worst difference of mass, first moment or inertia about the origin, as
a share of the largest of them: of the model at home from Pinocchio's sum of the URDF and a uniform
rod (random links), and from what `load` holds it against.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

import pinflex as pf
from pinflex.arrays import Array
from pinflex.description.description import model_names
from pinflex.mechanics import systems
from pinflex.mechanics.evaluation.equations import Equations
from tests.scenes import Body, load

RHO, WIDTH, THICK = 2700.0, 0.02, 0.006


@dataclass(frozen=True)
class Rod:
    """A random link.

    Attributes:
        bodies: It and its children. yaml: Its keys. inertia: `urdf` or `beam`.
        length: Span [m]. root, tip: End masses, with equal moments [kg, kg m^2].
    """

    bodies: tuple[Body, ...]
    yaml: str
    inertia: str
    length: float
    root: tuple[float, float]
    tip: tuple[float, float]

    def build(self) -> pf.Mechanism:
        with tempfile.TemporaryDirectory() as folder:
            return load(Path(folder), self.bodies, self.yaml, inertia=self.inertia)

    def weight(self, m: pf.Mechanism) -> Array:
        """Spatial inertia (6, 6) at home about the origin, by Pinocchio and a uniform rod."""
        model = pin.buildModelFromXML(m.description.urdf_text)
        data = model.createData()
        pin.forwardKinematics(model, data, pin.neutral(model))
        rod = data.oMi[model.getJointId("rod_joint")]
        whole = sum(data.oMi[k].act(model.inertias[k]).matrix() for k in range(1, model.njoints))
        if self.inertia == "beam":  # in place of the URDF's
            mass = RHO * WIDTH * THICK * self.length
            polar, across = mass * (WIDTH**2 + THICK**2) / 12, mass * self.length**2 / 12
            middle = np.array([0.5 * self.length, 0.0, 0.0])
            beam = pin.Inertia(mass, middle, np.diag([polar, across, across]))
            body = self.bodies[0]
            own = pin.Inertia(body.mass, np.array(body.com), np.diag(body.inertia))
            whole = whole + rod.act(beam).matrix() - rod.act(own).matrix()
        for x, (mass, moment) in ((0.0, self.root), (self.length, self.tip)):
            end = pin.Inertia(mass, np.array([x, 0.0, 0.0]), moment * np.eye(3))
            whole = whole + rod.act(end).matrix()
        return np.asarray(whole)


def random_rod(seed: int) -> Rod:
    """A link drawn from one integer; the same seed gives the same one."""
    rng = np.random.default_rng(seed)
    segments, length = int(rng.integers(1, 10)), round(float(rng.uniform(0.3, 1.5)), 1)

    def place() -> float:
        if rng.random() < 0.5:
            return float(rng.uniform(0.0, length))
        border = length * int(rng.integers(0, segments + 1)) / segments
        return float(border + rng.integers(-1, 2) * np.spacing(border))

    def body(name: str, parent: str, joint: str, x: float) -> Body:
        axis = rng.normal(size=3)
        mass, size = float(rng.uniform(0.5, 3.0)), float(rng.uniform(0.02, 0.2))
        return Body(
            name, parent, joint, xyz=(x, *rng.uniform(-0.1, 0.1, 2)), rpy=rng.uniform(-2, 2, 3),
            axis=axis / np.linalg.norm(axis), mass=mass, com=rng.uniform(-0.1, 0.1, 3),
            inertia=tuple(mass * size**2 * rng.uniform(1.0, 1.9, 3)),
        )  # fmt: skip

    own = float(rng.uniform(1.0, 4.0))  # a uniform rod, or one with a lump: riders at places
    spread = own * length**2 * float(rng.uniform(0.09, 0.4))
    rod = Body("rod", "base", "continuous", xyz=rng.uniform(-1, 1, 3), rpy=rng.uniform(-2, 2, 3),
               axis=(0, 1, 0), mass=own, com=(place(), 0.0, 0.0),
               inertia=(5e-3 * own, spread, spread))  # fmt: skip
    kinds = ["continuous", "prismatic", "fixed"]
    children = [
        body(f"child_{k}", "rod", kinds[int(rng.integers(0, 3))], place())
        for k in range(int(rng.integers(1, 5)))
    ]
    ends = [(float(rng.uniform(0, 1)), float(rng.uniform(0, 1e-3))) for _ in range(2)]
    root, tip = (end if rng.random() < 0.5 else (0.0, 0.0) for end in ends)
    yaml = f"""
actuated: [rod_joint]
idle: free
flexible:
  rod:
    material: {{E: 7.0e10, nu: 0.3, rho: {RHO}}}
    section: {{shape: rectangle, width: {WIDTH}, thickness: {THICK}}}
    end: far
    segments: {segments}
    torsion: true
    root: {{mass: {root[0]!r}, inertia: [{root[1]!r}, {root[1]!r}, {root[1]!r}]}}
    tip: {{mass: {tip[0]!r}, inertia: [{tip[1]!r}, {tip[1]!r}, {tip[1]!r}]}}
"""
    inertia = "urdf" if rng.random() < 0.6 else "beam"
    far = Body("far", "rod", xyz=(length, 0, 0))
    return Rod((rod, *children, far), yaml, inertia, length, root, tip)


def modelled(m: pf.Mechanism) -> Array:
    """Spatial inertia (6, 6) of a flexible model at home about the origin."""
    return systems.mass_of_model(m.flexible, Equations(m.flexible).joint_poses(m.undeformed()))


def off_scene(m: pf.Mechanism) -> float:
    """How far a model is off what `load` holds it against."""
    poses = Equations(m.rigid).joint_poses(m.home)
    said = systems.of_scene(m.description, m.links, m.parts, m.own, m.rigid, m.flexible, poses)
    return share(modelled(m), said)


def share(found: Array, expected: Array) -> float:
    """Largest difference, as a share of the largest entry."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def main() -> None:
    from example_robot_data.robots_loader import ROBOTS

    from tests.benchmarks.robots import flexible_robot

    count = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    worst = (0.0, -1)
    for seed in range(count):
        rod = random_rod(seed)
        m = rod.build()
        worst = max(worst, (max(share(modelled(m), rod.weight(m)), off_scene(m)), seed))
    print(f"{count} random links: worst {worst[0]:.1e} (seed {worst[1]})")
    shipped = [(off_scene(pf.load(name)), name) for name in model_names()]
    print("{} shipped models: worst {:.1e} ({})".format(len(shipped), *max(shipped)))
    robots, without = [], 0
    with tempfile.TemporaryDirectory() as folder:
        for name in sorted(ROBOTS):
            try:
                robot = flexible_robot(name, Path(folder))
            except pf.PinflexError as error:
                print(f"{name}: {str(error)[:120]}")
                continue
            without += robot is None
            if robot is not None:
                robots.append((off_scene(robot), name))
    print(
        "{} robots, {} without a beam: worst {:.1e} ({})".format(len(robots), without, *max(robots))
    )


if __name__ == "__main__":
    main()
