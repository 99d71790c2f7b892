"""Robots that nobody prepared: one flexible link each, with the YAML of a newcomer.

    python tests/benchmarks/robots.py                 every URDF of example-robot-data
    python tests/benchmarks/robots.py ur5 panda --ked and how far the torques of a quick move differ

The link is the one with the longest clear span (joint to joint) whose inertia takes the beam: an
aluminium tube of a sixth of the span, with walls of 4 mm. `share` is that of its density which
the inertia has room for, `beam/link` that of the link's mass. `rigid` is the largest difference
between the rigid torques and Pinocchio's rnea of the URDF, at random states, of the largest
torque. `ked` is the same between the levels ked and rigid in a small quick move (every motor 0.1
rad or m in 0.5 s, from rest in equilibrium). Nothing is asserted here; three of these robots are
in tests/unit/mechanics/test_ride.py.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin

import pinflex as pf
from pinflex.mechanics.model.tree import Link

SMALLEST = 0.05  # m: shorter spans are not beams
STATES = 10


def main() -> None:
    from example_robot_data.robots_loader import ROBOTS

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("robots", nargs="*", default=sorted(ROBOTS))
    parser.add_argument("--ked", action="store_true", help="run a quick move at level ked too")
    asked = parser.parse_args()
    print(f"{'robot':26} {'link':26} {'span':>6} {'share':>6} {'beam/link':>9} {'rigid':>8}  ked")
    exact = []
    with tempfile.TemporaryDirectory() as folder:
        for name in asked.robots:
            try:
                robot = flexible_robot(name, Path(folder))
            except pf.PinflexError as error:
                print(f"{name:26} {str(error)[:100]}")
                continue
            if robot is None:
                print(f"{name:26} no link of {SMALLEST} m between two joints takes a beam")
                continue
            off = rigid_difference(robot)
            exact.append(off)
            (part,) = robot.parts.values()
            weight = next(link.inertia.mass for link in robot.links if link.name == part.link)
            ked = f"{100 * ked_difference(robot):.2f} %" if asked.ked else ""
            print(
                f"{name:26} {part.link:26} {part.length:6.3f} {part.share or 0:6.3f} "
                f"{part.mass / weight:9.3f} {off:8.1e}  {ked}", flush=True,
            )  # fmt: skip
    print(f"{len(exact)} robots, largest difference {max(exact, default=0):.1e}")


def flexible_robot(name: str, folder: Path) -> pf.Mechanism | None:
    """The robot with one flexible link, or None where no link takes a beam."""
    path = folder / f"{name}.yaml"
    plain = f"urdf: example-robot-data:{name}\nuse_urdf_dynamics: false\n"
    path.write_text(plain)
    for length, link in spans(pf.load(path).links):
        wall = min(4e-3, length / 24)
        path.write_text(
            f"{plain}flexible:\n  {link}:\n    material: aluminium\n"
            f"    section: {{shape: tube, diameter: {length / 6!r}, wall: {wall!r}}}\n"
        )
        try:
            return pf.load(path)
        except pf.DescriptionError as error:
            if "inertia" not in str(error) and "span" not in str(error):
                raise
    return None


def spans(links: tuple[Link, ...]) -> Iterator[tuple[float, str]]:
    """Lengths [m] and names of links that lead to one next joint, the longest first."""
    found = []
    for k, link in enumerate(links):
        ends = {
            tuple(np.round(below.placement.translation, 9))
            for below in links
            if below.parent == k and below.steps
        }
        lengths = [float(np.linalg.norm(end)) for end in ends]
        long = [length for length in lengths if length > 1e-9]
        if link.parent >= 0 and len(long) == 1 and long[0] > SMALLEST:
            found.append((long[0], link.name))
    yield from sorted(found, reverse=True)


def rigid_difference(robot: pf.Mechanism) -> float:
    """Of the largest torque, against the URDF read by Pinocchio alone."""
    model = pin.buildModelFromXML(robot.description.urdf_text)
    model.gravity.linear = np.array(robot.description.gravity)
    rng, data = np.random.default_rng(1), model.createData()
    q = [pin.integrate(model, pin.neutral(model), x)
         for x in rng.uniform(-1, 1, (STATES, model.nv))]  # fmt: skip
    v, a = rng.uniform(-2, 2, (2, STATES, model.nv))
    expected = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
    found = pf.inverse_dynamics(robot, np.array(q), v, a)
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def ked_difference(robot: pf.Mechanism) -> float:
    """Largest torque difference of a quick move, of the largest rigid torque."""
    names = robot.description.actuated
    move = pf.cycloid(joints=dict.fromkeys(names, 0.1), duration=0.5)
    runs = {
        level: pf.solve(robot, move, level=level, until=0.5, samples=201, **start)
        for level, start in (("rigid", {}), ("ked", {"start": "static"}))
    }
    off = np.abs(runs["ked"].torque - runs["rigid"].torque).max()
    return float(off / np.abs(runs["rigid"].torque).max())


if __name__ == "__main__":
    main()
