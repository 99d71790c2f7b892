"""Level coupled where a scene leaves its steps open: within a tolerance, unless that is dear.

A comparison is to be true to the digits that it shows. A tolerance keeps that, mostly for less than
equal steps of unknown error take; where something undamped rings all the time it can take far more.
"""

from __future__ import annotations

from contextlib import suppress

from pinflex.advice.solve import solve
from pinflex.description.motions.motion import Motion
from pinflex.errors import ConvergenceError
from pinflex.integrators.march import TOGETHER
from pinflex.mechanics.mechanism import Mechanism
from pinflex.progress import Callback
from pinflex.results.result import Result
from pinflex.solver.solve import default_motion
from pinflex.solver.step_length import default_step

TOL = 1e-3  # a tenth of it is reached mostly, and a table shows three digits


class _TooDear(Exception):
    """More steps of collocation than equal ones would be."""


def steps_are_open(mechanism: Mechanism) -> bool:
    """Whether a scene leaves the steps of level coupled open, and collocation serves it.

    By that it takes half the time of equal steps, with a twentieth of their error or less.
    """
    spec, controlled = mechanism.description.solve, mechanism.description.control is not None
    said = (spec.dt, spec.tol, spec.integrator, spec.rho_inf, spec.newmark)
    sticks = mechanism.flexible.sticks(spec.drive == "prescribed")
    return not (controlled or sticks) and all(x is None for x in said)


def solved(
    mechanism: Mechanism, motion: Motion | None, level: str, progress: Callback | None
) -> Result:
    """The run of a level; coupled within a tolerance where that is open and can be reached."""
    if level == "coupled" and steps_are_open(mechanism):
        with suppress(ConvergenceError, _TooDear):
            within = _limited(mechanism, motion, progress)
            return solve(mechanism, motion, level=level, tol=TOL, progress=within)
    return solve(mechanism, motion, level=level, progress=progress)


def _limited(mechanism: Mechanism, motion: Motion | None, progress: Callback | None) -> Callback:
    """A progress that ends a run which takes more steps than equal ones would be."""
    end = mechanism.description.solve.until or (motion or default_motion(mechanism)).duration
    left = int(end / default_step(mechanism, end)) // TOGETHER  # a run tells of so many at a time

    def told(done: int, of: int) -> None:
        nonlocal left
        left -= 1
        if left < 0 and done < of:
            raise _TooDear
        if progress is not None:
            progress(done, of)

    return told
