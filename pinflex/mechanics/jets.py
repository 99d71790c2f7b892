"""Arrays with their first and second derivatives by a few variables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinflex.arrays import Array


class Jet:
    """An array and what it changes by, by m variables.

    Attributes:
        value: Shape (...). grad: Shape (..., m). hess: Shape (..., m, m), or None: not asked for.
    """

    __slots__ = ("grad", "hess", "value")

    def __init__(self, value: Array, grad: Array, hess: Array | None) -> None:
        self.value, self.grad, self.hess = np.asarray(value), grad, hess

    def __getitem__(self, at: int) -> Jet:
        return Jet(self.value[at], self.grad[at], None if self.hess is None else self.hess[at])

    def __add__(self, other: Jet) -> Jet:
        hess = None if self.hess is None or other.hess is None else self.hess + other.hess
        return Jet(self.value + other.value, self.grad + other.grad, hess)

    def __sub__(self, other: Jet) -> Jet:
        return self + other.times(-1.0)

    def __mul__(self, other: Jet) -> Jet:
        """Entry by entry."""
        grad = self.value[..., None] * other.grad + other.value[..., None] * self.grad
        if self.hess is None or other.hess is None:
            return Jet(self.value * other.value, grad, None)
        cross = self.grad[..., :, None] * other.grad[..., None, :]
        hess = self.value[..., None, None] * other.hess + other.value[..., None, None] * self.hess
        return Jet(self.value * other.value, grad, hess + cross + np.swapaxes(cross, -1, -2))

    def __matmul__(self, other: Jet) -> Jet:
        """The product of two matrices."""
        grad = np.einsum("ijm,jk->ikm", self.grad, other.value)
        grad += np.einsum("ij,jkm->ikm", self.value, other.grad)
        if self.hess is None or other.hess is None:
            return Jet(self.value @ other.value, grad, None)
        cross = np.einsum("ijm,jkn->ikmn", self.grad, other.grad)
        hess = np.einsum("ijmn,jk->ikmn", self.hess, other.value) + cross + cross.swapaxes(2, 3)
        hess += np.einsum("ij,jkmn->ikmn", self.value, other.hess)
        return Jet(self.value @ other.value, grad, hess)

    @property
    def transposed(self) -> Jet:
        """Of a matrix."""
        hess = None if self.hess is None else self.hess.swapaxes(0, 1)
        return Jet(self.value.T, self.grad.swapaxes(0, 1), hess)

    def times(self, factor: float) -> Jet:
        """The same times a number."""
        hess = None if self.hess is None else factor * self.hess
        return Jet(factor * self.value, factor * self.grad, hess)

    def of(self, f: float, df: float, ddf: float) -> Jet:
        """A function of a scalar jet, by its value and its derivatives there.

        Args:
            f, df, ddf: Value, first and second derivative.
        """
        if self.hess is None:
            return Jet(np.array(f), df * self.grad, None)
        return Jet(
            np.array(f), df * self.grad, df * self.hess + ddf * np.outer(self.grad, self.grad)
        )


def constant(value: Array, m: int, second: bool) -> Jet:
    """What depends on none of m variables.

    Args:
        value: Of any shape.
        m: Number of variables. second: Second derivatives too.
    """
    value = np.asarray(value, dtype=float)
    hess = np.zeros((*value.shape, m, m)) if second else None
    return Jet(value, np.zeros((*value.shape, m)), hess)


def stacked(parts: Sequence[Jet]) -> Jet:
    """One array of several, along a new first axis."""
    hess = None
    if all(part.hess is not None for part in parts):
        hess = np.array([part.hess for part in parts])
    return Jet(np.array([p.value for p in parts]), np.array([p.grad for p in parts]), hess)


def turned(axis: int, angle: Jet) -> Jet:
    """The rotation (3, 3) about a coordinate axis by a scalar jet (rad).

    Args:
        axis: 0, 1 or 2.
        angle: [rad].
    """
    a, m = float(angle.value), angle.grad.shape[-1]
    out = constant(np.zeros((3, 3)), m, angle.hess is not None)
    cos, sin = (
        angle.of(np.cos(a), -np.sin(a), -np.cos(a)),
        angle.of(np.sin(a), np.cos(a), -np.sin(a)),
    )
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out.value[axis, axis] = 1.0
    for row, column, part, sign in (
        (i, i, cos, 1),
        (j, j, cos, 1),
        (j, i, sin, 1),
        (i, j, sin, -1),
    ):
        out.value[row, column] = sign * part.value
        out.grad[row, column] = sign * part.grad
        if out.hess is not None and part.hess is not None:
            out.hess[row, column] = sign * part.hess
    return out


def applied(matrix: Jet, f: Jet) -> Jet:
    """A matrix (i, j) times a vector (j,).

    Args:
        matrix: Of shape (i, j).
        f: Of shape (j,).
    """
    hess = None if f.hess is None else f.hess[:, None]
    out = matrix @ Jet(f.value[:, None], f.grad[:, None], hess)
    return Jet(out.value[:, 0], out.grad[:, 0], None if out.hess is None else out.hess[:, 0])


def dot(f: Jet, g: Jet) -> Jet:
    """The product of two vectors.

    Args:
        f, g: Of one shape (i,).
    """
    both = f * g
    hess = None if both.hess is None else both.hess.sum(axis=0)
    return Jet(both.value.sum(axis=0), both.grad.sum(axis=0), hess)


def eliminated(f: Jet, F: Jet) -> Jet:
    """f where F = 0 gives its first variable s by the others; nothing then depends on the first.

    With Z = dz/dw of all variables z = (s, w) by w,

        s_w = -F_w / F_s,    f_ww = Z' f_zz Z + f_s s_ww,    s_ww = -Z' F_zz Z / F_s

    Args:
        f: Shape (k,). F: Scalar.
    """
    F_s = F.grad[0]
    Z = np.eye(len(F.grad))
    Z[0] = -F.grad / F_s
    Z[0, 0] = 0.0
    grad = f.grad @ Z
    if f.hess is None or F.hess is None:
        return Jet(f.value, grad, None)
    s_ww = -(Z.T @ F.hess @ Z) / F_s
    return Jet(f.value, grad, Z.T @ f.hess @ Z + f.grad[:, 0][:, None, None] * s_ww)
