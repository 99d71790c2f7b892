"""What a run prescribes in time as a table of polynomials, which the compiled march reads.

Between corners motors and loads move smoothly: polynomials through Chebyshev points of pieces, that
are halved until round-off is all they miss between the points. What is not so smooth (samples,
other interpolations) has no table.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from pinflex.arrays import Array
from pinflex.kernel.march import Table

_NODES = 25  # and as many less one between them
_FEW = 7  # where it is a polynomial of fifth degree on pieces that are known
_ROUND_OFF = 3e-14  # of the largest value of a kind: what may be missed; seen: 2e-15
# Of it: what may be missed where a half misses as much as its whole: the function's own round-off,
# or a kink so small.
_NOISE, _NO_BETTER = 1e-11, 0.5
_ROUNDS = 4  # of halving those that are not close, the first without
_CORNER_GAP = 1e-9  # of the whole: a piece ends just before its corner, where inputs may jump
_AT_CORNER = 1e-12  # of the whole: what round-off moves a corner by


def tabulated(
    function: Callable[[Array], Array],
    kinds: Sequence[slice],
    start: float,
    end: float,
    corners: Sequence[float],
    pieces: Array | None = None,
) -> Table | None:
    """The table of a function of time; None where it is not smooth between its corners.

    `pieces`: times (s) between which motors follow polynomials of fifth degree, where they do.
    """
    span = end - start
    gap = _CORNER_GAP * span
    inside = [c for c in sorted(set(corners)) if start + gap < c < end - gap]
    ends, count = np.array([start, *inside, end]), _NODES
    if pieces is not None:
        apart = np.abs(pieces[:, None] - ends).min(axis=1) > 10.0 * gap
        between = (pieces > start) & (pieces < end)
        ends, count = np.sort(np.concatenate([ends, pieces[apart & between]])), _FEW
    begin, until = ends[:-1] + gap, ends[1:] - gap
    whole = np.array([start, *(c for c in corners if start < c < end), end])
    size, corner_value = np.full(len(kinds), 1e-300), None
    done: list[tuple[Array, Array, Array]] = []
    before = np.full((len(kinds), len(begin)), np.inf)
    for _ in range(_ROUNDS):
        middle, half = 0.5 * (begin + until), 0.5 * (until - begin)
        more = whole if corner_value is None else whole[:0]
        values, missed, others = _pieces(function, middle, half, more, count)
        corner_value = others if corner_value is None else corner_value
        size = np.maximum(size, [np.abs(values[..., k]).max(initial=0.0) for k in kinds])
        worst = np.stack([missed[:, k].max(axis=1, initial=0.0) for k in kinds]) / size[:, None]
        noise = (worst <= _NOISE) & (worst > _NO_BETTER * before)
        good = np.all((worst <= _ROUND_OFF) | noise, axis=0)
        done.append((middle[good], half[good], values[good]))
        if good.all():
            break
        begin, until, middle = begin[~good], until[~good], middle[~good]
        begin, until = np.concatenate([begin, middle]), np.concatenate([middle, until])
        before = np.tile(worst[:, ~good], 2)
    else:
        return None
    middle, half, value = (np.concatenate(parts) for parts in zip(*done, strict=True))
    order = np.argsort(middle)
    middle, half, value = middle[order], half[order], value[order]
    # Between two pieces, in the gap of a corner, either holds.
    rest = (middle + half, middle, half, value, whole, corner_value, _AT_CORNER * span)
    return Table(_nodes(count), _weights(count), *rest)


def read(table: Table, t: Array) -> Array:
    """Values of a table at times, as the kernel reads them (source/inputs.c).

    Returns:
        Columns, shape (k, n).
    """
    piece = np.minimum(np.searchsorted(table.end, t), len(table.end) - 1)
    piece[(piece > 0) & (t < table.middle[piece] - table.half[piece])] -= 1  # just before a corner
    away = ((t - table.middle[piece]) / table.half[piece])[:, None] - table.node
    hit = away == 0.0
    W = np.where(hit.any(axis=1, keepdims=True), hit, table.weight / np.where(hit, 1.0, away))
    W /= W.sum(axis=1, keepdims=True)
    found = np.einsum("kn,knj->kj", W, table.value[piece])
    if len(table.corner):
        nearest = np.argmin(np.abs(t[:, None] - table.corner), axis=1)
        at = np.abs(t - table.corner[nearest]) <= table.gap
        found[at] = table.corner_value[nearest[at]]
    return np.asarray(found)


def _pieces(
    function: Callable[[Array], Array], middle: Array, half: Array, more: Array, count: int
) -> tuple[Array, Array, Array]:
    """Values at the nodes of pieces, (pieces, nodes, n), and misses between, (pieces, n).

    And values at times `more`, for every call of the function has its price.
    """
    at = np.concatenate([_nodes(count), _between(count)])
    times = (middle[:, None] + half[:, None] * at).ravel()
    found = function(np.concatenate([times, more]))
    inner, others = found[: len(times)].reshape(len(middle), len(at), -1), found[len(times) :]
    values, wanted = inner[:, :count], inner[:, count:]
    return values, np.abs(_interpolation(count) @ values - wanted).max(axis=1, initial=0.0), others


@cache
def _angles(count: int) -> Array:
    return np.asarray(np.pi * (np.arange(count) + 0.5) / count)


@cache
def _nodes(count: int) -> Array:
    """Zeros of the Chebyshev polynomial."""
    return np.asarray(np.cos(_angles(count)))


@cache
def _weights(count: int) -> Array:
    """Barycentric weights of the nodes."""
    return np.asarray(np.where(np.arange(count) % 2, -1.0, 1.0) * np.sin(_angles(count)))


@cache
def _between(count: int) -> Array:
    """Points between the nodes."""
    return np.asarray(np.cos(_angles(count)[:-1] + 0.5 * np.pi / count))


@cache
def _interpolation(count: int) -> Array:
    """Values at the nodes to those between them, shape (nodes - 1, nodes)."""
    W = _weights(count) / (_between(count)[:, None] - _nodes(count))
    return np.asarray(W / W.sum(axis=1, keepdims=True))
