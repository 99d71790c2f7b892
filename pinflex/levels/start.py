"""Consistent starts: poses on the closures, in equilibrium or straight, balanced forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from pinflex.actuation.drive import Nominal, nominal
from pinflex.actuation.path import MotorPath, motor_axes
from pinflex.arrays import Array, IntArray, distinct, others
from pinflex.boundary import public
from pinflex.description.motions.motion import Motion
from pinflex.description.reading.schema import shown
from pinflex.description.solve import Speeds
from pinflex.errors import AssemblyError, ConvergenceError, DescriptionError, Ending, nearest
from pinflex.integrators.problem import Run, Settings, states_of
from pinflex.levels.linearised import LinearPath
from pinflex.levels.quasistatic import Equilibrium, balance, unstable_directions, unstable_text
from pinflex.linalg import negative_directions, null_space, saddle_matrix
from pinflex.mechanics.assembly import close_loops
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import FrozenLinks, frame_jacobian
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.mechanics.model.system import System
from pinflex.mechanics.model.tree import joint_rows
from pinflex.results.result import Result
from pinflex.text import frozen

# Newton iterations that `auto` spends on a load put on in parts: an equilibrium that is near takes
# thirty, and without one nobody should wait.
_PATIENCE = 120

_CENTRED = (
    "starts with undeformed links and every pin that has clearance in the middle of its hole: no "
    "equilibrium is sought, and the first blows are those of that start. Write start: static, or "
    "start: straight where this is meant."
)
_SWINGS = "the motors do not hold every freedom, and home is not where the rest hangs still"
_AT_REST = 1e-3  # [rad | m] of loose joints from where they hang: as a home is written
_NO_STIFFNESS = 1e-9  # of the stiffest direction: round-off of one that nothing holds
_STILL = 1e-9  # [m/s^2] of the heaviest coordinate: round-off of gravity across a plane is 1e-15


@frozen
class Moving:
    """A state to linearise about: y, v, a, multipliers lam, time t [s], and its name in words."""

    y: Array
    v: Array
    a: Array
    lam: Array
    t: float
    about: str


def state_of_run(mechanism: Mechanism, result: Result, time: float) -> Moving:
    """The sample of a run of this mechanism that is nearest to a time [s]."""
    k = int(np.argmin(np.abs(result.t - time)))
    system, arrays = mechanism.flexible, result.arrays
    if "eta" not in arrays and system.n_eta:
        raise DescriptionError(
            f"{mechanism.name}: a run of level {result.level}, in which no link "
            "deforms. Give one of level quasistatic, ked or coupled, or a time of the motion."
        )
    y, v, a = (x[k] for x in states_of(result))
    lam = arrays["multiplier"][k]
    if (len(y), len(v), len(lam)) != (system.nq, system.nv, system.closed.n):
        raise DescriptionError(
            f"{mechanism.name}: the run has {len(v)} coordinates and {len(lam)} closure "
            f"rows, the mechanism {system.nv} and {system.closed.n}. Give the one that was solved."
        )
    about = f"the run at t = {result.t[k]:g} s"
    return Moving(y, v, a, lam, float(result.t[k]), about)


@frozen
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
        settings: Settings = {**run.settings, "start": self.kind}
        return replace(run, settings=settings, warnings=(*run.warnings, *said))


def in_equilibrium(mechanism: Mechanism, start: str, y: Array | None = None) -> tuple[bool, str]:
    """Whether a run is to start in equilibrium, and why not where that would be expected.

    `auto` is static where something acts on what is free at rest, unless the motors leave freedoms
    that do not hang at rest. The equations say what acts, so there is no list of loads to keep.
    """
    if start != "auto":
        return start == "static", ""
    system = mechanism.flexible
    if not (system.n_eta or len(system.springs.v_at) or system.loads.springs):
        return False, ""
    if not acted_on(lasting(system), mechanism.undeformed() if y is None else y):
        return False, ""
    if mechanism.report.mobility > len(system.motors) and not hangs(mechanism):
        return False, _SWINGS
    return True, ""


def acted_on(system: System, y: Array) -> bool:
    """Whether anything pushes a free coordinate of the system at rest at y, at t = 0."""
    dynamics, still = Equations(system), np.zeros(system.nv)
    r, _ = dynamics.residual(y, still, still, np.zeros(system.closed.n), 0.0)
    free = system.free
    heaviest = float(np.max(np.diag(dynamics.mass(y))[free], initial=0.0))
    return float(np.max(np.abs(r[free]), initial=0.0)) > _STILL * heaviest


def hangs(mechanism: Mechanism) -> bool:
    """Whether what the motors leave loose hangs at rest at home, as a payload does on its rope."""
    system, y = lasting(mechanism.rigid), mechanism.home
    dynamics, still, free = Equations(system), np.zeros(system.nv), system.free
    J = dynamics.close(y).J
    r = dynamics.residual(y, still, still, np.zeros(len(J)), 0.0).r
    K = dynamics.tangent(y, still, still, np.linalg.pinv(J[:, free].T) @ r[free], 0.0).K
    Z = null_space(J[:, free])
    K, r = Z.T @ K[np.ix_(free, free)] @ Z, Z.T @ r[free]
    stiff = np.linalg.eigvalsh(0.5 * (K + K.T))
    if stiff[0] <= _NO_STIFFNESS * stiff[-1]:
        return False
    return float(np.max(np.abs(Z @ np.linalg.solve(K, r)))) < _AT_REST


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
    if not static and start != "straight" and mechanism.standing is not mechanism.flexible:
        return Start(y, v, "straight", _CENTRED)
    if static and start == "auto" and len(mechanism.idle.base):
        static, why = False, "the base is free"
    swings = mechanism.report.mobility > len(mechanism.motors)
    if static and start == "auto" and swings and np.any(v):
        static, why = False, _SWINGS
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
        links = FrozenLinks(at, mechanism, free)
    where = f"{mechanism.name}: start: {'auto' if auto else 'static'}"
    try:
        patience = _PATIENCE if auto else np.inf
        found = balance(at, y, v, a, free, t, None, where, patience, links)
    except ConvergenceError as error:
        if auto:
            return replace(straight, said=_shaken("there is no static equilibrium near it"))
        raise _no_equilibrium(str(error), error) from None
    if system.kinks.rigid:
        from pinflex.levels.settled import beyond

        if passed := beyond(at, found.y):
            why = f"{', '.join(passed)} gives speeds back and bears no force"
            if auto:
                return replace(straight, said=_shaken(why))
            raise _no_equilibrium(f"{where}: {why}: give it `stiffness`.")
    if not unstable_directions(at, found.y, found.v, found.a, found.lam, t, free):
        return Start(found.y, found.v, "static")
    if auto:
        return replace(straight, said=_shaken("its static equilibrium is unstable"))
    return Start(found.y, found.v, "static", unstable_text("start: static equilibrium"))


@public
@takes_model
def linear_statics(
    mechanism: Mechanism, q: Array | None = None, loaded: bool = False
) -> Equilibrium:
    """One linear step about the undeformed pose: K d = -r0 with J d = 0.

    Args:
        mechanism: Mechanism with its home pose.
        q: Rigid pose, shape (nq,), default home.
        loaded: With the stiffness that weight and loads bring there, as level ked has it.
    """
    system, y = mechanism.flexible, mechanism.undeformed(q)
    nq, nv = int(system.rigid.nq), int(system.rigid.nv)
    here = Nominal(np.zeros(1), y[None, :nq], *np.zeros((2, 1, nv)))
    at = LinearPath(mechanism, here, structural=not loaded).at(0)
    now, n, rows = at.free, len(system.free), len(at.base)
    x = np.linalg.solve(saddle_matrix(now.K, now.J), np.concatenate([-now.r, np.zeros(rows)]))
    still, dy, r = np.zeros((3, system.nv))
    dy[system.free], none = x[:n], np.zeros(n)
    r[system.motors] = at.motor_forces(x[:n], none, none, x[n:])
    return Equilibrium(system.integrate(y, dy), still, still, at.base + x[n:], r, 1)


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
    """The system without loads that come and go; what it carries at first has its weight."""
    carried = system.added.clocks.values()
    forces = tuple(x for x in system.loads.forces if not x[0].timed or x[0] in carried)
    if len(forces) == len(system.loads.forces):
        return system
    return replace(system, loads=replace(system.loads, forces=forces))


def _lasting(dynamics: Equations) -> Equations:
    system = lasting(dynamics.system)
    return dynamics if system is dynamics.system else Equations(system)


def _shaken(why: str) -> str:
    if not why:
        return ""
    static = "start: static to begin in the equilibrium near it, or " if why == _SWINGS else ""
    return (
        f"starts with undeformed links, on which the loads act at once, because {why}: it rings "
        f"from t = 0. Write {static}start: straight where this is meant."
    )


def _no_equilibrium(text: str, error: ConvergenceError | None = None) -> ConvergenceError:
    advice = "Or write start: straight, which starts with undeformed links."
    known = {"ending": Ending.NO_EQUILIBRIUM} if error is None else error.data
    return ConvergenceError(f"{text} {advice}", **known)


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


# Start speeds of joints and links, with what closures make of the others.
#
# Joints take the speeds given to them, all other open joints and all deflections stay as they are,
# and the closures determine the rest, J v = 0; what they leave open (one crank of two) and what a
# bent pose needs beside it takes the least kinetic energy:
#
#     min 1/2 dv' M dv,     J (v + dv) = 0,     w (v + dv) = given
#
# The speed of a link is that of its frame's origin in the world. It comes about as by a blow there:
# the least kinetic energy over all that may move, deflections too.

_MISSED = 1e-9  # of the largest speed: round-off of a constraint that can be met is 1e-15


def with_speeds(
    mechanism: Mechanism,
    dynamics: Equations,
    y: Array,
    v: Array,
    speeds: Speeds,
    driven: bool = False,
) -> Array:
    """Velocities (nv,) at the start with the given ones among them.

    Raises:
        DescriptionError: An unknown name, a prescribed one, or speeds that closures do not allow.
    """
    if not speeds:
        return v
    system = dynamics.system
    fixed = system.held if driven else distinct(system.held, system.motors)
    joints, links = _sorted(mechanism, speeds)
    v, named = v.copy(), list[int]()
    for name, at, values in joints:
        if np.any(np.isin(at, fixed)):
            raise _prescribed(mechanism, name, at, system.motors)
        for row, value in zip(at, values, strict=True):
            if value is not None:
                v[row] = value
                named.append(row)
    free = others(system.nv, np.array([*fixed, *named], dtype=np.intp))
    rows, given = _link_rows(dynamics, y, links)
    J = dynamics.close(y).J
    A, b = np.vstack([J, rows]), np.concatenate([np.zeros(len(J)), given])
    if not links:
        rigid = free[free < dynamics.n_rigid]
        looped = rigid[np.any(J[:, rigid] != 0, axis=0)]
        v = corrected(dynamics, y, v, A, b, looped)
        if not misses(A, b, v):
            return v
    v = corrected(dynamics, y, v, A, b, free)
    if misses(A, b, v):
        raise DescriptionError(
            f"{mechanism.name}: solve.start_speeds: {', '.join(name for name, _ in speeds)}: the "
            "loops and motors do not allow these speeds together; they miss by "
            f"{np.max(np.abs(A @ v - b)):.3g} (m/s or rad/s). Name fewer of them: what is not "
            "named follows."
        )
    return v


def misses(A: Array, b: Array, v: Array, share: float = _MISSED) -> bool:
    """Whether v misses A v = b by more than a share of the largest velocity."""
    size = max(float(np.max(np.abs(v), initial=0.0)), 1e-300)
    return float(np.max(np.abs(A @ v - b), initial=0.0)) > share * size


def corrected(dynamics: Equations, y: Array, v: Array, A: Array, b: Array, free: IntArray) -> Array:
    """v with the rows `free` moved by the least kinetic energy so that A v = b, if that can be."""
    if not len(free) or not len(A):
        return v
    M, A_free = dynamics.mass(y)[np.ix_(free, free)], A[:, free]
    # Massless coordinates are moved as little as can be: a share of round-off of the largest mass.
    values, V = np.linalg.eigh(M)
    root = V / np.sqrt(np.maximum(values, 1e-12 * max(values[-1], 1e-300)))
    step = root @ np.linalg.lstsq(A_free @ root, b - A @ v, rcond=1e-11)[0]
    moved = v.copy()
    moved[free] += step
    return moved


def _sorted(
    mechanism: Mechanism, speeds: Speeds
) -> tuple[
    list[tuple[str, list[int], Sequence[float | None]]],
    list[tuple[str, Sequence[float | None]]],
]:
    """Joints with their velocity rows, and links."""
    model = mechanism.rigid.rigid
    joints = list[tuple[str, list[int], Sequence[float | None]]]()
    links = list[tuple[str, Sequence[float | None]]]()
    frames = mechanism.flexible.expansion.frames
    for name, values in speeds:
        rows = joint_rows(model, name)
        count = len(rows) or 3
        if rows:
            joints.append((name, rows, values))
        elif name in frames:
            links.append((name, values))
        else:
            known = nearest(name, [*list(model.names)[1:], *frames])
            raise DescriptionError(
                f"{mechanism.name}: solve.start_speeds: no such moving joint or link: "
                f'"{name}".{known}'
            )
        if len(values) != count:
            what = "velocity of its origin" if not rows else "speed for each freedom"
            raise DescriptionError(
                f"{mechanism.name}: solve.start_speeds.{name}: {len(values)} values. Allowed: "
                f"{count}, the {what}."
            )
    return joints, links


def _prescribed(
    mechanism: Mechanism, name: str, rows: Sequence[int], motors: IntArray
) -> DescriptionError:
    if np.any(np.isin(rows, motors)):
        why, advice = "is a motor, and follows the motion", "Change the motion, or drive: torque"
    else:
        why, advice = "is idle or a base that is held", "Write idle: free"
    return DescriptionError(
        f"{mechanism.name}: solve.start_speeds.{name}: {name} {why}. {advice}, or leave it out."
    )


def _link_rows(
    dynamics: Equations, y: Array, links: Sequence[tuple[str, Sequence[float | None]]]
) -> tuple[Array, Array]:
    """Rows (k, nv) that make the given components of the links' velocities, and those (k,)."""
    rows, given = [np.zeros((0, dynamics.system.nv))], list[float]()
    for name, values in links:
        moved = frame_jacobian(dynamics, y, dynamics.system.expansion.frames[name])[:3]
        kept = [k for k, value in enumerate(values) if value is not None]
        rows.append(moved[kept])
        given += [float(x) for x in values if x is not None]
    return np.vstack(rows), np.array(given)


