"""The exact command where elastic drives are all that gives way: no grid, no iteration.

With undamped gears the robot is flat: the path gives the motion of the links, the rigid inverse
dynamics the torque T on each gear, its stiffness the motor's angle, and that the motor's torque:

    q_m = q + T(q, q', q'') / K,     tau = T + I q_m'' + F(q_m')

T is smooth between the corners of a motion; its rates are those of its Chebyshev polynomial.
Source: Spong (1987), J. Dyn. Syst. Meas. Control 109; De Luca & Book, Handbook of Robotics, ch. 11.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from pinflex.actuation.drive import breaks
from pinflex.actuation.motors import MotorAxes, motor_axes
from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array, IntArray
from pinflex.description.motion import Motion
from pinflex.integrators.chebyshev import PiecewiseChebyshev
from pinflex.inversion.target import Target, delayed
from pinflex.levels.rigid import solve_rigid
from pinflex.mechanics.mechanism import Mechanism

_FIRST, _MOST = 16, 128  # degree of the polynomials
_SETTLED = 1e-13  # of the largest coefficient, for the last two: round-off
_ENOUGH = 1e-9  # the same where more would not help


@dataclass(frozen=True)
class Flat:
    """Deflections T / K of the motors' gears as polynomials, over the rigid motion.

    Attributes:
        mechanism, motion: The motion delayed. pieces: Of time. axes: Of the motors.
        rows: Velocity rows of the motors. error: Of motor positions [m | rad], shape (nm,).
        coefficients: Chebyshev, shape (pieces, degree + 1, nm).
    """

    mechanism: Mechanism
    motion: Motion
    pieces: PiecewiseChebyshev
    axes: MotorAxes
    rows: IntArray
    coefficients: Array
    error: Array

    def twist(self, t: Array, order: int) -> Array:
        """Rates of T / K at times, of order 0 to 2, shape (nt, nm)."""
        found, of, ends = (
            np.zeros((len(t), len(self.rows))),
            self.pieces.of(t),
            self.pieces.nodes(1),
        )
        for k, (a, b) in enumerate(ends):
            here = of == k
            c = chebyshev.chebder(self.coefficients[k], order) * (2.0 / (b - a)) ** order
            x = np.clip((2.0 * t[here] - a - b) / (b - a), -1.0, 1.0)
            found[here] = chebyshev.chebval(x, c).T.reshape(-1, len(self.rows))
        return found

    def position(self, t: Array, order: int = 0) -> Array:
        """Rates of the motor positions at times, of order 0 to 2, shape (nt, nm)."""
        path = nominal(self.mechanism, self.motion, t)
        rigid = (self.axes.read(path.q), path.v[:, self.rows], path.a[:, self.rows])[order]
        if order == 0 and len(self.axes.paired):
            rigid = np.unwrap(rigid, axis=0)
        return np.asarray(rigid + self.twist(t, order))

    def poses(self, t: Array) -> Array:
        """Poses [q; eta], shape (nt, nq)."""
        system = self.mechanism.flexible
        y = nominal(self.mechanism, self.motion, t).straight(system.n_eta)
        self.axes.write(y, self.position(t))
        twist, names = self.twist(t, 0), self.mechanism.motors
        for gear in system.expansion.drives:
            y[:, int(system.rigid.nq) + gear.eta] = -twist[:, names.index(gear.joint)]
        return y

    def torque(self, t: Array) -> Array:
        """Motor torques in the joints' coordinates [N m | N], shape (nt, nm)."""
        T = _on_gears(self.mechanism, self.motion, t)
        return T + _at_motors(self.mechanism, self.position(t, 1), self.position(t, 2))


def flat(mechanism: Mechanism, motion: Motion, wanted: Target) -> Flat | None:
    """The command, or None where something else gives way, rubs unsmoothly or is damped."""
    if not _is_flat(mechanism, wanted):
        return None
    later, rows = delayed(motion, wanted.before), mechanism.rigid.motors
    none = mechanism.rigid.loads
    corners = [wanted.before, *(wanted.before + t for t in breaks(motion, none))]
    pieces = PiecewiseChebyshev(0.0, float(wanted.t[-1]), corners)
    system, names = mechanism.flexible, mechanism.motors
    compliance = np.zeros(len(rows))
    for gear in system.expansion.drives:
        k = int(system.rigid.nv) + gear.eta
        compliance[names.index(gear.joint)] = 1.0 / system.K[k, k]
    n = _FIRST
    while True:
        nodes = pieces.nodes(n)
        T = _on_gears(mechanism, later, nodes.ravel()).reshape(*nodes.shape, -1)
        c = np.array([_coefficients(x) for x in T * compliance])
        last = np.max(np.abs(c[:, -2:]), axis=(0, 1))
        lost = float(np.max(last / np.maximum(np.max(np.abs(c), axis=(0, 1)), 1e-300)))
        if lost < _SETTLED or 2 * n > _MOST:
            break
        n *= 2
    if lost > _ENOUGH:
        return None
    return Flat(mechanism, later, pieces, motor_axes(mechanism), rows, c, last)


def _is_flat(mechanism: Mechanism, wanted: Target) -> bool:
    """Whether undamped gears are all that gives way, and the path all that moves."""
    system = mechanism.flexible
    gears = [int(system.rigid.nv) + gear.eta for gear in system.expansion.drives]
    only = bool(gears) and not system.expansion.slots and not mechanism.elastic_joints
    motors = len(mechanism.rigid.motors)
    determined = len(wanted.names) == motors == mechanism.report.mobility
    timed = any(force.timed for force, _ in system.loads.forces)
    return only and determined and not timed and not np.any(np.diag(system.D)[gears])


def _on_gears(mechanism: Mechanism, motion: Motion, t: Array) -> Array:
    """Torques that the gears give out when the links follow the rigid motion, (nt, nm)."""
    run, rows = solve_rigid(mechanism, motion, t), mechanism.rigid.motors
    return run.torque - _at_motors(mechanism, run.v[:, rows], run.a[:, rows])


def _at_motors(mechanism: Mechanism, v: Array, a: Array) -> Array:
    """Torques of rotors, dampers and friction at motor speeds and accelerations (nt, nm)."""
    system, rows = mechanism.rigid, mechanism.rigid.motors
    every = np.zeros((len(v), system.nv))
    every[:, rows] = v
    force = every * np.diag(system.D)
    force[:, system.friction.rows] += system.friction.force(every)
    return np.asarray(force[:, rows] + system.rigid.armature[rows] * a)


def _coefficients(values: Array) -> Array:
    """Chebyshev coefficients of values (n + 1, k) at the points of `PiecewiseChebyshev.nodes`."""
    n = len(values) - 1
    x = np.arange(n + 1)
    T = np.cos(np.pi * np.outer(x, x) / n) * np.where(x % n, 1.0, 0.5)
    c = (2.0 / n) * T @ values[::-1]  # the nodes run from -1 to 1
    c[[0, -1]] *= 0.5
    return np.asarray(c)
