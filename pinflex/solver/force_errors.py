"""How far two runs of one system differ in what follows from accelerations: forces and stresses.

Stress and section forces relative to their largest values, all sections of all links together; the
acceleration of the platform likewise. They take a pass over the samples: few are looked at, and
only where strain differs enough, or somebody asks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache

import numpy as np

from pinflex.arrays import Array
from pinflex.integrators.run import Run
from pinflex.levels.outputs import ROUND_OFF
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.recover import result_of
from pinflex.results.result import Result

_SAMPLES = 51  # as poses are compared at
_PARTS = slice(0, 3), slice(3, 6)  # of section forces: N, N m

Told = Callable[[], Mapping[str, float]]


def force_errors(mechanism: Mechanism, coarse: Run, fine: Run, gain: float) -> Told:
    """Function that finds the estimated errors, once.

    Args:
        mechanism: Mechanism that was solved.
        coarse, fine: Runs with the same samples; the second is the reference.
        gain: What their difference is divided by.
    """
    every = slice(None, None, -(-len(fine.t) // _SAMPLES))
    pair = coarse.at(every), fine.at(every)

    @cache
    def told() -> dict[str, float]:
        a, b = (result_of(mechanism, run, lambda: None, "coupled", {}, "") for run in pair)
        return {key: max(e / gain, ROUND_OFF) for key, e in differences(a, b).items()}

    return told


def differences(a: Result, b: Result) -> dict[str, float]:
    """Largest differences of stress, section forces and the platform's acceleration, relative.

    Forces and moments of a section have scales of their own.

    Args:
        a: Judged. b: By this one, at the same instants and sections.
    """
    mine, theirs = (_quantities(x) for x in (a, b))
    found: dict[str, float] = {}
    for (key, x), (_, y) in zip(mine, theirs, strict=True):
        scale = float(np.max(np.abs(y), initial=0.0))
        if scale > 0.0:
            apart = float(np.max(np.abs(x - y), initial=0.0)) / scale
            found[key] = max(found.get(key, 0.0), apart)
    return found


def _quantities(result: Result) -> list[tuple[str, Array]]:
    """What is compared, with the output that it belongs to."""
    found, links = list[tuple[str, Array]](), [result.link(name) for name in result.links]
    if links:
        cut = np.concatenate([link.resultant for link in links], axis=1)
        stress = np.concatenate([link.von_mises for link in links], axis=1)
        found = [("stress", stress), *(("section forces", cut[:, :, s]) for s in _PARTS)]
    if platform := result.meta.get("platform"):
        moved = result.array(f"frame/{platform}/acceleration")[:, :3]
        found.append(("platform acceleration", moved))
    return found


def strain_apart(coarse: Run, fine: Run) -> float:
    """Difference of two runs in the energy of strain, its root relative to the largest."""
    n, m = int(fine.system.rigid.nq), int(fine.system.rigid.nv)
    K = fine.system.K[m:, m:]

    def size(eta: Array) -> float:
        energy = np.einsum("ki,ij,kj->k", eta, K, eta, optimize=True)
        return float(np.sqrt(np.max(np.maximum(energy, 0.0), initial=0.0)))

    whole = size(fine.y[:, n:])
    return size(coarse.y[:, n:] - fine.y[:, n:]) / whole if whole > 0.0 else 0.0
