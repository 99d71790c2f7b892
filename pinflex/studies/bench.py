"""Work and precision on a scene of your own: levels, internal modes, integrators and steps.

Every case is compared with a converged run of the coupled level, which is refined until two runs in
a row agree, and then once more with more internal modes. An error is max_t |x - ref| / max_t |ref|
of torques, elastic deflections, and the platform's deviation from the rigid motion.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.basis import cut
from pinflex.errors import DescriptionError, SceneError
from pinflex.integrators.problem import Run
from pinflex.levels.modes import default_step
from pinflex.levels.outputs import Outputs, relative
from pinflex.levels.quasistatic_smooth import solve_equilibria
from pinflex.levels.rigid import solve_rigid
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.progress import Progress, barred, callback
from pinflex.recovery import links
from pinflex.solver.scene import Scene
from pinflex.solver.solve import default_motion
from pinflex.threads import one_blas_thread
from pinflex.viewer.plots.drawing import COLOURS, Drawing, panels, title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


SAMPLES = 201
RESOLUTIONS = (1e-2, 1e-3, 1e-4)  # of radau
STEPS = (4.0, 1.0, 0.25)  # of the default step
AGREE = 1e-4  # two runs in a row: a decade below errors of interest
_ROUNDS, _SECTIONS = 5, 11
_MODES = {"craig_bampton": "internal", "assumed": "modes", "finite_element": "elements"}


@dataclass(frozen=True)
class Case:
    """A way to solve the scene: level, method, its setting, and a number of internal modes.

    Attributes:
        method: rigid, quasistatic, ked, alpha or radau. value: Step in s, or resolution; 0: none.
        modes: What the basis of every link is given; None: as the model says.
    """

    method: str
    value: float = 0.0
    modes: int | None = None

    @property
    def setting(self) -> str:
        """The value as a person would say it."""
        if not self.value:
            return "-"
        return (
            f"resolution {self.value:.0e}" if self.method == "radau" else f"dt {self.value:.2g} s"
        )


@dataclass(frozen=True)
class Point:
    """A case, the seconds it took (wall, CPU; best of repeats) and its errors, or why it failed."""

    case: Case
    wall: float
    cpu: float
    errors: dict[str, float]
    failed: str = ""

    @property
    def worst(self) -> float:
        """Largest error of all outputs."""
        return max(self.errors.values(), default=float("inf"))


@dataclass(frozen=True)
class Bench:
    """The points, and the reference they are measured against.

    Attributes:
        name: Model. points: In the order they were run.
        reference: How it was made. own_error: By output, the larger of what one refinement of time
            and one of the modes still changes.
        key: What the number of modes is called in the YAML; None: links of several kinds.
    """

    name: str
    points: tuple[Point, ...]
    reference: str
    own_error: dict[str, float]
    key: str | None

    def plot(self, panel: str | None = None, ax: Axes | None = None) -> Any:
        """Draw time against error; returns the matplotlib axes."""
        return drawing(self).axes(panel, ax)

    def pareto(self, output: str | None = None) -> list[Point]:
        """Points that no other beats in both time and error, fast ones first."""
        best, kept = np.inf, []
        for p in sorted((p for p in self.points if not p.failed), key=lambda p: p.cpu):
            error = p.worst if output is None else p.errors[output]
            if error < best:
                best = error
                kept.append(p)
        return kept


@barred
@one_blas_thread()
def bench(mechanism: Mechanism, progress: Progress = None) -> Bench:
    """Run all cases of a scene against its converged solution."""
    tell = callback(progress)
    if not mechanism.flexible.n_eta:
        raise DescriptionError(
            f"{mechanism.name}: bench compares flexible levels, and no link is flexible. Name some "
            "under `flexible`."
        )
    if any(mechanism.description.system_damping):
        raise DescriptionError(
            f"{mechanism.name}: damping.scope: system is known to level ked only, and bench "
            "compares with level coupled. Write scope: links."
        )
    scenes = _Scenes(mechanism)
    reference, how, own = scenes.converged()
    points, cases = [], list(scenes.cases())
    for k, case in enumerate(cases):
        points.append(scenes.measure(case, reference))
        if tell is not None:
            tell(k + 1, len(cases))
    return Bench(mechanism.name, tuple(points), how, own, scenes.key)


class _Scenes:
    """The scene at every number of modes, and the runs that are compared."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism, self.motion = mechanism, default_motion(mechanism)
        spec = mechanism.description.solve
        end = spec.until if spec.until is not None else self.motion.duration
        self.t = np.linspace(0.0, end, SAMPLES)
        bases = {part.spec.basis for part in mechanism.parts.values()}
        basis = next(iter(bases))
        # Links of several bases have no one number of modes to change: they stay as they are.
        self.key = _MODES.get(basis.kind) if len(bases) == 1 else None
        self.modes = None if self.key is None else int(getattr(basis, self.key))
        self._at: dict[int | None, Scene] = {}
        self.stepped = spec.integrator in ("newmark", "hht") or mechanism.description.control
        self.still = spec.drive == "prescribed"

    def scene(self, modes: int | None) -> Scene:
        """The coupled scene with so many modes in every link."""
        if modes not in self._at:
            m = self.mechanism
            if modes is not None and modes != self.modes:
                m = load(m.description.with_overrides([f"flexible.*.basis.{self.key}={modes}"]))
            spec = replace(m.description.solve, level="coupled", tol=None, dt=None, asked=())
            self._at[modes] = Scene(m, self.motion, spec, m.description.control)
        return self._at[modes]

    def cases(self) -> Iterator[Case]:
        """Cheap ones first."""
        step = default_step(self.mechanism, float(self.t[-1]))
        yield Case("rigid")
        lowest = 0 if self.key == "internal" else 1
        around = [None] if self.modes is None else [
            n for n in (self.modes - 1, self.modes, self.modes + 1) if n >= lowest
        ]  # fmt: skip
        for modes in around:
            if self.still:
                yield Case("quasistatic", modes=modes)
                yield from (Case("ked", k * step, modes) for k in STEPS)
            yield from (Case("alpha", k * step, modes) for k in STEPS)
            if not self.stepped:
                yield from (Case("radau", r, modes) for r in RESOLUTIONS)

    def run(self, case: Case) -> Run:
        """Solve a case."""
        scene, t = self.scene(case.modes), self.t
        if case.method == "rigid":
            return solve_rigid(scene.mechanism, self.motion, t)
        if case.method == "quasistatic":
            return solve_equilibria(scene.mechanism, self.motion, t)
        if case.method == "radau":
            return scene.resolved(t, case.value, pilot=True)
        if case.method == "ked":
            scene = replace(scene, spec=replace(scene.spec, level="ked"), control=None)
        elif scene.spec.only is not None:
            scene = replace(scene, spec=replace(scene.spec, integrator="generalized_alpha"))
        return scene.stepped(t, case.value)

    def converged(self) -> tuple[Run, str, dict[str, float]]:
        """The reference, how it was made, and its own error by output."""
        rich = None if self.modes is None else self.modes + 3
        value = default_step(self.mechanism, float(self.t[-1])) / 4.0 if self.stepped else 1e-4
        method = "alpha" if self.stepped else "radau"
        coarse = self.run(Case(method, value, rich))
        for _ in range(_ROUNDS):
            value /= 2.0 if self.stepped else 8.0
            fine = self.run(Case(method, value, rich))
            own = self.errors(coarse, fine)
            coarse = fine
            if max(own.values()) < AGREE:
                break
        case = Case(method, value, rich)
        how = f"coupled, {method}, {case.setting}"
        if rich is not None:
            fewer = self.errors(self.run(replace(case, modes=rich - 1)), fine)
            own = {key: max(e, fewer[key]) for key, e in own.items()}
            how += f", {self.key} {rich}"
        return fine, how, own

    def measure(self, case: Case, reference: Run) -> Point:
        """A case timed: best of three, or of fewer once they have taken half a second."""
        nan = float("nan")
        wall, cpu, spent = np.inf, np.inf, 0.0
        try:
            for _ in range(3):
                clock, process = time.perf_counter(), time.process_time()
                run = self.run(case)
                took = time.perf_counter() - clock
                wall, cpu = min(wall, took), min(cpu, time.process_time() - process)
                spent += took
                if spent > 0.5:
                    break
            return Point(case, wall, cpu, self.errors(run, reference))
        except SceneError as error:
            return Point(case, nan, nan, {}, str(error))

    def errors(self, run: Run, reference: Run) -> dict[str, float]:
        """By output; bases of different size are compared by the shapes that they make."""
        outputs = Outputs(self.mechanism, self.motion, self.t, ("torque", "platform"))
        found = outputs.differences(run, reference)
        bent = _deflections(reference)
        ours = _deflections(run) if run.system.n_eta else 0.0 * bent
        return {"deflection": relative(ours, bent)} | found


