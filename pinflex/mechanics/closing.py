"""From a guess to a closed pose: Newton, then least squares inside the limits, then restarts.

Newton from the guess closes what is nearly closed, but for a gap that no joint moves, which is
built in (`pinflex.mechanics.closing`). Else the closure with angles instead of sines
(`pinflex.mechanics.closure`) is minimised from the guess and from random poses inside the joint
limits, always the same ones; of the poses found that nearest to the guess is taken, drawn towards
the guess along the closures and closed by Newton to round-off.

Source of the least squares: Branch, Coleman, Li (1999), as `scipy.optimize.least_squares`, trf.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from itertools import count

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray, others
from pinflex.description.loops import ALONG, Loop, loop_kind
from pinflex.errors import AssemblyError
from pinflex.linalg import independent_rows
from pinflex.mechanics import assembly
from pinflex.mechanics.assembly import CLOSED, RANK, close_loops
from pinflex.mechanics.closure import Closures, LogClosure, size_of
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.manifold import translations
from pinflex.mechanics.model.loads import COUPLING, DIRECTION, DISTANCE, POINT, SLEEVE
from pinflex.rotations import axis_frame
from pinflex.text import frozen

# Loops that close but for the last digits of a drawing: the gap that is built in.
#
# A plane four-bar closed by a spatial hinge holds three rows that no joint of it moves: a pin 1e-6
# m beside its hole stays beside it, whatever the pose. Where the rows that joints do move close,
# and the others are open by no more than a drawing's accuracy, the hinge is made to fit there:
# frame b is moved on its link until the loop closes at home. What is built in so bears no force of
# its own.

# Gap over the size of the mechanism, and angle [rad], up to which loops are made to fit. A place
# may be off by the width of a line in a drawing. An angle also moves rows that nothing else moves,
# by as much as itself, and has to stay below any ratio at which a mechanism can be used: six digits
# of `rpy`, and 1.5708 for a right angle, both ways.
GAP, ANGLE = 1e-3, 1e-5
# Ratio below which rows count as dependent that `ANGLE` makes independent (see `assembly.RANK`).
MISFIT_RANK = 3 * ANGLE
_TURNS = 4  # Newton's steps that turn frame b; an angle of 1e-5 takes two


@frozen
class Misfit:
    """What makes loops fit that are open at home.

    Attributes:
        gaps: How far each loop is open, m and rad.
        shifts: Moves of frame b in its own axes, by loop.
        lengths: Distances as they are at home, by loop.
    """

    gaps: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    shifts: Mapping[str, pin.SE3] = field(default_factory=dict)
    lengths: Mapping[str, float] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.gaps)

    @property
    def rank(self) -> float:
        """Ratio of singular values below which rows count as dependent."""
        return MISFIT_RANK if self else assembly.RANK

    def built_in(self, closed: Closures) -> Closures:
        """Closures with frames b, and distances, that fit."""
        if not self:
            return closed
        local, lengths = closed.local.copy(), closed.lengths.copy()
        for name, shift in self.shifts.items():
            b = local[len(closed.names) + closed.names.index(name)]
            b[:, 3] += b[:, :3] @ shift.translation
            b[:, :3] = b[:, :3] @ shift.rotation
        for name, length in self.lengths.items():
            lengths[closed.of(DISTANCE, closed.names.index(name))] = length
        return replace(closed, local=local, lengths=lengths)


def nearly_closed(dynamics: Equations, guess: Array, moving: IntArray) -> Array | None:
    """A pose at which the rows close that joints move, the others to the drawing's accuracy.

    None where more stays open, or where rows are dependent in this pose only.
    """
    closed, size = dynamics.system.closed, _size(dynamics, guess)
    kept, _ = assembly.independent_rows(dynamics.close(guess).J, closed.labels, MISFIT_RANK)
    firm = Equations(replace(dynamics.system, closed=closed.select(kept)))
    pose, left = assembly.close_loops(firm, guess, moving) if len(kept) else (guess, 0.0)
    if left > 10 * assembly.CLOSED or not _fits(dynamics, pose, size):
        return None
    if assembly.rank_beside(firm, dynamics, pose, MISFIT_RANK) > len(kept):
        return None
    return pose


def _size(dynamics: Equations, pose: Array) -> float:
    """Size of the mechanism [m]; without a joint, from the base to the furthest loop."""
    closed = dynamics.system.closed
    if dynamics.n_rigid or not closed.names:
        return size_of(dynamics, pose)
    origins = closed.frames(dynamics.joint_poses(pose))[0, len(closed.names) :, :, 3]
    return float(np.max(np.linalg.norm(origins, axis=1)))


def _fits(dynamics: Equations, pose: Array, size: float) -> bool:
    """Whether all that stays open is a frame or a distance that can be made to fit."""
    closed, c = dynamics.system.closed, np.abs(dynamics.close(pose).c)
    limit = np.where(closed.sorts == DIRECTION, ANGLE, GAP * size)
    rigid = np.isin(closed.sorts, (COUPLING, SLEEVE))
    return bool(np.all(c <= np.where(rigid, 10 * assembly.CLOSED, limit)))


def misfit(dynamics: Equations, pose: Array) -> Misfit:
    """What makes the loops fit at a pose; empty where they are closed."""
    closed = dynamics.system.closed
    frames_a, frames_b = np.split(closed.frames(dynamics.joint_poses(pose))[0], 2)
    c, _ = dynamics.close(pose)
    apart, turned = LogClosure(dynamics, 1.0).gaps(c)
    gaps: dict[str, tuple[float, float]] = {}
    shifts: dict[str, pin.SE3] = {}
    lengths: dict[str, float] = {}
    for k, name in enumerate(closed.names):
        gap = float(apart[k]), float(turned[k])
        if max(gap) < assembly.CLOSED:
            continue
        gaps[name] = gap
        if closed.kinds[k] == "distance":
            lengths[name] = float(np.linalg.norm(frames_b[k, :, 3] - frames_a[k, :, 3]))
            continue
        a, b = frames_a[k], frames_b[k]
        u = a[:, closed.a[closed.of(POINT, k)]]
        move = -u @ (u.T @ (b[:, 3] - a[:, 3]))
        dots = closed.of(DIRECTION, k)
        turn = _turn(a[:, :3], b[:, :3], closed.a[dots], closed.b[dots])
        shifts[name] = pin.SE3(b[:, :3].T @ turn @ b[:, :3], b[:, :3].T @ move)
    return Misfit(gaps, shifts, lengths)


def _turn(a: Array, b: Array, of_a: IntArray, of_b: IntArray) -> Array:
    """The least turn of axes b (3, 3), in the world, that makes e_a . e_b = 0 for some pairs."""
    turn = np.eye(3)
    for _ in range(_TURNS):
        e_a, e_b = a[:, of_a].T, (turn @ b)[:, of_b].T
        c = np.sum(e_a * e_b, axis=1)
        w = np.linalg.lstsq(np.cross(e_b, e_a), -c, rcond=None)[0]
        turn = pin.exp3(w) @ turn
    return turn


# A loop whose axis does not fit the joints around it: a wrong `axis` in a flat mechanism.

_PARALLEL = 1e-6  # sine of the angle of two axes below which they are parallel
_TURNED = 1e-2  # sine of the angle from which a loop's axis is another one
_SHOWN = 4  # joints listed before "..."


def axis_hint(dynamics: Equations, loops: Sequence[Loop], pose: Array) -> str:
    """A sentence for each hinge of a loop that blocks its neighbours: they need one direction."""
    at, system = dynamics.kinematics(pose), dynamics.system
    closed, model = system.closed, system.rigid
    placed, turning = closed.frames(at.poses)[0, :, :, :3], at.J[0, 3:]
    hinged = {
        joint.idx_v: name
        for joint, name in zip(model.joints[1:], model.names[1:], strict=True)
        if joint.nv == 1 and np.linalg.norm(turning[:, joint.idx_v]) > 0.5
    }
    found = []
    for loop in loops:
        k = closed.names.index(loop.name)
        if loop_kind(loop.kind).directions != ALONG:
            continue
        moves = (closed.support_b[k] != closed.support_a[k]).nonzero()[0]
        beside = [int(v) for v in moves if int(v) in hinged]
        turned = [v for v in moves if np.linalg.norm(turning[:, v]) > 0.5]
        if len(beside) < 2 or len(turned) > len(beside):  # a ball or a universal joint turns too
            continue
        frames = placed[k], placed[len(closed.names) + k]
        names = [hinged[v] for v in beside]
        found.append(_hint(loop, frames, turning[:, beside], names))
    return "".join(found)


def _hint(loop: Loop, frames: tuple[Array, Array], axes: Array, names: Sequence[str]) -> str:
    """The sentence for one loop, "" where its axis fits."""
    normal = axes[:, 0]
    bent = max(float(np.linalg.norm(np.cross(normal, beside))) for beside in axes.T)
    shown = f"{', '.join(names[:_SHOWN])}{', ...' if len(names) > _SHOWN else ''}"
    if ANGLE < bent < _TURNED:
        return (
            f' The joints around loop "{loop.name}" ({shown}) are up to {bent:.2g} rad off '
            "parallel, so that hinges block each other. Write more digits in the URDF (1.5707963 "
            "for a right angle), or kind: planar, which holds no tilt."
        )
    axis = min((frame[:, 2] for frame in frames), key=lambda z: abs(float(normal @ z)))
    if bent > _PARALLEL or np.linalg.norm(np.cross(normal, axis)) < _TURNED:
        return ""
    angle = np.degrees(np.arccos(min(1.0, abs(float(normal @ axis)))))
    turn = axis_frame(loop.axis, None)
    own = [turn @ frame.T @ normal for frame in frames]
    advice = "Turn one of the frames in the URDF"
    if np.linalg.norm(np.cross(own[0], own[1])) < _PARALLEL:
        advice = f"Write loops.{loop.name}.axis: {_written(own[0])}"
    return (
        f' The axis of loop "{loop.name}" is {angle:.3g} deg off the axes of its neighbours '
        f"({shown}), which are all parallel. {advice}."
    )


def _written(axis: Array) -> str:
    """An axis as the YAML takes it; its sense does not matter."""
    largest = int(np.argmax(np.abs(axis)))
    if abs(axis[largest]) > 1 - _PARALLEL:
        return "xyz"[largest]
    return "[" + ", ".join(f"{x:.4g}" for x in axis) + "]"


_STARTS = 48  # poses to start from at most
_HELD_STARTS = 12  # of these with the motors where they are, before they may move
_MORE = 3  # further starts after the first closed pose, for one nearer to the guess
_NEAR = 1.0  # way from the guess at which no other pose is looked for: a motor by 6 degrees
_EVALUATIONS = 80  # of one least squares; from a good start 10 are enough
_NEARLY = 1e-3  # residual over the size of the mechanism from which Newton is let go
_TOUCH = 1e-9  # [rad | m] by which a pose on a limit may be beyond it
_MOTORS = 10.0  # weight of the motors' way from the guess beside that of passive joints
_PULL = 1e-3  # weight of the way to the guess against the closure: moves the pose along it


@frozen
class Limits:
    """Bounds of the rigid coordinates q: -inf, inf where there is none, shape (nq,) each."""

    lower: Array
    upper: Array


@frozen
class Closed:
    """A closed pose q.

    Attributes:
        pose: Shape (nq,).
        starts: Poses that were tried for it: 0 where Newton found it at once.
        misfit: What stays open there and is built in.
    """

    pose: Array
    starts: int
    misfit: Misfit = field(default_factory=Misfit)


def limits_of(written: pin.Model, model: pin.Model) -> Limits:
    """Limits of a URDF for a model with the same joints (one in which the beams are none).

    Only joints of one coordinate have them; lower >= upper means that nobody wrote any.
    """
    lower, upper = np.full(int(model.nq), -np.inf), np.full(int(model.nq), np.inf)
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        if joint.nq != 1 or not written.existJointName(name):
            continue
        source = written.joints[written.getJointId(name)]
        low, high = (float(x[source.idx_q]) for x in
                     (written.lowerPositionLimit, written.upperPositionLimit))  # fmt: skip
        if source.nq == 1 and low < high:
            lower[joint.idx_q], upper[joint.idx_q] = low, high
    return Limits(lower, upper)


def assemble(
    dynamics: Equations,
    guess: Array,
    held: IntArray,
    where: str,
    limits: Limits,
    given: IntArray,
    loops: Sequence[Loop],
) -> Closed:
    """A closed pose near the guess: with the motors held if that can be, else with all free.

    Raises:
        AssemblyError: No closed pose was found, with the loop, how far it stays open in m (`gap`)
            and rad (`turn`), and the best pose.
    """
    if not np.all(np.isfinite(dynamics.close(guess).c)):
        raise AssemblyError(
            f"{where}: the places of the loops' frames are not finite numbers. Check the origins "
            "in the URDF for numbers that are far too large."
        )
    search = _Search(dynamics, guess, held, limits, given)
    spare: Array | None = None
    for motors_held, moving in ((True, search.passive), (False, search.every)):
        if not motors_held and search.passive_may_close():
            found = search.run(True)
            if found is not None:
                return found
        pose, size = close_loops(dynamics, guess, moving)
        if size < CLOSED * 10:
            fits = not search.closure.flipped(pose)
            if fits and search.inside(pose, free=True):
                if motors_held or search.way(pose) < _NEAR:
                    return Closed(pose, 0)
                return search.run(False, pose) or Closed(pose, 0)
            if fits or not search.closure.twisted(pose):  # no more than the side of an axis
                spare = pose if spare is None else spare
        elif (near := search.nearly(guess, moving)) is not None:
            return near
    found = search.run(False)
    if found is not None:
        return found
    if spare is not None:  # outside the limits, or axes against each other, but closed
        return Closed(spare, 0)
    if search.best is not None and (near := search.nearly(search.best[1], search.every)):
        return near
    raise search.failure(where, loops)


class _Search:
    """Least squares from one pose after the other, on the joints that take part in loops."""

    def __init__(
        self, dynamics: Equations, guess: Array, held: IntArray, limits: Limits, given: IntArray
    ) -> None:
        self.dynamics, self.guess = dynamics, guess
        self.length = size_of(dynamics, guess)
        self.closure = LogClosure(dynamics, self.length)
        cosines = self.closure.axes(guess)
        rows, model = dynamics.n_rigid, dynamics.system.rigid
        self.every = np.arange(rows, dtype=np.intp)
        self.passive = others(rows, held)
        # A Newton step keeps the side from which axes meet; a search wants them to point alike.
        self.closure.signs = np.where(cosines < 0, -1.0, 1.0)
        self.wanted = np.where(cosines < -1 + 1e-6, -1.0, 1.0)
        self.unit = np.where(translations(model) > 0, self.length, 1.0)
        self.weight = np.ones(rows)
        self.weight[held] = _MOTORS
        self.weight /= self.unit
        self._bound(model, limits, given)
        self.tried = 0
        self.best: tuple[float, Array] | None = None

    @cached_property
    def moving(self) -> dict[bool, IntArray]:
        """Rows of joints that take part in loops: with the motors held, and all."""
        closed = self.dynamics.system.closed
        looped = np.any(closed.row_mask != 0, axis=0)
        if len(closed.coupled.rows):
            looped |= np.any(closed.coupled.J != 0, axis=0)
        return {True: self.passive[looped[self.passive]], False: self.every[looped]}

    def _bound(self, model: pin.Model, limits: Limits, given: IntArray) -> None:
        """Bounds of the way from the guess, shape (nv,), and joints that have limits."""
        rows = self.dynamics.n_rigid
        self.low, self.high = np.full(rows, -np.inf), np.full(rows, np.inf)
        self.limited: list[tuple[int, float, float, bool]] = []
        for joint in model.joints[1:]:
            if joint.nq != 1:
                continue
            q, low, high = joint.idx_q, limits.lower[joint.idx_q], limits.upper[joint.idx_q]
            at = self.guess[q]
            if q in given:  # a value that was given is a better witness than a limit
                low, high = low if low <= at else -np.inf, high if high >= at else np.inf
            self.low[joint.idx_v], self.high[joint.idx_v] = low - at, high - at
            if np.isfinite(low) or np.isfinite(high):
                self.limited.append((q, low - _TOUCH, high + _TOUCH, q in given))

    def inside(self, pose: Array, free: bool = False) -> bool:
        """Whether a pose keeps the limits; `free`: of the joints that were not given."""
        return all(
            low <= pose[q] <= high for q, low, high, given in self.limited if not (free and given)
        )

    def passive_may_close(self) -> bool:
        """Whether passive joints alone move the closures as far as all joints together do."""
        passive, every = self.moving[True], self.moving[False]
        if not len(passive) or len(passive) == len(every):
            return False
        beside = np.random.default_rng(0).uniform(-0.1, 0.1, len(self.unit)) * self.unit
        _, J = self.closure.at(self.dynamics.integrate(self.guess, beside))
        ranks = [len(independent_rows(J[:, rows], RANK)) for rows in (passive, every)]
        return ranks[0] == ranks[1]

    def run(self, motors_held: bool, known: Array | None = None) -> Closed | None:
        """The nearest of the closed poses found: with the motors where they are, or all free."""
        self.closure.signs = self.wanted
        rows = self.moving[motors_held]
        found: list[tuple[float, Array]] = []
        left = _HELD_STARTS if motors_held else _STARTS
        if known is not None:
            drawn = self._drawn(known, rows)
            found, left = [(self.way(drawn), drawn)], _MORE
        for start in self._starts(rows):
            if not left:
                break
            left -= 1
            self.tried += 1
            pose = self._close(start, rows)
            if pose is None:
                continue
            if not found:
                left = min(left, _MORE)
            pose = self._drawn(pose, rows)
            found.append((self.way(pose), pose))
        if not found:
            return None
        return Closed(min(found, key=lambda x: x[0])[1], self.tried)

    def _starts(self, rows: IntArray) -> Iterator[Array]:
        """Ways of some rows from the guess: none, then further and further."""
        yield np.zeros(self.dynamics.n_rigid)
        reach = np.pi * self.unit
        reach[self.unit != 1.0] = self.length
        least, most = np.maximum(self.low, -reach), np.minimum(self.high, reach)
        narrow = least >= most  # the guess is far outside the limits
        least[narrow], most[narrow] = self.low[narrow], self.high[narrow]
        random = np.random.default_rng(0)  # a fixed seed: the same pose on every run
        for k in count():
            draw = min(1.0, 0.25 * (1 + k // 4)) * random.uniform(least, most)
            start = np.zeros(self.dynamics.n_rigid)
            start[rows] = draw[rows]
            yield start

    def _close(self, start: Array, rows: IntArray) -> Array | None:
        """A closed pose inside the limits by least squares from a start."""
        if not len(rows):
            return None
        way = self._least_squares(start, rows, 0.0)
        pose = self.dynamics.integrate(self.guess, way)
        c, _ = self.closure.at(pose)
        size = float(np.linalg.norm(c))
        if self.best is None or size < self.best[0]:
            self.best = (size, pose)
        if size > _NEARLY * self.length:
            return None
        return self._polished(pose, rows)

    def nearly(self, start: Array, rows: IntArray) -> Closed | None:
        """What is closed near a pose but for a gap that is built in."""
        pose = nearly_closed(self.dynamics, start, rows)
        if pose is None or self.closure.flipped(pose) or not self.inside(pose, free=True):
            return None
        return Closed(pose, self.tried, misfit(self.dynamics, pose))

    def _polished(self, pose: Array, rows: IntArray) -> Array | None:
        pose, size = close_loops(self.dynamics, pose, rows)
        good = size < CLOSED * 10 and not self.closure.flipped(pose) and self.inside(pose)
        return pose if good else None

    def _drawn(self, pose: Array, rows: IntArray) -> Array:
        """The pose moved along the closures towards the guess."""
        way = self.dynamics.difference(self.guess, pose)
        back = self._least_squares(way, rows, _PULL)
        nearer = self._polished(self.dynamics.integrate(self.guess, back), rows)
        return pose if nearer is None or self.way(nearer) > self.way(pose) else nearer

    def way(self, pose: Array) -> float:
        """How far a pose is from the guess: rad, m over the size, of motors ten times as much."""
        return float(np.linalg.norm(self.weight * self.dynamics.difference(self.guess, pose)))

    def _least_squares(self, start: Array, rows: IntArray, pull: float) -> Array:
        """The way from the guess that minimises the closure, and `pull` times itself."""
        from scipy.optimize import least_squares

        d, way = self.dynamics, start.copy()
        pulled = pull * np.diag(self.weight * self.length)[rows][:, rows]
        last: list[Array] = []

        def evaluate(x: Array) -> tuple[Array, Array]:
            if not last or not np.array_equal(last[0], x):
                way[rows] = x
                c, J = self.closure.at(d.integrate(self.guess, way))
                if not d.vector_space:
                    J = J @ pin.dIntegrate(d.system.rigid, self.guess, way)[1]
                J = J[:, rows]
                if pull:
                    c, J = np.concatenate([c, pulled @ x]), np.vstack([J, pulled])
                last[:] = [x.copy(), c, J]
            return last[1], last[2]

        low, high = self.low[rows], self.high[rows]
        margin = 1e-10 * np.minimum(high - low, 1.0)  # a start has to be inside, not on a bound
        inside = np.clip(start[rows], low + margin, high - margin)
        solved = least_squares(
            lambda x: evaluate(x)[0],
            inside,
            jac=lambda x: evaluate(x)[1],
            bounds=(low, high),
            x_scale=self.unit[rows],
            xtol=1e-9,
            ftol=1e-9,
            gtol=1e-12,
            max_nfev=_EVALUATIONS,
        )
        way[rows] = solved.x
        return way

    def failure(self, where: str, loops: Sequence[Loop]) -> AssemblyError:
        """What stays open at the best pose found."""
        pose = self.guess if self.best is None else self.best[1]
        c, _ = self.closure.at(pose)
        apart, turned = self.closure.gaps(c)
        k = int(np.argmax(apart + self.length * turned))
        closed = self.dynamics.system.closed
        name = closed.names[k]
        words = [f"{apart[k]:.3g} m"] if len(closed.of(POINT, k)) else []
        words += [f"{turned[k]:.3g} rad"] if len(closed.of(DIRECTION, k)) else []
        words = words or [f"{apart[k]:.3g} m"]
        hint = axis_hint(self.dynamics, loops, pose)
        tried = f"{self.tried} start{'' if self.tried == 1 else 's'}"
        return AssemblyError(
            f'{where}: loop "{name}" does not close: at the best pose of {tried} this '
            f"{closed.kinds[k]} stays open by {' and '.join(words)}.{hint} Check link lengths, "
            "loop frames and joint limits, or give `home` values nearer to a closed pose.",
            gap=float(apart[k]),
            turn=float(turned[k]),
            loop=name,
            starts=self.tried,
            pose=pose,
        )
