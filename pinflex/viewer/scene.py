"""Scene of a run, from its Result alone: world positions, fields, arrows, curves.

Everything that moves is kept twice, as it is and as the rigid mechanism has it, so that a drawing
can put a material point at r_rigid + mag (r - r_rigid). Scaled that way (and not link by link) the
points shared by two bodies stay shared, and no joint opens at any magnification.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray, chosen
from pinflex.results.drawing import Joint
from pinflex.results.result import Result
from pinflex.results.views import Deviation
from pinflex.viewer.curves import FrameLocator, body_names, plots, seen_from, track, verdicts
from pinflex.viewer.links import (
    FIELDS,
    largest,
    link_geometry,
    stations,
    thinned,
    time_arrays,
    undeformed,
)
from pinflex.viewer.surfaces import Surface, joined, packed, surfaces

# Rigid links as shapes to draw: balls at joints, rods between two, plates across three or more.


@dataclass(frozen=True)
class Skeleton:
    """Links that hang on each other by fixed joints, as one body.

    Attributes:
        name: The link whose frame is used.
        points: Joint origins [m] in that frame, shape (n, 3).
        radius: Size of the joints [m].
        pose: Pose in the world, shape (nt, 3, 4).
        rigid: Pose of the rigid mechanism, shape (nt, 3, 4).
        root: No moving joint carries it.
        platform: It carries the platform frame.
        surface: What the URDF draws of it, in the same frame.
        frame: It only marks a place on a flexible link.
        rails: Ends of the straight ways on which sliding links move along it, each (2, 3).
        stems: Where sliding links start on it [m], in the same frame, and their names.
    """

    name: str
    points: Array
    radius: float
    pose: Array
    rigid: Array
    root: bool
    platform: bool
    surface: Surface | None = None
    frame: bool = False
    rails: tuple[Array, ...] = ()
    stems: tuple[tuple[Array, str], ...] = ()


def skeletons(
    result: Result, locator: FrameLocator, surfaces: Mapping[str, Surface]
) -> list[Skeleton]:
    """The rigid bodies of a result that have something to draw."""
    names = body_names(result)
    joints = [j for j in locator.joints.values() if j.child in names]
    fixed = [j for j in joints if j.kind == "fixed" and _together(result, j.parent, j.child)]
    moving = {j.child for j in joints if j not in fixed}
    bodies = []
    for head, links in _groups(names, {j.child: j.parent for j in fixed}).items():
        points, surface = _shape(result, head, links, surfaces)
        if len(points) or surface is not None:
            body = _skeleton(result, head, links, points, surface, joints, moving)
            bodies.append(replace(body, stems=_stems(result, locator, head, links)))
    return bodies


def _stems(
    result: Result, locator: FrameLocator, head: str, links: Sequence[str]
) -> tuple[tuple[Array, str], ...]:
    """Origins of the sliding joints on a body, in the frame of its head, and what they carry."""
    found = []
    for joint in locator.joints.values():
        if joint.kind == "prismatic" and joint.parent in links:
            of_head, own = (result.arrays[f"body/{n}/pose"][0] for n in (head, joint.parent))
            place = own[:, :3] @ joint.origin + own[:, 3]
            found.append((of_head[:, :3].T @ (place - of_head[:, 3]), joint.child))
    return tuple(found)


def _groups(names: Sequence[str], above: Mapping[str, str]) -> dict[str, list[str]]:
    """Links that move as one body, by the uppermost of them; `above`: parents by fixed joints."""
    groups: dict[str, list[str]] = {}
    for name in names:
        head = name
        while above.get(head) in names:
            head = above[head]
        groups.setdefault(head, []).append(name)
    return groups


def _shape(
    result: Result, head: str, links: Sequence[str], surfaces: Mapping[str, Surface]
) -> tuple[Array, Surface | None]:
    """Joint origins (n, 3) of a body and what the URDF draws of it, in the frame of its head."""
    about, platform = result.meta.get("bodies", {}), result.meta.get("platform")
    rotation, origin = np.split(result.arrays[f"body/{head}/pose"][0], [3], axis=1)
    parts, centre, skins = [np.empty((0, 3))], None, []
    for link in links:
        own = result.arrays[f"body/{link}/pose"][0]
        turn, shift = rotation.T @ own[:, :3], rotation.T @ (own[:, 3] - origin[:, 0])
        points = np.asarray(about.get(link, {}).get("points", ()), dtype=float).reshape(-1, 3)
        parts.append(points @ turn.T + shift)
        centre = shift if link == platform else centre
        if link in surfaces:
            skins.append(surfaces[link].moved(turn, shift))
    points = _distinct(np.concatenate(parts))
    if centre is not None and len(points) > 3:  # the platform's origin is no joint of it
        points = points[np.linalg.norm(points - centre, axis=1) > 1e-6]
    return points, joined(skins) if skins else None


def _skeleton(
    result: Result,
    head: str,
    links: Sequence[str],
    points: Array,
    surface: Surface | None,
    joints: Sequence[Joint],
    moving: Collection[str],
) -> Skeleton:
    """One body, and what it is to the mechanism; `moving`: children of joints that move."""
    about, pose = result.meta.get("bodies", {}), result.arrays[f"body/{head}/pose"]
    on_beam = any(j.parent in result.links for j in joints if j.child == head and j.kind == "fixed")
    massless = not any(about.get(link, {}).get("mass") for link in links)
    rails = [
        _way(pose, result.arrays[f"body/{j.child}/pose"])
        for j in joints
        if j.kind == "prismatic" and j.parent in links
    ]
    return Skeleton(
        name=head,
        points=points,
        radius=max(float(about.get(link, {}).get("radius") or 0.0) for link in links),
        pose=pose,
        rigid=result.arrays.get(f"body/{head}/pose_rigid", pose),
        root=not any(link in moving for link in links),
        platform=result.meta.get("platform") in links,
        surface=surface,
        frame=on_beam and massless and len(points) < 2,
        rails=tuple(rails),
    )


def body_shapes(body: Skeleton, keep: IntArray | slice, size: float) -> dict[str, Any]:
    """Shapes in the body's own frame, and its motion at the instants kept."""
    pose, rigid = body.pose, body.rigid
    radius = float(np.clip(body.radius, 0.007 * size, 0.03 * size))
    mesh = None if body.surface is None else packed(body.surface)[0]
    # a mesh says more than any simple shape
    rods, plate = _simple(body.points, radius) if mesh is None else ([], None)
    still = bool(np.ptp(pose, axis=0).max() < 1e-9 and np.abs(rigid - pose).max() < 1e-9)
    return {
        "name": body.name,
        "radius": radius,
        "base": still and body.root,
        "platform": body.platform,
        "frame": body.frame,
        "points": body.points.tolist(),
        "rods": rods,
        "plate": plate,
        "mesh": mesh,
        "stems": [] if body.root else [[start.tolist(), name] for start, name in body.stems],
        "rails": [rail.tolist() for rail in body.rails] if body.root else [],
        "rigid": rigid[slice(1) if still else keep].reshape(-1, 12),
        "disp": None if np.array_equal(rigid, pose) else (pose - rigid)[keep].reshape(-1, 12),
    }


