"""A run of a richer model beside a run: what the model leaves out where no cheap look tells it.

Motors that push, controls, freedoms that nothing determines, long or fast vibration and motion far
from linear vibration: there the richer model is solved at the same instants, and every output is
compared. Where the difference is below the run's error of time it tells that error; then both
models are run again to a finer tolerance.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motion import Motion
from pinflex.errors import ConvergenceError, PinflexError
from pinflex.levels.outputs import REST, STILL, between
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.error_bars import time_error
from pinflex.results.result import Result
from pinflex.solver.solve import solve_level

_TOL = 1e-3  # of time of the richer run, at the least: what a model leaves out is larger
_LONGEST = 30.0  # s of computing: a richer run that takes more is given up
_OF_THE_METHOD = (
    *("tol", "dt", "samples", "until", "integrator", "rho_inf", "newmark", "theta", "ked"),
    *("modes", "asked", "level"),
)
_FINER = 0.1  # of the tolerance: where the error of time hides what the model leaves out
_SECTION = 1e-6  # of the length: sections so near are one
_PARTS = {"section forces": (slice(0, 3), slice(3, 6))}  # N, N m


def run_apart(
    result: Result,
    mechanism: Mechanism,
    finer: Mechanism,
    motion: Motion,
    options: Mapping[str, Any],
    static: bool,
) -> dict[str, float]:
    """Largest differences of a run from one of a richer model, by output, relative.

    Raises:
        ConvergenceError: The richer run takes too long, or does not come to its end.
    """
    loose = free(finer)
    found = outputs_apart(result, richer_run(result, finer, motion, options, static), loose)
    settings = result.meta["settings"]
    of_time, _ = time_error(settings, result.level)
    if result.level == "coupled" and any(e < of_time.get(key, 0.0) for key, e in found.items()):
        with contextlib.suppress(PinflexError):  # below what time integration can reach
            tol = _FINER * min(float(settings.get("tol", _TOL)), _TOL)
            a, b = (richer_run(result, x, motion, options, static, tol) for x in (mechanism, finer))
            return outputs_apart(a, b, loose)
    return found


def richer_run(
    result: Result,
    finer: Mechanism,
    motion: Motion,
    options: Mapping[str, Any],
    static: bool,
    tol: float | None = None,
) -> Result:
    """A run of a richer model at the instants of another; arguments as of `run_apart`.

    `tol`: Of time; None: that of the run, or less.
    """
    given = {k: x for k, x in options.items() if k not in _OF_THE_METHOD and x is not None}
    if tol is None:
        tol = min(float(result.meta["settings"].get("tol", _TOL)), _TOL)
    until, began = float(result.t[-1]), time.process_time()

    def watch(step: int, steps: int) -> None:
        if time.process_time() - began > _LONGEST:
            raise ConvergenceError(f"its run takes more than {_LONGEST:g} s")

    keys = {**given, "start": "static" if static else "straight", "until": until, "tol": tol}
    return solve_level(finer, motion, "coupled", samples=len(result.t), progress=watch, **keys)


def free(mechanism: Mechanism) -> bool:
    """Whether joints move that motors do not determine: no rigid motion to deviate from."""
    return mechanism.report.mobility != len(mechanism.rigid.motors)


def outputs_apart(a: Result, b: Result, free: bool = False) -> dict[str, float]:
    """Largest differences of all outputs of two runs at the same instants, relative."""
    found: dict[str, float | None] = {}
    if a.torque.shape[1]:
        found["torque"] = _ratio([a.torque], [b.torque])
    found |= links_apart(a, b)
    found |= _platform(a, b, free)
    if not found or not any(found.values()):
        q = "joint/v"
        found["joint speeds"] = _ratio([a.array(q)], [b.array(q)])
    return {key: e for key, e in found.items() if e is not None}


def links_apart(a: Result, b: Result) -> dict[str, float]:
    """The same of deflection, stress and section forces, at the sections that both have."""
    found: dict[str, float] = {}
    values: dict[str, tuple[list[Array], list[Array]]] = {
        key: ([], []) for key in ("deflection", "stress", "section forces")
    }
    for name in b.links:
        theirs = b.link(name)
        mine = a.link(name) if name in a.links else None
        own, at = shared(theirs.x if mine is None else mine.x, theirs.x)
        for key, pick in _OF_LINKS.items():
            y = pick(theirs)[:, at]
            values[key][0].append(0.0 * y if mine is None else pick(mine)[:, own])
            values[key][1].append(y)
    for key, (x, y) in values.items():
        for part in _PARTS.get(key, (slice(None),)):
            cut = (..., part) if key in _PARTS else ...
            e = _ratio([v[cut] for v in x], [v[cut] for v in y])
            if e is not None:
                found[key] = max(found.get(key, 0.0), e)
    return found


_OF_LINKS: Any = {
    "deflection": lambda link: link.deflection[:, :, :3],
    "stress": lambda link: link.von_mises,
    "section forces": lambda link: link.resultant,
}


def platform_acceleration(a: Result, b: Result) -> dict[str, float]:
    """The same of the platform's acceleration."""
    name = b.meta.get("platform")
    if not name:
        return {}
    x, y = (run.array(f"frame/{name}/acceleration")[:, :3] for run in (a, b))
    e = _ratio([x], [y])
    return {} if e is None else {"platform acceleration": e}


def _platform(a: Result, b: Result, free: bool) -> dict[str, float]:
    """Pose of the platform, relative to its largest deviation from rigid, and its acceleration."""
    name = b.meta.get("platform")
    if not name:
        return {}
    known = not free and name in b.meta["bodies"]
    rigid = b.array(f"body/{name}/pose_rigid") if known else None
    (p, R), (p_b, R_b) = pose_of(a), pose_of(b)
    p_r, R_r = (p_b[:1], R_b[:1]) if rigid is None else (rigid[:, :, 3], rigid[:, :, :3])
    pairs = {
        "platform position": (np.abs(p - p_b).max(), np.abs(p_b - p_r).max()),
        "platform rotation": (
            np.abs(between(R, R_b)).max(),
            np.abs(between(np.broadcast_to(R_r, R_b.shape), R_b)).max(),
        ),
    }
    found = {key: float(e / s) for key, (e, s) in pairs.items() if s > STILL}
    return found | platform_acceleration(a, b)


def pose_of(run: Result) -> tuple[Array, Array]:
    """Positions (n, 3) [m] and rotations (n, 3, 3) of the platform in a run."""
    name = run.meta["platform"]
    return run.array(f"frame/{name}/position"), run.array(f"frame/{name}/rotation")


def shared(x: Array, at: Array) -> tuple[list[int], list[int]]:
    """Numbers of the sections that are among others, and which of those they are."""
    near = np.argmin(np.abs(at[:, None] - x), axis=0)
    same = np.flatnonzero(np.abs(at[near] - x) < _SECTION * at[-1])
    return same.tolist(), near[same].tolist()


def _ratio(a: list[Array], b: list[Array]) -> float | None:
    """Largest difference over the largest value of the second; None: that is zero."""
    scale = max((float(np.max(np.abs(y), initial=0.0)) for y in b), default=0.0)
    scale = scale if scale > REST else 0.0  # round-off
    apart = (float(np.max(np.abs(x - y), initial=0.0)) for x, y in zip(a, b, strict=True))
    return max(apart, default=0.0) / scale if scale > 0.0 else None
