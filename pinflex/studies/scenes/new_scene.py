"""A commented YAML for a robot's file, which loads as it is: `pinflex import` and `pinflex new`."""

from __future__ import annotations

import json
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pinflex.advice.solve import solve
from pinflex.arrays import Array
from pinflex.description import sources
from pinflex.description.blocks.flexible import FlexibleLink
from pinflex.description.blocks.material import MATERIALS
from pinflex.description.description import from_text
from pinflex.description.files import Source
from pinflex.description.reading import schema
from pinflex.description.robots.urdf import Limits, limits
from pinflex.description.section import Section
from pinflex.errors import DescriptionError, PinflexError
from pinflex.mechanics.closing import limits_of
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.mechanics.model.planes import beam_frame
from pinflex.mechanics.model.tree import Link, model_of
from pinflex.results.drawing import drawing_of, urdf_parts
from pinflex.results.result import Result
from pinflex.studies.scenes import proposals
from pinflex.studies.scenes.home import home_values
from pinflex.text import plural
from pinflex.viewer.surfaces import Surface, surfaces_of

# Guesses of flexible links for a robot that nobody prepared: which links, and their sections.
#
# A section is guessed from what the link looks like across the middle of its span, and from what it
# weighs: a solid bar of steel or aluminium where that is its mass, else a tube or a box, whose wall
# is a tenth of the width, or less where the link is lighter. Every guess is to be replaced.

_ALIKE = 0.2  # share by which two widths may differ and be those of a tube
_WALL = 0.1  # of the diameter, at most
_CLOSE = 0.3  # share by which a link may weigh more or less than the solid bar that is drawn
_MIDDLE = (0.3, 0.7)  # part of the span that is looked at
_SHORT = 0.1  # of the longest span: shorter links are no candidates
_MOST = 12  # candidates
_HERE = 1e-6  # m
_DENSITIES = {name: MATERIALS[name].rho or np.nan for name in ("aluminium", "steel")}  # kg/m^3
Sides = tuple[float, float, bool]  # along beam y and z [m], and whether it is round
_CORNER = 1.2  # half widths from the middle to the furthest point: 1 of a circle, 1.41 of a box
_SLIM = 100  # lengths over sides of a bar: a thinner one is a slip, or a point mass
_DRAWN = "the drawing at the middle of the span"
_SEEN = 1e-3  # of the span: a drawing that is thinner says nothing


@dataclass(frozen=True)
class Guess:
    """A link that may bend.

    Attributes:
        link: Its name. length: Span [m].
        values: Its block under `flexible`, as YAML.
        why: Where the section is from.
    """

    link: str
    length: float
    values: str
    why: str


def candidates(mechanism: Mechanism, only: tuple[str, ...] = ()) -> tuple[list[Guess], list[str]]:
    """Links with mass and a span, longest first, each of which loads; what is not drawn of them."""
    description = mechanism.description
    visuals = drawing_of({"drawing": urdf_parts(description.urdf_text)}).visuals
    looks, notes = surfaces_of(visuals, description.package_dirs)
    spans = _spans(mechanism)
    longest = max((length for _, length, _ in spans.values()), default=0.0)
    found: list[Guess] = []
    for name in sorted(spans, key=lambda link: -spans[link][1]):
        end, length, frame = spans[name]
        wanted = name in only if only else length > _SHORT * longest and len(found) < _MOST
        if wanted:
            link = next(link for link in mechanism.links if link.name == name)
            sides, seen = _sides(link, looks.get(name), frame, length)
            if not only and (max(sides[:2]) > length or (name in looks and seen != _DRAWN)):
                continue  # a block or a plate, or drawn elsewhere than along its span
            bar = _bar(sides, length, link.inertia.mass, seen)
            made = _guess(mechanism, name, end, *bar, length)
            found += [made] if made is not None else []
    return found, [note.partition(";")[0] for note in notes if "not found" in note]


