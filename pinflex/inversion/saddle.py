"""The linear system of a command: a quadratic cost of poses, and rows of every instant, by time.

    [ H  G' ] [  dx ]   [ p ]
    [ G  0  ] [ dmu ] = [ e ]        G: rows of an instant by the poses about it, its multipliers

The closures and the platform's rows hold poses of one instant alone, and multipliers stand in rows
of one instant alone: both are solved for first, by a basis N of the moves that those rows allow and
a basis P of the forces that no multiplier bears. What is left couples five instants in turn,

    [ N'H N    (P'G N)' ] [  z ]
    [ P'G N        0    ] [ nu ]

with half as many unknowns and a band of under three instants, which LAPACK factorises with
pivoting.

Source: Nocedal, Wright (2006), Numerical Optimization, ch. 16.2 (null spaces); Golub, Van Loan
(2013), Matrix Computations, ch. 4.3 (bands).
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import as_strided, sliding_window_view

from pinflex.arrays import Array, IntArray
from pinflex.linalg import lapack

_REGULAR = 1e-13  # keeps the matrix regular where rows of several instants depend on each other
_DEPENDENT = 1e-11  # of the largest row: what is left of one that the others say already


class Saddle:
    """The factorised matrix.

    Attributes:
        pad: Poses on either side of an instant that its rows depend on.
    """

    def __init__(self, weights: Array, G: Array, forces: int) -> None:
        """H by pose (nt + 2 pad, nv, nv); G (nt, per, (2 pad + 1) nv + rows), its `forces` first.

        The rows below those hold poses of their own instant alone, and no multipliers.
        """
        nv, width = weights.shape[1], len(weights) - len(G) + 1
        self.pad, self._forces, self._weights = width // 2, forces, weights
        self._G = G[:, :forces, : width * nv].copy()
        held = G[:, forces:, self.pad * nv : (self.pad + 1) * nv]
        self._to_held, self._N = _split(held)
        self._to_borne, self._P = _split(G[:, :forces, width * nv :].transpose(0, 2, 1))
        self._places()
        self._factors, self._pivots = self._factorised()

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

    def _places(self) -> None:
        """Where the unknowns stand, along time: of a pose z, about it the halves of its nu."""
        (nt, nv, nz), nr, pad = self._N.shape, self._P.shape[2], self.pad
        self._sizes = np.full(nt + 2 * pad, nv)
        self._sizes[pad:-pad] = nz
        ahead, behind = np.zeros_like(self._sizes), np.zeros_like(self._sizes)
        ahead[pad:-pad], behind[pad:-pad] = nr // 2, nr - nr // 2
        ends = np.cumsum(ahead + self._sizes + behind)
        self._at_z = ends - behind - self._sizes
        of_instants = np.arange(nr) + (self._at_z - ahead)[pad:-pad, None]
        self._at_nu = np.where(np.arange(nr) < nr // 2, of_instants, of_instants + nz)
        back = self._at_nu[:, -1] - self._at_z[:nt]
        on = (self._at_z + self._sizes)[2 * pad :] - 1 - self._at_nu[:, 0]
        self._band, self._n = int(max(back.max(), on.max())), int(ends[-1])

    def _factorised(self) -> tuple[Array, IntArray]:
        """LU factors of the matrix, as LAPACK stores a band."""
        n, band, pad, rows = self._n, self._band, self.pad, 3 * self._band + 1
        store = np.zeros(n * rows)
        item = store.itemsize
        # entry (i, j) of the band stands at 2 band + i + j (rows - 1): blocks are views of it
        S = as_strided(store[2 * band :], (n, n), (item, (rows - 1) * item))
        bases = self._bases()
        for at, size, N, W in zip(self._at_z, self._sizes, bases, self._weights, strict=True):
            S[at : at + size, at : at + size] = N.T @ W @ N
        nv, half = self._N.shape[1], self._P.shape[2] // 2
        for k, (P, G, at_nu) in enumerate(zip(self._P, self._G, self._at_nu, strict=True)):
            found = P.T @ G
            for j in range(2 * pad + 1):
                at, size = self._at_z[k + j], self._sizes[k + j]
                block = found[:, j * nv : (j + 1) * nv] @ bases[k + j]
                for part in (slice(0, half), slice(half, None)):
                    first, some = at_nu[part][:1], block[part]
                    if len(some):
                        there = slice(int(first[0]), int(first[0]) + len(some))
                        S[there, at : at + size] = some
                        S[at : at + size, there] = some.T
        diagonal = store[2 * band :: rows]
        diagonal[self._at_nu] -= np.where(np.any(self._P, axis=1), _REGULAR, 1.0)
        at = self._at_z[pad:-pad, None] + np.arange(self._N.shape[2])
        diagonal[at] += np.where(np.any(self._N, axis=1), 0.0, 1.0)
        factors, pivots, _ = lapack().dgbtrf(store.reshape(n, rows).T, band, band, overwrite_ab=1)
        return factors, pivots

    def _bases(self) -> list[Array]:
        """Of each pose what moves are allowed; of those beyond the instants, all."""
        every = [np.eye(self._N.shape[1])] * self.pad
        return [*every, *self._N, *every]

    def _solved(self, p: Array, f: Array) -> tuple[Array, Array]:
        """Moves by z (nt + 2 pad, nv), and nu (nt, nr)."""
        right, pad, (nt, nv, nz) = np.zeros(self._n), self.pad, self._N.shape
        outside = self._at_z[[*range(pad), *range(-pad, 0)], None] + np.arange(nv)
        inside = self._at_z[pad:-pad, None] + np.arange(nz)
        ends = np.r_[:pad, nt + pad : nt + 2 * pad]
        right[outside], right[inside] = p[ends], _by(p[pad:-pad], self._N)
        right[self._at_nu] = f
        found, _ = lapack().dgbtrs(
            self._factors, self._band, self._band, right, self._pivots, overwrite_b=1
        )
        moves = np.empty_like(p)
        moves[ends], moves[pad:-pad] = found[outside], _times(self._N, found[inside])
        return moves, found[self._at_nu]


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
