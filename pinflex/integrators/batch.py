"""A batch of steps as the kernel leaves them, and the states that are read off it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from pinflex.arrays import Array, IntArray
    from pinflex.integrators.compiled import Stages
    from pinflex.kernel.march import MarchKernel, Table

STATE = ("y", "v", "a", "lam", "torque")


class States(NamedTuple):
    """States at k instants, as they are recorded.

    Attributes:
        y: Shape (k, nq). v, a: Shape (k, nv). lam: Shape (k, rows). torque: Shape (k, nm).
        work: Of the motors and of the damping since the start of the step, J, shape (k, 2).
    """

    y: Array
    v: Array
    a: Array
    lam: Array
    torque: Array
    work: Array


class Batch:
    """Steps that the kernel has made, until it makes others: read them off before.

    Attributes:
        stages: The method. kernel: Arrays of the steps, of which those from 1 on are meant.
        table: What is prescribed, or None.
    """

    def __init__(self, stages: Stages, kernel: MarchKernel, table: Table | None, size: int) -> None:
        self.stages, self.kernel, self.table, self._size = stages, kernel, table, size

    def __len__(self) -> int:
        return self._size

    def upto(self, size: int) -> Batch:
        """The first of its steps."""
        return Batch(self.stages, self.kernel, self.table, size)

    @property
    def t(self) -> Array:
        """Starts of the steps, s, shape (k,)."""
        return self.kernel.steps["t"][1 : self._size + 1]

    @property
    def h(self) -> Array:
        """Their lengths, s, shape (k,)."""
        return self.kernel.steps["h"][1 : self._size + 1]

    @property
    def ends(self) -> Array:
        """Their ends, s, a little later than they are: a sample that rounds to one is in it."""
        return np.asarray(self.t + (1.0 + 1e-9) * self.h)

    def states(self) -> States:
        """States at their ends, without work."""
        kernel, end = self.kernel, self._size + 2
        columns = [kernel.steps[f"{name}0"][2:end].copy() for name in STATE]
        if self._size == kernel.at.count:  # that of the last one is where the run is
            columns = [
                np.vstack([x[: end - 3], getattr(kernel, name)])
                for name, x in zip(STATE, columns, strict=True)
            ]
        y, v, a, lam, torque = columns
        return States(y, v, a, lam, torque, np.zeros((self._size, 2)))

    def samples(self, t: Array, of: IntArray, room: States) -> None:
        """Read off states."""
        self.kernel.samples(t, of + 1, None if self.table else self.stages.at(t), room)

    def works(self) -> Array:
        """Work of the motors and of the damping in each step, J, shape (k, 2)."""
        power = self.kernel.steps["power"][1 : self._size + 1]
        return np.asarray(self.h[:, None] * (self.stages.method.A[-1] @ power))
