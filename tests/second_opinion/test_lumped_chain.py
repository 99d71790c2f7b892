"""A planar 3-RRR once more, by a formulation that shares nothing with the package.

Every rigid body has absolute coordinates (x, y, angle); each thin link is a chain of rigid pieces
joined by pins and rotational springs EI/(L/n); all pins are closures; scipy integrates index 1 with
Baumgarte feedback. No joint angles, no modes, no recursive dynamics, no alpha scheme.

Claims:
    Invariances, a second opinion, workspaces
    - a 3-RRR as chains of rigid pieces in absolute coordinates: torque, bending, platform's
      deviation | scipy, index 1 | 3e-4, 1e-2, 3e-2 of the peak | 3.8e-5, 3.8e-4, 1.3e-3
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pinflex as pf
from pinflex.arrays import Array
from tests.scenes import published

BASE = np.array([[0.0, 0.0], [0.5, 0.0], [0.25, 0.4330127018922193]])  # [m]
CORNER = 0.068 * np.exp(1j * np.radians([210.0, 330.0, 90.0]))  # platform pins
LENGTH, EI = 0.21, 7.1e10 * 0.025 * 0.002**3 / 12  # [m], [N m^2]
LINE = 2810 * 0.025 * 0.002  # [kg/m]
CRANK, ROTOR = 0.147525, 8.3e-3  # [kg], [kg m^2]
PLATFORM = (0.4, 9.5e-4)  # [kg], [kg m^2]
MOVES = np.array([0.25, -0.15, 0.10])  # [rad] cycloid
DURATION = 0.1  # [s]


@dataclass
class Chain:
    """Bodies, pins and springs in absolute coordinates."""

    mass: list[tuple[float, float]] = field(default_factory=list)
    start: list[tuple[float, float, float]] = field(default_factory=list)
    pins: list[tuple[int, Array, int, Array]] = field(default_factory=list)
    springs: list[tuple[int, int, float]] = field(default_factory=list)

    def add(self, mass: float, inertia: float, x: float, y: float, angle: float) -> int:
        self.mass.append((mass, inertia))
        self.start.append((x, y, angle))
        return len(self.mass) - 1


def robot(pieces: int) -> tuple[Chain, list[int]]:
    """All bodies; body -1 in a pin is the ground."""
    chain, cranks = Chain(), []
    platform = chain.add(*PLATFORM, 0.25, 0.25 / np.sqrt(3), 0.0)
    r1 = pf.load(published("race_r1"))
    angles = {n: float(q) for n, q in zip(r1.coordinates, r1.home, strict=True)}
    for leg in range(3):
        a = angles.get(f"motor_{leg + 1}")
        assert a is not None
        crank_mass = (CRANK, CRANK * LENGTH**2 / 12)
        at = BASE[leg] + 0.5 * LENGTH * np.array([np.cos(a), np.sin(a)])
        crank = chain.add(crank_mass[0], crank_mass[1] + ROTOR, at[0], at[1], a)
        cranks.append(crank)
        chain.pins.append((-1, BASE[leg], crank, np.array([-LENGTH / 2, 0])))
        b = a + angles[f"knee_{leg + 1}"]
        knee = BASE[leg] + LENGTH * np.array([np.cos(a), np.sin(a)])
        # Half pieces at both ends: springs sit at the middle of equal shares of the length.
        shares = np.array([0.5, *[1.0] * (pieces - 1), 0.5]) * LENGTH / pieces
        before, s = crank, 0.0
        for k, share in enumerate(shares):
            middle = knee + (s + share / 2) * np.array([np.cos(b), np.sin(b)])
            m = LINE * share
            piece = chain.add(m, m * share**2 / 12, middle[0], middle[1], b)
            end = LENGTH / 2 if k == 0 else shares[k - 1] / 2
            chain.pins.append((before, np.array([end, 0]), piece, np.array([-share / 2, 0])))
            if k:
                chain.springs.append((before, piece, EI / (LENGTH / pieces)))
            before, s = piece, s + share
        corner = np.array([CORNER[leg].real, CORNER[leg].imag])
        chain.pins.append((before, np.array([shares[-1] / 2, 0]), platform, corner))
    return chain, cranks


def cycloid(t: float) -> tuple[Array, Array, Array]:
    u = min(t / DURATION, 1.0)
    w = 2 * np.pi
    s = u - np.sin(w * u) / w
    v = (1 - np.cos(w * u)) / DURATION if u < 1 else 0.0
    a = w * np.sin(w * u) / DURATION**2 if u < 1 else 0.0
    return MOVES * s, MOVES * v, MOVES * a


def march(pieces: int, until: float, t_out: Array) -> tuple[Array, Array, Array]:
    """Platform (x, y), motor torques, and offset of each link's middle from its chord."""
    chain, cranks = robot(pieces)
    n = 3 * len(chain.mass)
    M = np.repeat(np.array(chain.mass), [2, 1], axis=1).ravel()
    q0 = np.array(chain.start).ravel()
    rows = 2 * len(chain.pins)
    home = q0[[3 * c + 2 for c in cranks]]
    alpha = 400.0  # [1/s] Baumgarte: faster than the run, slower than the springs

    def constraints(q: Array, v: Array) -> tuple[Array, Array, Array]:
        c, bias, J = np.zeros(rows), np.zeros(rows), np.zeros((rows, n))
        for k, (i, p, j, r) in enumerate(chain.pins):
            at = slice(2 * k, 2 * k + 2)
            for body, arm, sign in ((i, p, -1.0), (j, r, 1.0)):
                if body < 0:
                    c[at] += sign * arm
                    continue
                x, y, th = q[3 * body : 3 * body + 3]
                turned = np.array([np.cos(th) * arm[0] - np.sin(th) * arm[1],
                                   np.sin(th) * arm[0] + np.cos(th) * arm[1]])  # fmt: skip
                c[at] += sign * (np.array([x, y]) + turned)
                J[at, 3 * body : 3 * body + 2] += sign * np.eye(2)
                J[at, 3 * body + 2] += sign * np.array([-turned[1], turned[0]])
                bias[at] -= sign * turned * v[3 * body + 2] ** 2
        return c, J, bias

    S = np.zeros((n + rows + 3, n + rows + 3))
    S[range(n), range(n)] = M
    for k, crank in enumerate(cranks):
        S[n + rows + k, 3 * crank + 2] = S[3 * crank + 2, n + rows + k] = 1.0

    def accelerate(t: float, z: Array) -> Array:
        q, v = z[:n], z[n:]
        c, J, bias = constraints(q, v)
        f = np.zeros(n)
        for i, j, k in chain.springs:
            moment = k * (q[3 * j + 2] - q[3 * i + 2])
            f[3 * i + 2] += moment
            f[3 * j + 2] -= moment
        p, pv, pa = cycloid(t)
        angle, rate = (x[[3 * k + 2 for k in cranks]] for x in (q, v))
        drive = pa - 2 * alpha * (rate - pv) - alpha**2 * (angle - home - p)
        S[:n, n : n + rows], S[n : n + rows, :n] = J.T, J
        b = np.concatenate([f, -bias - 2 * alpha * (J @ v) - alpha**2 * c, drive])
        return np.asarray(np.linalg.solve(S, b))

    run = solve_ivp(
        lambda t, z: np.concatenate([z[n:], accelerate(t, z)[:n]]), (0.0, until),
        np.concatenate([q0, np.zeros(n)]), "DOP853", t_eval=t_out, rtol=1e-6, atol=1e-8,
    )  # fmt: skip
    assert run.success, run.message
    torque = np.array([-accelerate(t, z)[n + rows :] for t, z in zip(run.t, run.y.T, strict=True)])
    offsets = []
    for leg in range(3):
        crank, first = cranks[leg], cranks[leg] + 1
        knee = _point(run.y, crank, np.array([LENGTH / 2, 0]))
        corner = _point(run.y, 0, np.array([CORNER[leg].real, CORNER[leg].imag]))
        middle = _point(run.y, first + pieces // 2, np.zeros(2))  # pieces is even
        chord = corner - knee
        away = middle - knee
        offsets.append((chord[0] * away[1] - chord[1] * away[0]) / np.hypot(*chord))
    return run.y[:2].T, torque, np.array(offsets).T


def _point(q: Array, body: int, arm: Array) -> Array:
    """World place of a point of a body over time, shape (2, nt)."""
    x, y, th = q[3 * body : 3 * body + 3]
    c, s = np.cos(th), np.sin(th)
    return np.array([x + c * arm[0] - s * arm[1], y + s * arm[0] + c * arm[1]])


Runs = tuple[pf.Result, pf.Result, Array, Array, Array]


@pytest.fixture(scope="module")
def runs() -> Runs:
    until, samples = 0.05, 51
    m = pf.load(published("race_r1"))
    r = pf.solve(m, level="coupled", until=until, samples=samples, dt=5e-5)
    rigid = pf.solve(m, level="rigid", until=until, samples=samples)
    # Chains of 4 and 8 pieces, extrapolated: a lumped chain errs with 1/n^2.
    coarse, fine = (march(n, until, r.t) for n in (4, 8))
    place, torque, offset = ((4 * b - a) / 3 for a, b in zip(coarse, fine, strict=True))
    return r, rigid, place, torque, offset


def test_the_links_bend_as_the_lumped_chains_do(runs: Runs) -> None:
    r, _, _, _, offset = runs
    for leg in range(3):
        line = r.link(f"distal_{leg + 1}").centreline[:, :, :2]
        chord, away = line[:, -1] - line[:, 0], line[:, line.shape[1] // 2] - line[:, 0]
        mine = (chord[:, 0] * away[:, 1] - chord[:, 1] * away[:, 0]) / np.linalg.norm(chord, axis=1)
        # What the extrapolation leaves of the chain's second mode.
        assert np.abs(mine - offset[:, leg]).max() < 0.01 * np.abs(offset).max()


def test_the_platform_goes_where_the_lumped_chain_takes_it(runs: Runs) -> None:
    r, rigid, place, _, _ = runs
    bend = r.frame("platform").position - rigid.frame("platform").position
    gap = r.frame("platform").position[:, :2] - place
    # What is compared is the elastic deviation, not the nominal path.
    assert np.abs(gap).max() < 0.03 * np.abs(bend).max()


def test_the_motor_torques_are_those_of_the_lumped_chain(runs: Runs) -> None:
    r, _, _, torque, _ = runs
    # 3.8e-5 of the peak measured: the feedback that keeps the chain's pins closed.
    assert np.abs(r.torque - torque).max() < 3e-4 * np.abs(torque).max()
