"""The shipped models: geometry, masses and poses, by Pinocchio and closed forms alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from pinflex.arrays import Array
from pinflex.description import description
from pinflex.description.reading import schema, yaml_text

MODELS = Path(__file__).resolve().parents[2] / "models"
PLANAR, SPATIAL = ("3rrr", "race_r1"), ("3rrs", "race_r2")
CLOSED = PLANAR + SPATIAL
ALL = (*CLOSED, "spinning_beam", "cantilever", "ur5", "delta", "hexapod", "cassie")
LEGS = (1, 2, 3)
CENTROID = np.array([0.25, 0.25 / np.sqrt(3)])  # [m]
ROUNDING = 1e-12  # [m] a dozen operations on lengths below 1 m
HEIGHT = {"3rrs": 0.237, "race_r2": 0.20}  # [m] of the platform at home
WRITTEN = 1e-9  # relative: the URDFs give ten digits


@dataclass(frozen=True)
class Home:
    """A model at its home, each frame by name; the ball joint turned by its home rotation."""

    raw: dict[str, Any]
    model: pin.Model
    frames: dict[str, pin.SE3]

    def at(self, name: str) -> Array:
        return np.array(self.frames[name].translation)

    def x(self, name: str) -> Array:
        return np.array(self.frames[name].rotation[:, 0])

    def z(self, name: str) -> Array:
        return np.array(self.frames[name].rotation[:, 2])


def load_home(name: str) -> Home:
    raw = yaml_text.load((MODELS / name / f"{name}.yaml").read_text(), name)
    model = pin.buildModelFromUrdf(str(MODELS / name / f"{name}.urdf"))
    data, q = model.createData(), pin.neutral(model)
    ball = None
    for joint, value in raw.get("home", {}).items():
        if isinstance(value, list):
            ball = pin.SE3(pin.exp3(np.array(value, float)), np.zeros(3))
        else:
            q[model.joints[model.getJointId(joint)].idx_q] = value
    pin.framesForwardKinematics(model, data, q)
    frames = {f.name: data.oMf[i].copy() for i, f in enumerate(model.frames)}
    if ball is not None:  # all that hangs on it turns about platform_c1
        old = frames["platform_c1"]
        moved = old * ball * old.inverse()
        for part in ("platform_c1", "platform", "platform_c2", "platform_c3"):
            frames[part] = moved * frames[part]
    return Home(raw, model, frames)


def own_inertia(model: pin.Model, link: str) -> pin.Inertia:
    """A link's inertia in its own frame, without what Pinocchio merges from fixed joints."""
    frame = model.frames[model.getFrameId(link)]
    carrier = model.frames[frame.parentFrame]
    if carrier.type == pin.FrameType.FIXED_JOINT:
        return carrier.inertia
    total = model.inertias[frame.parentJoint]
    for f in model.frames:
        if f.parentJoint == frame.parentJoint and f.type == pin.FrameType.FIXED_JOINT:
            total = total - f.placement.act(f.inertia) if f.inertia.mass > 0 else total
    return total


def azimuth(leg: int) -> float:
    return float(np.deg2rad([90.0, 210.0, 330.0][leg - 1]))


def radial(leg: int) -> Array:
    return np.array([np.cos(azimuth(leg)), np.sin(azimuth(leg)), 0.0])


@pytest.mark.parametrize("name", ALL)
def test_a_model_reads_and_says_where_its_numbers_are_from(name: str) -> None:
    assert description.read(name).name == name
    assert (MODELS / name / "SOURCE.md").read_text().count("|") > 20


@pytest.mark.parametrize("name", CLOSED)
def test_home_closes_the_loops(name: str) -> None:
    home = load_home(name)
    assert len(home.raw["loops"]) == 2
    for loop in home.raw["loops"].values():
        a, b = loop["between"]
        assert np.abs(home.at(a) - home.at(b)).max() < ROUNDING


@pytest.mark.parametrize("name", CLOSED)
def test_home_puts_the_platform_where_the_scene_says_and_does_not_turn_it(name: str) -> None:
    home = load_home(name)
    place = [*CENTROID, 0.0] if name in PLANAR else [0.0, 0.0, HEIGHT[name]]
    assert home.at("platform") == pytest.approx(np.array(place), abs=ROUNDING)
    assert home.frames["platform"].rotation == pytest.approx(np.eye(3), abs=ROUNDING)


@pytest.mark.parametrize(("name", "length"), [(n, 0.21 if n in PLANAR else 0.15) for n in CLOSED])
def test_links_run_along_their_x_axes_and_have_the_right_length(name: str, length: float) -> None:
    home = load_home(name)
    for leg in LEGS:
        tip = "platform_c1" if leg == 1 else f"distal_{leg}_tip"
        crank, distal = f"crank_{leg}", f"distal_{leg}"
        assert home.at(distal) - home.at(crank) == pytest.approx(length * home.x(crank))
        assert home.at(tip) - home.at(distal) == pytest.approx(length * home.x(distal))


