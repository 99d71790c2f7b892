"""Advice on scenes of different nature: its error bars cover what was measured.

Errors are measured from outside of it: on what a Result reports (torques, poses, deflections of the
sections), against eight segments in each link with every plane, stretch, twist and second order
(race_r2, whose links hardly deform: one more mode), solved to a twentieth of the tolerance.

Claims:
    Advice
    - accelerations that jump (trapezoid): bars of rigid and ked from half the error to three times
      it; the proposal keeps its own | 0.5 to 3 | ur5: 1.9 (10 before), delta: 2.3 (25 before)
    - a proposal keeps the tolerance wherever a row of its table does, without stretch and twist
      that cost nothing: ur5, delta, 1 %, quintic and trapezoid | exact | passes
    - progress is told from look to look | exact | passes
    - a whirling blade far from linear vibration: what segments bring is measured, by runs | 4
      segments | error <= bar; bar < 3 error as loaded | 7.8 % of 13 %, the proposal 1.2 % of 4.6 %
      (1.3 % was told)
    - a gantry whose long arm bends: twice the error of the rigid torque | one mass on a spring |
      3 % | 1.7 %
"""

from __future__ import annotations

import json

import numpy as np
import pytest

import pinflex as pf
from pinflex.advice import error_bars
from pinflex.advice.advise import advise
from pinflex.advice.error_bars import finer_model
from pinflex.advice.reduced_models import richer
from tests.cli.small import call
from tests.scenes import Body, load, published

ALL = ("torque", "deflection", "platform")
SLOW = ("motion.duration=4", "solve.until=4", "solve.start=static")
STATIC = ("solve.start=static",)
# At full speed at once, from straight links. Without damping its stretch rings on from there, and
# nothing but its step answers for torques.
STIFFENED = (
    "flexible.*.second_order=true", "damping={rayleigh: [0, 2.0e-5]}", "solve.start=straight"
)  # fmt: skip
SCENES = {
    "stiff": ("ur5", STATIC, 0.1, ("torque",), "rigid"),
    "stiff, all": ("ur5", STATIC, 0.02, ALL, "coupled"),
    "slow": ("race_r2", SLOW, 0.02, ALL, None),
    "fast": ("race_r1", (), 0.03, ("torque",), "rigid"),
    "fast, all": ("race_r1", (), 0.02, ALL, "coupled"),
    "spinning": ("spinning_beam", (), 0.03, ("torque",), "rigid"),
    "spinning, all": ("spinning_beam", (), 0.03, ALL, None),
    "planar": ("3rrr", STIFFENED, 0.1, ("torque",), "coupled"),
    "spinning, tight": ("spinning_beam", (), 0.001, ALL, "coupled"),
    "large": ("cantilever", (), 0.01, ALL, "coupled"),
    "spatial": ("race_r2", (), 0.02, ALL, "coupled"),
}


def relative(a: np.ndarray, b: np.ndarray, scale: float | None = None) -> float:
    scale = float(np.max(np.abs(b))) if scale is None else scale
    return float(np.max(np.abs(a - b))) / scale if scale > 1e-9 else 0.0


