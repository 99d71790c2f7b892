"""solve(): one call from a mechanism and a motion to a Result, at any level."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.actuation.drive import Nominal, nominal
from pinflex.actuation.feedback import drives_motors
from pinflex.actuation.path import motor_axes
from pinflex.arrays import Array, distinct
from pinflex.boundary import public
from pinflex.description.blocks.control import Control
from pinflex.description.description import Description
from pinflex.description.motions.motion import Motion
from pinflex.description.solve import SolveSpec, with_options
from pinflex.errors import (
    ConvergenceError,
    DescriptionError,
    Ending,
    MotionError,
    RunInterrupted,
    SceneError,
)
from pinflex.integrators.collocation import AlphaScheme, Collocation
from pinflex.integrators.problem import Run
from pinflex.kernel.library import warn_if_missing
from pinflex.levels.modes import default_motion as default_motion
from pinflex.levels.rigid import untensioned
from pinflex.mechanics.assembly import close_loops
from pinflex.mechanics.evaluation.compiled import require_samples
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.recovery.kinematics import run_of
from pinflex.recovery.recover import recover, result_of
from pinflex.results.result import Result
from pinflex.solver import levels
from pinflex.solver.resume import grid, join, stored
from pinflex.solver.scene import Scene
from pinflex.threads import one_blas_thread

# Motions whose speed jumps inside a run: an impulse that no motor gives.
#
# In level coupled and ked motors are where their motion says; a jump of their speed strikes the
# links with the impulse that keeps all other momenta, M_ff dv_f = -M_fm dv_m, which the marches do
# not know. At the start of a run it is made (`pinflex.levels.start`).

_GRID = 2001  # instants at which a jump is looked for beside the motion's own corners
_SEEN = 1e-3  # of the top speed: a jump from here on is said (samples end at rest to about that)
_STRIKES = 1e-2  # of the top speed: a jump from here on is refused; links err by that share of it
_TABLES = (
    "sampled",
    "command",
)  # what is read off a table may end before motors rest: that is said
_BESIDE = 1e-7  # of the run: just before a corner
_HALVINGS = 40  # of the time between two instants, to the jump between them
_WAY_OUT = (
    "No motor does that, and the blow that it gives the links is not in this run. Take a motion "
    "without the jump (from rest to rest, or `until` where it ends), or solve up to there and "
    "give that run as `start` of a motion that begins there: a start makes the blow."
)


def blows(motion: Motion, until: float) -> list[str]:
    """A sentence where the speed of a motion jumps a little inside a run, else none.

    Raises:
        MotionError: It jumps by more than a hundredth of the top speed, and is no table of samples.
    """
    if not motion.names:
        return []
    ends = np.array([t for t in motion.switches if 0.0 < t < until])
    t = distinct(np.linspace(0.0, until, _GRID), ends - _BESIDE * until, ends)
    t = t[(t >= 0.0) & (t < until)]
    v, a = motion.evaluate(t)[1:]
    top = np.maximum(np.max(np.abs(v), axis=0), 1e-300)
    # what accelerations do not explain; where these jump it is of the order of the step
    left = np.abs(np.diff(v, axis=0) - 0.5 * np.diff(t)[:, None] * (a[1:] + a[:-1])) / top
    said = []
    for k in np.flatnonzero(np.max(left, axis=1, initial=0.0) > 0.5 * _SEEN):
        at, jump = _jump(motion, float(t[k]), float(t[k + 1]))
        j = int(np.argmax(np.abs(jump) / top))
        share = abs(jump[j]) / top[j]
        if share < _SEEN:
            continue
        words = (
            f"the speed of {motion.names[j]} jumps by {abs(jump[j]):.3g} (rad/s or m/s), "
            f"{100 * share:.2g} % of its top speed, at t = {at:.6g} s. {_WAY_OUT}"
        )
        if share > _STRIKES and motion.kind not in _TABLES:
            raise MotionError(words, time=at)
        said.append(words)
    return said


def too_late(description: Description, until: float) -> list[str]:
    """A sentence on loads and a payload that come only after the end of a run, else none."""
    late = [f"forces.{x.name} ({x.start:g} s)" for x in description.forces if x.start >= until]
    body = description.payload
    late += [f"payload ({body.start:g} s)"] if body is not None and body.start >= until else []
    if not late:
        return []
    return [
        f"{', '.join(late)}: not before the end of the run, {until:g} s, so without effect. Write "
        "an earlier time, or a later solve.until."
    ]


def _jump(motion: Motion, low: float, high: float) -> tuple[float, Array]:
    """Where speeds change most between two times, and by how much in no time at all."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        v = motion.evaluate(np.array([low, middle, high]))[1]
        first, second = np.abs(v[1] - v[0]).max(), np.abs(v[2] - v[1]).max()
        low, high = (low, middle) if first > second else (middle, high)
    v = motion.evaluate(np.array([low, high]))[1]
    return high, v[1] - v[0]