def _spans(mechanism: Mechanism) -> dict[str, tuple[str | None, float, Array]]:
    """Far frame (None: the only one), length and beam frame of each link with mass.

    None lies on another: a link ends where one that is bolted to it begins a span of its own.
    """
    links = mechanism.links
    closing = {*mechanism.description.tied}
    fars: dict[int, tuple[str | None, Array]] = {}
    for number, link in enumerate(links):
        ends = _ends(number, links, closing) if link.parent >= 0 and link.weighs else []
        far = max(ends, key=lambda end: float(np.linalg.norm(end[1])), default=None)
        if far is not None and np.linalg.norm(far[1]) >= _HERE:
            fars[number] = None if len(ends) == 1 and far[2] else far[0], far[1]
    reach = {k: float(np.linalg.norm(place)) for k, (_, place) in fars.items()}
    short = _SHORT * max(reach.values(), default=0.0)
    for k in [k for k in fars if not links[k].steps and reach[k] > short]:  # from base to tips
        below = links[k].parent
        while below >= 0 and below not in fars and not links[below].steps:
            below = links[below].parent
        if below not in fars or k not in fars:
            continue
        ((_, place, _),) = _on(below, links, [links[k]])
        if np.linalg.norm(place) > short:
            fars[below] = links[k].name, place
        else:  # side by side
            del fars[min(below, k, key=lambda x: links[x].inertia.mass)]
    found = {}
    for k, (name, place) in fars.items():
        spec = FlexibleLink(links[k].name, MATERIALS["aluminium"], Section.circle(1.0))
        frame, length = beam_frame("", spec, links[k], np.zeros(3), place)
        found[links[k].name] = (name, length, np.array(frame.homogeneous))
    return found


def _ends(number: int, links: Sequence[Link], closing: set[str]) -> list[tuple[str, Array, bool]]:
    """Frames on a link that carry something: name, place in the link, whether it is a joint.

    Where there are none, what is fixed to it and carries nothing either: the open end of a loop.
    """
    parents = {link.parent for link in links}
    bearing = [link for link in links if link.steps or link.name in closing]
    leaves = [link for k, link in enumerate(links) if k not in parents and not link.steps]
    ends = _on(number, links, leaves)
    alone = all(np.linalg.norm(end[1] - ends[0][1]) < _HERE for end in ends)  # no plate
    return _on(number, links, bearing) or (ends if alone else [])


def _on(number: int, links: Sequence[Link], ends: Sequence[Link]) -> list[tuple[str, Array, bool]]:
    """Those of some links that are fixed to one, or hang on it by a joint."""
    found = []
    for link in ends:
        place, above = link.placement, link.parent
        while above >= 0 and above != number and not links[above].steps:
            place, above = links[above].placement * place, links[above].parent
        if above == number:
            found.append((link.name, np.array(place.translation), bool(link.steps)))
    return found


def _sides(link: Link, look: Surface | None, frame: Array, length: float) -> tuple[Sides, str]:
    """How wide a link is, and where that is from."""
    if look is not None and (seen := _widths(look, frame, length)):
        return seen, _DRAWN
    if seen := _boxed(link, frame, length):
        return seen, "nothing is drawn there: its moments of inertia"
    area = link.inertia.mass / (_DENSITIES["aluminium"] * length)
    d = float(np.sqrt(area / (np.pi * _WALL * (1 - _WALL))))
    return (d, d, True), "nothing is drawn there: a tube that weighs as much"


def _boxed(link: Link, frame: Array, length: float) -> Sides | None:
    """Sides of the full bar with these moments of inertia.

    None where no bar of that length has them, as the ones written where nobody knew any.
    """
    about = frame[:3, :3].T @ link.inertia.inertia @ frame[:3, :3]
    x, y, z = 6 * np.diag(about) / link.inertia.mass
    sides = np.array([x + z - y, x + y - z])  # x = m (b^2 + c^2) / 12, and so on
    if not np.all((length / _SLIM) ** 2 < sides) or not np.all(sides < length**2):
        return None
    b, c = (float(side) for side in np.sqrt(sides))
    rod = float(2 * np.sqrt(x / 3))  # its diameter: x = 6 r^2 / 2
    return (b, c, False) if abs(b - c) > _ALIKE * max(b, c) else (rod, rod, True)


def _widths(look: Surface, frame: Array, length: float) -> Sides | None:
    """Extent in the middle of the span; None where nothing is drawn there."""
    points = (look.vertices - frame[:3, 3]) @ frame[:3, :3]
    corners = points[look.faces]  # a long triangle has no corner in the middle
    low, high = corners[..., 0].min(axis=1), corners[..., 0].max(axis=1)
    middle = (low < _MIDDLE[1] * length) & (high > _MIDDLE[0] * length)
    if not middle.any():
        return None
    seen = corners[middle].reshape(-1, 3)[:, 1:]
    sides = np.ptp(seen, axis=0)
    if min(sides) <= _SEEN * length:
        return None
    out = np.linalg.norm((2 * seen - seen.min(axis=0) - seen.max(axis=0)) / sides, axis=1).max()
    round_ = out < _CORNER and abs(sides[0] - sides[1]) <= _ALIKE * max(sides)
    return float(sides[0]), float(sides[1]), bool(round_)


