"""Interface of a one-step method for adaptive marching."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from pinflex.actuation.drive import MotorPath
from pinflex.arrays import Array, IntArray
from pinflex.mechanics.equations import Equations

Path = Callable[[Array], MotorPath]


class StepFailed(Exception):
    """Newton did not converge in a step: a shorter one may."""


class States(NamedTuple):
    """States at k instants, as they are recorded.

    Attributes:
        y: Shape (k, nq). v, a: Shape (k, nv). lam: Shape (k, rows). torque: Shape (k, nm).
        work: Of the motors and of the damping since the start of the step, J, shape (k, 2).
    """

    y: Array
    v: Array
    a: Array
    lam: Array
    torque: Array
    work: Array


class Recorded(Protocol):
    """What a record asks of the equations that steps were solved by."""

    dynamics: Equations

    def dense(self, steps: Sequence[Any], t: Array, of: IntArray) -> States:
        """States at times t (k,) in s, of (k,): the step that each lies in.

        Args:
            steps: Accepted steps.
            t: Times [s], shape (k,).
            of: Number of the step that each time lies in, shape (k,).
        """

    def works(self, steps: Sequence[Any]) -> Array:
        """Work of the motors and of the damping in each step, J, shape (k, 2)."""


class Steps(Recorded, Protocol):
    """Single steps of one run, by one method.

    Its states have t, y, v, a, lam and torque; its steps start, h and coarseness, the error
    estimate that the resolution of a run bounds.

    Attributes:
        dynamics: Workspace of the run.
        idle: Factors on h between which a change does not pay.
        scale: Largest displacement of the run so far.
    """

    idle: tuple[float, float]
    scale: float

    @property
    def order(self) -> int:
        """Power of h that the coarseness falls with."""

    @property
    def counts(self) -> dict[str, float]:
        """What the run has cost so far."""

    @property
    def settings(self) -> dict[str, object]:
        """The method, for reports."""

    def first(self, t: float, y: Array, v: Array) -> Any:
        """Consistent accelerations, multipliers and torques at (y, v).

        Args:
            t: Time [s].
            y: Coordinates on the closures, shape (nq,).
            v: Velocity, shape (nv,).
        """

    def step(self, start: Any, h: float, last: Any) -> Any:
        """The step of length h (s) from a state; the one before it, or None, predicts.

        Args:
            start: State at its beginning.
            h: Length [s].
            last: The step before it; None: there is none.
        """

    def end(self, step: Any) -> Any:
        """The state after a step."""

    def resolve(self, resolution: float) -> None:
        """Let steps be solved for a resolution from now on."""

    def expire(self) -> None:
        """Let the next step begin with a new tangent."""


def largest(moves: Array, weight: Array) -> float:
    """Largest norm of displacements (k, n) in a weight (n, n).

    Args:
        moves: Displacements, shape (k, n).
        weight: Symmetric and positive, shape (n, n).
    """
    # Few numbers: a list of them is quicker than arrays.
    squares = np.add.reduce(moves.dot(weight) * moves, axis=1).tolist()
    square, total = max(squares, default=0.0), sum(squares)
    if not total < math.inf:
        return math.inf if total > 0.0 else math.nan
    return math.sqrt(square) if square > 0.0 else abs(square)
