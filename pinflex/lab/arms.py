"""G: flexible arms whose root turns by -1.5 rad at constant speed and stops (Simo, Vu-Quoc).

The source has plots only. What is exact: while the root turns with omega, T + V - omega H about
its axis stays (Jacobi); once it rests, the energy does. The root's speed jumps at both ends of the
turn; the arm takes the jump as a blow that leaves the momenta of its other coordinates as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinflex.actuation.drive import MotorPath
from pinflex.arrays import Array
from pinflex.integrators.run import Run
from pinflex.lab.record import Case, Check, Outcome, Picture, Series
from pinflex.lab.scene import PLANE_BEAM, Body, frame_positions, release, scene
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.mechanism import Mechanism

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
    """The mechanism of an arm: rho A = 1, G A = E A; a hinge cuts it in the middle.

    Args:
        arm: Its numbers.
        segments: Bodies of each beam.
    """
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


def struck(m: Mechanism, y: Array, v: Array, jump: float) -> Array:
    """v after the root's speed has jumped: other momenta stay, M_ff dv_f + M_fm jump = 0.

    Args:
        m: The arm.
        y: Coordinates, shape (nq,).
        v: Velocity before, shape (nv,).
        jump: Change of the root's speed [rad/s].
    """
    M, free, motors = Equations(m.flexible).mass(y), m.flexible.free, m.flexible.motors
    after = v.copy()
    after[motors] += jump
    after[free] -= np.linalg.solve(
        M[np.ix_(free, free)], M[np.ix_(free, motors)].sum(axis=1) * jump
    )
    return after


def conserved(m: Mechanism, run: Run, omega: float, every: int) -> Array:
    """T + V - omega H [J], shape (nt,).

    Args:
        m: The arm.
        run: A run of it.
        omega: Speed of its root [rad/s].
        every: Instants between two rows.
    """
    d, rows = Equations(run.system), []
    for y, v in zip(run.y[::every], run.v[::every], strict=True):
        energy = sum(d.energies(y, v, 0.0))
        here = d.at(y, v, np.zeros_like(v))
        h = pin.computeCentroidalMomentum(d.model, d.data, here.Q[0], here.V[0])
        about_axis = h.angular[2] + np.cross(d.data.com[0], h.linear)[2]
        rows.append(energy - omega * about_axis)
    return np.array(rows)


def swing(arm: Arm, h: float) -> tuple[Array, Array, Array, Array]:
    """Times, tip places, and what is conserved during and after the turn.

    Args:
        arm: Its numbers.
        h: Step [s].
    """
    m, omega = build(arm), TURN / arm.turn
    t = np.linspace(0.0, arm.turn, round(arm.turn / h) + 1)[:, None]
    path = MotorPath(t[:, 0], omega * t, omega + 0 * t, 0 * t)
    y = m.undeformed()
    v = struck(m, y, np.zeros(m.flexible.nv), omega)
    first = release(m, arm.turn, h, v=v, y=y, path=path, tolerance=1e-10)
    rest = arm.until - arm.turn
    t = np.linspace(0.0, rest, round(rest / h) + 1)[:, None]
    path = MotorPath(t[:, 0], TURN + 0 * t, 0 * t, 0 * t)
    v = struck(m, first.y[-1], first.v[-1], -omega)
    second = release(m, rest, h, v=v, y=first.y[-1], path=path, tolerance=1e-10)
    every = 20
    times = np.concatenate([first.t[::every], arm.turn + second.t[::every]])
    tips = [frame_positions(m, r, "tip", range(0, len(r.t), every)) for r in (first, second)]
    return (times, np.vstack(tips), conserved(m, first, omega, every),
            conserved(m, second, 0.0, every))  # fmt: skip


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
