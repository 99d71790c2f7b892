"""Closed forms of beams, and shooting on the exact rod, for the tests to compare with.

omega = b^2 sqrt(E I / (m L^4)); every beam in these tests has L = m = E I = 1, so omega = b^2.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

from pinflex.arrays import Array


def _clamped_free(b: float) -> float:
    return float(1 + np.cos(b) * np.cosh(b)) / np.cosh(b)


def _clamped_clamped(b: float) -> float:
    return float(1 - np.cos(b) * np.cosh(b)) / np.cosh(b)


def _clamped_pinned(b: float) -> float:
    return float(np.sin(b) - np.cos(b) * np.tanh(b))


def _pinned_pinned(b: float) -> float:
    return float(np.sin(b))


EQUATIONS: dict[str, Callable[[float], float]] = {
    "clamped_free": _clamped_free,
    "clamped_clamped": _clamped_clamped,
    "clamped_pinned": _clamped_pinned,
    "pinned_pinned": _pinned_pinned,
}


def _roots(equation: Callable[[float], float], count: int) -> Array:
    found: list[float] = []
    grid = np.arange(0.2, 4.0 * (count + 2), 0.05)
    values = [equation(b) for b in grid]
    for a, b, fa, fb in zip(grid[:-1], grid[1:], values[:-1], values[1:], strict=True):
        if fa * fb < 0 and len(found) < count:
            found.append(brentq(equation, a, b, xtol=1e-14))
    return np.array(found)


def wave_numbers(ends: str, count: int = 4) -> Array:
    """b of a beam with the given ends."""
    return _roots(EQUATIONS[ends], count)


def hub(inertia: float, count: int = 4) -> Array:
    """b of a beam on a torque-free hub of inertia Ih/(m L^3), without the zero."""

    def equation(b: float) -> float:
        s, c, th = np.sin(b), np.cos(b), np.tanh(b)
        return float(inertia * b**3 * (1 / np.cosh(b) + c) + s - c * th)

    return _roots(equation, count)


def tip_mass(mass: float, count: int = 3) -> Array:
    """b of a cantilever with a point mass M/(m L) at its tip."""

    def equation(b: float) -> float:
        s, c, th = np.sin(b), np.cos(b), np.tanh(b)
        return float(1 / np.cosh(b) + c + mass * b * (c * th - s))

    return _roots(equation, count)


def compressed_cantilever(force: float) -> float:
    """First omega of a cantilever under the constant axial force P L^2/EI, compression positive.

    w'''' + P w'' = omega^2 w, clamped at 0; w'' = 0 and w''' + P w' = 0 at 1.
    """

    def equation(omega: float) -> float:
        half = 0.5 * force
        root = np.sqrt(half**2 + omega**2)
        a, b = np.sqrt(half + root), np.sqrt(root - half)  # trigonometric, hyperbolic
        s, c, sh, ch = np.sin(a), np.cos(a), np.sinh(b), np.cosh(b)
        # w = A (cosh - cos) + B (sinh - (b/a) sin)
        moment = np.array([b * b * ch + a * a * c, b * b * sh + a * b * s])
        slope = np.array([b * sh + a * s, b * ch - b * c])
        third = np.array([b**3 * sh - a**3 * s, b**3 * ch + a * a * b * c])
        return float(np.linalg.det(np.array([moment, third + force * slope])) / np.cosh(b))

    grid = np.linspace(0.05, 8.0, 400)
    values = [equation(w) for w in grid]
    for a, b, fa, fb in zip(grid[:-1], grid[1:], values[:-1], values[1:], strict=True):
        if fa * fb < 0:
            return float(brentq(equation, a, b, xtol=1e-13))
    raise ValueError("no frequency: buckled")


def southwell(count: int = 4) -> tuple[Array, Array]:
    """Slopes of omega^2 in eta^2 at rest: on a hub of no radius, and per hub radius r0/L.

    Quotients int (1 - x^2)/2 f'^2 / int f^2 and int (1 - x) f'^2 / int f^2 of the exact modes f.
    """
    s, weights = np.polynomial.legendre.leggauss(80)
    x, w = (s + 1) / 2, weights / 2
    slope, radius = [], []
    for b in wave_numbers("clamped_free", count):
        k = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
        f = np.cosh(b * x) - np.cos(b * x) - k * (np.sinh(b * x) - np.sin(b * x))
        df = b * (np.sinh(b * x) + np.sin(b * x) - k * (np.cosh(b * x) - np.cos(b * x)))
        slope.append(w @ ((1 - x * x) / 2 * df**2) / (w @ f**2))
        radius.append(w @ ((1 - x) * df**2) / (w @ f**2))
    return np.array(slope), np.array(radius)


def lagging_rod(eta: float, slenderness: float, steady_stretch: bool = True) -> Array:
    """Chordwise omega of a spinning rod that also stretches, E A = slenderness^2, by a Ritz series.

    Exact linearisation of the Kirchhoff rod (v' = (1 + e) theta, steady strain e and force N) with
    Coriolis forces. Without the steady stretch in the geometry it gives the published digits.
    """
    n, EA = 14, slenderness**2
    s, weights = np.polynomial.legendre.leggauss(60)
    x, w = (s + 1) / 2, weights / 2
    k = eta / slenderness
    e = np.cos(k * x) / np.cos(k) - 1 if steady_stretch else 0 * x
    N = EA * e if steady_stretch else eta**2 * (1 - x * x) / 2
    P, one = np.polynomial.legendre.legvander(s, n - 1), np.eye(n)
    legendre = np.polynomial.legendre
    dP = 2 * np.array([legendre.legval(s, legendre.legder(c)) for c in one]).T
    f, df = x[:, None] * P, P + x[:, None] * dP  # theta or u, and its slope
    full = legendre.legvander(s, 59)
    series = np.linalg.solve(full, (1 + e)[:, None] * f)
    v = legendre.legval(s, legendre.legint(series, lbnd=-1)).T / 2

    def product(a: Array, b: Array, factor: Array | float = 1.0) -> Array:
        return np.asarray(a.T @ ((w * factor)[:, None] * b))

    Kv = product(df, df) + product(f, f, (1 + e) * N) - eta**2 * product(v, v)
    Ku = EA * product(df, df) - eta**2 * product(f, f)
    G, O = 2 * eta * product(v, f), np.zeros((n, n))  # noqa: E741
    M = np.block([[product(v, v), O], [O, product(f, f)]])
    K, C = np.block([[Kv, O], [O, Ku]]), np.block([[O, G], [-G.T, O]])
    first = np.block([[0 * M, np.eye(2 * n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    roots = np.linalg.eigvals(first).imag
    return np.sort(roots[roots > 1e-6])


def cosserat_tip(
    length: float, force: Array, stiffness: Array, curvature: float = 0.0, parts: int = 4
) -> tuple[Array, Array]:
    """Tip place [m] and rotation of a rod along x, clamped at the origin, under a dead tip force.

    r' = R (e1 + C1 R'F), R' = R [kappa0 e3 + C2 R'm], m' = -r' x F, m(L) = 0: Reissner's rod
    without any approximation, by shooting on m(0).

    Args:
        length: m. force: N, world. stiffness: EA, kGA_y, kGA_z, GJ, EI_y, EI_z.
        curvature: Of the unloaded rod towards y, 1/m. parts: In which the load is put on.
    """
    soft = 1.0 / np.asarray(stiffness, float)

    def tip(root: Array, F: Array) -> Array:
        def slope(_: float, z: Array) -> Array:
            R, m = z[3:12].reshape(3, 3), z[12:]
            moved = R @ (np.array([1.0, 0, 0]) + soft[:3] * (R.T @ F))
            k = soft[3:] * (R.T @ m) + np.array([0, 0, curvature])
            turn = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
            return np.concatenate([moved, (R @ turn).ravel(), np.cross(F, moved)])

        start = np.concatenate([np.zeros(3), np.eye(3).ravel(), root])
        run = solve_ivp(slope, (0.0, length), start, "DOP853", rtol=1e-10, atol=1e-12)
        return np.asarray(run.y[:, -1])

    F, root = np.asarray(force, float), np.zeros(3)
    scale = length * float(np.linalg.norm(F))
    for part in np.arange(1, parts + 1) / parts:

        def open_by(x: Array, F: Array = part * F) -> Array:
            return tip(scale * x, F)[12:] / scale

        found, _, _, _ = fsolve(open_by, root / scale, xtol=1e-11, full_output=True)
        root = scale * found
    end = tip(root, F)
    assert np.abs(end[12:]).max() < 1e-7 * scale
    return end[:3], end[3:12].reshape(3, 3)
