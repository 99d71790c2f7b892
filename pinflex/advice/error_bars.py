"""What the model of a run leaves out: measured against a richer one by a cheap look at both.

The richer model has every plane, stretch and twist, second-order terms, shear and rotary inertia
and twice the segments in each link (`pinflex.advice.finer`). Both models are looked at along the
whole motion by linear vibration, twice corrected for what is not linear (pinflex.advice.probe), on
the same instants, so that what the look itself misses is missed twice and cancels; what a shifted
frequency makes of a long vibration is in it. Where no cheap look describes the motion, or its steps
do not resolve the third mode, the richer model is run (`pinflex.advice.second_run`). The error bar
is twice the difference. Nothing is paid before it is asked for.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from pinflex.advice.finer import finer_model
from pinflex.advice.probe import RESOLVED, Deviation, Probe
from pinflex.advice.reduced_models import SAFETY, Errors
from pinflex.advice.second_run import (
    links_apart,
    platform_acceleration,
    pose_of,
    richer_run,
    run_apart,
    shared,
)
from pinflex.arrays import Array
from pinflex.description.motion import Motion
from pinflex.description.motion_keys import PLATFORM_COORDINATES
from pinflex.errors import ConvergenceError, PinflexError
from pinflex.integrators.run import Run
from pinflex.levels.outputs import ROUND_OFF, STILL, between, platform_poses, relative
from pinflex.levels.quasistatic_smooth import solve_equilibria
from pinflex.levels.start import in_equilibrium
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.recover import result_of
from pinflex.recovery.sections import deflections
from pinflex.results.error_bars import NOT_MEASURED, ErrorBars, time_error
from pinflex.results.result import Result
from pinflex.rotations import zyx_angles
from pinflex.threads import one_blas_thread

_INSTANTS = 161  # at which they are compared: some ten in each period that a march resolves
_CONTRACTION = 0.7  # corrections that shrink by less say nothing,
_SMALL = 1e-3  # unless they are so small beside the deviation
_TOLD = (
    *("torque", "deflection", "stress", "section forces", "platform position"),
    *("platform rotation", "platform acceleration"),
)
_PERIODS = 40.0  # of the first mode in a run: a look at more resolves none of them well
_GIVEN = ("run", "state")  # starts that the undeformed mechanism, or equilibrium, tells nothing of
_QUASISTATIC = 1e-6  # tolerance of the equilibria that a quasistatic run is judged by


def error_bars(
    result: Result, mechanism: Mechanism, motion: Motion, options: Mapping[str, Any]
) -> ErrorBars:
    """Both errors of a result of `solve`."""
    settings = result.meta.get("settings", {})
    time, how = time_error(settings, result.level)
    why = _not_measured(result, mechanism)
    model: Errors = {}
    if not why:
        try:
            model, note = _model_error(result, mechanism, motion, options)
            return ErrorBars(time, model, how, note)
        except (PinflexError, np.linalg.LinAlgError) as failed:
            why = str(failed)
    return ErrorBars(time, {}, how, f"{NOT_MEASURED}: {why}")


def _not_measured(result: Result, mechanism: Mechanism) -> str:
    """Why nothing tells what a model leaves out, "" if something does."""
    if not mechanism.parts:
        return "no link is flexible"
    if result.meta.get("status") == "stopped":
        return "the run stopped"
    if result.meta.get("settings", {}).get("start") in _GIVEN:
        return "the run starts from a given state"
    if any(mechanism.description.system_damping):
        return "damping.scope: system is known to ked only"
    return ""


def _model_error(
    result: Result, mechanism: Mechanism, motion: Motion, options: Mapping[str, Any]
) -> tuple[Errors, str]:
    """What the model of a run leaves out by output, relative; and against what that is."""
    settings, end = result.meta.get("settings", {}), float(result.t[-1])
    start = settings.get("start", mechanism.description.solve.start)
    static = in_equilibrium(mechanism, start)[0] or result.level == "quasistatic"
    finer, what = finer_model(mechanism)
    found: Errors | None = None

    def looked(coarse: bool = False) -> Errors:
        with one_blas_thread():
            return _apart(*_looks(mechanism, finer, motion, end, static, result.level, coarse))

    cheap = not _only_by_a_run(mechanism, settings, options)
    if cheap:
        with contextlib.suppress(PinflexError, np.linalg.LinAlgError):
            found = looked()
    if found is None:
        try:
            found = run_apart(result, mechanism, finer, motion, options, static)
            what = f"a run with {what}"
        except (PinflexError, np.linalg.LinAlgError):
            if not cheap:
                raise
            found = looked(coarse=True)
    return {key: max(SAFETY * e, ROUND_OFF) for key, e in found.items()}, f"against {what}"


def _only_by_a_run(
    mechanism: Mechanism, settings: Mapping[str, Any], options: Mapping[str, Any]
) -> bool:
    """Whether a scene cannot be looked at cheaply."""
    spec, control = mechanism.description.solve, options.get("control")
    acting = control if control is not None else mechanism.description.control
    return bool(
        settings.get("drive", spec.drive) == "torque"
        or acting
        or options.get("start_speeds")
        or spec.start_speeds
        or mechanism.report.mobility != len(mechanism.rigid.motors)
    )


def covering(error: Errors, apart: Errors) -> Errors:
    """Error bars that cover a measured difference of the whole model too."""
    return {key: max(e, SAFETY * apart.get(key, 0.0)) for key, e in error.items()}


@dataclass(frozen=True)
class Seen:
    """A model at a level, looked at along a motion.

    Attributes:
        probe: Of the model. run: Its motion at the instants that are compared. some: Those.
    """

    probe: Probe
    run: Run
    some: slice

    @cached_property
    def deflections(self) -> dict[str, tuple[Array, Array]]:
        """By link: sections (nx,) and how far they move, (n, nx, 3)."""
        return deflections(self.probe.dynamics, self.run.y)

    @cached_property
    def platform(self) -> tuple[Array, Array]:
        """Positions (n, 3) and rotations (n, 3, 3)."""
        return platform_poses(self.probe.mechanism, self.probe.dynamics, self.run.y)

    @cached_property
    def rigid_platform(self) -> tuple[Array, Array]:
        """The same of the rigid motion."""
        y = self.probe.rigid().y[self.some]
        return platform_poses(self.probe.mechanism, self.probe.dynamics, y)

    @cached_property
    def result(self) -> Result:
        """All outputs of the run."""
        path = partial(self.probe.path.at, self.some)
        return result_of(self.probe.mechanism, self.run, path, "probe", {}, "")


def look(probe: Probe, motion: Motion, level: str = "coupled") -> Seen:
    """A model at a level, at some of the instants of its probe.

    Raises:
        ConvergenceError: Linear vibration does not describe the motion.
    """
    some = compared(probe)
    return Seen(probe, _at_level(probe, motion, level).at(some), some)


def compared(probe: Probe) -> slice:
    """The instants of a probe at which models are compared."""
    return slice(None, None, max(1, (probe.steps - 1) // (_INSTANTS - 1)))


def _apart(small: Seen, large: Seen) -> Errors:
    """Largest differences of one look from another, by output."""
    found = links_apart(small.result, large.result) | differences(small, large)
    found |= platform_acceleration(small.result, large.result)
    return {key: found[key] for key in _TOLD if key in found}


def _looks(
    mechanism: Mechanism,
    finer: Mechanism,
    motion: Motion,
    end: float,
    static: bool,
    level: str,
    coarse: bool = False,
) -> tuple[Seen, Seen]:
    """A level of one model and all of another, at the same instants.

    Raises:
        ConvergenceError: It is too long, or, unless it may be `coarse`, not resolved.
    """
    probe = Probe(mechanism, motion, end, static)
    if probe.first * end > _PERIODS:
        raise ConvergenceError("it is long beside its first natural period")
    if not coarse and probe.seen < RESOLVED:
        raise ConvergenceError("it is long beside its third natural period")
    small = look(probe, motion, level)
    probe = Probe(finer, motion, end, static, small.probe.steps - 1, like=small.probe)
    return small, look(probe, motion)


def platform_bar(
    mechanism: Mechanism, names: Sequence[str], motion: Motion, run: Result | None = None
) -> tuple[Array, str]:
    """Bar on platform coordinates, for what a model leaves out of a motion from equilibrium.

    Returns:
        Bars [m | rad], shape (k,), and against what; NaN where nothing tells, and why.
    """
    if not mechanism.parts:
        return np.full(len(names), np.nan), f"{NOT_MEASURED}: no link is flexible"
    try:
        finer, what = finer_model(mechanism)
        a, b = _poses(mechanism, finer, motion, run)
    except (PinflexError, np.linalg.LinAlgError) as failed:
        return np.full(len(names), np.nan), f"{NOT_MEASURED}: {failed}"
    turned = (zyx_angles(a[1]) - zyx_angles(b[1]) + np.pi) % (2.0 * np.pi) - np.pi
    away = np.concatenate([a[0] - b[0], turned], axis=1)
    columns = [PLATFORM_COORDINATES.index(name) for name in names]
    return SAFETY * np.max(np.abs(away[:, columns]), axis=0), f"against {what}"


def _poses(
    mechanism: Mechanism, finer: Mechanism, motion: Motion, run: Result | None
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Positions (n, 3) and rotations (n, 3, 3) of the platform in two models."""
    try:
        with one_blas_thread():
            small, large = _looks(
                mechanism, finer, motion, motion.duration, True, "coupled", run is None
            )
            return small.platform, large.platform
    except (PinflexError, np.linalg.LinAlgError):
        if run is None:
            raise
    return pose_of(run), pose_of(richer_run(run, finer, motion, {}, True))


