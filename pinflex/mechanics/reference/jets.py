"""Arrays with their first and, if wanted, second derivatives by m variables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinflex.arrays import Array


@dataclass(frozen=True, eq=False)
class Jet:
    """An array and its derivatives.

    Attributes:
        value: Shape (...). grad: Shape (..., m). hess: Shape (..., m, m), or None: first order.
    """

    value: Array
    grad: Array
    hess: Array | None = None

    def __getitem__(self, at: Any) -> Jet:
        return Jet(self.value[at], self.grad[at], None if self.hess is None else self.hess[at])

    def __add__(self, other: Jet) -> Jet:
        second = self.hess is None or other.hess is None
        hess = None if second else self.hess + other.hess  # type: ignore[operator]
        return Jet(self.value + other.value, self.grad + other.grad, hess)

    def __sub__(self, other: Jet) -> Jet:
        return self + other.times(-1.0)

    def times(self, factor: float) -> Jet:
        """The array times a number."""
        hess = None if self.hess is None else factor * self.hess
        return Jet(factor * self.value, factor * self.grad, hess)

    def plus(self, constant: float | Array) -> Jet:
        """The array plus constants."""
        return Jet(self.value + constant, self.grad, self.hess)

    def over(self, factors: Array) -> Jet:
        """The array over constants of its own shape."""
        hess = None if self.hess is None else self.hess / factors[..., None, None]
        return Jet(self.value / factors, self.grad / factors[..., None], hess)


def constant(value: Any, like: Jet) -> Jet:
    """An array that depends on none of the variables of another one."""
    value, m = np.asarray(value, dtype=float), like.grad.shape[-1]
    hess = None if like.hess is None else np.zeros((*value.shape, m, m))
    return Jet(value, np.zeros((*value.shape, m)), hess)


def still(jet: Jet) -> Jet:
    """The array as a constant, beside one variable."""
    return Jet(jet.value, np.zeros((*jet.value.shape, 1)))


def product(rule: str, f: Jet, g: Jet) -> Jet:
    """A product of two arrays by a rule of `numpy.einsum`, which names neither m nor n."""
    (a, b), out = rule.split("->")[0].split(","), rule.split("->")[1]

    def summed(of: str, to: str, x: Array, y: Array) -> Array:
        return np.asarray(np.einsum(f"{of}->{to}", x, y))

    value = summed(f"{a},{b}", out, f.value, g.value)
    grad = summed(f"{a}m,{b}", f"{out}m", f.grad, g.value)
    grad = grad + summed(f"{a},{b}m", f"{out}m", f.value, g.grad)
    if f.hess is None or g.hess is None:
        return Jet(value, grad)
    both = summed(f"{a}m,{b}n", f"{out}mn", f.grad, g.grad)
    hess = summed(f"{a}mn,{b}", f"{out}mn", f.hess, g.value)
    hess = hess + summed(f"{a},{b}mn", f"{out}mn", f.value, g.hess)
    return Jet(value, grad, hess + both + both.swapaxes(-1, -2))


def dot(f: Jet, g: Jet) -> Jet:
    """Sum of products along the last axis."""
    return product("...i,...i->...", f, g)


def stacked(parts: Sequence[Jet]) -> Jet:
    """One array of several, along a new first axis."""
    hess = None
    if all(part.hess is not None for part in parts):
        hess = np.array([part.hess for part in parts])
    return Jet(np.array([p.value for p in parts]), np.array([p.grad for p in parts]), hess)


def joined(parts: Sequence[Jet], axis: int = 0) -> Jet:
    """One array of several, along an axis that they have."""
    hess = None
    if all(part.hess is not None for part in parts):
        hess = np.concatenate([part.hess for part in parts if part.hess is not None], axis)
    value, grad = (
        np.concatenate(x, axis) for x in zip(*((p.value, p.grad) for p in parts), strict=True)
    )
    return Jet(value, grad, hess)


def function(value: Array, first: Array, second: Array, of: Jet) -> Jet:
    """f(z) by its value (...), its derivatives (..., p) and (..., p, p) there, and z (p,)."""
    grad = first @ of.grad
    if of.hess is None:
        return Jet(np.asarray(value), grad)
    hess = of.grad.T @ second @ of.grad + np.einsum("...p,pmn->...mn", first, of.hess)
    return Jet(np.asarray(value), grad, hess)


def scalar(f: float, df: float, ddf: float, of: Jet) -> Jet:
    """A function of a number, by its value and derivatives there."""
    hess = None if of.hess is None else df * of.hess + ddf * np.outer(of.grad, of.grad)
    return Jet(np.asarray(f), df * of.grad, hess)


def turn_about(axis: int, angle: Jet) -> Jet:
    """The rotation (3, 3) about a coordinate axis by an angle [rad]."""
    a = float(angle.value)
    cos, sin = (
        scalar(np.cos(a), -np.sin(a), -np.cos(a), angle),
        scalar(np.sin(a), np.cos(a), -np.sin(a), angle),
    )
    one, nil = constant(1.0, angle), constant(0.0, angle)
    rows = [[nil] * 3 for _ in range(3)]
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rows[axis][axis] = one
    rows[i][i] = rows[j][j] = cos
    rows[j][i], rows[i][j] = sin, sin.times(-1.0)
    return stacked([stacked(row) for row in rows])
