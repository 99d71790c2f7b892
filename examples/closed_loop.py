"""A digital controller on a flexible 3-RRR: feed-forward and reference from two commands.

The platform moves 67 mm and 0.3 rad in 80 ms, with a first period of 57 ms. One PD controller, at
1 kHz with a delay of one sample, follows the rigid inverse kinematics with the rigid torques, then
the command found for the flexible mechanism with its torques.
"""

from pathlib import Path

import numpy as np

import pinflex as pf

BODY = (
    "material: {like: aluminium_7075, E: 7.1e10, nu: 0.33, rho: 2810}, "
    "basis: {kind: craig_bampton, internal: 1}, inertia: beam, axial: false"
)
CRANK = "{shape: rectangle, width: 0.025, thickness: 0.004}"
DISTAL = "{shape: rectangle, width: 0.025, thickness: 0.002}"
LINKS = (
    f"flexible={{'distal_?': {{{BODY}, section: {DISTAL}}}, "
    f"'crank_?': {{{BODY}, section: {CRANK}}}}}"
)
MODEL = Path(__file__).parents[1] / "models/3rrr/published.yaml"


def main() -> dict[str, float]:
    robot = pf.load(str(MODEL), [LINKS, "damping={rayleigh: [0, 1.0e-4]}", "motion=null"])
    motion = pf.nonic(platform={"x": 0.06, "y": 0.03, "rz": 0.3}, duration=0.08)
    off = {}
    for level in ("rigid", "exact"):
        found = pf.command(robot, motion, level, before=0.04, after=0.06)
        control = pf.track(robot, found, kp=50.0, kd=1.0, period=1e-3, delay=1e-3)
        run = pf.solve(
            robot, found.motion, "coupled", start="static", control=control,
            until=float(found.t[-1]), tol=1e-3,
        )  # fmt: skip
        path = found.reference[0, :2] + motion.evaluate(run.t - found.before)[0][:, :2]
        error = np.linalg.norm(run.frame("platform").position[:, :2] - path, axis=1)
        off[level] = float(error.max())
        peak = float(np.abs(run.torque).max())
        print(f"{level:>6} command: platform off by {1e3 * off[level]:.4f} mm, {peak:.2f} N m")
    assert off["rigid"] > 5e-3  # the motors are where they should be, the platform is not
    assert off["exact"] < 20e-6  # what sampling leaves
    return off


if __name__ == "__main__":
    main()
