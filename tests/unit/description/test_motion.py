"""Motions: derivatives, ends, the worked examples of the source papers, and every wrong input."""

import json
import pickle
import re

import numpy as np
import pytest

from pinflex.description.motions.motion import (
    KINDS,
    Motion,
    circle,
    cycloid,
    from_spec,
    harmonic,
    hold,
    quintic,
    sampled,
    trapezoid,
)
from pinflex.errors import DescriptionError

T = np.linspace(0.0, 0.8, 9)
WAVE = np.sin(np.pi * T / 0.8) ** 4

SMOOTH = {
    "cycloid": cycloid(joints={"motor_1": 0.25, "motor_2": -0.15}, duration=0.8),
    "quintic": quintic(platform={"z": -0.0075, "ry": -0.155, "rx": 0.03}, duration=0.8),
    "harmonic": harmonic(joints={"motor_1": 0.2}, frequency=2.0, phase=0.4, duration=0.8),
    "faded harmonic": harmonic(joints={"a": 0.2, "b": 1.0}, frequency=2.0, phase=0.4, smooth=0.3),
    "circle": circle(center=[0.3, 0.1], radius=0.06, omega=6.0, fixed={"rz": 0.1}),
    "ramped circle": circle(
        center=[0.3, 0.1], radius=0.06, omega=6.0, direction=-1, plane=["z", "x"], ramp=0.4
    ),
    "samples": sampled(t=T, joints={"motor_1": WAVE, "motor_2": T**3}),
    "periodic samples": sampled(t=T, platform={"x": np.sin(2 * np.pi * T / 0.8)}, periodic=True),
    "hold": hold(duration=0.8),
}
ALL = SMOOTH | {"trapezoid": trapezoid(joints={"motor_1": 0.2}, ramp=0.1, duration=0.8)}


@pytest.mark.parametrize("name", ALL)
def test_velocity_and_acceleration_are_the_derivatives_of_position(name):
    motion = ALL[name]
    step = 1e-5
    # Midpoints of cells: away from the switching instants of the ramps, where a jumps.
    t = (np.arange(400) + 0.5) * 0.0031
    (p0, v0, _), (p1, v1, _) = motion.evaluate(t - step), motion.evaluate(t + step)
    _, v, a = motion.evaluate(t)
    # Central differences err by h^2/6 of the third derivative. That of p is below 5e3 (8e-8), that
    # of v below 3e5 (5e-6), both in the fade-in; rounding is 1e-10.
    assert (p1 - p0) / (2 * step) == pytest.approx(v, abs=1e-7)
    assert (v1 - v0) / (2 * step) == pytest.approx(a, abs=1e-5)


@pytest.mark.parametrize("name", ALL)
def test_arrays_are_time_first_with_one_column_for_each_name(name):
    for x in ALL[name].evaluate(np.linspace(-0.1, 2.0, 7)):
        assert x.shape == (7, len(ALL[name].names))
        assert np.isfinite(x).all()


@pytest.mark.parametrize("name", ALL)
def test_before_the_start_a_motion_rests_in_its_start_position(name):
    p, v, a = ALL[name].evaluate(np.array([-1.0, -1e-9, 0.0]))
    assert (p[:2] == p[2]).all()
    assert (v[:2] == 0.0).all() and (a[:2] == 0.0).all()
    if not ALL[name].absolute:
        assert (p == 0.0).all()


@pytest.mark.parametrize("kind", ["cycloid", "quintic", "trapezoid"])
def test_a_point_to_point_motion_ends_exactly_at_its_displacement_and_rests(kind):
    more = {"ramp": 0.02} if kind == "trapezoid" else {}
    motion = KINDS[kind](joints={"a": 0.25, "b": -1.5}, duration=0.1, **more)
    p, v, a = motion.evaluate(np.array([0.1, 0.1 + 1e-9, 5.0]))
    assert (p == [0.25, -1.5]).all()
    assert (v == 0.0).all() and (a == 0.0).all()


@pytest.mark.parametrize("kind, peak", [("cycloid", 2.0), ("quintic", 1.875)])
def test_the_peak_speed_at_half_time_is_that_of_the_law(kind, peak):
    p, v, a = KINDS[kind](joints={"a": 0.3}, duration=0.5).evaluate(np.array([0.25]))
    assert p[0, 0] == pytest.approx(0.15, rel=1e-14)  # rounding
    assert v[0, 0] == pytest.approx(peak * 0.3 / 0.5, rel=1e-14)
    assert a[0, 0] == pytest.approx(0.0, abs=1e-14)


