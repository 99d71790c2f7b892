"""Loop closures: residual c, Jacobian J and their exact derivatives, all loops in one batch.

Every kind is made of three sorts of rows between frame a (on body A) and frame b (on body B):

    point      c = u . (p_b - p_a)                  u an axis of a
    direction  c = e_a . e_b                        an axis of a, an axis of b
    distance   c = (|p_b - p_a|^2 - l^2) / (2 l)

A sleeve on a flexible beam (`pinflex.slider`) adds rows that also hold its elastic coordinates.

Each row is W (twist of B - twist of A), twists taken at the world origin, so with J the world
Jacobians of Pinocchio the closure Jacobian is (W J) times the difference of the bodies' supports.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.expanded import Attachment
from pinflex.poses import SKEW, JointPoses, columns, skew
from pinflex.slider import Contact, ContactState, Sleeve
from pinflex.supplement import Loop

# Points held along these axes of a, and pairs (axis of a, axis of b) held perpendicular.
_ROWS: Mapping[str, tuple[tuple[int, ...], tuple[tuple[int, int], ...]]] = {
    "weld": ((0, 1, 2), ((0, 1), (1, 2), (2, 0))),
    "revolute": ((0, 1, 2), ((0, 2), (1, 2))),
    "prismatic": ((0, 1), ((0, 1), (1, 2), (2, 0))),
    "cylindrical": ((0, 1), ((0, 2), (1, 2))),
    "universal": ((0, 1, 2), ((2, 0),)),
    "spherical": ((0, 1, 2), ()),
    "planar": ((0, 1), ()),
    "distance": ((), ()),
    "slider": ((), ()),
}
_AXES = "xyz"


@dataclass(frozen=True)
class Closures:
    """The loop closures of one (rigid or expanded) model.

    Attributes:
        names, kinds: One per loop.
        labels: One per row, "loop: what is held".
        loop_of: Loop of each row.
        bodies: Joints of A then B, shape (2 loops,).
        local: Frames a then b in their joints, [R | p], shape (2 loops, 3, 4).
        point_rows, point_axes: Rows of point type and the axis of a they use.
        dot_rows, dot_a, dot_b: Rows of direction type and the axes they use.
        distance_rows, lengths: Rows of distance type and their lengths in m.
        contacts: Rows of sleeves on flexible beams.
        support_a, support_b: 1 where a velocity row moves the body, shape (loops, nV).
        row_mask: support_b - support_a of each row's loop, shape (rows, nV).
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    labels: tuple[str, ...]
    loop_of: IntArray
    bodies: IntArray
    local: Array
    point_rows: IntArray
    point_axes: IntArray
    dot_rows: IntArray
    dot_a: IntArray
    dot_b: IntArray
    distance_rows: IntArray
    lengths: Array
    support_a: Array
    support_b: Array
    row_mask: Array
    contacts: tuple[Contact, ...] = ()

    @property
    def n(self) -> int:
        """Number of rows."""
        return len(self.labels)

    def select(self, rows: Sequence[int] | IntArray) -> Closures:
        """The same loops with some rows only (the independent ones)."""
        rows = np.asarray(rows, dtype=np.intp)
        renumber = np.full(self.n, -1, dtype=np.intp)
        renumber[rows] = np.arange(len(rows))

        def kept(sort: IntArray) -> npt.NDArray[np.bool_]:
            return renumber[sort] >= 0

        p, d, s = kept(self.point_rows), kept(self.dot_rows), kept(self.distance_rows)
        return replace(
            self,
            labels=tuple(self.labels[r] for r in rows),
            loop_of=self.loop_of[rows],
            point_rows=renumber[self.point_rows[p]],
            point_axes=self.point_axes[p],
            dot_rows=renumber[self.dot_rows[d]],
            dot_a=self.dot_a[d],
            dot_b=self.dot_b[d],
            distance_rows=renumber[self.distance_rows[s]],
            lengths=self.lengths[s],
            row_mask=self.row_mask[rows],
            contacts=tuple(contact.select(renumber) for contact in self.contacts),
        )


