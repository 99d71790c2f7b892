"""Where accelerations jump, on steps and between them, against the exact answer.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - ked where accelerations jump, on and between steps: second order, states and force | sum of
      step responses | 4e-4; ratios above 3.5 | 3.2e-4; the first order had 8.8e-4
    - the same of a force that grows within a step | sum of ramp responses | 4e-4; ratio above 3.5 |
      1.95e-4; 3.95
    - motor force at samples on jumps of the acceleration, the last one included: that just after,
      at every level | sum of step responses | 1e-4 by tol, 1e-3 in steps | 1.4e-7, 4.3e-4
    - equal steps of level coupled where accelerations, or torques fed forward, jump on and between
      steps: second order | sum of step responses | 1e-2; ratio above 3.5 | 9e-3; 4.0
    - the same of forces that come and go on and between steps, with and without the kernel | sum of
      step responses | 2e-4; ratio above 3.5 | 1.3e-4; 3.9
    - steps of the simulator with a motion whose acceleration jumps on and between them: second
      order | sum of step responses | 4e-3; ratio above 3.5 | 2.2e-3; 4.0
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

import pinflex as pf
from pinflex.arrays import Array
from pinflex.description.blocks.external import FrameForce
from pinflex.integrators.problem import Problem, Run
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.model.loads import Loads
from pinflex.solver import scene
from tests.scenes import UNIT_BEAM, Body, load

RAMP, END = 0.5, 3.0  # s: jumps at 0.5, 1.5 and 2 s
SPEED = 1.0 / 1.5  # m/s, of a way of 1 m


def carried(folder: Path) -> pf.Mechanism:
    """A beam across a slide that goes 1 m in 2 s, ramps of constant acceleration at both ends."""
    bodies = (
        Body("slide", "base", "prismatic", axis=(0, 1, 0), mass=1.0),
        Body("beam", "slide"),
        Body("tip", "beam", xyz=(1, 0, 0)),
    )
    yaml = (
        "gravity: [0, 0, 0]\nactuated: [slide_joint]\nplatform: tip\n"
        f"motion: {{kind: trapezoid, joints: {{slide_joint: 1}}, ramp: {RAMP}, duration: 2}}\n"
        f"flexible:{UNIT_BEAM}"
    )
    return load(folder, bodies, yaml, ["flexible.beam.basis.internal=0"])


def exact(robot: pf.Mechanism, t: Array) -> tuple[Array, Array]:
    """Elastic coordinates (nt, n) and motor force (nt,): sum of responses to three steps.

    The answer of an oscillator to an acceleration that sets in is (cos(w s) - 1) / w^2.
    """
    M = Equations(robot.flexible).mass(robot.undeformed())
    K = robot.flexible.K[1:, 1:]
    squares, V = scipy.linalg.eigh(K, M[1:, 1:])
    a = SPEED / RAMP
    eta, force = np.zeros((len(t), len(K))), np.zeros(len(t))
    for at, jump in ((0.0, a), (RAMP, -a), (2.0 - RAMP, -a), (2.0, a)):
        s = np.maximum(t - at, 0.0)[:, None]
        on = (t >= at)[:, None] * jump
        push = V.T @ M[1:, 0]
        eta += on * (push * (np.cos(np.sqrt(squares) * s) - 1.0) / squares) @ V.T
        swing = on * (-push * np.cos(np.sqrt(squares) * s)) @ V.T
        force += on[:, 0] * M[0, 0] + swing @ M[1:, 0]
    return eta, force


@pytest.mark.parametrize("samples", [1201, 1213])
def test_a_jump_between_two_steps_is_where_it_is(samples: int, tmp_path: Path) -> None:
    """Second order, at jumps on steps and between them: felt half a step off, it was the first."""
    robot, errors = carried(tmp_path), []
    for every in (1, 2, 4):
        dt = END / (samples - 1) / every
        run = pf.solve(robot, level="ked", until=END, samples=samples, dt=dt, rho_inf=1.0)
        eta, force = exact(robot, run.t)
        pairs = (run.array("eta"), eta), (run.torque[:, 0], force)
        errors.append([float(np.max(np.abs(x - y)) / np.max(np.abs(y))) for x, y in pairs])
    assert np.max(errors[-1]) < 4e-4, errors  # felt half a step off: 9e-4
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert np.all(ratios > 3.5), ratios  # 4 in the end; the first order has 2


MASS, ROTOR, STIFFNESS = 1.0, 0.5, 900.0  # kg, kg seen at the slide, N/m
JUMPS = ((0.0, 1.0), (RAMP, -1.0), (2.0 - RAMP, -1.0), (2.0, 1.0))  # s, of SPEED / RAMP


def sprung(
    folder: Path, more: str = "", law: str = f"kind: trapezoid, ramp: {RAMP}"
) -> pf.Mechanism:
    """A rotor that drives a mass along a slide through a spring."""
    bodies = (Body("slide", "base", "prismatic", axis=(0, 1, 0), mass=MASS),)
    drive = f"{{gear: 1, motor_inertia: {ROTOR}, stiffness: {STIFFNESS}}}"
    yaml = (
        "gravity: [0, 0, 0]\nactuated: [slide_joint]\nplatform: slide\n"
        f"joints: {{slide_joint: {{drive: {drive}}}}}\n{more}"
        f"motion: {{{law}, joints: {{slide_joint: 1}}, duration: 2}}\n"
    )
    return load(folder, bodies, yaml)


@pytest.mark.parametrize("kernel", ["1", "0"])
@pytest.mark.parametrize(
    ("level", "options", "close"),  # equal steps: phase (w h)^2 w t / 12 = 1.1e-3, of 2/3 the force
    [
        ("coupled", {"tol": 1e-5}, 1e-4),
        ("coupled", {"dt": 5e-4}, 1e-3),
        ("ked", {"dt": 5e-4}, 1e-3),
    ],
)
def test_a_sample_on_a_jump_has_the_force_just_after_it(
    level: str, options: dict[str, float], close: float, kernel: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """What the rotor's inertia asks for jumps by 0.67 N, 15 % of the largest force."""
    monkeypatch.setenv("PINFLEX_KERNEL", kernel)
    run = pf.solve(sprung(tmp_path), level=level, until=2.0, samples=41, **options)
    w, force = np.sqrt(STIFFNESS / MASS), np.zeros(len(run.t))
    for at, jump in JUMPS:
        s = run.t - at
        swing = MASS * (1.0 - np.cos(w * np.maximum(s, 0.0)))
        force += (s > -1e-9) * jump * SPEED / RAMP * (ROTOR + swing)
    assert np.abs(run.torque[:, 0] - force).max() < close * np.abs(force).max()


