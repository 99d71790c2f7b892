"""Elastic drives: one elastic coordinate of a joint, and both sides of the gear.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - a rotor's spin in the shaking moment; the damping of what a motion excites | by hand | 1e-12;
      1e-6 | passes | also `unit/studies/test_check_damping.py`
    - what an elastic drive gives out moves its link: work = kinetic energy and weight | by hand |
      1e-6 | passes
    - elastic drives of a ur5: 8.70, 12.29, 20.21 Hz; ringing of ked and coupled after a stop | crba
      + K (+ weight); published | 1e-10; 0.005 Hz; 3 % left, twice with 2 % other frequencies |
      passes
    - elastic drive = URDF with a massless link and a sprung joint, four levels | second formulation
      | 1e-9 m, 1e-6 of the torque | passes
    - elastic drives: every level tends to the robot without them | limit | slope -1 +- 0.05; 1e-4 |
      passes
    - drive: sag, holding torque, frequency, motor free; axis at will, continuous, sliding | closed
      form | 1e-12, 1e-10 | passes
    - power of the motors = stored + damping + friction + gear loss | written anew, Simpson | 1e-6 |
      rigid 1e-16, coupled 1e-12
    - motor torque, speed, use of its curve at constant speed, lifting and lowering | closed form |
      1e-12 | passes
    - mass on a belt: peak, trough, instants of slip and stick, two tolerances; energy is lost,
      never made | closed form (Popp & Stelzer 1990) | 1 % | 0.45 %; balance 2e-9
    - block that friction stops: way, rest, no tolerance asked for | closed form | 1e-3; 1e-6 m |
      passes
    - friction of passive joints in a parallelogram at the motor, four levels | virtual work | 2e-3
      | passes
    - damping and friction of a URDF: rigid torque = rnea + d v + F tanh; without the key rnea to
      the bit | Pinocchio | 1e-12; 0 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import simpson
from scipy.linalg import eigh
from scipy.optimize import brentq

import pinflex as pf
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.recovery.recover import shaking
from pinflex.studies.checking.check import check
from pinflex.viewer.plots.axes import torque_speed
from tests.finite import slope
from tests.scenes import Body, load

# Stiffness, damping, gear and motor inertia of three large drives.
DRIVES = {"shoulder_pan_joint": 1e4, "shoulder_lift_joint": 1e4, "elbow_joint": 0.7e4}
HOME = {"shoulder_lift_joint": -1.2, "elbow_joint": 1.5,
        "wrist_1_joint": -1.8707963267948966, "wrist_2_joint": -1.5707963267948966}  # fmt: skip
PUBLISHED = (8.70, 12.29, 20.21)  # [Hz], by crba + K with the gravity stiffness of that pose


def ur5(folder: Path, scale: float = 1.0, damping: float = 0.0, more: str = "") -> pf.Mechanism:
    joints = "\n".join(
        f"  {name}: {{drive: {{gear: 100, motor_inertia: {k / 1e4 * 1e-4!r}, "
        f"stiffness: {k * scale!r}, damping: {damping!r}}}}}"
        for name, k in DRIVES.items()
    )
    text = f"urdf: example-robot-data:ur5\nhome: {HOME}\nplatform: tool0\njoints:\n{joints}\n"
    (folder / "geared.yaml").write_text(text.replace("'", "") + more)
    return pf.load(folder / "geared.yaml")


@pytest.fixture(scope="module")
def geared(tmp_path_factory: pytest.TempPathFactory) -> pf.Mechanism:
    return ur5(tmp_path_factory.mktemp("ur5"))


def bare(m: pf.Mechanism, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mass matrix and gravity stiffness of the three large joints by Pinocchio alone."""
    model = pin.buildModelFromXML(m.description.urdf_text)
    data = model.createData()
    M = np.triu(pin.crba(model, data, q))
    M = M + np.triu(M, 1).T
    return M[:3, :3], pin.computeGeneralizedGravityDerivatives(model, data, q)[:3, :3]


def hertz(K: np.ndarray, M: np.ndarray) -> np.ndarray:
    return np.sqrt(eigh(K, M, eigvals_only=True)) / (2 * np.pi)


