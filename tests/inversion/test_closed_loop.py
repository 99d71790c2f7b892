"""Digital controllers on the coupled level, against discrete-time systems solved apart from it.

Claims:
    Commands: motions that the platform follows
    - digital PD on a mass, delays of 0 to 2.5 samples | exact discrete system | 1e-12 | 5e-14
    - the same on the kernel, beside a flexible arm, with at most 2.2 steps a hold; a ur5 under a
      PID at 1 kHz with and without the kernel | exact discrete system; plain march | 1e-9; 1e-4
      (the tolerance) | passes
    - digital PID on a cart with a light mass on a spring and a damper, which dies in a twentieth of
      a hold, with and without the kernel: states, accelerations and force just after the instants;
      acceleration between them | exponential of its matrix | 1e-3 (the tolerance); less than told
      | 4e-5; 0.1 of it
    - the same where what lies between has no mass, with and without dampers | exponential of its
      matrix | 1e-6 | 7e-9
    - what has no mass is not pushed: refused; a plate with a rotor on a damper | exponential | 1e-3
      (the tolerance) | passes
    - `control` with `period` in the YAML: PID with limit and delay; motion followed with the rigid
      torque | law as a loop on the exact discrete mass; a controller made in Python from the
      motion's formula | 1e-12; 1e-6 rad | passes; 1e-9
    - a transfer function as law, continuous or discrete, with a delay | python-control's closed
      loop | 1e-7 | passes
    - flexible arm on a hub under a digital law: hub and tip | discrete linear model | 1e-5 | passes
    - a loop that shakes its robot is named, one that begins to late, too | kd T = 2 J of a sampled
      mass | named 10 % beyond it, not 10 % before | passes
    - torque limit holds; the PID's integral does not wind up | loop on the exact discrete mass |
      1e-9 | passes; overshoot 0.29 for 1.86 rad
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scenes
from scipy.linalg import expm
from scipy.signal import StateSpace, cont2discrete, dlsim

import pinflex as pf
from pinflex.arrays import Array
from pinflex.solver import tolerance

J, PERIOD = 0.5, 0.01  # [kg m^2]; [s]
ARM, HUB = (pf.Travel("arm_joint"),), (pf.Effort("arm_joint"),)


def turntable(folder: Path, effort: float = 0.0) -> pf.Mechanism:
    """One freedom: J q'' = u."""
    bodies = [
        scenes.Body("arm", "base", "revolute", mass=1.0, com=(0, 0, 0), inertia=(0.1, 0.1, J))
    ]
    robot = scenes.load(folder, bodies, "gravity: [0, 0, 0]\nmotion: {kind: hold, duration: 1}\n")
    if effort:
        text = (folder / "scene.urdf").read_text().replace('effort="1e9"', f'effort="{effort}"')
        assert f'effort="{effort}"' in text
        (folder / "scene.urdf").write_text(text)
        robot = pf.load(folder / "scene.yaml")
    return robot


@pytest.fixture(scope="module")
def free(tmp_path_factory: pytest.TempPathFactory) -> pf.Mechanism:
    return turntable(tmp_path_factory.mktemp("turntable"))


def run(robot: pf.Mechanism, control: pf.Control, until: float = 1.0) -> pf.Result:
    """Instants at every tenth of a sample."""
    return pf.solve(
        robot, level="coupled", control=control, until=until, samples=round(1e3 * until) + 1
    )


def sampled(count: int, kp: float, kd: float, delay: float) -> list[float]:
    """Angles of a wheel every millisecond: between samples its acceleration is constant."""
    x, u, waiting, exact, h = np.zeros(2), 0.0, [], [], 1e-3
    for k in range(count):
        exact.append(x[0])
        if k % 10 == 0:
            waiting.append((k * h + delay, kp * (1 - x[0]) - kd * x[1]))
        while waiting and waiting[0][0] <= k * h + 1e-9:
            u = waiting.pop(0)[1]
        x = np.array([x[0] + h * x[1] + h * h * u / J / 2, x[1] + h * u / J])
    return exact


@pytest.mark.parametrize("delay", [0.0, 0.004, 0.01, 0.025])
def test_a_sampled_pd_on_a_mass_is_its_exact_discrete_system(
    free: pf.Mechanism, delay: float
) -> None:
    """Parabolas between the instants at which the held torque changes, for any delay."""
    kp, kd = 40.0, 3.0
    control = pf.Control(
        ARM, HUB, lambda t, m, rate, total: kp * (1 - m) - kd * rate, period=PERIOD, delay=delay
    )
    found = run(free, control)
    exact = sampled(1001, kp, kd, delay)
    # round-off: Radau is exact on parabolas
    np.testing.assert_allclose(found.joint("arm_joint").position, exact, atol=1e-12)
    assert found.meta["energy_balance"] < 1e-12


def test_samples_on_a_jump_have_what_is_just_after(free: pf.Mechanism) -> None:
    """Of what the controller drives, at its instants, and of a load that switches on and off."""
    pushed = free.with_("forces={push: {at: arm, moment: [0, 0, 2], start: 0.105, until: 0.2}}")
    found = pf.solve(
        pushed, level="coupled", until=0.3, samples=61,
        control=pf.Control(ARM, HUB, lambda t, m, rate, total: 40 * (1 - m), period=PERIOD),
    )  # fmt: skip
    driven = found.array(next(key for key in found.arrays if key.startswith("control/")))
    np.testing.assert_allclose(found.torque[:, 0], driven, rtol=1e-12)  # read off a polynomial
    acts = 2.0 * ((found.t > 0.105 - 1e-9) & (found.t < 0.2 - 1e-9))
    # of J a to some digits
    np.testing.assert_allclose(J * found.joint("arm_joint").acceleration, driven + acts, atol=1e-9)


CART, BOB, SPRING, DAMPER = 1.0, 1e-3, 200.0, 20.0  # kg, N/m, N s/m: what is light dies in 50 us


def shaken(end: float, gains: Array, target: float) -> tuple[Array, Array, Array]:
    """A cart under a sampled PID, and a light mass on it by a spring and a damper, exactly.

    Returns:
        x, z, x', z', x'' and z'' (z relative to the cart) and force at five instants a hold, those
        at a jump just after it.
    """
    period, parts = 1e-3, 5
    M = np.linalg.inv([[CART + BOB, BOB], [BOB, BOB]])
    A, B = np.zeros((4, 4)), np.zeros(4)
    A[:2, 2:], A[2:, 1], A[2:, 3], B[2:] = np.eye(2), -SPRING * M[:, 1], -DAMPER * M[:, 1], M[:, 0]
    whole = np.zeros((5, 5))
    whole[:4, :4], whole[:4, 4] = A, B
    ahead = expm(whole * period / parts)
    x, integral, states, forces = np.zeros(5), 0.0, [], []
    for k in range(round(end / period) * parts + 1):
        if k % parts == 0 and k < round(end / period) * parts:  # a sample at the end acts no more
            error = target - x[0]
            x[4] = gains @ [error, integral, -x[2]]
            integral += period * error
        states.append([*x[:4], *(A @ x[:4] + B * x[4])[2:]])
        forces.append(x[4])
        x = ahead @ x
    return period / parts * np.arange(len(states)), np.array(states), np.array(forces)


@pytest.mark.parametrize("kernel", ["1", "0"])
def test_what_dies_within_a_hold_begins_with_what_it_is_given(
    kernel: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A light mass is left behind when the force jumps: no polynomial of a step knows how fast."""
    monkeypatch.setenv("PINFLEX_KERNEL", kernel)
    robot = scenes.load(
        tmp_path,
        [
            scenes.Body("cart", "base", "prismatic", axis=(0, 1, 0), mass=CART),
            scenes.Body("bob", "cart", "prismatic", axis=(0, 1, 0), mass=BOB),
        ],
        "gravity: [0, 0, 0]\nactuated: [cart_joint]\nplatform: bob\n"
        f"joints: {{bob_joint: {{spring: {SPRING}, damper: {DAMPER}}}}}\n"
        "motion: {kind: hold, duration: 0.05}\n",
    )
    gains, target = np.array([9e3, 2e5, 150.0]), 0.01
    control = pf.Control(
        (pf.Travel("cart_joint"),), (pf.Effort("cart_joint"),),
        pf.digital_pid(*gains, period=1e-3, reference=target), period=1e-3, limit=(np.inf,),
    )  # fmt: skip
    t, exact, force = shaken(0.05, gains, target)
    found = pf.solve(robot, level="coupled", control=control, samples=len(t), tol=1e-3)
    joints = [found.joint(name) for name in ("cart_joint", "bob_joint")]
    q, v, a = (
        np.stack([getattr(x, what) for x in joints], axis=1)
        for what in ("position", "velocity", "acceleration")
    )
    for ours, theirs in ((q, exact[:, :2]), (v, exact[:, 2:4]), (a, exact[:, 4:])):
        apart = np.abs(ours - theirs) / np.abs(theirs).max(axis=0)
        assert apart[::5].max() < 1e-3, apart[::5].max(axis=0)  # the tolerance; seen: 4e-5
    assert np.abs(found.torque[:, 0] - force).max() < 1e-3 * np.abs(force).max()  # seen: 3e-10
    platform = found.array("frame/bob/acceleration")[:, 1]
    told, whole = found.meta["settings"]["error"], exact[:, 4] + exact[:, 5]
    off = np.abs(platform - whole).max() / np.abs(whole).max()
    assert off < told["platform acceleration"]  # between instants, too; seen: 0.007 of 0.048


