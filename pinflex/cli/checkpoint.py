"""Checkpoints of a long run, against an end that no process can catch."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from pinflex.advice.solve import solve
from pinflex.errors import DescriptionError, RunInterrupted
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.result import Result


def with_checkpoints(
    mechanism: Mechanism, output: str | None, seconds: float, options: Mapping[str, Any]
) -> Result:
    """The run of `solve(mechanism, **options)`, interrupted to be saved and gone on with."""
    options = dict(options)
    _check(mechanism, output, options)
    assert output is not None
    spec, tell = mechanism.description.solve, options["progress"]
    reached, due, rung = -1.0, 0.0, False

    def step(done: int, steps: int) -> None:
        nonlocal rung
        tell(done, steps)
        if time.monotonic() > due:
            rung = True
            raise KeyboardInterrupt

    options["progress"] = step
    while True:
        due, rung = time.monotonic() + seconds, False
        try:
            return solve(mechanism, **options)
        except RunInterrupted as stop:
            if not rung:  # by somebody else
                raise
            part = stop.result
        if isinstance(part, Result) and len(part.t) > 1 and part.t[-1] > reached:
            part.save(output)
            options["resume"], reached = part, float(part.t[-1])
            options["until"] = options.get("until") or spec.until or _end(mechanism)
            options["samples"] = None
        else:
            seconds *= 2.0  # not one sample further: what is between samples would be done again


def _check(mechanism: Mechanism, output: str | None, options: Mapping[str, Any]) -> None:
    """Raise where a run has no state that it can go on from."""
    if output is None:
        raise DescriptionError("--checkpoint: where to? Give -o RUN.npz.")
    spec = mechanism.description.solve
    by_tol = options.get("tol") or (spec.tol if options.get("dt") is None else None)
    if (options.get("level") or spec.level) != "coupled" or by_tol or spec.only == "coupled":
        raise DescriptionError(
            f"{mechanism.name}: --checkpoint: only level coupled in steps (dt) can go on from a "
            "saved state. Leave it out, or give --level coupled --dt."
        )
    if mechanism.description.control is not None:
        raise DescriptionError(
            f"{mechanism.name}: --checkpoint: a run with a control cannot go on. Leave it out."
        )


def _end(mechanism: Mechanism) -> float:
    from pinflex.solver.solve import default_motion

    return default_motion(mechanism).duration
