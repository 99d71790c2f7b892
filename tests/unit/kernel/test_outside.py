"""The compiled kernel against Pinocchio itself on the expanded model, not against numpy's terms.

Of the package only the places Q(y) of the expanded model are taken. Velocities, accelerations and
the columns of dQ/dy are differences of them, so that no map of rates is believed.

Claims:
    Equations
    - a spring off the origin of a link, in the compiled equations | by hand | 1e-12 | exact
    - masses that differ with the direction, in the compiled equations = d/dt dT/dv - dT/dq of
      Pinocchio's twist | Lagrange; differences | 1e-8 of the largest | 1e-10
    - a wheel that follows another is felt there by its ratio squared, in the compiled equations |
      by hand | 1e-13 | exact
    - inertia and weight of the compiled kernel = Pinocchio's rnea and crba on the expanded model
      with differences of its places; C, K | Pinocchio; differences | 3e-6 of the largest | 1e-7
    Beams (frequencies relative; L = m = E I = 1)
    - kernel: friction and dampers take force times speed; a run that ends with its braking ends at
      rest | by hand | 1e-12; 1e-6 | passes
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.kernel.library import kernel
from pinflex.mechanics.evaluation.compiled import Compiled, serves
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.model.loads import AddedMasses, DryFriction, Loads
from pinflex.mechanics.model.system import System
from tests.every_model import NAMES, at_home, manifold, mechanism
from tests.scenes import Body, load
from tests.unit.kernel.test_kernel import bare as of_model
from tests.unit.kernel.test_kernel import states

pytestmark = pytest.mark.skipif(kernel().functions is None, reason=kernel().said)
STEP = 1e-4  # of differences: errors of STEP^2 beside round-off over STEP^2
FINE = 1e-5  # of first differences of forces
SAME = 3e-6  # of the largest force; seen: 1e-7


def bare(system: System) -> System:
    """Inertia and weight alone."""
    zero = np.zeros_like(system.K)
    springs = replace(system.springs, stiffness=0.0 * system.springs.stiffness)
    return replace(
        system, K=zero, D=zero, springs=springs, friction=DryFriction(), loads=Loads((), ())
    )


class Outside:
    """Pinocchio on the expanded model of a system."""

    def __init__(self, system: System) -> None:
        self.of, self.model = Equations(system), system.expansion.model
        self.data, self.nv = self.model.createData(), system.nv

    def place(self, y: Array) -> Array:
        return np.array(self.of.at(y).Q[0])

    def moved(self, y: Array, v: Array) -> Array:
        return np.array(self.of.integrate(y, v))

    def apart(self, Q: Array, other: Array) -> Array:
        return np.array(pin.difference(self.model, Q, other))

    def columns(self, y: Array) -> Array:
        """dQ/dy, shape (nV, nv)."""
        steps = STEP * np.eye(self.nv)
        ends = [(self.place(self.moved(y, -e)), self.place(self.moved(y, e))) for e in steps]
        return np.array([self.apart(*pair) for pair in ends]).T / (2 * STEP)

    def force(self, y: Array, v: Array, a: Array) -> Array:
        """(dQ/dy)' rnea(Q, dQ/dt, d2Q/dt2) along y + v t + a t^2 / 2."""
        Q, h = self.place(y), STEP
        late, early = (
            self.apart(Q, self.place(self.moved(y, s * h * v + 0.5 * h**2 * a))) for s in (1, -1)
        )
        V, A = (late - early) / (2 * h), (late + early) / h**2
        return self.columns(y).T @ pin.rnea(self.model, self.data, Q, V, A)

    def mass(self, y: Array) -> Array:
        M = np.triu(pin.crba(self.model, self.data, self.place(y)))
        X = self.columns(y)
        return X.T @ (M + np.triu(M, 1).T) @ X


