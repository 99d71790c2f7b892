"""What a robot's file leaves unsaid, proposed: which frame matters, which ends meet in a joint.

All of it is guessed from names, shapes and freedoms, and written so that it can be looked at.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description.files import Source
from pinflex.errors import PinflexError
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.mechanics.model.tree import Link

_NEAR = 1e-6  # [m | rad] frames that coincide
_MOVES = 1e-6  # [m] two ends whose distance varies by less are held together already
_LOOKS = 3  # poses at which that is looked at
_WORDS = (  # the end of a robot, surest name first
    re.compile(r"platform|(^|_)plate|tool|effector|tcp|flange", re.I),
    re.compile(r"eff$|(^|_)ee(_|$)", re.I),
    re.compile(r"gripper|hand|palm|wrist", re.I),
    re.compile(r"foot|feet|sole", re.I),
)
_FINGER = re.compile(
    r"finger|thumb|(^|_)(index|middle|ring|pinky|little|knuckle|jaw|ph)(\d|_|$)", re.I
)
_SENSOR = re.compile(r"camera|laser|imu|optical|sensor|rgb|depth|lidar|gnss|(^|_)head|eye", re.I)
_MOTOR = re.compile("mot|act", re.I)


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
    """

    loops: tuple[Loop, ...] = ()
    motors: tuple[str, ...] = ()
    closed: Mechanism | None = None


# The platform --------------------------------------------------------------------------------


def platform(mechanism: Mechanism, ends: Sequence[str] = ()) -> str:
    """A link whose name sounds like the end of a robot, an end of a loop, or the outermost link.

    Fingers and sensors come last, whatever hangs furthest out.
    """
    links = mechanism.links
    depth = _depths(links)
    moving = [k for k in range(len(links)) if depth[k][0]] or [0]
    plain = [k for k in moving if not _aside(k, links)] or moving
    named: list[int] = next(
        (found for word in _WORDS if (found := [k for k in plain if word.search(links[k].name)])),
        [],
    )
    tied = [k for k in plain if links[k].name in ends]
    heavy = [k for k in plain if links[k].weighs]
    best = named or [k for k in tied if links[k].weighs] or tied or heavy or plain
    return links[max(best, key=lambda k: (*depth[k], links[k].inertia.mass, -k))].name


def _depths(links: Sequence[Link]) -> list[tuple[int, int]]:
    """Moving joints between the ground and each link, and then links that are fixed there."""
    depth: list[tuple[int, int]] = []
    for link in links:
        moving, fixed = depth[link.parent] if link.parent >= 0 else (0, 0)
        depth.append((moving + len(link.steps), 0 if link.steps else fixed + 1))
    return depth


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
    pairs = _pairs(mechanism, named_motors(tree))
    if not pairs:
        return Closing()
    motors = named_motors(tree)
    best = Closing(tuple(pairs), motors)
    some = json.dumps(motors or mechanism.description.actuated[:1])
    for kind in _kinds(mechanism, pairs):
        loops = tuple(Loop(p.a, p.b, p.apart, *kind) for p in pairs)
        text = json.dumps({loop.name: loop.block for loop in loops})
        changes = [f"loops={text}", f"actuated={some}"]
        try:
            closed = load(mechanism.description.with_overrides(changes))
        except PinflexError:
            continue
        mobility = closed.report.mobility
        if mobility and mobility == len(motors):
            return Closing(loops, motors, closed)
        if mobility and best.closed is None:
            best = Closing(loops, motors, closed)
    return best


def named_motors(tree: Source) -> tuple[str, ...]:
    """Joints whose names say that they have a motor, where not all do."""
    single = [
        j.name for j in tree.joints.values()
        if j.type in ("revolute", "continuous", "prismatic") and j.mimic is None
    ]  # fmt: skip
    found = tuple(name for name in single if _MOTOR.search(name))
    return found if len(found) < len(single) else ()


def _pairs(mechanism: Mechanism, motors: Sequence[str]) -> list[Loop]:
    """Open ends of different branches that coincide; else the nearest, where joints are passive."""
    model, links = mechanism.rigid.rigid, mechanism.links
    ends = [k for k in range(len(links)) if _open_end(k, mechanism)]
    frames = {k: model.getFrameId(links[k].name) for k in ends}
    poses = _poses(mechanism)
    spots = [{k: data.oMf[frames[k]].translation.copy() for k in ends} for data in poses]
    free: dict[tuple[int, int], float] = {}
    for n, a in enumerate(ends):
        for b in ends[n + 1 :]:
            apart = [float(np.linalg.norm(spot[a] - spot[b])) for spot in spots]
            weighs = links[a].weighs and links[b].weighs
            if not weighs and np.ptp(apart) > _MOVES:
                free[a, b] = apart[0]
    together = [(pair, d) for pair, d in free.items() if d < _NEAR]
    if together:
        return [Loop(links[a].name, links[b].name, d) for (a, b), d in together]
    branches = {pair: d for pair, d in free.items() if _apart(model, frames, pair)}
    if not branches or not (motors or len(branches) == 1):
        return []  # every joint has a motor, as far as names tell: feet, not loops
    return _nearest(links, branches)


def _open_end(number: int, mechanism: Mechanism) -> bool:
    """Whether a link is fixed to another, carries nothing and closes no loop."""
    links = mechanism.links
    link = links[number]
    return (
        link.parent >= 0
        and not link.steps
        and all(other.parent != number for other in links)
        and link.name not in mechanism.description.tied
        and not _SENSOR.search(link.name)
        and mechanism.rigid.rigid.existFrame(link.name)
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


def _kinds(mechanism: Mechanism, pairs: Sequence[Loop]) -> list[tuple[str, str]]:
    """Kinds to try with their axis: pins where all joints of both branches turn about one line."""
    axes = {_axis(mechanism, pair) for pair in pairs}
    pin_about = [("revolute", next(iter(axes)))] if len(axes) == 1 and "" not in axes else []
    return [*pin_about, ("spherical", ""), ("weld", "")]


def _axis(mechanism: Mechanism, pair: Loop) -> str:
    """x, y or z of frame a, the axis of all turning joints of both branches; "" if of not all."""
    model = mechanism.rigid.rigid
    data = model.createData()
    pin.computeJointJacobians(model, data, mechanism.home)
    pin.updateFramePlacements(model, data)
    frames = [model.getFrameId(name) for name in (pair.a, pair.b)]
    joints = {j for f in frames for j in model.supports[model.frames[f].parentJoint] if j}
    columns = [c for j in joints for c in range(model.idx_vs[j], model.idx_vs[j] + model.nvs[j])]
    turns: Array = data.J[3:, columns]
    turns = turns[:, np.linalg.norm(turns, axis=0) > _NEAR]
    local = data.oMf[frames[0]].rotation.T @ turns
    along = np.flatnonzero(np.abs(local).max(axis=1, initial=0.0) > _NEAR)
    return "xyz"[along[0]] if len(along) == 1 else ""
