"""The linear system of a command: a quadratic cost of poses, and rows of every instant, by time.

    [ H  G' ] [  dx ]   [ p ]
    [ G  0  ] [ dmu ] = [ e ]        G: rows of an instant by the poses about it, its multipliers

The closures and the platform's rows hold poses of one instant alone, and multipliers stand in rows
of one instant alone: both are solved for first, by a basis N of the moves that those rows allow and
a basis P of the forces that no multiplier bears. What is left couples five instants in turn,

    [ N'H N    (P'G N)' ] [  z ]
    [ P'G N        0    ] [ nu ]

and N'H N is positive, pose by pose. With its inverse moves are solved for too, and of nu is left

    P'G N (N'H N)^-1 (P'G N)' nu = ...

symmetric, positive, with a band of five instants, for LAPACK's Cholesky factors. That squares how
ill-conditioned the rows are; what it costs in digits, the next correction of a command has.

Source: Nocedal, Wright (2006), Numerical Optimization, ch. 16.2 (null spaces, Schur complements);
Golub, Van Loan (2013), Matrix Computations, ch. 4.3 (bands).
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import as_strided, sliding_window_view

from pinflex.arrays import Array
from pinflex.linalg import lapack

_REGULAR = 1e-13  # of the diagonal: keeps rows of several instants that depend on each other apart
_TOGETHER = 32  # instants multiplied at a time: new memory costs more than arithmetic
_MORE = 100.0  # times as much, where round-off has eaten that
_DEPENDENT = 1e-11  # of the largest row: what is left of one that the others say already


class Saddle:
    """The factorised matrix.

    Attributes:
        pad: Poses on either side of an instant that its rows depend on.
    """

    def __init__(self, weights: Array, G: Array, forces: int) -> None:
        """H by pose (nt + 2 pad, nv, nv); G (nt, per, (2 pad + 1) nv + rows), its `forces` first.

        The rows below those hold poses of their own instant alone, and no multipliers. G is not
        copied: it must stay as it is.
        """
        nv, self._width = weights.shape[1], len(weights) - len(G) + 1
        self.pad, self._forces, self._weights = self._width // 2, forces, weights
        self._G = G[:, :forces, : self._width * nv]
        held = G[:, forces:, self.pad * nv : (self.pad + 1) * nv]
        self._to_held, N = _split(held)
        self._to_borne, self._P = _split(G[:, :forces, self._width * nv :].transpose(0, 2, 1))
        outside = np.eye(nv)[None].repeat(self.pad, 0)  # the poses there may move anyhow
        bases = (outside, N, outside)
        cuts = np.split(weights, [self.pad, -self.pad])
        self._roots = np.concatenate([_roots(*x) for x in zip(cuts, bases, strict=True)])
        self._factors = self._factorised()

    def solve(self, p: Array, s: Array, e: Array) -> tuple[Array, Array, Array]:
        """Moves (nt + 2 pad, nv), multipliers (nt, rows) and dmu (nt, per).

        For p by pose, s by multiplier and e by row, of these shapes.
        """
        inner = slice(self.pad, -self.pad)
        forces, closed = e[:, : self._forces], e[:, self._forces :]
        x = np.zeros_like(p)
        x[inner] = _times(self._to_held, closed)
        mu = _times(self._to_borne, s)
        open_poses = p - _times(self._weights, x) - self.spread(_by(mu, self._G))
        open_forces = forces - _times(self._G, self.windows(x))
        moves, nu = self._solved(open_poses, _by(open_forces, self._P))
        x += moves
        mu += _times(self._P, nu)
        left = p - _times(self._weights, x) - self.spread(_by(mu, self._G))
        lam = _by(forces - _times(self._G, self.windows(x)), self._to_borne)
        return x, lam, np.concatenate([mu, _by(left[inner], self._to_held)], axis=1)

    def windows(self, x: Array) -> Array:
        """What each instant sees of poses (nt + 2 pad, nv), shape (nt, (2 pad + 1) nv)."""
        seen = sliding_window_view(x, 2 * self.pad + 1, axis=0)
        return seen.transpose(0, 2, 1).reshape(len(seen), -1)

    def spread(self, seen: Array) -> Array:
        """The transpose of `windows`."""
        width, nt = 2 * self.pad + 1, len(seen)
        nv = seen.shape[1] // width
        out = np.zeros((nt + width - 1, nv))
        for j in range(width):
            out[j : j + nt] += seen[:, j * nv : (j + 1) * nv]
        return out

    def _factorised(self, more: float = _REGULAR) -> Array:
        """Cholesky factors of the rows' matrix, a band's lower half by columns.

        Raises:
            LinAlgError: Rows that are no numbers.
        """
        G, P, (nt, _, nr), width = self._G, self._P.transpose(0, 2, 1), self._P.shape, self._width
        band = width * nr  # and a column is longer by one: entry (i, j) stands at i + j band
        store = np.zeros(nt * nr * (band + 1))
        steps = tuple(store.itemsize * k for k in (nr * (band + 1), band, 1))
        for first in range(0, nt, _TOGETHER):
            last = min(first + _TOGETHER + width - 1, nt)
            some = slice(first, last)
            rows = (P[some] @ G[some]).reshape(last - first, nr, width, -1)
            for j in range(width):
                rows[:, :, j] = rows[:, :, j] @ self._roots[first + j : last + j]
            for d in range(min(width, last - first)):  # what instants so far apart have in common
                n = min(_TOGETHER, last - first - d)
                mine, theirs = rows[:n, :, d:], rows[d : d + n, :, : width - d]
                common = mine.reshape(n, nr, -1) @ theirs.reshape(n, nr, -1).transpose(0, 2, 1)
                at = store[first * nr * (band + 1) + d * nr :]
                as_strided(at, (n, nr, nr), steps)[...] = common if d else np.triu(common)
        diagonal = store[:: band + 1]
        diagonal *= 1.0 + more
        diagonal[~np.any(P, axis=2).ravel()] = 1.0
        if not np.isfinite(diagonal).all():
            raise np.linalg.LinAlgError("saddle: rows that are no numbers")
        by_columns = store.reshape(nt * nr, band + 1).T
        factors, info = lapack().dpbtrf(by_columns, lower=1, overwrite_ab=1)
        return self._factorised(_MORE * more) if info else factors

    def _solved(self, p: Array, f: Array) -> tuple[Array, Array]:
        """Moves by z (nt + 2 pad, nv), and nu (nt, nr)."""
        free = self._yield(p)
        right = _by(_times(self._G, self.windows(free)), self._P) - f
        found, _ = lapack().dpbtrs(self._factors, right.ravel(), lower=1)
        nu = found.reshape(right.shape)
        return free - self._yield(self.spread(_by(_times(self._P, nu), self._G))), nu

    def _yield(self, p: Array) -> Array:
        """Moves of each pose alone under p, without the rows that span instants."""
        return _times(self._roots, _by(p, self._roots))


def _roots(weights: Array, N: Array) -> Array:
    """R of each pose, square, with R R' = N (N'H N)^-1 N'; columns of zeros in N have no part."""
    H = N.transpose(0, 2, 1) @ weights @ N
    k = np.arange(H.shape[1])
    H[:, k, k] += np.where(np.any(N, axis=1), 0.0, 1.0)
    found = np.zeros_like(weights)
    root = np.linalg.solve(np.linalg.cholesky(H), N.transpose(0, 2, 1))
    found[:, :, : len(k)] = root.transpose(0, 2, 1)
    return found


