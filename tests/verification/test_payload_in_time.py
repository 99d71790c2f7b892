"""A payload that comes or goes: torques beside Pinocchio, vibration after it, energy, refusals.

Claims:
    Machines
    - payload that comes or goes: torques of a UR5 on both sides of the instant, levels rigid and
      quasistatic | bare Pinocchio; the same robot with and without it | 1e-11 | passes
    - mass that is let go of, or caught and let go of, on an elastic drive, on and between steps:
      ked and coupled, by tol and in equal steps, with and without the kernel | closed form | 1e-7
      by tol; second order in steps | 2e-8; ratios 4.0
    - the same where a force or the motors' acceleration switches in the same step, or beside it |
      its run by tol | second order in steps | ratios 4.0
    - the same for a delta with locked motors | its run without the payload from the same state |
      1e-7 | passes
    - energy that it brings and takes between two samples | 1/2 m (v1^2 - v2^2) and weight, closed
      form | 1e-3 | passes (none before)
    - energy that it brings to or takes from a turning arm | m r^2 w^2 / 2 | 1e-9 | passes
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from tests.finite import by_configuration, by_speed, close, random_state
from tests.scenes import Body, load
from tests.verification.test_added_masses import ARM, YAML

BODY = "at: tool0, mass: 5, centre: [0.1, -0.05, 0.2], inertia: [0.1, 0.2, 0.25]"


def bare_torques(robot: pf.Mechanism, run: pf.Result, carried: Array) -> Array:
    """Of Pinocchio, for the joints' motion of a run; `carried`: at which instants."""
    own = pin.buildModelFromXML(robot.description.urdf_text)
    more = pin.buildModelFromXML(robot.description.urdf_text)
    tool = more.frames[more.getFrameId("tool0")]
    body = pin.Inertia(5.0, np.array([0.1, -0.05, 0.2]), np.diag([0.1, 0.2, 0.25]))
    more.appendBodyToJoint(tool.parentJoint, body, tool.placement)
    found = []
    for k, held in enumerate(carried):
        q, v, a = (np.array([getattr(run.joint(n), x)[k] for n in run.motors])
                   for x in ("position", "velocity", "acceleration"))  # fmt: skip
        model = more if held else own
        found.append(pin.rnea(model, model.createData(), q, v, a))
    return np.array(found)


@pytest.mark.parametrize("when", ["from: 0.2", "until: 0.2", "from: 0.1, until: 0.2034"])
def test_rigid_torques_are_those_of_pinocchio_on_either_side(when: str) -> None:
    robot = pf.load("ur5")
    run = pf.solve(robot.with_(f"payload={{{BODY}, {when}}}"), level="rigid", until=0.4, samples=41)
    held = (run.t > 0.2 - 1e-9) if when == "from: 0.2" else run.t < 0.2 - 1e-9
    if "0.1" in when:  # a sample on the instant has what is just after it
        held = (run.t > 0.1 - 1e-9) & (run.t < 0.2034)
    expected = bare_torques(robot, run, held)
    assert np.abs(run.torque - expected).max() < 1e-11 * np.abs(expected).max()  # other sums


def test_balance_jumps_where_it_goes() -> None:
    robot, ends = pf.load("ur5"), {"until": 0.4, "samples": 41}
    with_it = pf.solve(robot.with_(f"payload={{{BODY}}}"), level="quasistatic", **ends)
    without = pf.solve(robot, level="quasistatic", **ends)
    run = pf.solve(robot.with_(f"payload={{{BODY}, until: 0.2}}"), level="quasistatic", **ends)
    held = run.t < 0.2 - 1e-9
    for key in ("torque", "frame/tool0/position"):
        a, b, found = (x.array(key) for x in (with_it, without, run))
        assert np.abs(found - np.where(held[:, None], a, b)).max() < 1e-11 * np.abs(a).max()
        assert np.abs(a - b)[~held].max() > 1e3 * 1e-11 * np.abs(a).max()


MASS, LOAD, STIFFNESS, G = 2.0, 1.5, 900.0, 9.81
DROPPED = "until: 0.3", [(0.3, MASS)], (-(MASS + LOAD) * G / STIFFNESS, MASS + LOAD)
CAUGHT = "from: 0.2037, until: 0.61", [(0.2037, MASS + LOAD), (0.61, MASS)], (0.0, MASS)


