"""Beams with closed-form frequencies: cantilever, hub, tip mass, turning, and the spin-up.

All beams but the spin-up's have L = rho A = E I = 1, so that omega = b^2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinflex.advice.solve import solve
from pinflex.arrays import Array
from pinflex.description.motions.motion import formula, hold
from pinflex.lab.scene import (
    PLANE_BEAM,
    Body,
    Case,
    Check,
    Outcome,
    Picture,
    Series,
    energy,
    momenta,
    off,
    scene,
    worst,
)
from pinflex.levels.modes import modes
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.results.result import Result
from pinflex.solver.solve import solve_level

LIMIT = 1e-6  # a converged discretisation
# Wave numbers b: roots of the transcendental equations, to eight decimals.
WAVES = {
    "clamped_free": (1.87510407, 4.69409113, 7.85475744, 10.99554073),
    "clamped_clamped": (4.73004074, 7.85320462, 10.99560784, 14.13716549),
    "clamped_pinned": (3.92660231, 7.06858275, 10.21017612, 13.35176878),
    "pinned_pinned": (np.pi, 2 * np.pi, 3 * np.pi, 4 * np.pi),
}
HUBS = {
    0.1: (2.63892470, 4.79377085, 7.87565294, 11.00310416),
    1.0: (2.01000332, 4.70379426, 7.85682355, 10.99629338),
}
TIPS = {0.1: 1.72274152, 0.5: 1.41996443, 1.0: 1.24791741, 10.0: 0.73578192}
# eta = Omega sqrt(m L^4/EI): three flapping frequencies (Wright, Smith, Thresher, Wang 1982,
# recomputed with 14 Ritz terms).
FLAP = {
    2.0: (4.13731957, 22.6149220, 62.2731841),
    6.0: (7.36037302, 26.8090817, 66.6839144),
    12.0: (13.1701505, 37.6031123, 79.6144785),
}
LAG = -0.573779  # [m] largest tip lag of the geometrically exact spinning beam


def beam(
    head: str = "", extra: str = "", hub: Body | None = None, wall: bool = False, motor: str = ""
) -> Mechanism:
    """A unit beam along x in the plane of z, on the ground or on a hub."""
    bodies = [Body("beam", "hub" if hub else "base"), Body("tip", "beam", xyz=(1, 0, 0))]
    if hub is not None:
        bodies.insert(0, hub)
    if wall:
        bodies.append(Body("wall", "base", xyz=(1, 0, 0)))
    yaml = f"""
{head}
flexible:
  beam:
    material: {{E: 1, nu: 0.3, rho: 1}}
    section: {{shape: given, A: 1, Iy: 1, Iz: 1, J: 1}}
    basis: {{kind: craig_bampton, internal: 12}}
    end: tip
    torsion: false
    axial: false
    {extra}
