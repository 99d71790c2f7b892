"""What measurements say of parameters: covariance, and what they cannot tell apart.

J holds the derivatives of residuals, in standard deviations, by logarithms of parameters; the
covariance of the logarithms is (J' J)^-1. A column without size is a parameter that nothing
measured depends on; a singular vector without size, of J with unit columns, is a change of several
parameters that nothing measured sees.

Source: Belsley, Kuh, Welsch (1980), Regression Diagnostics, ch. 3.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinflex.arrays import Array, BoolArray, IntArray

_SILENT = 1e-6  # column over the largest: derivatives by differences carry 1e-7
_SAME = 1e-3  # singular value of unit columns: a thousandth of what one parameter does
_UNKNOWN = 1.0  # standard deviation of the logarithm of a hidden parameter
_SHARE = 0.05  # of a singular vector: a parameter that takes part in it
_POOR = 0.5  # a quarter of the width of an interval [ln]: known to a factor 2.7 either way
_TWINS = 0.98  # correlation at which two estimates are one


def unseen(J: Array) -> tuple[IntArray, Array]:
    """Silent parameters, and changes of the others that nothing measured sees.

    Returns:
        Places of silent parameters; directions of the logarithms, shape (directions, n).
    """
    size = np.linalg.norm(J, axis=0)
    silent = size <= _SILENT * np.max(size, initial=0.0)
    loud = np.flatnonzero(~silent)
    unit = J[:, loud] / size[loud]
    _, values, V = np.linalg.svd(unit, full_matrices=True)
    values = np.concatenate([values, np.zeros(len(loud) - len(values))])
    found = np.zeros((int(np.sum(values < _SAME)), J.shape[1]))
    found[:, loud] = V[values < _SAME] / size[loud]
    return np.flatnonzero(silent), found


def covariance(J: Array, hidden: BoolArray) -> Array:
    """Covariance of the logarithms, shape (n, n); infinite for what takes part in hidden changes.

    The errors of the others include what the hidden ones do to them: these may be wrong by a
    factor e either way.
    """
    guesses = np.eye(J.shape[1])[hidden] / _UNKNOWN
    whole = np.vstack([J, guesses])
    scale = np.linalg.norm(whole, axis=0)
    inverse = np.linalg.pinv(whole / scale)
    found = np.asarray(inverse @ inverse.T / np.outer(scale, scale))
    found[hidden, :] = found[:, hidden] = 0.0
    found[hidden, hidden] = np.inf
    return found


def takes_part(direction: Array) -> BoolArray:
    """Which parameters a direction changes, shape (n,)."""
    return np.asarray(np.abs(direction) > _SHARE * np.max(np.abs(direction), initial=0.0))


def hidden(J: Array) -> BoolArray:
    """Parameters that no row of J tells, a boolean per parameter, shape (n,)."""
    silent, directions = unseen(J)
    found = np.zeros(J.shape[1], bool)
    found[silent] = True
    for direction in directions:
        found |= takes_part(direction)
    return found


def sentences(J: Array, C: Array, names: Sequence[str], ends: Array | None = None) -> list[str]:
    """What the measurements do not tell, in words."""
    silent, directions = unseen(J)
    spread = np.sqrt(np.diag(C))
    if ends is None:
        ends = np.stack([-2.0 * spread, 2.0 * spread], axis=1)
    told = np.any(np.isfinite(ends), axis=1)
    said = [f"Nothing measured depends on {names[k]}." for k in silent.tolist() if not told[k]]
    said += [_same(direction, names, bool(np.any(told[takes_part(direction)])))
             for direction in directions]  # fmt: skip
    width = ends[:, 1] - ends[:, 0]
    for k in np.flatnonzero(np.isfinite(width) & (width > 4.0 * _POOR)).tolist():
        said.append(
            f"{names[k]} is hardly told: its interval spans a factor {np.exp(width[k]):.2g}"
            ". Measure something that depends on it, or give it a prior."
        )
    blind = hidden(J)
    for i in range(len(names)):
        for j in range(i):
            known = not (blind[i] or blind[j]) and spread[i] * spread[j] > 0
            if known and abs(C[i, j]) > _TWINS * spread[i] * spread[j]:
                said.append(
                    f"{names[j]} and {names[i]} are hard to tell apart: the correlation of their "
                    f"errors is {C[i, j] / (spread[i] * spread[j]):+.3f}."
                )
    return said


def _same(direction: Array, names: Sequence[str], bent: bool) -> str:
    """A change that nothing measured sees, in words."""
    places = np.flatnonzero(takes_part(direction))
    places = places[np.argsort(-np.abs(direction[places]), kind="stable")]
    change = direction / direction[places[0]]
    order: list[int] = places.tolist()
    listed = ", ".join(names[k] for k in order[:-1]) + f" and {names[order[-1]]}"
    moves = ", ".join(f"{change[k]:+.2g} % of {names[k]}" for k in order)
    if bent:
        return (
            f"{listed} are hard to tell apart: nothing measured changes with a little of {moves} "
            "together, and little with more."
        )
    return f"{listed} cannot be told apart: nothing measured changes with {moves} together."
