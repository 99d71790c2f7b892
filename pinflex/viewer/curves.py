"""Curves of a run over time: the platform's path, how far it is from rigid, torques, stress."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.results.drawing import Drawing, Joint, drawing_of
from pinflex.results.lazy import Late, read_only
from pinflex.results.result import Result
from pinflex.results.views import Deviation
from pinflex.rotations import rotation_vector

# Joint positions, reaction forces and motor torques of a result in the world frame.
#
# A Result gives a reaction in the frame of the joint's child link. Which link that is, and about
# which axis a motor turns, is in its `drawing`.


@dataclass(frozen=True)
class FrameLocator:
    """Finds the world pose of links and frames of a result, as they are and as rigid ones."""

    result: Result

    def forces(self) -> list[dict[str, Any]]:
        """Joint and loop forces [N] on the child: {name, rigid, disp, vector}, each (nt, 3)."""
        arrays, arrows = self.result.arrays, list[dict[str, Any]]()
        for key in sorted(k for k in arrays if k.startswith("reaction/")):
            child = self._child(key[9:])
            if child is not None:
                force = np.einsum("tij,tj->ti", child[1], arrays[key][:, :3])
                arrows.append(_arrow(key[9:], child[0], force))
        for name, between in self.drawing.loops.items():
            place = next((p for p in map(self.point, reversed(between)) if p), None)
            if place is not None and f"loop/{name}/wrench" in arrays:
                arrows.append(_arrow(name, place, arrays[f"loop/{name}/wrench"][:, :3]))
        return arrows

    def torques(self) -> list[dict[str, Any]]:
        """Motor torques: as forces, the axis being the vector, and value (nt,), linear."""
        arrows: list[dict[str, Any]] = []
        for i, name in enumerate(self.result.motors if "torque" in self.result.arrays else ()):
            child = self._child(name)
            if child is not None:
                joint = self.joints[name]
                more = {"value": self.result.torque[:, i], "linear": joint.kind == "prismatic"}
                arrows.append(_arrow(name, child[0], child[1] @ joint.axis) | more)
        return arrows

    def _child(self, name: str) -> tuple[tuple[Array, Array], Array] | None:
        """Place and rotation of the link that a joint carries, where both are known."""
        joint = self.joints.get(name)
        place = self.point(joint.child) if joint else None
        turn = self.rotation(joint.child) if joint else None
        return None if place is None or turn is None else (place, turn)

    @cached_property
    def drawing(self) -> Drawing:
        """Joints, visuals, loops and beam axes of the robot."""
        return drawing_of(self.result.meta)

    @property
    def joints(self) -> Mapping[str, Joint]:
        """Joints by name."""
        return self.drawing.joints

    def point(self, name: str) -> tuple[Array, Array] | None:
        """World position of a link or frame, and that of the rigid mechanism; each (nt, 3)."""
        arrays = self.result.arrays
        if f"body/{name}/pose" in arrays:
            return self._on_body(name, np.zeros(3))
        if f"link/{name}/centreline" in arrays:
            return self._station(name, 0)
        if f"frame/{name}/position" in arrays:
            position = arrays[f"frame/{name}/position"]
            still, _ = self.rigid_frame(name)
            return position, position if still is None else still
        above = [j for j in self.joints.values() if j.child == name and j.kind == "fixed"]
        for joint in above:  # a frame fixed to a link: at its origin, or at the far end of a beam
            if f"link/{joint.parent}/centreline" in arrays:
                return self._station(joint.parent, -1 if np.any(joint.origin) else 0)
            if f"body/{joint.parent}/pose" in arrays:
                return self._on_body(joint.parent, joint.origin)
        return None

    def rotation(self, name: str) -> Array | None:
        """Rotation of a link in the world, (nt, 3, 3); of a flexible link: of its root section."""
        arrays = self.result.arrays
        if f"body/{name}/pose" in arrays:
            return arrays[f"body/{name}/pose"][:, :, :3]
        if f"link/{name}/section_y" not in arrays:
            return None
        beam = self.drawing.beams.get(name)
        if beam is None:
            return None
        centre, y = arrays[f"link/{name}/centreline"], arrays[f"link/{name}/section_y"][:, 0]
        x = centre[:, 1] - centre[:, 0]
        x = x - y * np.sum(x * y, axis=1)[:, None]
        x = x / np.linalg.norm(x, axis=1)[:, None]
        world = np.stack([x, y, np.cross(x, y)], axis=2)
        return np.asarray(world @ beam.T)

    def rigid_frame(self, name: str) -> tuple[Array | None, Array | None]:
        """Position and rotation of a frame in the rigid mechanism, from what carries it.

        The locator is the body (or end of a link) to which the frame keeps its place all the time.
        """
        arrays = self.result.arrays
        position = arrays[f"frame/{name}/position"]
        turn = arrays.get(f"frame/{name}/rotation")
        for body in sorted(body_names(self.result), key=lambda b: b != name):
            rigid = arrays.get(f"body/{body}/pose_rigid")
            pose = arrays[f"body/{body}/pose"]
            local = seen_from(pose, position)
            if rigid is not None and np.ptp(local, axis=0).max() < 1e-7:
                spin = rigid[:, :, :3] @ np.swapaxes(pose[:, :, :3], 1, 2)
                return _move(rigid, local[0]), None if turn is None else spin @ turn
        for link in self.result.links:
            for station in (0, -1):
                place, rigid = self._station(link, station)
                if np.abs(place - position).max() < 1e-7:
                    return rigid, None
        return None, None

    def _on_body(self, name: str, point: Array) -> tuple[Array, Array]:
        """A point of a body, as it is and as the rigid mechanism has it."""
        pose = self.result.arrays[f"body/{name}/pose"]
        rigid = self.result.arrays.get(f"body/{name}/pose_rigid", pose)
        return _move(pose, point), _move(rigid, point)

    def _station(self, link: str, index: int) -> tuple[Array, Array]:
        centre = self.result.arrays[f"link/{link}/centreline"]
        rigid = self.result.arrays.get(f"link/{link}/centreline_rigid", centre)
        return centre[:, index], rigid[:, index]


def body_names(result: Result) -> list[str]:
    """Rigid bodies of a result."""
    heads = (key.partition("/")[2] for key in result.arrays if key.startswith("body/"))
    return [name.removesuffix("/pose") for name in heads if name.endswith("/pose")]


def seen_from(pose: Array, points: Array) -> Array:
    """Points of the world as a body sees them, shape (nt, 3)."""
    return np.asarray(np.einsum("tji,tj->ti", pose[:, :, :3], points - pose[:, :, 3]))


def _arrow(name: str, place: tuple[Array, Array], vector: Array) -> dict[str, Any]:
    return {"name": name, "rigid": place[1], "disp": place[0] - place[1], "vector": vector}


def _move(pose: Array, point: Array) -> Array:
    return np.asarray(pose[:, :, :3] @ point + pose[:, :, 3])


RIGID_TORQUE = "rigid/torque"  # array of a flexible run that was compared with the rigid one


def with_rigid_torque(run: Result, rigid: Result) -> Result:
    """The run with the torques of the same motion without elasticity beside its own."""
    if not run.motors or run.motors != rigid.motors or run is rigid:
        return run
    beside = read_only(_at(rigid, "torque", run.t), RIGID_TORQUE)
    return Result(run.t, Late({**run.arrays, RIGID_TORQUE: beside}, {}), run.meta)


def track(
    result: Result, rigid: Result | None, off_path: Deviation | None = None
) -> dict[str, Any] | None:
    """Path of the platform (or of the tip that moves most) and how far it is from rigid."""
    name, angle = result.meta.get("platform"), np.zeros(len(result.t))
    if name and f"frame/{name}/position" in result.arrays:
        position = result.arrays[f"frame/{name}/position"]
        other, turned = _rigid_platform(result, rigid, name)
        turn = result.arrays.get(f"frame/{name}/rotation")
        if turn is not None and turned is not None:
            angle = np.linalg.norm(rotation_vector(turn @ np.swapaxes(turned, 1, 2)), axis=1)
    elif result.links:
        name, position, other = _furthest_tip(result)
    else:
        return None
    other = position if other is None else other
    disp = position - other
    deviation = np.linalg.norm(disp, axis=1)
    if off_path is not None:
        deviation, angle = off_path.norm, off_path.angle
    path = {"name": name, "rigid": other, "disp": disp, "deviation": deviation, "angle": angle}
    path["off"] = "rigid" if off_path is None else "path"
    fine, finer = deviation.max() < 1e-5, angle.max() < 1e-4
    path |= {"factor": 1e6, "unit": "µm"} if fine else {"factor": 1e3, "unit": "mm"}
    path |= {"angle_factor": 1e6 if finer else 1e3, "angle_unit": "µrad" if finer else "mrad"}
    return path


def _rigid_platform(
    result: Result, rigid: Result | None, name: str
) -> tuple[Array | None, Array | None]:
    """Positions (nt, 3) and rotations (nt, 3, 3) of the platform were the robot rigid."""
    if rigid is None or f"frame/{name}/position" not in rigid.arrays:
        return FrameLocator(result).rigid_frame(name)
    position = _at(rigid, f"frame/{name}/position", result.t)
    same = len(rigid.t) == len(result.t)
    return position, rigid.arrays.get(f"frame/{name}/rotation") if same else None


def _furthest_tip(result: Result) -> tuple[str, Array, Array]:
    """Name, path and rigid path (nt, 3) of the link's end that moves most."""
    ends = {n: result.arrays[f"link/{n}/centreline"][:, -1] for n in result.links}
    rigid = {
        n: result.arrays.get(f"link/{n}/centreline_rigid", result.arrays[f"link/{n}/centreline"])[
            :, -1
        ]
        for n in result.links
    }
    link = max(ends, key=lambda n: float(np.abs(ends[n] - rigid[n]).max()))
    return f"tip of {link}", ends[link], rigid[link]


