"""What pinflex understood of a model: freedoms, loops, masses, planes, frequencies, warnings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pinflex.actuation.nominal import nominal
from pinflex.bodies.summary import summary
from pinflex.description.motion import from_spec
from pinflex.description.schema import integer
from pinflex.errors import ConvergenceError, SceneError
from pinflex.levels.modes import modes
from pinflex.mechanics.assembly import LoopReport
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.loop_axes import axis_hint
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.parts import FlexiblePart, LeftOut
from pinflex.mechanics.plausible import heavy
from pinflex.studies import check_urdf
from pinflex.studies.check_statics import Statics, rigid_holding, statics
from pinflex.studies.mode_shapes import first_modes, rigid_body
from pinflex.text import brief
from pinflex.threads import one_blas_thread

MASS_OFF = 0.01  # share of the URDF's mass beyond which a beam's mass is worth a warning
_OFF_AXIS = 1e-6  # of the largest holding torque: round-off of an axis written with ten digits
CENTRE_OFF = 0.05  # the same for its centre of mass, as a share of the span
SAG_FAR = 0.1  # share of the longest flexible link beyond which a sag is worth a warning
SAG_NONE = 1e-6  # share below which it is none, as where a leg hangs straight
SAG_APART = 0.2  # share by which linear and full statics may differ without a word
_ALONG_MOTION = 101  # poses at which the motion is tried


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
class Check:
    """The report of `pinflex check`; `check_text.write` turns it into text.

    Attributes:
        name, urdf, base: What was read. gravity: [m/s^2].
        joints: Velocity coordinates of the rigid tree. elastic: Elastic coordinates.
        report: Loops of the rigid mechanism: rows, rank, redundant rows, mobility, sigma_min.
        motors: Names. units: Of their torques.
        loops, links: One record each.
        platform: Frame, or None.
        elastic_joints: Coordinates with a spring that the rigid level holds.
        idle: Freedoms that nothing hangs on, held where home has them.
        statics: Sag and holding torques.
        frequencies: [Hz]. frequency_note: Of which state.
        motion: What the motion asks, and whether the rigid mechanism can follow it.
        warnings: Sentences.
        summaries: Modal summary of each solid body, as text.
        by_joint: Links of the frames that the YAML names by their joint.
    """

    __repr__ = brief

    name: str
    urdf: str
    base: str
    gravity: tuple[float, float, float]
    joints: int
    elastic: int
    report: LoopReport
    motors: tuple[str, ...]
    units: tuple[str, ...]
    loops: tuple[LoopCheck, ...]
    links: tuple[LinkCheck, ...]
    platform: str | None
    statics: Statics
    frequencies: tuple[float, ...]
    frequency_note: str
    motion: str
    elastic_joints: tuple[str, ...] = field(default=())
    idle: tuple[str, ...] = field(default=())
    warnings: tuple[str, ...] = field(default=())
    summaries: tuple[str, ...] = field(default=())
    by_joint: Mapping[str, str] = field(default_factory=dict)


@one_blas_thread()
def check(mechanism: Mechanism, count: int = 6) -> Check:
    """Look at a model before anything is solved.

    Args:
        mechanism: From `load`.
        count: How many natural frequencies.
    """
    integer(count, "check: count", 1)
    description = mechanism.description
    rest = statics(mechanism)
    frequencies, note = first_frequencies(mechanism, count)
    motion, motion_warning = _motion(mechanism)
    links = tuple(_link(mechanism, part) for part in mechanism.parts.values())
    warnings = (
        *_freedom_warnings(mechanism),
        *_off_axis(mechanism),
        *(text for link in links for text in _link_warnings(link)),
        *(text for p in mechanism.parts.values() for text in _carries_nothing(mechanism, p)),
        *_sag_warnings(rest, links),
        *heavy(mechanism.links),
        *check_urdf.ignored(description),
        *check_urdf.beyond_limits(
            description, mechanism, rest.holding_full or rest.holding_linear or rest.holding_rigid
        ),
        *motion_warning,
    )
    return Check(
        name=mechanism.name,
        urdf=description.urdf_name,
        base=description.base,
        gravity=description.gravity,
        joints=int(mechanism.rigid.nv),
        elastic=mechanism.flexible.n_eta,
        report=mechanism.report,
        motors=mechanism.motors,
        units=_units(mechanism),
        loops=_loops(mechanism),
        links=links,
        platform=description.platform,
        by_joint=dict(description.by_joint),
        statics=rest,
        frequencies=frequencies,
        frequency_note=note,
        motion=motion,
        elastic_joints=mechanism.elastic_joints,
        idle=mechanism.idle.names,
        warnings=warnings,
        summaries=_summaries(mechanism),
    )


def is_loaded(mechanism: Mechanism) -> bool:
    """Whether anything acts on the mechanism at rest: gravity, a spring, a load, a frame spring."""
    description = mechanism.description
    acting = any(force.scale(0.0) for force in description.forces)
    springs = len(mechanism.flexible.springs.v_at) > 0 or len(description.springs) > 0
    return any(description.gravity) or springs or acting


def _summaries(mechanism: Mechanism) -> tuple[str, ...]:
    """One text per different solid body."""
    bodies: dict[int, list[str]] = {}
    for name, part in mechanism.parts.items():
        if part.bodies[0].solid is not None:
            bodies.setdefault(id(part.bodies[0]), []).append(name)
    return tuple(
        f"{', '.join(names)}: {summary(mechanism.parts[names[0]].bodies[0])}"
        for names in bodies.values()
    )


def first_frequencies(mechanism: Mechanism, count: int) -> tuple[tuple[float, ...], str]:
    """Natural frequencies [Hz] at home with locked motors, and the words for that state.

    Where gravity leaves no equilibrium, those of the undeformed pose.
    """
    if not mechanism.flexible.n_eta and not len(mechanism.flexible.springs.v_at):
        return (), "no flexible link and no spring: nothing vibrates"
    locked = "at home, motors locked" if mechanism.motors else "at home"
    loaded, every = is_loaded(mechanism), mechanism.flexible.nv
    try:
        found = modes(mechanism, count=every, preload="gravity" if loaded else "none")
        note = f"{locked}, {'about the static equilibrium' if loaded else 'no load'}"
    except ConvergenceError:
        found = modes(mechanism, count=every, preload="none")
        note = f"{locked}, about the undeformed pose: gravity and loads leave no equilibrium"
    first = first_modes(found, count)
    zeros = rigid_body(first)
    return tuple(float(f) for f in first.frequencies), f"{note}; {zeros}" if zeros else note


def _units(mechanism: Mechanism) -> tuple[str, ...]:
    model = mechanism.rigid.rigid
    linear = {
        joint.idx_v
        for joint in model.joints
        if joint.nv == 1 and joint.shortname().startswith("JointModelP")
    }
    return tuple("N" if int(row) in linear else "N m" for row in mechanism.rigid.motors)


def _loops(mechanism: Mechanism) -> tuple[LoopCheck, ...]:
    report, closed = mechanism.report, mechanism.rigid.closed
    found = []
    for loop in mechanism.description.loops:
        redundant = tuple(r for r in report.redundant if r.startswith(f"{loop.name}: "))
        kept = sum(closed.names[k] == loop.name for k in closed.loop_of)
        between = (loop.frame_a, loop.frame_b)
        found.append(LoopCheck(loop.name, loop.kind, between, kept + len(redundant), redundant))
    return tuple(found)


def _link(mechanism: Mechanism, part: FlexiblePart) -> LinkCheck:
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


def _link_warnings(link: LinkCheck) -> list[str]:
    """The beam's inertia takes the place of the URDF's: said where that changes the robot."""
    if link.share is not None:
        return []
    if link.mass_difference is None or link.centre_shift is None:
        mass = link.mass + link.end_masses
        return [f"{link.name}: the URDF gives no mass; the beam has its own, {mass:.4g} kg."]
    words = []
    if abs(link.mass_difference) > MASS_OFF:
        words.append(
            f"its mass is {link.mass + link.end_masses:.4g} kg instead of {link.urdf_mass:.4g} kg "
            f"({100 * link.mass_difference:+.1f} %)"
        )
    if link.centre_shift > CENTRE_OFF * link.length:
        words.append(f"its centre of mass moves by {1e3 * link.centre_shift:.3g} mm")
    if not words:
        return []
    return [
        f"{link.name}: the beam replaces the URDF's inertia: {' and '.join(words)}. "
        "Write inertia: urdf to keep it."
    ]


def _carries_nothing(mechanism: Mechanism, part: FlexiblePart) -> list[str]:
    """A beam beside the load path: everything that hangs on its link sits at its root."""
    links = mechanism.links
    number = next(k for k, link in enumerate(links) if link.name == part.link)
    sections: dict[str, float] = {}
    for link in links:
        if link.parent == number and (link.steps or link.weighs):
            sections[link.name] = part.section_of(link.placement.translation)
    loops = {f for loop in mechanism.description.loops for f in (loop.frame_a, loop.frame_b)}
    for link in links:
        if link.parent == number and link.name in loops:
            sections[link.name] = part.length
    if not sections or any(sections.values()) or part.bodies[0].solid is not None:
        return []
    return [
        f"{part.link}: nothing hangs on its beam beyond the root, where {', '.join(sections)} "
        f"{'sits' if len(sections) == 1 else 'sit'}: it bends under its own mass alone."
    ]


def _sag_warnings(rest: Statics, links: tuple[LinkCheck, ...]) -> list[str]:
    """The platform sags far, or so far that linear statics are off."""
    sags = [rest.linear, rest.full]
    far = [float(np.linalg.norm(sag.position)) for sag in sags if sag is not None]
    longest = max((link.length for link in links), default=0.0)
    found = []
    if far and max(far) > SAG_FAR * longest:
        found.append(
            f"the platform sags by {max(far):.3g} m, more than a tenth of the longest flexible "
            f"link ({longest:.3g} m): look for a slip of units, a joint that gives way, or a link "
            "that is too soft."
        )
    seen = len(far) == 2 and max(far) > SAG_NONE * longest
    if seen and abs(far[0] - far[1]) > SAG_APART * max(far):
        found.append(
            f"linear statics give a sag of {far[0]:.3g} m, the full equilibrium {far[1]:.3g} m: "
            "deflections are not small, so level ked is off as well. Trust coupled."
        )
    return found


def _freedom_warnings(mechanism: Mechanism) -> list[str]:
    report, motors = mechanism.report, len(mechanism.motors)
    count = f"{motors} motor{'' if motors == 1 else 's'} for {report.mobility} degrees of freedom"
    warnings = []
    if motors < report.mobility:
        warnings.append(
            f"{count}: underactuated. Only the "
            "level coupled (or drive: torque) lets the rest swing; the other levels need a motor "
            "for each degree of freedom."
        )
    if motors > report.mobility:
        warnings.append(
            f"{count}: redundantly actuated. "
            "Their motions must agree; prescribe the platform's motion instead."
        )
    if mechanism.description.loops:
        crossed = axis_hint(Dynamics(mechanism.rigid), mechanism.description.loops, mechanism.home)
        warnings += [crossed.strip()] if crossed else []
    every = dict.fromkeys((*report.redundant, *mechanism.flexible_report.redundant))
    if every:
        flexible = mechanism.flexible_report.redundant
        kind = "" if set(every) == set(flexible) else f" ({len(flexible)} in the flexible model)"
        warnings.append(
            f"{len(every)} closure rows are dependent and left out{kind}: {', '.join(every)}. The "
            "motion is exact; reactions in these directions are not unique."
        )
    return warnings


def _off_axis(mechanism: Mechanism) -> list[str]:
    """Rods whose centre of mass is off the line about which they spin."""
    if mechanism.report.mobility > len(mechanism.motors):
        return []
    torques, couples = rigid_holding(mechanism)
    scale = float(np.max(np.abs(torques), initial=0.0))
    off = [
        f"{spin.name} ({abs(couple):.3g} N m)"
        for spin, couple in zip(mechanism.idle.spins, couples, strict=True)
        if abs(couple) > _OFF_AXIS * scale
    ]
    if not off:
        return []
    return [
        f"{', '.join(off)}: the mass is off the axis, so that gravity would turn it; this couple "
        "holds it where home has it, and no motor gives it."
    ]


def _motion(mechanism: Mechanism) -> tuple[str, list[str]]:
    """The motion in words, and a warning where the rigid mechanism cannot follow it."""
    description = mechanism.description
    if description.motion is None:
        return "none given: the motors hold home", []
    folder = None if description.path is None else description.path.parent
    motion = from_spec(description.motion, f"{mechanism.name}.yaml: motion", folder)
    names = ", ".join(motion.names)
    moved = f" of the {motion.target} ({names})" if names else ""
    end = description.solve.until or motion.duration
    words = f"{motion.kind}{moved}, {end:g} s"
    if mechanism.report.mobility > len(mechanism.motors):
        return words, []
    try:
        nominal(mechanism, motion, np.linspace(0.0, end, _ALONG_MOTION))
    except SceneError as error:
        return f"{words}: cannot be followed", [f"motion: {error}"]
    return f"{words}: the rigid mechanism can follow it", []
