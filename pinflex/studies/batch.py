"""Many cases, some of which may fail, worked on in parallel and kept one by one as they end.

The journal has one JSON object a line; a case counts as done when its line is on the disk. A line
is found again by its key, which names the case and everything that its numbers follow from.
"""

from __future__ import annotations

import ctypes
import gc
import hashlib
import json
import os
import pickle
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from multiprocessing.connection import Connection, Pipe, wait
from pathlib import Path
from typing import IO, Any

import yaml

from pinflex import registered
from pinflex.description.description import Description
from pinflex.errors import DescriptionError, PinflexError, reason
from pinflex.kernel.library import warn_if_missing
from pinflex.recovery.meta import version
from pinflex.results.pose_map import Columns
from pinflex.threads import one_blas_thread
from pinflex.writing import lock, plain, writable

# A process that dies takes one piece of work with it, not the rest. A copy of this process has
# loaded whatever it has; it is made where that is safe: on Linux, in a process of one thread.
# Threads share Python, in which a case of delta spends two thirds of its time (of 105 ms; the rest
# is the compiled kernel): they work where there are no copies, on what does not travel.

Task = Callable[[Any], Any]
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


def alone(work: Task, item: Any) -> Any:
    """One piece of work on one BLAS thread: as many processes as cores leave none to spare."""
    from threadpoolctl import threadpool_limits

    # a worker of Dask may have several threads, a solve is made for one
    with _ONE_AT_A_TIME, threadpool_limits(limits=1), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a diverging run overflows before its error says so
        return work(item)


def can_fork() -> bool:
    """Whether copies of this process work: others of its threads would stop amid what they do."""
    return sys.platform == "linux" and threading.active_count() == 1


def forked(work: Task, items: Sequence[Any], jobs: int) -> Iterator[tuple[int, Any]]:
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
                if answer is KILLED or not _sent(one, next(left, None)):
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


def _sent(one: _Copy, number: int | None) -> bool:
    """Send a copy its next item; False where there is none."""
    if number is None:
        return False
    one.pipe.send(number)
    one.number = number
    return True


def _end(one: _Copy) -> None:
    one.pipe.close()  # which ends it, if it waits
    os.waitpid(one.pid, 0)


def _copy(work: Task, items: Sequence[Any], number: int, others: Sequence[Connection]) -> _Copy:
    """A copy of this process that works on an item, and then on those sent to it."""
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


def _serve(work: Task, items: Sequence[Any], number: int, pipe: Connection) -> None:
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


_SWITCH = 5e-4  # [s] who comes out of the kernel waits so long for Python, not ten times as long
_WATCH = 0.5  # [s]
_PATIENCE = "10s"  # for a scheduler to answer


def answers(
    work: Task,
    items: Sequence[Any],
    jobs: int = 1,
    scheduler: str | None = None,
    pickles: bool = True,
) -> Iterator[tuple[int, Any]]:
    """Number and answer (or `Lost`) of every item, in the order in which they are ready.

    `pickles`: whether work and items may travel; else threads do what copies cannot.
    """
    warn_if_missing()  # here: where the work is done, warnings are ignored
    if scheduler is not None:
        return _cluster(work, items, scheduler)
    if jobs == 1:
        return ((number, alone(work, item)) for number, item in enumerate(items))
    if can_fork():
        return forked(work, items, jobs)
    return _processes(work, items, jobs) if pickles else threaded(work, items, jobs)


