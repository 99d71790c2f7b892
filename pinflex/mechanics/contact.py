"""The rows of a sleeve on a beam at one state, with their exact derivatives.

See `pinflex.mechanics.slider`. Every row has the form

    h = s . (n0 + N g) + O g,      g = B(X) eta

where s is the place p of frame b in the beam's frame, or its x or y axis there; g holds v, w at
X - a, X, X + a, their slopes at X and the twist psi(X); n0, N and O are constants of the row.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array
from pinflex.errors import MotionError
from pinflex.mechanics.poses import skew
from pinflex.mechanics.slider import ROWS

if TYPE_CHECKING:
    from pinflex.mechanics.slider import Contact, Sleeve

_FIRST = {"v": 0, "w": 4}  # of values at X - a, X, X + a and the slope at X, in g
_TWIST, _SIZE = 8, 9
_ROWS = dict(zip("vwp", ROWS, strict=True))
_VALUES = {
    "hold": (0.0, -1.0, 0.0),
    "right": (0.0, -1.0, 1.0),
    "left": (1.0, -1.0, 0.0),
    "pivot": (1.0, -2.0, 1.0),
}
_SLOPES = {"right": -1.0, "left": 1.0}  # of a times the slope
_PLACE, _X_AXIS, _Y_AXIS = 0, 1, 2


def _row(sort: str, direction: str, a: float) -> tuple[int, Array, Array, Array]:
    """Which s a row takes, its n0 (3,), N (3, 9) and O (9,)."""
    n0, N, O = np.zeros(3), np.zeros((3, _SIZE)), np.zeros(_SIZE)  # noqa: E741
    first, axis = _FIRST[direction], 1 if direction == "v" else 2
    if sort in ("tilt", "twist"):
        n0[axis] = 1.0
        N[0, first + 3] = -1.0
        N[2 if direction == "v" else 1, _TWIST] = 1.0 if direction == "v" else -1.0
        return _X_AXIS if sort == "tilt" else _Y_AXIS, n0, N, O
    if sort in ("hold", "chord"):
        n0[axis] = 1.0
    if sort in _VALUES:
        O[first : first + 3] = _VALUES[sort]
    O[first + 3] = a * _SLOPES.get(sort, 0.0)
    return _PLACE, n0, N, O


class ContactRows:
    """The rows of one sleeve: their constants.

    Attributes:
        rows: Among the closure rows. loop: Of the sleeve. eta: Of its beam in the coordinates.
    """

    def __init__(self, contact: Contact) -> None:
        sleeve = contact.sleeve
        self.contact, self.rows, self.loop = contact, contact.rows, contact.loop
        self.eta = sleeve.eta
        made = [_row(sort, direction, sleeve.half) for sort, direction in sleeve.sorts]
        count = len(made)
        self.source = np.array([m[0] for m in made], dtype=np.intp)
        self.n0 = np.array([m[1] for m in made]).reshape(count, 3)
        self.N = np.array([m[2] for m in made]).reshape(count, 3, _SIZE)
        self.O = np.array([m[3] for m in made]).reshape(count, _SIZE)
        self.placed = self.source == _PLACE
        self.turning = np.flatnonzero(~self.placed)
        self.places = sleeve.half * np.array([-1.0, 0.0, 1.0])
        self.n = sleeve.eta.stop - sleeve.eta.start

    def at(self, frame_a: Array, frame_b: Array, arm: Array, eta: Array) -> ContactState:
        """The rows at one state.

        Args:
            frame_a: Beam frame [R | p], shape (3, 4). frame_b: The sleeve's frame.
            arm: skew(p_b), shape (3, 3). eta: Elastic coordinates of all bodies.
        """
        return ContactState(self, frame_a, frame_b, arm, eta)


class ContactState:
    """The rows of one sleeve at one state, their Jacobians and second derivatives.

    Attributes:
        rows, loop, eta: As in `ContactRows`. X, place: Where on the beam the sleeve is, m.
        sleeve: What it holds.
        value: h, shape (rows,). W: By the relative twist at the world origin, (rows, 6).
        by_eta: dh/deta of the body's coordinates, (rows, n).
    """

    def __init__(
        self, rows: ContactRows, frame_a: Array, frame_b: Array, arm: Array, eta: Array
    ) -> None:
        """As `ContactRows.at`."""
        self._of, self.rows, self.loop, self.eta = rows, rows.rows, rows.loop, rows.eta
        self._width = len(eta)
        self._R, self._arm = frame_a[:, :3], arm
        self._axes = frame_b[:, :2].T  # x and y of b in the world
        here = np.vstack([frame_b[:, 3] - frame_a[:, 3], self._axes]) @ self._R
        self.place = self.X = float(here[0, 0])
        self.sleeve = rows.contact.sleeve
        self._tables()
        self._mine = eta[self.eta]
        s = here[rows.source]
        g, self._g_X = self._B @ self._mine, self._B_X @ self._mine
        self._c, normal = rows.O, rows.n0
        if len(rows.turning):
            self._c = self._c + np.einsum("ri,rik->rk", s, rows.N)
            normal = normal + rows.N @ g
        self.value = (s * normal).sum(axis=1) + rows.O @ g
        self.by_eta, self._by_X_eta = self._c @ self._B, self._c @ self._B_X
        self._by_X = self._c @ self._g_X
        self._normal = normal @ self._R.T
        push = self._by_X[:, None] * self._R[:, 0]
        push[rows.placed] += self._normal[rows.placed]
        self.W = np.empty((len(push), 6))
        self.W[:, :3], self.W[:, 3:] = push, push @ arm.T
        if len(rows.turning):
            k = rows.turning
            self.W[k, 3:] += np.cross(self._axes[rows.source[k] - 1], self._normal[k])

    def _tables(self) -> None:
        """B and its derivatives by X of order 1 and 2, shape (9, n)."""
        self._B, self._B_X, self._B_XX = B = np.zeros((3, _SIZE, self._of.n))
        track = self._of.contact.sleeve.track
        if track is None:
            return
        around = [track.at(self.X + a).Phi for a in self._of.places]
        for direction, k in _FIRST.items():
            row = _ROWS[direction]
            for place, Phi in enumerate(around):
                B[:, k + place] = Phi[:3, row]
            B[:, k + 3] = around[1][1:, row]
        B[:, _TWIST] = around[1][:3, _ROWS["p"]]

    def _by_XX(self) -> Array:
        """d2h/dX2, shape (rows,)."""
        return np.asarray(self._c @ (self._B_XX @ self._mine))

    def bias(
        self, spin_a: Array, spin_b: Array, v_ab: Array, swept: Array, gap: Array,
        rate: Array,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Time derivative of W (rows, 6), and of by_eta times the elastic rates, (rows,).

        Args:
            spin_a, spin_b: skew of the frames' angular velocities. v_ab: Velocity of b's origin
                less that of a's (m/s). swept: skew of b's. gap: b's origin less a's (m).
            rate: Of the elastic coordinates.
        """
        R, mine = self._R, rate[self.eta]
        slip = float(R[:, 0] @ v_ab + (spin_a @ R[:, 0]) @ gap)
        g_rate = self._g_X * slip + self._B @ mine
        s_rate = np.vstack([np.zeros(3), self._axes @ (spin_b - spin_a).T @ R])[self._of.source]
        c_rate = np.einsum("ri,rik->rk", s_rate, self._of.N)
        swing = self._by_X_eta @ mine
        drift = swing * slip + c_rate @ (self._B @ mine)
        grow = self._by_XX() * slip + swing + c_rate @ self._g_X
        out = np.zeros_like(self.W)
        along = spin_a @ R[:, 0]
        push = grow[:, None] * R[:, 0] + self._by_X[:, None] * along
        n_rate = self._normal @ spin_a.T + (self._of.N @ g_rate) @ R.T
        push[self._of.placed] += n_rate[self._of.placed]
        out[:, :3] = push
        out[:, 3:] = self.W[:, :3] @ swept.T + push @ self._arm.T
        if len(self._of.turning):
            k = self._of.turning
            e = self._axes[self._of.source[k] - 1]
            out[k, 3:] += np.cross(e @ spin_b.T, self._normal[k]) + np.cross(e, n_rate[k])
        return out, drift

    def turning_stiffness(self, lam: Array) -> tuple[Array, Array]:
        """What the moments of fixed sleeves change by when b turns against a: on B, on A, (3, 3).

        Args:
            lam: Multipliers of all closure rows.
        """
        k = self._of.turning
        e, n = skew(self._axes[self._of.source[k] - 1]), skew(self._normal[k])
        weights = lam[self.rows[k], None, None]
        return (weights * (e @ n)).sum(axis=0), (weights * (n @ e)).sum(axis=0)

    def add_tangent(self, total: Array, lam: Array, J_rel: Array) -> None:
        """Add what the moving contact changes in J' lam.

        Args:
            total: d(J' lam)/dy, shape (nv, nv). lam: Multipliers of all closure rows.
            J_rel: Relative twist of b to a by v, shape (6, nv).
        """
        push, x = lam[self.rows], self._R[:, 0]
        slip = np.concatenate([x, self._arm @ x]) @ J_rel
        total += float(push @ self._by_XX()) * np.outer(slip, slip)
        start = len(total) - self._width  # where the elastic coordinates begin in v
        at = slice(start + self.eta.start, start + self.eta.stop)
        cross = np.outer(slip, push @ self._by_X_eta)
        if len(self._of.turning):
            k = self._of.turning
            moved = -self._R.T @ skew(self._axes[self._of.source[k] - 1]) @ J_rel[3:]
            pulled = np.einsum("r,riv,rik->vk", push[k], moved, self._of.N[k])
            total += np.outer(pulled @ self._g_X, slip) + np.outer(slip, pulled @ self._g_X)
            cross += pulled @ self._B
        if self._of.n:
            total[:, at] += cross
            total[at] += cross.T

    def forces(self, lam: Array) -> Array:
        """What the sleeve does to the beam: (x, F, M, segment) at X - a, X, X + a, shape (3, 8).

        Args:
            lam: Multipliers of all closure rows.
        """
        push = lam[self.rows]
        on = push @ self._c
        out = np.zeros((3, 8))
        out[:, 0] = self.X + self._of.places
        out[1, 1] = -push @ self._by_X
        out[:, 2], out[:, 3] = on[0:3], on[4:7]
        out[1, 4], out[1, 5], out[1, 6] = on[_TWIST], -on[7], on[3]
        return out


