"""A run within a tolerance: refined until two runs in a row agree on what was asked.

The error of an output is its largest difference over the samples, relative to the largest value it
takes; of the platform's pose, relative to its largest deviation from the rigid motion. The finer
run is answered; what it differs from the coarser one by, divided by what refining gains, is its
estimated error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array
from pinflex.description.motion import Motion
from pinflex.description.supplement import ASKED
from pinflex.errors import ConvergenceError, SceneError
from pinflex.levels.run import Run
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.stacked import Stacked
from pinflex.solver.timed import Progress, Scene, default_step

_SAMPLES = 51  # instants at which poses are compared: the samples, or every k-th of more
_PILOT = 0.1  # resolution of a run that tells how far the mechanism moves, to a hundredth
_LOCAL = 2.0  # resolution of the first run over tol^1.5: where it serves, the next one is the last
_ROUNDS = 8
_FAILURES = 2  # runs that may break off, or change more than the last, before it is given up


def within(scene: Scene, t: Array, tol: float, progress: Progress | None = None) -> Run:
    """The run at samples t (s) within a relative error tol.

    Level coupled goes by Radau IIA collocation, a sixteenth of the resolution at a time, or by a
    member of the alpha family that is asked for (`paced`); level ked and a control in equal steps
    (`halved`).
    """
    # Level ked is linear: equal steps keep its matrices. A control has a sampling period.
    if scene.spec.level == "ked" or scene.control is not None:
        return halved(scene, t, tol, progress)
    if scene.spec.integrator not in (None, "radau"):
        return paced(scene, t, tol, progress)

    # The resolution falls with the power of the stages, 6, of the step: a sixteenth of it costs six
    # tenths more steps, and two runs so far apart tell errors well. In a smooth motion it brings
    # far more than threefold; a faint vibration that both leave unresolved makes them agree better
    # than they should, so that less is trusted.
    def attempt(resolution: float, coarser: Run | None) -> Run:
        return scene.resolved(t, resolution, progress, coarser, pilot=coarser is None)

    return _refine(scene, t, tol, attempt, 8.0 * tol, 16.0, 3.0)


def halved(scene: Scene, t: Array, tol: float, progress: Progress | None = None) -> Run:
    """By equal steps, half as long every time; methods of order 2."""
    # Errors of a step of 1/40 of a period are near 1e-3.
    first = default_step(scene.mechanism, float(t[-1] - t[0])) * min(1.0, (tol / 1e-3) ** 0.5)
    return _refine(scene, t, tol, lambda dt, _: scene.stepped(t, dt, progress), first, 2.0, 3.0)


def paced(scene: Scene, t: Array, tol: float, progress: Progress | None = None) -> Run:
    """By steps of the alpha family that follow the motion, with an eighth of the local error.

    A local error falls with h^3, that of a run with h^2.
    """

    def attempt(resolution: float, coarser: Run | None) -> Run:
        pilot = coarser or scene.resolved(t, _PILOT, progress, pilot=True, alpha=True)
        run = scene.resolved(t, resolution, progress, pilot, alpha=True)
        spent = {} if coarser else pilot.cost
        return replace(run, cost={k: n + spent.get(k, 0.0) for k, n in run.cost.items()})

    return _refine(scene, t, tol, attempt, _LOCAL * tol**1.5, 8.0, 3.0)


def _refine(
    scene: Scene,
    t: Array,
    tol: float,
    attempt: Callable[[float, Run | None], Run],
    first: float,
    ratio: float,
    gain: float,
) -> Run:
    """Runs at first, first/ratio, ... until the estimate is half of tol; gain: what one brings."""
    compare = Outputs(scene.mechanism, scene.motion, t, scene.spec.asked or ASKED)
    size, cost, failures, worse, worst = first, dict[str, float](), 0, 0, np.inf
    coarse: Run | None = None
    runs = 0
    while runs <= _ROUNDS:
        runs += 1
        try:
            fine = attempt(size, coarse)
        except ConvergenceError:
            # Where steps that are too long break off, shorter ones may pass.
            failures += 1
            if failures > _FAILURES:
                raise
            size, coarse = size / ratio, None
            continue
        for key, count in fine.cost.items():
            cost[key] = cost.get(key, 0.0) + count
        if coarse is not None:
            changes = compare.differences(coarse, fine)
            error = {key: e / gain for key, e in changes.items()}
            settings = {**fine.settings, "tol": tol, "error": error}
            fine = replace(fine, settings=settings, cost={**cost, "last_steps": fine.cost["steps"]})
            before, worst = worst, max(error.values(), default=0.0)
            if worst <= 0.5 * tol:
                return fine
            worse += worst > before
            if worse > _FAILURES:
                break
        size, coarse = size / ratio, fine
    where = max(error, key=lambda key: error[key])
    failed = ConvergenceError(
        f"{scene.mechanism.name}: tol = {tol:g} not reached: {where} still changes by "
        f"{worst:.2g} after {runs} runs. Give a larger tol, start=static, or damping "
        "for what rings; error.result holds the last run."
    )
    failed.result = fine
    raise failed


class Outputs:
    """What a tolerance is about: torques, elastic coordinates and the platform's pose."""

    def __init__(
        self,
        mechanism: Mechanism,
        motion: Motion,
        t: Array,
        asked: Sequence[str] = ASKED,
        dynamics: Dynamics | None = None,
    ) -> None:
        self._asked, self._dynamics = asked, dynamics  # a new workspace is dear in large models
        self._mechanism, self._motion, self._t = mechanism, motion, t
        self._keep = slice(None, None, -(-len(t) // _SAMPLES))
        self._rigid: tuple[Array, Array] | None = None
        self._before: tuple[Run, tuple[Array, Array]] | None = None

    def differences(self, coarse: Run, fine: Run) -> dict[str, float]:
        """Relative difference of two runs at the same samples, by output."""
        found = {}
        if "torque" in self._asked:
            found["torque"] = relative(coarse.torque, fine.torque)
        n = int(fine.system.rigid.nq)
        if fine.system.n_eta and "deflection" in self._asked:
            found["deflection"] = relative(coarse.y[:, n:], fine.y[:, n:])
        if not found:  # rigid links driven by torque: nothing else moves
            found["joint speeds"] = relative(coarse.v, fine.v)
        platform = self._mechanism.description.platform is not None
        gives_way = fine.system.n_eta or len(self._mechanism.rigid.held)
        if platform and "platform" in self._asked and gives_way:
            p, R = self._poses(coarse)
            p_fine, R_fine = self._poses(fine)
            p_rigid, R_rigid = self._rigid_poses(fine)
            scale = np.abs(p_fine - p_rigid).max(), np.abs(between(R_rigid, R_fine)).max()
            apart = np.abs(p - p_fine).max(), np.abs(between(R, R_fine)).max()
            for key, a, s in zip(("platform position", "platform rotation"), apart, scale,
                                 strict=True):  # fmt: skip
                # Below a nanometre and a nanoradian there is no deviation to speak of.
                found[key] = float(a / s) if s > 1e-9 else 0.0
        return found

    def _poses(self, run: Run) -> tuple[Array, Array]:
        if self._before is not None and self._before[0] is run:
            return self._before[1]
        dynamics = self._dynamics or Dynamics(run.system)
        poses = platform_poses(self._mechanism, dynamics, run.y[self._keep])
        self._before = run, poses
        return poses

    def _rigid_poses(self, run: Run) -> tuple[Array, Array]:
        """Of the rigid motion; where it is not known, the first pose of the run."""
        if self._rigid is None:
            dynamics, q = Dynamics(self._mechanism.rigid), None
            try:
                q = nominal(self._mechanism, self._motion, self._t).q[self._keep]
            except SceneError:
                q = np.tile(run.y[:1, : int(run.system.rigid.nq)], (len(self._t[self._keep]), 1))
            self._rigid = platform_poses(self._mechanism, dynamics, q)
        return self._rigid


def platform_poses(mechanism: Mechanism, dynamics: Dynamics, y: Array) -> tuple[Array, Array]:
    """Position (m), shape (n, 3), and rotation (n, 3, 3) of the platform at poses y (n, nq)."""
    model, data = dynamics.model, dynamics.data
    frame = model.getFrameId(mechanism.description.platform, pin.FrameType.BODY)
    p, R = np.empty((len(y), 3)), np.empty((len(y), 3, 3))
    still = np.zeros((len(y), dynamics.system.nv))
    for k, q in enumerate(Stacked(dynamics, len(y)).expanded(y, still, still)[0]):
        pin.forwardKinematics(model, data, q)
        pose = pin.updateFramePlacement(model, data, frame)
        p[k], R[k] = pose.translation, pose.rotation
    return p, R


def relative(a: Array, b: Array) -> float:
    """Largest difference of two histories over the largest value of the second."""
    scale = float(np.max(np.abs(b), initial=0.0))
    return float(np.max(np.abs(a - b), initial=0.0)) / scale if scale > 0 else 0.0


def between(a: Array, b: Array) -> Array:
    """Rotation vectors from a to b, shape (n, 3): small ones, by their skew part."""
    turn = np.matmul(a.transpose(0, 2, 1), b)
    skew = turn - turn.transpose(0, 2, 1)
    return 0.5 * np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
