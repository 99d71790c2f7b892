"""command(): the motor motion with which the platform of a flexible mechanism follows its path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.actuation.setpoints import Setpoints, missed, ticks, write_message
from pinflex.advice.error_bars import platform_bar
from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.motions.laws import Kinematics
from pinflex.description.motions.motion import Motion
from pinflex.description.trajectories.waypoints import slowed
from pinflex.doors import door
from pinflex.errors import ConvergenceError, DescriptionError, MotionError, nearest
from pinflex.integrators.problem import Run
from pinflex.inversion.exact import EIGHTH, padded, rates, spline
from pinflex.inversion.on_grid import (
    RESOLVED,
    Answer,
    Poles,
    instants_over,
    internal_poles,
    on_grid,
)
from pinflex.inversion.target import (
    Balanced,
    Instant,
    require_within_limits,
    target,
)
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.mechanics.model.loads import require_staying
from pinflex.mechanics.model.tree import sliding
from pinflex.recovery.meta import drives
from pinflex.report import card, grid, pairs
from pinflex.results.error_bars import NOT_MEASURED
from pinflex.results.quantities import joint_unit, unit_of
from pinflex.solver.solve import default_motion
from pinflex.threads import one_blas_thread

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEVELS = ("rigid", "quasistatic", "exact")
_INSTANTS = 150  # in the time of the motion
_LEAST, _MOST = 120, 4000  # instants in all
_FEWEST = 30  # that are asked for: differences of eighth order take nine
_NO_BETTER = 0.5  # of the last error: an order of four and more leaves 0.15, round-off more
_STEPS = 12  # of a swing that grows, on the grid that tells whether an inversion settles
_REFINED = 1.6  # instants of a finer grid over those of the last
_MOTOR_SIDE = ("motor_position", "motor_speed", "motor_torque")
_POOR = 1e-2  # of what the rigid command misses: a bar that is worth a second grid
_ROUND_OFF = 3.0  # times the bar of a coarser grid: what two grids leave at the end differs by less
_STILL = 1e-3  # of its top speed, below which a motor rests
_AT_REST = 1e-3  # of the largest speed: samples of a motion end at rest to about that
_TAIL = 8  # instants beyond the end, where differences have no neighbours: solved, and cut off


@dataclass(frozen=True, repr=False)
class Command:
    """Motor motion over time, and what is known of it.

    Attributes:
        name: Model. level: rigid, quasistatic or exact.
        motors: Motor names. units: Of their torques.
        t: Uniform times [s], shape (nt,).
        position, velocity, acceleration: Of the motors [m | rad, per s, per s^2], each (nt, nm).
        torque: Motor torques [N m | N], shape (nt, nm).
        before, after: Rest ahead of the platform's motion and after it [s].
        coordinates: Platform coordinates that follow the path.
        reference: Their values [m | rad], shape (nt, k).
        error: Bar on the largest error of each coordinate [m | rad], shape (k,), had the robot this
            model (`model_error` tells what that leaves out): of level exact by the instants and
            the rest, also after the motors stop; of level quasistatic in a forward run, vibration
            included; of level rigid what the quasistatic command corrects.
        cut_off: Level exact: the part of it, shape (k,), by motors that stop while the links still
            swing. More `after` lowers it where that swing fades by then.
        changes: Level quasistatic: largest change of a motor position from pass to pass.
        iterations: Level exact: linear systems solved; 0 where elastic drives alone give way.
        drives: Of each drive both sides of the gear, by key as in a Result: motor_position,
            motor_speed, motor_torque, torque, ..., each (nt,).
        limit_curves: Points motor speed [rad/s], torque [N m] of each drive; () for none.
    """

    name: str
    level: str
    motors: tuple[str, ...]
    units: tuple[str, ...]
    t: Array
    position: Array
    velocity: Array
    acceleration: Array
    torque: Array
    before: float
    after: float
    coordinates: tuple[str, ...]
    reference: Array
    error: Array
    cut_off: Array = field(default_factory=lambda: np.zeros(0))
    changes: tuple[float, ...] = ()
    iterations: int = 0
    drives: dict[str, dict[str, Array]] = field(default_factory=dict)
    limit_curves: dict[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    curve: Callable[..., Array] = field(default=np.zeros, compare=False)
    look: Callable[[Motion], tuple[Array, str]] | None = field(default=None, compare=False)

    @cached_property
    def _model(self) -> tuple[Array, str]:
        none = np.full(len(self.coordinates), np.nan), NOT_MEASURED
        return none if self.look is None else self.look(self.motion)

    @property
    def model_error(self) -> Array:
        """Bar on the error of each coordinate by what the model leaves out [m | rad], shape (k,).

        Twice what a cheap look at a richer model does otherwise with the same motors (twice the
        segments, second order, stretch, twist, shear). NaN where none tells; found when
        first asked for.
        """
        return self._model[0]

    @property
    def model_note(self) -> str:
        """What `model_error` is measured against, or why it is not."""
        return self._model[1]

    def __repr__(self) -> str:
        parts = zip(self.coordinates, self.error, strict=True)
        largest = {len(name): 0.0 for name in self.coordinates}
        for name, error in parts:
            largest[len(name)] = max(largest[len(name)], float(error))
        words = " and ".join(
            f"{1e6 * error:.3g} {'um' if n == 1 else 'urad'}" for n, error in largest.items()
        )
        return (
            f"<Command {self.name}, {self.level}, {self.t[-1]:.4g} s; platform within {words}, "
            "and model_error by what the model leaves out>"
        )

    def plot(self, panel: str | None = None, ax: Axes | None = None) -> Any:
        """Draw how far the motors move, and torques; returns the matplotlib axes.

        Args:
            panel: One alone: "motors" or "torque".
            ax: Where to draw that; default: axes of a new figure.
        """
        return door("viewer.plots.motions", "plot_command")(self, panel, ax)

    def _repr_html_(self) -> str:
        rows = [
            [name, f"{error:.3g}", "m" if len(name) == 1 else "rad"]
            for name, error in zip(self.coordinates, self.error.tolist(), strict=True)
        ]
        heading = f"{self.name}: {self.level} command, {self.t[-1]:.4g} s"
        motors = pairs([("motors", ", ".join(self.motors)), ("instants", len(self.t))])
        return card(heading, motors, grid(("coordinate", "within", "unit"), rows))

    @property
    def actuation(self) -> tuple[float, float]:
        """How long the motors move before the platform does, and after it [s].

        While a motor is faster than a thousandth of its top speed.
        """
        speed = np.abs(self.velocity)
        moving = np.flatnonzero(np.any(speed > _STILL * speed.max(axis=0), axis=1))
        if not len(moving):
            return 0.0, 0.0
        first, last = self.t[moving[0]], self.t[moving[-1]]
        ends = float(self.t[-1]) - self.after
        return max(self.before - float(first), 0.0), max(float(last) - ends, 0.0)

    @property
    def motion(self) -> Motion:
        """The command as a motion of the joints, which `solve` takes."""
        names = tuple(self.motors)
        law = partial(_follow, self.curve, float(self.t[-1]))
        end = float(self.t[-1])
        corners = self.before, end - self.after  # where the platform starts and stops
        return Motion("command", "joints", names, end, law, True, corners=corners)

    def at_rate(self, rate: float | None = None) -> Setpoints:
        """Rows for a controller and what its interpolation misses; None: the command's instants.

        Args:
            rate: Rows in a second [Hz].
        """
        t = self.t if rate is None else ticks(float(self.t[-1]), rate)
        p, v, a = self.motion.evaluate(t)
        sides = {
            f"{name}.{key} [{unit_of(f'drive/{name}/{key}')}]": side[key]
            for name, side in self.drives.items()
            for key in _MOTOR_SIDE
        }
        values = np.column_stack([self.torque, *sides.values()])
        if rate is None:
            p, v, a = self.position, self.velocity, self.acceleration
        else:
            values = spline(self.t, values)(np.minimum(t, self.t[-1]))
        n = len(self.motors)
        units = tuple("m" if unit == "N" else "rad" for unit in self.units)
        more = dict(zip(sides, values[:, n:].T, strict=True))
        off = missed(self.motion.evaluate, t)
        return Setpoints(self.motors, units, t, p, v, a, True, off, values[:, :n], more)

    def to_csv(self, path: str | Path, rate: float | None = None) -> Path:
        """Write t, then position, velocity, acceleration and torque of every motor, SI units.

        Behind them stand position, speed and torque of the motor of every drive.

        Args:
            path: The file.
            rate: Rows in a second [Hz]; default: the instants of the command.
        """
        return self.at_rate(rate).to_csv(path)

    def to_joint_trajectory(
        self, path: str | Path | None = None, rate: float | None = 1000.0
    ) -> dict[str, Any]:
        """The command as a ROS 2 JointTrajectory, plain data, torques as effort.

        Args:
            path: .yaml or .json, where it is to be written too.
            rate: Points in a second [Hz]; None: the instants of the command.
        """
        data = self.at_rate(rate).message()
        if path is not None:
            write_message(path, data)
        return data


def _follow(curve: Callable[..., Array], end: float, t: Array) -> Kinematics:
    inside = np.clip(t, 0.0, end)
    p, v, a = (curve(inside, k) for k in range(3))
    rest = (t > end)[:, None]
    return p, np.where(rest, 0.0, v), np.where(rest, 0.0, a)


@public
@takes_model
@one_blas_thread()
def command(
    mechanism: Mechanism,
    motion: Motion | None = None,
    level: str = "exact",
    *,
    tol: float | None = None,
    coordinates: tuple[str, ...] | list[str] | None = None,
    before: float | None = None,
    after: float | None = None,
    instants: int | None = None,
    limited: bool = True,
) -> Command:
    """Find the motor motion with which the platform follows a path although the links deform.

    Args:
        mechanism: Flexible mechanism with a platform and motors of one axis each.
        motion: Of the platform, or of joints (then of the platform of the rigid mechanism);
            default: the motion of the YAML.
        level: "rigid": inverse kinematics. "quasistatic": an asymptotic series, for motions slower
            than the vibrations. "exact": stable inversion, for any motion that is smooth.
        tol: Platform error wanted, as a share of what the rigid command misses (level exact). The
            grid is refined until the estimate is below it, but for `Command.cut_off`. Default: one
            grid.
        coordinates: Platform coordinates that follow, among x y z rz ry rx; default: those of the
            motion, or as many independent ones as there are motors. Fewer than motors: what moves
            none of them stays on the rigid motion, and the links swing freely there.
        before, after: Rest ahead of the motion and after it [s]; default: from the internal
            dynamics (the vibration that is left when the platform is held on its path).
        instants: Number of grid points; default: 150 over the motion. Of level exact there are
            more where fast modes ring after it (`pinflex.inversion.on_grid`).
        limited: Refuse a command beyond the URDF's effort and velocity limits, or beyond the
            limit curve of a drive.
    Returns:
        The command. Its `motion` goes into `solve`, with `start="static"`.
    Raises:
        DescriptionError: No platform, no flexible link, an unknown coordinate or level.
        MotionError: A path with jumps in its acceleration, beyond reach, or beyond what the motors
            may do: it says how long the motion must take.
        ConvergenceError: No motor motion found.
    Source: see `pinflex.inversion.on_grid` and `pinflex.inversion.exact`.
    """
    if level not in LEVELS:
        raise DescriptionError(f"command: level: {level}.{nearest(level, LEVELS)}")
    if not mechanism.flexible.n_eta and not len(mechanism.rigid.held):
        raise DescriptionError(
            f"{mechanism.name}: command: nothing deforms, so the rigid inverse kinematics is the "
            "answer. Describe flexible links or elastic joints."
        )
    if len(mechanism.idle.base):
        raise DescriptionError(
            f"{mechanism.name}: command: the base is free and drifts as motors push, so that no "
            "motor motion alone holds the platform on a path in the world. Write `base: fixed`, or "
            "hold the base by a loop to `world`."
        )
    _require_numbers(mechanism.name, level, tol, before, after, instants)
    require_staying(mechanism.description, "command")
    motion = motion if motion is not None else default_motion(mechanism)
    _require_smooth(mechanism, motion)
    held = tuple(coordinates or (motion.names if motion.target == "platform" else ()))
    looks = level == "exact" or before is None or after is None
    poles = internal_poles(mechanism, motion, held) if looks else None
    ahead, behind = _rests(mechanism.name, poles, level, before, after)
    span = ahead + motion.duration + behind
    over = instants_over(mechanism, motion.duration) if level == "exact" else _INSTANTS
    n = instants or int(np.clip(over * span / motion.duration, _LEAST, _MOST))
    on = partial(_on_grid, mechanism, motion, level, held, poles, (ahead, behind))

    def slower(times: float) -> Command:
        return command(mechanism, slowed(motion, times), level, coordinates=coordinates,
                       before=before, after=after, instants=instants, limited=False)  # fmt: skip

    best, answer = np.inf, None
    if poles is not None and level == "exact" and (swing := poles.swing_from(ahead)):
        few = int(span * swing / (2.0 * np.pi) * _STEPS)
        answer = on(few, None)[1] if _FEWEST < few < n // 2 else None  # refused early, if at all
    while True:
        found, answer, _ = on(n, answer)
        by_grid = found.error - found.cut_off
        missed = float(np.max(by_grid / np.maximum(answer.missed, RESOLVED)))
        if tol is None and missed > _POOR and level == "exact":
            found = _refined(found, on, int(_REFINED * n), answer)
        if tol is None or missed <= tol:
            break
        if missed > _NO_BETTER * best or n >= _MOST:  # the last grid said so at 1.6 times the cost
            floor = min(best, missed)
            raise ConvergenceError(
                f"{mechanism.name}: command: tol = {tol:g} is out of reach: the best grid, of "
                f"{n if missed < best else int(n / _REFINED)} instants, misses {floor:.2g} of what "
                f"the rigid command does. Ask for {2 * floor:.1g} or more, or leave tol out.",
                floor=floor,
            )
        best, n = missed, min(int(_REFINED * n), _MOST)
    if limited:
        require_within_limits(mechanism, found, motion.duration, slower)
    return found


def _require_numbers(
    name: str,
    level: str,
    tol: float | None,
    before: float | None,
    after: float | None,
    instants: int | None,
) -> None:
    """Refuse numbers that make no command."""
    if tol is not None and (level != "exact" or not 0.0 < tol < np.inf):
        raise DescriptionError(
            f"{name}: command: tol = {tol:g}. Give a number above 0, at level exact: the others "
            "have one grid."
        )
    if instants is not None and not (isinstance(instants, int) and _FEWEST <= instants <= 10**6):
        raise DescriptionError(
            f"{name}: command: instants = {instants!r}. Give a whole number from {_FEWEST} on; "
            f"{_LEAST} and more are usual."
        )
    for key, time in (("before", before), ("after", after)):
        if time is not None and not 0.0 <= time < np.inf:
            raise DescriptionError(f"{name}: command: {key} = {time!r}. Give seconds, 0 or more.")


def _rests(
    name: str, poles: Poles | None, level: str, before: float | None, after: float | None
) -> tuple[float, float]:
    """Rest ahead of the motion and after it [s]: as asked, else from the internal dynamics.

    Raises:
        DescriptionError: What is asked for cuts off motion that an exact command needs ahead.
    """
    ahead, behind = (0.0, 0.0) if poles is None else poles.rests
    before, after = ahead if before is None else before, behind if after is None else after
    least = poles.ahead if poles is not None and level == "exact" else 0.0
    if before < 0.999 * least:
        raise DescriptionError(
            f"{name}: command: before = {before:g} s cuts off what the motors must do ahead of the "
            f"motion (the platform is not minimum phase). Give at least {least:.3g} s, or leave it "
            "out."
        )
    return before, after


def _on_grid(
    mechanism: Mechanism,
    motion: Motion,
    level: str,
    coordinates: tuple[str, ...],
    poles: Poles | None,
    rests: tuple[float, float],
    n: int,
    coarser: Answer | None,
) -> tuple[Command, Answer, Array]:
    """A command on n instants, what it was made of, and the gain (nt, k, nm)."""
    ahead, behind = rests
    t = np.arange(n + _TAIL, dtype=float) * ((ahead + motion.duration + behind) / (n - 1))
    wanted = target(mechanism, motion, t, ahead, coordinates)
    instant = Instant(mechanism, wanted)
    kept = slice(n)
    answer = on_grid(instant, motion, level, kept, coarser.grid if coarser else None)
    position = instant.axes.read(answer.found.y)
    if len(instant.axes.paired):
        position = np.unwrap(position, axis=0)
    curve = answer.curve or spline(t, position)
    window = np.zeros(len(wanted.names))
    if poles is not None and answer.swing is not None:
        window = poles.cut_off(ahead) * answer.missed + answer.swing
    slides = sliding(mechanism.rigid.rigid)
    found = Command(
        name=mechanism.name,
        level=level,
        motors=mechanism.motors,
        units=tuple(joint_unit("torque", name in slides) for name in mechanism.motors),
        t=t[kept],
        position=position[kept],
        velocity=curve(t[kept], 1),
        acceleration=curve(t[kept], 2),
        torque=answer.found.torque[kept],
        before=ahead,
        after=behind,
        coordinates=wanted.names,
        reference=wanted.position[kept],
        error=answer.error + window,
        cut_off=window,
        changes=answer.changes,
        iterations=answer.iterations,
        drives=_both_sides(instant, answer.found, curve, kept),
        limit_curves={
            name: extra.drive.limit_curve
            for name, extra in mechanism.description.joints.items()
            if extra.drive is not None
        },
        curve=curve,
        look=partial(platform_bar, mechanism, wanted.names),
    )
    return found, answer, wanted.gain[kept]


def _refined(coarse: Command, on: Callable[..., Any], n: int, answer: Answer) -> Command:
    """A command on a finer grid of n instants; the coarser one where that does not settle."""
    try:
        finer, _, gain = on(n, answer)
    except ConvergenceError:
        return coarse
    return _held_against(coarse, finer, gain)


def _held_against(coarse: Command, finer: Command, gain: Array) -> Command:
    """The finer of two commands, its bar what the other one misses of it, where that is less.

    But the coarser one where the bar of the finer is far larger: that is round-off, which
    differences over a shorter step raise.
    Where the jerk jumps, orders 4 and 8 of one grid are far further apart than 8 is from the truth.
    """
    if np.any(finer.error > _ROUND_OFF * coarse.error):
        return coarse
    apart = np.einsum("tkm,tm->tk", gain, coarse.curve(finer.t) - finer.position)
    error = np.max(np.abs(apart), axis=0) + finer.cut_off
    return replace(finer, error=np.minimum(error, finer.error))


def _both_sides(
    instant: Instant, answer: Balanced, curve: Callable[..., Array], kept: slice
) -> dict[str, dict[str, Array]]:
    """Torque, speed and power on both sides of each drive."""
    mechanism, t = instant.mechanism, instant.target.t
    if not any(extra.drive is not None for extra in mechanism.description.joints.values()):
        return {}
    h = float(t[1] - t[0])
    v, a = rates(instant.dynamics, padded(answer.y, EIGHTH.reach), h, EIGHTH)
    rows = instant.system.motors
    v[:, rows], a[:, rows] = curve(t, 1), curve(t, 2)
    run = Run(instant.system, t, answer.y, v, a, answer.lam, answer.torque, {})
    found: dict[str, dict[str, Array]] = {}
    for key, values in drives(mechanism, run).items():
        _, name, quantity = key.split("/")
        found.setdefault(name, {})[quantity] = values[kept]
    return found


def _require_smooth(mechanism: Mechanism, motion: Motion) -> None:
    """Refuse a motion whose acceleration jumps, or its speed where it begins or ends.

    No motor motion makes a platform do that.
    """
    t = np.linspace(0.0, motion.duration, 2001)
    _, v, a = motion.evaluate(t)
    if not a.shape[1]:
        raise MotionError(
            f"{mechanism.name}: command: the motion moves nothing. Give a motion of the platform "
            "or of the joints."
        )
    ends = (np.maximum(np.abs(x[0]), np.abs(x[-1])) for x in (v, a))
    jumps = np.max(np.abs(np.diff(a, axis=0)), axis=0)
    each = (np.max(np.abs(v), axis=0), np.max(np.abs(a), axis=0), *ends, jumps)
    for name, fastest, size, end, edge, jump in zip(motion.names, *each, strict=True):
        if end > _AT_REST * fastest:
            raise MotionError(
                f"{mechanism.name}: command: the speed of {name} jumps where a {motion.kind} "
                f"motion begins or ends ({end:.3g} of at most {fastest:.3g}, SI). Take a motion "
                "from rest to rest: cycloid, quintic or nonic, or samples of one."
            )
        if size > 0.0 and max(jump, edge) > 0.2 * size:
            raise MotionError(
                f"{mechanism.name}: command: the acceleration of {name} jumps in a "
                f"{motion.kind} motion, and no motor makes a flexible robot follow that. Take a "
                "cycloid, quintic or nonic motion, or samples of a smooth one."
            )
