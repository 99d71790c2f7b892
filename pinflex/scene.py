"""What a picture of a run needs, from its Result alone: world positions, fields, arrows, curves.

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
from pinflex.carried import Carrier
from pinflex.named import rotation_vector
from pinflex.result import Result
from pinflex.skeleton import Skeleton, drawn, skeletons
from pinflex.surfaces import Surface, packed, surfaces

FRAMES = 600  # a page holds at most this many instants
STATIONS = 25  # and this many stations of a link, besides those where a field peaks
SHARE = 0.06  # automatic magnification: largest displacement over robot size
FIELDS = {  # key: label, unit, shown = SI * factor
    "von_mises": ("von Mises stress", "MPa", 1e-6),
    "bending": ("bending stress", "MPa", 1e-6),
    "axial": ("axial stress", "MPa", 1e-6),
    "shear": ("shear stress", "MPa", 1e-6),
    "displacement": ("displacement", "mm", 1e3),
}
LEVELS = {"ked": "kineto-elastodynamic", "coupled": "coupled rigid-flexible"}


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
    links = {name: _link(result, name, skins.get(name)) for name in result.links}
    track = _track(result, rigid)
    keep = _frames(result, links, track)
    carrier = Carrier(result)
    bones = skeletons(result, carrier, skins)
    size = _size(bones, links, keep)
    largest = max(
        [float(np.linalg.norm(link["disp"], axis=2).max()) for link in links.values()]
        + ([float(track["deviation"].max())] if track else [])
        + [0.0]
    )
    notes = [*result.meta.get("warnings", ()), *missing]
    if len(keep) < len(result.t):
        notes.insert(0, f"{len(keep)} of {len(result.t)} instants kept, extremes among them")
    if result.meta.get("status", "complete") != "complete":
        notes.insert(0, f"{result.meta['status']}: {result.meta.get('message', '')}")
    return {
        "name": str(result.meta.get("name", "result")),
        "level": LEVELS.get(result.level, result.level),
        "mode": None,
        "t": result.t[keep],
        "size": size,
        "scale": automatic_scale(largest, size) if scale == "auto" else float(scale),
        "largest": largest,
        "links": [_thin(link, keep) for link in links.values()],
        "bodies": [drawn(bone, keep, size) for bone in bones],
        "track": track
        and {k: v[keep] if isinstance(v, np.ndarray) else v for k, v in track.items()},
        "forces": [_rows(arrow, keep) for arrow in carrier.forces()],
        "torques": [_rows(arrow, keep) for arrow in carrier.torques()],
        "plots": _plots(result, rigid, links, track, keep),
        "fields": _fields(links),
        "notes": notes,
    }


def automatic_scale(largest: float, size: float, share: float = SHARE) -> float:
    """Magnification 1, 2 or 5 times a power of ten that shows `largest` as a share of `size`.

    A displacement that is large as it is stays at 1: nothing is ever drawn smaller.
    """
    if not 0.0 < largest < share * size:
        return 1.0
    wanted = np.log10(share * size / largest)
    steps = [np.log10(s) + np.floor(wanted) for s in (1, 2, 5, 10)]
    return float(np.round(10.0 ** min(steps, key=lambda s: abs(s - wanted)), 6))


def _link(result: Result, name: str, skin: Surface | None) -> dict[str, Any]:
    """One flexible link at every instant, with the stations worth keeping."""
    get = {
        k[len(f"link/{name}/") :]: v
        for k, v in result.arrays.items()
        if k.startswith(f"link/{name}/")
    }
    about = result.meta.get("links", {}).get(name, {})
    centre, x = get["centreline"], get["x"]
    rigid = get.get("centreline_rigid", centre)
    fields = {k: get[f"stress/{k}"] for k in FIELDS if f"stress/{k}" in get}
    station = np.unique(np.linspace(0, len(x) - 1, min(STATIONS, len(x))).round().astype(np.intp))
    peaks = [np.abs(f).max(axis=0).argmax() for f in fields.values()]
    station = np.union1d(station, np.array(peaks, dtype=np.intp))
    section_y = get["section_y"] if "section_y" in get else _any_normal(rigid)
    outline = about.get("section", {}).get("outline") or _circle(
        0.01 * float(about.get("length", x[-1]))
    )
    return {
        "name": name,
        "x": x[station],
        "length": float(about.get("length", x[-1])),
        "outline": outline,
        "mesh": _on_beam(skin, about),
        "shape": about.get("section", {}).get("shape", ""),
        "material": about.get("material", {}).get("name", "") or "",
        "rigid": rigid[:, station],
        "disp": (centre - rigid)[:, station],
        "y_rigid": _rigid_normal(rigid, section_y),
        "y": section_y[:, station],
        "fields": {k: f[:, station] for k, f in fields.items()},
    }


def _on_beam(skin: Surface | None, about: dict[str, Any]) -> dict[str, Any] | None:
    """The mesh of a flexible link in its beam frame, to be bent with it."""
    if skin is None or not skin.from_file or "frame" not in about or "origin" not in about:
        return None
    turn = np.asarray(about["frame"], dtype=float).T  # from the link's frame to the beam's
    return packed(skin.moved(turn, -turn @ np.asarray(about["origin"], dtype=float)))


def _rigid_normal(rigid: Array, section_y: Array) -> Array:
    """World direction of the section's y axis in the rigid pose, shape (nt, 3).

    The root section's own, made square to the rigid span: a turn about an axis across the span
    moves y along the span only, to first order.
    """
    along, y = _unit(rigid[:, -1] - rigid[:, 0]), section_y[:, 0]
    return _unit(y - along * np.sum(along * y, axis=1)[:, None])


def _thin(link: dict[str, Any], keep: IntArray) -> dict[str, Any]:
    out = {**link, **{k: link[k][keep] for k in ("rigid", "disp", "y_rigid")}}
    out["fields"] = {k: f[keep] for k, f in link["fields"].items()}
    # a direction needs no more than 16 bits: 0.002 degrees
    out["y"] = np.round(32767 * np.clip(link["y"][keep], -1, 1)).astype(np.int16)
    ends = out["rigid"][:, [0, -1]]
    share = ((link["x"] - link["x"][0]) / (link["x"][-1] - link["x"][0]))[:, None]
    line = ends[:, :1] * (1 - share) + ends[:, 1:] * share
    if np.abs(line - out["rigid"]).max() < 1e-6 * link["length"]:  # straight: two ends say it all
        out["rigid"] = ends
    return out


def _track(result: Result, rigid: Result | None) -> dict[str, Any] | None:
    """Path of the platform (or of the tip that moves most) and how far it is from rigid."""
    name = result.meta.get("platform")
    other: Array | None
    turn: Array | None
    turned: Array | None
    if name and f"frame/{name}/position" in result.arrays:
        position = result.arrays[f"frame/{name}/position"]
        turn = result.arrays.get(f"frame/{name}/rotation")
        if rigid is not None and f"frame/{name}/position" in rigid.arrays:
            other, turned = _at(rigid, f"frame/{name}/position", result.t), None
            if turn is not None and len(rigid.t) == len(result.t):
                turned = rigid.arrays.get(f"frame/{name}/rotation")
        else:
            other, turned = Carrier(result).rigid_frame(name)
    elif result.links:
        ends = {n: result.arrays[f"link/{n}/centreline"][:, -1] for n in result.links}
        still = {
            n: result.arrays.get(
                f"link/{n}/centreline_rigid", result.arrays[f"link/{n}/centreline"]
            )[:, -1]
            for n in result.links
        }
        link = max(ends, key=lambda n: float(np.abs(ends[n] - still[n]).max()))
        name, position, other, turn, turned = f"tip of {link}", ends[link], still[link], None, None
    else:
        return None
    other = position if other is None else other
    angle = np.zeros(len(result.t))
    if turn is not None and turned is not None:
        angle = np.linalg.norm(rotation_vector(turn @ np.swapaxes(turned, 1, 2)), axis=1)
    deviation = np.linalg.norm(position - other, axis=1)
    track = {"name": name, "position": position, "rigid": other}
    track |= {"deviation": deviation, "angle": angle}
    fine, finer = deviation.max() < 1e-5, angle.max() < 1e-4
    track |= {"factor": 1e6, "unit": "µm"} if fine else {"factor": 1e3, "unit": "mm"}
    track |= {"angle_factor": 1e6 if finer else 1e3, "angle_unit": "µrad" if finer else "mrad"}
    return track


def _plots(
    result: Result,
    rigid: Result | None,
    links: dict[str, dict[str, Any]],
    track: dict[str, Any] | None,
    keep: IntArray,
) -> list[dict[str, Any]]:
    plots: list[dict[str, Any]] = []
    torque, still = result.arrays.get("torque"), result.arrays.get("rigid/torque")
    if rigid is not None and rigid.motors and rigid.motors == result.motors:
        still = _at(rigid, "torque", result.t)
    if torque is not None and torque.shape[1]:
        curves = [_curve(n, torque[keep, i], i) for i, n in enumerate(result.motors)]
        if still is not None:
            curves += [
                _curve(f"{n}, rigid", still[keep, i], i, rigid=True)
                for i, n in enumerate(result.motors)
            ]
        unit = result.unit(f"torque/{result.motors[0]}") if result.motors else ""
        plots.append({"title": "motor torque", "unit": unit or "N m", "curves": curves})
    if track is not None and float(track["deviation"].max()) > 0.0:
        curve = _curve(track["name"], track["factor"] * track["deviation"][keep], 0)
        title = f"{track['name']} off rigid"
        plots.append({"title": title, "unit": track["unit"], "curves": [curve]})
    stress = {n: k["fields"]["von_mises"] for n, k in links.items() if "von_mises" in k["fields"]}
    if stress:
        curves = [
            _curve(n, 1e-6 * s[keep].max(axis=1), i) for i, (n, s) in enumerate(stress.items())
        ]
        plots.append({"title": "peak von Mises", "unit": "MPa", "curves": curves})
    return plots


def _curve(name: str, y: Array, colour: int, rigid: bool = False) -> dict[str, Any]:
    return {"name": name, "y": y, "colour": colour, "rigid": rigid}


def _frames(
    result: Result, links: dict[str, dict[str, Any]], track: dict[str, Any] | None
) -> IntArray:
    """Instants to keep: evenly spread, and every one where something is largest or smallest."""
    n = len(result.t)
    if n <= FRAMES:
        return np.arange(n)
    torque = result.arrays.get("torque", np.empty((n, 0)))
    rows = [torque, -torque, track["deviation"][:, None] if track else np.empty((n, 0))]
    rows += [np.abs(f).max(axis=1)[:, None] for k in links.values() for f in k["fields"].values()]
    rows += [np.linalg.norm(k["disp"], axis=2).max(axis=1)[:, None] for k in links.values()]
    extremes = np.unique([0, n - 1, *(int(i) for r in rows for i in r.argmax(axis=0))])
    spread = np.linspace(0, n - 1, max(FRAMES - len(extremes), 2)).round().astype(np.intp)
    keep = np.union1d(spread, extremes.astype(np.intp))
    if len(keep) > FRAMES:  # a robot with hundreds of links: the ends and an even choice
        keep = keep[np.linspace(0, len(keep) - 1, FRAMES).round().astype(np.intp)]
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


def _size(bones: list[Skeleton], links: dict[str, dict[str, Any]], keep: IntArray) -> float:
    """Largest diagonal of the box about the rigid mechanism [m]."""
    clouds = [link["rigid"][keep] for link in links.values()]
    for bone in bones:
        pose, points = bone.pose[keep], bone.points
        clouds.append(np.einsum("tij,pj->tpi", pose[:, :, :3], points) + pose[:, None, :, 3])
    if not clouds:
        return 1.0
    cloud = np.concatenate(clouds, axis=1)
    return float(np.linalg.norm(np.ptp(cloud, axis=1), axis=1).max()) or 1.0


def _at(result: Result, key: str, t: Array) -> Array:
    """An array of another run at the instants t, linear in between; shape (nt, n)."""
    values = result.arrays[key]
    return np.stack([np.interp(t, result.t, column) for column in values.T], axis=1)


def _rows(arrow: dict[str, Any], keep: IntArray) -> dict[str, Any]:
    return {k: v[keep] if isinstance(v, np.ndarray) else v for k, v in arrow.items()}


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-30))


def _any_normal(rigid: Array) -> Array:
    """A direction across the link, for a result without section directions."""
    along = _unit(rigid[:, -1] - rigid[:, 0])
    pick = np.eye(3)[np.abs(along).mean(axis=0).argmin()]
    return np.broadcast_to(_unit(np.cross(along, pick))[:, None], rigid.shape)


def _circle(radius: float) -> list[list[float]]:
    turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    return [[float(radius * np.cos(a)), float(radius * np.sin(a))] for a in turn]