def test_a_break_without_a_jump_leaves_the_run_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cycloid ends at rest, its acceleration none but for round-off: that is no jump."""
    seen, plain = [], scene.after_jumps

    def watched(problem: Problem, run: Run, breaks: list[float]) -> Run:
        seen.append((run, breaks, plain(problem, run, breaks)))
        return seen[-1][2]

    monkeypatch.setattr(scene, "after_jumps", watched)
    robot = sprung(tmp_path, law="kind: cycloid")
    pf.solve(robot, level="coupled", tol=1e-5, until=3.0, samples=61)
    assert seen
    for before, breaks, after in seen:
        assert np.abs(before.t - breaks[0]).min() < 1e-12  # a sample lies on it
        assert after is before


def off(run: pf.Result, drive: str) -> float:
    """Largest error of the way of the mass, of what the spring gives way by."""
    whole = MASS + ROTOR
    reduced = MASS if drive == "prescribed" else MASS * ROTOR / whole
    w, bend, way = np.sqrt(STIFFNESS / reduced), np.zeros(len(run.t)), np.zeros(len(run.t))
    pushed = 1.0 if drive == "prescribed" else whole / ROTOR  # on what the spring holds back
    for at, jump in JUMPS:
        s, a = np.maximum(run.t - at, 0.0), jump * SPEED / RAMP
        bend += a * pushed * (np.cos(w * s) - 1.0) / w**2
        way += 0.5 * a * s**2
    share = 1.0 if drive == "prescribed" else ROTOR / whole  # else about the centre of mass
    mass = run.frame("slide").position[:, 1]
    return float(np.abs(mass - (way + share * bend)).max() / np.abs(share * bend).max())


@pytest.mark.parametrize("samples", [101, 98])  # jumps on steps, and between them
@pytest.mark.parametrize("drive", ["prescribed", "torque"])
def test_equal_steps_of_level_coupled_feel_a_jump_where_it_is(
    drive: str, samples: int, tmp_path: Path
) -> None:
    """Second order in the way of the mass; felt half a step off, it was the first."""
    errors = []
    for every in (1, 2):
        robot = sprung(tmp_path, f"solve: {{drive: {drive}}}\n")
        run = pf.solve(robot, level="coupled", until=3.0, samples=samples, dt=1.5e-3 / every)
        errors.append(off(run, drive))
    # phase (w h)^2 w t / 12 is 2e-2 for the faster one, and 4 times as much in steps twice as long
    assert errors[1] < 1e-2 and errors[0] > 3.5 * errors[1], errors


@pytest.mark.parametrize("kernel", ["1", "0"])
@pytest.mark.parametrize("on", [0.3, 0.30041])  # s: on a step, and between two
def test_equal_steps_feel_a_force_where_it_comes_and_goes(
    on: float, kernel: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Second order in the mass's place and motor force; felt half a step off, it was the first."""
    monkeypatch.setenv("PINFLEX_KERNEL", kernel)
    off, push, w, errors = on + 0.40047, 5.0, np.sqrt(STIFFNESS / MASS), []
    robot = sprung(tmp_path).with_(
        "motion={kind: hold, duration: 1}",
        f"forces={{push: {{at: slide, force: [0, {push}, 0], start: {on}, until: {off}}}}}",
    )
    for dt in (1e-3, 5e-4):
        run = pf.solve(robot, level="coupled", until=1.0, samples=101, dt=dt)
        place, force = np.zeros(len(run.t)), np.zeros(len(run.t))
        for at, sign in ((on, 1.0), (off, -1.0)):
            s = np.maximum(run.t - at, 0.0)
            place += sign * push / STIFFNESS * (1.0 - np.cos(w * s))
        force = -STIFFNESS * place  # the motor holds what the spring bears
        pairs = (run.frame("slide").position[:, 1], place), (run.torque[:, 0], force)
        errors.append([np.abs(x - y).max() / np.abs(y).max() for x, y in pairs])
    # phase (w h)^2 w t / 12 = 4e-4 of the swing about a place twice as far, less numerical damping
    assert np.max(errors[1]) < 2e-4, errors
    assert np.all(np.array(errors[0]) > 3.5 * np.array(errors[1])), errors
    if kernel == "1":
        live = pf.Simulator(robot, dt=dt).record()
        for _ in range(round(1.0 / dt)):
            live.step(motion=pf.hold(duration=1.0))
        way = live.result().frame("slide").position[:, 1]
        # Newton's tolerance of 1e-7 a step, over some 20 steps of a swing
        assert np.abs(way[:: round(0.01 / dt)] - pairs[0][0]).max() < 1e-5 * place.max()


