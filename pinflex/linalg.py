"""Linear algebra that mechanisms need: saddle systems, null spaces, ranks, signs of a stiffness."""

from __future__ import annotations

import sys
from functools import cache
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.errors import SingularityError

# Curvature of rows scaled to one: a free joint without a load has 0 and round-off.
_NEUTRAL = 1e-9
_LOW = 1e-8  # omega^2 below this share of the highest: half its digits are round-off
_STIFF = 1e-6  # least pivot of K with unit diagonal at which nothing is free to move
_SPRINGS = 1e3  # of the closures, of a stiffness scaled to one


@cache
def lapack() -> Any:
    """LAPACK as scipy wraps it: what `scipy.linalg.lapack` holds.

    The wrappers are taken alone, in 3 ms: `scipy.linalg` as a whole takes 130, half of a small run.
    Where scipy keeps them elsewhere, the whole is imported.
    """
    alone = _alone()
    if alone is not None:
        return alone
    from scipy.linalg import lapack as whole

    return whole


def _alone() -> Any:
    scipy, name = find_spec("scipy"), "scipy.linalg._flapack"
    folders = None if scipy is None else scipy.submodule_search_locations
    if not folders or "scipy.linalg" in sys.modules:
        return None
    spec = PathFinder.find_spec(name, [str(Path(folders[0], "linalg"))])
    if spec is None or spec.loader is None:
        return None
    try:
        found = module_from_spec(spec)
        spec.loader.exec_module(found)
    except ImportError:  # it needs what importing scipy sets up
        return None
    finally:
        sys.modules.pop(name, None)  # `import scipy.linalg` finds it for itself
    return found


def eigh(K: Array, M: Array, vectors: bool = True) -> tuple[Array, Array]:
    """Eigenvalues (n,), ascending, and vectors (n, n) of K x = lambda M x with x' M x = 1.

    Raises:
        numpy.linalg.LinAlgError: M is not positive definite.
    """
    if not len(K):
        return np.zeros(0), np.zeros((0, 0))
    K, M = np.asarray_chkfinite(K), np.asarray_chkfinite(M)
    values, x, info = lapack().dsygvd(K, M, uplo="L", jobz="V" if vectors else "N")
    if info:
        raise np.linalg.LinAlgError(f"dsygvd: info {info}, of {len(K)}")
    return values, x


def saddle_matrix(A: Array, J: Array, J_left: Array | None = None) -> Array:
    """The matrix [A -J_left'; J 0] of equations of motion with closures, (n + rows, n + rows)."""
    n, rows = len(A), len(J)
    S = np.zeros((n + rows, n + rows))
    S[:n, :n], S[:n, n:], S[n:, :n] = A, -(J if J_left is None else J_left).T, J
    return S


_REGULAR = 1e-15  # least reciprocal condition of a scaled matrix: what is below is round-off
# Of the largest, roots of the diagonal: what is below is the round-off of none, and no scale. A
# hinge beside a rod has 1e-24 of the rod's stiffness so, a light joint under its weight 1e-17.
_NONE = 1e-11


