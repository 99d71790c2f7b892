"""Natural frequencies and platform stiffness over a grid of poses, or along a motion."""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.actuation.drive import nominal
from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.description import Description
from pinflex.description.motions.motion import Motion
from pinflex.description.reading.schema import shown
from pinflex.errors import ConvergenceError, DescriptionError, SingularityError
from pinflex.levels.modes import first_modes, modes
from pinflex.levels.rigid import side
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.mechanics.model.tree import sliding
from pinflex.progress import Progress, barred, callback
from pinflex.results.pose_map import PoseMap
from pinflex.studies.batch import Record, keys, run
from pinflex.studies.checking.check import is_loaded, require_vibrating
from pinflex.studies.pose import moved, platform_compliance, tracked
from pinflex.studies.sweep import Case, combined, described, listed

_SPARE = 4  # modes followed beside those shown: one of them may come down among the shown


@public
@barred
def pose_map(
    model: str | Path | Description | Mechanism,
    grid: Mapping[str, object] | None = None,
    *,
    along: Motion | None = None,
    instants: int = 41,
    count: int = 6,
    preload: str = "gravity",
    free_motors: bool = False,
    stiffness: bool = True,
    jobs: int = 1,
    scheduler: str | None = None,
    journal: str | Path | None = None,
    fresh: bool = False,
    progress: Progress = None,
) -> PoseMap:
    """Natural frequencies, followed from pose to pose, and the 6x6 compliance of the platform.

    Args:
        model: A model, or what `load` takes.
        grid: Displacements from home by motor or by platform coordinate: x, y, z (m), rz, ry, rx
            (rad), as in `pose.moved`; increasing lists, or texts such as "-.05:.05:9". Empty: home.
        along: Motion whose poses are taken instead; its grid is the time t (s).
        instants: How many of them, evenly in time.
        count: How many frequencies.
        preload: "gravity": about the static equilibrium; "none": about the undeformed pose.
        free_motors: Frequencies with free motors.
        stiffness: Compliance of the platform too.
        jobs: Processes of this machine.
        scheduler, journal, fresh, progress: As in `sweep`.

    Returns:
        The map; a pose that cannot be reached, or has no equilibrium, says why.

    Raises:
        DescriptionError: Nothing that vibrates, a coordinate that does not exist, or a grid beside
            a motion.
        MotionError, SingularityError: The motion cannot be followed.
        ConvergenceError: Not one pose has an answer.
        Interrupted: On Ctrl-C.
    """
    description = described(model)
    mechanism = model if isinstance(model, Mechanism) else load(description)
    require_vibrating(mechanism)
    if along is not None and grid:
        raise DescriptionError(f"{mechanism.name}: map: a grid and a motion. Give one of them.")
    axes, units, cases = poses_of(mechanism, grid, along, instants)
    preload = preload if is_loaded(mechanism) else "none"
    named = keys(description, cases, "map", count, preload, free_motors, stiffness)
    settings = {"preload": preload, "free_motors": free_motors}
    records = run(
        partial(_at, pickle.dumps(description), count + _SPARE, stiffness, settings),
        dict(zip(named, cases, strict=True)), jobs=jobs, scheduler=scheduler, journal=journal,
        fresh=fresh, progress=callback(progress),
    )  # fmt: skip
    shape = tuple(map(len, axes.values()))
    found = dict(zip(np.ndindex(*shape), (records[key] for key in named), strict=True))
    if all(record.error for record in found.values()):
        first = next(iter(found.values()))
        raise ConvergenceError(f"{mechanism.name}: not one pose has an answer: {first.error}")
    tables = _gathered(mechanism, shape, found, count, None if along is None else (0,))
    # a journal of an older version, or a failed pose, has none
    sides = np.array([(x.found or {}).get("side", [np.nan])[0] for x in found.values()], float)
    return PoseMap(
        mechanism.name, axes, units, *tables, preload, free_motors, sides.reshape(shape)
    )  # fmt: skip


