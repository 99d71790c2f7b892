"""Race scene R2 in Exudyn: every link a chain of modal floating-frame bodies.

A body is clamped at its root, with two polynomial bending modes in each plane, one of twist and, if
wanted, one of stretch. Its inertia is that of four mass points at each Gauss station.
"""

from __future__ import annotations

from typing import Any

import exudyn as exu
import exudyn.itemInterface as item
import numpy as np
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
from numpy.polynomial import Polynomial
from peer import Settings, cycloid, drive, march, samples
from scipy.linalg import eigh
from scipy.sparse import csr_matrix, diags

BASE, PLATE, LINK, HEIGHT = 0.12, 0.10, 0.15, 0.20  # [m]
E, G, RHO, WIDTH, THICK = 2.11e11, 8.0e10, 7800.0, 5e-3, 3e-3  # [Pa], [Pa], [kg/m^3], [m], [m]
MASS, INERTIA = 0.152, (2.74e-4, 2.74e-4, 5.4e-4, 0, 0, 0)  # [kg], [kg m^2]
TRAVEL, DURATION, END = (0.05, -0.025, 0.0125), 0.2, 0.4  # [rad], [s], [s]
DOWN, DAMPING = [0.0, 0.0, -9.81], 3e-4  # [m/s^2], [s] on the stiffness
AREA = WIDTH * THICK
SOFT, HARD = WIDTH * THICK**3 / 12, THICK * WIDTH**3 / 12  # [m^4] bending along z, along y
_ratio = THICK / WIDTH
TORSION = WIDTH * THICK**3 * (1 / 3 - 0.21 * _ratio * (1 - _ratio**4 / 12))  # [m^4]


def law(t: Any, travel: Any) -> Any:
    """Angle of a motor from home, rad."""
    return travel * cycloid(t, DURATION, exu.symbolic.sin, exu.symbolic.min)


def body(length: float, stretch: bool) -> tuple[Any, list[int]]:
    """A modal body along x, and the mesh nodes of its tip."""
    gauss, weights = np.polynomial.legendre.leggauss(6)
    x = np.append(0.5 * length * (gauss + 1), length)
    mass = np.append(0.5 * length * weights * RHO * AREA, 0.0)
    corners = np.array([[a, b] for a in (-1, 1) for b in (-1, 1)]) / np.sqrt(12)
    Y, Z = (corners * (WIDTH, THICK)).T
    shapes, stiff = [], []
    kinds = [
        ("w", E * SOFT, RHO * AREA), ("v", E * HARD, RHO * AREA),
        ("u", E * AREA, RHO * AREA), ("twist", G * TORSION, RHO * (SOFT + HARD)),
    ]  # fmt: skip
    for kind, rigidity, inertia in kinds:
        if kind == "u" and not stretch:
            continue
        order = 2 if kind in "wv" else 1
        powers = (2, 3) if order == 2 else (1,)
        phi = [Polynomial(np.eye(4)[p], domain=[0, length], window=[0, 1]) for p in powers]
        for mode, k in _normal(phi, order, rigidity, inertia, length):
            shapes.append(_moved(mode, kind, x, Y, Z))
            stiff.append(k)
    fem = FEMinterface()
    fem.nodes = {"Position": np.array([[a, y, z] for a in x for y, z in zip(Y, Z, strict=True)])}
    lumps = np.repeat(mass / len(Y), 3 * len(Y))
    fem.massMatrix, fem.stiffnessMatrix = diags(lumps).tocsr(), csr_matrix((len(lumps),) * 2)
    fem.modeBasis = {"matrix": np.column_stack(shapes), "type": "NormalModes"}
    fem.surface = []
    modal = ObjectFFRFreducedOrderInterface(fem)
    modal.stiffnessMatrixReduced = np.diag(stiff)
    return modal, list(range(len(Y) * (len(x) - 1), len(Y) * len(x)))


def _normal(
    phi: list[Polynomial], order: int, rigidity: float, inertia: float, length: float
) -> list[tuple[Polynomial, float]]:
    """Combinations of shapes with modal mass rho A l, and their stiffness."""

    def gram(f: list[Polynomial]) -> np.ndarray:
        return np.array([[(a * b).integ()(length) - (a * b).integ()(0) for a in f] for b in f])

    K, M = rigidity * gram([p.deriv(order) for p in phi]), inertia * gram(phi)
    values, vectors = eigh(K, M)
    scale = np.sqrt(RHO * AREA * length)
    modes = [sum(c * p for c, p in zip(column, phi, strict=True)) * scale for column in vectors.T]
    return list(zip(modes, values * scale**2, strict=True))


def _moved(mode: Polynomial, kind: str, x: np.ndarray, Y: np.ndarray, Z: np.ndarray) -> np.ndarray:
    """Displacements of all mass points in a mode; bending turns the sections."""
    size, slope = mode(x)[:, None], mode.deriv()(x)[:, None]
    none = 0.0 * (size + Y)
    moves = {
        "u": (size + 0 * Y, none, none),
        "v": (-slope * Y, size + 0 * Y, none),
        "w": (-slope * Z, none, size + 0 * Y),
        "twist": (none, -size * Z, size * Y),
    }[kind]
    return np.stack(moves, axis=-1).ravel()


