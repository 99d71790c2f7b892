"""What the model of a run leaves out: measured against a richer one by a cheap look at both.

The richer model has every plane, stretch and twist, second-order terms, shear and rotary inertia
and twice the segments in each link (`finer_model`). Both models are looked at along the whole
motion by linear vibration, twice corrected for what is not linear (pinflex.advice.probe), on the
same instants, so that what the look itself misses is missed twice and cancels; what a shifted
frequency makes of a long vibration is in it. Steps are halved until the difference settles. Where
it does not, or no cheap look describes the motion, the richer model is run (`richer_run`). The
error bar is twice the difference. Nothing is paid before it is asked for.
"""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from pinflex.advice.probe import Probe
from pinflex.advice.reduced_models import PLANES, SAFETY, Errors, beams, enlarged
from pinflex.arrays import Array
from pinflex.description.motions.laws import PLATFORM_COORDINATES
from pinflex.description.motions.motion import Motion
from pinflex.errors import ConvergenceError, DescriptionError, PinflexError
from pinflex.integrators.problem import Run
from pinflex.levels.ked import Response
from pinflex.levels.outputs import OUTPUTS, ROUND_OFF, output_differences, pose_of
from pinflex.levels.quasistatic_smooth import solve_equilibria
from pinflex.levels.start import in_equilibrium
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.parts import FlexiblePart
from pinflex.progress import Callback
from pinflex.recovery.recover import result_of
from pinflex.results.error_bars import NOT_MEASURED, ErrorBars, time_error
from pinflex.results.result import Result
from pinflex.rotations import zyx_angles
from pinflex.solver.solve import solve_level
from pinflex.threads import one_blas_thread

# The scene with more in it than it has: what the error of a model is measured against.

_WORDS = {0: "more modes", 1: "one more segment"}
_THICK = ("shear", "rotary_inertia")
_CELLS = 0.6  # of their length: two thirds of an error of second order go, for 5 times the cells
_SMOOTHER = "half the speed that smooths friction"
_MORE_MODES = 6  # of a solid: the next six tell what all others leave, to a third


def finer_model(mechanism: Mechanism) -> tuple[Mechanism, str]:
    """The scene with all deformations, second order and twice the segments; and what that is.

    Of solids with more modes, and with shorter cells where pinflex makes the mesh; pins that rub in
    their holes smoothly below half the speed.
    """
    failed: PinflexError | None = None
    rubs = list(_smoother(mechanism))
    for changes, words in _richer(mechanism):
        said = ", ".join(filter(None, [words, _SMOOTHER if rubs else ""]))
        try:
            more, n = enlarged(mechanism, [*changes, *rubs])
            if more is not None:
                return more, f"{said}: {n} coordinates"
        except PinflexError as error:
            failed = error
    raise failed or DescriptionError("a richer model is too large")


def _smoother(mechanism: Mechanism) -> Iterator[str]:
    """Changes that halve the speed below which the friction of pins in their holes is smooth."""
    hinges = mechanism.description.blocks().get("joints") or {}
    for loop in mechanism.description.loops:
        law = loop.friction
        if loop.clearance is not None and law is not None and law.dry:
            at, values = "joints" if loop.name in hinges else "loops", asdict(law)
            values["speed"] *= 0.5
            told = ", ".join(f"{key}: {x!r}" for key, x in values.items() if key != "viscous")
            yield f"{at}.{loop.name}.friction={{{told}}}"


def _richer(mechanism: Mechanism) -> Iterator[tuple[list[str], str]]:
    """Changes of the YAML and what they are: from the richest on to what most scenes can take."""
    cut, solid = beams(mechanism), solids(mechanism)
    own, words = _of_solids(solid)
    if not cut:
        yield own, words
        return
    # Shapes that move at the root, under a sleeve, take one segment only.
    most = max(part.spec.segments for part in cut)  # twice as many, else one more, else none
    rungs = [(more, True) for more in sorted({most, 1, 0}, reverse=True)]
    if all(map(_more_shapes, cut)):
        rungs.append((0, False))  # where all planes with all modes would be too much
    for (more, planes), thick in itertools.product(rungs, (True, False)):
        changes = list(own)
        for part in cut:
            at = f"flexible.{part.link}"
            changes += [f"{at}.{key}=true" for key, _ in PLANES.values() if planes]
            added = min(more, part.spec.segments)
            changes += [f"{at}.second_order=true", f"{at}.segments={part.spec.segments + added}"]
            changes += [f"{at}.{key}=true" for key in _THICK] if thick else []
            changes += [] if more else _more_shapes(part)
        said = [words, _WORDS.get(more, "twice the segments"), "second order"]
        said[-1] += ", stretch and twist" if planes else " in the planes that it has"
        yield changes, ", ".join(filter(None, [*said, "shear and rotary inertia" if thick else ""]))


def _more_shapes(part: FlexiblePart) -> list[str]:
    """A richer basis of one segment: half as many modes more where these converge slowly."""
    basis, at = part.spec.basis, f"flexible.{part.link}.basis"
    if basis.kind == "craig_bampton":
        return [f"{at}.internal={basis.internal + 1}"]
    if basis.kind == "assumed":
        return [f"{at}.modes={basis.modes + max(1, basis.modes // 2)}"]
    return []


