"""Check of a model: freedoms, loops, masses, planes, frequencies, warnings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Any

import numpy as np

from pinflex.actuation.drive import nominal
from pinflex.actuation.path import motor_axes
from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.blocks.joints import Friction
from pinflex.description.motions.motion import Motion
from pinflex.description.reading.schema import integer
from pinflex.errors import ConvergenceError, DescriptionError, SceneError, SingularityError
from pinflex.levels.modes import Modes, base_state, default_motion, first_modes, modes, rigid_body
from pinflex.levels.start import hangs
from pinflex.mechanics.assembly import LoopReport
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.mechanics.model.tree import sliding
from pinflex.report import Block, Listing, Report, Reported, Words, bullets, lines, table
from pinflex.results.quantities import joint_unit
from pinflex.solver.solve import too_late
from pinflex.studies.checking import doubts
from pinflex.studies.checking.parts import (
    DriveCheck,
    LinkCheck,
    LoopCheck,
    Sag,
    Statics,
    coupling_texts,
    drive_checks,
    link_check,
    loop_checks,
    statics,
    summary,
)
from pinflex.studies.scenes.home import home_values
from pinflex.text import angle, frozen, length, number, percent, plural
from pinflex.threads import one_blas_thread

_ALONG_MOTION = 101  # poses at which the motion is tried
_PRELOADED = "about the static equilibrium"
_UNDAMPED = 1e-9  # a damping ratio below is round-off
_MOVED = 0.05  # [rad | m] beyond the digits of a guess
_SHIFT = 0.01  # of a frequency by gravity and loads, above which both are reported


@frozen
class Check(Reported):
    """The report of `pinflex check`.

    Attributes:
        name, urdf, base: What was read. gravity: [m/s^2].
        joints: Velocity coordinates of the rigid tree. elastic: Elastic coordinates.
        report: Loops of the rigid mechanism: rows, rank, redundant rows, mobility, sigma_min.
        motors: Names. units: Of their torques.
        loops, links: One record each.
        platform: Frame, or None.
        elastic_joints: Coordinates with a spring that the rigid level holds.
        couplings: What follows what, as equations of positions.
        drives: Joints with a drive or with friction. urdf_dynamics: What is taken of the URDF's.
        idle: Freedoms that nothing hangs on, held where home has them.
        statics: Sag and holding torques.
        frequencies: [Hz]. frequency_note: Of which state. unloaded: Those without gravity and
            loads, where they differ. damping: Ratio [-] of each of these modes of the machine.
        motion: What the motion asks, and whether the rigid mechanism can follow it.
        warnings: Sentences.
        summaries: Modal summary of each solid body, as text.
        by_joint: Links of the frames that the YAML names by their joint.
        payload: What is carried, and where.
        moved: Where joints stand at home that closing the loops moved from the guess [rad | m].
    """

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
    couplings: tuple[str, ...] = field(default=())
    idle: tuple[str, ...] = field(default=())
    warnings: tuple[str, ...] = field(default=())
    summaries: tuple[str, ...] = field(default=())
    by_joint: Mapping[str, str] = field(default_factory=dict)
    drives: tuple[DriveCheck, ...] = field(default=())
    urdf_dynamics: str = ""
    unloaded: tuple[float, ...] = ()
    damping: tuple[float, ...] = ()
    payload: str = ""
    moved: Mapping[str, float] = field(default_factory=dict)

    def as_report(self) -> Report:
        """Everything, with its tables."""
        blocks = (_head, _loops, _drives, _links, _inertia, _planes)
        return Report(f"{self.name}: check", (
            *(block(self) for block in blocks),
            *map(Words, self.summaries),
            _statics(self),
            _holding(self),
            _frequencies(self),
            bullets(self.warnings, "Warnings") or "Warnings: none",
        ))  # fmt: skip


@public
@takes_model
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
    first, note = _first_modes(mechanism, count)
    frequencies = () if first is None else tuple(float(f) for f in first.frequencies)
    unloaded = _unloaded(mechanism, count, frequencies) if _PRELOADED in note else ()
    motion, motion_warning = _motion(mechanism)
    links = tuple(link_check(mechanism, part) for part in mechanism.parts.values())
    warnings = (*doubts.of(mechanism, links, rest), *motion_warning)
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
        loops=loop_checks(mechanism),
        links=links,
        platform=description.platform,
        by_joint=dict(description.by_joint),
        statics=rest,
        frequencies=frequencies,
        frequency_note=note,
        damping=() if first is None else damping_ratios(mechanism, first),
        motion=motion,
        elastic_joints=mechanism.elastic_joints,
        couplings=coupling_texts(mechanism),
        idle=mechanism.idle.names,
        warnings=warnings,
        summaries=_summaries(mechanism),
        drives=drive_checks(mechanism),
        urdf_dynamics=doubts.used(description),
        unloaded=unloaded,
        payload=str(description.payload or ""),
        moved=_moved(mechanism),
    )


def _moved(mechanism: Mechanism) -> dict[str, float]:
    """Joints of one freedom that closing the loops moved from their guess, and where they stand."""
    guess, found = mechanism.description.home, {}
    for name, at in home_values(mechanism).items() if mechanism.description.loops else ():
        before = guess.get(name, 0.0)
        if isinstance(at, float) and isinstance(before, int | float):
            way = abs(at - before)
            turns = name not in sliding(mechanism.rigid.rigid)
            if (min(way, abs(way - 2 * math.pi)) if turns else way) > _MOVED:
                found[name] = at
    return found


def is_loaded(mechanism: Mechanism) -> bool:
    """True if gravity, a spring, a load or a frame spring acts on the mechanism at rest.

    One that pushes no free coordinate counts too: thrust along a beam changes its frequencies.
    """
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


def require_vibrating(mechanism: Mechanism) -> None:
    """Refuse a mechanism in which nothing is elastic."""
    if not _vibrates(mechanism):
        raise DescriptionError(
            f"{mechanism.name}: no flexible link and no spring, so nothing vibrates. Write some "
            "under `flexible`."
        )


def _vibrates(mechanism: Mechanism) -> bool:
    system, tied = mechanism.flexible, mechanism.description.springs
    if system.n_eta or len(system.springs.v_at):
        return True
    loose = mechanism.report.mobility > len(mechanism.motors)
    return loose and (bool(tied) or hangs(mechanism))


def first_frequencies(mechanism: Mechanism, count: int) -> tuple[tuple[float, ...], str]:
    """Natural frequencies [Hz] at home with locked motors, and the words for that state.

    Where gravity leaves no equilibrium, those of the undeformed pose.
    """
    first, note = _first_modes(mechanism, count)
    return () if first is None else tuple(float(f) for f in first.frequencies), note


def damping_ratios(mechanism: Mechanism, found: Modes) -> tuple[float, ...]:
    """Damping ratio [-] of each mode of the machine, of all dampers; 0 where it does not vibrate.

    That of a link clamped at its root is another: a joint or a mass at its end takes part in the
    motion and has none.
    """
    dynamics, still = Equations(mechanism.flexible), np.zeros(mechanism.flexible.nv)
    lam = np.zeros(mechanism.flexible.closed.n)
    C = dynamics.tangent(found.y, still, still, lam, 0.0).C
    lost = np.einsum("ik,ij,jk->k", found.shapes, C, found.shapes)
    omega = 2.0 * np.pi * found.frequencies
    ratios = lost / np.where(omega > 0, 2.0 * omega, np.inf)
    return tuple(np.where(np.abs(ratios) > _UNDAMPED, ratios, 0.0).tolist())


def _first_modes(mechanism: Mechanism, count: int) -> tuple[Modes | None, str]:
    """The first modes that have a stiffness, and the words for their state."""
    if not _vibrates(mechanism):
        return None, "no flexible link and no spring: nothing vibrates"
    locked = "at home, motors locked" if mechanism.motors else "at home"
    locked += f", base {base}" if (base := base_state(mechanism)) else ""
    loaded, every = is_loaded(mechanism), mechanism.flexible.nv
    try:
        found = modes(mechanism, count=every, preload="gravity" if loaded else "none")
        note = f"{locked}, {_PRELOADED if loaded else 'no load'}"
    except ConvergenceError:
        found = modes(mechanism, count=every, preload="none")
        note = f"{locked}, about the undeformed pose: gravity and loads leave no equilibrium"
    first = first_modes(found, count)
    zeros = rigid_body(first)
    if first.growth is not None and np.max(first.growth, initial=0.0) > 0:
        rate = float(np.max(first.growth))
        note += f"; UNSTABLE: loads that follow make modes flutter, by {rate:.2g} 1/s undamped"
    return first, f"{note}; {zeros}" if zeros else note


def _unloaded(mechanism: Mechanism, count: int, loaded: tuple[float, ...]) -> tuple[float, ...]:
    """Frequencies [Hz] without gravity and loads, where one differs by more than a per cent."""
    try:
        every = modes(mechanism, count=mechanism.flexible.nv, preload="none")
    except SingularityError:
        return ()
    found = tuple(float(f) for f in first_modes(every, count).frequencies)
    pairs = zip(found, loaded, strict=False)
    return found if any(abs(a - b) > _SHIFT * abs(b) for a, b in pairs) else ()


def _units(mechanism: Mechanism) -> tuple[str, ...]:
    slides = sliding(mechanism.rigid.rigid)
    return tuple(joint_unit("torque", name in slides) for name in mechanism.motors)


def _motion(mechanism: Mechanism) -> tuple[str, list[str]]:
    """The motion in words, and a warning where the rigid mechanism cannot follow it."""
    description = mechanism.description
    motion = default_motion(mechanism)
    end = description.solve.until or motion.duration
    late = too_late(description, end)
    if description.motion is None:
        return "none given: the motors hold home", late
    names = ", ".join(motion.names)
    moved = f" of the {motion.target} ({names})" if names else ""
    words = f"{motion.kind}{moved}, {motion.duration:g} s"
    words += f", run to {end:g} s" if end != motion.duration else ""
    if mechanism.report.mobility > len(mechanism.motors):
        return words, late
    try:
        path = nominal(mechanism, motion, np.linspace(0.0, end, _ALONG_MOTION))
    except SceneError as error:
        late += [f"motion: {error}"]
        if motion.target != "joints":
            return f"{words}: cannot be followed", late
        words += ": cannot be followed"
        p, v, _ = motion.evaluate(np.linspace(0.0, end, _ALONG_MOTION))
        at = dict(zip(motion.names, p.T + _home_of(mechanism, motion)[:, None], strict=True))
        turning = dict(zip(motion.names, v.T, strict=True))
    else:
        words += ": the rigid mechanism can follow it"
        axes, motors = motor_axes(mechanism), description.actuated
        at = dict(zip(motors, np.transpose([axes.read(q) for q in path.q]), strict=True))
        turning = dict(zip(motors, path.v[:, axes.v_at].T, strict=True))
    beyond = doubts.beyond_on_the_way(description, at, turning)
    return words, [*late, *(f"motion: {x}" for x in beyond)]


def _home_of(mechanism: Mechanism, motion: Motion) -> Array:
    """Where displacements of joints begin; zero where a motion has positions."""
    home = motor_axes(mechanism).read(mechanism.home)
    at = [mechanism.description.actuated.index(name) for name in motion.names]
    return np.zeros(len(at)) if motion.absolute else home[at]


# The report of a check.

_PLANES = {"u": "axial", "v": "bending y", "w": "bending z", "p": "torsion"}
# sigma_min of a well-placed machine is 0.05 to 0.5; below this a motor must push hard
_NEAR = 0.01
_NOTHING = 1e-12  # a share that is round-off


def _head(c: Check) -> Block:
    """The model in a few rows, those with nothing to say left out."""
    motors = ", ".join(c.motors)
    return c.name, Listing({
        "URDF": f"{c.urdf}, base {c.base}",
        "gravity": "[" + ", ".join(f"{g:g}" for g in c.gravity) + "] m/s^2",
        "mobility": _mobility(c),
        "motors": f"{plural(len(c.motors), 'motor')} ({motors})" if motors else "none",
        "elastic": _elastic(c),
        "coupled": "; ".join(c.couplings),
        "dynamics": c.urdf_dynamics,
        "idle": f"{', '.join(c.idle)}: nothing hangs on it, held at home" if c.idle else "",
        "platform": c.platform or "none named: no deviation can be reported",
        "payload": c.payload,
        "motion": c.motion,
        "frames": _renamed(c.by_joint),
    }, 10)  # fmt: skip


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
    text = f"{plural(c.elastic, 'coordinate')} in {plural(len(c.links), 'flexible link')}"
    text += f" and {plural(gears, 'elastic drive')}" if gears else ""
    return text + (f"; joints {', '.join(c.elastic_joints)}" if c.elastic_joints else "")


def _renamed(by_joint: Mapping[str, str]) -> str:
    """Frames that the YAML names by the joint that carries them."""
    if not by_joint:
        return ""
    named = ", ".join(f"{joint} (link {link})" for joint, link in by_joint.items())
    return f"named by the joint that carries them: {named}"


def _loops(c: Check) -> Block:
    if not c.loops:
        return "Loops: none"
    home = (
        f"home: found by a search ({plural(c.report.starts, 'start')}), as the loops are far "
        "from closed at the values given, zero for the others. "
        if c.report.starts
        else "home: closing the loops moved joints from the values given, zero for the others. "
    )
    stand = [f"{name} {x:.3g}" for name, x in c.moved.items()]
    home += f"They stand at {doubts.listed(stand)}. " if stand else ""
    home += (
        "There may be other closed poses, such as elbows to the other side: `home` chooses. "
        "`pinflex check MODEL --write-home` writes this one into the YAML"
    )
    sigma = c.report.sigma_min
    state = "close to a singular pose" if sigma < _NEAR else "well away from a singular pose"
    return (
        table(
            "Loops", c.loops, ("loop", "name"), "kind",
            ("between", lambda x: " - ".join(x.between)), "rows",
            ("redundant", lambda x: len(x.redundant)), names=(18, 12, 44),
        ),
        Words("\n".join([
            f"{c.report.rows} rows, rank {c.report.rank}",
            *(f"redundant: {row}" for row in c.report.redundant),
        ])),
        lines(home if c.report.starts or c.moved else "", indent="    ", first=""),
        "" if math.isnan(sigma)
        else f"sigma_min {number(sigma)} at home (0 is singular, below {_NEAR:g} near it): {state}",
    )  # fmt: skip


def _drives(c: Check) -> Block:
    """Drives and friction, with what is left out of them."""
    if not c.drives:
        return ""
    loose = [x.name for x in c.drives if x.drive is not None and x.drive.backlash]
    play = f"the backlash of {', '.join(loose)} acts at level coupled" if loose else ""
    said = f"rotors turn about their own axes only (Spong), and {play or 'there is no backlash'}"
    speeds = {x.friction.speed for x in c.drives if x.friction is not None and x.friction.dry}
    if speeds:
        shown = ", ".join(f"{v:g}" for v in sorted(speeds))
        said += f"; dry friction is smooth below {shown} rad/s or m/s, at which a joint creeps"

    def drive(key: str, elastic: bool = False) -> Callable[[DriveCheck], Any]:
        def of(x: DriveCheck) -> Any:
            rigid = x.drive is None or (elastic and x.drive.stiffness is None)
            return None if rigid else getattr(x.drive, key)

        return of

    return table(
        "Drives and friction, at the joint [N m, rad | N, m]", c.drives, ("joint", "name"),
        ("gear", drive("gear")), ("inertia", "armature"), ("stiffness", drive("stiffness", True)),
        ("damping", drive("damping", True)), ("dry", lambda x: _dry(x.friction)),
        ("viscous", lambda x: None if x.friction is None else x.friction.viscous),
        ("efficiency", drive("efficiency"), lambda x: "-" if x is None else f"{100 * x:g} %"),
        names=(24,),
    ), lines(said, indent="    ", first="  ")  # fmt: skip


def _dry(f: Friction | None) -> str:
    if f is None:
        return "-"
    rest = f" ({number(f.breakaway)} at rest)" if f.breakaway > f.coulomb else ""
    return number(f.coulomb) + rest


def _links(c: Check) -> Block:
    def signed(share: float | None) -> str:
        return percent(share, sign="+")

    return table(
        "Flexible links: elastic coordinates; beam and what rides on it, against the URDF",
        c.links, ("link", "name"), "section", "material", ("L [mm]", "length"),
        ("elastic", "coordinates"), ("kg", lambda x: x.mass + x.end_masses),
        ("URDF [kg]", "urdf_mass"), ("mass", "mass_difference", signed),
        ("inertia", "inertia_difference", signed), names=(16, 24, 14),
    )  # fmt: skip


def _inertia(c: Check) -> Block:
    """Distribution of the URDF's inertia; links with the same text are named together."""
    groups: dict[str, list[str]] = {}
    for link in c.links:
        if link.share is not None:
            groups.setdefault(_carried(link), []).append(link.name)
    texts = (f"{', '.join(names)}: {text}" for text, names in groups.items())
    listed = lines(*texts, indent="    ", first="  ")
    return ("Mass, centre and inertia of the URDF are kept", listed) if groups else ""


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
    there: dict[str, float] = {}  # a tip mass and a remainder may ride on the same end
    for x, kg in riders:
        at = "at the root" if x == 0 else f"at {length(x)}" if x < link.length else "at the tip"
        there[at] = there.get(at, 0.0) + kg
    places = [f"{number(kg)} kg {at}" for at, kg in there.items()]
    return f"{text}; the rest, motors and covers, rides rigidly: {', '.join(places)}"


