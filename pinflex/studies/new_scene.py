"""A commented YAML for a robot's file, which loads as it is: `pinflex import` and `pinflex new`."""

from __future__ import annotations

import json
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from pinflex.advice.solve import solve
from pinflex.arrays import Array
from pinflex.description import sources
from pinflex.description.blocks.flexible import FlexibleLink
from pinflex.description.blocks.home_text import with_home
from pinflex.description.blocks.material import MATERIALS
from pinflex.description.description import from_text, read
from pinflex.description.files import Source
from pinflex.description.reading import schema
from pinflex.description.section import Section
from pinflex.errors import DescriptionError, PinflexError
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.mechanics.model.planes import beam_frame
from pinflex.mechanics.model.tree import Link
from pinflex.results.drawing import drawing_of, urdf_parts
from pinflex.viewer.surfaces import Surface, surfaces_of
from pinflex.writing import replaced

# Guesses of flexible links for a robot that nobody prepared: which links, and their sections.
#
# A section is guessed from what the link looks like across the middle of its span; a wall is not to
# be seen, so that it is a tenth of the diameter. Every guess is to be replaced.

_ALIKE = 0.2  # share by which two widths may differ and be those of a tube
_SLENDER = 1 / 3  # of the span: the widest that a section is guessed
_THIN = 1 / 20  # of the span: a diameter where nothing is drawn
_WALL = 0.1  # of the diameter
_MIDDLE = (0.3, 0.7)  # part of the span that is looked at
_SHORT = 0.1  # of the longest span: shorter links are no candidates
_MOST = 8  # candidates
_HERE = 1e-6  # m
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
            made = _guess(mechanism, name, end, length, _widths(looks.get(name), frame, length))
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
    """Frames on a link that carry something: name, place in the link, whether it is a joint."""
    found = []
    for link in links:
        place, above = link.placement, link.parent
        if not (link.steps or link.name in closing):
            continue
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


def _section(widths: tuple[float, float] | None, length: float) -> tuple[str, str]:
    """The block `section`, and where it is from."""
    if widths is None:
        d = _digits(_THIN * length)
        return _tube(d), "nothing is drawn there: a twentieth of the length"
    y, z = (min(w, _SLENDER * length) for w in widths)
    if abs(y - z) <= _ALIKE * max(y, z):
        return _tube(_digits((y + z) / 2)), "the width of the drawing at the middle of the span"
    text = f"{{shape: rectangle, width: {_digits(z)}, thickness: {_digits(y)}}}"
    return text, "the two widths of the drawing at the middle of the span, full"


def _tube(diameter: float) -> str:
    return f"{{shape: tube, diameter: {diameter}, wall: {_digits(_WALL * diameter)}}}"


def _digits(value: float) -> float:
    return float(f"{value:.3g}")


def _guess(
    mechanism: Mechanism, name: str, end: str | None, length: float,
    widths: tuple[float, float] | None,
) -> Guess | None:  # fmt: skip
    """The block of a link as the robot loads with it; None where it loads with none."""
    section, why = _section(widths, length)
    values = [f"end: {quoted(end)}"] if end is not None else []
    values += ["material: aluminium", f"section: {section}"]
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


# The closed pose of a mechanism as the block `home` of its YAML, and writing it there.

_PACKAGE = Path(__file__).resolve().parents[1]
_ZERO = 5e-10  # [rad | m] a value that is not written: joints stand at zero anyway


def home_values(mechanism: Mechanism) -> dict[str, float | list[float]]:
    """Value of each joint at home, as `home` takes it; joints at zero are left out."""
    model, q = mechanism.rigid.rigid, mechanism.home
    found: dict[str, float | list[float]] = {}
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        part = q[joint.idx_q : joint.idx_q + joint.nq]
        if joint.nv == 1 and joint.nq == 2:  # a continuous joint: cosine and sine
            part = np.array([np.arctan2(part[1], part[0])])
        elif joint.nv == 3 and joint.nq == 4 and joint.shortname() == "JointModelPlanar":
            part = np.array([*part[:2], np.arctan2(part[3], part[2])])
        values = [float(f"{x:.9g}") for x in part]
        stem = name.rpartition(".")[0]
        if stem and mechanism.description.joints.get(stem) is not None:
            both = found.setdefault(stem, [])  # NAME.1 and NAME.2 are the axes of a universal joint
            assert isinstance(both, list)
            both.append(values[0])
            continue
        found[name] = values[0] if joint.nv == 1 else values
    neutral = pin.neutral(model)
    return {
        name: value
        for name, value in found.items()
        if {name, f"{name}.1"} & {*mechanism.description.home}
        or not _at_rest(model, neutral, name, value)
    }