@pytest.mark.parametrize("dampers", [(20.0, 3.0), (0.0, 0.0)])
def test_what_has_no_mass_begins_a_hold_in_balance(
    dampers: tuple[float, float], tmp_path: Path
) -> None:
    """A cart, a pin without mass, a bob: the pin's balance gives its speed, its rate the rest.

    d1 z1' + k1 z1 = d2 z2' + k2 z2 with z1 + z2 = s; without dampers z1 is a part of s.
    """
    (d1, d2), k1, k2, bob, period, parts = dampers, 2000.0, 500.0, 0.2, 1e-3, 5
    gains, target = np.array([9e3, 2e5, 150.0]), 0.01
    robot = scenes.load(
        tmp_path,
        [
            scenes.Body("cart", "base", "prismatic", axis=(0, 1, 0), mass=CART),
            scenes.Body("pin", "cart", "prismatic", axis=(0, 1, 0)),
            scenes.Body("bob", "pin", "prismatic", axis=(0, 1, 0), mass=bob),
        ],
        "gravity: [0, 0, 0]\nactuated: [cart_joint]\nplatform: bob\n"
        f"joints: {{pin_joint: {{spring: {k1}, damper: {d1}}}, "
        f"bob_joint: {{spring: {k2}, damper: {d2}}}}}\n"
        "motion: {kind: hold, duration: 0.05}\n",
    )
    control = pf.Control(
        (pf.Travel("cart_joint"),), (pf.Effort("cart_joint"),),
        pf.digital_pid(*gains, period=period, reference=target), period=period, limit=(np.inf,),
    )  # fmt: skip
    found = pf.solve(robot, level="coupled", control=control, samples=251, tol=1e-3)
    # rows of the state (c, s, z1, c', s', u) that are z1, z1', and then c'' and s''
    unit = np.eye(6)
    z1 = unit[2] if d1 else k2 / (k1 + k2) * unit[1]
    v1 = (d2 * unit[4] + k2 * (unit[1] - z1) - k1 * z1) / (d1 + d2) if d1 else z1[1] * unit[4]
    pulls = k2 * (unit[1] - z1) + d2 * (unit[4] - v1)
    cart = (unit[5] + k1 * z1 + d1 * v1) / CART
    A = np.stack([unit[3], unit[4], v1, cart, -cart - pulls / bob, 0 * cart])
    a1 = (d2 * A[4] + k2 * (unit[4] - v1) - k1 * v1) / (d1 + d2) if d1 else z1[1] * A[4]
    ahead, x, integral, exact = expm(A * period / parts), np.zeros(6), 0.0, []
    for k in range(len(found.t)):
        if k % parts == 0 and k < len(found.t) - 1:
            x[5] = gains @ [target - x[0], integral, -x[3]]
            integral += period * (target - x[0])
        exact.append([A[3] @ x, a1 @ x, (A[4] - a1) @ x])
        x = ahead @ x
    a = np.stack([found.joint(f"{n}_joint").acceleration for n in ("cart", "pin", "bob")], axis=1)
    apart = np.abs(a - exact)[1:] / np.abs(exact).max(axis=0)  # at the start the pin's is any
    assert apart.max() < 1e-3, apart.max(axis=0)  # the tolerance
    assert apart[4::5].max() < 1e-6  # just after instants


