"""Section forces from strains, and the stress that they give: the source's way, for comparison.

Source: Liu et al. (2017), J. Cent. South Univ. 24, eqs. 27 to 30.
"""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.kinematics import run_of
from pinflex.results.result import Result


def strain_forces(mechanism: Mechanism, result: Result, link: str) -> Array:
    """N, Vy, Vz, T, My, Mz from the strains of the shapes (V left zero), shape (nt, nx, 6).

    N = EA u', T = GJ p', My = -EIy w'', Mz = EIz v'': equal to the balance where the shapes have
    converged. Directions in which the link does not deform stay zero.

    Args:
        mechanism: The mechanism that was solved.
        result: A flexible run.
        link: Flexible link.
    """
    run = run_of(mechanism, result)
    part, x = mechanism.parts[link], result.link(link).x
    E, G, S = part.spec.material.E, part.spec.material.G, part.spec.section
    gains = {"axial": (0, E * S.A), "twist": (3, G * S.J)}
    gains |= {"curvature_w": (4, -E * S.Iy), "curvature_v": (5, E * S.Iz)}
    out = np.zeros((len(run.t), len(x), 6))
    slots = [s for s in run.system.expansion.slots if s.link == link]
    for slot in slots:
        eta = run.y[:, int(run.system.rigid.nq) :][:, slot.eta]
        local = x - slot.offset
        inside = np.flatnonzero((local >= -1e-12) & (local <= slot.body.length * (1 + 1e-12)))
        fields = slot.body.fields(np.clip(local[inside], 0.0, slot.body.length))
        for name, (column, gain) in gains.items():
            if name in fields:
                out[:, inside, column] = gain * eta @ fields[name].T
    return out
