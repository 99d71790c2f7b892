"""What a level hands over: the states of a system over time, before anything is recovered."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.actuation.feedback import Signals
    from pinflex.actuation.nominal import Nominal
    from pinflex.mechanics.model.system import System


class Settings(TypedDict, total=False):
    """What a level used for a run; the file of a result has the same keys.

    integrator: "radau", or the name of a scheme or a stepper; stages: of collocation.
    dt: Step [s]; of steps that follow the motion their mean. steps: "given" where these are.
    scale: Largest displacement, in the norm of the steps. gamma: Of the alpha family.
    march: Who takes the steps, where that costs time. terms: "structural" or "full", of level ked.
    start: Where it started: straight, static, ... drive: "prescribed" or "torque".
    tol: Tolerance. error: Estimated error by output. judged: By what.
    events: Contacts. clearances: Of pins, by name [m].
    statistics: Of runs that part, by motor. share: Multipliers of shared torques.
    interpolated: Error of torques between steps [N m | N].
    """

    integrator: str
    stages: int
    dt: float
    steps: str
    scale: float
    gamma: float
    march: str
    terms: str
    start: str
    drive: str
    tol: float
    error: dict[str, float]
    judged: str
    events: list[dict[str, Any]]
    clearances: dict[str, float]
    statistics: dict[str, Any]
    share: dict[str, Any]
    interpolated: float


@dataclass(frozen=True)
class Run:
    """States of one system over time.

    Attributes:
        system: The system that was solved.
        t: Times, shape (nt,).
        y: Coordinates [q; eta], shape (nt, nq). v, a: Shape (nt, nv).
        lam: Multipliers of the independent closure rows, shape (nt, rows).
        torque: Motor torques (N m | N), shape (nt, nm).
        cost: Counts (steps, newton, tangents, ...).
        settings: What the level used.
        work: Energy put in by the motors and taken by damping, shape (nt, 2), or None.
        warnings: Plain sentences.
        signals: What a control measured and drove, or None.
        path: The nominal motion that a linear run deviates from, or None.
        settle: Solves the equations at the samples for accelerations and multipliers, which steps
            longer than the samples have less accurately; None: they are solved.
        judged: Finds estimated errors of forces and stresses, by output; None: not estimated.
        s: Algorithmic accelerations of the alpha family, shape (nt, nv), to go on from; or None.
    """

    __repr__ = brief

    system: System
    t: Array
    y: Array
    v: Array
    a: Array
    lam: Array
    torque: Array
    cost: dict[str, float]
    settings: Settings = field(default_factory=Settings)
    work: Array | None = None
    warnings: tuple[str, ...] = ()
    signals: Signals | None = None
    path: Nominal | None = None
    s: Array | None = None
    settle: Callable[[Run], Run] | None = None
    judged: Callable[[], Mapping[str, float]] | None = None

    def at(self, k: slice | IntArray) -> Run:
        """Some of its instants."""
        return replace(
            self, t=self.t[k], y=self.y[k], v=self.v[k], a=self.a[k], lam=self.lam[k],
            torque=self.torque[k], work=None if self.work is None else self.work[k],
            path=None if self.path is None else self.path.at(k),
            signals=None if self.signals is None else self.signals.at(k),
            s=None if self.s is None else self.s[k],
        )  # fmt: skip

    @property
    def linear(self) -> bool:
        """Whether forces are linear in the deviation: those of the undeformed mechanism."""
        return self.path is not None and self.settings.get("terms") == "structural"

    def acting(self, k: int) -> tuple[Array, Array]:
        """Pose and velocity at which forces are evaluated: the nominal ones of a linear run."""
        if self.path is None or not self.linear:
            return self.y[k], self.v[k]
        elastic = np.zeros(self.system.n_eta)
        return np.concatenate([self.path.q[k], elastic]), np.concatenate([self.path.v[k], elastic])
