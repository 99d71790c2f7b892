"""Loops and flexible links as `pinflex check` reports them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.description.drives import Drive, Friction
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.parts import FlexiblePart
from pinflex.mechanics.planes import LeftOut
from pinflex.text import brief


@dataclass(frozen=True)
class LoopCheck:
    """One loop: its kind, the frames it joins, its closure rows and those left out as dependent."""

    __repr__ = brief

    name: str
    kind: str
    between: tuple[str, str]
    rows: int
    redundant: tuple[str, ...]


@dataclass(frozen=True)
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

    __repr__ = brief

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


@dataclass(frozen=True)
class DriveCheck:
    """Drive or friction of a joint, as the columns of a table.

    Attributes:
        name: Joint. drive: None where it rubs and has none. friction: None for none.
        armature: Inertia of rotor and gear at the joint [kg m^2 | kg].
    """

    __repr__ = brief

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