def _at_rest(model: pin.Model, neutral: Array, name: str, value: float | list[float]) -> bool:
    if model.existJointName(name):
        joint = model.joints[model.getJointId(name)]
        if joint.nq > 2 and joint.shortname() != "JointModelPlanar":
            rest = neutral[joint.idx_q : joint.idx_q + joint.nq]
            return bool(np.max(np.abs(rest - value)) < _ZERO)
    return bool(np.max(np.abs(value)) < _ZERO)


def write_home(mechanism: Mechanism) -> Path:
    """Write the closed pose into the YAML that the mechanism was read from, and return its path.

    Comments and all other lines stay; the file is replaced in one step, so that it is never half
    written.

    Raises:
        DescriptionError: There is no such file, it came with pinflex, or it cannot be written.
    """
    path = mechanism.description.path
    if path is None:
        raise DescriptionError(f"{mechanism.name}: home: read from no file. Write the block there.")
    path = path.resolve()
    if path.is_relative_to(_PACKAGE) or "site-packages" in path.parts:
        raise DescriptionError(
            f"{mechanism.name}: home: this model came with an installed package, and the next "
            "update would undo the change. Copy its folder and give the copy."
        )
    raw = path.read_bytes()
    # what the robot's file says joins the YAML's own text, so both are read
    if read(path).yaml_text != mechanism.description.yaml_text:
        raise DescriptionError(
            f"{path.name}: home: the model is not that of the file (an override, or the file has "
            "changed since), and its pose may not fit. Write the changes into the file first."
        )
    mark = b"\xef\xbb\xbf" if raw.startswith(b"\xef\xbb\xbf") else b""
    text = with_home(raw[len(mark) :].decode("utf-8"), home_values(mechanism), path.name)
    with replaced(path) as part:
        part.write_bytes(mark + text.encode("utf-8"))
    return path


_PACKAGES = "example-robot-data:"
_ONE = ("revolute", "continuous", "prismatic")
_STEP = {"prismatic": 0.005}  # [m] of the motion that is proposed; turning joints:
_TURN = 0.1  # [rad]
_SHARES = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02)  # of it, the largest that can be followed
_LOOKS = 41  # instants at which it is looked at
_NEAR = 1e-6  # [m | rad] frames that coincide
_TOOL = re.compile(r"platform|tool|effector|eff$|tcp|flange|gripper|foot|hand", re.I)
_ORDER = ("base", "gravity", "joints", "actuated", "loops", "home")


def new_scene(source: str, out: Path, flexible: Sequence[str] = ()) -> tuple[str, Mechanism | None]:
    """The YAML text for a robot, and the mechanism; None where its loops do not close."""
    name = source if source.startswith(_PACKAGES) else _relative(Path(source), out)
    tree = sources.find(name, out.parent, "import")
    for link in flexible:
        schema.known(link, source, tree.links, f"link in {tree.file}")
    blocks = tree.joined({})
    if "actuated" not in blocks:
        blocks |= _motors(tree, closed=bool(blocks.get("loops")))
    plain = yaml.safe_dump({"urdf": name, **blocks}, sort_keys=False)
    description = from_text(plain, out)
    try:
        mechanism = load(description)
    except PinflexError as error:
        return _text(tree, name, blocks, [], [str(error)], flexible), None
    home = home_values(mechanism)
    if home:  # the guesses need not search for it again
        blocks["home"] = home
        plain = yaml.safe_dump({"urdf": name, **blocks}, sort_keys=False)
        mechanism = load(from_text(plain, out))
    guesses = candidates(mechanism, tuple(flexible))
    missing = sorted({*flexible} - {guess.link for guess in guesses})
    if missing:
        raise DescriptionError(
            f"{source}: {', '.join(missing)}: no beam fits there (no span, or no mass). Choose "
            f"another link: {', '.join(g.link for g in candidates(mechanism)) or 'there is none'}."
        )
    blocks["platform"] = _platform(mechanism)
    text = _text(tree, name, blocks, guesses, _proposals(mechanism), flexible)
    whole = text + _motion(text, out, mechanism)
    load(from_text(whole, out))  # it loads as it is
    return whole, mechanism


def _relative(path: Path, out: Path) -> str:
    if not path.is_file():
        raise DescriptionError(f"{path}: no such file. Give a URDF, MJCF, SDF or xacro.")
    return Path(os.path.relpath(path.resolve(), out.resolve().parent)).as_posix()


