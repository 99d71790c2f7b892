"""Joints that close a loop and resist: bushings and springs beside closed forms.

Claims:
    Levels, energy, steps
    - a block on a bushing: deflection K^-1 w, six frequencies, damped ringing; spring and friction
      in a four-bar's closing pin | closed forms, scipy's eigh and expm; power of spring and
      friction; 1e-5, 1e-9, 1e-8 | passes
    - a guide that yields across and in tilt: frequencies and damped ringing wherever its slider is,
      F / k across it, torques of the ideal guide as it stiffens | closed forms; expm; level rigid;
      1e-9, 1e-5, 1e-8, order 1 within 1e-3 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh, expm

import pinflex as pf
from pinflex.arrays import Array
from tests.finite import slope
from tests.scenes import Body, load

MASS, COM, INERTIA = 2.0, np.array([0.1, 0.02, -0.03]), np.array([0.01, 0.02, 0.03])
FORCE, MOMENT = np.array([3.0, -2.0, 4.0]), np.array([0.2, 0.1, -0.3])


def block(folder: Path, stiffness: object, force: float, more: str = "") -> pf.Mechanism:
    body = Body(
        "block", "base", "floating", mass=MASS, com=tuple(COM.tolist()),
        inertia=tuple(INERTIA.tolist()),
    )  # fmt: skip
    F, M = (force * FORCE).tolist(), (force * MOMENT).tolist()
    return load(folder, [body], f"""
gravity: [0, 0, 0]
actuated: []
loops: {{rubber: {{kind: bushing, between: [base, block], stiffness: {stiffness}{more}}}}}
platform: block
forces: {{push: {{at: block, force: {F}, moment: {M}}}}}
""")  # fmt: skip


def coupled() -> Array:
    """A stiffness with everything coupled, its lever arms about 0.1 m."""
    random = np.random.default_rng(7)
    size = np.array([300.0, 400.0, 500.0, 30.0, 40.0, 50.0])
    return np.asarray(size[:, None] * (np.eye(6) + 0.05 * _symmetric(random)) * size)


def _symmetric(random: np.random.Generator) -> Array:
    A = random.normal(size=(6, 6))
    return np.asarray(A @ A.T / 3.0)


def masses() -> Array:
    """Of the block, about its frame."""
    c = np.cross(np.eye(3), COM)  # rows e_i x c: c' w = w x c
    M = np.zeros((6, 6))
    M[:3, :3] = MASS * np.eye(3)
    M[:3, 3:] = MASS * c.T
    M[3:, :3] = M[:3, 3:].T
    M[3:, 3:] = np.diag(INERTIA) + MASS * (COM @ COM * np.eye(3) - np.outer(COM, COM))
    return M


@pytest.mark.parametrize(
    "K",
    [np.diag([1e5, 2e5, 3e5, 1e3, 2e3, 3e3]), coupled()],
    ids=["diagonal", "coupled"],
)
def test_a_block_on_a_bushing_gives_way_and_vibrates_by_its_matrix(
    K: Array, tmp_path: Path
) -> None:
    written = np.diag(K).tolist() if not np.any(K - np.diag(np.diag(K))) else K.tolist()
    small = 1e-5  # of the load: what is linear is of the size of the turn, 1e-3 of 1e-5
    robot = block(tmp_path, written, small)
    y = pf.static_equilibrium(robot).y
    at = robot.rigid.rigid.names
    x, q = y[:3], y[3:7]
    moved = np.concatenate([x, 2.0 * q[:3] * np.sign(q[3])])
    assert "rubber.rz" in at
    exact = np.linalg.solve(K, small * np.concatenate([FORCE, MOMENT]))
    np.testing.assert_allclose(moved, exact, rtol=1e-5, atol=1e-6 * np.abs(exact).max())
    found = pf.modes(block(tmp_path, written, 0.0)).frequencies
    omega = np.sqrt(eigh(K, masses(), eigvals_only=True))
    np.testing.assert_allclose(found, omega / (2 * np.pi), rtol=1e-9)


def test_a_damped_bushing_rings_as_its_matrices_say(tmp_path: Path) -> None:
    """M x'' + D x' + K x = f from rest, by the matrix exponential."""
    K, D = np.array([1e4, 2e4, 3e4, 1e2, 2e2, 3e2]), np.array([20.0, 30, 40, 0.1, 0.2, 0.3])
    small = 1e-5
    robot = block(tmp_path, K.tolist(), small, f", damping: {D.tolist()}")
    run = pf.solve(robot, pf.hold(duration=0.1), level="coupled", start="straight", tol=1e-7)
    inverse = np.linalg.inv(masses())
    A = np.zeros((13, 13))
    A[:6, 6:12] = np.eye(6)
    A[6:12, :6], A[6:12, 6:12] = -inverse * K, -inverse * D
    A[6:12, 12] = inverse @ (small * np.concatenate([FORCE, MOMENT]))
    begin = np.eye(13)[12]
    exact = np.array([(expm(A * t) @ begin)[:3] for t in run.t[::20]])
    moved = run.frame("block").position[::20]
    # 1e-5 of turns of 1e-5 rad and their products, and the tolerance
    np.testing.assert_allclose(moved, exact, atol=1e-5 * np.abs(exact).max())


