"""Closures in a motion, and their rates, of many states."""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.geometry import spans


def closure_motion(dynamics: Equations, Y: Array, V: Array, A: Array) -> Array:
    """Closures, and their first and second time derivatives, shape (3, n, rows).

    Args:
        dynamics: Workspace of the system.
        Y: Shape (n, nq).
        V, A: Shape (n, nv).
    """
    if (compiled := dynamics.compiled) is not None:
        return compiled.evaluator.closure_motion(Y, V, A)
    found = np.empty((3, len(Y), dynamics.system.closed.n))
    for s in spans(len(Y)):
        found[0, s], J = dynamics.close(Y[s])
        found[1, s], found[2, s] = ((J @ x[s][:, :, None])[:, :, 0] for x in (V, A))
        found[2, s] += dynamics.closure_bias(Y[s], V[s])
    return found
