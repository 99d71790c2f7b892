"""Pieces of work in copies of this process, which have loaded whatever it has.

A copy starts in some milliseconds, where a new process imports for a second. It is made where that
is safe: on Linux, in a process of one thread.
"""

from __future__ import annotations

import ctypes
import gc
import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, Pipe, wait
from typing import Any

Work = Callable[[Any], Any]
_ONE_AT_A_TIME = threading.Lock()
_PR_SET_PDEATHSIG = 1  # of Linux


@dataclass(frozen=True)
class Lost:
    """In place of an answer: why the process that was to give it did not."""

    reason: str


KILLED = Lost("its process was killed, by the system when it takes more memory than there is")


@dataclass
class _Copy:
    """A copy of this process: its number, the pipe to it, and what it works on."""

    pid: int
    pipe: Connection
    number: int


def alone(work: Work, item: Any) -> Any:
    """One piece of work on one BLAS thread: as many processes as cores leave none to spare."""
    from threadpoolctl import threadpool_limits

    # a worker of Dask may have several threads, a solve is made for one
    with _ONE_AT_A_TIME, threadpool_limits(limits=1), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a diverging run overflows before its error says so
        return work(item)


def can_fork() -> bool:
    """Whether copies of this process work: others of its threads would stop amid what they do."""
    return sys.platform == "linux" and threading.active_count() == 1


def forked(work: Work, items: Sequence[Any], jobs: int) -> Iterator[tuple[int, Any]]:
    """Number and answer (or `Lost`) of every item, as they are ready."""
    left = iter(range(len(items)))
    copies: dict[Connection, _Copy] = {}

    def more() -> None:
        number = next(left, None)
        if number is not None:
            one = _copy(work, items, number, [*copies])
            copies[one.pipe] = one

    try:
        for _ in range(jobs):
            more()
        while copies:
            for pipe in wait([*copies]):
                one = copies[pipe]  # type: ignore[index]
                try:
                    done, answer = pickle.loads(one.pipe.recv_bytes())
                except (EOFError, OSError):
                    done, answer = True, KILLED
                number = one.number
                if answer is KILLED or not _given(one, next(left, None)):
                    _end(copies.pop(one.pipe))
                    if answer is KILLED:
                        more()
                if not done:
                    raise answer
                yield number, answer
    finally:
        for one in copies.values():
            os.kill(one.pid, signal.SIGKILL)
            _end(one)


def _given(one: _Copy, number: int | None) -> bool:
    """Whether a copy has got another item to work on."""
    if number is None:
        return False
    one.pipe.send(number)
    one.number = number
    return True


def _end(one: _Copy) -> None:
    one.pipe.close()  # which ends it, if it waits
    os.waitpid(one.pid, 0)


def _copy(work: Work, items: Sequence[Any], number: int, others: Sequence[Connection]) -> _Copy:
    """A copy of this process that works on an item, and then on what it is given."""
    here, there = Pipe()
    parent = os.getpid()
    sys.stdout.flush()  # else it would be written twice
    sys.stderr.flush()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads of BLAS: it ends them itself
        pid = os.fork()
    if pid:
        there.close()
        return _Copy(pid, here, number)
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # left to the one that started it
        for pipe in (here, *others):
            pipe.close()
        _die_with(parent)
        gc.freeze()  # a collection would touch, and so copy, all that is shared
        _serve(work, items, number, there)
    finally:
        os._exit(0)  # nothing of the parent is cleaned up here


def _serve(work: Work, items: Sequence[Any], number: int, pipe: Connection) -> None:
    while True:
        try:
            answer = True, alone(work, items[number])
        except BaseException as error:
            answer = False, error
        try:
            packed = pickle.dumps(answer)
        except Exception as error:
            packed = pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")))
        try:
            pipe.send_bytes(packed)
            number = pipe.recv()
        except (EOFError, OSError):
            return


def _die_with(parent: int) -> None:
    """Let the system kill this process when the one that started it ends, however that ends."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it has ended already
        os._exit(1)
