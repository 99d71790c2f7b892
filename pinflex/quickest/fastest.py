"""fastest(): the shortest motion that keeps limits and is still at its end."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.motions.motion import Motion, quintic
from pinflex.doors import door
from pinflex.errors import ConvergenceError, DescriptionError, nearest
from pinflex.levels.modes import modes
from pinflex.levels.ringing import ringing
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.mechanics.model.loads import require_staying
from pinflex.quickest.curves import curves_of, reduced
from pinflex.quickest.limits import (
    Limits,
    Profile,
    RigidPath,
    basis,
    fitted,
    limits_of,
    require_numbers,
    slowness,
    with_jerk,
)
from pinflex.quickest.programme import places
from pinflex.quickest.response import Grid, Settled, Strains, rest_of, settled
from pinflex.quickest.robustness import Off, corners, robustness, variant
from pinflex.quickest.search import (
    DEAR,
    RESTART,
    Look,
    Search,
    Task,
    end_of,
    motors_of,
    platform_speed,
    rigid_least,
)
from pinflex.quickest.text import text
from pinflex.results.result import Result
from pinflex.threads import one_blas_thread

_INTERVALS = 40  # of constant jerk
_A_PERIOD = 28  # steps that the lowest mode's period has: its phase is right to 0.5 %
_EACH = (8, 16)  # steps in an interval: fewer leave derivatives of higher modes 10 % off
_PERIODS = 2.0  # of the lowest mode, that are watched after the end
_GENTLE = 0.25, 0.85  # of jerk and torque limits: a first profile that shakes little
_ROUGH = 1e-3  # of its duration: what ends the search for it
_JERK, _QUINTIC = 6.0, 60.0  # times a quintic's where no jerk limit is known; that of one second
_FIRST, _ALL = 4.0, 2.0  # times as far from the end do searches of it and of all robots stop
_STEPS = 60  # at the most
_FAR = 1.1  # of the rigid robot's least time: a longer motion is looked for from another start too
DRIVES = ("prescribed", "torque")
_FULL, _LOOSE = 0.999, 0.5  # of a torque limit; share of intervals, above which none is refined
_FINEST = 128  # steps in an interval of those that are looked at while refining
_ROUNDS, _PARTS, _RADIUS = 5, 4, 1.0  # of refining; parts of an interval; the first step's radius
_FINE = 0.05  # of `close`: what ends a search in finer intervals
TOL = 1e-5  # of the runs that verify
_BROKEN = 0.01  # of a limit: what drives and models are not known to
_SHOWN, _NEAR = 4e-4, 0.9  # of a limit: less is printed as 100.0 %; from which the two runs count
_ASIDE = 6e-4  # of a limit: a step and what finer runs show of it miss its aim by as much
_PASSES, _CLOSER, _NEARBY = 3, 6, 0.01  # under limits drawn in; steps at the most; their radius


@dataclass(frozen=True)
class Fastest:
    """The shortest motion found, and how it was verified.

    Attributes:
        name: Model. target, moves: What moves by how much from home [rad | m].
        duration: Of the motion [s].
        settled: Time from which every platform stays within the band [s].
        band: Asked distance from rest [m].
        residual: Largest distance from rest after the end [m], of the worst model, and
        bar: by how much its runs may be wrong [m].
        holds: What is at its limit, such as "torque of motor_1", the largest share of the time
            first; by name the share of the time.
        shares: Largest use of each limit [-].
        rigid: The rigid robot's least time under the same limits [s], its shaking left out.
        limits: Along the path and of the motors.
        runs: The coupled runs that verify, by name of the model; "nominal" is the first.
        motion: Usable in `pf.solve`.
        box, ends: Where the end alone was asked for: the largest distance [m] and speed [m/s] of an
            axis that is allowed there, and that was found, of all models; else None.
        frame: The platform. rest: Where that of the nominal robot comes to rest [m], shape (3,).
        steps: Linear programmes solved.
    """

    name: str
    target: str
    moves: dict[str, float]
    duration: float
    settled: float
    band: float
    residual: float
    bar: float
    holds: dict[str, float]
    shares: dict[str, float]
    rigid: float
    limits: Limits
    motion: Motion = field(repr=False)
    runs: dict[str, Result] = field(repr=False)
    models: dict[str, Mechanism] = field(repr=False)
    profile: Profile = field(repr=False)
    frame: str
    rest: Array = field(repr=False)
    steps: int = 0
    box: tuple[float, float] | None = None
    ends: tuple[float, float] | None = None

    @property
    def shares_of_torque(self) -> float:
        """Largest use of a torque limit [-]."""
        return max((x for name, x in self.shares.items() if "torque" in name), default=0.0)

    def __str__(self) -> str:
        return text(self)

    def baselines(self, progress: Callable[[str], None] | None = None) -> tuple[Any, ...]:
        """Quintic, trapezoid, jerk-limited, plain and shaped, and exact commands: same limits."""
        from pinflex.quickest.baselines import baselines

        return baselines(self, progress)

    def robustness(self, share: float = 0.05) -> tuple[Off, ...]:
        """What it does where payload, stiffness or friction are off by a share, both ways."""
        until = float(self.runs["nominal"].t[-1])
        return robustness(self.models["nominal"], self.motion, until, self.duration, share)

    def plot(self, rows: Sequence[Any] = (), panel: str | None = None, ax: Any = None) -> Any:
        """Draw speed, distance from rest and torques; returns the matplotlib axes.

        Args:
            rows: Of `baselines`, beside it.
            panel: One alone: "speed", "platform" or "torque".
            ax: Where to draw that; default: axes of a new figure.
        """
        return door("viewer.plots.motions", "plot_fastest")(self, rows, panel, ax)

    def page(self, path: Any, rows: Sequence[Any] = ()) -> Any:
        """Write a page that plays it beside the best of each usual profile; returns the path.

        Args:
            path: An HTML file.
            rows: Of `baselines`.
        """
        return door("viewer.view", "write_race")(self, rows, path)

    def __repr__(self) -> str:
        return (
            f"<Fastest {self.name}, {self.duration:.4g} s, still within {1e6 * self.residual:.3g} "
            f"um; the rigid robot {self.rigid:.4g} s>"
        )


@public
@takes_model
@one_blas_thread()
def fastest(
    mechanism: Mechanism,
    to: Mapping[str, float],
    *,
    settle: float | Mapping[str, float],
    limits: Mapping[str, Any] | None = None,
    robust: Mapping[str, float | Sequence[float]] | None = None,
    target: str | None = None,
    drive: str = "prescribed",
    intervals: int = _INTERVALS,
    close: float = 1.2e-3,
    progress: Callable[[str], None] | None = None,
) -> Fastest:
    """Find the shortest motion, from rest to rest, after which the platform does not shake.

    One profile along the path, its jerk constant in each of some intervals, found by linear
    programmes about coupled runs of the flexible robot, until the runs themselves keep the limits
    and the band.

    Args:
        mechanism: Flexible mechanism with a platform.
        to: Displacements from home by motor [rad | m] or by platform coordinate (x y z [m], rz ry
            rx [rad]): all move in step, along a straight line in these.
        settle: Distance [m] from where it comes to rest within which the platform stays from the
            end on; or {position: [m], speed: [m/s]} of each axis at the end alone.
        limits: Over those of the URDF, and beside the `limit_curve` of drives: speed,
            acceleration, jerk (of what moves, one number or by name; jerk inf: acceleration may
            jump; default six times a quintic's), torque and motor_speed (one number or by
            motor), stress (von Mises [Pa], one number or by link),
            path (distance [m] of the platform from where it would rest along the way).
        robust: Shares by which payload, stiffness or friction may be off, such as {"payload":
            0.2} (or factors, [0.8, 1.2]): the same motion must leave these robots still too; limits
            hold at the nominal one.
        target: "joints" or "platform"; default: what the names are of.
        drive: prescribed: motors follow the motion. torque: they push with the torque that the
            rigid nominal robot takes for it, without a controller; settle is then a position and a
            speed, of each motor too, and intervals are cut about the instants at which a torque
            goes from limit to limit.
        intervals: Of constant jerk.
        close: The search ends when a step hopes for less, as a share of the duration.
        progress: Called with a line of text after every step.
    Returns:
        The motion, verified by coupled runs within 1e-5.
    Raises:
        DescriptionError: Names, limits or shares that there are not, or no platform.
        ConvergenceError: No motion found that keeps all.
    Source: time-optimal inputs by linear programmes: Liu and Wie (1992), JGCD 15; here about runs.
    """
    if mechanism.description.platform is None:
        raise DescriptionError(
            f"{mechanism.name}: fastest: needs `platform: FRAME` in the YAML, which is to be still."
        )
    require_staying(mechanism.description, "fastest")
    require_numbers(mechanism.name, settle, intervals)
    target, moves = _moves(mechanism, to, target)
    models = {"nominal": mechanism}
    for factors in corners(robust or {}):
        label = ", ".join(f"{kind} {100 * (x - 1):+.0f} %" for kind, x in factors.items())
        models[label] = variant(mechanism, factors)
    pushed = _pushed(mechanism, drive, settle)
    task, first, bound = _task(target, moves, models, limits, settle, intervals, pushed)
    grid, period = _grid(task, bound, intervals)
    steps = 0

    def tell(now: Look) -> None:
        nonlocal steps
        steps += 1
        if progress is not None:
            progress(
                f"{now.profile.duration:.4f} s: shakes {now.shake:.2f} of the band, takes "
                f"{100 * now.push:.1f} % of the torques{_strained(task, now)}"
            )

    found, search = _searched(task, first, bound.duration, grid, close, tell)
    found, seen = _closed(task, found, search, period, close)
    made = _told(task, found, models, bound.duration, steps, seen)
    _require_kept(task, made)
    return made


def _pushed(mechanism: Mechanism, drive: str, settle: Any) -> bool:
    """Whether motors push.

    Raises:
        DescriptionError: No such drive, or no box at the end for motors that nothing holds there.
    """
    if drive not in DRIVES:
        raise DescriptionError(
            f"{mechanism.name}: fastest: drive: {drive}.{nearest(drive, DRIVES)}"
        )
    if drive == "torque" and not isinstance(settle, Mapping):
        raise DescriptionError(
            f"{mechanism.name}: fastest: settle: with drive torque nothing holds the motors after "
            "the end. Give {position: ..., speed: ...} of the end alone."
        )
    if drive == "torque" and (curves := curves_of(mechanism)):
        raise DescriptionError(
            f"{mechanism.name}: fastest: joints.{curves[0].name}.drive.limit_curve: with drive "
            "torque a motor's speed is not known beforehand. Remove it, and give limits of torque "
            "and motor_speed."
        )
    return drive == "torque"


def _moves(
    mechanism: Mechanism, to: Mapping[str, float], target: str | None
) -> tuple[str, dict[str, float]]:
    """Target and displacements; platform coordinates that are not named stay where they are."""
    if not to:
        raise DescriptionError(
            f"{mechanism.name}: fastest: to: nothing moves. Say what and how far."
        )
    if target is None:
        target = "joints" if set(to) <= set(mechanism.motors) else "platform"
    make = {"joints": to} if target == "joints" else {"platform": to}
    moves = dict(zip(quintic(**make, duration=1.0).names, map(float, to.values()), strict=True))
    if not any(moves.values()):
        raise DescriptionError(f"{mechanism.name}: fastest: to: nothing moves. Say how far.")
    return target, moves


def _task(
    target: str,
    moves: dict[str, float],
    models: dict[str, Mechanism],
    given: Mapping[str, Any] | None,
    settle: float | Mapping[str, float],
    intervals: int,
    pushed: bool,
) -> tuple[Task, Profile, Profile]:
    """The task, a gentle profile to begin with, and the rigid robot's fastest."""
    mechanism = models["nominal"]
    limits = limits_of(mechanism, target, moves, given)
    far = np.array([*moves.values()])
    box = None
    if isinstance(settle, Mapping):
        box = float(settle["position"]), float(settle["speed"])
    rigid = tuple(RigidPath(x, target, moves, 1.0) for x in models.values())
    make = {"joints": moves} if target == "joints" else {"platform": moves}

    def smooth(duration: float) -> Motion:
        return quintic(**make, duration=duration)

    others = limits.speed, limits.acceleration, *limits.torque, *limits.motor_speed
    by_jerk = np.isfinite(limits.jerk) and not np.any(np.isfinite(others))
    slow = 0.0 if by_jerk else slowness(rigid[0], limits, moves, smooth)
    slow = float(np.fmax(slow, np.cbrt(_QUINTIC / limits.jerk)))  # nan: no jerk limit is known
    limits = with_jerk(limits, _JERK * _QUINTIC / slow**3)
    start = fitted(smooth(slow), far, intervals, limits.jumps)
    bound = rigid_least(rigid[0], limits, start)
    soft = replace(limits, jerk=_GENTLE[0] * limits.jerk, torque=_GENTLE[1] * limits.torque,
                   curves=reduced(limits.curves, _GENTLE[1]))  # fmt: skip
    first = rigid_least(rigid[0], soft, replace(start, duration=1.5 * slow), _ROUGH)
    rest = np.array([rest_of(x, path.end) for x, path in zip(models.values(), rigid, strict=True)])
    band = float(settle) if box is None else box[0]  # type: ignore[arg-type]
    every = tuple(models.values())
    strains = _strains(mechanism, limits, rigid[0]) if limits.strains else None
    task = Task(target, moves, limits, band, every, rigid, rest, box, pushed, strains)
    return task, first, bound


