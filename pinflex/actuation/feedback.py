"""A control on a system: constant rows that measure, constant columns that drive, and its state."""

from __future__ import annotations

import copy
from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pinflex.arrays import Array, IntArray, distinct
from pinflex.description.blocks.control import (
    Control,
    Deflection,
    Effort,
    Pid,
    StateLaw,
    Travel,
    Voltage,
    effort_limits,
    is_system,
    linear_law,
)
from pinflex.errors import DescriptionError, nearest
from pinflex.linalg import null_space
from pinflex.mechanics.evaluation.compiled import require_steps
from pinflex.mechanics.evaluation.equations import Equations

if TYPE_CHECKING:
    from pinflex.mechanics.mechanism import Mechanism


# What a control measured and drove along a run.


class Held(NamedTuple):
    """What a digital controller held: from t (k,) s on generalised forces, shape (k, nv).

    Attributes:
        free: Velocity rows that move.
    """

    t: Array
    force: Array
    free: IntArray


@dataclass(frozen=True)
class Signals:
    """What a control did.

    Attributes:
        names: Of the drives. B: Forces per drive, shape (nv, nu).
        u: Drives (V | N m | N), shape (nt, nu). measured: m (m | rad), shape (nt, nm).
        said: Of a digital controller that shakes its robot, a sentence. held: By a digital one.
    """

    names: tuple[str, ...]
    B: Array
    u: Array
    measured: Array
    said: tuple[str, ...] = ()
    held: Held | None = None

    def at(self, k: slice | IntArray) -> Signals:
        """The same at some of the times."""
        return replace(self, u=self.u[k], measured=self.measured[k])

    def arrays(self) -> dict[str, Array]:
        """Arrays of a result, by flat key."""
        out = {f"control/{name}": self.u[:, k] for k, name in enumerate(self.names)}
        out["measured"] = self.measured
        return out


# Gains of a law come from differences over this part of the size of its arguments: exact for the
# linear laws, and Newton needs two digits.
_STEP = 1e-4


@dataclass(frozen=True)
class Feedback:
    """A control placed on a mechanism.

    Attributes:
        control: What was asked for.
        home: y that measures are counted from, shape (nq,).
        S: Measures per velocity row, shape (nm, nv). B: Forces per drive, shape (nv, nu).
    """

    control: Control
    home: Array
    S: Array
    B: Array

    @property
    def linear(self) -> StateLaw | None:
        """The law in state space; None: it is any function."""
        law = self.control.law
        return law.linear(len(self.S)) if isinstance(law, Pid) else None


def place(mechanism: Mechanism, control: Control, prescribed: bool) -> Feedback:
    """Find the rows and columns of a control."""
    nv = mechanism.flexible.nv
    S = np.array([_measure(mechanism, m, nv) for m in control.measures]).reshape(-1, nv)
    B = np.array([_drive(mechanism, d, nv, prescribed) for d in control.drives]).reshape(-1, nv).T
    feedback = Feedback(control, mechanism.undeformed(), S, np.ascontiguousarray(B))
    if control.period is not None:
        return feedback  # its law has a state: it is not called to look at it
    still = np.zeros(len(S))
    size = np.shape(control.law(0.0, still, still, still))
    if size != (len(control.drives),):
        raise DescriptionError(
            f"control.law: gives shape {size} for {len(control.drives)} drives. Return one each."
        )
    return feedback


def _measure(mechanism: Mechanism, one: Deflection | Travel, nv: int) -> Array:
    row = np.zeros(nv)
    if isinstance(one, Travel):
        row[_joint_row(mechanism, one.joint)] = 1.0
        return row
    at, rows = _bending(mechanism, one.link, one.x, one.direction)
    row[at] = rows[0]
    return row


def _drive(mechanism: Mechanism, one: Voltage | Effort, nv: int, prescribed: bool) -> Array:
    column = np.zeros(nv)
    if isinstance(one, Effort):
        row = _joint_row(mechanism, one.joint)
        if prescribed and row in mechanism.flexible.motors:
            raise DescriptionError(
                f"{mechanism.name}: control: {one.joint} is a motor that follows the motion, so a "
                "force on it moves nothing. Set solve.drive: torque, or drive another joint."
            )
        column[row] = 1.0
        return column
    patches = {
        p.name: (link, p) for link, part in mechanism.parts.items() for p in part.spec.patches
    }
    if one.patch not in patches:
        raise DescriptionError(
            f"{mechanism.name}: control: no patch {one.patch}.{nearest(one.patch, patches)}"
        )
    link, patch = patches[one.patch]
    for x, sign in ((patch.end, 1.0), (patch.start, -1.0)):
        at, rows = _bending(mechanism, link, x, "y")
        column[at] += sign * patch.constant * rows[1]
    return column


