"""Mechanisms with springs between bodies: Andrews' squeezer and the stiff flyball governor."""

from __future__ import annotations

import math

import numpy as np

from pinflex.advice.solve import solve
from pinflex.arrays import Array
from pinflex.description.motions.motion import hold
from pinflex.lab.scene import (
    PLANE_BEAM,
    SPACE_BEAM,
    Body,
    Case,
    Check,
    Outcome,
    Picture,
    Series,
    by_step,
    energy,
    momenta,
    off,
    released,
    scene,
)
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.result import Result
from pinflex.solver.solve import solve_level

PROJECT = 1e-6  # extrapolated from 40, 20 and 10 us

# A03 -------------------------------------------------------------------------------------------

# q at 0.03 s: PSIDE with tolerance 1e-14 (IVP test set); beta, Theta, gamma, Phi, delta, Omega,
# epsilon [rad], speeds [rad/s], and the closure forces at E by pairs [N].
SQUEEZER = {
    "beta": (15.81077119629904, 1139.920302151208),
    "theta": (-15.75637105984298, -1424.379294994111),
    "gamma": (0.04082224013073101, 11.03291221937134),
    "phi": (-0.5347301163226948, 19.29337464421385),
    "delta": (0.5244099658805304, 0.5735699284790808),
    "omega": (0.5347301163226948, -19.29337464421385),
    "epsilon": (1.048080741042263, 0.3231791658026955),
}
SQUEEZER_FORCES = (
    (199.1753333731910, -29.75531228015052),
    (23.06654119098399, 31.45271365475927),
    (22.64249232082739, 11.61740700019673),
)
BETA_AT_50MS = 33.825867767  # [rad]


def squeezer() -> Mechanism:
    """Seven bodies, three loops at one point; constants of the IVP test set."""
    xa, ya, xb, yb, xc, yc = -0.06934, -0.00227, -0.03635, 0.03273, 0.014, 0.072
    d, da, e, ea, rr, ra = 0.028, 0.0115, 0.02, 0.01421, 0.007, 0.00092
    ss, sa, sb, sc, sd, ta, tb = 0.035, 0.01874, 0.01043, 0.018, 0.02, 0.02308, 0.00916
    u, ua, ub, zf, zt, fa = 0.04, 0.01228, 0.00449, 0.02, 0.04, 0.01421
    masses = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)
    inertias = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
    places = (
        ("beta", "base", (0.0, 0.0), (ra, 0.0)),
        ("theta", "beta", (rr, 0.0), (-da, 0.0)),
        ("gamma", "base", (xb, yb), (sb, -sa)),
        ("phi", "delta", (zt, 0.0), (0.0, -(e - ea))),
        ("delta", "base", (xa, ya), (ta, tb)),
        ("omega", "epsilon", (0.0, -u), (zf - fa, 0.0)),
        ("epsilon", "base", (xa, ya), (-ub, -ua)),
    )
    bodies = [
        Body(name, parent, "revolute", xyz=(*at, 0), mass=mass, com=(*com, 0), inertia=(i, i, i))
        for (name, parent, at, com), mass, i in zip(places, masses, inertias, strict=True)
    ]
    for name, parent, at in (
        ("e2", "theta", (-d, 0.0)), ("e3", "gamma", (0.0, -ss)), ("e4", "phi", (0.0, -e)),
        ("e6", "omega", (zf, 0.0)), ("spring_end", "gamma", (sd, -sc)), ("c", "base", (xc, yc)),
    ):  # fmt: skip
        bodies.append(Body(name, parent, xyz=(*at, 0)))
    start = {
        "beta": -0.0617138900142764496, "theta": 0.0, "gamma": 0.455279819163070380,
        "phi": 0.222668390165885885, "delta": 0.487364979543842550,
        "omega": -0.222668390165885885, "epsilon": 1.23054744454982119,
    }  # fmt: skip
    home = ", ".join(f"{name}_joint: {value!r}" for name, value in start.items())
    yaml = f"""
home: {{{home}}}
loops:
  at_3: {{kind: planar, between: [e3, e2]}}
  at_4: {{kind: planar, between: [e4, e2]}}
  at_6: {{kind: planar, between: [e6, e2]}}
forces: {{motor: {{at: beta, moment: [0, 0, 0.033]}}}}
springs: {{spring: {{between: [spring_end, c], stiffness: 4530, length: 0.07785}}}}
"""
    return scene("squeezer", bodies, yaml)