@pytest.mark.parametrize("name", PLANAR)
def test_the_planar_base_and_platform_are_equilateral_and_every_axis_is_z(name: str) -> None:
    home = load_home(name)
    base = np.array([home.at(f"crank_{leg}")[:2] for leg in LEGS])
    assert base == pytest.approx(np.array([[0, 0], [0.5, 0], [0.25, np.sqrt(3) / 4]]), abs=ROUNDING)
    for leg, degrees in zip(LEGS, (210.0, 330.0, 90.0), strict=True):  # towards the own base pivot
        angle = np.deg2rad(degrees)
        arm = home.at(f"platform_c{leg}") - home.at("platform")
        expected = 0.068 * np.array([np.cos(angle), np.sin(angle), 0])
        assert arm == pytest.approx(expected, abs=ROUNDING)
    for joint in (*(f"{kind}_{leg}" for kind in ("motor", "knee") for leg in LEGS), "pin_1"):
        assert home.model.joints[home.model.getJointId(joint)].shortname() == "JointModelRZ"
        assert home.z(joint) == pytest.approx(np.array([0, 0, 1.0]))


@pytest.mark.parametrize("name", PLANAR)
def test_planar_motor_angles_are_azimuths_and_the_elbows_lie_left(name: str) -> None:
    home = load_home(name)
    for leg in LEGS:
        alpha = home.raw["home"][f"motor_{leg}"]
        azimuth_vector = np.array([np.cos(alpha), np.sin(alpha), 0])
        assert home.x(f"crank_{leg}") == pytest.approx(azimuth_vector, abs=ROUNDING)
        chord = home.at(f"platform_c{leg}") - home.at(f"crank_{leg}")
        assert np.cross(chord, home.x(f"crank_{leg}"))[2] > 0
    degrees = [np.rad2deg(home.raw["home"][f"motor_{leg}"]) for leg in LEGS]
    half = np.rad2deg(np.arccos((0.5 / np.sqrt(3) - 0.068) / 0.42))
    assert degrees == pytest.approx([30 + half, 150 + half, -90 + half], abs=1e-9)
    assert degrees == pytest.approx([88.30368, 208.30368, -31.69632], abs=1e-5)


@pytest.mark.parametrize("name", SPATIAL)
def test_spatial_legs_stand_at_120_degrees_with_tangential_axes(name: str) -> None:
    home = load_home(name)
    for leg in LEGS:
        assert home.at(f"crank_{leg}") == pytest.approx(0.12 * radial(leg), abs=ROUNDING)
        top = home.at(f"platform_c{leg}") - home.at("platform")
        assert top == pytest.approx(0.10 * radial(leg), abs=ROUNDING)
        tangent = np.array([-np.sin(azimuth(leg)), np.cos(azimuth(leg)), 0.0])
        axis = tangent if name == "race_r2" else -tangent
        for joint in ("motor", "knee"):
            assert home.z(f"{joint}_{leg}") == pytest.approx(axis, abs=ROUNDING)
        assert home.at(f"distal_{leg}") @ radial(leg) > 0.12  # knee outward


@pytest.mark.parametrize(("name", "degrees"), [("3rrs", 57.272), ("race_r2", -47.777)])
def test_spatial_motor_angles_are_inclinations_in_the_sense_of_the_scene(
    name: str, degrees: float
) -> None:
    home = load_home(name)
    sense = 1.0 if name == "3rrs" else -1.0  # race_r2: a positive move lowers the crank outward
    for leg in LEGS:
        angle = home.raw["home"][f"motor_{leg}"]
        assert np.rad2deg(angle) == pytest.approx(degrees, abs=5e-4)  # digits of the scene
        direction = np.cos(angle) * radial(leg) + sense * np.sin(angle) * np.array([0, 0, 1.0])
        assert home.x(f"crank_{leg}") == pytest.approx(direction, abs=ROUNDING)
    turned = pin.exp3(0.05 * home.z("crank_1")) @ home.x("crank_1")  # a positive move of motor_1
    assert np.sign(turned[2] - home.x("crank_1")[2]) == sense
    assert np.sign(turned @ radial(1) - home.x("crank_1") @ radial(1)) == -sense


