"""The shipped delta as a space frame: poses, loads and freedoms worked out by hand."""

from __future__ import annotations

import numpy as np

from tests.frame import Array, Bar, Frame, Place, axes

# models/delta/SOURCE.md
BASE, PLATE, ARM, ROD, HALF = 0.200, 0.045, 0.350, 0.800, 0.050  # [m]
ARM_BAR = Bar.tube(0.036, 0.0025, 6.89e10, 6.89e10 / 2.66, 2700.0)
ROD_BAR = Bar.tube(0.014, 0.0015, 1.1e11, 1.1e11 / 2.6, 1600.0)
ELBOW, PLATE_MASS, CENTRE = 0.120, 1.300, np.array([0.0, 0.0, -0.04])  # [kg], [kg], [m]
G = np.array([0.0, 0.0, -9.81])  # [m/s^2]
START = np.array([-0.1525, 0.0, -0.8])  # [m] where the motion begins
WAY, MOVE = 0.305, 0.3  # [m], [s]


def azimuth(leg: int) -> Array:
    c, s = np.cos(2 * np.pi / 3 * leg), np.sin(2 * np.pi / 3 * leg)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def elbows(plate: Array) -> Array:
    """Ends of the arms for a place of the plate (…, 3), shape (3, …, 3)."""
    found = []
    for leg in range(3):
        R = azimuth(leg)
        q = plate @ R + np.array([PLATE - BASE, 0, 0])  # from the motor to the rods' middle foot
        far = np.sqrt(q[..., 0] ** 2 + q[..., 2] ** 2)
        size = (q**2).sum(axis=-1)
        opening = np.arccos((size + ARM**2 - ROD**2) / (2 * ARM * far))
        down = np.arctan2(-q[..., 2], q[..., 0]) - opening
        arm = np.stack([np.cos(down), 0 * down, -np.sin(down)], axis=-1)
        found.append((np.array([BASE, 0, 0]) + ARM * arm) @ R.T)
    return np.array(found)


def plate_at(t: Array) -> Array:
    """Place of the plate along the quintic move, then at rest, shape (…, 3)."""
    u = np.clip(np.asarray(t) / MOVE, 0.0, 1.0)
    return START + np.multiply.outer(WAY * (10 * u**3 - 15 * u**4 + 6 * u**5), [1.0, 0, 0])


def acceleration_of(x: Array, h: float) -> Array:
    """Fourth-order differences of five places h [s] apart along the last but one axis."""
    weights = np.array([-1, 16, -30, 16, -1]) / (12 * h * h)
    return np.einsum("k,...kj->...j", weights, x)


class DeltaFrame:
    """The frame at one place of the plate, motors locked.

    Members are straight and rigid in the nominal motion, so that their acceleration is linear
    between their ends: 0 at a motor, the elbow's at an arm's tip and all along an elbow, the
    plate's at every foot, for the plate does not turn.
    """

    def __init__(self, plate: Array) -> None:
        frame = self.frame = Frame()
        self.body, self.plate = frame.node(), plate
        self.tips: list[int] = []
        self.members: list[list[tuple[Place, Place, Array]]] = []
        spins = []
        for leg, elbow in enumerate(elbows(plate)):
            R, tip = azimuth(leg), frame.node()
            self.tips.append(tip)
            motor = Place(-1, R @ [BASE, 0, 0])
            self.members.append(frame.beam(motor, Place(tip, elbow), 3, ARM_BAR))
            across = ELBOW * (2 * HALF) ** 2 / 12
            frame.bodies.append(
                (Place(tip, elbow), ELBOW, R @ np.diag([across, 6e-6, across]) @ R.T)
            )
            for side in (1, -1):
                lever, foot = R @ [0, side * HALF, 0], R @ [PLATE, side * HALF, 0]
                top = Place(tip, elbow + lever, lever, frame.node(3))
                low = Place(self.body, plate + foot, foot, frame.node(3))
                self.members.append(frame.beam(top, low, 6, ROD_BAR))
                spins.append((top, low.x - top.x))
        inertia = np.diag([2e-3, 2e-3, 1.5e-3])
        frame.bodies.append((Place(self.body, plate + CENTRE, CENTRE), PLATE_MASS, inertia))
        self.K, self.M = frame.matrices()
        for top, along in spins:  # between its balls a rod spins freely: held by a spring
            row = axes(along)[0] @ frame.rows(top)[3:]
            self.K += 1e3 * np.outer(row, row)

    def compliance(self) -> Array:
        """Of the plate (6, 6): displacement [m] and rotation [rad] by force [N], moment [N m]."""
        at = slice(self.body, self.body + 6)
        return np.linalg.inv(self.K)[at, at]

    def frequencies(self, count: int) -> Array:
        """Lowest natural frequencies [Hz]."""
        root = np.linalg.inv(np.linalg.cholesky(self.K))
        values = np.linalg.eigvalsh(root @ self.M @ root.T)[::-1][:count]
        return 1.0 / np.sqrt(values) / (2 * np.pi)

    def deviation(self, plate: Array, tips: Array) -> Array:
        """Displacement and rotation of the plate (6,) by weight and rigid inertia forces.

        Args:
            plate: Acceleration of the plate (3,) [m/s^2].
            tips: Accelerations of the elbows (3, 3) [m/s^2].
        """
        pull = {-1: G, self.body: G - plate}
        pull |= {tip: G - a for tip, a in zip(self.tips, tips, strict=True)}
        load = np.zeros(self.frame.n)
        for pieces in self.members:
            first, last = pieces[0][0], pieces[-1][1]
            low, change, way = pull[first.at], pull[last.at] - pull[first.at], last.x - first.x
            turn = np.cross(way, change) / (way @ way)
            for a, b, m in pieces:
                ends = [low + change * ((p.x - first.x) @ way / (way @ way)) for p in (a, b)]
                load += self.frame.rows(a, b).T @ m @ np.concatenate([ends[0], turn, ends[1], turn])
        for place, mass, _ in self.frame.bodies:
            load += self.frame.rows(place)[:3].T @ (mass * pull[place.at])
        return np.linalg.solve(self.K, load)[self.body : self.body + 6]


def quasistatic(t: float) -> Array:
    """Deviation of the plate (6,) [m, rad] at the instant t [s] of the move."""
    h = 1e-3  # [s]; the error of the differences is 1e-6 of the acceleration
    places = plate_at(t + h * np.arange(-2, 3))
    tips = acceleration_of(elbows(places), h)
    return DeltaFrame(places[2]).deviation(acceleration_of(places, h), tips)
