"""Pins with clearance: Hertz's blow, restitution by another integrator, the ideal joint.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - a pin's and a ball's blow: duration, depth, restitution (Flores; Lankarani and Nikravesh;
      rigid) | Hertz's integral; DOP853; Newton | 1e-6; rigid 1e-8 | 2e-7
    - slider-crank with clearance in its guide, rigid, 0.1 s | Flores, Leine, Glocker (2010), by two
      time-stepping schemes | 1e-3 turns; 2e-6 up to 20 ms | 3.3e-4; 7e-7
    - the bar of a model with friction in a pin, over what 1/64 of its smoothing speed changes | the
      bar of bars | 0.5 to 10 | 1.1
    - a pin with friction that turns in its hole; the angle at which one leans, with breakaway |
      DOP853; closed form | 1e-6; 1e-5 | passes
    - contacts of every shape, kernel and reference; tangents | plain twin; differences | 1e-12;
      3e-6 | passes
    - a pendulum on a loose pin, as loop and as joint of the tree; the 3-RRR with three loose pins,
      flexible and rigid | the ideal joint; energy; Parseval | order 1 within 0.2; 1e-5, rigid 5e-5
      | 3e-6; 1.1e-5
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq, minimize_scalar

import pinflex as pf
from pinflex.errors import DescriptionError
from pinflex.mechanics.evaluation.equations import Equations
from tests.finite import slope
from tests.scenes import Body, load

MASS, GAP, PIN, SPEED = 0.3, 2e-4, 0.01, 0.5
E, NU = 2.1e11, 0.3  # steel
# A body that moves in a plane, with a pin in a hole of the ground.
FLYING = (
    Body("hole", "base"),
    Body("x", "base", "prismatic", axis=(1, 0, 0), mass=1e-9),
    Body("pin", "x", "prismatic", axis=(0, 1, 0), mass=MASS),
)
K = 4 / (3 * 2 * (1 - NU**2) / E) * np.sqrt(PIN / 2 * (PIN / 2 + GAP) / GAP)


def flying(folder: Path, contact: str, kind: str = "planar") -> pf.Mechanism:
    return load(folder, FLYING, f"""gravity: [0, 0, 0]
