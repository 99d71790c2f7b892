"""What a robot without Python tells and is told: names, units and the tables behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.quantities import joint_unit
from pinflex.text import brief

STATIONS = 9  # of a beam, where its stress is looked at: as in source/robot.h


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
        signals: Torque, position and speed of motors, pose of frames, deflection of tips, stress of
            beams.
        frame_node, frame_place: Nodes of frames, and [R | p] in them, shapes (k,), (k, 12).
        tip_at, tip_n, tip_curved: Of tips: first coordinate in y, number, whether with G.
        tip_rows: Phi (3, n) and G (3, n, n) of each, in a row.
        beam_at, beam_n, beam_fibres: Of beams: first coordinate, number, points of the rim.
        beam_rows: E u', -E v'', -E w'' at stations (3, n), one after the other.
        beam_rim: y, z of the points of the rim, one after the other.
        carried: What is carried, as a parameter, or None.
    """

    __repr__ = brief

    signals: tuple[Signal, ...]
    frame_node: IntArray
    frame_place: Array
    tip_at: IntArray
    tip_n: IntArray
    tip_curved: IntArray
    tip_rows: Array
    beam_at: IntArray
    beam_n: IntArray
    beam_fibres: IntArray
    beam_rows: Array
    beam_rim: Array
    carried: Carried | None


@dataclass(frozen=True)
class Carried:
    """A mass that a frame carries.

    Attributes:
        frame: Its name. mass: At first, kg. node: Of the tree of the kernel.
        place: Its centre in the axes of the node, m. inertia: About it, of a kg, (3, 3), m^2.
    """

    frame: str
    mass: float
    node: int
    place: Array
    inertia: Array


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
    beams = _beams(mechanism)
    signals += [
        Signal(f"stress {link}", "Pa", f"largest normal stress of {link}, by its strains")
        for link in dict.fromkeys(beams[0])
    ]
    return Outputs(
        tuple(signals), np.array(nodes, dtype=np.intp),
        np.array(places).reshape(-1, 12), np.array(at, dtype=np.intp),
        np.array(n, dtype=np.intp), np.array(curved, dtype=np.intp), np.concatenate(rows),
        *beams[1:], _carried(mechanism),
    )  # fmt: skip


def _beams(mechanism: Mechanism) -> tuple[list[str], IntArray, IntArray, IntArray, Array, Array]:
    """Links of one beam each, and the tables of their stress."""
    names, at, n, fibres, rows, rims = [], [], [], [], [np.zeros(0)], [np.zeros(0)]
    for slot in mechanism.loose.expansion.slots:
        part = mechanism.parts[slot.link]
        if len(part.bodies) > 1 or slot.body.solid is not None:
            continue  # as the ends above
        x = np.linspace(0.0, slot.body.length, STATIONS)
        fields, none = slot.body.fields(x), np.zeros((STATIONS, slot.body.n))
        E, section = part.spec.material.E, part.spec.section
        each = (("axial", E), ("curvature_v", -E), ("curvature_w", -E))
        stacked = np.stack([factor * fields.get(key, none) for key, factor in each], axis=1)
        names.append(slot.link)
        at.append(int(mechanism.loose.rigid.nq) + slot.eta.start)
        n.append(slot.body.n)
        fibres.append(len(section.fibres))
        rows.append(stacked.ravel())
        rims.append(np.array(section.fibres, dtype=np.float64).ravel())
    lists = (np.array(x, dtype=np.intp) for x in (at, n, fibres))
    return names, *lists, np.concatenate(rows), np.concatenate(rims)  # type: ignore[return-value]


def _carried(mechanism: Mechanism) -> Carried | None:
    """What the YAML says is carried, or nothing yet, at the platform."""
    system, payload = mechanism.loose, mechanism.description.payload
    frame = mechanism.description.platform if payload is None else payload.frame
    place = None if frame is None else system.expansion.frames.get(frame)
    if frame is None or place is None:
        return None
    node = int(system.node_of_joints[place.joint])
    if node < 0:
        return None
    R, p = place.placement.rotation, place.placement.translation
    if payload is None or payload.mass <= 0.0:
        return Carried(frame, 0.0, node, p, np.zeros((3, 3)))
    inertia = R @ payload.tensor @ R.T / payload.mass
    return Carried(frame, payload.mass, node, p + R @ np.array(payload.centre), inertia)


def _unit(mechanism: Mechanism, kind: str, motor: str) -> str:
    """Unit of a quantity of a motor: m and N where it slides."""
    slides = mechanism.joints[motor].kind == "prismatic"
    keys = {"position": "joint/q", "velocity": "joint/v", "acceleration": "joint/a"}
    return joint_unit(keys.get(kind, kind), slides)
