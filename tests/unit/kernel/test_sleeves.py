"""Sleeves on beams in the compiled kernel: as numpy has them, and as differences find them.

Claims:
    Machines
    - sleeves in the kernel: residual, closures and their rates, tangent; four bases in a plane,
      eight variants in space on 1, 2 and 4 segments, two on one rod; marches | numpy and Pinocchio;
      differences | 1e-11, tangent 1e-9; differences 1e-6 | passes
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.kernel.library import kernel
from pinflex.mechanics.evaluation.compiled import Compiled, serves
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.model.system import System
from tests.scenes import Body, load
from tests.unit.kernel.test_kernel import (
    SAME,
    SAME_TANGENT,
    agrees,
    apart,
    same_closure_motion,
    same_outputs,
    without_kernel,
)
from tests.unit.mechanics.test_slider import (
    BASES,
    FIXED,
    ROD,
    SLEEVES,
    SPACE,
    robot,
)
from tests.unit.mechanics.test_slider_segments import along

pytestmark = pytest.mark.skipif(kernel().functions is None, reason=kernel().said)

LONG = "loops.sleeve.sleeve=0.2"
SECOND = ("flexible.rod.second_order=true", "flexible.rod.axial=true")
SPATIAL = {
    "turning": (),
    "fixed": (FIXED,),
    "fixed and long": (FIXED, LONG),
    "pivoting": (LONG, "loops.sleeve.pivoting=true"),
    "with second order": (FIXED, LONG, *SECOND),
    "with shear": (FIXED, LONG, "flexible.rod.shear=true",
                   "flexible.rod.basis={kind: finite_element, elements: 2}"),
    "of many modes": (FIXED, "flexible.rod.basis={kind: assumed, boundary: clamped_free, "
                      "modes: 4}"),
    "bent far": (FIXED, *SECOND, "flexible.rod.third_order=true",
                 "flexible.rod.section={shape: circle, diameter: 0.02}"),
}  # fmt: skip
CUTS = (1, 2, 4)
NEAR = 2e-5  # [m | rad]: beyond a border of elements the rows are other polynomials
BESIDE = (
    *ROD,
    Body("slide", "base", "prismatic", xyz=(0.35, 0, 0), axis=(0, 0.6, 0.8), mass=0.1,
         inertia=(1e-4, 1e-4, 1e-4)),
    Body("second", "slide"),
)  # fmt: skip
TWO = ("loops.beside={kind: slider, between: [rod, second], sleeve: 0.03}",)


def free(system: System) -> System:
    """Without the stiffness and damping that would hide what sleeves do."""
    zero = np.zeros_like(system.K)
    return dataclasses.replace(system, K=zero, D=zero)


def state(m: pf.Mechanism, x: float, seed: int) -> list[Array]:
    """y, v, a and lam with the sleeve near x (m) of the rod, bent by a per cent."""
    rng, system = np.random.default_rng(seed), m.flexible
    y, n = m.undeformed().copy(), int(system.rigid.nv)
    y[1:4] = 0.2 - x, 2e-3, -1e-3  # the carriage turns first
    y[-system.n_eta :] = 4e-3 * rng.uniform(-1, 1, system.n_eta)
    size = np.ones(system.nv)
    size[n:] = 0.02
    v, a = (size * rng.uniform(-1, 1, system.nv) for _ in range(2))
    return [y, v, a, rng.uniform(-1, 1, system.closed.n)]


def is_numpy(system: System, states: list[list[Array]]) -> None:
    bare = free(system)
    Y, V, A, lam = (np.array(column) for column in zip(*states, strict=True))
    R, C = Compiled(bare).residual(Y, V, A, lam, np.zeros(len(Y)))
    r, c = without_kernel(bare).residual(Y, V, A, lam, np.zeros(len(Y)))
    assert apart(R, r) < SAME
    assert np.abs(C - c).max() < SAME
    same_closure_motion(bare, (Y, V, A))
    same_outputs(bare, (Y, V, A, lam, np.zeros(len(Y))))
    for each in states[1::2]:
        same_along(bare, *each)
    places = without_kernel(bare).sleeve_places(Y)
    np.testing.assert_allclose(Equations(bare).sleeve_places(Y), places, rtol=0, atol=SAME)


def same_along(system: System, y: Array, v: Array, a: Array, lam: Array) -> None:
    """Derivatives along a random direction with a part of every coordinate, as `same_tangent`.

    Column by column the reference looks for every sleeve four times in each: seven times the time.
    """
    plain, n, one = without_kernel(system), int(system.rigid.nv), np.zeros(1)
    X = plain.map.at(y[None]).X
    assert X is not None
    d = np.random.default_rng(1).choice([-1.0, 1.0], system.nv) / np.abs(X[0]).max(axis=0)
    h = NEAR / np.abs(X[0] @ d).max()

    def forces(y: Array, v: Array, a: Array) -> Array:
        return plain.residual(y[None], v[None], a[None], lam[None], one)[0][0]

    for rates in (True, False):
        if not rates:
            v, a = (np.append(x[:n], np.zeros(system.n_eta)) for x in (v, a))
        at = [forces(system.integrate(y, k * h * d), v, a) for k in (-3, -2, -1, 1, 2, 3)]
        expected = (
            forces(y, v, a + d) - forces(y, v, a),  # linear in a, of second order in v
            0.5 * (forces(y, v + d, a) - forces(y, v - d, a)),
            np.array([-1, 9, -45, 45, -9, 1]) @ at / (60 * h),  # of sixth order
        )
        *found, J = Compiled(system).tangent(y, v, a, lam, 0.0, rates)
        least = 1e-3 * np.abs(at).max()  # of a matrix that is zero, as in `same_matrices`
        for matrix, slope in zip(found, expected, strict=True):
            scale = max(np.abs(matrix * d).max(), least)
            assert np.abs(matrix @ d - slope).max() < SAME_TANGENT * scale
    expected_J = plain.close(y[None]).J[0]
    assert np.abs(J - expected_J).max() < SAME_TANGENT * np.abs(J).max()


@pytest.mark.parametrize("sleeve", SLEEVES)
@pytest.mark.parametrize("basis", BASES)
def test_on_one_body_in_a_plane_they_are_those_of_numpy(basis: str, sleeve: str) -> None:
    m = robot(BASES[basis], *SLEEVES[sleeve])
    assert serves(m.flexible)
    agrees(m.flexible, m.undeformed(), 6)


@pytest.mark.parametrize("segments", CUTS)
@pytest.mark.parametrize("case", SPATIAL)
def test_in_space_and_over_borders_they_are_those_of_numpy(
    case: str, segments: int, tmp_path: Path
) -> None:
    m = load(tmp_path, ROD, SPACE, (f"flexible.rod.segments={segments}", *SPATIAL[case]))
    places = 0.11, 0.2499, 0.26, 0.375  # four in one call: the lanes are on segments of their own
    is_numpy(m.flexible, [state(m, x, seed) for seed, x in enumerate(places)])


@pytest.mark.parametrize("segments", CUTS)
def test_several_sleeves_on_one_rod(segments: int, tmp_path: Path) -> None:
    m = load(tmp_path, BESIDE, SPACE, (f"flexible.rod.segments={segments}", FIXED, *TWO))
    assert len(m.flexible.closed.contacts) == 2
    # The second sleeve stands 0.15 m farther. Off the rod, 0.5 m long, its ends have several roots.
    places = 0.11, 0.26, 0.21  # and at the last it reaches over a border of four segments
    is_numpy(m.flexible, [state(m, x, seed) for seed, x in enumerate(places)])


@pytest.mark.parametrize("x", [0.1, 0.26])
@pytest.mark.parametrize("segments", [1, 2])
def test_differences_find_the_same_derivatives(segments: int, x: float, tmp_path: Path) -> None:
    """Good to h^4 and round-off over h, as in test_slider_segments.py."""
    m = load(tmp_path, ROD, SPACE, (f"flexible.rod.segments={segments}", FIXED,
                                    "loops.sleeve.sleeve=0.04"))  # fmt: skip
    d = Equations(free(m.flexible))
    assert d.compiled is not None
    y, v, _, lam = state(m, x, 3)
    zero, no = 0.0 * v, 0.0 * lam
    moved = along(lambda y: d.close(y).c, y, v, d)
    np.testing.assert_allclose(d.close(y).J @ v, moved, atol=1e-8 * np.abs(moved).max())
    bias = along(lambda y: d.close(y).J @ v, y, v, d)
    np.testing.assert_allclose(d.closure_bias(y, v), bias, atol=1e-6 * np.abs(bias).max())
    K = d.tangent(y, zero, zero, lam, 0.0).K - d.tangent(y, zero, zero, no, 0.0).K
    pushed = along(lambda y: -d.close(y).J.T @ lam, y, v, d)
    np.testing.assert_allclose(K @ v, pushed, atol=1e-6 * np.abs(pushed).max())


@pytest.mark.parametrize("how", [{"tol": 1e-2}, {"dt": 1e-3}])
def test_a_compiled_march_stops_where_a_sleeve_leaves_its_beam(how: dict[str, float]) -> None:
    m = robot("motion.joints.slide_2=0", "loops.sleeve.sleeve=0.03")
    with pytest.raises(pf.MotionError, match=r'sleeve "sleeve" leaves the beam') as caught:
        pf.solve(m, until=1.5, samples=151, **how)
    found = float(caught.value.data["time"])  # type: ignore[arg-type]
    # The far end of the sleeve is at 0.18/cos(theta) + 0.015 = 0.5 m.
    assert found >= np.sqrt(0.18 * np.tan(np.arccos(0.18 / 0.485)) / 0.3)
    assert caught.value.result.t[-1] <= found + 1e-12


@pytest.mark.parametrize("modes", [12, 50])
def test_shortening_by_squares_of_slopes_is_that_by_products(modes: int) -> None:
    """And is taken where there are many functions: the products are a quarter of them at most."""
    m = robot(f"flexible.beam.basis={{kind: assumed, boundary: free_free, modes: {modes}}}")
    counts, arrays = m.flexible.tables.counts, m.flexible.tables.arrays
    rest = int(np.sum(arrays["g_at"][1:] - arrays["g_rest"]))
    work = int(arrays["sum_at"][-1] + arrays["square_at"][-1])
    assert (counts["squares"] > 0) == (modes == 50)
    assert modes != 50 or 4 * work < rest
    agrees(m.flexible, m.undeformed(), 6)
