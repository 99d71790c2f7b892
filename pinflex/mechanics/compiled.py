"""The equations of a system on the compiled kernel, where there is one and it covers the system."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.kernel.evaluate import Evaluator
from pinflex.kernel.library import kernel

if TYPE_CHECKING:
    from pinflex.mechanics.system import System


def on_kernel(system: System) -> Compiled | None:
    """The compiled equations of a system; None: those of numpy and Pinocchio serve."""
    return Compiled(system) if serves(system) else None


def serves(system: System, marched: bool = False) -> bool:
    """Whether the compiled kernel evaluates a system.

    Where nothing gives way the equations are Pinocchio itself, to the last bit, but in a march.

    Args:
        system: That is evaluated. marched: In the steps of level coupled.
    """
    if kernel().functions is None or (_stiff(system) and not marched):
        return False
    return system.uncovered is None


def evaluated_by(system: System, marched: bool = False) -> str:
    """Which equations serve a system: the build of the kernel, or why it is not used.

    Args:
        system: That is evaluated. marched: In the steps of level coupled.
    """
    library = kernel()
    if _stiff(system) and not (marched and serves(system, True)):
        return "Pinocchio (nothing gives way)"
    if library.functions is None:
        return f"numpy and Pinocchio (kernel: {library.said})"
    if system.uncovered is not None:
        return f"numpy and Pinocchio (the kernel has no {system.uncovered})"
    return f"kernel ({library.said})"


def _stiff(system: System) -> bool:
    return system.n_eta == 0 and not len(system.springs.v_at)


class Compiled:
    """Residual, closures and their derivatives of one system (make one per run, and per thread).

    Attributes:
        evaluator: The compiled functions.
    """

    def __init__(self, system: System) -> None:
        self.evaluator = Evaluator(system.tables)
        self._forces = [force for force, _ in system.loads.forces]

    def residual(
        self, Y: Array, V: Array, A: Array, lam: Array, t: Array | Sequence[float | Array]
    ) -> tuple[Array, Array]:
        """Residuals (n, nv) and closures (n, rows) of several states.

        Args:
            Y: Shape (n, nq). V, A: Shape (n, nv). lam: Shape (n, rows), N | N m.
            t: Times in s, at which the loads are taken, shape (n,).
        """
        return self.evaluator.residuals(Y, V, A, lam, self.scale(t))

    def tangent(
        self, y: Array, v: Array, a: Array, lam: Array, t: float, rates: bool = True
    ) -> tuple[Array, Array, Array, Array]:
        """M, C, K (nv, nv) and J (rows, nv) at a state.

        Args:
            y: Shape (nq,). v, a: Shape (nv,). lam: Shape (rows,). t: Time in s.
            rates: With what the rates of the second-order rows bring.
        """
        return self.evaluator.tangent(y, v, a, lam, self.scale((t,))[0], rates)

    def scale(self, t: Array | Sequence[float | Array]) -> Array:
        """Shares of the loads that act at times t (n,), shape (n, forces)."""
        scale = np.empty((len(t), len(self._forces)))
        for k, force in enumerate(self._forces):
            scale[:, k] = [force.scale(float(time)) for time in t]
        return scale