def _bar(sides: Sides, length: float, mass: float, seen: str) -> tuple[str, str]:
    """Material and section of a link as YAML, and where they are from."""
    y, z = (min(side, length) for side in sides[:2])
    d = (y + z) / 2
    full = np.pi * d**2 / 4 if sides[2] else y * z
    for name, rho in _DENSITIES.items():
        if abs(mass / (rho * full * length) - 1) < _CLOSE:
            shape = (
                f"shape: circle, diameter: {_digits(d)}" if sides[2]
                else f"shape: rectangle, width: {_digits(z)}, thickness: {_digits(y)}"
            )  # fmt: skip
            return f"material: {name}, section: {{{shape}}}", f"{seen}, full: it weighs as much"
    # a tube or a box of aluminium that weighs no more than the link, motors and housings included
    area = mass / (_DENSITIES["aluminium"] * length)
    bore = d**2 - 4 * area / (np.pi if sides[2] else 4.0)  # area = pi (or 4) wall (d - wall)
    wall = min(_WALL * min(y, z), (d - np.sqrt(bore)) / 2 if bore > 0 else d)
    shape = (
        f"shape: tube, diameter: {_digits(d)}" if sides[2]
        else f"shape: box, width: {_digits(z)}, height: {_digits(y)}"
    )  # fmt: skip
    return f"material: aluminium, section: {{{shape}, wall: {_digits(wall)}}}", f"{seen}, hollow"


def _digits(value: float) -> float:
    return float(f"{value:.3g}")


def _guess(
    mechanism: Mechanism, name: str, end: str | None, bar: str, why: str, length: float
) -> Guess | None:
    """The block of a link as the robot loads with it; None where it loads with none."""
    values = [*([f"end: {quoted(end)}"] if end is not None else []), bar]
    for more in ([], ["inertia: beam"]):
        text = f"{{{', '.join([*values, *more])}}}"
        raw = yaml.safe_load(text)
        try:
            load(mechanism.description.with_overrides([f"flexible={json.dumps({name: raw})}"]))
        except PinflexError:
            continue
        return Guess(name, length, text, why)
    return None


def quoted(name: str) -> str:
    """A name as YAML takes it for a text."""
    return str(yaml.safe_dump(name, allow_unicode=True, width=10**6)).splitlines()[0]


_PACKAGES = "example-robot-data:"
_STEP = {"prismatic": 0.005}  # [m] of the motion that is proposed; turning joints:
_TURN = 0.1  # [rad]
_SHARES = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02)  # of it, the largest that can be followed
_SHORTEST = 0.5  # [s] that it takes, longer where a limit asks for it
_STRETCHES = (1, 2, 4, 8)  # times as long, until motors are strong enough
_LOOKS = 41  # instants at which it is looked at
_ORDER = ("xacro_args", "base", "gravity", "joints", "actuated", "loops", "home")


