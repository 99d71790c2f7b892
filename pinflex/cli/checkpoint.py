"""Checkpoints of a long run, against an end that no process can catch."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import FrameType
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
    spec = mechanism.description.solve
    reached = -1.0
    while True:
        with _alarm(seconds) as rung:
            try:
                return solve(mechanism, **options)
            except RunInterrupted as stop:
                if not rung.is_set():
                    raise
                part = stop.result
            except KeyboardInterrupt:  # before the first step
                if not rung.is_set():
                    raise
                part = None
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
    if not hasattr(signal, "setitimer"):
        raise DescriptionError("--checkpoint: this system has no timers. Leave it out.")
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


@contextmanager
def _alarm(seconds: float) -> Iterator[threading.Event]:
    """Interrupt once after some seconds; the event says that it was this."""
    rung = threading.Event()
    if sys.platform == "win32":  # it has no alarm: a second thread interrupts the first

        def interrupt() -> None:
            rung.set()
            _thread.interrupt_main()

        timer = threading.Timer(seconds, interrupt)
        timer.start()
        try:
            yield rung
        finally:
            timer.cancel()
        return

    def ring(number: int, frame: FrameType | None) -> None:
        rung.set()
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield rung
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
