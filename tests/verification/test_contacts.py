"""Backlash, stops, cables and tables against closed forms and matrix exponentials.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - a gear with backlash; backlash to 0; stiff stops to rigid ones | matrix exponentials between
      flanks | 1e-8; slopes 1 within 0.02 | 6e-13; 1.00
    - a cable that pulls only; all laws of pieces, forces, tangents, energies | parabola and swing;
      the plain reference | 1e-9; 1e-12, tangents 1e-7 | passes
    - bouncing ball, mass between two stops, 1000 bounces without loss, bounces without end, rest on
      a stop | closed forms | 1e-10 of instants, impulses, losses; 1e-11 of the energy | 2e-13
    - blows of an arm on a crank that follows its motion: energy with what the motor puts in |
      conservation; M_cj / M_jj of the impulse | 1e-7 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import pinflex as pf
from pinflex.arrays import Array
from pinflex.errors import DescriptionError
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.studies.checking.check import check
from tests.finite import slope
from tests.scenes import Body, load

MASS, G = 2.0, 9.81
BALL = (Body("ball", "base", "prismatic", axis=(0, 0, 1), mass=MASS),)
JM, JL, K, C, KP, KD, T, END = 0.5, 0.2, 400.0, 0.6, 30.0, 0.8, 1.5, 1.0
DRIVEN = (Body("link", "base", "revolute", mass=1.0, inertia=(JL,) * 3),)


def ball(folder: Path, stops: str, home: float = 1.0, gravity: float = G) -> pf.Mechanism:
    return load(folder, BALL, f"""gravity: [0, 0, {-gravity}]
actuated: []
home: {{ball_joint: {home}}}
joints: {{ball_joint: {{stops: {{{stops}}}}}}}
solve: {{level: coupled}}
""")  # fmt: skip


def test_a_bouncing_ball_bounces_when_and_as_high_as_it_has_to(tmp_path: Path) -> None:
    """t_k = t_0 (1 + 2 (e + ... + e^k)), and each bounce leaves e^2 of the energy."""
    e, h = 0.7, 1.0
    run = pf.solve(ball(tmp_path, f"lower: 0, restitution: {e}"), pf.hold(duration=1.5), tol=1e-6)
    found, fall = run.events, np.sqrt(2 * h / G)
    k = np.arange(len(found))
    times = fall * (1 + 2 * (e * (1 - e**k) / (1 - e)))
    assert len(found) == 2
    # Parabolas are exact in collocation: what is left is the landing, 1e-13 m.
    np.testing.assert_allclose([x.time for x in found], times, rtol=1e-10)
    speed = np.sqrt(2 * G * h) * e**k
    np.testing.assert_allclose([x.impulse for x in found], MASS * (1 + e) * speed, rtol=1e-10)
    lost = 0.5 * MASS * (1 - e**2) * speed**2
    np.testing.assert_allclose([x.loss for x in found], lost, rtol=1e-10)
    stored = run.array("energy/kinetic") + run.array("energy/gravity")
    assert np.ptp(stored + run.array("energy/dissipated")) < 1e-10 * MASS * G * h
    assert np.diff(stored).max() < 1e-10 * MASS * G * h  # never gained


def test_a_mass_between_two_stops_gives_back_what_they_say(tmp_path: Path) -> None:
    """Without gravity the k-th way takes w / (v e^k)."""
    e, v, width = 0.8, 3.0, 0.5
    m = ball(tmp_path, f"lower: -0.2, upper: 0.3, restitution: {e}", home=0.0, gravity=0.0)
    run = pf.solve(m, pf.hold(duration=2.0), tol=1e-6, start_speeds={"ball_joint": v})
    found = run.events
    ways = np.array([0.3, *[width] * (len(found) - 1)]) / (v * e ** np.arange(len(found)))
    assert len(found) == 6
    np.testing.assert_allclose([x.time for x in found], np.cumsum(ways), rtol=1e-10)
    last = 0.5 * MASS * (v * e ** len(found)) ** 2
    assert run.array("energy/kinetic")[-1] == pytest.approx(last, rel=1e-10)


def test_a_thousand_bounces_without_loss_keep_the_energy(tmp_path: Path) -> None:
    m = ball(tmp_path, "lower: 0, upper: 1, restitution: 1", home=0.3)
    run = pf.solve(m, pf.hold(duration=130.0), tol=1e-6, start_speeds={"ball_joint": 8.0})
    assert len(run.events) > 1000
    stored = run.array("energy/kinetic") + run.array("energy/gravity")
    # 1000 landings within 1e-13 m each, times the weight over the energy: 1e-12
    assert np.ptp(stored) < 1e-11 * run.array("energy/kinetic").max()


def test_a_ball_that_gives_nothing_back_stays_where_it_falls(tmp_path: Path) -> None:
    run = pf.solve(ball(tmp_path, "lower: 0, restitution: 0"), pf.hold(duration=1.0), tol=1e-6)
    (met,) = run.events
    assert (met.what, met.time) == ("rest", pytest.approx(np.sqrt(2 / G), rel=1e-12))
    assert met.loss == pytest.approx(met.impulse * met.speed / 2, rel=1e-12)
    # what rests sinks in by 1e-10 of what accelerates it
    assert abs(run.array("joint/q")[-1, 0]) < 2e-10 * G


def test_a_start_beyond_a_rigid_stop_is_refused(tmp_path: Path) -> None:
    m = ball(tmp_path, "lower: 0, restitution: 0.5", home=-1e-3)
    with pytest.raises(pf.SceneError, match="starts 0.001 .* beyond the stop of ball_joint"):
        pf.solve(m, pf.hold(duration=0.1), tol=1e-6)


BAR = (
    Body("crank", "base", "revolute", mass=1.0, com=(0.1, 0, 0), inertia=(0.01,) * 3),
    Body("arm", "crank", "revolute", xyz=(0.2, 0, 0), mass=0.5, com=(0.15, 0, 0),
         inertia=(0.01,) * 3),
)  # fmt: skip


def swept(folder: Path, solve: str) -> pf.Mechanism:
    return load(folder, BAR, f"""gravity: [0, -9.81, 0]