def test_three_numbers_leave_it_free_to_turn_and_a_change_of_them_counts(tmp_path: Path) -> None:
    K = [1e5, 2e5, 3e5]
    robot = block(tmp_path, K, 0.0)
    found = pf.modes(robot).frequencies
    rubber = np.zeros((6, 6))
    rubber[:3, :3] = np.diag(K)
    omega = np.sqrt(np.maximum(eigh(rubber, masses(), eigvals_only=True), 0.0))
    np.testing.assert_allclose(found, omega / (2 * np.pi), rtol=1e-9, atol=1e-4)
    stiffer = robot.with_({"loops.rubber.stiffness": [4e5, 8e5, 12e5]})
    np.testing.assert_allclose(pf.modes(stiffer).frequencies[3:], 2 * found[3:], rtol=1e-9)


FOUR_BAR = (
    Body("crank", "base", "revolute", mass=1.0, com=(0.1, 0, 0), inertia=(0.01,) * 3),
    Body("coupler", "crank", "revolute", xyz=(0.2, 0, 0), mass=1.0, inertia=(0.01,) * 3),
    Body("coupler_end", "coupler", xyz=(0.4, 0, 0)),
    Body("rocker", "base", "revolute", xyz=(0.4, 0, 0), mass=1.0, inertia=(0.01,) * 3),
    Body("rocker_end", "rocker", xyz=(0.3, 0, 0)),
)


def four_bar(folder: Path, more: str) -> pf.Mechanism:
    return load(folder, FOUR_BAR, f"""
gravity: [0, -9.81, 0]
actuated: [crank_joint]
home: {{crank_joint: 1.5, coupler_joint: -1.4, rocker_joint: 1.6}}
loops: {{pin: {{kind: revolute, between: [coupler_end, rocker_end]{more}}}}}
motion: {{kind: quintic, joints: {{crank_joint: 0.4}}, duration: 0.5}}
""")  # fmt: skip


def test_a_spring_and_friction_in_the_pin_that_closes_a_four_bar(tmp_path: Path) -> None:
    """Power: the crank's torque gives k (angle - rest) and the friction times the pin's speed."""
    k, rest, rub = 3.0, 0.2, 0.5
    plain, held = (
        pf.solve(four_bar(tmp_path, more), level="rigid", samples=41)
        for more in (
            "",
            f", stiffness: {k}, rest: {rest}, friction: {{coulomb: {rub}, speed: 1e-6}}",
        )
    )
    angle = plain.joint("rocker_joint").position - sum(
        plain.joint(f"{x}_joint").position for x in ("crank", "coupler")
    )
    speed = plain.joint("rocker_joint").velocity - sum(
        plain.joint(f"{x}_joint").velocity for x in ("crank", "coupler")
    )
    turns = 2 * np.pi * np.round((held.joint("pin").position - angle) / (2 * np.pi))
    crank = plain.joint("crank_joint").velocity
    some = np.abs(crank) > 1e-3 * np.abs(crank).max()
    exact = (k * (angle + turns - rest) + rub * np.sign(speed)) * speed
    added = ((held.torque - plain.torque)[:, 0] * crank)[some]
    np.testing.assert_allclose(added, exact[some], rtol=1e-8, atol=1e-9 * np.abs(exact).max())