def _strains(mechanism: Mechanism, limits: Limits, along: RigidPath) -> Strains:
    """What finds stress and distance from the path.

    Raises:
        DescriptionError: Weight alone breaks a limit of stress.
    """
    found = Strains(mechanism, limits, along)
    stresses = found.use(found.resting).max(axis=0)
    worst = int(np.argmax(stresses))
    if stresses[worst] > 1.0:
        raise DescriptionError(
            f"{mechanism.name}: fastest: limits.stress: rest takes {100 * stresses[worst]:.4g} % "
            f"of the {found.names[worst]}. Give more."
        )
    return found


def _grid(task: Task, bound: Profile, n: int) -> tuple[Grid, float]:
    """Instants of the search, and the longest period at the end [s]."""
    model = task.models[0]
    found = modes(model, task.rigid[0].end, count=1).frequencies
    if not len(found):
        raise DescriptionError(
            f"{model.name}: fastest: nothing in this model vibrates. Make links flexible or give a "
            "`drive` its `stiffness`; what is rigid moves fastest by `kind: scurve` or pf.retime."
        )
    lowest = float(found[0])
    each = int(np.clip(np.ceil(_A_PERIOD * lowest * bound.duration / n), *_EACH))
    after = int(np.ceil(_PERIODS / lowest / bound.duration * n * each))
    return Grid(n, each, min(after, 2 * n * each) if task.box is None else 4), 1.0 / lowest