def _split(J: Array) -> tuple[Array, Array]:
    """Pseudo-inverses (nt, n, r) of rows (nt, r, n), and bases (nt, n, k) of what they allow.

    Where rows depend on each other at some instants, bases of the others have columns of zeros.
    """
    r = J.shape[1]
    Q, R = np.linalg.qr(J.transpose(0, 2, 1), mode="complete")
    size = np.abs(np.diagonal(R[:, :r], axis1=1, axis2=2))
    if np.all(size > _DEPENDENT * size.max(axis=1, initial=0.0, keepdims=True)):
        inverse = Q[:, :, :r] @ np.linalg.inv(R[:, :r]).transpose(0, 2, 1)
        return np.asarray(inverse), np.asarray(Q[:, :, r:])
    _, sigma, Vt = np.linalg.svd(J)
    rank = np.sum(sigma > _DEPENDENT * sigma[:, :1], axis=1)
    null = Vt.transpose(0, 2, 1) * (np.arange(J.shape[2]) >= rank[:, None])[:, None]
    return np.asarray(np.linalg.pinv(J, rcond=_DEPENDENT)), null[:, :, int(rank.min()) :]


def _times(A: Array, x: Array) -> Array:
    """Products A x of each instant."""
    return np.asarray((A @ x[:, :, None])[:, :, 0])


def _by(x: Array, A: Array) -> Array:
    """Products x A of each instant."""
    return np.asarray((x[:, None] @ A)[:, 0])