def a03() -> Outcome:
    """Angles, speeds and closure forces at 0.03 s, the crank at 0.05 s, energy."""
    m = squeezer()
    names = [name.removesuffix("_joint") for name in m.coordinates]
    beta = names.index("beta")
    every = 1e-3

    def states(h: float) -> Array:
        """q, v, multipliers and energy less the motor's work, every ms."""
        r = released(m, 0.05, h, 51, tolerance=1e-10)
        q = r.array("joint/q")
        spent = energy(r) - 0.033 * q[:, beta]
        return np.column_stack([q, r.array("joint/v"), r.array("multiplier"), spent])

    fine, best = by_step(states, (4e-5, 2e-5, 1e-5))
    q, v, lam, spent = (best[:, at] for at in (slice(7), slice(7, 14), slice(14, 20), 20))
    k = round(0.03 / every)
    angles, speeds = (np.array([SQUEEZER[n][i] for n in names]) for i in (0, 1))
    # The two rows of a loop lie in the frame of its first body; the set counts forces from E.
    angle = dict(zip(names, q[k], strict=True))
    held = (angle["gamma"], angle["delta"] + angle["phi"], angle["epsilon"] + angle["omega"])
    turned = np.exp(1j * np.array(held))
    force = -(lam[k, 0::2] + 1j * lam[k, 1::2]) * turned
    exact = np.array([complex(*pair) for pair in SQUEEZER_FORCES])
    checks = [
        off("worst of the seven angles at 0.03 s, relative", np.abs(q[k] / angles - 1).max(),
            PROJECT, "the project's limit; beta turns 2.5 times"),
        off("worst of the seven speeds at 0.03 s, relative", np.abs(v[k] / speeds - 1).max(), 1e-5,
            "beta turns at 1140 rad/s: 1e-8 s off is 1e-5 of a speed that follows it"),
        Check("beta at 0.05 s [rad]", float(q[-1, beta]), BETA_AT_50MS, PROJECT),
        off("energy less the motor's work, drift [J]", np.ptp(spent), 1e-6, "of 1.44 J"),
        Check("the same, its value [J]", float(spent[-1]), 1.4378329575321, PROJECT),
    ]  # fmt: skip
    checks += [
        off(f"closure force {n} at 0.03 s, off by [N]", np.abs(f - g), 1e-4 * abs(g),
            "the project's limit: 1e-4 of it, both components")
        for n, f, g in zip(("E to K3", "E to K4", "E to K6"), force, exact, strict=True)
    ]  # fmt: skip
    picture = Picture(
        "A03 Andrews' squeezer", "time [s]", "gamma [rad]",
        (Series("pinflex", np.linspace(0.0, 0.05, len(fine)), fine[:, names.index("gamma")]),
         Series("PSIDE", np.array([0.03]), np.array([SQUEEZER["gamma"][0]]), True)),
    )  # fmt: skip
    return Outcome(checks, picture)


# A05 -------------------------------------------------------------------------------------------

# Slider height [m] over time [s]: symmetric three-freedom reduction, Radau 1e-12.
GOVERNOR = {0.1: 0.5238364756, 0.2: 0.5850798118, 0.5: 0.7432494248, 1.0: 0.5014209224,
            2.0: 0.5059092943}  # fmt: skip


