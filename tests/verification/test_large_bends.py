"""Bends that are not small, with `third_order`: frequency against amplitude, and the elastica.

Every beam has L = rho A = E I = 1, as in test_beams.

Claims:
    Equations
    - `third_order`: a force across the tip of a cantilever, tip with the 5th power of the load (3rd
      without) | exact rod, by shooting | slope 5 +- 0.4, 3 +- 0.4 | passes
    - `third_order`: first mode, (omega/omega_0 - 1)/(a/L)^2 = 0.3067 - 0.2873; only -0.2873 without
      | closed form, Crespo da Silva and Glynn | 5e-3 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import pinflex as pf
from pinflex.bodies.family import assumed, quadrature
from tests import analytical
from tests.finite import slope
from tests.scenes import load
from tests.verification.test_beams import BEAM, scene

FEW = "{kind: assumed, boundary: clamped_free, modes: 1}"  # others answer in fifth order


def beam(folder: Path, extra: str, head: str = "", basis: str = FEW) -> pf.Mechanism:
    return load(folder, BEAM, scene(basis, f"frames: [tip]\n{head}", extra))


def shifts() -> tuple[float, float]:
    """d(omega)/omega over (tip amplitude)^2 of a cantilever's first mode: by curvature, by inertia.

    First-order averaging of V4 = 1/2 int (v' v'')^2 and T4 = 1/2 int (du/dt)^2, u = -1/2 int v'^2:
    3/4 V4/V2 and -1/4 T4/T2 at unit amplitude (Crespo da Silva and Glynn 1978; 4.597 is T4/T2 for
    modes of unit mean square).
    """
    family = assumed(1.0, "clamped_free", 1)
    x, w = (a.ravel() for a in quadrature(np.linspace(0.0, 1.0, 101), 4))
    F, tip = family.evaluate(x), family.evaluate(np.ones(1)).f[0, 0]
    f, df, curv = (a[:, 0] / tip for a in (F.f, F.df, F.curv))
    shortening = np.cumsum(w * df**2) - 0.5 * w * df**2
    mass = w @ f**2
    ratio = (w @ shortening**2) / mass
    assert ratio * mass == pytest.approx(4.597 / 16, rel=1e-3)  # modes with tip 2
    return 0.75 * (w @ (curv * df) ** 2) / (w @ curv**2), -0.25 * ratio


def frequency_shift(m: pf.Mechanism, amplitude: float) -> float:
    """(omega / omega_0 - 1) / amplitude^2 over five periods of the first mode."""
    found = pf.modes(m, preload="none")
    shape = 0.5 * found.shapes[:, 0]  # a cantilever's modes of unit mass have a tip of 2
    period = 1.0 / found.frequencies[0]
    run = pf.solve(
        m, pf.hold(duration=5.3 * period), "coupled", tol=1e-7, samples=531, asked=["deflection"],
        start=(m.undeformed() + amplitude * shape, 0 * shape),
    )  # fmt: skip
    tip = run.frame("tip").position[:, 1]
    passed = CubicSpline(run.t, tip * np.sign(tip[0])).roots(extrapolate=False)
    passed = passed[1::2]  # those on the way up
    own = np.polyfit(np.arange(len(passed)), passed, 1)[0]
    return float((period / own - 1) / amplitude**2)


def test_the_frequency_of_a_large_vibration_moves_as_in_closed_form(tmp_path: Path) -> None:
    """0.307 - 0.287: up by two hundredths of the square of the tip; without the term, down."""
    curvature, inertia = shifts()
    assert (curvature, inertia) == pytest.approx((0.3067, -0.2873), abs=1e-4)
    amplitude = 0.1
    with_it, without = (
        frequency_shift(beam(tmp_path, f"third_order: {on}"), amplitude) for on in ("true", "false")
    )
    # Terms of higher order: amplitude^2 of each coefficient.
    assert with_it == pytest.approx(curvature + inertia, abs=5e-3)
    assert without == pytest.approx(inertia, abs=5e-3)


def test_the_elastica_is_met_to_the_fifth_power_of_the_load(tmp_path: Path) -> None:
    """A force across the tip, against the exact rod; the third power without the term."""
    loads = np.array([0.3, 0.45, 0.6])  # tip at 0.10 to 0.19
    stiff = 1e8  # the exact rod stretches and shears too: 1e-8 here
    exact = [
        analytical.cosserat_tip(1.0, np.array([0, P, 0]), np.array([stiff, stiff, stiff, 1, 1, 1]))
        for P in loads
    ]
    for on, power in (("true", 5.0), ("false", 3.0)):
        gaps = []
        for P, (place, _) in zip(loads, exact, strict=True):
            head = f"forces: {{load: {{at: tip, force: [0, {float(P)!r}, 0]}}}}"
            basis = "{kind: craig_bampton, internal: 3}"
            m = beam(tmp_path, f"third_order: {on}", head, basis)
            r = pf.solve(m, pf.hold(duration=1.0), "quasistatic", samples=2)
            gaps.append(abs(r.frame("tip").position[0, 1] - place[1]))
        assert slope(loads, gaps) == pytest.approx(power, abs=0.4)


def test_a_beam_that_it_is_not_for_is_refused(tmp_path: Path) -> None:
    for extra, what in (
        ("third_order: true\n    second_order: false", "without second_order"),
        ("third_order: true\n    shear: true", "with shear"),
    ):
        with pytest.raises(pf.DescriptionError, match=rf"beam\.third_order: .*{what}.*segments"):
            beam(tmp_path, extra, basis="{kind: craig_bampton, internal: 1}")
