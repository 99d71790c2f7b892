"""Closures and energy of a run in words, good, look or wrong, by one rule for everybody."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinflex.arrays import Array
from pinflex.integrators.run import Run

GOOD, LOOK, WRONG = "good", "look", "wrong"
# Loops open by these shares of the largest deflection say that deflections are not small, of which
# level ked knows nothing. Below 1e-9 m or rad there is nothing to see.
_OPEN, _SHUT = (0.05, 0.2), 1e-9
# Of the largest energy in play: a per cent or two is numerical damping, more is a wrong answer.
_ENERGY = (0.02, 0.05)


def grades(run: Run, arrays: Mapping[str, Array], balance: float | None) -> dict[str, str]:
    """Grades of "closure" and "energy" of a run, where there is something to say."""
    found = {}
    if run.system.closed.n:
        found["closure"] = GOOD if _gap(arrays) < _SHUT else _word(_open_share(run, arrays), _OPEN)
    marches = run.work is not None or run.path is not None
    if balance is not None and marches and len(run.t) > 4:
        found["energy"] = _word(balance - _unseen(run, arrays), _ENERGY)
    return found


def sentences(
    run: Run, arrays: Mapping[str, Array], balance: float, found: Mapping[str, str]
) -> list[str]:
    """One for each that is not good, with what to do."""
    texts, linear = [], run.path is not None
    if found.get("closure", GOOD) != GOOD:
        why, bent = "it is linear, and " if linear else "", 1e3 * _deflection(run, arrays)
        trust = "Trust coupled." if linear else "Take shorter steps."
        texts.append(
            f"leaves its loops open by up to {1e3 * _gap(arrays):.3g} mm ({found['closure']}): "
            f"{why}deflections of {bent:.3g} mm are not small here. {trust}"
        )
    if found.get("energy", GOOD) != GOOD:
        way = (
            "Trust coupled, or take smaller steps."
            if linear
            else "Use a smaller step (--set solve.dt=...), or less numerical damping."
        )
        texts.append(
            f"keeps the energy balance to {100 * balance:.2g} % only ({found['energy']}). {way}"
        )
    return texts


def _word(value: float, limits: tuple[float, float]) -> str:
    return GOOD if value <= limits[0] else LOOK if value <= limits[1] else WRONG


def _gap(arrays: Mapping[str, Array]) -> float:
    return float(np.max(np.abs(arrays["residual/closure"]), initial=0.0))


def _deflection(run: Run, arrays: Mapping[str, Array]) -> float:
    """Largest deflection of any link, m."""
    links = {slot.link for slot in run.system.expansion.slots}
    keys = [f"link/{link}/deflection" for link in links]
    return max((float(np.max(np.abs(arrays[k][:, :, :3]), initial=0.0)) for k in keys), default=0.0)


def _open_share(run: Run, arrays: Mapping[str, Array]) -> float:
    deflection = _deflection(run, arrays)
    return _gap(arrays) / deflection if deflection > 0 else 0.0


def _unseen(run: Run, arrays: Mapping[str, Array]) -> float:
    """Relative error of the work from the sampled power: by every other instant (trapezia)."""
    if run.work is not None:
        return 0.0
    power = np.sum(run.torque * run.v[:, run.system.motors], axis=1)

    def total(k: slice) -> float:
        return float(np.trapezoid(power[k], run.t[k]))

    even = len(power) - 1 - (len(power) - 1) % 2
    apart = abs(total(slice(0, even + 1)) - total(slice(0, even + 1, 2))) / 3.0
    parts = [
        float(np.ptp(arrays[f"energy/{k}"])) for k in ("kinetic", "gravity", "elastic", "work")
    ]
    return apart / max([*parts, 1e-15])