actuated: [crank_joint]
joints: {{arm_joint: {{stops: {{lower: -0.1, upper: 0.1, restitution: 1}}}}}}
motion: {{kind: harmonic, joints: {{crank_joint: 0.5}}, frequency: 3, smooth: 0.1, duration: 1}}
solve: {{{solve}, start: straight}}
""")  # fmt: skip


def test_a_motor_that_moves_on_gives_energy_to_a_blow(tmp_path: Path) -> None:
    """An arm between its stops on a crank that follows its motion: what the blow asks of the motor.

    The crank's speed stays w, that of the arm in its joint turns: with the mass M_jj that the stop
    meets and what couples it to the crank, M_cj, the motor gives M_cj / M_jj of the impulse at w.
    """
    run = pf.solve(swept(tmp_path, "level: coupled"), tol=1e-6, samples=1001)
    assert len(run.events) > 5
    assert run.meta["energy_balance"] < 1e-7
    met, w = run.events[0], run.joint("crank_joint").velocity
    angle = 0.1 if run.joint("arm_joint").position[np.searchsorted(run.t, met.time)] > 0 else -0.1
    m, a, b = 0.5, 0.2, 0.15
    whole, own = 0.01 + m * b * (b + a * np.cos(angle)), 0.01 + m * b**2
    speed = np.interp(met.time, run.t, w)
    stored = run.array("energy/kinetic") + run.array("energy/gravity") - run.array("energy/work")
    assert np.ptp(stored) < 1e-7 * run.array("energy/kinetic").max()
    # Between two samples: what the motor puts in besides is about that of the ms before.
    around = [np.searchsorted(run.t, met.time) + k for k in (-1, 0)]
    jump = np.diff(run.array("energy/work")[around])[0]
    slow = np.diff(run.array("energy/work")[[around[0] - 1, around[0]]])[0]
    exact = -np.sign(angle) * met.impulse * speed * whole / own
    assert jump == pytest.approx(exact, abs=abs(3 * slow))
    assert abs(exact) > 10 * abs(slow)


def test_a_motion_through_a_rigid_stop_is_told_and_fed_forward_without_it(tmp_path: Path) -> None:
    through = ball(tmp_path, "upper: 1.1, restitution: 0.5").with_({"actuated": ["ball_joint"]})
    move = pf.quintic(joints={"ball_joint": 0.3}, duration=0.4)
    rigid = pf.solve(through, move, level="rigid")
    assert any("beyond the stop of ball_joint" in text for text in rigid.meta["warnings"])
    driven = pf.solve(through, move, drive="torque", kp=50.0, kd=5.0, tol=1e-4)
    assert driven.joint("ball_joint").position.max() < 1.1 + 1e-6
    assert np.abs(driven.torque).max() < 100.0  # 4 N of weight and motion, 50 N/m times 0.2 m


def test_bounces_without_end_come_to_rest(tmp_path: Path) -> None:
    """t_0 (1 + e) / (1 - e) is where a ball comes to rest after bounces without number."""
    e = 0.5
    m = ball(tmp_path, f"lower: 0, restitution: {e}")
    run = pf.solve(m, pf.hold(duration=2.0), tol=1e-6)
    rest = np.sqrt(2 / G) * (1 + e) / (1 - e)
    # it ends at a bounce of 1e-6 of the first one's speed, and so much of the time before the end
    assert run.events[-1].what == "rest"
    assert run.events[-1].time == pytest.approx(rest, rel=2e-6)
    held = run.t > rest
    # what holds it gives way by its weight, g / (1e5 rad/s)^2
    np.testing.assert_allclose(run.joint("ball_joint").position[held], 0.0, atol=2e-9)
    stored = run.array("energy/kinetic") + run.array("energy/gravity")
    assert np.diff(stored).max() < 1e-9 * MASS * G  # never gained
    assert run.array("energy/dissipated")[-1] == pytest.approx(MASS * G, rel=1e-9)


def test_a_ball_thrown_from_rest_leaves_its_stop_when_it_is_pulled(tmp_path: Path) -> None:
    """At rest on a stop from the start, pulled by a force that grows beyond its weight at 0.5 s."""
    m = load(tmp_path, BALL, f"""gravity: [0, 0, {-G}]
