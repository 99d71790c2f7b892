"""Large static deflection: links cut into segments under dead loads and moments.

A body is right to second order in its own deflection; the error of n segments falls with 1/n^3 and
two runs, n and 2 n, are extrapolated where a benchmark asks for more digits than one run gives.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.benchmarks.record import Case, Check, Outcome, Picture, Series
from pinflex.benchmarks.scene import Body, scene
from pinflex.dynamics import Dynamics
from pinflex.mechanism import Mechanism
from pinflex.quasistatic import static_equilibrium

# Bisshopp, Drucker 1945, recomputed with elliptic integrals: a = P L^2/EI: tip angle, dy/L, x/L.
ELASTICA = {
    1.0: (0.46135195, 0.30172077, 0.94356676),
    2.0: (0.78174983, 0.49345748, 0.83935828),
    5.0: (1.21536812, 0.71379152, 0.61237164),
    10.0: (1.43028554, 0.81060902, 0.44500440),
}


def tip_pose(m: Mechanism, frame: str = "tip") -> pin.SE3:
    """Pose of a frame at the static equilibrium."""
    rest = static_equilibrium(m)
    d, here = Dynamics(m.flexible), m.frame(frame)
    d.place(rest.y)
    pin.forwardKinematics(d.model, d.data, d.Q)
    return d.data.oMi[here.joint] * here.placement


def cantilever(
    segments: int,
    load: str,
    *,
    length: float = 1.0,
    EI: tuple[float, float] = (1.0, 1.0),
    GJ: float = 1.0,
    EA: float | None = None,
    planar: bool = True,
    GA: float | None = None,
) -> Mechanism:
    """A cantilever along x, cut into segments; `load` is the YAML of the load at its tip.

    Args:
        segments: Number of bodies. load: "force: [..]" and the like.
        length: m. EI: About y and z, N m^2. GJ: N m^2. EA: N; None: does not stretch.
        planar: Bends in the xy plane only. GA: Shear stiffness, N (with EA); None: no shear.
    """
    area = 1.0 if EA is None else EA
    factor = "" if GA is None else f", ky: {GA / area!r}, kz: {GA / area!r}"
    yaml = f"""
gravity: [0, 0, 0]
actuated: []
forces: {{load: {{at: tip, {load}}}}}
flexible:
  beam:
    material: {{E: 1.0, G: 1.0, rho: 1.0}}
    section: {{shape: given, A: {area!r}, Iy: {EI[0]!r}, Iz: {EI[1]!r}, J: {GJ!r}{factor}}}
    basis: {{kind: craig_bampton, internal: 0}}
    end: tip
    bending_y: true
    bending_z: {str(not planar).lower()}
    torsion: {str(not planar).lower()}
    axial: {str(EA is not None).lower()}
    shear: {str(GA is not None).lower()}
    segments: {segments}
