"""A motion: named coordinates and their rates as functions of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.cards import card, grid
from pinflex.description.laws import Kinematics
from pinflex.doors import door

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Motion:
    """A motion of named coordinates; `Motion("own", "joints", ("crank",), 2.0, law)` takes any law.

    Args:
        kind: One of `KINDS`, or any word for a law of your own.
        target: "joints" or "platform".
        names: Joints or platform coordinates, the columns of `evaluate`; empty: all motors rest.
        duration: Time the motion is meant for [s].
        law: t >= 0, shape (nt,), to position, velocity and acceleration, each (nt, n).
        absolute: Positions are values of the coordinates; else displacements from home.
        spec: The plain mapping from which `from_spec` rebuilds the motion.
        corners: Times [s] before the end at which some rate jumps: steps end there.
    """

    kind: str
    target: str
    names: tuple[str, ...]
    duration: float
    law: Callable[[Array], Kinematics] = field(repr=False, compare=False)
    absolute: bool = False
    spec: dict[str, Any] = field(default_factory=dict, repr=False, hash=False)
    corners: tuple[float, ...] = field(default=(), repr=False)

    @property
    def switches(self) -> tuple[float, ...]:
        """Times above 0 s at which a piece of the motion ends."""
        spec, end = self.spec, self.duration
        times = {end, float(spec.get("smooth", 0.0)), float(spec.get("ramp", 0.0)), *self.corners}
        if self.kind == "trapezoid":
            times.add(end - float(spec["ramp"]))
        return tuple(sorted(time for time in times if time > 0.0))

    def evaluate(self, t: Array) -> Kinematics:
        """Position, velocity, acceleration at times t [s], shape (nt,); at rest before t = 0.

        Returns: (rad | m), (rad/s | m/s), (rad/s^2 | m/s^2), each of shape (nt, len(names)).
        """
        t = np.atleast_1d(np.asarray(t, dtype=np.float64))
        moving = t >= 0.0
        if moving.all():
            return self.law(t)
        p, v, a = self.law(np.maximum(t, 0.0))
        moving = moving[:, None]
        return p, np.where(moving, v, 0.0), np.where(moving, a, 0.0)

    def __call__(self, t: Array | float) -> Array:
        """Positions [rad | m] at times t [s], (nt, n) for the n `names`; (n,) for a single time."""
        p = self.evaluate(np.asarray(t, dtype=np.float64).reshape(-1))[0]
        return p if np.ndim(t) else p[0]

    def plot(
        self, until: float | None = None, panel: str | None = None, ax: Axes | None = None
    ) -> Any:
        """Draw position, velocity and acceleration over time; returns the matplotlib axes.

        Args:
            until: End [s]; default: the duration.
            panel: One alone: "position", "velocity" or "acceleration".
            ax: Where to draw that; default: axes of a new figure.
        """
        return door("viewer.plot_motion", "plot_motion")(self, until, panel, ax)

    def _repr_html_(self) -> str:
        p, v, a = self.evaluate(np.linspace(0.0, self.duration, 401))
        rows = [
            [name, *(f"{np.abs(x[:, k]).max():.4g}" for x in (p, v, a))]
            for k, name in enumerate(self.names)
        ]
        heads = (self.target, "position", "velocity", "acceleration")
        return card(
            f"{self.kind} motion, {self.duration:g} s; largest, SI units", grid(heads, rows)
        )

    def shaped(
        self,
        kind: str,
        modes: Sequence[float] | float,
        damping: Sequence[float] | float = 0.0,
    ) -> Motion:
        """The motion convolved with an input shaper, so that vibrations cancel; it ends later.

        Args:
            kind: "zv", "zvd" or "ei".
            modes: Frequencies [Hz] to cancel, such as those of `pinflex.ringing`.
            damping: Damping ratios [-], one for each or one for all.
        Source: see `pinflex.description.shaping`.
        """
        from pinflex.description.shaping import shaped

        return shaped(self, kind, modes, damping)


def of_moves(kind: str, moves: Any, law: Any, n: dict[str, float]) -> Motion:
    """A motion of target, displacements by name and as an array, along a law with numbers n."""
    target, by_name, _ = moves
    spec = {"kind": kind} | ({target: by_name} if by_name else {}) | n
    return Motion(kind, target, tuple(by_name), n["duration"], law, False, spec)
