"""Commands: the platform of a flexible robot follows its path.

Every command is judged from outside, by a forward run of level coupled with the motor positions it
gives: that run knows nothing of how they were found.

Claims:
    Commands: motions that the platform follows
    - 3-RRR with flexible cranks, 60 mm in 80 ms: platform error with the rigid command | a
      prototype written apart | 1 % | 22.25 mm, 21.04 mm after it
    - the same, exact command | forward run | 0.05 um | 0.001 um
    - the same in 30 ms (first period 57 ms; the series diverges) | forward run | 1 um | 0.002 um
    - 3-RRS under gravity in less than its first period (race_r2, 0.1 s; rigid command 4.7 mm) |
      forward run | 0.05 um | 0.0025 um
    - error bar of the exact command covers | forward run | - | 0.033 of 0.0025 um
    - quasistatic command: error below the prototype's best pass on its two tables; its bar covers,
      one coordinate each, vibration included | forward run | 1 to 2 | 1.004 to 1.85 (3-RRR), 1.03
      to 1.13 (race_r2); undamped 1.5 to 2.3, 1.06 to 1.2; 3rrs 1.006 to 1.5; ur5 with drives 1.04
      to 1.5, undamped 6 to 9
    - the inversion converges with its grid | order of its differences | 4 +- 0.4 | passes
    - an exact command with one factorisation = with one in every iteration | the other way | 1e-9
      rad; torque 1e-5 | passes
    - tip of a flexible link on a hub (not minimum phase): hub torque, pre-actuation there | linear
      beam in the frequency domain, FFT (Bayo 1987) | 1e-3 | passes
    - elastic drive: motor angle, speed, torque, both sides, at every instant | closed form (Spong
      1987) | 1e-8 | 1e-10
    - delta of rigid links and elastic drives, 0.1 m in 0.3 s; steps, where a rotation is round-off
      | forward run | 1e-9 m; < 400 | 5e-11 m; passes
    - the rigid command's torques on a loop under gravity | level rigid | 1e-2 | passes
    - model bar of a command of one arm, 1 and 4 segments, 3 mm | Exudyn, 16 ANCF cables: 430.6 and
      18.8 um | 1 to 2 times | 584 and 26.7 um
    - bar of a command with `after` 0.2 to 1 times the usual, four robots | a run that goes on 0.4 s
      beyond it | covers | 1.9 to 9 times on three of them; 7.3 nm where it is right to 0.1 nm
    - bar of an exact command of a cycloid, undamped five-bar | a run that goes on 0.1 s beyond it |
      1 to 4 times | 1.6 and 2.5 times (5.2 um; 2.1 mm by one grid)
    - delta, 305 mm in 0.3 s, instants chosen by the command: error over that of the rigid command,
      residual swing over its error at rest, links alone and with elastic drives | forward run |
      1e-4 | passes; by hand, over its swing, forward run to 1e-5: 7e-8, 8e-6 (301 instants, 18 s of
      CPU); 9e-8, 2e-5 (225, 14 s)
"""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
from scenes import published
from scipy.special import beta, betainc

import pinflex as pf
from pinflex.inversion import exact, saddle
from pinflex.inversion.exact import invert
from pinflex.inversion.on_grid import series
from pinflex.inversion.target import Instant, delayed, target

BEAM = "{shape: rectangle, width: 0.025, thickness: 0.004}"
CRANKS = (
    "material: {like: aluminium_7075, E: 7.1e10, nu: 0.33, rho: 2810}, "
    "basis: {kind: craig_bampton, internal: 1}, inertia: beam, axial: false"
)


@pytest.fixture(scope="module")
def planar() -> pf.Mechanism:
    """A 3-RRR with flexible cranks and distal links; first mode 17.4 Hz."""
    rod = "{shape: rectangle, width: 0.025, thickness: 0.002}"
    flexible = (
        f"flexible={{'distal_?': {{{CRANKS}, section: {rod}}}, "
        f"'crank_?': {{{CRANKS}, section: {BEAM}}}}}"
    )
    return pf.load(published("3rrr"), [flexible, "damping={rayleigh: [0, 1.0e-4]}", "motion=null"])


def nonic_motion(duration: float, **moves: float) -> pf.Motion:
    return pf.nonic(platform=moves, duration=duration)


