"""Sliders of a page: what they stand for, and what they do to the tables of the kernel.

Claims:
    Pages, pictures, figures
    - round-off does not grow from step to step (lengths of steps rounded) | a payload 1e-13
      heavier: torques 1e-8 | 1.5e-9 (8.5e-5 without)
"""

from __future__ import annotations

import numpy as np
import pytest

import pinflex as pf
from pinflex.browser.recipe import live_scene, pattern_of, tables_of, widened
from pinflex.browser.sliders import changes, proposed
from pinflex.kernel.evaluate import Evaluator, Tables
from tests.browser.native import apart, corrections, native_run

ARM = """<robot name="arm"><link name="base"/><link name="beam"/>{tool}
<joint name="motor" type="revolute"><parent link="base"/><child link="beam"/><axis xyz="0 1 0"/>
<limit lower="-9" upper="9" effort="1e3" velocity="99"/></joint>
<joint name="end" type="fixed"><parent link="beam"/><child link="tool"/>
<origin xyz="0.5 0 0"/></joint>
</robot>"""
HEAVY = """<inertial><mass value="2"/>
<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>"""
SCENE = """
urdf: arm.urdf
gravity: [0, 0, -9.81]
platform: tool
flexible:
  beam:
    material: aluminium_6061
    section: {shape: rectangle, width: 0.02, thickness: 0.01}
    start: beam
    end: tool
damping: {rayleigh: [0, 1.0e-4]}
motion: {kind: quintic, joints: {motor: 1.0}, duration: 0.5}
solve: {level: coupled, samples: 21}
"""


def arm(folder, tool="<link name='tool'/>"):
    folder.mkdir(exist_ok=True)
    (folder / "arm.urdf").write_text(ARM.format(tool=tool))
    (folder / "arm.yaml").write_text(SCENE)
    return folder / "arm.yaml"


def test_a_payload_is_a_point_mass_of_the_platform(tmp_path):
    """As an override it does what the same mass does in the URDF: inertia and weight."""
    slider = proposed(pf.load("ur5"))[0]
    assert slider.name == "payload"
    light = arm(tmp_path / "light")
    keys = next(s for s in proposed(pf.load(light)) if s.name == "payload")
    added = pf.load(light, keys.overrides(2.0))
    heavy = pf.load(arm(tmp_path / "heavy", f"<link name='tool'>{HEAVY}</link>"))
    a, b = (pf.solve(m, tol=1e-7) for m in (added, heavy))
    # Both runs are within their tolerance of one motion: twice 1e-7 of torques and deflections.
    assert np.abs(a.torque - b.torque).max() < 1e-6 * np.abs(b.torque).max()


def test_speed_stretches_time_alone():
    """Rigid inertia torques of a robot without gravity go with the square of speed."""
    slider = next(s for s in proposed(pf.load("3rrr")) if s.name == "speed")
    slow, fast = (
        pf.solve(pf.load("3rrr", slider.overrides(p)), level="rigid", samples=21)
        for p in (1.0, 2.0)
    )
    assert fast.t[-1] == pytest.approx(slow.t[-1] / 2, rel=1e-14)
    # gravity is zero there, and motors have no friction: round-off of inverse dynamics
    assert np.abs(fast.torque - 4.0 * slow.torque).max() < 1e-9 * np.abs(fast.torque).max()


def test_what_a_slider_does_is_found_in_the_tables(tmp_path):
    """At a place between those that were looked at, lines and factors are exact to round-off."""
    description = pf.load(arm(tmp_path)).description
    sliders = proposed(pf.load(description))
    base = sliders[0].for_tables(1.0)
    found = changes(description, sliders, tables_of, base)
    kinds = {name: change.kind for name, change in found.changes.items()}
    assert kinds["payload"] == "line"
    assert kinds["damping"] == "factor"
    origin = tables_of(pf.load(description, base))
    payload, damping = (next(s for s in sliders if s.name == n) for n in ("payload", "damping"))
    there = tables_of(pf.load(description, [*payload.for_tables(0.37), *damping.overrides(2.3)]))
    made = {name: x.copy() for name, x in origin.items()}
    change = found.changes["payload"]
    for name, at in change.entries.items():
        slopes = change.values[name][len(at) :]
        made[name][at] += (0.37 - 1.0) * slopes
    for name, at in found.changes["damping"].entries.items():
        made[name][at] *= 2.3
    for name, wanted in there.items():
        # 1e-12: ten roundings of numbers that differ by as many powers of ten
        assert np.abs(made[name] - wanted).max() <= 1e-12 * np.abs(wanted).max() + 1e-300, name


