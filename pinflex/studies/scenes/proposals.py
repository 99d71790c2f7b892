"""What a robot's file leaves unsaid, proposed: which frame matters, which ends meet in a joint.

All of it is guessed from names, shapes and freedoms, and written so that it can be looked at.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from pinflex.arrays import Array
from pinflex.description.files import Source, SourceJoint
from pinflex.description.reading import yaml_text
from pinflex.description.robots.urdf import Limits, limits
from pinflex.errors import DescriptionError, PinflexError, SingularityError
from pinflex.linalg import null_space
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.mechanics.model.tree import Link

_NEAR = 1e-4  # [m] frames that coincide, but for the decimals of a file
_MOVES = 1e-6  # [m] two ends whose distance varies by less are held together already; a frame
# that moves by less for one radian or metre of a freedom stands still
_BENT, _LESS = 0.5, 0.8  # by which joints are bent out of a singular pose [rad | m]: by so much
# the first, each other one by so much of the last: in a pose of no symmetry
_LOOKS = 3  # poses at which that is looked at
_WORDS = (  # the end of a robot, surest name first
    re.compile(r"platform|(^|_)plate|tool|effector|tcp|flange", re.I),
    re.compile(r"eff$|(^|_)ee(_|$)", re.I),
    re.compile(r"gripper|hand|palm|wrist", re.I),
    re.compile(r"foot|feet|sole", re.I),
)
_TIP = re.compile(r"(^|_)(tip|nozzle|hook)(\d|_|$)", re.I)  # of a tree; of loops their ends
_FINGER = re.compile(
    r"finger|thumb|(^|_)(index|middle|ring|pinky|little|knuckle|jaw|ph)(\d|_|$)", re.I
)
_SENSOR = re.compile(r"camera|laser|imu|optical|sensor|rgb|depth|lidar|gnss|(^|_)head|eye", re.I)
MOTOR = re.compile("mot|act|drive(?!n)|servo", re.I)
_TYPES = {  # which URDF lacks, so that files draw another in their place
    "spherical": re.compile("ball|spher", re.I),
    "universal": re.compile("univ|cardan|u_?joint", re.I),
}


@dataclass(frozen=True)
class Loop:
    """Two ends that may meet in a joint.

    Attributes:
        a, b: Their frames. apart: Distance at home [m].
        kind: Of `loops`. axis: In frame a, "" where the kind has none.
    """

    a: str
    b: str
    apart: float
    kind: str = "spherical"
    axis: str = ""

    @property
    def block(self) -> dict[str, object]:
        """Its value under `loops`."""
        axis = {"axis": self.axis} if self.axis else {}
        return {"kind": self.kind, "between": [self.a, self.b], **axis}

    @property
    def name(self) -> str:
        """Its key under `loops`."""
        return f"{self.a}_{self.b}"


@dataclass(frozen=True)
class Closing:
    """Loops that a file leaves open, with the motors.

    Attributes:
        loops: What may meet. motors: Joints with a motor then; none: they are not to be guessed.
        closed: The mechanism with them; None where it does not close.
        types: Of joints that have another in the file. also: Axes of hinges that fit as well.
        home: Values that bend it out of the pose drawn, where that is singular.
    """

    loops: tuple[Loop, ...] = ()
    motors: tuple[str, ...] = ()
    closed: Mechanism | None = None
    types: Mapping[str, str] = field(default_factory=dict)
    also: tuple[str, ...] = ()
    home: Mapping[str, Any] = field(default_factory=dict)


# The platform --------------------------------------------------------------------------------


def platform(mechanism: Mechanism, closing: Closing) -> str:
    """A link whose name sounds like the end of a robot, an end of a loop, or the outermost link.

    Fingers and sensors come last, whatever hangs furthest out, and so do rods that spin: no motor
    says how they are turned; and frames on the axis about which a closed loop turns their link.
    """
    links, ends = mechanism.links, [end for loop in closing.loops for end in (loop.a, loop.b)]
    spins = {spin.frame_b for spin in closing.closed.idle.spins} if closing.closed else set()
    rods = {_body(k, links) for k in range(len(links)) if links[k].name in spins}
    depth = _depths(links)
    moving = [k for k in range(len(links)) if depth[k][0]] or [0]
    still = _fixed_frames(closing.closed or mechanism)
    moving = [k for k in moving if links[k].name not in still] or moving
    plain = [k for k in moving if not _aside(k, links) and _body(k, links) not in rods] or moving
    named: list[int] = next(
        (found for word in _WORDS if (found := [k for k in plain if word.search(links[k].name)])),
        [],
    )
    tied = [k for k in plain if links[k].name in ends]
    heavy = [k for k in plain if links[k].weighs]
    tips = [k for k in plain if _TIP.search(links[k].name)]
    best = named or [k for k in tied if links[k].weighs] or tied or tips or heavy or plain
    return links[max(best, key=lambda k: (*depth[k], links[k].inertia.mass, -k))].name


def _fixed_frames(mechanism: Mechanism) -> set[str]:
    """Frames whose origins no motion that the loops leave can move from home."""
    look, home = Equations(mechanism.rigid), mechanism.home
    Z, frames = null_space(look.close(home).J), look.system.expansion.frames
    return {
        name
        for name, frame in frames.items()
        if np.max(np.abs(frame_jacobian(look, home, frame)[:3] @ Z), initial=0.0) < _MOVES
    }


def _depths(links: Sequence[Link]) -> list[tuple[int, int]]:
    """Moving joints between the ground and each link, and then links that are fixed there."""
    depth: list[tuple[int, int]] = []
    for link in links:
        moving, fixed = depth[link.parent] if link.parent >= 0 else (0, 0)
        depth.append((moving + len(link.steps), 0 if link.steps else fixed + 1))
    return depth


def _body(number: int, links: Sequence[Link]) -> int:
    """The link that a joint moves, with which this one moves."""
    while not links[number].steps and links[number].parent >= 0:
        number = links[number].parent
    return number


def _aside(number: int, links: Sequence[Link]) -> bool:
    """Whether a link is a finger or a sensor, or hangs on one."""
    while number >= 0:
        if _FINGER.search(links[number].name) or _SENSOR.search(links[number].name):
            return True
        number = links[number].parent
    return False


# Loops ---------------------------------------------------------------------------------------


def closing(mechanism: Mechanism, tree: Source) -> Closing:
    """The loops that a file leaves open, of the first kind that gives every motor its freedom."""
    motors = named_motors(tree)
    pairs = _pairs(mechanism, motors)
    if not pairs:
        return Closing()
    best, types = Closing(tuple(pairs), motors), _named_types(tree)
    some = json.dumps(motors or mechanism.description.actuated[:1])
    fits: list[Closing] = []
    flat = _flat(mechanism, pairs)
    kinds = _kinds(mechanism, pairs, flat)
    tries = itertools.product([{}, types] if types else [{}], kinds)
    for retyped, kind in tries:
        loops = tuple(Loop(p.a, p.b, p.apart, *kind) for p in pairs)
        text = json.dumps({loop.name: loop.block for loop in loops})
        changes = [f"loops={text}", f"actuated={some}"]
        changes += [f"joints.{name}.type={kind}" for name, kind in retyped.items()]
        try:
            closed = _closed(mechanism, changes, pairs)
        except PinflexError:
            continue
        mobility = closed.report.mobility
        driven = motors or _likely_motors(tree, mobility)
        home = closed.description.home
        bent = home if home != mechanism.description.home else {}
        closing = Closing(loops, driven, closed, retyped, home=bent)
        if mobility and mobility == len(driven):
            fits.append(closing)
            if kind[0] == "revolute":
                continue  # about another axis, too?
            break
        if mobility and kind in flat and not motors:
            return closing  # a plane chain: better no motor named than a hinge that blocks it
        least = best.closed.report.mobility if best.closed else 0
        if mobility and (not least or least < mobility < len(driven)):
            best = closing
    hinges = [fit for fit in fits if fit.loops[0].kind == "revolute"]
    if not hinges:
        return fits[0] if fits else best
    axes = dict.fromkeys(fit.loops[0].axis for fit in hinges)  # some twice, with other types
    return replace(hinges[0], also=tuple(axes)[1:])


def _closed(mechanism: Mechanism, changes: Sequence[str], pairs: Sequence[Loop]) -> Mechanism:
    """The mechanism with loops; where it is drawn in a singular pose, bent out of it."""
    try:
        return load(mechanism.description.with_overrides(changes))
    except SingularityError:
        model = mechanism.rigid.rigid
        joints = sorted(set().union(*(_between(model, *_numbers(model, pair)) for pair in pairs)))
        turns = [model.names[j] for j in joints if model.nvs[j] == 1]
        bent = [f"home.{name}={_BENT * _LESS**k:.2g}" for k, name in enumerate(turns)]
        return load(mechanism.description.with_overrides([*changes, *bent]))


def _named_types(tree: Source) -> dict[str, str]:
    """Balls and universal joints by their names, where the file has another type."""
    return {
        joint.name: kind
        for joint in tree.joints.values()
        for kind, word in _TYPES.items()
        if word.search(joint.name) and joint.type in ("revolute", "continuous", "fixed")
    }


def named_motors(tree: Source) -> tuple[str, ...]:
    """Joints whose names say that they have a motor, where not all do."""
    ones = single(tree)
    found = tuple(joint.name for joint in ones if MOTOR.search(joint.name))
    return found if len(found) < len(ones) else ()


def _likely_motors(tree: Source, mobility: int) -> tuple[str, ...]:
    """The sliding joints, else those on the base, where they are as many as the freedoms.

    Else those with an effort limit, where others have none: as many as freedoms, or more.
    """
    ones = single(tree)
    moved = {joint.child for joint in tree.joints.values() if joint.type != "fixed"}
    for likely in (
        [joint.name for joint in ones if joint.type == "prismatic"],
        [joint.name for joint in ones if joint.parent not in moved],
    ):
        if len(likely) == mobility:
            return tuple(likely)
    pushed = limited(tree)
    return tuple(pushed) if mobility <= len(pushed) < len(ones) else ()


def limited(tree: Source) -> list[str]:
    """Joints with an effort limit."""
    known = limits(tree.text)
    return [joint.name for joint in single(tree) if known.get(joint.name, Limits()).effort > 0]


def single(tree: Source) -> list[SourceJoint]:
    """Joints of one freedom that follow no other."""
    return [
        j for j in tree.joints.values()
        if j.type in ("revolute", "continuous", "prismatic") and j.mimic is None
    ]  # fmt: skip


def _pairs(mechanism: Mechanism, motors: Sequence[str]) -> list[Loop]:
    """Open ends of different branches that coincide; else the nearest, where joints are passive."""
    model, links = mechanism.rigid.rigid, mechanism.links
    free = _open_ends(mechanism)
    if found := _coinciding(mechanism, free):
        return found
    frames = {k: model.getFrameId(links[k].name, pin.FrameType.BODY) for pair in free for k in pair}
    branches = {
        pair: d
        for pair, d in free.items()
        if _apart(model, frames, pair) and not any(_SENSOR.search(links[k].name) for k in pair)
    }
    if not branches or not (motors or len(branches) == 1):
        return []  # every joint has a motor, as far as names tell: feet, not loops
    return _nearest(links, branches)


def cut_open(mechanism: Mechanism) -> str:
    """The block `loops` for open ends that coincide at home, as a line of YAML; "" for none."""
    found: Sequence[Loop] = _coinciding(mechanism, _open_ends(mechanism))
    if found and not mechanism.description.loops:  # of the kind that leaves motors their freedom
        found = closing(mechanism, mechanism.description.tree()).loops
    return _plain({"loops": {loop.name: loop.block for loop in found}}) if found else ""


def _coinciding(mechanism: Mechanism, free: Mapping[tuple[int, int], float]) -> list[Loop]:
    names = [link.name for link in mechanism.links]
    return [Loop(names[a], names[b], d) for (a, b), d in free.items() if d < _NEAR]


def _open_ends(mechanism: Mechanism) -> dict[tuple[int, int], float]:
    """Pairs of open ends that may move apart, by numbers of links; their distance at home [m]."""
    model, links = mechanism.rigid.rigid, mechanism.links
    ends = [k for k in range(len(links)) if _open_end(k, mechanism)]
    if len(ends) < 2:
        return {}
    frames = {k: model.getFrameId(links[k].name, pin.FrameType.BODY) for k in ends}
    spots = [
        {k: data.oMf[frames[k]].translation.copy() for k in ends} for data in _poses(mechanism)
    ]
    free: dict[tuple[int, int], float] = {}
    for a, b in itertools.combinations(ends, 2):
        apart = [float(np.linalg.norm(spot[a] - spot[b])) for spot in spots]
        weighs = links[a].weighs and links[b].weighs
        if not weighs and np.ptp(apart) > _MOVES:
            free[a, b] = apart[0]
    return free


def _open_end(number: int, mechanism: Mechanism) -> bool:
    """Whether a link carries nothing, closes no loop and bears no load or spring.

    One fixed to another, or half a joint.
    """
    links = mechanism.links
    link = links[number]
    return (
        link.parent >= 0
        and not (link.steps and link.weighs)
        and all(other.parent != number for other in links)
        and link.name not in {*mechanism.description.tied, *mechanism.description.loaded}
        and mechanism.rigid.rigid.existFrame(link.name, pin.FrameType.BODY)
    )


def _poses(mechanism: Mechanism) -> list[pin.Data]:
    """Home, and poses away from it by one step of every joint."""
    model, found = mechanism.rigid.rigid, []
    away = np.random.default_rng(0).uniform(-1, 1, (_LOOKS, model.nv))
    for step in [np.zeros(model.nv), *away]:
        data = model.createData()
        pin.framesForwardKinematics(model, data, pin.integrate(model, mechanism.home, step))
        found.append(data)
    return found


def _apart(model: pin.Model, frames: dict[int, int], pair: tuple[int, int]) -> bool:
    """Whether neither end hangs on the other's joint."""
    joints = [model.frames[frames[k]].parentJoint for k in pair]
    return not any(b in list(model.supports[a]) for a, b in (joints, joints[::-1]))


