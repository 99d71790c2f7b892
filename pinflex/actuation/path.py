"""A path of the closed-loop rigid mechanism: poses by Newton, their rates, what goes wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array, IntArray, others
from pinflex.description.motions.motion import Motion, from_spec, hold
from pinflex.errors import DescriptionError, MotionError, SceneError, SingularityError, nearest
from pinflex.mechanics import assembly
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import PlatformCoordinates, poses_of_frames
from pinflex.mechanics.manifold import Manifold
from pinflex.mechanics.model.loads import Attachment
from pinflex.mechanics.reference.evaluator import Kinematics
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.mechanics.mechanism import Mechanism


# The motors: where they sit in the coordinates, and their motion when it is given by joint.


@frozen
class MotorAxes:
    """Where single-axis motors sit in q and v; a continuous joint keeps (cos, sin) in q.

    Attributes:
        q_at, v_at: First coordinate and row of each.
        paired: Numbers of those that keep (cos, sin).
    """

    q_at: IntArray
    v_at: IntArray
    paired: IntArray

    def write(self, y: Array, angle: Array) -> None:
        """Put motor positions (rad | m), shape (..., nm), into y, shape (..., nq)."""
        y[..., self.q_at] = angle
        if len(self.paired):
            at, turned = self.q_at[self.paired], angle[..., self.paired]
            y[..., at], y[..., at + 1] = np.cos(turned), np.sin(turned)

    def read(self, y: Array) -> Array:
        """Motor positions (rad | m), shape (..., nm), of y, shape (..., nq)."""
        angle = np.array(y[..., self.q_at], float)
        for k in self.paired:
            angle[..., k] = np.arctan2(y[..., self.q_at[k] + 1], y[..., self.q_at[k]])
        return angle

    def behind(self, position: Array, y: Array) -> Array:
        """How far y (..., nq) is behind motor positions [rad | m], shape (..., nm).

        Of a motor that turns without end, the shorter way round.
        """
        error = position - self.read(y)
        if len(self.paired):
            whole = 2.0 * np.pi
            error[..., self.paired] -= whole * np.round(error[..., self.paired] / whole)
        return np.asarray(error)


@frozen
class MotorPath:
    """Motor positions, velocities, accelerations on a time grid, each (nt, nm)."""

    t: Array
    position: Array
    velocity: Array
    acceleration: Array


def motor_axes(mechanism: Mechanism) -> MotorAxes:
    """Locate the motors."""
    model, motors = mechanism.rigid.rigid, mechanism.description.actuated
    joints = [model.joints[model.getJointId(name)] for name in motors]
    q_at, v_at = (
        np.array([getattr(joint, key) for joint in joints], dtype=np.intp)
        for key in ("idx_q", "idx_v")
    )
    return MotorAxes(q_at, v_at, np.flatnonzero([joint.nq == 2 for joint in joints]))


def joint_curve(
    mechanism: Mechanism, motion: Motion
) -> Callable[[Array], tuple[Array, Array, Array]]:
    """Positions, velocities, accelerations of the motors, (nt, nm), of times (nt,)."""
    axes = motor_axes(mechanism)
    names = list(mechanism.description.actuated)
    home = axes.read(mechanism.home)
    for name in motion.names:
        if name not in names:
            raise DescriptionError(
                f"{mechanism.name}: motion.joints.{name}: not a motor.{nearest(name, names)}"
            )
    columns = [names.index(name) for name in motion.names]
    rest = home.copy()
    if motion.absolute:
        rest[columns] = 0.0

    def curve(t: Array) -> tuple[Array, Array, Array]:
        moved = np.zeros((3, len(t), len(names)))
        moved[:, :, columns] = motion.evaluate(t)
        moved[0] += rest
        return moved[0], moved[1], moved[2]

    return curve


def plain_motion(mechanism: Mechanism) -> Motion:
    """The motion of the YAML without its shaper."""
    path, block = mechanism.description.path, mechanism.description.motion
    if block is None:
        return hold(duration=1.0)
    spec = {key: x for key, x in block.items() if key != "shaper"}
    folder = None if path is None else path.parent
    return from_spec(spec, f"{mechanism.name}.yaml: motion", folder)


# Why a platform's path ends at a pose: links in line, stretched or folded.
#
# At the limit of its reach a mechanism can turn some joints without moving the platform, to first
# order: in an arm of two links where both are in line. So the joints of that motion are put in
# order along the mechanism, through a loop if it leads on, and their places are looked at.

_TAKES_PART = 0.1  # of the largest turn of a joint in the motion
_IN_LINE = 0.01  # [rad] between links: a path is followed to 1e-4 rad of its end
_HERE = 1e-9  # [m]


def in_line(
    mechanism: Mechanism, dynamics: Equations, pose: Array, motion: Array
) -> tuple[list[str], bool] | None:
    """Links that are in line at a pose and whether stretched (or folded); None where none are."""
    links, frames = mechanism.links, mechanism.rigid.expansion.frames
    number = {link.name: k for k, link in enumerate(links)}
    model = dynamics.model
    large = np.flatnonzero(np.abs(motion) > _TAKES_PART * np.abs(motion).max())
    moving = {
        name
        for name, joint in zip(model.names[1:], model.joints[1:], strict=True)
        if np.any((large >= joint.idx_v) & (large < joint.idx_v + joint.nv))
    }

    def above(k: int) -> list[int]:
        """Links from the root to one, whose joints take part."""
        found: list[int] = []
        while k >= 0:
            if any(step.name in moving for step in links[k].steps):
                found.insert(0, k)
            k = links[k].parent
        return found

    ends = [(loop.frame_a, loop.frame_b) for loop in mechanism.description.loops]
    platform = mechanism.description.platform
    ends += [(platform, platform)] if platform is not None else []
    for pair in ends:
        sides = [above(number[name]) if name in number else [] for name in dict.fromkeys(pair)]
        chain = [*sides[0], *reversed(sides[-1] if len(sides) > 1 else [])]
        if sum(any(s.name in moving for s in link.steps) for link in links) != len(chain):
            continue  # other joints take part
        end = next(name for name in pair if name in number)
        order = [
            *(links[k].name for k in sides[0]),
            end,
            *(links[k].name for k in chain[len(sides[0]) :]),
        ]
        placed = poses_of_frames(dynamics, pose[None], [frames[name] for name in order])
        found = _straight(order, [p[0] for _, p in placed], len(sides[0]))
        if found is not None:
            return found
    return None


def _straight(
    names: Sequence[str], places: Sequence[Array], end: int
) -> tuple[list[str], bool] | None:
    """Names of links, whose joints' places follow each other, if all are in line."""
    apart = [b - a for a, b in pairwise(places)]
    # before the end a link leads from its joint to the next place, after it to the one before
    carried = [names[k] if k < end else names[k + 1] for k in range(len(apart))]
    pairs = [
        (d / np.linalg.norm(d), n)
        for d, n in zip(apart, carried, strict=True)
        if np.linalg.norm(d) > _HERE
    ]
    if len(pairs) < 2:
        return None
    turns = [float(np.linalg.norm(np.cross(pairs[0][0], d))) for d, _ in pairs[1:]]
    if max(turns) > _IN_LINE:
        return None
    return [n for _, n in pairs], all(float(pairs[0][0] @ d) > 0 for d, _ in pairs[1:])


