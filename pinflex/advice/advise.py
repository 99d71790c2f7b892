"""What a scene needs: level, links, planes, modes, segments and tolerance, with error bars.

Everything is measured on the motion itself by cheap runs of a model richer than the scene's
(`reduced_models`): every plane, stretch, twist, term, one more mode. Rigid torques, the
balance of every instant, the linear vibration and smaller models are held against its linear
vibration, twice corrected for what is not linear (`probe`); a short coupled run holds that to the
full equations. Where corrections hardly change anything, models are compared without. At the end
the model that is proposed is held against one of all that and one more segment in each link
(`error_bars`). An error bar is twice what was measured, and what the corrections leave: of time
integration and of the model; errors are relative, as in levels.outputs.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from pinflex.advice import error_bars
from pinflex.advice import reduced_models as fewer
from pinflex.advice.error_bars import finer_model
from pinflex.advice.probe import RESOLVED, Probe
from pinflex.advice.reduced_models import SAFETY, Advice, Errors, LeftOut
from pinflex.boundary import public
from pinflex.description.motions.motion import Motion
from pinflex.description.solve import ASKED
from pinflex.errors import ConvergenceError, DescriptionError, PinflexError, SceneError, nearest
from pinflex.integrators.problem import Run
from pinflex.levels.modes import default_step
from pinflex.levels.outputs import STILL, Outputs
from pinflex.levels.quasistatic_smooth import solve_equilibria
from pinflex.levels.start import in_equilibrium
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.progress import Progress, barred, callback
from pinflex.results.verdict import BAND, TOL, platform_allowed
from pinflex.solver.scene import Scene
from pinflex.solver.solve import default_motion
from pinflex.solver.tolerance import solve_to_tolerance
from pinflex.text import percent
from pinflex.threads import one_blas_thread

_CONTRACTION = 0.7  # corrections that shrink by less say nothing
_WITHIN = 0.1  # of the tolerance: that of the runs that the probes are held against
_WINDOW = 8  # the coupled run that verifies covers this part of the time
_STILL = 0.03  # of the tolerance: that of a quasistatic run, which hardly costs more for it
# Modes beyond the last one tried, together: 9/16 + 9/25 + ... of what the third brings where their
# parts fall with the square of their number, as those of a load along a beam. Where twice the
# segments are looked at, they are measured.
_TAIL = 3.0
_MENDED = 0.35  # of what one more segment mends is left: bodies are right to second order
_WORTH = 0.7  # of the error bar: segments that leave more do not pay
_NEXT_TO_NOTHING = 0.02  # of what is allowed: the model that is left is as good as the richer one
_RUN = 0.125  # of the tolerance: that of the run that is proposed, whose bar is twice as much
_DOUBT = 0.25  # of the tolerance: where the estimate is off by more, whole runs are taken
# Of what is allowed: where corrections change no more of an output, prices go without them, which
# saves half of the marches and all residuals. That much of the largest price they miss at most.
_LINEAR = 0.1
# Times as long as a coupled run quasistatic may take: it has no vibration to resolve or to doubt,
# and no proposal may hang on what a clock says of runs that cost much the same.
_DEARER = 2.0
_LOOKS = 5  # stages that are told
_BY_A_RUN = "no cheap look tells what the model leaves out: that run tells its own error bars"
_UNTRIED = "more segments were not tried, and are not in the bars"


@public
@takes_model
@barred
def advise(
    mechanism: Mechanism,
    motion: Motion | None = None,
    *,
    tol: float = TOL,
    band: float = BAND,
    asked: Sequence[str] = (),
    until: float | None = None,
    fixed: bool = False,
    progress: Progress = None,
) -> Advice:
    """Propose level, links, planes, modes and tolerance for a scene.

    Args:
        mechanism: From `load`. motion: Default: the motion of the YAML.
        tol: Error that each output may have, relative to its largest value; of the platform, to
            its largest deviation from the rigid motion.
        band: Error of the platform that does no harm [m], as of `compare`.
        asked: Of torque, deflection and platform; default: the YAML's `solve.asked`, or what
            `compare` judges by: torque and platform.
        until: End [s]; default: the YAML's, or the motion's duration.
        fixed: Take the flexible links as they are: propose level and tolerance only.
        progress: True: a bar; or a function called with (step, steps) between the looks.
    Returns:
        The advice.
    Raises:
        DescriptionError: An unknown output or a tolerance outside 1e-6 to 0.1.
        MotionError, SingularityError: The nominal motion does not exist.
    """
    began, spec = time.perf_counter(), mechanism.description.solve
    asked = _checked(tuple(asked) or spec.asked or _judged(mechanism), tol)
    stepless = ("solve.dt=null",) if spec.dt is not None else ()  # beside tol it is refused
    n = mechanism.flexible.n_eta
    plain = Advice(mechanism.name, tol, asked, band=band, run_tol=_RUN * tol, coordinates=(n, n, n),
                   error=dict.fromkeys(asked, np.inf))  # fmt: skip
    if any(mechanism.description.system_damping):
        why = "damping.scope: system is known to ked only; no error bar can be had"
        return replace(plain, level="ked", why=why, overrides=stepless)
    only = _only_coupled(mechanism)
    if only:
        return replace(plain, why=only, overrides=stepless, notes=(_BY_A_RUN,))
    if not mechanism.compliant:
        exact = dict.fromkeys(asked, 0.0)
        return replace(plain, level="rigid", run_tol=None, error=exact, why="nothing is flexible")
    motion = motion if motion is not None else default_motion(mechanism)
    end = until or spec.until or motion.duration
    rich, note = (mechanism, "") if fixed else fewer.richer(mechanism)
    with one_blas_thread():
        tell = callback(progress) or (lambda step, steps: None)
        found = _Study(rich, motion, end, plain, tell).advice(mechanism, fixed)
    notes = (note, *found.notes) if note else found.notes
    if found.run_tol is not None:
        found = replace(found, overrides=(*found.overrides, *stepless))
    return replace(found, notes=notes, seconds=time.perf_counter() - began)


def _checked(asked: tuple[str, ...], tol: float) -> tuple[str, ...]:
    """The outputs asked for; raises where one is not known, or a tolerance is out of range."""
    for name in asked:
        if name not in ASKED:
            raise DescriptionError(f"asked: {name}: no such output.{nearest(name, ASKED)}")
    if not 1e-6 <= tol <= 0.1:
        raise DescriptionError(f"tol: {tol}. Give a relative error, 1e-6 to 0.1.")
    return asked


def _judged(mechanism: Mechanism) -> tuple[str, ...]:
    """What `compare` judges levels by; all outputs where it judges by none."""
    motors, platform = len(mechanism.rigid.motors) > 0, bool(mechanism.description.platform)
    there = {"torque": motors, "platform": platform}
    return tuple(name for name, is_there in there.items() if is_there) or ASKED


def _only_coupled(mechanism: Mechanism) -> str:
    """Why no level but coupled applies, "" if others do."""
    if mechanism.description.solve.drive == "torque":
        return "the motors push (drive: torque): only coupled lets them feel the links"
    if mechanism.description.control is not None:
        return "a control feeds vibration back, which only coupled has"
    if mechanism.flexible.added.instants:
        return "a payload comes or goes, of which no error bar of the other levels knows"
    if mechanism.report.mobility != len(mechanism.rigid.motors) or len(mechanism.idle.base):
        return "the motors do not determine the motion: only coupled lets the rest swing"
    return ""


def _worst(error: Errors) -> float:
    """The largest of some errors."""
    return max(error.values(), default=0.0)


class _Study:
    """The probes of one scene."""

    def __init__(
        self,
        rich: Mechanism,
        motion: Motion,
        end: float,
        plain: Advice,
        tell: Callable[[int, int], None],
    ) -> None:
        self._tell = tell
        self.rich, self.motion, self.plain, self.tol = rich, motion, plain, plain.tol
        static, _ = in_equilibrium(rich, rich.description.solve.start)
        self.probe = Probe(rich, motion, end, static)
        self.outputs = Outputs(
            self.probe.mechanism, motion, self.probe.t, plain.asked, self.probe.dynamics
        )
        self.notes = self._doubts()
        self.fast: Errors = {}  # what a coupled run of the first part shows beyond the probes
        self.linear = False  # where corrections hardly change anything
        self.by_runs = False  # where the probes miss too much
        self.corrections = 1  # of the motions of smaller models
        self.tail: Errors = {}  # of the modes beyond the last one tried
        self.doubts: Errors = {}  # where that is more than expected

    def advice(self, mechanism: Mechanism, fixed: bool) -> Advice:
        """The level first; then, where links bend at all, what they can do without."""
        try:
            once, ked, levels, seconds = self._levels()
        except ConvergenceError as failed:
            why = f"linear vibration does not describe it ({failed})"
            return replace(self.plain, why=why, notes=(*self.notes, _BY_A_RUN))
        self._tell(1, _LOOKS)
        level, why = self._choose(levels, seconds)
        error, tol = levels[level], self.tol
        n = (mechanism.flexible.n_eta, self.rich.flexible.n_eta)
        found = replace(
            self.plain, level=level, error=error, levels=levels, why=why,
            coordinates=(*n, 0 if level == "rigid" else n[0]),
        )  # fmt: skip
        if level == "rigid":
            found = replace(found, run_tol=None)
        if level == "quasistatic":
            found = replace(found, run_tol=tol * _STILL)
        if level == "coupled" and self.linear:
            once, self.corrections = ked, 0
        if level == "rigid" or fixed:
            found = self._segmented(mechanism, found)
        else:
            left = 1.0 - found.used(error)
            found = self._smaller(mechanism, found, once, left if left > 0.0 else 0.5)
        return replace(found, notes=tuple(self.notes))

    def _smaller(self, mechanism: Mechanism, whole: Advice, once: Run, room: float) -> Advice:
        """The advice with less in its model, as far as errors stay within what is allowed.

        Where the smaller model as a whole does not keep them there, only what costs next to
        nothing goes; where that does not either, no level of the table does.
        """
        found = self._segmented(mechanism, self._reduced(mechanism, whole, once, room))
        if found.used(found.error) <= 1.0:
            return found
        more = self._segmented(mechanism, self._reduced(mechanism, whole, once, _NEXT_TO_NOTHING))
        if more.used(more.error) < _WORTH * found.used(found.error) or more.used(more.error) <= 1.0:
            found = more
        return replace(found, levels=self._with_model(found.levels))

    def _reduced(self, mechanism: Mechanism, whole: Advice, once: Run, room: float) -> Advice:
        """Links, planes and modes left out that cost no more than `room` of what is allowed."""
        error, levels = whole.error, whole.levels
        terms, on = self._terms(mechanism, once, room)
        self._tell(2, _LOOKS)
        small = fewer.smaller(
            self.rich, self.probe, self.outputs, once, room, whole.used, mechanism,
            self.corrections,
        )  # fmt: skip
        last = {} if self._cut else small.unsettled
        error = {
            k: x + SAFETY * small.error.get(k, 0.0) + _TAIL * last.get(k, 0.0)
            for k, x in error.items()
        }
        if last and not self.tail:
            self.notes.append(
                f"the last mode tried still changes an output by {percent(_worst(last))}"
                ", which is in the error bars: more modes may be needed"
            )
        self.tail = {k: _TAIL * e for k, e in last.items()}
        found = replace(
            whole, error=error, levels=levels, left_out=(*terms, *small.tried),
            overrides=(*fewer.overrides(mechanism, small.parts), *on),
            coordinates=(*whole.coordinates[:2], small.coordinates),
        )  # fmt: skip
        self._tell(3, _LOOKS)
        return found

    def _with_model(self, levels: dict[str, Errors]) -> dict[str, Errors]:
        """Error bars of levels with what the richer model itself leaves out."""
        apart: Errors = {}
        if self._finer is not None:
            with contextlib.suppress(PinflexError, np.linalg.LinAlgError):
                apart = self._apart(self._look(self.rich, "coupled"), self._finer)
        return {
            name: error_bars.covering({k: x + self.tail.get(k, 0.0) for k, x in e.items()}, apart)
            for name, e in levels.items()
        }

    def _terms(
        self, mechanism: Mechanism, whole: Run, room: float
    ) -> tuple[list[LeftOut], tuple[str, ...]]:
        """What it costs to leave out terms that the scene has not; changes that add the others."""
        tried: list[LeftOut] = []
        changes: tuple[str, ...] = ()
        for keys in fewer.TERMS if self.rich is not mechanism else ():
            terms = fewer.without(mechanism, self.rich, keys)
            if terms:
                tried.append(self._left_out(terms, whole, room))
                changes += () if tried[-1].out else fewer.added(mechanism, terms)
        return tried, changes

    def _left_out(self, terms: list[tuple[str, str]], whole: Run, room: float) -> LeftOut:
        """The cost of leaving out terms of links."""
        links, keys = (dict.fromkeys(x) for x in zip(*terms, strict=True))
        what = " and ".join(key.replace("_", " ") for key in keys)
        try:
            off = [f"flexible.{link}.{key}=false" for link, key in terms]
            less, like = self.rich.with_(*off), self.probe
            probe = Probe(less, self.motion, like.end, like.static, like)
            run = probe.motion(self.corrections)
        except (PinflexError, np.linalg.LinAlgError):
            return LeftOut(f"{what}: without it the motion runs away", {}, False)
        error = self.outputs.differences(run, whole)
        out = SAFETY * self.plain.used(error) <= room
        return LeftOut(f"{what} of {', '.join(links)}", error, out)

    def _segmented(self, mechanism: Mechanism, found: Advice) -> Advice:
        """The advice with the error of its whole model in its bars, and segments if they help."""
        level, finer = found.level, self._finer
        level = level if level in ("rigid", "quasistatic") else "coupled"
        if finer is None:
            return found
        try:
            model = mechanism.with_(*found.overrides)
            apart = self._apart(self._look(model, level), finer)
            self._tell(4, _LOOKS)
            error = error_bars.covering(found.error, apart)
            more = fewer.segmented(model)
            used = found.used
            if level == "rigid" or used(error) <= 1.0 or self.rich is mechanism or not more:
                return replace(found, error=error)
            if used(found.error) > _WORTH * used(error):
                return replace(found, error=error)  # whatever segments mend, that is left
            cut = model.with_(*more)
            rest = self._apart(self._look(cut, level), finer)
            # What two segments leave is a quarter to a third of what they mend.
            left = {k: e + _MENDED * apart.get(k, 0.0) for k, e in rest.items()}
            better = error_bars.covering(found.error, left)
            if used(better) > _WORTH * used(error):
                return replace(found, error=error)
            n = cut.flexible.n_eta
            return replace(
                found, error=better, overrides=(*found.overrides, *more),
                coordinates=(*found.coordinates[:2], n),
                left_out=(*found.left_out, LeftOut("segments beyond those it has", apart, False)),
            )  # fmt: skip
        except (PinflexError, np.linalg.LinAlgError) as failed:
            self.notes.append(f"{_UNTRIED}: {failed}")
            return found

    @cached_property
    def _finer(self) -> error_bars.Look | None:
        """All of the richer model and twice its segments; None where nothing can look at that."""
        finer = finer_model(self.rich)[0]
        try:
            with contextlib.suppress(PinflexError, np.linalg.LinAlgError):
                return self._look(finer, "coupled")
            self.by_runs = True  # too far from linear vibration for a cheap look
            return self._look(finer, "coupled")
        except (PinflexError, np.linalg.LinAlgError) as failed:
            self.notes.append(f"{_UNTRIED}: {failed}")
            return None

    @property
    def _cut(self) -> bool:
        """Whether that has twice the segments, which tell what all modes beyond the last bring.

        Their shapes hold twice the modes: what is beyond those is half of what they bring.
        """
        if self._finer is None:
            return False
        finer, own = self._finer.probe.mechanism.parts, fewer.beams(self.rich)
        return all(finer[x.link].spec.segments >= 2 * x.spec.segments for x in own)

    def _look(self, model: Mechanism, level: str) -> error_bars.Look:
        """A model at a level, on the instants of the probe; by a run where looks miss too much."""
        like = self.probe
        probe = Probe(model, self.motion, like.end, like.static, like)
        some = error_bars.compared(probe)
        if level == "coupled" and not self.corrections:
            return error_bars.Look(probe, probe.motion(0).at(some), some)
        if level != "coupled" or not self.by_runs:
            return error_bars.look(probe, self.motion, level)
        scene, patient = self._scene(model, level), error_bars.patient()
        run = solve_to_tolerance(scene, probe.t[some], _WITHIN * self.tol, patient)
        return error_bars.Look(probe, run, some)

    def _apart(self, a: error_bars.Look, b: error_bars.Look) -> Errors:
        """How far one look differs from another in what is asked for."""
        asked = self.plain.asked
        outputs = tuple(
            key for key in error_bars.OF_POSES
            if key.split()[0] in asked or (key == "motor force" and "torque" in asked)
        )  # fmt: skip
        return error_bars.differences(a, b, outputs)

    def _scene(self, model: Mechanism, level: str) -> Scene:
        """A run of a model, that is asked for no more than the advice is."""
        spec = replace(model.description.solve, level=level, asked=self.plain.asked)
        return Scene(model, self.motion, spec)

    def _levels(self) -> tuple[Run, Run, dict[str, Errors], dict[str, float]]:
        """The motion corrected once, the linear one, error bars by level, seconds of a run."""
        probe, differ = self.probe, self.outputs.differences
        linear, corrected, twice = probe.marched(2)
        once, best, ked = probe.nonlinear(corrected), probe.nonlinear(twice), probe.linear(linear)
        first, second = differ(ked, best), differ(once, best)
        # what neither correction moves by a share that counts is settled, whatever their ratio
        small = _NEXT_TO_NOTHING * self.tol
        going = [k for k, e in first.items() if max(e, second[k]) > small]
        ratio = max((second[k] / max(first[k], small) for k in going), default=0.0)
        rest = ratio / (1.0 - ratio) if ratio < _CONTRACTION else np.inf
        if not np.isfinite(rest):
            self.notes.append(
                "the levels below coupled were not measured: corrections of the linear vibration "
                "do not shrink, it is too far from the motion"
            )
        left = {k: e * (rest if k in going else 1.0) if e else 0.0 for k, e in second.items()}
        seconds = {"coupled": self._verify(best, left)}
        runs = self._runs() if self.doubts else None
        if runs is not None:
            best, ked = runs
            first = differ(ked, best)
            left, self.fast, self.by_runs = dict.fromkeys(first, _WITHIN * self.tol), {}, True

        def bars(error: Errors) -> Errors:
            return {k: SAFETY * e + left[k] for k, e in error.items()}

        self._allow(best)
        self.linear = not self.by_runs and self.plain.used(first) <= _LINEAR
        levels = {"rigid": bars(differ(probe.rigid(), best))}
        levels["quasistatic"], seconds["quasistatic"] = dict.fromkeys(left, np.inf), np.inf
        began = time.thread_time()
        try:
            still = solve_equilibria(
                self.rich, self.motion, probe.t, self.tol * _STILL, self.plain.asked
            )
        except ConvergenceError as failed:
            self.notes.append(f"quasistatic was not measured: there is no equilibrium ({failed})")
        else:
            seconds["quasistatic"] = time.thread_time() - began
            own = self.tol * _STILL
            levels["quasistatic"] = {k: e + own for k, e in bars(differ(still, best)).items()}
        levels["ked"] = bars(first)
        # Twice the tolerance of its run, and what is too fast for the looks by which models are
        # compared: in that two models may differ wholly.
        levels["coupled"] = {k: 2 * _RUN * self.tol + self.fast.get(k, 0.0) for k in left}
        return once, ked, levels, seconds

    def _runs(self) -> tuple[Run, Run] | None:
        """Levels coupled and ked of the whole motion, where the estimate is not to be believed.

        The doubts become notes: about bars that have them where a run stops.
        """
        t, within = self.probe.t, _WITHIN * self.tol
        apart = ", ".join(f"{key} by {percent(e)}" for key, e in self.doubts.items())
        about = f"a coupled run of the first part differs from the estimate ({apart})"
        try:
            scene = self._scene(self.rich, "coupled")
            best = solve_to_tolerance(scene, t, within, error_bars.patient())
            ked = self._as_compared(self._scene(self.rich, "ked"), within)
        except SceneError as failed:
            self.notes.append(f"{about}, which is in the error bars; a whole run stops: {failed}")
            return None
        self.notes.append(f"{about}: levels were judged by whole runs")
        return best, ked

    def _as_compared(self, ked: Scene, tol: float) -> Run:
        """Level ked as `compare` judges it: in steps by default these are in its error.

        Steps that a scene names serve every level there: what they miss is not the level's.
        """
        t = self.probe.t
        if ked.spec.dt is None:
            return ked.stepped(t, default_step(self.rich, self.probe.end))
        try:
            return solve_to_tolerance(ked, t, tol)
        except ConvergenceError as failed:  # the finest on the way there
            if not isinstance(failed.result, Run):
                raise
            return failed.result

    def _allow(self, best: Run) -> None:
        """Let the pose of the platform be off by what the band is of its largest deviation."""
        keys = ("platform position", "platform rotation")
        apart = self.outputs.histories(self.probe.rigid(), best)
        if keys[0] not in apart:
            return
        far = {k: max(float(np.max(apart[k].size, initial=0.0)), STILL) for k in keys}
        share = platform_allowed(far[keys[0]], self.tol, self.plain.band) / far[keys[0]]
        self.plain = replace(
            self.plain, allowed=dict.fromkeys(keys, share), sizes=far if share > self.tol else {}
        )

    def _verify(self, best: Run, left: Errors) -> float:
        """Hold the corrected motion against the coupled one; seconds that all of that would take.

        Where they differ by more than `left`, that is the difference; much more is a doubt.
        """
        probe, upto = self.probe, slice(0, (self.probe.steps - 1) // _WINDOW + 1)
        began = time.thread_time()
        try:
            scene = self._scene(self.rich, "coupled")
            run = scene.resolved(probe.t[upto], _WITHIN * self.tol)
        except SceneError as failed:
            self.notes.append(f"a coupled run of the first part stopped: {failed}")
            return np.inf
        seconds = time.thread_time() - began
        y, v, torque = best.y.copy(), best.v.copy(), best.torque.copy()
        y[upto], v[upto], torque[upto] = run.y, run.v, run.torque
        found = self.outputs.differences(replace(best, y=y, v=v, torque=torque), best)
        # Of no link that bends a model may differ in anything.
        self.fast = found if self.rich.parts else {}
        for key, apart in found.items():
            if apart > left[key] + _DOUBT * self.tol:
                self.doubts[key] = apart
            left[key] = max(left[key], apart)
        # A run within a tolerance corrects every step, which costs what these finer ones do.
        return _WINDOW * seconds

    def _choose(self, levels: dict[str, Errors], seconds: dict[str, float]) -> tuple[str, str]:
        """The cheapest level whose error bars fit, and why."""
        lower = ("rigid", "quasistatic", "ked")
        known = [
            f"{name} {self.plain.worst(levels[name])}"
            for name in lower if np.isfinite(_worst(levels[name]))
        ]  # fmt: skip
        rigid, still, ked = (self.plain.used(levels[name]) <= 1.0 for name in lower)
        why = f"error bars: {', '.join(known)}" if known else "no lower level could be measured"
        if rigid:
            return "rigid", why
        if still:
            now, then = seconds["quasistatic"], seconds["coupled"]
            if now <= _DEARER * then:
                return "quasistatic", why
            return "coupled", (
                f"{why}; quasistatic would do, but takes longer (about {now:.2g} s, "
                f"coupled {then:.2g} s)"
            )
        if ked:
            # Its steps resolve every period, however long those of coupled may be.
            return "coupled", f"{why}; ked would do, but is hardly cheaper than coupled by tol"
        return "coupled", why

    def _doubts(self) -> list[str]:
        """What weakens the probes themselves, in sentences."""
        probe, said = self.probe, []
        if probe.rough > 1e-2:
            said.append(
                f"the motion has corners: interpolation misses {percent(probe.rough)} of the "
                "linear system there, and error bars may be short of them"
            )
        if probe.steps_a_period < RESOLVED:
            said.append(
                f"the third mode, {probe.third:.3g} Hz, was seen with "
                f"{probe.steps_a_period:.1f} steps a period: a long run for so fast a mode; ask "
                "about a part of it (until)"
            )
        return said
