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

from pinflex.arrays import Array
from pinflex.description.files import Source, SourceJoint
from pinflex.description.robots.urdf import Limits, limits
from pinflex.errors import PinflexError, SingularityError
from pinflex.linalg import null_space
from pinflex.mechanics.assembly import close_loops
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.mechanics.model.tree import Link, poses_of
from pinflex.studies.scenes.home import in_flow

_NEAR = 1e-4  # [m] frames that coincide, but for the decimals of a file
_MOVES = 1e-6  # [m] two ends whose distance varies by less are held together already; a frame
# that moves by less for one radian or metre of a freedom stands still
_BENT, _LESS = 0.5, 0.8  # by which joints are bent out of a singular pose [rad | m]: by so much
# the first, each other one by so much of the last: in a pose of no symmetry
_LOOKS = 3  # poses at which that is looked at
_BESIDE, _STILL = 0.1, 1e-3  # a step away from home; a joint's share of a motion there: none, but
# for hinges that are parallel to a drawing's digits
_DRAWN = 0.01  # of the robot: ends that are nearer are meant to meet, whatever motors there are
_WORDS = (  # the end of a robot, surest name first
    re.compile(r"platform|(^|_)plate|tool|effector|tcp|flange", re.I),
    re.compile(r"eff$|(^|_)ee(_|$)", re.I),
    re.compile(r"gripper|hand|palm|wrist", re.I),
    re.compile(r"foot|feet|sole", re.I),
)
_TIP = re.compile(r"(^|_)(tip|nozzle|hook)(\d|_|$)", re.I)  # of a tree; of loops their ends
_FINGER = re.compile(r"finger|thumb", re.I)
_HAND = re.compile(r"finger|thumb|hand|palm|grip", re.I)  # without one, a ring is none of its own:
_ON_HAND = re.compile(r"(^|_)(index|middle|ring|pinky|little|knuckle|jaw|ph)(\d|_|$)", re.I)
_SENSOR = re.compile(r"camera|laser|imu|optical|sensor|rgb|depth|lidar|gnss|eye", re.I)
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
    aside = _aside(links)
    plain = [k for k in moving if k not in aside and _body(k, links) not in rods] or moving
    inner = max(depth[k][0] for k in plain)
    borne = [k for k in moving if depth[k][0] > inner and not _FINGER.search(links[k].name)]
    named: list[int] = next(
        (found for word in _WORDS if (found := [k for k in plain if word.search(links[k].name)])),
        [],
    )
    if not named and not any(_HAND.search(link.name) for link in links):
        plain += [k for k in borne if k in aside]  # what a camera crane is for: motors turn it
    tied = [k for k in plain if links[k].name in ends]
    heavy = [k for k in plain if links[k].weighs]
    tips = [k for k in plain if _TIP.search(links[k].name)]
    best = named or [k for k in tied if links[k].weighs] or tied or tips or heavy or plain
    end = max(best, key=lambda k: (*depth[k], links[k].inertia.mass, -k))
    if best is heavy:  # a frame that was put on it is meant to be looked at, the furthest most
        parents = {link.parent for link in links}
        bare = [k for k in plain if k not in parents and not links[k].weighs]
        put = [k for k in bare if links[k].parent == end and not links[k].steps]
        end = max([end, *put], key=lambda k: _out(links[k]) if k in put else 0.0)
    return links[end].name


def _out(link: Link) -> float:
    """How far from its parent [m]."""
    return float(np.linalg.norm(link.placement.translation))


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


def _aside(links: Sequence[Link]) -> set[int]:
    """Links that are fingers or sensors, or hang on one."""
    words = [_FINGER, _SENSOR]
    words += [_ON_HAND] if any(_HAND.search(link.name) for link in links) else []
    found: set[int] = set()
    for k, link in enumerate(links):
        if link.parent in found or any(word.search(link.name) for word in words):
            found.add(k)
    return found


# Loops ---------------------------------------------------------------------------------------


def closing(mechanism: Mechanism, tree: Source) -> Closing:
    """The loops that a file leaves open, of the first kind that gives every motor its freedom."""
    motors = named_motors(tree)
    pairs = _pairs(mechanism, tree, motors)
    if not pairs:
        return Closing()
    light = {link.name for link in mechanism.links if not link.weighs}
    best, types = Closing(tuple(pairs), motors), _named_types(tree, light)
    some = json.dumps(motors or mechanism.description.actuated[:1])
    fits: list[Closing] = []
    flat = _flat(mechanism, pairs)
    kinds = _kinds(mechanism, pairs, flat)
    tries = itertools.product([types, {}] if types else [{}], kinds)
    for retyped, kind in tries:
        if retyped and kind[0] == "planar":
            continue  # which is for hinges that are not quite parallel
        loops = tuple(Loop(p.a, p.b, p.apart, *kind) for p in pairs)
        text = json.dumps({loop.name: loop.block for loop in loops})
        changes = [f"loops={text}", f"actuated={some}"]
        changes += [f"joints.{name}.type={kind}" for name, kind in retyped.items()]
        try:
            closed = _closed(mechanism, changes, pairs)
        except PinflexError:
            continue
        mobility, hinge = closed.report.mobility, kind[0] == "revolute"
        if hinge and (retyped or kind not in flat) and _stuck(closed, pairs):
            continue
        # as Sarrus' linkage, which has freedoms by its shape alone: no chance
        special = hinge and not flat and not motors and bool(closed.report.redundant)
        driven = _pushed(tree, motors, mobility) or motors or _likely_motors(tree, closed)
        home = closed.description.home
        bent = home if home != mechanism.description.home else {}
        closing = Closing(loops, driven, closed, retyped, home=bent)
        if mobility and kind in flat and not (motors or driven or best.closed):
            return closing  # a plane chain: better no motor named than a hinge that blocks it
        if mobility and (mobility == len(driven) or special):
            fits.append(closing)
            if hinge:
                continue  # about another axis, too?
            break
        least = best.closed.report.mobility if best.closed else 0
        if mobility and (not least or least < mobility < len(driven)):
            best = closing
        if not mobility and not best.closed and kind[0] == "spherical":
            best = closing  # nothing moves, which is to be said
    hinges = [fit for fit in fits if fit.loops[0].kind == "revolute"]
    if not hinges:
        return fits[0] if fits else best
    axes = dict.fromkeys(fit.loops[0].axis for fit in hinges)  # some twice, with other types
    return replace(hinges[0], also=tuple(axes)[1:])


