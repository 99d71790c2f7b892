"""Links at a temperature: bars that are free, held, in a triangle, close to buckling.

Claims:
    Equations
    - warm links, at every level: free bar alpha T L, held bar E alpha T, triangle of two bars,
      angles of a bent one | closed forms | 1e-9 | passes
    - a warm bar between pins: (omega/omega_0)^2 = 1 - T/T_Euler | Euler's column | 1e-5 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.description.blocks.material import MATERIALS
from pinflex.errors import DescriptionError
from pinflex.mechanics.evaluation.equations import Equations
from tests.scenes import Body, load

L, A, E, ALPHA, T = 0.5, 4e-4, 2.1e11, 12e-6, 50.0
EI = E * 0.02**4 / 12
BAR = (
    Body("tip", "bar", xyz=(L, 0, 0)),
    Body("post", "base", xyz=(L, 0, 0)),
    Body("arm", "base", "revolute", (2, 0, 0), mass=1.0, inertia=(0.1, 0.1, 0.1)),  # that moves
)
WELD = "loops: {post: {kind: weld, between: [tip, post]}}"
PIN = "loops: {post: {kind: revolute, between: [tip, post], axis: z}}"
WAYS = [
    ("quasistatic", {}), ("ked", {"dt": 1e-4}), ("coupled", {"dt": 1e-4}),
    ("coupled", {"tol": 1e-4}),
]  # fmt: skip
BASES = [
    (), ("flexible.bar.segments=3",),
    ("flexible.bar.basis={kind: finite_element, elements: 3}",),
    ("flexible.bar.basis={kind: assumed, stretch: polynomials}",),
    ("flexible.bar.basis={kind: ritz8}",),
]  # fmt: skip


def scene(
    folder: Path, head: str = "", overrides: tuple[str, ...] = (), joint: str = "fixed"
) -> pf.Mechanism:
    yaml = f"""
gravity: [0, 0, 0]
actuated: [arm_joint]
frames: [tip]
{head}
flexible:
  bar:
    material: steel
    section: {{shape: rectangle, width: 0.02, thickness: 0.02}}
    end: tip
    temperature: {T}
"""
    return load(folder, (Body("bar", "base", joint), *BAR), yaml, overrides)


def solve(m: pf.Mechanism, level: str, **options: object) -> pf.Result:
    move = pf.quintic(joints={"arm_joint": 0.5}, duration=0.02)
    return pf.solve(m, move, level, samples=11, **options)


def stretch(run: pf.Result) -> np.ndarray:
    return run.frame("tip").position[:, 0] - L


@pytest.mark.parametrize(("level", "options"), WAYS)
def test_a_free_bar_gets_longer_and_carries_nothing(level, options, tmp_path):
    run = solve(scene(tmp_path), level, **options)
    assert stretch(run) == pytest.approx(ALPHA * T * L, rel=1e-9)
    assert np.max(np.abs(run.link("bar").resultant)) < 1e-9 * E * A * ALPHA * T
    assert np.max(run["energy/elastic"]) < 1e-12 * E * A * L * (ALPHA * T) ** 2


@pytest.mark.parametrize("overrides", BASES)
def test_in_every_basis_that_stretches_evenly(overrides, tmp_path):
    assert stretch(solve(scene(tmp_path, "", overrides), "quasistatic")) == pytest.approx(
        ALPHA * T * L, rel=1e-9
    )
    held = solve(scene(tmp_path, WELD, overrides), "quasistatic")
    assert held.link("bar").stress("axial") == pytest.approx(-E * ALPHA * T, rel=1e-9)


@pytest.mark.parametrize(("level", "options"), WAYS)
@pytest.mark.parametrize(("head", "joint"), [(WELD, "fixed"), (PIN, "revolute")])
def test_a_bar_that_is_held_at_both_ends_is_pressed(head, joint, level, options, tmp_path):
    run = solve(scene(tmp_path, head, (), joint), level, **options)
    assert run.link("bar").stress("axial") == pytest.approx(-E * ALPHA * T, rel=1e-9)
    assert np.max(np.abs(stretch(run))) < 1e-12
    assert run["energy/elastic"] == pytest.approx(E * A * L * (ALPHA * T) ** 2 / 2, rel=1e-9)


@pytest.mark.parametrize("overrides", BASES[:3])
def test_a_bar_that_is_held_keeps_a_tolerance_and_its_energy(overrides, tmp_path):
    """It does not move but by round-off, which is nothing to take shorter steps for."""
    m = scene(tmp_path, WELD, overrides)
    run = pf.solve(m, pf.hold(duration=0.05), "coupled", tol=1e-4, samples=51)
    assert run.meta["energy_balance"] < 0.01
    assert run.meta["grades"]["energy"] == "good"


def test_the_rigid_level_knows_no_temperature(tmp_path):
    assert np.all(stretch(solve(scene(tmp_path), "rigid")) == 0.0)


@pytest.mark.parametrize(("level", "options"), WAYS[::2] + WAYS[3:])
def test_a_triangle_of_bars_closes_with_their_lengths(level, options, tmp_path):
    """Two bars from two pins to one: the cosine rule, of any size of strain; nothing is pressed."""
    lengths, base = (L * (1 + ALPHA * 200), L * (1 - ALPHA * 100)), 0.6
    turn = np.arccos(0.5 * base / L)
    bodies = (
        Body("bar", "base", "revolute", rpy=(0, 0, turn)),
        Body("tip", "bar", xyz=(L, 0, 0)),
        Body("other", "base", "revolute", (base, 0, 0), (0, 0, np.pi - turn)),
        Body("end", "other", xyz=(L, 0, 0)),
        BAR[2],
    )
    bar = "material: steel, section: {shape: rectangle, width: 0.02, thickness: 0.02}"
    m = load(tmp_path, bodies, f"""