def turned(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Small rotation vectors from A to B."""
    R = A.transpose(0, 2, 1) @ B
    S = 0.5 * (R - R.transpose(0, 2, 1))
    return np.stack([S[:, 2, 1], S[:, 0, 2], S[:, 1, 0]], axis=1)


def bent(run: pf.Result, full: pf.Result, link: str) -> tuple[np.ndarray, np.ndarray]:
    """Deflections of a link at the sections that both runs report."""
    b = full.link(link)
    if link not in run.links:
        return 0.0 * b.deflection[:, :, :3], b.deflection[:, :, :3]
    a = run.link(link)
    near = np.argmin(np.abs(b.x[:, None] - a.x), axis=0)
    same = np.abs(b.x[near] - a.x) < 1e-6 * b.length
    return a.deflection[:, same, :3], b.deflection[:, near[same], :3]


def measured(run: pf.Result, full: pf.Result, rigid: pf.Result, asked) -> dict[str, float]:
    """Largest differences over the samples, by output, relative as the advice says."""
    errors = {}
    if "torque" in asked and run.motors:
        errors["torque"] = relative(run.torque, full.torque)
    if "deflection" in asked:
        pairs = [bent(run, full, x) for x in full.links]
        scale = max(float(np.max(np.abs(b))) for _, b in pairs)
        errors["deflection"] = max(relative(a, b, scale) for a, b in pairs)
    name = full.meta["platform"]
    if "platform" in asked and name:
        p, p_full, p_rigid = (x.frame(name).position for x in (run, full, rigid))
        R, R_full, R_rigid = (x.frame(name).rotation for x in (run, full, rigid))
        far = float(np.max(np.abs(p_full - p_rigid)))
        errors["platform position"] = relative(p, p_full, far)
        most = float(np.max(np.abs(turned(R_rigid, R_full))))
        off = float(np.max(np.abs(turned(R, R_full))))
        errors["platform rotation"] = off / most if most > 1e-9 else 0.0
    return errors


def truth(mechanism: pf.Mechanism) -> pf.Mechanism:
    """The scene with everything on."""
    if mechanism.name == "race_r2":  # eight segments would be 240 coordinates
        return richer(mechanism)[0]
    changes = ["flexible.*.segments=8", "flexible.*.basis.internal=0"]
    keys = ("axial", "second_order", "shear", "rotary_inertia")
    if mechanism.name in ("ur5", "delta"):  # not in a plane
        keys += ("torsion", "bending_y", "bending_z")
    changes += [f"flexible.*.{key}=true" for key in keys]
    return pf.load(mechanism.description.with_overrides(changes))


@pytest.mark.parametrize("scene", SCENES)
def test_error_bars_cover_the_measured_errors(scene):
    model, changes, tol, asked, level = SCENES[scene]
    mechanism = pf.load(model, list(changes))
    found = advise(mechanism, tol=tol, band=0.0, asked=asked)  # of the platform too: relative
    followed = pf.load(mechanism.description, list(found.overrides))
    options = {} if found.run_tol is None else {"tol": found.run_tol, "asked": asked}
    run = pf.solve(followed, level=found.level, samples=101, **options)
    full = truth(mechanism)
    reference = pf.solve(full, level="coupled", samples=101, tol=tol / 20, asked=asked)
    rigid = pf.solve(mechanism, level="rigid", samples=101)
    errors = measured(run, reference, rigid, asked)
    print("\n", scene, found.level, found.overrides, found.coordinates, f"{found.seconds:.1f} s")
    print({k: f"{e:.1e} of {found.error[k]:.1e}" for k, e in errors.items()})
    print({x: round(r.meta["cost"]["seconds"], 3) for x, r in (("run", run), ("full", reference))})
    assert level in (None, found.level)
    for key, error in errors.items():
        assert error <= found.error[key], f"{key}: {error:.2g}, error bar {found.error[key]:.2g}"
    if found.level == "rigid":
        assert found.error["torque"] <= tol


def test_stretch_is_what_moves_the_platform_of_race_r1():
    """Links pinned at both ends bend without moving it: without stretch 14 nm, with it 0.7 um."""
    found = advise(pf.load(published("race_r1")), tol=0.02, band=0.0, asked=ALL)
    assert "flexible.*.axial=true" in found.overrides
    assert all("u" in part.planes for part in pf.load("race_r1").parts.values())  # by itself
    stretch = next(x for x in found.left_out if "axial" in x.what)
    assert not stretch.out and stretch.error["platform position"] > 0.9  # 1 - 14 nm / 0.7 um
    flat = next(x for x in found.left_out if "bending_z" in x.what)
    # Nothing excites bending out of the plane: what is left is round-off of the comparison.
    assert flat.out and max(flat.error.values()) < 1e-9


def test_auto_solves_at_the_level_advised_and_says_why():
    robot = pf.load("race_r1")
    run = pf.solve(robot, level="auto", tol=0.03, asked=("torque",), samples=21)
    assert run.level == "rigid" == run.meta["advice"]["level"]
    assert "error bars" in run.meta["advice"]["why"]


def test_segments_and_second_order_are_tried() -> None:
    """One segment is 0.39 % off where 0.1 % is asked; 3rrr without second order, 75 %."""
    tight = advise(pf.load("spinning_beam"), tol=0.001, band=0.0, asked=ALL)
    assert "flexible.*.segments=2" in tight.overrides
    off = ["flexible.*.second_order=false", *STIFFENED[1:]]
    linear = advise(pf.load("3rrr", off), tol=0.02, band=0.0, asked=ALL)
    assert "flexible.*.second_order=true" in linear.overrides
    tried = next(x for x in linear.left_out if x.what.startswith("second order"))
    assert not tried.out and max(tried.error.values()) > 0.1


def test_what_is_not_known_is_said_in_words(capsys) -> None:
    """3rrs buckles: no level below coupled has an error bar."""
    text = call(capsys, "advise", "3rrs", "--tol", "0.02").out
    assert "not measured" in text and " inf" not in text and "?" not in text


def test_what_no_look_measured_has_no_error_bar(capsys):
    """Motors that push: only a run tells what the model leaves out, and it was told as 1.2 %."""
    pushed = ["solve.drive=torque"]
    found = advise(pf.load("cantilever", pushed))
    assert found.level == "coupled" and not np.isfinite(list(found.error.values())).any()
    text = call(capsys, "advise", "cantilever", "--set", *pushed).out
    assert "not measured" in text and "that run tells its own error bars" in text


def test_the_command_says_it_for_people_and_machines(capsys):
    arguments = ("advise", "race_r1", "--asked", "torque", "--tol", "0.03")
    text = call(capsys, *arguments).out
    assert "Proposal: level rigid" in text
    answer = json.loads(call(capsys, *arguments, "--json").out)
    assert answer["level"] == "rigid" and 0 < answer["error"]["torque"] <= 0.03


@pytest.mark.parametrize(
    ("options", "text"),
    [({"tol": 0.5}, "tol: 0.5"), ({"asked": ("torqe",)}, 'Did you mean "torque"')],
)
def test_what_cannot_be_asked_is_said(options, text):
    with pytest.raises(pf.DescriptionError, match=text):
        advise(pf.load("cantilever"), **options)


def test_progress_is_told_up_to_the_last_look() -> None:
    told: list[tuple[int, int]] = []
    advise(pf.load("race_r2"), progress=lambda step, steps: told.append((step, steps)))
    assert [step for step, _ in told] == [1, 2, 3, 4] and {steps for _, steps in told} == {5}


TRAPEZOID = ("motion.kind=trapezoid", "motion.ramp=0.1")


@pytest.mark.parametrize("model", ["ur5", "delta"])
def test_accelerations_that_jump_make_no_level_worse_than_it_is(model: str) -> None:
    """Bars of ked and rigid between their error against a fine run and three times that.

    What the steps of a look make of a vibration that a jump starts was in all bars before: 41 %
    for ked and for coupled itself, of which 4.6 % are true.
    """
    robot = pf.load(model, list(TRAPEZOID))
    found = advise(robot, tol=0.05, band=0.0)
    fine = pf.solve(robot, level="coupled", samples=401, tol=1e-4)
    runs = {level: pf.solve(robot, level=level, samples=401) for level in ("rigid", "ked")}
    for level, run in runs.items():
        true = measured(run, fine, runs["rigid"], ("torque",))["torque"]
        assert 0.5 * true < found.levels[level]["torque"] < 3.0 * true, level
    assert found.used(found.error) <= 1.0 and found.level == "coupled"
    followed = pf.load(robot.description, list(found.overrides))
    run = pf.solve(followed, level="coupled", samples=401, tol=found.run_tol)
    full = pf.solve(finer_model(robot)[0], level="coupled", samples=401, tol=1e-3)
    errors = measured(run, full, runs["rigid"], ("torque", "platform"))
    assert errors == {k: e for k, e in errors.items() if e <= found.error[k]}


@pytest.mark.parametrize("changes", [(), TRAPEZOID])
def test_a_proposal_keeps_its_tolerance_and_adds_nothing_that_costs_nothing(changes) -> None:
    """1 %: proposals of ur5 and delta missed it by runs that they cut too short of modes."""
    for model in ("ur5", "delta"):
        found = advise(pf.load(model, list(changes)), tol=0.01)
        rows = {x: found.used(e) for x, e in found.levels.items()}
        assert found.used(found.error) <= 1.0 or min(rows.values()) > 1.0, (model, rows)
        if model == "delta":  # `check` puts stretch of arms and twist of rods below 1e-4
            assert not any(".axial=true" in x or ".torsion=true" in x for x in found.overrides)


GANTRY = """
actuated: [bridge_joint, arm_joint]
platform: gripper
flexible:
  arm:
    material: aluminium
    section: {shape: given, A: 5e-4, Iy: 6e-8, Iz: 2e-7, J: 1e-7}
    end: gripper
motion: {kind: cycloid, joints: {bridge_joint: 0.3}, duration: 0.4}
"""


def test_whole_runs_that_take_too_long_are_given_up(monkeypatch) -> None:
    """Undamped stretch under a load that comes at once takes steps of 1e-5 s, run after run."""
    monkeypatch.setattr(error_bars, "_LONGEST", 0.0)
    found = pf.advise(pf.load("race_r3"))
    assert any("a whole run stops: its run takes more than" in note for note in found.notes)
    # The doubt is in the bars of the levels: two to three times the vibration's own size.
    assert max(found.levels["ked"].values()) > 0.5


def test_corrections_that_move_nothing_keep_no_level_from_being_measured(tmp_path):
    """A gantry with a long arm: what its drive feels of it, as one mass on a spring.

    Two corrections of the platform by 3e-5 of its deviation did not shrink, and no level was told.
    """
    length, carried, beam = 1.5, 2.0, 2700 * 5e-4 * 1.5
    bodies = [
        Body("bridge", "base", "prismatic", axis=(1, 0, 0), mass=10.0, inertia=(1.0, 1.0, 1.0)),
        Body("arm", "bridge", "prismatic", mass=beam, com=(0, length / 2, 0),
             inertia=(beam * length**2 / 12, 1e-3, beam * length**2 / 12)),
        Body("gripper", "arm", xyz=(0, length, 0), mass=carried, inertia=(2e-3,) * 3),
    ]  # fmt: skip
    found = advise(load(tmp_path, bodies, GANTRY))
    # The shape of the static bend: of the beam's mass 33/140 count as at the tip, moved 3/8.
    mass, moved, k = carried + 33 / 140 * beam, carried + 3 / 8 * beam, 3 * 70e9 * 2e-7 / length**3
    w, rate = np.sqrt(k / mass), 2 * np.pi / 0.4
    t, share = np.linspace(0.0, 0.4, 4001), moved / mass
    a = 0.3 * rate / 0.4 * np.sin(rate * t)
    free = np.sin(rate * t) - rate / w * np.sin(w * t)
    bend = -share * 0.3 * rate / 0.4 / (w**2 - rate**2) * free
    felt = moved * (-(w**2) * bend - share * a)
    error = np.abs(felt).max() / np.abs((10.0 + beam + carried) * a + felt).max()
    # 3 %: the shape of the first mode is not that of the static bend, higher ones are left out
    assert found.levels["rigid"]["torque"] == pytest.approx(2.0 * error, rel=0.03)
    assert found.levels["ked"]["torque"] < 0.01  # bending by 1/500 of the length is linear


BLADE = """
platform: tip
flexible:
  blade:
    material: aluminium
    section: {shape: rectangle, width: 0.03, thickness: 0.003}
    end: tip
damping: {modal: 0.01}
motion: {kind: spin_up, joints: {hub_joint: 15}, duration: 0.5}
solve: {until: 0.7}
"""


def test_segments_are_measured_where_vibration_is_far_from_linear(tmp_path):
    """No cheap look tells of two segments: they were left out of the bars, and "reached" was said.

    The blade is pitched against the plane of its spin and carries its tip's mass beside its line.
    """
    bodies = [
        Body("hub", "base", "revolute", mass=2.0, inertia=(0.02,) * 3),
        Body("blade", "hub", xyz=(0.1, 0, 0), rpy=(0.5, 0, 0)),
        Body("tip", "blade", xyz=(0.6, 0, 0), mass=0.1, com=(0.02, 0.05, 0), inertia=(2e-5,) * 3),
    ]
    robot = load(tmp_path, bodies, BLADE)
    found = advise(robot, band=0.0)
    every = ("bending_y", "bending_z", "torsion", "axial", "second_order")
    full = [f"flexible.blade.{key}=true" for key in every]
    fine = pf.load(robot.description, [*full, "flexible.blade.segments=4"])
    reference = pf.solve(fine, tol=1e-4, samples=101)
    rigid = pf.solve(robot, level="rigid", samples=101)
    proposed = pf.load(robot.description, list(found.overrides))
    rows = ((robot, found.levels["coupled"]), (proposed, found.error))
    off = []
    for model, told in rows:
        run = pf.solve(model, level="coupled", tol=1e-3, samples=101)
        errors = measured(run, reference, rigid, ("torque", "platform"))
        assert all(error <= told[key] for key, error in errors.items()), (errors, told)
        off.append(errors)
    assert all(found.levels["coupled"][key] < 3.0 * error for key, error in off[0].items())
    assert found.used(found.error) <= 1.0
