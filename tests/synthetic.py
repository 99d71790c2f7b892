"""A made-up planar 3-RRR result that holds every key, for tests that need a result and no solver.

The geometry is exact (three legs closed by inverse kinematics, beams drawn on their chords), the
stresses follow from the drawn shape by beam theory; the torques are only plausible curves.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.results.result import Result

BASE_RADIUS, PLATFORM_RADIUS = 0.35, 0.10  # [m]
CRANK, DISTAL = 0.20, 0.22  # [m]
WIDTH, THICKNESS = 0.025, 0.002  # [m]
E, G, RHO = 7.1e10, 2.7e10, 2810.0  # [Pa], [Pa], [kg/m^3]
MOVE, UNTIL = 0.1, 0.2  # [s]
BENDING, SWAY = 61.0, 34.0  # [Hz], of the links and of the platform
LEGS = (1, 2, 3)


def synthetic_result(level: str = "coupled", samples: int = 201, stations: int = 21) -> Result:
    """A run of `level` over 0.2 s; "rigid" has no link or eta keys, bodies instead of beams."""
    t = np.linspace(0.0, UNTIL, samples)
    flexible = level != "rigid"
    s = np.clip(t / MOVE, 0.0, 1.0)
    ramp = s - np.sin(2 * np.pi * s) / (2 * np.pi)  # cycloid
    push = np.sin(2 * np.pi * s) * (t < MOVE)  # its acceleration, scaled
    ringing = ramp * np.exp(-12 * np.maximum(t - MOVE, 0))  # excited by the move, then decays
    nominal = np.stack([0.03 * ramp, -0.02 * ramp, 0.10 * ramp])  # x [m], y [m], rz [rad]
    sway = flexible * (push + 0.5 * ringing * np.sin(2 * np.pi * SWAY * t))
    actual = nominal + np.array([[4e-4], [-2.5e-4], [1.5e-3]]) * sway

    arrays: dict[str, Array] = {}
    q = np.empty((samples, 7))  # motor_i, elbow_i, and the tree's own platform pin
    for i in LEGS:
        elbow, tip = _leg(i, nominal), _corner(i, actual)
        root = np.broadcast_to(_motor(i), elbow.shape)
        crank = np.unwrap(_angle(elbow - root))
        q[:, i - 1], q[:, i + 2] = crank, np.unwrap(_angle(_corner(i, nominal) - elbow)) - crank
        _body(arrays, f"crank_{i}", _pose(root, crank), _pose(root, crank))
        if flexible:
            swing = push + ringing * np.sin(2 * np.pi * BENDING * t + i)
            bow = 1e-3 * (1 + 0.3 * i) * swing  # deflection at mid-span [m]
            _beam(arrays, f"distal_{i}", elbow, tip, _corner(i, nominal), bow, stations)
        else:
            pose = _pose(elbow, q[:, i - 1] + q[:, i + 2])
            _body(arrays, f"distal_{i}", pose, pose)
    q[:, 6] = nominal[2] - q[:, 0] - q[:, 3]
    v, a = _rate(q, t), _rate(_rate(q, t), t)
    arrays |= {"joint/q": q, "joint/v": v, "joint/a": a}

    centre = np.column_stack([actual[0], actual[1], np.zeros(samples)])
    centre_rigid = np.column_stack([nominal[0], nominal[1], np.zeros(samples)])
    platform = _pose(centre, actual[2])
    _body(arrays, "platform", platform, _pose(centre_rigid, nominal[2]))
    _body(arrays, "base", *2 * [_pose(np.zeros((samples, 3)), np.zeros(samples))])
    twist = np.zeros((samples, 6))
    twist[:, [0, 1, 5]] = _rate(actual.T, t)
    for name, pose in (
        ("platform", platform),
        ("platform_c2", _pose(_corner(2, actual), actual[2])),
    ):
        arrays |= {
            f"frame/{name}/position": pose[:, :, 3],
            f"frame/{name}/rotation": pose[:, :, :3],
            f"frame/{name}/velocity": twist,
            f"frame/{name}/acceleration": _rate(twist, t),
        }

    ripple = (
        flexible * 0.4 * ringing[:, None] * np.sin(2 * np.pi * BENDING * t[:, None] + np.arange(3))
    )
    arrays["torque"] = push[:, None] * np.array([3.2, -2.1, 1.4]) + ripple
    arrays["multiplier"] = push[:, None] * np.array([12.0, -7.0, 5.0, 9.0]) + 2 * sway[:, None]
    for name in (f"{kind}_{i}" for kind in ("motor", "elbow") for i in LEGS):
        arrays[f"reaction/{name}"] = np.outer(push + 0.1 * sway, [14.0, 6.0, 0.0, 0.0, 0.0, 0.5])
    arrays["reaction/pin_1"] = np.outer(push, [9.0, 4.0, 0.0, 0.0, 0.0, 0.0])
    for k, i in enumerate((2, 3)):
        wrench = np.zeros((samples, 6))
        wrench[:, :2] = arrays["multiplier"][:, 2 * k : 2 * k + 2]
        arrays[f"loop/pin_{i}/wrench"] = wrench
    if flexible:
        eta = 1e-3 * np.stack([sway * np.cos(k) + 0.1 * push for k in range(12)], axis=1)
        arrays |= {"eta": eta, "eta_v": _rate(eta, t), "eta_a": _rate(_rate(eta, t), t)}
    kinetic = 0.6 * np.square(twist[:, :3]).sum(axis=1) + 0.02 * np.square(v).sum(axis=1)
    zero = np.zeros(samples)
    elastic, dissipated = 0.05 * sway**2, 0.02 * flexible * ramp
    arrays |= {
        "energy/kinetic": kinetic,
        "energy/gravity": zero,
        "energy/elastic": elastic,
        "energy/spring": zero,
        "energy/dissipated": dissipated,
        "energy/work": kinetic + elastic + dissipated,
        "residual/closure": 1e-13 * (1 + np.abs(push)),
        "residual/newton": 1e-10 * (1 + np.abs(push)),
    }
    return Result(t, arrays, _meta(level, samples))


def _meta(level: str, samples: int) -> dict[str, Any]:
    joints = [f"{kind}_{i}" for kind in ("motor", "elbow") for i in LEGS] + ["pin_1"]
    y, z = THICKNESS / 2, WIDTH / 2
    corners = [[y, z], [-y, z], [-y, -z], [y, -z]]
    section = {"shape": "rectangle", "width": WIDTH, "thickness": THICKNESS, "A": WIDTH * THICKNESS}
    section |= {"outline": corners, "fibres": corners}
    beam = {
        "length": DISTAL,
        "section": section,
        "material": {"name": "aluminium", "E": E, "G": G, "rho": RHO},
        "planes": ["bending_y", "axial"],
        "basis": "craig_bampton, 2 internal modes",
    }
    rod = {"points": [[0.0, 0.0, 0.0], [CRANK, 0.0, 0.0]], "radius": 0.008}
    bodies: dict[str, Any] = {f"crank_{i}": rod for i in LEGS}
    bodies["platform"] = {
        "points": [[*_spot(PLATFORM_RADIUS, i), 0.0] for i in LEGS],
        "radius": 0.006,
    }
    bodies["base"] = {"points": [[*_spot(BASE_RADIUS, i), 0.0] for i in LEGS], "radius": 0.01}
    if level == "rigid":
        distal = {"points": [[0.0, 0.0, 0.0], [DISTAL, 0.0, 0.0]], "radius": 0.005}
        bodies |= {f"distal_{i}": distal for i in LEGS}
    steps = 0 if level == "rigid" else samples - 1
    return {
        "name": "synthetic-3rrr",
        "level": level,
        "joints": joints,
        "coordinates": joints,
        "actuated": joints[:3],
        "frames": ["platform", "platform_c2"],
        "platform": "platform",
        "loops": [
            {
                "name": f"pin_{i}",
                "kind": "revolute",
                "rows": ["x", "y"],
                "redundant": ["z", "rx", "ry"],
            }
            for i in (2, 3)
        ],
        "links": {} if level == "rigid" else {f"distal_{i}": beam for i in LEGS},
        "bodies": bodies,
        "gravity": [0.0, 0.0, 0.0],
        "settings": {"level": level, "until": UNTIL, "dt": UNTIL / (samples - 1)},
        "cost": {
            "seconds": 0.011 if level == "rigid" else 0.42,
            "steps": steps,
            "newton": 2 * steps,
        },
        "energy_balance": 2.1e-6,
        "warnings": [] if level == "rigid" else ["loop pin_2: rows z, rx, ry are redundant"],
        "units": {"torque": "N m", "joint/q": "rad"},
        "versions": {"pinflex": "0.1.0", "pinocchio": "4.1.0", "numpy": np.__version__},
        "sources": {"3rrr.urdf": "<robot name='3rrr'/>", "3rrr.yaml": "urdf: 3rrr.urdf\n"},
        "status": "complete",
        "message": "",
    }


def _spot(radius: float, leg: int) -> tuple[float, float]:
    angle = np.deg2rad(120.0 * leg - 30.0)
    return float(radius * np.cos(angle)), float(radius * np.sin(angle))


def _motor(leg: int) -> Array:
    return np.array([*_spot(BASE_RADIUS, leg), 0.0])


def _corner(leg: int, pose: Array) -> Array:
    """Corner of the platform [m], shape (nt, 3), at poses x, y, rz of shape (3, nt)."""
    (x, y), (c, s) = _spot(PLATFORM_RADIUS, leg), (np.cos(pose[2]), np.sin(pose[2]))
    return np.column_stack([pose[0] + c * x - s * y, pose[1] + s * x + c * y, 0 * c])


def _leg(leg: int, pose: Array) -> Array:
    """Elbow [m], shape (nt, 3): where the two circles of crank and distal link meet."""
    span = _corner(leg, pose) - _motor(leg)
    d = np.linalg.norm(span, axis=1)
    bend = np.arccos((CRANK**2 + d**2 - DISTAL**2) / (2 * CRANK * d))
    angle = _angle(span) + bend
    return _motor(leg) + CRANK * np.column_stack([np.cos(angle), np.sin(angle), 0 * d])


def _angle(vector: Array) -> Array:
    return np.asarray(np.arctan2(vector[:, 1], vector[:, 0]))


def _pose(origin: Array, angle: Array) -> Array:
    c, s, o = np.cos(angle), np.sin(angle), 0 * angle
    turn = np.stack([c, -s, o, s, c, o, o, o, o + 1], axis=1).reshape(-1, 3, 3)
    return np.concatenate([turn, origin[:, :, None]], axis=2)


def _body(arrays: dict[str, Array], name: str, pose: Array, rigid: Array) -> None:
    arrays[f"body/{name}/pose"], arrays[f"body/{name}/pose_rigid"] = pose, rigid


def _rate(x: Array, t: Array) -> Array:
    return np.asarray(np.gradient(x, t, axis=0))


def _beam(
    arrays: dict[str, Array], name: str, root: Array, tip: Array, tip0: Array, bow: Array, nx: int
) -> None:
    """Fields of a pinned-pinned beam drawn as half a sine of height `bow` on its chord."""
    x = np.linspace(0.0, DISTAL, nx)
    k = np.pi / DISTAL
    chord = tip - root
    stretch = np.linalg.norm(chord, axis=1) - DISTAL
    along = chord / np.linalg.norm(chord, axis=1)[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0], 0 * stretch])
    u, v = np.outer(stretch, x / DISTAL), np.outer(bow, np.sin(k * x))
    slope = np.outer(bow, k * np.cos(k * x))
    zero = np.zeros_like(v)
    area, inertia = WIDTH * THICKNESS, WIDTH * THICKNESS**3 / 12
    moment = -E * inertia * k**2 * v
    shear_force = E * inertia * k**2 * slope
    tension = np.broadcast_to(40.0 * bow[:, None] / 1e-3, v.shape)
    axial, bending = tension / area, np.abs(moment) * THICKNESS / 2 / inertia
    shear = 1.5 * np.abs(shear_force) / area
    normal = np.abs(axial) + bending
    place = root[:, None] + (x + u)[:, :, None] * along[:, None] + v[:, :, None] * across[:, None]
    normal_y = (
        across[:, None] * np.cos(slope)[:, :, None] - along[:, None] * np.sin(slope)[:, :, None]
    )
    arrays |= {
        f"link/{name}/x": x,
        f"link/{name}/deflection": np.stack([u, v, zero, zero, zero, slope], axis=2),
        f"link/{name}/resultant": np.stack(
            [tension, shear_force, zero, zero, zero, moment], axis=2
        ),
        f"link/{name}/stress/normal": normal,
        f"link/{name}/stress/axial": axial,
        f"link/{name}/stress/bending": bending,
        f"link/{name}/stress/shear": shear,
        f"link/{name}/stress/von_mises": np.sqrt(normal**2 + 3 * shear**2),
        f"link/{name}/centreline": place,
        f"link/{name}/centreline_rigid": root[:, None]
        + (x / DISTAL)[:, None] * (tip0 - root)[:, None],
        f"link/{name}/section_y": normal_y,
    }