def governor() -> Mechanism:
    """A shaft, two arms with balls, a slider, and two very stiff springs with dampers."""
    rho = 3000.0
    rod, box = rho * 1.0 * 0.01**2, rho * 0.1**3
    slim, thick = rod * (0.01**2 + 0.01**2) / 12, rod * (1.0 + 0.01**2) / 12
    cube = box * 0.1**2 / 6
    bodies = [
        Body("shaft", "base", "continuous", mass=rod, com=(0, 0, 0.5),
             inertia=(thick, thick, slim)),
        Body("slider", "shaft", "prismatic", xyz=(0, 0, 0.5), mass=box, inertia=(cube,) * 3),
    ]  # fmt: skip
    springs = []
    for side, turn in (("right", 0.0), ("left", math.pi)):
        x = 0.05 * math.cos(turn)
        # The arm's x axis points 30 degrees down, its joint turns about the arm's y.
        bodies += [
            Body(f"{side}_pin", "shaft", xyz=(x, 0, 1), rpy=(0, math.pi / 6, turn)),
            Body(f"{side}_arm", f"{side}_pin", "revolute", axis=(0, 1, 0), mass=rod,
                 com=(0.5, 0, 0), inertia=(slim, thick, thick)),
            Body(f"{side}_ball", f"{side}_arm", xyz=(1, 0, 0), mass=5.0, inertia=(1e-12,) * 3),
            Body(f"{side}_middle", f"{side}_arm", xyz=(0.5, 0, 0)),
            Body(f"{side}_hook", "slider", xyz=(x, 0, 0)),
        ]  # fmt: skip
        springs.append(
            f"  {side}: {{between: [{side}_hook, {side}_middle], stiffness: 8.0e5, "
            "damper: 4.0e4, length: 0.5}"
        )
    yaml = "springs:\n" + "\n".join(springs)
    return scene("governor", bodies, yaml, (0, 0, -9.81))


def a05() -> Outcome:
    """Slider height over two seconds: stiffness 5e3 1/s, steps of 1 ms."""
    m = governor()
    h = 1e-3
    r = solve_level(m, hold(duration=2.0), "coupled", dt=h, samples=2001,
                    start_speeds={"shaft_joint": 2 * math.pi})  # fmt: skip
    s = 0.5 + r.joint("slider_joint").position
    checks = [
        Check(f"slider height at {t:g} s [m]", float(s[round(t / h)]), exact, 1e-4,
              note="second order at 1 ms; explicit schemes need 0.6 ms to be stable")
        for t, exact in GOVERNOR.items()
    ]  # fmt: skip
    picture = Picture(
        "A05 flyball governor", "time [s]", "slider height [m]",
        (Series("pinflex", r.t[::5], s[::5]),
         Series("reduction", np.array(list(GOVERNOR)), np.array(list(GOVERNOR.values())), True)),
    )  # fmt: skip
    return Outcome(checks, picture)


CASES = (
    Case("A03 Andrews' squeezer", "IVP test set; PSIDE 1e-14", a03),
    Case("A05 flyball governor", "UDC library A05; Radau 1e-12", a05),
)


# G: a free beam in a plane, kicked by a force and a moment, then left alone (Simo and Vu-Quoc).
#
# The source has plots only. What is exact: its centre of mass moves as a point would, and after the
# kick energy, momentum and angular momentum stay.

KICK, FLIGHT = 2.5, 5.0  # [s]
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
    second = released(free, FLIGHT - KICK, h, 26, start=first, tolerance=1e-10)
    return np.vstack([invariants(kicked, first), invariants(free, second)])


def flying_beam() -> Outcome:
    """Centre of mass, and what is conserved."""
    coarse, fine = flight(8, 2.0 * STEP), flight(8, STEP)
    t = np.linspace(0.0, KICK, 26)
    exact = np.concatenate([3 + 0.4 * t**2, 5.5 + 2.0 * t])
    errors = [float(abs(run[25, 0] - 5.5)) for run in (coarse, fine)]
    free, note = fine[26:], "second order at 1.25 ms; the kick's end rings up to the axial modes"
    checks = [
        off("centre of mass off 3 + 0.4 t^2, then 5.5 + 2 (t - 2.5) [m]",
            np.abs(fine[:, 0] - exact).max(), 1e-4, note),
        off("centre of mass off y = 4 [m]", np.abs(fine[:, 1] - 4.0).max(), 1e-4, note),
        Check("order of its error in the step", float(np.log2(errors[0] / errors[1])), 2.0, 0.05),
        Check("momentum after the kick [kg m/s]", float(free[-1, 2]), 20.0, 1e-4, note=note),
    ]  # fmt: skip
    checks += [
        off(f"{name} after the kick, spread / {size:.4g}", np.ptp(free[:, k]) / size, 1e-4, note)
        for k, name, size in ((3, "momentum along y", 20.0),
                              (4, "angular momentum", float(abs(free[0, 4]))),
                              (5, "energy", float(free[0, 5])))
    ]  # fmt: skip
    at = np.concatenate([t, KICK + t])
    lines = (Series("pinflex", at, fine[:, 0]), Series("exact", at[::3], exact[::3], True))
    return Outcome(checks, Picture("G flying beam", "time [s]", "centre of mass, x [m]", lines))