def _planes(c: Check) -> Block:
    """Links that share their planes, the reason and what is left out are named together."""
    groups: dict[tuple[tuple[str, ...], str, str], list[LinkCheck]] = {}
    for link in c.links:
        out = "".join(x.direction for x in link.left_out)
        groups.setdefault((link.planes, link.reason, out), []).append(link)
    listed: list[Block] = ["Planes chosen"] if groups else []
    for (planes, reason, out), links in groups.items():
        names, active = ", ".join(x.name for x in links), ", ".join(_PLANES[p] for p in planes)
        listed.append(lines(f"{names}: {active} ({reason})", indent="    ", first="  "))
        texts = (_left_out(links, direction) for direction in out)
        listed.append(lines(*texts, indent="      ", first="    "))
    return listed


def _left_out(links: Sequence[LinkCheck], direction: str) -> str:
    every = (x for link in links for x in link.left_out if x.direction == direction)
    most = max(every, key=lambda x: x.share)
    share, of = f"at most {most.share:.0e}", f" ({most.of})"
    if most.share <= _NOTHING:
        share, of = "nothing", ""
    words = f"{_PLANES[direction]} left out: {share} of compliance, sag, torques"
    return f"{words} and inertia loads{of}"


def _statics(c: Check) -> Block:
    s = c.statics
    sags = [_sag("linear", s.linear, s.linear_reason, c.platform),
            _sag("full", s.full, s.full_reason, c.platform)]  # fmt: skip
    if s.linear_reason == s.full_reason and s.linear_reason:
        sags = [f"platform sag  none: {s.linear_reason}"]
    head = f"At rest at home{', motors locked' if c.motors else ''}"
    return head, lines(*sags, indent=" " * 16, first="  ")


