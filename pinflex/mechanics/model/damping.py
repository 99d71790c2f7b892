"""Damping matrices of flexible links: of the description, or from Python in their place.

A link in segments is damped as the one link that it is, by its own modes held at its root: damping
of each segment by itself would fall with their number, as modes of short segments are fast.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.bodies.basis import FlexibleBody
from pinflex.bodies.damping import damping
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.model.expanded import Expansion
from pinflex.mechanics.model.parts import FlexiblePart
from pinflex.mechanics.model.system import System

_ROUND_OFF = 1e-9  # of the largest entry, for symmetry and for the sign of energy

_AXES = [0, 1, 2, 5, 4, 3]  # rows (u, v, w, rz, ry, rx) as displacement and rotation about x, y, z


def rows_of(expansion: Expansion) -> dict[str, IntArray]:
    """Places in eta of the coordinates of each link, root to tip."""
    rows: dict[str, list[int]] = {}
    for slot in expansion.slots:
        rows.setdefault(slot.link, []).extend(range(slot.eta.start, slot.eta.stop))
    return {link: np.array(at, dtype=np.intp) for link, at in rows.items()}


def link_damping(part: FlexiblePart) -> Array:
    """Damping of a link in all its coordinates, root to tip, shape (n, n)."""
    first, count = part.bodies[0], len(part.bodies)
    if count == 1:
        return first.D
    K = np.asarray(np.kron(np.eye(count), first.K))
    every = np.arange(count)[:, None] * first.n
    places = {d: (every + np.arange(first.n)[at]).ravel() for d, at in first.slices.items()}
    return damping(part.spec, places, K, _mass(part))


def _mass(part: FlexiblePart) -> Array:
    """Linear mass matrix of a straight link in segments, riders too, held at its root, (n, n).

    What a segment moves by at x is what its root moves by as a rigid body, and its own rows.
    """
    width = sum(body.n for body in part.bodies)
    root, roots, done = np.zeros((6, width)), [], 0
    M = np.zeros((width, width))
    for body in part.bodies:
        roots.append((root, slice(done, done + body.n)))
        own, done = roots[-1][1], done + body.n
        for k, x in enumerate(body.x):
            B = _moved(root, float(x))
            B[:3, own] += body.Phi[k]
            M += body.mass[k] * B[:3].T @ B[:3]
            if body.inertia is not None and body.Phi_r is not None:
                B[3:, own] += body.Phi_r[k][::-1]
                M += B[3:].T @ (body.inertia[k][:, None] * B[3:])
        for moment, Phi in zip(body.It, body.Phi_t, strict=True):
            turn = root[3].copy()
            turn[own] += Phi
            M += moment * np.outer(turn, turn)
        root = _section(body, root, own, body.length)
    for rider in part.riders:
        k, x = part.segment_of(rider.x)
        B = _section(part.bodies[k], *roots[k], x)
        M += B.T @ rider.inertia.matrix() @ B
    return 0.5 * (M + M.T)


def _section(body: FlexibleBody, root: Array, own: slice, x: float) -> Array:
    """Displacement and rotation of a section at x (m) of a segment, shape (6, n)."""
    B = _moved(root, x)
    B[:, own] += body.rows(x)[0][_AXES]
    return B


def _moved(root: Array, x: float) -> Array:
    """What a point at x (m) along the beam moves by with the root, shape (6, n)."""
    B = root.copy()
    B[1] += x * root[5]
    B[2] -= x * root[4]
    return B


def with_damping(system: System, name: str, given: Mapping[str, Array]) -> System:
    """The flexible system with the given damping of some links.

    Raises:
        DescriptionError: A link that is not flexible; a matrix of another shape, or one that is
            not symmetric or makes energy.
    """
    D, first = system.D.copy(), int(system.rigid.nv)
    rows = rows_of(system.expansion)
    for link, matrix in given.items():
        where = f"{name}: damping: {link}"
        if link not in rows:
            raise DescriptionError(f"{where} is not flexible.{nearest(link, rows)}")
        at, own = first + rows[link], np.asarray(matrix, float)
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