def test_the_cycloid_of_the_rrs_platform_passes_the_values_of_its_equation():
    deltas = {"z": -0.0075, "ry": -0.155, "rx": 0.03}
    motion = cycloid(platform=deltas, duration=1.0)
    p, v, a = motion.evaluate(np.array([0.25, 1.0]))
    delta = np.array(list(deltas.values()))
    assert (motion.target, motion.names, motion.absolute) == ("platform", ("z", "ry", "rx"), False)
    assert p[0] == pytest.approx(delta * (0.25 - 1 / (2 * np.pi)), rel=1e-14)  # rounding
    assert v[0] == pytest.approx(delta, rel=1e-14)
    assert a[0] == pytest.approx(delta * 2 * np.pi, rel=1e-14)
    assert (p[1] == delta).all()


@pytest.mark.parametrize("omega", [10 * np.pi, 50 * np.pi])
def test_the_circle_of_the_rrr_platform_is_the_published_path(omega):
    center = [0.31, 0.25 / np.sqrt(3)]
    text = {"kind": "circle", "center": center, "radius": 0.06, "omega": omega}
    text |= {"phase": np.pi, "direction": -1, "fixed": {"rz": 0}}
    motion = from_spec(text, "3rrr.yaml: motion")
    t = np.linspace(0.0, 0.2, 41)
    p, v, a = motion.evaluate(t)
    c, s = 0.06 * np.cos(omega * t), 0.06 * np.sin(omega * t)
    assert (motion.names, motion.absolute) == (("x", "y", "rz"), True)
    zero = 0 * t
    # 10 turns lose 64 * 2e-16 rad in the argument.
    assert p == pytest.approx(np.stack([center[0] - c, center[1] + s, zero], 1), abs=1e-14)
    assert v / omega == pytest.approx(np.stack([s, c, zero], 1), abs=1e-14)
    assert a / omega**2 == pytest.approx(np.stack([c, -s, zero], 1), abs=1e-14)
    assert motion.duration == pytest.approx(2 * np.pi / omega)


def test_the_trapezoid_of_the_tpt_platform_keeps_its_speed_between_the_ramps():
    motion = trapezoid(platform={"x": 0.2}, speed=1 / 6, ramp=0.02)
    assert motion.duration == pytest.approx(1.22, rel=1e-14)
    _, v, a = motion.evaluate(np.array([0.0, 0.01, 0.02, 0.6, 1.21, 1.22]))
    assert v[:, 0] == pytest.approx([0, 1 / 12, 1 / 6, 1 / 6, 1 / 12, 0], abs=1e-13)
    assert a[:, 0] == pytest.approx([25 / 3, 25 / 3, 0, 0, -25 / 3, 0], abs=1e-10)


def test_the_trapezoid_switches_on_the_grid_in_spite_of_rounding():
    motion = trapezoid(joints={"a": 1.0}, ramp=0.3, duration=1.0)
    for step in (0.1, 0.05, 0.01, 0.001):
        t = np.arange(round(1.0 / step) + 1) * step
        _, _, a = motion.evaluate(t)
        # The right-continuous acceleration, summed over the cells, leaves no speed behind.
        assert a.sum() == pytest.approx(0.0, abs=1e-9)


def test_speed_is_that_of_the_longest_way():
    motion = trapezoid(joints={"a": 0.1, "b": -0.4}, speed=2.0, ramp=0.05)
    _, v, _ = motion.evaluate(np.array([motion.duration / 2]))
    assert v[0] == pytest.approx([0.5, -2.0], rel=1e-13)


def test_a_faded_harmonic_starts_from_rest_and_joins_the_full_one():
    faded, full = SMOOTH["faded harmonic"], harmonic(joints={"a": 0.2}, frequency=2.0, phase=0.4)
    _, v, a = faded.evaluate(np.array([0.0]))
    assert (v == 0.0).all() and (a == 0.0).all()
    t = np.linspace(0.3, 2.0, 20)
    for x, y in zip(faded.evaluate(t), full.evaluate(t), strict=True):
        assert x[:, :1] == pytest.approx(y, abs=1e-12)  # 1e-15 times omega^2


def test_a_ramped_circle_starts_from_rest_and_reaches_its_speed():
    motion = SMOOTH["ramped circle"]
    _, v, a = motion.evaluate(np.array([0.0, 0.4, 3.0]))
    assert (v[0] == 0.0).all() and (a[0] == 0.0).all()
    assert np.linalg.norm(v[1:], axis=1) == pytest.approx(0.06 * 6.0, rel=1e-13)
    p, _, _ = motion.evaluate(np.array([0.0, motion.duration]))
    assert p[1] == pytest.approx(p[0], abs=1e-14)  # one turn
    _, v, _ = motion.evaluate(np.array([0.4 + motion.duration]))
    assert motion.names == ("z", "x") and motion.absolute