def solids(mechanism: Mechanism) -> list[FlexiblePart]:
    """The links of meshes and matrices."""
    return [p for p in mechanism.parts.values() if p.spec.basis.solid]


def _of_solids(found: list[FlexiblePart]) -> tuple[list[str], str]:
    """Changes that refine solids, and what they are."""
    changes, meshed = [], []
    for part in found:
        basis, at = part.spec.basis, f"flexible.{part.link}.basis"
        changes.append(f"{at}.modes={basis.modes + _MORE_MODES}")
        if basis.rod:
            size = basis.size or min(d for d, _ in basis.rod)
            changes.append(f"{at}.size={_CELLS * size!r}")
            meshed.append(part.link)
    if not found:
        return changes, ""
    if len(meshed) == len(found):
        return (
            changes,
            f"cells of {_CELLS:g} of the length and {_MORE_MODES} more modes of each solid",
        )
    return changes, f"{_MORE_MODES} more modes of each solid (meshes of a file as they are)"


# A run of a richer model beside a run: what the model leaves out where no cheap look tells it.
#
# Motors that push, controls, freedoms that nothing determines, long or fast vibration and motion
# far from linear vibration: there the richer model is solved at the same instants, and every output
# is compared. Where the difference is below the run's error of time it tells that error; then both
# models are run again to a finer tolerance.

_TOL = 1e-3  # of time of the richer run, at the least: what a model leaves out is larger
_LONGEST = 30.0  # s of computing: a richer run that takes more is given up
_OF_THE_METHOD = (
    *("tol", "dt", "samples", "until", "integrator", "rho_inf", "newmark", "ked", "asked", "level"),
)
_FINER = 0.1  # of the tolerance: where the error of time hides what the model leaves out


def run_difference(
    result: Result,
    mechanism: Mechanism,
    finer: Mechanism,
    motion: Motion,
    options: Mapping[str, Any],
    static: bool,
) -> dict[str, float]:
    """Largest differences of a run from one of a richer model, by output, relative.

    Raises:
        ConvergenceError: The richer run takes too long, or does not come to its end.
    """
    loose, settings = free(finer), result.meta["settings"]
    rigid = None
    if not loose and settings.get("drive") == "torque":  # it knows where its motors went, not meant
        n, until = len(result.t), float(result.t[-1])
        rigid = solve_level(mechanism, motion, "rigid", samples=n, until=until, drive="prescribed")
    richer = richer_run(result, finer, motion, options, static)
    found = output_differences(result, richer, loose, rigid=rigid)
    of_time, _ = time_error(settings, result.level)
    if result.level == "coupled" and any(e < of_time.get(key, 0.0) for key, e in found.items()):
        with contextlib.suppress(PinflexError):  # below what time integration can reach
            tol = _FINER * min(float(settings.get("tol", _TOL)), _TOL)
            a, b = (richer_run(result, x, motion, options, static, tol) for x in (mechanism, finer))
            return output_differences(a, b, loose, rigid=rigid)
    return found


def richer_run(
    result: Result,
    finer: Mechanism,
    motion: Motion,
    options: Mapping[str, Any],
    static: bool,
    tol: float | None = None,
) -> Result:
    """A run of a richer model at the instants of another; arguments as of `run_difference`.

    `tol`: Of time; None: that of the run, or less.
    """
    given = {k: x for k, x in options.items() if k not in _OF_THE_METHOD and x is not None}
    if tol is None:
        tol = min(float(result.meta["settings"].get("tol", _TOL)), _TOL)
    start = "static" if static else "straight"
    if static and result.level != "quasistatic":  # auto leaves out loads that come and go
        start = options.get("start") or finer.description.solve.start
    keys = {**given, "start": start, "until": float(result.t[-1]), "tol": tol}
    return solve_level(finer, motion, "coupled", samples=len(result.t), progress=patient(), **keys)


def patient() -> Callback:
    """What gives a run up that takes too long."""
    began = time.process_time()

    def watch(step: int, steps: int) -> None:
        if time.process_time() - began > _LONGEST:
            raise ConvergenceError(f"its run takes more than {_LONGEST:g} s")

    return watch


def free(mechanism: Mechanism) -> bool:
    """Whether joints move that motors do not determine: no rigid motion to deviate from."""
    return mechanism.report.mobility != len(mechanism.rigid.motors)


