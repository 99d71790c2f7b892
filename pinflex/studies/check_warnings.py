"""Warnings of `pinflex check`, one sentence or two each."""

from __future__ import annotations

import numpy as np

from pinflex.levels.excited import default_motion
from pinflex.levels.rigid import sharing
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.loop_axes import axis_hint
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.parts import FlexiblePart
from pinflex.mechanics.plausible import heavy
from pinflex.studies import check_urdf
from pinflex.studies.check_parts import LinkCheck
from pinflex.studies.check_statics import Statics, rigid_holding
from pinflex.text import percent, plural

MASS_OFF = 0.01  # share of the URDF's mass beyond which a beam's mass is worth a warning
_OFF_AXIS = 1e-6  # of the largest holding torque: round-off of an axis written with ten digits
CENTRE_OFF = 0.05  # the same for its centre of mass, as a share of the span
SAG_FAR = 0.1  # share of the longest flexible link beyond which a sag is worth a warning
SAG_NONE = 1e-6  # share below which it is none, as where a leg hangs straight
SAG_APART = 0.2  # share by which linear and full statics may differ without a word


def of(mechanism: Mechanism, links: tuple[LinkCheck, ...], rest: Statics) -> tuple[str, ...]:
    """Warnings about freedoms, masses, sag and parts of the URDF that are not used."""
    description = mechanism.description
    return (
        *_freedom_warnings(mechanism),
        *_off_axis(mechanism),
        *(text for link in links for text in _link_warnings(link)),
        *(text for p in mechanism.parts.values() for text in _carries_nothing(mechanism, p)),
        *_sag_warnings(rest, links),
        *heavy(mechanism.links),
        *check_urdf.ignored(description),
        *description.notes,
        *check_urdf.beyond_limits(
            description, mechanism, rest.holding_full or rest.holding_linear or rest.holding_rigid
        ),
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
            f"({percent(link.mass_difference, sign='+')})"
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
    number = next(k for k, link in enumerate(mechanism.links) if link.name == part.link)
    ends = mechanism.description.tied
    sections = {
        link.name: part.length if link.name in ends else part.section_of(link.placement.translation)
        for link in mechanism.links
        if link.parent == number and (link.steps or link.weighs or link.name in ends)
    }
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
    if far and links and max(far) > SAG_FAR * longest:  # of elastic joints alone: not judged
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
    count = f"{plural(motors, 'motor')} for {report.mobility} degrees of freedom"
    warnings = []
    if motors < report.mobility:
        warnings.append(
            f"{count}: underactuated. Only the "
            "level coupled (or drive: torque) lets the rest swing; the other levels need a motor "
            "for each degree of freedom."
        )
    if motors > report.mobility:
        fight = mechanism.description.motion and default_motion(mechanism).target == "joints"
        advice = " Their motions must agree; prescribe the platform's motion instead."
        warnings.append(sharing(mechanism) + advice * bool(fight))
    if mechanism.description.loops:
        crossed = axis_hint(Equations(mechanism.rigid), mechanism.description.loops, mechanism.home)
        warnings += [crossed.strip()] if crossed else []
    warnings += [report.built_in] if report.gaps else []
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