# Starts from a state that is given: that of a run at some time, or coordinates and velocities.
#
# Motors move as their motion says. Where the state has another speed of theirs, the start is a
# blow: it leaves the momenta of all other coordinates as they are, but for what the closures carry,
#
#     M_fm (v_m - v_m') + M_ff dv_f = J_f' p,     J (v + dv) = 0

_SAME = 1e-6  # [rad | m] what a state may miss of the motion that goes on with it
_ABOUT = "the state (y, v)"


def start_from(
    mechanism: Mechanism, dynamics: Equations, path: MotorPath, given: object, driven: bool = False
) -> Start:
    """The start from a given state; loads and motion may be others than those it comes from.

    Raises:
        DescriptionError: No such state, or one whose motors stand elsewhere, whose loops are open
            or whose velocities would open them.
    """
    where = f"{mechanism.name}: solve.start"
    y, v, about = _state(mechanism, given, where)
    stands = y.copy()
    if not driven:
        motor_axes(mechanism).write(stands, path.position[0])
    off = float(np.max(np.abs(stands - y), initial=0.0))
    gap = float(np.max(np.abs(dynamics.close(y).c), initial=0.0))
    if off > _SAME or gap > _SAME:
        what = (
            f"its motors stand {off:.3g} (rad or m) away" if off > _SAME else "its loops are open"
        )
        raise DescriptionError(
            f"{where}: {about} is no start of this motion: {what}. Give a motion (absolute) "
            "that begins there, or the mechanism that was solved."
        )
    if not driven:
        v = _struck(dynamics, y, v, path.velocity[0])
    if about == _ABOUT:
        _require_closed(dynamics, y, v, where)
        return Start(y, v, "state")
    return Start(y, v, "run")