@pytest.mark.parametrize("rotor", [0.0, 1e-4])
def test_what_has_no_mass_is_not_pushed_by_a_held_force(rotor: float, tmp_path: Path) -> None:
    """A plate on a damper: without mass d v = u jumps; with a rotor's, u (1 - exp(-d t / m))."""
    d, push, period, parts = 2.0, 3.0, 1e-3, 20
    robot = scenes.load(
        tmp_path,
        [
            scenes.Body("cart", "base", "prismatic", axis=(0, 1, 0), mass=CART),
            scenes.Body("plate", "base", "prismatic", axis=(0, 1, 0)),
        ],
        "gravity: [0, 0, 0]\nactuated: [cart_joint]\nplatform: plate\n"
        f"joints: {{plate_joint: {{damper: {d}, rotor_inertia: {rotor}}}}}\n"
        "motion: {kind: hold, duration: 0.01}\n",
    )
    control = pf.Control(
        (pf.Travel("cart_joint"),), (pf.Effort("plate_joint"),),
        lambda t, m, rate, total: np.array([push if t < 4.5 * period else -push]), period=period,
        limit=(np.inf,),
    )  # fmt: skip
    keys = {"level": "coupled", "control": control, "samples": 10 * parts + 1, "tol": 1e-3}
    if not rotor:
        with pytest.raises(pf.DescriptionError, match="plate_joint pushes what has no mass"):
            pf.solve(robot, **keys)
        return
    found = pf.solve(robot, **keys).joint("plate_joint").velocity
    t = period / parts * np.arange(10 * parts + 1)
    late = np.maximum(t - 5 * period, 0.0)
    exact = push / d * (1 - np.exp(-d * t / rotor) - 2 * (1 - np.exp(-d * late / rotor)))
    assert np.abs(found - exact).max() < 1e-3 * np.abs(exact).max()  # the tolerance


