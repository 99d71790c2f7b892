"""Richardson's extrapolation: what runs of several fineness say about an infinitely fine one."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pinflex.arrays import Array


def extrapolated(sizes: Sequence[float], values: Sequence[Array], order: int) -> Array:
    """Value at size 0 of the polynomial x + a h^order + b h^(order + 1) + ... through all runs.

    Source: Richardson (1911); rows that use it say "extrapolated from" and the sizes.
    """
    h = np.asarray(sizes, float) / max(sizes)
    powers = np.append(0, order + np.arange(len(h) - 1))
    weights = np.linalg.inv(h[:, None] ** powers)[0]
    return np.asarray(np.tensordot(weights, np.array(values), 1))


def by_step(run: Callable[[float], Array], steps: Sequence[float]) -> tuple[Array, Array]:
    """What `run` gives with the finest of several steps, and extrapolated (order 2)."""
    values = [run(h) for h in steps]
    return values[int(np.argmin(steps))], extrapolated(steps, values, 2)


def by_count(run: Callable[[int], Array], counts: Sequence[int], order: int) -> Array:
    """What `run` gives with 1/count extrapolated to zero."""
    return extrapolated([1.0 / n for n in counts], [run(n) for n in counts], order)