def closures(
    loops: Sequence[Loop],
    frames: Mapping[str, Attachment],
    model: pin.Model,
    sleeves: Mapping[str, Sleeve] | None = None,
) -> Closures:
    """Gather the loops of a description on a model.

    Args:
        loops: Described loops; a distance without a length gets NaN, to be set at assembly.
        frames: Where each frame sits in the model.
        model: Rigid or expanded model.
        sleeves: What the loops of kind slider hold, by name.
    Returns:
        All rows, redundant ones included.
    """
    ends = [(frames[loop.frame_a], frames[loop.frame_b]) for loop in loops]
    sleeves = sleeves or {}
    for k, loop in enumerate(loops):
        if loop.name in sleeves:  # frame a of a slider is the frame of the beam
            here, b = ends[k]
            beam = Attachment(here.joint, here.placement * sleeves[loop.name].placement)
            ends[k] = (beam, b)
    turn_a = [_axes(loop.axis, None) for loop in loops]
    # A universal joint holds the axis of a (z) perpendicular to the axis of b (x here).
    turn_b = [
        _axes(None, loop.axis_b) if loop.kind == "universal" else _axes(loop.axis, None)
        for loop in loops
    ]
    labels: list[str] = []
    owner: list[int] = []
    points: list[tuple[int, int]] = []
    dots: list[tuple[int, int, int]] = []
    distances: list[tuple[int, float]] = []
    contacts: list[Contact] = []
    for number, loop in enumerate(loops):
        held, square = _ROWS[loop.kind]
        for axis in held:
            points.append((len(labels), axis))
            labels.append(f"{loop.name}: position along {_AXES[axis]}")
        for a, b in square:
            dots.append((len(labels), a, b))
            about = _AXES[3 - a - b] if a != b else _AXES[a]
            labels.append(f"{loop.name}: rotation about {about}")
        if loop.kind == "distance":
            distances.append((len(labels), np.nan if loop.length is None else loop.length))
            labels.append(f"{loop.name}: distance")
        if loop.kind == "slider":
            held_rows = sleeves[loop.name].labels(loop.name)
            at = np.arange(len(labels), len(labels) + len(held_rows))
            contacts.append(Contact(sleeves[loop.name], number, at))
            labels.extend(held_rows)
        owner.extend([number] * (len(labels) - len(owner)))
    sides = [e[0] for e in ends] + [e[1] for e in ends]
    local = np.zeros((len(sides), 3, 4))
    for k, (end, turn) in enumerate(zip(sides, turn_a + turn_b, strict=True)):
        local[k, :, :3] = end.placement.rotation @ turn
        local[k, :, 3] = end.placement.translation
    support_a = _supports(model, [e[0].joint for e in ends])
    support_b = _supports(model, [e[1].joint for e in ends])
    loop_of = np.array(owner, dtype=np.intp)
    return Closures(
        names=tuple(loop.name for loop in loops),
        kinds=tuple(loop.kind for loop in loops),
        labels=tuple(labels),
        loop_of=loop_of,
        bodies=np.array([s.joint for s in sides], dtype=np.intp),
        local=local,
        point_rows=np.array([p[0] for p in points], dtype=np.intp),
        point_axes=np.array([p[1] for p in points], dtype=np.intp),
        dot_rows=np.array([d[0] for d in dots], dtype=np.intp),
        dot_a=np.array([d[1] for d in dots], dtype=np.intp),
        dot_b=np.array([d[2] for d in dots], dtype=np.intp),
        distance_rows=np.array([d[0] for d in distances], dtype=np.intp),
        lengths=np.array([d[1] for d in distances], dtype=float),
        support_a=support_a,
        support_b=support_b,
        row_mask=(support_b - support_a)[loop_of],
        contacts=tuple(contacts),
    )


def _axes(z: Sequence[float] | None, x: Sequence[float] | None) -> Array:
    """A rotation whose z (or x) axis is the given one, the identity where it can be."""
    if z is None and x is None:
        return np.eye(3)
    k, wish = (2, z) if z is not None else (0, x)
    axis = np.array(wish, float) / np.linalg.norm(np.array(wish, float))
    helper = np.eye(3)[(k + 1) % 3]
    if abs(axis @ helper) > 0.9:
        helper = np.eye(3)[(k + 2) % 3]
    second = helper - axis * (axis @ helper)
    second /= np.linalg.norm(second)
    columns = [np.zeros(3)] * 3
    columns[k] = axis
    if abs(helper[(k + 1) % 3]) > 0.5:
        columns[(k + 1) % 3] = second
        columns[(k + 2) % 3] = np.cross(axis, second)
    else:
        columns[(k + 2) % 3] = second
        columns[(k + 1) % 3] = np.cross(second, axis)
    return np.column_stack(columns)