actuated: []
loops: {{joint: {{kind: {kind}, between: [hole, pin], clearance: {GAP}, pin: {PIN}, {contact}}}}}
solve: {{level: coupled, start: straight}}
""")  # fmt: skip


def thrown(folder: Path, contact: str, until: float, kind: str = "planar") -> pf.Result:
    """The pin leaves the middle at 3 : 4, so that both axes are met."""
    speeds = {"x_joint": 0.6 * SPEED, "pin_joint": 0.8 * SPEED}
    return pf.solve(
        flying(folder, contact, kind), pf.hold(duration=until), tol=1e-8, start_speeds=speeds
    )


@pytest.mark.parametrize("kind", ["planar", "spherical"])
def test_an_elastic_blow_lasts_as_hertz_says(kind: str, tmp_path: Path) -> None:
    """x_max = (5 m v^2 / 4 K)^(2/5), for 2 x_max / v times the integral of (1 - u^(5/2))^(-1/2)."""
    run = thrown(tmp_path, "restitution: 1", 2.5 * GAP / SPEED, kind)
    met = run.events
    deep = (5 * MASS * SPEED**2 / (4 * K)) ** 0.4
    lasts = 2 * deep / SPEED * quad(lambda u: (1 - u**2.5) ** -0.5, 0, 1, epsabs=1e-12)[0]
    assert [x.what for x in met[:2]] == ["contact", "release"]
    assert met[0].time == pytest.approx(GAP / SPEED, rel=1e-9)
    # x^(3/2) begins with an infinite second derivative, so that steps lose order there.
    assert met[1].time - met[0].time == pytest.approx(lasts, rel=1e-6)
    assert met[1].speed == pytest.approx(SPEED, rel=1e-6)
    stored = run.array("energy/kinetic") + run.array("energy/spring")
    assert np.ptp(stored) < 1e-6 * stored[0]
    orbit = run.array("loop/joint/orbit")
    assert np.abs(np.cross(orbit, [0.6, 0.8, 0.0])).max() < 1e-8 * GAP  # x slides with 1e-9 kg more
    assert np.linalg.norm(orbit, axis=1).max() == pytest.approx(GAP + deep, rel=1e-3)  # of samples


@pytest.mark.parametrize(
    ("contact", "chi"),
    [("flores", 8 * 0.2 / (5 * 0.8)), ("lankarani_nikravesh", 0.75 * (1 - 0.8**2))],
)
def test_blows_are_damped_as_published(contact: str, chi: float, tmp_path: Path) -> None:
    """One blow of F = K x^1.5 (1 + chi x'/v_0) by DOP853."""
    e, c = 0.8, chi

    def rates(_: float, s: list[float]) -> list[float]:
        x, v = max(s[0], 0.0), s[1]
        return [v, -K * x**1.5 * (1 + c * v / SPEED) / MASS]

    def out(_: float, s: list[float]) -> float:
        return s[0]

    out.terminal, out.direction = True, -1  # type: ignore[attr-defined]
    blow = solve_ivp(rates, (0, 1e-2), [0, SPEED], "DOP853", events=out, rtol=1e-11, atol=1e-18)
    run = thrown(tmp_path, f"contact: {contact}, restitution: {e}", 2.5 * GAP / SPEED)
    met = run.events
    assert met[1].speed == pytest.approx(-blow.y_events[0][0][1], rel=1e-6)
    assert met[1].time - met[0].time == pytest.approx(blow.t_events[0][0], rel=1e-6)
    lost = 0.5 * MASS * (SPEED**2 - met[1].speed ** 2)
    # to the order that the quadrature of steps has over x^(3/2)
    assert run.array("energy/dissipated")[-1] == pytest.approx(lost, rel=1e-6)
    assert abs(met[1].speed / SPEED - e) < 0.05  # which is what the laws are made for, about


def test_a_rigid_blow_gives_back_what_it_says(tmp_path: Path) -> None:
    """The same pin in the limit of stiff bodies: e of the speed, at once."""
    run = thrown(tmp_path, "contact: rigid, restitution: 0.8", 2.5 * GAP / SPEED)
    blow = run.events[0]
    assert (blow.what, blow.time) == ("bounce", pytest.approx(GAP / SPEED, rel=1e-9))
    # x slides with 1e-9 kg more than y
    assert blow.impulse == pytest.approx(1.8 * MASS * SPEED, rel=1e-8)
    assert blow.loss == pytest.approx(0.5 * MASS * SPEED**2 * (1 - 0.8**2), rel=1e-8)
    assert np.linalg.norm(run.array("joint/v")[-1]) == pytest.approx(0.8 * SPEED, rel=1e-8)


def test_a_pendulum_on_a_loose_pin_swings_as_one_on_an_ideal_one(tmp_path: Path) -> None:
    """It is off by the clearance, whatever the pin does in its hole: first order."""
    bodies = (
        Body("hole", "base"),
        Body("bob", "base", "planar", mass=1.0, inertia=(0.02,) * 3),
        Body("pin", "bob", xyz=(-0.4, 0, 0)),
    )
    ideal = """gravity: [0, -9.81, 0]
actuated: []
home: {bob_joint: [0.4, 0, 0]}
loops: {joint: {kind: planar, between: [hole, pin]}}
solve: {level: coupled, start: straight}
"""
    exact = pf.solve(load(tmp_path, bodies, ideal), pf.hold(duration=0.4), tol=1e-6, samples=81)
    off, gaps = [], (4e-4, 2e-4, 1e-4)
    for gap in gaps:
        yaml = ideal.replace("[hole, pin]", f"[hole, pin], clearance: {gap}, pin: 0.01, "
                             "restitution: 0.5, contact: lankarani_nikravesh")  # fmt: skip
        run = pf.solve(load(tmp_path, bodies, yaml), pf.hold(duration=0.4), tol=1e-3, samples=81)
        assert run.meta["energy_balance"] < 1e-5
        found = run.array("joint/q")[:, :2] - exact.array("joint/q")[:, :2]
        off.append(np.abs(found).max())
    assert np.all(np.array(off) < 4 * np.array(gaps))
    # Blows differ from run to run: the slope is one of sizes, not of a smooth function.
    assert slope(gaps, off) == pytest.approx(1.0, abs=0.2)


# Flores, Leine, Glocker, Multibody System Dynamics 23 (2010) 165: a slider-crank of 150 rad/s whose
# slider has 1 mm to each side in its guide.
CRANK, ROD = 0.153, 0.306
SLIDER_CRANK = (
    Body("crank", "base", "revolute", mass=0.038, com=(CRANK / 2, 0, 0), inertia=(7.4e-5,) * 3),
    Body("rod", "crank", "revolute", (CRANK, 0, 0), mass=0.038, com=(ROD / 2, 0, 0),
         inertia=(5.9e-4,) * 3),
    Body("slider", "rod", "revolute", (ROD, 0, 0), mass=0.076, inertia=(2.7e-6,) * 3),
)  # fmt: skip


def test_a_slider_with_clearance_in_its_guide_as_published(tmp_path: Path) -> None:
    """Turns of the crank by two time-stepping schemes, which agree to 2e-5 (1e-3 asked for)."""
    m = load(
        tmp_path,
        SLIDER_CRANK,
        """gravity: [0, -9.81, 0]
actuated: []
loops: {guide: {kind: prismatic, between: [base, slider], axis: [1, 0, 0], across: [0, 1, 0],
                clearance: 1 mm, length: 0.1, height: 0.05, restitution: 0.4}}
solve: {level: coupled, start: straight}
""",
    )
    speeds = {"crank_joint": 150.0, "rod_joint": -225.0, "slider_joint": 75.0}
    run = pf.solve(m, pf.hold(duration=0.1), tol=1e-4, samples=101, start_speeds=speeds)
    turns = run.joint("crank_joint").position[[2, 5, 10, 20, 40, 60, 80, 100]] / (2 * np.pi)
    published = (0.043894, 0.091702, 0.150936, 0.256959, 0.627205, 0.869374, 1.168974, 1.439418)
    np.testing.assert_allclose(turns, published, rtol=0, atol=1e-3)
    np.testing.assert_allclose(turns[:4], published[:4], rtol=0, atol=2e-6)  # before errors add up
    assert {x.what for x in run.events} == {"bounce", "rest", "release"}
    stored = run.array("energy/kinetic") + run.array("energy/gravity")
    # As far as steps resolve how contacts sink in: tol of the energy.
    assert np.diff(stored).max() < 1e-4 * stored[0]
    reached = np.abs(run.array("loop/guide/orbit")[:, 0]).max()
    assert 0.9e-3 < reached < 1e-3 + 1e-6


def test_friction_of_a_pin_that_turns_in_its_hole(tmp_path: Path) -> None:
    """A wheel whose pin lies in its hole and turns: it climbs and slows down, by DOP853."""
    mass, inertia, mu, radius, g, spin, end = 0.3, 2e-4, 0.3, PIN / 2, 9.81, 60.0, 0.02
    chi, slow = 8 * 0.5 / (5 * 0.5), 1e-3
    deep = (mass * g / K) ** (2 / 3)
    bodies = (
        Body("hole", "base"),
        Body("wheel", "base", "planar", mass=mass, inertia=(inertia,) * 3),
    )
    m = load(tmp_path, bodies, f"""gravity: [0, -{g}, 0]
actuated: []
loops: {{pin: {{kind: planar, between: [hole, wheel], clearance: {GAP}, pin: {PIN}, friction: {mu},
               restitution: 0.5}}}}
solve: {{level: coupled, start: straight}}
""")  # fmt: skip
    y, v = m.undeformed(), np.array([0.0, 0.0, spin])
    y[1] = -GAP - deep

    def rates(_: float, s: list[float]) -> list[float]:
        x, y, _, u, w, turn = s
        off = np.hypot(x, y)
        n, x_in = np.array([x, y]) / off, off - GAP
        rate = n @ [u, w]
        slip = np.array([u, w]) - rate * n + turn * radius * np.array([-n[1], n[0]])
        # it lies in its hole from the start: no speed of entry, and no damping by it
        force = K * max(x_in, 0.0) ** 1.5
        rub = -mu * force * np.tanh(np.hypot(*slip) / slow) * slip / np.hypot(*slip)
        a = (rub - force * n) / mass - [0, g]
        return [u, w, turn, *a, radius * (n[0] * rub[1] - n[1] * rub[0]) / inertia]

    assert chi > 0
    run = pf.solve(m, pf.hold(duration=end), tol=1e-6, start=(y, v), samples=41)
    other = solve_ivp(rates, (0, end), [0, y[1], 0, 0, 0, spin], "DOP853", t_eval=run.t,
                      rtol=1e-10, atol=1e-16)  # fmt: skip
    assert not run.events
    found = run.array("joint/q")[:, :2]
    np.testing.assert_allclose(found, other.y[:2].T, rtol=0, atol=1e-5 * GAP)
    turning = run.array("joint/v")[:, 2]
    np.testing.assert_allclose(turning, other.y[5], rtol=1e-6)
    stored = run.array("energy/kinetic") + run.array("energy/gravity") + run.array("energy/spring")
    balance = stored + run.array("energy/dissipated")
    assert np.ptp(balance) < 1e-5 * stored[0]
    wrench = run.array("loop/pin/wrench")
    np.testing.assert_allclose(wrench[1:, 5], np.gradient(turning, run.t)[1:] * inertia, rtol=0.05)


@pytest.mark.parametrize("part", [0.3, 1.0, 4.0])
def test_a_pin_that_turns_lies_where_its_friction_leans(part: float, tmp_path: Path) -> None:
    """A heavy wheel turns steadily: its pin leans to tan a = mu(v), which is breakaway at most.

    Where N = m g cos a and m g sin a balance, the moment on it is mu N r. At speeds below, at and
    beyond the one of most friction, which is looked for here by itself.
    """
    mass, inertia, g, sliding, most, falls, slow = 0.3, 1e2, 9.81, 0.2, 0.35, 0.02, 1e-3

    def mu(v: float, more: float) -> float:
        return float((sliding + more * np.exp(-((v / falls) ** 2))) * np.tanh(v / slow))

    def top(more: float) -> Any:
        return minimize_scalar(lambda v: -mu(v, more), bounds=(0.0, falls), method="bounded",
                               options={"xatol": 1e-12})  # fmt: skip

    more = brentq(lambda e: -top(e).fun - most, 0.01, 1.0, xtol=1e-14)
    speed = part * float(top(more).x)
    found = mu(speed, more)
    if part == 1.0:
        assert found == pytest.approx(most, rel=1e-12)
    lean = np.arctan(found)
    deep = (mass * g * np.cos(lean) / K) ** (2 / 3)
    bodies = (
        Body("hole", "base"),
        Body("wheel", "base", "planar", mass=mass, inertia=(inertia,) * 3),
    )
    m = load(tmp_path, bodies, f"""gravity: [0, -{g}, 0]
actuated: []
loops: {{pin: {{kind: planar, between: [hole, wheel], clearance: {GAP}, pin: {PIN},
               friction: {{coulomb: {sliding}, breakaway: {most}, stribeck: {falls},
                          speed: {slow}}}}}}}
solve: {{level: coupled, start: straight}}
""")  # fmt: skip
    y, v = m.undeformed(), np.array([0.0, 0.0, speed / (PIN / 2)])
    y[:2] = -(GAP + deep) * np.array([np.sin(lean), np.cos(lean)])
    run = pf.solve(m, pf.hold(duration=2e-3), tol=1e-6, start=(y, v), samples=5)
    # 1e-7 of the slip is what the slope of the smoothed law makes of round-off in the start.
    assert np.abs(run.array("joint/q")[:, :2] - y[:2]).max() < 1e-6 * GAP
    held = -found * mass * g * np.cos(lean) * PIN / 2
    np.testing.assert_allclose(run.array("loop/pin/wrench")[:, 5], held, rtol=1e-5)


def every_contact(folder: Path) -> pf.Mechanism:
    bodies = (
        Body("arm", "base", "revolute", axis=(0, 0.3, 1), mass=1.0, inertia=(0.1,) * 3),
        Body("hand", "arm", "floating", (0.4, 0, 0), mass=0.5, inertia=(0.02, 0.03, 0.04)),
        Body("tip", "hand", "continuous", (0.2, 0.1, 0), axis=(0, 1, 0), mass=0.3,
             inertia=(0.01, 0.01, 0.02)),
        Body("grip", "arm", xyz=(0.4, 0, 0)),
    )  # fmt: skip
    return load(folder, bodies, """
actuated: [arm_joint]
loops:
  socket: {kind: spherical, between: [grip, hand], clearance: 1 mm, pin: 20 mm, friction: 0.2}
  hinge: {kind: revolute, between: [grip, hand], clearance: 2 mm, pin: 10 mm, axial: 1 mm,
          friction: {coulomb: 0.3, breakaway: 0.4, stribeck: 0.02, speed: 0.002}}
  guide: {kind: prismatic, between: [grip, hand], axis: [1, 0, 0], across: [0, 0, 1],
          clearance: 3 mm, length: 0.1, height: 0.02}
""")  # fmt: skip


def test_kernel_and_reference_have_the_same_contacts(tmp_path: Path) -> None:
    """Forces, tangents, energies and losses of states that touch everywhere; round-off."""
    m = every_contact(tmp_path)
    system, rng, n = m.loose, np.random.default_rng(3), 30
    d = Equations(system, marched=True)
    assert d.on_kernel and len(system.loads.touches) == 8
    rows = system.closed.n
    Y = np.array([system.integrate(m.undeformed(), x)
                  for x in rng.uniform(-0.02, 0.02, (n, system.nv))])  # fmt: skip
    V, A = 0.01 * rng.normal(size=(2, n, system.nv))
    lam, t = rng.normal(size=(n, rows)), np.zeros(n)
    assert d.compiled is not None
    beyond = d.compiled.elongations(Y) > 0.0
    assert beyond.any(axis=0).all() and not beyond.all()
    found, expected = d.compiled.residual(Y, V, A, lam, t)[0], d.reference.forces(Y, V, A, t)
    expected = expected - (lam[:, None] @ d.reference.close(Y).J)[:, 0]
    size = np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * size)
    for own, plain in zip(d.compiled.energies(Y, V, t), d.reference.energies(Y, V, t), strict=True):
        np.testing.assert_allclose(own, plain, rtol=1e-9, atol=1e-10 * np.abs(plain).max())
    np.testing.assert_allclose(d.losses(Y, V), d.reference.losses(Y, V), rtol=1e-10)
    for k in range(8):  # at rest: Newton goes without what the turning of bodies does to rates
        y, v, fixed = Y[k], 0.0 * V[k], (A[k : k + 1], lam[k : k + 1], t[:1])
        _, C, stiff, _ = d.compiled.tangent(y, v, A[k], lam[k], 0.0)
        for own, h in ((C, 1e-8), (stiff, 1e-9)):
            for i, e in enumerate(h * np.eye(system.nv)):
                moves = (y, v + e) if own is C else (system.integrate(y, e), v)
                back = (y, v - e) if own is C else (system.integrate(y, -e), v)
                ahead, behind = (
                    d.compiled.residual(state[None], speed[None], *fixed)[0][0]
                    for state, speed in (moves, back)
                )
                # of 1e-16 over 1e-9, and of the friction's bend over 1e-4 of its speed
                most = np.abs(own).max()
                slopes = (ahead - behind) / (2 * h)
                np.testing.assert_allclose(own[:, i], slopes, rtol=0, atol=3e-6 * most)