def threaded(work: Task, items: Sequence[Any], threads: int) -> Iterator[tuple[int, Any]]:
    """Number and answer of every item, by threads of this process."""
    switch = sys.getswitchinterval()
    pool = ThreadPoolExecutor(threads)
    with one_blas_thread(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # as in `alone`
        sys.setswitchinterval(_SWITCH)
        try:
            futures = {pool.submit(work, item): number for number, item in enumerate(items)}
            for future in as_completed(futures):
                yield futures[future], future.result()
        finally:
            pool.shutdown(cancel_futures=True)
            sys.setswitchinterval(switch)


def _carried(made: bytes, work: Task, item: Any) -> Any:
    """The work in another process, with the registrations of the one that started it."""
    registered.repeat(made)
    return alone(work, item)


def _numbered(parent: int, made: bytes, work: Task, number: int, item: Any) -> tuple[int, Any]:
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


def _processes(work: Task, items: Sequence[Any], jobs: int) -> Iterator[tuple[int, Any]]:
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


def _isolated(work: Task, number: int, item: Any) -> Any:
    """The answer of a process that does nothing else."""
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    try:
        # two processes: with one, joblib would work in this one
        with closing(_parallel(work, [(number, item)], 2)) as ready:
            return next(ready)[1]
    except TerminatedWorkerError:
        return KILLED


def _parallel(work: Task, items: Sequence[tuple[int, Any]], jobs: int) -> Any:
    from joblib import Parallel, delayed, parallel_config

    made = registered.packed()
    with parallel_config(backend="loky", inner_max_num_threads=1):
        parallel = Parallel(
            n_jobs=jobs, return_as="generator_unordered", pre_dispatch="2 * n_jobs", batch_size=1
        )
        return parallel(
            delayed(_numbered)(os.getpid(), made, work, number, item) for number, item in items
        )


def _cluster(work: Task, items: Sequence[Any], scheduler: str) -> Iterator[tuple[int, Any]]:
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


Work = Callable[[Any], dict[str, Any]]


@dataclass(frozen=True)
class Record:
    """Outcome of a case: numbers and texts by name, or one line on why there are none.

    Numbers that are not finite are None.
    """

    found: Mapping[str, Any]
    error: str = ""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C: `records` has the cases that ended, `table` what the caller makes of them."""

    def __init__(self, records: Mapping[str, Record], message: str) -> None:
        super().__init__(message)
        self.records = records
        self.table: Columns | None = None


def run(
    work: Work,
    cases: Mapping[str, Any],
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    journal: str | Path | None = None,
    fresh: bool = False,
    progress: Callable[[int, int], None] | None = None,
    pickles: bool = True,
) -> dict[str, Record]:
    """The record of every case, by its key; `pickles`: whether cases may travel to processes.

    Raises:
        DescriptionError: The journal cannot be written or is in use; no such scheduler.
        Interrupted: On Ctrl-C.
    """
    if jobs < 1:
        raise DescriptionError(f"jobs: {jobs}. Give 1 or more.")
    with _opened(journal) as stream:
        if fresh and stream is not None:
            stream.truncate(0)
        records = _kept(stream, cases)
        left = [key for key in cases if key not in records]
        todo = [cases[key] for key in left]
        ready = answers(partial(_outcome, work), todo, jobs, scheduler, pickles)
        try:
            for ended, (number, answer) in enumerate(ready, 1):
                record = Record({}, answer.reason) if isinstance(answer, Lost) else answer
                if stream is not None:
                    _write(stream, left[number], record)
                records[left[number]] = record
                if progress is not None:
                    progress(ended, len(left))
        except KeyboardInterrupt:
            records |= _kept(stream, cases)  # it may come between a line and its record
            said = f"interrupted: {len(records)} of {len(cases)} cases are done"
            if journal is not None:
                said += f" and kept in {journal}; the same command goes on from there"
            raise Interrupted(records, said) from None
    return records


def _outcome(work: Work, case: Any) -> Record:
    """Outcome of a case; an error in one does not stop the others."""
    try:
        return Record(plain(work(case)))
    except PinflexError as error:
        why = reason(error)
    except MemoryError:
        why = "not enough memory"
    except Exception as error:
        why = f"{type(error).__name__}: {error}"
    return Record({}, " ".join(why.split()))


# Keys ------------------------------------------------------------------------------------------


def keys(description: Description, cases: Iterable[Any], *about: Any) -> list[str]:
    """A key for each case, which changes with whatever changes the numbers of the case.

    These are the version, the texts of the model, the contents of the files that it or a case
    names, the case itself and `about` (plain JSON values: level, outputs, ...).
    """
    cases = list(cases)
    model = hashlib.sha256(version().encode())
    for text in (description.urdf_text, description.yaml_text):
        model.update(b"\0" + text.encode())
    folder = Path() if description.path is None else description.path.parent
    for name in sorted({*_texts([yaml.safe_load(description.yaml_text), cases])}):
        with_it = folder / name
        if len(name) < 256 and "\0" not in name and with_it.is_file():
            model.update(b"\0" + with_it.read_bytes())
    return [
        hashlib.sha256(
            json.dumps([model.hexdigest(), case, about], sort_keys=True).encode()
        ).hexdigest()[:32]
        for case in cases
    ]


def _texts(value: Any) -> Iterator[str]:
    """Every text in nested lists and mappings."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        yield from _texts([*value.values()])
    elif isinstance(value, Sequence):
        for item in value:
            yield from _texts(item)


# The journal -----------------------------------------------------------------------------------


@contextmanager
def _opened(path: str | Path | None) -> Iterator[IO[bytes] | None]:
    """The journal, for this process alone until it ends, however it ends."""
    if path is None:
        yield None
        return
    writable(path)
    with Path(path).open("a+b") as stream:
        if not lock(stream):
            raise DescriptionError(
                f"{path}: another process is writing it. Wait for that one, or choose another "
                "output file."
            )
        try:
            yield stream
        finally:
            stream.flush()
            if not Path(path).stat().st_size:
                Path(path).unlink()  # refused before the first case


def _kept(stream: IO[bytes] | None, cases: Iterable[str]) -> dict[str, Record]:
    """The records of these cases; a last line that a kill left unfinished is cut off."""
    if stream is None:
        return {}
    stream.seek(0)
    lines = stream.read().split(b"\n")
    stream.truncate(stream.tell() - len(lines[-1]))
    found = {}
    for line in lines[:-1]:
        try:
            entry = json.loads(line)
            record = Record(entry["found"], entry["error"])
            if isinstance(record.found, dict) and isinstance(record.error, str):
                found[entry["key"]] = record
        except (ValueError, TypeError, KeyError):
            continue  # a line of something else: the case is worked on again
    return {key: found[key] for key in cases if key in found}


def _write(stream: IO[bytes], key: str, record: Record) -> None:
    stream.write(json.dumps({"key": key, **asdict(record)}).encode() + b"\n")
    stream.flush()
    os.fsync(stream.fileno())