actuated: []
home: {{ball_joint: 0.0}}
joints: {{ball_joint: {{stops: {{lower: 0, restitution: 0.5}}}}}}
forces: {{pull: {{at: ball, force: [0, 0, {2 * MASS * G}], ramp: 1.0}}}}
solve: {{level: coupled, start: straight}}
""")  # fmt: skip
    run = pf.solve(m, pf.hold(duration=0.9), tol=1e-7, samples=91)
    assert [x.what for x in run.events] == ["rest", "release"]
    # It leaves as the spring that holds it does: 2 / (1e5 rad/s) later at the most.
    assert run.events[1].time == pytest.approx(0.5, abs=5e-5)
    late = np.maximum(run.t - 0.5, 0.0)
    np.testing.assert_allclose(run.joint("ball_joint").position, G * late**3 / 3, atol=1e-6)


def test_stiff_stops_become_rigid_ones(tmp_path: Path) -> None:
    """The ball stays pi sqrt(m/k) (weight apart), so that what differs falls with that."""
    off, stiffness = [], (1e6, 1e8, 1e10)
    rigid = pf.solve(
        ball(tmp_path, "lower: 0, restitution: 1"), pf.hold(duration=1.2), tol=1e-7, samples=25
    )
    for k in stiffness:
        run = pf.solve(
            ball(tmp_path, f"lower: 0, stiffness: {k}"), pf.hold(duration=1.2), tol=1e-7, samples=25
        )
        off.append(np.abs(run.array("joint/q") - rigid.array("joint/q")).max())
    assert slope(np.sqrt(MASS / np.array(stiffness)), off) == pytest.approx(1.0, abs=0.02)


def drive(folder: Path, play: float) -> pf.Mechanism:
    return load(folder, DRIVEN, f"""gravity: [0, 0, 0]
