"""The compiled functions on numpy arrays."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array, IntArray
from pinflex.errors import PinflexError
from pinflex.kernel.library import Record, aligned, loaded, names, numbers, place, shapes

# Flat tables of one system, as the C code reads them; fields and shapes are those of `Tables` in
# source/kernel.h, which says what they hold. Sizes are checked here; that every index is within
# what it points into, tests check of all tables that they make (tests/sound_tables.py).

COUNTS = names("Tables", ctypes.c_int64)


def pairs_of(arrays: Mapping[str, npt.ArrayLike]) -> tuple[dict[str, IntArray], int]:
    """Pairs of coordinates that G multiplies, each once: rows of a body share them.

    Those of rows that are sums of products come first; also their number.
    """
    given = (arrays[f"g_{name}"] for name in ("i", "j", "at", "rest"))
    i, j, at, rest = (np.asarray(x, dtype=np.int64) for x in given)
    row = np.searchsorted(at, np.arange(len(i)), side="right") - 1
    (first, second), pair = np.unique(np.array([i, j]), axis=1, return_inverse=True)
    summed = np.zeros(len(first), dtype=bool)
    summed[pair[np.arange(len(i)) < rest[np.minimum(row, len(rest) - 1)]]] = True
    order = np.argsort(~summed, kind="stable")
    number = np.argsort(order)
    found = {"g_pair": number[pair], "g_first": first[order], "g_second": second[order]}
    return found, int(summed.sum())


class Tables(Record):
    """Tables of one system; the C code may read every entry that they point to.

    Attributes:
        counts: Sizes by name, of what arrays follow by their lengths unless they are given.
    """

    def __init__(self, counts: Mapping[str, int], arrays: Mapping[str, npt.ArrayLike]) -> None:
        if "g_pair" not in arrays:
            pairs, products = pairs_of(arrays)
            arrays = {**arrays, **pairs}
            counts = {**counts, "pairs": len(pairs["g_first"]), "products": products}
        lengths = dict.fromkeys(COUNTS, 0)
        for name, (_, (first, *_)) in shapes("Tables").items():
            if first in lengths and name in arrays:
                lengths[first] = len(arrays[name])  # type: ignore[arg-type]
        self.counts = {name: int(counts.get(name, lengths[name])) for name in COUNTS}
        sizes = self.counts | {"n_eta": self.counts["nv"] - self.counts["nv_rigid"]}
        super().__init__("Tables", sizes, arrays)

    def __reduce__(self) -> tuple[type[Tables], tuple[Any, ...]]:
        """Addresses do not travel to another process: it makes its own."""
        return Tables, (self.counts, self.arrays)


# Workspaces that no run uses now: most of what a short run costs is to make new ones.

_KEPT = 4  # of one kind: runs at the same time are few
_LARGEST = 1.6e7  # bytes: beside a run that fills a larger one, to make it costs nothing


class Spares:
    """Spare workspaces of one system, by kind; they travel to no other process."""

    def __init__(self) -> None:
        self._by_kind: dict[object, list[Any]] = {}

    def __reduce__(self) -> tuple[type[Spares], tuple[()]]:
        return Spares, ()

    def acquire(self, kind: object) -> Any:
        """A spare workspace, its caller's own from now on; None: there is none."""
        try:
            return self._by_kind[kind].pop()
        except (KeyError, IndexError):
            return None

    def release(self, kind: object, workspace: Any, size: float) -> None:
        """Keep a workspace that its owner no longer uses."""
        spare = self._by_kind.setdefault(kind, [])
        if size <= _LARGEST and len(spare) < _KEPT:
            spare.append(workspace)


# What the equations answer with, by name: values that nothing overwrites.


# Named tuples: a frozen dataclass costs eight times as much to make, in every iteration of a step.
class Residual(NamedTuple):
    """Forces left to the motors r, shape (n, nv), and closure residuals c, shape (n, rows)."""

    r: Array
    c: Array


class Closure(NamedTuple):
    """Closure residuals c, shape (n, rows), and their Jacobian J = dc/dy, shape (n, rows, nv)."""

    c: Array
    J: Array


class Tangent(NamedTuple):
    """Derivatives of r by a, v, y, shape (nv, nv) each, and of c by y, shape (rows, nv)."""

    M: Array
    C: Array
    K: Array
    J: Array


class Energies(NamedTuple):
    """Energies in J, shape (n,): that of dead loads is in `spring`."""

    kinetic: Array
    gravity: Array
    elastic: Array
    spring: Array


class JointForces(NamedTuple):
    """Forces at n states.

    Attributes:
        r, c: As in `Residual`. g: Expanded forces rnea - J_Q' lam, shape (n, nV).
        f: Forces of joints in their own frames, shape (n, joints, 6).
        wrenches: Of loops on their B, about the origin of frame b, shape (n, loops, 6).
        sleeves: (x, F, M, segment) of sleeves at three places, shape (n, contacts, 3, 8).
    """

    r: Array
    c: Array
    g: Array
    f: Array
    wrenches: Array
    sleeves: Array


