"""The band of a command's linear system against the whole matrix, written out.

Claims:
    Commands: motions that the platform follows
    - linear system of a command as a band in time, rows that depend on each other | the whole
      matrix | 1e-10 | 2e-12
"""

from __future__ import annotations

import numpy as np
import pytest

from pinflex.inversion.saddle import Saddle

NT, NV, ROWS, FORCES, PAD = 7, 6, 2, 5, 2
HELD, WIDTH = NV + ROWS - FORCES, 2 * PAD + 1


@pytest.mark.parametrize("dependent", [False, True])
def test_all_instants_are_solved_as_by_the_whole_matrix(dependent: bool) -> None:
    """Also where at two instants two held rows are one, and two multipliers do the same."""
    rng, poses, per = np.random.default_rng(3), (NT + 2 * PAD) * NV, FORCES + HELD
    G = np.zeros((NT, per, WIDTH * NV + ROWS))
    G[:, :FORCES] = rng.normal(size=(NT, FORCES, WIDTH * NV + ROWS))
    G[:, FORCES:, PAD * NV : (PAD + 1) * NV] = rng.normal(size=(NT, HELD, NV))
    if dependent:
        G[2:4, FORCES + 1] = 2.0 * G[2:4, FORCES]
        G[2:4, :FORCES, WIDTH * NV] = G[2:4, :FORCES, WIDTH * NV + 1]
    W = rng.normal(size=(NT + 2 * PAD, NV, NV))
    W = W @ W.transpose(0, 2, 1) + np.eye(NV)
    unknown = poses + NT * ROWS
    whole = np.zeros((unknown + NT * per,) * 2)
    for k, block in enumerate(W):
        whole[k * NV : (k + 1) * NV, k * NV : (k + 1) * NV] = block
    for k, rows in enumerate(G):
        here = slice(unknown + k * per, unknown + (k + 1) * per)
        whole[here, k * NV : (k + WIDTH) * NV] = rows[:, : WIDTH * NV]
        whole[here, poses + k * ROWS : poses + (k + 1) * ROWS] = rows[:, WIDTH * NV :]
    whole[:unknown, unknown:] = whole[unknown:, :unknown].T
    true = rng.normal(size=len(whole))
    p, s, e = np.split(whole @ true, [poses, unknown])
    x, lam, mu = Saddle(W, G, FORCES).solve(
        p.reshape(-1, NV), s.reshape(NT, ROWS), e.reshape(NT, per)
    )
    # round-off of numbers of order 10 to 100 in a matrix of condition 1e3
    assert x.ravel() == pytest.approx(true[:poses], abs=1e-10)
    found = np.concatenate([x.ravel(), lam.ravel(), mu.ravel()])
    assert whole @ found == pytest.approx(whole @ true, abs=1e-10)
