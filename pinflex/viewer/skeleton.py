"""Rigid links as shapes to draw: balls at joints, rods between two, plates across three or more."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.results.drawing import Joint
from pinflex.results.result import Result
from pinflex.viewer.frames import FrameLocator, body_names, seen_from
from pinflex.viewer.surfaces import Surface, joined, packed


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


def body_shapes(body: Skeleton, keep: IntArray, size: float) -> dict[str, Any]:
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
        "rigid": rigid[keep[:1] if still else keep].reshape(-1, 12),
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
