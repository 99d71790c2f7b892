"""Warnings of `pinflex check`, one sentence or two each."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pinflex.actuation.path import motor_axes
from pinflex.arrays import Array
from pinflex.description.description import Description
from pinflex.description.files import Source
from pinflex.description.robots.urdf import Limits, limits
from pinflex.errors import SceneError
from pinflex.levels.modes import default_motion, first_modes, modes
from pinflex.levels.quasistatic import rest
from pinflex.levels.rigid import sharing
from pinflex.linalg import null_space
from pinflex.mechanics.closing import axis_hint
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian, frame_pose
from pinflex.mechanics.freedoms import INDEPENDENT
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.mechanics.model.parts import FlexiblePart, heavy
from pinflex.mechanics.model.tree import Link, poses_of, sliding
from pinflex.results.quantities import SLIDING
from pinflex.studies.checking.parts import LinkCheck, Statics, rigid_holding
from pinflex.studies.scenes.home import home_values
from pinflex.studies.scenes.proposals import cut_open
from pinflex.text import number, percent, plural

# What a model takes of a URDF's dynamics, what it does not, and limits that it exceeds.

_SOME = 6  # names listed before "..."
_MUCH = 0.1  # of a link's mass: what rides between its ends may matter
_COMPARED, _PRICE = 3, 0.02  # first frequencies; by how much one moves to be worth a warning
_PARTS = 1e-6  # of the rows, for ends that part: motions are orthonormal to 1e-12
_NEARLY = 1e-3  # of a limit or of the way: a motion made for a limit, and what vibrates about it


def ignored(description: Description) -> list[str]:
    """Sentences on entries of the URDF that have no effect."""
    tree = description.tree()
    geared = [
        f"{name} {joint.reduction:g}"
        for name, joint in tree.joints.items()
        if abs(joint.reduction or 1.0) != 1.0 and not _driven(description, name)
    ]
    leaders = {name: joint.mimic[0] for name, joint in tree.joints.items() if joint.mimic}
    notes = {
        **_unused_rubbing(tree, description.use_urdf_dynamics),
        "gear ratios of the URDF's transmissions are not used ({}): they count where "
        "joints.NAME.drive says what the motor is.": geared,
        "mimic in the URDF names joints that are not there ({}): these joints move by themselves. "
        "Write joints.NAME.follows in the YAML if they should not.": [
            name for name, leader in leaders.items() if leader not in tree.joints
        ],
    }
    return [text.format(listed(names)) for text, names in notes.items() if names]


def _unused_rubbing(tree: Source, dynamics: bool) -> dict[str, list[str]]:
    """Sentences on damping and friction without effect, with the joints that they are about."""
    moving = {key: _moving(tree, key) for key in ("damping", "friction")}
    if not dynamics:
        text = "{} in the URDF is not used ({{}}): use_urdf_dynamics is false."
        return {text.format(key): names for key, names in moving.items()}
    several = [
        name
        for names in moving.values()
        for name in names
        if tree.joints[name].type in ("floating", "planar")
    ]
    text = "damping and friction in the URDF are not used in joints of several freedoms ({})."
    return {text: several}


def used(description: Description) -> str:
    """Joints whose damping and friction are the URDF's, in words; "" for none."""
    if not description.use_urdf_dynamics:
        return ""
    tree = description.tree()
    parts = []
    for key in ("damping", "friction"):
        names = [name for name in _moving(tree, key) if _as_written(description, tree, name, key)]
        if names:
            parts.append(f"{key} of the URDF ({listed(names)})")
    if not parts:
        return ""
    return f"{' and '.join(parts)}; `use_urdf_dynamics: false` leaves them out"


def _moving(tree: Source, key: str) -> list[str]:
    """Joints with damping or friction of one freedom or more."""
    moving = (joint for joint in tree.joints.values() if joint.type != "fixed")
    return [joint.name for joint in moving if getattr(joint, key)]


def _as_written(description: Description, tree: Source, name: str, key: str) -> bool:
    """Whether a joint has what the URDF says of it, and not what the YAML says."""
    extra = description.joints.get(name)
    if extra is None:
        return False
    rubs = 0.0 if extra.friction is None else extra.friction.coulomb
    return bool((extra.damper if key == "damping" else rubs) == getattr(tree.joints[name], key))


def _driven(description: Description, name: str) -> bool:
    extra = description.joints.get(name)
    return extra is not None and extra.drive is not None