def agrees(system: System, home: Array) -> None:
    system = bare(system)
    assert serves(system)
    compiled, outside = Compiled(system), Outside(system)
    Y, V, A, lam, t = states(system, home, 3)
    got = compiled.residual(Y, V, A, 0 * lam, t)[0]
    for k in range(3):
        expected = outside.force(Y[k], V[k], A[k])
        assert np.max(np.abs(got[k] - expected)) < SAME * np.max(np.abs(expected))
    # Of the tangent, M from Pinocchio's crba, C and K from differences of what stands above.
    M, C, K = compiled.tangent(Y[0], V[0], A[0], 0 * lam[0], 0.0)[:3]
    assert np.max(np.abs(M - outside.mass(Y[0]))) < SAME * np.max(np.abs(M))
    steps = FINE * np.eye(system.nv)
    by = {"C": [(Y[0], V[0] + s * e) for e in steps for s in (1, -1)],
          "K": [(outside.moved(Y[0], s * e), V[0]) for e in steps for s in (1, -1)]}  # fmt: skip
    for name, matrix in (("C", C), ("K", K)):
        y, v = (np.array(x) for x in zip(*by[name], strict=True))
        n = len(y)
        r = compiled.residual(
            y, v, np.tile(A[0], (n, 1)), np.zeros((n, lam.shape[1])), np.zeros(n)
        )[0]
        slope = (r[::2] - r[1::2]).T / (2 * FINE)
        assert np.max(np.abs(matrix - slope)) < SAME * np.max(np.abs(slope)), name


@pytest.mark.parametrize("name", [n for n in NAMES if n not in ("prprp", "cassie")])
def test_inertia_and_weight_are_pinocchios_on_shipped_models(name: str) -> None:
    agrees(*at_home(mechanism(name), "flexible"))


def test_they_are_with_every_kind_of_joint(tmp_path: Path) -> None:
    agrees(*at_home(manifold(tmp_path), "flexible"))


def test_a_spring_off_the_origin_of_a_link_turns_it_by_its_arm(tmp_path: Path) -> None:
    """k (d - l) across an arm of 1 m: 100 (1 - 0.4) 1 N m, from the compiled equations."""
    bodies = (
        Body("arm", "base", "revolute", axis=(0, 0, 1), mass=1.0, inertia=(0.1, 0.1, 0.1)),
        Body("tip", "arm", xyz=(1, 0, 0)),
        Body("post", "base", xyz=(1, 1, 0)),
    )
    spring = "springs: {s: {between: [tip, post], stiffness: 100, length: 0.4}}"
    m = load(tmp_path, bodies, f"gravity: [0, 0, 0]\nactuated: [arm_joint]\n{spring}\n")
    y, still = np.tile(m.home, (2, 1)), np.zeros((2, 1))
    found, _ = Compiled(m.rigid).residual(y, still, still, np.zeros((2, 0)), np.zeros(2))
    np.testing.assert_allclose(found, -60.0, rtol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_added_masses_are_what_lagrange_makes_of_their_energy(seed: int) -> None:
    """d/dt dT/dv - dT/dq, T = u' M u / 2 of the twist u that Pinocchio has for the body."""
    rng = np.random.default_rng(seed)
    model, at = pin.Model(), 0
    model.gravity.linear = rng.normal(size=3)
    for k in range(4):
        axis = rng.normal(size=3)
        joint = pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis))
        at = model.addJoint(at, joint, pin.SE3.Random(), f"joint {k}")
        model.appendBodyToJoint(at, pin.Inertia.Random(), pin.SE3.Random())
    X, data = rng.normal(size=(6, 6)), model.createData()
    plain, own = of_model(model), X @ X.T
    system = replace(plain, added=AddedMasses((3,), own[None]))

    def momentum(q: Array, v: Array) -> tuple[Array, float]:
        J = pin.computeJointJacobian(model, data, q, 3)
        return J.T @ own @ J @ v, 0.5 * v @ J.T @ own @ J @ v

    q, v, a = rng.normal(size=(3, 4))
    h, (late, early) = FINE, [momentum(q + s * v * FINE, v + s * a * FINE)[0] for s in (1, -1)]
    slope = [momentum(q + e, v)[1] - momentum(q - e, v)[1] for e in h * np.eye(4)]
    expected = (late - early - np.array(slope)) / (2 * h)
    none = np.zeros((1, 0))
    with_it, without = (
        Compiled(x).residual(q[None], v[None], a[None], none, np.zeros(1))[0][0]
        for x in (system, plain)
    )
    scale = np.max(np.abs(expected))
    assert np.max(np.abs(with_it - without - expected)) < 1e-8 * scale  # h^2, and 1e-16 / h


