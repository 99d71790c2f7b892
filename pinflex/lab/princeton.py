"""The Princeton beam: a flat cantilever under a tip load at an angle to its principal planes.

Section and loads of Dowell and Traybar 1975 as in Bauchau et al. 2016; the references are a
shooting on the Cosserat rod with kGA = 5/6 GA (tests/verification/test_elastica.py makes them
again). Twist is the first angle of R = Rx(twist) Rz Ry, which is what published tables print: at
45 degrees the component of the rotation vector is 12 % smaller, the last angle of Rz Ry Rx 1 to
12 % larger.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from pinflex.arrays import Array
from pinflex.lab.elastica import cantilever, tip_pose
from pinflex.lab.extrapolation import by_count
from pinflex.lab.record import Case, Check, Outcome, Picture, Series

LENGTH, EA, EI, GJ = 0.508, 2.84191e6, (2.428734, 36.27936), 3.103338  # [m], [N], [N m^2]
GA = 5 / 6 * EA / (2 * (1 + 0.31))
# Load [N], its angle from the stiff plane [deg]: stiff, soft tip displacement [mm], twist [deg].
TIPS = {
    (4.448, 0): (5.3595, 0.0, 0.0),
    (4.448, 30): (4.7511, 39.9494, 0.3822),
    (4.448, 45): (3.9652, 56.0552, 0.4360),
    (4.448, 60): (2.8622, 68.1291, 0.3730),
    (4.448, 90): (0.0, 78.0819, 0.0),
    (8.896, 0): (10.7154, 0.0, 0.0),
    (8.896, 30): (10.1472, 79.4561, 1.5115),
    (8.896, 45): (8.8889, 109.0416, 1.6650),
    (8.896, 60): (6.6544, 129.9235, 1.3809),
    (8.896, 90): (0.0, 146.2600, 0.0),
    (13.345, 0): (16.0651, 0.0, 0.0),
    (13.345, 30): (16.7780, 117.9023, 3.3292),
    (13.345, 45): (15.3423, 156.5878, 3.4847),
    (13.345, 60): (11.7164, 181.9212, 2.7766),
    (13.345, 90): (0.0, 200.6929, 0.0),
}
COUNTS = (4, 6, 8)  # segments


def princeton() -> Outcome:
    """A flat beam under a tip load at an angle: bending in two planes twists it."""
    checks, stiff = [], {}
    names = ("stiff [mm]", "soft [mm]", "twist [deg]")
    for (load, angle), published in TIPS.items():
        best, exact = by_count(partial(tip, load, angle), COUNTS, 2), np.array(published)
        stiff[load, angle] = float(best[0])
        some = np.flatnonzero(exact)
        worst = int(some[np.argmax(np.abs(best[some] / exact[some] - 1))])
        checks.append(
            Check(f"{load:g} N, {angle} deg, worst is {names[worst]}", float(best[worst]),
                  float(exact[worst]), 5e-3,
                  note="extrapolated from 4, 6, 8 segments; the project's limit")
        )  # fmt: skip
        if len(some) == 1:
            checks.append(
                Check(f"{load:g} N, {angle} deg, out of its plane [mm, deg]",
                      float(np.max(np.abs(np.delete(best, some)))), 0.0, 1e-9, False, "symmetry")
            )  # fmt: skip
    angles = np.array(sorted({angle for _, angle in TIPS}), float)
    series = []
    for load in sorted({load for load, _ in TIPS}):
        ours = np.array([stiff[load, int(a)] for a in angles])
        theirs = np.array([TIPS[load, int(a)][0] for a in angles])
        series += [
            Series(f"pinflex, {load} N", angles, ours),
            Series(f"shooting, {load} N", angles, theirs, True),
        ]
    picture = Picture("D Princeton beam", "load angle [deg]", "stiff tip displacement [mm]",
                      tuple(series))  # fmt: skip
    return Outcome(tuple(checks), picture)


def tip(load: float, angle: float, segments: int) -> Array:
    """Stiff and soft tip displacement [mm], twist [deg]."""
    # Stiff direction is beam y (about z), soft is z (about y).
    turn = math.radians(angle)
    force = f"force: [0, {load * math.cos(turn)!r}, {load * math.sin(turn)!r}]"
    m = cantilever(segments, force, length=LENGTH, EI=EI, GJ=GJ, EA=EA, GA=GA, planar=False)
    R, p = tip_pose(m)
    p = 1e3 * p
    return np.array([p[1], p[2], math.degrees(math.atan2(-R[2, 1], R[1, 1]))])


CASES = (Case("D Princeton beam", "Dowell, Traybar 1975; Cosserat shooting", princeton),)
