"""Loops and flexible links as `pinflex check` reports them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.basis import FlexibleBody
from pinflex.bodies.superelement import CROSS
from pinflex.description.blocks.joints import Drive, Friction
from pinflex.errors import SceneError
from pinflex.levels.quasistatic import Equilibrium, rest, unstable_text
from pinflex.levels.rigid import multipliers
from pinflex.levels.start import acted_on, hangs, linear_statics
from pinflex.linalg import eigh
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian, frame_pose
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.parts import FlexiblePart
from pinflex.mechanics.model.planes import LeftOut
from pinflex.mechanics.model.tree import poses_of
from pinflex.rotations import rotation_vector
from pinflex.text import frozen


@frozen
class LoopCheck:
    """One loop: its kind, the frames it joins, its closure rows and those left out as dependent."""

    name: str
    kind: str
    between: tuple[str, str]
    rows: int
    redundant: tuple[str, ...]


@frozen
class LinkCheck:
    """One flexible link: what its beam is, and how its mass compares with the URDF's.

    Attributes:
        name: Link. length: Span [m]. section, material, basis: Words.
        coordinates: Elastic coordinates. segments: Bodies it is cut into.
        planes: Active directions among u (axial), v, w (bending along beam y, z), p (torsion).
        reason: Why these planes.
        left_out: What `auto` left out, with its largest share of compliance, sag, holding torques
            and inertia loads.
        mass: Of the beam [kg]. end_masses: Of all that rides rigidly on it. urdf_mass: [kg].
        riders: Place along the span [m] and mass of each.
        share: Share of its described density that the beam carries; None where the beam's inertia
            takes the place of the URDF's.
        mass_difference: (beam and riders - URDF) / URDF, None where the URDF has no mass.
        centre_shift: Distance of the two centres of mass [m], None likewise.
        inertia_difference: The same ratio for the trace of the inertia about the link's frame.
    """

    name: str
    length: float
    section: str
    material: str
    basis: str
    coordinates: int
    segments: int
    planes: tuple[str, ...]
    reason: str
    left_out: tuple[LeftOut, ...]
    mass: float
    end_masses: float
    urdf_mass: float
    riders: tuple[tuple[float, float], ...]
    share: float | None
    mass_difference: float | None
    centre_shift: float | None
    inertia_difference: float | None


@frozen
class DriveCheck:
    """Drive or friction of a joint, as the columns of a table.

    Attributes:
        name: Joint. drive: None where it rubs and has none. friction: None for none.
        armature: Inertia of rotor and gear at the joint [kg m^2 | kg].
    """

    name: str
    drive: Drive | None
    friction: Friction | None
    armature: float


def drive_checks(mechanism: Mechanism) -> tuple[DriveCheck, ...]:
    """One record for each joint with a drive or with friction, motors first."""
    joints = mechanism.description.joints
    known = [*mechanism.description.actuated, *joints]
    return tuple(
        DriveCheck(name, joints[name].drive, joints[name].friction, joints[name].armature)
        for name in dict.fromkeys(known)
        if name in joints and (joints[name].drive is not None or joints[name].friction is not None)
    )


def loop_checks(mechanism: Mechanism) -> tuple[LoopCheck, ...]:
    """One record for each loop of the rigid mechanism."""
    report, closed = mechanism.report, mechanism.rigid.closed
    found = []
    for loop in mechanism.description.loops:
        redundant = tuple(r for r in report.redundant if r.startswith(f"{loop.name}: "))
        kept = sum(closed.names[k] == loop.name for k in closed.loop_of)
        between = (loop.frame_a, loop.frame_b)
        found.append(LoopCheck(loop.name, loop.kind, between, kept + len(redundant), redundant))
    return tuple(found)


def coupling_texts(mechanism: Mechanism) -> tuple[str, ...]:
    """Each coupling of joints as an equation of their positions (rad | m)."""
    found = []
    for one in mechanism.description.couplings:
        ratio = {1.0: "", -1.0: "-"}.get(one.ratio, f"{one.ratio:g} ")
        offset = f" {one.offset:+g}" if one.offset else ""
        led = f"{one.offset:g}" if one.leader is None else f"{ratio}{one.leader}{offset}"
        found.append(f"{one.joint} = {led}")
    return tuple(found)


def link_check(mechanism: Mechanism, part: FlexiblePart) -> LinkCheck:
    """Beam of a flexible link beside the URDF's inertia."""
    spec, section = part.spec, part.spec.section
    urdf = next(link.inertia for link in mechanism.links if link.name == part.link)
    beam = np.zeros((6, 6))  # about the link's frame
    for inertia in part.rigid_inertias():
        beam += inertia.matrix()
    mass, centre = beam[0, 0], np.array([beam[5, 1], beam[3, 2], beam[4, 0]]) / beam[0, 0]
    known = urdf.mass > 0
    trace = [float(np.trace(i[3:, 3:])) for i in (beam, urdf.matrix())]
    riders = tuple((rider.x, float(rider.inertia.mass)) for rider in part.riders)
    sizes = " x ".join(f"{1e3 * value:.4g}" for _, value in section.dimensions)
    return LinkCheck(
        name=part.link,
        length=part.length,
        section=section.shape if section.shape == "given" else f"{section.shape} {sizes} mm",
        material=spec.material.name,
        basis=spec.basis.kind,
        coordinates=sum(body.n for body in part.bodies),
        segments=len(part.bodies),
        planes=part.planes,
        reason=part.reason,
        left_out=part.left_out,
        mass=part.mass,
        end_masses=sum(kg for _, kg in riders),
        urdf_mass=float(urdf.mass),
        riders=riders,
        share=part.share,
        mass_difference=float(mass / urdf.mass - 1) if known else None,
        centre_shift=float(np.linalg.norm(centre - urdf.lever)) if known else None,
        inertia_difference=trace[0] / trace[1] - 1 if known and trace[1] > 0 else None,
    )


