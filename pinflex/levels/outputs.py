"""What a run is judged by: how far two runs of one system differ, output by output.

The difference of an output is its largest one over the samples, relative to the largest value it
takes; of the platform's pose, relative to its largest deviation from the rigid motion. Forces of
motors that slide are an output of their own beside torques of those that turn. Torques that dry
friction makes jump differ by their root mean square: a jump an instant later is no error. An
output that is zero throughout (the torque of no motor, a platform that does not turn) is left out:
nothing can be said of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinflex.actuation.drive import Nominal, nominal_of
from pinflex.arrays import Array, BoolArray, IntArray
from pinflex.description.motions.motion import Motion
from pinflex.description.solve import ASKED
from pinflex.errors import SceneError
from pinflex.integrators.problem import Run
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_poses
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.system import System
from pinflex.mechanics.model.tree import sliding
from pinflex.results.result import Result

_SAMPLES = 51  # instants at which poses are compared: so many samples at least, if there are
ROUND_OFF = 1e-10  # relative: no estimate is smaller, for the sums of thousands of steps are not
# m or rad: below, there is no deviation to speak of.
STILL = 1e-9
REST = 1e-12  # m or rad
# Outputs that are nothing to speak of below this, m or rad: so small a deflection is the round-off
# of a link that is pressed between fixed ends.
LEAST_SIZES = dict.fromkeys(("joint positions", "platform position", "platform rotation"), STILL)
LEAST_SIZES |= dict.fromkeys(("deflection", "gear deflection"), 1e-15)
# Of the largest of all motors: forces of motors that idle beside others that turn are round-off.
_IDLE = 1e-3


_Poses = tuple[Array, Array]  # positions (n, 3) in m and rotations (n, 3, 3)


class History(NamedTuple):
    """Distance of two runs in an output over time.

    Attributes:
        at: Samples, counted from the first of the runs, shape (k,).
        apart: Distance there. size: Of the finer run.
    """

    at: IntArray
    apart: Array
    size: Array

    def upto(self, sample: int) -> History:
        """What lies before a sample."""
        kept = self.at < sample
        return self if kept.all() else History(self.at[kept], self.apart[kept], self.size[kept])


class Outputs:
    """What a tolerance is about: torques, deflections of links and gears, the platform's pose."""

    def __init__(
        self,
        mechanism: Mechanism,
        motion: Motion,
        t: Array,
        asked: Sequence[str] = ASKED,
        dynamics: Equations | None = None,
        of: tuple[Array, IntArray] | None = None,
    ) -> None:
        """`of`: times of which the samples are those with some numbers."""
        self._of = (t, np.arange(len(t))) if of is None else of
        self._asked, self._dynamics = asked, dynamics  # a new workspace is dear in large models
        self._mechanism, self._motion, self._t = mechanism, motion, t
        self._every = max(1, len(t) // _SAMPLES)
        self._rigid: _Poses | None = None
        self._before: tuple[Run, _Poses] | None = None

    def at(self, some: IntArray) -> Outputs:
        """The same at some of the samples."""
        given = self._mechanism, self._motion, self._t[some], self._asked, self._dynamics
        return Outputs(*given, (self._of[0], self._of[1][some]))

    def differences(self, coarse: Run, fine: Run) -> dict[str, float]:
        """Relative difference of two runs at the same samples, by output."""
        if np.ptp(fine.y, axis=0).max(initial=0.0) < REST:
            return {}  # at rest: round-off is all that differs
        found = {
            key: relative_size(key, history.apart, history.size)
            for key, history in self.histories(coarse, fine).items()
        }
        if "torque" in found and fine.system.sticks(fine.settings.get("drive") != "torque"):
            least = _IDLE * float(np.sqrt(np.mean(np.square(fine.torque))))
            for key, at in self._motors.items():
                found[key] = mean_square(coarse.torque[:, at], fine.torque[:, at], least)
        if self._swings(fine) or not any(found.values()):
            joints = self._joints(coarse, fine, fine.y[0])
            found |= {key: relative_size(key, h.apart, h.size) for key, h in joints.items()}
        return {key: error for key, error in found.items() if error is not None}

    def sizes(self, run: Run) -> dict[str, float]:
        """Largest values of the outputs, of the platform its deviation from the rigid motion."""
        every = self.histories(run, run).items()
        return {key: float(np.max(history.size, initial=0.0)) for key, history in every}

    def histories(
        self,
        coarse: Run,
        fine: Run,
        from_sample: int | None = 0,
        first: Array | None = None,
    ) -> dict[str, History]:
        """Distance of two runs and size of the finer run over time, by output asked for."""
        found: dict[str, History] = {}
        system, elastic = fine.system, fine.system.n_eta
        if "torque" in self._asked and fine.torque.shape[1]:
            apart, every = coarse.torque - fine.torque, _IDLE * fine.torque
            for key, at in self._motors.items():
                size = np.hstack([fine.torque[:, at], every])
                found[key] = _history(apart[:, at], size)
        if elastic and "deflection" in self._asked:
            mine, theirs = bent(coarse.system, coarse.y), bent(system, fine.y)
            found |= {key: _history(mine[key] - x, x) for key, x in theirs.items()}
        if self.about_platform(system):
            found |= self._platform(coarse, fine, from_sample, first)
        if first is not None and (self._swings(fine) or not found):
            found |= self._joints(coarse, fine, first)
        return found

    @cached_property
    def _motors(self) -> dict[str, BoolArray]:
        slides = sliding(self._mechanism.rigid.rigid)
        return motor_outputs([name in slides for name in self._mechanism.motors])

    def about_platform(self, system: System) -> bool:
        """Whether the pose of a platform that gives way is asked for."""
        gives_way = system.n_eta or len(self._mechanism.rigid.held)
        named = self._mechanism.description.platform
        return bool(named and gives_way and "platform" in self._asked)

    def _swings(self, run: Run) -> bool:
        """Whether joints move that motors and motion do not determine."""
        return (
            self._mechanism.report.mobility != len(run.system.motors)
            or run.settings.get("drive") == "torque"
        )

    def _joints(self, coarse: Run, fine: Run, first: Array) -> dict[str, History]:
        """Of the positions of all joints, over their largest way from the first, and speeds."""
        rigid = fine.system.rigid
        nq, nv = int(rigid.nq), int(rigid.nv)
        pairs = zip(coarse.y[:, :nq], fine.y[:, :nq], strict=True)
        # Steps may hold no sample, and robots no joint: rows without any keep their width.
        shape = len(fine.y), nv
        apart = np.array([pin.difference(rigid, a, b) for a, b in pairs]).reshape(shape)
        way = np.array([pin.difference(rigid, first[:nq], q) for q in fine.y[:, :nq]])
        way = way.reshape(shape)
        return {
            "joint positions": _history(apart, way),
            "joint speeds": _history(coarse.v[:, :nv] - fine.v[:, :nv], fine.v[:, :nv]),
        }

    def _platform(
        self, coarse: Run, fine: Run, from_sample: int | None, first: Array | None
    ) -> dict[str, History]:
        every = slice(None)
        keep = (
            every if from_sample is None else slice(-from_sample % self._every, None, self._every)
        )
        (p, R), (p_fine, R_fine) = self._poses(coarse, fine, keep)
        if from_sample is None:
            return {
                "platform position": _history(p - p_fine, 0.0 * p, keep),
                "platform rotation": _history(between(R, R_fine), 0.0 * p, keep),
            }
        at = slice(-(-from_sample // self._every), None)
        system, first = fine.system, fine.y[0] if first is None else first
        p_rigid, R_rigid = (part[at][: len(p)] for part in self._rigid_poses(system, first))
        return {
            "platform position": _history(p - p_fine, p_fine - p_rigid, keep),
            "platform rotation": _history(between(R, R_fine), between(R_rigid, R_fine), keep),
        }

    def _poses(self, coarse: Run, fine: Run, keep: slice) -> tuple[_Poses, _Poses]:
        """Of the platform in two runs, the first of which may have been the second one before."""
        if coarse.system is not fine.system:  # such as other modes: no workspace serves both
            first, last = (
                platform_poses(self._mechanism, Equations(run.system), run.y[keep])
                for run in (coarse, fine)
            )
            return first, last
        before, y = self._before, fine.y[keep]
        n, known = len(y), before is not None and before[0] is coarse
        if not known:
            y = np.concatenate([coarse.y[keep], y])
        p, R = np.zeros((0, 3)), np.zeros((0, 3, 3))
        if len(y):
            p, R = platform_poses(self._mechanism, self._dynamics or Equations(fine.system), y)
        last = p[len(p) - n :], R[len(p) - n :]
        self._before = fine, last
        return (before[1] if known and before is not None else (p[:n], R[:n])), last

    @cached_property
    def reference(self) -> Nominal | None:
        """Rigid motion at the instants at which poses are compared; None where there is none."""
        try:
            t, some = self._of
            return nominal_of(self._mechanism, self._motion, t, some[:: self._every])
        except SceneError:
            return None

    def _rigid_poses(self, system: System, first: Array) -> _Poses:
        """Of the rigid motion; where it is not known, the first pose of the run."""
        if self._rigid is None:
            known, asked = self._mechanism.followed.platforms, self._t[:: self._every].tobytes()
            self._rigid = known.find(self._motion, asked)
        if self._rigid is None:
            n, count = int(system.rigid.nq), len(self._t[:: self._every])
            y, rigid = np.zeros((count, system.nq)), self.reference
            y[:, :n] = first[:n] if rigid is None else rigid.q
            self._rigid = platform_poses(self._mechanism, self._dynamics or Equations(system), y)
            if rigid is not None:
                known.keep(self._motion, asked, self._rigid)
        return self._rigid


def bent(system: System, y: Array) -> dict[str, Array]:
    """How far links [m] and gears [rad | m] give way at poses y (n, nq), by output.

    Not the elastic coordinates of links: these have units and scales of their own.
    """
    of, eta = system.expansion, y[:, int(system.rigid.nq) :]
    found = dict[str, Array]()
    if len(of.sections):
        found["deflection"] = eta @ of.sections.T
    if of.drives:
        found["gear deflection"] = eta[:, -len(of.drives) :]
    return found


def motor_outputs(slides: Sequence[bool]) -> dict[str, BoolArray]:
    """Which motors an output is of: newtons have an error of their own beside newton metres."""
    force = np.array(slides, dtype=bool)
    if force.all() or not force.any():
        return {"torque": np.ones_like(force)}
    return {"torque": ~force, "motor force": force}


def platform_poses(mechanism: Mechanism, dynamics: Equations, y: Array) -> tuple[Array, Array]:
    """Position (m), shape (n, 3), and rotation (n, 3, 3) of the platform at poses y (n, nq)."""
    platform = dynamics.system.expansion.frames[str(mechanism.description.platform)]
    R, p = frame_poses(dynamics, y, platform)
    return p, R


def relative_size(key: str, apart: Array, size: Array) -> float | None:
    """Largest distance over the largest size of an output, or None where nothing can be said."""
    scale = float(np.max(size, initial=0.0))
    far = float(np.max(apart, initial=0.0))
    if key in LEAST_SIZES:
        return far / scale if scale > LEAST_SIZES[key] else None
    if scale > 0.0:
        return far / scale
    return None if far == 0.0 else np.inf


def _history(apart: Array, size: Array, keep: slice = slice(None)) -> History:
    """Of distances and sizes (k, n), at every sample or at those of a slice."""
    step = keep.step or 1
    at = (keep.start or 0) + step * np.arange(len(apart))
    return History(at, *(np.abs(x).max(axis=1, initial=0.0) for x in (apart, size)))


def relative(a: Array, b: Array) -> float:
    """Largest difference of two histories over the largest value of the second."""
    scale = float(np.max(np.abs(b), initial=0.0))
    apart = float(np.max(np.abs(a - b), initial=0.0))
    return apart / scale if scale > 0 else np.inf if apart > 0 else 0.0


def mean_square(a: Array, b: Array, least: float = 0.0) -> float | None:
    """Root mean square of a difference over that of the second, at least `least`; None: zero."""
    if not (np.any(b) or np.any(a)):
        return None
    size = max(float(np.sqrt(np.mean(np.square(b)))), least)
    return float(np.sqrt(np.mean(np.square(a - b)))) / size if size > 0 else np.inf


def between(a: Array, b: Array) -> Array:
    """Rotation vectors from a to b, shape (n, 3): small ones, by their skew part."""
    turn = np.matmul(a.transpose(0, 2, 1), b).reshape(-1, 9)
    return np.asarray(0.5 * (turn[:, (7, 2, 3)] - turn[:, (5, 6, 1)]))


# How far two results differ: also in what takes a pass over the samples, as forces and stresses do.

_OF_LINKS: Any = {
    "deflection": lambda link: link.deflection[:, :, :3],
    "stress": lambda link: link.von_mises,
    "section forces": lambda link: link.resultant,
}
_OF_PARTS = {"section forces": (slice(0, 3), slice(3, 6))}  # N, N m
_OF_POSE = ("platform position", "platform rotation")
OUTPUTS = ("torque", "motor force", *_OF_LINKS, *_OF_POSE, "platform acceleration")
_SECTION = 1e-6  # of the length: sections so near are one


def output_differences(
    a: Result,
    b: Result,
    free: bool = False,
    of: Sequence[str] | None = None,
    rigid: Result | None = None,
) -> dict[str, float]:
    """Largest differences of outputs of two results at the same instants, relative.

    `free`: there is no rigid motion to deviate from. `of`: the outputs that are compared; None:
    all, and where these are zero, speeds of joints. `rigid`: that motion, for platforms of which
    results do not know where it has them: on flexible links, and of motors that push, which a
    result takes where they went.
    """
    keys, found = OUTPUTS if of is None else of, dict[str, float | None]()
    if a.torque.shape[1] and "torque" in keys:
        slides = [b.unit(f"torque/{motor}") == "N" for motor in b.motors]
        for key, at in motor_outputs(slides).items():
            least = _IDLE * float(np.max(np.abs(b.torque), initial=0.0))
            found[key] = _ratio([a.torque[:, at]], [b.torque[:, at]], least)
    found |= _of_links(a, b, [key for key in _OF_LINKS if key in keys])
    platform = b.meta.get("platform")
    if platform and {*keys} & {*_OF_POSE}:
        found |= _of_platform(a, b, None if free else _rigid_pose(b if rigid is None else rigid))
    if platform and "platform acceleration" in keys:
        x, y = (run.array(f"frame/{platform}/acceleration")[:, :3] for run in (a, b))
        found["platform acceleration"] = _ratio([x], [y])
    if of is None and not any(found.values()):
        found["joint speeds"] = _ratio([a.array("joint/v")], [b.array("joint/v")])
    return {key: e for key, e in found.items() if e is not None}


def _of_links(a: Result, b: Result, keys: Sequence[str]) -> dict[str, float]:
    """Of deflection, stress and section forces, at the sections that both have."""
    found: dict[str, float] = {}
    values: dict[str, tuple[list[Array], list[Array]]] = {key: ([], []) for key in keys}
    for name in b.links:
        theirs = b.link(name)
        mine = a.link(name) if name in a.links else None
        own, at = shared(theirs.x if mine is None else mine.x, theirs.x)
        for key, pair in values.items():
            pick = _OF_LINKS[key]
            y = pick(theirs)[:, at]
            pair[0].append(0.0 * y if mine is None else pick(mine)[:, own])
            pair[1].append(y)
    for key, (x, y) in values.items():
        for part in _OF_PARTS.get(key, (slice(None),)):
            cut = (..., part) if key in _OF_PARTS else ...
            e = _ratio([v[cut] for v in x], [v[cut] for v in y])
            if e is not None:
                found[key] = max(found.get(key, 0.0), e)
    return found


def _rigid_pose(run: Result) -> tuple[Array, Array] | None:
    """`pose_of` the rigid mechanism; None: the run does not know it."""
    if run.level == "rigid":
        return pose_of(run)
    if (name := run.meta["platform"]) not in run.meta["bodies"]:
        return None
    pose = run.array(f"body/{name}/pose_rigid")
    return pose[:, :, 3], pose[:, :, :3]


def _of_platform(a: Result, b: Result, rigid: tuple[Array, Array] | None) -> dict[str, float]:
    """Of the platform's pose, relative to its largest deviation from rigid, or from its first."""
    (p, R), (p_b, R_b) = pose_of(a), pose_of(b)
    p_r, R_r = (p_b[:1], R_b[:1]) if rigid is None else rigid
    pairs = {
        "platform position": (np.abs(p - p_b).max(), np.abs(p_b - p_r).max()),
        "platform rotation": (
            np.abs(between(R, R_b)).max(),
            np.abs(between(np.broadcast_to(R_r, R_b.shape), R_b)).max(),
        ),
    }
    return {key: float(e / s) for key, (e, s) in pairs.items() if s > STILL}


def pose_of(run: Result) -> tuple[Array, Array]:
    """Positions (n, 3) [m] and rotations (n, 3, 3) of the platform in a run."""
    name = run.meta["platform"]
    return run.array(f"frame/{name}/position"), run.array(f"frame/{name}/rotation")


def shared(x: Array, at: Array) -> tuple[list[int], list[int]]:
    """Numbers of the sections that are among others, and which of those they are."""
    near = np.argmin(np.abs(at[:, None] - x), axis=0)
    same = np.flatnonzero(np.abs(at[near] - x) < _SECTION * at[-1])
    return same.tolist(), near[same].tolist()


def _ratio(a: list[Array], b: list[Array], least: float = 0.0) -> float | None:
    """Largest difference over the largest value of the second, at least `least`; None: zero."""
    scale = max((float(np.max(np.abs(y), initial=0.0)) for y in b), default=0.0)
    scale = max(scale, least)
    scale = scale if scale > REST else 0.0  # round-off
    apart = (float(np.max(np.abs(x - y), initial=0.0)) for x, y in zip(a, b, strict=True))
    return max(apart, default=0.0) / scale if scale > 0.0 else None
