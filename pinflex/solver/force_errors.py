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
from pinflex.mechanics import workspace
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.links import resultants
from pinflex.recovery.samples import Samples
from pinflex.recovery.stress import stresses
from pinflex.threads import one_blas_thread

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
        a, b = (Samples(mechanism, run) for run in pair)
        with one_blas_thread(), workspace.keep_alive():
            found = _differences(a, b)
        return {key: max(e / gain, ROUND_OFF) for key, e in found.items()}

    return told


def _differences(a: Samples, b: Samples) -> dict[str, float]:
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


def _quantities(samples: Samples) -> list[tuple[str, Array]]:
    """What is compared, with the output that it belongs to."""
    mechanism, found = samples.mechanism, list[tuple[str, Array]]()
    if mechanism.parts:
        forces = resultants(samples)
        cut = np.concatenate([*forces.values()], axis=1)
        sections = {name: mechanism.parts[name].spec.section for name in forces}
        every = [stresses(sections[name], force)["von_mises"] for name, force in forces.items()]
        found = [("stress", np.concatenate(every, axis=1))]
        found += [("section forces", cut[:, :, s]) for s in _PARTS]
    if platform := mechanism.description.platform:
        moved = samples.kinematics.arrays[f"frame/{platform}/acceleration"][:, :3]
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