_MEANT = 0.2  # rad, or of the mechanism's length: from there Newton may end on another branch


def underactuated(mechanism: Mechanism, passive: Sequence[str]) -> MotionError:
    """The error of motors that leave coordinates undetermined."""
    return MotionError(
        f"{mechanism.name}: the motors do not determine the motion of {', '.join(passive)}. "
        "Actuate these joints, lock them (joints: {NAME: {type: fixed}}) or close loops over them. "
        "Level coupled lets them swing; what hangs by its weight needs but a soft spring (joints: "
        "{NAME: {spring: 1e-3}}) for all levels, shapers and commands."
    )


class Path:
    """One run's solver: unknown velocity rows, imposed rows, and the sign of the determinant."""

    def __init__(self, mechanism: Mechanism, motion: Motion) -> None:
        self.mechanism, self.motion = mechanism, motion
        self.dynamics = Equations(mechanism.rigid)
        self.manifold = Manifold(self.dynamics)
        self.axes = motor_axes(mechanism)
        self.names = mechanism.coordinates
        system = mechanism.rigid
        self.passive = system.free
        self.platform: PlatformCoordinates | None = None
        self.sign = 0.0
        self._last = np.zeros(0), np.zeros(0)  # the pose solved for, and its Jacobian
        self.rows = system.closed.n
        self.unknown, equations = self.passive, self.rows
        units = assembly.units(self.dynamics, mechanism.home)
        per_row = units.rows
        if motion.target == "platform":
            self.platform = PlatformCoordinates(self.dynamics, self._frame(), motion.names)
            self.unknown = others(system.nv, system.held)
            equations += len(motion.names)
            imposed = np.where(self.platform.turning, 1.0, 1.0 / units.length)
            per_row = np.concatenate([per_row, imposed])
        self._columns = units.columns
        self._factors = per_row[:, None] * units.columns[self.unknown]
        if equations != len(self.unknown):
            raise self._wrong_count(equations)

    def _wrong_count(self, equations: int) -> SceneError:
        where, mobility = self.mechanism.name, self.mechanism.report.mobility
        if self.platform is None:
            if equations < len(self.unknown):
                J = self.dynamics.close(self.mechanism.home)[1][:, self.passive]
                names = [self.names[k] for k in self.passive]
                _, motion = assembly.null_motion(J, self.dynamics.system.closed, names)
                return underactuated(self.mechanism, [motion])
            return MotionError(
                f"{where}: {len(self.axes.v_at)} motors drive a mechanism of mobility {mobility}: "
                "their motions fight each other. Take motors out of `actuated`, or move the "
                "platform (motion: platform), which gives consistent motor motions."
            )
        return MotionError(
            f"{where}: motion.platform imposes {len(self.motion.names)} coordinates "
            f"({', '.join(self.motion.names)}), the mechanism has mobility {mobility}. "
            f"Name exactly {mobility} of x, y, z, rz, ry, rx that it can follow."
        )

    def _frame(self) -> Attachment:
        name = self.mechanism.description.platform
        if name is None:
            raise DescriptionError(
                f"{self.mechanism.name}: motion.platform needs `platform: FRAME` in the YAML."
            )
        return self.mechanism.rigid.expansion.frames[name]

    def scaled(self, J: Array) -> Array:
        """A Jacobian (..., rows, unknown) without units, as `assembly.Units` has it."""
        pure: Array = J * self._factors
        return pure

    def near(self, guess: Array, pose: Array) -> bool:
        """Whether a pose is what a guess meant, whatever else closes the loops."""
        off = np.abs(self.manifold.log(guess[None], pose[None])[0]) / self._columns
        return bool(np.max(off, initial=0.0) < _MEANT)

    # One instant ---------------------------------------------------------------------------

    def imposed(self, t: Array) -> tuple[Array, Array, Array]:
        """Imposed coordinates over time: motor positions or platform coordinates."""
        if self.platform is None:
            return joint_curve(self.mechanism, self.motion)(t)
        p, v, a = self.motion.evaluate(t)
        if not self.motion.absolute:
            p = p + self._values(self.mechanism.home)
        return p, v, a

    def start(self, imposed: tuple[Array, Array, Array]) -> Array:
        """First pose of the path: reached from home in small moves, so the branch is kept."""
        home = self.mechanism.home
        begin = self._values(home) if self.platform else self.axes.read(home)
        end, pose = imposed[0][0], home
        for part in (1.0,) if np.allclose(begin, end, atol=1e-9) else np.linspace(0.05, 1.0, 20):
            pose = self.solve(pose, begin + part * (end - begin), 0.0)
        return pose

    def equations(self, poses: Array, target: Array) -> tuple[Array, Array]:
        """What is open at poses (n, nq), shape (n, k), and its Jacobian, shape (n, k, nv)."""
        c, J = self.dynamics.close(poses)
        if self.platform is None:
            return c, J
        place, J_place = self.platform.at(self._placed(poses))
        error = self.platform.error(place, target)
        return np.concatenate([c, error], axis=1), np.concatenate([J, J_place], axis=1)

    def _placed(self, poses: Array) -> Kinematics:
        assert self.platform is not None
        return self.dynamics.kinematics(poses, self.platform.joint)

    def _values(self, pose: Array) -> Array:
        """Platform coordinates that are imposed, at a pose, shape (k,)."""
        assert self.platform is not None
        found: Array = self.platform.of(self.dynamics, pose[None])[0]
        return found

    def _jacobian(self, pose: Array) -> Array:
        """Jacobian of the rows at a pose, by all velocity rows, shape (1, k, nv)."""
        if pose is self._last[0]:
            return self._last[1]
        J = self.dynamics.close(pose[None]).J
        if self.platform is None:
            return J
        return np.concatenate([J, self.platform.at(self._placed(pose))[1]], axis=1)

    def _bias(self, poses: Array, v: Array) -> Array:
        """What velocities v (n, nv) alone make of the rows' accelerations, shape (n, k)."""
        gamma = self.dynamics.closure_bias(poses, v)
        if self.platform is None:
            return gamma
        swept = self.platform.bias(self.dynamics, poses, v)
        return np.concatenate([gamma, swept], axis=1)

    def _equations(self, pose: Array, target: Array) -> tuple[Array, Array]:
        error, J = self.equations(pose[None], target)
        self._last = pose, J
        return error[0], J[0][:, self.unknown]

    def solve(self, guess: Array, target: Array, time: float) -> Array:
        """Closed pose with the imposed coordinates; Newton with step halving."""
        pose = guess.copy()
        if self.platform is None:
            self.axes.write(pose, target)
        error, J = self._equations(pose, target)
        size = float(np.max(np.abs(error), initial=0.0))
        for _ in range(40):
            if size < assembly.CLOSED:
                break
            step = _solve(J, -error)
            step *= min(1.0, 0.5 / max(float(np.max(np.abs(step))), 1e-300))
            for _ in range(8):
                dy = np.zeros(self.dynamics.system.nv)
                dy[self.unknown] = step
                trial = self.dynamics.integrate(pose, dy)
                error_trial, J_trial = self._equations(trial, target)
                size_trial = float(np.max(np.abs(error_trial)))
                if size_trial < size or size_trial < assembly.CLOSED:
                    break
                step *= 0.5
            else:
                break
            pose, error, J, size = trial, error_trial, J_trial, size_trial
        if size < assembly.CLOSED * 100:
            return pose
        raise MotionError(
            f"{self.mechanism.name}: t = {time:.6g} s: the mechanism cannot reach this pose "
            f"(closest approach {size:.2g} m or rad). Keep the path inside the workspace, or start "
            "from another branch.",
            time=time,
        )

    def rates(self, pose: Array, v_in: Array, a_in: Array, time: float) -> tuple[Array, Array]:
        """Exact velocity and acceleration at a closed pose; raises where they are not unique."""
        J = self._jacobian(pose)
        self._check(J[0][:, self.unknown], "path" if self.platform else "motors", time)
        v, a = self.rates_of(pose[None], J, v_in[None], a_in[None])
        return v[0], a[0]

    def start_from(self, pose: Array) -> None:
        """Take the branch of a closed pose."""
        self._check(self._jacobian(pose)[0][:, self.unknown], "motors", 0.0)

    def rates_of(self, poses: Array, J: Array, v_in: Array, a_in: Array) -> tuple[Array, Array]:
        """Velocities and accelerations (n, nv) at closed poses with the Jacobians J there."""
        unknown, motors = self.unknown, self.axes.v_at
        v, a = (np.zeros((len(poses), self.dynamics.system.nv)) for _ in range(2))
        if self.platform:
            none = np.zeros((len(poses), self.rows))
            v_in, a_in = (np.concatenate([none, x], axis=1) for x in (v_in, a_in))
        else:
            v[:, motors], a[:, motors] = v_in, a_in
            v_in, a_in = (-(J[:, :, motors] @ x[:, :, None])[:, :, 0] for x in (v_in, a_in))
        if len(unknown):
            v[:, unknown] = np.linalg.solve(J[:, :, unknown], v_in[:, :, None])[:, :, 0]
            a_in = a_in - self._bias(poses, v)
            a[:, unknown] = np.linalg.solve(J[:, :, unknown], a_in[:, :, None])[:, :, 0]
        return v, a

    def _check(self, J: Array, which: str, time: float) -> None:
        """Singular here, or passed a singular pose since the last instant (determinant's sign)."""
        sign = float(np.linalg.slogdet(J)[0])
        ratio = assembly.singular_ratio(self.scaled(J))
        if ratio < assembly.SINGULAR or (self.sign and sign != self.sign):
            raise self._singular(J, which, time)
        self.sign = sign

    def _singular(self, J: Array, which: str, time: float) -> SceneError:
        columns = [self.names[k] for k in self.unknown]
        where = f"{self.mechanism.name}: t = {time:.6g} s"
        what = "passive loop Jacobian", "all motors locked"
        if which != "motors":
            what = (
                "Jacobian of loops and imposed platform coordinates",
                "the platform coordinates held",
            )
        closed = self.dynamics.system.closed
        return assembly.singularity(self.scaled(J), closed, columns, where, time, what)

    def locate(self, pose: Array, good: float, bad: float) -> None:
        """Bisect to the last reachable time and name the singular pose there, if it is one."""
        for _ in range(24):
            middle = 0.5 * (good + bad)
            p, v, a = (x[0] for x in self.imposed(np.array([middle])))
            try:
                pose = self.solve(pose, p, middle)
                self.rates(pose, v, a, middle)
                good = middle
            except SceneError:
                bad = middle
        J = self._jacobian(pose)[0][:, self.unknown]
        which = "path" if self.platform else "motors"
        # At a fold the smallest singular value falls with the square root of the time left, so
        # after 24 halvings of one sample it is far below this.
        if assembly.singular_ratio(self.scaled(J)) < 1e-2:
            singular = self._singular(J, which, good)
            raise (self._out_of_reach(pose, J, singular) if self.platform else None) or singular

    def _out_of_reach(self, pose: Array, J: Array, singular: SceneError) -> SceneError | None:
        """The error of a platform led to where links are in line, if they are there."""
        motion = np.zeros(self.dynamics.system.nv)
        motion[self.unknown] = np.linalg.svd(self.scaled(J))[2][-1]
        found = in_line(self.mechanism, self.dynamics, pose, motion)
        if found is None:
            return None
        names, stretched = found
        return SingularityError(
            f"{self.mechanism.name}: t = {singular.data['time']:.6g} s: out of reach: "
            f"{', '.join(names[:-1])} and {names[-1]} are {'stretched' if stretched else 'folded'} "
            "there, in one line. Keep the path inside the workspace.",
            **{**singular.data, "motion": ", ".join(names)},
        )


def _solve(A: Array, b: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(A, b))
    except np.linalg.LinAlgError:  # singular, or not square
        return np.asarray(np.linalg.lstsq(A, b, rcond=1e-12)[0])
