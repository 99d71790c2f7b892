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
            joint = self.joints.get(key[9:])
            place = self.point(joint.child) if joint else None
            turn = self.rotation(joint.child) if joint else None
            if place is not None and turn is not None:
                force = np.einsum("tij,tj->ti", turn, arrays[key][:, :3])
                arrows.append(_arrow(key[9:], place, force))
        for name, between in self.drawing.loops.items():
            place = next((p for p in map(self.point, reversed(between)) if p), None)
            if place is not None and f"loop/{name}/wrench" in arrays:
                arrows.append(_arrow(name, place, arrays[f"loop/{name}/wrench"][:, :3]))
        return arrows

    def torques(self) -> list[dict[str, Any]]:
        """Motor torques: as forces, the axis being the vector, and value (nt,), linear."""
        arrows: list[dict[str, Any]] = []
        for i, name in enumerate(self.result.motors):
            joint = self.joints.get(name)
            place = self.point(joint.child) if joint else None
            turn = self.rotation(joint.child) if joint else None
            if joint is None or place is None or turn is None or "torque" not in self.result.arrays:
                continue
            linear = joint.kind == "prismatic"
            arrow = _arrow(name, place, turn @ joint.axis)
            arrow |= {"value": self.result.torque[:, i], "linear": linear}
            arrows.append(arrow)
        return arrows

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
            pose = arrays[f"body/{name}/pose"]
            rigid = arrays.get(f"body/{name}/pose_rigid", pose)
            return pose[:, :, 3], rigid[:, :, 3]
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
                pose = arrays[f"body/{joint.parent}/pose"]
                rigid = arrays.get(f"body/{joint.parent}/pose_rigid", pose)
                return _move(pose, joint.origin), _move(rigid, joint.origin)
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
        bodies = [k[5:-5] for k in arrays if k.startswith("body/") and k.endswith("/pose")]
        for body in sorted(bodies, key=lambda b: b != name):
            rigid = arrays.get(f"body/{body}/pose_rigid")
            pose = arrays[f"body/{body}/pose"]
            local = np.einsum("tji,tj->ti", pose[:, :, :3], position - pose[:, :, 3])
            if rigid is not None and np.ptp(local, axis=0).max() < 1e-7:
                spin = rigid[:, :, :3] @ np.swapaxes(pose[:, :, :3], 1, 2)
                return _move(rigid, local[0]), None if turn is None else spin @ turn
        for link in self.result.links:
            for station in (0, -1):
                place, rigid = self._station(link, station)
                if np.abs(place - position).max() < 1e-7:
                    return rigid, None
        return None, None

    def _station(self, link: str, index: int) -> tuple[Array, Array]:
        centre = self.result.arrays[f"link/{link}/centreline"]
        rigid = self.result.arrays.get(f"link/{link}/centreline_rigid", centre)
        return centre[:, index], rigid[:, index]


def _arrow(name: str, place: tuple[Array, Array], vector: Array) -> dict[str, Any]:
    return {"name": name, "rigid": place[1], "disp": place[0] - place[1], "vector": vector}


def _move(pose: Array, point: Array) -> Array:
    return np.asarray(pose[:, :, :3] @ point + pose[:, :, 3])
