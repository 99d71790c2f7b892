"""Race scene R4 in Exudyn: a planar ANCF cable on a driven hub."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import exudyn as exu
import exudyn.itemInterface as item
import numpy as np
from peer import Settings, drive, march, samples

LENGTH, RHO_A, EI, EA = 10.0, 1.2, 1.4e4, 2.8e7  # [m], [kg/m], [N m^2], [N]
SPEED, RAMP, END = 6.0, 15.0, 20.0  # [rad/s], [s], [s]


def angle(t: Any, unused: Any) -> Any:
    """Angle of the hub, rad."""
    w, s = 2 * np.pi / RAMP, exu.symbolic
    before = s.min(t, RAMP)
    ramp = before * before * 0.5 + (s.cos(w * before) - 1.0) * (1.0 / w**2)
    return SPEED / RAMP * ramp + SPEED * (t - before)


def run(settings: Settings) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """World position of the tip and torque of the hub."""
    mbs = exu.SystemContainer().AddSystem()
    ground = mbs.AddNode(item.NodePointGround())
    fixed = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    # The hub: a body of next to no mass, which turns the root of the cable.
    hub = mbs.AddNode(item.NodeRigidBody2D(referenceCoordinates=[0, 0, 0]))
    mbs.AddObject(item.ObjectRigidBody2D(mass=1e-6, inertia=1e-6, nodeNumber=hub))
    h = LENGTH / settings.elements
    nodes = [
        mbs.AddNode(item.NodePoint2DSlope1(referenceCoordinates=[k * h, 0, 1, 0]))
        for k in range(settings.elements + 1)
    ]
    for pair in pairwise(nodes):
        cable = item.ObjectANCFCable2D(
            nodeNumbers=list(pair), physicsLength=h, physicsMassPerLength=RHO_A,
            physicsBendingStiffness=EI, physicsAxialStiffness=EA, useReducedOrderIntegration=1,
        )  # fmt: skip
        mbs.AddObject(cable)
    for node in (hub, nodes[0]):
        for axis in (0, 1):
            held = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=node, coordinate=axis))
            mbs.AddObject(item.CoordinateConstraint(markerNumbers=[fixed, held]))
    sides = [mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=n)) for n in (hub, nodes[0])]
    mbs.AddObject(item.GenericJoint(markerNumbers=sides, constrainedAxes=[0, 0, 0, 0, 0, 1]))
    turn = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=hub, coordinate=2))
    motor = mbs.AddObject(item.CoordinateConstraint(markerNumbers=[fixed, turn]))
    drive(mbs, motor, angle)
    kinds = exu.OutputVariableType
    tip = mbs.AddSensor(item.SensorNode(
        nodeNumber=nodes[-1], storeInternal=True, outputVariableType=kinds.Position
    ))  # fmt: skip
    torque = mbs.AddSensor(item.SensorObject(
        objectNumber=motor, storeInternal=True, outputVariableType=kinds.Force
    ))  # fmt: skip
    cost = march(mbs, END, settings)
    found = {"position": samples(mbs, tip, END), "torque": -samples(mbs, torque, END)}
    return found, cost
