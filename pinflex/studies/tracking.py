"""Tracking of modes from pose to pose, where frequencies cross."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np

from pinflex.arrays import Array, IntArray

Place = tuple[int, ...]  # of a pose in the grid


def matched(before: Array, now: Array, M: Array) -> tuple[IntArray, Array]:
    """Match shapes to those of a neighbouring pose by the largest sum of squared cosines.

    Cosines are those of the mass matrix: shapes of different frequencies are at right angles, and
    shapes of equal ones, which may turn among themselves, stay among themselves.

    Returns:
        Columns of now in the order of those before, and their squared cosines (the modal assurance
        criterion, 1 for the same shape), shape (min(k, m),) each.
    """
    from scipy.optimize import linear_sum_assignment

    size = np.sqrt(np.einsum("ik,ij,jk->k", before, M, before))
    agreement = np.square((before / size).T @ M @ now)
    rows, columns = linear_sum_assignment(-agreement)
    return np.asarray(columns), np.asarray(agreement[rows, columns])


def tracked(
    shapes: Mapping[Place, Array],
    mass: Callable[[Place], Array],
    count: int,
    first: Place | None = None,
) -> dict[Place, tuple[IntArray, float]]:
    """Follow modes over a grid of poses, away from the first, along the neighbours most alike.

    Of all poses that border on one already followed, the next is always the one whose modes agree
    best with that neighbour's. So a line of poses at which two frequencies (nearly) coincide, and
    shapes mix, is walked round where that is possible.

    Returns:
        By place: the columns in the common order, and the least squared cosine of the first
        `count` modes to the neighbour that they follow (1 at the first place).
    """
    if not shapes:
        return {}
    far = [max(place[axis] for place in shapes) for axis in range(len(next(iter(shapes))))]
    middle = tuple(n / 2 for n in far)
    place = min(shapes, key=lambda at: _distance(at, middle)) if first is None else first
    orders = {place: (np.arange(shapes[place].shape[1], dtype=np.intp), 1.0)}
    border: list[tuple[float, int, Place, IntArray]] = []
    number = itertools.count()  # of two that agree alike the earlier

    def look(place: Place, there: Place) -> None:
        order, agreement = matched(shapes[place][:, orders[place][0]], shapes[there], mass(there))
        least = float(np.min(agreement[:count], initial=1.0))
        heapq.heappush(border, (-least, next(number), there, order))

    while len(orders) < len(shapes):
        for there in _neighbours(place):
            if there in shapes and there not in orders:
                look(place, there)
        while border and border[0][2] in orders:
            heapq.heappop(border)
        if not border:
            # an island behind poses that do not exist: over the shortest gap
            look(*_shortest_gap(orders, [p for p in shapes if p not in orders]))
        least, _, place, order = heapq.heappop(border)
        orders[place] = (order, -least)
    return orders


def _shortest_gap(followed: Iterable[Place], rest: Sequence[Place]) -> tuple[Place, Place]:
    """The followed pose and the other one that are closest."""
    return min(((a, b) for a in followed for b in rest), key=lambda pair: _distance(*pair))


def _neighbours(place: Place) -> Iterator[Place]:
    for axis in range(len(place)):
        for step in (-1, 1):
            yield (*place[:axis], place[axis] + step, *place[axis + 1 :])


def _distance(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return float(np.sum(np.square(np.subtract(a, b))))