def plots(
    result: Result,
    rigid: Result | None,
    stress: dict[str, Array],
    path: dict[str, Any] | None,
    keep: IntArray | slice,
) -> list[dict[str, Any]]:
    """Plots under the time bar: {title, unit, curves}."""
    panels = _torques(result, rigid, keep)
    if path is not None and float(path["deviation"].max()) > 0.0:
        curve = _curve(path["name"], path["factor"] * path["deviation"][keep], 0)
        title = f"{path['name']} off {path['off']}"
        panels.append({"title": title, "unit": path["unit"], "curves": [curve], "deviation": True})
    if stress:
        curves = [_curve(n, 1e-6 * s[keep], i) for i, (n, s) in enumerate(stress.items())]
        panels.append({"title": "peak von Mises", "unit": "MPa", "curves": curves})
    return panels


def _torques(result: Result, rigid: Result | None, keep: IntArray | slice) -> list[dict[str, Any]]:
    """Torques in one plot, forces in another, each with its rigid counterpart."""
    torque, still = result.arrays.get("torque"), result.arrays.get(RIGID_TORQUE)
    if rigid is not None and rigid.motors == result.motors and "torque" in rigid.arrays:
        still = _at(rigid, "torque", result.t)
    panels: dict[str, dict[str, Any]] = {}
    for i, name in enumerate(result.motors if torque is not None else ()):
        unit = result.unit(f"torque/{name}") or "N m"
        title = "motor force" if unit == "N" else "motor torque"
        plot = panels.setdefault(unit, {"title": title, "unit": unit, "curves": []})
        for values, is_rigid in ((torque, False), (still, True)):
            if values is not None:
                plot["curves"].append(_curve(name, values[keep, i], i, is_rigid))
    return list(panels.values())