def _nearest(links: Sequence[Link], free: dict[tuple[int, int], float]) -> list[Loop]:
    """Each end with one other, those of like names before those that are near."""

    def order(pair: tuple[int, int]) -> tuple[bool, float]:
        one, other = ({*re.findall(r"[a-z]+|\d+", links[k].name.lower())} for k in pair)
        return not one & other, free[pair]

    found: list[Loop] = []
    taken: set[int] = set()
    for pair in sorted(free, key=order):
        if not taken & {*pair}:
            taken |= {*pair}
            found.append(Loop(links[pair[0]].name, links[pair[1]].name, free[pair]))
    return found


def _flat(mechanism: Mechanism, pairs: Sequence[Loop]) -> list[tuple[str, str]]:
    """The hinge about the one line about which all joints between all ends turn, if there is."""
    axes = {_axis(mechanism, pair) for pair in pairs}
    return [("revolute", next(iter(axes)))] if len(axes) == 1 and "" not in axes else []


def _kinds(
    mechanism: Mechanism, pairs: Sequence[Loop], flat: Sequence[tuple[str, str]]
) -> list[tuple[str, str]]:
    """Kinds to try with their axis: hinges of a plane chain, or pins where its axes are rounded.

    Hinges about an axis that both ends of each pair have in common hold more than balls do, so
    that where all freedoms are left (Bennett's linkage, a spherical wrist) they are meant.
    """
    shared = [_shared(mechanism, pair) for pair in pairs]
    hinges = [("revolute", axis) for axis in shared[0] if all(axis in axes for axes in shared)]
    pins = [("planar", axis) for _, axis in flat]
    return list(dict.fromkeys([*flat, *hinges, *pins, ("spherical", ""), ("weld", "")]))


