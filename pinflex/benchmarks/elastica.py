"""Large static deflection: links cut into segments under dead loads, followers and moments.

A body is right to second order in its own deflection, so n segments leave an error of 1/n^2; two
runs with n and 2 n are extrapolated where a benchmark asks for more digits than one run gives.
"""

from __future__ import annotations

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
) -> Mechanism:
    """A cantilever along x, cut into segments; `load` is the YAML of the load at its tip.

    Args:
        segments: Number of bodies. load: "force: [..]" and the like.
        length: m. EI: About y and z, N m^2. GJ: N m^2. EA: N; None: does not stretch.
        planar: Bends in the xy plane only.
    """
    area = 1.0 if EA is None else EA
    yaml = f"""
gravity: [0, 0, 0]
actuated: []
forces: {{load: {{at: tip, {load}}}}}
flexible:
  beam:
    material: {{E: 1.0, G: 1.0, rho: 1.0}}
    section: {{shape: given, A: {area!r}, Iy: {EI[0]!r}, Iz: {EI[1]!r}, J: {GJ!r}}}
    basis: {{kind: craig_bampton, internal: 2}}
    end: tip
    bending_y: true
    bending_z: {str(not planar).lower()}
    torsion: {str(not planar).lower()}
    axial: {str(EA is not None).lower()}
    segments: {segments}
"""
    bodies = (Body("beam", "base"), Body("tip", "beam", xyz=(length, 0, 0)))
    return scene("cantilever", bodies, yaml)


def _planar(pose: pin.SE3) -> Array:
    """Tip angle, -y, x."""
    angle = np.arctan2(-pose.rotation[1, 0], pose.rotation[0, 0])
    return np.array([angle, -pose.translation[1], pose.translation[0]])


def elastica() -> Outcome:
    """Dead tip load up to where the beam hangs along it."""
    checks = []
    names = ("tip angle [rad]", "tip drop / L", "tip x / L")
    drop = []
    for a, exact in ELASTICA.items():
        by_count = {n: _planar(tip_pose(cantilever(n, f"force: [0, {-a}, 0]"))) for n in (8, 16)}
        refined = by_count[16] + (by_count[16] - by_count[8]) / 3.0
        drop.append(by_count[16][1])
        worst = int(np.argmax(np.abs(by_count[16] / exact - 1)))
        checks.append(
            Check(f"a = {a:g}, 16 segments, {names[worst]}", float(by_count[16][worst]),
                  exact[worst], 2e-3, note="error 1/n^2 of second-order segments")
        )  # fmt: skip
        worst = int(np.argmax(np.abs(refined / exact - 1)))
        checks.append(
            Check(f"a = {a:g}, 8 and 16 extrapolated, {names[worst]}", float(refined[worst]),
                  exact[worst], 1e-4, note="the 1/n^4 that is left")
        )  # fmt: skip
    a = np.array(list(ELASTICA))
    picture = Picture(
        "D elastica under a dead tip load", "P L^2 / EI", "tip drop / L",
        (Series("pinflex, 16 segments", a, np.array(drop)),
         Series("elliptic integrals", a, np.array([e[1] for e in ELASTICA.values()]), True)),
    )  # fmt: skip
    return Outcome(tuple(checks), picture)


CASES = (Case("D elastica", "Bisshopp, Drucker 1945; elliptic integrals", elastica),)