def test_samples_are_met_and_the_motion_rests_at_both_ends():
    motion = SMOOTH["samples"]
    p, v, a = motion.evaluate(T)
    assert p == pytest.approx(np.stack([WAVE, T**3], 1), abs=1e-13)
    for x in (v[0], v[-1], a[0]):
        assert x == pytest.approx(0.0, abs=1e-10)
    p, v, a = motion.evaluate(np.array([3.0]))
    assert p[0] == pytest.approx([0.0, 0.512], abs=1e-13)
    assert (v == 0.0).all() and (a == 0.0).all()


def test_the_acceleration_of_samples_is_continuous():
    knots = T[1:-1]
    _, _, before = SMOOTH["samples"].evaluate(knots - 1e-9)
    _, _, after = SMOOTH["samples"].evaluate(knots + 1e-9)
    assert before == pytest.approx(after, abs=1e-4)  # 2e-9 s times a jerk below 1e4


def test_the_spline_converges_to_the_motion_it_samples_with_order_six():
    exact = quintic(joints={"a": 1.0}, duration=1.0)
    # A clamped quintic spline reproduces the quintic law: rounding is all that is left.
    t, fine = np.linspace(0, 1, 6), np.linspace(0, 1, 101)
    again = sampled(t=t, joints={"a": exact.evaluate(t)[0][:, 0]})
    assert again.evaluate(fine)[0] == pytest.approx(exact.evaluate(fine)[0], abs=1e-13)
    exact, errors = cycloid(joints={"a": 1.0}, duration=1.0), []
    for n in (20, 40):
        t = np.linspace(0, 1, n + 1)
        again = sampled(t=t, joints={"a": exact.evaluate(t)[0][:, 0]})
        errors.append(np.abs(again.evaluate(fine)[0] - exact.evaluate(fine)[0]).max())
    assert np.log2(errors[0] / errors[1]) > 5.5  # 6 asymptotically


def test_periodic_samples_go_on():
    motion = SMOOTH["periodic samples"]
    t = np.array([0.13, 0.55])
    for x, y in zip(motion.evaluate(t), motion.evaluate(t + 8.0), strict=True):
        assert x == pytest.approx(y, abs=1e-10)


def test_a_csv_file_names_its_joints_in_the_header(tmp_path):
    rows = "\n".join(f"{t}, {t**2}, {-t}" for t in T)
    (tmp_path / "path.csv").write_text(f"# recorded\nt, motor_1, motor_2\n{rows}\n")
    every = from_spec({"kind": "sampled", "file": "path.csv"}, "motion", tmp_path)
    assert (every.target, every.names, every.absolute) == ("joints", ("motor_1", "motor_2"), True)
    assert every.duration == 0.8
    assert every.evaluate(T)[0] == pytest.approx(np.stack([T**2, -T], 1), abs=1e-13)
    text = {"kind": "sampled", "file": "path.csv", "joints": ["motor_2"], "absolute": False}
    one = from_spec(text, "motion", tmp_path)
    assert (one.names, one.absolute) == (("motor_2",), False)
    assert one.evaluate(T)[0][:, 0] == pytest.approx(-T, abs=1e-13)


def test_a_csv_file_of_platform_coordinates_is_a_platform_motion(tmp_path):
    (tmp_path / "path.csv").write_text("t,x,rz\n0,0,0\n1,.1,0\n2,.2,0\n3,.3,0\n")
    assert sampled(tmp_path / "path.csv").target == "platform"
    assert sampled(tmp_path / "path.csv", joints=["x"]).target == "joints"


@pytest.mark.parametrize("name", ALL)
def test_a_motion_is_rebuilt_from_its_spec_and_its_pickle(name):
    motion = ALL[name]
    t = np.linspace(-0.1, 2.0, 50)
    text = json.loads(json.dumps(motion.spec))
    for again in (from_spec(text, "motion"), pickle.loads(pickle.dumps(motion))):
        assert again == motion
        for x, y in zip(again.evaluate(t), motion.evaluate(t), strict=True):
            assert (x == y).all()


def test_a_law_of_your_own_is_a_motion():
    def spin(t):
        t = t[:, None]
        return 3.0 * t**2, 6.0 * t, 6.0 + 0.0 * t

    p, v, a = Motion("spin", "joints", ("hub",), 1.0, spin).evaluate(np.array([-1.0, 2.0]))
    assert np.hstack([p, v, a]).tolist() == [[0, 0, 0], [12, 12, 6]]