def test_a_wheel_that_follows_is_felt_by_its_ratio_squared(tmp_path: Path) -> None:
    """(I1 + n^2 I2) a + n k (n q) at the leader, with I2 and a spring k at the follower."""
    bodies = (
        Body("wheel", "base", "revolute", axis=(0, 0, 1), mass=1.0, inertia=(0.1, 0.1, 0.3)),
        Body("pinion", "base", "revolute", axis=(0, 0, 1), mass=1.0, inertia=(0.1, 0.1, 0.02)),
    )
    follows = "joints: {pinion_joint: {follows: wheel_joint, ratio: -3, spring: 5}}"
    m = load(tmp_path, bodies, f"gravity: [0, 0, 0]\nactuated: [wheel_joint]\n{follows}\n")
    assert serves(m.rigid)
    lead, follow = (m.coordinates.index(f"{name}_joint") for name in ("wheel", "pinion"))
    q, a = np.zeros((2, 1, 2))
    q[0, lead], q[0, follow], a[0, lead], a[0, follow] = 0.25, -0.75, 0.7, -2.1
    lam = np.array([[0.02 * -2.1 + 5.0 * -0.75]])  # what the follower needs
    r, c = Compiled(m.rigid).residual(q, 0 * q, a, lam, np.zeros(1))
    expected = (0.3 + 9 * 0.02) * 0.7 + 9 * 5.0 * 0.25
    np.testing.assert_allclose(r[0, [lead, follow]], [expected, 0.0], rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(c, 0.0, atol=1e-16)


def test_what_rubs_and_damps_takes_its_force_times_the_speed(tmp_path: Path) -> None:
    """A slide with friction, a damper of 3 N s/m and a spinning disk: powers by hand, W."""
    bodies = (
        Body("slide", "base", "prismatic", axis=(1, 0, 0), mass=1.0),
        Body("disk", "slide", "revolute", mass=1.0, inertia=(0.1, 0.1, 0.1)),
    )
    rubs = "{coulomb: 2, breakaway: 5, stribeck: 0.3, speed: 0.01}"
    m = load(tmp_path, bodies, "gravity: [0, 0, 0]\nactuated: []\njoints:\n"
             f"  slide_joint: {{damper: 3, friction: {rubs}}}\n"
             "  disk_joint: {damper: 0.5}\n")  # fmt: skip
    compiled, law = Compiled(m.rigid), m.rigid.friction
    v = np.array([[0.2, 0.0], [-0.2, 4.0], [0.004, -1.0]])
    x, w = v.T
    # 2 N of sliding, and what is on top at low speed, of which the law says how much
    force = (2.0 + law.excess[0] * np.exp(-((x / 0.3) ** 2))) * np.tanh(x / law.speed[0])
    expected = force * x + 3.0 * x**2 + 0.5 * w**2
    y = np.tile(m.home, (3, 1))
    np.testing.assert_allclose(compiled.losses(y, v), expected, rtol=1e-12)


def test_a_run_that_ends_with_its_motion_ends_at_rest() -> None:
    """0.2 rad in 20 ms, ramps of 5 ms: 2667 rad/s^2, and none at the very end of the braking."""
    move = "motion={kind: trapezoid, joints: {motor_1: 0.2}, duration: 0.02, ramp: 0.005}"
    m = pf.load("race_r1", [move])
    run, longer = (
        pf.solve(m, level="coupled", tol=1e-3, until=end, samples=n)
        for end, n in ((0.02, 5), (0.03, 7))
    )
    a = 0.2 / (0.015 * 0.005)
    found = run.joint("motor_1").acceleration
    np.testing.assert_allclose(found, [a, 0.0, 0.0, -a, 0.0], atol=1e-6 * a)
    # The torque too is that after the jump, within the tolerance of both runs; before: twice it.
    off = np.abs(run.torque - longer.torque[:5])
    assert np.max(off) < 2e-3 * np.max(np.abs(longer.torque))