actuated: [link_joint]
joints: {{link_joint: {{drive: {{motor_inertia: {JM}, stiffness: {K}, damping: {C},
                               backlash: {play}}}}}}}
forces: {{push: {{at: link, moment: [0, 0, {T}]}}}}
motion: {{kind: hold, duration: {END}}}
solve: {{level: coupled, drive: torque, start: straight, kp: {KP}, kd: {KD}, until: {END}}}
""")  # fmt: skip


def piece(side: int, play: float) -> Array:
    """Motor and gear, their speeds, and 1: the matrix of one flank, or of the gap (0).

    The motor holds the load's torque forward, so that only the link is pushed.
    """
    inverse, A = np.linalg.inv([[JM + JL, JL], [JL, JL]]), np.zeros((5, 5))
    k, c = (K, C) if side else (0.0, 0.0)
    A[0, 2] = A[1, 3] = 1.0
    A[2:4, :2], A[2:4, 2:4] = -inverse @ np.diag([KP, k]), -inverse @ np.diag([KD, c])
    A[2:4, 4] = inverse @ [0.0, T + 0.5 * play * k * side]
    return A


def by_pieces(play: float, t: Array) -> tuple[Array, list[float]]:
    """Motor and gear (nt, 2) by matrix exponentials, and when flanks are met and left."""
    z, now, side, out = np.eye(5)[4], 0.0, int(play == 0.0), np.zeros((len(t), 2))
    met: list[float] = []
    while True:
        A, border = piece(side, play), 0.5 * play
        step, past = expm(2e-4 * A), 1e-9

        def off(x: float, z: Array = z, A: Array = A, side: int = side) -> float:
            d = (expm(x * A) @ z)[1]
            return float(abs(d) - 0.5 * play if side == 0 else 0.5 * play - side * d)

        ahead, end = expm(past * A) @ z, np.inf
        while play and now + past < t[-1]:
            ahead = step @ ahead
            d = ahead[1]
            if (abs(d) > border) if side == 0 else (side * d < border):
                end = brentq(off, past, past + 2e-4, xtol=1e-15)
                break
            past += 2e-4
        for i in np.flatnonzero((t > now) & (t <= now + end)):
            out[i] = (expm((t[i] - now) * A) @ z)[:2]
        if end == np.inf:
            return out, met
        z, now = expm(end * A) @ z, now + end
        met.append(now)
        side = int(np.sign(z[1])) if side == 0 else 0


def test_a_gear_with_backlash_against_matrix_exponentials(tmp_path: Path) -> None:
    play = 0.02
    run = pf.solve(drive(tmp_path, play), tol=1e-7, samples=101)
    expected, met = by_pieces(play, run.t)
    # steps of order 11 that end at the flanks; the samples are read off them to 1e-9 or so
    np.testing.assert_allclose([x.time for x in run.events], met, rtol=1e-9)
    assert [x.what for x in run.events[:2]] == ["contact", "release"]
    found = np.column_stack([run.joint("link_joint").position, run.drive("link_joint").deflection])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


def test_check_names_what_has_play(tmp_path: Path) -> None:
    text = " ".join(str(check(drive(tmp_path, 0.02))).split())
    assert "the backlash of link_joint acts at level coupled" in text


def test_backlash_vanishes_at_first_order(tmp_path: Path) -> None:
    off, plays = [], (2e-3, 1e-3, 5e-4)
    for play in plays:
        run = pf.solve(drive(tmp_path, play), tol=1e-7, samples=101)
        off.append(np.abs(run.joint("link_joint").position - by_pieces(0.0, run.t)[0][:, 0]).max())
    # shifts by half the play, and once more by the time that the gap takes: of order 3/2
    assert slope(plays, off) == pytest.approx(1.0, abs=0.02)


def test_a_cable_pulls_and_does_not_push(tmp_path: Path) -> None:
    """A mass thrown up below a cable flies a parabola, and swings harmonically where it hangs."""
    k, v = 800.0, 2.0
    m = load(tmp_path, BALL, f"""gravity: [0, 0, {-G}]
