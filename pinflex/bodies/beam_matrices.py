"""Stiffness, mass and damping of a beam by direction; its static end shapes and modes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.family import (
    BENDING,
    Family,
    quadrature,
)

if TYPE_CHECKING:
    from pinflex.description.flexible import FlexibleLink
    from pinflex.description.section import Section


def bending(section: Section, direction: str) -> tuple[float, float]:
    """Second moment [m^4] and shear factor of bending."""
    return (section.Iz, section.ky) if direction == "v" else (section.Iy, section.kz)


def beam_energy(
    link: FlexibleLink, direction: str, family: Family, rho: float
) -> tuple[Array, Array]:
    """Stiffness and mass matrix of one direction, end masses included, each (n, n)."""
    section, E, G = link.section, link.material.E, link.material.G
    shear = 0.0
    if direction == "u":
        stiffness, spin = E * section.A, 0.0
    elif direction == "p":
        stiffness, spin = G * section.J, rho * section.Ip
    else:
        second, k = bending(section, direction)
        stiffness = E * second
        spin = rho * section.turning[direction == "v"] * (link.rotary_inertia is True)
        shear = k * G * section.A * family.shear
    x, weights = quadrature(family.breaks, family.gauss)
    F, w = family.evaluate(x.ravel()), weights.ravel()[:, None]
    K = stiffness * F.curv.T @ (w * F.curv)
    if shear:
        K += shear * (F.df - F.rot).T @ (w * (F.df - F.rot))
    translates = direction != "p"
    M = spin * F.rot.T @ (w * F.rot) + translates * rho * section.A * F.f.T @ (w * F.f)
    axis = {"p": 0, "w": 1, "v": 2}.get(direction)
    for end, at in ((link.root, 0.0), (link.tip, family.length)):
        # One body stands for every segment of a link that is cut; none of them owns the ends.
        if end is not None and link.segments == 1:
            F = family.evaluate(np.array([at]))
            turn = 0.0 if axis is None else end.inertia[axis]
            M += translates * end.mass * F.f.T @ F.f + turn * F.rot.T @ F.rot
    return 0.5 * (K + K.T), 0.5 * (M + M.T)


def craig_bampton(
    family: Family, direction: str, K: Array, M: Array, internal: int
) -> tuple[Array, tuple[str, ...]]:
    """Static tip shapes and the lowest modes with the tip held, from a family clamped at its root.

    Returns:
        T (n, m), such that the new functions are f @ T, and their names. The end shapes have unit
        tip displacement or rotation; the modes have int f^2 dx = L.
    Source: Craig, Bampton (1968).
    """
    tip = family.evaluate(np.array([family.length]))
    B = np.vstack([tip.f, tip.rot]).T if direction in BENDING else tip.f.T
    compliance = np.linalg.solve(K, B)
    static = compliance @ np.linalg.inv(B.T @ compliance)
    held = np.linalg.qr(B, mode="complete")[0][:, B.shape[1] :]
    # Eigenvectors of K^-1 M, not of M^-1 K: the lowest modes are then the accurate ones.
    root = np.linalg.inv(np.linalg.cholesky(held.T @ K @ held))
    modes = held @ root.T @ np.linalg.eigh(root @ (held.T @ M @ held) @ root.T)[1][:, ::-1]
    modes = modes[:, :internal]
    x, weights = quadrature(family.breaks, family.gauss)
    shapes = family.evaluate(np.append(x.ravel(), 0.0))
    norm = np.sqrt(weights.ravel() @ (shapes.f[:-1] @ modes) ** 2 / family.length)
    start = shapes.curv[-1] @ modes  # the first lobe is positive
    names = ("tip", "slope")[: B.shape[1]] + tuple(str(k + 1) for k in range(modes.shape[1]))
    return np.hstack([static, modes * np.where(start < 0.0, -1.0, 1.0) / norm]), names