def _supports(model: pin.Model, joints: Sequence[int]) -> Array:
    support = np.zeros((len(joints), model.nv))
    for k, joint in enumerate(joints):
        for above in model.supports[joint]:
            if above:
                step = model.joints[above]
                support[k, step.idx_v : step.idx_v + step.nv] = 1.0
    return support


class ClosureState:
    """Closures evaluated at one configuration: c, W and what their derivatives need."""

    def __init__(self, closed: Closures, model: pin.Model, data: pin.Data) -> None:
        self.closed = closed
        self.poses = JointPoses(model, data)
        self._model, self._data = model, data
        loops = len(closed.names)
        self._loops = loops
        self.c = np.zeros(closed.n)
        self.W = np.zeros((closed.n, 6))
        self.J = np.zeros((closed.n, model.nv))
        self._point_loop = closed.loop_of[closed.point_rows]
        self._dot_loop = closed.loop_of[closed.dot_rows]
        self._distance_loop = closed.loop_of[closed.distance_rows]
        self._frames = np.zeros((2 * loops, 3, 4))
        self.frames_a, self.frames_b = self._frames[:loops], self._frames[loops:]
        self.gap = np.zeros((loops, 3))
        self._arm = np.zeros((loops, 3, 3))
        # Flat positions of u = a[loop, :, axis] among the frames: one `take` instead of indexing.
        self._u_at = self._point_loop[:, None] * 12 + 4 * np.arange(3) + closed.point_axes[:, None]
        self._plain = closed.n == len(closed.point_rows)
        self.contacts = [ContactState(contact) for contact in closed.contacts]
        # Elastic coordinates and their rates, and dc/deta, for the rows of sleeves only.
        self.eta = self.eta_rate = np.zeros(0)
        self.J_eta = np.zeros((closed.n, 0))

    def evaluate(self) -> None:
        """c, W and J from the joint poses and Jacobians in the data (both must be current)."""
        cl, loops = self.closed, self._loops
        self.poses.refresh()
        np.matmul(self.poses.rotation.take(cl.bodies, axis=0), cl.local, out=self._frames)
        self._frames[:, :, 3] += self.poses.translation.take(cl.bodies, axis=0)
        origin = self._frames[:, :, 3]
        np.subtract(origin[loops:], origin[:loops], out=self.gap)
        np.matmul(origin[loops:], SKEW, out=self._arm.reshape(loops, 9))
        if len(cl.point_rows):
            u, loop = self._frames.take(self._u_at), self._point_loop
            c = np.einsum("ij,ij->i", u, self.gap.take(loop, axis=0))
            turned = np.matmul(self._arm.take(loop, axis=0), u[:, :, None])[:, :, 0]
            if self._plain:
                self.c, self.W[:, :3], self.W[:, 3:] = c, u, turned
            else:
                rows = cl.point_rows
                self.c[rows], self.W[rows, :3], self.W[rows, 3:] = c, u, turned
        if len(cl.dot_rows):
            loop = self._dot_loop
            e_a = self.frames_a[loop, :, cl.dot_a]
            e_b = self.frames_b[loop, :, cl.dot_b]
            self.c[cl.dot_rows] = (e_a * e_b).sum(1)
            self.W[cl.dot_rows, 3:] = (skew(e_b) @ e_a[:, :, None])[:, :, 0]
        if len(cl.distance_rows):
            loop = self._distance_loop
            d = self.gap[loop]
            self.c[cl.distance_rows] = ((d * d).sum(1) - cl.lengths**2) / (2 * cl.lengths)
            u = d / cl.lengths[:, None]
            self.W[cl.distance_rows, :3] = u
            self.W[cl.distance_rows, 3:] = (self._arm[loop] @ u[:, :, None])[:, :, 0]
        if self.contacts:
            self._evaluate_contacts()
        np.matmul(self.W, columns(self._data.J), out=self.J)
        self.J *= cl.row_mask

    def _evaluate_contacts(self) -> None:
        if self.J_eta.shape[1] != len(self.eta):
            self.J_eta = np.zeros((self.closed.n, len(self.eta)))
        for one in self.contacts:
            axes, gap = self.frames_a[one.loop, :, :2], self.gap[one.loop]
            one.update(float(gap @ axes[:, 0]), float(gap @ axes[:, 1]), self.eta)
            u = np.outer(one.by_X, axes[:, 0]) + np.outer(one.by_Y, axes[:, 1])
            self.c[one.rows], self.W[one.rows, :3] = one.value, u
            self.W[one.rows, 3:] = u @ self._arm[one.loop].T
            if self.J_eta.shape[1]:
                self.J_eta[one.rows, one.eta] = one.by_eta

    def require_on_beams(self, where: str, t: float | None = None) -> None:
        """Raise a MotionError where a sleeve has left its beam, at a time t (s)."""
        for one in self.contacts:
            one.require_on_beam(self.closed.names[one.loop], where, t)

    def wrenches(self, lam: Array) -> Array:
        """World wrench [force; moment about the origin] on each B, shape (loops, 6)."""
        F = np.zeros((self._loops, 6))
        np.add.at(F, self.closed.loop_of, self.W * lam[:, None])
        return F

    def body_wrenches(self, lam: Array) -> dict[int, Array]:
        """World wrenches of the closures by joint: +W on B, -W on A."""
        total = {int(body): np.zeros(6) for body in self.closed.bodies}
        for k, wrench in enumerate(self.wrenches(lam)):
            total[int(self.closed.bodies[self._loops + k])] += wrench
            total[int(self.closed.bodies[k])] -= wrench
        return total

    def bias(self, V: Array) -> Array:
        """Jdot V, shape (rows,): needs J and dJ (time variation) current in the data.

        Rows of sleeves add what follows from `eta_rate`, so that cdd = J A + J_eta eta_a + bias.
        """
        cl, data = self.closed, self._data
        twist_a = (cl.support_a * V) @ columns(data.J).T
        twist_b = (cl.support_b * V) @ columns(data.J).T
        relative = twist_b - twist_a
        turned = (cl.support_b - cl.support_a) * V @ columns(data.dJ).T
        rate = np.zeros_like(self.W)
        spin_a, spin_b = skew(twist_a[:, 3:]), skew(twist_b[:, 3:])
        p_b = self.frames_b[:, :, 3]
        v_b = twist_b[:, :3] + (spin_b @ p_b[:, :, None])[:, :, 0]
        v_a = twist_a[:, :3] + (spin_a @ self.frames_a[:, :, 3:])[:, :, 0]
        swept = skew(v_b)

        def point(rows: IntArray, loop: IntArray, u: Array, du: Array) -> None:
            rate[rows, :3] = du
            turn = swept[loop] @ u[:, :, None] + self._arm[loop] @ du[:, :, None]
            rate[rows, 3:] = turn[:, :, 0]

        if len(cl.point_rows):
            loop = self._point_loop
            u = self.frames_a[loop, :, cl.point_axes]
            point(cl.point_rows, loop, u, (spin_a[loop] @ u[:, :, None])[:, :, 0])
        if len(cl.dot_rows):
            loop = self._dot_loop
            e_a = self.frames_a[loop, :, cl.dot_a]
            e_b = self.frames_b[loop, :, cl.dot_b]
            de_a = (spin_a[loop] @ e_a[:, :, None])[:, :, 0]
            de_b = (spin_b[loop] @ e_b[:, :, None])[:, :, 0]
            rate[cl.dot_rows, 3:] = np.cross(de_b, e_a) + np.cross(e_b, de_a)
        if len(cl.distance_rows):
            loop = self._distance_loop
            u = self.gap[loop] / cl.lengths[:, None]
            du = (v_b - v_a)[loop] / cl.lengths[:, None]
            point(cl.distance_rows, loop, u, du)
        drift = np.zeros(cl.n)
        for one in self.contacts:
            k, axes = one.loop, self.frames_a[one.loop, :, :2]
            turn = spin_a[k] @ axes
            slip = float(axes[:, 0] @ (v_b - v_a)[k] + turn[:, 0] @ self.gap[k])
            swing = one.by_X_eta @ self.eta_rate[one.eta]
            du = np.outer(one.by_XX(self.eta) * slip + swing, axes[:, 0])
            du += np.outer(one.by_X, turn[:, 0]) + np.outer(one.by_Y, turn[:, 1])
            rate[one.rows, :3] = du
            rate[one.rows, 3:] = self.W[one.rows, :3] @ swept[k].T + du @ self._arm[k].T
            drift[one.rows] = swing * slip
        loop = cl.loop_of
        total: Array = (rate * relative[loop]).sum(1) + (self.W * turned[loop]).sum(1)
        return total + drift

    def force_tangent(self, lam: Array, times_map: Callable[[Array], Array]) -> Array:
        """Part of d(J' lam)/dy that Pinocchio's derivatives with fixed local forces miss.

        The closure force follows frame a in direction and frame b in its point of attack, so in
        the bodies' own frames it changes with the relative motion of the two.

        Args:
            lam: Multipliers, shape (rows,).
            times_map: D (k, nV) to D X (k, nv).
        Returns:
            Shape (nv, nv).
        """
        cl, J = self.closed, columns(self._data.J)
        on_a, on_b = np.zeros((self._loops, 6, 6)), np.zeros((self._loops, 6, 6))
        force = np.zeros((self._loops, 3))
        np.add.at(force, self._point_loop, self.W[cl.point_rows, :3] * lam[cl.point_rows, None])
        pull = self.W[cl.distance_rows, :3] * lam[cl.distance_rows, None]
        np.add.at(force, self._distance_loop, pull)
        for one in self.contacts:
            force[one.loop] += lam[one.rows] @ self.W[one.rows, :3]
        f, arm = skew(force), self._arm
        on_b[:, :3, 3:] += f
        on_b[:, 3:, 3:] += arm @ f
        on_a[:, 3:, :3] -= f
        on_a[:, 3:, 3:] += f @ arm
        for row, loop in zip(cl.distance_rows, self._distance_loop, strict=True):
            k = lam[row] / cl.lengths[list(cl.distance_rows).index(row)]
            move = np.hstack([np.eye(3), -arm[loop]]) * k
            for side in (on_a, on_b):
                side[loop, :3] += move
                side[loop, 3:] += arm[loop] @ move
        if len(cl.dot_rows):
            loop = self._dot_loop
            mu = lam[cl.dot_rows, None, None]
            e_a = skew(self.frames_a[loop, :, cl.dot_a])
            e_b = skew(self.frames_b[loop, :, cl.dot_b])
            np.add.at(on_b[:, 3:, 3:], loop, mu * (e_b @ e_a))
            np.add.at(on_a[:, 3:, 3:], loop, mu * (e_a @ e_b))
        n = J.shape[1]
        J_a = times_map((J * cl.support_a[:, None]).reshape(-1, n)).reshape(self._loops, 6, -1)
        J_b = times_map((J * cl.support_b[:, None]).reshape(-1, n)).reshape(self._loops, 6, -1)
        pushed = on_b @ (J_b - J_a), on_a @ (J_b - J_a)
        width = J_a.shape[2]
        total: Array = J_b.reshape(-1, width).T @ pushed[0].reshape(-1, width)
        total -= J_a.reshape(-1, width).T @ pushed[1].reshape(-1, width)
        for one in self.contacts:
            x = self.frames_a[one.loop, :, 0]
            slip = np.concatenate([x, self._arm[one.loop] @ x]) @ (J_b - J_a)[one.loop]
            total += float(lam[one.rows] @ one.by_XX(self.eta)) * np.outer(slip, slip)
            if one.by_X_eta.shape[1]:
                start = width - len(self.eta)
                at = slice(start + one.eta.start, start + one.eta.stop)
                cross = np.outer(slip, lam[one.rows] @ one.by_X_eta)
                total[:, at] += cross
                total[at] += cross.T
        return total
