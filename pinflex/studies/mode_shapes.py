"""Shapes of modes as runs of one period, so that the player can show them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.actuation.nominal import Nominal
from pinflex.errors import DescriptionError
from pinflex.integrators.run import Run
from pinflex.levels.modes import Modes
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.meta import describe
from pinflex.recovery.recover import recover
from pinflex.results.result import Result
from pinflex.viewer.plots.shapes import shape_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_INSTANTS = 41  # of one period: smooth on the screen
_SWING = 1e-3  # [rad | m] largest coordinate of the drawn motion: small, so shapes stay linear


def mode_runs(mechanism: Mechanism, found: Modes) -> list[tuple[float, Result]]:
    """Each oscillating mode as (frequency [Hz], one period of its motion).

    Displacements are measured from the pose that was linearised about, sag included; fields that a
    shape without size does not have (stress, forces) are left out.
    """
    dynamics = Equations(mechanism.flexible)
    return [
        (float(f), _run(mechanism, dynamics, found, k, float(f)))
        for k, f in enumerate(found.frequencies)
        if f > 0
    ]


def plot_shape(found: Modes, mode: int, ax: Axes | None = None) -> Any:
    """Axes with the shape of one mode as lines, at both ends of its swing."""
    count = len(found.frequencies)
    if found.mechanism is None or found.growth is not None:
        why = "modes about a motion turn" if found.mechanism else "these modes know no mechanism"
        raise DescriptionError(f"modes.plot: {why}, so there is no one shape to draw.")
    if isinstance(mode, bool) or not isinstance(mode, int | np.integer) or not 1 <= mode <= count:
        raise DescriptionError(f"modes.plot: mode {mode!r:.80}. Allowed: 1 to {count}.")
    frequency = float(found.frequencies[mode - 1])
    dynamics = Equations(found.mechanism.flexible)
    period = 1.0 / abs(frequency) if frequency else 1.0
    run = _run(found.mechanism, dynamics, found, int(mode) - 1, 1.0 / period)
    heading = f"{found.mechanism.name}, mode {mode}: {frequency:.4g} Hz"
    return shape_axes(run, heading, ax)


def _run(
    mechanism: Mechanism, dynamics: Equations, found: Modes, k: int, frequency: float
) -> Result:
    system = dynamics.system
    t = np.linspace(0.0, 1.0 / frequency, _INSTANTS)
    swing = np.sin(2 * np.pi * frequency * t)
    shape = found.shapes[:, k] * (_SWING / np.max(np.abs(found.shapes[:, k])))
    y = np.array([dynamics.integrate(found.y, s * shape) for s in swing])
    still = np.zeros((len(t), system.nv))
    run = Run(
        system, t, y, still, still, np.zeros((len(t), system.closed.n)),
        np.zeros((len(t), len(system.motors))), {},
    )  # fmt: skip
    q = np.tile(found.y[: int(system.rigid.nq)], (len(t), 1))
    empty = np.zeros((len(t), int(system.rigid.nv)))
    arrays = recover(mechanism, run, Nominal(t, q, empty, empty))
    known = describe(mechanism, run, "coupled", {}, "")
    meta = {key: find() for key, find in known.items()}
    meta |= {"warnings": [], "limits": [], "monitors": {}, "energy_balance": None}
    drawn = {
        key: value
        for key, value in arrays.items()
        if key.startswith(("joint/q", "frame/", "body/", "link/"))
        and not key.endswith(("resultant", "/velocity", "/acceleration", "von_mises"))
        and "/stress/" not in key
    }
    # the pose at t = 0 is the one linearised about: the drawing's "undeformed"
    for key in list(drawn):
        moving = key.replace("centreline_rigid", "centreline").replace("pose_rigid", "pose")
        if moving != key:
            drawn[key] = np.broadcast_to(drawn[moving][:1], drawn[moving].shape)
    return Result(t, drawn, meta)
