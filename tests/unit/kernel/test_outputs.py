"""Forces, motions and energies of the compiled kernel against Pinocchio, balances and closed forms.

Rates of the expanded coordinates are differences of its places, as in test_outside.py: no map of
rates is believed. That numpy has the same numbers is checked in test_kernel.py and test_sleeves.py.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pinflex.arrays import Array
from pinflex.kernel.library import kernel
from pinflex.mechanics.evaluation.compiled import Compiled
from pinflex.mechanics.model.loads import DryFriction
from pinflex.mechanics.model.system import System
from tests.every_model import NAMES, at_home, manifold, mechanism
from tests.scenes import Body, load
from tests.unit.kernel.test_kernel import FOLLOWER, LOADS, states
from tests.unit.kernel.test_outside import SAME, STEP, Outside, bare
from tests.unit.mechanics.test_slider import DRAWN, TELESCOPE, TUBE

pytestmark = pytest.mark.skipif(kernel().functions is None, reason=kernel().said)
DEAD = LOADS.replace("follower: true, ramp: 2.0", "follower: false")
DEAD = DEAD.replace("damper: 4, ", "").replace(", moment: [1.0, 2.0, 3.0]", "")
BOTH_WAYS = ("flexible.rod.bending_y=true", "flexible.rod.bending_z=true")


def moving(outside: Outside, y: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
    """Q, V and A along y + v t + a t^2 / 2."""
    Q, h = outside.place(y), STEP
    late, early = (
        outside.apart(Q, outside.place(outside.moved(y, s * h * v + 0.5 * h**2 * a)))
        for s in (1, -1)
    )
    return Q, (late - early) / (2 * h), (late + early) / h**2


def are_pinocchios(system: System, home: Array) -> None:
    """Joint forces, motions and energies of inertia and weight."""
    system = bare(system)
    compiled, outside, joints = Compiled(system), Outside(system), system.looked_at
    Y, V, A, lam, t = states(system, home, 3)
    forces = compiled.joint_forces(Y, V, A, 0 * lam, t, joints[1:])
    poses, rates = compiled.motions(Y, V, A, joints)
    energies = compiled.energies(Y, V, t)
    model, data = outside.model, outside.data
    for k in range(3):
        Q, dQ, ddQ = moving(outside, Y[k], V[k], A[k])
        pin.rnea(model, data, Q, dQ, ddQ)
        pairs = [(forces.f[k], [data.f[j].vector for j in joints[1:]]), (forces.g[k], data.tau)]
        pin.forwardKinematics(model, data, Q, dQ, ddQ)
        pairs += [
            (rates[:, k, 0], [data.v[j].vector for j in joints]),
            (rates[:, k, 1], [data.a[j].vector for j in joints]),
            (poses[:, k], [data.oMi[j].homogeneous[:3] for j in joints]),
            # p of points would leave out rotors about some axes: T = V' M V / 2
            (energies.kinetic[k], 0.5 * dQ @ whole(pin.crba(model, data, Q)) @ dQ),
            (energies.gravity[k], pin.computePotentialEnergy(model, data, Q)),
        ]
        for found, expected in pairs:
            scale = np.max(np.abs(expected), initial=1e-3)
            assert np.max(np.abs(found - np.array(expected)), initial=0.0) < SAME * scale


def whole(M: Array) -> Array:
    return np.triu(M) + np.triu(M, 1).T


@pytest.mark.parametrize("name", [n for n in NAMES if n not in ("prprp", "cassie")])
def test_forces_motions_and_energies_are_pinocchios_on_shipped_models(name: str) -> None:
    are_pinocchios(*at_home(mechanism(name), "flexible"))


def test_they_are_with_every_kind_of_joint(tmp_path: Path) -> None:
    are_pinocchios(*at_home(manifold(tmp_path), "flexible"))


@pytest.mark.parametrize("loads", ["", DEAD])
def test_energies_change_by_the_power_of_the_residual(loads: str, tmp_path: Path) -> None:
    """d(T + U)/dt = v' r of links, gears, springs and dead loads; nothing damps or rubs."""
    system, home = at_home(manifold(tmp_path, loads), "flexible")
    system = replace(system, D=0 * system.D, friction=DryFriction())
    Y, V, A, lam, t = states(system, home, 3)
    compiled, outside = Compiled(system), Outside(system)
    r, _ = compiled.residual(Y, V, A, 0 * lam, t)
    h, each = STEP, list(zip(Y, V, A, strict=True))
    late, early = (
        compiled.energies(
            np.array([outside.moved(y, s * h * v + 0.5 * h**2 * a) for y, v, a in each]),
            V + s * h * A,
            t,
        )
        for s in (1, -1)
    )
    grown = sum(np.array(late) - np.array(early)) / (2 * h)
    power = np.sum(V * r, axis=1)
    # Rates of rotations are those of the body: V + h A is off by h^2; seen: 2e-7.
    np.testing.assert_allclose(grown, power, rtol=3e-6, atol=3e-6 * np.max(np.abs(power)))
    assert not loads or np.all(compiled.energies(Y, V, t).spring != 0.0)