def test_frequencies_are_those_of_crba_and_the_gear_stiffness(geared: pf.Mechanism) -> None:
    M, G = bare(geared, geared.home)
    K = np.diag(list(DRIVES.values()))
    found = pf.modes(geared, preload="none")
    np.testing.assert_allclose(found.frequencies, hertz(K, M), rtol=1e-10)  # the same problem
    assert found.links == tuple(DRIVES)
    # With the weight at the undeflected pose: the published numbers, to their digits.
    d, y = Equations(geared.flexible), geared.undeformed()
    still = np.zeros(d.system.nv)
    stiff = d.tangent(y, still, still, np.zeros(0), 0.0)[2][6:, 6:]
    ours = hertz(stiff, d.mass(y)[6:, 6:])
    np.testing.assert_allclose(ours, hertz(K + G, M), rtol=1e-9)
    np.testing.assert_allclose(ours, PUBLISHED, atol=5e-3)


MOVE = pf.cycloid(
    joints={"shoulder_pan_joint": 0.08, "shoulder_lift_joint": 0.04, "elbow_joint": -0.06},
    duration=0.1,
)


@pytest.mark.parametrize("level", ["ked", "coupled"])
def test_what_is_left_after_a_stop_rings_at_those_frequencies(
    level: str, geared: pf.Mechanism
) -> None:
    """The end pose's crba + K + weight explain the ringing; 1 % other frequencies do not."""
    run = pf.solve(geared, MOVE, level=level, until=0.6, samples=301, dt=5e-4)
    rigid = pf.solve(geared, MOVE, level="rigid", until=0.6, samples=301)
    rings = run.deviation_from(rigid, "tool0").position[run.t > 0.1]
    M, G = bare(geared, rigid.array("joint/q")[-1])
    expected = hertz(np.diag(list(DRIVES.values())) + G, M)

    def missed(frequencies: np.ndarray) -> float:
        """Share of the ringing that vibration of these frequencies does not explain."""
        phase = 2 * np.pi * np.outer(run.t[run.t > 0.1], frequencies)
        A = np.column_stack([np.sin(phase), np.cos(phase), np.ones(len(phase))])
        left = rings - A @ np.linalg.lstsq(A, rings, rcond=None)[0]
        return float(np.std(left) / np.std(rings))

    # Amplitudes of 2 mrad move the frequencies by some 1e-3; so does the sag of 3 mrad.
    assert missed(expected) < 0.03
    assert missed(1.02 * expected) > 2 * missed(expected)
    assert missed(0.98 * expected) > 2 * missed(expected)


def test_stiff_gears_tend_to_the_robot_without_them(tmp_path: Path) -> None:
    """Deviation of the torque falls like 1/k in statics and, by a smooth motion, in dynamics."""
    motion = pf.nonic(joints=dict.fromkeys(DRIVES, 0.3), duration=0.5)
    scales, levels = (1e2, 1e3), ("quasistatic", "ked", "coupled")
    off: dict[str, list[float]] = {level: [] for level in levels}
    for scale in scales:
        m = ur5(tmp_path, scale)
        rigid_gears = [
            f"joints.{j}.drive.{k}=null" for j in DRIVES for k in ("stiffness", "damping")
        ]
        without = pf.load(m.description.with_overrides(rigid_gears))
        assert without.flexible is without.rigid  # a rigid gear has no coordinate
        rigid = pf.solve(without, motion, level="rigid", samples=41)
        held = pf.solve(m, motion, level="rigid", samples=41)
        np.testing.assert_array_equal(held.torque, rigid.torque)
        for level in levels:
            step = {} if level == "quasistatic" else {"dt": 1e-3}
            run = pf.solve(m, motion, level=level, samples=41, **step)
            off[level].append(float(np.abs(run.torque - rigid.torque).max()))
    for level, found in off.items():
        assert slope(scales, found) == pytest.approx(-1.0, abs=0.05), level
        assert found[-1] < 1e-4 * np.abs(rigid.torque).max()


# A motor and a link of mass M at L with the inertia J_C about its centre, lifted about y.
M_L, L, J_C, G = 2.0, 0.5, 0.03, 9.81
ARM = (
    Body("arm", "base", "revolute", axis=(0, 1, 0), mass=M_L, com=(L, 0, 0), inertia=(0, J_C, 0)),
    Body("tip", "arm", xyz=(L, 0, 0)),
)
# The same with the gear as a joint of its own, as one had to write it.
SPLIT = (
    Body("arm", "base", "revolute", axis=(0, 1, 0)),
    Body("gear", "arm", "revolute", axis=(0, 1, 0), mass=M_L, com=(L, 0, 0), inertia=(0, J_C, 0)),
    Body("tip", "gear", xyz=(L, 0, 0)),
)  # fmt: skip
GEAR = "gear: 50, motor_inertia: 4e-5, stiffness: 400, damping: 0.3"