def test_what_rests_before_a_load_comes_begins_with_what_that_does(tmp_path: Path) -> None:
    """Until then accelerations are round-off, of which no correction leaves a millionth."""
    load = "gravity: [0, 0, -9.81]\nactuated: [cart_joint]\nsolve: {start: static}\n"
    load += "joints: {bob_joint: {spring: 300, damper: 1}}\nmotion: {kind: hold, duration: 0.2}\n"
    load += "forces: {push: {at: cart, force: [0, 0, 2], start: 0.1}}\n"
    bodies = (scenes.Body("cart", "base", "prismatic", axis=(0, 0, 1), mass=0.7),
              scenes.Body("bob", "cart", "prismatic", axis=(0, 0, 1), mass=0.13))  # fmt: skip
    control = pf.Control(
        (pf.Travel("cart_joint"),), (pf.Effort("cart_joint"),),
        lambda t, m, rate, total: 0.83 * 9.81 - 500 * m - 10 * rate, period=1e-3, limit=(np.inf,),
    )  # fmt: skip
    robot = scenes.load(tmp_path, bodies, load)
    found = pf.solve(robot, level="coupled", control=control, samples=401, tol=1e-3)
    cart, bob = (found.joint(name) for name in ("cart_joint", "bob_joint"))
    sprung = 300 * bob.position + 1 * bob.velocity
    acts = found.torque[:, 0] + sprung + 2.0 * (found.t > 0.1 - 1e-9)
    # on instants (every other sample) to round-off; two newtons were missing at 0.1 s
    np.testing.assert_allclose(0.7 * (cart.acceleration + 9.81), acts, atol=1e-9)