def new_scene(
    source: str,
    out: Path,
    flexible: Sequence[str] = (),
    arguments: Mapping[str, str] | None = None,
) -> tuple[str, Mechanism | None]:
    """The YAML text for a robot, and the mechanism; None where its loops do not close.

    `boundary` are those of a xacro.
    """
    name = source if source.startswith(_PACKAGES) else _relative(Path(source), out)
    tree = sources.find(name, out.parent, "import", arguments)
    for link in flexible:
        schema.known(link, source, tree.links, f"link in {tree.file}")
    blocks = tree.joined({"xacro_args": dict(arguments)} if arguments else {})
    if "actuated" not in blocks:
        blocks |= _motors(tree, closed=bool(blocks.get("loops")))
    try:
        mechanism = _loaded(name, blocks, out)
    except PinflexError as error:
        return _text(tree, name, blocks, [], _wrapped("", [str(error)]), flexible), None
    home = home_values(mechanism) | ({} if blocks.get("loops") else _within_limits(mechanism))
    if home:  # the guesses need not search for it again
        blocks["home"] = home
        mechanism = _loaded(name, blocks, out)
    guesses, missed = candidates(mechanism, tuple(flexible))
    missing = sorted({*flexible} - {guess.link for guess in guesses})
    if missing:
        others = ", ".join(guess.link for guess in candidates(mechanism)[0])
        raise DescriptionError(
            f"{source}: {', '.join(missing)}: no beam fits there (no span, or no mass). Choose "
            f"another link: {others or 'there is none'}."
        )
    ways = proposals.closing(mechanism, tree)
    if home and ways.home:
        blocks["home"], ways = dict(ways.home), replace(ways, home={})
        mechanism = _loaded(name, blocks, out)
    more = [] if ways.loops or blocks.get("loops") else _pushed(tree, blocks)
    if more:
        blocks["actuated"] += more
        mechanism = _loaded(name, blocks, out)
    blocks["platform"] = proposals.platform(mechanism, ways)
    guessed = f"actuated: GUESSES, by effort limits, not by a <transmission>: {', '.join(more)}"
    said = [guessed] if more else [] if "actuated" in blocks else _unlimited(tree)
    said += [f"{note}: sections of what it draws are from moments of inertia" for note in missed]
    remarks = [*_wrapped("", said), *_open_loops(ways)]
    text = _text(tree, name, blocks, guesses, remarks, flexible)
    whole = text + _motion(text, out, mechanism, ways)
    return whole, load(from_text(whole, out))  # it loads as it is


def _loaded(name: str, blocks: Mapping[str, Any], out: Path) -> Mechanism:
    return load(from_text(yaml.safe_dump({"urdf": name, **blocks}, sort_keys=False), out))


def _within_limits(mechanism: Mechanism) -> dict[str, float]:
    """The middle of the range of joints that stand outside it, as zero does on many arms."""
    model, q = mechanism.rigid.rigid, mechanism.home
    limits = limits_of(model_of(mechanism.description), model)
    lower, upper = limits.lower, limits.upper
    outside = (q < lower) | (q > upper)
    return {
        name: float(f"{(lower[joint.idx_q] + upper[joint.idx_q]) / 2:.3g}")
        for name, joint in zip(model.names[1:], model.joints[1:], strict=True)
        if joint.nq == 1 and outside[joint.idx_q]
    }


def _relative(path: Path, out: Path) -> str:
    if not path.is_file():
        raise DescriptionError(f"{path}: no such file. Give a URDF, MJCF, SDF or xacro.")
    return Path(os.path.relpath(path.resolve(), out.resolve().parent)).as_posix()


def _motors(tree: Source, closed: bool) -> dict[str, Any]:
    """Motors by the transmissions of a URDF, or by name where loops are closed."""
    root = ET.fromstring(tree.text.strip())
    single = [joint.name for joint in proposals.single(tree)]
    found = [
        joint.get("name", "")
        for way in root.findall("transmission")
        for joint in way.findall("joint")
    ]
    found = [name for name in dict.fromkeys(found) if name in single]
    if not found and closed:
        found = [name for name in single if proposals.MOTOR.search(name)]
    return {"actuated": found} if found or closed else {}


def _pushed(tree: Source, blocks: Mapping[str, Any]) -> list[str]:
    """Joints of an open tree with an effort limit, of which no transmission speaks."""
    if "actuated" not in blocks:  # then every joint is a motor
        return []
    return [name for name in proposals.limited(tree) if name not in blocks["actuated"]]


def _unlimited(tree: Source) -> list[str]:
    """What to write where joints without an effort limit have no motor, as most others do."""
    pushed = proposals.limited(tree)
    loose = [joint.name for joint in proposals.single(tree) if joint.name not in pushed]
    if not pushed or not loose:
        return []
    return [
        f"Every joint is a motor here. Without an effort limit: {', '.join(loose)}. If these are "
        f"passive, write actuated: [{', '.join(pushed)}]"
    ]