def _state(mechanism: Mechanism, given: Any, where: str) -> tuple[Array, Array, str]:
    """y, v and their name in words; copies."""
    pair = given if isinstance(given, tuple) and len(given) == 2 else (given, np.inf)
    if isinstance(pair[0], Result):
        time = min(float(pair[1]), float(pair[0].t[-1]))
        state = state_of_run(mechanism, pair[0], time)
        return state.y.copy(), state.v.copy(), state.about
    system = mechanism.flexible
    try:
        y, v = (np.array(part, dtype=float) for part in pair)
    except (TypeError, ValueError, OverflowError):
        y = v = np.zeros(())
    if not y.ndim:
        raise DescriptionError(
            f"{where}: {shown(given)} is not valid. Allowed: auto, static, straight, a result of "
            "level coupled, (result, time in s), or (y, v), coordinates and velocities."
        )
    if y.shape != (system.nq,) or v.shape != (system.nv,):
        raise DescriptionError(
            f"{where}: y and v have shapes {y.shape} and {v.shape}. Allowed: ({system.nq},) and "
            f"({system.nv},), as y and the columns of shapes in pf.modes(robot)."
        )
    if not (np.all(np.isfinite(y)) and np.all(np.isfinite(v))):
        raise DescriptionError(f"{where}: {_ABOUT}: give finite numbers.")
    n = int(system.rigid.nq)
    y[:n] = pin.normalize(system.rigid, y[:n])  # cos and sin, quaternions
    return y, v, _ABOUT


