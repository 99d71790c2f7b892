"""The levels by name: each a function from a scene and its samples to a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.description.solve import ASKED
from pinflex.errors import ConvergenceError, DescriptionError, MotionError
from pinflex.integrators.collocation import Collocation
from pinflex.integrators.problem import Run
from pinflex.levels.modes import default_step
from pinflex.levels.quasistatic_smooth import solve_equilibria
from pinflex.levels.rigid import solve_rigid
from pinflex.linalg import independent_rows, null_space
from pinflex.mechanics.assembly import RANK
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.solver.tolerance import solve_to_tolerance

if TYPE_CHECKING:
    from pinflex.solver.scene import Progress, Scene

    Level = Callable[[Scene, Array, Progress | None], Run]

_STICTION = 1e-3  # tolerance of runs that stick, where none is given
_PASSED_OVER = (
    "equal steps do not end at contacts, and lose their order there: take `tol` where that matters."
)


def coupled(scene: Scene, t: Array, progress: Progress | None = None) -> Run:
    """The full equations marched in time: to a tolerance, or in steps of dt.

    Where neither is asked for and equal steps do not pass an instant at which dry friction brings a
    joint to rest, steps follow the motion.
    """
    spec = scene.spec
    _require_one_answer(scene)
    tol = spec.tol
    if scene.bends or scene.mechanism.flexible.kinks.rows:
        tol = _to_meet_contacts(scene)
    if tol is not None:
        return solve_to_tolerance(scene, t, tol, progress)
    if scene.bends:
        run = scene.stepped(t, spec.dt or default_step(scene.mechanism, float(t[-1])), progress)
        return replace(run, warnings=(*run.warnings, _PASSED_OVER))
    dt = spec.dt if spec.dt is not None else default_step(scene.mechanism, float(t[-1]))
    try:
        return scene.stepped(t, dt, progress)
    except ConvergenceError as error:
        if spec.dt is not None or scene.linear or scene.control is not None or not scene.sticks:
            raise
        run = solve_to_tolerance(scene, t, _STICTION, progress)
        said = f"friction stops joints, which equal steps do not pass ({str(error).split(': ')[0]})"
        words = f"{said}: solved with steps that follow the motion, tol = {_STICTION:g}."
        return replace(run, warnings=(*run.warnings, words))


def _to_meet_contacts(scene: Scene) -> float | None:
    """The tolerance of a run with contacts: equal steps would not end at them."""
    spec, where = scene.spec, scene.mechanism.name
    if scene.linear:
        raise DescriptionError(
            f"{where}: level ked is linear, and backlash, stops, tables and cables are not. Take "
            "level coupled."
        )
    kinks = scene.mechanism.loose.kinks
    if (kinks.rigid or kinks.pins) and not _lands(scene):
        raise DescriptionError(
            f"{where}: stops with `restitution` and pins with `clearance` are met at instants that "
            "equal steps (`dt`, an integrator by name, a control without `period`, a run without "
            "the compiled kernel) do not end at. Give `tol` alone (or stops `stiffness`)."
        )
    return (spec.tol or _STICTION) if spec.tol is not None or _lands(scene) else None


def _lands(scene: Scene) -> bool:
    """Whether steps follow the motion and end at contacts."""
    spec, method = scene.spec, scene.spec.method
    collocates = method is None or method == "radau" or isinstance(method, Collocation)
    continuous = scene.control is not None and not scene.sampled
    chosen = spec.tol is not None or spec.dt is None
    return chosen and collocates and not continuous and scene.on_kernel


def rigid(scene: Scene, t: Array, progress: Progress | None = None) -> Run:
    """Inverse dynamics of the rigid mechanism; with `drive: torque` its equations are marched."""
    if scene.spec.drive == "prescribed":
        return solve_rigid(scene.mechanism, scene.motion, t)
    return coupled(scene, t, progress)


def quasistatic(scene: Scene, t: Array, progress: Progress | None = None) -> Run:
    """Equilibrium of the links at every sample."""
    _require_prescribed(scene)
    _require_one_answer(scene)
    spec = scene.spec
    return solve_equilibria(
        scene.mechanism, scene.motion, t, spec.tol, spec.asked or ASKED, progress
    )


def ked(scene: Scene, t: Array, progress: Progress | None = None) -> Run:
    """Linear vibration about the rigid motion."""
    _require_prescribed(scene)
    return coupled(scene, t, progress)


LEVELS: dict[str, Level] = {
    "rigid": rigid,
    "quasistatic": quasistatic,
    "ked": ked,
    "coupled": coupled,
}


def _require_prescribed(scene: Scene) -> None:
    if scene.spec.drive != "prescribed":
        raise DescriptionError(
            f"{scene.mechanism.name}: solve.drive: torque needs level coupled (or rigid); "
            f"{scene.spec.level} follows the nominal motion."
        )


def _require_one_answer(scene: Scene) -> None:
    """Raise where prescribed motors fight each other, or a loop, and nothing gives way to them."""
    mechanism, spec = scene.mechanism, scene.spec
    few = len(mechanism.motors) < mechanism.report.mobility  # other freedoms are for level coupled
    system, mobility = mechanism.loose if few else mechanism.flexible, mechanism.report.mobility
    torque, rigid = spec.drive == "torque", spec.level == "ked" and not mechanism.compliant
    done = few and spec.level != "coupled"
    if len(system.motors) == mobility or torque or rigid or done or not system.closed.n:
        return
    J = Equations(system).close(mechanism.undeformed())[1][:, system.free]
    rank = len(independent_rows(J, RANK))
    if rank == len(J):
        return
    if few:
        raise MotionError(
            f"{mechanism.name}: loops lock {', '.join(_locked(mechanism))}, whose motion is "
            f"prescribed, and what gives way takes up {rank} of {len(J)} closures. Take "
            "locked motors out of `actuated`, make links of their loops flexible, or write drive: "
            "torque."
        )
    raise MotionError(
        f"{mechanism.name}: {len(system.motors)} motors prescribe a mechanism of mobility "
        f"{mobility}, and what gives way takes up {rank} of its {len(J)} closures: how the rest "
        f"share the forces has no one answer at level {spec.level}. Leave {mobility} in "
        "`actuated`, make the other limbs flexible or elastic too, or write drive: torque."
    )


def _locked(mechanism: Mechanism) -> list[str]:
    """Motors that the loops do not let move one by one; all where none is locked alone."""
    system = mechanism.rigid
    motions = null_space(Equations(system).close(mechanism.home)[1], RANK)
    still = np.linalg.norm(motions[system.motors], axis=1) < RANK
    names = [name for name, one in zip(mechanism.motors, still, strict=True) if one]
    return names or [*mechanism.motors]