def _curve(name: str, y: Array, colour: int, rigid: bool = False) -> dict[str, Any]:
    return {"name": name, "y": y, "colour": colour, "rigid": rigid}


def _at(result: Result, key: str, t: Array) -> Array:
    """An array of another run at the instants t, linear in between; shape (nt, n)."""
    values = result.arrays[key]
    return np.stack([np.interp(t, result.t, column) for column in values.T], axis=1)


# What a viewer of a run must know before believing the picture, in a few words each.

BAD, CARE, PLAIN = "bad", "care", "plain"
_GRADES = {"closure": "loops open", "energy": "energy balance"}
_WORDS = {"closure": "leaves its loops open", "energy": "energy balance"}  # of their warnings
_STRAIGHT = "started straight under gravity"  # as a comparison remarks


def verdicts(result: Result) -> list[dict[str, str]]:
    """Verdicts of a run, worst first: {kind, text, why}."""
    found = [*_ended(result), *_warned(result), *_grades(result), *_model(result)]
    order = (BAD, CARE, PLAIN)
    return sorted(found, key=lambda v: order.index(v["kind"]))


def _ended(result: Result) -> list[dict[str, str]]:
    """An early end: no equilibrium, or no solution of the equations."""
    status = str(result.meta.get("status", "complete"))
    if status == "complete":
        return []
    message = str(result.meta.get("message", ""))
    falls = "buckle" in message or "no equilibrium" in message
    what = "buckles or falls" if falls else status
    return [_verdict(BAD, f"{what} at {result.t[-1]:.4g} s", message)]


