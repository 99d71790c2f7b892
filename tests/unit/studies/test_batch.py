"""Work in parallel that nothing stops, and the journal that keeps it.

Claims:
    Many cases
    - half a line left by a kill is cut off, finished cases are not worked on again | - | exact |
      exact
    - an error in a copy of the process is raised here, the others end; copies need nothing that can
      be pickled but answers; a process of several threads is not copied | - | exact | exact
"""

from __future__ import annotations

import json
import os
import signal
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from pinflex.description.description import read
from pinflex.errors import ConvergenceError, DescriptionError
from pinflex.studies import batch
from pinflex.studies.batch import Interrupted, Lost, Record, answers, keys, run
from tests.cli.small import write_model

CASES = {"one": 1, "two": 2, "three": 3}


def square(x: int) -> dict[str, float]:
    return {"square": x * x, "infinite": float("inf")}


def test_numbers_that_are_none_are_left_empty():
    assert run(square, {"two": 2})["two"] == Record({"square": 4, "infinite": None})


@pytest.mark.parametrize(
    "error, line",
    [
        (ConvergenceError("t = 1 s:\n stopped. error.result holds the run so far."), "t = 1 s: s"),
        (ZeroDivisionError("by zero"), "ZeroDivisionError: by zero"),
        (MemoryError(), "not enough memory"),
    ],
)
def test_a_case_that_fails_leaves_one_line_and_the_others_go_on(error, line):
    def work(x: int) -> dict[str, float]:
        if x == 2:
            raise error
        return {"x": x}

    records = run(work, CASES)
    assert records["two"].error.startswith(line)
    assert "\n" not in records["two"].error and "error.result" not in records["two"].error
    assert [records[k].found for k in CASES] == [{"x": 1}, {}, {"x": 3}]


def test_what_the_journal_has_is_not_worked_on_again(tmp_path: Path):
    journal = tmp_path / "journal"
    seen: list[int] = []

    def work(x: int) -> dict[str, float]:
        seen.append(x)
        if x == 3 and len(seen) == 3:
            raise KeyboardInterrupt
        return {"x": x + 0.1}

    with pytest.raises(Interrupted, match="2 of 3 cases are done and kept in .*journal") as stop:
        run(work, CASES, journal=journal)
    assert set(stop.value.records) == {"one", "two"}
    half_a_line = b'{"key": "three", "fou'
    with journal.open("ab") as stream:
        stream.write(half_a_line)  # as a kill in the middle of writing leaves it
    steps: list[tuple[int, int]] = []
    records = run(work, CASES, journal=journal, progress=lambda *step: steps.append(step))
    assert seen == [1, 2, 3, 3] and steps == [(1, 1)]
    assert [records[k].found["x"] for k in CASES] == [1.1, 2.1, 3.1]  # exact through the file
    lines = [json.loads(line) for line in journal.read_text().splitlines()]
    assert [line["key"] for line in lines] == ["one", "two", "three"]
    run(work, CASES, journal=journal, fresh=True)
    assert seen[4:] == [1, 2, 3] and len(journal.read_text().splitlines()) == 3


def test_two_processes_do_not_write_one_journal(tmp_path: Path):
    def work(x: int) -> dict[str, float]:
        with pytest.raises(DescriptionError, match="another process is writing it"):
            run(square, CASES, journal=tmp_path / "journal")
        return {}

    run(work, {"one": 1}, journal=tmp_path / "journal")


def test_a_key_changes_with_model_case_question_and_named_files(tmp_path: Path):
    path = write_model(tmp_path, "arm")
    (tmp_path / "path.csv").write_text("t, shoulder\n")
    case = {"motion.file": "path.csv"}
    found = [*keys(read(path), [case, {}], "ked"), *keys(read(path), [case], "coupled")]
    (tmp_path / "path.csv").write_text("t, shoulder\n0, 0\n")
    found += keys(read(path), [case], "ked")
    write_model(tmp_path, "arm", [("0.004", "0.005")])
    found += keys(read(path), [case], "ked")
    assert len(set(found)) == len(found) == 5
    assert keys(read(path), [case], "ked") == found[-1:]


def killing_itself_at_three(x: int) -> int:
    if x == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return x * x


@pytest.mark.parametrize("copies", [True, False], ids=["copies", "new processes"])
def test_a_process_that_is_killed_costs_its_own_case_only(copies, monkeypatch):
    monkeypatch.setattr(batch, "can_fork", lambda: copies)
    found = dict(answers(killing_itself_at_three, range(6), jobs=2))
    assert isinstance(found.pop(3), Lost)
    assert found == {x: x * x for x in (0, 1, 2, 4, 5)}


def refusing_three(x: int) -> int:
    if x == 3:
        raise ValueError(f"{x} is refused")
    return x * x


@pytest.mark.skipif(sys.platform != "linux", reason="copies of a process are of Linux")
def test_an_error_in_a_copy_is_raised_here_and_ends_the_others(monkeypatch):
    started, fork = [], os.fork
    monkeypatch.setattr(os, "fork", lambda: started.append(fork()) or started[-1])
    with pytest.raises(ValueError, match="3 is refused"):
        dict(batch.forked(refusing_three, range(40), 2))
    assert len(started) == 2
    for pid in started:
        with pytest.raises(ChildProcessError):  # it has ended, and was waited for
            os.waitpid(pid, os.WNOHANG)


@pytest.mark.skipif(sys.platform != "linux", reason="copies of a process are of Linux")
def test_copies_have_what_this_process_has_and_take_turns():
    here = {"loaded": "once"}  # no function of a module, no item that could be pickled
    items = [lambda k=k: (here["loaded"], os.getpid(), k) for k in range(8)]
    found = dict(batch.forked(lambda item: item(), items, 2))
    assert [found[k][0::2] for k in range(8)] == [("once", k) for k in range(8)]
    workers = {pid for _, pid, _ in found.values()}
    assert 1 <= len(workers) <= 2 and os.getpid() not in workers


def test_a_process_of_several_threads_is_not_copied():
    with ThreadPoolExecutor(1) as threads:
        assert threads.submit(batch.can_fork).result() is False