def _searched(
    task: Task, first: Profile, bound: float, grid: Grid, close: float,
    tell: Callable[[Look], None],
) -> tuple[Look, Search]:  # fmt: skip
    """The nominal robot's motion, then all robots' from there on, and the last search."""
    alone = replace(task, models=task.models[:1], rigid=task.rigid[:1], rest=task.rest[:1])
    many = len(task.models) > 1
    search, asked = Search(alone, grid, tell), _FIRST * close if many else close
    found = search.go(first, _STEPS, asked)
    if task.box is None and (not found.kept or found.profile.duration > _FAR * bound):
        other = Search(alone, grid, tell)
        try:
            again = other.go(_shaped(task, first), _STEPS, asked)
        except ConvergenceError:  # no step from there keeps the jerk: the first search stands
            again = found
        if (not again.kept, again.profile.duration) < (not found.kept, found.profile.duration):
            found, search = again, other
    if many:
        search = Search(task, grid, tell, max(search.radius, RESTART))
        found = search.go(found.profile, _STEPS, _ALL * close, found.runs)
    if task.pushed and found.kept:
        found, search = _refined(Search(task, grid, tell), found, close)
    if broken := found.broken:
        raise ConvergenceError(
            f"{task.models[0].name}: fastest: no motion found that keeps all: the best one, of "
            f"{found.profile.duration:.4g} s, {' and '.join(broken)}. Allow more intervals than "
            f"{found.profile.n}, a wider band, or higher limits."
        )
    return found, search  # equal steps have less than the band: finer runs judge what is between