CARRIAGE = Body("carriage", "base", "floating", mass=MASS, inertia=tuple(INERTIA.tolist()))
ACROSS, TILT, TURN = 3e5, 200.0, 50.0


def carriage(folder: Path, loop: str, more: str = "") -> pf.Mechanism:
    return load(
        folder,
        [CARRIAGE],
        f"""
gravity: [0, 0, 0]
actuated: []
home: {{carriage_joint: [0.7, 0, 0, 0, 0, 0, 1]}}
loops: {{guide: {{between: [base, carriage], axis: x, {loop}}}}}
platform: carriage
{more}""",
    )


@pytest.mark.parametrize(
    ("kind", "held", "free"),
    [("prismatic", ("across", "tilt", "turn"), 1), ("cylindrical", ("across", "tilt"), 2)],
)
def test_a_guide_yields_across_and_in_tilt(
    kind: str, held: tuple[str, ...], free: int, tmp_path: Path
) -> None:
    """0.7 m from the middle of the rail: sqrt(k / m) twice, sqrt(k / I) about each axis."""
    k = {"across": ACROSS, "tilt": TILT, "turn": TURN}
    given = ", ".join(f"{word}: {k[word]}" for word in held)
    found = pf.modes(carriage(tmp_path, f"kind: {kind}, stiffness: {{{given}}}")).frequencies
    square = [ACROSS / MASS, ACROSS / MASS, TILT / INERTIA[1], TILT / INERTIA[2]]
    square += [TURN / INERTIA[0]] if "turn" in held else []
    exact = np.sqrt(np.sort([*[0.0] * free, *square])) / (2 * np.pi)
    np.testing.assert_allclose(found, exact, rtol=1e-9, atol=1e-4)
    for pair in (["world", "carriage"], ["carriage", "world"]):
        turned = carriage(tmp_path, f"kind: {kind}, stiffness: {{{given}}}").with_(
            {"loops.guide.between": pair}
        )
        np.testing.assert_allclose(pf.modes(turned).frequencies, exact, rtol=1e-9, atol=1e-4)
    # Directions that are left out stay held.
    stiff = pf.modes(carriage(tmp_path, f"kind: {kind}, stiffness: {{across: {ACROSS}}}"))
    assert len(stiff.frequencies) == free + 2


def test_a_damped_guide_rings_across(tmp_path: Path) -> None:
    """x'' + c/m x' + k/m x = F/m from rest, by the matrix exponential."""
    c, force = 60.0, 3.0
    loop = f"kind: prismatic, stiffness: {{across: {ACROSS}}}, damping: {{across: {c}}}"
    push = f"forces: {{push: {{at: carriage, force: [0, {force}, 0]}}}}"
    robot = carriage(tmp_path, loop, push)
    run = pf.solve(robot, pf.hold(duration=0.05), level="coupled", start="straight", tol=1e-7)
    A = np.array([[0, 1, 0], [-ACROSS / MASS, -c / MASS, force / MASS], [0, 0, 0]])
    exact = np.array([(expm(A * t) @ [0, 0, 1])[0] for t in run.t])
    moved = run.frame("carriage").position[:, 1]
    np.testing.assert_allclose(moved, exact, rtol=0, atol=1e-5 * np.abs(exact).max())


SLIDER_CRANK = (
    Body("crank", "base", "revolute", mass=0.5, com=(0.05, 0, 0), inertia=(1e-3,) * 3),
    Body("rod", "crank", "revolute", xyz=(0.1, 0, 0), mass=0.3, com=(0.15, 0, 0),
         inertia=(2e-3,) * 3),
    Body("slider", "rod", "revolute", xyz=(0.3, 0, 0), mass=0.4, inertia=(1e-3,) * 3),
)  # fmt: skip