SAMPLES = 401
Progress = Callable[[int, int], None]


def solve_level(
    mechanism: Mechanism,
    motion: Motion | None = None,
    level: str | None = None,
    *,
    until: float | None = None,
    dt: float | None = None,
    samples: int | None = None,
    control: Control | bool | None = None,
    progress: Progress | None = None,
    resume: Result | str | Path | None = None,
    **options: Any,
) -> Result:
    """Solve a scene at one level; the arguments are those of `pinflex.advice.solve.solve`.

    Returns:
        The result. If a run stops early, the error carries `.result` up to the last good step.
    Raises:
        DescriptionError: An unknown level or option.
        MotionError, SingularityError, ConvergenceError: The scene cannot be solved.
    """
    warn_if_missing()
    tolerance = options.pop("tolerance", None)
    given = {"level": level, "until": until, "dt": dt, "samples": samples}
    spec = _spec(mechanism, {**given, **options})
    motion = motion if motion is not None else default_motion(mechanism)
    end = spec.until if spec.until is not None else motion.duration
    if not 0 < end < np.inf:
        raise DescriptionError(f"{mechanism.name}: solve.until: {end}. Give a time above 0 s.")
    with one_blas_thread():
        began = time.perf_counter()
        try:
            acting = _control(mechanism, spec, control)
            if acting is not None and acting.period is not None:
                spec = _sampled(mechanism, spec, acting, dt)
            before = None if resume is None else _before(mechanism, resume, spec, acting)
            scene = Scene(mechanism, motion, spec, acting, tolerance, before)
            # Links have momenta that a motion of the motors changes.
            led = spec.level in ("ked", "coupled") and spec.drive == "prescribed"
            struck = _struck(mechanism, motion, end) if led else []
            run = _run(scene, end, progress)
            late = too_late(mechanism.description, end)
            run = replace(run, warnings=(*run.warnings, *struck, *late))
        except (ConvergenceError, MotionError, RunInterrupted) as error:
            part, why = error.result, str(error)
            if isinstance(part, Run):
                part = sound(part if before is None else join(before, part))
                error.result = (
                    result_from(mechanism, motion, part, spec, began, stopped=why)
                    if len(part.t)
                    else None
                )
            raise
        _require_finite(mechanism, run)
        return result_from(mechanism, motion, run, spec, began)


def _struck(mechanism: Mechanism, motion: Motion, end: float) -> list[str]:
    """What `blows` says, kept with the mechanism: a look at 2001 instants costs 0.3 ms a run."""
    return mechanism.followed.jumps.get(motion, end, lambda: blows(motion, end))


def _require_finite(mechanism: Mechanism, run: Run) -> None:
    """Raise where a run that came to its end has numbers that are none."""
    for what, values in (("state", run.y), ("acceleration", run.a), ("torque", run.torque)):
        bad = ~np.isfinite(values).all(axis=1)
        if np.any(bad):
            t = float(run.t[int(np.argmax(bad))])
            raise ConvergenceError(
                f"t = {t:.6g} s: {mechanism.name}: the {what} is not finite. "
                f"{Ending.NOT_FINITE.value}",
                time=t,
                ending=Ending.NOT_FINITE,
            )