"""
    bodies = (Body("beam", "base"), Body("tip", "beam", xyz=(length, 0, 0)))
    return scene("cantilever", bodies, yaml)


def _planar(pose: pin.SE3) -> Array:
    """Tip angle, -y, x."""
    angle = np.arctan2(-pose.rotation[1, 0], pose.rotation[0, 0])
    return np.array([angle, -pose.translation[1], pose.translation[0]])


def extrapolated(coarse: Array, fine: Array, order: int = 3) -> Array:
    """Richardson from n and 2 n."""
    gain = 2.0**order
    return np.asarray((gain * fine - coarse) / (gain - 1.0))


def elastica() -> Outcome:
    """Dead tip load up to where the beam hangs along it."""
    checks, drop = [], []
    names = ("tip angle [rad]", "tip drop / L", "tip x / L")
    for a, exact in ELASTICA.items():
        coarse, fine = (_planar(tip_pose(cantilever(n, f"force: [0, {-a}, 0]"))) for n in (5, 10))
        drop.append(fine[1])
        for label, found, limit in (
            ("10 segments", fine, 2e-3),
            ("extrapolated from 5 and 10", extrapolated(coarse, fine), 5e-4),
        ):
            worst = int(np.argmax(np.abs(found / exact - 1)))
            checks.append(
                Check(f"a = {a:g}, {label}, {names[worst]}", float(found[worst]), exact[worst],
                      limit, note="second-order segments: 1/n^3")
            )  # fmt: skip
    loads = np.array(list(ELASTICA))
    picture = Picture(
        "D elastica under a dead tip load", "P L^2 / EI", "tip drop / L",
        (Series("pinflex, 10 segments", loads, np.array(drop)),
         Series("elliptic integrals", loads, np.array([e[1] for e in ELASTICA.values()]), True)),
    )  # fmt: skip
    return Outcome(tuple(checks), picture)


def roll_up() -> Outcome:
    """A tip moment of pi EI/L bends half a circle, twice that a whole one."""
    half = tip_pose(cantilever(10, f"moment: [0, 0, {math.pi!r}]")).translation
    whole = tip_pose(cantilever(10, f"moment: [0, 0, {2 * math.pi!r}]")).translation
    checks = [
        Check("half a circle, 10 segments: height / L", float(half[1]), 2 / math.pi, 5e-3,
              note="each body turns by 0.31 rad, right to second order"),
        Check("whole circle, 10 segments: tip to root / L", float(np.linalg.norm(whole)), 0.0,
              1e-8, False, "exact for any polygon"),
    ]  # fmt: skip
    found = []
    for n in (3, 6):
        pose = tip_pose(
            cantilever(n, "force: [0, -600000.0, 0]", length=5.0, EI=(9.346e6, 9.346e6),
                       EA=4.8e8, GA=3.231e8)
        )  # fmt: skip
        found.append([pose.translation[0] - 5.0, pose.translation[1], _planar(pose)[0]])
    best = extrapolated(np.array(found[0]), np.array(found[1]))
    for k, (name, exact) in enumerate(
        (("u_x [m]", -0.59647127), ("u_z [m]", -2.15969389), ("rotation [rad]", 0.67200606))
    ):
        checks.append(
            Check(f"Geradin-Cardona, 3 and 6 segments extrapolated, {name}", float(best[k]), exact,
                  1e-3)
        )  # fmt: skip
    return Outcome(tuple(checks))


BEND = (47.150096, 15.684690, 53.475478)  # [m] tip at P = 600, kGA = 5/6 GA: Cosserat shooting


def arc(pieces: int, load: float) -> Mechanism:
    """An eighth of a circle of radius 100 as straight, flexible chords."""
    turn = np.pi / 4 / pieces
    chord = 2 * 100.0 * np.sin(turn / 2)
    bodies = []
    for k in range(pieces):
        at = (0.0, 0.0, 0.0) if k == 0 else (chord, 0.0, 0.0)
        angle = turn / 2 if k == 0 else turn
        parent = "base" if k == 0 else f"piece_{k - 1}"
        bodies.append(Body(f"piece_{k}", parent, xyz=at, rpy=(0, 0, angle)))
    bodies.append(Body("tip", f"piece_{pieces - 1}", xyz=(chord, 0, 0)))
    yaml = f"""
gravity: [0, 0, 0]
actuated: []
forces: {{load: {{at: tip, force: [0, 0, {load!r}]}}}}
flexible:
  "piece_*":
    material: {{E: 1.0e7, G: 5.0e6, rho: 1.0}}
    section: {{shape: given, A: 1.0, Iy: {1 / 12!r}, Iz: {1 / 12!r}, J: {1 / 6!r}, ky: {5 / 6!r},
      kz: {5 / 6!r}}}
    basis: {{kind: craig_bampton, internal: 0}}
    up: [0, 0, 1]
    bending_y: true
    bending_z: true
    torsion: true
    axial: true
    shear: true
