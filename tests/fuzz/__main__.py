"""`python -m tests.fuzz 3000 [--seed 11] [--only K]`: mangled inputs, and what answered them.

A worker process tries them one after the other, in memory that is limited; where it hangs or dies,
that input is a fault and the next worker goes on behind it.
"""

from __future__ import annotations

import argparse
import collections
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tests.fuzz.run import attempt, largest, limit_memory

SEED = 11
PATIENCE = 90.0  # [s] for one input; the worker's own timer rings before, but not inside C
_ROOT = Path(__file__).resolve().parents[2]
_ENVIRONMENT = os.environ | {"PYTHONPATH": str(_ROOT), "OMP_NUM_THREADS": "1"}


def worker(seed: int, first: int, last: int) -> None:
    """Try inputs and print a line of JSON for each."""
    limit_memory()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # commands write beside themselves
        for index in range(first, last):
            found = asdict(attempt(seed, index, Path(folder) / str(index)))
            print(json.dumps({**found, "memory": largest()}), flush=True)


def fuzz(seed: int, first: int, last: int) -> list[dict[str, Any]]:
    """The outcome of every input."""
    found: list[dict[str, Any]] = []
    index = first
    while index < last:
        command = [sys.executable, "-m", "tests.fuzz", "--worker", str(seed), str(index), str(last)]
        with subprocess.Popen(
            command,
            cwd=_ROOT,
            env=_ENVIRONMENT,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        ) as process:  # fmt: skip
            assert process.stdout is not None
            while index < last:
                line = _line(process)
                if line is None:
                    process.kill()
                    died = {"index": index, "kind": "?", "answer": "", "seconds": PATIENCE}
                    found.append({**died, "fault": "the process hung or died", "shown": ""})
                    index += 1
                    break
                found.append(line)
                index += 1
    return found


def _line(process: subprocess.Popen[str]) -> dict[str, Any] | None:
    import select

    assert process.stdout is not None
    ready, _, _ = select.select([process.stdout], [], [], PATIENCE)
    text = process.stdout.readline() if ready else ""
    while text and not text.startswith("{"):
        text = process.stdout.readline()
    return json.loads(text) if text else None


def report(found: list[dict[str, Any]]) -> str:
    """Numbers in a few lines, and every fault."""
    answers = collections.Counter(one["answer"] for one in found if not one["fault"])
    lines = [f"{len(found)} inputs, {sum(bool(one['fault']) for one in found)} faults"]
    lines += [f"  {count:5d} {answer}" for answer, count in answers.most_common()]
    slow = max(found, key=lambda one: one["seconds"])
    most = max(one.get("memory", 0.0) for one in found)
    lines.append(
        f"slowest {slow['seconds']} s (number {slow['index']}), memory {most / 1e9:.2f} GB"
    )
    for one in found:
        if one["fault"]:
            lines.append(f"{one['index']} {one['kind']}: {one['fault']} | {one['shown'][:200]!r}")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("count", nargs="?", type=int, default=200)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", type=int)
    parser.add_argument("--worker", nargs=3, type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.worker:
        worker(*args.worker)
        return 0
    if args.only is not None:
        args.first, args.count = args.only, 1
    found = fuzz(args.seed, args.first, args.first + args.count)
    print(report(found))
    return int(any(one["fault"] for one in found))


if __name__ == "__main__":
    sys.exit(main())