OF_POSES = ("torque", "motor force", "deflection", "platform position", "platform rotation")
_INSTANTS = 161  # at which they are compared: some ten in each period that a march resolves
_CONTRACTION = 0.7  # corrections that shrink by less say nothing,
_SMALL = 1e-3  # unless they are so small beside the deviation
_SETTLED, _FAINT = 0.25, 1e-6  # of a difference: what half the steps may change; below it nothing
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
    if not (mechanism.parts or any(_smoother(mechanism))):
        return "no link is flexible"
    if "parts" in result.meta.get("settings", {}):
        return "single histories part at contacts, of one model too"
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

    def measured(coarse: bool = False) -> Errors:
        with one_blas_thread():
            return _looks(mechanism, finer, motion, end, static, result.level, coarse)[2]

    cheap = not _only_by_a_run(mechanism, settings, options)
    if cheap:
        with contextlib.suppress(PinflexError, np.linalg.LinAlgError):
            found = measured()
    if found is None:
        try:
            found = run_difference(result, mechanism, finer, motion, options, static)
            what = f"a run with {what}"
        except (PinflexError, np.linalg.LinAlgError):
            if not cheap:
                raise
            found = measured(coarse=True)
    return {key: max(SAFETY * e, ROUND_OFF) for key, e in found.items()}, f"against {what}"


def _only_by_a_run(
    mechanism: Mechanism, settings: Mapping[str, Any], options: Mapping[str, Any]
) -> bool:
    """Whether a scene cannot be looked at cheaply."""
    spec, control = mechanism.description.solve, options.get("control")
    return bool(
        settings.get("drive", spec.drive) == "torque"
        or (mechanism.description.control if control is None else control)
        or options.get("start_speeds")
        or spec.start_speeds
        or settings.get("clearances")  # a look knows ideal joints only
        or mechanism.flexible.loads.timed  # what a blow rings first is too fast for a look
        or free(mechanism)
    )


def covering(error: Errors, apart: Errors) -> Errors:
    """Error bars that cover a measured difference of the whole model too."""
    return {key: max(e, SAFETY * apart.get(key, 0.0)) for key, e in error.items()}


@dataclass(frozen=True)
class Look:
    """A model at a level, looked at along a motion.

    Attributes:
        probe: Of the model. run: Its motion at the instants that are compared. some: Those.
    """

    probe: Probe
    run: Run
    some: slice

    @cached_property
    def result(self) -> Result:
        """All outputs of the run."""
        return self._of(self.run, "probe")

    @cached_property
    def rigid(self) -> Result:
        """Those of the rigid motion."""
        return self._of(self.probe.rigid().at(self.some), "rigid")

    def _of(self, run: Run, level: str) -> Result:
        path = partial(self.probe.path.at, self.some)
        return result_of(self.probe.mechanism, run, path, level, {}, "")


def look(probe: Probe, motion: Motion, level: str = "coupled") -> Look:
    """A model at a level, at some of the instants of its probe."""
    some = compared(probe)
    return Look(probe, _at_level(probe, motion, level).at(some), some)


def compared(probe: Probe) -> slice:
    """The instants of a probe at which models are compared."""
    return slice(None, None, max(1, (probe.steps - 1) // (_INSTANTS - 1)))


def differences(a: Look, b: Look, of: Sequence[str] = OF_POSES) -> Errors:
    """Largest differences of one look from another, by output."""
    found = output_differences(a.result, b.result, of=of, rigid=b.rigid)
    return {key: found[key] for key in of if key in found}


def _looks(
    mechanism: Mechanism,
    finer: Mechanism,
    motion: Motion,
    end: float,
    static: bool,
    level: str,
    coarse: bool = False,
) -> tuple[Look, Look, Errors]:
    """A level of one model and all of another, at the same instants; and how far they differ.

    Steps are right where half as many tell nearly the same: what a look misses of a vibration is
    missed by both models, but not where they ring at other frequencies.

    Raises:
        ConvergenceError: It is too long, or, unless it may be `coarse`, no steps settle it.
    """
    probe = Probe(mechanism, motion, end, static)
    if probe.first * end > _PERIODS:
        raise ConvergenceError("it is long beside its first natural period")
    before: Errors = {}
    for share in (0.5, 1.0, 2.0):
        own = probe if share == 1.0 else Probe(mechanism, motion, end, static, probe, share)
        small = look(own, motion, level)
        large = look(Probe(finer, motion, end, static, own), motion)
        found = differences(small, large, OUTPUTS)
        apart = [abs(e - before.get(k, np.inf)) > _SETTLED * e + _FAINT for k, e in found.items()]
        if not any(apart):
            return small, large, found
        before = found
    if not coarse:
        raise ConvergenceError("its vibration is too fast for the steps of a look")
    return small, large, found


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
            small, large, _ = _looks(
                mechanism, finer, motion, motion.duration, True, "coupled", run is None
            )
            return pose_of(small.result), pose_of(large.result)
    except (PinflexError, np.linalg.LinAlgError):
        if run is None:
            raise
    return pose_of(run), pose_of(richer_run(run, finer, motion, {}, True))


def described(probe: Probe) -> Response:
    """The vibration, corrected twice: where deflections settle, stiff modes may still run away."""
    march, once, twice = probe.marched(2)
    for of_march, of_once, of_twice in (
        (march.d, once.d, twice.d), (march.v, once.v, twice.v), (march.a, once.a, twice.a)
    ):  # fmt: skip
        first, second, size = (
            float(np.max(np.abs(x), initial=0.0))
            for x in (of_once - of_march, of_twice - of_once, of_twice)
        )
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