def _at_home(mechanism: Mechanism, pair: Loop) -> tuple[pin.Model, pin.Data, Array, int, int]:
    """The model, its frames and turns (3, nv) at home, and the numbers of both ends."""
    model = mechanism.rigid.rigid
    data = model.createData()
    J = pin.computeJointJacobians(model, data, mechanism.home).reshape(6, model.nv)[3:]
    pin.updateFramePlacements(model, data)
    return model, data, J, *_numbers(model, pair)


def _numbers(model: pin.Model, pair: Loop) -> tuple[int, int]:
    """Of the frames at both ends."""
    a, b = (int(model.getFrameId(name, pin.FrameType.BODY)) for name in (pair.a, pair.b))
    return a, b


def _between(model: pin.Model, a: int, b: int) -> set[int]:
    """Joints that move one of two frames alone; what carries both, as a column, moves neither."""
    one, other = (set(model.supports[model.frames[f].parentJoint]) for f in (a, b))
    return one ^ other


def _shared(mechanism: Mechanism, pair: Loop) -> list[str]:
    """Axes of both frames that are one at home: first as the joint that carries the first turns."""
    model, data, J, a, b = _at_home(mechanism, pair)
    bears = model.frames[a].parentJoint or model.frames[b].parentJoint
    turns = data.oMi[bears].rotation.T @ J[:, model.idx_vs[bears]]
    apart = np.linalg.norm(data.oMf[a].rotation - data.oMf[b].rotation, axis=0)
    found = [axis for axis in "zxy" if apart["xyz".index(axis)] < _NEAR]
    return sorted(found, key=lambda axis: -round(abs(turns["xyz".index(axis)])))