def test_a_page_says_what_it_cannot_run():
    with pytest.raises(pf.DescriptionError, match="no sleeve on a beam"):
        live_scene(pf.load("prprp"))
    with pytest.raises(pf.DescriptionError, match="no link to bend"):
        live_scene(pf.load("cassie"))


def test_zeros_in_the_places_of_others_change_nothing():
    """Tables with zeros where other tables have entries are the same equations."""
    arm = pf.load("ur5")
    tables, system = tables_of(arm), live_scene(arm).equations().system
    large = np.abs(tables["phi"]) > 1e-12 * np.abs(tables["phi"]).max()
    counted = np.concatenate([[0], np.cumsum(large)])
    bare = tables | {
        "phi": tables["phi"][large],
        "phi_i": tables["phi_i"][large],
        "phi_at": counted[tables["phi_at"].astype(int)].astype(float),
    }
    wide = widened(bare, pattern_of([bare, tables]))
    assert wide["phi"].size > bare["phi"].size
    wide, bare = (Tables(system.tables.counts, system.tables.arrays | t) for t in (wide, bare))
    rng, n = np.random.default_rng(2), system.tables.counts
    y, v, a = (1e-2 * rng.standard_normal((3, n[k])) for k in ("nq", "nv", "nv"))
    rest = np.zeros((3, n["closures"])), np.zeros((3, n["forces"]))
    r, wanted = (Evaluator(t).residual(y, v, a, *rest)[0] for t in (wide, bare))
    # sums with zeros among them: the order of the others is the same
    assert np.abs(r - wanted).max() <= 1e-14 * np.abs(wanted).max()


def test_a_section_between_the_tables_is_off_by_no_more_than_is_told():
    description = pf.load("3rrr").description
    sliders = [s for s in proposed(pf.load("3rrr")) if s.acts == "section"]
    found = changes(description, sliders, tables_of, [])
    assert [s.label for s in found.sliders] == ["thickness of distal_1\u20133"]
    change = found.changes["thickness of distal_?"]
    assert 0.0 < change.error < 1e-9  # cubes of the thickness by a fifth degree; rounding 1.5e-11
    there, here = (
        widened(tables_of(pf.load(description, sliders[0].overrides(p))), found.pattern)
        for p in (1.234, float(change.nodes[0]))
    )
    x = change.nodes
    powers = np.vander((x - 1.0) / 0.35, increasing=True)
    place = np.vander([(1.234 - 1.0) / 0.35], len(x), increasing=True)
    weights = np.linalg.solve(powers.T, place[0])
    for name, entries in change.entries.items():
        every = change.values[name].reshape(len(x), -1)
        made = (weights @ every - every[0]) - (there[name][entries] - here[name][entries])
        # the error told is the largest at three places; at others it may be twice that
        size = np.abs(there[name]).max()
        assert np.abs(made).max() < 2.0 * change.error * size + 1e-13 * size


def test_round_off_does_not_grow_from_step_to_step():
    """A payload heavier by 1e-13 of itself: torques differ by as much, not by the tolerance.

    Lengths of steps that follow estimates of error to all digits make 4e-6 of it at the end.
    """
    fixed = ["damping.modal=0.0045", "motion.omega=17.5", "solve.until=0.36"]
    mechanisms = [
        pf.load("3rrr", [*fixed, f"payload={{at: platform, mass: {m!r}}}"])
        for m in (0.135, 0.135 * (1 + 1e-13))
    ]
    t = np.linspace(0.0, 0.36, 41)
    a, b = (native_run(mechanism, t) for mechanism in mechanisms)
    assert a.cost["steps"] == b.cost["steps"]
    # loops are closed to 1e-16 m, which counts as acceleration by 1 / h^2: 4e-10 seen
    assert apart(a.torque, b.torque) < 1e-8


def test_a_correction_after_a_stop_is_one():
    """A slow move with a heavy tool: short steps where it stops, by the mass of the pose there.

    By the mass of another pose the second correction was off by a seventh of the torque, and the
    page said so of a run that was right.
    """
    ov = ["motion.duration=0.92", "solve.until=1.47", "payload={at: tool0, mass: 3.1}"]
    mechanism = pf.load("ur5", ov)
    t = np.linspace(0.0, 1.47, 401)
    once, twice = corrections(mechanism, t)
    finer = pf.solve(mechanism, tol=1e-5).torque
    # within the tolerance of the page, both of them
    assert apart(once.torque, finer) < 1e-3
    assert apart(twice.torque, finer) < 1e-3