def _shaped(task: Task, like: Profile) -> Profile:
    """Near the quintic shaped by ZV, within the limits of the rigid robot: another start."""
    model, rigid = task.models[0], task.rigid[0]
    make = {"joints": task.moves} if task.target == "joints" else {"platform": task.moves}
    heard = ringing(model, quintic(**make, duration=like.duration), 1)
    cancelled = heard.frequencies.tolist(), heard.damping.tolist()

    def shaped(duration: float) -> Motion:
        return quintic(**make, duration=duration).shaped("zv", *cancelled)

    motion = shaped(slowness(rigid, task.limits, task.moves, shaped))
    return fitted(motion, np.array([*task.moves.values()]), like.n, like.jumps)


def _strained(task: Task, now: Look) -> str:
    return "" if task.strains is None else f", {100 * now.strain:.1f} % of stress or path"


def _refined(search: Search, found: Look, close: float) -> tuple[Look, Search]:
    """The same with shorter intervals where a torque goes from limit to limit inside one."""
    limits = search.task.limits
    for _ in range(_ROUNDS):
        profile = found.profile
        B = basis(profile.ends, profile.jumps, places(profile))
        tau = search.task.rigid[0].torque_by(B, profile.x, profile.duration)[0]
        full = np.max(np.abs(tau) / limits.torque, axis=1).reshape(profile.n, -1) > _FULL
        loose = ~full.all(axis=1)
        if not 0 < np.sum(loose) <= _LOOSE * profile.n:
            break
        grid = replace(search.grid, each=min(_PARTS * search.grid.each, _FINEST))
        finer_search = replace(search, grid=grid, radius=_RADIUS, nearby=[])
        finer = finer_search.go(profile.split(loose, _PARTS), _STEPS, _FINE * close)
        if not finer.kept:
            break
        found, search = finer, finer_search
        if finer.profile.duration > (1.0 - close) * profile.duration:
            break
    return found, search