def poses_of(
    mechanism: Mechanism, grid: Mapping[str, object] | None, along: Motion | None, instants: int
) -> tuple[dict[str, Array], dict[str, str], list[Case]]:
    """Axes of a grid of displacements or instants of a motion, their units, and the poses."""
    if along is not None:
        if instants < 2:
            raise DescriptionError(f"map: instants: {instants}. Give at least 2.")
        end = mechanism.description.solve.until or along.duration
        t = np.linspace(0.0, min(end, along.duration) or end, instants)
        q = nominal(mechanism, along, t).q
        cases = [{"t": x, "q": row} for x, row in zip(t.tolist(), q.tolist(), strict=True)]
        return {"t": t}, {"t": "s"}, cases
    where = f"{mechanism.name}: map"
    axes = {name: _increasing(name, values) for name, values in listed(grid or {}, where).items()}
    moved(mechanism, dict.fromkeys(axes, 0.0))  # names every coordinate that does not exist
    lengths = sliding(mechanism.rigid.rigid) | {*"xyz"}
    units = {name: "m" if name in lengths else "rad" for name in axes}
    every = combined({name: values.tolist() for name, values in axes.items()})
    return axes, units, [{"by": case} for case in every]


def pose_of(mechanism: Mechanism, case: Case) -> Array:
    """The rigid configuration of one of the poses, shape (nq,)."""
    return np.array(case["q"]) if "q" in case else moved(mechanism, case["by"])


@lru_cache(maxsize=1)
def _loaded(packed: bytes) -> Mechanism:
    """The model, once in each process."""
    return load(pickle.loads(packed))


def _at(
    packed: bytes, count: int, stiffness: bool, settings: Mapping[str, Any], case: Case
) -> dict[str, Any]:
    """Frequencies, shapes and compliance of one pose, as plain lists."""
    mechanism = _loaded(packed)
    q = pose_of(mechanism, case)
    every = modes(mechanism, q, count=mechanism.flexible.nv, **settings)
    first = first_modes(every, count, zeros=True)
    found = {"y": first.y, "frequencies": first.frequencies, "shapes": first.shapes}
    found["side"] = side(mechanism, Equations(mechanism.rigid).close(q).J[None])
    if stiffness and mechanism.description.platform is not None:
        with suppress(SingularityError):  # what is free to move has frequencies all the same
            found["compliance"] = platform_compliance(mechanism, q, preload=settings["preload"])
    return {name: values.tolist() for name, values in found.items()}


def _gathered(
    mechanism: Mechanism,
    shape: tuple[int, ...],
    found: Mapping[tuple[int, ...], Record],
    count: int,
    first: tuple[int, ...] | None,
) -> tuple[Array, Array, Array, Any]:
    """Frequencies, agreement, compliance and errors of all poses, modes in one order."""
    dynamics = Equations(mechanism.flexible)
    known = {place: record.found for place, record in found.items() if not record.error}
    order = tracked(
        {place: np.array(got["shapes"]) for place, got in known.items()},
        lambda place: dynamics.mass(np.array(known[place]["y"])),
        count,
        first if first in known else None,
    )
    frequencies, compliance = np.full((*shape, count), np.nan), np.full((*shape, 6, 6), np.nan)
    agreement, errors = np.full(shape, np.nan), np.full(shape, "", dtype=object)
    for place, record in found.items():
        errors[place] = record.error
        if record.error:
            continue
        columns, agreement[place] = order[place]
        f = np.array(record.found["frequencies"])[columns][:count]
        frequencies[place][: len(f)] = f
        compliance[place] = record.found.get("compliance", np.nan)
    return frequencies, agreement, compliance, errors


def _increasing(name: str, values: Iterable[Any]) -> Array:
    try:
        found = np.array(list(values), float)
    except (TypeError, ValueError, OverflowError):
        found = np.full(1, np.nan)
    if not np.all(np.isfinite(found)) or np.any(np.diff(found) <= 0):
        raise DescriptionError(
            f"map: {name}: {shown(list(values))} are no increasing numbers. Write a:b:n, or a,b,..."
        )
    return found
