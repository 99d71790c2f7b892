"""The simulator in the loop: the march of pf.solve, and what bounds it.

Claims:
    In the loop, FMUs
    - 1e4 steps of the simulator are those of `pf.solve(dt=)` | another path to the same steps |
      1e-12 | passes
    - energy over 1e5 undamped steps; its error by half the step | its conservation | 1 % of what
      swings; 3.4 to 4.7 | 1.5e-8; 4.0
    - no step bears a tangent's evaluation and its factors | counts, 1200 steps of delta | all |
      passes
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import pinflex as pf
from pinflex.actuation.drive import motor_path
from pinflex.actuation.path import motor_axes
from pinflex.errors import PinflexError
from pinflex.kernel import build
from pinflex.kernel.library import kernel
from pinflex.levels.modes import default_motion
from pinflex.live.cost import _on_and_on, step_cost

pytestmark = pytest.mark.skipif(kernel().functions is None, reason="no kernel")


def there_and_back(robot: pf.Mechanism, far: float) -> pf.Motion:
    """A law without bends, at rest at the start but for 1e-8 of it."""
    tanh = "(1-2/(exp(16*(t-{}))+1))"
    law = f"{far}*({tanh.format(1.2)}-{tanh.format(3.0)})/2"
    return pf.formula(joints=dict.fromkeys(robot.motors, law), duration=5.0)


@pytest.mark.parametrize("model, far", [("ur5", 0.3), ("3rrr", 0.1)])
def test_ten_thousand_steps_are_those_of_solve(model: str, far: float) -> None:
    """With the same schedule of tangents: the same arithmetic; 5 s at 0.5 ms, stop and ring."""
    robot, steps = pf.load(model), 10_000
    motion = there_and_back(robot, far)
    run = pf.solve(robot, motion, level="coupled", dt=5e-4, until=5.0, samples=steps + 1)
    path = motor_path(robot, motion, run.t)
    moves = list(zip(path.position, path.velocity, path.acceleration, strict=True))[1:]

    live = pf.Simulator(robot, dt=5e-4, tangents=None, stops=False)
    live.reset(motion=motion).record()
    for move in moves:
        live.step(motion=move)
    found = live.result()
    assert np.ptp(path.position, axis=0).max() > 0.9 * far
    for key in ("joint/q", "eta", "torque"):
        want = run.array(key)
        np.testing.assert_allclose(
            found.array(key), want, rtol=0, atol=1e-12 * float(np.abs(want).max())
        )
    # With its own schedule, one tangent a step at the most: to Newton's tolerance, 1e-7 of the
    # accelerations, which the links' stiffness makes as much of the torques.
    live = pf.Simulator(robot, dt=5e-4, every=50, stops=False)
    live.reset(motion=motion).record()
    for move in moves[:4000]:
        live.step(motion=move)
    torque = run.torque[:4001]
    np.testing.assert_allclose(
        live.result().torque, torque, rtol=0, atol=1e-5 * np.abs(torque).max()
    )
    assert live.cost["tangents"] >= 4000 // 50


def test_torques_drive_it_as_they_drive_a_run() -> None:
    """The rigid torques of a motion as feed-forward without feedback, from rest at 0."""
    robot = pf.load("ur5")
    motion, dt, n = there_and_back(robot, 0.2), 1e-3, 1500
    options: dict[str, Any] = {"drive": "torque", "kp": 0.0, "kd": 0.0, "start": "static"}
    run = pf.solve(robot, motion, level="coupled", dt=dt, until=n * dt, samples=n + 1, **options)
    live = pf.Simulator(robot, dt=dt, tangents=None, stops=False)
    live.reset(start="static", motion=motion).record()
    for torque in run.torque[1:]:
        live.step(torque=torque)
    found = live.result()
    # The run begins with its torque at 0, the simulator with that of its first step, 1e-9 off.
    moved = np.abs(run.array("joint/q") - run.array("joint/q")[0]).max()
    assert moved > 0.04
    np.testing.assert_allclose(
        found.array("joint/q"), run.array("joint/q"), rtol=0, atol=1e-6 * moved
    )


@pytest.mark.parametrize("name", ["generalized_alpha", "newmark"])
def test_energy_of_a_flexible_pendulum(name: str) -> None:
    """A beam of 8 m that swings: over 1e5 undamped steps energy never grows by more than 1 % of
    what swings, and its error falls as dt^2 (3.4 to 4.7 times less for half the step)."""
    robot = pf.load("spinning_beam", ["gravity=[0,-9.81,0]"])
    scheme = getattr(pf, name)()

    def errors(dt: float, steps: int) -> tuple[float, float, float]:
        """Largest growth and largest error of the energy, and the largest kinetic one."""
        live = pf.Simulator(robot, dt=dt, integrator=scheme).reset(start="straight")
        start, seen, most = sum(live.energy.values()), [], 0.0
        for k in range(steps):
            live.step(torque=[0.0])
            if k % 10 == 9:
                now = live.energy
                seen.append(sum(now.values()) - start)
                most = max(most, now["kinetic"])
        return max(seen), float(np.abs(seen).max()), most

    grown, _, swings = errors(2e-3, 100_000)
    assert swings > 400.0 and grown < 1e-2 * swings
    coarse, fine = errors(4e-3, 2500)[1], errors(2e-3, 5000)[1]
    assert 3.4 < coarse / fine < 4.7


def test_no_step_bears_a_whole_tangent() -> None:
    """Where they may come late, one is evaluated behind two steps and factored behind the next."""
    live = pf.Simulator("delta", dt=5e-4)
    path = _on_and_on(live.mechanism, live.dt)
    live.reset(motion=default_motion(live.mechanism))
    at, made = live._at.march.at, []
    for move in np.moveaxis(path, 1, 0)[:1200]:
        ready, before = at.ready, at.refreshed
        live.step(motion=tuple(move))
        made.append((at.refreshed - before, ready))
    new = np.array(made)
    assert new[0, 0] == 1 and new[:, 0].max() == 1  # the first has none to begin with
    assert (new[1:, 0] == (new[1:, 1] == 2)).all()
    assert 20 < live.cost["tangents"] < 85  # 56; 122 where the nodes of a half are left out


def test_what_steps_cost_is_told_beside_the_same_arithmetic() -> None:
    found = step_cost("ur5", steps=400, iterations=9)
    assert found.steps == 400 and found.tangents[1] == 1 and 2 <= found.iterations[1] <= 9
    assert found.percentiles[50.0] <= found.percentiles[99.0] <= found.largest
    # As long as a step, up to the quarter by which its length is searched, and what machines do.
    assert 0.2 < found.same[50.0] / found.percentiles[50.0] < 5.0
    assert found.preempted is None or 0 <= found.preempted <= 400


def test_short_steps_expect_accelerations_to_go_on_along_parabolas() -> None:
    """2.1 iterations a step; along straight lines it were 2.9, of the same steps."""
    assert step_cost("ur5", steps=3000, dt=1e-4).iterations[0] < 2.5


def test_snapshots_are_exact() -> None:
    robot = pf.load("delta")
    live = pf.Simulator(robot)
    hold, torque = live.motors, live.motors.torque

    def on(count: int) -> np.ndarray:
        for k in range(count):
            live.step(torque=torque * (1.0 + 0.02 * np.sin(0.1 * k)))
        return np.concatenate([live.y, live.v, live.motors.torque])

    on(30)
    kept = live.snapshot()
    first = on(100)
    live.step(motion=(live.motors.position, 0 * torque, 0 * torque))  # and led in between
    assert np.array_equal(live.restore(kept).motors.position, live.motors.position)
    assert live.time == pytest.approx(0.030) and np.array_equal(on(100), first)
    assert np.abs(live.motors.position - hold.position).max() > 1e-4
    with pytest.raises(pf.DescriptionError, match="not a snapshot of this simulator"):
        pf.Simulator(robot).restore(kept)


BAD = {
    "nan": ({"torque": [np.nan, 0, 0]}, "torque: not a finite number for motor_1"),
    "few": ({"torque": [0.0]}, r"torque: shape \(1,\). Give 3 numbers"),
    "text": ({"torque": "much"}, "torque: shape"),
    "huge": ({"torque": [10**400, 0, 0]}, "torque: shape"),
    "nothing": ({}, "give torque= or motion="),
    "both": ({"torque": [0, 0, 0], "motion": ([0] * 3,) * 3}, "one of them"),
    "pair": ({"motion": ([0, 0, 0], [0, 0, 0])}, "give .position, velocity, acceleration."),
    "much": ({"torque": [1e12, 0, 0]}, "t = 0.02 s: (no step of|motor_1 would)"),
    "far": ({"motion": ([9, 9, 9], [0] * 3, [0] * 3)}, "t = 0.02 s: (no step of|motor_1 would)"),
}


@pytest.mark.parametrize("what", BAD)
def test_a_bad_step_says_so_and_leaves_everything(what: str) -> None:
    live = pf.Simulator("delta")
    q = live.motors.position
    torque = live.motors.torque
    for _ in range(19):
        live.step(motion=(q, 0 * q, 0 * q))
    before = live.time, live.y, live.v, live.motors.torque
    given, said = BAD[what]
    with pytest.raises(PinflexError, match=said) as error:
        live.step(**given)
    assert str(error.value).count("\n") == 0
    after = live.time, live.y, live.v, live.motors.torque
    assert all(np.array_equal(x, y) for x, y in zip(before, after, strict=True))
    live.step(motion=(q, 0 * q, 0 * q))  # and goes on from there
    np.testing.assert_allclose(live.motors.torque, torque, rtol=1e-6)


@pytest.mark.parametrize(
    "given, said",
    [
        ({"pose": {"motor_1": -1.6}}, "motor_1 would pass its stop"),
        ({"pose": {"motor_1": None}}, "motor_1: None"),
        ({"pose": {"motor_1": 10**400}}, "motor_1: 1000"),
        ({"motion": 1j}, "give a pose"),
        ({"start": [10**400]}, "is not valid"),
    ],
)
def test_a_bad_reset_says_so_and_leaves_everything(given: dict[str, Any], said: str) -> None:
    live = pf.Simulator("delta").record()
    q = live.motors.position
    live.step(motion=(q, 0 * q, 0 * q))
    before = live.time, live.y, live.v, live.motors.torque
    with pytest.raises(PinflexError, match=said):
        live.reset(**given)
    after = live.time, live.y, live.v, live.motors.torque
    assert all(np.array_equal(x, y) for x, y in zip(before, after, strict=True))
    live.step(motion=(q, 0 * q, 0 * q))
    assert len(live.result().t) == 3


def test_a_motor_stops_at_its_limit() -> None:
    """The ur5's shoulder at 2 rad/s: a step before 2 pi, the limit of its URDF."""
    robot = pf.load("ur5")
    live = pf.Simulator(robot, dt=2e-3)
    q, v = live.motors.position.copy(), np.zeros(6)
    v[0] = 2.0
    live.reset(pose={robot.motors[0]: 6.2})
    q[0] = 6.2

    def turn() -> None:
        for k in range(1, 101):
            live.step(motion=(q + k * live.dt * v, v, 0 * v))

    with pytest.raises(pf.MotionError, match=f"{robot.motors[0]} would pass its stop") as error:
        turn()
    last = live.motors.position[0]
    assert last <= 2 * np.pi < last + 2.0 * live.dt + 1e-12
    assert error.value.data["time"] == pytest.approx(live.time + live.dt)
    before, k = (live.time, live.y, live.v, live.motors.torque), round(live.time / live.dt) + 1
    with pytest.raises(pf.MotionError, match="would pass its stop"):
        live.step(motion=(q + k * live.dt * v, v, 0 * v))
    after = live.time, live.y, live.v, live.motors.torque
    assert all(np.array_equal(x, y) for x, y in zip(before, after, strict=True))


