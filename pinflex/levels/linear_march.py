"""March of a linear system along a path, under any number of loads.

    M(t) a + C(t) v + K(t) d + r(t) - J(t)' lam = 0,     J(t) d = 0

Systems and their factors do not depend on the load: marches may go on side by side, each with loads
that come of what those before it found. A window of steps is factored at a time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pinflex.arrays import Array, BoolArray, IntArray
from pinflex.integrators.chebyshev import Interpolation
from pinflex.integrators.linear import Instant, State, alpha, start_at_rest
from pinflex.integrators.schemes import AlphaScheme
from pinflex.kernel.library import kernel
from pinflex.kernel.linear import LinearKernel, Still
from pinflex.levels.interpolated import InterpolatedPath
from pinflex.levels.varying import Varying, varying
from pinflex.mechanics.geometry import spans

_BATCH = 64  # systems at a time
_KEPT = 2_000_000  # numbers of factors that are kept (16 MB): memory is dear, caches are small
_FEWEST = 16  # systems whose factors are kept, however large
_FORCES = 256  # steps whose forces are taken together


class Marched(NamedTuple):
    """Deviation d, its rates v and a, (nt, n) each, and multipliers lam (nt, rows)."""

    d: Array
    v: Array
    a: Array
    lam: Array

    def sampled(self, every: int) -> Marched:
        """Every so manyth step."""
        return Marched(*(x[::every] for x in self))


def forces_along(
    grid: Interpolation, parts: Sequence[Varying], found: Marched, every: int = 1
) -> Array:
    """Forces M a + C v + K d + r - J' lam at every step, shape (nt, k): of motors, what they give.

    Args:
        grid: Times of the systems, and of the steps.
        parts: Some rows of M, C, K (k, n) and r (k,), columns of J (rows, k).
        found: The deviation and its multipliers.
        every: Steps from one of those to the next.
    """
    force = np.empty((len(found.d), *parts[3].shape))
    for s in spans(len(force), _FORCES):
        steps = slice(s.start * every, s.stop * every, every)
        m, c, k, left, j = (x.along(grid, steps) for x in parts)
        pairs = (m, found.a), (c, found.v), (k, found.d), (-j.swapaxes(1, 2), found.lam)
        force[s] = left + sum((A @ x[s][:, :, None])[:, :, 0] for A, x in pairs)
    return force


class Room:
    """Numbers that marches in turn use: memory is dear when it is first touched.

    Attributes:
        owner: Whose numbers are there.
    """

    def __init__(self) -> None:
        self._numbers = np.empty(0)
        self.owner: LinearMarch | None = None

    def take(self, owner: LinearMarch, size: int) -> Array:
        """Room for numbers; nobody else's are left.

        Args:
            owner: Who is to have it.
            size: Numbers.
        """
        self.owner = owner
        if len(self._numbers) < size:
            self._numbers = np.empty(size)
        return self._numbers[:size]


class LinearMarch:
    """The systems of marches at equal steps, by a method of the alpha family."""

    def __init__(
        self,
        scheme: AlphaScheme,
        grid: Interpolation,
        parts: Sequence[Varying],
        h: float,
        room: Room | None = None,
    ) -> None:
        """Nothing is factored yet.

        Args:
            scheme: The method.
            grid: Times of the systems, and of the steps.
            parts: M, C, K (n, n) and J (rows, n).
            h: Step [s].
            room: Where factors of some steps are kept, for marches that go on side by side; None:
                for one march.
        """
        self.scheme, self.grid, self.h, self.parts = scheme, grid, h, tuple(parts)
        self._room, self._shared, self._at = room or Room(), room is not None, slice(0, 0)
        self._ready: tuple[Array, IntArray] = np.empty(0), np.empty(0, dtype=np.intp)

    @cached_property
    def first(self) -> Instant:
        """M, C, K and J at the first step, without a load."""
        M, C, K, J = (x.along(self.grid, slice(0, 1))[0] for x in self.parts)
        return Instant(M, C, K, np.zeros(len(M)), J)

    def __call__(self, load: Array, start: Array) -> Marched:
        """March from rest.

        Args:
            load: r at every step, shape (nt, n).
            start: First deviation, shape (n,).
        """
        one = self.begin()
        for s in self.windows():
            one.go(s, load[s], start)
        return one.found

    def begin(self) -> Going:
        """One of some marches that go on side by side, window by window."""
        return Going(self)

    def windows(self) -> Iterator[slice]:
        """Steps that are taken at a time: the first, then as many as share `room`."""
        count, each = len(self.grid.t), self._window
        yield slice(0, 1)
        yield from (slice(k, min(k + each, count)) for k in range(1, count, each))

    @cached_property
    def _window(self) -> int:
        size = self.parts[0].shape[0] + self.parts[3].shape[0]
        kept = _BATCH if not self._shared else max(_FEWEST, _KEPT // max(size * size, 1))
        return int(min(kept, max(len(self.grid.t) - 1, 1)))

    # On the kernel -------------------------------------------------------------------------

    @property
    def compiled(self) -> bool:
        """Whether the kernel marches."""
        n = self.parts[0].shape[0]
        return kernel().functions is not None and n > 0 and len(self.grid.t) > 1

    def advance(self, s: slice, load: Array, state: Array, found: Marched) -> bool:
        """Steps of a window by the kernel; False where a system is singular.

        Args:
            s: The window.
            load: There, shape (steps, n).
            state: That the steps begin from, and what they end in, shape (4, n).
            found: Of all steps; those of the window are written.
        """
        value, own = self._opened(s)
        self._kernel.state[:] = state
        there = found.d[s], found.v[s], found.a[s], found.lam[s]
        done = self._kernel.march(own, value, load, there)
        state[:] = self._kernel.state
        return bool(done == len(own))

    def _opened(self, s: slice) -> tuple[Array, IntArray]:
        """Moving entries of the systems of a window, and which of them is each step's."""
        if s != self._at or self._room.owner is not self:
            of, at = self._systems
            mine, own = np.unique(of[s], return_inverse=True)
            width, size = self._moving_values.shape[1], self._kernel.n + self._kernel.rows
            factors = self._window * size * size if self._shared else 0
            numbers = self._room.take(self, factors + len(mine) * width)
            if self._shared:
                self._kernel.use(numbers[:factors])
            self._kernel.forget()
            values = numbers[factors:].reshape(len(mine), width)
            self._at, self._ready = (
                s,
                (self.grid.between(self._moving_values, at[mine], values), own),
            )
        return self._ready

    @cached_property
    def _systems(self) -> tuple[IntArray, IntArray]:
        """System of each step, (nt,), and a step at which each is: resting pieces have one."""
        grid, steps = self.grid, np.arange(len(self.grid.t))
        rests = np.ones(len(grid.pieces), dtype=bool)
        for x, moving in zip(self.parts, self._moving, strict=True):
            nodes = moving[: grid.nodes].reshape(len(grid.pieces), grid.n + 1, -1)
            rests &= np.all(np.ptp(nodes, axis=1) <= x.small, axis=1)
        for piece in np.flatnonzero(rests):
            here = grid.piece == piece
            here[grid.corners] = False
            steps[here] = np.argmax(here)
        at, system = np.unique(steps, return_inverse=True)
        return system, at

    @cached_property
    def _entries(self) -> tuple[BoolArray, BoolArray]:
        """Entries of M, C or K, and of J, that change, shapes (n, n) and (rows, n)."""
        M, C, K, J = (x.moves for x in self.parts)
        return M | C | K, J

    @cached_property
    def _moving(self) -> list[Array]:
        """Those entries of M, C, K and J at the nodes, column by column, (size, .) each."""
        square, J_at = (np.nonzero(x.T)[::-1] for x in self._entries)
        places = square, square, square, J_at
        return [x.those(at) for x, at in zip(self.parts, places, strict=True)]

    @cached_property
    def _moving_values(self) -> Array:
        """The same of S, C, K and J side by side, shape (size, width)."""
        M, C, K, J = self._moving
        return np.hstack([self._weighted(M, C, K), C, K, J])

    def _weighted(self, M: Array, C: Array, K: Array) -> Array:
        """S, which the acceleration of a step is solved with."""
        by_a, by_v, by_y = self.scheme.weights(self.h)
        return by_a * M + by_v * C + by_y * K

    @cached_property
    def _kernel(self) -> LinearKernel:
        one, (moving, J_moving) = self.scheme, self._entries
        M, C, K = (np.where(moving, 0.0, x.still) for x in self.parts[:3])
        J = np.where(J_moving, 0.0, self.parts[3].still)
        still = Still(self._weighted(M, C, K), C, K, J, moving, J_moving)
        coefficients = one.mass_factor, one.beta, one.gamma, one.alpha_m, one.alpha_f
        return LinearKernel(still, self.h, coefficients, self._window, self._shared)