def _axis(mechanism: Mechanism, pair: Loop) -> str:
    """x, y or z of frame a, the axis of all turning joints between the ends; "" if of not all."""
    model, data, J, *frames = _at_home(mechanism, pair)
    joints = _between(model, *frames)
    columns = [c for j in joints for c in range(model.idx_vs[j], model.idx_vs[j] + model.nvs[j])]
    turns = J[:, columns]
    turns = turns[:, np.linalg.norm(turns, axis=0) > _NEAR]
    local = data.oMf[frames[0]].rotation.T @ turns
    along = np.flatnonzero(np.abs(local).max(axis=1, initial=0.0) > _NEAR)
    return "xyz"[along[0]] if len(along) == 1 else ""


# Home as the block `home` takes it.

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


# A YAML text with another `home`; every other byte stays as its author wrote it.

_DIGITS = 1e-8  # relative or absolute; nine digits are written


def with_home(text: str, values: Mapping[str, float | list[float]], file: str) -> str:
    """The text with the block `home` replaced, or appended where there is none."""
    before = yaml_text.load(text, file)
    changed = _changed(text, values, before)
    if not _only_home_differs(changed, before, values, file):
        lines = _lines(values, "\r\n" if "\r\n" in text else "\n")
        raise DescriptionError(
            f"{file}: home: this file is written in a way that does not let the block be replaced "
            f"alone (an anchor, several documents). Write it yourself:\n{lines}"
        )
    return changed