def test_arguments_are_checked() -> None:
    for wrong, said in (
        ({"dt": 0.0}, "dt: 0.0"), ({"dt": np.nan}, "dt: nan"), ({"every": 0}, "every: 0"),
        ({"dt": 10**400}, "dt: 1000"),
        ({"tangents": 10**30}, "tangents: 1000"), ({"integrator": 3}, "integrator: 3"),
        ({"sensors": {"a": pf.StrainGauge("arm_1", 0.1, np.nan)}}, "y: nan"),
        ({"iterations": 2.5}, "iterations: 2.5"), ({"sensors": {"a": 3}}, "sensors: a: no sensor"),
        ({"sensors": {"a": pf.Encoder("motor")}}, "motor: not a motor"),
        ({"sensors": {"a": pf.StrainGauge("arm_1", 9.0)}}, "x: 9.0. Allowed: 0 to"),
        ({"sensors": {"a": pf.Imu("moon")}}, "moon: no such frame"),
    ):  # fmt: skip
        with pytest.raises(pf.DescriptionError, match=said):
            pf.Simulator("delta", **wrong)  # type: ignore[arg-type]
    with pytest.raises(PinflexError, match="no step of 1e.30 s"):
        pf.Simulator("delta", dt=1e30)
    live = pf.Simulator("delta")
    for call in (lambda: live.frame("moon"), lambda: live.link("moon"), lambda: live.sensor("x"),
                 lambda: live.reset(pose={"moon": 1.0}), live.result):  # fmt: skip
        with pytest.raises(pf.DescriptionError):
            call()


