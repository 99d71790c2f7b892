"""A delta robot: what to change, its lightest tubes, and what a modal test says of the one built.

Writes sensitivities.png, search.png, fit.png, lighter.yaml and fitted.yaml to the current folder.
"""

import numpy as np

import pinflex as pf
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian

SENSORS = ("plate", "rod_1a", "rod_2a", "rod_3a")  # rods: at their upper ends
ARMS, RODS = "flexible.arm_?.material.E", "flexible.rod_??.material.E"


def main() -> float:
    robot = pf.load("delta")

    what = pf.sensitivities(
        robot, by=["flexible.*.section.*"], of=["frequency.1", "mass", "sag", "stiffness.x"]
    )
    print(what.text())
    what.plot("sensitivities.png")

    lighter = pf.design(
        robot, "mass",
        {"flexible.*.section.diameter": (0.010, 0.05), "flexible.*.section.wall": (6e-4, 4e-3)},
        keep=["frequency.1 > base", "sag < base"], starts=1,
    )  # fmt: skip
    print(lighter.text())
    lighter.plot("search.png")
    lighter.write("lighter.yaml")

    # The robot as built: its tubes are softer than the data sheet says. A modal test of six modes,
    # with 1 % of noise, of which the second was missed.
    softer = ["flexible.arm_?.material={like: aluminium_6061, E: 6.1e10}", f"{RODS}=9.3e10"]
    built = pf.load(robot.description, softer)
    found = pf.fit(robot, modal_test(built), [ARMS, RODS], shape_std=0.02)
    print(found.text())
    found.plot("fit.png")
    found.write("fitted.yaml")

    assert lighter.after["mass"] < lighter.before["mass"]
    for (low, high), true in zip(found.intervals, (6.1e10, 9.3e10), strict=True):
        assert low < true < high
    return found[ARMS]


def modal_test(robot: pf.Mechanism) -> dict[str, np.ndarray]:
    """Frequencies, their standard deviations, and shapes at the sensors."""
    modes = pf.modes(robot, count=7)
    system = Equations(robot.flexible)
    rows = np.concatenate(
        [frame_jacobian(system, modes.y, robot.frame(name))[:3] for name in SENSORS]
    )
    shapes = (rows @ modes.shapes) / np.linalg.norm(rows @ modes.shapes, axis=0)
    seen, rng = [0, 2, 3, 4, 5, 6], np.random.default_rng(7)
    f = modes.frequencies[seen]
    noisy = shapes[:, seen] + 0.02 * rng.standard_normal((len(rows), len(seen)))
    names = [f"{name}.{axis}" for name in SENSORS for axis in "xyz"]
    return {
        "frequency": f * (1 + 0.01 * rng.standard_normal(len(seen))), "std": 0.01 * f,
        **dict(zip(names, noisy, strict=True)),
    }  # fmt: skip


if __name__ == "__main__":
    main()