def _changed(
    text: str, values: Mapping[str, float | list[float]], before: Mapping[str, Any]
) -> str:
    """The text with the block replaced, or with a new one at its end."""
    newline = "\r\n" if "\r\n" in text else "\n"
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    assert isinstance(root, yaml.MappingNode)
    lines = _lines(values, newline)
    for key, value in root.value:
        if key.value == "home":
            if isinstance(value, yaml.MappingNode) and value.value:
                return _edited(text, value, before["home"], values, newline)
            first, last = key.start_mark.index, max(_end(value), key.end_mark.index + 1)
            inner = _flow(values) if root.flow_style else lines
            return text[:first] + inner + text[last:]
    if root.flow_style:
        at = text.rindex("}", 0, root.end_mark.index)
        return f"{text[:at].rstrip().rstrip(',')}, {_flow(values)}{text[at:]}"
    at = max(_end(value) for pair in root.value for value in pair)
    line = text.find("\n", at)
    at = len(text) if line < 0 else line
    at -= at > 0 and text[at - 1 : at] == "\r"
    return text[:at] + newline + lines + (text[at:] or newline)


def _only_home_differs(
    changed: str,
    before: Mapping[str, Any],
    values: Mapping[str, float | list[float]],
    file: str,
) -> bool:
    """Whether the changed text says the values, and everything else as before."""
    try:
        after = yaml_text.load(changed, file)
        now = after.pop("home")
        if after != {k: v for k, v in before.items() if k != "home"}:
            return False
        return now.keys() >= values.keys() and all(_same(now[k], x) for k, x in values.items())
    except (DescriptionError, AttributeError, KeyError, TypeError):
        return False