def beyond_limits(
    description: Description, mechanism: Mechanism, holding: tuple[float, ...] | None
) -> list[str]:
    """Motors whose home position or holding torque is beyond the URDF's limits."""
    known = limits(description.urdf_text)
    at_home = motor_axes(mechanism).read(mechanism.home)
    found = []
    for k, name in enumerate(description.actuated):
        limit = known.get(name, Limits())
        lower, upper = limit.lower, limit.upper
        if lower < upper and not lower - 1e-9 <= at_home[k] <= upper + 1e-9:
            at = f"{at_home[k]:.4g} {_unit(description, name, 'rad')}"
            found.append(f"{name}: home {at} is outside the URDF's limits {lower:g} to {upper:g}.")
        effort = limit.effort
        if holding is not None and 0 < effort < abs(holding[k]):
            found.append(
                f"{name}: holding needs {abs(holding[k]):.4g} "
                f"{_unit(description, name, 'N m')}, more than the URDF's effort limit {effort:g}."
            )
    return found


_DEGREES = " Degrees? Write 90 deg, or head a column of a trajectory NAME [deg]."


def beyond_on_the_way(
    description: Description,
    position: Mapping[str, Array],
    speed: Mapping[str, Array],
    torque: Mapping[str, Array] | None = None,
) -> list[str]:
    """Motors that a motion, by their histories, takes beyond the URDF's limits."""
    known, found = limits(description.urdf_text), []
    for name in position:
        limit, low, high = known.get(name, Limits()), position[name].min(), position[name].max()
        slack = _NEARLY * max(high - low, 1e-300)
        if limit.lower < limit.upper and not (
            limit.lower - slack <= low and high <= limit.upper + slack
        ):
            off = low if limit.lower - low > high - limit.upper else high
            found.append(
                f"{name} gets to {off:.4g} {_unit(description, name, 'rad')}, outside the URDF's "
                f"limits {limit.lower:g} to {limit.upper:g}."
                + (_DEGREES if abs(off) > _TURN and limit.upper < _TURNS[0] else "")
            )
        for word, histories, allowed, turning in (
            ("a speed", speed, limit.velocity, "rad/s"),
            ("an effort", torque or {}, limit.effort, "N m"),
        ):
            top = float(np.max(np.abs(histories.get(name, 0.0))))
            if 0 < allowed * (1 + _NEARLY) < top:
                found.append(
                    f"{name} takes {word} of up to {top:.4g} "
                    f"{_unit(description, name, turning)}, more than the URDF's {allowed:g}."
                )
    return found


def _unit(description: Description, name: str, turning: str) -> str:
    """Unit at a joint, of which one that turns is given."""
    joint = description.tree().joints.get(name)
    slides = joint is not None and joint.type == "prismatic"
    return SLIDING.get(turning, turning) if slides else turning


def listed(names: list[str]) -> str:
    """The first names, and dots for more."""
    return ", ".join(names[:_SOME]) + (", ..." if len(names) > _SOME else "")


MASS_OFF = 0.01  # share of the URDF's mass beyond which a beam's mass is worth a warning
_OFF_AXIS = 1e-6  # of the largest holding torque: round-off of an axis written with ten digits
CENTRE_OFF = 0.05  # the same for its centre of mass, as a share of the span
SAG_FAR = 0.1  # share of the longest flexible link beyond which a sag is worth a warning
SAG_NONE = 1e-6  # share below which there is no sag, as of a leg that hangs straight
SAG_APART = 0.2  # share by which linear and full statics may differ without a word


def of(mechanism: Mechanism, links: tuple[LinkCheck, ...], rest: Statics) -> tuple[str, ...]:
    """Warnings about freedoms, masses, sag and parts of the URDF that are not used."""
    description = mechanism.description
    return (
        *_freedom_warnings(mechanism),
        *_cut_open(mechanism),
        *_loose_at_home(mechanism),
        *_loose_pins(mechanism),
        *_off_axis(mechanism),
        *(text for link in links for text in _link_warnings(link)),
        *_heavy_riders(mechanism, links),
        *(text for p in mechanism.parts.values() for text in _without_load(mechanism, p)),
        *_sag_warnings(rest, links, home_values(mechanism)),
        *_at_a_root(mechanism),
        *heavy(mechanism.links),
        *slips(mechanism),
        *ignored(description),
        *description.notes,
        *beyond_limits(
            description, mechanism, rest.holding_full or rest.holding_linear or rest.holding_rigid
        ),
    )


_TURN = 2 * np.pi + 1e-3  # rad: no origin is written with a larger angle,
_TURNS = 30.0, 720.0  # rad: and few motors have so wide a range; a wider one means any angle
_FAR = 3.0  # times the reach of the robot: a radius of gyration that no link of it has
_THIN = 10.0  # kg/m^3: lighter than foam


