"""The coupled level by the alpha family, with steps that follow the motion.

What a step of h leaves of its displacement (Zienkiewicz and Xie 1991; Hulbert and Jang 1995):

    y(t1) - y1 = -(beta + (alpha_m - alpha_f)/2 - 1/6) h^3 da/dt + O(h^4)

Two parts of a state belong to the step that made it; where h becomes h' they are moved along:

    s - a = (alpha_m - alpha_f) h da/dt, by h'/h (Bruels and Arnold 2008),
    J v = O(h^2), by (h'/h)^2: what the scheme's own solution leaves of the closures' rates
    (Arnold, Bruels and Cardona 2015).

Without the first multipliers lose an order, and positions too where steps come in turn. Without the
second every change throws the multipliers by O(h), and some patterns of steps diverge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinflex.actuation.drive import TorqueDrive
from pinflex.arrays import Array, IntArray
from pinflex.integrators.alpha import NEWTON, March, NoConvergence
from pinflex.integrators.newton import Step
from pinflex.integrators.schemes import AlphaScheme
from pinflex.integrators.steps import Path, States, StepFailed, largest
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.mechanism import Mechanism

# Newton's tolerance at coarse resolutions: outputs of the race scenes differ by less than a
# hundredth of their error from those at NEWTON, which costs a fifth to a third more iterations. Not
# without numerical damping (gamma = 1/2): there the multipliers keep all that Newton leaves.
_NEWTON = 1e-5


@dataclass
class State(Step):
    """A state of the run.

    Attributes:
        t: Time in s.
        h: Step in s that s and the normal part of v belong to; 0: a consistent start, to none.
        power: Of the motors and of the damping, W, shape (2,).
    """

    t: float
    h: float
    power: Array


@dataclass(frozen=True)
class AlphaStep:
    """A step: the states at its ends, and the one before them for a parabola (or None).

    Attributes:
        h: Length in s.
        mean: Mean acceleration, shape (nv,).
        scale: Largest displacement so far.
        coarseness: Local error of the displacement over it.
    """

    before: State | None
    start: State
    end: State
    h: float
    mean: Array
    scale: float
    coarseness: float


class AlphaSteps:
    """Solves single steps of one run."""

    # A change of the step costs a tangent. In a vibration the error comes and goes twice a period:
    # steps that grew at once, or for less, would be refused as often.
    order, idle, memory = 3, (0.9, 1.6), 0.9

    def __init__(
        self,
        mechanism: Mechanism,
        dynamics: Equations,
        path: Path,
        t: tuple[float, float],
        scheme: AlphaScheme,
        resolution: float,
        drive: TorqueDrive | None = None,
        forces: bool = True,
        tolerance: float | None = None,
    ) -> None:
        """`t`: start and end of the run, s; `forces`: whether they matter (see `Stages`)."""
        if tolerance is None:
            tolerance = max(NEWTON, min(_NEWTON, resolution)) if scheme.gamma > 0.5 else NEWTON
        self.path, self.drive, self.dynamics, self.scheme = path, drive, dynamics, scheme
        self.march = March(mechanism, dynamics, path(np.array(t)), scheme, drive, tolerance, None)
        free = self.march.newton.free
        self.manifold = Manifold(dynamics, () if drive is not None else self.march.motors)
        self.by_energy, self.resolution = forces and dynamics.flexible, resolution
        self.measured = slice(dynamics.n_rigid, None) if dynamics.flexible else free
        self.error = scheme.beta + 0.5 * (scheme.alpha_m - scheme.alpha_f) - 1.0 / 6.0
        self.scale, self._origin = 0.0, np.zeros(0)

    @property
    def counts(self) -> dict[str, float]:
        """What the run has cost so far."""
        return {"newton": self.march.iterations, "tangents": self.march.newton.count}

    @property
    def settings(self) -> dict[str, object]:
        """The method, for reports."""
        return {"integrator": self.scheme.name, "gamma": self.scheme.gamma}

    def resolve(self, resolution: float) -> None:
        """Let steps be solved for a resolution from now on."""
        self.resolution = resolution

    def expire(self) -> None:
        """Let the next step begin with a new tangent."""
        self.march.slow = True

    def first(self, t: float, y: Array, v: Array) -> State:
        """Consistent accelerations, multipliers and torques at (y, v).

        Args:
            t: Time [s].
            y: Coordinates on the closures, shape (nq,).
            v: Velocity, shape (nv,).
        """
        self._between(t, self.march.h)
        now = self.march.first(y, v, 0)
        if not len(self._origin):
            self._origin = y
            self.march.set_scale(now, 0)
            d, rows = self.dynamics, self.measured
            self._weight = d.strain.stiffness if self.by_energy else d.mass(y)[rows][:, rows]
            # Positions are known to 1e-15 m or rad: no error is looked for below that.
            least = 1e-14 * float(np.sqrt(self._weight.trace())) / self.resolution
            self.scale = max(self.scale, least, 1e-300)
            self._kept = self.march.reference, self.march.peak
        return self._state(now, t, 0.0)

    def _between(self, t: float, h: float) -> None:
        """Let the march go from t to t + h: steps 0 and 1 of its path."""
        march = self.march
        march.path = self.path(np.array([t, t + h]))
        if h != march.h:
            march.set_step(h)
        if self.drive is not None:
            march.drive = replace(self.drive, feed_forward=self.drive.forward(march.path.t))

    def step(self, start: State, h: float, last: AlphaStep | None) -> AlphaStep:
        """The step of length h (s) from a state; the one before it predicts.

        Args:
            start: State at its beginning.
            h: Length [s].
            last: The step before it; None: there is none.
        Raises:
            StepFailed: Newton does not converge. LinAlgError: its matrix is singular.
        """
        march, before = self.march, None
        # A step that failed or was refused must not loosen Newton's tolerance, nor the error's.
        march.reference, march.peak = self._kept
        self._between(start.t, h)
        try:
            now: Step = start
            if start.h == 0.0:
                now = march.quiet_start(march.first(start.y, start.v, 0), 0)
            elif start.h != h:
                now = self._moved_along(start, h)
            a, lam = now.a.copy(), now.lam.copy()
            if last is not None:
                before, ratio = last.start, h / last.h
                a += ratio * (now.a - before.a)
                lam += ratio * (now.lam - before.lam)
            found = march.step(now, (a, lam), 1)
        except NoConvergence:
            raise StepFailed from None
        end = self._state(found, start.t + h, h)
        # h da/dt by the mean accelerations of two steps: what flips its sign from one step to the
        # next, as multipliers do where nothing damps them, is no error of the displacement.
        mean = (end.v - now.v) / h
        rise = end.a - now.a
        if last is not None:
            rise = (mean - last.mean) * (2.0 * h / (h + last.h))
        moves = np.array([self._displacement(start.y), self._displacement(end.y)])
        scale = max(self.scale, self._size(moves))
        coarse = self._size(self.error * h * h * rise[None]) / scale
        return AlphaStep(before, start, end, h, mean, scale, coarse)

    def _moved_along(self, start: State, h: float) -> Step:
        """A state whose s and normal part of v belong to steps of h (s)."""
        ratio, march, newton = h / start.h, self.march, self.march.newton
        s = start.a + ratio * (start.s - start.a)
        v = start.v.copy()
        if newton.rows:
            newton.refresh(start, start.t)
            march.slow = False
            # The iteration matrix at a scaled c moves v by J dv = -c / (beta h^2).
            J = self.dynamics.close(start.y).J
            c = (1.0 - ratio * ratio) * self.scheme.beta * h * h * (J @ v)
            v[newton.free] += newton.step(np.zeros(newton.n), c)[0]
        return Step(start.y, v, start.a, s, start.lam, start.torque)

    def _state(self, now: Step, t: float, h: float) -> State:
        power = np.array(
            [now.torque @ now.v[self.march.motors], self.dynamics.losses(now.y, now.v)]
        )
        return State(now.y, now.v, now.a, now.s, now.lam, now.torque, t, h, power)

    def _displacement(self, y: Array) -> Array:
        """Elastic coordinates of a pose, or without them its way from the first, shape (nv,)."""
        d = self.dynamics
        if not d.flexible:
            return d.difference(self._origin, y)
        return np.concatenate([np.zeros(d.n_rigid), y[d.nq_rigid :]])

    def _size(self, moves: Array) -> float:
        return largest(moves[:, self.measured], self._weight)

    def end(self, step: AlphaStep) -> State:
        """The state after a step that is accepted."""
        self.scale, self._kept = step.scale, (self.march.reference, self.march.peak)
        return step.end

    def works(self, steps: Sequence[AlphaStep]) -> Array:
        """Work of the motors and of the damping in each step, J, shape (k, 2)."""
        return np.array([0.5 * step.h * (step.start.power + step.end.power) for step in steps])

    def dense(self, steps: Sequence[AlphaStep], t: Array, of: IntArray) -> States:
        """States at times t (k,) in s, of (k,): the step that each lies in.

        Args:
            steps: Accepted steps.
            t: Times [s], shape (k,).
            of: Number of the step that each time lies in, shape (k,).
        """
        within = [self._within(steps[k], t[of == k]) for k in np.unique(of)]
        return States(*(np.concatenate(part) for part in zip(*within, strict=True)))

    def _within(self, step: AlphaStep, t: Array) -> States:
        """States at times within a step.

        Cubics through y and v, v and a (Hermite), of order 4; parabolas of order 3 through three
        states for what has no rate. On a manifold in exponential coordinates.
        """
        d, now, end, before, h = self.dynamics, step.start, step.end, step.before, step.h
        x = ((t - now.t) / h)[:, None]
        move, rate = d.difference(now.y, end.y), end.v
        if self.manifold.turning:
            rate = rate + self.manifold.turn(now.y, move[None], end.v[None])[0]
        y = self.manifold.retract(
            now.y, _hermite(x, np.zeros_like(move), h * now.v, move, h * rate)
        )
        v = _hermite(x, now.v, h * now.a, end.v, h * end.a)

        def between(name: str) -> Array:
            x0, x1 = getattr(now, name), getattr(end, name)
            rise = x1 - x0
            if before is not None:
                part = (now.t - before.t) / h
                bend = (rise - (x0 - getattr(before, name)) / part) / (1.0 + part)
                rise = rise + (x - 1.0) * bend
            return np.asarray(x0 + x * rise)

        a, lam, torque = between("a"), between("lam"), between("torque")
        if self.drive is None:
            path, motors = self.path(t), self.march.motors
            self.march.axes.write(y, path.position)
            v[:, motors], a[:, motors] = path.velocity, path.acceleration
        work = h * x * (now.power + 0.5 * x * (end.power - now.power))
        return States(y, v, a, lam, torque, work)


def _hermite(x: Array, y0: Array, d0: Array, y1: Array, d1: Array) -> Array:
    """Cubic through values and rates at 0 and 1, at x (k, 1)."""
    rise = y1 - y0
    return np.asarray(y0 + x * (d0 + x * (3 * rise - 2 * d0 - d1 + x * (d0 + d1 - 2 * rise))))