def saddle(A: Array, J_left: Array, J: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """x and lam of A x - J_left' lam = b, J x = c; least squares where directions are massless.

    Those of several coordinates, such as two lengths of a link that turn against each other with
    all its inertia beyond them, leave round-off of A, which no solution is to be divided by.
    """
    S, right, n = saddle_matrix(A, J, J_left), np.concatenate([b, c]), len(A)
    size = np.sqrt(np.abs(np.diag(S)))
    size[size <= _NONE * size.max(initial=0.0)] = 1.0
    scaled = S / size / size[:, None]
    lu, pivots, info = lapack().dgetrf(scaled)
    share = 0.0 if info else lapack().dgecon(lu, np.abs(scaled).sum(axis=0).max())[0]
    if share > _REGULAR or not np.isfinite(scaled).all():
        x = lapack().dgetrs(lu, pivots, right / size)[0] / size
    else:
        x = np.linalg.lstsq(scaled, right / size, rcond=1e-13)[0] / size
    return x[:n], x[n:]


def null_space(J: Array, small: float = 1e-10, scale: float | None = None) -> Array:
    """Orthonormal basis of the motions that J allows, shape (n, n - rank)."""
    if not J.shape[0] or not J.shape[1]:
        return np.eye(J.shape[1])
    _, sigma, Vt = np.linalg.svd(J)
    limit = small * (float(sigma[0]) if scale is None else scale)
    return np.asarray(Vt[int(np.sum(sigma > limit)) :].T)


def independent_rows(J: Array, small: float, scale: float | None = None) -> IntArray:
    """Numbers of rows of J (rows, n) that carry its rank, the largest first."""
    if not J.shape[0] or not J.shape[1]:
        return np.zeros(0, dtype=np.intp)
    R, order, *_ = lapack().dgeqp3(np.asarray_chkfinite(J.T))
    size = np.abs(np.diag(R))
    limit = small * (max(float(size[0]), 1e-300) if scale is None else scale)
    return np.asarray(order[: int(np.sum(size > limit))] - 1, dtype=np.intp)


def negative_directions(K: Array, J: Array) -> int:
    """Number of directions that J (rows, n) allows in which a stiffness K (n, n) is negative."""
    if not len(K):
        return 0
    if resists(K, J):
        return 0
    K, J = _scaled(K, J)
    Z = null_space(J)
    return int(np.sum(np.linalg.eigvalsh(Z.T @ K @ Z) < -_NEUTRAL))


def resists(K: Array, J: Array) -> bool:
    """Whether each of some stiffnesses is plainly positive in what its closures allow."""
    if not K.shape[-1]:
        return True
    K, J = _scaled(K, J)
    try:
        # What resists with springs in place of the closures resists with the closures; it is cheap.
        np.linalg.cholesky(K + _SPRINGS * J.swapaxes(-1, -2) @ J)
    except np.linalg.LinAlgError:
        return False
    return True


def _scaled(K: Array, J: Array) -> tuple[Array, Array]:
    """Stretch is 1e6 times stiffer than bending: rows of size one keep the digits of soft ones."""
    size = np.abs(np.diagonal(K, axis1=-2, axis2=-1))
    least = np.maximum(1e-12 * np.max(size, axis=-1, keepdims=True), 1e-300)
    scale = 1.0 / np.sqrt(np.maximum(size, least))
    symmetric = 0.5 * (K + K.swapaxes(-1, -2))
    return symmetric * scale[..., None, :] * scale[..., :, None], J * scale[..., None, :]


def condensed(K: Array, M: Array) -> tuple[Array, Array, Array]:
    """Unit-mass modes of what has mass, and the compliance of what has none.

    Returns:
        Modes x (n, k), the massless coordinates following statically; compliance (n, n) of the
        massless ones with the others held; omega^2 (k,).
    """
    K, M = 0.5 * (K + K.T), 0.5 * (M + M.T)
    if not len(K):
        return np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(M), 1e-300))
    scale = np.where(
        np.diag(M) > 1e-14 * np.max(np.diag(M)), scale, 1.0 / np.sqrt(np.max(np.diag(M)))
    )
    values, V = np.linalg.eigh(M * scale * scale[:, None])
    heavy = values > 1e-13 * values[-1]
    V = scale[:, None] * V
    if np.all(heavy):
        omega2, x = _lowest_again(K, M, *eigh(K, M))
        return x, np.zeros_like(K), omega2
    H, L = V[:, heavy], V[:, ~heavy]
    soft = L.T @ K @ L
    if np.linalg.eigvalsh(soft)[0] < 1e-12 * float(np.max(np.abs(K * scale * scale[:, None]))):
        raise SingularityError(
            "modes: a coordinate has neither mass nor stiffness: two coordinates make one motion "
            "(a basis with free ends on a joint that moves the same way), or a massless link "
            "swings freely. Take a basis clamped at its root, fix the joint, or give the link "
            "a mass."
        )
    T = H - L @ np.linalg.lstsq(soft, L.T @ K @ H, rcond=None)[0]
    K, M = T.T @ K @ T, T.T @ M @ T
    omega2, x = _lowest_again(K, M, *eigh(K, M))
    return T @ x, L @ np.linalg.lstsq(soft, L.T, rcond=None)[0], omega2


def _lowest_again(K: Array, M: Array, omega2: Array, x: Array) -> tuple[Array, Array]:
    """Eigenpairs of (K, M), those far below the highest again from (M, K).

    Each way errs by round-off of its largest eigenvalue: omega^2 of the lowest is lost where the
    highest is 1e13 times larger (a payload of 1e10 times the beam), 1/omega^2 of the lowest is not.
    """
    highest = float(np.max(np.abs(omega2), initial=0.0))
    low = np.abs(omega2) < _LOW * highest
    if not np.any(low):
        return omega2, x
    # Round-off of a zero frequency is 1e-16 of the largest omega^2: shown as zero.
    shown = np.where(np.abs(omega2) < 1e-13 * highest, 0.0, omega2)
    size = np.diag(K)
    if np.any(size <= 0):
        return shown, x
    scale = 1.0 / np.sqrt(size)
    try:
        L = np.linalg.cholesky(K * scale * scale[:, None])
    except np.linalg.LinAlgError:
        return shown, x
    if np.min(np.diag(L)) < _STIFF:  # something is free to move, or nearly so
        return shown, x
    trtrs = lapack().dtrtrs
    half = trtrs(L, M * scale * scale[:, None], lower=True)[0]
    flexibility, z = np.linalg.eigh(trtrs(L, half.T, lower=True)[0])
    again = slice(None, -int(np.sum(low)) - 1, -1)
    found = trtrs(L.T, z[:, again])[0] * scale[:, None]
    shown, x = shown.copy(), x.copy()
    shown[low] = 1.0 / flexibility[again]
    x[:, low] = found / np.sqrt(flexibility[again])
    return shown, x
