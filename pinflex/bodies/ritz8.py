"""The Ritz link of eight end coordinates, without the two that move it as a whole."""

from __future__ import annotations

import numpy as np

from pinflex.bodies.family import BENDING, Family, combine, hermite


def ritz8(length: float, direction: str, shear_ratio: float) -> Family:
    """End coordinates q1..q8 of a link: stretch, rotations about z and y, twist of both ends.

    The source's bending functions are linear, which bends nothing while its stiffness is that of
    end rotations: here q2, q3, q6, q7 are these rotations, against the chord, and the
    twist has the stiffness G J / l.
    The frame of the link is fixed to its root section, not to the chord, so the shapes are those
    of the chord less a rotation; q1 and q4 move the whole link, which its joint does already.

    Source: Liu, Zhu, Zhao, the link of the 3-TPT (models/3tpt/SOURCE.md).
    """
    one = hermite(length, 1, "cubic", direction=direction, shear_ratio=shear_ratio)
    if direction in BENDING:
        names = ("q2", "q6") if direction == "v" else ("q3", "q7")
        return combine(one, np.array([[-length, 0.0], [-1.0, 1.0]]), names)
    return combine(one, np.eye(1), ("q5" if direction == "u" else "q8",))