"""
    return scene("beam", bodies, yaml, motors=motor)


IN_PLANE = "bending_y: true\n    bending_z: false"


def _omega(m: Mechanism) -> Array:
    return np.asarray(2 * np.pi * modes(m, preload="none").frequencies)


def standing() -> Outcome:
    """Frequencies of beams whose far end is free or held by a loop."""
    hinge = Body("hub", "base", "revolute", inertia=(1e-9,) * 3, mass=1e-9)
    checks = []
    for ends, kind, root in (
        ("clamped_free", "", None),
        ("clamped_pinned", "planar", None),
        ("clamped_clamped", "weld", None),
        ("pinned_pinned", "planar", hinge),
    ):
        loop = f"loops: {{end: {{kind: {kind}, between: [tip, wall]}}}}" if kind else ""
        found = _omega(beam(loop, IN_PLANE, root, bool(kind)))[:4]
        what = f"{ends.replace('_', '-')}, worst of 4 frequencies [rad/s]"
        checks.append(worst(what, found, np.square(WAVES[ends]), LIMIT))
    return Outcome(checks)


def carrying() -> Outcome:
    """A free hub takes part in the vibration; a tip mass slows it."""
    checks = []
    for inertia, waves in HUBS.items():
        hub = Body("hub", "base", "revolute", mass=1.0, inertia=(inertia,) * 3)
        found = _omega(beam("", IN_PLANE, hub))[1:5]
        what = f"free hub {inertia:g} m L^3, worst of 4 frequencies [rad/s]"
        checks.append(worst(what, found, np.square(waves), LIMIT))
    for mass, wave in TIPS.items():
        found = _omega(beam("", f"{IN_PLANE}\n    tip: {{mass: {mass}}}"))
        what = f"tip mass {mass:g} m L, first frequency [rad/s]"
        checks.append(Check(what, found[0], wave**2, LIMIT))
    return Outcome(checks)


def turning(eta: float, plane: str) -> Array:
    """Frequencies [rad/s] of the beam on a hub that turns with eta, about its steady state."""
    hub = Body("hub", "base", "continuous", mass=1.0, inertia=(1, 1, 1))
    chord = plane == "chord"
    extra = f"bending_y: {str(chord).lower()}\n    bending_z: {str(not chord).lower()}"
    m = beam("", extra, hub, motor="hub_joint")
    return 2 * np.pi * modes(m, at={"hub_joint": eta}).frequencies


def rotating() -> Outcome:
    """Flapping stiffens as published, lagging by eta^2 less."""
    checks = []
    for plane in ("flap", "chord"):
        for eta, flap in FLAP.items():
            exact = np.sqrt(np.square(flap) - (eta**2 if plane == "chord" else 0.0))
            what = f"eta = {eta:g}, {plane}, worst of 3 frequencies"
            checks.append(worst(what, turning(eta, plane)[:3], exact, 1e-5))
    at = np.linspace(0.0, 12.0, 13)
    lines = [Series(f"pinflex, {plane}", at, np.array([turning(e, plane)[0] for e in at]))
             for plane in ("flap", "chord")]  # fmt: skip
    speeds = np.array(list(FLAP))
    first = np.array([f[0] for f in FLAP.values()])
    lines += [Series("published, flap", speeds, first, True),
              Series("published, chord", speeds, np.sqrt(first**2 - speeds**2), True)]  # fmt: skip
    picture = Picture("B rotating cantilever", "speed of rotation, eta", "first frequency",
                      tuple(lines))  # fmt: skip
    return Outcome(checks, picture)


def spin_up() -> Outcome:
    """The manoeuvre that a linear flexible body fails, with one body and with three."""
    checks, lines = [], []
    for segments, limit in ((1, 5e-3), (3, 5e-4)):
        m = load("spinning_beam", [f"flexible.beam.segments={segments}"])
        r = solve(m, dt=1e-2, until=20.0, samples=1001)
        c, s = r.arrays["joint/q"].T
        x, y, _ = r.frame("tip").position.T
        lag = -s * x + c * y
        k = int(np.argmin(lag))
        a, b, low = np.polyfit(r.t[k - 1 : k + 2] - r.t[k], lag[k - 1 : k + 2], 2)
        checks.append(
            Check(f"largest tip lag, {segments} segment(s) [m]", float(low - b * b / (4 * a)), LAG,
                  limit, note="one second-order body: error of order (w/L)^2; segments: 1/n^2")
        )  # fmt: skip
        if segments == 3:
            late = float(np.abs(lag[r.t > 15.0]).max())
            checks.append(Check("largest lag after 15 s [m]", late, 3.65e-3, 0.1,
                                note="the Galerkin solution's residual; limit 4e-3"))  # fmt: skip
        lines.append(Series(f"pinflex, {segments} segment(s)", r.t, lag))
    checks.append(
        Check("steady stretch at 6 rad/s [m]", _steady_stretch(), 5.143175e-4, 1e-3,
              note="L (tan kL / kL - 1); the project's limit")
    )  # fmt: skip
    lines.append(Series("geometrically exact", np.array([6.76]), np.array([LAG]), True))
    picture = Picture("C spin-up to 6 rad/s", "time [s]", "tip lag [m]", tuple(lines))
    return Outcome(checks, picture)


def _steady_stretch() -> float:
    """Stretch [m] of the spinning beam at its final speed."""
    m = load("spinning_beam", ["flexible.beam.axial=true"])
    steady = formula(joints={"hub": "6*t"}, duration=0.1)
    tip = solve(m, steady, "quasistatic", samples=2).frame("tip").position[0]
    return float(np.linalg.norm(tip) - 10.0)


CASES = (
    Case("A beam frequencies", "transcendental equations", standing),
    Case("A hub and tip mass", "transcendental equations", carrying),
    Case("B rotating cantilever", "Wright, Smith, Thresher, Wang 1982; 14 Ritz terms", rotating),
    Case("C spin-up of a beam", "Kane, Ryan, Banerjee 1987; geometrically exact", spin_up),
)


# G: flexible arms whose root turns by -1.5 rad at constant speed and stops (Simo, Vu-Quoc).
#
# The source has plots only. What is exact: while the root turns with omega, T + V - omega H about
# its axis stays (Jacobi); once it rests, the energy does. The root's speed jumps at both ends of
# the turn; the arm takes the jump as a blow that leaves the momenta of its other coordinates as
# they are.

TURN, SPAN = -1.5, 10.0  # [rad], [m]


@dataclass(frozen=True)
class Arm:
    """One arm: E A [N], E I [N m^2], rho I [kg m], s of the turn, end [s], step [s], a hinge?"""

    name: str
    EA: float
    EI: float
    rho_I: float
    turn: float
    until: float
    h: float
    hinged: bool


ARMS = (
    Arm("turned arm", 1e4, 1e3, 10.0, 5.0, 10.0, 2.5e-3, False),
    Arm("hinged arm", 1e6, 1e5, 1.0, 0.5, 2.2, 2.5e-4, True),
)


def build(arm: Arm, segments: int = 4) -> Mechanism:
    """The mechanism of an arm: rho A = 1, G A = E A; a hinge cuts it in the middle."""
    half = SPAN / (1 + arm.hinged)
    bodies = [Body("arm", "base", "continuous")]
    if arm.hinged:
        bodies.append(Body("forearm", "arm", "continuous", xyz=(half, 0, 0)))
    bodies.append(Body("tip", bodies[-1].name, xyz=(half, 0, 0)))
    I = arm.EI / arm.EA  # noqa: E741
    yaml = f"""