def slider_crank(folder: Path, more: str, g: float, force: str = "") -> pf.Mechanism:
    return load(
        folder,
        SLIDER_CRANK,
        f"""
gravity: [0, {-g}, 0]
actuated: [crank_joint]
home: {{crank_joint: 0.6, rod_joint: -0.8, slider_joint: 0.2}}
loops: {{guide: {{kind: prismatic, between: [base, slider], axis: x{more}}}}}
platform: slider
motion: {{kind: quintic, joints: {{crank_joint: 0.8}}, duration: 0.3}}
{force}""",
    )


def test_a_force_across_a_guide_and_guides_that_stiffen(tmp_path: Path) -> None:
    force = "forces: {push: {at: slider, force: [0, -30, 0]}}"
    robot = slider_crank(tmp_path, f", stiffness: {{across: {ACROSS}}}", 0.0, force)
    # The rod bears nothing at rest: what pushes the slider across goes into the guide alone.
    run = pf.solve(robot, pf.hold(duration=0.1), level="quasistatic", samples=2)
    moved = [abs(run.joint(f"guide.{x}").position[0]) for x in "xy"]
    assert max(moved) == pytest.approx(30 / ACROSS, rel=1e-8)
    assert min(moved) < 1e-12
    ideal = pf.solve(slider_crank(tmp_path, "", 9.81), level="rigid", samples=21).torque
    off, stiff = [], (1e5, 1e6, 1e7)
    for k in stiff:
        more = f", stiffness: {{across: {k}, tilt: {k / 1e3}, turn: {k / 1e3}}}"
        robot = slider_crank(tmp_path, more, 9.81)
        rigid, still = (pf.solve(robot, level=x, samples=21) for x in ("rigid", "quasistatic"))
        np.testing.assert_allclose(rigid.torque, ideal, rtol=0, atol=1e-12)
        off.append(np.abs(still.torque - ideal).max())
    assert slope(stiff, off) == pytest.approx(-1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("loop", "said"),
    [
        ("kind: bushing", "without stiffness"),
        ("kind: bushing, stiffness: [1, 2]", "2 numbers. Allowed: 3"),
        ("kind: planar, stiffness: 3", "no meaning for the kind planar"),
        ("kind: revolute, rest: 1", "there is no spring"),
        ("kind: prismatic, stiffness: {along: 1}", "Allowed: across, tilt, turn"),
        ("kind: cylindrical, stiffness: {turn: 1}", "turn: no such key. Allowed: across, tilt"),
        ("kind: prismatic, stiffness: {across: 0}", "finite number > 0"),
        ("kind: prismatic, stiffness: {}", "in which direction"),
        ("kind: distance, stiffness: {across: 1}", "a bearing of the kind distance has none"),
        ("kind: prismatic, stiffness: {across: 1}, damping: {tilt: 1}", "tilt: no such key"),
        ("kind: prismatic, damping: {across: 1}", "is not a number"),
        ("kind: prismatic, stiffness: {across: 1}, rest: 1", "there is no spring"),
        ("kind: bushing, stiffness: {across: 1}", "is not a list"),
        ("kind: planar, clearance: 50 um, pin: 5 mm, stiffness: {across: 1}", "held by contact"),
        ("kind: bushing, stiffness: [1, 2, 3], friction: 1", "no meaning for the kind bushing"),
    ],
)
def test_what_does_not_fit_is_refused(loop: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(pf.DescriptionError, match=said):
        load(tmp_path, FOUR_BAR, f"""
actuated: [crank_joint]
loops: {{pin: {{between: [coupler_end, rocker_end], {loop}}}}}
""")  # fmt: skip


def test_a_matrix_that_pushes_or_is_askew_is_refused(tmp_path: Path) -> None:
    K = np.eye(6) * 1e3
    K[0, 1] = K[1, 0] = 2e3
    with pytest.raises(pf.DescriptionError, match="pushes by itself"):
        block(tmp_path, K.tolist(), 0.0)
    K[0, 1] = 0.0
    with pytest.raises(pf.DescriptionError, match="not symmetric"):
        block(tmp_path, K.tolist(), 0.0)