def arm(folder: Path, drive: str = GEAR, more: str = "") -> pf.Mechanism:
    return load(
        folder, ARM, f"joints: {{arm_joint: {{drive: {{{drive}}}}}}}\nplatform: tip\n{more}"
    )


def test_a_drive_is_the_passive_joint_that_one_had_to_write(tmp_path: Path) -> None:
    """Second formulation: URDF with a massless link between motor and gear, spring in the gear."""
    ours = arm(tmp_path)
    split = load(
        tmp_path,
        SPLIT,
        "actuated: [arm_joint]\njoints: {arm_joint: {rotor_inertia: 0.1}, "
        "gear_joint: {spring: 400, damper: 0.3}}\nplatform: tip\n",
    )
    move = pf.cycloid(joints={"arm_joint": 0.8}, duration=0.3)
    for level in ("rigid", "quasistatic", "ked", "coupled"):
        step = {} if level in ("rigid", "quasistatic") else {"dt": 1e-3}
        a, b = (pf.solve(m, move, level=level, samples=31, until=0.4, **step)
                for m in (ours, split))  # fmt: skip
        # Newton of both stops at 1e-7 of the accelerations.
        np.testing.assert_allclose(a.torque, b.torque, atol=1e-6 * np.abs(b.torque).max())
        eta = b.joint("gear_joint").position
        np.testing.assert_allclose(a.drive("arm_joint").deflection, eta, atol=1e-9)
        away = a.frame("tip").position - b.frame("tip").position
        assert np.abs(away).max() < 1e-9


def test_sag_holding_torque_and_frequency_are_the_closed_forms(tmp_path: Path) -> None:
    m = arm(tmp_path)
    angle = brentq(lambda x: 400 * x - M_L * G * L * np.cos(x), 0.0, 1.0, xtol=1e-15)
    rest = pf.static_equilibrium(m)
    assert rest.y[1] == pytest.approx(angle, abs=1e-12)
    assert rest.r[0] == pytest.approx(-400 * angle, rel=1e-12)
    stiff = 400 + M_L * G * L * np.sin(angle)
    f = pf.modes(m).frequencies
    assert f[0] == pytest.approx(np.sqrt(stiff / (J_C + M_L * L**2)) / (2 * np.pi), rel=1e-10)
    # Motor free, no gravity: rotor and link swing against each other.
    free = pf.modes(arm(tmp_path, more="gravity: [0, 0, 0]\n"), free_motors=True).frequencies
    link, rotor = J_C + M_L * L**2, 50**2 * 4e-5
    assert free[-1] == pytest.approx(np.sqrt(400 * (1 / link + 1 / rotor)) / (2 * np.pi), rel=1e-10)


@pytest.mark.parametrize("kind", ["continuous", "prismatic"])
def test_any_joint_of_one_freedom_takes_a_drive(kind: str, tmp_path: Path) -> None:
    """About an axis that is none of x, y, z; continuous joints have cosine and sine in q."""
    u = np.array([1.0, 2.0, 2.0]) / 3
    body = Body("arm", "base", kind, axis=tuple(u), mass=2.0, inertia=(0.1, 0.2, 0.3))
    m = load(tmp_path, [body], "joints: {arm_joint: {drive: {gear: 30, stiffness: 50}}}\n"
             "gravity: [0, 0, 0]\nhome: {arm_joint: 1.3}\n")  # fmt: skip
    inertia = 2.0 if kind == "prismatic" else float(u @ np.diag([0.1, 0.2, 0.3]) @ u)
    found = pf.modes(m, preload="none").frequencies
    assert found[0] == pytest.approx(np.sqrt(50 / inertia) / (2 * np.pi), rel=1e-12)


# Both sides of the gear --------------------------------------------------------------------------


