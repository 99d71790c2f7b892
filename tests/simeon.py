"""Simeon's flexible slider-crank, integrated on its own: a floating frame, written from the text.

The rod's frame has its origin on the crank pin and its x axis along the chord, at the angle phi2.
A point x of the rod is at r = r_pin + R(phi2) (x + N(x) q, S(x) q): N the two quadratic shapes with
nodes in the middle and at the tip, S = sin(k pi x / L). With w = (phi2, x3, q1..q4), the crank
turning at Omega, inertia as a Gauss sum over points and a linear strain energy,

    M wdd + J' lam = f,     J wdd = -Jdot wd - (crank),     closed at the slider.

Nothing of pinflex is used.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]

CRANK, ROD, SIDE, E, RHO = 0.15, 0.30, 0.008, 2e11, 7870.0  # [m], [m], [m], [Pa], [kg/m^3]
M3, J2, OMEGA = 0.075552, 0.0045339259, 150.0  # [kg], [kg m^2], [rad/s]
TEST_SET = (15.0, 3.1415927)  # factor on the mass of the axial shapes; pi of the stiffness
CONSISTENT = (1.0, float(np.pi))
Convention = tuple[float, float]

_s, _w = np.polynomial.legendre.leggauss(20)
_xi = 0.5 * (_s + 1)
_N = np.column_stack([4 * _xi * (1 - _xi), _xi * (2 * _xi - 1)])
_S = np.column_stack([np.sin(np.pi * _xi), np.sin(2 * np.pi * _xi)])
X, MASS = ROD * _xi, 0.5 * _w * RHO * SIDE**2 * ROD
ALONG, ACROSS = np.hstack([0 * _N, _N]), np.hstack([_S, 0 * _S])


def stiffness(pi: float) -> Array:
    """K of q1..q4, N/m."""
    bend = E * SIDE**2 / ROD * pi**4 / 24 * (SIDE / ROD) ** 2
    K = np.diag([bend, 16 * bend, 0.0, 0.0])
    K[2:, 2:] = E * SIDE**2 / ROD / 3 * np.array([[16.0, -8.0], [-8.0, 7.0]])
    return K


def _inertia(
    place: tuple[Array, Array], rate: tuple[Array, Array], bends: Array, turn: float, mass: Array
) -> tuple[Array, Array]:
    """M and the forces of relative motion of points at `place` in the turning frame."""
    (u, s), (du, ds) = place, rate
    rows = np.zeros((len(u), 2, 6))
    rows[:, 0, 0], rows[:, 1, 0] = -s, u
    rows[:, 0, 2:], rows[:, 1, 2:] = ALONG, bends
    left = np.column_stack([-(turn**2) * u - 2 * turn * ds, -(turn**2) * s + 2 * turn * du])
    weighted = rows * mass[:, None, None]
    M = np.einsum("pci,pcj->ij", weighted, rows)
    return M, -np.einsum("pci,pc->i", weighted, left)


def accelerate(t: float, w: Array, v: Array, convention: Convention) -> tuple[Array, Array]:
    """wdd (6,) and lam (2,) of the closures along y and x."""
    factor, pi = convention
    phi1, phi2, q, turn, dq = OMEGA * t, w[0], w[2:], v[0], v[2:]
    place, rate = (X + ALONG @ q, ACROSS @ q), (ALONG @ dq, ACROSS @ dq)
    M, f = _inertia(place, rate, ACROSS, turn, MASS)
    # The crank pin's acceleration, in the rod's frame.
    pin = -CRANK * OMEGA**2 * np.array([np.cos(phi1 - phi2), np.sin(phi1 - phi2)])
    f[0] -= MASS @ (place[0] * pin[1] - place[1] * pin[0])
    f[2:] -= (MASS @ ALONG) * pin[0] + (MASS @ ACROSS) * pin[1]
    # More mass for the axial shapes alone: points that turn and stretch, but do not ride along.
    alone = (ALONG @ q, 0 * X), (ALONG @ dq, 0 * X)
    more, push = _inertia(*alone, 0 * ACROSS, turn, (factor - 1.0) * MASS)
    M, f = M + more, f + push
    M[0, 0] += J2 - RHO * SIDE**2 * ROD**3 / 3  # rotary inertia of the undeformed rod
    M[1, 1] += M3
    f[2:] -= stiffness(pi) @ q
    long, c, s = ROD + q[3], np.cos(phi2), np.sin(phi2)
    J = np.array([[long * c, 0, 0, 0, 0, s], [long * s, 1, 0, 0, 0, -c]])
    left = np.array([
        -CRANK * np.sin(phi1) * OMEGA**2 - long * s * turn**2 + 2 * turn * dq[3] * c,
        CRANK * np.cos(phi1) * OMEGA**2 + long * c * turn**2 + 2 * turn * dq[3] * s,
    ])  # fmt: skip
    S = np.block([[M, J.T], [J, np.zeros((2, 2))]])
    x = np.linalg.solve(S, np.concatenate([f, -left]))
    return x[:6], x[6:]


def run(
    until: float,
    start: tuple[tuple[float, ...], tuple[float, ...]],
    convention: Convention,
    tolerance: float = 1e-11,
) -> tuple[Array, Array, Array]:
    """w, wd (6,) and lam (2,) at a time, from q and qd at phi1 = phi2 = 0.

    The closures are kept on the level of accelerations: over 0.1 s at this tolerance they open by
    less than 1e-11 m.
    """
    w, v = np.zeros(6), np.zeros(6)
    w[2:], v[2:] = start
    w[1] = CRANK + ROD + w[5]
    v[0], v[1] = -CRANK * OMEGA / (ROD + w[5]), v[5]
    scale = np.concatenate([[1, 1], np.full(4, 1e-5), [100, 10], np.full(4, 1e-2)])

    def slope(t: float, z: Array) -> Array:
        return np.concatenate([z[6:], accelerate(t, z[:6], z[6:], convention)[0]])

    end = solve_ivp(slope, (0.0, until), np.concatenate([w, v]), "DOP853", rtol=tolerance,
                    atol=tolerance * scale).y[:, -1]  # fmt: skip
    return end[:6], end[6:], accelerate(until, end[:6], end[6:], convention)[1]
