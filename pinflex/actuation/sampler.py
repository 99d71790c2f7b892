"""A digital controller along a run: it measures at sample instants and holds its outputs.

What is sampled at k T acts from k T + delay until the next output (zero-order hold), |u| <= limit.
"""

from __future__ import annotations

import copy
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.actuation.feedback import Signals
from pinflex.arrays import Array
from pinflex.description.blocks.control import Control, Effort, effort_limits, is_system, linear_law
from pinflex.errors import DescriptionError
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.model.cost import require_steps

if TYPE_CHECKING:
    from pinflex.actuation.feedback import Feedback
    from pinflex.mechanics.mechanism import Mechanism

_EARLY = 1e-9  # of the period: round-off of an instant's time


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
        self._law: Any = _law(control)
        self._limit = _limit(mechanism, control)
        self._motors = dynamics.system.motors if free else dynamics.system.motors[:0]
        self._other = feedback.B.copy()
        self._other[self._motors] = 0.0
        self.driven = np.any(feedback.B[self._motors] != 0.0, axis=1)
        n = len(feedback.S)
        self._last, self._total = np.zeros(n), np.zeros(n)
        self._next = 0  # number of the sample that comes
        self._waiting: deque[tuple[float, Array]] = deque()
        self._log: list[tuple[float, Array]] = []
        self._hold(0.0, self._clip(self._forward(0.5 * self.period)))

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
        found = np.append(np.union1d(samples, late[late < end]), end)
        cut = found[:-1, None] + np.diff(found)[:, None] * np.arange(parts) / parts
        return tuple(cut.ravel().tolist())

    def reach(self, t: float, y: Array, v: Array) -> bool:
        """Measure where a sample is due at t (s), and apply the outputs that are due.

        Returns:
            Whether outputs were applied.
        """
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
        times = np.array([when for when, _ in self._log])
        at = np.searchsorted(times, t + _EARLY * self.period, side="right") - 1
        u = np.array([u for _, u in self._log])[np.maximum(at, 0)]
        one = self.feedback
        m = np.array([one.S @ self._dynamics.difference(one.home, pose) for pose in y])
        return Signals(one.control.labels, self._other, u, m.reshape(len(t), len(one.S)))

    def _sample(self, t: float, y: Array, v: Array) -> None:
        one, control = self.feedback, self.feedback.control
        m = one.S @ self._dynamics.difference(one.home, y)
        if self._next:
            self._total = self._total + 0.5 * self.period * (self._last + m)
        self._last = m
        asked = np.asarray(self._law(t, m, one.S @ v, self._total), dtype=np.float64)
        if asked.shape != self._limit.shape:
            raise DescriptionError(
                f"control.law: gives shape {asked.shape} for {len(self._limit)} drives. Return "
                "one each."
            )
        asked = asked + self._forward(t + control.delay + 0.5 * self.period)
        given = self._clip(asked)
        if hasattr(self._law, "applied"):
            self._law.applied(asked, given)
        self._waiting.append((t + control.delay, given))

    def _forward(self, t: float) -> Array:
        forward = self.feedback.control.forward
        return np.zeros(len(self._limit)) if forward is None else np.asarray(forward(t), float)

    def _clip(self, u: Array) -> Array:
        return np.minimum(np.maximum(u, -self._limit), self._limit)

    def _hold(self, t: float, u: Array) -> None:
        self.u = u
        self._log.append((t, u))
        self.held = self.feedback.B @ u


def drives_motors(mechanism: Mechanism, control: Control) -> bool:
    """Whether a control drives a motor of the mechanism."""
    motors = mechanism.description.actuated
    return any(isinstance(d, Effort) and d.joint in motors for d in control.drives)


def require_instants(mechanism: Mechanism, control: Control, end: float) -> None:
    """Raise where a run of `end` (s) would have far too many samples."""
    assert control.period is not None
    require_steps(mechanism, int(min(np.ceil(end / control.period), 1e12)), end, "control.period")


def _law(control: Control) -> Any:
    """A fresh law: every run begins with its state as given."""
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