def _spec(mechanism: Mechanism, options: dict[str, Any]) -> SolveSpec:
    """What the YAML says with the options in place, as far as the mechanism can do it."""
    spec = with_options(mechanism.description.solve, options)
    _require_method(spec)
    if _collocates(spec):
        spec = (
            replace(spec, tol=spec.tol or 1e-3)
            if spec.level == "coupled"
            else replace(spec, integrator=None)
        )
    if spec.level == "coupled" and any(mechanism.description.system_damping):
        raise DescriptionError(
            f"{mechanism.name}: damping.scope: system damps the deviation from the nominal "
            "motion, which only level ked knows. Write scope: links for level coupled."
        )
    return spec


def _collocates(spec: SolveSpec) -> bool:
    """Whether the integrator that the scene names takes steps of its own length."""
    return spec.only == "coupled" or isinstance(spec.method, Collocation)


def _require_method(spec: SolveSpec) -> None:
    """Raise where an integrator given as a value is none that the level can use."""
    given = spec.method
    if given is None or isinstance(given, str | AlphaScheme | Collocation):
        return
    if not callable(given) or spec.level == "coupled":
        raise DescriptionError(
            f"solve.integrator: {spec.by_steps} at level {spec.level}. Allowed: a name, an "
            "AlphaScheme (ked, coupled), a Collocation (coupled, with tol), or at level ked a "
            "function (at, steps, dt, start) that gives the states one by one."
        )


def _control(
    mechanism: Mechanism, spec: SolveSpec, control: Control | bool | None
) -> Control | None:
    """The control that acts: only level coupled has the vibration that it feels."""
    if not isinstance(control, Control | bool | None):
        raise TypeError(f"control: {control!r}")  # said in full by the boundary
    if isinstance(control, Control) and spec.level != "coupled":
        raise DescriptionError(
            f"{mechanism.name}: a control acts at level coupled only, not at {spec.level}. Leave "
            "one of them out."
        )
    if control is False or spec.level != "coupled":
        return None
    return control if isinstance(control, Control) else mechanism.description.control


def _sampled(
    mechanism: Mechanism, spec: SolveSpec, control: Control, dt: float | None
) -> SolveSpec:
    """What to compute under a digital controller: steps that end at its instants."""
    written = control is mechanism.description.control and spec.dt is not None
    if dt is not None or written or not (spec.integrator is None or _collocates(spec)):
        raise DescriptionError(
            f"{mechanism.name}: a digital controller (control.period) acts at instants of its own, "
            "where steps end. Give a tol instead of dt, and no integrator."
        )
    drive = "torque" if drives_motors(mechanism, control) else spec.drive
    return replace(spec, dt=None, tol=spec.tol or 1e-3, drive=drive)


def _before(
    mechanism: Mechanism, resume: Result | str | Path, spec: SolveSpec, control: Control | None
) -> Run:
    if spec.level != "coupled" or spec.tol is not None or control is not None:
        raise DescriptionError(
            f"{mechanism.name}: resume: goes on with level coupled in steps (dt), without a "
            "control. Solve again from the start."
        )
    result = resume if isinstance(resume, Result) else Result.load(resume)
    try:
        return stored(mechanism, result)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise DescriptionError(
            f"{mechanism.name}: resume: what the stored run holds does not fit together "
            f"({type(error).__name__}: {error}). Solve again from the start."
        ) from error


def _run(scene: Scene, end: float, progress: Progress | None) -> Run:
    """The run of a scene from 0 to its end (s), or from where another one stopped."""
    spec, before = scene.spec, scene.before
    if before is not None:
        t = grid(before, end, scene.mechanism.name)
        dt = spec.dt if spec.dt is not None else before.settings["dt"]
        return join(before, scene.stepped(t, dt, progress))
    samples = spec.samples or SAMPLES
    require_samples(scene.mechanism, samples)
    return levels.LEVELS[spec.level](scene, np.linspace(0.0, end, samples), progress)


def sound(run: Run) -> Run:
    """The run up to its last instant with numbers that mean something."""
    states = np.concatenate([run.y, run.v, run.a, run.lam, run.torque], axis=1)
    # A state that has grown past this is on its way to infinity, not a motion in SI units.
    good = np.all(np.abs(states) < 1e9, axis=1)  # false for NaN
    return run.at(slice(0, len(good) if np.all(good) else int(np.argmin(good))))