@pytest.mark.parametrize("name", [*CLOSED, "spinning_beam"])
def test_the_urdf_weighs_a_flexible_link_as_its_beam_does(name: str) -> None:
    home = load_home(name)
    for flexible in description.read(name).flexible:
        section, rho = flexible.section, flexible.material.rho
        assert rho is not None
        inertia = own_inertia(home.model, flexible.link)
        length = 2 * inertia.lever[0]
        mass = rho * section.A * length
        slender = mass * length**2 / 12
        assert inertia.mass == pytest.approx(mass, rel=WRITTEN)
        assert np.diag(inertia.inertia) == pytest.approx(
            np.array([rho * section.Ip * length, slender, slender]), rel=WRITTEN
        )


@pytest.mark.parametrize(
    ("name", "mass", "moments"),
    [
        ("3rrr", 0.30, (2.5e-4, 2.5e-4, 5e-4)),
        ("race_r1", 0.40, (4.75e-4, 4.75e-4, 9.5e-4)),
        ("3rrs", 0.152, (1.06e-2, 2.74e-4, 1.09e-2)),
        ("race_r2", 0.152, (2.74e-4, 2.74e-4, 5.4e-4)),
    ],
)
def test_the_platform_has_its_mass_at_its_centre(
    name: str, mass: float, moments: tuple[float, float, float]
) -> None:
    inertia = own_inertia(load_home(name).model, "platform")
    assert inertia.mass == mass
    assert inertia.lever == pytest.approx(np.zeros(3), abs=ROUNDING)
    assert inertia.inertia == pytest.approx(np.diag(moments), rel=WRITTEN)


@pytest.mark.parametrize("name", PLANAR)
def test_cranks_are_slender_rods_and_only_3rrr_has_elbow_masses(name: str) -> None:
    home = load_home(name)
    mass = 2810 * 0.21 * 0.025 * 0.010
    for leg in LEGS:
        crank = own_inertia(home.model, f"crank_{leg}")
        assert crank.mass == pytest.approx(mass, rel=WRITTEN)
        assert crank.lever == pytest.approx(np.array([0.105, 0, 0]))
        assert crank.inertia[2, 2] == pytest.approx(mass * 0.21**2 / 12, rel=WRITTEN)
        assert home.raw["joints"][f"motor_{leg}"] == {"rotor_inertia": 8.3e-3}
        assert home.model.existFrame(f"elbow_{leg}") == (name == "3rrr")
        if name == "3rrr":
            assert own_inertia(home.model, f"elbow_{leg}").mass == 0.05
            assert home.at(f"elbow_{leg}") == pytest.approx(home.at(f"distal_{leg}"))


def planar_coordinates(pose: Array) -> Array:
    """motor_i, knee_i [rad] of both planar models at platform poses x, y, turned by 0."""
    base = np.array([[0, 0], [0.5, 0], [0.25, np.sqrt(3) / 4]])
    turn = np.deg2rad([210.0, 330.0, 90.0])
    arm = 0.068 * np.column_stack([np.cos(turn), np.sin(turn)])
    chord = pose[:, None, :] + arm - base
    size = np.linalg.norm(chord, axis=2)
    half = np.arccos(size / 0.42)
    return np.hstack([np.arctan2(chord[..., 1], chord[..., 0]) + half, -2 * half])


def test_the_rigid_3rrr_needs_the_torques_of_the_scene_on_its_10_pi_circle() -> None:
    home = load_home("3rrr")
    model, data = home.model, home.model.createData()
    motion = home.raw["motion"]
    assert motion["omega"] == pytest.approx(10 * np.pi, rel=1e-15)
    h = 1e-4  # [s] central differences then err by (omega h)^2 / 12 = 1e-6
    names = [f"{kind}_{leg}" for kind in ("motor", "knee") for leg in LEGS]
    at = [model.joints[model.getJointId(name)].idx_v for name in names]
    last = model.joints[model.getJointId("pin_1")].idx_v

    def coordinates(t: Array) -> Array:
        angle = motion["phase"] + motion["direction"] * motion["omega"] * t
        circle = motion["radius"] * np.column_stack([np.cos(angle), np.sin(angle)])
        legs = planar_coordinates(np.array(motion["center"]) + circle)
        q = np.zeros((len(t), model.nv))
        q[:, at] = legs
        q[:, last] = -legs[:, 0] - legs[:, 3]  # the platform does not turn
        return np.unwrap(q, axis=0)

    t = np.linspace(0.0, 0.2, 401)
    q0, q, q1 = coordinates(t - h), coordinates(t), coordinates(t + h)
    v, a = (q1 - q0) / (2 * h), (q1 - 2 * q + q0) / h**2
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    model.gravity = pin.Motion.Zero()
    torque = np.empty((len(t), 3))
    for k in range(len(t)):
        pin.computeJointJacobians(model, data, q[k])
        pin.updateFramePlacements(model, data)
        rows = []
        for loop in home.raw["loops"].values():
            tip, pin_hole = (
                pin.getFrameJacobian(model, data, model.getFrameId(f), world)[:2]
                for f in loop["between"]
            )
            rows.append(tip - pin_hole)
        S = np.eye(model.nv)[:, at[:3]]
        force = pin.rnea(model, data, q[k], v[k], a[k])
        force[at[:3]] += 8.3e-3 * a[k, at[:3]]
        torque[k] = np.linalg.solve(np.hstack([S, np.vstack(rows).T]), force)[:3]
    # 0.5 %: the scene's numbers have an elbow inertia of 2.2e-5 kg m^2 besides.
    assert np.abs(torque).max(axis=0) == pytest.approx(np.array([7.90, 10.83, 8.26]), rel=5e-3)