class Going:
    """One march among some on the same systems.

    Attributes:
        found: All steps; those of the windows so far are written.
    """

    def __init__(self, march: LinearMarch) -> None:
        """`march`: The systems."""
        self._march, count = march, len(march.grid.t)
        n, rows = march.parts[0].shape[0], march.parts[3].shape[0]
        self.found = Marched(*(np.empty((count, width)) for width in (n, n, n, rows)))
        self._load, self._state = np.empty((count, n)), np.empty((4, n))
        self._start, self._compiled = np.zeros(n), march.compiled
        self._steps: Iterator[State] | None = None

    def go(self, s: slice, load: Array, start: Array) -> None:
        """Take the steps of a window.

        Args:
            s: The window, after those before it.
            load: r there, shape (steps, n).
            start: First deviation of all, shape (n,).
        """
        self._load[s] = load
        if s.start == 0:
            self._start = start
        if self._compiled:
            if s.start == 0:
                first = start_at_rest(replace(self._march.first, r=load[0]), start)
                self._put(0, first)
                self._state[:] = first.d, first.v, first.a, first.a
                return
            if self._march.advance(s, self._load[s], self._state, self.found):
                return
            self._compiled = False
        if self._steps is None:  # from the first step on, also where the kernel gave up later
            self._steps, s = self._in_numpy(), slice(0, s.stop)
        for k, state in zip(range(s.start, s.stop), self._steps, strict=False):
            self._put(k, state)

    def _put(self, k: int, state: State) -> None:
        for name, history in zip(Marched._fields, self.found, strict=True):
            history[k] = getattr(state, name)

    def _in_numpy(self) -> Iterator[State]:
        march, n = self._march, len(self._start)
        M, C, K, J = march.parts
        r, none = (varying(np.zeros((len(M), width))) for width in (n, 0))
        system = InterpolatedPath(march.grid, (M, C, K, r, J, none))

        def at(k: int) -> Instant:
            now = system.at(k).free
            return Instant(now.M, now.C, now.K, self._load[k], now.J)

        return iter(alpha(march.scheme, at, len(self._load), march.h, self._start))