gravity: [0, 0, 0]
actuated: [arm_joint]
frames: [tip]
loops: {{apex: {{kind: revolute, between: [tip, end], axis: z}}}}
flexible:
  bar: {{{bar}, end: tip, temperature: 200}}
  other: {{{bar}, end: end, temperature: -100}}
""")  # fmt: skip
    run = solve(m, level, **options)
    x = (lengths[0] ** 2 - lengths[1] ** 2 + base**2) / (2 * base)
    apex = np.array([x, np.sqrt(lengths[0] ** 2 - x**2)])
    # ... of a stretch of 1.2 mm.
    assert np.max(np.abs(run.frame("tip").position[:, :2] - apex)) < 1e-9
    assert np.max(np.abs(run.link("bar").stress("axial"))) < 1e-6 * E * ALPHA * 200


def test_a_bent_link_grows_alike_in_every_direction(tmp_path):
    """A frame of straight pieces keeps its angles: each point moves by alpha T of its place."""
    corners = np.array([[0, 0, 0], [0.3, 0, 0], [0.3, 0.2, 0], [0.5, 0.2, 0.1]])
    bodies = (Body("bar", "base", "fixed"), Body("tip", "bar", xyz=tuple(corners[-1])), BAR[2])
    m = load(
        tmp_path,
        bodies,
        f"""
gravity: [0, 0, 0]
actuated: [arm_joint]
frames: [tip]
flexible:
  bar:
    material: steel
    section: {{shape: circle, diameter: 0.02}}
    temperature: {T}
    polyline: {corners.tolist()}
""",
    )
    tip = solve(m, "quasistatic").frame("tip").position
    assert np.max(np.abs(tip - corners[-1] * (1 + ALPHA * T))) < 1e-9 * ALPHA * T


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_a_warm_bar_between_pins_is_softer(share, tmp_path):
    """omega^2 / omega_0^2 = 1 - T / T_E, with the Euler load E A alpha T_E = pi^2 EI / L^2."""
    warm = share * np.pi**2 * EI / L**2 / (E * A * ALPHA)
    only = ("flexible.bar.bending_z=false", "flexible.bar.basis.internal=6")

    def first(temperature: float) -> float:
        set_to = (f"flexible.bar.temperature={temperature}", *only)
        return float(pf.modes(scene(tmp_path, PIN, set_to, "revolute")).frequencies[0])

    assert (first(warm) / first(0.0)) ** 2 == pytest.approx(1 - share, abs=1e-5)


def test_a_start_that_is_straight_rings_and_keeps_its_energy(tmp_path):
    """A bar made warm at once swings about its free length, as one that is let go."""
    run = pf.solve(
        scene(tmp_path), pf.hold(duration=2e-3), "coupled", tol=1e-6, samples=201, start="straight"
    )
    total = run["energy/kinetic"] + run["energy/elastic"]
    assert total[0] == pytest.approx(E * A * L * (ALPHA * T) ** 2 / 2, rel=1e-9)
    assert np.max(np.abs(total / total[0] - 1)) < 1e-5
    assert np.max(stretch(run)) > 1.9 * ALPHA * T * L


@pytest.mark.parametrize("head", ["", WELD])
def test_the_kernel_and_the_reference_agree(head, tmp_path):
    system = scene(tmp_path, head).flexible
    d, rng = Equations(system), np.random.default_rng(3)
    if d.compiled is None:
        pytest.skip("no kernel")
    Y = 1e-3 * rng.uniform(-1, 1, (5, system.nq))
    V, acc = rng.uniform(-1, 1, (2, 5, system.nv))
    lam, t = rng.uniform(-1, 1, (5, system.closed.n)), np.zeros(5)
    mine, known = (x.residual(Y, V, acc, lam, t)[0] for x in (d.compiled, d.reference))
    assert np.max(np.abs(d.strain.force(np.zeros(system.n_eta)))) > 1e3  # N: the term is there
    assert np.max(np.abs(mine - known)) < 1e-11 * np.max(np.abs(known))
    mine, known = (x.energies(Y, V, t).elastic for x in (d.compiled, d.reference))
    assert mine == pytest.approx(known, rel=1e-11)


def test_without_the_kernel_it_is_the_same(tmp_path, monkeypatch):
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    run = solve(scene(tmp_path), "quasistatic")
    assert "kernel (" not in run.meta["evaluated_by"]
    assert stretch(run) == pytest.approx(ALPHA * T * L, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("axial=false", "a warm link stretches"),
        ("material=pla", "the expansion of pla is not known"),
        ("material={E: 1e9, nu: 0.3}", "material.thermal_expansion"),
        ("temperature=warm", "is not a number"),
    ],
)
def test_a_temperature_that_means_nothing_is_refused(change, said, tmp_path):
    with pytest.raises(DescriptionError, match=said):
        scene(tmp_path, "", (f"flexible.bar.{change}",))


def test_an_expansion_of_its_own(tmp_path):
    change = ("flexible.bar.material={like: pla, thermal_expansion: 7e-5}",)
    run = solve(scene(tmp_path, "", change), "quasistatic")
    assert stretch(run) == pytest.approx(7e-5 * T * L, rel=1e-9)


def test_the_materials_with_a_source_expand():
    known = {name: m.thermal_expansion for name, m in MATERIALS.items()}
    assert known.pop("pla") is None
    assert all(known.values())
    assert known["steel"] == ALPHA
