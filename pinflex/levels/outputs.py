"""What a run is judged by: how far two runs of one system differ, output by output.

The difference of an output is its largest one over the samples, relative to the largest value it
takes; of the platform's pose, relative to its largest deviation from the rigid motion. Torques that
dry friction makes jump differ by their root mean square: a jump an instant later is no error. An
output
that is zero throughout (the torque of no motor, a platform that does not turn) is left out: nothing
can be said of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array
from pinflex.description.motion import Motion
from pinflex.description.solve import ASKED
from pinflex.errors import SceneError
from pinflex.integrators.run import Run
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.frames import Frame
from pinflex.mechanics.mechanism import Mechanism

_SAMPLES = 51  # instants at which poses are compared: the samples, or every k-th of more
ROUND_OFF = 1e-10  # relative: no estimate is smaller, for the sums of thousands of steps are not
# m or rad: below, there is no deviation to speak of.
STILL = 1e-9

REST = 1e-12  # m or rad


class Outputs:
    """What a tolerance is about: torques, elastic coordinates and the platform's pose."""

    def __init__(
        self,
        mechanism: Mechanism,
        motion: Motion,
        t: Array,
        asked: Sequence[str] = ASKED,
        dynamics: Equations | None = None,
    ) -> None:
        self._asked, self._dynamics = asked, dynamics  # a new workspace is dear in large models
        self._mechanism, self._motion, self._t = mechanism, motion, t
        self._keep = slice(None, None, -(-len(t) // _SAMPLES))
        self._rigid: tuple[Array, Array] | None = None
        self._before: tuple[Run, tuple[Array, Array]] | None = None

    def differences(self, coarse: Run, fine: Run) -> dict[str, float]:
        """Relative difference of two runs at the same samples, by output."""
        found: dict[str, float | None] = {}
        if np.ptp(fine.y, axis=0).max(initial=0.0) < REST:
            return {}  # at rest: round-off is all that differs
        system, elastic = fine.system, fine.system.n_eta
        if "torque" in self._asked:
            jumps = system.sticks(fine.settings.get("drive") != "torque")
            measure = mean_square if jumps else relative_or_none
            found["torque"] = measure(coarse.torque, fine.torque)
        n = int(system.rigid.nq)
        if elastic and "deflection" in self._asked:
            found["deflection"] = relative_or_none(coarse.y[:, n:], fine.y[:, n:])
        gives_way = elastic or len(self._mechanism.rigid.held)
        if self._mechanism.description.platform and gives_way and "platform" in self._asked:
            found |= self._platform(coarse, fine)
        if self._swings(fine) or not any(found.values()):
            found |= self._joints(coarse, fine)
        return {key: error for key, error in found.items() if error is not None}

    def _swings(self, run: Run) -> bool:
        """Whether joints move that motors and motion do not determine."""
        return (
            self._mechanism.report.mobility != len(run.system.motors)
            or run.settings.get("drive") == "torque"
        )

    def _joints(self, coarse: Run, fine: Run) -> dict[str, float | None]:
        """Of the positions of all joints, over their largest way from the first, and speeds."""
        rigid = fine.system.rigid
        nq, nv = int(rigid.nq), int(rigid.nv)
        pairs = zip(coarse.y[:, :nq], fine.y[:, :nq], strict=True)
        apart = np.array([pin.difference(rigid, a, b) for a, b in pairs])
        first = fine.y[0, :nq]
        way = np.array([pin.difference(rigid, first, q) for q in fine.y[:, :nq]])
        scale = float(np.max(np.abs(way), initial=0.0))
        far = float(np.max(np.abs(apart), initial=0.0))
        return {
            "joint positions": far / scale if scale > STILL else None,
            "joint speeds": relative_or_none(coarse.v[:, :nv], fine.v[:, :nv]),
        }

    def _platform(self, coarse: Run, fine: Run) -> dict[str, float | None]:
        p, R = self._poses(coarse)
        p_fine, R_fine = self._poses(fine)
        p_rigid, R_rigid = self._rigid_poses(fine)
        scale = np.abs(p_fine - p_rigid).max(), np.abs(between(R_rigid, R_fine)).max()
        apart = np.abs(p - p_fine).max(), np.abs(between(R, R_fine)).max()
        names = "platform position", "platform rotation"
        return {
            key: float(a / s) if s > STILL else None
            for key, a, s in zip(names, apart, scale, strict=True)
        }

    def _poses(self, run: Run) -> tuple[Array, Array]:
        if self._before is not None and self._before[0] is run:
            return self._before[1]
        dynamics = self._dynamics or Equations(run.system)
        poses = platform_poses(self._mechanism, dynamics, run.y[self._keep])
        self._before = run, poses
        return poses

    def _rigid_poses(self, run: Run) -> tuple[Array, Array]:
        """Of the rigid motion; where it is not known, the first pose of the run."""
        if self._rigid is None:
            dynamics, q = Equations(self._mechanism.rigid), None
            try:
                q = nominal(self._mechanism, self._motion, self._t).q[self._keep]
            except SceneError:
                q = np.tile(run.y[:1, : int(run.system.rigid.nq)], (len(self._t[self._keep]), 1))
            self._rigid = platform_poses(self._mechanism, dynamics, q)
        return self._rigid


def platform_poses(mechanism: Mechanism, dynamics: Equations, y: Array) -> tuple[Array, Array]:
    """Position (m), shape (n, 3), and rotation (n, 3, 3) of the platform at poses y (n, nq)."""
    platform = dynamics.system.expansion.frames[str(mechanism.description.platform)]
    R, p = Frame(dynamics.model, platform).pose(dynamics.joint_poses(y))
    return p, R


def relative(a: Array, b: Array) -> float:
    """Largest difference of two histories over the largest value of the second."""
    scale = float(np.max(np.abs(b), initial=0.0))
    apart = float(np.max(np.abs(a - b), initial=0.0))
    return apart / scale if scale > 0 else np.inf if apart > 0 else 0.0


def relative_or_none(a: Array, b: Array) -> float | None:
    """`relative`, or None where both are zero throughout."""
    return relative(a, b) if np.any(b) or np.any(a) else None


def mean_square(a: Array, b: Array) -> float | None:
    """Root mean square of a difference over that of the second, or None where both are zero."""
    if not (np.any(b) or np.any(a)):
        return None
    size = float(np.sqrt(np.mean(np.square(b))))
    return float(np.sqrt(np.mean(np.square(a - b)))) / size if size > 0 else np.inf


def between(a: Array, b: Array) -> Array:
    """Rotation vectors from a to b, shape (n, 3): small ones, by their skew part."""
    turn = np.matmul(a.transpose(0, 2, 1), b)
    skew = turn - turn.transpose(0, 2, 1)
    return 0.5 * np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
