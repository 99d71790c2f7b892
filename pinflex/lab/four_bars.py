"""IFToMM A02: N windows of rods that stretch flat, where N freedoms open at once, twice a swing.

By symmetry the cranks stay parallel: one equation, thdd = G/I sin th, is the exact solution.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motions.motion import hold
from pinflex.lab.extrapolation import by_step
from pinflex.lab.loops import ROD, G, reduced
from pinflex.lab.record import Case, Check, Outcome, Picture, Series
from pinflex.lab.scene import Body, scene
from pinflex.mechanics.mechanism import Mechanism
from pinflex.solver.solve import solve_level

# [m] second order at 1 ms, where the library's high precision is 1e-3; ours, extrapolated.
PLAIN, PROJECT = 1e-5, 1e-6
# [s] the step does not meet the flat poses (0.714 s, 0.722 s, ...) exactly; momentum carries the
# mechanism through. The error stays of second order, so that three steps can be extrapolated.
STEPS = (4e-3, 2e-3, 1e-3)
# Flat poses amplify what Newton leaves: with its default 1e-7 a run is 1e-7 m off after 20 s, which
# extrapolation would multiply.
TOLERANCE = 1e-10


SPEEDS = {"crank_0_joint": -1.0}  # [rad/s] the first tip moves with 1 m/s


def four_bars(windows: int, kind: str = "planar") -> Mechanism:
    """N windows, 2 N + 1 equal rods."""
    rod: dict[str, Any] = {"mass": 1.0, "com": (0.5, 0, 0), "inertia": (1e-4, ROD, ROD)}
    bodies: list[Body] = []
    loops: list[str] = []
    for k in range(windows + 1):
        up = (0, 0, np.pi / 2)
        bodies.append(Body(f"crank_{k}", "base", "continuous", xyz=(k, 0, 0), rpy=up, **rod))
        bodies.append(Body(f"tip_{k}", f"crank_{k}", xyz=(1, 0, 0)))
    for k in range(windows):
        turned = (0, 0, -np.pi / 2)
        bodies.append(
            Body(f"bar_{k}", f"crank_{k}", "continuous", xyz=(1, 0, 0), rpy=turned, **rod)
        )
        bodies.append(Body(f"end_{k}", f"bar_{k}", xyz=(1, 0, 0)))
        loops.append(f"  pin_{k}: {{kind: {kind}, between: [end_{k}, tip_{k + 1}]}}")
    yaml = f"gravity: [0, {-G}, 0]\nactuated: []\nframes: [tip_0]\nloops:\n" + "\n".join(loops)
    return scene("four_bars", bodies, yaml)


def four_bars_exact(windows: int, t: Array) -> Array:
    """B0 (x, y): all cranks stay parallel, thdd = G/I sin th, th from the vertical."""
    inertia = (windows + 1) / 3 + windows
    weight = ((windows + 1) / 2 + windows) * G
    th = reduced(lambda _, s: (s[1], weight / inertia * np.sin(s[0])), (0.0, 1.0), t)[:, 0]
    return np.column_stack([np.sin(th), np.cos(th)])


def b0(m: Mechanism, until: float, every: float, h: float) -> Array:
    """Places of the first tip in multiples of `every` s, m, shape (nt, 2)."""
    run = solve_level(
        m, hold(duration=until), "coupled", dt=h, samples=round(until / every) + 1,
        tolerance=TOLERANCE, start_speeds=SPEEDS,
    )  # fmt: skip
    return run.frame("tip_0").position[:, :2]


def a02() -> Outcome:
    """N = 2 (also with redundant hinges) and 40: B0 at 10 and 20 s."""
    checks, every, until = [], 0.04, 20.0
    at = np.arange(0.0, until + every / 2, every)
    drawn = []
    for windows in (2, 40):
        m = four_bars(windows)
        exact = four_bars_exact(windows, at)
        fine, best = by_step(partial(b0, m, until, every), STEPS)
        for found, label, limit in (
            (fine, "dt = 1 ms", PLAIN), (best, "extrapolated from 4, 2, 1 ms", PROJECT)
        ):  # fmt: skip
            off = np.linalg.norm(found - exact, axis=1)
            checks += [
                Check(f"N = {windows}, {label}: B0 off its place at {t:g} s [m]",
                      float(off[round(t / every)]), 0.0, limit, False,
                      "the project's limit" if limit == PROJECT else "the library asks for 1e-3")
                for t in (10.0, 20.0)
            ]  # fmt: skip
        if windows == 2:
            drawn = [Series("pinflex, N = 2", at, fine[:, 0]),
                     Series("exact", at[::5], exact[::5, 0], True)]  # fmt: skip
    m = four_bars(2, "revolute")
    ten = four_bars_exact(2, np.array([0.0, 10.0]))
    off = np.linalg.norm(b0(m, 10.0, 10.0, 1e-3) - ten, axis=1)[-1]
    checks += [
        Check("N = 2, hinges in 3-D, dt = 1 ms: B0 off its place at 10 s [m]", float(off), 0.0,
              PLAIN, False, "the library asks for 1e-3"),
        Check("N = 2, hinges in 3-D: redundant rows found", len(m.report.redundant), 6.0, 0.0),
    ]  # fmt: skip
    picture = Picture("A02 four-bars through change points", "time [s]", "x of B0 [m]",
                      tuple(drawn))  # fmt: skip
    return Outcome(tuple(checks), picture)


CASES = (Case("A02 N four-bars", "UDC library A02; exact symmetric reduction", a02),)