actuated: []
springs: {{cable: {{between: [ball, world], at: [0, 0, 1.0], stiffness: {k}, length: 1.0,
                   tension_only: true}}}}
solve: {{level: coupled, start: straight}}
""")  # fmt: skip
    run = pf.solve(m, pf.hold(duration=0.9), tol=1e-7, start_speeds={"ball_joint": v})
    flight, w, sag = 2 * v / G, np.sqrt(k / MASS), MASS * G / k

    def hanging(t: Array) -> Array:
        return np.asarray(sag * (np.cos(w * t) - 1) - v / w * np.sin(w * t))

    back = brentq(hanging, 0.5 * np.pi / w, 1.9 * np.pi / w)
    times = [x.time for x in run.events]
    np.testing.assert_allclose(times, np.cumsum([flight, back, flight])[: len(times)], rtol=1e-9)
    assert len(times) == 2
    t, z = run.t, run.joint("ball_joint").position
    flying = v * t - 0.5 * G * t**2
    again = v * (t - flight - back) - 0.5 * G * (t - flight - back) ** 2
    expected = np.where(t < flight, flying, np.where(t < flight + back, hanging(t - flight), again))
    np.testing.assert_allclose(z, expected, rtol=0, atol=1e-9 * np.ptp(z))
    stored = sum(run.array(f"energy/{x}") for x in ("kinetic", "gravity", "spring"))
    assert np.ptp(stored) < 1e-9 * MASS * v**2


def every_law(folder: Path) -> pf.Mechanism:
    bodies = (
        Body("arm", "base", "revolute", axis=(0, 0.3, 1), mass=1.0, inertia=(0.1,) * 3),
        Body("slide", "arm", "prismatic", (0.4, 0, 0), axis=(1, 0.2, 0), mass=0.5,
             inertia=(0.02, 0.03, 0.04)),
        Body("tip", "slide", "continuous", (0.2, 0.1, 0), axis=(0, 1, 0), mass=0.3,
             inertia=(0.01, 0.01, 0.02)),
    )  # fmt: skip
    return load(folder, bodies, """
actuated: [arm_joint]
joints:
  arm_joint: {drive: {stiffness: 300, damping: 2, motor_inertia: 0.1, backlash: 0.2}}
  slide_joint: {stops: {lower: -0.1, upper: 0.2, stiffness: 5000, damping: 7}}
  tip_joint: {table: [[-0.5, -4], [0.1, 0], [0.2, 3], [0.4, 12]]}
springs:
  cable: {between: [tip, world], at: [0.7, 0.3, 0.6], stiffness: 900, damper: 5, length: 0.55,
          tension_only: true}
  rubber: {between: [base, slide], length: 0.3, damper: 3,
           table: [[-0.1, -30], [0.1, 5], [0.2, 90]]}
