"""The usual ways beside the fastest motion, under the same limits and for the same robots.

Quintic, trapezoid and jerk-limited profiles, plain and shaped by ZV, ZVD and EI, and the exact
commands of smooth ones: each as fast as its limits let it be in a run of the nominal robot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from pinflex.actuation import drive
from pinflex.description.motions import laws
from pinflex.description.motions.laws import Kinematics
from pinflex.description.motions.motion import Motion
from pinflex.description.trajectories.profiles import double_s
from pinflex.errors import ConvergenceError, DescriptionError, PinflexError
from pinflex.levels.modes import modes
from pinflex.levels.ringing import ringing
from pinflex.mechanics.mechanism import Mechanism
from pinflex.quickest.fastest import Fastest
from pinflex.quickest.limits import RigidPath, slowness
from pinflex.quickest.response import rest_of, settled
from pinflex.quickest.search import motors_of
from pinflex.results.result import Result

_COMMANDS = {"exact command, quintic": laws.quintic, "exact command, nonic": laws.nonic}
_RAMP = 1.0 / 3.0  # of a trapezoid: the fastest where torque alone is limited
_SHAPES: dict[str, Callable[[np.ndarray], Kinematics]] = {
    "quintic": laws.quintic, "trapezoid": partial(laws.trapezoid, _RAMP), **_COMMANDS,
}  # fmt: skip
PROFILES = ("quintic", "trapezoid", "jerk-limited", *_COMMANDS)
SHAPERS = ("", "zv", "zvd", "ei")
_TOL = 1e-4  # of the runs: 0.1 um of a swing of 1 mm
_SUDDEN = 1e9  # jerk over acceleration [1/s] where no jerk is limited
_PLACES = 801
_OVER, _BROKEN = 4e-4, 0.01  # of a limit: less is printed as 100.0 %; more keeps none
_TRIES = 5
_TOPS = np.linspace(0.4, 1.0, 7)  # of a top speed that are tried
_STILL = 1e-6  # of their top speed, below which the motors of a command rest


@dataclass(frozen=True)
class Baseline:
    """One usual motion.

    Attributes:
        name: Profile and shaper. ends: Of the motion [s].
        settled: Time from which every platform stays within the band [s]; inf: not in the run.
        residual: Largest distance from rest after the end, of the worst model [m].
        push: Largest torque over its limit.
        motion: It. run: Of the nominal robot. rest: Where its platform comes to rest [m], (3,).
    """

    name: str
    ends: float
    settled: float
    residual: float
    push: float
    motion: Motion
    run: Result
    rest: np.ndarray


class Baselines(tuple[Baseline, ...]):
    """The usual motions, and by name why some could not be made."""

    left_out: dict[str, str]


def baselines(
    found: Fastest,
    progress: Callable[[str], None] | None = None,
    profiles: tuple[str, ...] = PROFILES,
    shapers: tuple[str, ...] = SHAPERS,
) -> Baselines:
    """The usual motions under the limits of a fastest one, the first to be still first."""
    nominal = found.models["nominal"]
    rigid = RigidPath(nominal, found.target, found.moves, 1.0)
    heard = ringing(nominal, found.motion)
    loud = np.argsort(-heard.share)  # up to three, as a shaper of the YAML takes
    period = 1.0 / float(modes(nominal, rigid.end, count=1).frequencies[0])
    gain = np.abs(rigid.motor_speed(np.linspace(0.0, 1.0, 101))).max(axis=0)
    turning = gain > 0.0
    top = float(np.min(found.limits.motor_speed[turning] / gain[turning], initial=np.inf))
    top = _cruise(found, rigid, min(found.limits.speed, top))
    rows: list[Baseline] = []
    left_out = {}
    for kind in profiles:
        for shaper, count in _shapers(("",) if kind in _COMMANDS else shapers, len(loud)):
            name = kind + (f" + {shaper.upper()} of {count}" if shaper else "")
            (progress or (lambda line: None))(name)
            some = np.sort(loud[:count])
            cancelled = heard.frequencies[some].tolist(), heard.damping[some].tolist()

            def make(
                slower: float, kind: str = kind, shaper: str = shaper, cancelled: Any = cancelled
            ) -> Motion:
                plain = _profile(kind, found, slower, top)
                return plain.shaped(shaper, *cancelled) if shaper else plain

            try:
                rows.append(_row(name, found, make, rigid, period, kind in _COMMANDS))
            except PinflexError as failed:
                left_out[name] = str(failed)
    every = Baselines(sorted(rows, key=lambda row: (row.settled, row.residual)))
    every.left_out = left_out
    return every


def _cruise(found: Fastest, rigid: RigidPath, top: float) -> float:
    """Top speed of a jerk-limited profile: the best one, where motors are weaker when they turn."""
    best = np.inf, top
    for speed in top * _TOPS if found.limits.curves else ():
        make = partial(_profile, "jerk-limited", found, top=speed)
        try:
            slower = slowness(rigid, found.limits, found.moves, make)
        except DescriptionError:  # no acceleration is small enough for that speed
            continue
        best = min(best, (make(slower).duration, speed))
    return best[1]


def _shapers(kinds: tuple[str, ...], modes: int) -> list[tuple[str, int]]:
    """Each shaper of the loudest mode, of two and so on."""
    return [(kind, n) for kind in kinds for n in (range(1, modes + 1) if kind else (0,))]


def _row(
    name: str, found: Fastest, make: Callable[[float], Motion], rigid: RigidPath, period: float,
    followed: bool,
) -> Baseline:  # fmt: skip
    """A motion as slow as its limits ask, first of the rigid robot, then of a run.

    `followed`: what runs is the motors' motion with which the platform follows it.
    """

    def rest(model: Mechanism) -> np.ndarray:  # a command ends elsewhere: links give way at rest
        t = np.linspace(0.0, motion.duration, _PLACES)
        return rest_of(model, drive.nominal(model, motion, t).q[-1])

    nominal, room, slower = found.models["nominal"], 1.0, 1.0
    for _ in range(_TRIES):
        slower = slowness(rigid, found.limits, found.moves, make, room)
        motion = make(slower)
        motion, end = _command(nominal, motion) if followed else (motion, motion.duration)
        seen = settled(nominal, motion, rest(nominal), found.band, end, period, _TOL)
        push = float(np.max(found.limits.push(seen.run.torque, *motors_of(nominal, seen.run))))
        if push <= 1.0 + _OVER:
            break
        room /= push
    if push > 1.0 + _BROKEN:
        raise ConvergenceError(
            f"it takes {100 * push:.4g} % of a limit of torque, however it is slowed down: what it "
            "makes vibrate changes with its length."
        )
    every = [seen]
    for model in [*found.models.values()][1:]:
        every.append(settled(model, motion, rest(model), found.band, end, period, _TOL))
    residual = max(x.residual for x in every)
    still = max(x.time for x in every)
    return Baseline(name, end, still, residual, push, motion, seen.run, rest(nominal))


def _command(mechanism: Mechanism, motion: Motion) -> tuple[Motion, float]:
    """The exact command of a motion, from where motors begin to move, and when they rest again."""
    from pinflex.inversion.command import command

    found = command(mechanism, motion, limited=False)
    speed = np.abs(found.velocity)
    moving = np.flatnonzero(np.any(speed > _STILL * speed.max(axis=0), axis=1))
    begin, own = float(found.t[max(int(moving[0]) - 1, 0)]), found.motion
    corners = tuple(t - begin for t in own.corners if t > begin)
    later = replace(own, law=partial(_from, own.law, begin), duration=own.duration - begin,
                    corners=corners)  # fmt: skip
    return later, found.before - begin + motion.duration + found.actuation[1]


def _from(law: Callable[[np.ndarray], Kinematics], begin: float, t: np.ndarray) -> Kinematics:
    return law(t + begin)


def _profile(kind: str, found: Fastest, slower: float, top: float) -> Motion:
    """A plain profile; of a jerk-limited one up to a top speed, `slower` lowers accelerations."""
    names, far = tuple(found.moves), np.array([*found.moves.values()])
    corners: tuple[float, ...] = ()
    if kind == "jerk-limited":
        jerk = min(found.limits.jerk, _SUDDEN * slower**-2)
        ramps = double_s(top, slower**-2, jerk, far)
        corners = tuple(ramps.knots[1:-1].tolist())
        end = float(ramps.knots[-1])
        return Motion(kind, found.target, names, end, ramps, corners=corners)
    law = partial(laws.move, _SHAPES[kind], far, slower)
    if kind == "trapezoid":
        corners = (_RAMP * slower, (1.0 - _RAMP) * slower)
    return Motion(kind, found.target, names, slower, law, corners=corners)
