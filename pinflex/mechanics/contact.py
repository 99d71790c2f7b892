"""Where a sleeve is on its beam, and the section forces that it adds there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array, BoolArray
from pinflex.errors import MotionError

if TYPE_CHECKING:
    from pinflex.mechanics.slider import Sleeve


def off_beam(sleeve: Sleeve, place: Array) -> BoolArray:
    """Whether an end of a sleeve lies beyond an end of its beam, shape as `place`."""
    # An end may stand on an end of the beam, up to what closing the loops leaves.
    slack = 1e-9 * sleeve.length
    return np.asarray(
        np.abs(place - 0.5 * sleeve.length) + sleeve.half > 0.5 * sleeve.length + slack
    )


def left_beam(sleeve: Sleeve, place: float, name: str, where: str, t: float | None) -> MotionError:
    """The error that a sleeve has left its beam."""
    when = where if t is None else f"{where}: t = {t:.6g} s"
    reach = f"x = {place:.6g} m"
    if sleeve.half:
        reach += f", from {place - sleeve.half:.6g} to {place + sleeve.half:.6g} m"
    return MotionError(
        f'{when}: sleeve "{name}" leaves the beam {sleeve.link}: it is at {reach}, the beam '
        f"ends at 0 and {sleeve.length:g} m. Shorten the motion, or lengthen the beam.",
        loop=name,
        position=place,
        time=t,
    )


def section_forces(x: Array, forces: Array, segment: int = 0, roots: Array | None = None) -> Array:
    """Section forces N, Vy, Vz, T, My, Mz that a sleeve adds on a segment, shape (nt, nx, 6).

    What stands on later segments is in the forces of the interface; there it acts with the root of
    the segment that the sleeve is on.
    """
    on = forces[:, 0, 7]
    at, F, M = forces[:, :, 0], forces[:, :, 1:4], forces[:, :, 4:7]
    if roots is not None and np.any(on != segment):
        own, there = roots[segment], roots[on.astype(int), np.arange(len(on))]
        turn = np.swapaxes(own[:, :, :3], 1, 2) @ there[:, :, :3]
        shift = np.einsum("tji,tj->ti", own[:, :, :3], there[:, :, 3] - own[:, :, 3])
        at = at * turn[:, :1, 0] + shift[:, :1]
        F, M = F @ turn.swapaxes(1, 2), M @ turn.swapaxes(1, 2)
    arm = at[:, None, :] - x[None, :, None]
    counted = (arm >= 0.0).astype(float) - (on > segment)[:, None, None]
    Fx, Fy, Fz, Mx, My, Mz = (part[:, None, :, k] for part in (F, M) for k in range(3))
    parts = (Fx, Fy, Fz, Mx, My - arm * Fz, Mz + arm * Fy)
    return np.stack([np.sum(counted * p, axis=2) for p in parts], axis=2)
