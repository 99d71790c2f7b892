"""The coordinate map of equal bodies, evaluated on preallocated arrays: X = Phi + G eta."""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.expanded import Block


class CoordinateMap:
    """One stacked block of X and its rates, on preallocated arrays."""

    def __init__(self, block: Block) -> None:
        self.block = block
        bodies, _, n = block.Phi.shape
        self.curved = block.G.shape[1]
        self.shape = (bodies, n, 1)
        self.X = block.Phi.copy()
        self.X_curved = self.X[:, : self.curved]
        self.X_turned = self.X.transpose(0, 2, 1)
        self.Phi_curved = block.Phi[:, : self.curved]
        self._G = block.G.reshape(bodies, self.curved * n, n)
        self._bent_shape = (bodies, self.curved, n)
        self.rate = np.zeros(self._bent_shape)
        self.force_rows = block.rows.reshape(-1)

    def bend(self, eta: Array) -> Array:
        """G eta of the curved rows, shape (bodies, Rc, n), for eta of the stacked bodies."""
        bent: Array = np.matmul(self._G, eta.reshape(self.shape))
        return bent.reshape(self._bent_shape)

    def place(self, eta: Array) -> Array:
        """Sets X; returns the coordinates Phi eta + 1/2 eta' G eta, flat."""
        column = eta.reshape(self.shape)
        lift: Array = np.matmul(self.block.Phi, column)
        if self.curved:
            bent = self.bend(eta)
            np.add(self.Phi_curved, bent, out=self.X_curved)
            lift[:, : self.curved] += 0.5 * np.matmul(bent, column)
        return lift.reshape(-1)
