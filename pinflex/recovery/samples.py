"""The samples of a run: how it moves and what that takes, each found when first asked for."""

from __future__ import annotations

from functools import cached_property

from pinflex.arrays import Array, IntArray
from pinflex.integrators.run import Run
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.forces import Forces, forces, slide
from pinflex.recovery.kinematics import Moves, moves


class Samples:
    """The samples of one run; no workspace is kept between the two passes over them."""

    def __init__(self, mechanism: Mechanism, run: Run) -> None:
        self.mechanism, self.run = mechanism, run

    @cached_property
    def moves(self) -> Moves:
        """Poses, rates and energies."""
        return moves(self.mechanism, self.run)

    @cached_property
    def forces(self) -> Forces:
        """Expanded forces, and those of joints, loops and sleeves."""
        return forces(self.mechanism, self.run, self.moves.poses)

    def interface_load(self, joint: int, rows: IntArray) -> tuple[Array, Array]:
        """Force and moment, in the beam frame, that what hangs on an interface needs."""
        joint = slide(self.run.system.expansion.model, joint, rows)
        return self.forces.f[:, joint, :3], self.forces.f[:, joint, 3:]
