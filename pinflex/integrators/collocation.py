"""Radau IIA collocation with s stages: its nodes, integrals and eigenvalues (order 2 s - 1).

Hairer and Wanner 1996, Solving Ordinary Differential Equations II, sections IV.5 and IV.8. The
accelerations of a step are the polynomial through s stages; velocities and positions are its
integrals. Newton's equations for all stages fall apart along the eigenvectors of A^-1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from pinflex.arrays import Array


@dataclass(frozen=True)
class Collocation:
    """Radau IIA with s stages on the unit interval.

    Attributes:
        c: Nodes, shape (s,), the last one 1.
        A: Integrals of the stage polynomials up to the nodes, shape (s, s).
        A2: A A. A2_inverse: Its inverse.
        values: Eigenvalues of A^-1, one of each conjugate pair, shape (s/2 rounded up,).
        forward: Stages to eigenvectors, complex, one row for each of `values`.
        back: Eigenvectors to stages: stages = real(back @ parts).
        last: Weights of (0, stages) that give the last Legendre coefficient of the polynomial
            through them, without that of 0, shape (s,).
    """

    c: Array
    A: Array
    A2: Array
    A2_inverse: Array
    values: Array
    forward: Array
    back: Array
    last: Array

    @property
    def s(self) -> int:
        """Number of stages."""
        return len(self.c)

    @property
    def monomials(self) -> tuple[Array, Array]:
        """Values at the nodes, and at 0 and the nodes, to coefficients of the powers."""
        return _monomials(self.s, False), _monomials(self.s, True)

    def at(self, x: Array) -> Array:
        """Weights of the stages for their polynomial at places x of the step, (len(x), s)."""
        rows = np.asarray(x, float)[:, None] ** np.arange(self.s)
        return np.asarray(rows @ _monomials(self.s, False))

    def between(self, x: Array) -> tuple[Array, Array, Array]:
        """Weights at x of the stages for both integrals, and of the value at 0 and the stages.

        Returns:
            Shapes (len(x), s), (len(x), s) and (len(x), s + 1): the last for the polynomial itself.
        """
        places, powers = np.asarray(x, float)[:, None], np.arange(self.s + 1)
        rows = places**powers
        first = rows[:, 1:] / powers[1:]
        second = first * places / (powers[1:] + 1)
        inner = _monomials(self.s, False)
        return first @ inner, second @ inner, rows @ _monomials(self.s, True)


@cache
def _monomials(s: int, zero: bool) -> Array:
    """Values at the nodes (and at 0) to coefficients of the powers."""
    c = _tableau(s).c
    nodes = np.append(0.0, c) if zero else c
    return np.asarray(np.linalg.inv(np.vander(nodes, increasing=True)))


def radau(s: int) -> Collocation:
    """The scheme with s stages (2 to 7: beyond that round-off shows in the eigenvectors)."""
    if not 2 <= s <= 7:
        raise ValueError(f"radau: {s} stages. Take 2 to 7.")
    return _tableau(s)


def implicit_euler() -> Collocation:
    """The scheme with one stage, whose equations are those of a single state."""
    return _tableau(1)


def with_one_more(method: Collocation) -> Collocation:
    """The scheme with one stage more, up to 9: good enough for a correction."""
    return _tableau(method.s + 1)


@cache
def _legendre(s: int) -> Array:
    """Weights of s stages for the coefficients of a polynomial that is 0 at 0, (s + 1, s)."""
    at = np.polynomial.legendre.legvander(2.0 * np.append(0.0, _nodes(s)) - 1.0, s)
    return np.asarray(np.linalg.inv(at))[:, 1:]


@cache
def _nodes(s: int) -> Array:
    """Zeros of P_(s-1) - P_s on the unit interval, the last one 1.

    By numpy: scipy's special functions take longer to import than a run.
    """
    of, legendre = np.zeros(s + 1), np.polynomial.legendre
    of[-2:] = 1.0, -1.0
    x = np.sort(legendre.legroots(of).real)[:-1]
    for _ in range(2):  # of Newton, to the last digit
        x = x - legendre.legval(x, of) / legendre.legval(x, legendre.legder(of))
    return np.append((x + 1.0) / 2.0, 1.0)


@cache
def _tableau(s: int) -> Collocation:
    c = _nodes(s)
    powers = np.arange(s)
    V = np.vander(c, increasing=True)
    A = (c[:, None] ** (powers + 1) / (powers + 1)) @ np.asarray(np.linalg.inv(V))
    values, vectors = np.linalg.eig(np.linalg.inv(A))
    inverse = np.linalg.inv(vectors)
    kept = np.flatnonzero(values.imag > -1e-9)
    # A pair counts twice: its other half is the conjugate.
    twice = np.where(values.imag[kept] > 1e-9, 2.0, 1.0)
    last = _legendre(s)[s]
    return Collocation(
        c, A, A @ A, np.asarray(np.linalg.inv(A @ A)), values[kept], inverse[kept],
        vectors[:, kept] * twice, last,
    )  # fmt: skip