Times = Array | Sequence[float | Array]


class Evaluator:
    """One system on the kernel, with a workspace of its own (one for each thread).

    States are time-first: y (n, nq), v and a (n, nv), multipliers lam (n, rows) at times t (n,).

    Attributes:
        tables: The system. functions: The C code. work: Address of the workspace.
    """

    def __init__(
        self, tables: Tables, loads: Sequence[Any] = (), node_of: IntArray | None = None
    ) -> None:
        """`loads`: of `FrameForce`. `node_of`: of joints, -1: none; None: nodes are meant.

        Raises:
            PinflexError: There is no kernel.
        """
        self.functions, self.tables = loaded(), tables
        self._loads, self._node_of, n = loads, node_of, tables.counts
        self._widths = {
            "y": n["nq"], "v": n["nv"], "a": n["nv"], "lam": n["closures"], "scale": n["forces"]
        }  # fmt: skip
        self._work = aligned(self.functions.pinflex_work_size(tables.address) // 8 + 1)
        self.work: int = self._work.ctypes.data

    def scale(self, t: Times) -> Array:
        """Shares of the loads that act at times t (n,), shape (n, forces)."""
        scale = np.empty((len(t), len(self._loads)))
        for k, load in enumerate(self._loads):
            scale[:, k] = [load.scale(float(time)) for time in t]
        return scale

    def residual(self, Y: Array, V: Array, A: Array, lam: Array, t: Times) -> Residual:
        """Residuals and what the loops are open by, of several states."""
        given = self._given(y=Y, v=V, a=A, lam=lam, scale=self.scale(t))
        found = Residual(*self._room(len(Y), "v", "lam"))
        self._call("residuals", len(Y), *given, *found)
        return found

    def closure_motion(self, Y: Array, V: Array, A: Array) -> Array:
        """Closures of several states, and their first and second time derivatives, (3, n, rows)."""
        found = np.empty((3, len(Y), self._widths["lam"]))
        self._call("closure_motion", len(Y), *self._given(y=Y, v=V, a=A), *found)
        return found

    def losses(self, Y: Array, V: Array) -> Array:
        """Power that damping, friction and dampers take, shape (n,), W."""
        power = np.empty(len(Y))
        self._call("losses", len(Y), *self._given(y=Y, v=V), power)
        return power

    def closures(self, Y: Array) -> Closure:
        """Closures (n, rows) and their Jacobians (n, rows, nv) at poses Y (n, nq)."""
        given, (c,) = self._given(y=Y), self._room(len(Y), "lam")
        J = np.empty((*c.shape, self._widths["v"]))
        self._call("closures", len(Y), *given, c, J)
        return Closure(c, J)

    def sleeve_places(self, Y: Array) -> Array:
        """Where the sleeves are on their links at poses Y (n, nq), shape (n, sleeves), m."""
        out = np.empty((len(Y), self.tables.counts["sleeves"]))
        self._call("sleeves", len(Y), *self._given(y=Y), out)
        return out

    def elongations(self, Y: Array) -> Array:
        """What laws of pieces are over, coordinates and springs, at Y (n, nq), shape (n, kinks)."""
        out = np.empty((len(Y), self.tables.counts["kinks"]))
        self._call("elongations", len(Y), *self._given(y=Y), out)
        return out

    def poses(self, Y: Array, joints: Sequence[int]) -> Array:
        """Poses [R | p] of joints in the world, m, shape (k, n, 3, 4)."""
        given, wanted = self._given(y=Y), self._nodes(joints, -1)
        poses = np.empty((len(wanted), len(Y), 3, 4))
        self._call("poses", len(Y), *given, len(wanted), wanted, poses)
        return poses

    def motions(self, Y: Array, V: Array, A: Array, joints: Sequence[int]) -> tuple[Array, Array]:
        """Poses (k, n, 3, 4) of joints, and spatial velocity and acceleration (k, n, 2, 6).

        Returns:
            Poses in the world; motions of the joints' origins in their own axes.
        """
        given, wanted = self._given(y=Y, v=V, a=A), self._nodes(joints, -1)
        poses, rates = np.empty((len(wanted), len(Y), 3, 4)), np.empty((len(wanted), len(Y), 2, 6))
        self._call("motions", len(Y), *given, len(wanted), wanted, poses, rates)
        return poses, rates

    def energies(self, Y: Array, V: Array, t: Times) -> Energies:
        """Energies of several states, J."""
        found = np.empty((4, len(Y)))
        self._call("energies", len(Y), *self._given(y=Y, v=V, scale=self.scale(t)), found)
        return Energies(*found)

    def joint_forces(
        self, Y: Array, V: Array, A: Array, lam: Array, t: Times, joints: Sequence[int]
    ) -> JointForces:
        """Forces of joints, loops and sleeves at several states."""
        given = self._given(y=Y, v=V, a=A, lam=lam, scale=self.scale(t))
        wanted, n, count = self._nodes(joints, 0), len(Y), self.tables.counts
        shapes = ((count["nV"],), (len(wanted), 6), (count["loops"], 6), (count["sleeves"], 3, 8))
        own = (np.empty((n, *shape)) for shape in shapes)
        found = JointForces(*self._room(n, "v", "lam"), *own)
        self._call("forces", n, *given, len(wanted), wanted, *found)
        return found

    def tangent(
        self, y: Array, v: Array, a: Array, lam: Array, t: float, rates: bool = True
    ) -> Tangent:
        """M, C, K, the derivatives of the residual by a, v and y, (nv, nv), and J (rows, nv)."""
        states = {"y": y[None], "v": v[None], "a": a[None], "lam": lam[None]}
        nv, rows = self._widths["v"], self._widths["lam"]
        M, C, K = np.empty((3, nv, nv))
        found = Tangent(M, C, K, np.empty((rows, nv)))
        self._call("tangent", int(rates), *self._given(**states, scale=self.scale((t,))), *found)
        return found

    def linear_systems(
        self, states: Sequence[Array], at: IntArray, out: Array, rates: bool = True
    ) -> None:
        """Entries of M, C, K (nv, nv) and J (rows, nv) at several states y, v, a, lam and t."""
        *states, t = states
        given = self._given(**dict(zip(self._widths, [*states, self.scale(t)], strict=True)))
        size = self._widths["v"] * (3 * self._widths["v"] + self._widths["lam"])
        if len(at) and not 0 <= np.min(at) <= np.max(at) < size:
            raise PinflexError(f"kernel: an entry of a tangent of {size}.")
        to = place(out, len(states[0]), max(out.shape[1], len(at)))
        entries, room = np.ascontiguousarray(at, dtype=np.int64), np.empty(size)
        where = len(at), entries, room, out.shape[1], to
        self._call("linear_systems", int(rates), len(out), *given, *where)

    def saddle(self, S: Array, b: Array) -> Array:
        """The solution x (n,) of S x = b, of least norm where S (n, n) is singular."""
        n = len(b)
        rooms = np.array(numbers(S, n, n), order="F"), np.array(b, dtype=np.float64)
        order, x = np.empty(3 * n, dtype=np.int64), np.empty(n)
        arrays = (*rooms, np.empty((n, n + 1)), order, x)
        self.functions.pinflex_saddle(n, *(array.ctypes.data for array in arrays))
        return x

    def has(self, joints: Sequence[int]) -> bool:
        """Whether joints are nodes of the kernel's tree; stations at its leaves are none."""
        wanted = np.asarray(joints, dtype=np.intp)
        return self._node_of is None or bool(np.all(self._node_of[wanted] >= 0))

    def _given(self, **states: Array) -> list[Array]:
        """States as the C code reads them."""
        n = len(next(iter(states.values())))
        return [numbers(array, n, self._widths[name]) for name, array in states.items()]

    def _room(self, n: int, *like: str) -> list[Array]:
        return [np.empty((n, self._widths[name])) for name in like]

    def _nodes(self, joints: Sequence[int], first: int) -> IntArray:
        """Nodes of joints that outputs look at; -1: the base."""
        wanted = np.ascontiguousarray(joints, dtype=np.int64)
        if self._node_of is not None:
            nodes = self._node_of[wanted].astype(np.int64)
            if np.any((nodes < 0) & (wanted > 0)):
                raise PinflexError(f"kernel: {wanted[nodes < 0]}: no joints that outputs look at.")
            wanted = nodes
        if np.any(wanted < first) or np.any(wanted >= self.tables.counts["nodes"]):
            raise PinflexError(f"kernel: {wanted}: a node that is none.")
        return wanted

    def _call(self, name: str, *given: int | npt.NDArray[Any]) -> None:
        """The C function of a name."""
        pointers = (x if isinstance(x, int) else x.ctypes.data for x in given)
        getattr(self.functions, f"pinflex_{name}")(self.tables.address, self.work, *pointers)


def entries_of(
    matrices: str, nv: int, closures: int, rows: IntArray, columns: IntArray
) -> IntArray:
    """Where some rows and columns are in M, C, K and J, as `linear_systems` counts entries."""
    square = (rows[:, None] * nv + columns).ravel()
    J = 3 * nv**2 + (np.arange(closures)[:, None] * nv + rows).ravel()
    where = {"M": square, "C": square + nv**2, "K": square + 2 * nv**2, "J": J}
    return np.concatenate([where[matrix] for matrix in matrices])