def _grades(result: Result) -> list[dict[str, str]]:
    """Closures and energy that are not good, each with the warning about it."""
    found = []
    for key, grade in _poor(result).items():
        why = next((text for text in _warnings(result) if _WORDS[key] in text), "")
        found.append(_verdict(BAD if grade == "wrong" else CARE, f"{_GRADES[key]}: {grade}", why))
    return found


def _poor(result: Result) -> dict[str, str]:
    """Grades that are not good."""
    grades: dict[str, str] = result.meta.get("grades") or {}
    return {key: grade for key, grade in grades.items() if grade != "good"}


def _warnings(result: Result) -> list[str]:
    return [str(text) for text in result.meta.get("warnings", ())]


def _warned(result: Result) -> list[dict[str, str]]:
    """Remarks and warnings, shortened to what matters; those that a grade tells are left out."""
    told = [_WORDS[key] for key in _poor(result)]
    remarks = [x for x in str(result.meta.get("remark") or "").split("; ") if x and x != _STRAIGHT]
    rest = [text for text in _warnings(result) if not any(words in text for words in told)]
    found = [_verdict(BAD, text.partition(":")[0], text) for text in remarks]
    return found + [_in_short(text) for text in rest]


def _in_short(warning: str) -> dict[str, str]:
    if "buckle" not in warning:
        return _verdict(CARE, warning, warning)
    when = re.match(r"t = (\S+ s):", warning)
    return _verdict(BAD, f"buckles from {when[1]} on" if when else warning, warning)


def _model(result: Result) -> list[dict[str, str]]:
    """How the level sees the motion, and how it starts."""
    found = []
    settings: dict[str, Any] = result.meta.get("settings") or {}
    if settings.get("start") == "straight":
        why = "The links are undeformed at first: loads that act at once make them ring."
        rings = _STRAIGHT in str(result.meta.get("remark") or "")
        found.append(_verdict(CARE if rings else PLAIN, "straight start", why))
    if result.level == "ked":
        why = "Small vibrations about the rigid motion: buckling and large bends are not seen."
        found.append(_verdict(PLAIN, "linear", why))
    if result.level == "quasistatic":
        found.append(_verdict(PLAIN, "no vibration", "In balance at every instant."))
    return found


def _verdict(kind: str, text: str, why: str) -> dict[str, str]:
    return {"kind": kind, "text": text, "why": why}