@pytest.mark.parametrize("delay", [0.0, 0.004, 0.025])
def test_it_is_so_beside_a_flexible_arm_in_two_steps_a_hold(delay: float, tmp_path: Path) -> None:
    """The kernel marches it: forces are held, the method is not begun anew where they change."""
    robot = scenes.load(
        tmp_path,
        [
            scenes.Body("arm", "base", "revolute", mass=1.0, com=(0,) * 3, inertia=(0.1, 0.1, J)),
            scenes.Body("beam", "base", "revolute", mass=1.0, com=(0.5, 0, 0), inertia=(1e-3,) * 3),
            scenes.Body("tip", "beam", xyz=(1, 0, 0)),
        ],
        "gravity: [0, 0, 0]\nframes: [tip]\nsolve: {drive: torque, kp: 5, kd: 1}\n"
        "motion: {kind: cycloid, joints: {beam_joint: 0.2}, duration: 0.5}\n"
        f"flexible:{scenes.UNIT_BEAM}",
    )
    kp, kd = 40.0, 3.0
    control = pf.Control(
        ARM, HUB, lambda t, m, rate, total: kp * (1 - m) - kd * rate, period=PERIOD, delay=delay
    )
    found = pf.solve(robot, level="coupled", control=control, samples=501, tol=1e-3)
    exact = sampled(501, kp, kd, delay)
    # of Newton's iteration, which stops for the beam too; seen: 4e-11
    np.testing.assert_allclose(found.joint("arm_joint").position, exact, atol=1e-9)
    assert found.meta["energy_balance"] < 1e-5
    holds = 50 * (1 + (delay % PERIOD > 0))
    assert found.meta["cost"]["last_steps"] <= 2.2 * holds