def test_sensors_of_a_cantilever() -> None:
    """At rest under its weight: strain -y M / EI at the root, M = rho A g l^2 / 2; 1 g at the tip.

    Its strip of 20 x 2 mm bends by 4 mm/m at the root: second-order terms are 1e-3 of it. The
    curvature of the shapes at the root is 1 % off (a polynomial of few terms).
    """
    robot = pf.load("cantilever")
    sensors: Any = {"up": pf.StrainGauge("beam", 0.0, y=1e-3), "imu": pf.Imu("tip")}
    live = pf.Simulator(robot, dt=1e-3, sensors=sensors).reset(start="static")
    live.step()
    part = robot.parts["beam"]
    section, material = part.spec.section, part.spec.material
    load = 9.81 * material.rho * section.A
    want = 1e-3 * 0.5 * load * part.length**2 / (material.E * section.Iz)  # pulled on top
    assert float(live.sensor("up")) == pytest.approx(want, rel=2e-2)
    assert live.link("beam").strain[0] == pytest.approx(want, rel=2e-2)
    bent = -load * part.length**4 / (8 * material.E * section.Iz)
    assert live.frame("tip").position[2] == pytest.approx(bent, rel=2e-3)
    force = live.sensor("imu")
    np.testing.assert_allclose(np.linalg.norm(force[:3]), 9.81, rtol=1e-6)
    np.testing.assert_allclose(force[3:], 0.0, atol=1e-6)


