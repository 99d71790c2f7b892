"""Why a platform's path ends at a pose: links in line, stretched or folded.

At the limit of its reach a mechanism can turn some joints without moving the platform, to first
order: in an arm of two links where both are in line. So the joints of that motion are put in order
along the mechanism, through a loop if it leads on, and their places are looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from pinflex.arrays import Array
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.frames import poses_of_frames
from pinflex.mechanics.mechanism import Mechanism

_TAKES_PART = 0.1  # of the largest turn of a joint in the motion
_IN_LINE = 0.01  # [rad] between links: a path is followed to 1e-4 rad of its end
_HERE = 1e-9  # [m]


def in_line(
    mechanism: Mechanism, dynamics: Equations, pose: Array, motion: Array
) -> tuple[list[str], bool] | None:
    """Links that are in line at a pose and whether stretched (or folded); None where none are."""
    links, frames = mechanism.links, mechanism.rigid.expansion.frames
    number = {link.name: k for k, link in enumerate(links)}
    model = dynamics.model
    large = np.flatnonzero(np.abs(motion) > _TAKES_PART * np.abs(motion).max())
    moving = {
        name
        for name, joint in zip(model.names[1:], model.joints[1:], strict=True)
        if np.any((large >= joint.idx_v) & (large < joint.idx_v + joint.nv))
    }

    def above(k: int) -> list[int]:
        """Links from the root to one, whose joints take part."""
        found: list[int] = []
        while k >= 0:
            if any(step.name in moving for step in links[k].steps):
                found.insert(0, k)
            k = links[k].parent
        return found

    ends = [(loop.frame_a, loop.frame_b) for loop in mechanism.description.loops]
    platform = mechanism.description.platform
    ends += [(platform, platform)] if platform is not None else []
    for pair in ends:
        sides = [above(number[name]) if name in number else [] for name in dict.fromkeys(pair)]
        chain = [*sides[0], *reversed(sides[-1] if len(sides) > 1 else [])]
        if sum(any(s.name in moving for s in link.steps) for link in links) != len(chain):
            continue  # other joints take part
        end = next(name for name in pair if name in number)
        order = [
            *(links[k].name for k in sides[0]),
            end,
            *(links[k].name for k in chain[len(sides[0]) :]),
        ]
        placed = poses_of_frames(dynamics, pose[None], [frames[name] for name in order])
        found = _straight(order, [p[0] for _, p in placed], len(sides[0]))
        if found is not None:
            return found
    return None


def _straight(
    names: Sequence[str], places: Sequence[Array], end: int
) -> tuple[list[str], bool] | None:
    """Names of links, whose joints' places follow each other, if all are in line."""
    apart = [b - a for a, b in pairwise(places)]
    # before the end a link leads from its joint to the next place, after it to the one before
    carried = [names[k] if k < end else names[k + 1] for k in range(len(apart))]
    pairs = [
        (d / np.linalg.norm(d), n)
        for d, n in zip(apart, carried, strict=True)
        if np.linalg.norm(d) > _HERE
    ]
    if len(pairs) < 2:
        return None
    turns = [float(np.linalg.norm(np.cross(pairs[0][0], d))) for d, _ in pairs[1:]]
    if max(turns) > _IN_LINE:
        return None
    return [n for _, n in pairs], all(float(pairs[0][0] @ d) > 0 for d, _ in pairs[1:])