# Rest under gravity: how far the platform sags and what the motors hold.

_ROUND_OFF = 1e-12  # [m | rad], and this share of the largest torque or of the weight: zero
_BESIDE = 1e-6  # of a sag: a component that no picture shows


@dataclass(frozen=True)
class Sag:
    """Displacement of the platform from the undeformed pose: [m], rotation vector [rad]."""

    position: tuple[float, float, float]
    rotation: tuple[float, float, float]


@frozen
class Statics:
    """Rest at home; what could not be found is None and `reason` says why.

    Attributes:
        linear, full: Sag of the platform in linear statics about the undeformed pose, and in the
            full equilibrium. loaded: Linear with the stiffness of weight and loads, as level ked.
        holding_rigid, holding_linear, holding_full: Motor torques (N m | N) that hold it.
        spring_moves: How far joints with a spring move in the full equilibrium [rad | m].
        linear_reason, full_reason: Why there is none, "" when there is.
    """

    linear: Sag | None = None
    full: Sag | None = None
    loaded: Sag | None = None
    holding_rigid: tuple[float, ...] | None = None
    holding_linear: tuple[float, ...] | None = None
    holding_full: tuple[float, ...] | None = None
    spring_moves: Mapping[str, float] = field(default_factory=dict)
    linear_reason: str = ""
    full_reason: str = ""


def statics(mechanism: Mechanism) -> Statics:
    """Sag of the platform and holding torques at home, motors locked, linear and full."""
    system, report = mechanism.flexible, mechanism.report
    swings = report.mobility > len(mechanism.motors)
    held = swings and bool(mechanism.description.springs)  # perhaps: then it has an equilibrium
    if swings and not held and not hangs(mechanism):
        why = "the motors do not hold every degree of freedom"
        return Statics(linear_reason=why, full_reason=why)
    weight = _weight(mechanism)
    rigid = _torques(rigid_holding(mechanism)[0], weight)
    if not mechanism.compliant and not held:
        why = "no flexible link and no elastic joint"
        return Statics(holding_rigid=rigid, linear_reason=why, full_reason=why)
    if not acted_on(system, mechanism.undeformed()):
        why = "nothing acts on it at rest"
        return Statics(holding_rigid=rigid, linear_reason=why, full_reason=why)
    linear, loaded, linear_reason = None, None, "what hangs loose has no stiffness but its weight"
    if held:
        linear_reason = "what springs between frames hold is not linearised"
    if not swings:
        linear, linear_reason = _or_reason(lambda: linear_statics(mechanism))
        loaded, _ = _or_reason(lambda: linear_statics(mechanism, loaded=True))
    full, full_reason = _or_reason(lambda: rest(mechanism))
    if full is not None and full.unstable:
        full, full_reason = None, unstable_text("static equilibrium")
    dynamics = Equations(system)
    return Statics(
        linear=_sag(mechanism, dynamics, linear, True),
        full=_sag(mechanism, dynamics, full, False),
        loaded=_sag(mechanism, dynamics, loaded, True),
        holding_rigid=rigid,
        holding_linear=_holding(mechanism, linear),
        holding_full=_holding(mechanism, full),
        spring_moves=_spring_moves(mechanism, dynamics, full),
        linear_reason=linear_reason,
        full_reason=full_reason,
    )


