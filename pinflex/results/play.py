"""Where a platform can be without any motor moving: what clearances and backlash let go.

Of loose places j, each with a move d_j (a pin's centre in its hole, |d_j| <= c_j), the platform
moves by x = sum T_j d_j to first order. How far that goes along u is, as a load u has it whose
forces there are T_j' u (virtual work),

    h(u) = max u . x = sum c_j |T_j' u|

and where loops are overconstrained, so that moves must agree, sum S_j d_j = 0, the least of
sum c_j |T_j' u + S_j' s| over the forces s that the mechanism can bear by itself (its dual).
Source: Rockafellar, Convex Analysis (1970), section 13.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.doors import door
from pinflex.errors import DescriptionError
from pinflex.report import Table
from pinflex.report import table as report_table
from pinflex.results.pose_map import AXES, Columns, column, of_poses
from pinflex.text import frozen, number

if TYPE_CHECKING:
    from matplotlib.axes import Axes

OUTLINE = 96  # points of an outline
_DIRECTIONS = 400  # over a sphere, from which the farthest place is climbed to
_CLIMBS, _ROUNDS = 30, 300
_NOTHING = 1e-12  # of a direction: what is round-off
_NONE = 1e-8  # of a load: below it a force counts as zero in overconstrained loops
_EVEN = np.pi * (3.0 - np.sqrt(5.0))  # the golden angle


@frozen
class Play:
    """Where the platform can be with the motors still, to first order in the clearances.

    Attributes:
        name: Of the mechanism.
        places: Names of what is loose: pins, balls, "gear of MOTOR".
        sizes: Of each: radius of the hole less that of the pin [m]; half the backlash [rad | m].
        moves: Of each: displacement of the platform by its move, T_j, shape (6, 1 to 3): of the
            frame's origin [m] and its turn [rad], in world axes.
        agree: Of each: S_j, shape (k, 1 to 3); k: how often the loops are overconstrained in it.
        free: Directions in which nothing holds the platform, shape (6, n), n mostly 0.
    """

    name: str
    places: tuple[str, ...]
    sizes: Array
    moves: tuple[Array, ...]
    agree: tuple[Array, ...]
    free: Array

    def reach(self, direction: Sequence[float] | Array) -> Array:
        """How far the platform goes along directions (..., 6), shape (...); inf where it is free.

        Args:
            direction: Of the origin, then of the turn, in world axes: [1, 0, 0, 0, 0, 0] gives m,
                [0, 0, 0, 0, 0, 1] rad.
        """
        u = np.asarray(direction, float)
        if u.shape[-1:] != (6,) or not np.all(np.isfinite(u)):
            raise DescriptionError(
                f"{self.name}: reach: {u.shape} is no direction. Give 6 numbers: x, y, z, rx, ry, "
                "rz in the world."
            )
        far = sum(
            (
                c * np.linalg.norm(f, axis=-1)
                for c, f in zip(self.sizes, self._forces(u), strict=True)
            ),
            np.zeros(u.shape[:-1]),
        )
        loose = np.linalg.norm(u @ self.free, axis=-1) > _NOTHING * np.linalg.norm(u, axis=-1)
        return np.asarray(np.where(loose, np.inf, far))

    def where(self, direction: Sequence[float] | Array) -> Array:
        """The place farthest along directions (..., 6): displacement, shape (..., 6), m and rad."""
        u = np.asarray(direction, float)
        if u.ndim > 1 and self._held_by_itself:
            return np.array([self.where(one) for one in u.reshape(-1, 6)]).reshape(u.shape)
        found = np.zeros(u.shape)
        for c, T, force in zip(self.sizes, self.moves, self._forces(u), strict=True):
            size = np.linalg.norm(force, axis=-1, keepdims=True)
            if self._held_by_itself:  # of a force of zero, the lean with which moves agree
                size = np.hypot(size, _NONE * float(np.linalg.norm(u)))
            found += c * np.divide(force, size, out=np.zeros_like(force), where=size > 0.0) @ T.T
        return found

    def leans(self, direction: Sequence[float] | Array) -> dict[str, float]:
        """What each loose place adds to the reach along one direction (6,), largest first."""
        force = self._forces(np.asarray(direction, float))
        every = zip(self.places, self.sizes, force, strict=True)
        each = {name: float(c * np.linalg.norm(f)) for name, c, f in every}
        return dict(sorted(each.items(), key=lambda pair: -pair[1]))

    @property
    def extent(self) -> Array:
        """Reach to each side along x, y, z [m] and about x, y, z [rad], others free, shape (6,)."""
        return self.reach(np.eye(6))

    @property
    def farthest(self) -> tuple[float, Array]:
        """The longest displacement of the origin [m], and its direction, shape (3,)."""
        return self._longest(slice(0, 3))

    @property
    def largest_turn(self) -> tuple[float, Array]:
        """The largest turn [rad], and its axis, shape (3,)."""
        return self._longest(slice(3, 6))

    def outline(self, axes: tuple[str, str] = ("x", "y"), points: int = OUTLINE) -> Array:
        """Rim of where the platform can be, seen in a plane of two of x, y, z, rx, ry, rz.

        Args:
            axes: The two.
            points: How many.
        Returns:
            Displacements along both, shape (points, 2): a polygon's corners among them.
        """
        at = [AXES.index(axis) for axis in axes]
        turn = 2.0 * np.pi * (np.arange(points) + 0.5) / points
        u = np.zeros((points, 6))
        u[:, at] = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        return np.asarray(self.where(u)[:, at])

    def plot(self, axes: tuple[str, str] = ("x", "y"), ax: Axes | None = None) -> Any:
        """Draw the outline in a plane; returns the matplotlib axes.

        Args:
            axes: Which plane.
            ax: Where to draw; default: axes of a new figure.
        """
        return door("viewer.plots.maps", "axes_of_play")(self, axes, ax)

    def as_table(self) -> Table:
        """Its reach along and about each axis, and what it is mostly by."""
        rows = [
            (axis, float(x), unit, ", ".join([*self.leans(e)][:3]) if x else "")
            for axis, x, unit, e in zip(
                AXES, self.extent, ("um",) * 3 + ("mrad",) * 3, np.eye(6), strict=True
            )
        ]
        return report_table(
            f"{self.name}: where the platform can be, motors still",
            rows,
            ("along", itemgetter(0)),
            ("to each side", lambda row: number(row[1] * (1e6 if row[2] == "um" else 1e3))),
            ("unit", itemgetter(2)),
            ("mostly by", itemgetter(3)),
            names=(6,),
            prose=True,
        )

    def __str__(self) -> str:
        return self.as_table().text()

    def _longest(self, part: slice) -> tuple[float, Array]:
        # overconstrained, each place is a programme of its own
        count, starts, climbs = (
            (60, 4, 8) if self._held_by_itself else (_DIRECTIONS, 2 * _DIRECTIONS, _CLIMBS)
        )
        k = np.arange(count) + 0.5
        z = 1.0 - 2.0 * k / count
        around = np.sqrt(1.0 - z**2)
        sphere = np.stack([around * np.cos(_EVEN * k), around * np.sin(_EVEN * k), z], axis=1)
        turn = 2.0 * np.pi * (k - 0.5) / count
        flat = np.stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))], axis=1)
        u = np.zeros((2 * count, 6))
        u[:, part] = np.concatenate([sphere, flat])
        size = self.reach(u)
        if not np.all(np.isfinite(size)):
            return float("inf"), u[int(np.argmax(size)), part]
        u = u[np.argsort(-size)[:starts]]
        for _ in range(climbs):  # h is convex: the place that is farthest along u is no nearer
            x = self.where(u)[:, part]
            length = np.linalg.norm(x, axis=1, keepdims=True)
            u[:, part] = np.where(length > 0.0, x / np.maximum(length, 1e-300), u[:, part])
        size = self.reach(u)
        best = int(np.argmax(size))
        return float(size[best]), u[best, part]

    @property
    def _held_by_itself(self) -> int:
        return int(self.agree[0].shape[0]) if self.agree else 0

    def _forces(self, u: Array) -> list[Array]:
        """T_j' u + S_j' s of each place, with the s that makes their sum least."""
        forces = [u @ T for T in self.moves]
        k = self._held_by_itself
        if not k or not np.any(np.concatenate(forces, axis=-1)):
            return forces
        if u.ndim > 1:
            each = [self._forces(one) for one in u.reshape(-1, 6)]
            shape = u.shape[:-1]
            return [np.array(f).reshape(*shape, -1) for f in zip(*each, strict=True)]
        # Weiszfeld's rounds: least squares whose weights are what is sought, over the size
        S, f = np.concatenate(self.agree, axis=1), np.concatenate(forces)
        ends = np.cumsum([T.shape[1] for T in self.moves])[:-1]
        small = _NONE * float(np.linalg.norm(u))
        s: Array = np.zeros(k)
        weight = np.ones(len(f))
        for _ in range(_ROUNDS):
            root = np.sqrt(weight)
            new = np.asarray(np.linalg.lstsq((S * root).T, -root * f, rcond=None)[0], float)
            parts = np.split(f + new @ S, ends)
            sizes = [np.sqrt(p @ p + small**2) for p in parts]
            weight = np.concatenate(
                [np.full(len(p), c / n) for c, n, p in zip(self.sizes, sizes, parts, strict=True)]
            )
            if np.max(np.abs(new - s)) <= 1e-12 * np.max(np.abs(new), initial=1e-300):
                break
            s = new
        return parts


@frozen
class PlayMap:
    """The play of the platform at the poses of a grid, or of a motion; G: shape of the grid.

    Attributes:
        name: Of the mechanism.
        grid: Displacements from home by coordinate, each of shape (n,), or instants "t".
        units: m, rad or s, of each.
        plays: By place in the grid, shape G; None where a pose has none.
        errors: Why, "" where it has, shape G.
    """

    name: str
    grid: Mapping[str, Array]
    units: Mapping[str, str]
    plays: Any
    errors: Any

    @property
    def table(self) -> Columns:
        """A row for each pose: grid, status, error, the longest way [m], the largest turn [rad],
        and the reach along and about each axis to each side, the others free.
        """
        arrays, units = of_poses(self.grid, self.errors), dict(self.units)
        names = ("play", "play.turn", *(f"play.{axis}" for axis in AXES))
        rows = [
            [np.nan] * len(names) if each is None
            else [each.farthest[0], each.largest_turn[0], *each.extent.tolist()]
            for each in self.plays.reshape(-1)
        ]  # fmt: skip
        for k, name in enumerate(names):
            arrays[name] = column([row[k] for row in rows])
            units[name] = "rad" if k == 1 or k > 4 else "m"
        return Columns(arrays, units)

    def plot(self, ax: Axes | None = None) -> Any:
        """Draw the longest way over the poses, with outlines; returns the matplotlib axes.

        Args:
            ax: Where to draw; default: axes of a new figure.
        """
        return door("viewer.plots.maps", "axes_of_plays")(self, ax)
