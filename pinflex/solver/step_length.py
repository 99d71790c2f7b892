"""Step of a run that neither the YAML nor a tolerance says."""

from __future__ import annotations

from pinflex.levels.modes import modes
from pinflex.mechanics.mechanism import Mechanism


def default_step(mechanism: Mechanism, end: float) -> float:
    """Step from the scene: 1/40 of the third mode's period, at least 400 steps a run."""
    step = end / 400.0
    if not mechanism.compliant:
        return step
    found = modes(mechanism, count=9, preload="none").frequencies
    alive = found[found > 0]
    if not len(alive):
        return step
    third = float(alive[min(2, len(alive) - 1)])
    return min(step, 1.0 / (40.0 * third))