def hung(folder: Path, when: str, start: str, more: str = "") -> pf.Mechanism:
    """A mass that hangs on the elastic gear of a motor."""
    bodies = (Body("block", "base", "prismatic", axis=(0, 0, 1), mass=MASS),)
    drive = f"{{gear: 1, motor_inertia: 0.3, stiffness: {STIFFNESS}}}"
    return load(folder, bodies, f"""actuated: [block_joint]
joints: {{block_joint: {{drive: {drive}}}}}
platform: block
payload: {{at: block, mass: {LOAD}, {when}}}
motion: {{kind: hold, duration: 1}}
solve: {{start: {start}, until: 1.0, samples: 101}}
{more}""")  # fmt: skip


def closed_form(t: Array, changes: list[tuple[float, float]], start: tuple[float, float]) -> Array:
    """Place of the mass (nt,): swings about -m g / k, place and speed kept where m changes."""
    (z, mass), v, found = start, 0.0, np.zeros_like(t)
    times = [(0.0, mass), *changes]
    for (begin, mass), end in zip(times, [*(x for x, _ in changes), np.inf], strict=True):
        w, rest = np.sqrt(STIFFNESS / mass), -mass * G / STIFFNESS
        here, s = t > begin - 1e-12, t - begin
        found[here] = (rest + (z - rest) * np.cos(w * s) + v / w * np.sin(w * s))[here]
        if np.isfinite(end):
            c, n = np.cos(w * (end - begin)), np.sin(w * (end - begin))
            z, v = rest + (z - rest) * c + v / w * n, v * c - (z - rest) * w * n
    return found