@pytest.mark.parametrize("links", ["flexible", "rigid"])
def test_three_rrr_with_three_loose_pins(links: str) -> None:
    """Energy is kept account of over 150 blows; a single history is told to mean little."""
    pins = ["joints.pin_1={clearance: 5e-5, pin: 0.005}"]
    pins += [f"loops.pin_{k}.{key}" for k in (2, 3) for key in ("clearance=5e-5", "pin=0.005")]
    changes = ["solve.level=coupled", *(["flexible={}"] if links == "rigid" else [])]
    run = pf.solve(pf.load("3rrr", [*changes, *pins]), tol=1e-3, until=0.05, start="straight")
    assert len({event.name for event in run.events}) == 3
    assert len(run.events) > 100
    # Steps are resolved to 0.3 tol, in displacements; blows of rigid links are the sharper ones.
    assert run.meta["energy_balance"] < (5e-5 if links == "rigid" else 1e-5)
    for name in ("pin_1", "pin_2", "pin_3"):
        reached = np.linalg.norm(run.array(f"loop/{name}/orbit"), axis=1)
        assert 5e-5 < reached.max() < 5.3e-5  # the rim, and a little into it
    ideal = pf.solve(pf.load("3rrr", changes), tol=1e-3, until=0.05)
    peak = np.abs(run.torque).max()
    assert peak > np.abs(ideal.torque).max()
    said = next(text for text in run.meta["warnings"] if "single history" in text)
    when = float(said.split("at t = ")[1].split(" s,")[0])
    assert when < 0.01 and "two runs up to" in run.meta["settings"]["judged"]
    motor = run.statistics["motor_1"]
    # Two starts whose speeds differ by 1e-9 part, and no sooner than within some blows.
    assert motor.parted is not None and 1e-3 < motor.parted < 0.02
    assert motor.runs == 3
    assert abs(motor.peak - np.abs(run.torque[:, 0]).max()) < 2 * motor.spread[1]  # of three
    # Parseval: octaves and the mean make up the rms.
    octaves = np.sqrt(np.sum(np.square(motor.levels)))
    assert octaves < motor.rms + 3 * motor.spread[0]
    assert np.hypot(octaves, np.abs(run.torque[:, 0].mean())) > 0.9 * motor.rms