def _closed(
    task: Task, found: Look, search: Search, period: float, close: float
) -> tuple[Look, list[Settled]]:
    """The motion whose runs by a tolerance keep limits and band, and these runs of all models.

    They know nothing of how the motion was found. The nominal robot's show limits. Where they show
    modes that the search's equal steps do not resolve, it goes on in shorter ones.
    """

    def verified(one: Look, k: int) -> Settled:
        T, how = one.profile.duration, dict(task.drive)
        if task.limits.jumps:  # torques jump
            how["asked"] = ("platform",)
        motion = one.profile.motion(task.target, task.moves)
        return settled(task.models[k], motion, task.rest[k], task.band, T, period, TOL,
                       T if task.box else None, how)  # fmt: skip

    def shaking(*every: Settled) -> float:
        return 0.0 if task.box is not None else max(x.residual for x in every) / task.band

    def used(one: Look, seen: Settled) -> dict[str, float]:
        return _active(task, one.profile, seen.run)[1]

    def beyond(one: Look, seen: Settled) -> float:
        return max(used(one, seen).values(), default=0.0) - 1.0

    seen = verified(found, 0)
    while (missed := beyond(found, seen)) > _BROKEN and search.grid.each < 2 * _EACH[1]:
        parts = min(int(np.ceil((missed / found.over) ** 0.5)), _PARTS)  # an error of second order
        finer = replace(search, grid=search.grid.finer(parts), radius=RESTART, nearby=[])
        closer = finer.go(found.profile, _STEPS, close)
        if not closer.kept:
            break
        search, found, seen = finer, closer, verified(closer, 0)
    ways = [(found, [seen])]
    for _ in range(_PASSES):
        last, every = ways[-1]
        shares, shakes = used(last, every[0]), shaking(*every)
        most = 1.0 + beyond(last, every[0])
        if most <= 1.0 + _SHOWN and shakes <= 1.0:
            every += [verified(last, k) for k in range(1, len(task.models))]
            shakes = shaking(*every)
            if shakes <= 1.0:
                break
        band = task.band
        if shakes > _NEAR:  # as limits are: anew from what the last search let the motion shake
            seen_by_it = last.shake * search.task.band / last.still
            band = min(seen_by_it / shakes - _ASIDE * band, band)
        drawn_in = replace(_drawn_in(task, last, shares), band=band)
        search = replace(search, task=drawn_in, radius=_NEARBY, push=DEAR, any_kept=True)
        closer = search.go(last.profile, _CLOSER, 0.0, last.runs)
        again = verified(closer, 0)
        worse = shakes <= 1.0 and 1.0 + beyond(closer, again) > most
        if worse or shaking(again) > max(shakes, 1.0):
            break  # the band first, limits in the next pass
        ways.append((closer, [again]))
    for found, every in reversed(ways):
        every += [verified(found, k) for k in range(len(every), len(task.models))]
        if shaking(*every) <= 1.0:
            break
    return found, every


def _told(
    task: Task, found: Look, models: dict[str, Mechanism], bound: float, steps: int,
    every: list[Settled],
) -> Fastest:  # fmt: skip
    """The result, from runs of all models."""
    motion = found.profile.motion(task.target, task.moves)
    seen = dict(zip(models, every, strict=True))
    ends = None
    if task.box is not None:
        each = [
            end_of(task, model, seen[name].run, path, -1, rest)
            for (name, model), path, rest in zip(models.items(), task.rigid, task.rest, strict=True)
        ]
        far, fast = np.abs(each).max(axis=(0, 1)).tolist()
        ends = far, fast
    worst = max(seen.values(), key=lambda x: x.residual)
    runs = {name: x.run for name, x in seen.items()}
    holds, shares = _active(task, found.profile, runs["nominal"])
    return Fastest(
        task.models[0].name, task.target, task.moves, found.profile.duration,
        max(x.time for x in seen.values()), task.band, worst.residual, worst.bar, holds, shares,
        bound, task.limits, motion, runs, models, found.profile,
        str(task.models[0].description.platform), task.rest[0], steps, task.box, ends,
    )  # fmt: skip


