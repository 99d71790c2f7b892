"""solve(): the public call, a level or the one that is advised, with error bars on demand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.blocks.control import Control
from pinflex.description.motions.motion import Motion
from pinflex.description.solve import ASKED, LEVELS
from pinflex.errors import ConvergenceError, DescriptionError, MotionError, RunInterrupted
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.progress import Progress, shown
from pinflex.results.error_bars import ErrorBars
from pinflex.results.result import Result
from pinflex.solver.solve import default_motion, solve_level
from pinflex.writing import plain

__all__ = ["LEVELS", "solve"]


@public
@takes_model
def solve(
    mechanism: Mechanism,
    motion: Motion | None = None,
    level: str | None = None,
    *,
    until: float | None = None,
    dt: float | None = None,
    tol: float | None = None,
    samples: int | None = None,
    asked: Sequence[str] | None = None,
    start: str | Result | tuple[Result, float] | tuple[Array, Array] | None = None,
    start_speeds: Mapping[str, Any] | None = None,
    integrator: Any = None,
    rho_inf: float | None = None,
    newmark: Sequence[float] | None = None,
    ked: str | None = None,
    drive: str | None = None,
    kp: float | None = None,
    kd: float | None = None,
    tolerance: float | None = None,
    control: Control | bool | None = None,
    progress: Progress = None,
    resume: Result | str | Path | None = None,
) -> Result:
    """Solve a scene at one level.

        robot = pf.load("3rrr")
        run = pf.solve(robot, level="coupled", tol=1e-3, progress=True)
        run.torque                          # (nt, motors) [N m]
        run.frames["platform"].position     # (nt, 3) [m]
        run.plot("torque")

    Args:
        mechanism: From `load`.
        motion: Default: the motion of the YAML.
        level: rigid, quasistatic, ked, coupled or auto; default: the YAML's. Auto is the one
            that `advise` proposes for `tol` (default 1e-2), with the links as they are; the
            result's meta["advice"] says why.
        until: End time [s]; default: the YAML's, or the motion's duration.
        dt: Step [s] for ked and coupled; default: from the first frequencies and the motion.
        tol: Relative error of time integration instead of a step, such as 1e-3.
        samples: Number of instants to report, nt; default 401.
        asked: Outputs that `tol` is about: torque, deflection, platform; default: the YAML's.
        start: straight (undeformed), static (in equilibrium) or auto; at level coupled also a run,
            or (run, t), from whose state at t [s] it goes on, or (y, v): coordinates and
            velocities, laid out as y and the columns of shapes in `modes`.
        start_speeds: Speeds at the start of joints without a prescribed motion [rad/s | m/s], and
            velocities of links' origins in the world [m/s] (level coupled).
        integrator: A name (generalized_alpha, hht, newmark, radau, ...), an `AlphaScheme`, or of
            level ked a function, see CONTRIBUTING.
        rho_inf: Spectral radius of generalized_alpha and hht at infinite frequency, 0 to 1.
        newmark: Its (gamma, beta) [-].
        ked: Terms of level ked: full or structural.
        drive: prescribed (the motors follow the motion) or torque (they push).
        kp: Position gain of the torque drive [N m/rad | N/m].
        kd: Speed gain of the torque drive [N m s/rad | N s/m].
        tolerance: Newton's, of the alpha family; default: its own.
        control: Feedback (level coupled); default: the YAML's, False: none.
        progress: True: a bar; or a function called with (step, steps) on long work.
        resume: A stopped or shorter run (or its file) of level coupled to go on with, to `until`,
            in its own steps unless dt is given; the motion must be the same.
    Returns:
        The result: t (nt,) [s], torque (nt, motors) [N m | N], and by name `joints`, `frames`,
        `links`, `loops`. If a run stops early, the error carries `.result` up to the last good
        step.
    Raises:
        DescriptionError: An unknown level or option.
        MotionError, SingularityError, ConvergenceError: The scene cannot be solved.
    """
    given: dict[str, Any] = {"until": until, "dt": dt, "samples": samples, "control": control}
    options = {
        "tol": tol, "asked": asked, "start": start, "integrator": integrator, "rho_inf": rho_inf,
        "newmark": newmark, "ked": ked, "drive": drive, "kp": kp,
        "kd": kd, "start_speeds": start_speeds, "tolerance": tolerance,
    }  # fmt: skip
    given |= {key: value for key, value in options.items() if value is not None}
    with shown(progress, level or mechanism.description.solve.level) as tell:
        if level == "auto":
            return _solve_advised(mechanism, motion, progress=tell, **given)
        moved = motion if motion is not None else default_motion(mechanism)
        look = partial(_look, mechanism, moved, given)
        try:
            found = solve_level(mechanism, motion, level, progress=tell, resume=resume, **given)
        except (ConvergenceError, MotionError, RunInterrupted) as error:
            if isinstance(error.result, Result):
                error.result = replace(error.result, look=look)
            raise
        return replace(found, look=look)


def _solve_advised(
    mechanism: Mechanism, motion: Motion | None, *, dt: float | None, **options: Any
) -> Result:
    """The run of `solve(level="auto")`: at the level advised, with the links as they are."""
    if dt is not None:
        raise DescriptionError('solve.dt: level="auto" chooses the step. Give tol instead.')
    from pinflex.advice.advise import advise  # much that a run at a given level does not need

    wanted = options.pop("tol", None) or mechanism.description.solve.tol or 1e-2
    asked, until = tuple(options.pop("asked", ())), options.get("until")
    # a run has every output: none is let off for what does no harm
    asked = asked or mechanism.description.solve.asked or ASKED
    found = advise(mechanism, motion, tol=wanted, band=0.0, asked=asked, until=until, fixed=True)
    if found.run_tol is not None:
        options |= {"tol": found.run_tol, "asked": found.asked}
        spec = replace(mechanism.description.solve, dt=None)
        mechanism = replace(mechanism, description=mechanism.description.replace(solve=spec))
    result = solve_level(mechanism, motion, found.level, **options)
    moved = motion if motion is not None else default_motion(mechanism)
    result = replace(result, look=partial(_look, mechanism, moved, options))
    return replace(result, meta={**result.meta, "advice": plain(asdict(found))})


def _look(
    mechanism: Mechanism, motion: Motion, given: Mapping[str, Any], result: Result
) -> ErrorBars:
    from pinflex.advice.error_bars import error_bars

    return error_bars(result, mechanism, motion, given)