def test_a_robot_under_a_sampled_pid_is_the_same_without_the_kernel(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of ur5, whose elbow has a controller at 1 kHz."""
    law = pf.digital_pid(2000.0, 500.0, 60.0, period=1e-3)
    joint = "elbow_joint"
    control = pf.Control(
        (pf.Travel(joint),), (pf.Effort(joint),), law, period=1e-3, follow=(True,),
        rigid_torque=(True,),
    )  # fmt: skip

    def run() -> pf.Result:
        return pf.solve("ur5", level="coupled", control=control, until=0.02, samples=41, tol=1e-4,
                        kp=2e3, kd=60.0)  # fmt: skip

    found = run()
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    wanted = run()
    for a, b in (
        (found.torque, wanted.torque),
        (found.joint(joint).position, wanted.joint(joint).position),
        (found.arrays[f"control/{joint}"], wanted.arrays[f"control/{joint}"]),
    ):
        assert np.abs(a - b).max() < 1e-4 * np.abs(b).max()  # the tolerance of each


def test_a_loop_that_shakes_its_robot_is_named(free: pf.Mechanism) -> None:
    """A sampled speed, J q'' = -kd q', is stable for kd T < 2 J; at limits of 20 N m it shakes."""
    for kd, shakes in ((0.9 * 2 * J / PERIOD, False), (1.1 * 2 * J / PERIOD, True)):
        law = pf.digital_pid(40.0, 0.0, kd, period=PERIOD, reference=1.0)
        control = pf.Control(ARM, HUB, law, period=PERIOD, limit=(20.0,))
        said = [x for x in run(free, control).meta["warnings"] if x.startswith("control: ")]
        assert len(said) == shakes
        assert np.isnan(pf.margins(free, control).rows[0].low) == shakes
        for words in said:
            assert (
                "arm_joint (by 40 each time)" in words  # from limit to limit
                and "nearly every sample" in words
                and "50 Hz" in words
            )


def test_a_loop_that_begins_to_shake_late_is_named(free: pf.Mechanism) -> None:
    """Its gain on the speed is half of what is stable, and from 0.7 s on one and a half times."""

    def law(t: float, m: Array, rate: Array, total: Array) -> Array:
        return 40.0 * (1.0 - m) - (0.5 if t < 0.7 else 1.5) * 2 * J / PERIOD * rate

    control = pf.Control(ARM, HUB, law, period=PERIOD, limit=(20.0,))
    (words,) = [x for x in run(free, control).meta["warnings"] if x.startswith("control: ")]
    assert "arm_joint (by 40 each time)" in words


def test_runs_that_an_unstable_loop_parts_end_with_its_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The last wrist of ur5 is too light for the gains of its arm: finer runs never agree."""
    joints = pf.load("ur5").motors
    control = pf.Control(
        tuple(map(pf.Travel, joints)), tuple(map(pf.Effort, joints)),
        pf.digital_pid(2000.0, 500.0, 60.0, period=1e-3), period=1e-3,
        follow=(True,) * 6, rigid_torque=(True,) * 6,
    )  # fmt: skip
    # from limit to limit of 28 N m, but for a few samples
    monkeypatch.setattr(tolerance, "_LASTS", 0.0)  # s: from then on it is said beforehand, once
    with (
        pytest.warns(pf.UnstableWarning, match="linearised at t = 0 s .* goes on") as before,
        pytest.raises(pf.ConvergenceError, match=r"wrist_3_joint \(by 5[56]\S* each time") as error,
    ):
        pf.solve("ur5", level="coupled", control=control, until=0.2, tol=1e-2)
    assert len(before) == 1 and error.value.result.meta["cost"]["runs"] == 3


def with_block(robot: pf.Mechanism, block: str, *more: str) -> pf.Mechanism:
    return pf.load(robot.description.path, [f"control={block}", *more])


def test_the_yaml_has_the_exact_discrete_loop_with_a_delay_and_a_limit(free: pf.Mechanism) -> None:
    """PI with a limit, a delay of two and a half samples: the law as a loop, parabolas between."""
    kp, ki, kd, delay, limit, target = 40.0, 30.0, 3.0, 0.025, 15.0, 0.7
    robot = with_block(
        free,
        f"{{period: {PERIOD}, delay: {delay}, hub: {{measure: {{joint: arm_joint}}, "
        f"drive: {{joint: arm_joint}}, kp: {-kp}, ki: {-ki}, kd: {-kd}, target: {target}, "
        f"limit: {limit}}}}}",
    )
    found = pf.solve(robot, level="coupled", samples=1001)
    q, v, u, integral, waiting, exact, h = 0.0, 0.0, 0.0, 0.0, list[tuple[float, float]](), [], 1e-3
    for k in range(1001):
        exact.append(q)
        if k % 10 == 0:
            error = target - q
            asked = kp * error + ki * integral - kd * v
            given = min(max(asked, -limit), limit)
            integral += PERIOD * error * ((asked - given) * error <= 0.0)
            waiting.append((k * h + delay, given))
        while waiting and waiting[0][0] <= k * h + 1e-9:
            u = waiting.pop(0)[1]
        q, v = q + h * v + h * h * u / J / 2, v + h * u / J
    # round-off: Radau is exact on parabolas
    np.testing.assert_allclose(found.joint("arm_joint").position, exact, atol=1e-12)
    assert np.max(np.abs(found.arrays["control/hub"])) == limit  # it did saturate


def test_the_yaml_follows_the_motion_as_a_controller_made_in_python_does(
    free: pf.Mechanism,
) -> None:
    """Reference, speed and rigid torque of the motion, those of Python from its formula."""
    kp, kd, T, size = 5.0, 0.4, 0.5, 0.8
    entry = "measure: {joint: arm_joint}, drive: {joint: arm_joint}"
    motion = f"motion={{kind: cycloid, joints: {{arm_joint: {size}}}, duration: {T}}}"
    block = f"{{period: 0.02, delay: 0.01, hub: {{{entry}, kp: {-kp}, kd: {-kd}, target: motion}}}}"
    robot = with_block(free, block, motion)

    def cycloid(t: float) -> tuple[Array, Array, Array]:
        u, w = min(t / T, 1.0), 2.0 * np.pi
        u = max(u, 0.0)
        return (np.array([size * (u - np.sin(w * u) / w)]),
                np.array([size / T * (1.0 - np.cos(w * u))]),
                np.array([size / T**2 * w * np.sin(w * u)]))  # fmt: skip

    law = pf.digital_pid(kp, 0.0, kd, period=0.02, reference=lambda t: cycloid(t)[0],
                         rate=lambda t: cycloid(t)[1])  # fmt: skip
    control = pf.Control(
        ARM, HUB, law, period=0.02, delay=0.01, forward=lambda t: J * cycloid(t)[2]
    )
    same = pf.solve(free, control=control, level="coupled", until=0.8, samples=81)
    found = pf.solve(robot, level="coupled", until=0.8, samples=81)
    position = found.joint("arm_joint").position
    # torques are interpolated between 401 instants, one of them at the end of the motion
    assert np.max(np.abs(position - same.joint("arm_joint").position)) < 1e-6
    assert abs(position[-1] - size) < 1e-2 * size
    blind = pf.solve(with_block(free, block.replace("motion}", "motion, forward: none}"), motion),
                     level="coupled", until=0.8, samples=81)  # fmt: skip
    late = np.abs(blind.joint("arm_joint").position - same.joint("arm_joint").position)
    assert np.max(late) > 0.01 * size  # without the rigid torque it lags


def test_a_digital_block_that_cannot_be_is_refused(free: pf.Mechanism) -> None:
    ends = "measure: {joint: arm_joint}, drive: {joint: arm_joint}"
    for block, words in (
        (f"{{delay: 0.1, hub: {{{ends}, kp: 1}}}}", "control.delay: only a digital"),
        (f"{{hub: {{{ends}, kp: 1, limit: 3}}}}", "limit: only a digital"),
        (f"{{hub: {{{ends}, kp: 1, target: motion}}}}", "target: motion: only a digital"),
        ("{period: 0.1}", "nothing that is measured"),
        (f"{{period: 0.1, hub: {{{ends}}}}}", "it does nothing"),
        (f"{{period: 0, hub: {{{ends}, kp: 1}}}}", "control.period: 0"),
        (f"{{period: 0.1, hub: {{{ends}, kp: 1, forward: rigit}}}}", "rigid"),
    ):
        with pytest.raises(pf.DescriptionError, match=words):
            with_block(free, block)


def test_a_system_as_law_is_the_closed_loop_of_python_control(free: pf.Mechanism) -> None:
    """A lead filter with a delay of one sample, which is one more pole at zero."""
    control = pytest.importorskip("control")
    lead = control.tf([20.0, 60.0], [0.05, 1.0])  # continuous: made discrete by Tustin's rule
    discrete = control.c2d(lead, PERIOD, method="bilinear")
    plant = control.c2d(control.tf([1.0], [J, 0.0, 0.0]), PERIOD, method="zoh")
    late = control.tf([1.0], [1.0, 0.0], PERIOD)
    _, expected = control.step_response(control.feedback(discrete * late * plant), T=100 * PERIOD)
    scipy_law = StateSpace(*control.ssdata(control.ss(lead)))
    for law in (lead, discrete, control.ss(discrete), scipy_law, scipy_law.to_tf()):
        given = pf.Control(
            ARM, HUB, law, period=PERIOD, delay=PERIOD, reference=lambda t: np.ones(1)
        )
        found = run(free, given).joint("arm_joint").position[::10]
        # of transfer functions in z near one, with roots known to 1e-8
        np.testing.assert_allclose(found, expected[: len(found)], atol=1e-7)


def test_a_flexible_arm_under_a_sampled_law_is_the_discrete_linear_model(tmp_path: Path) -> None:
    bodies = [
        scenes.Body("beam", "base", "revolute", mass=1.0, com=(0.5, 0, 0), inertia=(1e-3,) * 3),
        scenes.Body("tip", "beam", xyz=(1, 0, 0)),
    ]
    yaml = "gravity: [0, 0, 0]\nplatform: tip\nmotion: {kind: hold, duration: 3}\n"
    yaml += "joints: {beam_joint: {rotor_inertia: 0.1}}\nflexible:" + scenes.UNIT_BEAM
    yaml += "    basis: {kind: craig_bampton, internal: 2}\n"
    robot = scenes.load(tmp_path, bodies, yaml)
    kp, kd, period, size = 1.0, 0.8, 0.05, 1e-4  # small, so that the linear model is the truth
    control = pf.Control(
        (pf.Travel("beam_joint"),),
        (pf.Effort("beam_joint"),),
        lambda t, m, rate, total: kp * (size - m) - kd * rate,
        period=period,
    )
    found = pf.solve(robot, control=control, level="coupled", tol=1e-6, until=3.0, samples=61)
    model = pf.linearise(robot, outputs=["beam_joint", "beam_joint.velocity", "tip.y"])
    A, B, C, _, _ = cont2discrete((model.A, model.B, model.C, model.D), period)
    feed = np.array([[kp, kd, 0.0]]) @ C
    closed = (A - B @ feed, B * kp * size, C, np.zeros((3, 1)), period)
    _, out, _ = dlsim(closed, np.ones(61))
    tip = found.array("frame/tip/position")[:, 1]
    for ours, theirs in ((found.joint("beam_joint").position, out[:, 0]), (tip, out[:, 2])):
        # terms of second order: size; and the tolerance of the run
        assert np.max(np.abs(ours - theirs)) < 1e-5 * np.max(np.abs(theirs))


def test_torque_saturates_at_the_effort_limit_and_the_pid_does_not_wind_up(tmp_path: Path) -> None:
    robot = turntable(tmp_path, effort=4.0)
    gains = {"kp": 60.0, "ki": 200.0, "kd": 8.0}
    period, target = 0.005, 1.0

    def winding(t: float, m: Array, rate: Array, total: Array) -> Array:
        error = target - m
        return gains["kp"] * error + gains["ki"] * (target * t - total) - gains["kd"] * rate

    law = pf.digital_pid(**gains, period=period, reference=target)
    found, without = (
        run(robot, pf.Control(ARM, HUB, one, period=period), 3.0) for one in (law, winding)
    )
    assert np.max(np.abs(found.torque)) == pytest.approx(4.0, rel=1e-12)
    overshoot, worse = (x.joint("arm_joint").position.max() - target for x in (found, without))
    assert worse > 2.0 * overshoot > 0.0  # 1.86 and 0.29 rad
    # the law as a loop of its own, on the exact discrete mass
    q = v = integral = 0.0
    for _ in range(600):
        error = target - q
        asked = gains["kp"] * error + gains["ki"] * integral - gains["kd"] * v
        u = min(max(asked, -4.0), 4.0)
        if (asked - u) * error <= 0.0:
            integral += period * error
        q, v = q + period * v + period**2 * u / J / 2, v + period * u / J
    assert found.joint("arm_joint").position[-1] == pytest.approx(q, abs=1e-9)
    assert found.arrays["control/arm_joint"][0] == 4.0
    assert law.integral == 0.0  # every run works on a copy of it
    lifted = run(robot, pf.Control(ARM, HUB, law, period=period, limit=(np.inf,)), 0.1)
    assert np.max(np.abs(lifted.torque)) > 50.0


def test_a_sampled_patch_acts_as_a_continuous_one_that_is_constant() -> None:
    changes = ["motion={kind: hold, duration: 0.1}",
               "flexible.beam.patches={pzt: {from: 0.115, to: 0.145, constant: 5e-4}}"]  # fmt: skip
    robot = pf.load("prprp", ["flexible.beam.basis={kind: assumed, boundary: free_free, modes: 8}",
                              *changes])  # fmt: skip
    volts = (pf.Voltage("pzt"),)

    def law(t: float, m: Array, rate: Array, total: Array) -> Array:
        return np.array([100.0])

    held = pf.solve(robot, level="coupled", tol=1e-5, until=0.1, samples=51, start="straight",
                    control=pf.Control((), volts, law, period=0.01))  # fmt: skip
    same = pf.solve(robot, level="coupled", dt=1e-4, until=0.1, samples=51, start="straight",
                    control=pf.Control((), volts, law))  # fmt: skip
    a, b = (x.arrays["link/beam/deflection"][:, -1, 1] for x in (held, same))
    assert np.max(np.abs(a - b)) < 2e-3 * np.max(np.abs(b))  # second order in dt
    assert held.meta["energy_balance"] < 1e-4


def test_what_a_digital_controller_cannot_be_is_refused(free: pf.Mechanism) -> None:
    law = pf.digital_pid(1.0, period=PERIOD)
    with pytest.raises(pf.DescriptionError, match="Give its period"):
        pf.Control(ARM, HUB, law)
    with pytest.raises(pf.DescriptionError, match="period: -1"):
        pf.Control(ARM, HUB, law, period=-1.0)
    with pytest.raises(pf.DescriptionError, match="for 1 drives"):
        pf.Control(ARM, HUB, law, period=PERIOD, limit=(1.0, 2.0))
    with pytest.raises(pf.DescriptionError, match="Give a tol instead of dt"):
        pf.solve(free, level="coupled", dt=1e-3, control=pf.Control(ARM, HUB, law, period=PERIOD))
    other = pf.Control(ARM, HUB, StateSpace([[0.5]], [[1]], [[1]], [[0]], dt=0.02), period=PERIOD)
    with pytest.raises(pf.DescriptionError, match="sample time is 0.02 s"):
        run(free, other)
    two = pf.Control(ARM, HUB, StateSpace([[0.5]], [[1, 1]], [[1]], [[0, 0]]), period=PERIOD)
    with pytest.raises(pf.DescriptionError, match="2 inputs and 1 outputs for 1 measures"):
        run(free, two)