"""
    return scene("arc", bodies, yaml)


def bend() -> Outcome:
    """The 45-degree bend of Bathe and Bolourchi, polygons of 6 and 12 chords."""
    coarse, fine = (np.array(tip_pose(arc(n, 600.0)).translation) for n in (6, 12))
    best = extrapolated(coarse, fine, 2)
    checks = [
        Check(f"{label}: distance of the tip to the reference / 53.5 m",
              float(np.linalg.norm(found - BEND)) / 53.5, 0.0, limit, False, "polygon: 1/n^2")
        for label, found, limit in (("12 chords", fine, 2e-3), ("extrapolated", best, 1e-3))
    ]  # fmt: skip
    return Outcome(tuple(checks))


# Load [N] at 45 deg: stiff and soft tip displacement [mm], tip twist [deg], and the soft tip
# displacement at 90 deg. The twist is the first component of the rotation vector, from a shooting
# of ours without shear (published tables differ in what they call twist by 15 %).
PRINCETON = {
    4.448: (3.965, 56.055, 0.38413, 78.082),
    8.896: (8.889, 109.042, 1.47668, 146.260),
    13.345: (15.342, 156.588, 3.12136, 200.693),
}


def princeton() -> Outcome:
    """A flat beam under a tip load at an angle: bending in two planes twists it."""
    checks, rows = [], []
    names = ("45 deg, stiff [mm]", "45 deg, soft [mm]", "45 deg, twist [deg]", "90 deg, soft [mm]")
    for load, published in PRINCETON.items():
        best = extrapolated(_princeton(4, load), _princeton(8, load), 2)
        rows.append(best)
        for name, value, exact in zip(names, best, published, strict=True):
            checks.append(
                Check(f"{load:g} N, {name}", float(value), exact, 5e-3,
                      note="4 and 8 segments extrapolated; the project's limit")
            )  # fmt: skip
    loads = np.array(list(PRINCETON))
    found, exact_rows = np.array(rows), np.array(list(PRINCETON.values()))
    picture = Picture(
        "D Princeton beam, load at 45 deg", "load [N]", "stiff tip displacement [mm]",
        (Series("pinflex", loads, found[:, 0]),
         Series("published", loads, exact_rows[:, 0], True)),
    )  # fmt: skip
    return Outcome(tuple(checks), picture)


def _princeton(segments: int, load: float) -> Array:
    """Stiff, soft, twist at 45 deg, and soft at 90 deg."""
    poses = []
    for angle in (math.pi / 4, math.pi / 2):
        # Stiff direction is beam y (about z), soft is z (about y).
        force = f"force: [0, {load * math.cos(angle)!r}, {load * math.sin(angle)!r}]"
        m = cantilever(
            segments, force, length=0.508, EI=(2.428734, 36.27936), GJ=3.103338, EA=2.84191e6,
            planar=False,
        )  # fmt: skip
        poses.append(tip_pose(m))
    p, twist = poses[0].translation, math.degrees(abs(pin.log3(poses[0].rotation)[0]))
    return np.array([1e3 * p[1], 1e3 * p[2], twist, 1e3 * poses[1].translation[2]])


def frame(load: float, segments: int) -> Mechanism:
    """A right-angle frame of two flat arms, clamped, with an in-plane load at the free end."""
    E, nu, h, w = 71.24e9, 0.31, 0.03, 0.0006
    G = E / (2 * (1 + nu))
    bodies = (
        Body("first", "base"),
        Body("second", "first", xyz=(0.24, 0, 0), rpy=(0, 0, -np.pi / 2)),
        Body("tip", "second", xyz=(0.24, 0, 0)),
    )
    yaml = f"""
gravity: [0, 0, 0]
actuated: []
forces: {{load: {{at: tip, force: [{load!r}, 0, 0]}}}}
flexible:
  "first, second":
    material: {{E: {E!r}, G: {G!r}, rho: 2700.0}}
    section: {{shape: given, A: {h * w!r}, Iy: {h * w**3 / 12!r}, Iz: {w * h**3 / 12!r},
      J: {h * w**3 / 3!r}}}
    basis: {{kind: craig_bampton, internal: 0}}
    up: [0, 0, 1]
    bending_y: true
    bending_z: true
    torsion: true
    segments: {segments}
"""
    return scene("frame", bodies, yaml)


def buckling() -> Outcome:
    """Load at which the loaded frame loses its stiffness sideways, in both directions."""
    from scipy.optimize import brentq

    def lowest(load: float, segments: int) -> float:
        m = frame(load, segments)
        rest = static_equilibrium(m)
        d, still = Dynamics(m.flexible), np.zeros(m.flexible.nv)
        K = d.tangent(rest.y, still, still, rest.lam)[2]
        stiff = np.linalg.inv(np.linalg.cholesky(m.flexible.K))
        # In units of the unloaded stiffness, so that every direction counts alike.
        return float(np.linalg.eigvalsh(stiff @ (0.5 * (K + K.T)) @ stiff.T)[0])

    checks = []
    for name, exact in (("opening", 1.0875186), ("closing", -0.6804278)):
        found = [
            np.array(brentq(lowest, 0.9 * exact, 1.1 * exact, args=(n,), xtol=1e-5)) for n in (3, 6)
        ]
        checks += [
            Check(f"{name} load, 6 segments an arm [N]", float(found[1]), exact, 5e-3,
                  note="the project's limit"),
            Check(f"{name} load, 3 and 6 extrapolated [N]",
                  float(extrapolated(found[0], found[1], 2)), exact, 1e-3),
        ]  # fmt: skip
    return Outcome(tuple(checks))


CASES = (
    Case("D elastica", "Bisshopp, Drucker 1945; elliptic integrals", elastica),
    Case("D roll-up and Geradin-Cardona", "closed form; shooting", roll_up),
    Case("D 45-degree bend", "Bathe, Bolourchi 1979; Cosserat shooting", bend),
    Case("D Princeton beam", "Dowell, Traybar 1975; shooting with kGA = 5/6", princeton),
    Case("D right-angle frame", "Argyris 1979; shooting determinant", buckling),
)
