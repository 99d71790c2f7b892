"""Time to reach an error on the race scenes R1 to R4, beside Exudyn where it is installed.

What is tuned by hand is tuned for either side by the same rule, from coarse to fine: a setting
counts if it and the next finer one both meet the error, for a lucky hit is no accuracy. The
cheapest setting of each is then timed in fresh processes, the two sides in turn.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError, SceneError
from pinflex.levels.outputs import between, relative
from pinflex.mechanics.mechanism import load
from pinflex.solver.scene import Scene
from pinflex.threads import one_blas_thread
from tests.benchmarks.race.case import Arrays, march, outputs, scene
from tests.benchmarks.race.scenes import RACES, Overrides, Peer, Race

PEER = Path(__file__).with_name("peer.py")
CASE = "tests.benchmarks.race.case"  # the module that makes one run of ours
USER = "tests.benchmarks.race.user"  # what that run costs with all that is around it
REPEATS = 3  # fresh processes of each
RESOLUTIONS = tuple(0.1 * 10.0 ** (-k / 4) for k in range(25))  # 0.1 to 1e-7
STEPS = (400, 800, 1600, 3200, 6400, 12800, 25600)  # of the alpha family; 400 samples each
Say = Callable[[str], None]
_AXES = {"axial": 0, "transverse": 1}


@dataclass(frozen=True)
class Entry:
    """One way to reach the error of a scene.

    Attributes:
        label: As a person would say it. command: Its process, without the file it writes.
        errors: By output. wall, cpu: Best seconds of the solver call over the fresh processes.
        every: CPU seconds in each of them.
        first: CPU seconds of pinflex's first call in a process, with the imports it needs.
        kernel: Share of its CPU time in the compiled kernel.
        around: Of tol and the peer, CPU seconds of the whole process: imports, model, run, torques;
            of tol also those of load, solve and every output in a process that has all imports.
    """

    label: str
    command: tuple[str, ...]
    errors: dict[str, float]
    cpu: float = float("nan")
    wall: float = float("nan")
    first: float = float("nan")
    every: tuple[float, ...] = ()
    kernel: float = float("nan")
    around: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """A scene, its reference, and who takes how long.

    Attributes:
        race: The scene. limits: Error to reach by output: what is asked, or the floor above it.
        checks: The reference against other models and methods: errors by name and output.
        peer_floor: The refined peer against the reference; empty without a peer.
        entries: Those that reach the error: tol, radau, alpha, peer.
        at_tol: Errors of solve(tol=...) with the error asked for, whether it reaches it or not.
    """

    race: Race
    limits: dict[str, float]
    checks: dict[str, dict[str, float]]
    peer_floor: dict[str, float]
    entries: dict[str, Entry]
    at_tol: dict[str, float] = field(default_factory=dict)

    def ratio(self, ways: Sequence[str], of: str = "peer") -> tuple[float, float, float]:
        """CPU time of an entry over that of pinflex's cheapest of `ways`; NaN if one is missing.

        Args:
            ways: Entries. of: The entry in the numerator.
        Returns:
            Of the best of the processes, and the least and the largest of processes in turn.
        """
        ours = [self.entries[way] for way in ways if way in self.entries]
        other = self.entries.get(of)
        if other is None or not ours:
            return (float("nan"),) * 3
        best = min(ours, key=lambda entry: entry.cpu)
        turns = [a / b for a, b in zip(other.every, best.every, strict=True)]
        return other.cpu / best.cpu, min(turns), max(turns)


Attempt = Callable[[], Entry]  # one setting tried, or SceneError


def errors(
    race: Race, found: Mapping[str, Array], reference: Mapping[str, Array]
) -> dict[str, float]:
    """max_t |x - ref| / max_t |ref| of what the scene compares."""
    return {
        name: relative(_quantity(name, found, reference), _quantity(name, reference, reference))
        for name in race.limits
    }


def _quantity(name: str, found: Mapping[str, Array], rigid: Mapping[str, Array]) -> Array:
    """Torque, mid-point deflection, or the platform's deviation in the rigid platform's frame."""
    if name == "rotation":
        return between(rigid["rigid_rotation"], found["rotation"])
    if name != "position" and name not in _AXES:
        return found[name]
    away = np.einsum(
        "tji,tj->ti", rigid["rigid_rotation"], found["position"] - rigid["rigid_position"]
    )
    return np.asarray(away if name == "position" else away[:, _AXES[name]])


def with_peer(wanted: Sequence[str]) -> bool:
    """Whether the peer can run here: installed, and its models at hand."""
    unknown = [key for key in wanted if key not in RACES]
    if unknown:
        raise DescriptionError(f"{unknown[0]}: no such scene. Allowed: {', '.join(RACES)}.")
    return find_spec("exudyn") is not None and PEER.exists()


def run(keys: Sequence[str], say: Say) -> list[Outcome]:
    """Race on the scenes named, one after the other."""
    peer = with_peer(keys)
    with one_blas_thread(), tempfile.TemporaryDirectory() as folder:
        return [_race(RACES[key], Path(folder) / "out.npz", say, peer) for key in keys]


def _race(race: Race, out: Path, say: Say, peer: bool) -> Outcome:
    say(f"{race.key}: reference and its checks")
    reference = _solve(race, race.reference, "careful", race.finest)
    others = {name: _solve(race, *how) for name, *how in race.checks}  # type: ignore[arg-type]
    checks = {name: errors(race, other, reference) for name, other in others.items()}
    floor: dict[str, float] = {}
    if peer and race.peer_finest is not None:
        say(f"{race.key}: the refined peer")
        floor = errors(race, _process(_peer(race, race.peer_finest), out)[0], reference)
    # The peer cannot be asked for less than its finest model leaves, nor then can pinflex.
    limits = {name: max(limit, 1.2 * floor.get(name, 0.0)) for name, limit in race.limits.items()}
    found = {}
    for method in ("tol", "radau", "alpha"):
        say(f"{race.key}: {method}")
        found[method] = _search(race, method, limits, reference)
    if peer and race.peer:
        say(f"{race.key}: settings of the peer")
        found["peer"] = _search_peer(race, limits, reference, out)
    entries = {key: entry for key, entry in found.items() if entry is not None}
    say(f"{race.key}: timing in fresh processes")
    at_tol = _solve(race, race.models[-1], "tol", min(race.limits.values()))
    return Outcome(
        race, limits, checks, floor, _timed(entries, out), errors(race, at_tol, reference)
    )


def _solve(race: Race, overrides: Sequence[str], method: str, value: float) -> Arrays:
    given = scene(load(race.model, [*race.always, *overrides]), race.asked)
    return outputs(given, march(given, method, value).run)


def _search(race: Race, method: str, limits: dict[str, float], reference: Arrays) -> Entry | None:
    """The cheapest setting of pinflex that reaches the error, over the models offered."""
    end = float(load(race.model).description.solve.until or 0.0)
    goal = min(limits.values())
    values = {
        "tol": [min(0.1, 4.0 * goal) / 2**k for k in range(8)],
        "radau": RESOLUTIONS,
        "alpha": [end / n for n in STEPS],
    }[method]

    def attempts(overrides: Overrides) -> Iterator[Attempt]:
        given = scene(load(race.model, [*race.always, *overrides]), race.asked)
        for value in values:
            yield partial(attempt, given, overrides, value)

    def attempt(given: Scene, overrides: Overrides, value: float) -> Entry:
        timed = min((march(given, method, value) for _ in range(2)), key=lambda r: r.cpu)
        label = f"{method} {value:.2g}, {' '.join(overrides) or 'as shipped'}"
        command = (
            *(sys.executable, "-m", CASE, race.model, method, repr(value)),
            *(",".join(race.asked), *race.always, *overrides),
        )
        found = errors(race, outputs(given, timed.run), reference)
        return Entry(label, command, found, timed.cpu)

    return _cheapest(map(attempts, race.models), limits, 5.0)


def _search_peer(
    race: Race, limits: dict[str, float], reference: Arrays, out: Path
) -> Entry | None:
    """The cheapest setting of the peer, by the same rule."""

    def attempt(settings: dict[str, object]) -> Entry:
        command = _peer(race, settings)
        arrays, cost = _process(command, out)
        label = " ".join(f"{k}={v}" for k, v in settings.items())
        found = errors(race, arrays, reference)
        return Entry(f"Exudyn {cost['version']}, {label}", command, found, cost["cpu"])

    def attempts(settings: Peer) -> Iterator[Attempt]:
        return (partial(attempt, {**settings, "steps": steps}) for steps in race.peer_steps)

    return _cheapest(map(attempts, race.peer), limits, 3.0)


def _cheapest(
    models: Iterable[Iterable[Attempt]], limits: dict[str, float], patience: float
) -> Entry | None:
    """The cheapest entry that meets the limits, as does the next finer one of its model.

    Args:
        models: Of each, attempts from coarse to fine. limits: Error to reach by output.
        patience: A model is given up at so many times the cost of the cheapest entry.
    """
    best: Entry | None = None
    for attempts in models:
        before: Entry | None = None
        for attempt in attempts:
            try:
                entry = attempt()
            except SceneError:
                before = None
                continue
            if best is not None and entry.cpu > patience * best.cpu:
                break
            if not _within(entry.errors, limits):
                before = None
                continue
            if before is not None:
                best = before if best is None or before.cpu < best.cpu else best
                break
            before = entry
    return best


def _within(found: dict[str, float], limits: dict[str, float]) -> bool:
    return all(found[name] <= limit for name, limit in limits.items())


def _peer(race: Race, settings: Mapping[str, object]) -> tuple[str, ...]:
    options = [f"{key}={value}" for key, value in settings.items()]
    return (sys.executable, str(PEER), race.key.lower(), *options)


def _process(command: Sequence[str], out: Path) -> tuple[Arrays, dict[str, Any]]:
    """What a process wrote and what it cost; its file is the argument after the scene."""
    at = command.index(CASE) + 2 if CASE in command else 3
    whole = [*command[:at], str(out), *command[at:]]
    done = subprocess.run(whole, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SceneError(f"{' '.join(whole)}: {done.stderr.strip()[-300:]}")
    with np.load(out) as stored:
        arrays = dict(stored)
    if "position" in arrays and arrays["position"].shape[1] == 2:  # a planar sensor
        arrays["position"] = np.pad(arrays["position"], ((0, 0), (0, 1)))
    return arrays, json.loads(done.stdout.splitlines()[-1])


def _around(command: Sequence[str]) -> dict[str, float]:
    """CPU seconds of what is around a run by tol, in a process that begins with no import."""
    python, _, _, model, _, tol, *rest = command
    done = subprocess.run([python, "-m", USER, model, tol, *rest], capture_output=True, check=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found


def _timed(entries: dict[str, Entry], out: Path) -> dict[str, Entry]:
    """Best of the fresh processes, the entries in turn."""
    costs: dict[str, list[dict[str, Any]]] = {key: [] for key in entries}
    around: dict[str, list[dict[str, float]]] = {"tol": []} if "tol" in entries else {}
    for _ in range(REPEATS):
        for key, entry in entries.items():
            costs[key].append(_process(entry.command, out)[1])
            if key in around:
                around[key].append(_around(entry.command))
    if "peer" in entries:
        around["peer"] = [{"process": cost["process"]} for cost in costs["peer"]]
    nan = float("nan")
    return {
        key: replace(
            entry,
            cpu=min(c["cpu"] for c in costs[key]),
            every=tuple(c["cpu"] for c in costs[key]),
            wall=min(c["wall"] for c in costs[key]),
            first=min(c.get("first_cpu", nan) for c in costs[key]),
            kernel=min(c.get("kernel", nan) for c in costs[key]),
            around={k: min(c[k] for c in around[key]) for k in around[key][0]}
            if key in around
            else {},
        )
        for key, entry in entries.items()
    }