def _simple(points: Array, radius: float) -> tuple[list[Any], dict[str, Any] | None]:
    """Rods between joints (n, 3) [m], or a plate across them where they are flat."""
    if len(points) < 2:
        return [], None
    if len(points) == 2:
        return [points.tolist()], None
    _, spread, axes = np.linalg.svd(points - points.mean(axis=0))
    across = np.append(spread, np.zeros(3))[:3] / max(float(spread[0]), 1e-12)
    if across[1] < 0.05:  # on one line
        order = points[np.argsort(points @ axes[0])]
        return [[order[0].tolist(), order[-1].tolist()]], None
    if across[2] < 0.2:  # flat
        return [], _plate(points, axes, 1.5 * radius)
    return [[points.mean(axis=0).tolist(), p.tolist()] for p in points], None


def _together(result: Result, parent: str, child: str) -> bool:
    """True if a joint that the URDF calls fixed is so: a YAML may make it universal."""
    a, b = (result.arrays.get(f"body/{name}/pose") for name in (parent, child))
    if a is None or b is None:
        return True
    every = -(-len(a) // _LOOKS)
    a, b = a[::every], b[::every]
    turn = np.swapaxes(a[:, :, :3], 1, 2) @ b[:, :, :3]
    shift = seen_from(a, b[:, :, 3])
    return bool(max(np.ptp(turn, axis=0).max(), np.ptp(shift, axis=0).max()) < 1e-7)


def _way(pose: Array, child: Array) -> Array:
    """Ends of the path of a sliding link, as its parent sees it; shape (2, 3)."""
    path = seen_from(pose, child[:, :, 3])
    axis = int(np.ptp(path, axis=0).argmax())
    return np.asarray(path[[path[:, axis].argmin(), path[:, axis].argmax()]])


def _plate(points: Array, axes: Array, margin: float) -> dict[str, Any]:
    """Outline of a flat body: the convex hull of discs about its joints."""
    centre = points.mean(axis=0)
    flat = (points - centre) @ axes[:2].T
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    discs = flat[:, None] + margin * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    hull = _hull(discs.reshape(-1, 2))
    normal = np.cross(axes[0], axes[1])
    return {"outline": (centre + hull @ axes[:2]).tolist(), "normal": normal.tolist()}


def _hull(points: Array) -> Array:
    """Convex hull, counter-clockwise (Andrew's monotone chain); scipy would take 0.1 s to load."""
    order = sorted(map(tuple, points.tolist()))
    chains: list[list[tuple[float, ...]]] = []
    for run in (order, order[::-1]):
        chain: list[tuple[float, ...]] = []
        for p in run:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-2], chain[-1]
                if (bx - ax) * (p[1] - ay) - (by - ay) * (p[0] - ax) > 1e-12:
                    break
                chain.pop()
            chain.append(p)
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1])