def test_the_bar_of_a_model_tells_what_smooth_friction_leaves_out() -> None:
    """Rigid 3-RRR up to its first blows, beside 1/64 of the speed below which a pin rubs smoothly.

    What is left out falls about with that speed: twice the change by half of it tells it, to the
    factor that error bars are held to (tests.benchmarks.bars: 0.5 to 10).
    """

    def solve(speed: float) -> pf.Result:
        law = f"{{coulomb: 0.3, speed: {speed}}}"
        keys = ("clearance=50 um", "pin=5 mm", f"friction={law}")
        changes = ["solve.level=coupled", "flexible={}", *(f"loops.pin_2.{key}" for key in keys)]
        return pf.solve(pf.load("3rrr", changes), tol=1e-3, until=0.003, samples=41)

    run, sharp = solve(0.02), solve(0.02 / 64)
    apart = np.abs(run.torque - sharp.torque).max() / np.abs(sharp.torque).max()
    assert apart > 1e-3  # the bar is about something
    assert 0.5 * apart < run.errors.model["torque"] < 10 * apart
    assert "half the speed that smooths friction" in run.errors.model_note


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("kind: planar, clearance: 50 um", "of which pin"),
        ("kind: planar, pin: 5 mm", "the joint is ideal"),
        ("kind: planar, clearance: 50 um, pin: 5 mm, contact: hertz", "is not known"),
        ("kind: planar, clearance: 50 um, contact: rigid, friction: 0.1", "rigid blows have none"),
        ("kind: planar, clearance: 50 um, pin: 5 mm, friction: {viscous: 1}", "no viscous part"),
        ("kind: planar, clearance: 50 um, pin: 5 mm, friction: {coulomb: 2 N}", "friction.coulomb"),
        (
            "kind: planar, clearance: 50 um, pin: 5 mm, axial: 1 mm",
            "no meaning for the kind planar",
        ),
        ("kind: prismatic, axis: x, clearance: 1 mm", "in which direction"),
        ("kind: prismatic, axis: x, across: [1, 1, 0], clearance: 1 mm", "perpendicular"),
        ("kind: prismatic, axis: x, across: y, clearance: 1 mm, contact: flores", "is for pins"),
        ("kind: prismatic, axis: x, length: 0.1", "the joint is ideal"),
    ],
)
def test_clearances_that_say_too_little_are_refused(keys: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=said):
        load(
            tmp_path, FLYING, "actuated: []\nloops: {joint: {between: [hole, pin], " + keys + "}}\n"
        )


