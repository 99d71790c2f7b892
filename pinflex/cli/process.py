"""The command as a process: signals that end it, and an output that takes no text or is gone."""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

# Sent by batch queues, `docker stop` and a terminal that closes; handled as Ctrl-C is.
_ENDING = tuple(
    getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGXCPU") if hasattr(signal, name)
)


@dataclass
class Ending:
    """Exit code of an interrupted command: 130 for Ctrl-C, 128 and its number for a signal."""

    code: int = 130


@contextmanager
def ending() -> Iterator[Ending]:
    """Signals that end a process become an interruption, so that what is done is saved."""
    end = Ending()

    def stop(number: int, _: FrameType | None) -> None:
        end.code = 128 + number
        raise KeyboardInterrupt

    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in _ENDING:
            if signal.getsignal(number) is signal.SIG_DFL:  # nohup ignores SIGHUP: so do we
                before[number] = signal.signal(number, stop)
    try:
        yield end
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def show_warning(message: Warning | str, *unused: object, **also_unused: object) -> None:
    """Write a warning as the command writes its errors: one line, without the place in the code."""
    sys.stderr.write(f"pinflex: {message}\n")


@contextmanager
def settled(ends: bool) -> Iterator[None]:
    """What is loaded by now is left out of garbage collections until the block ends.

    It lives as long as the process; going over it again takes a twentieth of a comparison. Where
    the process `ends` with the block, so does everything: Python would look through all of it.
    """
    gc.freeze()
    try:
        yield
    finally:
        if ends:
            gc.freeze()
        else:
            gc.unfreeze()


def escape_unprintable() -> None:
    """Every name can be printed, as an escape where the terminal has no such letter."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by who started us: the next file would take its place
            _occupy(1 if name == "stdout" else 2)
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif hasattr(stream, "reconfigure"):
            with contextlib.suppress(ValueError, OSError):
                stream.reconfigure(errors="backslashreplace")


def drop_stdout() -> None:
    """Forget what stdout did not take: at the end of Python it would be complained of again."""
    try:
        sys.stdout.flush()
    except (OSError, ValueError):
        with contextlib.suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _occupy(number: int) -> None:
    try:
        os.fstat(number)
    except OSError:
        null = os.open(os.devnull, os.O_WRONLY)
        if null != number:
            os.dup2(null, number)
            os.close(null)