@pytest.mark.parametrize("level", ["rigid", "coupled"])
def test_power_in_at_the_motors_is_stored_or_lost(level: str, tmp_path: Path) -> None:
    """Motor side: work = energy of rotors, links, gears and weight, damping, friction, gear loss.

    The losses are written anew here. Simpson's rule over 2001 instants of a smooth run misses
    1e-8; the friction's change of sign, at rest, is at the ends.
    """
    lost = "friction: {coulomb: 1.5, viscous: 0.4, speed: 0.1}, efficiency: 0.8"
    m = arm(tmp_path, f"{GEAR}, {lost}")
    move = pf.nonic(joints={"arm_joint": -0.9}, duration=0.5)  # up: the motor lifts
    tight = {} if level == "rigid" else {"tol": 1e-6}
    run = pf.solve(m, move, level=level, samples=2001, until=0.5, start="static", **tight)
    d, v = run.drive("arm_joint"), run.joint("arm_joint").velocity
    work = simpson(d.motor_power, x=run.t)
    energy = sum(run.array(f"energy/{k}") for k in ("kinetic", "gravity", "elastic"))
    rate = d.speed - v
    rubbing = simpson(1.5 * np.tanh(v / 0.1) * v + 0.4 * v**2 + 0.3 * rate**2, x=run.t)
    driving = np.tanh(v / 0.1) * np.sign(d.torque)
    loss = d.torque * v * driving * np.where(driving > 0, 1 / 0.8 - 1, 0.2)
    balance = work - (energy[-1] - energy[0]) - rubbing - simpson(loss, x=run.t)
    assert abs(balance) < 1e-6 * abs(work)
    assert np.all(loss >= 0)
    # What the gear gives out is the spring's torque, and moves the link.
    if level == "coupled":
        spring = -(400 * d.deflection + 0.3 * rate)
        np.testing.assert_allclose(d.torque, spring, atol=1e-5 * np.abs(spring).max())
        link = (J_C + M_L * L**2) / 2 * d.speed**2 + run.array("energy/gravity")
        assert simpson(d.power, x=run.t) == pytest.approx(link[-1] - link[0], abs=1e-6 * abs(work))


