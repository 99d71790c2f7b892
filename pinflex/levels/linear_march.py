"""March of a linear system along a path, under any number of loads.

    M(t) a + C(t) v + K(t) d + r(t) - J(t)' lam = 0,     J(t) d = 0

Systems and their factors do not depend on the load: they are kept from one march to the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pinflex.arrays import Array, BoolArray, IntArray
from pinflex.integrators.chebyshev import Interpolation
from pinflex.integrators.linear import Instant, alpha, start_at_rest
from pinflex.integrators.schemes import AlphaScheme
from pinflex.kernel.library import kernel
from pinflex.kernel.linear import LinearKernel, Still
from pinflex.levels.interpolated import InterpolatedPath
from pinflex.levels.varying import Varying, varying
from pinflex.mechanics.geometry import spans

_LARGEST = 32e6  # numbers that systems and factors may hold together (256 MB)
_BATCH = 64  # systems at a time where they may not
_FORCES = 256  # steps whose forces are taken together


class Marched(NamedTuple):
    """Deviation d, its rates v and a, (nt, n) each, and multipliers lam (nt, rows)."""

    d: Array
    v: Array
    a: Array
    lam: Array


def forces_along(grid: Interpolation, parts: Sequence[Varying], found: Marched) -> Array:
    """Forces M a + C v + K d + r - J' lam at every step, shape (nt, k): of motors, what they give.

    Args:
        grid: Times of the systems, and of the steps.
        parts: Some rows of M, C, K (k, n) and r (k,), columns of J (rows, k).
        found: The deviation and its multipliers.
    """
    force = np.empty((len(found.d), *parts[3].shape))
    for s in spans(len(force), _FORCES):
        m, c, k, left, j = (x.along(grid, s) for x in parts)
        pairs = (m, found.a), (c, found.v), (k, found.d), (-j.swapaxes(1, 2), found.lam)
        force[s] = left + sum((A @ x[s][:, :, None])[:, :, 0] for A, x in pairs)
    return force


class Room:
    """Numbers that marches in turn use: memory is paid for when it is first touched.

    Attributes:
        owner: Whose numbers are there.
    """

    def __init__(self) -> None:
        self._numbers = np.empty(0)
        self.owner: LinearMarch | None = None

    def take(self, owner: LinearMarch, size: int) -> Array:
        """Room for `size` numbers, up to `_LARGEST`; nobody else's are left.

        Args:
            owner: Who is to have it.
            size: Numbers.
        """
        if not len(self._numbers):
            self._numbers = np.empty(int(_LARGEST))
        self.owner = owner
        return self._numbers[:size]


class LinearMarch:
    """The systems of a march at equal steps, by a method of the alpha family."""

    def __init__(
        self,
        scheme: AlphaScheme,
        grid: Interpolation,
        parts: Sequence[Varying],
        h: float,
        room: Room | None = None,
        kept: bool = True,
    ) -> None:
        """Nothing is factored yet.

        Args:
            scheme: The method.
            grid: Times of the systems, and of the steps.
            parts: M, C, K (n, n) and J (rows, n).
            h: Step [s].
            room: Where systems and factors are kept; None: of its own.
            kept: Keep them for other loads.
        """
        self._scheme, self._grid, self._parts, self._h = scheme, grid, tuple(parts), h
        self._room, self._wanted = room or Room(), kept

    @cached_property
    def first(self) -> Instant:
        """M, C, K and J at the first step, without a load."""
        M, C, K, J = (x.along(self._grid, slice(0, 1))[0] for x in self._parts)
        return Instant(M, C, K, np.zeros(len(M)), J)

    def __call__(self, load: Array, start: Array) -> Marched:
        """March from rest.

        Args:
            load: r at every step, shape (nt, n).
            start: First deviation, shape (n,).
        """
        load = np.ascontiguousarray(load)
        if kernel().functions is not None and len(start) and len(load) > 1:
            found = self._compiled(load, start)
            if found is not None:
                return found
        M, C, K, J = self._parts
        r, none = (varying(np.zeros((len(M), n))) for n in (len(start), 0))
        system = InterpolatedPath(self._grid, (M, C, K, r, J, none))

        def at(k: int) -> Instant:
            now = system.at(k).free
            return Instant(now.M, now.C, now.K, load[k], now.J)

        states = list(alpha(self._scheme, at, len(load), self._h, start))
        pairs = ([getattr(state, x) for state in states] for x in Marched._fields)
        return Marched(*(np.array(x).reshape(len(load), -1) for x in pairs))

    # On the kernel -------------------------------------------------------------------------

    def _compiled(self, load: Array, start: Array) -> Marched | None:
        """None where a system is singular."""
        n, rows, count = len(start), self._parts[3].shape[0], len(load)
        found = Marched(*(np.empty((count, width)) for width in (n, n, n, rows)))
        now = self.first
        first = start_at_rest(Instant(now.M, now.C, now.K, load[0], now.J), start)
        for history, x in zip(found, (first.d, first.v, first.a, first.lam), strict=True):
            history[0] = x
        self._kernel.state[:] = first.d, first.v, first.a, first.a
        system, _ = self._systems
        each = count if self._kept else _BATCH
        for k in range(1, count, each):
            steps = slice(k, min(k + each, count))
            value, own = self._values(system[steps])
            rest = found.d[steps], found.v[steps], found.a[steps], found.lam[steps]
            if self._kernel.march(own, value, load[steps], rest) < len(own):
                return None
        return found

    @cached_property
    def _systems(self) -> tuple[IntArray, IntArray]:
        """System of each step, (nt,), and a step at which each is: resting pieces have one."""
        grid, steps = self._grid, np.arange(len(self._grid.t))
        rests = np.ones(len(grid.pieces), dtype=bool)
        for x, moving in zip(self._parts, self._moving, strict=True):
            nodes = moving[: grid.nodes].reshape(len(grid.pieces), grid.n + 1, -1)
            rests &= np.all(np.ptp(nodes, axis=1) <= x.small, axis=1)
        for piece in np.flatnonzero(rests):
            here = grid.piece == piece
            here[grid.corners] = False
            steps[here] = np.argmax(here)
        at, system = np.unique(steps, return_inverse=True)
        return system, at

    @cached_property
    def _kept(self) -> bool:
        """Whether all systems and their factors are kept."""
        size = self._parts[0].shape[0] + self._parts[3].shape[0]
        width = self._moving_values.shape[1] + size * size
        return self._wanted and bool(len(self._systems[1]) * width <= _LARGEST)

    def _values(self, wanted: IntArray) -> tuple[Array, IntArray]:
        """Moving entries of systems, (systems, width), and which of them is each that is wanted."""
        kernel, at = self._kernel, self._systems[1]
        if not self._kept:
            mine, own = np.unique(wanted, return_inverse=True)
            kernel.forget()
            return self._grid.between(self._moving_values, at[mine]), own
        if self._room.owner is not self:
            width, size = self._moving_values.shape[1], kernel.n + kernel.rows
            numbers = self._room.take(self, len(at) * (width + size * size))
            self._all = numbers[: len(at) * width].reshape(len(at), width)
            self._grid.between(self._moving_values, at, self._all)
            kernel.use(numbers[len(at) * width :])
        return self._all, wanted

    @cached_property
    def _entries(self) -> tuple[BoolArray, BoolArray]:
        """Entries of M, C or K, and of J, that change, shapes (n, n) and (rows, n)."""
        M, C, K, J = (x.moves for x in self._parts)
        return M | C | K, J

    @cached_property
    def _moving(self) -> list[Array]:
        """Those entries of M, C, K and J at the nodes, column by column, (size, .) each."""
        square, J_at = (np.nonzero(x.T)[::-1] for x in self._entries)
        places = square, square, square, J_at
        return [x.those(at) for x, at in zip(self._parts, places, strict=True)]

    @cached_property
    def _moving_values(self) -> Array:
        """The same of S, C, K and J side by side, shape (size, width)."""
        M, C, K, J = self._moving
        return np.hstack([self._weighted(M, C, K), C, K, J])

    def _weighted(self, M: Array, C: Array, K: Array) -> Array:
        """S, which the acceleration of a step is solved with."""
        one, h = self._scheme, self._h
        return one.mass_factor * M + one.gamma * h * C + one.beta * h * h * K

    @cached_property
    def _kernel(self) -> LinearKernel:
        one, (moving, J_moving) = self._scheme, self._entries
        M, C, K = (np.where(moving, 0.0, x.still) for x in self._parts[:3])
        J = np.where(J_moving, 0.0, self._parts[3].still)
        still = Still(self._weighted(M, C, K), C, K, J, moving, J_moving)
        coefficients = one.mass_factor, one.beta, one.gamma, one.alpha_m, one.alpha_f
        systems = len(self._systems[1]) if self._kept else _BATCH
        return LinearKernel(still, self._h, coefficients, systems, self._kept)