def slips(mechanism: Mechanism) -> list[str]:
    """Values that are allowed, and mostly a slip of sign or unit, or something forgotten."""
    description, links, found = mechanism.description, mechanism.links, []
    gx, gy, gz = description.gravity
    if gz > max(abs(gx), abs(gy)):
        found.append(
            f"gravity: {gz:g} m/s^2 along +z, so that the robot falls upward. Write [0, 0, "
            f"{-gz:g}], unless z of the world points down."
        )
    root = ET.fromstring(description.urdf_text.strip())
    known, angles = limits(description.urdf_text), []
    turning = {*mechanism.motors} - sliding(mechanism.rigid.rigid)
    for joint in root.findall("joint"):
        name, origin = joint.get("name", ""), joint.find("origin")
        turned = [] if origin is None else (origin.get("rpy") or "").split()
        one = known.get(name, Limits())
        most = max(abs(one.lower), abs(one.upper)) if name in turning else 0.0
        wide = _TURNS[0] < most <= _TURNS[1]
        if wide or any(abs(float(x)) > _TURN for x in turned):
            angles.append(f"{name} ({'limits' if wide else 'rpy'})")
    if angles:
        found.append(f"angles that look like degrees: {listed(angles)}. A URDF has radians.")
    carried = [k for k, link in enumerate(links) if link.weighs or link.name in mechanism.parts]
    bare = [
        f"{link.name} (moved by {link.joint})"
        for k, link in enumerate(links)
        if link.joint in mechanism.motors and not any(_rides(links, x, k) for x in carried)
    ]
    if bare:
        found.append(f"no mass: {listed(bare)}. Is an <inertial> missing in the URDF?")
    reach = max(float(np.linalg.norm(pose.translation)) for pose in poses_of(links))
    spread = [
        f"{link.name} {radius:.3g} m"
        for link in links
        if link.inertia.mass > 0
        and (radius := np.sqrt(np.abs(link.inertia.inertia).max() / link.inertia.mass))
        > _FAR * reach
        > 0
    ]
    if spread:
        found.append(
            f"radii of gyration beyond the whole robot ({reach:.3g} m): {listed(spread)}. Moments "
            "of inertia are in kg m^2."
        )
    thin = [p.link for p in mechanism.parts.values() if 0 < (p.spec.material.rho or 0.0) < _THIN]
    if thin:
        found.append(f"rho below {_THIN:g} kg/m^3: {listed(thin)}. Steel has 7850 kg/m^3.")
    return found


def _rides(links: Sequence[Link], number: int, on: int) -> bool:
    """Whether a link is another one or fixed to it."""
    while number != on and number >= 0 and not links[number].steps:
        number = links[number].parent
    return number == on


def _link_warnings(link: LinkCheck) -> list[str]:
    """The beam's inertia takes the place of the URDF's."""
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


def _heavy_riders(mechanism: Mechanism, links: tuple[LinkCheck, ...]) -> list[str]:
    """Links heavier than their beams, by what the first frequencies are if all mass is spread."""
    heavier = [
        link.name for link in links
        if link.share is not None and link.share >= 1
        and max((kg for x, kg in link.riders if 0 < x < link.length), default=0.0)
        > _MUCH * link.urdf_mass
    ]  # fmt: skip
    if not heavier:
        return []
    flexible = tuple(
        replace(spec, material=replace(spec.material, rho=None)) if spec.link in heavier else spec
        for spec in mechanism.description.flexible
    )
    try:
        spread = load(replace(mechanism.description, flexible=flexible))
        both = [
            first_modes(modes(one, count=one.flexible.nv, preload="none"), _COMPARED).frequencies
            for one in (mechanism, spread)
        ]
    except (SceneError, np.linalg.LinAlgError):
        return []  # which is said elsewhere
    now, then = both
    if len(now) != len(then) or np.all(np.abs(then / now - 1) < _PRICE):
        return []
    moved = [
        f"{percent(x, sign='+')} ({number(b)} Hz)"
        for x, b in zip(then / now - 1, then, strict=True)
    ]
    return [
        f"{listed(heavier)}: heavier than the beam, and the rest rides in one or two places, as "
        "motors do. If it is spread along the link, frequencies without load change by "
        f"{', '.join(moved)}: write material: {{like: ..., rho: urdf}}, which spreads it as far "
        "as its moments of inertia let it."
    ]


def _without_load(mechanism: Mechanism, part: FlexiblePart) -> list[str]:
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


def _at_a_root(mechanism: Mechanism) -> list[str]:
    """The platform is a flexible link, whose frame is its root."""
    name = mechanism.description.platform or ""
    part = mechanism.parts.get(name)
    if part is None or part.bodies[0].root_moves:
        return []
    end = part.spec.end
    behind = "the link behind it, or a massless link there" if end is None else end
    return [
        f"platform: {name} is the frame at the root of that flexible link, and does not move as "
        f"the link bends: name what sits at its far end ({behind})."
    ]