def test_an_encoder_counts() -> None:
    step = 2 * np.pi / 4096
    live = pf.Simulator("ur5", sensors={"e": pf.Encoder("elbow_joint", step)})
    exact = live.motors.position[live.mechanism.motors.index("elbow_joint")]
    read = float(live.sensor("e"))
    assert abs(read - exact) <= step / 2 and read / step == pytest.approx(round(read / step))


def test_the_state_is_that_of_its_own_result() -> None:
    live = pf.Simulator("3rrs")
    live.step(torque=1.1 * live.motors.torque)
    run, name = live.now(), live.mechanism.description.platform
    assert name is not None
    frame = live.frame(name)
    np.testing.assert_allclose(frame.position, run.frames[name].position[0], atol=1e-15)
    np.testing.assert_allclose(frame.velocity, run.frames[name].velocity[0], atol=1e-13)
    position = motor_axes(live.mechanism).read(run.array("joint/q")[0])
    np.testing.assert_array_equal(live.motors.position, position)


def test_the_library_asks_for_no_memory() -> None:
    """No allocator is among the symbols that it imports, so no step can call one."""
    for name, *_ in build.BUILDS[build.here().rpartition("-")[2]]:
        path = build.SOURCE.parent / build.name_of(build.here(), name)
        symbols = set(path.read_bytes().split(b"\0"))
        assert b"atan2" in symbols  # imports are seen
        assert not symbols & {b"malloc", b"calloc", b"realloc", b"free", b"aligned_alloc", b"mmap"}
