"""G: a free beam in a plane, kicked by a force and a moment, then left alone (Simo and Vu-Quoc).

The source has plots only. What is exact: its centre of mass moves as a point would, and after the
kick energy, momentum and angular momentum stay.
"""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.lab.record import Case, Check, Outcome, Picture, Series
from pinflex.lab.scene import PLANE_BEAM, Body, energy, momenta, released, scene
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.result import Result

KICK, UNTIL = 2.5, 5.0  # [s]
STEP = 1.25e-3  # [s]


def beam(segments: int, load: bool) -> Mechanism:
    """A beam of 10 m from (6, 0) to (0, 8); EA = GA = 1e4, EI = 100, rho A = 1, rho I = 10."""
    bodies = (
        Body("slide", "base", "prismatic", xyz=(6, 0, 0), axis=(1, 0, 0)),
        Body("lift", "slide", "prismatic", axis=(0, 1, 0)),
        Body("beam", "lift", "continuous", rpy=(0, 0, float(np.arctan2(8.0, -6.0)))),
        Body("tip", "beam", xyz=(10, 0, 0)),
    )
    kick = "forces: {kick: {at: beam, force: [8, 0, 0], moment: [0, 0, -80]}}" if load else ""
    yaml = f"""
gravity: [0, 0, 0]
actuated: []
{kick}
flexible:
  beam:
    material: {{E: 1.0e4, G: 1.0e4, rho: 1}}
    section: {{shape: given, A: 1, Iy: 0.01, Iz: 0.01, J: 0.02, ky: 1, kz: 1, my: 10, mz: 10}}
    end: tip
    {PLANE_BEAM}
    segments: {segments}
"""
    return scene("flying_beam", bodies, yaml)


def invariants(mechanism: Mechanism, run: Result) -> Array:
    """Centre of mass x, y, momentum p_x, p_y, angular momentum about it, energy; (nt, 6)."""
    found = momenta(mechanism, run)
    columns = found.centre[:, :2], found.linear[:, :2], found.angular[:, 2], energy(run)
    return np.column_stack(columns)


def flight(segments: int, h: float) -> Array:
    """Invariants every 0.1 s: 26 rows of the kick, 26 after it."""
    kicked, free = beam(segments, True), beam(segments, False)
    first = released(kicked, KICK, h, 26, tolerance=1e-10)
    # The load goes at once: a new start, so that the step does not smear it.
    second = released(free, UNTIL - KICK, h, 26, start=first, tolerance=1e-10)
    return np.vstack([invariants(kicked, first), invariants(free, second)])


def flying_beam() -> Outcome:
    """Centre of mass, and what is conserved."""
    coarse, fine = flight(8, 2.0 * STEP), flight(8, STEP)
    t = np.linspace(0.0, KICK, 26)
    exact = np.concatenate([3 + 0.4 * t**2, 5.5 + 2.0 * t])
    errors = [float(abs(run[25, 0] - 5.5)) for run in (coarse, fine)]
    free, note = fine[26:], "second order at 1.25 ms; the kick's end rings up to the axial modes"
    checks = [
        Check("centre of mass off 3 + 0.4 t^2, then 5.5 + 2 (t - 2.5) [m]",
              float(np.abs(fine[:, 0] - exact).max()), 0.0, 1e-4, False, note),
        Check("centre of mass off y = 4 [m]", float(np.abs(fine[:, 1] - 4.0).max()), 0.0, 1e-4,
              False, note),
        Check("order of its error in the step", float(np.log2(errors[0] / errors[1])), 2.0, 0.05),
        Check("momentum after the kick [kg m/s]", float(free[-1, 2]), 20.0, 1e-4, note=note),
    ]  # fmt: skip
    checks += [
        Check(f"{name} after the kick, spread / {size:.4g}", float(np.ptp(free[:, k])) / size,
              0.0, 1e-4, False, note)
        for k, name, size in ((3, "momentum along y", 20.0),
                              (4, "angular momentum", float(abs(free[0, 4]))),
                              (5, "energy", float(free[0, 5])))
    ]  # fmt: skip
    at = np.concatenate([t, KICK + t])
    lines = (Series("pinflex", at, fine[:, 0]), Series("exact", at[::3], exact[::3], True))
    return Outcome(
        tuple(checks),
        Picture("G flying beam", "time [s]", "centre of mass, x [m]", lines),
    )


CASES = (Case("G flying beam", "Simo, Vu-Quoc 1986; laws of conservation", flying_beam),)