def _bending(
    mechanism: Mechanism, link: str, x: float, direction: str
) -> tuple[slice, tuple[Array, Array]]:
    """Velocity rows of a bending direction, with its functions and slopes at x."""
    where = f"{mechanism.name}: control: {link}"
    plane = {"y": "v", "z": "w"}[direction]
    part = mechanism.parts.get(link)
    if part is None:
        raise DescriptionError(f"{where}: no such flexible link.{nearest(link, mechanism.parts)}")
    if len(part.bodies) > 1 or plane not in part.planes:
        raise DescriptionError(f"{where}: it must be one segment that bends along {direction}.")
    if not 0.0 <= x <= part.length * (1 + 1e-9):
        raise DescriptionError(
            f"{where}: x = {x:g} m is not on the beam. Allowed: 0 to {part.length:g} m."
        )
    slot = next(s for s in mechanism.flexible.expansion.slots if s.link == link)
    inside, start = slot.body.slices[plane], int(mechanism.flexible.rigid.nv) + slot.eta.start
    F = slot.body.families[plane].evaluate(np.array([x]))
    return slice(start + inside.start, start + inside.stop), (F.f[0], F.rot[0])


def _joint_row(mechanism: Mechanism, joint: str) -> int:
    names = list(mechanism.coordinates)
    if joint not in names:
        raise DescriptionError(
            f"{mechanism.name}: control: {joint} is no joint of one freedom.{nearest(joint, names)}"
        )
    return names.index(joint)


class FeedbackState:
    """The integrals of a control along a run, and its forces at any state."""

    def __init__(self, feedback: Feedback, dynamics: Equations, h: float) -> None:
        self.feedback, self._dynamics, self._half = feedback, dynamics, 0.5 * h
        n, self._t = len(feedback.S), 0.0
        self.m, self.total = np.zeros(n), np.zeros(n)
        self._m_old: Array | None = None
        self._total_old = np.zeros(n)
        self.u = np.zeros(len(feedback.control.drives))

    def force(self, t: float, y: Array, v: Array) -> Array:
        """Generalised forces (nv,) at time t (s); integrals by the trapezoidal rule."""
        one, self._t = self.feedback, t
        self.m = one.S @ self._dynamics.difference(one.home, y)
        before = self.m if self._m_old is None else self._m_old
        step = 0.0 if self._m_old is None else self._half
        self.total = self._total_old + step * (before + self.m)
        self.u = np.asarray(one.control.law(t, self.m, one.S @ v, self.total), dtype=np.float64)
        return one.B @ self.u

    def signals(self, count: int) -> Signals:
        """Room for what it does at a number of times."""
        one = self.feedback
        u, m = np.zeros((count, len(self.u))), np.zeros((count, len(self.m)))
        return Signals(one.control.labels, one.B, u, m)

    def keep(self) -> None:
        """Accept the last state as the end of a step."""
        self._m_old, self._total_old = self.m.copy(), self.total.copy()

    def state_at(self, t: float, target: Array) -> tuple[Array, Array]:
        """Integrals of the errors, and these, at the end of the last step; shape (nm,) each."""
        m = np.zeros_like(target) if self._m_old is None else self._m_old
        return self._total_old - target * t, m - target

    def go_on(self, t: float, target: Array, x: Array, e: Array) -> None:
        """Take over a later end of a step, as `state_at` tells it."""
        self._m_old, self._total_old = e + target, x + target * t

    def gains(self, y: Array, v: Array) -> tuple[Array, Array]:
        """Derivatives of the force by y and by v at a state, each (nv, nv)."""
        t = self._t
        self.force(t, y, v)
        one, law = self.feedback, self.feedback.control.law
        given = [self.m, one.S @ v, self.total]
        slopes = []
        for k, x in enumerate(given):
            columns = []
            for e in np.eye(len(x)):
                step = _STEP * max(float(np.max(np.abs(x))), 1e-6)
                moved = [law(t, *(g + s * step * e if j == k else g for j, g in enumerate(given)))
                         for s in (1.0, -1.0)]  # fmt: skip
                columns.append((np.asarray(moved[0]) - np.asarray(moved[1])) / (2.0 * step))
            slopes.append(np.array(columns).reshape(len(x), len(self.u)).T)
        by_m = slopes[0] + self._half * slopes[2]
        return one.B @ by_m @ one.S, one.B @ slopes[1] @ one.S


