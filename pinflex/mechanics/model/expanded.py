"""Records of the expanded model: where frames, stations and interfaces sit, and their maps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.text import brief

if TYPE_CHECKING:
    from pinflex.bodies.basis import FlexibleBody


@dataclass(frozen=True)
class Attachment:
    """Where a frame sits in the expanded model: a joint and the pose in that joint's frame."""

    __repr__ = brief

    joint: int
    placement: pin.SE3


@dataclass(frozen=True)
class Interface:
    """A section that carries something: its place x [m], its joint and its velocity rows."""

    __repr__ = brief

    x: float
    attachment: Attachment
    force_rows: IntArray

    def bottom(self, model: pin.Model) -> int:
        """The translation at the bottom of its chain of joints.

        Its force has all six components, about the displaced section, in the beam frame.
        """
        joint = self.attachment.joint
        while model.joints[joint].idx_v != self.force_rows[0]:
            joint = int(model.parents[joint])
        return joint


@dataclass(frozen=True)
class Slot:
    """One flexible body in the expanded model: its eta slice, stations and interfaces."""

    __repr__ = brief

    link: str
    offset: float
    body: FlexibleBody
    eta: slice
    root: Attachment
    stations: IntArray
    twists: IntArray
    interfaces: tuple[Interface, ...]


@dataclass(frozen=True)
class Block:
    """The coordinate maps of equal bodies, stacked, so that one product serves them all.

    X is the identity on the rigid rows and one small block per body; nothing else is stored.

    Attributes:
        rows: Expanded velocity rows of each body, the curved ones first, shape (bodies, R).
        q_rows: Where these coordinates sit in Q, shape (bodies * R,).
        Phi: First-order part, shape (bodies, R, n).
        G: Second-order part of the first Rc rows, shape (bodies, Rc, n, n).
        eta: Slice of eta that covers the stacked bodies.
    """

    __repr__ = brief

    rows: IntArray
    q_rows: IntArray
    Phi: Array
    G: Array
    eta: slice


@dataclass(frozen=True)
class ElasticDrive:
    """A gear that gives way: its joint, its elastic coordinate and its expanded velocity row."""

    __repr__ = brief

    joint: str
    eta: int
    row: int


@dataclass(frozen=True)
class Expansion:
    """An expanded model and the constant parts of its coordinate map.

    Attributes:
        model: Expanded Pinocchio model.
        q_at, v_at: Where the rigid q and v sit in Q and V.
        blocks: Maps from eta to station and interface coordinates, grouped by equal bodies.
        frames: Attachment of every link frame, by name.
        slots: The flexible bodies.
        n_eta: Number of elastic coordinates.
        drives: Gears that give way; their coordinates follow those of the links.
    """

    __repr__ = brief

    model: pin.Model
    q_at: IntArray
    v_at: IntArray
    blocks: tuple[Block, ...]
    frames: Mapping[str, Attachment]
    slots: tuple[Slot, ...]
    n_eta: int
    drives: tuple[ElasticDrive, ...] = ()


def gear_name(joint: str) -> str:
    """Name in the expanded model of the joint between a motor's side and the link."""
    return f"gear of {joint}"


def rigid_indices(rigid: pin.Model, model: pin.Model) -> tuple[IntArray, IntArray]:
    """Where the q and v of the rigid model sit in Q and V."""
    q_at = np.empty(rigid.nq, dtype=np.intp)
    v_at = np.empty(rigid.nv, dtype=np.intp)
    for joint, name in zip(rigid.joints[1:], rigid.names[1:], strict=True):
        there = model.joints[model.getJointId(name)]
        q_at[joint.idx_q : joint.idx_q + joint.nq] = there.idx_q + np.arange(joint.nq)
        v_at[joint.idx_v : joint.idx_v + joint.nv] = there.idx_v + np.arange(joint.nv)
    return q_at, v_at
