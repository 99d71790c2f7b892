"""Central differences and log-log slopes: the two rulers of these tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.model.system import System

# Two central differences, at h and h/2, extrapolated: h^4 f5/480 and round-off over h are both
# below 1e-11 of functions of order one.
STEP = 4e-4


def _central(f: Callable[[float], Array], h: float) -> Array:
    def difference(h: float) -> Array:
        return np.asarray((np.array(f(h)) - np.array(f(-h))) / (2 * h))

    return np.asarray((4 * difference(h / 2) - difference(h)) / 3)


def by_configuration(d: Equations, f: Callable[[Array], Array], y: Array) -> Array:
    """df/dy along every velocity row at y, shape (len(f), nv)."""
    rows = np.eye(d.system.nv)
    return np.array([_central(lambda h, e=e: f(d.integrate(y, h * e)), STEP) for e in rows]).T


def by_vector(f: Callable[[Array], Array], v: Array) -> Array:
    """df/dv of a function at most quadratic in v, for which a step of one is exact."""
    return np.array([(f(v + e) - f(v - e)) / 2 for e in np.eye(len(v))]).T


def by_speed(f: Callable[[Array], Array], v: Array) -> Array:
    """df/dv of any function of v, shape (len(f), nv)."""
    return np.array([_central(lambda h, e=e: f(v + h * e), STEP) for e in np.eye(len(v))]).T


def by_time(
    d: Equations, f: Callable[[Array, Array], Array], y: Array, v: Array, a: Array
) -> Array:
    """df/dt along the motion with constant acceleration a through (y, v)."""
    return _central(lambda t: f(d.integrate(y, t * v + 0.5 * t * t * a), v + t * a), STEP)


def random_state(system: System, home: Array, seed: int) -> tuple[Array, Array, Array, Array]:
    """y, v, a, lam of size one; links bend by a few per cent of a metre-size span."""
    rng = np.random.default_rng(seed)
    d = Equations(system)
    n = int(system.rigid.nv)
    size = np.ones(system.nv)
    size[n:] = 0.02
    y = d.integrate(home, 0.5 * size * rng.uniform(-1, 1, system.nv))
    v, a = (size * rng.uniform(-1, 1, system.nv) for _ in range(2))
    return y, v, a, rng.uniform(-1, 1, system.closed.n)


def close(found: Array, expected: Array, relative: float) -> None:
    """Columns agree to a fraction of their own largest entry (rows may have other units)."""
    scale = np.maximum(np.abs(expected).max(axis=0), np.abs(found).max(axis=0))
    scale = np.maximum(scale, 1e-3 * np.max(scale, initial=1e-300))
    error = np.abs(found - expected) / scale
    assert np.max(error, initial=0.0) < relative, np.argwhere(error >= relative)[:5]


def slope(x: Sequence[float] | Array, y: Sequence[float] | Array) -> float:
    """Exponent p of y = c x^p by least squares on logarithms."""
    return float(np.polyfit(np.log(np.asarray(x, float)), np.log(np.asarray(y, float)), 1)[0])