def described(probe: Probe) -> Deviation:
    """The vibration, corrected twice.

    Raises:
        ConvergenceError: The corrections do not shrink.
    """
    march, once, twice = probe.marched(2)
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


def differences(a: Seen, b: Seen) -> Errors:
    """Largest differences of what two models do, relative as in `pinflex.levels.outputs`."""
    found: Errors = {}
    if a.run.torque.shape[1] and np.any(b.run.torque):
        found["torque"] = relative(a.run.torque, b.run.torque)
    mine, theirs = {}, {}
    for link, (at, moved) in b.deflections.items():
        mine[link], theirs[link] = 0.0 * moved, moved
        if link in a.deflections:
            x, own = a.deflections[link]
            same, near = shared(x, at)
            mine[link], theirs[link] = own[:, same], moved[:, near]
    scale, far = _largest(mine, theirs)
    if scale > 0:
        found["deflection"] = far / scale
    return found | (_platform(a, b) if b.probe.mechanism.description.platform else {})


def _largest(a: Mapping[str, Array], b: Mapping[str, Array]) -> tuple[float, float]:
    """Largest value of the second, and difference of the first, which may lack links."""
    scale = max((float(np.max(np.abs(y), initial=0.0)) for y in b.values()), default=0.0)
    pairs = ((a.get(link, 0.0 * y), y) for link, y in b.items())
    return scale, max((float(np.max(np.abs(x - y), initial=0.0)) for x, y in pairs), default=0.0)


def _platform(a: Seen, b: Seen) -> Errors:
    """Differences of the platform's pose, relative to its largest deviation from rigid."""
    (p, R), (p_b, R_b), (p_r, R_r) = a.platform, b.platform, a.rigid_platform
    pairs = {
        "platform position": (np.abs(p - p_b).max(), np.abs(p_b - p_r).max()),
        "platform rotation": (np.abs(between(R, R_b)).max(), np.abs(between(R_r, R_b)).max()),
    }
    return {key: float(e / s) for key, (e, s) in pairs.items() if s > STILL}
