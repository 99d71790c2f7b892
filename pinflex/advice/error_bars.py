"""What the model of a run leaves out: measured against a richer one by a cheap look at both.

The richer model has every plane, stretch and twist, second-order terms and one more segment in each
link (one more mode where segments would be too many). Both models are looked at along the whole
motion by linear vibration that is twice corrected for what is not linear (pinflex.advice.probe), on
the same instants, so that what the look itself misses is missed twice and cancels; what a shifted
frequency makes of a long vibration is in it. The error bar is twice the difference. Nothing is paid
before it is asked for.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pinflex.actuation.nominal import Nominal
from pinflex.advice.probe import Deviation, Probe
from pinflex.advice.reduced_models import LARGEST, PLANES, SAFETY, Errors, beams
from pinflex.arrays import Array
from pinflex.description.motion import Motion
from pinflex.errors import ConvergenceError, PinflexError
from pinflex.integrators.run import Run
from pinflex.levels.outputs import ROUND_OFF, STILL, between, relative
from pinflex.levels.quasistatic_smooth import solve_equilibria
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.mechanics.parts import resolve
from pinflex.recovery.recover import result_of
from pinflex.results.error_bars import NOT_MEASURED, ErrorBars, time_error
from pinflex.results.result import Result
from pinflex.threads import one_blas_thread

_INSTANTS = 161  # at which they are compared: some ten in each period that a march resolves
_CONTRACTION = 0.7  # corrections that shrink by less say nothing,
_SMALL = 1e-3  # unless they are so small beside the deviation
_QUASISTATIC = 1e-6  # tolerance of the equilibria that a quasistatic run is judged by


def error_bars(result: Result, mechanism: Mechanism, motion: Motion, static: bool) -> ErrorBars:
    """Both errors of a result of `solve`.

    Args:
        result: The run. mechanism, motion: Of it. static: Whether it started in equilibrium.
    """
    time, how = time_error(result.meta.get("settings", {}), result.level)
    end = float(result.t[-1])
    model, note = model_error(mechanism, motion, end, static, result.level)
    return ErrorBars(time, model, how, note)


def model_error(
    mechanism: Mechanism, motion: Motion, end: float, static: bool, level: str = "coupled"
) -> tuple[Errors, str]:
    """What a level of a scene leaves out by output, relative; and against what, or why not.

    Args:
        mechanism: Mechanism.
        motion: What it is to do.
        end: Last time [s].
        static: Whether it starts in equilibrium.
        level: Level whose error is asked for.
    """
    why = not_probed(mechanism)
    if why:
        return {}, f"{NOT_MEASURED}: {why}"
    try:
        finer, what = finer_model(mechanism)
        found = apart(mechanism, finer, motion, end, static, level)
    except (PinflexError, np.linalg.LinAlgError) as failed:
        return {}, f"{NOT_MEASURED}: a cheap look does not describe this motion ({failed})"
    return {key: max(SAFETY * e, ROUND_OFF) for key, e in found.items()}, f"against {what}"


def not_probed(mechanism: Mechanism) -> str:
    """Why a scene cannot be looked at cheaply, "" if it can."""
    if not mechanism.parts:
        return "no link is flexible"
    if mechanism.description.solve.drive == "torque":
        return "the motors push (drive: torque)"
    if mechanism.description.control is not None:
        return "a control feeds vibration back"
    if mechanism.report.mobility != len(mechanism.rigid.motors):
        return "the motors do not determine the motion"
    if any(mechanism.description.system_damping):
        return "damping.scope: system is known to ked only"
    return ""


def finer_model(mechanism: Mechanism) -> tuple[Mechanism, str]:
    """The scene with all deformations, second order and more segments; and what that is.

    Raises:
        DescriptionError: There is no such model.
    """
    for more in (1, 0):  # shapes that move at the root, under a sleeve, take one segment only
        changes = []
        for part in beams(mechanism):
            at = f"flexible.{part.link}"
            changes += [f"{at}.{key}=true" for key, _ in PLANES.values()]
            changes += [f"{at}.second_order=true", f"{at}.segments={part.spec.segments + more}"]
            if not more and part.spec.basis.kind == "craig_bampton":
                changes.append(f"{at}.basis.internal={part.spec.basis.internal + 1}")
        try:
            description = mechanism.description.with_overrides(changes)
            parts = resolve(description, mechanism.links)
            n = sum(body.n for part in parts.values() for body in part.bodies)
            if n <= LARGEST or not more:
                finer = load(description)
                break
        except PinflexError:
            if not more:
                raise
    words = "one more segment" if more else "one more mode"
    return finer, f"{words}, second order, stretch and twist: {n} coordinates"


def covering(error: Errors, apart: Errors) -> Errors:
    """Error bars that cover a measured difference of the whole model too.

    Args:
        error: Bars. apart: Differences measured.
    """
    return {key: max(e, SAFETY * apart.get(key, 0.0)) for key, e in error.items()}


def apart(
    mechanism: Mechanism,
    finer: Mechanism,
    motion: Motion,
    end: float,
    static: bool,
    level: str = "coupled",
    like: Probe | None = None,
) -> Errors:
    """Largest differences of a level of one model from all of another, by output.

    Args:
        mechanism: The model in question.
        finer: The other one.
        motion: What both are to do.
        end: Last time [s].
        static: Whether they start in equilibrium.
        level: Level of the model in question.
        like: A probe of the same motion, that has marched.
    Raises:
        ConvergenceError: Linear vibration does not describe the motion.
    """
    with one_blas_thread():
        small = Probe(mechanism, motion, end, static, like=like)
        mine = _at_level(small, motion, level)
        large = Probe(finer, motion, end, static, small.steps - 1, like=small)
        full = _at_level(large, motion, "coupled")
        some = slice(None, None, max(1, (len(mine.t) - 1) // (_INSTANTS - 1)))
        runs = (small, mine), (large, full), (small, small.rigid())
        a, b, rigid = (_result(probe, run.at(some), some) for probe, run in runs)
        return differences(a, b, rigid, bool(finer.description.platform))


def described(probe: Probe) -> Deviation:
    """The vibration, corrected twice.

    Raises:
        ConvergenceError: The corrections do not shrink.
    """
    march = probe.march()
    once = probe.corrected(march)
    twice = probe.corrected(once)
    first, second = (float(np.max(np.abs(x.d - y.d), initial=0.0)) for x, y in
                     ((once, march), (twice, once)))  # fmt: skip
    size = float(np.max(np.abs(twice.d), initial=0.0))
    if not second <= max(_CONTRACTION * first, _SMALL * size):
        raise ConvergenceError("it is far from linear vibration about the rigid motion")
    return twice


def _at_level(probe: Probe, motion: Motion, level: str) -> Run:
    if level == "rigid":
        return probe.rigid()
    if level == "quasistatic":
        run = solve_equilibria(probe.mechanism, motion, probe.t, _QUASISTATIC)
        return replace(run, settings={})
    if level == "ked":
        return probe.linear(probe.march())
    return probe.nonlinear(described(probe))


def _result(probe: Probe, run: Run, some: slice) -> Result:
    def path() -> Nominal:
        return probe.path.at(some)

    return result_of(probe.mechanism, run, path, "probe", {}, "")


def differences(a: Result, b: Result, rigid: Result, platform: bool) -> Errors:
    """Largest differences of what two results report, relative as in `pinflex.levels.outputs`.

    Args:
        a: Judged. b: By this one, at the same instants. rigid: Their rigid motion.
        platform: Whether they have one.
    """
    found: Errors = {}
    if a.torque.shape[1] and np.any(b.torque):
        found["torque"] = relative(a.torque, b.torque)
    bent = [_deflections(a, b, link) for link in b.links]
    scale = max((float(np.max(np.abs(y), initial=0.0)) for _, y in bent), default=0.0)
    if scale > 0:
        found["deflection"] = max(float(np.max(np.abs(x - y), initial=0.0)) for x, y in bent)
        found["deflection"] /= scale
    stresses = [(_peaks(a, link), _peaks(b, link)) for link in b.links]
    scale = max((float(np.max(y)) for _, y in stresses), default=0.0)
    if scale > 0:
        found["stress"] = max(float(np.max(np.abs(x - y))) for x, y in stresses) / scale
    if platform:
        found |= _platform(a, b, rigid)
    return found


def _platform(a: Result, b: Result, rigid: Result) -> Errors:
    """Differences of the platform's pose, relative to its largest deviation from rigid."""
    p, p_b, p_r = (x.frame("platform").position for x in (a, b, rigid))
    R, R_b, R_r = (x.frame("platform").rotation for x in (a, b, rigid))
    pairs = {
        "platform position": (np.abs(p - p_b).max(), np.abs(p_b - p_r).max()),
        "platform rotation": (np.abs(between(R, R_b)).max(), np.abs(between(R_r, R_b)).max()),
    }
    return {key: float(e / s) for key, (e, s) in pairs.items() if s > STILL}


def _deflections(a: Result, b: Result, link: str) -> tuple[Array, Array]:
    """Deflections of a link at the sections that both report, shape (nt, k, 3)."""
    theirs = b.link(link)
    at = theirs.deflection[:, :, :3]
    if link not in a.links:
        return 0.0 * at, at
    mine = a.link(link)
    near = [int(np.argmin(np.abs(theirs.x - x))) for x in mine.x]
    same = [k for k, j in enumerate(near) if abs(theirs.x[j] - mine.x[k]) < 1e-6 * theirs.length]
    return mine.deflection[:, same, :3], at[:, [near[k] for k in same]]


def _peaks(run: Result, link: str) -> Array:
    """Largest von Mises stress along a link, shape (nt,)."""
    if link not in run.links:
        return np.zeros(len(run.t))
    return np.asarray(run.link(link).von_mises.max(axis=1))