def _text(
    tree: Source,
    name: str,
    blocks: dict[str, Any],
    guesses: list[Guess],
    remarks: list[str],
    flexible: Collection[str],
) -> str:
    """The YAML up to the motion."""
    lines = ["# Written by `pinflex import`. What each key means: models/README.md."]
    lines += _wrapped("Not taken over from the file:", tree.notes)
    lines += ["", f"urdf: {quoted(name)}", "", *_joints(tree)]
    ordered = {key: blocks[key] for key in _ORDER if key in blocks} | blocks
    for key, value in ordered.items():
        lines += _block(key, value)
    lines += remarks
    if not flexible:
        lines += [
            "",
            "# Links that may bend, longest first. Sections are GUESSES from the drawing, the",
        ]
        lines += ["# material too: replace them, take the links that matter, remove the #."]
        if any("rectangle" in guess.values for guess in guesses):
            lines += ["# width: along the joint's axis; thickness: in the plane of its motion."]
    if guesses:
        lines += ["flexible:" if flexible else "# flexible:"]
    for guess in guesses:
        mark = "  " if flexible else "#   "
        lines += [f"{mark}# GUESS ({guess.length:.3g} m): {guess.why}"] if flexible else []
        tail = "" if flexible else f"  # {guess.length:.3g} m"
        lines += [f"{mark}{quoted(guess.link)}: {guess.values}{tail}"]
    return "\n".join(lines) + "\n"


def _wrapped(head: str, sentences: Sequence[str]) -> list[str]:
    if not sentences:
        return []
    flat = [" ".join(sentence.split()) for sentence in sentences]
    return [*([f"# {head}"] if head else [""]), *(f"# - {sentence}" for sentence in flat)]


def _joints(tree: Source) -> list[str]:
    """The joints that move, as a comment."""
    moving = [j for j in tree.joints.values() if j.type != "fixed"]
    lines = [f"# Joints that move ({len(moving)}):"] if moving else ["# No joint moves."]
    return lines + [f"#   {j.name}: {j.type}, {j.parent} -> {j.child}" for j in moving]


def _block(key: str, value: Any) -> list[str]:
    nested = isinstance(value, dict) and any(isinstance(v, dict) for v in value.values())
    flow: dict[str, Any] = {"default_flow_style": None if nested else False}
    text = yaml.safe_dump({key: value}, sort_keys=False, allow_unicode=True, width=96, **flow)
    if isinstance(value, list):
        text = f"{key}: {yaml.safe_dump(value, width=88, default_flow_style=True)}"
    comment = {
        "actuated": "joints with a motor; all others are passive",
        "loops": "joints that close loops",
        "home": "the pose from which everything starts: loops closed, joints within their limits",
        "platform": "GUESS: the frame whose motion matters",
    }.get(key)
    return ["", *([f"# {comment}"] if comment else []), *text.rstrip().splitlines()]


# Proposals ---------------------------------------------------------------------------------


def _open_loops(ways: proposals.Closing) -> list[str]:
    """The block `loops` of a file whose branches are open, behind #."""
    if not ways.loops:
        return []
    lines = [
        "",
        "# Ends that may meet, and motors: GUESSES. Keep what is right; remove the #.",
    ]
    lines += ["# loops:"]
    for loop in ways.loops:
        block = yaml.safe_dump(loop.block, sort_keys=False, default_flow_style=True, width=200)
        drawn = f"{loop.apart:.3g} m apart" if loop.apart > 1e-6 else "together"
        lines += [f"#   {quoted(loop.name)}: {block.strip()}  # drawn {drawn}"]
    if ways.types:
        retyped = ", ".join(f"{quoted(n)}: {{type: {kind}}}" for n, kind in ways.types.items())
        lines += [f"# joints: {{{retyped}}}  # guessed by name: URDF has no such type"]
    if ways.home:
        bent = ", ".join(f"{quoted(name)}: {value}" for name, value in ways.home.items())
        lines += [f"# home: {{{bent}}}  # GUESS: the pose drawn is singular"]
    motors = ", ".join(quoted(name) for name in ways.motors) or "..."
    if ways.closed is None:
        why = "they do not close from the pose drawn: give a guess under home"
    else:
        mobility, named = ways.closed.report.mobility, len(ways.motors)
        why = f"mobility {mobility} with these loops"
        why += f", as with axis {' or '.join(ways.also)}: look" if ways.also else ""
        if not mobility:
            why += ": a joint is of another type, such as a ball drawn as a hinge. Write joints: "
            why += "{NAME: {type: spherical}}"
        elif not named:
            alone = ways.closed.idle.names[len(ways.closed.idle.spins) :]
            why += f": name {plural(mobility, 'joint')} with a motor"
            why += f", and {' and '.join(alone)}, idle without one" if alone else ""
        elif mobility > named:
            why += ": a joint is of another type, or a motor is not named so"
        elif mobility < named:
            why += f", {named} motors: redundantly actuated, or some have no motor"
    return [*lines, f"# actuated: [{motors}]  # {why}"]