@pytest.mark.parametrize("kernel", ["1", "0"])
@pytest.mark.parametrize(
    ("case", "start"), [(DROPPED, "auto"), (CAUGHT, "straight")], ids=["dropped", "caught"]
)
def test_a_mass_that_goes_leaves_the_closed_form(
    case: Any, start: str, kernel: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frequency sqrt(k / m) and swing m g / k of what is let go of, from the rest with both."""
    monkeypatch.setenv("PINFLEX_KERNEL", kernel)
    when, changes, begun = case
    robot = hung(tmp_path, when, start)

    def off(run: pf.Result) -> float:
        place = closed_form(run.t, changes, begun)
        pull = np.abs(run.torque[:, 0] + STIFFNESS * place).max() / STIFFNESS  # of the gear
        way = np.abs(run.frame("block").position[:, 2] - place).max()
        return float(max(pull, way) / np.abs(place).max())

    run = pf.solve(robot, level="coupled", tol=1e-6)
    assert off(run) < 1e-7  # tol is kept by far in so smooth a swing
    # the speed between samples 10 ms apart is read to (w h)^3 / 12 where it is caught at speed
    assert run.meta["energy_balance"] < (1e-7 if start == "auto" else 5e-4)
    for level in ("ked", "coupled"):
        errors = [off(pf.solve(robot, level=level, dt=dt)) for dt in (1e-3, 5e-4)]
        # phase (w h)^2 w t / 24 = 4e-4 of a swing of half the place
        assert errors[0] < 4e-4 and errors[0] > 3.5 * errors[1], (level, errors)
    if kernel == "1":  # level ked off polynomials, as it goes in many steps
        assert off(pf.solve(robot, level="ked", dt=5e-5)) < 1e-6


@pytest.mark.parametrize("level", ["ked", "coupled"])
def test_a_mass_between_two_samples_brings_and_takes_energy(level: str, tmp_path: Path) -> None:
    """Caught and let go of between samples: 1/2 m (v1^2 - v2^2), of the closed form."""
    first, last = 0.111, 0.119
    robot = hung(tmp_path, f"from: {first}, until: {last}", "straight")
    run = pf.solve(robot, level=level, dt=1e-4)
    assert not np.any((run.t > first) & (run.t < last))
    moved = [(first, MASS + LOAD), (last, MASS)]
    near = np.array([first - 1e-6, first + 1e-6, last - 1e-6, last + 1e-6])
    z = closed_form(near, moved, (0.0, MASS))
    v1, v2 = (z[1] - z[0]) / 2e-6, (z[3] - z[2]) / 2e-6
    held = closed_form(np.array([first, last]), moved, (0.0, MASS))
    brought = LOAD / 2 * (v1**2 - v2**2) - LOAD * G * (held[1] - held[0])
    got = run.array("energy/loads")
    size = LOAD / 2 * v1**2
    # parabolas of the samples to (w h)^3 / 6; nothing of it was seen before
    assert abs(got[-1] - got[0] - brought) < 1e-3 * size and abs(brought) > 1e-2 * size
    assert run.meta["energy_balance"] < 1e-4


JUMP = "motion={kind: trapezoid, joints: {block_joint: 0.3}, duration: 0.6, ramp: 0.3}"
PUSH = "forces={{push: {{at: block, force: [0, 0, 30], start: 0.1, until: {}}}}}"


@pytest.mark.parametrize("change", [JUMP, PUSH.format(0.3), PUSH.format(0.2995)])
@pytest.mark.parametrize("when", ["from: 0.3", "until: 0.29999"])
def test_what_switches_with_it_keeps_the_order_of_steps(
    change: str, when: str, tmp_path: Path
) -> None:
    """In its step, or in the one beside it, whose mean would reach into it."""
    robot = hung(tmp_path, when, "auto").with_(change)
    exact = pf.solve(robot, level="coupled", tol=1e-7).frame("block").position[:, 2]
    for level in ("ked", "coupled"):
        runs = [pf.solve(robot, level=level, dt=dt) for dt in (1e-3, 5e-4)]
        errors = [np.abs(run.frame("block").position[:, 2] - exact).max() for run in runs]
        # phase, as above
        assert errors[0] < 4e-4 * np.ptp(exact) and errors[0] > 3.5 * errors[1], (level, errors)


def test_motors_that_push_feel_it_too(tmp_path: Path) -> None:
    """A rotor of 0.3 kg and a mass on a spring: what is let go of weighs on both."""
    robot, runs = hung(tmp_path, "until: 0.3037", "auto", ""), []
    for how in ({"tol": 1e-6}, {"dt": 1e-3}, {"dt": 5e-4}):
        runs.append(pf.solve(robot, level="coupled", drive="torque", kp=4000.0, kd=30.0, **how))
    exact, *steps = (run.frame("block").position[:, 2] for run in runs)
    errors = [np.abs(x - exact).max() / np.ptp(exact) for x in steps]
    assert errors[0] < 2e-3 and errors[0] > 3.5 * errors[1], errors


def test_a_delta_that_drops_its_part_goes_on_as_one_without(tmp_path: Path) -> None:
    """Locked motors; from the instant on it is another robot, in the same state."""
    robot = pf.load("delta", ["motion={kind: hold, duration: 1}"])
    at = robot.description.platform
    body = f"at: {at}, mass: 0.3, centre: [0.01, 0.02, -0.03], inertia: [1e-4, 2e-4, 3e-4]"
    dropping = robot.with_(f"payload={{{body}, until: 0.01}}")
    whole = pf.solve(dropping, level="coupled", tol=1e-6, until=0.06, samples=61)
    first = whole.t < 0.01 - 1e-9
    moved = np.abs(whole.frame(at).position[first] - whole.frame(at).position[0]).max()
    state = tuple(
        np.concatenate([whole.array(f"joint/{x}")[0], whole.array(eta)[0]])
        for x, eta in (("q", "eta"), ("v", "eta_v"))
    )
    other = pf.solve(robot, level="coupled", tol=1e-6, until=0.05, samples=51, start=state)
    for key in ("torque", f"frame/{at}/position", f"frame/{at}/acceleration"):
        found, expected = whole.array(key)[10:], other.array(key)
        swing = np.abs(np.ptp(expected, axis=0)).max()
        assert np.abs(found - expected).max() < 1e-5 * swing, key  # both within tol
    assert moved < 1e-9 and whole.meta["energy_balance"] < 1e-5


@pytest.mark.parametrize("when", ["from: 0.25", "until: 0.25"])
def test_the_energy_of_what_comes_or_goes_is_counted(when: str, tmp_path: Path) -> None:
    """An arm turns freely; what it grasps moves with it, and is no impact: the speed stays."""
    bodies = (
        Body("arm", "base", "continuous", mass=0.5, inertia=(1e-2,) * 3),
        Body("tip", "arm", xyz=(0.4, 0, 0)),
    )
    robot = load(tmp_path, bodies, f"""gravity: [0, 0, 0]
actuated: []
payload: {{at: tip, mass: 0.7, centre: [0.1, 0, 0], inertia: [0, 0, 0.02], {when}}}
solve: {{level: coupled, start: straight, start_speeds: {{arm_joint: 3}}, until: 0.4}}
""")  # fmt: skip
    run = pf.solve(robot, tol=1e-8, samples=33)
    assert np.abs(run.joint("arm_joint").velocity - 3.0).max() < 1e-9
    brought = 0.5 * (0.7 * 0.5**2 + 0.02) * 3.0**2
    signed = (run.t > 0.25 - 1e-9) * (brought if "from" in when else -brought)
    np.testing.assert_allclose(run.array("energy/loads"), signed, rtol=0, atol=1e-9 * brought)
    np.testing.assert_allclose(np.ptp(run.array("energy/kinetic")), brought, rtol=1e-9)
    assert run.meta["energy_balance"] < 1e-9


def carrying(folder: Path) -> Mechanism:
    """A bent arm on a free body with a part that comes at 1 s, off the frame that carries it."""
    bodies = (
        Body("hull", "base", mass=1.0, inertia=(0.1, 0.2, 0.3)),
        Body("rod", "hull", "revolute", axis=(0, 0.6, 0.8), rpy=(0.3, 0.2, 0.1)),
        ARM[1],
    )
    part = (
        "payload: {at: tip, mass: 0.8, centre: [0.1, 0.2, -0.1], "
        "inertia: [0.3, 0.4, 0.5, 0.01, 0.02, 0.03], from: 1}"
    )
    rest = YAML.replace("gravity: [0, 0, 0]", "gravity: [0.3, 0.4, -9.81]").split("motion:")[0]
    return load(folder, bodies, f"base: free_flyer\n{part}{rest}")


@pytest.mark.parametrize("t", [0.5, 1.5])
def test_tangents_are_differences_and_the_kernel_is_the_reference(t: float, tmp_path: Path) -> None:
    system = (m := carrying(tmp_path)).flexible
    assert system.uncovered is None
    d = Equations(system)
    y, v, a, lam = random_state(system, m.undeformed(), 5)
    M, C, K, _ = d.tangent(y, v, a, lam, t)
    close(C, by_speed(lambda x: d.residual(y, x, a, lam, t).r, v), 1e-7)
    close(K, by_configuration(d, lambda x: d.residual(x, v, a, lam, t).r, y), 1e-6)
    plain, at = d.reference, np.array([t])
    Y, V, A, L = (x[None] for x in (y, v, a, lam))
    expected = plain.residual(Y, V, A, L, at)[0][0]
    found = d.residual(y, v, a, lam, t).r
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    np.testing.assert_allclose(M, plain.mass(y, t), rtol=0, atol=1e-12 * np.abs(M).max())
    np.testing.assert_allclose(d.mass(y, t), M, rtol=0, atol=1e-12 * np.abs(M).max())
    for one, other in zip(d.energies(Y, V, at), plain.energies(Y, V, at), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-12)
    # its kinetic energy, and what M has of it
    less = d.mass(y, 1.5) - d.mass(y, 0.5)
    more = d.energies(y, v, 1.5).kinetic - d.energies(y, v, 0.5).kinetic
    assert more == pytest.approx(0.5 * v @ less @ v, rel=1e-10)


def test_a_part_that_came_is_the_link_that_a_steady_one_is(tmp_path: Path) -> None:
    """Residual, mass and reactions, past the instant and before it."""
    came = carrying(tmp_path)
    steady, none = came.with_("payload.from=0"), came.with_("payload.mass=0", "payload.centre=null",
                                                             "payload.inertia=null")  # fmt: skip
    y, v, a, lam = random_state(came.flexible, came.undeformed(), 7)
    for t, other in ((1.5, steady), (0.5, none)):
        r, expected = (Equations(m.flexible).residual(y, v, a, lam, t).r for m in (came, other))
        np.testing.assert_allclose(r, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_where_masses_have_to_stay_it_is_refused(tmp_path: Path) -> None:
    robot = pf.load("ur5", [f"payload={{{BODY}, from: 0.2}}"])
    with pytest.raises(pf.DescriptionError, match=r"Simulator: payload: .*reset\(start"):
        pf.Simulator(robot)
    for call in (
        lambda: pf.fastest(robot, to={"shoulder_pan_joint": 0.5}, settle=1e-3),
        lambda: pf.retime(robot, robot.motion),
        lambda: pf.command(robot),
    ):
        with pytest.raises(pf.DescriptionError, match="has to stay here. Leave out both"):
            call()
    with pytest.raises(pf.DescriptionError, match="give the shaper its frequencies"):
        pf.ringing(robot, robot.motion)
    with pytest.raises(pf.DescriptionError, match="method of the alpha family"):
        pf.solve(robot, level="ked", integrator=lambda *_: iter(()), dt=1e-3)
    assert "payload" in pf.advise(robot).why


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("from: -1", r"payload\.from: -1"),
        ("until: 0", r"payload\.until: 0 s\. Give a time after `from`"),
        ("from: 1, until: 0.5", r"until: 0\.5 s\. Give a time after `from`, 1 s"),
        ("from: soon", r"payload\.from"),
    ],
)
def test_times_that_are_none_are_told(keys: str, words: str) -> None:
    with pytest.raises(pf.DescriptionError, match=words):
        pf.load("ur5", [f"payload={{{BODY}, {keys}}}"])