def rigid_reference(mechanism: Mechanism, motion: Motion, run: Run) -> Nominal | None:
    """The rigid mechanism at the run's motor positions: its nominal motion, or frame by frame."""
    if run.system is mechanism.rigid or not mechanism.compliant:
        return None
    if run.path is not None:
        return run.path
    determined = mechanism.report.mobility == len(run.system.motors)
    let_go = run.system is mechanism.loose and run.system is not mechanism.flexible
    if run.settings.get("drive") != "torque" and determined and not let_go:
        return _as_far_as_it_goes(mechanism, motion, run)
    dynamics, axes = Equations(mechanism.rigid), motor_axes(mechanism)
    passive = mechanism.rigid.free
    n = int(mechanism.rigid.nq)
    q = np.empty((len(run.t), n))
    for k, y in enumerate(run.y):
        pose = mechanism.held_at_home(y[:n])
        axes.write(pose, axes.read(y[:n]))
        q[k] = close_loops(dynamics, pose, passive)[0] if dynamics.looped else pose
    empty = np.zeros((len(run.t), int(mechanism.rigid.nv)))
    return Nominal(run.t, q, empty, empty)


def _as_far_as_it_goes(mechanism: Mechanism, motion: Motion, run: Run) -> Nominal:
    """The nominal motion; where the rigid mechanism cannot follow, the run's own joints."""
    try:
        return nominal(mechanism, motion, run.t)
    except SceneError as error:
        time = error.data.get("time")
        if time is None:
            raise
        loop = error.data.get("loop")
        why = f' at a singular pose of loop "{loop}"' if loop else ""
    n, m = int(mechanism.rigid.nq), int(mechanism.rigid.nv)
    q, v, a = run.y[:, :n].copy(), run.v[:, :m].copy(), run.a[:, :m].copy()
    count = int(np.sum(run.t < time))
    if count > 1:
        known = nominal(mechanism, motion, run.t[:count])
        q[:count], v[:count], a[:count] = known.q, known.v, known.a
    said = (
        f"from t = {time:.4g} s on the rigid mechanism cannot follow the motors{why}, and the "
        "flexible one can: rigid poses are left out there, the run's own stand for them."
    )
    return Nominal(run.t, q, v, a, said)


def scene_of(mechanism: Mechanism, level: str | None = None) -> Scene:
    """What `solve_level` solves where nothing but a level is said."""
    spec = _spec(mechanism, {"level": level})
    acting = _control(mechanism, spec, None)
    if acting is not None and acting.period is not None:
        spec = _sampled(mechanism, spec, acting, None)
    return Scene(mechanism, default_motion(mechanism), spec, acting)


def result_from(
    mechanism: Mechanism,
    motion: Motion,
    run: Run,
    spec: SolveSpec,
    began: float,
    stopped: str = "",
) -> Result:
    """The result of a run."""
    run = replace(run, settings={**run.settings, "drive": spec.drive})
    lacks = untensioned(mechanism)
    if lacks and (spec.level != "rigid" or spec.drive == "torque"):
        run = replace(run, warnings=(lacks, *run.warnings))
    cost = {**run.cost, "seconds": time.perf_counter() - began}
    rigid_path = partial(rigid_reference, mechanism, motion, run)
    return result_of(mechanism, run, rigid_path, spec.level, cost, stopped)


# Every array of a stored run again, from its states.


@public
@takes_model
@one_blas_thread()
def recompute(mechanism: Mechanism, result: Result, motion: Motion | None = None) -> Result:
    """Fields of links and bodies to the last digits, which a compact file keeps to 5e-7.

        run = pf.recompute(pf.load("delta"), pf.Result.load("delta-compare/delta-coupled.npz"))

    Args:
        mechanism: The mechanism that was solved.
        result: Its run, from a file.
        motion: The motion that was solved; default: that of the YAML.
    Raises:
        DescriptionError: Another mechanism: its coordinates differ.
    """
    run = run_of(mechanism, result)
    if "energy/work" in result.arrays:
        flow = [result.array(f"energy/{part}") for part in ("work", "dissipated")]
        run = replace(run, work=np.column_stack(flow))
    moved = default_motion(mechanism) if motion is None else motion
    arrays = recover(mechanism, run, rigid_reference(mechanism, moved, run))
    meta = {key: value for key, value in result.meta.items() if key != "rounded"}
    return Result(result.t, {**result.arrays, **arrays}, meta)