def _stuck(closed: Mechanism, pairs: Sequence[Loop]) -> bool:
    """Whether a joint drawn between ends has no motion left, as two of a ball drawn as three."""
    look, model = Equations(closed.rigid), closed.rigid.rigid
    Z = null_space(look.close(closed.home).J)
    beside = look.integrate(closed.home, _BESIDE * Z.sum(axis=1))  # symmetry stops joints at home
    pose, left = close_loops(look, beside, np.arange(model.nv))
    Z = null_space(look.close(pose).J) if left < _NEAR else Z
    joints = set().union(*(_between(model, *_numbers(model, pair)) for pair in pairs))
    rows = [r for j in joints for r in range(model.idx_vs[j], model.idx_vs[j] + model.nvs[j])]
    return bool(np.min(np.linalg.norm(Z[rows], axis=1), initial=np.inf) < _STILL)


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


def _named_types(tree: Source, light: set[str]) -> dict[str, str]:
    """Balls and universal joints by their names, where the file has another type.

    Several with massless links between them are the hinges of which a file makes one.
    """
    found = {
        joint.name: kind
        for joint in tree.joints.values()
        for kind, word in _TYPES.items()
        if word.search(joint.name) and joint.type in ("revolute", "continuous", "fixed")
    }
    joints = {name: tree.joints[name] for name in found}
    within = (
        {joint.child for joint in joints.values()} & {j.parent for j in joints.values()} & light
    )
    return {n: found[n] for n, joint in joints.items() if not {joint.parent, joint.child} & within}


def named_motors(tree: Source) -> tuple[str, ...]:
    """Joints whose names say that they have a motor, where not all do."""
    ones = single(tree)
    found = tuple(joint.name for joint in ones if MOTOR.search(joint.name))
    return found if len(found) < len(ones) else ()


def _likely_motors(tree: Source, closed: Mechanism) -> tuple[str, ...]:
    """The sliding joints, else those on the base, where they determine all freedoms.

    Else those with an effort limit, where others have none: as many as freedoms, or more.
    """
    ones, model, mobility = single(tree), closed.rigid.rigid, closed.report.mobility
    Z = null_space(Equations(closed.rigid).close(closed.home).J)
    moved = {joint.child for joint in tree.joints.values() if joint.type != "fixed"}
    for likely in (
        [joint.name for joint in ones if joint.type == "prismatic"],
        [joint.name for joint in ones if joint.parent not in moved],
    ):
        rows = [model.idx_vs[model.getJointId(name)] for name in likely]
        if len(likely) == mobility and np.linalg.matrix_rank(Z[rows], _STILL) == mobility:
            return tuple(likely)
    pushed = limited(tree)
    return tuple(pushed) if mobility <= len(pushed) < len(ones) else ()


def _pushed(tree: Source, named: Sequence[str], mobility: int) -> tuple[str, ...]:
    """Joints with an effort limit, where names leave freedoms without a motor and these do not."""
    pushed = limited(tree)
    fits = named and len(named) != mobility == len(pushed) and {*named} <= {*pushed}
    return tuple(pushed) if fits else ()


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


def _pairs(mechanism: Mechanism, tree: Source, motors: Sequence[str]) -> list[Loop]:
    """Open ends of different branches that coincide; else the nearest, where joints are passive.

    Two arms each joint of which has a motor are open, however near their tips are drawn.
    """
    model, links = mechanism.rigid.rigid, mechanism.links
    free = _open_ends(mechanism)
    if found := _coinciding(mechanism, free):
        return found
    frames = {k: model.getFrameId(links[k].name, pin.FrameType.BODY) for pair in free for k in pair}
    near = _DRAWN * max(float(np.linalg.norm(pose.translation)) for pose in poses_of(links))
    driven = {model.getJointId(name) for name in motors or limited(tree)}
    branches = {
        pair: d
        for pair, d in free.items()
        if _apart(model, frames, pair)
        and not any(_SENSOR.search(links[k].name) for k in pair)
        and (d < near or _between(model, *(frames[k] for k in pair)) - driven)
    }
    if not branches or not (motors or len(branches) == 1):
        return []  # every joint has a motor, as far as names tell: feet, not loops
    return _nearest(links, branches)


def cut_open(mechanism: Mechanism) -> str:
    """The block `loops` for open ends that coincide at home, as a line of YAML; "" for none."""
    found: Sequence[Loop] = _coinciding(mechanism, _open_ends(mechanism))
    if found and not mechanism.description.loops:  # of the kind that leaves motors their freedom
        found = closing(mechanism, mechanism.description.tree()).loops
    return in_flow({"loops": {loop.name: loop.block for loop in found}}) if found else ""


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