def missed(
    mechanism: pf.Mechanism, motion: pf.Motion, command: pf.Command, names: tuple[str, ...]
) -> tuple[float, float]:
    """Largest distance of the platform from its path, during the motion and after it [m]."""
    run = pf.solve(
        mechanism,
        command.motion,
        level="coupled",
        tol=1e-4,
        start="static",
        samples=301,
        until=float(command.t[-1]),
    )
    frame = mechanism.description.platform
    position = run.array(f"frame/{frame}/position")
    moved = motion.evaluate(run.t - command.before)[0]
    wanted = np.column_stack(
        [
            command.reference[0, command.coordinates.index(name)]
            + moved[:, motion.names.index(name)]
            for name in names
        ]
    )
    error = np.linalg.norm(position[:, ["xyz".index(n) for n in names]] - wanted, axis=1)
    during = run.t <= run.t[-1] - command.after
    return float(error[during].max()), float(error[~during].max())


def test_the_platform_follows_where_the_rigid_command_misses_by_millimetres(
    planar: pf.Mechanism,
) -> None:
    """60 mm in 80 ms with a first period of 57 ms (design study of this project, table 1)."""
    motion = nonic_motion(0.08, x=0.06, y=0.03, rz=0.3)
    rest = {"before": 0.04, "after": 0.06, "instants": 250}
    rigid = pf.command(planar, motion, "rigid", **rest)
    slow = pf.command(planar, motion, "quasistatic", **rest)
    exact = pf.command(planar, motion, "exact", **rest)
    # 22250 and 21040 um by a prototype of the same equations written apart from this code
    assert missed(planar, motion, rigid, ("x", "y")) == pytest.approx(
        (22.25e-3, 21.04e-3), rel=0.01
    )
    assert max(missed(planar, motion, slow, ("x", "y"))) < 0.3e-6  # the prototype's third pass
    during, after = missed(planar, motion, exact, ("x", "y"))
    assert max(during, after) < 0.05e-6  # 22 mm over 4e5: what a sensor could tell
    assert max(during, after) < np.hypot(*exact.error[:2])


SLOW = {  # mechanism, duration: rests, instants, passes, and of which coordinates the prototype
    # told what error [m]: the largest of "during" and "after" of its best pass
    ("planar", 0.08): ((0.04, 0.06, 250), ("x", "y"), 0.3e-6),
    ("planar", 0.05): ((0.04, 0.06, 250), ("x", "y"), 2.3e-6),
    ("race_r2", 0.3): ((0.1, 0.2, 300), ("z",), 4.5e-6),
    ("race_r2", 0.15): ((0.1, 0.2, 300), ("z",), 74e-6),
    ("race_r2", 0.1): ((0.1, 0.2, 300), ("z",), 120e-6),
}


@pytest.mark.parametrize(("model", "duration"), SLOW)
def test_the_error_bar_of_the_series_covers_what_the_robot_does(
    model: str, duration: float, planar: pf.Mechanism
) -> None:
    """The quasistatic rows of the design study, one bar a coordinate, vibration included."""
    rest, names, published_error = SLOW[model, duration]
    robot = planar if model == "planar" else pf.load(model)
    moves = {"z": 0.03, "rx": 0.1, "ry": 0.05}
    if model == "planar":
        moves = {"x": 0.06, "y": 0.03, "rz": 0.3}
    motion = nonic_motion(duration, **moves)
    given = dict(zip(("before", "after", "instants"), rest, strict=True))
    slow = pf.command(robot, motion, "quasistatic", **given)
    bars = [slow.error[slow.coordinates.index(name)] for name in names]
    for name, bar in zip(names, bars, strict=True):
        true = max(missed(robot, motion, slow, (name,)))
        # not twice the error: what two marches find, and what the second one changes
        assert true < bar < 2.0 * true, name
    assert max(missed(robot, motion, slow, names)) < published_error


def test_a_move_within_half_a_period_has_no_series_but_an_exact_command(
    planar: pf.Mechanism,
) -> None:
    motion = nonic_motion(0.03, x=0.06, y=0.03, rz=0.3)
    exact = pf.command(planar, motion, before=0.04, after=0.06, instants=400)
    during, _ = missed(planar, motion, exact, ("x", "y"))
    assert during < 1e-6  # the rigid command misses 41 mm