@pytest.mark.parametrize(
    ("joint", "motors", "said"),
    [
        ("x_joint: {clearance: 50 um, pin: 5 mm}", "", "is prismatic"),
        ("arm_joint: {clearance: 50 um}", "", "of which pin"),
        ("arm_joint: {clearance: 50 um, pin: 5 mm, spring: 1}", "", "beside clearance"),
        ("arm_joint: {clearance: 50 um, pin: 5 mm}", "arm_joint", "a motor turns"),
    ],
)
def test_hinges_that_cannot_be_cut_are_refused(
    joint: str, motors: str, said: str, tmp_path: Path
) -> None:
    bodies = (*FLYING, Body("arm", "pin", "revolute", mass=0.1, inertia=(1e-4,) * 3))
    with pytest.raises(DescriptionError, match=said):
        load(tmp_path, bodies, f"actuated: [{motors}]\njoints: {{{joint}}}\n")


def test_a_hinge_of_the_tree_is_cut_where_it_has_clearance(tmp_path: Path) -> None:
    """A pendulum on a tilted axis: joint and loop say the same, and its period is the ideal one."""
    bodies = (
        Body("bob", "base", "revolute", (0.1, 0, 0.2), rpy=(0.3, 0.2, 0.5), axis=(0.6, 0, 0.8),
             mass=1.0, com=(0, -0.4, 0), inertia=(0.02,) * 3),
    )  # fmt: skip
    ideal = "actuated: []\nhome: {bob_joint: 0.3}\nsolve: {level: coupled, start: straight}\n"
    exact = pf.solve(load(tmp_path, bodies, ideal), pf.hold(duration=0.3), tol=1e-6, samples=31)
    yaml = (
        ideal
        + """joints: {bob_joint: {clearance: 20 um, pin: 10 mm, restitution: 0.5,
                             contact: lankarani_nikravesh}}
"""
    )
    m = load(tmp_path, bodies, yaml)
    run = pf.solve(m, pf.hold(duration=0.3), tol=1e-3, samples=31)
    assert run.meta["energy_balance"] < 1e-5
    turned = np.arctan2(*run.array("joint/q")[:, [3, 2]].T)
    # by the clearance over the length, some times
    np.testing.assert_allclose(turned, exact.joint("bob_joint").position, rtol=0, atol=4 * 5e-5)
    assert 2e-5 < np.linalg.norm(run.array("loop/bob_joint/orbit"), axis=1).max() < 2.2e-5


def test_stops_of_a_joint_without_end_lie_within_a_turn(tmp_path: Path) -> None:
    body = (Body("arm", "base", "continuous", mass=0.1, inertia=(1e-4,) * 3),)
    for stops in ("upper: 1", "lower: -4, upper: 4"):
        with pytest.raises(DescriptionError, match="between -pi and pi"):
            load(tmp_path, body, "actuated: []\njoints: {arm_joint: {stops: {restitution: 1, "
                                 f"{stops}}}}}}}\n")  # fmt: skip
