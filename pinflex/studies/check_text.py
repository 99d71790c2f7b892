"""The check report as text for people."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from pinflex.description.drives import Friction
from pinflex.studies.check import Check
from pinflex.studies.check_parts import DriveCheck, LinkCheck
from pinflex.studies.check_statics import Sag, Statics
from pinflex.text import (
    angle,
    bullets,
    length,
    number,
    paragraph,
    percent,
    plural,
    report,
    table,
)

_PLANES = {"u": "axial", "v": "bending y", "w": "bending z", "p": "torsion"}
# sigma_min of a well-placed machine is 0.05 to 0.5; below this a motor must push hard
_NEAR = 0.01
_NOTHING = 1e-12  # a share that is round-off


def write(c: Check) -> str:
    """Aligned plain text of at most 100 columns."""
    return report(
        _head(c),
        _loop_table(c),
        _drive_table(c),
        _link_table(c),
        _inertia(c),
        _planes(c),
        *c.summaries,
        _statics(c),
        _frequencies(c),
        f"Warnings\n{bullets(c.warnings)}" if c.warnings else "Warnings: none",
    )


def _head(c: Check) -> str:
    """The model in a few rows, those with nothing to say left out."""
    names = ", ".join(c.motors)
    rows = {
        "URDF": f"{c.urdf}, base {c.base}",
        "gravity": "[" + ", ".join(f"{g:g}" for g in c.gravity) + "] m/s^2",
        "mobility": _mobility(c),
        "motors": f"{plural(len(c.motors), 'motor')} ({names})" if names else "none",
        "elastic": _elastic(c),
        "coupled": "; ".join(c.couplings),
        "dynamics": c.urdf_dynamics,
        "idle": f"{', '.join(c.idle)}: nothing hangs on it, held at home" if c.idle else "",
        "platform": c.platform or "none named: no deviation can be reported",
        "motion": c.motion,
        "frames": _renamed(c.by_joint),
    }
    lines = [paragraph(text, " " * 12, f"  {name:<10}") for name, text in rows.items() if text]
    return "\n".join([c.name, *lines])


def _mobility(c: Check) -> str:
    """Mobility as the difference that it is: coordinates less all that holds or follows."""
    r, elastic = c.report, len(c.elastic_joints)
    rank = r.rank if c.loops else 0
    idle = c.joints - rank - elastic - r.coupled - r.mobility
    held = (
        (bool(c.loops), plural(rank, "independent closure row")),
        (elastic, plural(elastic, "elastic joint")),
        (r.coupled, f"{r.coupled} coupled"),
        (idle, f"{idle} idle"),
    )
    terms = [plural(c.joints, "joint coordinate"), *(text for some, text in held if some)]
    return f"{r.mobility} = {' - '.join(terms)}{'' if c.loops else ', no loops'}"


def _elastic(c: Check) -> str:
    """Elastic coordinates and where they are."""
    gears = sum(x.drive is not None and x.drive.stiffness is not None for x in c.drives)
    text = f"{c.elastic} coordinates in {plural(len(c.links), 'flexible link')}"
    text += f" and {plural(gears, 'elastic drive')}" if gears else ""
    return text + (f"; joints {', '.join(c.elastic_joints)}" if c.elastic_joints else "")


def _renamed(by_joint: Mapping[str, str]) -> str:
    """Frames that the YAML names by the joint that carries them."""
    if not by_joint:
        return ""
    named = ", ".join(f"{joint} (link {link})" for joint, link in by_joint.items())
    return f"named by the joint that carries them: {named}"


def _loop_table(c: Check) -> str:
    if not c.loops:
        return "Loops: none"
    rows = [
        [x.name, x.kind, f"{x.between[0]} - {x.between[1]}", str(x.rows), str(len(x.redundant))]
        for x in c.loops
    ]
    text = table("Loops", "loop|kind|between|rows|redundant", rows, (18, 12, 44))
    lines = [text, f"{c.report.rows} rows, rank {c.report.rank}"]
    lines += [f"redundant: {row}" for row in c.report.redundant]
    if c.report.starts:
        words = (
            f"home: found by a search ({plural(c.report.starts, 'start')}), as the loops are far "
            "from closed at the values given, zero for the others. `pinflex check MODEL "
            "--write-home` keeps it in the YAML"
        )
        lines.append(paragraph(words, "    ", ""))
    sigma = c.report.sigma_min
    if not math.isnan(sigma):
        state = "close to a singular pose" if sigma < _NEAR else "well away from a singular pose"
        lines.append(f"sigma_min {number(sigma)} at home (0 is singular, 1 is best): {state}")
    return "\n".join(lines)


def _drive_table(c: Check) -> str:
    """Drives and friction, with what is left out of them."""
    if not c.drives:
        return ""
    text = table(
        "Drives and friction, at the joint [N m, rad | N, m]",
        "joint|gear|inertia|stiffness|damping|dry|viscous|efficiency",
        [_drive_row(x) for x in c.drives],
        (24,),
    )
    said = ["rotors turn about their own axes only (Spong), and there is no backlash"]
    speeds = {x.friction.speed for x in c.drives if x.friction is not None and x.friction.dry}
    if speeds:
        shown = ", ".join(f"{v:g}" for v in sorted(speeds))
        said.append(f"dry friction is smooth below {shown} rad/s or m/s, at which a joint creeps")
    return "\n".join([text, paragraph("; ".join(said), "    ", "  ")])


def _drive_row(x: DriveCheck) -> list[str]:
    d, f = x.drive, x.friction
    row = [x.name, "-" if d is None else number(d.gear), number(x.armature)]
    gives = d is not None and d.stiffness is not None
    row += [number(d.stiffness), number(d.damping)] if d is not None and gives else ["-", "-"]
    row += ["-", "-"] if f is None else [_dry(f), number(f.viscous)]
    return [*row, "-" if d is None else f"{100 * d.efficiency:g} %"]


def _dry(f: Friction) -> str:
    if f.breakaway > f.coulomb:
        return f"{number(f.coulomb)} ({number(f.breakaway)} at rest)"
    return number(f.coulomb)


def _link_table(c: Check) -> str:
    rows = []
    for x in c.links:
        off = (x.mass_difference, x.inertia_difference)
        rows.append([x.name, x.section, x.material, number(1e3 * x.length), str(x.coordinates)])
        rows[-1] += [number(x.mass + x.end_masses), number(x.urdf_mass)]
        rows[-1] += [percent(d, sign="+") for d in off]
    return table(
        "Flexible links: elastic coordinates; beam and what rides on it, against the URDF",
        "link|section|material|L [mm]|elastic|kg|URDF [kg]|mass|inertia",
        rows,
        (16, 24, 14),
    )


def _inertia(c: Check) -> str:
    """Distribution of the URDF's inertia; links with the same text are named together."""
    groups: dict[str, list[str]] = {}
    for link in c.links:
        if link.share is not None:
            groups.setdefault(_carried(link), []).append(link.name)
    lines = [
        paragraph(f"{', '.join(names)}: {text}", "    ", "  ") for text, names in groups.items()
    ]
    return "\n".join(["Mass, centre and inertia of the URDF are kept", *lines]) if lines else ""