def run(settings: Settings) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Pose of the platform and motor torques."""
    mbs, kinds = exu.SystemContainer().AddSystem(), exu.OutputVariableType
    ground = mbs.AddNode(item.NodePointGround())
    fixed = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    home = [0, 0, HEIGHT, 1, 0, 0, 0]
    centre = mbs.AddNode(item.NodeRigidBodyEP(referenceCoordinates=home))
    plate = mbs.AddObject(item.ObjectRigidBody(mass=MASS, inertia=INERTIA, nodeNumber=centre))
    whole = mbs.AddMarker(item.MarkerBodyMass(bodyNumber=plate))
    mbs.AddLoad(item.LoadMassProportional(markerNumber=whole, loadVector=DOWN))
    link = _Links(mbs, settings.elements, settings.stretch)
    torques = []
    for azimuth, travel in zip(np.deg2rad([90, 210, 330]), TRAVEL, strict=True):
        out = np.array([np.cos(azimuth), np.sin(azimuth), 0])
        axis = np.array([-out[1], out[0], 0])
        frames, foot, knee = _leg(out, axis)
        motor, turning = _motor(mbs, fixed, frames[0], foot, travel)
        end = link.chain(turning, frames[0], foot, [1] * 6)
        end = link.chain(end, frames[1], knee, [1, 1, 1, 1, 0, 1], ball=True)
        seat = item.MarkerBodyRigid(bodyNumber=plate, localPosition=list(PLATE * out))
        ball = [end, mbs.AddMarker(seat)]
        mbs.AddObject(item.SphericalJoint(markerNumbers=ball, constrainedAxes=[1, 1, 1]))
        torques.append(mbs.AddSensor(item.SensorObject(
            objectNumber=motor, storeInternal=True, outputVariableType=kinds.Force
        )))  # fmt: skip
    pose = [
        mbs.AddSensor(item.SensorBody(
            bodyNumber=plate, localPosition=[0, 0, 0], storeInternal=True, outputVariableType=kind
        ))
        for kind in (kinds.Position, kinds.RotationMatrix)
    ]  # fmt: skip
    cost = march(mbs, END, settings)
    position, rotation = (samples(mbs, s, END) for s in pose)
    torque = -np.hstack([samples(mbs, s, END) for s in torques])
    return {"position": position, "rotation": rotation.reshape(-1, 3, 3), "torque": torque}, cost


def _leg(out: np.ndarray, axis: np.ndarray) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Link frames (x along the link, y the joint axis), foot and knee, at home."""
    up = np.array([0, 0, 1.0])
    foot, ball = BASE * out, PLATE * out + HEIGHT * up
    half = 0.5 * (ball - foot)
    outward = np.cross(axis, half / np.linalg.norm(half))
    knee = foot + half + np.sqrt(LINK**2 - half @ half) * outward
    along = [(knee - foot) / LINK, (ball - knee) / LINK]
    return [np.column_stack([x, axis, np.cross(x, axis)]) for x in along], foot, knee


def _motor(
    mbs: Any, fixed: int, frame: np.ndarray, foot: np.ndarray, travel: float
) -> tuple[int, int]:
    """The driven joint, a body of next to no mass: its constraint, and the marker it turns."""
    node = mbs.AddNode(item.NodeGenericODE2(
        referenceCoordinates=[0.0], initialCoordinates=[0.0], initialCoordinates_t=[0.0],
        numberOfODE2Coordinates=1,
    ))  # fmt: skip
    tree = mbs.AddObject(item.ObjectKinematicTree(
        nodeNumber=node, jointTypes=[exu.JointType.RevoluteY], linkParents=[-1],
        jointTransformations=exu.Matrix3DList([frame]), jointOffsets=exu.Vector3DList([list(foot)]),
        linkInertiasCOM=exu.Matrix3DList([1e-9 * np.eye(3)]),
        linkCOMs=exu.Vector3DList([[0, 0, 0]]), linkMasses=[1e-6],
        baseOffset=[0, 0, 0], gravity=[0, 0, 0],
    ))  # fmt: skip
    angle = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
    motor = mbs.AddObject(item.CoordinateConstraint(markerNumbers=[fixed, angle], offset=travel))
    drive(mbs, motor, law)
    place = item.MarkerKinematicTreeRigid(objectNumber=tree, linkNumber=0, localPosition=[0, 0, 0])
    return motor, mbs.AddMarker(place)


class _Links:
    """Adds links of `count` equal bodies."""

    def __init__(self, mbs: Any, count: int, stretch: bool) -> None:
        self.mbs, self.count, self.length = mbs, count, LINK / count
        self.modal, self.tip = body(self.length, stretch)

    def chain(
        self, before: int, frame: np.ndarray, start: np.ndarray, held: list[int], ball: bool = False
    ) -> int:
        """A link whose root is held to the marker `before`; the marker of its end."""
        mbs = self.mbs
        for k in range(self.count):
            at = start + k * self.length * frame[:, 0]
            added = self.modal.AddObjectFFRFreducedOrder(
                mbs, positionRef=list(at), rotationMatrixRef=frame, gravity=DOWN,
                stiffnessProportionalDamping=DAMPING,
            )  # fmt: skip
            root = mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=added["nRigidBody"]))
            axes = held if k == 0 else [1] * 6
            mbs.AddObject(item.GenericJoint(markerNumbers=[before, root], constrainedAxes=axes))
            point = ball and k == self.count - 1
            kind = item.MarkerSuperElementPosition if point else item.MarkerSuperElementRigid
            before = mbs.AddMarker(kind(
                bodyNumber=added["oFFRFreducedOrder"], meshNodeNumbers=self.tip,
                weightingFactors=[0.25] * 4,
            ))  # fmt: skip
        return before
