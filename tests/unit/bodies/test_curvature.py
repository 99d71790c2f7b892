"""The bending energy of fourth order: its derivatives, and that it knows no plane.

Claims:
    Equations
    - `third_order`: force, stiffness = derivatives; a round beam has one energy in every plane |
      differences | order 2 +- 0.05; 1e-12 | passes
"""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.bodies.basis import Curvature, curvature
from pinflex.bodies.family import hermite
from pinflex.mechanics.evaluation.equations import Equations
from tests.finite import slope


def both_planes() -> Curvature:
    family = hermite(0.8, 2, "cubic")
    slices = {"v": slice(0, family.n), "w": slice(family.n, 2 * family.n)}
    return curvature({"v": family, "w": family}, slices, 2 * family.n, 3.0)


def test_force_and_stiffness_are_derivatives_of_the_energy():
    bent, rng = both_planes(), np.random.default_rng(3)
    eta, along = rng.normal(size=(2, 8))
    steps = np.array([2e-2, 1e-2, 5e-3])

    def gap(value, derivative):
        exact = derivative(eta) @ along
        pairs = [(value(eta + h * along) - value(eta - h * along)) / (2 * h) for h in steps]
        return [np.max(np.abs(p - exact)) for p in pairs]

    # Central differences: of second order if the derivative is the exact one.
    assert slope(steps, gap(bent.energy, bent.force)) == pytest.approx(2.0, abs=0.05)
    assert slope(steps, gap(bent.force, bent.stiffness)) == pytest.approx(2.0, abs=0.05)


def test_states_together_are_the_states_one_by_one():
    bent, eta = both_planes(), np.random.default_rng(4).normal(size=(3, 8))
    assert np.allclose(bent.force(eta), [bent.force(one) for one in eta], rtol=1e-13)
    assert np.allclose(bent.energy(eta), [bent.energy(one) for one in eta], rtol=1e-13)


def test_a_round_beam_has_one_energy_in_every_plane():
    bent, shape = both_planes(), np.random.default_rng(5).normal(size=4)
    turned = [
        float(bent.energy(np.concatenate([np.cos(a) * shape, np.sin(a) * shape])))
        for a in (0.0, 0.7, 2.0)
    ]
    assert turned == pytest.approx([turned[0]] * 3, rel=1e-12)


def test_an_arc_has_the_energy_of_its_curvature():
    """v = b x^2 / 2: EI/2 int (b^2 x)^2 dx = EI b^4 L^3 / 6."""
    family = hermite(0.8, 1, "cubic")
    bent = curvature({"v": family}, {"v": slice(0, 2)}, 2, 3.0)
    b = 0.4
    eta = np.array([b * 0.8**2 / 2, b * 0.8])
    assert float(bent.energy(eta)) == pytest.approx(3.0 * b**4 * 0.8**3 / 6, rel=1e-12)


def test_equations_with_it_are_consistent():
    """Tangent = differences of the residual; stages together = one by one; energy and force."""
    robot = pf.load("cantilever", ["flexible.beam.third_order=true"])
    d, n = Equations(robot.flexible), robot.flexible.nv
    rng = np.random.default_rng(6)
    Y, V, A = 0.3 * rng.normal(size=(3, 2, n))
    none, h = np.zeros((2, 0)), 1e-5
    along = rng.normal(size=n)
    K = d.tangent(Y[0], V[0], A[0], none[0], 0.0).K
    ends = [d.residual(Y[0] + s * h * along, V[0], A[0], none[0], 0.0).r for s in (1.0, -1.0)]
    change = (ends[0] - ends[1]) / (2 * h)
    assert np.allclose(K @ along, change, rtol=1e-6, atol=1e-6 * np.max(np.abs(change)))
    together = d.residual(Y, V, A, none, np.zeros(2)).r
    assert np.allclose(together, [d.residual(*s, 0.0).r for s in zip(Y, V, A, none, strict=True)])
    rise = [float(d.strain.energy(Y[0] + s * h * along)) for s in (1.0, -1.0)]
    assert d.strain.force(Y[0]) @ along == pytest.approx((rise[0] - rise[1]) / (2 * h), rel=1e-7)
