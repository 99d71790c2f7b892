"""Work and precision on a scene of one's own: levels, internal modes, integrators and steps.

Every case is compared with a converged run of the coupled level, which is refined until two runs in
a row agree, and then once more with more internal modes. An error is max_t |x - ref| / max_t |ref|
of torques, elastic deflections, and the platform's deviation from the rigid motion.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.cut import cut
from pinflex.errors import DescriptionError, SceneError
from pinflex.integrators.run import Run
from pinflex.levels.outputs import Outputs, relative
from pinflex.levels.quasistatic_smooth import solve_equilibria
from pinflex.levels.rigid import solve_rigid
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.progress import Progress, barred, callback
from pinflex.recovery import stress
from pinflex.solver.scene import Scene
from pinflex.solver.solve import default_motion
from pinflex.solver.step_length import default_step
from pinflex.threads import one_blas_thread

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
        from pinflex.studies.plot_bench import drawing

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
    """Run all cases of a scene against its converged solution.

    Raises:
        DescriptionError: Nothing is flexible. SceneError: No converged solution.
    """
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
        stress.deflections(cut(slot.body, _SECTIONS), eta[:, slot.eta])[:, :, :3]
        for slot in run.system.expansion.slots
    ], axis=1)  # fmt: skip
