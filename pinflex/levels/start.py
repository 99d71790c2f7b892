"""Consistent starts: poses on the closures, in equilibrium or straight, balanced forces."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinflex.actuation.drive import MotorPath
from pinflex.actuation.motors import motor_axes
from pinflex.actuation.nominal import Nominal, nominal
from pinflex.arrays import Array
from pinflex.description.motion import Motion
from pinflex.errors import AssemblyError, ConvergenceError
from pinflex.integrators.run import Run
from pinflex.levels.linearised import LinearPath
from pinflex.levels.quasistatic import balance, unstable_directions, unstable_text
from pinflex.linalg import negative_directions, saddle_matrix
from pinflex.mechanics.assembly import close_loops
from pinflex.mechanics.closure_motion import FrozenLinks
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.system import System

# Newton iterations that `auto` spends on a load put on in parts: an equilibrium that is near takes
# thirty, and without one nobody should wait.
_PATIENCE = 120

_STILL = 1e-9  # [m/s^2] of the heaviest coordinate: round-off of gravity across a plane is 1e-15


@dataclass(frozen=True)
class Start:
    """Where a run starts.

    Attributes:
        y, v: Shapes (nq,) and (nv,); of a linear run the deviations from the nominal motion.
        kind: static, straight, run or state.
        said: A sentence where it is not what one would expect, or "".
    """

    y: Array
    v: Array
    kind: str
    said: str = ""

    def told(self, run: Run) -> Run:
        """The run with this in its settings and warnings."""
        said = (self.said,) if self.said else ()
        settings = {**run.settings, "start": self.kind}
        return replace(run, settings=settings, warnings=(*run.warnings, *said))


def in_equilibrium(mechanism: Mechanism, start: str, y: Array | None = None) -> tuple[bool, str]:
    """Whether a run is to start in equilibrium, and why not where that would be expected.

    `auto` is static where something acts on what is free at rest, unless the motors leave freedoms
    that fall. The equations say what acts, so that there is no list of loads to keep.
    """
    if start != "auto":
        return start == "static", ""
    system = mechanism.flexible
    if not (system.n_eta or len(system.springs.v_at) or system.loads.springs):
        return False, ""
    if not acted_on(lasting(system), mechanism.undeformed() if y is None else y):
        return False, ""
    if mechanism.report.mobility > len(system.motors):
        return False, "the motors do not hold every freedom"
    return True, ""


def acted_on(system: System, y: Array) -> bool:
    """Whether anything pushes a free coordinate of the system at rest at y, at t = 0."""
    dynamics, still = Equations(system), np.zeros(system.nv)
    r, _ = dynamics.residual(y, still, still, np.zeros(system.closed.n), 0.0)
    free = system.free
    heaviest = float(np.max(np.diag(dynamics.mass(y))[free], initial=0.0))
    return float(np.max(np.abs(r[free]), initial=0.0)) > _STILL * heaviest


def start_of(
    mechanism: Mechanism, motion: Motion, path: MotorPath, dynamics: Equations, start: str
) -> Start:
    """Where a coupled run starts: straight, static or auto (see `in_equilibrium`).

    Static: elastic coordinates and free joints in balance with what acts at the first time. At
    rest that is gravity and the loads; a motion that is already moving adds the inertia forces of
    its nominal velocities and accelerations. `auto` leaves out loads that come and go: they are
    to shake the mechanism.

    Raises:
        ConvergenceError: `static` is asked for, and there is no equilibrium.
    """
    y, v = straight_start(mechanism, motion, path, dynamics)
    if dynamics.system is mechanism.rigid and start == "auto":
        return Start(y, v, "straight")
    static, why = in_equilibrium(mechanism, start, y)
    if static and start == "auto" and len(mechanism.idle.base):
        static, why = False, "the base is free"
    if not static:
        return Start(y, v, "straight", _shaken(why))
    return _static_start(mechanism, motion, path, dynamics, start, Start(y, v, "straight"))


def _static_start(
    mechanism: Mechanism,
    motion: Motion,
    path: MotorPath,
    dynamics: Equations,
    start: str,
    straight: Start,
) -> Start:
    """Equilibrium near the straight start; where `auto` finds none, that one, with the reason."""
    y, v = straight.y, straight.v
    system, auto = dynamics.system, start == "auto"
    free = mechanism.flexible.free if system is mechanism.loose else system.free
    at = _lasting(dynamics) if auto else dynamics
    a, t, links = np.zeros(system.nv), float(path.t[0]), None
    if np.any(v) and mechanism.report.mobility == len(system.motors):
        a[: dynamics.n_rigid] = nominal(mechanism, motion, path.t[:1]).a[0]
        links = FrozenLinks(at, mechanism.rigid.free, free)
    where = f"{mechanism.name}: start: {'auto' if auto else 'static'}"
    try:
        patience = _PATIENCE if auto else np.inf
        found = balance(at, y, v, a, free, t, None, where, patience, links)
    except ConvergenceError as error:
        if auto:
            return replace(straight, said=_shaken("there is no static equilibrium near it"))
        raise _no_equilibrium(str(error), error) from None
    if not unstable_directions(at, found.y, found.v, found.a, found.lam, t, free):
        return Start(found.y, found.v, "static")
    if auto:
        return replace(straight, said=_shaken("its static equilibrium is unstable"))
    return Start(found.y, found.v, "static", unstable_text("start: static equilibrium"))


def linear_start(
    mechanism: Mechanism, path: Nominal, structural: bool, start: str, dynamics: Equations
) -> Start:
    """The same for level ked: deviations d of the free coordinates from the nominal motion.

    Static is the linear balance K d - J' dlam = -r, J d = 0 of the first instant. The nonlinear
    one would leave J d of second order, which the march divides by h^2. `dynamics` is a workspace
    of the flexible mechanism.
    """
    n = len(mechanism.flexible.free)
    straight, static = Start(np.zeros(n), np.zeros(n), "straight"), "static"
    first = path.at(slice(0, 1))
    balanced, why = in_equilibrium(mechanism, start, mechanism.undeformed(first.q[0]))
    if not balanced:
        return replace(straight, said=_shaken(why))
    if not np.any(first.v):
        first = replace(first, a=np.zeros_like(first.a))
    if start == "auto":
        dynamics = _lasting(dynamics)
    now = LinearPath(mechanism, first, structural, dynamics).at(0).free
    rows = len(now.J)
    S = saddle_matrix(now.K, now.J)
    try:
        d = np.linalg.solve(S, np.concatenate([-now.r, np.zeros(rows)]))[:n]
    except np.linalg.LinAlgError:
        if start == "auto":
            return replace(straight, said=_shaken("the linear balance is singular"))
        where = f"{mechanism.name}: start: static: the linear balance is singular."
        raise _no_equilibrium(where) from None
    if not negative_directions(now.K, now.J):
        return Start(d, np.zeros(n), static)
    if start == "auto":
        return replace(straight, said=_shaken("its static equilibrium is unstable"))
    return Start(d, np.zeros(n), static, unstable_text("start: static equilibrium"))


def lasting(system: System) -> System:
    """The system without loads that come and go."""
    forces = tuple(pair for pair in system.loads.forces if not pair[0].timed)
    if len(forces) == len(system.loads.forces):
        return system
    return replace(system, loads=replace(system.loads, forces=forces))


def _lasting(dynamics: Equations) -> Equations:
    system = lasting(dynamics.system)
    return dynamics if system is dynamics.system else Equations(system)


def _shaken(why: str) -> str:
    if not why:
        return ""
    return (
        f"starts with undeformed links, on which the loads act at once, because {why}: it rings "
        "from t = 0. Write start: straight where this is meant."
    )


def _no_equilibrium(text: str, error: ConvergenceError | None = None) -> ConvergenceError:
    advice = "Or write start: straight, which starts with undeformed links."
    return ConvergenceError(f"{text} {advice}", **({} if error is None else error.data))


def straight_start(
    mechanism: Mechanism, motion: Motion, path: MotorPath, dynamics: Equations
) -> tuple[Array, Array]:
    """Undeformed pose and compatible velocities at the first time.

    Joints that neither motors nor loops determine start at home and at rest.
    """
    system = dynamics.system
    m = int(system.rigid.nv)
    v = np.zeros(system.nv)
    if mechanism.report.mobility == len(system.motors):
        first = nominal(mechanism, motion, path.t[:1])
        v[:m] = first.v[0]
        y = np.concatenate([first.q[0], np.zeros(system.n_eta)])
        return y, v
    y = mechanism.undeformed() if system.n_eta else mechanism.home.copy()
    motor_axes(mechanism).write(y, path.position[0])
    v[system.motors] = path.velocity[0]
    if dynamics.looped:
        passive = mechanism.rigid.free
        y, size = close_loops(dynamics, y, passive)
        if size > 1e-9:
            raise AssemblyError(
                f"{mechanism.name}: t = {path.t[0]:g} s: the loops do not close at the start of "
                f"the motion (open by {size:.2g}). Start the motion at home."
            )
        _, J = dynamics.close(y)
        v[passive] = -np.linalg.lstsq(J[:, passive], J @ v, rcond=1e-10)[0]
    return y, v