@pytest.mark.parametrize("ramp", [2e-4, 1.3e-3])  # s: within a step, and over some
def test_ked_feels_a_ramp_within_a_step(ramp: float, tmp_path: Path) -> None:
    """Second order in the mass's place; of a ramp known by its ends alone, the first."""
    on, push, w, errors = 0.30041, 5.0, np.sqrt(STIFFNESS / MASS), []
    robot = sprung(tmp_path).with_(
        "motion={kind: hold, duration: 1}",
        f"forces={{push: {{at: slide, force: [0, {push}, 0], start: {on}, ramp: {ramp}}}}}",
    )
    for dt in (1e-3, 5e-4):
        run = pf.solve(robot, level="ked", until=1.0, samples=101, dt=dt, rho_inf=1.0)
        late = (np.maximum(run.t - at, 0.0) for at in (on, on + ramp))
        begun, done = (s - np.sin(w * s) / w for s in late)
        place = push / STIFFNESS * (begun - done) / ramp
        errors.append(np.abs(run.frame("slide").position[:, 1] - place).max() / place.max())
    # phase (w h)^2 w t / 12 = 4e-4 of the swing about half the largest place
    assert errors[1] < 4e-4 and errors[0] > 3.5 * errors[1], errors


@pytest.mark.parametrize("samples", [101, 98])  # jumps on steps, and between them
def test_steps_of_the_simulator_feel_a_jump_where_it_is(samples: int, tmp_path: Path) -> None:
    """Second order, as the run above; with the motion taken at the end of each step the first."""
    robot, errors = sprung(tmp_path), []
    motion = pf.trapezoid(joints={"slide_joint": 1.0}, ramp=RAMP, duration=2.0)
    for every in (1, 2):
        count = every * 20 * (samples - 1)
        dt = 3.0 / count
        live = pf.Simulator(robot, dt=dt).reset(motion=motion).record()
        for _ in range(count):
            live.step(motion=motion)
        errors.append(off(live.result(), "prescribed"))
    # phase (w h)^2 w t / 12 is 3.8e-3, and 4 times as much in steps twice as long
    assert errors[1] < 4e-3 and errors[0] > 3.5 * errors[1], errors


@pytest.mark.parametrize("ramp", [0.0, 2e-4, 0.03])
@pytest.mark.parametrize("until", [None, 0.02, 0.06])
def test_loads_spread_over_a_step_keep_impulse_and_its_moment(
    ramp: float, until: float | None
) -> None:
    """Integrals of the load and of t times it, to a time behind all switches."""
    h, end, load = 1e-3, 0.1, FrameForce("push", "tip", (0.0, 1.0, 0.0), start=0.01, ramp=ramp)
    one = Loads(((replace(load, until=until), None),), ())  # type: ignore[arg-type]
    t = (np.arange(400_000) + 0.5) * end / 400_000

    def integrals(loads: Loads) -> Array:
        force = sum(f.force[1] * np.array([f.scale(x) for x in t]) for f, _ in loads.forces)
        return np.array([np.mean(force), np.mean(t * force)]) * end

    # a ramp in place of a jump has the same middle; its spread, h^2 / 24 of the force, is 4e-8
    assert np.abs(integrals(one.spread(h)) - integrals(one)).max() < 1e-7
