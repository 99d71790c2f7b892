"""Joint positions, reaction forces and motor torques of a result in the world frame.

A Result gives a reaction in the frame of the joint's child link. Which link that is, and about
which axis a motor turns, is in its `drawing`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.results.drawing import Drawing, Joint, drawing_of
from pinflex.results.result import Result


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
