"""How far two runs of one system differ in what follows from accelerations: forces and stresses.

Stress and section forces relative to their largest values, all sections of all links together; the
acceleration of the platform likewise. They take a pass over the samples: few are looked at, those
that differ most, and only where strain differs enough, or somebody asks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.integrators.run import Run
from pinflex.levels.outputs import ROUND_OFF
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.links import resultants
from pinflex.recovery.samples import Samples
from pinflex.recovery.stress import stresses
from pinflex.threads import one_blas_thread

_SAMPLES = 51  # the worst of so many pieces
_PARTS = slice(0, 3), slice(3, 6)  # of section forces: N, N m

Told = Callable[[], Mapping[str, float]]


def force_errors(mechanism: Mechanism, coarse: Run, fine: Run, gain: float) -> Told:
    """Function that finds the estimated errors, once."""

    @cache
    def told() -> dict[str, float]:
        some = _worst(coarse, fine)
        a, b = (Samples(mechanism, run.at(some)) for run in (coarse, fine))
        with one_blas_thread():
            found = _differences(a, b)
        return {key: max(e / gain, ROUND_OFF) for key, e in found.items()}

    return told


def _differences(a: Samples, b: Samples) -> dict[str, float]:
    """Largest differences of stress, section forces and the platform's acceleration, relative.

    Forces and moments of a section have scales of their own.
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
    if samples.run.system.expansion.slots:  # a rigid run has none
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


def _worst(coarse: Run, fine: Run) -> IntArray:
    """Of samples in a row the one at which elastic forces, or what they accelerate, differ most."""
    every, m = np.arange(len(fine.t)), int(fine.system.rigid.nv)
    if len(every) <= _SAMPLES or not fine.system.n_eta:
        return every[:: -(-len(every) // _SAMPLES)]
    M = Equations(fine.system).mass(fine.y[0])[m:, m:]
    squares = _squares(fine, coarse.y - fine.y, M)
    size = np.max(squares / np.maximum(squares.max(axis=1, keepdims=True), 1e-300), axis=0)
    return np.array([row[np.argmax(size[row])] for row in np.array_split(every, _SAMPLES)])


def elastic_apart(coarse: Run, fine: Run, mass: Array) -> tuple[float, float]:
    """Difference of two runs in strain, and in what elastic forces accelerate; of the largest."""
    m = int(fine.system.rigid.nv)
    apart, whole = (
        _squares(fine, y, mass[m:, m:]).max(axis=1, initial=0.0) ** 0.5
        for y in (coarse.y - fine.y, fine.y)
    )
    strain, force = (float(x / y) if y > 0.0 else 0.0 for x, y in zip(apart, whole, strict=True))
    return strain, force


def _squares(run: Run, y: Array, M: Array) -> Array:
    """Energy of strain, and its forces squared over the mass M (n_eta, n_eta), shape (2, nt)."""
    m, eta = int(run.system.rigid.nv), y[:, int(run.system.rigid.nq) :]
    force = eta @ run.system.K[m:, m:]
    lifted = np.linalg.lstsq(M, force.T, rcond=1e-13)[0].T  # coordinates may have no mass
    return np.abs([np.einsum("ki,ki->k", force, x) for x in (eta, lifted)])
