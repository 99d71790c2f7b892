"""Race scene R1 in Exudyn: planar ANCF cables between rigid cranks and the platform."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import exudyn as exu
import exudyn.itemInterface as item
import numpy as np
from peer import Settings, cycloid, drive, march, samples

CRANK, LINK, RADIUS = 0.21, 0.21, 0.068  # [m]
E, RHO, WIDTH, THICK = 7.1e10, 2810.0, 0.025, 0.002  # [Pa], [kg/m^3], [m], [m]
ROD = RHO * 0.025 * 0.010 * CRANK  # [kg] of a crank
INERTIA = ROD * CRANK**2 / 12 + 8.3e-3  # [kg m^2] of a crank about its centre, with the rotor
BASES = np.array([[0, 0], [0.5, 0], [0.25, np.sqrt(3) / 4]])
CORNERS = RADIUS * np.array([[np.cos(a), np.sin(a)] for a in np.deg2rad([210, 330, 90])])
HOME = np.array([0.25, 0.25 / np.sqrt(3)])
TRAVEL, DURATION, END = (0.25, -0.15, 0.10), 0.10, 0.20  # [rad], [s], [s]


def law(t: Any, travel: Any) -> Any:
    """Angle of a motor from home, rad."""
    return travel * cycloid(t, DURATION, exu.symbolic.sin, exu.symbolic.min)


def run(settings: Settings) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Motor torques."""
    mbs = exu.SystemContainer().AddSystem()
    world = mbs.AddObject(item.ObjectGround())
    ground = mbs.AddNode(item.NodePointGround())
    fixed = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    centre = mbs.AddNode(item.NodeRigidBody2D(referenceCoordinates=[*HOME, 0]))
    platform = mbs.AddObject(item.ObjectRigidBody2D(mass=0.40, inertia=9.5e-4, nodeNumber=centre))
    torques = []
    for base, corner, travel in zip(BASES, CORNERS, TRAVEL, strict=True):
        reach = HOME + corner - base
        far = np.hypot(*reach)
        bend = np.arccos((CRANK**2 + far**2 - LINK**2) / (2 * CRANK * far))
        azimuth = np.arctan2(reach[1], reach[0]) + bend
        elbow = base + CRANK * np.array([np.cos(azimuth), np.sin(azimuth)])
        middle = [*(0.5 * (base + elbow)), azimuth]
        node = mbs.AddNode(item.NodeRigidBody2D(referenceCoordinates=middle))
        crank = mbs.AddObject(item.ObjectRigidBody2D(mass=ROD, inertia=INERTIA, nodeNumber=node))

        def point(body: int, x: float, y: float) -> int:
            place = item.MarkerBodyPosition(bodyNumber=body, localPosition=[x, y, 0])
            return int(mbs.AddMarker(place))

        axle = [point(world, *base), point(crank, -CRANK / 2, 0)]
        mbs.AddObject(item.RevoluteJoint2D(markerNumbers=axle))
        turn = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=node, coordinate=2))
        motor = mbs.AddObject(item.CoordinateConstraint(markerNumbers=[fixed, turn], offset=travel))
        drive(mbs, motor, law)
        first, last = _cable(mbs, elbow, HOME + corner, settings.elements)
        knee = [point(crank, CRANK / 2, 0), first]
        mbs.AddObject(item.RevoluteJoint2D(markerNumbers=knee))
        pin = [last, point(platform, *corner)]
        mbs.AddObject(item.RevoluteJoint2D(markerNumbers=pin))
        torques.append(mbs.AddSensor(item.SensorObject(
            objectNumber=motor, storeInternal=True,
            outputVariableType=exu.OutputVariableType.Force,
        )))  # fmt: skip
    cost = march(mbs, END, settings)
    return {"torque": -np.hstack([samples(mbs, s, END) for s in torques])}, cost


def _cable(mbs: Any, start: np.ndarray, end: np.ndarray, elements: int) -> tuple[int, int]:
    """A straight cable; the markers of its ends."""
    slope, h = (end - start) / LINK, LINK / elements
    nodes = [
        mbs.AddNode(item.NodePoint2DSlope1(referenceCoordinates=[*(start + k * h * slope), *slope]))
        for k in range(elements + 1)
    ]
    for pair in pairwise(nodes):
        mbs.AddObject(item.ObjectANCFCable2D(
            nodeNumbers=list(pair), physicsLength=h, physicsMassPerLength=RHO * WIDTH * THICK,
            physicsBendingStiffness=E * WIDTH * THICK**3 / 12,
            physicsAxialStiffness=E * WIDTH * THICK, useReducedOrderIntegration=1,
        ))  # fmt: skip
    ends = [mbs.AddMarker(item.MarkerNodePosition(nodeNumber=n)) for n in (nodes[0], nodes[-1])]
    return ends[0], ends[1]
