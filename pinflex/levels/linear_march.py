"""March of a linear system along a path, under any number of loads.

    M(t) a + C(t) v + K(t) d + r(t) - J(t)' lam = 0,     J(t) d = 0

Systems and their factors do not depend on the load: marches may go on side by side, each with loads
that come of the responses before it. A window of steps is factored at a time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pinflex.arrays import Array, BoolArray, IntArray
from pinflex.integrators.chebyshev import Interpolation, Varying, together
from pinflex.integrators.collocation import AlphaScheme
from pinflex.integrators.linear import Instant, State, alpha, start_at_rest
from pinflex.kernel.library import kernel
from pinflex.kernel.linear import ConstantPart, LinearKernel

_WINDOW = 64  # steps at a time, at the least
_VALUES = 100_000  # varying entries of the systems of a window (0.8 MB): caches are small
_FACTORS = 2_000_000  # numbers of factors that a window keeps (16 MB)
_FEWEST = 16  # systems whose factors are kept, however large


class Response(NamedTuple):
    """Deviation d, its rates v and a, (nt, n) each, and multipliers lam (nt, closures)."""

    d: Array
    v: Array
    a: Array
    lam: Array

    @classmethod
    def empty(cls, steps: int, n: int, closures: int) -> Response:
        """Room for one."""
        return cls(*(np.empty((steps, width)) for width in (n, n, n, closures)))

    def put(self, k: int, state: State) -> None:
        """Write a step."""
        self.d[k], self.v[k], self.a[k], self.lam[k] = state.d, state.v, state.a, state.lam

    def sampled(self, every: int) -> Response:
        """Every n-th step."""
        return Response(*(x[::every] for x in self))

    @property
    def sound(self) -> int:
        """Number of steps before the first that is not finite."""
        finite = np.all(np.isfinite(self.d), axis=1) & np.all(np.isfinite(self.a), axis=1)
        return len(finite) if np.all(finite) else int(np.argmin(finite))


def forces_along(
    grid: Interpolation, parts: Sequence[Varying], response: Response, every: int = 1
) -> Array:
    """Forces M a + C v + K d + r - J' lam at every step, shape (nt, k): what motors give."""
    force = np.empty((len(response.d), *parts[4].shape))
    each = max(_WINDOW, _VALUES // max(parts[0].constant.size, 1))
    for start in range(0, len(force), each):
        s = slice(start, min(start + each, len(force)))
        steps = slice(s.start * every, s.stop * every, every)
        M, C, K, J, r = together(parts, grid, steps)
        d, v, a, lam = (x[s, :, None] for x in response)
        force[s] = r + (M @ a + C @ v + K @ d - J.swapaxes(1, 2) @ lam)[:, :, 0]
    return force


class Workspace:
    """Buffer shared by successive marches; first touch of new memory is slow.

    Attributes:
        owner: Whose numbers are there.
    """

    def __init__(self) -> None:
        self._numbers = np.empty(0)
        self.owner: LinearMarch | None = None

    def take(self, owner: LinearMarch, size: int) -> Array:
        """The buffer, for another owner; what was there is lost."""
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
        workspace: Workspace | None = None,
    ) -> None:
        """Nothing is factored yet."""
        self.scheme, self.grid, self.h, self.parts = scheme, grid, h, tuple(parts)
        self._workspace, self._shared = workspace or Workspace(), workspace is not None
        self._window: slice | None = None
        self._values: tuple[Array, IntArray] = np.empty(0), np.empty(0, dtype=np.intp)

    def instant(self, k: int, load: Array) -> Instant:
        """The system at a step, under a load (n,)."""
        M, C, K, J = (x[0] for x in together(self.parts, self.grid, slice(k, k + 1)))
        return Instant(M, C, K, load, J)

    def __call__(self, load: Array, start: Array) -> Response:
        """March from rest."""
        march = self.begin()
        for s in self.windows():
            march.go(s, load[s], start)
        return march.response

    def begin(self) -> RunningMarch:
        """One of some marches that go on side by side, window by window."""
        return RunningMarch(self)

    def windows(self) -> Iterator[slice]:
        """Steps that are taken at a time: the first, then as many as share the workspace."""
        count, each = len(self.grid.t), self._steps
        yield slice(0, 1)
        yield from (slice(k, min(k + each, count)) for k in range(1, count, each))

    @cached_property
    def _steps(self) -> int:
        """Steps in a window."""
        if self._shared:
            size = self.parts[0].shape[0] + self.parts[3].shape[0]
            steps = max(_FEWEST, _FACTORS // max(size * size, 1))
        else:
            steps = max(_WINDOW, _VALUES // max(self._nodes.shape[1], 1))
        return int(min(steps, max(len(self.grid.t) - 1, 1)))

    # On the kernel -------------------------------------------------------------------------

    @property
    def compiled(self) -> bool:
        """Whether the kernel marches."""
        n = self.parts[0].shape[0]
        return kernel().functions is not None and n > 0 and len(self.grid.t) > 1

    def advance(self, s: slice, load: Array, state: Array, response: Response) -> bool:
        """Steps of a window by the kernel; False where a system is singular."""
        values, system = self._opened(s)
        self._kernel.state[:] = state
        there = response.d[s], response.v[s], response.a[s], response.lam[s]
        done = self._kernel.march(system, values, load, there)
        state[:] = self._kernel.state
        return bool(done == len(system))

    def _opened(self, s: slice) -> tuple[Array, IntArray]:
        """Varying entries of the systems of a window, and which of them is each step's."""
        if s != self._window or self._workspace.owner is not self:
            at, system = np.unique(self._at[s], return_inverse=True)
            width, size = self._nodes.shape[1], self._kernel.n + self._kernel.rows
            factors = self._steps * size * size if self._shared else 0
            numbers = self._workspace.take(self, factors + len(at) * width)
            if self._shared:
                self._kernel.use(numbers[:factors])
            self._kernel.forget()
            values = numbers[factors:].reshape(len(at), width)
            self.grid.between(self._nodes, at, values)
            self._window, self._values = s, (values, system)
        return self._values

    @cached_property
    def _at(self) -> IntArray:
        """A step at which the system is that of each step: pieces at rest have only one."""
        grid, steps = self.grid, np.arange(len(self.grid.t))
        rests = np.ones(len(grid.pieces), dtype=bool)
        for x, varying in zip(self.parts, self._varying, strict=True):
            for k, nodes in enumerate(grid.by_piece(varying)):
                rests[k] &= bool(np.all(np.ptp(nodes, axis=0) <= x.noise))
        for piece in np.flatnonzero(rests):
            here = grid.piece == piece
            here[grid.corners] = False
            steps[here] = np.argmax(here)
        return steps

    @cached_property
    def _entries(self) -> tuple[BoolArray, BoolArray]:
        """Entries of M, C or K, and of J, that vary, shapes (n, n) and (closures, n)."""
        M, C, K, J = (x.varies for x in self.parts)
        return M | C | K, J

    @cached_property
    def _varying(self) -> list[Array]:
        """Those entries of M, C, K and J at the nodes, column by column, (size, .) each."""
        square, J_at = (np.nonzero(x.T)[::-1] for x in self._entries)
        places = square, square, square, J_at
        return [x.entries_at(at) for x, at in zip(self.parts, places, strict=True)]

    @cached_property
    def _nodes(self) -> Array:
        """The same of S, C, K and J side by side, shape (size, width)."""
        M, C, K, J = self._varying
        return np.hstack([self._weighted(M, C, K), C, K, J])

    def _weighted(self, M: Array, C: Array, K: Array) -> Array:
        """S, which the acceleration of a step is solved with."""
        by_a, by_v, by_d = self.scheme.weights(self.h)
        return by_a * M + by_v * C + by_d * K

    @cached_property
    def _kernel(self) -> LinearKernel:
        scheme, (square, closures) = self.scheme, self._entries
        M, C, K = (np.where(square, 0.0, x.constant) for x in self.parts[:3])
        J = np.where(closures, 0.0, self.parts[3].constant)
        constant = ConstantPart(self._weighted(M, C, K), C, K, J, square, closures)
        coefficients = (
            scheme.mass_factor, scheme.beta, scheme.gamma, scheme.alpha_m, scheme.alpha_f,
        )  # fmt: skip
        return LinearKernel(constant, self.h, coefficients, self._steps, self._shared)


class RunningMarch:
    """One march among some on the same systems.

    Attributes:
        response: All steps; those of the windows so far are written.
    """

    def __init__(self, march: LinearMarch) -> None:
        self._march, count = march, len(march.grid.t)
        closures, n = march.parts[3].shape
        self.response = Response.empty(count, n, closures)
        self._load, self._state = np.empty((count, n)), np.empty((4, n))
        self._start, self._compiled = np.zeros(n), march.compiled
        self._plain: Iterator[State] | None = None

    def go(self, s: slice, load: Array, start: Array) -> None:
        """Take the steps of a window."""
        self._load[s] = load
        if s.start == 0:
            self._start = start
        if self._compiled:
            if s.start == 0:
                first = start_at_rest(self._march.instant(0, load[0]), start)
                self.response.put(0, first)
                self._state[:] = first.d, first.v, first.a, first.a
                return
            if self._march.advance(s, self._load[s], self._state, self.response):
                return
            self._compiled = False
        if self._plain is None:  # from the first step on, also where the kernel gave up later
            march, s = self._march, slice(0, s.stop)
            count, load = len(self._load), self._load
            self._plain = alpha(
                march.scheme, lambda k: march.instant(k, load[k]), count, march.h, self._start
            )
        for k, state in zip(range(s.start, s.stop), self._plain, strict=False):
            self.response.put(k, state)