frames: [tip]
flexible:
  "{"arm, forearm" if arm.hinged else "arm"}":
    material: {{E: {arm.EA!r}, G: {arm.EA!r}, rho: 1}}
    section: {{shape: given, A: 1, Iy: {I!r}, Iz: {I!r}, J: {I!r}, ky: 1, kz: 1, my: {arm.rho_I!r},
      mz: {arm.rho_I!r}}}
    {PLANE_BEAM}
    segments: {segments}
"""
    return scene("arm", bodies, yaml, motors="arm_joint")


def conserved(m: Mechanism, run: Result, omega: float) -> Array:
    """T + V - omega H [J], shape (nt,)."""
    found = momenta(m, run)
    about_axis = found.angular[:, 2] + np.cross(found.centre, found.linear)[:, 2]
    return np.asarray(energy(run) - omega * about_axis)


def swing(arm: Arm, h: float) -> tuple[Array, Array, Array, Array]:
    """Times, tip places, and what is conserved during and after the turn."""
    m, omega = build(arm), TURN / arm.turn

    def run(angle: str, span: float, start: Result) -> Result:
        """Both starts are blows: the root has another speed in the state that is gone on from."""
        motion = formula(joints={"arm_joint": angle}, duration=span)
        samples = round(span / (20 * h)) + 1
        return solve_level(
            m, motion, "coupled", dt=h, samples=samples, start=start, tolerance=1e-10
        )

    at_rest = solve_level(m, hold(duration=h), "coupled", dt=h, samples=2)
    first = run(f"{omega!r} * t", arm.turn, at_rest)
    second = run(f"{TURN!r}", arm.until - arm.turn, first)
    times = np.concatenate([first.t, arm.turn + second.t])
    tips = [r.frame("tip").position for r in (first, second)]
    return times, np.vstack(tips), conserved(m, first, omega), conserved(m, second, 0.0)


def case(arm: Arm) -> Callable[[], Outcome]:
    """The benchmark of an arm."""

    def outcome() -> Outcome:
        _, coarse, *_ = swing(arm, 2 * arm.h)
        t, tip, turning, resting = swing(arm, arm.h)
        scale, moved = resting[0], np.linalg.norm(tip[-1] - coarse[-1]) / SPAN
        parts = {
            f"T + V - omega H in the turn, spread / {scale:.4g} J": np.ptp(turning) / scale,
            f"energy after it, spread / {scale:.4g} J": np.ptp(resting) / scale,
            "tip at the end, change when the step is halved / length": moved,
        }
        note = "a thousandth; the blows ring in every mode, those above 1/h are damped"
        checks = [off(what, value, 1e-3, note) for what, value in parts.items()]
        lines = tuple(Series(f"tip, {c}", t, tip[:, k]) for k, c in enumerate("xy"))
        return Outcome(checks, Picture(f"G {arm.name}", "time [s]", "place [m]", lines))

    return outcome


ARM_CASES = tuple(
    Case(f"G {arm.name}", "Simo, Vu-Quoc 1986; laws of conservation", case(arm)) for arm in ARMS
)