def _loose(mechanism: Mechanism) -> str:
    """Why the motors do not determine the motion, and what to write."""
    held = {*mechanism.motors, *mechanism.idle.names, "root_joint"}
    held |= {one.joint for one in mechanism.description.couplings}
    loose = [name for name in mechanism.rigid.rigid.names[1:] if name not in held]
    if mechanism.description.loops or not loose:
        return "the motors do not determine it."
    return (
        f"no motor moves {', '.join(loose)}. Add them to `actuated`, or lock them:\n"
        f"# joints: {{{', '.join(f'{quoted(n)}: {{type: fixed}}' for n in loose)}}}"
    )


def _motion(text: str, out: Path, mechanism: Mechanism, ways: proposals.Closing) -> str:
    """A small motion of the first motor, as far as the rigid robot follows it."""
    motors = ways.motors or mechanism.description.actuated
    closed = bool(ways.closed and len(ways.motors) == ways.closed.report.mobility > 0)
    if not motors:
        return "\n# No motion is proposed: no joint has a motor.\n"
    if mechanism.report.mobility != len(mechanism.motors):
        return f"\n# No motion is proposed: {_loose(mechanism)}\n"
    if ways.closed is not None and ways.closed.report.mobility < len(ways.motors):
        return (
            "\n# No motion is proposed: motors beyond the freedoms have to agree. Move the "
            f"platform, by\n# {ways.closed.report.mobility} of x, y, z [m], rz, ry, rx [rad]:"
            "\n# motion: {kind: cycloid, platform: {x: 0.01, ...}, duration: 0.5}\n"
        )
    joint, first, way = motors[0], "", 0.0
    for step, duration in _steps(mechanism, joint, ways.home):
        proposal = (
            "\n# A small motion to begin with.\nmotion: {kind: cycloid, joints: "
            f"{{{quoted(joint)}: {step:g}}}, duration: {duration:g}}}\n"
        )
        try:
            run = solve(load(from_text(text + proposal, out)), level="rigid", samples=_LOOKS)
            if closed:  # it is to run when the # are gone, too
                taken = re.sub(
                    r"^# (loops:|joints:|home:|actuated:|  .*# drawn)", r"\1", text, flags=re.M
                )
                run = solve(load(from_text(taken + proposal, out)), level="rigid", samples=_LOOKS)
        except PinflexError:
            continue
        if first and step != way:
            break  # a shorter way is none for a motor that hardly holds still
        first, way = first or proposal, step
        if _strong_enough(mechanism, run):
            return proposal
    none = "\n# No motion is proposed: the rigid robot cannot follow a small one from here.\n"
    return first or none


def _steps(
    mechanism: Mechanism, joint: str, bent: Mapping[str, Any]
) -> Iterator[tuple[float, float]]:
    """Ways of a motor within its limits, largest first, and how long a cycloid takes for each."""
    known = mechanism.description.tree().joints
    way = _STEP.get(known[joint].type, _TURN) if joint in known else _TURN
    at = bent.get(joint, home_values(mechanism).get(joint, 0.0))
    most = limits(mechanism.description.urdf_text).get(joint, Limits())
    for share in _SHARES:
        step = share * way
        if most.lower < most.upper and not at + step <= most.upper:
            step = -step
        if most.lower < most.upper and not most.lower <= at + step <= most.upper:
            continue
        speed, bend = 2 * abs(step), 2 * np.pi * abs(step)  # of a cycloid of 1 s, at their peaks
        least = [_SHORTEST]
        least += [speed / most.velocity] if most.velocity > 0 else []
        least += [np.sqrt(bend / most.acceleration)] if most.acceleration > 0 else []
        for stretch in _STRETCHES:
            yield step, stretch * float(np.ceil(10 * max(least)) / 10)


def _strong_enough(mechanism: Mechanism, run: Result) -> bool:
    """Whether half the efforts that motors have are enough; links that shake take the rest."""
    known = limits(mechanism.description.urdf_text)
    most = np.array([known.get(name, Limits()).effort or np.inf for name in run.motors])
    return bool(np.all(np.abs(run.torque).max(axis=0) <= most / 2))