def _sag(kind: str, sag: Sag | None, reason: str, platform: str | None) -> str:
    start = f"sag, {kind:<9}"
    if sag is None:
        return start + (f"none: {reason}" if reason else "found, but no platform is named")
    move, turn = (math.sqrt(sum(x * x for x in v)) for v in (sag.position, sag.rotation))
    where = ", ".join(f"{axis} {length(x)}" for axis, x in zip("xyz", sag.position, strict=True))
    turned = angle(turn) if turn else "no rotation"
    return f"{start}{platform}: {length(move)} ({where}), {turned}"


def _holding(c: Check) -> Block:
    s = c.statics
    sets = {"rigid": s.holding_rigid, "linear": s.holding_linear, "full": s.holding_full}
    known = {name: torques for name, torques in sets.items() if torques is not None}
    if not c.motors or not known:
        return ""
    columns = [
        (name, lambda k, torques=torques: torques[k], "{:.5g}".format)
        for name, torques in known.items()
    ]
    name = ("holding torque", lambda k: f"{c.motors[k]} [{c.units[k]}]")
    motors = range(len(c.motors))
    return table("Holding torques", motors, name, *columns, names=(28,))


def _frequencies(c: Check) -> Block:
    if not c.frequencies:
        return f"Natural frequencies: none, {c.frequency_note}"

    def row(values: Sequence[float], what: str = "") -> str:
        return "  " + "  ".join(map(number, values)) + f"   {what}" * bool(what)

    rows = [f"Natural frequencies [Hz], {c.frequency_note}", row(c.frequencies)]
    if any(c.damping):
        rows.append(row(c.damping, "damping ratio of the machine's own modes"))
    if c.unloaded:
        rows.append(row(c.unloaded, "without gravity and loads (modes --preload none)"))
    return Words("\n".join(rows))
