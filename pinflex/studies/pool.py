"""Many independent pieces of work in processes of their own: of this machine, or of a Dask cluster.

Answers come as they are ready. A process that dies takes one piece of work with it, not the rest.
Threads were no faster: load, start and outputs of a case are Python, which runs one at a time.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from functools import lru_cache, partial
from typing import Any

from pinflex import registered
from pinflex.errors import DescriptionError, PinflexError
from pinflex.kernel.library import warn_if_missing
from pinflex.studies.forks import KILLED, Lost, Work, alone, can_fork, forked

_WATCH = 0.5  # [s]
_PATIENCE = "10s"  # for a scheduler to answer


def answers(
    work: Work, items: Sequence[Any], jobs: int = 1, scheduler: str | None = None
) -> Iterator[tuple[int, Any]]:
    """Number and answer (or `Lost`) of every item, in the order in which they are ready.

    Raises:
        DescriptionError: No scheduler at that address, or Dask is not installed.
    """
    warn_if_missing()  # here: where the work is done, warnings are ignored
    if scheduler is not None:
        return _cluster(work, items, scheduler)
    if jobs == 1:
        return ((number, alone(work, item)) for number, item in enumerate(items))
    return forked(work, items, jobs) if can_fork() else _processes(work, items, jobs)


def _carried(made: bytes, work: Work, item: Any) -> Any:
    """The work in another process, with the registrations of the one that started it."""
    registered.repeat(made)
    return alone(work, item)


def _numbered(parent: int, made: bytes, work: Work, number: int, item: Any) -> tuple[int, Any]:
    """The work in a process of this machine, which leaves Ctrl-C to the one that started it."""
    if os.getpid() != parent:  # joblib may decide to work without processes
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        _end_with(parent)
    return number, _carried(made, work, item)


@lru_cache(maxsize=1)
def _end_with(parent: int) -> None:
    """End this process soon after its parent was killed; of itself it would wait for minutes."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _processes(work: Work, items: Sequence[Any], jobs: int) -> Iterator[tuple[int, Any]]:
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    left = dict(enumerate(items))
    while left:
        try:
            with closing(_parallel(work, [*left.items()], jobs)) as ready:
                for number, answer in ready:
                    del left[number]
                    yield number, answer
        except TerminatedWorkerError:
            # Work is handed out in order, at most 2 jobs ahead: one of these killed its process.
            for number in [*left][: 2 * jobs]:
                yield number, _isolated(work, number, left.pop(number))


def _isolated(work: Work, number: int, item: Any) -> Any:
    """The answer of a process that does nothing else."""
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    try:
        # two processes: with one, joblib would work in this one
        with closing(_parallel(work, [(number, item)], 2)) as ready:
            return next(ready)[1]
    except TerminatedWorkerError:
        return KILLED


def _parallel(work: Work, items: Sequence[tuple[int, Any]], jobs: int) -> Any:
    from joblib import Parallel, delayed, parallel_config

    made = registered.packed()
    with parallel_config(backend="loky", inner_max_num_threads=1):
        parallel = Parallel(
            n_jobs=jobs, return_as="generator_unordered", pre_dispatch="2 * n_jobs", batch_size=1
        )
        return parallel(
            delayed(_numbered)(os.getpid(), made, work, number, item) for number, item in items
        )


def _cluster(work: Work, items: Sequence[Any], scheduler: str) -> Iterator[tuple[int, Any]]:
    try:
        from distributed import CancelledError, Client, KilledWorker, as_completed
    except ImportError:
        raise DescriptionError(
            f"scheduler: {scheduler}: Dask is not installed. Run pip install 'pinflex[sweep]'."
        ) from None
    try:
        client = Client(scheduler, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise DescriptionError(
            f"scheduler: {scheduler}: no Dask scheduler answers there ({error}). Start one with "
            "`dask scheduler` and `dask worker ADDRESS`, and give the address that it prints."
        ) from error
    with client:
        futures = client.map(partial(_carried, registered.packed(), work), items, pure=False)
        place = {future.key: number for number, future in enumerate(futures)}
        for future in as_completed(futures, loop=client.loop):
            answer: Any
            try:
                answer = future.result()  # solved again if its worker was lost meanwhile
            except KilledWorker:
                answer = Lost("its worker was killed, each time that Dask tried")
            except (CancelledError, OSError) as error:
                raise PinflexError(
                    f"scheduler: {scheduler}: the connection was lost ({type(error).__name__}). "
                    "What is done is kept in the journal: start Dask and the same call again."
                ) from error
            yield place[future.key], answer