def _sag_warnings(
    rest: Statics, links: tuple[LinkCheck, ...], home: Mapping[str, Any]
) -> list[str]:
    """The platform sags far, or so far that linear statics are off."""
    linear, full, loaded = (
        None if sag is None else np.array(sag.position)
        for sag in (rest.linear, rest.full, rest.loaded)
    )
    far = [float(np.linalg.norm(sag)) for sag in (linear, full) if sag is not None]
    sinks = far[-1] if far else 0.0  # of linear statics, which overshoot, only where none is full
    turned = {name: x for name, x in rest.spring_moves.items() if abs(x) > SAG_FAR}
    longest = max((link.length for link in links), default=0.0)
    found = []
    if links and sinks > SAG_FAR * longest and turned:
        at = listed([f"{name}: {x + home.get(name, 0.0):.3g}" for name, x in turned.items()])
        found.append(
            f"home is not where it comes to rest: its springs let the platform go {sinks:.3g} m, "
            f"where joints stand at {at}. If it is to begin there, write these under home."
        )
    elif links and sinks > SAG_FAR * longest:  # of elastic joints alone: not judged
        found.append(
            f"the platform sags by {sinks:.3g} m, more than a tenth of the longest flexible "
            f"link ({longest:.3g} m): look for a slip of units, a joint that gives way, or a link "
            "that is too soft."
        )
    if linear is None or full is None or max(far) <= SAG_NONE * longest:
        return found
    apart, less = (
        np.inf if sag is None else float(np.linalg.norm(sag - full)) for sag in (linear, loaded)
    )
    if apart > SAG_APART * max(far):
        why = "deflections are not small, so level ked is off as well. Trust coupled."
        if less <= SAG_APART * max(far):
            why = (
                "weight and loads bring stiffness (they pull links straight, or hold what hangs "
                "upright), which linear statics lack; levels ked and coupled have it."
            )
        found.append(
            f"linear statics give a sag of {far[0]:.3g} m, the full equilibrium {far[1]:.3g} m, "
            f"{apart:.3g} m apart: {why}"
        )
    return found


def _cut_open(mechanism: Mechanism) -> list[str]:
    """Proposal for open ends that coincide at home."""
    loops = cut_open(mechanism)
    if not loops:
        return []
    return [
        "open ends coincide at home, as where a loop is cut open: each branch moves by itself. If "
        f"they meet in joints, write `{loops}`, and their motors under `actuated`; `pinflex new` "
        "proposes both."
    ]


def _loose_at_home(mechanism: Mechanism) -> list[str]:
    """Pins, gears and cables that bear no force at home under gravity and lasting loads."""
    system = mechanism.standing
    if not system.kinks.rows or mechanism.report.mobility > len(mechanism.motors):
        return []
    from pinflex.levels.settled import loose_directions, slack

    dynamics = Equations(system, marched=True)
    try:
        found = rest(mechanism, dynamics=dynamics)
    except SceneError:
        return []  # which is said elsewhere
    names = slack(dynamics, found.y)
    if not names:
        return []
    free = loose_directions(dynamics, found, system.free, 0.0)
    more = (
        f" Nothing holds it in {plural(free, 'direction')} there, in which it stays in the middle."
        if free
        else ""
    )
    return [f"loose at home under what acts there: {listed(list(names))} bear no force.{more}"]


def _loose_pins(mechanism: Mechanism) -> list[str]:
    """Loops of the kind planar whose ends, motors locked, can part along the axis of the pin."""
    look, y = Equations(mechanism.flexible), mechanism.undeformed()
    system, frames = look.system, look.system.expansion.frames
    pins = [
        loop for loop in mechanism.description.loops
        if loop.kind == "planar" and loop.clearance is None and not loop.grounded
    ]  # fmt: skip
    if not pins:
        return []
    N = null_space(look.close(y).J[:, system.free], INDEPENDENT)
    parting = []
    for pin in pins:
        a, b = frames[pin.frame_a], frames[pin.frame_b]
        axis = frame_pose(look, y, a).rotation @ pin.axis
        apart = axis @ (frame_jacobian(look, y, b) - frame_jacobian(look, y, a))[:3, system.free]
        if np.linalg.norm(apart @ N) > _PARTS * np.linalg.norm(apart):
            parting.append(pin.name)
    if not parting:
        return []
    return [
        f"{listed(parting)}: a pin of the kind planar holds nothing along its axis, and its ends "
        "can part where links bend or hang loose. Write kind: revolute if the joint holds that, "
        "cylindrical if it slides but keeps the axes in line."
    ]


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
    warnings += filter(None, [report.built_in])
    every = dict.fromkeys((*report.redundant, *mechanism.flexible_report.redundant))
    if every:
        flexible = mechanism.flexible_report.redundant
        kind = "" if set(every) == set(flexible) else f" ({len(flexible)} in the flexible model)"
        warnings.append(
            f"{plural(len(every), 'dependent closure row')} left out{kind}: {', '.join(every)}. "
            "The motion is exact; reactions in these directions are not unique."
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