def off_beam(sleeve: Sleeve, place: Array) -> npt.NDArray[np.bool_]:
    """Whether an end of a sleeve lies beyond an end of its beam, shape as `place`.

    Args:
        sleeve: It. place: Of its middle on the link (m).
    """
    # An end may stand on an end of the beam, up to what closing the loops leaves.
    slack = 1e-9 * sleeve.length
    return np.asarray(
        np.abs(place - 0.5 * sleeve.length) + sleeve.half > 0.5 * sleeve.length + slack
    )


def left_beam(sleeve: Sleeve, place: float, name: str, where: str, t: float | None) -> MotionError:
    """The error that a sleeve has left its beam.

    Args:
        sleeve: It. place: Of its middle on the link (m).
        name: Of the loop. where: Name of the model. t: Time (s), if there is one.
    """
    when = where if t is None else f"{where}: t = {t:.6g} s"
    reach = f"x = {place:.6g} m"
    if sleeve.half:
        reach += f", from {place - sleeve.half:.6g} to {place + sleeve.half:.6g} m"
    return MotionError(
        f'{when}: sleeve "{name}" leaves the beam {sleeve.link}: it is at {reach}, the beam '
        f"ends at 0 and {sleeve.length:g} m. Shorten the motion, or lengthen the beam.",
        loop=name,
        position=place,
        time=t,
    )