def test_numbers_that_yaml_reads_as_text_are_numbers():
    motion = from_spec({"kind": "quintic", "joints": {"a": "1e-3"}, "duration": "1e-1"}, "motion")
    assert motion.spec == {"kind": "quintic", "joints": {"a": 1e-3}, "duration": 0.1}


def test_unnamed_motors_of_a_hold_are_no_columns():
    assert hold(duration=1.0).names == ()


J = {"joints": {"m": 1.0}}
CIRCLE = {"kind": "circle", "center": [0, 0], "radius": 1, "omega": 1}
FOUR = {"kind": "sampled", "t": [0, 1, 2, 3]}
WRONG = [
    ("cycloid", "x.yaml: motion: 'cycloid' is no mapping. Write {kind: cycloid"),
    ({"kind": "cycliod", **J}, "motion.kind: 'cycliod' is no motion. Did you mean \"cycloid\"?"),
    ({**J, "duration": 1}, "motion.kind: None is no motion. Allowed: cycloid, "),
    ({"kind": ["hold"]}, "motion.kind: ['hold'] is no motion."),
    (
        {"kind": "cycloid", **J, "durration": 1},
        'motion.durration: no such key of a cycloid motion. Did you mean "duration"?',
    ),
    ({"kind": "cycloid", **J}, "motion.duration: missing. A cycloid motion needs duration."),
    ({"kind": "circle"}, "motion.center: missing. A circle motion needs center, radius, omega."),
    ({"kind": "quintic", "duration": 1}, "motion: nothing moves. Give one of joints"),
    (
        {"kind": "quintic", "duration": 1, **J, "platform": {"x": 1}},
        "motion: both joints and platform are given. Give one of",
    ),
    ({"kind": "quintic", "duration": 1, "joints": ["m"]}, "motion.joints: ['m'] is no mapping."),
    ({"kind": "quintic", "duration": 1, "joints": {}}, "motion.joints: {} is no list of names."),
    (
        {"kind": "quintic", "duration": 1, "platform": {"phi": 1}},
        "motion.platform.phi: no such platform coordinate. Allowed: x, y, z, rz, ry, rx.",
    ),
    (
        {"kind": "quintic", "duration": 1, "platform": {"rzz": 1}},
        'motion.platform.rzz: no such platform coordinate. Did you mean "rz"?',
    ),
    (
        {"kind": "cycloid", "joints": {"m": "14 deg"}, "duration": 1},
        "motion.joints.m: '14 deg' is not a finite number. Give a number in rad or m.",
    ),
    (
        {"kind": "cycloid", "joints": {"m": True}, "duration": 1},
        "motion.joints.m: True is not a finite number.",
    ),
    (
        {"kind": "cycloid", **J, "duration": float("nan")},
        "motion.duration: nan is not a finite number. Give a number in s.",
    ),
    ({"kind": "cycloid", **J, "duration": None}, "motion.duration: None is not a finite number."),
    (
        {"kind": "cycloid", **J, "duration": -1},
        "motion.duration: -1 s is out of range. It must be above 0.",
    ),
    ({"kind": "hold", "duration": 0}, "motion.duration: 0 s is out of range."),
    (
        {"kind": "trapezoid", **J, "ramp": 0.6, "duration": 1},
        "motion.ramp: two ramps of 0.6 s do not fit into 1 s. Give more than 0 and at most 0.5 s.",
    ),
    (
        {"kind": "trapezoid", **J, "ramp": 2, "speed": 1},
        "motion.ramp: two ramps of 2 s do not fit into 3 s. Give more than 0 and at most 1 s.",
    ),
    ({"kind": "trapezoid", **J, "ramp": 1}, "motion: give either duration in s or speed"),
    (
        {"kind": "trapezoid", **J, "ramp": 1, "speed": 1, "duration": 4},
        "motion: give either duration in s or speed",
    ),
    (
        {"kind": "harmonic", **J, "frequency": 0},
        "motion.frequency: 0 Hz is out of range. It must be above 0.",
    ),
    (
        {"kind": "harmonic", **J, "frequency": 1, "smooth": -1},
        "motion.smooth: -1 s is out of range. It must be 0 or more.",
    ),
    (CIRCLE | {"radius": 0}, "motion.radius: 0 m is out of range."),
    (CIRCLE | {"center": [0, 0, 0]}, "motion.center: [0, 0, 0] is no point of the plane."),
    (CIRCLE | {"center": [0, "a"]}, "motion.center[1]: 'a' is not a finite number."),
    (
        CIRCLE | {"plane": ["x", "rz"]},
        "motion.plane: ['x', 'rz'] is no plane. Name two of x, y, z.",
    ),
    (CIRCLE | {"plane": ["x", "x"]}, "motion.plane: ['x', 'x'] has a name twice."),
    (CIRCLE | {"plane": "xy"}, "motion.plane: 'xy' is no list of names."),
    (CIRCLE | {"direction": "left"}, "motion.direction: 'left' is no direction. Allowed: 1, -1."),
    (CIRCLE | {"fixed": {"x": 0}}, "motion.fixed.x: it moves on the circle."),
    (
        CIRCLE | {"fixed": {"rzz": 0}},
        'motion.fixed.rzz: no such platform coordinate. Did you mean "rz"',
    ),
    ({"kind": "sampled"}, "motion: give either file: name.csv or t: [...]"),
    (FOUR, "motion: nothing moves."),
    (FOUR | {"joints": ["m"]}, "motion.joints: ['m'] has no samples."),
    (FOUR | {"joints": {"m": 3}}, "motion.joints.m: 3 is no list of samples."),
    (FOUR | {"joints": {"m": [0, 1]}}, "motion.joints.m: 2 samples for 4 times."),
    (
        FOUR | {"joints": {"m": [0, 1, float("nan"), 2]}},
        "motion.joints.m[2]: nan is not a finite number.",
    ),
    (
        FOUR | {"t": [0, 1, 1, 2], "joints": {"m": [0, 1, 2, 3]}},
        "motion.t: sample 3 at 1 s follows 1 s. Times must increase.",
    ),
    (
        FOUR | {"t": [0, 1, 2], "joints": {"m": [0, 1, 2]}},
        "motion.t: 3 samples from 0 s. Give 4 or more, from t = 0 on.",
    ),
    (
        FOUR | {"t": [5, 6, 7, 8], "joints": {"m": [0, 1, 2, 3]}},
        "motion.t: 4 samples from 5 s. Give 4 or more, from t = 0 on.",
    ),
    (
        FOUR | {"joints": {"m": [0, 1, 2, 3]}, "periodic": True},
        "motion.joints.m: starts at 0, ends at 3. A periodic motion must close.",
    ),
    (
        FOUR | {"joints": {"m": [0, 1, 2, 3]}, "absolute": "yes"},
        "motion.absolute: 'yes' is not allowed. Allowed: true, false.",
    ),
]