def _edited(
    text: str,
    block: yaml.MappingNode,
    old: Mapping[str, Any],
    values: Mapping[str, float | list[float]],
    newline: str,
) -> str:
    """The text with new values in the entries of a block, and entries that it lacks after them."""
    pieces: list[tuple[int, int, str]] = []
    for key, value in block.value:
        new = values.get(key.value)
        if new is not None and not _same(old.get(key.value), new):
            shown = _plain({"x": new}).partition(": ")[2]
            pieces.append((value.start_mark.index, _end(value), shown))
    more = [_plain({name: v}) for name, v in values.items() if name not in old]
    last = _end(block.value[-1][1])
    if more and block.flow_style:
        pieces.append((last, last, "".join(f", {entry}" for entry in more)))
    elif more:
        indent = " " * block.value[0][0].start_mark.column
        line = text.find("\n", last)
        line = len(text) if line < 0 else line - (text[line - 1] == "\r")
        pieces.append((line, line, "".join(f"{newline}{indent}{entry}" for entry in more)))
    for first, after, shown in sorted(pieces, reverse=True):
        text = text[:first] + shown + text[after:]
    return text


def _same(a: object, b: float | list[float]) -> bool:
    """Values that are one to the digits written."""
    one, other = (x if isinstance(x, list) else [x] for x in (a, b))
    if len(one) != len(other) or not all(isinstance(x, int | float) for x in one):
        return False
    return all(abs(x - y) <= _DIGITS * max(1.0, abs(y)) for x, y in zip(one, other, strict=True))


def _lines(values: Mapping[str, float | list[float]], newline: str) -> str:
    if not values:
        return "home: {}"
    rows = [f"  {_plain({name: value})}" for name, value in values.items()]
    return newline.join(["home:", *rows])


def _flow(values: Mapping[str, float | list[float]]) -> str:
    return _plain({"home": dict(values)})


def _plain(block: dict[str, Any]) -> str:
    """One line "key: value"."""
    dumped = yaml.safe_dump(block, default_flow_style=True, width=10**6, allow_unicode=True)
    return str(dumped).strip()[1:-1]


def _end(node: yaml.Node) -> int:
    """Where a value ends in the text; a block ends with its last entry, not with what follows."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[-1] if isinstance(last, tuple) else last)
    return int(node.end_mark.index)