def _distinct(points: Array) -> Array:
    kept: list[Array] = []
    for p in points:
        if all(np.linalg.norm(p - k) > 1e-6 for k in kept):
            kept.append(p)
    return np.array(kept).reshape(-1, 3)


FRAMES = 1200  # a page holds at most this many instants
NUMBERS = 4_000_000  # and this many numbers, of 0.6 to 1.4 bytes: below 8 MB
_LOOKS = 100  # instants at which is looked at how large a robot is, and whether parts move
_UNSEEN = 1e-6  # [m], and of a direction: nobody sees it
BODY = 36  # of them that a rigid body takes: its pose twice, and an arrow or two
SHARE = 0.06  # automatic magnification: largest displacement over robot size
_MODE_SHARE = 0.08  # the same of a mode shape, which has no size of its own
LEVELS = {
    "rigid": "rigid mechanism",
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
    """Plain data of one run; arrays are thinned in time and along the links, extremes kept."""
    return build_scenes([result], rigid, scale, meshes)[0]


def mode_scene(result: Result, meshes: Sequence[str | Path] | None = ()) -> dict[str, Any]:
    """Scene of a period of a mode shape, magnified to be seen."""
    scene = build_scene(result, meshes=meshes)
    largest = scene["largest"]
    return scene | {"scale": _MODE_SHARE * scene["size"] / largest if largest else 1.0}


def build_scenes(
    results: Sequence[Result],
    rigid: Result | None = None,
    scale: float | str = "auto",
    meshes: Sequence[str | Path] | None = (),
    off_path: Sequence[Deviation | None] = (),
    instants: int = FRAMES,
) -> list[dict[str, Any]]:
    """Scenes of runs of one mechanism, alike in instants, stations and magnification.

    `instants`: of each run, at the most.
    """
    away = off_path or [None] * len(results)
    at = _stations(results)
    drawn = [_drawn(r, rigid, meshes, at, d) for r, d in zip(results, away, strict=True)]
    drawn = [_with_links(d, drawn) for d in drawn]
    keep = _instants(drawn, instants)
    scenes = [_scene(d, rigid, k) for d, k in zip(drawn, keep, strict=True)]
    flexible = [s for s in scenes if s["fields"]] or scenes
    least = min(automatic_scale(s["largest"], s["size"]) for s in flexible)
    return [s | {"scale": least if scale == "auto" else float(scale)} for s in scenes]


@dataclass(frozen=True)
class _Drawn:
    """A run with what is drawn of it at every instant."""

    result: Result
    links: dict[str, dict[str, Any]]
    bodies: list[Skeleton]
    path: dict[str, Any] | None
    locator: FrameLocator
    missing: list[str]


def _drawn(
    result: Result,
    rigid: Result | None,
    meshes: Sequence[str | Path] | None,
    at: Mapping[tuple[str, int], IntArray],
    off_path: Deviation | None,
) -> _Drawn:
    skins, missing = ({}, []) if meshes is None else surfaces(result, meshes)
    count = {name: len(result.arrays[f"link/{name}/x"]) for name in result.links}
    links = {n: link_geometry(result, n, skins.get(n), at[n, count[n]]) for n in result.links}
    locator = FrameLocator(result)
    bodies = skeletons(result, locator, skins)
    return _Drawn(result, links, bodies, track(result, rigid, off_path), locator, missing)


def _with_links(drawn: _Drawn, others: Sequence[_Drawn]) -> _Drawn:
    """A rigid run with the flexible links of another one where that has the same rigid motion.

    A rigid run alone does not have their poses.
    """
    if drawn.links:
        return drawn
    for other in others:
        if other.links and _same_motion(drawn, other):
            links = {name: undeformed(link) for name, link in other.links.items()}
            return replace(drawn, links=links)
    return drawn


def _same_motion(rigid: _Drawn, flexible: _Drawn) -> bool:
    if not np.array_equal(rigid.result.t, flexible.result.t):
        return False
    theirs = {body.name: body.rigid for body in flexible.bodies}
    return all(
        body.name in theirs and np.abs(body.pose - theirs[body.name]).max() < _UNSEEN
        for body in rigid.bodies
    )


def _stations(results: Sequence[Result]) -> dict[tuple[str, int], IntArray]:
    """Stations to keep, by link and the number that it has: the same in every run."""
    found: dict[tuple[str, int], IntArray] = {}
    for result in results:
        for name in result.links:
            key = name, len(result.arrays[f"link/{name}/x"])
            found[key] = np.union1d(found.get(key, np.empty(0, np.intp)), stations(result, name))
    return found


def _scene(drawn: _Drawn, rigid: Result | None, keep: IntArray) -> dict[str, Any]:
    result, links, path = drawn.result, drawn.links, drawn.path
    size = _size(drawn.bodies, links, keep[:: -(-len(keep) // _LOOKS)])
    at = chosen(keep, len(result.t))
    moved = [np.linalg.norm(link["disp"], axis=2) for link in links.values()]
    moved += [path["deviation"]] if path else []
    peaks = {name: largest(link, "von_mises") for name, link in links.items()}
    stress = {name: p for name, p in peaks.items() if p is not None}
    return {
        "name": str(result.meta.get("name", "result")),
        "key": result.level,
        "level": LEVELS.get(result.level, result.level),
        "mode": None,
        "verdicts": verdicts(result),
        "t": result.t[at],
        "opens": _opens(result, path, stress),
        "size": size,
        "largest": max((float(x.max()) for x in moved), default=0.0),
        "links": [
            {**thinned(link, at), "strength": strength(result, name)}
            for name, link in links.items()
        ],
        "bodies": [body_shapes(body, at, size) for body in drawn.bodies],
        "track": path and _rows(path, at),
        "forces": [_rows(arrow, at) for arrow in drawn.locator.forces()],
        "torques": [_rows(arrow, at) for arrow in drawn.locator.torques()],
        "plots": plots(result, None if result is rigid else rigid, stress, path, at),
        "fields": _fields(links) if result.links else [],
        "notes": _notes(result, len(keep)) + drawn.missing,
    }


def _notes(result: Result, kept: int) -> list[str]:
    """Why the run ended early, the number of instants kept, warnings."""
    notes = list(result.meta.get("warnings", ()))
    if kept < len(result.t):
        notes.insert(0, f"{kept} of {len(result.t)} instants kept, extremes among them")
    if result.meta.get("status", "complete") != "complete":
        notes.insert(0, f"{result.meta['status']}: {result.meta.get('message', '')}")
    return notes


def strength(result: Result, link: str) -> float | None:
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


def automatic_scale(largest: float, size: float) -> float:
    """Magnification 1, 2 or 5 times a power of ten that shows `largest` as `SHARE` of `size`.

    A displacement that is large as it is stays at 1: nothing is ever drawn smaller.
    """
    if not 0.0 < largest < SHARE * size:
        return 1.0
    wanted = np.log10(SHARE * size / largest)
    steps = [np.log10(s) + np.floor(wanted) for s in (1, 2, 5, 10)]
    return float(np.round(10.0 ** min(steps, key=lambda s: abs(s - wanted)), 6))


def _instants(drawn: Sequence[_Drawn], most: int) -> list[IntArray]:
    """Instants to keep of each run: evenly spread, and where something is largest or smallest.

    Runs at the same instants, or at the first of them, keep the same ones.
    """
    longest = max((d.result.t for d in drawn), key=len)
    alike = [np.array_equal(d.result.t, longest[: len(d.result.t)]) for d in drawn]
    together = [d for d, same in zip(drawn, alike, strict=True) if same]
    shared = _kept(together, len(longest), most)
    keep = []
    for d, same in zip(drawn, alike, strict=True):
        last = len(d.result.t) - 1
        own = np.union1d(shared[shared <= last], [last]) if same else _kept([d], last + 1, most)
        keep.append(own.astype(np.intp))
    return keep


def _kept(drawn: Sequence[_Drawn], n: int, instants: int) -> IntArray:
    each = sum(_numbers(d) for d in drawn)
    most = max(min(instants, NUMBERS // max(each, 1)), 2)
    if n <= most:
        return np.arange(n)
    extremes = np.unique([0, n - 1, *(i for d in drawn for i in _extremes(d))])
    spread = np.linspace(0, n - 1, max(most - len(extremes), 2)).round().astype(np.intp)
    keep = np.union1d(spread, extremes.astype(np.intp))
    if len(keep) > most:  # a robot with hundreds of links: the ends and an even choice
        keep = keep[np.linspace(0, len(keep) - 1, most).round().astype(np.intp)]
    return keep


def _numbers(drawn: _Drawn) -> int:
    """Numbers that an instant takes."""
    links = sum(a[0].size for link in drawn.links.values() for a in time_arrays(link))
    return int(links) + BODY * len(drawn.bodies)


def _extremes(drawn: _Drawn) -> list[int]:
    """Instants at which a torque, the deviation or a field of a link is largest or smallest."""
    n, path = len(drawn.result.t), drawn.path
    torque = drawn.result.arrays.get("torque", np.empty((n, 0)))
    rows = [torque, -torque, path["deviation"][:, None] if path else np.empty((n, 0))]
    for link in drawn.links.values():
        peaks = [largest(link, k) for k in link["fields"]]
        peaks.append(np.linalg.norm(link["disp"], axis=2).max(axis=1))
        rows += [p[:, None] for p in peaks if p is not None]
    return [int(i) for r in rows for i in r.argmax(axis=0)]


def _fields(links: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
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
    cloud = np.concatenate([points.swapaxes(0, 1) for points in clouds])  # instants in long rows
    return float(np.linalg.norm(np.ptp(cloud, axis=0), axis=1).max()) or 1.0


def _rows(arrow: dict[str, Any], keep: IntArray | slice) -> dict[str, Any]:
    return {k: v[keep] if isinstance(v, np.ndarray) else v for k, v in arrow.items()}
