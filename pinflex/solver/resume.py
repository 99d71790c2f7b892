"""Going on with a stopped or partial run from its last stored state."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError
from pinflex.integrators.plain.alpha import Step
from pinflex.integrators.problem import Run, Settings, states_of
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.result import Result

_SAME = 1e-6  # relative: two steps, two residuals


def stored(mechanism: Mechanism, result: Result) -> Run:
    """The run that a result was made of.

    Raises:
        DescriptionError: It is of another level or model.
    """
    system, name = mechanism.loose, mechanism.name
    a = result.arrays
    if result.level != "coupled" or result.meta["settings"].get("integrator") == "radau":
        raise DescriptionError(
            f"{name}: resume: a run of level {result.level} with "
            f"{result.meta['settings'].get('integrator', 'no integrator')}. Only runs of level "
            "coupled with a step (dt) carry a state to go on from: solve again."
        )

    s, settings = result.meta.get("resume"), result.meta["settings"]
    settings = {**settings, "dt": float(settings["dt"])}
    run = Run(
        system, result.t, *states_of(result), a["multiplier"], a["torque"],
        {k: float(n) for k, n in result.meta["cost"].items() if "seconds" not in k},
        cast("Settings", settings),
        np.column_stack([a["energy/work"], a["energy/dissipated"]]),
        s=None if s is None else np.array([s]),
    )  # fmt: skip
    rates = [run.v, run.a] if run.s is None else [run.v, run.a, run.s]
    widths = [x.shape[-1] for x in (run.y, run.lam, run.torque, *rates)]
    wanted = [system.nq, system.closed.n, len(system.motors)] + [system.nv] * len(rates)
    if widths != wanted or not _balanced(run):
        raise DescriptionError(
            f"{name}: resume: the stored state at t = {run.t[-1]:g} s is not one of this model. "
            "Give the model, overrides and loads that the run was made with."
        )
    return run


def _balanced(run: Run) -> bool:
    """Whether the last state satisfies the equations of motion and the closures."""
    dynamics, system = Equations(run.system), run.system
    y, v, a, lam = run.y[-1], run.v[-1], run.a[-1], run.lam[-1]
    r, c = dynamics.residual(y, v, a, lam, float(run.t[-1]))
    open_by = float(np.max(np.abs(c), initial=0.0))
    inertia = dynamics.mass(y, float(run.t[-1])) @ a
    scale = max(float(np.max(np.abs(x), initial=0.0)) for x in (inertia, r, run.torque[-1]))
    left = np.append(r[system.free], r[system.motors] - run.torque[-1])
    return open_by < _SAME and float(np.max(np.abs(left))) <= 1e-3 * max(scale, 1e-9)


def grid(run: Run, end: float, name: str) -> Array:
    """Samples from 0 to end (s) that go on with those of a run."""
    if len(run.t) < 2 or end <= run.t[-1]:
        raise DescriptionError(
            f"{name}: resume: the stored run has {len(run.t)} instant(s) up to t = "
            f"{run.t[-1]:g} s and until is {end:g} s. Give at least two, and a later end."
        )
    spacing = float(run.t[-1]) / (len(run.t) - 1)
    count = round(end / spacing)
    if abs(count * spacing - end) > _SAME * spacing:
        raise DescriptionError(
            f"{name}: resume: the stored run has an instant every {spacing:.6g} s, of which "
            f"until = {end:g} s is no multiple. Take {count * spacing:.6g} s."
        )
    return np.linspace(0.0, end, count + 1)


def state(run: Run, h: float) -> Step | None:
    """The last state, if steps of h (s) go on with it; else they start from its y and v anew.

    The algorithmic acceleration s belongs to one step size; without it a consistent start differs
    from the uninterrupted run by the O(h^2) of its error.
    """
    if run.s is None or abs(h / run.settings["dt"] - 1.0) > _SAME:
        return None
    parts = (run.y, run.v, run.a, run.s, run.lam, run.torque)
    return Step(*(part[-1].copy() for part in parts))


def join(first: Run, rest: Run) -> Run:
    """Two runs of which the second starts where the first ends."""
    worked = np.zeros((len(first.t), 2)) if first.work is None else first.work
    work = None if rest.work is None else np.concatenate([worked[:-1], worked[-1] + rest.work])

    def both(x: Array, y: Array) -> Array:
        return np.concatenate([x[:-1], y])

    return replace(
        rest, t=both(first.t, rest.t), y=both(first.y, rest.y), v=both(first.v, rest.v),
        a=both(first.a, rest.a), lam=both(first.lam, rest.lam), work=work,
        torque=both(first.torque, rest.torque),
        cost={key: count + first.cost.get(key, 0.0) for key, count in rest.cost.items()},
    )  # fmt: skip
