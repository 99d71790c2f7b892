"""A commented YAML for a robot's file, which loads as it is: `pinflex import` and `pinflex new`."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from pinflex.advice.solve import solve
from pinflex.description import schema, sources
from pinflex.description.description import from_text
from pinflex.description.source import Source
from pinflex.errors import DescriptionError, PinflexError
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.studies.guesses import Guess, candidates, quoted
from pinflex.studies.home import home_values

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