def section_forces(x: Array, forces: Array, segment: int = 0, roots: Array | None = None) -> Array:
    """Section forces N, Vy, Vz, T, My, Mz that a sleeve adds on a segment, shape (nt, nx, 6).

    What stands on later segments is in the forces of the interface; there it acts with the root of
    the segment that the sleeve is on.

    Args:
        x: Sections from the segment's root (m), shape (nx,).
        forces: From `ContactState.forces`, shape (nt, 3, 8).
        segment: Its number. roots: Beam frames of all segments in the world, shape
            (segments, nt, 3, 4); None: of one.
    """
    on = forces[:, 0, 7]
    at, F, M = forces[:, :, 0], forces[:, :, 1:4], forces[:, :, 4:7]
    if roots is not None and np.any(on != segment):
        own, there = roots[segment], roots[on.astype(int), np.arange(len(on))]
        turn = np.swapaxes(own[:, :, :3], 1, 2) @ there[:, :, :3]
        shift = np.einsum("tji,tj->ti", own[:, :, :3], there[:, :, 3] - own[:, :, 3])
        at = at * turn[:, :1, 0] + shift[:, :1]
        F, M = F @ turn.swapaxes(1, 2), M @ turn.swapaxes(1, 2)
    arm = at[:, None, :] - x[None, :, None]
    counted = (arm >= 0.0).astype(float) - (on > segment)[:, None, None]
    Fx, Fy, Fz, Mx, My, Mz = (part[:, None, :, k] for part in (F, M) for k in range(3))
    parts = (Fx, Fy, Fz, Mx, My - arm * Fz, Mz + arm * Fy)
    return np.stack([np.sum(counted * p, axis=2) for p in parts], axis=2)
