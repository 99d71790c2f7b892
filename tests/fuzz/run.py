"""One mangled input tried: what answered it, how long it took, how much memory.

An input passes if a right result or one clear error answers it. Progress counts as an answer that
is on its way: a run that reports is stopped after a while.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import resource
import signal
import sys
import time
import traceback
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import pinflex as pf
from pinflex import progress as bars
from pinflex.__main__ import main
from pinflex.errors import PinflexError, RunInterrupted
from pinflex.studies.checking.check import check
from tests.fuzz import mangle

SECONDS = 20.0  # without an answer or progress
MEMORY = 2e9  # [bytes]
ENOUGH = 1.0  # [s] of a run that reports progress, before it is stopped
KINDS = ("description", "robot", "override", "stored", "command", "python")


@dataclass
class Outcome:
    """What became of an input: `fault` is "" where it passed."""

    index: int
    kind: str
    answer: str
    fault: str
    seconds: float
    shown: str = ""


class TooLong(BaseException):
    """No answer in time; no `except Exception` may swallow it."""


class Watch:
    """A timer that progress winds up again."""

    def __init__(self) -> None:
        self.began = time.monotonic()

    def __enter__(self) -> Watch:
        signal.signal(signal.SIGALRM, self._ring)
        signal.setitimer(signal.ITIMER_REAL, SECONDS)
        bars.Bar.__call__ = lambda bar, k, n: self(k, n)  # type: ignore[method-assign]
        return self

    def __exit__(self, *unused: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0.0)

    def __call__(self, step: int, steps: int) -> None:
        """Progress: the run is alive, and is not needed to its end."""
        signal.setitimer(signal.ITIMER_REAL, SECONDS)
        if time.monotonic() - self.began > ENOUGH:
            raise KeyboardInterrupt

    @staticmethod
    def _ring(*unused: object) -> None:
        raise TooLong


def attempt(seed: int, index: int, folder: Path) -> Outcome:
    """Try the input of a number, in a folder of its own."""
    rng = random.Random(f"{seed}-{index}")
    kind = KINDS[index % len(KINDS)]
    folder.mkdir(parents=True, exist_ok=True)
    shown: list[str] = []
    began, answer, fault = time.monotonic(), "result", ""
    with warnings.catch_warnings(), Watch() as watch:
        warnings.simplefilter("ignore")
        try:
            fault = _TRIES[kind](rng, folder, watch, shown)
        except PinflexError as error:
            answer, fault = type(error).__name__, _unclear(str(error))
        except (KeyboardInterrupt, RunInterrupted):
            answer = "progress"
        except TooLong:
            fault = f"no answer in {SECONDS:g} s: {_place()}"
        except MemoryError:
            fault = "memory"
        except RecursionError as error:
            fault = f"RecursionError: {error}"
        except Exception as error:
            fault = f"{type(error).__name__}: {str(error)[:200]} {_place()}"
    return Outcome(
        index, kind, answer, fault, round(time.monotonic() - began, 2), " ".join(shown)[:600]
    )


def _place() -> str:
    """Where in pinflex an error came from."""
    frames = traceback.extract_tb(sys.exc_info()[2])
    own = [f for f in frames if "/pinflex/" in f.filename]
    return "".join(f" {Path(f.filename).name}:{f.lineno}" for f in own[-3:])


def _unclear(message: str) -> str:
    """A message is one line of bounded length that ends its sentence."""
    if not message.strip() or len(message) > 2500 or not message.isprintable():
        return f"unclear message: {message[:200]!r}"
    return ""


def _write(folder: Path, files: tuple[str, str, str]) -> Path:
    name, urdf, text = files
    (folder / name).write_text(urdf, encoding="utf-8", errors="surrogatepass")
    path = folder / "scene.yaml"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    return path


def _use(rng: random.Random, model: pf.Mechanism, watch: Watch, shown: list[str]) -> str:
    """One thing that is done with a model that loads."""
    what = rng.choice(("check", "modes", *pf.LEVELS, *pf.LEVELS))
    shown.append(what)
    if what == "check":
        check(model)
        return ""
    if what == "modes":
        return "" if np.all(np.isfinite(pf.modes(model).frequencies)) else "modes: not finite"
    run = pf.solve(model, level=what, progress=watch)
    finite = all(np.isfinite(run.array(key)).all() for key in ("torque", "joint/q", "joint/v"))
    run.summary()
    return "" if finite else f"{what}: not finite, without a word"


def _description(rng: random.Random, folder: Path, watch: Watch, shown: list[str]) -> str:
    return _use(rng, pf.load(_write(folder, mangle.description(rng))), watch, shown)


def _robot(rng: random.Random, folder: Path, watch: Watch, shown: list[str]) -> str:
    return _use(rng, pf.load(_write(folder, mangle.robot(rng))), watch, shown)


def _override(rng: random.Random, folder: Path, watch: Watch, shown: list[str]) -> str:
    files = mangle.SCENES[rng.choice(list(mangle.SCENES))]
    changes = [mangle.override(rng, files[2]) for _ in range(rng.choice((1, 1, 2)))]
    shown += changes
    return _use(rng, pf.load(_write(folder, files), changes), watch, shown)


def stored_run(folder: Path) -> Path:
    """A run of the arm, solved once."""
    path = folder / "run.npz"
    if not path.exists():
        model = pf.load(_write(folder, mangle.SCENES["arm"]), ["solve.samples=11"])
        pf.solve(model, level="coupled").save(path)
    return path


def _stored(rng: random.Random, folder: Path, watch: Watch, shown: list[str]) -> str:
    """A stored run with a changed name, array or byte: read, written as a table, drawn, resumed."""
    whole = stored_run(folder.parent).read_bytes()
    bad, what = folder / "bad.npz", rng.randrange(5)
    if what == 0:
        bad.write_bytes(whole[: rng.randrange(len(whole))])
    elif what == 1:
        data = bytearray(whole)
        for _ in range(rng.randrange(1, 9)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        bad.write_bytes(bytes(data))
    else:
        with np.load(io.BytesIO(whole)) as archive:
            arrays: dict[str, Any] = {key: archive[key] for key in archive.files}
        header = json.loads(str(arrays["pinflex"]))
        key = rng.choice(list(arrays))
        if what == 2:
            header = mangle.tree(rng, header, rng.choice((1, 1, 2)))
            arrays["pinflex"] = np.array(json.dumps(header, default=str))
        elif what == 3:
            shown.append(key)
            arrays[key] = rng.choice((
                np.zeros(0), np.zeros((2, 3)), np.array("x"), np.array(np.nan), arrays[key][:-1]
                if arrays[key].ndim else np.zeros(1), arrays[key][..., None],
                np.full(arrays[key].shape, np.nan), np.zeros(arrays[key].shape, "c16"),
            ))  # fmt: skip
        else:
            shown.append(f"without {key}")
            del arrays[key]
        np.savez_compressed(bad, **arrays)
    argv = rng.choice((
        ["view", str(bad), "--no-open", "-o", str(folder / "page.html")],
        ["solve", str(folder.parent / "scene.yaml"), "--resume", str(bad), "--until", "0.4"],
        ["load"],
    ))  # fmt: skip
    if argv == ["load"]:
        run = pf.Result.load(bad)
        run.summary()
        run.to_csv(folder / "table.csv")
        return ""
    return _command(argv, shown)


_VALUES = (
    "0",
    "-1",
    "1e-3",
    "1e300",
    "nan",
    "x",
    "",
    "10" * 50,
    "ü",
    "a=b",
    "motor=1",
    "ked",
    "x=0:1:3",
)
_COMMANDS: dict[str, tuple[str, ...]] = {
    "check": ("--count", "--set", "--json", "--limit"),
    "modes": ("--count", "--preload", "--free-motors", "--pose", "--set", "--json"),
    "solve": ("--level", "--until", "--dt", "--tol", "--samples", "--set", "--json", "--resume",
              "-o", "--csv", "--checkpoint"),
    "compare": ("--levels", "--set"),
    "sweep": ("--set", "--outputs", "--level", "--jobs", "--out", "--zip", "--json"),
    "map": ("--grid", "--count", "--jobs", "--out", "--preload"),
    "advise": ("--tol", "--asked", "--json"),
    "view": ("--field", "--scale", "-o", "--no-open", "--meshes", "--rigid", "--png"),
    "verify": ("no such case", "--nothing"),
    "bench": ("--nothing",),
}  # fmt: skip


def _arguments(rng: random.Random, folder: Path, watch: Watch, shown: list[str]) -> str:
    scene = rng.choice(list(mangle.SCENES))
    model = _write(folder, mangle.SCENES[scene])
    name = rng.choice(list(_COMMANDS))
    argv = [name]
    if name not in ("verify", "view"):
        argv.append(rng.choice((str(model),) * 6 + ("3rr", "/dev/null", "", str(folder))))
    elif name == "view":
        argv.append(rng.choice((str(stored_run(folder.parent)), str(model), "none.npz")))
        argv += ["--no-open", "-o", str(folder / "page.html")]
    for _ in range(rng.choice((1, 1, 2, 3))):
        option = rng.choice(_COMMANDS[name])
        argv.append(option)
        if option == "--set":
            argv.append(mangle.override(rng, mangle.SCENES[scene][2]))
        elif option not in ("--json", "--zip", "--free-motors", "--no-open"):
            argv.append(rng.choice((*_VALUES, str(folder / "out.npz"), str(folder))))
    if name in ("bench", "verify"):
        argv.append("--nothing")
    if name in ("sweep", "map") and "--jobs" not in argv:
        argv += ["--jobs", "1"]
    return _command(argv, shown)


def _command(argv: list[str], shown: list[str]) -> str:
    shown += argv
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code: Any = main(argv)
        except SystemExit as stop:
            code = stop.code
    said = err.getvalue()
    if "internal error" in said or "Traceback" in said or "not enough memory" in said:
        return said[:300]
    if code not in (0, 1, 2, 130):
        return f"exit code {code}: {said[:200]}"
    if code in (1, 2) and said.count("\n") > 3:
        return f"{said.count(chr(10))} lines of error: {said[:200]}"
    return ""


_CALLS: dict[str, tuple[str, ...]] = {  # public functions and what may be given to them
    "solve": ("level", "until", "dt", "samples", "tol", "integrator", "rho_inf", "newmark", "drive",
              "ked", "kp", "kd", "start", "asked", "control", "resume"),
    "modes": ("count", "preload", "free_motors", "q"),
    "cycloid": ("joints", "platform", "duration"),
    "harmonic": ("joints", "frequency", "phase", "smooth", "duration"),
    "trapezoid": ("joints", "ramp", "duration", "speed"),
    "formula": ("joints", "duration", "absolute"),
    "circle": ("center", "radius", "omega", "plane", "phase", "direction", "fixed", "ramp"),
    "sampled": ("t", "joints", "file", "absolute", "periodic"),
    "hold": ("duration",),
    "load": ("source", "overrides"),
    "check": ("count",),
}  # fmt: skip
_GOOD: dict[str, Any] = {
    "joints": {"shoulder": 0.2}, "duration": 0.1, "frequency": 2.0, "ramp": 0.02, "radius": 0.1,
    "omega": 1.0, "center": [0, 0], "t": [0, 0.1, 0.2, 0.3], "count": 3, "until": 0.02,
}  # fmt: skip


def _python(rng: random.Random, folder: Path, watch: Watch, shown: list[str]) -> str:
    name = rng.choice(("solve", "solve", "solve", *_CALLS))
    keys = _CALLS[name]
    given = {key: _GOOD[key] for key in keys if key in _GOOD and name not in ("solve", "modes")}
    for key in rng.sample(keys, min(len(keys), rng.choice((1, 1, 2)))):
        given[key] = mangle.value(rng)
    if name == "sampled":
        given.setdefault("joints", {})
        if isinstance(given["joints"], dict):
            given["joints"] = {"shoulder": [0, 0.1, 0.2, 0.1]}
    shown.append(f"{name}({given!r:.300})")
    if name == "load":
        source = given.pop("source", str(_write(folder, mangle.SCENES["arm"])))
        pf.load(source, **given)
        return ""
    scene = mangle.SCENES[rng.choice(("arm", "fourbar", "plane"))]
    model = pf.load(_write(folder, scene))
    if name == "solve":
        run = pf.solve(model, progress=watch, **given)
        return "" if np.isfinite(run.torque).all() else "torque: not finite, without a word"
    if name == "modes":
        pf.modes(model, **given)
    elif name == "check":
        check(model, **given)
    else:
        motion = getattr(pf, name)(**given)
        pf.solve(model, motion, level=rng.choice(pf.LEVELS), until=0.01, progress=watch)
    return ""


_TRIES: dict[str, Callable[[random.Random, Path, Watch, list[str]], str]] = {
    "description": _description,
    "robot": _robot,
    "override": _override,
    "stored": _stored,
    "command": _arguments,
    "python": _python,
}


def limit_memory() -> None:
    """This process may take MEMORY more than it has."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = int(pages * os.sysconf("SC_PAGE_SIZE") + MEMORY)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def largest() -> float:
    """Most memory that this process had [bytes].

    Not ru_maxrss, which begins with that of the process that started this one.
    """
    status = Path("/proc/self/status").read_text("utf-8")
    return 1024.0 * int(status.partition("VmHWM:")[2].split()[0])


__all__ = ["Outcome", "attempt", "largest", "limit_memory", "zipfile"]