def test_the_rigid_3rrs_holds_its_weight_with_the_drive_moment_of_the_scene() -> None:
    home = load_home("3rrs")
    model, data = home.model, home.model.createData()

    def angle_and_energy(z: float) -> tuple[float, float]:
        """Motor angle of leg 2 and the energy per leg, platform level at the height z."""
        inward, up = -0.02, z
        chord = np.hypot(inward, up)
        angle = np.arctan2(up, inward) - np.arccos(chord / 0.30)
        knee = 2 * np.arccos(chord / 0.30)
        q = pin.neutral(model)
        q[model.joints[model.getJointId("motor_2")].idx_q] = angle
        q[model.joints[model.getJointId("knee_2")].idx_q] = knee
        pin.framesForwardKinematics(model, data, q)
        weights = []
        for joint in ("motor_2", "knee_2"):
            number = model.getJointId(joint)
            inertia = model.inertias[number]
            weights.append(inertia.mass * data.oMi[number].act(inertia.lever)[2])
        top = data.oMf[model.getFrameId("distal_2_tip")].translation
        assert top[2] == pytest.approx(z, abs=ROUNDING)
        return angle, 9.81 * (sum(weights) + 0.152 / 3 * top[2])

    h = 1e-5  # [m]
    (low, below), (high, above) = angle_and_energy(0.237 - h), angle_and_energy(0.237 + h)
    assert abs((above - below) / (high - low)) == pytest.approx(0.11296, rel=5e-5)


def test_the_spinning_beam_has_the_stiffness_and_mass_of_the_benchmark() -> None:
    home = load_home("spinning_beam")
    beam = home.raw["flexible"]["beam"]
    E, rho, section = beam["material"]["E"], beam["material"]["rho"], beam["section"]
    assert E * section["A"] == pytest.approx(2.8e7)
    assert E * section["Iz"] == pytest.approx(1.4e4)
    assert rho * section["A"] == pytest.approx(1.2)
    assert rho * section["Iz"] == pytest.approx(6e-4)
    assert home.at("tip") == pytest.approx(np.array([10.0, 0, 0]))
    assert home.model.joints[1].shortname() == "JointModelRUBZ"  # unbounded, about z


def test_the_cantilever_bends_over_its_thin_side_under_gravity() -> None:
    raw = yaml_text.load((MODELS / "cantilever/cantilever.yaml").read_text(), "cantilever")
    model = pin.buildModelFromUrdf(str(MODELS / "cantilever/cantilever.urdf"))
    assert model.nv == 0
    assert model.inertias[0].mass == pytest.approx(7850 * 0.5 * 0.020 * 0.002, rel=WRITTEN)
    assert raw["flexible"]["beam"]["section"]["thickness"] == 0.002
    up = np.array(schema.direction(raw["flexible"]["beam"]["up"], "up"))
    beam_y = np.cross(up, [1.0, 0, 0])
    assert beam_y == pytest.approx(np.array([0, 0, 1.0]))
    assert raw["gravity"] == [0, 0, -9.81]


def test_the_ur5_spans_run_between_its_joint_axes() -> None:
    loaders = pytest.importorskip("example_robot_data")
    model = loaders.load("ur5").model
    raw = yaml_text.load((MODELS / "ur5/ur5.yaml").read_text(), "ur5")
    assert model.existFrame(raw["platform"])
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    for link, length, mass in (
        ("upper_arm_link", 0.44154, 8.393),
        ("forearm_link", 0.39225, 2.275),
    ):
        ends = (raw["flexible"][link][key] for key in ("start", "end"))
        a, b = (data.oMf[model.getFrameId(frame)].translation for frame in ends)
        assert np.linalg.norm(b - a) == pytest.approx(length, abs=1e-5)
        joint = model.frames[model.getFrameId(link)].parentJoint
        assert model.inertias[joint].mass == pytest.approx(mass)  # what `rho: urdf` takes
    assert set(raw["home"]) == set(model.names[1:])
