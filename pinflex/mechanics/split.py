"""A large model in parts: one for each child of the base, and several of a child that is large.

A workspace of Pinocchio has four tensors of nV^3 numbers: many small ones take less than one large
one. What hangs on a cut rides on a free joint of six velocities.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from pinflex.arrays import IntArray
from pinflex.mechanics.workspace import same_tree

Rows = slice | IntArray

# Velocity rows of a model that stays whole (0.13 GB, 60 ms to make); of a child of the base that
# does, where mass and derivatives are Pinocchio's (2 GB); of what a larger one is cut to.
_WHOLE, _UNCUT, _PIECE = 160, 396, 48


@dataclass(frozen=True)
class Subtree:
    """A part of a model.

    Attributes:
        number: Of this part. like: Of the first part with equal joints.
        model: Its joints; one that hangs on a cut has a free joint before them.
        joints: Their numbers in the whole model, in order.
        q, v: Where its coordinates and velocities are in the whole model's.
        parent: Joint of the whole model that it hangs on.
        cut: Whether that is a cut, not the base.
        carriers: Joints that others hang on: numbers here and in the whole model.
    """

    number: int
    like: int
    model: pin.Model
    joints: IntArray
    q: Rows
    v: Rows
    parent: int
    cut: bool
    carriers: tuple[tuple[int, int], ...]


def split(model: pin.Model, compiled: bool) -> tuple[Subtree, ...]:
    """Subtrees of a model, those that carry others first; none where it is to stay whole.

    Args:
        model: The model. compiled: Whether the kernel has its mass and derivatives.
    """
    if model.nv <= _WHOLE:
        return ()
    heads = _heads(model, _WHOLE if compiled else _UNCUT)
    if len(set(heads.values())) == 1:
        return ()
    head_of, members = np.zeros(int(model.njoints), dtype=np.intp), dict[int, list[int]]()
    for j in range(1, int(model.njoints)):
        head_of[j] = heads[j] if j in heads else head_of[model.parents[j]]
        members.setdefault(int(head_of[j]), []).append(j)
    carriers = {int(model.parents[head]) for head in heads} - {0}
    parts, kinds = list[Subtree](), list[Subtree]()
    for joints in members.values():
        part = _subtree(model, len(parts), joints, carriers)
        same = next((kind for kind in kinds if same_tree(kind.model, part.model)), None)
        if same is None:
            kinds.append(part)
        parts.append(part if same is None else replace(part, like=same.number))
    return tuple(parts)


def _heads(model: pin.Model, most: int) -> dict[int, int]:
    """The first joints of every subtree, each with the first of those that it goes with.

    A child of the base is cut that has more rows than most: large branches by themselves, small
    ones of one joint, such as the stations of a beam, several together.
    """
    nv = np.array(model.nvs)
    below = nv.copy()
    for j in range(int(model.njoints) - 1, 0, -1):
        below[model.parents[j]] += below[j]
    heads = {int(j): int(j) for j in model.children[0]}
    large = np.zeros(len(nv), dtype=bool)
    for j in range(1, len(nv)):
        large[j] = below[j] > most if j in heads else large[model.parents[j]]
    rest = nv.copy()
    for j in np.flatnonzero(large)[::-1]:
        children = sorted(map(int, model.children[int(j)]), key=lambda child: -rest[child])
        rest[j] += sum(rest[child] for child in children)
        first, size = 0, _PIECE  # of small ones together
        for child in children:
            if rest[j] <= _PIECE:
                break
            if 4 * rest[child] > _PIECE:
                heads[child] = child
            else:
                if size + rest[child] > _PIECE:
                    first, size = child, 0
                heads[child], size = first, size + rest[child]
            rest[j] -= rest[child]
    return heads


def _subtree(model: pin.Model, number: int, joints: list[int], carriers: set[int]) -> Subtree:
    """The part of a model that has these joints."""
    part, parent = pin.Model(), int(model.parents[joints[0]])
    part.gravity = model.gravity
    here = {parent: 0}
    if parent:
        here[parent] = part.addJoint(
            0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), model.names[parent]
        )
    q, v = list[int](), list[int]()
    for j in joints:
        joint = model.joints[j]
        above, place = here[int(model.parents[j])], model.jointPlacements[j]
        here[j] = part.addJoint(above, joint, place, model.names[j])
        part.appendBodyToJoint(here[j], model.inertias[j], pin.SE3.Identity())
        q += range(joint.idx_q, joint.idx_q + joint.nq)
        v += range(joint.idx_v, joint.idx_v + joint.nv)
    armature = np.zeros(part.nv)
    armature[part.nv - len(v) :] = model.armature[v]
    part.armature = armature
    carried = tuple((here[j], j) for j in joints if j in carriers)
    rows = _rows(q), _rows(v)
    return Subtree(number, number, part, np.array(joints), *rows, parent, parent > 0, carried)


def _rows(numbers: list[int]) -> Rows:
    """Numbers as a slice where they follow each other."""
    first = numbers[0]
    if numbers == [*range(first, first + len(numbers))]:
        return slice(first, first + len(numbers))
    return np.array(numbers, dtype=np.intp)