FLYING = (Case("G flying beam", "Simo, Vu-Quoc 1986; laws of conservation", flying_beam),)


# G: a four-bar of flexible bars with one hinge 5 degrees off the normal (Bauchau; IFToMM).
#
# With rigid bars it cannot move at all; bent and twisted, it goes round through two change points
# (2.618 s and 7.854 s), where it leaves the parallelogram for the anti-parallelogram.
# Reference: geometrically exact beams, 12/24/12 elements, extrapolated from 8/16/8 (Exudyn).

OUT_OF_PLANE = 4.262e-3  # [m] largest of the hinge C; the project's limit is 1 %
UNTIL = 12.0  # [s] a turn at 0.6 rad/s and a little more


def four_bar(segments: int) -> Mechanism:
    """A(0, 0) B(0, .12) C(.24, .12) D(.24, 0) m; bars AB, BC 16 mm square, CD 8 mm, steel."""
    tilt = math.radians(5.0)
    bodies = (
        Body("ab", "base", "continuous"),
        Body("bc", "ab", "continuous", xyz=(0, 0.12, 0)),
        Body("cd", "bc", "continuous", xyz=(0.24, 0, 0), axis=(math.sin(tilt), 0, math.cos(tilt))),
        Body("d", "cd", xyz=(0, -0.12, 0)),
        Body("ground", "base", xyz=(0.24, 0, 0)),
    )
    bars = "".join(
        f"""
  {name}:
    material: {{E: 2.07e11, nu: 0.3, rho: 7800}}
    section: {{shape: rectangle, width: {side}, thickness: {side}}}
    up: [0, 0, 1]
    {SPACE_BEAM}
    segments: {segments}"""
        for name, side in (("ab", 0.016), ("bc", 0.016), ("cd", 0.008))
    )
    yaml = f"""
loops: {{d: {{kind: revolute, between: [ground, d], axis: z}}}}
frames: [cd]
flexible:{bars}
motion: {{kind: formula, joints: {{ab_joint: -0.6*t}}, duration: {UNTIL}}}
"""
    return scene("tilted_four_bar", bodies, yaml, motors="ab_joint")


def height(segments: int, h: float) -> tuple[Array, Array]:
    """Times [s] and z of C [m]."""
    r = solve(four_bar(segments), dt=h, until=UNTIL, samples=601, rho_inf=0.6)
    return r.t, r.frame("cd").position[:, 2]


def tilted_four_bar() -> Outcome:
    """Largest height of C with one and two bodies a bar, and with half the step."""
    t, one = height(1, 0.01)
    _, half = height(1, 0.005)
    _, two = height(2, 0.01)
    m = four_bar(1)
    largest = [float(np.abs(z).max()) for z in (one, two, half)]
    checks = (
        off("mobility with rigid bars", m.report.mobility, 0.0),
        Check("largest height of C, one body a bar [m]", largest[0], OUT_OF_PLANE, 1e-2,
              note="the project's limit"),
        Check("the same, two bodies a bar [m]", largest[1], OUT_OF_PLANE, 1e-2,
              note="the project's limit"),
        off("one body a bar, change when the step is halved [m]", abs(largest[2] - largest[0]),
            1e-3 * OUT_OF_PLANE, "a tenth of the limit"),
    )  # fmt: skip
    picture = Picture(
        "G four-bar with a tilted hinge", "time [s]", "height of C [m]",
        (Series("pinflex, one body a bar", t, one), Series("two bodies", t, two),
         Series("published peak", t[np.abs(one).argmax()][None], np.array([-OUT_OF_PLANE]), True)),
    )  # fmt: skip
    return Outcome(checks, picture)


TILTED = (
    Case("G tilted flexible four-bar", "Bauchau; geometrically exact beams (Exudyn)",
         tilted_four_bar),
)  # fmt: skip
