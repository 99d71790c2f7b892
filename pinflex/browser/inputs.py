"""The motion of a run as a table that the kernel reads, of platform motions too.

Motors follow a platform by a spline of fifth degree through poses (`pinflex.actuation.drive`),
which no polynomial of a whole piece of the motion meets to round-off: each span of it is one then.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motions.motion import Motion
from pinflex.errors import DescriptionError
from pinflex.integrators.march import Radau
from pinflex.integrators.prescribed import tabulated
from pinflex.kernel.march import Table

_NODES = 6  # of a polynomial of fifth degree
_SPANS = (128, 256, 512, 1024, 2048)  # of the spline between start and end (`drive._interpolated`)
_ROUND_OFF = (
    1e-9  # of the accelerations, which the spline has from positions: eps over spans squared
)
_GAP, _AT_CORNER = 1e-9, 1e-12  # of the whole, as in `integrators.prescribed`


def tabulate(
    radau: Radau, motion: Motion, ends: tuple[float, float], corners: Sequence[float]
) -> None:
    """Let a run read its motion from a table.

    Raises:
        DescriptionError: It has none.
    """
    drive, problem = radau.problem.drive, radau.problem
    near = 1e-9 * (ends[1] - ends[0])  # of the stops of a march, the last of which is its end
    inner = [x for x in sorted(corners) if ends[0] < x < ends[1] - near]
    corners = [*inner, ends[1]]
    asked_for = (problem.motion, drive and drive.forward, *ends, *corners)
    n, forces = len(problem.motors), radau.compiled.kernel.counts["forces"]
    kinds = [slice(*pair) for pair in pairwise(np.cumsum([0, n, n, n, forces]))]
    table = tabulated(radau.at, kinds, *ends, corners) or _spline(radau, ends, inner)
    if table is None:
        raise DescriptionError(
            f"{motion.kind}: a motion that is no smooth function of time between its breaks: a "
            "page that computes cannot prescribe it."
        )
    radau.compiled.table = asked_for, table


def _spline(radau: Radau, ends: tuple[float, float], inner: Sequence[float]) -> Table | None:
    """A table of the spans of the spline that a platform is followed by; None: it is no such."""
    between = 0.5 * (_nodes()[1:] + _nodes()[:-1])
    weights = _weights()
    W = weights / (between[:, None] - _nodes())
    W /= W.sum(axis=1, keepdims=True)
    span = ends[1] - ends[0]
    for spans in _SPANS:
        marks = np.union1d(np.linspace(*ends, spans + 1), inner)
        marks = marks[np.append(True, np.diff(marks) > _AT_CORNER * span)]
        gap = _GAP * span * np.isin(marks, inner)
        begin, until = (marks + gap)[:-1], (marks - gap)[1:]
        middle, half = 0.5 * (begin + until), 0.5 * (until - begin)
        every = np.concatenate([_nodes(), between])
        whole = np.array([ends[0], *inner, ends[1]])
        found = radau.at(np.append((middle[:, None] + half[:, None] * every).ravel(), whole))
        inside = found[: -len(whole)].reshape(len(middle), len(every), -1)
        value, wanted = inside[:, :_NODES], inside[:, _NODES:]
        size = np.abs(value).max(axis=(0, 1), initial=0.0)
        missed = np.abs(W @ value - wanted).max(axis=(0, 1), initial=0.0)
        if np.all(missed <= _ROUND_OFF * size + 1e-300):
            rest = whole, found[-len(whole) :], _AT_CORNER * span
            return Table(_nodes(), weights, middle + half, middle, half, value, *rest)
    return None


def _angles() -> Array:
    return np.asarray(np.pi * (np.arange(_NODES) + 0.5) / _NODES)


def _nodes() -> Array:
    return np.asarray(np.cos(_angles()))


def _weights() -> Array:
    """Barycentric weights of the nodes, zeros of the Chebyshev polynomial."""
    return np.asarray(np.where(np.arange(_NODES) % 2, -1.0, 1.0) * np.sin(_angles()))