flexible: {slide: {material: steel, section: {shape: circle, diameter: 0.01}, end: tip}}
""")  # fmt: skip


def test_kernel_and_reference_have_the_same_laws(tmp_path: Path) -> None:
    """Forces, tangents, energies and losses of random states, on all pieces; round-off."""
    m = every_law(tmp_path)
    d, rng = Equations(m.flexible, marched=True), np.random.default_rng(7)
    assert d.on_kernel
    system, n = m.flexible, 40
    Y = np.array([system.integrate(m.undeformed(), x)
                  for x in rng.uniform(-0.3, 0.3, (n, system.nv))])  # fmt: skip
    V, A = rng.normal(size=(2, n, system.nv))
    for k in system.kinks.of_coordinates:  # all pieces are met
        assert set(system.kinks.piece(k, system.kinks.position(k, Y))) == set(
            range(len(system.kinks.rows[k].pieces))
        )
    lam, t = np.zeros((n, 0)), np.zeros(n)
    assert d.compiled is not None
    found, expected = d.compiled.residual(Y, V, A, lam, t)[0], d.reference.forces(Y, V, A, t)
    size = np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * size)
    for own, plain in zip(d.compiled.energies(Y, V, t), d.reference.energies(Y, V, t), strict=True):
        np.testing.assert_allclose(own, plain, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(d.losses(Y, V), d.reference.losses(Y, V), rtol=1e-10)
    for k in range(8):
        here = Y[k], V[k], A[k], lam[k], 0.0
        for own, plain in zip(d.compiled.tangent(*here), d.reference.tangent(*here), strict=True):
            # those of the reference are differences of fourth order, of forces of 1e3
            size = max(np.abs(plain).max(initial=0), 1)
            np.testing.assert_allclose(own, plain, rtol=0, atol=1e-7 * size)


def test_forces_of_laws_are_slopes_of_their_energies(tmp_path: Path) -> None:
    """Central differences of (1e-5)^2, but for a step across a bend: none of these states is."""
    m = every_law(tmp_path)
    kinks = m.flexible.kinks
    for k, row in enumerate(kinks.rows):
        x = np.linspace(-0.613, 0.617, 41)
        e = [kinks.pull(k, x + h, 0.0).energy for h in (-1e-5, 1e-5)]
        found = kinks.pull(k, x, 0.0)
        scale = np.abs(found.force).max()
        np.testing.assert_allclose((e[1] - e[0]) / 2e-5, found.force, atol=1e-6 * scale)
        assert row.name


@pytest.mark.parametrize(
    ("joint", "said"),
    [
        ("stops: {lower: 0}", "a stop is a spring"),
        ("stops: {lower: 0, stiffness: 1, restitution: 1}", "Give one of the two"),
        ("stops: {stiffness: 1}", "no stop"),
        ("stops: {lower: 1, upper: 0, stiffness: 1}", "Exchange them"),
        ("stops: {lower: 0, restitution: 0.5, damping: 1}", "a rigid stop has none"),
        ("stops: {lower: 0, restitution: 1.5}", "out of range"),
        ("table: [[0, 1]]", "one point is no table"),
        ("table: [[0, 1], [0, 2]]", "does not follow"),
        ("drive: {backlash: 0.1 deg}", "no stiffness"),
    ],
)
def test_what_makes_no_law_is_refused(joint: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=said):
        load(tmp_path, BALL, f"actuated: []\njoints: {{ball_joint: {{{joint}}}}}\n")


def test_equal_steps_say_that_they_pass_over_contacts(tmp_path: Path) -> None:
    """Of first order in the instants of contact: 1e-4 s of speeds of 0.5 rad/s."""
    m = drive(tmp_path, 0.02)
    run = pf.solve(m, dt=1e-4, samples=101)
    assert "do not end at contacts" in run.meta["warnings"][-1]
    found = run.joint("link_joint").position
    np.testing.assert_allclose(found, by_pieces(0.02, run.t)[0][:, 0], rtol=0, atol=5e-5)


def test_steps_that_do_not_end_at_contacts_are_refused_for_rigid_stops(tmp_path: Path) -> None:
    m = ball(tmp_path, "lower: 0, restitution: 1")
    for equal in ({"dt": 1e-3}, {"tol": 1e-3, "integrator": "hht"}):
        with pytest.raises(DescriptionError, match="Give `tol` alone"):
            pf.solve(m, pf.hold(duration=0.6), **equal)
    with pytest.raises(DescriptionError, match="level ked is linear"):
        pf.solve(m, pf.hold(duration=0.6), level="ked")
