"""The equations of motion of one system, at one state or at many.

    r(y, v, a, lam) = X' (rnea(Q, X v, X a + Xdot v) - J_Q' lam) + K y + D v,     c(y) = 0

With no flexible link X = I and this is Pinocchio itself. Here r leaves out the motor torques: the
rows of motors give the torque that the motion needs.

The compiled kernel answers where it serves, else the plain reference of Pinocchio and numpy, with
the same numbers. Every call is a value: states and time go in, arrays that nothing overwrites come
out, by name. States are time-first: y (n, nq), v and a (n, nv), multipliers lam (n, rows) [N | N m]
at times t (n,) [s], or one for all; one state y (nq,) is a batch of one, and answers lose the axis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import field, fields
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, BoolArray, spans
from pinflex.errors import MotionError
from pinflex.kernel.evaluate import Closure, Energies, JointForces, Residual, Tangent
from pinflex.mechanics.evaluation.compiled import Compiled, serves
from pinflex.mechanics.model.strain import Strain
from pinflex.mechanics.reference.evaluator import Configuration, Kinematics, Reference
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.mechanics.mechanism import Mechanism
    from pinflex.mechanics.model.slider import Sleeve
    from pinflex.mechanics.model.system import System


T = TypeVar("T")

# Rigid motions kept with their mechanism: whatever runs, compares or draws asks for the same.

# Keys of a description that say nothing of how rigid joints move: home is compared. (Gravity is in
# the accelerations of the compiled nodes: that of rows is a difference, to round-off the same.)
_APART = (
    *("yaml_text", "share", "forces", "control", "springs", "added_masses", "flexible"),
    *("system_damping", "solve", "limit", "allow"),
)


@frozen(eq=False)
class Memory:
    """The last few values of motions, by what was asked of them, the newest first."""

    most: int
    values: list[tuple[Any, Any, Any]] = field(default_factory=list)

    def find(self, motion: object, asked: object) -> Any:
        """The value of a motion for what is asked of it; None: it is not known."""
        known = (x for moved, like, x in self.values if moved is motion and like == asked)
        return next(known, None)

    def keep(self, motion: object, asked: object, value: T) -> T:
        """The value, put before what was known; the oldest goes."""
        self.values.insert(0, (motion, asked, value))
        del self.values[self.most :]
        return value

    def get(self, motion: object, asked: object, make: Callable[[], T]) -> T:
        """The value of a motion for what is asked of it, made where it is not known."""
        known: T | None = self.find(motion, asked)
        return self.keep(motion, asked, make()) if known is None else known


@frozen(eq=False)
class Followed:
    """What was found of the motions of a rigid mechanism.

    Attributes:
        motions: Of the YAML, shaped where it says so.
        nominals: Rigid motions at instants. Which of them serves depends on what was asked before:
            they are never shared.
        solved: What was solved for them. between: What was, between instants of them.
        paths: Of the motors between two times: functions of time.
        starts: Of the flexible mechanism, by how they are asked for; never shared.
        scales: How far runs of it are going to move; never shared.
        platforms: Where its platform is on the way, undeformed; never shared.
        sides: Accelerations of the motors just before and after breaks.
        jumps: What is said of jumps of speed before an end: sentences.
    """

    motions: Memory = field(default_factory=partial(Memory, 1))
    # of a run: at its samples, where a platform's motor motion is interpolated, for scales
    nominals: Memory = field(default_factory=partial(Memory, 4))
    solved: Memory = field(default_factory=partial(Memory, 4))
    between: Memory = field(default_factory=partial(Memory, 4))
    paths: Memory = field(default_factory=partial(Memory, 4))
    starts: Memory = field(default_factory=partial(Memory, 4))
    scales: Memory = field(default_factory=partial(Memory, 4))
    platforms: Memory = field(default_factory=partial(Memory, 4))
    sides: Memory = field(default_factory=partial(Memory, 4))
    jumps: Memory = field(default_factory=partial(Memory, 1))

    def __reduce__(self) -> tuple[type[Followed], tuple[()]]:
        return Followed, ()  # found again where it is needed


def share(one: Mechanism, other: Mechanism, alike: bool = False) -> None:
    """Let a mechanism have the rigid motions of another one of the same file, where they agree.

    `alike`: they are known to, for masses and springs alone are others.
    """
    if alike or _move_alike(one, other):
        known = one.followed
        both = {"solved": known.solved, "between": known.between, "paths": known.paths}
        shared = Followed(known.motions, **both)
        vars(other)["followed"] = shared


def _move_alike(one: Mechanism, other: Mechanism) -> bool:
    """Whether two mechanisms have the same rigid motions, to the last bit."""
    a, b, rigid = one.description, other.description, (one.rigid, other.rigid)
    if any(system.closed.contacts for system in rigid) or (a.motion or {}).get("shaper"):
        return False  # a sleeve knows its beam, and a shaper the modes
    keys = (x.name for x in fields(a) if x.name not in _APART)
    if [link.link for link in a.flexible] != [link.link for link in b.flexible]:
        return False
    if any(getattr(a, key) != getattr(b, key) for key in keys):
        return False
    pairs = ((x.home, x.rigid.held, x.rigid.motors) for x in (one, other))
    if not all(np.array_equal(x, y) for x, y in zip(*pairs, strict=True)):
        return False
    places = (system.rigid.jointPlacements for system in rigid)
    return all(x == y for x, y in zip(*places, strict=True))


# Where a sleeve is on its beam, and the section forces that it adds there.


def off_beam(sleeve: Sleeve, place: Array) -> BoolArray:
    """Whether an end of a sleeve lies beyond an end of its beam, shape as `place`."""
    # An end may stand on an end of the beam, up to what closing the loops leaves.
    slack = 1e-9 * sleeve.length
    return np.asarray(
        np.abs(place - 0.5 * sleeve.length) + sleeve.half > 0.5 * sleeve.length + slack
    )


def left_beam(sleeve: Sleeve, place: float, name: str, where: str, t: float | None) -> MotionError:
    """The error that a sleeve has left its beam."""
    when = where if t is None else f"{where}: t = {t:.6g} s"
    reach = f"x = {place:.6g} m"
    if sleeve.half:
        reach += f", from {place - sleeve.half:.6g} to {place + sleeve.half:.6g} m"
    return MotionError(
        f'{when}: sleeve "{name}" leaves the beam {sleeve.link}: it is at {reach}, the beam '
        f"ends at 0 and {sleeve.length:g} m. Shorten the motion, or lengthen the beam.",
        loop=name,
        position=place,
        time=t,
    )


def section_forces(x: Array, forces: Array, segment: int = 0, roots: Array | None = None) -> Array:
    """Section forces N, Vy, Vz, T, My, Mz that a sleeve adds on a segment, shape (nt, nx, 6).

    What stands on later segments is in the forces of the interface; there it acts with the root of
    the segment that the sleeve is on.
    """
    on = forces[:, 0, 7]
    at, F, M = forces[:, :, 0], forces[:, :, 1:4], forces[:, :, 4:7]
    if roots is not None and np.any(on != segment):
        own, there = roots[segment], roots[on.astype(int), np.arange(len(on))]
        turn = np.swapaxes(own[:, :, :3], 1, 2) @ there[:, :, :3]
        shift = np.einsum("tji,tj->ti", own[:, :, :3], there[:, :, 3] - own[:, :, 3])
        at = at * turn[:, :1, 0] + shift[:, :1]
        F, M = F @ turn.swapaxes(1, 2), M @ turn.swapaxes(1, 2)
    arm = at[:, None, :] - x[None, :, None]
    counted = (arm >= 0.0).astype(float) - (on > segment)[:, None, None]
    Fx, Fy, Fz, Mx, My, Mz = (part[:, None, :, k] for part in (F, M) for k in range(3))
    parts = (Fx, Fy, Fz, Mx, My - arm * Fz, Mz + arm * Fy)
    return np.stack([np.sum(counted * p, axis=2) for p in parts], axis=2)


class Equations:
    """The equations of a system (make one per run, and per thread).

    Attributes:
        system: What is evaluated. model: Its expanded model.
        n_rigid, nq_rigid: Rigid velocities and coordinates. flexible: Whether any link bends.
        vector_space: Whether y moves by plain addition. looped: Whether there are closures.
        strain: Elastic potential of the links.
    """

    def __init__(self, system: System, marched: bool = False) -> None:
        """`marched`: in steps, where the kernel serves rigid systems too."""
        self.system, self._marched = system, marched
        self.model: pin.Model = system.expansion.model
        self.n_rigid, self.nq_rigid = int(system.rigid.nv), int(system.rigid.nq)
        self.flexible = system.n_eta > 0
        self.vector_space = self.nq_rigid == self.n_rigid
        self.looped, self.strain = system.closed.n > 0, Strain(system)

    @cached_property
    def reference(self) -> Reference:
        """The plain evaluator."""
        return Reference(self.system)

    @property
    def data(self) -> pin.Data:
        """Workspace of Pinocchio for the model, which the next call overwrites."""
        return self.reference.placing.data

    @cached_property
    def compiled(self) -> Compiled | None:
        """The compiled equations, where they serve."""
        return self._kernel if self.on_kernel else None

    @cached_property
    def _kernel(self) -> Compiled | None:
        """What the kernel has of a system that it need not march: closures and tangents."""
        return Compiled(self.system) if serves(self.system, True) else None

    @property
    def _serving(self) -> Compiled | Reference:
        return self.reference if self.compiled is None else self.compiled

    @property
    def on_kernel(self) -> bool:
        """Whether the compiled equations serve."""
        return serves(self.system, self._marched)

    def _closures(self, y: Array) -> Compiled | None:
        """The compiled closures; of one pose of a rigid system the tables would cost more."""
        return self._kernel if self.looped and (y.ndim > 1 or self.on_kernel) else None

    # Poses -----------------------------------------------------------------------------------

    def integrate(self, y: Array, dy: Array) -> Array:
        """y moved by dy on the configuration manifold (right-trivialised), shape (nq,)."""
        return self.system.integrate(y, dy)

    def difference(self, y0: Array, y1: Array) -> Array:
        """dy that takes y0 to y1, shape (nv,)."""
        return self.system.difference(y0, y1)

    def at(self, y: Array, v: Array | None = None, a: Array | None = None) -> Configuration:
        """Expanded configuration and map, always with a first axis for the states."""
        given = (None if x is None else np.atleast_2d(x) for x in (v, a))
        return self.reference.map.at(np.atleast_2d(y), *given)

    def joint_poses(self, y: Array) -> Array:
        """Poses of the joints [R | p] at y (nq,) or (n, nq), shape (n, joints, 3, 4)."""
        of = self.reference
        return _in_turn(lambda Y: (of.placing.poses(of.map.at(Y).Q),), np.atleast_2d(y))[0]

    def kinematics(self, y: Array, joint: int | None = None) -> Kinematics:
        """Joints, or one of them, at y (nq,) or (n, nq)."""
        return self.reference.kinematics(np.atleast_2d(y), joint)

    def motions(self, y: Array, v: Array, a: Array, joints: Sequence[int]) -> tuple[Array, Array]:
        """Poses of k joints (k, n, 3, 4) in the world, and their spatial motion (k, n, 2, 6).

        Velocity and acceleration are in the frames of the joints.
        """
        poses, rates = _in_turn(partial(self._serving.motions, joints=joints), y, v, a, axis=1)
        return poses, rates

    # Closures --------------------------------------------------------------------------------

    def close(self, y: Array) -> Closure:
        """Closure residuals and their Jacobian at y (nq,) or (n, nq)."""
        Y = np.atleast_2d(y)
        if (kernel := self._closures(y)) is not None:
            c, J = kernel.closures(Y)
        else:
            c, J = _in_turn(self.reference.close, Y)
        return Closure(c, J) if y.ndim > 1 else Closure(c[0], J[0])

    def closure_bias(self, y: Array, v: Array) -> Array:
        """gamma in cdd = J a + gamma, (..., rows), at y (..., nq) and v (..., nv)."""
        Y, V = np.atleast_2d(y), np.atleast_2d(v)
        if (kernel := self._closures(y)) is not None:
            gamma = kernel.closure_motion(Y, V, np.zeros_like(V))[2]
        else:
            (gamma,) = _in_turn(lambda *at: (self.reference.closure_bias(*at),), Y, V)
        return np.asarray(gamma[0] if y.ndim == 1 else gamma)

    def sleeve_places(self, Y: Array) -> Array:
        """Where the sleeves are on their links (m) at poses Y (n, nq), shape (n, sleeves)."""
        if not self.system.closed.contacts:
            return np.empty((len(Y), 0))
        return self._serving.sleeve_places(Y)

    def first_off(self, Y: Array) -> int | None:
        """The first of poses Y (n, nq) at which a sleeve has left its beam; None: at none."""
        contacts, off = self.system.closed.contacts, np.zeros(len(Y), dtype=bool)
        for one, x in zip(contacts, self.sleeve_places(Y).T, strict=True):
            off |= off_beam(one.sleeve, x)
        return int(np.argmax(off)) if np.any(off) else None

    def require_on_beams(self, y: Array, where: str, t: float | None = None) -> None:
        """Raise a MotionError where a sleeve has left its beam at y (nq,), at a time t (s)."""
        closed = self.system.closed
        for one, place in zip(closed.contacts, self.sleeve_places(y[None])[0], strict=True):
            if off_beam(one.sleeve, place):
                raise left_beam(one.sleeve, float(place), closed.names[one.loop], where, t)

    # Forces ----------------------------------------------------------------------------------

    def open(self, y: Array, v: Array, a: Array, t: Array) -> Array:
        """What motions take where loops are open, by Pinocchio, shape (n, nv)."""
        return _in_turn(lambda *at: (self.reference.forces(*at),), y, v, a, t)[0]

    def residual(
        self,
        y: Array,
        v: Array,
        a: Array,
        lam: Array,
        t: float | Array,
        control_force: Array | None = None,
    ) -> Residual:
        """Forces that the motion (y, v, a) with multipliers lam leaves to the motors.

        r = X' (rnea - J_Q' lam) + K y + D v, zero in the rows of everything that is not driven.
        """
        Y, V, A, given = (np.atleast_2d(x) for x in (y, v, a, lam))
        times = np.broadcast_to(np.asarray(t, dtype=float), len(Y))
        if self.compiled is not None:
            r, c = self.compiled.residual(Y, V, A, given, times)
        else:
            c, J = self.close(Y)
            r = self.open(Y, V, A, times) - (given[:, None] @ J)[:, 0]
        if control_force is not None:
            r -= control_force
        return Residual(r, c) if y.ndim > 1 else Residual(r[0], c[0])

    def joint_forces(
        self,
        y: Array,
        v: Array,
        a: Array,
        lam: Array,
        t: Array,
        joints: Sequence[int],
        control_force: Array | None = None,
    ) -> JointForces:
        """Forces of joints, loops and sleeves at n states."""
        of = self._serving
        if isinstance(of, Compiled) and not of.has(joints):
            of = self.reference
        found = JointForces(*_in_turn(partial(of.joint_forces, joints=joints), y, v, a, lam, t))
        return found if control_force is None else found._replace(r=found.r - control_force)

    # Matrices, at one state ------------------------------------------------------------------

    def mass(self, y: Array, t: float = 0.0) -> Array:
        """M = X' crba(Q) X, shape (nv, nv), with what is carried at a time t (s)."""
        if self.compiled is not None:
            still, lam = np.zeros(self.system.nv), np.zeros(self.system.closed.n)
            return self.compiled.tangent(y, still, still, lam, t, False)[0]
        return self.reference.mass(y, t)

    def tangent(
        self, y: Array, v: Array, a: Array, lam: Array, t: float, rates: bool = True
    ) -> Tangent:
        """Derivatives by y, v and a, and the closure Jacobian; `rates`: see `iteration_matrix`."""
        if self._kernel is not None:
            return self._kernel.tangent(y, v, a, lam, t, rates)
        return self.reference.tangent(y, v, a, lam, t)

    def iteration_matrix(
        self,
        y: Array,
        v: Array,
        a: Array,
        lam: Array,
        t: float,
        weights: Sequence[float],
        rates: bool = False,
    ) -> tuple[Array, Array]:
        """weights[0] dr/da + weights[1] dr/dv + weights[2] dr/dy for Newton, and J.

        The kernel leaves the rates of the second-order rows out unless asked for them: they are of
        the order of the step times the elastic rates, and Newton does not miss them in a smooth
        motion.
        """
        *parts, J = self.tangent(y, v, a, lam, t, rates)
        S = sum(w * part for w, part in zip(weights, parts, strict=True) if w)
        return np.asarray(S), J

    def structural_stiffness(self, y: Array) -> Array:
        """K of links and springs alone, without the stiffness that loads bring, shape (nv, nv).

        Springs between frames resist along their line at the pose y; what their pull adds across
        it is a load's.
        """
        K, springs = self.system.K.copy(), self.system.springs
        K[springs.v_at, springs.v_at] += springs.stiffness
        return K + self.reference.spring_stiffness(y) if self.system.loads.springs else K

    # Energies --------------------------------------------------------------------------------

    def energies(self, y: Array, v: Array, t: float | Array) -> Energies:
        """Kinetic energy, and potentials of weight, links, and of springs and loads, J."""
        Y, V = np.atleast_2d(y), np.atleast_2d(v)
        found = _in_turn(self._serving.energies, Y, V, np.broadcast_to(t, len(Y)))
        return Energies(*(x[0] if y.ndim == 1 else x for x in found))

    def losses(self, y: Array, v: Array) -> Array:
        """Power that damping, friction and dampers between frames take, shape (n,), W."""
        if not self.system.kinks.rows and not any(
            spring.damper for spring, _, _ in self.system.loads.springs
        ):
            return self.system.dissipation(v)
        return self._serving.losses(y, v)


def _in_turn(f: Callable[..., Iterable[Array]], *states: Array, axis: int = 0) -> list[Array]:
    """Answers to n states, some at a time: a long motion shall not fill the memory."""
    parts = [f(*(x[s] for x in states)) for s in spans(len(states[0]))] or [f(*states)]
    if len(parts) == 1:
        return [*parts[0]]
    return [np.concatenate(part, axis) for part in zip(*parts, strict=True)]
