"""Scene of a run, from its Result alone: world positions, fields, arrows, curves.

Everything that moves is kept twice, as it is and as the rigid mechanism has it, so that a drawing
can put a material point at r_rigid + mag (r - r_rigid). Scaled that way (and not link by link) the
points shared by two bodies stay shared, and no joint opens at any magnification.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.results.result import Result
from pinflex.viewer.curves import plots, track
from pinflex.viewer.frames import FrameLocator
from pinflex.viewer.links import FIELDS, largest, link_geometry, thinned, time_arrays
from pinflex.viewer.skeleton import Skeleton, body_shapes, skeletons
from pinflex.viewer.surfaces import surfaces

FRAMES = 1200  # a page holds at most this many instants
NUMBERS = 4_000_000  # and this many numbers, of 0.6 to 1.4 bytes: below 8 MB
BODY = 36  # of them that a rigid body takes: its pose twice, and an arrow or two
SHARE = 0.06  # automatic magnification: largest displacement over robot size
LEVELS = {
    "quasistatic": "quasistatic: no vibration",
    "ked": "kineto-elastodynamic: linear vibration about the rigid motion",
    "coupled": "coupled rigid-flexible",
}


def build_scene(
    result: Result,
    rigid: Result | None = None,
    scale: float | str = "auto",
    meshes: Sequence[str | Path] | None = (),
) -> dict[str, Any]:
    """Plain data of one run; arrays are thinned in time and along the links, extremes kept.

    Args:
        result: The run to draw.
        rigid: The same motion without elasticity: its torques and platform path are compared.
        scale: Magnification of displacements, or "auto" (1, 2 or 5 times a power of ten).
        meshes: Folders of mesh files besides example-robot-data; None draws simple shapes only.
    """
    skins, missing = ({}, []) if meshes is None else surfaces(result, meshes)
    links = {name: link_geometry(result, name, skins.get(name)) for name in result.links}
    path = track(result, rigid)
    locator = FrameLocator(result)
    bodies = skeletons(result, locator, skins)
    keep = _instants(result, links, len(bodies), path)
    size = _size(bodies, links, keep)
    most = max(
        [float(np.linalg.norm(link["disp"], axis=2).max()) for link in links.values()]
        + ([float(path["deviation"].max())] if path else [])
        + [0.0]
    )
    peaks = {name: largest(link, "von_mises") for name, link in links.items()}
    stress = {name: p for name, p in peaks.items() if p is not None}
    return {
        "name": str(result.meta.get("name", "result")),
        "level": LEVELS.get(result.level, result.level),
        "mode": None,
        "remark": _remark(result),
        "t": result.t[keep],
        "opens": _opens(result, path, stress),
        "size": size,
        "scale": automatic_scale(most, size) if scale == "auto" else float(scale),
        "largest": most,
        "links": [
            {**thinned(link, keep), "strength": _strength(result, name)}
            for name, link in links.items()
        ],
        "bodies": [body_shapes(body, keep, size) for body in bodies],
        "track": path and _rows(path, keep),
        "forces": [_rows(arrow, keep) for arrow in locator.forces()],
        "torques": [_rows(arrow, keep) for arrow in locator.torques()],
        "plots": plots(result, rigid, stress, path, keep),
        "fields": _fields(links),
        "notes": _notes(result, len(keep)) + missing,
    }


def _notes(result: Result, kept: int) -> list[str]:
    """Why the run ended early, the number of instants kept, warnings."""
    notes = list(result.meta.get("warnings", ()))
    if kept < len(result.t):
        notes.insert(0, f"{kept} of {len(result.t)} instants kept, extremes among them")
    if result.meta.get("status", "complete") != "complete":
        notes.insert(0, f"{result.meta['status']}: {result.meta.get('message', '')}")
    return notes


def _remark(result: Result) -> str:
    """Caution for a viewer of the picture, in one line; "" for none."""
    if result.meta.get("status", "complete") != "complete":
        return f"{result.meta['status']} at {result.t[-1]:.4g} s"
    remarks = [*filter(None, [result.meta.get("remark")]), *result.meta.get("warnings", ())]
    more = f" (and {len(remarks) - 1} more)" if len(remarks) > 1 else ""
    return f"{remarks[0]}{more}" if remarks else ""


def _strength(result: Result, link: str) -> float | None:
    """Yield strength of a link [MPa], where known."""
    known = result.meta.get("links", {}).get(link, {}).get("material", {}).get("yield_strength")
    return None if not known else 1e-6 * float(known)


def _opens(result: Result, path: dict[str, Any] | None, stress: dict[str, Array]) -> float:
    """Instant [s] worth a first look: the platform furthest from rigid, or the largest stress."""
    if path is not None and float(path["deviation"].max()) > 0.0:
        return float(result.t[int(np.argmax(path["deviation"]))])
    if stress:
        return float(result.t[int(np.argmax(np.max(list(stress.values()), axis=0)))])
    return float(result.t[0])


def automatic_scale(largest: float, size: float, share: float = SHARE) -> float:
    """Magnification 1, 2 or 5 times a power of ten that shows `largest` as a share of `size`.

    A displacement that is large as it is stays at 1: nothing is ever drawn smaller.

    Args:
        largest: Displacement [m].
        size: Of the robot [m].
        share: Of the size that the displacement should fill.
    """
    if not 0.0 < largest < share * size:
        return 1.0
    wanted = np.log10(share * size / largest)
    steps = [np.log10(s) + np.floor(wanted) for s in (1, 2, 5, 10)]
    return float(np.round(10.0 ** min(steps, key=lambda s: abs(s - wanted)), 6))


def _instants(
    result: Result, links: dict[str, dict[str, Any]], bodies: int, path: dict[str, Any] | None
) -> IntArray:
    """Instants to keep: evenly spread, and every one where something is largest or smallest."""
    n = len(result.t)
    each = sum(a[0].size for link in links.values() for a in time_arrays(link)) + BODY * bodies
    most = max(min(FRAMES, NUMBERS // max(each, 1)), 2)
    if n <= most:
        return np.arange(n)
    torque = result.arrays.get("torque", np.empty((n, 0)))
    rows = [torque, -torque, path["deviation"][:, None] if path else np.empty((n, 0))]
    for link in links.values():
        peaks = [largest(link, k) for k in link["fields"]]
        peaks.append(np.linalg.norm(link["disp"], axis=2).max(axis=1))
        rows += [p[:, None] for p in peaks if p is not None]
    extremes = np.unique([0, n - 1, *(int(i) for r in rows for i in r.argmax(axis=0))])
    spread = np.linspace(0, n - 1, max(most - len(extremes), 2)).round().astype(np.intp)
    keep = np.union1d(spread, extremes.astype(np.intp))
    if len(keep) > most:  # a robot with hundreds of links: the ends and an even choice
        keep = keep[np.linspace(0, len(keep) - 1, most).round().astype(np.intp)]
    return keep


def _fields(links: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    if not links:
        return []
    known = set.intersection(*[set(link["fields"]) for link in links.values()]) | {"displacement"}
    return [
        {"key": k, "label": label, "unit": unit, "factor": factor}
        for k, (label, unit, factor) in FIELDS.items()
        if k in known
    ]


def _size(bodies: list[Skeleton], links: dict[str, dict[str, Any]], keep: IntArray) -> float:
    """Largest diagonal of the box about the rigid mechanism [m]."""
    clouds = [link["rigid"][keep] for link in links.values()]
    for body in bodies:
        pose, points = body.pose[keep], body.points
        clouds.append(np.einsum("tij,pj->tpi", pose[:, :, :3], points) + pose[:, None, :, 3])
    if not clouds:
        return 1.0
    cloud = np.concatenate(clouds, axis=1)
    return float(np.linalg.norm(np.ptp(cloud, axis=1), axis=1).max()) or 1.0


def _rows(arrow: dict[str, Any], keep: IntArray) -> dict[str, Any]:
    return {k: v[keep] if isinstance(v, np.ndarray) else v for k, v in arrow.items()}