def test_a_spatial_loop_under_gravity_faster_than_its_first_period() -> None:
    robot = pf.load("race_r2")
    motion = nonic_motion(0.1, z=0.03, rx=0.1, ry=0.05)
    exact = pf.command(robot, motion, before=0.1, after=0.2, instants=300)
    during, after = missed(robot, motion, exact, ("z",))
    assert max(during, after) < 0.05e-6  # the rigid command misses 4.7 mm


@pytest.mark.parametrize("duration", [0.3, 0.15])
def test_the_other_rows_of_the_spatial_table(duration: float) -> None:
    """z of race_r2 by 30 mm; the rigid command misses by 1.1 and 2.4 mm."""
    robot, motion = pf.load("race_r2"), nonic_motion(duration, z=0.03, rx=0.1, ry=0.05)
    exact = pf.command(robot, motion, before=0.1, after=0.2, instants=300)
    assert max(missed(robot, motion, exact, ("z",))) < 0.05e-6


def test_the_other_row_of_the_planar_table(planar: pf.Mechanism) -> None:
    """60 mm in 50 ms, less than the first period; the rigid command misses by 40 mm."""
    motion = nonic_motion(0.05, x=0.06, y=0.03, rz=0.3)
    exact = pf.command(planar, motion, before=0.04, after=0.06, instants=300)
    assert max(missed(planar, motion, exact, ("x", "y"))) < 0.05e-6


def test_the_inversion_converges_at_fourth_order_in_the_grid(planar: pf.Mechanism) -> None:
    """Differences of order 4; what deferred correction finds beyond them is left out here.

    On a motion with nine smooth derivatives: at the ends of a nonic its fifth jumps.
    """
    T, size = 0.08, np.array([0.06, 0.03, 0.3])

    def law(t: np.ndarray) -> tuple[np.ndarray, ...]:
        u = np.clip(t / T, 0.0, 1.0)
        flat = u * (1.0 - u)
        scale = 1.0 / beta(10, 10)
        rates = (
            betainc(10, 10, u),
            scale * flat**9 / T,
            9.0 * scale * flat**8 * (1.0 - 2.0 * u) / T**2,
        )
        return tuple(np.outer(rate, size) for rate in rates)

    motion, errors = pf.Motion("smooth", "platform", ("x", "y", "rz"), T, law), []
    for n in (181, 271, 361):
        t = np.linspace(0.0, 0.18, n)
        instant = Instant(planar, target(planar, motion, t, 0.04))
        found = invert(instant, series(instant).found)
        errors.append(np.max(np.abs(found.error[:-8])))  # the last have no neighbours
    slope = np.polyfit(np.log([181, 271, 361]), np.log(errors), 1)[0]
    assert slope == pytest.approx(-4.0, abs=0.4)  # grids that are not yet fine