def _carried(link: LinkCheck) -> str:
    text = f"the beam carries {100 * link.mass / link.urdf_mass:.3g} % of the link's mass"
    if link.share is not None and link.share < 1 - 1e-6:
        density = f"{100 * link.share:.3g} % of its density"
        text += (
            f" ({density}: a heavier beam would exceed the link's moment of inertia in the URDF)"
        )
    riders = [(x, kg) for x, kg in link.riders if kg > 1e-6 * link.urdf_mass]
    if not riders:
        return text
    places = []
    for x, kg in riders:
        at = "at the root" if x == 0 else f"at {length(x)}" if x < link.length else "at the tip"
        places.append(f"{number(kg)} kg {at}")
    return f"{text}; the rest, motors and covers, rides rigidly: {', '.join(places)}"


def _planes(c: Check) -> str:
    """Links that share their planes, the reason and what is left out are named together."""
    groups: dict[tuple[tuple[str, ...], str, str], list[LinkCheck]] = {}
    for link in c.links:
        out = "".join(x.direction for x in link.left_out)
        groups.setdefault((link.planes, link.reason, out), []).append(link)
    lines = []
    for (planes, reason, out), links in groups.items():
        names, active = ", ".join(x.name for x in links), ", ".join(_PLANES[p] for p in planes)
        lines.append(paragraph(f"{names}: {active} ({reason})", "    ", "  "))
        lines += [paragraph(_left_out(links, direction), "      ", "    ") for direction in out]
    return "\n".join(["Planes chosen", *lines]) if lines else ""