def rigid_holding(mechanism: Mechanism) -> tuple[Array, Array]:
    """Motor torques at home without elasticity, and the couples that hold the spins of rods."""
    system = mechanism.rigid
    dynamics, still = Equations(system), np.zeros(system.nv)
    r, _ = dynamics.residual(mechanism.home, still, still, np.zeros(system.closed.n), 0.0)
    J = dynamics.close(mechanism.home).J
    lam, torque = multipliers(mechanism, J[None], r[None])
    return torque[0], lam[0, lam.shape[1] - len(mechanism.idle.spins) :]


def _or_reason(solve: Callable[[], Equilibrium]) -> tuple[Equilibrium | None, str]:
    try:
        return solve(), ""
    except SceneError as error:
        return None, str(error)
    except np.linalg.LinAlgError:
        return None, "something can move without any stiffness: the linear equations are singular"


def _weight(mechanism: Mechanism) -> float:
    """Moment [N m] of the whole weight at the reach of the robot, of whose parts torques are."""
    reach = max(float(np.linalg.norm(pose.translation)) for pose in poses_of(mechanism.links))
    mass = sum(link.inertia.mass for link in mechanism.links)
    return float(mass * np.linalg.norm(mechanism.description.gravity) * max(reach, 1.0))


def _torques(values: Array, weight: float) -> tuple[float, ...]:
    scale = float(np.max(np.abs(values), initial=weight))
    return tuple(float(x) if abs(x) > _ROUND_OFF * scale else 0.0 for x in values)


def _holding(mechanism: Mechanism, found: Equilibrium | None) -> tuple[float, ...] | None:
    if found is None:
        return None
    return _torques(found.r[mechanism.flexible.motors], _weight(mechanism))


def _spring_moves(
    mechanism: Mechanism, dynamics: Equations, found: Equilibrium | None
) -> dict[str, float]:
    model, elastic = mechanism.rigid.rigid, mechanism.elastic_joints
    if found is None or not elastic:
        return {}
    moved = dynamics.difference(mechanism.undeformed(), found.y)
    rows = {name: model.idx_vs[model.getJointId(name)] for name in elastic}
    return {name: float(moved[row]) for name, row in rows.items()}


def _sag(
    mechanism: Mechanism, dynamics: Equations, found: Equilibrium | None, linear: bool
) -> Sag | None:
    if found is None or mechanism.description.platform is None:
        return None
    flat, look = mechanism.undeformed(), Equations(dynamics.system)
    here = mechanism.frame(mechanism.description.platform)
    if linear:  # the differential of the pose, without the second order of its turns
        moved = frame_jacobian(look, flat, here) @ dynamics.difference(flat, found.y)
        return Sag(_triple(moved[:3]), _triple(moved[3:]))
    straight, bent = (frame_pose(look, y, here) for y in (flat, found.y))
    turned = rotation_vector((bent.rotation @ straight.rotation.T)[None])[0]
    return Sag(_triple(bent.translation - straight.translation), _triple(turned))


def _triple(vector: Array) -> tuple[float, float, float]:
    # what round-off leaves of a zero would read as a number
    least = max(_ROUND_OFF, _BESIDE * float(np.linalg.norm(vector)))
    kept = np.where(np.abs(vector) > least, vector, 0.0)
    return float(kept[0]), float(kept[1]), float(kept[2])


# The modal summary of a flexible body: mass, centre, inertia, frequencies, participation.
#
# What a modal file of a multibody program says of a body, in SI units, for beams and solids alike.

UNITS = {
    "mass": "kg",
    "centre": "m",
    "inertia": "kg m^2",
    "frequencies": "Hz",
    "effective_mass": "kg",
    "effective_inertia": "kg m^2",
    "participation": "kg^0.5 | kg^0.5 m",
}