def _motors(tree: Source, closed: bool) -> dict[str, Any]:
    """Motors by the transmissions of a URDF, or by name where loops are closed."""
    root = ET.fromstring(tree.text.strip())
    single = [j.name for j in tree.joints.values() if j.type in _ONE and j.mimic is None]
    found = [
        joint.get("name", "")
        for way in root.findall("transmission")
        for joint in way.findall("joint")
    ]
    found = [name for name in dict.fromkeys(found) if name in single]
    if not found and closed:
        found = [name for name in single if re.search("mot|act", name, re.I)]
    return {"actuated": found} if found or closed else {}


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
    lines += _wrapped("", remarks)
    if not flexible:
        lines += [
            "",
            "# Links that may bend, longest first. Sections are GUESSES from the drawing, the",
        ]
        lines += ["# material too: replace them, take the links that matter, remove the #."]
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
        "home": "the closed pose from which everything starts",
        "platform": "GUESS: the frame whose motion matters",
    }.get(key)
    return ["", *([f"# {comment}"] if comment else []), *text.rstrip().splitlines()]


# Proposals ---------------------------------------------------------------------------------


def _proposals(mechanism: Mechanism) -> list[str]:
    """Loops that the file does not close, where ends of branches coincide at home."""
    pairs = coinciding(mechanism, mechanism.description.tied)
    return [
        f"{a} and {b} coincide at home. If they meet in a joint: loops: {{{a}_{b}: {{kind: "
        f"{kind}, between: [{a}, {b}]}}}}, and list the motors under actuated."
        for a, b, kind in pairs
    ]


def _platform(mechanism: Mechanism) -> str:
    """A link whose name sounds like the end of a robot, else one with the most joints below it."""
    links = mechanism.links
    depth: list[int] = []
    for link in links:
        above = depth[link.parent] if link.parent >= 0 else 0
        depth.append(above + len(link.steps))
    heavy = [k for k, link in enumerate(links) if link.weighs] or [0]
    named = [k for k in range(len(links)) if _TOOL.search(links[k].name) and depth[k]]
    best = [k for k in named if links[k].weighs] or named or heavy
    return links[max(best, key=lambda k: depth[k])].name


def coinciding(mechanism: Mechanism, taken: Collection[str]) -> list[tuple[str, str, str]]:
    """Pairs of massless ends of different branches that coincide at home, and the kind to try."""
    model, links = mechanism.rigid.rigid, mechanism.links
    parents = {link.parent for link in links}
    leaves = [
        k for k, link in enumerate(links)
        if k not in parents and link.parent >= 0 and not link.weighs and link.name not in taken
        and model.existFrame(link.name)
    ]  # fmt: skip
    data = model.createData()
    pin.framesForwardKinematics(model, data, mechanism.home)
    poses = {k: data.oMf[model.getFrameId(links[k].name)] for k in leaves}
    joints = {k: model.frames[model.getFrameId(links[k].name)].parentJoint for k in leaves}
    found = []
    for n, a in enumerate(leaves):
        for b in leaves[n + 1 :]:
            apart = poses[a].actInv(poses[b])
            if joints[a] == joints[b] or np.linalg.norm(apart.translation) > _NEAR:
                continue
            alike = np.linalg.norm(pin.log3(apart.rotation)) < _NEAR
            found.append((links[a].name, links[b].name, "weld" if alike else "spherical"))
    return found


def _motion(text: str, out: Path, mechanism: Mechanism) -> str:
    """A small motion of the first motor, as far as the rigid robot follows it."""
    motors = mechanism.description.actuated
    if not motors or mechanism.report.mobility != len(mechanism.motors):
        return "\n# No motion is proposed: the motors do not determine it.\n"
    joint = motors[0]
    kind = ET.fromstring(mechanism.description.urdf_text.strip()).find(f".//joint[@name='{joint}']")
    step = _STEP.get(kind.get("type", "") if kind is not None else "", _TURN)
    for share in _SHARES:
        proposal = (
            "\n# A small motion to begin with.\nmotion: {kind: cycloid, joints: "
            f"{{{quoted(joint)}: {share * step:g}}}, duration: 0.5}}\n"
        )
        try:
            solve(load(from_text(text + proposal, out)), level="rigid", samples=_LOOKS)
        except PinflexError:
            continue
        return proposal
    return "\n# No motion is proposed: the rigid robot cannot follow a small one from here.\n"
