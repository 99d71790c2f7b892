"""A commented YAML for a robot's file, which loads as it is: `pinflex import` and `pinflex new`."""

from __future__ import annotations

import json
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping, Sequence
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
from pinflex.description.section import Section
from pinflex.errors import DescriptionError, PinflexError
from pinflex.mechanics.closing import limits_of
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.mechanics.model.planes import beam_frame
from pinflex.mechanics.model.tree import Link, model_of
from pinflex.results.drawing import drawing_of, urdf_parts
from pinflex.studies.scenes import proposals
from pinflex.studies.scenes.home import home_values
from pinflex.text import plural
from pinflex.viewer.surfaces import Surface, surfaces_of

# Guesses of flexible links for a robot that nobody prepared: which links, and their sections.
#
# A section is guessed from what the link looks like across the middle of its span, and from what it
# weighs: a solid bar of steel or aluminium where that is its mass, else a tube, whose wall is a
# tenth of the diameter, or less where the link is lighter. Every guess is to be replaced.

_ALIKE = 0.2  # share by which two widths may differ and be those of a tube
_SLENDER = 1 / 3  # of the span: the widest that a section is guessed
_THIN = 1 / 20  # of the span: a diameter where nothing is drawn
_WALL = 0.1  # of the diameter, at most
_CLOSE = 0.3  # share by which a link may weigh more or less than the solid bar that is drawn
_MIDDLE = (0.3, 0.7)  # part of the span that is looked at
_SHORT = 0.1  # of the longest span: shorter links are no candidates
_MOST = 12  # candidates
_HERE = 1e-6  # m
_DENSITIES = {name: MATERIALS[name].rho or np.nan for name in ("aluminium", "steel")}  # kg/m^3
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


def candidates(mechanism: Mechanism, only: tuple[str, ...] = ()) -> list[Guess]:
    """Links with mass and a span, longest first, each of which loads with its guess."""
    description = mechanism.description
    visuals = drawing_of({"drawing": urdf_parts(description.urdf_text)}).visuals
    looks, _ = surfaces_of(visuals, description.package_dirs)
    spans = _spans(mechanism)
    longest = max((length for _, length, _ in spans.values()), default=0.0)
    found: list[Guess] = []
    for name in sorted(spans, key=lambda link: -spans[link][1]):
        end, length, frame = spans[name]
        wanted = name in only if only else length > _SHORT * longest and len(found) < _MOST
        if wanted:
            widths = _widths(looks.get(name), frame, length)
            mass = next(link.inertia.mass for link in mechanism.links if link.name == name)
            made = _guess(mechanism, name, end, *_bar(widths, length, mass), length)
            found += [made] if made is not None else []
    return found


def _spans(mechanism: Mechanism) -> dict[str, tuple[str | None, float, Array]]:
    """Far frame (None: the only one), length and beam frame of each link with mass."""
    links = mechanism.links
    closing = {*mechanism.description.tied}
    found = {}
    for number, link in enumerate(links):
        ends = _ends(number, links, closing) if link.parent >= 0 and link.weighs else []
        far = max(ends, key=lambda end: float(np.linalg.norm(end[1])), default=None)
        if far is None or np.linalg.norm(far[1]) < _HERE:
            continue
        spec = FlexibleLink(link.name, MATERIALS["aluminium"], Section.circle(1.0))
        frame, length = beam_frame("", spec, link, np.zeros(3), far[1])
        name = None if len(ends) == 1 and far[2] else far[0]
        found[link.name] = (name, length, np.array(frame.homogeneous))
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


def _widths(look: Surface | None, frame: Array, length: float) -> tuple[float, float] | None:
    """Extent along beam y and z in the middle of the span [m]; None where nothing is drawn."""
    if look is None:
        return None
    points = (look.vertices - frame[:3, 3]) @ frame[:3, :3]
    corners = points[look.faces]  # a long triangle has no corner in the middle
    low, high = corners[..., 0].min(axis=1), corners[..., 0].max(axis=1)
    middle = (low < _MIDDLE[1] * length) & (high > _MIDDLE[0] * length)
    if not middle.any():
        return None
    seen = corners[middle].reshape(-1, 3)
    y, z = np.ptp(seen[:, 1]), np.ptp(seen[:, 2])
    return (float(y), float(z)) if min(y, z) > _SEEN * length else None


def _bar(widths: tuple[float, float] | None, length: float, mass: float) -> tuple[str, str]:
    """Material and section of a link as YAML, and where they are from."""
    if widths is None:
        return _tube(
            _THIN * length, length, mass
        ), "nothing is drawn there: a twentieth of the length"
    y, z = (min(w, _SLENDER * length) for w in widths)
    round_ = abs(y - z) <= _ALIKE * max(y, z)
    d = (y + z) / 2 if round_ else min(y, z)
    area = np.pi * d**2 / 4 if round_ else y * z
    seen = "the drawing at the middle of the span"
    for name, rho in _DENSITIES.items():
        if abs(mass / (rho * area * length) - 1) < _CLOSE:
            shape = (
                f"{{shape: circle, diameter: {_digits(d)}}}" if round_
                else f"{{shape: rectangle, width: {_digits(z)}, thickness: {_digits(y)}}}"
            )  # fmt: skip
            return f"material: {name}, section: {shape}", f"{seen}, full: it weighs as much"
    why = "the width" if round_ else "the lesser width"
    return _tube(d, length, mass), f"{why} of {seen}, hollow"


def _tube(diameter: float, length: float, mass: float) -> str:
    """A tube of aluminium that weighs no more than the link, motors and housings included."""
    area = mass / (_DENSITIES["aluminium"] * length)
    hole = diameter**2 - 4 * area / np.pi
    wall = min(_WALL * diameter, (diameter - np.sqrt(hole)) / 2 if hole > 0 else diameter)
    shape = f"{{shape: tube, diameter: {_digits(diameter)}, wall: {_digits(wall)}}}"
    return f"material: aluminium, section: {shape}"


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
    guesses = candidates(mechanism, tuple(flexible))
    missing = sorted({*flexible} - {guess.link for guess in guesses})
    if missing:
        raise DescriptionError(
            f"{source}: {', '.join(missing)}: no beam fits there (no span, or no mass). Choose "
            f"another link: {', '.join(g.link for g in candidates(mechanism)) or 'there is none'}."
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
    remarks = [*_wrapped("", said), *_open_loops(ways)]
    text = _text(tree, name, blocks, guesses, remarks, flexible)
    whole = text + _motion(text, out, mechanism, ways)
    load(from_text(whole, out))  # it loads as it is
    return whole, mechanism


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
        if not named:
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
    closed = ways.closed is not None and ways.closed.report.mobility == len(ways.motors)
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
    joint = motors[0]
    known = mechanism.description.tree().joints
    step = _STEP.get(known[joint].type, _TURN) if joint in known else _TURN
    for share in _SHARES:
        proposal = (
            "\n# A small motion to begin with.\nmotion: {kind: cycloid, joints: "
            f"{{{quoted(joint)}: {share * step:g}}}, duration: 0.5}}\n"
        )
        try:
            solve(load(from_text(text + proposal, out)), level="rigid", samples=_LOOKS)
            if closed:  # it is to run when the # are gone, too
                taken = re.sub(
                    r"^# (loops:|joints:|home:|actuated:|  .*# drawn)", r"\1", text, flags=re.M
                )
                solve(load(from_text(taken + proposal, out)), level="rigid", samples=_LOOKS)
        except PinflexError:
            continue
        return proposal
    return "\n# No motion is proposed: the rigid robot cannot follow a small one from here.\n"
