"""The levels by name: each a function from a scene and its samples to a run."""

from __future__ import annotations

from collections.abc import Callable

from pinflex.arrays import Array
from pinflex.description.solve import ASKED
from pinflex.errors import DescriptionError
from pinflex.integrators.run import Run
from pinflex.levels.quasistatic_smooth import solve_equilibria
from pinflex.levels.rigid import solve_rigid
from pinflex.solver.scene import Progress, Scene, default_step
from pinflex.solver.tolerance import solve_to_tolerance

Level = Callable[[Scene, Array, Progress | None], Run]


def coupled(scene: Scene, t: Array, progress: Progress | None = None) -> Run:
    """The full equations marched in time: to a tolerance, or in steps of dt.

    Args:
        scene: What is solved. t: Samples in s, shape (nt,). progress: Called with (step, steps).
    """
    spec = scene.spec
    if spec.tol is not None:
        return solve_to_tolerance(scene, t, spec.tol, progress)
    dt = spec.dt if spec.dt is not None else default_step(scene.mechanism, float(t[-1]))
    return scene.stepped(t, dt, progress)


def rigid(scene: Scene, t: Array, progress: Progress | None = None) -> Run:
    """Inverse dynamics of the rigid mechanism; with `drive: torque` its equations are marched.

    Args:
        scene: What is solved.
        t: Samples [s], shape (nt,).
        progress: Called with (step, steps).
    """
    if scene.spec.drive == "prescribed":
        return solve_rigid(scene.mechanism, scene.motion, t)
    return coupled(scene, t, progress)


def quasistatic(scene: Scene, t: Array, progress: Progress | None = None) -> Run:
    """Equilibrium of the links at every sample.

    Args:
        scene: What is solved.
        t: Samples [s], shape (nt,).
        progress: Called with (step, steps).
    """
    _require_prescribed(scene)
    spec = scene.spec
    return solve_equilibria(
        scene.mechanism, scene.motion, t, spec.tol, spec.asked or ASKED, progress
    )


def ked(scene: Scene, t: Array, progress: Progress | None = None) -> Run:
    """Linear vibration about the rigid motion.

    Args:
        scene: What is solved.
        t: Samples [s], shape (nt,).
        progress: Called with (step, steps).
    """
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
