"""Feedback and patches: constants, laws, effect on models, and what is refused.

Claims:
    Machines
    - piezo constant 4.8384e-4 N m/V | eq. 32 | 1e-5 | passes
"""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.description.blocks.flexible import piezo_constant

BEAM = ["flexible.beam.basis={kind: assumed, boundary: free_free, modes: 8}"]
PATCH = "flexible.beam.patches={pzt: {from: 0.115, to: 0.145, constant: 5e-4}}"
HOLD = "motion={kind: hold, duration: 0.5}"


def robot(*changes: str) -> pf.Mechanism:
    return pf.load("prprp", [*BEAM, HOLD, *changes])


def test_the_published_constant_of_a_patch() -> None:
    k = piezo_constant(-270e-12, 63e9, 0.025, 0.25e-3, 200e9, 0.03, 1.2e-3)
    assert k == pytest.approx(4.8384e-4, rel=1e-5)  # scenes 7, row 26


def test_a_constant_voltage_bends_a_beam_by_two_opposite_moments() -> None:
    # Between the ends of the patch the moment k V, nothing outside: a tip that turns by k V l / EI.
    patch = "flexible.beam.patches={pzt: {from: 0.3, to: 0.5, constant: 0.01}}"
    still = ("gravity=[0,0,0]", "motion={kind: hold, duration: 1}")
    m = pf.load("cantilever", [*still, "flexible.beam.damping={modal: 1.0}", patch])
    part = m.parts["beam"]
    EI = part.spec.material.E * part.spec.section.Iz
    volts = 1e-3 * EI / 0.01 / 0.2  # a milliradian
    control = pf.Control((), (pf.Voltage("pzt"),), lambda t, m, dm, im: np.array([volts]))
    r = pf.solve(m, control=control, until=6.0, dt=5e-3, samples=601)
    deflection = r.arrays["link/beam/deflection"][-1]
    assert r.arrays["control/pzt"] == pytest.approx(volts)
    # Static shapes of a beam with both end shapes hold it to the fourth polynomial moment: 5 %.
    assert deflection[-1, 5] == pytest.approx(1e-3, rel=0.05)


def test_pid_terms_act_as_written() -> None:
    law = pf.pid(kp=2.0, ki=3.0, kd=5.0, target=0.1)
    m, rate, total = np.array([0.4]), np.array([-1.0]), np.array([0.7])
    assert law(2.0, m, rate, total)[0] == pytest.approx(2 * 0.3 + 3 * (0.7 - 0.2) - 5.0)


def damped_by(gain: float) -> tuple[float, float]:
    """Swing of the tip in the last 0.16 s (m) with speed feedback, and the energy error."""
    law = pf.pid(kd=gain)
    control = pf.Control((pf.Deflection("beam", 0.13),), (pf.Voltage("pzt"),), law)
    r = pf.solve(robot(PATCH), control=control, until=0.5, dt=1e-3, samples=251)
    return float(np.ptp(r.link("beam").deflection[-80:, -1, 1])), float(r.meta["energy_balance"])


def test_speed_feedback_to_a_patch_damps_and_its_reverse_excites() -> None:
    free = pf.solve(robot(PATCH), until=0.5, dt=1e-3, samples=251)
    still = float(np.ptp(free.link("beam").deflection[-80:, -1, 1]))
    # The patch sits in front of the sleeve, where the first mode, mostly overhang, hardly moves.
    assert damped_by(2000.0)[0] < 0.9 * still
    assert damped_by(-100.0)[0] > 1.005 * still


def test_the_work_of_a_control_closes_the_balance_of_energy() -> None:
    # 6e-5 at this step, of second order in it: the trapezoidal rule for the work of fast modes.
    assert damped_by(500.0)[1] < 1e-4


def test_any_function_can_be_the_law() -> None:
    seen: list[float] = []

    def law(t: float, m: Array, rate: Array, total: Array) -> Array:
        seen.append(t)
        return np.array([np.tanh(1e3 * m[0]) if t > 0.1 else 0.0])

    control = pf.Control((pf.Deflection("beam", 0.5),), (pf.Effort("hinge"),), law)
    r = pf.solve(robot(), control=control, until=0.2, dt=1e-3, samples=201)
    u = r.arrays["control/hinge"]
    assert np.all(u[r.t <= 0.1] == 0.0)
    np.testing.assert_allclose(
        u[r.t > 0.101], np.tanh(1e3 * r.arrays["measured"][r.t > 0.101, 0]), atol=1e-12
    )
    assert max(seen) == pytest.approx(0.2)


