"""solve(): the public call, a level or the one that is advised, with error bars on demand."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

from pinflex.advice.advise import advise
from pinflex.advice.error_bars import error_bars
from pinflex.description.control import Control
from pinflex.description.motion import Motion
from pinflex.description.solve import LEVELS
from pinflex.errors import ConvergenceError, DescriptionError, MotionError, RunInterrupted
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.error_bars import ErrorBars
from pinflex.results.result import Result
from pinflex.solver.solve import Progress, default_motion, solve_level
from pinflex.writing import plain

__all__ = ["LEVELS", "solve"]


def solve(
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
    """Solve a scene at one level.

    Args:
        mechanism: From `load`.
        motion: Default: the motion of the YAML.
        level: rigid, quasistatic, ked or coupled; default: the YAML's. auto: the one that
            `advise` proposes for `tol` (default 1e-2), with the links as they are; the result's
            meta["advice"] says why.
        until: End time in s; default: the YAML's, or the motion's duration.
        dt: Step in s for ked and coupled; default: from the first frequencies and the motion.
        samples: Number of output times; default 401.
        control: Feedback (level coupled); default: the YAML's, False: none.
        progress: Called with (step, steps) on long work.
        resume: A stopped or shorter run (or its file) of level coupled to go on with, to `until`,
            in its own steps unless dt is given; the motion must be the same.
        **options: Other keys of the YAML block `solve`: integrator, rho_inf, newmark, drive,
            theta, modes, ked, kp, kd, start, start_speeds, tol; and `tolerance` (Newton's).
    Returns:
        The result. If a run stops early, the error carries `.result` up to the last good step.
    Raises:
        DescriptionError: An unknown level or option.
        MotionError, SingularityError, ConvergenceError: The scene cannot be solved.
    """
    given: dict[str, Any] = {"until": until, "dt": dt, "samples": samples, "control": control}
    if level == "auto":
        return _solve_advised(mechanism, motion, progress=progress, **given, **options)
    start = options.get("start", mechanism.description.solve.start)
    moved = motion if motion is not None else default_motion(mechanism)
    look = partial(_look, mechanism, moved, isinstance(start, str) and start == "static")
    try:
        found = solve_level(
            mechanism, motion, level, progress=progress, resume=resume, **given, **options
        )
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
    wanted = options.pop("tol", None) or mechanism.description.solve.tol or 1e-2
    asked, until = tuple(options.pop("asked", ())), options.get("until")
    found = advise(mechanism, motion, tol=wanted, asked=asked, until=until, fixed=True)
    if found.run_tol is not None:
        options |= {"tol": found.run_tol, "asked": found.asked}
        spec = replace(mechanism.description.solve, dt=None)
        mechanism = replace(mechanism, description=mechanism.description.replace(solve=spec))
    result = solve_level(mechanism, motion, found.level, **options)
    return replace(result, meta={**result.meta, "advice": plain(asdict(found))})


def _look(mechanism: Mechanism, motion: Motion, static: bool, result: Result) -> ErrorBars:
    return error_bars(result, mechanism, motion, static)
