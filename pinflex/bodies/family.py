"""Families of functions that span one direction of a beam: Hermite, polynomial, analytic modes.

A family knows nothing of stiffness or mass: it gives, at any x, the displacement f, its derivative
df, the rotation rot of the section and the curvature curv = rot'. Euler-Bernoulli: rot = df;
Timoshenko: the shear strain is df - rot. Axial and torsion: rot = f, curv = df.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from numpy.polynomial import legendre

from pinflex.arrays import Array, IntArray
from pinflex.text import frozen

# Vibration modes of a uniform Euler-Bernoulli beam, in closed form and stable to any number.
#
# The textbook cosh - sinh form cancels from about the tenth mode on and overflows later. Here
# every mode is written in split exponentials, each bounded by one on the beam,
#
#     f(x) = A cos(b x) + B sin(b x) + C exp(-b x) + D exp(-b (L - x)),
#
# with (A, B, C, D) the null vector of the four boundary conditions, each divided by its power of b.

# Derivatives that vanish at an end.
_ENDS = {"clamped": (0, 1), "pinned": (0, 2), "free": (2, 3)}
# Shift of the asymptotic roots b L = (k + shift) pi, k = 1, 2, ...
_SHIFTS = {
    "clamped_free": -0.5,
    "pinned_free": 0.25,
    "pinned_pinned": 0.0,
    "clamped_pinned": 0.25,
    "clamped_clamped": 0.5,
    "free_free": 0.5,
}


@dataclass(frozen=True, eq=False)
class Modes:
    """Mode shapes A cos + B sin + C exp(-b x) + D exp(-b (L - x)), scaled to int f^2 dx = L.

    Attributes:
        length: Length of the beam L (m).
        wavenumber: b of each mode (1/m), shape (n,); 0 for a rigid mode.
        coefficients: A, B, C, D of each mode (-), shape (n, 4).
        rigid: Number of leading rigid modes: none, or translation 1 and rotation sqrt(3)(2x/L - 1).
    """

    length: float
    wavenumber: Array
    coefficients: Array
    rigid: int = 0

    def evaluate(self, x: Array, derivative: int = 0) -> Array:
        """Order d = `derivative` of each mode (m^-d) at x (nx,) in m, shape (nx, n)."""
        x = np.asarray(x, dtype=np.float64)
        b = self.wavenumber
        A, B, C, D = self.coefficients.T
        phase = np.outer(x, b)
        quarter = derivative % 4
        # d/d(bx) turns (cos, sin) by a quarter: (A, B) -> (B, -A).
        A, B = ((A, B), (B, -A), (-A, -B), (-B, A))[quarter]
        out: Array = A * np.cos(phase) + B * np.sin(phase)
        out += (-1) ** quarter * C * np.exp(-phase)
        out += D * np.exp(-np.outer(self.length - x, b))
        out *= b**derivative
        if self.rigid:
            slope = 2.0 * np.sqrt(3.0) / self.length
            columns = (
                (np.ones_like(x), np.sqrt(3.0) * (2.0 * x / self.length - 1.0)),
                (np.zeros_like(x), np.full_like(x, slope)),
            )
            zero = (np.zeros_like(x), np.zeros_like(x))
            out[:, :2] = np.column_stack(columns[derivative] if derivative < 2 else zero)
        return out


def roots(boundary: str, n: int) -> Array:
    """First n roots b L (-) of the characteristic equation of the elastic modes, shape (n,).

    The equations are divided by cosh(b L), so their values stay of order one:
    clamped_free cos + 1/cosh = 0; clamped_clamped and free_free cos - 1/cosh = 0;
    clamped_pinned and pinned_free sin - cos tanh = 0; pinned_pinned sin = 0.

    Source: Blevins (1979), Formulas for Natural Frequency and Mode Shape, table 8-1.
    """
    b = np.asarray((np.arange(1, n + 1) + _SHIFTS[boundary]) * np.pi, dtype=np.float64)
    if boundary == "pinned_pinned":
        return b
    # Newton from the asymptotic root: the slope is close to one there, and the first root of
    # all (1.5708 -> 1.8751) is the farthest it has to go.
    for _ in range(8):
        sech, tanh = 1.0 / np.cosh(np.minimum(b, 700.0)), np.tanh(b)
        sine, cosine = np.sin(b), np.cos(b)
        if boundary in ("clamped_pinned", "pinned_free"):
            value, slope = sine - cosine * tanh, cosine + sine * tanh - cosine * sech**2
        else:
            sign = 1.0 if boundary == "clamped_free" else -1.0
            value, slope = cosine + sign * sech, -sine - sign * sech * tanh
        b -= value / slope
    return b


def mode_functions(boundary: str, n: int, length: float, rigid: bool = False) -> Modes:
    """Bending modes of a uniform beam under homogeneous boundary conditions, int f^2 dx = L.

    The sign makes the first derivative that does not vanish at the root positive.
    """
    held = min(n, 2) if rigid else 0
    bl = roots(boundary, n - held)
    root, _, tip = boundary.partition("_")
    conditions = [_row(bl, k, 0.0) for k in _ENDS[root]] + [_row(bl, k, 1.0) for k in _ENDS[tip]]
    coefficients: Array = np.linalg.svd(np.stack(conditions, axis=1))[2][:, -1, :]
    # With end conditions in which f f''' = 0 and f' f'' = 0, f'''' = b^4 f integrates by parts to
    # int f^2 dx = L/4 (f^2 - 2 f' f'''/b^4 + f''^2/b^4) at x = L.
    d = [np.einsum("kj,kj->k", _row(bl, k, 1.0), coefficients) for k in range(4)]
    norm = 0.25 * (d[0] ** 2 - 2.0 * d[1] * d[3] + d[2] ** 2)
    lead = min(k for k in range(3) if k not in _ENDS[root])
    start = np.einsum("kj,kj->k", _row(bl, lead, 0.0), coefficients)
    coefficients *= (np.sign(start) / np.sqrt(norm))[:, None]
    wavenumber = np.concatenate([np.zeros(held), bl / length])
    table: Array = np.vstack([np.zeros((held, 4)), coefficients])
    return Modes(length, wavenumber, table, held)


def _row(bl: Array, derivative: int, xi: float) -> Array:
    """Derivative of the four split functions at x = xi L, divided by b^d: shape (n, 4)."""
    angle = bl * xi + derivative * (np.pi / 2.0)
    if derivative and xi == 0.0:  # exact quarter turns: no 6e-17 in place of zero
        angle = np.full_like(bl, derivative % 4)
        cosine = np.choose(angle.astype(int), [1.0, 0.0, -1.0, 0.0])
        sine = np.choose(angle.astype(int), [0.0, 1.0, 0.0, -1.0])
    else:
        cosine, sine = np.cos(angle), np.sin(angle)
    decay, rise = (-1.0) ** derivative * np.exp(-bl * xi), np.exp(-bl * (1.0 - xi))
    return np.stack([cosine, sine, decay, rise], axis=1)


BENDING = ("v", "w")
_KEPT = 64  # sets of places of a family
# Hermite order of a bending field -> order of the torsion and the axial field that go with it.
_COMPANIONS = {
    "cubic": {"v": "cubic", "w": "cubic", "p": "linear", "u": "linear"},
    "quintic": {"v": "quintic", "w": "quintic", "p": "cubic", "u": "linear"},
}
# Shape functions of an element of unit length in powers of xi = x / l: one row per coordinate,
# (value, slope, curvature) at xi = 0, then at xi = 1. Scenes 1.1: n1..n6, n7..n10, (1 - e, e).
_HERMITE = {
    "quintic": np.array(
        [
            [1, 0, 0, -10, 15, -6],
            [0, 1, 0, -6, 8, -3],
            [0, 0, 0.5, -1.5, 1.5, -0.5],
            [0, 0, 0, 10, -15, 6],
            [0, 0, 0, -4, 7, -3],
            [0, 0, 0, 0.5, -1, 0.5],
        ]
    ),
    "cubic": np.array([[1.0, 0, -3, 2], [0, 1, -2, 1], [0, 0, 3, -2], [0, 0, -1, 1]]),
    "linear": np.array([[1.0, -1], [0, 1]]),
}


@frozen(eq=False)
class Functions:
    """A family at some points: each array has shape (nx, n).

    Attributes:
        f: Value.
        df: Derivative f' (1/m).
        rot: Rotation of the section.
        curv: Curvature rot' (1/m).
    """

    f: Array
    df: Array
    rot: Array
    curv: Array


@frozen(eq=False)
class Family:
    """n functions on [0, length].

    Attributes:
        n: Number of functions.
        length: Length of the beam (m).
        breaks: Boundaries of the intervals on which the functions are smooth (m).
        gauss: Gauss points per interval that integrate a product of two functions: p + 1, exactly,
            for polynomials of degree p; to rounding for analytic modes.
        names: Name of each coordinate, such as "slope 2" or "1".
        function: x (nx,) -> Functions.
        shear: Whether df and rot differ.
    """

    n: int
    length: float
    breaks: Array
    gauss: int
    names: tuple[str, ...]
    function: Callable[[Array], Functions]
    shear: bool = False

    def evaluate(self, x: Array) -> Functions:
        """Values, derivatives, rotations and curvatures at x (m), shape (nx,); not to be changed.

        Kept: whatever is made of a beam asks for the same places.
        """
        x = np.atleast_1d(np.asarray(x, dtype=np.float64))
        kept, at = vars(self).setdefault("_kept", {}), x.tobytes()
        if at not in kept:
            if len(kept) >= _KEPT:
                kept.clear()
            kept[at] = self.function(x)
        found: Functions = kept[at]
        return found

    def __getstate__(self) -> dict[str, object]:
        return {key: value for key, value in vars(self).items() if key != "_kept"}


def hermite(
    length: float,
    elements: int,
    order: str,
    root: str = "clamped",
    direction: str = "v",
    shear_ratio: float = 0.0,
) -> Family:
    """Hermite finite elements of equal length.

    A clamped root section fixes value and slope of a bending field, the value of an axial or
    torsion field; the root curvature or twist rate stays a coordinate.

    Source: Liu et al. (2010), eq. 1-4 (18-coordinate element); Friedman, Kosmatka (1993),
        eq. 20-21 (shear), with slope = rotation of the section.
    """
    kind = _COMPANIONS[order][direction]
    bending = direction in BENDING
    size, per_node = length / elements, len(_HERMITE[kind]) // 2
    value, turn = _element(kind, size, bending, shear_ratio)
    held = 0 if root == "free" else 2 if bending else 1
    rate = ("node", "slope", "curvature") if bending else ("node", "rate")
    labels = [f"{rate[k]} {node}" for node in range(elements + 1) for k in range(per_node)]
    first = per_node * np.arange(elements)[:, None]
    dofs = first + np.arange(2 * per_node) - held  # held ones become -1, -2: spare columns
    names, shear = tuple(labels[held:]), bending and shear_ratio > 0.0
    return _piecewise(length, elements, value, turn, dofs, names, value.shape[1], shear)


def _element(kind: str, size: float, bending: bool, shear_ratio: float) -> tuple[Array, Array]:
    """Values and rotations of the functions of one element of a size (m), Legendre coefficients."""
    powers = _HERMITE[kind]
    scale = np.tile(size ** np.arange(len(powers) // 2), 2)[:, None]
    if bending and shear_ratio:
        powers, turn = _friedman_kosmatka(12.0 * shear_ratio / size**2)
        return _from_powers(powers * scale), _from_powers(turn * scale / size)
    value = _from_powers(powers * scale)
    return value, _derivative(value, size) if bending else value


@lru_cache(maxsize=64)
def polynomial(
    length: float,
    n: int,
    direction: str = "v",
    shear_ratio: float = 0.0,
    shear_free: bool = False,
) -> Family:
    """Polynomials on the whole beam, clamped at the root, with Legendre strains.

    Bending: curv = P_j(2x/L - 1), j < n, f its double integral; axial and torsion: df = P_j. With
    shear, each curvature carries the shear strain that balances it, df - rot = -(EI/kGA) rot'',
    which is all there is without rotary inertia; with it, n free shear strains P_j are added.
    """
    half = length / 2.0
    strain = np.eye(n, n + 3)
    rotation = _integral(strain, half)
    if direction not in BENDING:
        turn = value = rotation
    else:
        slope = rotation.copy()
        if shear_ratio:
            slope -= shear_ratio * _derivative(strain, length)
        turn = rotation
        if shear_free:
            slope = np.vstack([slope, strain])
            turn = np.vstack([rotation, np.zeros_like(strain)])
        value = _integral(slope, half)
    count = len(value)
    names = tuple(str(k + 1) for k in range(count))
    degree = n + 1 if direction in BENDING else n
    shear = direction in BENDING and (shear_ratio > 0.0 or shear_free)
    return _piecewise(length, 1, value, turn, np.arange(count)[None], names, degree + 1, shear)


def assumed(length: float, boundary: str, modes: int) -> Family:
    """Analytic bending modes with int f^2 dx = L, so that coordinates are amplitudes in m."""
    rigid = boundary == "free_free"
    return _modal(mode_functions(boundary, modes, length, rigid), bending=True)


def sines(length: float, modes: int) -> Family:
    """Axial or torsional modes sqrt(2) sin((2k - 1) pi x / 2L) of a bar held at its root."""
    wavenumber = np.asarray((np.arange(1, modes + 1) - 0.5) * np.pi / length, dtype=np.float64)
    rows = np.tile([0.0, np.sqrt(2.0), 0.0, 0.0], (modes, 1))
    return _modal(Modes(length, wavenumber, rows), bending=False)


def combine(family: Family, T: Array, names: tuple[str, ...] | None = None) -> Family:
    """Linear recombination f @ T of a family."""
    m = T.shape[1]
    labels = names or tuple(str(k + 1) for k in range(m))
    function = partial(_combined, family=family, T=T)
    return Family(m, family.length, family.breaks, family.gauss, labels, function, family.shear)


_gauss = lru_cache(maxsize=64)(legendre.leggauss)


def quadrature(breaks: Array, points: int) -> tuple[Array, Array]:
    """Points and weights (m) of Gauss-Legendre rules on k intervals, each of shape (k, points)."""
    s, w = _gauss(points)
    half = 0.5 * np.diff(breaks)[:, None]
    return breaks[:-1, None] + half * (s + 1.0), half * w


def _modal(modes: Modes, bending: bool) -> Family:
    n = len(modes.wavenumber)
    bl = float(modes.wavenumber[-1]) * modes.length
    # Measured for products of modes and of their slopes at 3e-13, first 50 modes of every
    # boundary: bl/2 resolves the waves, the rest is the tail of the Gauss error.
    gauss = math.ceil(0.5 * bl + 5.0 * bl ** (1 / 3) + 1.0)
    breaks = np.array([0.0, modes.length])
    names = tuple(str(k + 1) for k in range(n))
    function = partial(_modal_functions, modes=modes, bending=bending)
    return Family(n, modes.length, breaks, max(gauss, 2), names, function)


def _modal_functions(x: Array, modes: Modes, bending: bool) -> Functions:
    f, df = modes.evaluate(x), modes.evaluate(x, 1)
    return Functions(f, df, df, modes.evaluate(x, 2)) if bending else Functions(f, df, f, df)


def _combined(x: Array, family: Family, T: Array) -> Functions:
    F = family.evaluate(x)
    f, df = F.f @ T, F.df @ T
    rot = df if F.rot is F.df else f if F.rot is F.f else F.rot @ T
    return Functions(f, df, rot, df if F.curv is F.df else F.curv @ T)


def _friedman_kosmatka(phi: float) -> tuple[Array, Array]:
    """Deflection and (times l) rotation functions in powers of xi, on an element of unit length."""
    deflection = [
        [1 + phi, -phi, -3, 2],
        [0, 1 + phi / 2, -2 - phi / 2, 1],
        [0, phi, 3, -2],
        [0, -phi / 2, -1 + phi / 2, 1],
    ]
    rotation = [[0, -6, 6], [1 + phi, -4 - phi, 3], [0, 6, -6], [0, -2 + phi, 3]]
    return np.array(deflection) / (1 + phi), np.array(rotation) / (1 + phi)


def _from_powers(powers: Array) -> Array:
    """Legendre coefficients on [-1, 1] of polynomials in xi = (s + 1)/2, row by row."""
    out = np.zeros(powers.shape)
    for k, column in enumerate(powers.T):
        out[:, : k + 1] += np.outer(column, legendre.legpow([0.5, 0.5], k))
    return out


def _integral(coefficients: Array, half: float) -> Array:
    """Integral from the root of Legendre series on a beam of length 2 half, same width."""
    series = legendre.legint(coefficients, lbnd=-1, axis=1)[:, :-1]
    return np.asarray(half * series, dtype=np.float64)


def _derivative(coefficients: Array, size: float) -> Array:
    """d/dx of Legendre series on elements of length `size`, padded to the same width."""
    d = legendre.legder(coefficients, axis=1) * (2.0 / size)
    return np.pad(d, ((0, 0), (0, coefficients.shape[1] - d.shape[1])))


def _piecewise(
    length: float,
    elements: int,
    value: Array,
    turn: Array,
    dofs: IntArray,
    names: tuple[str, ...],
    gauss: int,
    shear: bool,
) -> Family:
    """Family of piecewise polynomials, equal on every element."""
    breaks = np.linspace(0.0, length, elements + 1)
    size = length / elements
    turn = np.pad(turn, ((0, 0), (0, value.shape[1] - turn.shape[1])))
    tables = (value, _derivative(value, size), turn, _derivative(turn, size))
    function = partial(_piecewise_functions, breaks=breaks, tables=np.stack(tables), dofs=dofs)
    return Family(len(names), length, breaks, gauss, names, function, shear)


def _piecewise_functions(x: Array, breaks: Array, tables: Array, dofs: IntArray) -> Functions:
    element = np.clip(np.searchsorted(breaks, x, side="right") - 1, 0, len(breaks) - 2)
    start, size = breaks[element], breaks[1] - breaks[0]
    V = legendre.legvander(2.0 * (x - start) / size - 1.0, tables.shape[2] - 1)
    local = V @ tables.transpose(0, 2, 1)
    held = -int(dofs.min())
    if len(dofs) == 1 and held == 0:
        return Functions(*local)
    columns = int(dofs.max()) + 1
    out = np.zeros((4, len(x), columns + held))
    out[:, np.arange(len(x))[:, None], dofs[element]] = local
    return Functions(*out[:, :, :columns])