def _deflections(run: Run) -> Array:
    """Of sections along every body from its own root, m, shape (nt, n, 3)."""
    eta = run.y[:, int(run.system.rigid.nq) :]
    return np.concatenate([
        links.section_deflections(cut(slot.body, _SECTIONS), eta[:, slot.eta])[:, :, :3]
        for slot in run.system.expansion.slots
    ], axis=1)  # fmt: skip


# The work-precision figure of `pinflex bench`.

_METHODS = ("rigid", "quasistatic", "ked", "alpha", "radau")
_NAMES = {"alpha": "coupled, alpha", "radau": "coupled, radau"}
_MARKERS = ("o", "s", "^", "D")
_PANEL = 3.0  # [in]


def drawing(study: Bench) -> Drawing:
    """The figure, and its panels by output."""
    each = {name: partial(_panel_with_legend, study=study, name=name) for name in _outputs(study)}
    return Drawing(partial(figure, study), each)


def figure(study: Bench) -> Figure:
    """CPU seconds against error, log-log, one panel an output; the Pareto set is joined."""
    outputs = _outputs(study)
    columns = min(2, len(outputs))
    rows = -(-len(outputs) // columns)
    fig, axes = panels(rows, columns, rows * _PANEL + 0.5, None)
    colours, markers = _looks(study)
    for ax, name in zip(axes.flat, outputs, strict=False):
        _panel(ax, study, name, colours, markers)
    handles = _handles(study, colours, markers)
    for spare in axes.flat[len(outputs) :]:  # one at most: the legend fills it
        spare.set_axis_off()
        spare.legend(handles=handles, loc="center left", frameon=False, fontsize=8)
    if len(outputs) == axes.size:
        fig.legend(handles=handles, loc="outside upper center", ncols=4, frameon=False, fontsize=8)
    return fig


def _outputs(study: Bench) -> list[str]:
    return [name for name in study.own_error if any(p.errors.get(name) for p in study.points)]


def _looks(study: Bench) -> tuple[dict[str, str], dict[int, str]]:
    """Colours of methods, markers of numbers of modes."""
    modes = sorted({p.case.modes for p in study.points if p.case.modes is not None})
    colours = dict(zip(_METHODS, COLOURS[4:] + COLOURS[:3], strict=False))
    return colours, dict(zip(modes, _MARKERS, strict=False))


def _panel_with_legend(ax: Any, study: Bench, name: str) -> None:
    looks = _looks(study)
    _panel(ax, study, name, *looks)
    ax.legend(handles=_handles(study, *looks), frameon=False, fontsize=8)


def _panel(
    ax: Any, study: Bench, name: str, colours: Mapping[str, str], markers: Mapping[int, str]
) -> None:
    """One output."""
    known = [p for p in study.points if p.errors.get(name)]
    for p in known:
        marker = markers.get(p.case.modes or 0, "o")
        ax.loglog(p.cpu, p.errors[name], marker, color=colours[p.case.method], ms=5, mew=0)
    front = [p for p in study.pareto(name) if p.errors[name]]
    ax.loglog(
        [p.cpu for p in front], [p.errors[name] for p in front],
        "-o", color="0.25", lw=0.8, mfc="none", mec="0.25", ms=9, mew=0.8, zorder=1,
    )  # fmt: skip
    ax.axhspan(1e-12, study.own_error[name], color="0.92", zorder=0)
    low = min(study.own_error[name], *(p.errors[name] for p in front))
    high = max((p.errors[name] for p in known), default=1.0)
    ax.set_ylim(0.4 * low, 2.0 * max(high, 1.0))
    ax.margins(x=0.06)
    ax.grid(True, which="major", color="0.9", lw=0.6)
    ax.set_ylabel("relative error [-]")
    ax.set_xlabel("CPU time [s]")
    title(ax, name)


def _handles(study: Bench, colours: Mapping[str, str], markers: Mapping[int, str]) -> list[Any]:
    """Of the legend: methods, numbers of modes, the Pareto set."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    used = [m for m in _METHODS if any(p.case.method == m and not p.failed for p in study.points)]
    dot: dict[str, Any] = {"ls": "", "mew": 0, "ms": 5}
    return [
        *(Line2D([], [], marker="o", color=colours[m], label=_NAMES.get(m, m), **dot)
          for m in used),
        *(Line2D([], [], marker=marker, color="0.5", label=f"{study.key}: {n}, any colour", **dot)
          for n, marker in markers.items()),
        Line2D([], [], marker="o", mfc="none", color="0.25", lw=0.8, label="none better (Pareto)"),
        Patch(color="0.92", label="below the reference's own error"),
    ]  # fmt: skip