def modal_data(body: FlexibleBody) -> dict[str, Any]:
    """Plain numbers of a body, by name; `UNITS` says their units.

    Frame: x along the span from its start. Modes are those of the body held at its root and free
    elsewhere; the participation of mode k in a rigid motion r is f_k = phi_k' M r with
    phi_k' M phi_k = 1, and f_k^2 the mass (or, about the root, the inertia) that moves with it.

    Returns:
        mass; centre (3,); inertia about the centre (3, 3); frequencies (n,); participation (n, 6)
        and effective_mass (n, 3), effective_inertia (n, 3) for x, y, z; coordinates, points,
        inertia_error.
    """
    m, p = body.mass, body.points
    total = float(m.sum())
    centre = m @ p / total
    arm = p - centre
    second = arm.T @ (m[:, None] * arm)
    inertia = np.trace(second) * np.eye(3) - second
    if body.inertia is not None:
        inertia += np.diag(body.inertia.sum(axis=0))
    inertia[0, 0] += float(body.It.sum())
    M = body.M
    if np.linalg.eigvalsh(M)[0] <= 0.0:
        M = M + 1e-12 * np.trace(M) * np.eye(body.n)
    squares, V = eigh(body.K, M)
    rigid = np.concatenate(
        [np.tile(np.eye(3), (len(m), 1, 1)), np.einsum("acb,ib->ica", CROSS, p)], 2
    )
    share = np.einsum("i,ick,icr->kr", m, body.Phi, rigid)
    share[:, 3] += body.It @ body.Phi_t
    share = V.T @ share
    return {
        "mass": total,
        "centre": centre,
        "inertia": inertia,
        "frequencies": np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi),
        "participation": share,
        "effective_mass": share[:, :3] ** 2,
        "effective_inertia": share[:, 3:] ** 2,
        "coordinates": np.array(body.labels),
        "points": len(m),
        "inertia_error": 0.0 if body.solid is None else body.solid.inertia_error,
    }


def summary(body: FlexibleBody, count: int = 12) -> str:
    """Modal summary as text."""
    data = modal_data(body)
    I = data["inertia"]  # noqa: E741 - the symbol of the quantity
    near = np.where(np.abs(data["centre"]) < 1e-12 * body.length, 0.0, data["centre"])
    I = np.where(np.abs(I) < 1e-12 * np.trace(I), 0.0, I)  # noqa: E741
    centre = ", ".join(f"{x:.6g}" for x in near)
    lines = [
        "Modal summary (SI: kg, m, s; frame: x along the span from its start)",
        f"  mass             {data['mass']:.9g} kg",
        f"  centre           ({centre}) m",
        f"  inertia, centre  xx {I[0, 0]:.6g}, yy {I[1, 1]:.6g}, zz {I[2, 2]:.6g} kg m^2",
        f"                   xy {I[0, 1]:.3g}, yz {I[1, 2]:.3g}, zx {I[2, 0]:.3g} kg m^2",
        f"  coordinates      {body.n}, inertia on {data['points']} points",
    ]
    if body.solid is not None:
        held = "  ".join(f"{f:.5g}" for f in body.solid.held_frequencies)
        names = ", ".join([body.solid.held[0], *(node.name for node in body.solid.nodes)])
        order = "with" if body.second_order else "without"
        lines += [
            f"  interfaces       {names} (the first is held); {order} second-order rows",
            f"  point inertia    largest error {data['inertia_error']:.2g} of a modal mass; mass, "
            "centre, inertia exact",
            f"  all held         {held} Hz",
        ]
    lines.append(
        "  held at its root: frequency, share of the mass x y z, of the inertia about the root"
    )
    whole = np.array([data["mass"]] * 3)
    p, m = body.points, body.mass
    turn = np.array([float(m @ (np.sum(p**2, axis=1) - p[:, a] ** 2)) for a in range(3)])
    turn[0] += float(body.It.sum())
    turn = np.where(turn > 0.0, turn, np.inf)
    for k in range(min(count, body.n)):
        shares = [*(data["effective_mass"][k] / whole), *(data["effective_inertia"][k] / turn)]
        text = " ".join(f"{100 * x:6.2f}" for x in shares)
        lines.append(f"  {k + 1:3d} {data['frequencies'][k]:12.5g} Hz  {text} %")
    return "\n".join(lines)


def save(body: FlexibleBody, path: str | Path) -> Path:
    """Write the modal data, with units, K, M and D (in the coordinates of the body), as a .npz."""
    path = Path(path)
    data = modal_data(body)
    arrays = {key: np.asarray(value) for key, value in data.items()}
    units = np.array([f"{key}: {unit}" for key, unit in UNITS.items()])
    arrays |= {"K": body.K, "M": body.M, "D": body.D, "units": units}
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]
    return path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