def test_a_load_that_follows_has_no_energy(tmp_path: Path) -> None:
    (system, home), (without, _) = (
        at_home(manifold(tmp_path, text), "flexible") for text in (FOLLOWER, "")
    )
    Y, V, *_, t = states(system, home, 5)
    found, plain = (Compiled(s).energies(Y, V, t).spring for s in (system, without))
    np.testing.assert_array_equal(found, plain)


def test_a_pivot_carries_a_weight_and_what_a_rope_pulls(tmp_path: Path) -> None:
    """A pendulum of 2 kg at rest, with a rope from its end straight across to a post: by hand."""
    bodies = (
        Body("bob", "base", "revolute", axis=(0, 1, 0), mass=2.0, com=(0, 0, -0.5)),
        Body("hook", "bob", xyz=(0, 0, -1)),
        Body("post", "base", xyz=(1, 0, -1)),
    )
    rope = "loops: {rope: {kind: distance, between: [post, hook]}}"
    m = load(tmp_path, bodies, f"gravity: [0, 0, -9.81]\nactuated: []\n{rope}\n")
    compiled, still = Compiled(m.rigid), np.zeros((1, 1))
    joint = [int(m.rigid.expansion.model.getJointId("bob_joint"))]
    for lam in (0.0, 3.0):
        found = compiled.joint_forces(m.home[None], still, still, np.full((1, 1), lam), np.zeros(1),
                                      joint)  # fmt: skip
        # On B, the bob: lam along the rope from the post to the hook.
        np.testing.assert_allclose(found.wrenches[0, 0], [-lam, 0, 0, 0, 0, 0], atol=1e-14)
        expected = [lam, 0, 2.0 * 9.81, 0, -lam, 0]
        np.testing.assert_allclose(found.f[0, 0], expected, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("long", ["0.02", "0"])
def test_a_sleeve_pushes_its_beam_as_the_beam_pushes_it(long: str, tmp_path: Path) -> None:
    """Action and reaction: what stands on the beam, turned into the world, is less what is on B."""
    m = load(tmp_path, TELESCOPE, TUBE, [*DRAWN, *BOTH_WAYS, f"loops.mouth.sleeve={long}"])
    system = m.flexible
    Y, V, A, lam, t = states(system, m.undeformed(), 5)
    Y = np.tile(m.undeformed(), (5, 1))
    Y[:, -system.n_eta :] = 2e-3 * np.random.default_rng(2).uniform(-1, 1, (5, system.n_eta))
    compiled, one = Compiled(system), system.closed.contacts[0]
    joint = int(system.closed.bodies[one.loop])
    found = compiled.joint_forces(Y, V, A, lam, t, system.looked_at[1:])
    beam = compiled.poses(Y, [joint])[0][:, :, :3] @ system.closed.local[one.loop][:, :3]
    pushed = np.einsum("nij,nkj->ni", beam, found.sleeves[:, 0, :, 1:4])
    np.testing.assert_allclose(pushed, -found.wrenches[:, one.loop, :3], atol=1e-12)
    assert np.max(np.abs(pushed)) > 0.1
