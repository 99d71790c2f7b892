"""The equal steps of the coupled level one by one, with motors led or pushed from outside."""

from __future__ import annotations

import numpy as np

from pinflex.actuation.drive import TorqueDrive
from pinflex.actuation.path import MotorPath
from pinflex.arrays import Array
from pinflex.integrators.collocation import AlphaScheme
from pinflex.integrators.equal_steps import NEWTON, CompiledAlpha
from pinflex.integrators.plain.alpha import MAX_ITERATIONS, Step
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.text import frozen


@frozen
class Bounds:
    """What a step may cost, and where motors stop.

    Attributes:
        iterations: Of Newton's method in a step at the most.
        tangents: New ones in a step at the most; 0: as many as it takes, as `pf.solve`.
        every: Steps between two tangents at the most; 0: a new one where iterations are slow.
        stops: Lowest and highest positions of the motors (rad | m), shape (nm,) each.
    """

    iterations: int = MAX_ITERATIONS
    tangents: int = 1
    every: int = 0
    stops: tuple[Array, Array] | None = None


class Engine:
    """The steps of one mechanism; instant 0 is where one begins, instant 1 where it goes to.

    Attributes:
        path: Motion of the motors at the two instants, written before a step.
        torque: What pushes motors that are not led (N m | N), shape (2, nm).
        scale: Shares of the loads at the two instants, shape (2, forces).
        found: y, v, a, s, lam, torque and power at the two instants, shapes (2, n).
        march: The steps, compiled.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        dynamics: Equations,
        scheme: AlphaScheme,
        h: float,
        led: bool,
        bounds: Bounds,
    ) -> None:
        self.bounds, nm = bounds, len(dynamics.system.motors)
        self.path = MotorPath(np.array([0.0, h]), *np.zeros((3, 2, nm)))
        self.torque, none = np.zeros((2, nm)), np.zeros(nm)
        drive = None if led else TorqueDrive(none, none, self.torque, lambda t: self.torque[:1])
        march = CompiledAlpha(mechanism, dynamics, self.path, scheme, drive, NEWTON, None)
        march.limit(bounds.tangents, bounds.every, bounds.iterations, bounds.stops)
        self.march, self.found, self.scale = march, march.columns, march.rows[3]
        self.take = march.marcher(1, 1)

    def shares(self, t: float) -> None:
        """Let loads that vary in time act in the next step as at t (s)."""
        self.scale[1] = self.march.stages.evaluator.scale((t,))[0]

    def begin(self, t: float, now: Step, anew: bool) -> None:
        """Go on from a state at t (s); `anew`: with speeds that let multipliers start quietly."""
        self.path.t[:] = t, t + self.march.h
        self._put(now)
        march, at = self.march, self.march.at
        march.forget()
        at.reference = march.scale(0)
        if anew and march.dynamics.looped:
            at.allowed = 0  # the steps of a start are not those of the loop
            now = march.quiet(now, march.step(1, now, now), 0)
            at.allowed, at.age = self.bounds.tangents, 0
        self._put(now)
        march.begin(now, now)

    def _put(self, now: Step) -> None:
        for column, value in zip(self.found, now, strict=False):
            column[:] = value

    @property
    def stopped(self) -> int:
        """The motor that would have passed its stop in the last step, or -1."""
        return int(self.march.at.stopped)

    def kept(self) -> Step:
        """Where the last step ended."""
        return Step(*(column[1].copy() for column in self.found[:6]))