def test_a_matrix_that_is_kept_finds_what_new_ones_do(
    planar: pf.Mechanism, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []

    def counted(*matrix: Any) -> saddle.Saddle:
        made.append(matrix)
        return saddle.Saddle(*matrix)

    monkeypatch.setattr(exact, "Saddle", counted)
    motion = nonic_motion(0.15, x=0.04, y=0.02, rz=0.1)
    kept = pf.command(planar, motion, instants=150)
    assert len(made) == 1 < kept.iterations
    monkeypatch.setattr(exact, "_SLOW", -1.0)  # every contraction is too slow
    new = pf.command(planar, motion, instants=150)
    assert len(made) == new.iterations  # its last linear system is that of the refinement
    # the last correction of either is 1e-10 rad; torques follow from its second differences
    assert kept.position == pytest.approx(new.position, abs=1e-9)
    assert kept.torque == pytest.approx(new.torque, abs=1e-5 * float(np.abs(new.torque).max()))


def test_the_tip_of_a_flexible_link_on_a_hub_is_not_minimum_phase(tmp_path: Path) -> None:
    """Against the frequency domain solution of the linear beam (Bayo 1987), by FFT."""
    L, EI, rhoA, hub = 1.0, 1.0, 1.0, 0.1
    bodies = [
        scenes.Body("beam", "base", "revolute", mass=1.0, com=(0.5, 0, 0), inertia=(1e-3,) * 3),
        scenes.Body("tip", "beam", xyz=(L, 0, 0)),
    ]
    yaml = """
gravity: [0, 0, 0]
joints: {beam_joint: {rotor_inertia: 0.1}}
platform: tip
flexible:
  beam:
    material: {E: 1, nu: 0.3, rho: 1}
    section: {shape: given, A: 1, Iy: 1, Iz: 1, J: 1}
    end: tip
    inertia: beam
    bending_y: true
    bending_z: false
    torsion: false
    axial: false
    basis: {kind: craig_bampton, internal: 6}
"""
    robot = scenes.load(tmp_path, bodies, yaml)
    T, size = 1.0, 1e-4  # [s]; [m]: small, so that the linear beam is the truth
    motion = pf.nonic(platform={"y": size}, duration=T)
    for share in (0.2, 0.5, 0.9):  # of the rest that the zeros ask for
        with pytest.raises(pf.DescriptionError, match="before = .* s cuts off .* minimum phase"):
            pf.command(robot, motion, before=share * pf.command(robot, motion).before, after=3.0)
    found = pf.command(robot, motion, before=3.0, after=3.0, instants=1401)

    t = found.t
    dt, n = t[1] - t[0], 1 << 15  # a long window: the response dies out in it on both sides
    window = (np.arange(n) - n // 2) * dt
    u = np.clip(window / T, 0.0, 1.0)
    acceleration = size / T**2 * 2520 * (u * (1 - u)) ** 3 * (1 - 2 * u)
    omega = 2 * np.pi * np.fft.fftfreq(n, dt)
    spectrum = np.fft.fft(acceleration)
    torque = np.zeros(n, complex)
    for k in np.flatnonzero(np.abs(spectrum) > 1e-14 * np.abs(spectrum).max()):
        torque[k] = spectrum[k] * hub_torque_by_tip_acceleration(omega[k], L, EI, rhoA, hub)
    exact = np.interp(t - found.before, window, np.fft.ifft(torque).real)
    assert np.max(np.abs(found.torque[:, 0] - exact)) < 1e-3 * np.max(np.abs(exact))
    ahead = t < found.before - 0.05
    assert 0.1 < found.actuation[0] < found.before
    # pre-actuation: the hub moves before the tip does, by more than any numerical noise
    assert np.max(np.abs(found.torque[ahead, 0])) > 1e-2 * np.max(np.abs(exact))


def hub_torque_by_tip_acceleration(
    omega: complex, L: float, EI: float, rhoA: float, hub: float
) -> complex:
    """Euler-Bernoulli beam on a hub, small motion: torque over tip acceleration."""
    if omega == 0.0:
        return (hub + rhoA * L**3 / 3.0) / L
    b = (rhoA * omega**2 / EI) ** 0.25
    x = b * L
    s, c, sh, ch = np.sin(x), np.cos(x), np.sinh(x), np.cosh(x)
    # y = p sin + q cos + r sinh + w cosh of b x: pinned root, free tip, unit tip motion
    rows = [[0, 1, 0, 1], [-s, -c, sh, ch], [-c, s, ch, sh], [s, c, sh, ch]]
    p, q, r, w = np.linalg.solve(np.array(rows), [0.0, 0.0, 0.0, 1.0])
    slope, bend = b * (p + r), b**2 * (w - q)
    torque = -hub * omega**2 * slope - EI * bend
    return torque / -(omega**2)


def arm(folder: Path, thickness: float, segments: int) -> pf.Mechanism:
    """One aluminium link of 1 m on a motor, its tip the platform."""
    mass = 2700 * 0.04 * thickness
    bodies = [
        scenes.Body(
            "arm",
            "base",
            "revolute",
            mass=mass,
            com=(0.5, 0, 0),
            inertia=(1e-4, mass / 12, mass / 12),
        ),
        scenes.Body("tip", "arm", xyz=(1.0, 0, 0)),
    ]
    return scenes.load(
        folder,
        bodies,
        f"""
gravity: [0, 0, 0]
platform: tip
flexible:
  arm:
    material: {{E: 7.0e10, nu: 0.33, rho: 2700}}
    section: {{shape: rectangle, width: 0.04, thickness: {thickness}}}
    end: tip
    segments: {segments}
""",
    )


def two_links(folder: Path) -> pf.Mechanism:
    """Two flexible links on elastic gears in the plane x z, under gravity."""

    def link(name: str, parent: str, thickness: float, at: float) -> scenes.Body:
        m = 2700 * 0.04 * 0.5 * thickness
        inertia = (1e-4, m * 0.25 / 12, m * 0.25 / 12)
        return scenes.Body(
            name, parent, "revolute", axis=(0, 1, 0), xyz=(at, 0, 0), mass=m, com=(0.25, 0, 0),
            inertia=inertia,
        )  # fmt: skip

    tip = scenes.Body("tip", "l2", xyz=(0.5, 0, 0), mass=0.2, inertia=(1e-5,) * 3)
    flexible = "".join(
        f"""
  {name}:
    material: {{E: 7.0e10, nu: 0.33, rho: 2700}}
    section: {{shape: rectangle, thickness: {h}, width: 0.04}}
    end: {end}"""
        for name, h, end in (("l1", 0.006, "l2"), ("l2", 0.005, "tip"))
    )
    return scenes.load(
        folder,
        [link("l1", "base", 0.006, 0.0), link("l2", "l1", 0.005, 0.5), tip],
        f"""
gravity: [0, 0, -9.81]
platform: tip
home: {{l1_joint: 0.6, l2_joint: 0.9}}
joints:
  l1_joint: {{drive: {{gear: 100, motor_inertia: 2.0e-5, stiffness: 8000}}}}
  l2_joint: {{drive: {{gear: 100, motor_inertia: 1.0e-5, stiffness: 4000}}}}
damping: {{rayleigh: [0, 1.0e-4]}}
flexible:{flexible}
""",
    )


def carriages(folder: Path) -> pf.Mechanism:
    """A flexible link of 1 m on a carriage, pinned in its middle to a rigid one on another."""
    m, turn = 2700 * 0.04 * 0.006, np.arccos(0.8)
    slide = {"axis": (1, 0, 0), "mass": 3.0, "inertia": (1e-3,) * 3}
    rod = {"mass": m, "com": (0.5, 0, 0), "inertia": (1e-4, m / 12, m / 12)}
    half = {"mass": m / 2, "com": (0.25, 0, 0), "inertia": (1e-4, m / 96, m / 96)}
    bodies = [
        scenes.Body("c1", "base", "prismatic", **slide),
        scenes.Body("c2", "base", "prismatic", xyz=(0.8, 0, 0), **slide),
        scenes.Body("long", "c1", "revolute", rpy=(0, 0, turn), **rod),
        scenes.Body("mid", "long", xyz=(0.5, 0, 0)),
        scenes.Body("tip", "long", xyz=(1, 0, 0), mass=0.15, inertia=(1e-5,) * 3),
        scenes.Body("short", "c2", "revolute", rpy=(0, 0, np.pi - turn), **half),
        scenes.Body("pin", "short", xyz=(0.5, 0, 0)),
    ]
    return scenes.load(
        folder,
        bodies,
        """
gravity: [0, 0, 0]
platform: tip
actuated: [c1_joint, c2_joint]
loops:
  pin: {kind: planar, axis: z, between: [mid, pin]}
flexible:
  long:
    material: {E: 7.0e10, nu: 0.33, rho: 2700}
    section: {shape: rectangle, width: 0.04, thickness: 0.006}
    end: tip
damping: {rayleigh: [0, 2.0e-4]}
""",
    )


def off_path(robot: pf.Mechanism, motion: pf.Motion, found: pf.Command, later: float) -> np.ndarray:
    """Largest error of each coordinate in a forward run, until some time after the motors stop."""
    until = float(found.t[-1]) + later
    run = pf.solve(
        robot, found.motion, level="coupled", start="static", tol=3e-5, samples=601, until=until
    )
    path = delayed(motion, found.before)
    ideal = pf.solve(robot, path, level="rigid", samples=601, until=until)
    away = run.deviation_from(ideal, str(robot.description.platform)).position
    at = ["xyz".index(name) for name in found.coordinates if name in "xyz"]
    return np.asarray(np.abs(away[:, at]).max(axis=0))


@pytest.mark.parametrize(("thickness", "segments", "true"), [
    (0.003, 1, 430.6e-6), (0.003, 4, 18.8e-6), (0.004, 1, 94e-6), (0.004, 4, 1.61e-6),
])  # fmt: skip
def test_the_bar_of_the_model_covers_what_segments_leave_out(
    thickness: float, segments: int, true: float, tmp_path: Path
) -> None:
    """Hub by 0.4 rad in 0.5 s, path of the tip in y.

    The error of each command at 3 mm in Exudyn 1.13.6, 16 ANCFCable2D (one segment: 24 of them and
    8000 steps, not 4000, change 0.02 %; four: 16000 steps instead of 8000 change 0.6 %, 24 were
    not run); at 4 mm in pinflex with 14 segments and every deformation.
    """
    robot = arm(tmp_path, thickness, segments)
    found = pf.command(robot, pf.nonic(joints={"arm_joint": 0.4}, duration=0.5), coordinates=["y"])
    assert found.error[0] < 0.1e-6  # what the bar was
    assert true < found.model_error[0] < 2.0 * true
    assert "segment" in found.model_note


@pytest.mark.parametrize("share", [1.0, 0.5, 0.2])
@pytest.mark.parametrize("scene", ["arm", "two links", "carriages", "3-RRR"])
def test_a_rest_too_short_is_in_the_bar(
    scene: str, share: float, tmp_path: Path, planar: pf.Mechanism
) -> None:
    """Motors that stop with a way to go leave a swing, also after the command; ahead: refused."""
    robot, motion = {
        "arm": lambda: (arm(tmp_path, 0.0054, 1), nonic_motion(0.2, y=0.1)),
        "two links": lambda: (two_links(tmp_path), nonic_motion(0.6, x=-0.2, z=0.3)),
        "carriages": lambda: (carriages(tmp_path), nonic_motion(0.5, x=-0.3, y=0.1)),
        "3-RRR": lambda: (planar, nonic_motion(0.08, x=0.06, y=0.03, rz=0.3)),
    }[scene]()
    usual = pf.command(robot, motion)
    found = pf.command(robot, motion, after=share * usual.after)
    true = off_path(robot, motion, found, 0.4)
    assert np.all(true < found.error[: len(true)] + 2e-8)  # the run's own
    assert np.all(found.cut_off <= found.error)
    if scene != "3-RRR" and share < 1.0:  # that one is minimum phase
        with pytest.raises(pf.DescriptionError, match="before = .* cuts off"):
            pf.command(robot, motion, before=share * usual.before)


def five_bar(folder: Path) -> pf.Mechanism:
    """Cranks of 117 and 93 mm, couplers of 214 and 187 mm, aluminium of 20 x 4 mm; no damping."""

    def bar(name: str, parent: str, x: float, length: float) -> scenes.Body:
        m = 2700 * length * 0.02 * 0.004
        inertia = (1e-6, m * length**2 / 12, m * length**2 / 12)
        return scenes.Body(
            name, parent, "revolute", xyz=(x, 0, 0), mass=m, com=(length / 2, 0, 0), inertia=inertia
        )

    flexible = "".join(
        f"  {name}: {{end: {end}, material: {{E: 7.0e10, nu: 0.33, rho: 2700}}, "
        "section: {shape: rectangle, width: 0.02, thickness: 0.004}}\n"
        for name, end in (("cl", "kl"), ("kl", "tip_l"), ("cr", "kr"), ("kr", "tip_r"))
    )
    return scenes.load(
        folder,
        [
            bar("cl", "base", -0.09, 0.117),
            bar("kl", "cl", 0.117, 0.214),
            bar("cr", "base", 0.09, 0.093),
            bar("kr", "cr", 0.093, 0.187),
            scenes.Body("tip_l", "kl", xyz=(0.214, 0, 0), mass=0.15, inertia=(1e-5,) * 3),
            scenes.Body("tip_r", "kr", xyz=(0.187, 0, 0)),
        ],
        f"""
gravity: [0, 0, 0]
platform: tip_l
actuated: [cl_joint, cr_joint]
home: {{cl_joint: 2.2, kl_joint: -1.5, cr_joint: 0.9, kr_joint: 1.5}}
loops:
  pin: {{kind: planar, axis: z, between: [tip_l, tip_r]}}
flexible:
{flexible}""",
    )


def test_a_poor_bar_takes_a_finer_grid(tmp_path: Path) -> None:
    """A cycloid's jerk jumps: one grid told 60 times the error, and rang more than the rigid one.

    2.1 mm of swing after the stop by one grid; the rigid command misses 0.14 mm.
    """
    robot = five_bar(tmp_path)
    motion = pf.cycloid(joints={"cl_joint": 0.5}, duration=0.2)
    found = pf.command(robot, motion)
    true = off_path(robot, motion, found, 0.1)
    assert np.all(true < found.error)
    assert np.all(found.error < 4.0 * true)
    assert true.max() < 8e-6


@pytest.mark.parametrize("name", ["x", "z"])
def test_fewer_coordinates_than_motors(name: str, tmp_path: Path) -> None:
    """The one that is named follows; the bar knows what swings on when the motors stop."""
    robot, motion = two_links(tmp_path), nonic_motion(0.6, x=-0.2, z=0.3)
    found = pf.command(robot, motion, coordinates=[name])
    assert off_path(robot, motion, found, 0.0)[0] < 3e-6  # the rigid command misses 100 mm
    later = off_path(robot, motion, found, 0.4)[0]
    assert later < found.error[0] < 4.0 * later


def test_links_that_swing_far_beside_the_path_keep_the_coordinate_that_is_named(
    tmp_path: Path,
) -> None:
    """Each correction was -1.1 times the last one there, as the path's curvature is left out."""
    robot, motion = two_links(tmp_path), nonic_motion(0.25, x=-0.2, z=0.3)
    found = pf.command(robot, motion, coordinates=["z"])
    assert (
        off_path(robot, motion, found, 0.0)[0] < 5e-8
    )  # of 300 mm; the run itself is good to 1e-8
    assert off_path(robot, motion, found, 0.4)[0] < found.error[0]


def test_a_first_correction_of_ten_radians_settles(tmp_path: Path) -> None:
    """The motion stands within what is told: 43 to 52 nm of 300 mm were seen during the move."""
    robot, motion = two_links(tmp_path), nonic_motion(0.13, x=-0.2, z=0.3)
    found = pf.command(robot, motion, coordinates=["z"])
    during = off_path(robot, motion, found, 0.0)[0]
    assert during < found.error[0]
    assert during < 1e-6 * 0.3  # else the links' way, not round-off, would show
    assert off_path(robot, motion, found, 0.4)[0] < found.error[0]


def test_links_that_swing_too_far_beside_the_path_say_where_none_is_held(tmp_path: Path) -> None:
    with pytest.raises(pf.ConvergenceError, match=r"1 coordinate \(z\) for 2 motors"):
        pf.command(two_links(tmp_path), nonic_motion(0.1, x=-0.2, z=0.3), coordinates=["z"])


BOOM = """
actuated: [post_joint, boom_joint]
platform: hook
joints: {sway_joint: {spring: 1e-3}, load_joint: {spring: 1e-3}}
flexible:
  boom: {material: steel, section: {shape: tube, diameter: 0.15, wall: 0.01}, end: sway}
"""


def test_a_crane_whose_inversion_does_not_settle_hears_what_does(tmp_path: Path) -> None:
    """150 kg on a rope of 2.5 m below a boom that bends, slewed by 0.4 rad in 6 s.

    Exact corrections shrink by a few per cent each there, and more instants do not help.
    """
    body = scenes.Body
    robot = scenes.load(tmp_path, [
        body("post", "base", "revolute", mass=200, com=(0, 0, 1), inertia=(80, 80, 20)),
        body("boom", "post", "revolute", (0, 0, 2), (0, -0.6, 0), (0, 1, 0), 138, (2, 0, 0),
             (0.7, 184, 184)),
        body("sway", "boom", "continuous", (4, 0, 0), (0, 0.6, 0), (0, 1, 0)),
        body("load", "sway", "continuous", axis=(1, 0, 0), mass=150, com=(0, 0, -2.5),
             inertia=(5, 5, 5)),
        body("hook", "load", xyz=(0, 0, -2.5)),
    ], BOOM, inertia="urdf")  # fmt: skip
    motion = pf.nonic(joints={"post_joint": 0.4}, duration=6.0)
    with pytest.raises(pf.ConvergenceError, match="take level quasistatic, which tells"):
        pf.command(robot, motion)
    found = pf.command(robot, motion, "quasistatic")
    off, rigid = (
        off_path(robot, motion, x, 0.0)
        for x in (found, pf.command(robot, motion, "rigid", before=found.before, after=found.after))
    )
    # 1 %: the bar is of a forward run that looks at other instants
    assert np.all(off < 1.01 * found.error) and np.all(off > 0.5 * found.error)
    assert np.max(off) < 0.01 * np.max(rigid)  # 0.4 mm of 250


def test_what_cannot_be_commanded_is_refused_by_name(planar: pf.Mechanism) -> None:
    with pytest.raises(pf.MotionError, match="acceleration of x jumps in a trapezoid"):
        pf.command(planar, pf.trapezoid(platform={"x": 0.01}, duration=0.1, ramp=0.02))
    with pytest.raises(pf.DescriptionError, match="level: exakt.*exact"):
        pf.command(planar, nonic_motion(0.1, x=0.01, y=0.0, rz=0.0), "exakt")
    move = nonic_motion(0.1, x=0.01, y=0.0, rz=0.0)
    for options, what in (
        ({"tol": -1.0}, "tol = -1"),
        ({"tol": 1e-3, "level": "quasistatic"}, "the others have one grid"),
        ({"instants": -3}, "instants = -3. Give a whole number from 30"),
        ({"instants": 10}, "instants = 10"),
        ({"before": -0.1}, "before = -0.1. Give seconds"),
    ):  # fmt: skip
        with pytest.raises(pf.DescriptionError, match=what):
            pf.command(planar, move, **options)
    with pytest.raises(pf.MotionError, match="the speed of x jumps where a harmonic motion begins"):
        pf.command(planar, pf.harmonic(platform={"x": 0.002}, frequency=2.0, duration=1.0))
    with pytest.raises(pf.DescriptionError, match="nothing deforms"):
        pf.command(pf.load("ur5", ["flexible=null", "damping=null"]))


def test_a_tolerance_out_of_reach_is_refused_with_its_floor(planar: pf.Mechanism) -> None:
    move = nonic_motion(0.1, x=0.01, y=0.0, rz=0.0)
    begun = time.process_time()
    with pytest.raises(pf.ConvergenceError, match="tol = 1e-11 is out of reach") as refused:
        pf.command(planar, move, tol=1e-11)
    floor = refused.value.data["floor"]
    assert 1e-11 < floor < 1e-4
    had = pf.command(planar, move, tol=2 * floor)
    assert (had.error - had.cut_off).max() < 2 * floor * 0.01  # it can be had
    assert time.process_time() - begun < 60  # it was 63 s for the first alone


def test_the_command_is_written_for_a_controller(planar: pf.Mechanism, tmp_path: Path) -> None:
    command = pf.command(planar, nonic_motion(0.1, x=0.01, y=0.0, rz=0.0), "quasistatic")
    lines = command.to_csv(tmp_path / "command.csv").read_text().splitlines()
    assert lines[0].startswith("t [s],motor_1.position [rad],motor_1.velocity [rad/s],")
    values = np.genfromtxt(lines[1:], delimiter=",")
    assert values.shape == (len(command.t), 1 + 4 * 3)
    np.testing.assert_allclose(values[:, 0], command.t, rtol=1e-11)


def test_a_command_beyond_the_motors_is_refused_and_says_how_long_it_must_take() -> None:
    """The delta's motors have 120 N m and 15 rad/s in its URDF; rigid inverse dynamics judge."""
    robot, most = pf.load("delta"), []
    quick = pf.nonic(platform={"x": 0.305, "y": 0.0, "z": 0.0}, duration=0.08)
    given = {"level": "rigid", "before": 0.01, "after": 0.01, "instants": 60}
    said = r"motor_\d needs .* effort limit is 120. Slow .* to ([\d.]+) s, .*limited"
    with pytest.raises(pf.MotionError, match=said) as refused:
        pf.command(robot, quick, **given)
    told = re.search(said, str(refused.value))
    assert told is not None
    for share in (1.0, 0.98):
        move = pf.nonic(platform={"x": 0.305, "y": 0.0, "z": 0.0}, duration=share * float(told[1]))
        most.append(np.abs(pf.solve(robot, move, level="rigid").torque).max())
    # instants are 3 ms apart, and a peak of 50 ms is 0.5 % higher between two of them at the most
    assert most[0] < 1.005 * 120.0 < most[1]


def test_the_rigid_command_has_the_torques_of_the_rigid_mechanism() -> None:
    """On a loop under gravity: the links of the closures carry their share."""
    robot = pf.load("race_r2")
    motion = nonic_motion(0.3, z=0.03, rx=0.1, ry=0.05)
    found = pf.command(robot, motion, "rigid", before=0.05, after=0.05, instants=121)
    rigid = pf.solve(robot, motion, level="rigid", samples=91)  # at the same instants
    at = np.searchsorted(found.t, 0.05 - 1e-9) + np.arange(91)
    t = found.t[at] - 0.05
    for k, name in enumerate(robot.motors):
        expected = np.interp(t, rigid.t, rigid.torque[:, k])
        error = np.max(np.abs(found.torque[at, k] - expected)[t <= 0.3])
        assert error < 1e-2 * np.max(np.abs(expected)), name  # interpolation between instants
