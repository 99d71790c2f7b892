"""G: flexible arms whose root turns by -1.5 rad at constant speed and stops (Simo, Vu-Quoc).

The source has plots only. What is exact: while the root turns with omega, T + V - omega H about
its axis stays (Jacobi); once it rests, the energy does. The root's speed jumps at both ends of the
turn; the arm takes the jump as a blow that leaves the momenta of its other coordinates as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motions.motion import formula, hold
from pinflex.lab.record import Case, Check, Outcome, Picture, Series
from pinflex.lab.scene import PLANE_BEAM, Body, energy, momenta, scene
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.result import Result
from pinflex.solver.solve import solve_level

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
gravity: [0, 0, 0]
actuated: [arm_joint]
frames: [tip]
flexible:
  "{"arm, forearm" if arm.hinged else "arm"}":
    material: {{E: {arm.EA!r}, G: {arm.EA!r}, rho: 1}}
    section: {{shape: given, A: 1, Iy: {I!r}, Iz: {I!r}, J: {I!r}, ky: 1, kz: 1, my: {arm.rho_I!r},
      mz: {arm.rho_I!r}}}
    {PLANE_BEAM}
    segments: {segments}
"""
    return scene("arm", bodies, yaml)


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
        scale = float(resting[0])
        note = "a thousandth; the blows ring in every mode, those above 1/h are damped"
        checks = (
            Check(f"T + V - omega H in the turn, spread / {scale:.4g} J",
                  float(np.ptp(turning)) / scale, 0.0, 1e-3, False, note),
            Check(f"energy after it, spread / {scale:.4g} J", float(np.ptp(resting)) / scale, 0.0,
                  1e-3, False, note),
            Check("tip at the end, change when the step is halved / length",
                  float(np.linalg.norm(tip[-1] - coarse[-1])) / SPAN, 0.0, 1e-3, False, note),
        )  # fmt: skip
        lines = tuple(Series(f"tip, {c}", t, tip[:, k]) for k, c in enumerate("xy"))
        return Outcome(checks, Picture(f"G {arm.name}", "time [s]", "place [m]", lines))

    return outcome


CASES = tuple(
    Case(f"G {arm.name}", "Simo, Vu-Quoc 1986; laws of conservation", case(arm)) for arm in ARMS
)
