"""Kinematics and forces at the samples of a run, each computed on first use."""

from __future__ import annotations

from functools import cached_property

from pinflex.arrays import Array, IntArray
from pinflex.integrators.run import Run
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.forces import Forces, forces, slide
from pinflex.recovery.kinematics import Kinematics, kinematics


class Samples:
    """The samples of one run; no workspace is kept between the two passes over them."""

    def __init__(self, mechanism: Mechanism, run: Run) -> None:
        self.mechanism, self.run = mechanism, run

    @cached_property
    def kinematics(self) -> Kinematics:
        """Poses, rates and energies."""
        return kinematics(self.mechanism, self.run)

    @cached_property
    def forces(self) -> Forces:
        """Expanded forces, and those of joints, loops and sleeves."""
        return forces(self.mechanism, self.run)

    def interface_load(self, joint: int, rows: IntArray) -> tuple[Array, Array]:
        """Force and moment, in the beam frame, that what hangs on an interface needs."""
        joint = slide(self.run.system.expansion.model, joint, rows)
        return self.forces.f[:, joint, :3], self.forces.f[:, joint, 3:]