# A digital controller along a run: it measures at sample instants and holds its outputs.
#
# What is sampled at k T acts from k T + delay until the next output (zero-order hold), |u| <=
# limit.

MORE = 1.5  # steps of a hold, of those that a coarser run took
_EARLY = 1e-9  # of the period: round-off of an instant's time
# Outputs that nothing is said of, if there are no more; parts of the samples at which an output
# turns round, and of its largest value by which, from where on that is said.
_FEW, _OFTEN, _FAR = 20, 0.8, 0.1


class Sampler:
    """Outputs of a digital controller along one run.

    Attributes:
        u: Outputs that act now, shape (nu,).
        held: Generalised forces of the drives, shape (nv,).
        driven: Which motors it drives, shape (nm,).
    """

    def __init__(
        self, mechanism: Mechanism, feedback: Feedback, dynamics: Equations, free: bool
    ) -> None:
        control = feedback.control
        assert control.period is not None
        self.feedback, self.period, self._dynamics = feedback, control.period, dynamics
        self._law: Any = fresh_law(control)
        self._limit = _limit(mechanism, control)
        self._motors = dynamics.system.motors if free else dynamics.system.motors[:0]
        self._moving = dynamics.system.unheld if free else dynamics.system.free
        self._other = feedback.B.copy()
        self._other[self._motors] = 0.0
        self.driven = np.any(feedback.B[self._motors] != 0.0, axis=1)
        n = len(feedback.S)
        self._last, self._total = np.zeros(n), np.zeros(n)
        self._flat = len(feedback.home) == len(feedback.B)
        self._next = 0  # number of the sample that comes
        self._waiting: deque[tuple[float, Array]] = deque()
        self._log: list[tuple[float, Array]] = []
        self._hold(0.0, self._clip(self._fed(np.zeros(len(self._limit)), 0.5 * self.period)))

    @property
    def force(self) -> Array:
        """Generalised forces of the drives that are no motors, shape (nv,)."""
        return self._other @ self.u

    @property
    def torque(self) -> Array:
        """Motor torques, shape (nm,)."""
        return self.held[self._motors]

    def instants(self, end: float, parts: int = 1) -> tuple[float, ...]:
        """Times (s) before `end` at which the controller measures or its output changes."""
        period, delay = self.period, self.feedback.control.delay
        samples = np.arange(int(np.ceil(end / period))) * period
        late = samples + delay if delay % period > _EARLY * period else samples[:0]
        found = np.append(distinct(samples, late[late < end]), end)
        cut = found[:-1, None] + np.diff(found)[:, None] * np.arange(parts) / parts
        return tuple(cut.ravel().tolist())

    def reach(self, t: float, y: Array, v: Array) -> bool:
        """Measure where a sample is due at t (s); whether outputs were due and are applied now."""
        early = _EARLY * self.period
        while self._next * self.period <= t + early:
            self._sample(self._next * self.period, y, v)
            self._next += 1
        applied = len(self._log)
        while self._waiting and self._waiting[0][0] <= t + early:
            self._hold(*self._waiting.popleft())
        return len(self._log) > applied

    def signals(self, t: Array, y: Array) -> Signals:
        """What it measured and drove, seen at times t (nt,) of a run with poses y (nt, nq)."""
        times, every = (np.array(x) for x in zip(*self._log, strict=True))
        at = np.searchsorted(times, t + _EARLY * self.period, side="right") - 1
        u, one = every[np.maximum(at, 0)], self.feedback
        m = np.array([self._measured(pose) for pose in y]).reshape(len(t), len(one.S))
        held = Held(times, every @ one.B.T, self._moving)
        return Signals(one.control.labels, self._other, u, m, self._said(), held)

    def _said(self) -> tuple[str, ...]:
        """A sentence where an output turns round at nearly every sample in the end; or none."""
        labels, u = self.feedback.control.labels, np.array([u for _, u in self._log])
        way = np.diff(u, axis=0)[-max(_FEW, len(u) // 4) :]
        if len(way) < _FEW:
            return ()
        turned = np.mean(way[1:] * way[:-1] < 0.0, axis=0)
        far = np.median(np.abs(way), axis=0)
        shaken = np.flatnonzero((turned > _OFTEN) & (far > _FAR * np.abs(u).max(axis=0)))
        if not len(shaken):
            return ()
        drives = ", ".join(f"{labels[k]} (by {far[k]:.3g} each time)" for k in shaken)
        return (
            f"control: its output turns round at nearly every sample for {drives}: the loop "
            f"shakes the robot at half its sample rate, {0.5 / self.period:.4g} Hz, as an unstable "
            "one does, or one with the derivative of a rounded measure. Lower its gains or shorten "
            "`period`; pf.margins(robot, control) tells how far.",
        )

    def _sample(self, t: float, y: Array, v: Array) -> None:
        one, control, m = self.feedback, self.feedback.control, self._measured(y)
        if self._next:
            self._total = self._total + 0.5 * self.period * (self._last + m)
        self._last = m
        asked = np.asarray(self._law(t, m, one.S @ v, self._total), dtype=np.float64)
        if asked.shape != self._limit.shape:
            raise DescriptionError(
                f"control.law: gives shape {asked.shape} for {len(self._limit)} drives. Return "
                "one each."
            )
        asked = self._fed(asked, t + control.delay + 0.5 * self.period)
        given = self._clip(asked)
        if hasattr(self._law, "applied"):
            self._law.applied(asked, given)
        self._waiting.append((t + control.delay, given))

    def _measured(self, y: Array) -> Array:
        home = self.feedback.home
        return self.feedback.S @ (y - home if self._flat else self._dynamics.difference(home, y))

    def _fed(self, u: Array, t: float) -> Array:
        """Outputs with what is fed forward at t."""
        forward = self.feedback.control.forward
        return u if forward is None else u + np.asarray(forward(t), float)

    def _clip(self, u: Array) -> Array:
        return np.minimum(np.maximum(u, -self._limit), self._limit)

    def _hold(self, t: float, u: Array) -> None:
        self._log.append((t, u))
        self.u, self.held = u, self.feedback.B @ u


def drives_motors(mechanism: Mechanism, control: Control) -> bool:
    """Whether a control drives a motor of the mechanism."""
    motors = mechanism.description.actuated
    return any(isinstance(d, Effort) and d.joint in motors for d in control.drives)


def require_instants(mechanism: Mechanism, control: Control, end: float) -> None:
    """Raise where a run of `end` (s) would have far too many samples."""
    assert control.period is not None
    require_steps(mechanism, int(min(np.ceil(end / control.period), 1e12)), end, "control.period")


_NO_MASS = 1e-11  # of a mass matrix with a diagonal of ones: round-off


def require_masses(
    mechanism: Mechanism, feedback: Feedback, dynamics: Equations, y: Array, rows: IntArray
) -> None:
    """Raise where a drive pushes, at a pose y (nq,), what nothing gives a mass; rows: that move.

    Its speed, and without a damper its position, would jump with the output at every sample.
    """
    M, J = dynamics.mass(y)[np.ix_(rows, rows)], dynamics.close(y).J[:, rows]
    size = np.sqrt(np.diag(M))
    size[size == 0.0] = 1.0
    scaled = M / np.outer(size, size)
    if np.linalg.eigvalsh(scaled).min(initial=1.0) > _NO_MASS:
        return
    still = null_space(np.concatenate([scaled, J / size]), _NO_MASS) / size[:, None]
    pushed = np.abs(feedback.B[rows].T @ still).max(axis=1, initial=0.0)
    for label, push in zip(feedback.control.labels, pushed, strict=True):
        if push > _NO_MASS:
            raise DescriptionError(
                f"{mechanism.name}: control: {label} pushes what has no mass: its speed would jump "
                "at every sample. Give its joint a rotor_inertia or what it moves a mass, or "
                "drive another joint."
            )


def fresh_law(control: Control) -> Any:
    """The law of a digital controller: every run begins with its state as given."""
    if callable(control.law) and not is_system(control.law):
        return copy.deepcopy(control.law)
    assert control.period is not None
    made = linear_law(control.law, control.period, control.reference)
    wanted = (len(control.drives), len(control.measures))
    if made.D.shape != wanted:
        raise DescriptionError(
            f"control.law: a system with {made.D.shape[1]} inputs and {made.D.shape[0]} outputs "
            f"for {wanted[1]} measures and {wanted[0]} drives. Give one of each."
        )
    return made


def _limit(mechanism: Mechanism, control: Control) -> Array:
    """Largest |u| of each drive: as given, else the effort limits of the URDF."""
    if control.limit:
        return np.array(control.limit, dtype=np.float64)
    return np.array(effort_limits(mechanism.description.urdf_text, control.drives))