def test_the_motor_torque_at_constant_speed_is_the_closed_form(tmp_path: Path) -> None:
    """Lifting and lowering a slider of 3 kg at 0.2 m/s: (F_c + d v + m g / e) / n, and m g e."""
    body = Body("load", "base", "prismatic", mass=3.0)
    m = load(
        tmp_path,
        [body],
        "joints: {load_joint: {drive: {gear: 400, efficiency: 0.8, "
        "friction: {coulomb: 5.0, breakaway: 8.0, viscous: 10.0}, "
        "limit_curve: [[0, 0.2], [100, 0.1]]}}}\n",
    )
    for v, weight in ((0.2, 3.0 * G / 0.8), (-0.2, 3.0 * G * 0.8)):
        run = pf.solve(m, pf.formula(joints={"load_joint": f"{v}*t"}, duration=1.0), level="rigid",
                       samples=5)  # fmt: skip
        d = run.drive("load_joint")
        expected = (5.0 * np.sign(v) + 10.0 * v + weight) / 400
        np.testing.assert_allclose(d.motor_torque, expected, rtol=1e-12)
        np.testing.assert_allclose(d.motor_speed, 400 * v)
        np.testing.assert_allclose(d.torque, 3.0 * G)  # at the joint
        limit = 0.2 + (0.1 - 0.2) * 0.8
        assert d.use == pytest.approx(abs(expected) / limit, rel=1e-9)
    assert run.unit("drive/load_joint/torque") == "N"
    stored = pf.Result.load(run.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(stored.drive("load_joint").motor_torque, d.motor_torque)
    panel = torque_speed(stored).axes[0]
    assert panel.get_title(loc="left") == "load_joint"
    assert [len(line.get_xdata()) for line in panel.lines[2:]] == [5, 2, 2, 2, 2]
    text = str(pf.comparison(run, {"again": run}))
    assert "Drives: torque [N m], rms" in text
    assert "of limit" in text


def test_a_command_beyond_a_limit_curve_is_refused(tmp_path: Path) -> None:
    weak = f"{GEAR}, limit_curve: [[0, 0.3], [40, 0.3], [200, 0.05]]"
    m = arm(tmp_path, weak)
    move = pf.nonic(platform={"z": 0.1}, duration=0.4)
    with pytest.raises(pf.MotionError, match=r"arm_joint needs \d+ % of its motor's limit_curve"):
        pf.command(m, move, before=0.05, after=0.05)
    pf.command(m, move, before=0.05, after=0.05, limited=False)


def test_check_says_what_is_in_the_drives(tmp_path: Path) -> None:
    rubs = "friction: {coulomb: 2, breakaway: 3}"
    text = " ".join(str(check(arm(tmp_path, f"{GEAR}, {rubs}"))).split())
    assert "1 coordinate in 0 flexible links and 1 elastic drive" in text
    assert "2.000 (3.000 at rest)" in text
    assert "rotors turn about their own axes only (Spong), and there is no backlash" in text
    assert "dry friction is smooth below 0.001 rad/s" in text


def test_what_a_level_costs_is_advised_with_drives_and_links_together(tmp_path: Path) -> None:
    """A tube on an elastic gear: planes and modes may go, the gear stays."""
    more = """flexible: {arm: {material: steel, section: {shape: tube, diameter: 0.03, wall: 0.002},
  end: tip, inertia: beam}}
motion: {kind: cycloid, joints: {arm_joint: 0.5}, duration: 0.2}
"""
    m = arm(tmp_path, more=more)
    found = pf.advise(m, tol=0.02, band=0.0)
    assert found.level in ("coupled", "ked")
    smaller = pf.load(m.description.with_overrides(list(found.overrides)))
    assert len(smaller.flexible.expansion.drives) == 1
    shares = dict(zip(pf.modes(m).links, pf.modes(m).share[0], strict=True))
    assert shares["arm_joint"] > 0.5
    assert sum(shares.values()) == pytest.approx(1.0)


def test_a_torque_driven_motor_with_friction_follows_as_one_without(tmp_path: Path) -> None:
    """The rigid torque has the friction in it: feed-forward, and a controller for what is left."""
    move = "motion: {kind: cycloid, joints: {arm_joint: 0.5}, duration: 0.4}\n"
    push = "solve: {drive: torque, kp: 2e3, kd: 60, until: 0.4, samples: 41}\n"
    stiff = "gear: 50, motor_inertia: 4e-5, stiffness: 4e4, damping: 5"
    rubs = f"{stiff}, friction: {{coulomb: 3, viscous: 1}}"
    runs = [pf.solve(arm(tmp_path, d, move + push)) for d in (stiff, rubs)]
    assert np.abs(runs[1].torque - runs[0].torque).max() > 3.0
    away = runs[1].joint("arm_joint").position - runs[0].joint("arm_joint").position
    assert np.abs(away).max() < 3e-4  # of 0.5 rad; the dry part has no speed to act on at t = 0


def test_a_linear_model_knows_no_dry_friction(tmp_path: Path) -> None:
    plain, rubs = (
        pf.linearise(arm(tmp_path, d)).A for d in (GEAR, f"{GEAR}, friction: {{coulomb: 5}}")
    )
    np.testing.assert_allclose(rubs, plain, rtol=0, atol=1e-12 * np.abs(plain).max())


# Friction ----------------------------------------------------------------------------------------

MASS, SPRING, BELT, STATIC, SLIDING = 1.0, 100.0, 0.05, 1.5, 1.0
PEAK = SLIDING / SPRING + np.hypot((STATIC - SLIDING) / SPRING, BELT * np.sqrt(MASS / SPRING))


def belt(folder: Path, friction: str) -> pf.Mechanism:
    """A mass on a belt of constant speed, held back by a spring."""
    bodies = (
        Body("belt", "base", "prismatic", axis=(1, 0, 0)),
        Body("block", "belt", "prismatic", axis=(1, 0, 0), mass=MASS),
        Body("wall", "base", xyz=(-1, 0, 0)),
    )
    yaml = f"""gravity: [0, 0, 0]
actuated: [belt_joint]
joints: {{block_joint: {{friction: {{{friction}}}}}}}
springs: {{rubber: {{between: [wall, block], stiffness: {SPRING}, length: 1}}}}
motion: {{kind: formula, joints: {{belt_joint: "{BELT}*t"}}, duration: 1.2}}
"""
    return load(folder, bodies, yaml)


@pytest.mark.parametrize("tol", [1e-2, 1e-4])
def test_a_mass_on_a_belt_sticks_and_slips_as_the_closed_form_says(
    tol: float, tmp_path: Path
) -> None:
    """Sticks until k x = F_b, slips about F_c / k, sticks again where its speed is the belt's.

    Source: Popp & Stelzer (1990), Phil. Trans. R. Soc. A 332: stick-slip of a single mass.
    """
    m = belt(tmp_path, f"coulomb: {SLIDING}, breakaway: {STATIC}, stribeck: 1e-4, speed: 1e-5")
    run = pf.solve(m, level="coupled", tol=tol, samples=1201)
    slip = run.joint("block_joint").velocity
    x = run.joint("belt_joint").position + run.joint("block_joint").position
    assert x.max() == pytest.approx(PEAK, rel=1e-2)
    assert x[run.t > 0.4].min() == pytest.approx(2 * SLIDING / SPRING - PEAK, abs=1e-2 * PEAK)
    w, jump = np.sqrt(SPRING / MASS), (STATIC - SLIDING) / SPRING
    slipping = 2 * (np.pi - np.arctan(jump * w / BELT)) / w
    sticking = 2 * jump / BELT
    sliding = np.abs(slip) > 5e-5
    edges = run.t[1:][np.diff(sliding.astype(int)) != 0]  # slips, sticks, slips
    first = STATIC / SPRING / BELT
    # Within 1 % of a period: the smoothing speeds, 0.2 and 0.02 % of the belt's, cost 0.5 %.
    expected, period = first + np.cumsum([0, slipping, sticking]), slipping + sticking
    np.testing.assert_allclose(edges[:3], expected, rtol=0, atol=1e-2 * period)
    # Lost, never made.
    lost = np.diff(run.array("energy/dissipated"))
    assert lost.min() >= 0.0
    assert run.meta["energy_balance"] < 1e-5


def test_dry_friction_needs_no_tolerance_to_be_asked_for(tmp_path: Path) -> None:
    """A block thrown on a resting belt stops after v^2 m / 2 F, and stays."""
    bodies = (Body("block", "base", "prismatic", axis=(1, 0, 0), mass=2.0),)
    m = load(tmp_path, bodies, """gravity: [0, 0, 0]
actuated: []
joints: {block_joint: {friction: {coulomb: 4.0, speed: 1e-5}}}
forces: {push: {at: block, force: [20, 0, 0], until: 0.1}}
solve: {level: coupled, until: 1.0, samples: 101}
""")  # fmt: skip
    run = pf.solve(m)
    v = (20.0 - 4.0) / 2.0 * 0.1
    stopped = 0.1 + v / 2.0
    x = run.joint("block_joint").position
    assert x[-1] == pytest.approx(0.5 * v * 0.1 + 0.5 * v * (stopped - 0.1), rel=1e-3)
    assert np.ptp(x[run.t > stopped + 0.01]) < 1e-6


def test_friction_of_passive_joints_reaches_the_motor_at_every_level(tmp_path: Path) -> None:
    """A parallelogram: all three joints turn at the crank's speed, so three frictions add up."""
    bodies = (
        Body("crank", "base", "revolute", mass=1.0, inertia=(1e-2,) * 3),
        Body("rod", "crank", "revolute", (0, 0.3, 0), mass=1.0, inertia=(1e-2,) * 3),
        Body("rod_end", "rod", xyz=(0.5, 0, 0)),
        Body("rocker", "base", "revolute", (0.5, 0, 0), mass=1.0, inertia=(1e-2,) * 3),
        Body("rocker_end", "rocker", xyz=(0, 0.3, 0)),
    )
    rubs = ", ".join(f"{j}_joint: {{friction: {{coulomb: {f}}}}}"
                     for j, f in (("crank", 0.5), ("rod", 0.3), ("rocker", 0.2)))  # fmt: skip
    yaml = f"""gravity: [0, 0, 0]
actuated: [crank_joint]
joints: {{{rubs}}}
loops: {{pin: {{kind: planar, between: [rod_end, rocker_end]}}}}
flexible: {{rod: {{material: steel, section: {{shape: circle, diameter: 0.05}}}}}}
damping: {{modal: 0.5}}
motion: {{kind: formula, joints: {{crank_joint: 0.5*t}}, duration: 0.1}}
"""
    m = load(tmp_path, bodies, yaml)
    free = pf.load(m.description.with_overrides([f"joints.{j}_joint.friction=null"
                                                 for j in ("crank", "rod", "rocker")]))  # fmt: skip
    for level in ("rigid", "quasistatic", "ked", "coupled"):
        step = {"dt": 1e-4} if level in ("ked", "coupled") else {}
        with_, without = (pf.solve(x, level=level, samples=11, **step) for x in (m, free))
        extra = (with_.torque - without.torque)[5:-1, 0]  # a jump at t = 0 has died by then
        np.testing.assert_allclose(extra, 1.0, rtol=2e-3)  # the rod gives way a little


# What the URDF says ------------------------------------------------------------------------------


def test_damping_and_friction_of_a_urdf_are_used_unless_told(tmp_path: Path) -> None:
    """Rigid torques are rnea's plus d v + F tanh(v / v_0); without the key rnea's to the bit."""
    text = "urdf: example-robot-data:talos_arm\n"
    (tmp_path / "arm.yaml").write_text(text)
    on = pf.load(tmp_path / "arm.yaml")
    off = pf.load(tmp_path / "arm.yaml", ["use_urdf_dynamics=false"])
    model = pin.buildModelFromXML(on.description.urdf_text)
    rng = np.random.default_rng(1)
    q, v, a = rng.uniform(-1, 1, (3, 4, model.nv))
    rnea = np.array([pin.rnea(model, model.createData(), *s) for s in zip(q, v, a, strict=True)])
    np.testing.assert_array_equal(pf.inverse_dynamics(off, q, v, a), rnea)
    lost = model.damping * v + model.friction * np.tanh(v / 1e-3)
    assert np.abs(lost).max() > 1.0
    np.testing.assert_allclose(pf.inverse_dynamics(on, q, v, a), rnea + lost, rtol=0, atol=1e-12)


def test_the_yaml_comes_before_the_urdf(tmp_path: Path) -> None:
    urdf = """<robot name="a"><link name="base"/><link name="l"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="continuous"><parent link="base"/><child link="l"/><axis xyz="0 0 1"/>
<dynamics damping="0.5" friction="0.7"/></joint>
<transmission name="t"><joint name="j"><mechanicalReduction>7</mechanicalReduction></joint>
<actuator name="m"><mechanicalReduction>80</mechanicalReduction></actuator></transmission>
</robot>"""
    (tmp_path / "a.urdf").write_text(urdf)
    said = {}
    for key, joints in {
        "plain": "",
        "damper": "joints: {j: {damper: 0}}",
        "drive": "joints: {j: {drive: {motor_inertia: 1e-4}}}",
        "own": "joints: {j: {drive: {gear: 50, friction: {coulomb: 2}}}}",
    }.items():
        (tmp_path / "a.yaml").write_text(f"urdf: a.urdf\n{joints}\n")
        said[key] = pf.load(tmp_path / "a.yaml").description.joints["j"]
    plain, friction = said["plain"], said["plain"].friction
    assert (plain.damper, friction and friction.coulomb) == (0.5, 0.7)
    assert said["damper"].damper == 0.0
    assert said["drive"].armature == pytest.approx(80**2 * 1e-4)  # ROS has it at the actuator
    assert said["drive"].friction == friction
    own = said["own"]
    assert own.drive is not None and own.friction is not None
    assert (own.drive.gear, own.friction.coulomb, own.damper) == (50.0, 2.0, 0.5)


def test_a_rotor_shakes_the_frame_by_its_own_spin(tmp_path: Path) -> None:
    """A disk of 0.3 kg m^2 and a rotor of 0.2 kg m^2 on its joint: -(0.3 + 0.2) a about z."""
    disk = Body("disk", "base", "continuous", mass=1.0, inertia=(0.2, 0.2, 0.3))
    m = load(tmp_path, [disk], "gravity: [0, 0, 0]\nactuated: [disk_joint]\n"
             "joints: {disk_joint: {rotor_inertia: 0.2}}\n"
             "motion: {kind: formula, joints: {disk_joint: t^2}, duration: 1}\n")  # fmt: skip
    found = shaking(m, pf.solve(m, level="rigid", samples=3))
    np.testing.assert_allclose(found, [[0, 0, 0, 0, 0, -1.0]] * 3, atol=1e-12)
