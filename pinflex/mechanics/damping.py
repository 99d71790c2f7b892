"""Damping matrices of flexible links from Python, in place of those of the description."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.system import System

_ROUND_OFF = 1e-9  # of the largest entry, for symmetry and for the sign of energy


def with_damping(system: System, name: str, given: Mapping[str, Array]) -> System:
    """The flexible system with the given damping of some links.

    Args:
        system: Flexible system. name: Of the model, for messages.
        given: By link, N s/m in its elastic coordinates, root to tip, shape (n, n).
    Raises:
        DescriptionError: A link that is not flexible; a matrix of another shape, or one that is
            not symmetric or makes energy.
    """
    D, first = system.D.copy(), int(system.rigid.nv)
    rows: dict[str, list[int]] = {}
    for slot in system.expansion.slots:
        rows.setdefault(slot.link, []).extend(range(first + slot.eta.start, first + slot.eta.stop))
    for link, matrix in given.items():
        where = f"{name}: damping: {link}"
        if link not in rows:
            raise DescriptionError(f"{where} is not flexible.{nearest(link, rows)}")
        at, own = rows[link], np.asarray(matrix, float)
        n = len(at)
        if own.shape != (n, n) or not np.all(np.isfinite(own)):
            raise DescriptionError(
                f"{where}: shape {own.shape}. Allowed: finite numbers of shape {(n, n)}, one row "
                "for each elastic coordinate of the link (mechanism.parts[LINK].bodies)."
            )
        small = _ROUND_OFF * float(np.max(np.abs(own), initial=0.0))
        if np.max(np.abs(own - own.T), initial=0.0) > small:
            raise DescriptionError(f"{where}: is not symmetric. Give (D + D') / 2.")
        least = float(np.min(np.linalg.eigvalsh(own), initial=0.0))
        if least < -n * small:
            raise DescriptionError(
                f"{where}: has the eigenvalue {least:.3g}, with which it would make energy. "
                "Allowed: eigenvalues >= 0."
            )
        D[np.ix_(at, at)] = own
    return replace(system, D=D)
