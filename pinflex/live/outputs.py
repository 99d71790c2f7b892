"""What a robot without Python tells and is told: names, units and the tables behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.quantities import joint_unit
from pinflex.text import brief


@dataclass(frozen=True)
class Signal:
    """A number that goes in or out.

    Attributes:
        name: As in the table of a result. unit: SI. meaning: In words.
    """

    name: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class Outputs:
    """Tables of `Model` in source/robot.h, and the names of what they tell, in its order.

    Attributes:
        signals: Torque, position and speed of motors, pose of frames, deflection of tips.
        frame_node, frame_place: Nodes of frames, and [R | p] in them, shapes (k,), (k, 12).
        tip_at, tip_n, tip_curved: Of tips: first coordinate in y, number, whether with G.
        tip_rows: Phi (3, n) and G (3, n, n) of each, in a row.
    """

    __repr__ = brief

    signals: tuple[Signal, ...]
    frame_node: IntArray
    frame_place: Array
    tip_at: IntArray
    tip_n: IntArray
    tip_curved: IntArray
    tip_rows: Array


def commands(mechanism: Mechanism, pushed: bool) -> tuple[Signal, ...]:
    """What a step is given: torques of the motors, or their motion."""
    kinds = ("torque",) if pushed else ("position", "velocity", "acceleration")
    at = "at the end of a step"
    return tuple(
        Signal(f"command {kind} {motor}", _unit(mechanism, kind, motor), f"{kind} of {motor} {at}")
        for kind in kinds
        for motor in mechanism.motors
    )


def outputs_of(mechanism: Mechanism) -> Outputs:
    """What is told of a mechanism."""
    system, platform = mechanism.loose, mechanism.description.platform
    signals = [
        Signal(f"{kind} {motor}", _unit(mechanism, kind, motor), f"{kind} of {motor}")
        for kind in ("torque", "position", "velocity")
        for motor in mechanism.motors
    ]
    places, nodes = [], []
    for name in mechanism.description.reported:
        head = "platform" if name == platform else f"frame {name}"
        for k, axis in enumerate(("x", "y", "z", "rx", "ry", "rz")):
            what = "origin" if k < 3 else "rotation vector"
            signals.append(
                Signal(f"{head} {axis}", "m" if k < 3 else "rad", f"{what} of {name}, {axis[-1]}")
            )
        here = system.expansion.frames[name]
        nodes.append(int(system.node_of_joints[here.joint]))
        place = here.placement
        places.append(np.column_stack([place.rotation, place.translation]).ravel())
    at, n, curved, rows = [], [], [], [np.zeros(0)]
    for slot in system.expansion.slots:
        if len(mechanism.parts[slot.link].bodies) > 1 or slot.body.solid is not None:
            continue  # the end of a beam in segments is off a root that is not its own
        Phi, G = slot.body.rows(slot.body.length)
        at.append(int(system.rigid.nq) + slot.eta.start)
        n.append(slot.body.n)
        curved.append(int(G is not None))
        rows += [Phi[:3].ravel()] + ([] if G is None else [G[:3].ravel()])
        signals += [
            Signal(f"deflection {slot.link} {d}", "m", f"of the end of {slot.link}, along its {a}")
            for d, a in zip("uvw", "xyz", strict=True)
        ]
    return Outputs(
        tuple(signals), np.array(nodes, dtype=np.intp),
        np.array(places).reshape(-1, 12), np.array(at, dtype=np.intp),
        np.array(n, dtype=np.intp), np.array(curved, dtype=np.intp), np.concatenate(rows),
    )  # fmt: skip


def _unit(mechanism: Mechanism, kind: str, motor: str) -> str:
    """Unit of a quantity of a motor: m and N where it slides."""
    slides = mechanism.joints[motor].kind == "prismatic"
    keys = {"position": "joint/q", "velocity": "joint/v", "acceleration": "joint/a"}
    return joint_unit(keys.get(kind, kind), slides)