@pytest.mark.parametrize("spec, text", WRONG, ids=[w[1][:50] for w in WRONG])
def test_a_wrong_motion_is_refused_with_its_key_its_value_and_the_way_out(spec, text):
    with pytest.raises(DescriptionError, match=re.escape(text)) as caught:
        from_spec(spec, "x.yaml: motion")
    assert str(caught.value).startswith("x.yaml: motion")
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize(
    "content, text",
    [
        (None, "No such file or directory. Give a CSV file."),
        (b"\xff\xfe\x00t,a", "can't decode byte"),
        (b"", "it is empty"),
        (b"t,a\n0,1\n1\n", "its rows differ in length"),
        (b"t,a,a\n0,1,2\n", "two columns have one name in t, a, a"),
        (b"time,a\n0,1\n", "sampled.t: no such column. Allowed: time, a."),
        (b"t,a\n0,1\n1,2\n2,x\n3,4\n", "sampled.joints.a[2]: 'x' is not a finite number"),
        (b"t,a\n0,1\n1,nan\n2,1\n3,4\n", "sampled.joints.a[1]: 'nan' is not a finite number"),
        (b"t\n0\n1\n2\n3\n", "[] is no list of names"),
        (b"t,a\n0,1\n2,1\n1,1\n3,1\n", "sampled.t: sample 3 at 1 s follows 2 s"),
    ],
)
def test_a_wrong_file_is_refused_with_its_row_or_reason(tmp_path, content, text):
    path = tmp_path / "path.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DescriptionError, match=re.escape(text)):
        sampled(path)


def test_a_missing_column_is_named_with_the_nearest_one(tmp_path):
    (tmp_path / "path.csv").write_text("t,motor_1\n0,1\n1,1\n2,1\n3,1\n")
    text = 'motion.joints.motor_2: no such column. Did you mean "motor_1"?'
    with pytest.raises(DescriptionError, match=re.escape(text)):
        from_spec(
            {"kind": "sampled", "file": "path.csv", "joints": ["motor_2"]}, "motion", tmp_path
        )


def test_a_constructor_names_itself_in_its_errors():
    with pytest.raises(DescriptionError, match=r"^cycloid\.duration: 0 s is out of range"):
        cycloid(joints={"m": 1.0}, duration=0.0)