def _left_out(links: Sequence[LinkCheck], direction: str) -> str:
    every = (x for link in links for x in link.left_out if x.direction == direction)
    most = max(every, key=lambda x: x.share)
    share, of = f"{most.share:.0e}", f" ({most.of})"
    if most.share <= _NOTHING:
        share, of = "nothing", ""
    words = f"{_PLANES[direction]} left out: at most {share} of compliance, sag, torques"
    return f"{words} and inertia loads{of}"


def _statics(c: Check) -> str:
    s = c.statics
    lines = [
        paragraph(_sag("linear", s.linear, s.linear_reason, c.platform), "                ", "  "),
        paragraph(_sag("full", s.full, s.full_reason, c.platform), "                ", "  "),
    ]
    if s.linear_reason == s.full_reason and s.linear_reason:
        lines = [f"  platform sag  none: {s.linear_reason}"]
    head = f"At rest at home{', motors locked' if c.motors else ''}"
    return "\n".join([head, *lines, *filter(None, [_holding(c, s)])])


def _sag(kind: str, sag: Sag | None, reason: str, platform: str | None) -> str:
    start = f"sag, {kind:<9}"
    if sag is None:
        return start + (f"none: {reason}" if reason else "found, but no platform is named")
    move, turn = (math.sqrt(sum(x * x for x in v)) for v in (sag.position, sag.rotation))
    where = ", ".join(f"{axis} {length(x)}" for axis, x in zip("xyz", sag.position, strict=True))
    turned = angle(turn) if turn else "no rotation"
    return f"{start}{platform}: {length(move)} ({where}), {turned}"


def _holding(c: Check, s: Statics) -> str:
    sets = [("rigid", s.holding_rigid), ("linear", s.holding_linear), ("full", s.holding_full)]
    known = [(name, values) for name, values in sets if values is not None]
    if not c.motors or not known:
        return ""
    rows = [
        [f"{motor} [{unit}]", *(f"{values[k]:.5g}" for _, values in known)]
        for k, (motor, unit) in enumerate(zip(c.motors, c.units, strict=True))
    ]
    header = "|".join(["holding torque", *(name for name, _ in known)])
    return "\n" + table("Holding torques", header, rows, (28,))


def _frequencies(c: Check) -> str:
    if not c.frequencies:
        return f"Natural frequencies: none, {c.frequency_note}"
    values = "  ".join(number(f) for f in c.frequencies)
    text = f"Natural frequencies [Hz], {c.frequency_note}\n  {values}"
    if any(c.damping):
        ratios = "  ".join(number(zeta) for zeta in c.damping)
        text += f"\n  {ratios}   damping ratio of the machine's own modes"
    if not c.unloaded:
        return text
    plain = "  ".join(number(f) for f in c.unloaded)
    return f"{text}\n  {plain}   without gravity and loads (modes --preload none)"