def _drawn_in(task: Task, found: Look, shares: Mapping[str, float]) -> Task:
    """The task under limits that the finer runs keep where those of the search keep these.

    `shares`: of the limits, as the finer runs have them.
    """
    limits, seen = task.limits, _active(task, found.profile, found.runs[0])[1]

    def part(name: str) -> float:
        return seen[name] / shares[name] - _ASIDE if shares.get(name, 0.0) > _NEAR else 1.0

    names, strains = task.models[0].motors, task.strains
    most = replace(
        limits,
        speed=min(part("speed of the platform") + _ASIDE, 1.0) * limits.speed,
        torque=limits.torque * [part(f"torque of {name}") for name in names],
        stress=limits.stress * [part(f"stress of {name}") for name in task.models[0].parts],
        path=limits.path * part("distance from the path"),
        curves=tuple(reduced((x,), part(f"limit_curve of {x.name}"))[0] for x in limits.curves),
    )
    strains = None if strains is None else Strains(strains.mechanism, most, task.rigid[0])
    return replace(task, limits=most, strains=strains, over=_SHOWN + _ASIDE)


def _require_kept(task: Task, made: Fastest) -> None:
    """Refuse a motion that breaks band or limits in the finer runs that verify it."""
    where = f"{made.name}: fastest: the motion found, run again at {TOL:g},"
    if task.box is None and made.residual > task.band:
        raise ConvergenceError(
            f"{where} shakes by {1e6 * made.residual:.4g} um, {1e6 * task.band:.4g} were asked "
            "for. Give more `intervals`, or a slightly smaller `settle`."
        )
    if task.box is not None and made.ends is not None and np.any(np.array(made.ends) > task.box):
        raise ConvergenceError(
            f"{where} ends {made.ends[0]:.4g} from rest at {made.ends[1]:.4g} a second; "
            f"{task.box[0]:.4g} and {task.box[1]:.4g} were asked for. Give more `intervals`."
        )
    name, most = max(made.shares.items(), key=lambda item: item[1], default=("", 0.0))
    if most > 1.0 + _BROKEN:
        raise ConvergenceError(
            f"{where} takes {100 * most:.4g} % of the limit of {name}. Give more `intervals`, or "
            "a slightly lower limit."
        )


def _active(task: Task, profile: Profile, run: Result) -> tuple[dict[str, float], dict[str, float]]:
    """Share of the time each limit is reached in, and largest use of each."""
    limits, T = task.limits, profile.duration
    inside = run.t <= T
    t = run.t[inside]
    s, v, a = profile.at(t)
    jerk = np.abs(profile.x[: profile.n]) / T**3
    used = {"speed along the path": np.abs(v) / limits.speed,
            "acceleration along the path": np.abs(a) / limits.acceleration,
            "jerk along the path": np.repeat(jerk, 8) / limits.jerk}  # fmt: skip
    turn, torque = task.rigid[0].motor_speed(s) * v[:, None], run.torque[inside]
    used["speed of the platform"] = platform_speed(task, run, T)[1]
    if task.pushed:  # as they are asked for: a run's are read between its steps
        torque = task.rigid[0].torque(s, v, a)[0]
    for k, name in enumerate(task.models[0].motors):
        used[f"torque of {name}"] = np.abs(torque[:, k]) / limits.torque[k]
        used[f"speed of {name}"] = np.abs(turn[:, k]) / limits.motor_speed[k]
    turning = motors_of(task.models[0], run, len(torque))
    for curve in limits.curves:
        used[f"limit_curve of {curve.name}"] = curve.used(torque, *turning)
    if task.strains is not None:
        use = task.strains.use(task.strains.states_of(run))
        used |= dict(zip(task.strains.names, use.T, strict=True))
    shares = {name: float(x.max(initial=0.0)) for name, x in used.items() if np.any(x > 0.0)}
    moving = np.count_nonzero(inside)
    time = {name: float(np.mean(used[name][:moving] > 0.98)) for name in shares}
    order = sorted((name for name in time if time[name] > 0.0), key=lambda name: -time[name])
    return {name: time[name] for name in order}, shares
