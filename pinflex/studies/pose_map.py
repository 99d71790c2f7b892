"""Natural frequencies and platform stiffness over a grid of poses."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.description import Description
from pinflex.errors import ConvergenceError, DescriptionError, SingularityError
from pinflex.levels.modes import modes
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.studies.batch import Record, keys, run
from pinflex.studies.cases import combined, listed
from pinflex.studies.check import is_loaded
from pinflex.studies.columns import Columns, column
from pinflex.studies.mode_shapes import first_modes
from pinflex.studies.pose import moved
from pinflex.studies.stiffness import (
    AXES,
    free,
    free_stiffness,
    held,
    platform_compliance,
    stiffness_of,
)
from pinflex.studies.sweep import described
from pinflex.studies.tracking import tracked
from pinflex.text import brief

_SPARE = 4  # modes followed beside those shown: one of them may come down among the shown


@dataclass(frozen=True)
class PoseMap:
    """Frequencies and compliance at the poses of a grid; G stands for the shape of the grid.

    Attributes:
        name: Of the mechanism.
        grid: Displacements from home by coordinate, each of shape (n,). units: m or rad, of each.
        frequencies: Hz, shape (*G, count), negative where unstable; a column follows one mode, so
            columns may cross.
        agreement: Least squared cosine of these modes to those of the neighbouring pose that they
            follow, shape G: near 1 the columns are certain.
        compliance: Of the platform, motors locked, shape (*G, 6, 6), see `platform_compliance`; nan
            where something is free to move, or where the model names no platform.
        errors: Why a pose has no numbers, "" where it has, shape G.
        preload: "gravity" or "none". free_motors: Whether frequencies are those with free motors.
    """

    __repr__ = brief

    name: str
    grid: Mapping[str, Array]
    units: Mapping[str, str]
    frequencies: Array
    agreement: Array
    compliance: Array
    errors: Any
    preload: str
    free_motors: bool

    @property
    def table(self) -> Columns:
        """A row for each pose: grid, status, error, frequencies, stiffness and compliance.

        "K_AB (others held)" is the force (N) or moment (N m) along A per displacement (m, rad)
        along B, the other displacements zero; "1/C_AA (others free)" the force per displacement
        along its own axis, nothing else held. inf where the platform is rigid.
        """
        places = np.meshgrid(*self.grid.values(), indexing="ij")
        errors = self.errors.reshape(-1)
        arrays = {n: column(p.reshape(-1).tolist()) for n, p in zip(self.grid, places, strict=True)}
        arrays["status"] = column(["failed" if error else "done" for error in errors])
        arrays["error"] = column(list(errors))
        units = dict(self.units)
        for k, row in enumerate(self.frequencies.reshape(len(errors), -1).T, 1):
            arrays[f"frequency.{k}"], units[f"frequency.{k}"] = column(row.tolist()), "Hz"
        arrays["agreement"] = column(self.agreement.reshape(-1).tolist())
        C = self.compliance.reshape(-1, 6, 6)
        K = [stiffness_of(c)[0] if np.isfinite(c).all() else c for c in C]
        for i, values in enumerate(free_stiffness(C).T):
            arrays[free(i)], units[free(i)] = column(values.tolist()), _unit("stiffness", i, i)
        for what, values in (("stiffness", np.array(K)), ("compliance", C)):
            for i, j in combinations_with_replacement(range(6), 2):
                name = held(i, j) if what == "stiffness" else f"compliance.{AXES[i]}.{AXES[j]}"
                arrays[name], units[name] = column(values[:, i, j].tolist()), _unit(what, i, j)
        return Columns(arrays, units)

    @property
    def rigid(self) -> tuple[str, ...]:
        """Axes along which the platform does not give way at any pose, as x or rz."""
        every = np.diagonal(self.compliance, axis1=-2, axis2=-1).reshape(-1, 6)
        every = every[np.isfinite(every).all(axis=1)]
        return tuple(a for a, C in zip(AXES, every.T, strict=True) if len(C) and not C.any())


def pose_map(
    model: str | Path | Description | Mechanism,
    grid: Mapping[str, object],
    *,
    count: int = 6,
    preload: str = "gravity",
    free_motors: bool = False,
    jobs: int = 1,
    scheduler: str | None = None,
    journal: str | Path | None = None,
    fresh: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> PoseMap:
    """Natural frequencies, followed from pose to pose, and the 6x6 compliance of the platform.

    Args:
        model: A model, or what `load` takes.
        grid: Displacements from home by motor or by platform coordinate: x, y, z (m), rz, ry, rx
            (rad), as in `pose.moved`; increasing lists, or texts such as "-.05:.05:9". Empty: home.
        count: How many frequencies.
        preload: "gravity": about the static equilibrium; "none": about the undeformed pose.
        free_motors: Frequencies with free motors.
        jobs, scheduler, journal, fresh, progress: As in `sweep`.

    Returns:
        The map; a pose that cannot be reached, or has no equilibrium, says why.

    Raises:
        DescriptionError: Nothing that vibrates, or a coordinate that does not exist.
        ConvergenceError: Not one pose has an answer.
        Interrupted: On Ctrl-C.
    """
    description = described(model)
    mechanism = model if isinstance(model, Mechanism) else load(description)
    if not mechanism.flexible.n_eta and not len(mechanism.flexible.springs.v_at):
        raise DescriptionError(
            f"{mechanism.name}: no flexible link and no spring, so nothing vibrates. Write some "
            "under `flexible`."
        )
    axes = {
        name: _increasing(name, v) for name, v in listed(grid, f"{mechanism.name}: map").items()
    }
    moved(mechanism, dict.fromkeys(axes, 0.0))  # names every coordinate that does not exist
    preload = preload if is_loaded(mechanism) else "none"
    cases = combined({name: values.tolist() for name, values in axes.items()})
    named = keys(description, cases, "map", count, preload, free_motors)
    work = partial(_at, pickle.dumps(description), count + _SPARE, preload, free_motors)
    records = run(
        work, dict(zip(named, cases, strict=True)), jobs=jobs, scheduler=scheduler,
        journal=journal, fresh=fresh, progress=progress,
    )  # fmt: skip
    shape = tuple(map(len, axes.values()))
    found = dict(zip(np.ndindex(*shape), (records[key] for key in named), strict=True))
    first = next(iter(found.values()))
    if all(record.error for record in found.values()):
        raise ConvergenceError(f"{mechanism.name}: not one pose has an answer: {first.error}")
    return _gathered(mechanism, axes, found, count, preload, free_motors)


@lru_cache(maxsize=1)
def _loaded(packed: bytes) -> Mechanism:
    """The model, once in each process."""
    return load(pickle.loads(packed))


def _at(
    packed: bytes, count: int, preload: str, free_motors: bool, by: Mapping[str, float]
) -> dict[str, Any]:
    """Frequencies, shapes and compliance of one pose, as plain lists."""
    mechanism = _loaded(packed)
    q = moved(mechanism, by)
    every = modes(
        mechanism, q, count=mechanism.flexible.nv, preload=preload, free_motors=free_motors
    )
    first = first_modes(every, count, zeros=True)
    found = {"y": first.y, "frequencies": first.frequencies, "shapes": first.shapes}
    if mechanism.description.platform is not None:
        with suppress(SingularityError):  # what is free to move has frequencies all the same
            found["compliance"] = platform_compliance(mechanism, q, preload=preload)
    return {name: values.tolist() for name, values in found.items()}


def _gathered(
    mechanism: Mechanism,
    axes: Mapping[str, Array],
    found: Mapping[tuple[int, ...], Record],
    count: int,
    preload: str,
    free_motors: bool,
) -> PoseMap:
    """The grid of all poses, modes in one order."""
    dynamics = Equations(mechanism.flexible)
    shape = tuple(map(len, axes.values()))
    known = {place: record.found for place, record in found.items() if not record.error}
    order = tracked(
        {place: np.array(got["shapes"]) for place, got in known.items()},
        lambda place: dynamics.mass(np.array(known[place]["y"])),
        count,
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
    return PoseMap(
        mechanism.name,
        axes,
        _units(mechanism, axes),
        frequencies,
        agreement,
        compliance,
        errors,
        preload,
        free_motors,
    )


def _increasing(name: str, values: Iterable[Any]) -> Array:
    try:
        found = np.array(list(values), float)
    except (TypeError, ValueError):
        found = np.full(1, np.nan)
    if not np.all(np.isfinite(found)) or np.any(np.diff(found) <= 0):
        raise DescriptionError(
            f"map: {name}: {list(values)} are no increasing numbers. Write a:b:n, or a,b,..."
        )
    return found


def _units(mechanism: Mechanism, names: Iterable[str]) -> dict[str, str]:
    """m of x, y, z and of motors that slide, else rad."""
    model = mechanism.rigid.rigid
    slides = {
        name
        for name, joint in zip(model.names, model.joints, strict=True)
        if joint.nv == 1 and joint.shortname().startswith("JointModelP")
    }
    return {name: "m" if name in {*slides, "x", "y", "z"} else "rad" for name in names}


def _unit(what: str, i: int, j: int) -> str:
    if what == "stiffness":
        return ("N/m", "N", "N m")[(i > 2) + (j > 2)]
    return ("m/N", "1/N", "1/(N m)")[(i > 2) + (j > 2)]