def test_a_pd_on_a_motor_drives_a_pendulum_to_its_target() -> None:
    changes = ["gravity=[0,0,0]", "motion={kind: hold, duration: 2}", "solve.drive=torque"]
    m = pf.load("spinning_beam", changes)
    law = pf.pid(kp=-4000.0, kd=-1500.0, target=0.1)
    control = pf.Control((pf.Travel("hub"),), (pf.Effort("hub"),), law)
    r = pf.solve(m, control=control, until=10.0, dt=5e-3, samples=201)
    q = r.joint("hub").position[-1]
    assert np.arctan2(q[1], q[0]) == pytest.approx(0.1, abs=1e-3)


def test_the_integral_is_that_of_what_was_measured() -> None:
    control = pf.Control((pf.Deflection("beam", 0.5),), (pf.Voltage("pzt"),), pf.pid(ki=1.0))
    r = pf.solve(robot(PATCH), control=control, until=0.2, dt=1e-3, samples=201)
    m = r.arrays["measured"][:, 0]
    total = np.concatenate([[0.0], np.cumsum(0.5e-3 * (m[1:] + m[:-1]))])
    np.testing.assert_allclose(r.arrays["control/pzt"], total, atol=1e-12)


WRONG = (
    ("flexible.beam.patches={pzt: {from: 0.4, to: 0.6, constant: 1}}", "0.4 to 0.6 m, the beam"),
    ("flexible.beam.patches={pzt: {from: 0.3, to: 0.2, constant: 1}}", "Give 0 <= from < to"),
    ("flexible.beam.patches={pzt: {from: 0.3, to: 0.4}}", "missing"),
    ("flexible.beam.patches={pzt: {from: 0.3, to: 0.4, constant: 1, E: 1}}", "Give one"),
    ("control={a: {measure: {joint: hinge}, drive: {joint: hinge}}}", "it does nothing"),
    ("control={a: {measure: {joint: hinge}, drive: {}, kp: 1}}", "name one drive"),
)


@pytest.mark.parametrize(("change", "text"), WRONG)
def test_a_wrong_description_is_refused(change: str, text: str) -> None:
    with pytest.raises(pf.DescriptionError, match=text):
        robot(change)


PLACES = (
    ("{measure: {link: beam, at: 0.7}, drive: {joint: hinge}, kp: 1}", "x = 0.7 m is not on"),
    ("{measure: {link: tip, at: 0.1}, drive: {joint: hinge}, kp: 1}", "no such flexible link"),
    ("{measure: {joint: hinge}, drive: {patch: pz}, kp: 1}", "no patch pz"),
    ("{measure: {joint: hinge}, drive: {joint: slide_1}, kp: 1}", "follows the motion"),
    ("{measure: {link: beam, at: 0.1, direction: z}, drive: {joint: hinge}, kp: 1}", "along z"),
)


@pytest.mark.parametrize(("loop", "text"), PLACES)
def test_a_control_of_something_that_is_not_there_is_refused(loop: str, text: str) -> None:
    with pytest.raises(pf.DescriptionError, match=text):
        pf.solve(robot(f"control={{a: {loop}}}"), until=0.1, dt=1e-3)


def test_a_control_needs_the_coupled_level() -> None:
    control = pf.Control((pf.Travel("hinge"),), (pf.Effort("hinge"),), pf.pid(1.0))
    with pytest.raises(pf.DescriptionError, match="level coupled only"):
        pf.solve(robot(), level="rigid", control=control)


def test_a_law_of_the_wrong_shape_is_refused() -> None:
    control = pf.Control((), (pf.Effort("hinge"),), lambda t, m, dm, im: np.zeros(3))
    with pytest.raises(pf.DescriptionError, match="3"):
        pf.solve(robot(), control=control, until=0.1, dt=1e-3)