def _struck(dynamics: Equations, y: Array, v: Array, speed: Array) -> Array:
    """v with the motors at their speed (rad/s | m/s), and what a jump of it makes of the rest."""
    system = dynamics.system
    v, free = v.copy(), system.free
    jump = speed - v[system.motors]
    v[system.motors] = speed
    if not np.any(np.abs(jump) > _SAME * np.max(np.abs(speed), initial=0.0)):
        return v
    M = dynamics.mass(y)
    pull = M[np.ix_(free, system.motors)] @ jump
    # Coordinates without mass have no momentum to keep: they stay as they move.
    v[free] -= np.linalg.lstsq(M[np.ix_(free, free)], pull, rcond=1e-12)[0]
    J = dynamics.close(y).J
    return corrected(dynamics, y, v, J, np.zeros(len(J)), free)


def _require_closed(dynamics: Equations, y: Array, v: Array, where: str) -> None:
    """Raise where velocities would open the loops."""
    J = dynamics.close(y).J
    if misses(J, np.zeros(len(J)), v, _SAME):
        raise DescriptionError(
            f"{where}: the velocities of {_ABOUT} open the loops by "
            f"{np.max(np.abs(J @ v)):.3g} (m/s or rad/s). Take v = 0 with start_speeds, which "
            "moves all joints of a loop, or velocities that fit."
        )
