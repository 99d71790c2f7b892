"""Race scene R3 in Exudyn: a planar ANCF cable between a crank at constant speed and a slider."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import exudyn as exu
import exudyn.itemInterface as item
import numpy as np
from peer import Settings, drive, march, samples

CRANK, ROD, SIDE = 0.15, 0.30, 0.008  # [m]
E, RHO = 2e11, 7870.0  # [Pa], [kg/m^3]
SLIDER, OMEGA, END = 0.075552, 150.0, 0.1  # [kg], [rad/s], [s]
AREA, SECOND = SIDE**2, SIDE**4 / 12
STRETCH = (1.02745486e-5, 1.68593869e-5)  # [m] of the middle and the tip, in balance at the start


def law(t: Any, unused: Any) -> Any:
    """Angle of the motor, rad."""
    return OMEGA * t


def stretch(x: float) -> tuple[float, float]:
    """Axial displacement (m) and strain of the rod at the start: a parabola."""
    b, a = np.linalg.solve([[ROD / 2, ROD**2 / 4], [ROD, ROD**2]], STRETCH)
    return float(b * x + a * x**2), float(b + 2 * a * x)


def run(settings: Settings) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Distance of the rod's middle from its chord."""
    mbs = exu.SystemContainer().AddSystem()
    world = mbs.AddObject(item.ObjectGround())
    ground = mbs.AddNode(item.NodePointGround())
    fixed = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    crank = mbs.AddNode(item.NodeRigidBody2D(
        referenceCoordinates=[0, 0, 0], initialVelocities=[0, 0, OMEGA]
    ))  # fmt: skip
    wheel = mbs.AddObject(item.ObjectRigidBody2D(mass=0.36, inertia=0.002727, nodeNumber=crank))

    def place(body: int, x: float) -> int:
        return int(mbs.AddMarker(item.MarkerBodyPosition(bodyNumber=body, localPosition=[x, 0, 0])))

    mbs.AddObject(item.RevoluteJoint2D(markerNumbers=[place(world, 0), place(wheel, 0)]))
    turn = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=crank, coordinate=2))
    motor = mbs.AddObject(item.CoordinateConstraint(markerNumbers=[fixed, turn]))
    drive(mbs, motor, law)
    nodes = _rod(mbs, settings.elements)
    ends = [mbs.AddMarker(item.MarkerNodePosition(nodeNumber=n)) for n in (nodes[0], nodes[-1])]
    mbs.AddObject(item.RevoluteJoint2D(markerNumbers=[place(wheel, CRANK), ends[0]]))
    mbs.AddObject(item.ObjectMassPoint2D(physicsMass=SLIDER, nodeNumber=nodes[-1]))
    guide = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=nodes[-1], coordinate=1))
    mbs.AddObject(item.CoordinateConstraint(markerNumbers=[fixed, guide]))
    sensors = [
        mbs.AddSensor(item.SensorNode(
            nodeNumber=nodes[k], storeInternal=True,
            outputVariableType=exu.OutputVariableType.Position,
        ))
        for k in (0, settings.elements // 2, settings.elements)
    ]  # fmt: skip
    cost = march(mbs, END, settings)
    pin, middle, tip = (samples(mbs, sensor, END)[:, :2] for sensor in sensors)
    chord = tip - pin
    chord /= np.linalg.norm(chord, axis=1)[:, None]
    away = middle - pin
    return {"middle": chord[:, :1] * away[:, 1:] - chord[:, 1:] * away[:, :1]}, cost


def _rod(mbs: Any, elements: int) -> list[int]:
    """The rod's nodes, turning about the slider as a rigid rod would."""
    h, nodes = ROD / elements, []
    for x in h * np.arange(elements + 1):
        u, strain = stretch(x)
        sideways = OMEGA * CRANK * (1.0 - (x + u) / (ROD + STRETCH[1]))
        spin = -OMEGA * CRANK / (ROD + STRETCH[1]) * (1.0 + strain)
        nodes.append(mbs.AddNode(item.NodePoint2DSlope1(
            referenceCoordinates=[CRANK + x, 0, 1, 0], initialCoordinates=[u, 0, strain, 0],
            initialVelocities=[0, sideways, 0, spin],
        )))  # fmt: skip
    for pair in pairwise(nodes):
        mbs.AddObject(item.ObjectANCFCable2D(
            nodeNumbers=list(pair), physicsLength=h, physicsMassPerLength=RHO * AREA,
            physicsBendingStiffness=E * SECOND, physicsAxialStiffness=E * AREA,
            useReducedOrderIntegration=1,
        ))  # fmt: skip
    return nodes
