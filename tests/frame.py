"""A small program for space frames by the direct stiffness method, in numpy alone.

Straight beams (Euler-Bernoulli, Saint-Venant torsion, consistent masses) between stations that are
nodes of their own or points of rigid bodies; a ball at an end leaves the beam its own rotation
there. Written for tests: it shares no code and no idea of coordinates with pinflex.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

Array = np.ndarray


@dataclass
class Frame:
    """Freedoms of nodes (displacement m, then rotation rad, world axes) and what joins them."""

    n: int = 0
    pieces: list[tuple[Place, Place, Array, Array]] = field(default_factory=list)  # and k, m
    bodies: list[tuple[Place, float, Array]] = field(default_factory=list)  # kg, kg m^2

    def node(self, count: int = 6) -> int:
        """First freedom of a new node."""
        self.n += count
        return self.n - count

    def beam(self, a: Place, b: Place, count: int, bar: Bar) -> list[tuple[Place, Place, Array]]:
        """Cut a beam between two places into pieces; returns their ends and masses."""
        inner = [Place(self.node(), a.x + (b.x - a.x) * k / count) for k in range(1, count)]
        places = [a, *inner, b]
        made = [(one, two, *bar.matrices(one.x, two.x)) for one, two in pairwise(places)]
        self.pieces += made
        return [(one, two, m) for one, two, _, m in made]

    def rows(self, *places: Place) -> Array:
        """Displacement and rotation of places from all freedoms, shape (6 len, n)."""
        return np.vstack([place.rows(self.n) for place in places])

    def matrices(self) -> tuple[Array, Array]:
        """Stiffness and mass of all freedoms, shape (n, n)."""
        K, M = np.zeros((2, self.n, self.n))
        for a, b, k, m in self.pieces:
            T = self.rows(a, b)
            K += T.T @ k @ T
            M += T.T @ m @ T
        for place, mass, inertia in self.bodies:
            T = self.rows(place)
            M += mass * T[:3].T @ T[:3] + T[3:].T @ inertia @ T[3:]
        return K, M


@dataclass(frozen=True)
class Place:
    """A station x [m]: `lever` from the node `at` of a body, or, with a ball, turning by itself.

    at: First freedom of the node; -1: fixed. ball: First of three rotations of its own, or None.
    """

    at: int
    x: Array
    lever: Array = field(default_factory=lambda: np.zeros(3))
    ball: int | None = None

    def rows(self, n: int) -> Array:
        """Displacement and rotation of the station from all freedoms, shape (6, n)."""
        T = np.zeros((6, n))
        if self.at >= 0:
            T[:3, self.at : self.at + 3] = np.eye(3)
            T[:3, self.at + 3 : self.at + 6] = -cross(self.lever)
            T[3:, self.at + 3 : self.at + 6] = np.eye(3)
        if self.ball is not None:
            T[3:] = 0.0
            T[3:, self.ball : self.ball + 3] = np.eye(3)
        return T


@dataclass(frozen=True)
class Bar:
    """Round section: E, G [Pa], rho [kg/m^3], area [m^2] and second moment of area [m^4]."""

    E: float
    G: float
    rho: float
    area: float
    second: float

    @classmethod
    def tube(cls, diameter: float, wall: float, E: float, G: float, rho: float) -> Bar:
        outer, inner = diameter / 2, diameter / 2 - wall
        area, second = np.pi * (outer**2 - inner**2), np.pi * (outer**4 - inner**4) / 4
        return cls(E, G, rho, float(area), float(second))

    def matrices(self, a: Array, b: Array) -> tuple[Array, Array]:
        """Stiffness and consistent mass of a beam from a to b in world axes, shape (12, 12).

        Source: Przemieniecki (1968), eq. 5.116 and 11.10, without rotary inertia of bending.
        """
        L = float(np.linalg.norm(b - a))
        k, m = np.zeros((2, 12, 12))
        for rigidity, mass, i in (
            (self.E * self.area, self.rho * self.area, 0),
            (2 * self.G * self.second, 2 * self.rho * self.second, 3),
        ):
            at = np.ix_([i, i + 6], [i, i + 6])
            k[at] = rigidity / L * np.array([[1, -1], [-1, 1]])
            m[at] = mass * L / 6 * np.array([[2, 1], [1, 2]])
        # deflection and slope at both ends; about y the slope is minus the rotation
        bend = np.array([
            [12, 6 * L, -12, 6 * L],
            [6 * L, 4 * L**2, -6 * L, 2 * L**2],
            [-12, -6 * L, 12, -6 * L],
            [6 * L, 2 * L**2, -6 * L, 4 * L**2],
        ])  # fmt: skip
        swing = np.array([
            [156, 22 * L, 54, -13 * L],
            [22 * L, 4 * L**2, 13 * L, -3 * L**2],
            [54, 13 * L, 156, -22 * L],
            [-13 * L, -3 * L**2, -22 * L, 4 * L**2],
        ])  # fmt: skip
        for rows, sign in (([1, 5, 7, 11], 1), ([2, 4, 8, 10], -1)):
            S = np.diag([1, sign, 1, sign])
            k[np.ix_(rows, rows)] = self.E * self.second / L**3 * S @ bend @ S
            m[np.ix_(rows, rows)] = self.rho * self.area * L / 420 * S @ swing @ S
        R = np.kron(np.eye(4), axes(b - a))
        return R.T @ k @ R, R.T @ m @ R


def axes(along: Array) -> Array:
    """Rows: the direction of a beam and two square to it."""
    x = along / np.linalg.norm(along)
    other = np.eye(3)[int(np.argmin(np.abs(x)))]
    y = np.cross(other, x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)])


def cross(v: Array) -> Array:
    """Matrix of v x."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
