"""Rates of the closures in a motion, of many states."""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.geometry import spans


def closure_motion(dynamics: Equations, Y: Array, V: Array, A: Array) -> tuple[Array, Array]:
    """First and second time derivatives of the closures, (n, rows) each.

    Args:
        dynamics: Workspace of the system.
        Y: Shape (n, nq).
        V, A: Shape (n, nv).
    """
    if (compiled := dynamics.compiled) is not None:
        return compiled.evaluator.closure_motion(Y, V, A)
    rate, second = (np.empty((len(Y), dynamics.system.closed.n)) for _ in range(2))
    for s in spans(len(Y)):
        J, gamma = dynamics.close(Y[s]).J, dynamics.closure_bias(Y[s], V[s])
        rate[s], second[s] = ((J @ x[s][:, :, None])[:, :, 0] for x in (V, A))
        second[s] += gamma
    return rate, second
