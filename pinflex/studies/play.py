"""The play of a platform: what clearances and backlash let it do while the motors stand still."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.description import Description
from pinflex.description.motions.motion import Motion
from pinflex.description.reading import schema
from pinflex.errors import DescriptionError, SceneError, nearest
from pinflex.linalg import null_space
from pinflex.mechanics.closure import Closures, closures
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian
from pinflex.mechanics.mechanism import Mechanism, load, takes_model
from pinflex.mechanics.model.loads import DISTANCE, POINT
from pinflex.progress import Progress, barred, callback
from pinflex.results.play import Play, PlayMap
from pinflex.studies.pose_map import pose_of, poses_of

_BALLS = ("spherical", "universal")  # loops that hold all of a point
_PINS = ("revolute", "planar", "cylindrical")  # that hold it across an axis
_FREE = 1e-8  # of a platform's velocities: what closures do not hold
_BEARS = 1e-9  # of unit forces: what a mechanism cannot bear by itself


@dataclass(frozen=True)
class _Loose:
    """A loose place: its size, and what closures (rows, k) and platform (6, k) make of its move."""

    name: str
    size: float
    rows: Array
    platform: Array


@public
@takes_model
def play(
    mechanism: Mechanism,
    q: Array | None = None,
    clearance: float | str | Mapping[str, float | str] | None = None,
) -> Play:
    """Where the platform can be without any motor moving, to first order.

    Links are rigid; pins lean in their holes to any side, axes stay parallel; gears lie anywhere in
    their backlash.

        found = pf.play("3rrr", clearance="50 um")
        found.extent, found.farthest, found.plot()

    Args:
        mechanism: Mechanism with a platform, or what `load` takes.
        q: Rigid pose, default home.
        clearance: Radius of the hole less that of the pin, m or text with unit: of every pin and
            ball, or by name of joint or loop. None: the `clearance` of loops. `backlash` of drives
            counts always.
    Returns:
        The play.
    Raises:
        DescriptionError: No platform, nothing loose, or a name that is no pin.
    """
    description = mechanism.description
    if description.platform is None:
        raise DescriptionError(f"{mechanism.name}: play: of which frame? Add `platform`.")
    if mechanism.rigid.closed.contacts:
        raise DescriptionError(
            f"{mechanism.name}: play: sleeves on beams are not covered. Take pins and balls."
        )
    pose = mechanism.undeformed(q)[: len(mechanism.home)]
    sizes = _sizes(mechanism, clearance)
    closed = _every_row(mechanism, pose)
    dynamics = Equations(replace(mechanism.rigid, closed=closed))
    J = dynamics.close(pose).J if closed.n else np.zeros((0, mechanism.rigid.nv))
    place = mechanism.rigid.expansion.frames[description.platform]
    G = frame_jacobian(dynamics, pose, place)
    loose = [
        *_pins_of_tree(mechanism, dynamics, pose, sizes, closed),
        *_pins_of_loops(dynamics, pose, sizes, closed),
        *_gears(mechanism, J, G),
    ]
    if not loose:
        raise DescriptionError(
            f"{mechanism.name}: play: nothing is loose. Give clearance, as in "
            'pf.play(robot, clearance="50 um"), or write `clearance` at loops or drive.backlash.'
        )
    passive = mechanism.rigid.free
    moves, agree, free = _solved(J[:, passive], G[:, passive], loose)
    return Play(
        mechanism.name, tuple(x.name for x in loose), np.array([x.size for x in loose]), moves,
        agree, free,
    )  # fmt: skip


@public
@barred
def play_map(
    model: str | Path | Description | Mechanism,
    grid: Mapping[str, object] | None = None,
    *,
    along: Motion | None = None,
    instants: int = 41,
    clearance: float | str | Mapping[str, float | str] | None = None,
    progress: Progress = None,
) -> PlayMap:
    """The play of the platform over a grid of poses, or along a motion.

    Args:
        model: A model, or what `load` takes.
        grid: Displacements from home, as in `pose_map`. Empty: home.
        along: Motion whose poses are taken instead. instants: How many of them.
        clearance: As in `play`.
        progress: As in `sweep`.
    Returns:
        The map; a pose that cannot be reached says why.
    Raises:
        DescriptionError: As `play`, or a coordinate that does not exist.
    """
    mechanism = model if isinstance(model, Mechanism) else load(model)
    first = play(mechanism, None, clearance)  # what is wrong with the request, once
    axes, units, cases = poses_of(mechanism, grid, along, instants)
    shape, told = tuple(map(len, axes.values())), callback(progress)
    plays, errors = np.full(shape, None, dtype=object), np.full(shape, "", dtype=object)
    for k, (at, case) in enumerate(zip(np.ndindex(*shape), cases, strict=True)):
        try:
            q = pose_of(mechanism, case)
            plays[at] = first if not axes else play(mechanism, q, clearance)
        except SceneError as error:
            errors[at] = str(error)
        if told is not None:
            told(k + 1, len(cases))
    return PlayMap(mechanism.name, axes, units, plays, errors)


def _solved(
    J: Array, G: Array, loose: list[_Loose]
) -> tuple[tuple[Array, ...], tuple[Array, ...], Array]:
    """T_j and S_j of each place, and the directions in which the platform is free."""
    if len(J):
        held = np.linalg.lstsq(J.T, G.T, rcond=1e-10)[0]  # forces of the closures, (rows, 6)
        left = G.T - J.T @ held
        itself = null_space(J.T, 1e-9)  # forces that the closures bear by themselves
    else:
        held, left, itself = np.zeros((0, 6)), G.T, np.zeros((0, 0))
    size = max(float(np.max(np.abs(G), initial=0.0)), 1e-300)
    U, sigma, _ = np.linalg.svd(left.T, full_matrices=False) if left.size else (
        np.zeros((6, 0)), np.zeros(0), None)  # fmt: skip
    moves = tuple(x.platform - held.T @ x.rows for x in loose)
    every = np.concatenate([itself.T @ x.rows for x in loose], axis=1)
    bears = np.zeros((0, every.shape[1]))
    if every.size:
        _, strength, Vt = np.linalg.svd(every, full_matrices=False)
        bears = Vt[strength > _BEARS]
    ends = np.cumsum([x.rows.shape[1] for x in loose])[:-1]
    return moves, tuple(np.split(bears, ends, axis=1)), U[:, sigma > _FREE * size]


def _sizes(
    mechanism: Mechanism, given: float | str | Mapping[str, float | str] | None
) -> dict[str, float]:
    """Clearances by name of joint or loop."""
    where = f"{mechanism.name}: play: clearance"
    own = {x.name: x.clearance for x in mechanism.description.loops if x.clearance is not None}
    if given is None:
        return own
    known = [name for name, _, _ in _tree_pins(mechanism)]
    known += [x.name for x in mechanism.description.loops if x.kind in (*_BALLS, *_PINS)]
    if not isinstance(given, Mapping):
        return dict.fromkeys(known, schema.number(given, where, above=0, of="length"))
    for name in given:
        if name not in known:
            raise DescriptionError(f"{where}: {name}: no pin or ball.{nearest(name, known)}")
    return own | {
        name: schema.number(value, schema.at(where, name), above=0, of="length")
        for name, value in given.items()
    }


def _tree_pins(mechanism: Mechanism) -> list[tuple[str, int, bool]]:
    """Pins and balls of the tree: name, joint, whether a ball."""
    model, found = mechanism.rigid.expansion.model, list[tuple[str, int, bool]]()
    slots = mechanism.rigid.rigid
    for name in list(slots.names)[1:]:
        joint = model.getJointId(name)
        one = model.joints[joint]
        if name.endswith(".2") and model.existJointName(f"{name[:-2]}.1"):
            continue  # the second axis of a universal joint, which is one ball
        if one.nv == 3 and "Spherical" in one.shortname():
            found.append((name, joint, True))
        elif one.nv == 1 and one.shortname().startswith("JointModelR"):
            both = name.endswith(".1") and model.existJointName(f"{name[:-2]}.2")
            found.append((name[:-2] if both else name, joint, bool(both)))
    return found


def _pins_of_tree(
    mechanism: Mechanism, dynamics: Equations, q: Array, sizes: Mapping[str, float],
    closed: Closures,
) -> list[_Loose]:  # fmt: skip
    """A joint that gives way moves all that hangs on it."""
    system = mechanism.rigid
    model, data = system.expansion.model, system.expansion.model.createData()
    pin.computeJointJacobians(model, data, q)
    frame = system.expansion.frames[str(mechanism.description.platform)]
    carries = set(model.supports[frame.joint])
    shift, found = _shifts(dynamics, q, closed), list[_Loose]()
    above = [set(model.supports[int(body)]) for body in closed.bodies]
    loops = len(closed.names)
    for name, joint, ball in _tree_pins(mechanism):
        if name not in sizes:
            continue
        basis = np.eye(3)
        if not ball:
            row = int(model.idx_vs[joint])
            axis = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)[3:, row]
            basis = null_space(axis[None])
        sides = np.array([joint in each for each in above], float)
        by_loop = sides[loops:] - sides[:loops]
        rows = by_loop[closed.loop_of][:, None] * shift[: len(closed.loop_of)]
        rows = np.vstack([rows, np.zeros((closed.n - len(rows), 3))])
        platform = np.vstack([np.eye(3) * (joint in carries), np.zeros((3, 3))])
        found.append(_Loose(name, sizes[name], rows @ basis, platform @ basis))
    return found


def _pins_of_loops(
    dynamics: Equations, q: Array, sizes: Mapping[str, float], closed: Closures
) -> list[_Loose]:
    """A loop that gives way is open by its move."""
    if not closed.n:
        return []
    shift, found = _shifts(dynamics, q, closed), list[_Loose]()
    frames = closed.frames(dynamics.joint_poses(q))[0]
    for k, (name, kind) in enumerate(zip(closed.names, closed.kinds, strict=True)):
        if name not in sizes or kind not in (*_BALLS, *_PINS):
            continue
        own = np.array([owner == k for owner in closed.loop_of], float)[:, None]
        rows = np.zeros((closed.n, 3))
        rows[: len(own)] = -own * shift[: len(own)]
        basis = np.eye(3) if kind in _BALLS else frames[k, :, :2]
        found.append(_Loose(name, sizes[name], rows @ basis, np.zeros((6, basis.shape[1]))))
    return found


def _shifts(dynamics: Equations, q: Array, closed: Closures) -> Array:
    """Change of the rows per shift of body b in the world, shape (rows, 3)."""
    found = np.zeros((closed.n, 3))
    if not closed.n:
        return found
    frames, loops = closed.frames(dynamics.joint_poses(q))[0], len(closed.names)
    points, distances = closed.of(POINT), closed.of(DISTANCE)
    found[points] = frames[closed.loop_of[points], :, closed.a[points]]
    a = closed.loop_of[distances]
    way = frames[loops + a, :, 3] - frames[a, :, 3]
    found[distances] = way / closed.lengths[distances, None]
    return found


def _gears(mechanism: Mechanism, J: Array, G: Array) -> list[_Loose]:
    """Gears within their backlash."""
    found = list[_Loose]()
    for name, row in zip(mechanism.motors, mechanism.rigid.motors, strict=True):
        extra = mechanism.description.joints.get(name)
        if extra is not None and extra.drive is not None and extra.drive.backlash:
            half = 0.5 * extra.drive.backlash
            found.append(_Loose(f"gear of {name}", half, J[:, [row]], G[:, [row]]))
    return found


def _every_row(mechanism: Mechanism, q: Array) -> Closures:
    """The closures, with those rows that a mechanism without clearance does not need."""
    system, description = mechanism.rigid, mechanism.description
    kept = system.closed
    if not mechanism.report.redundant:
        return kept
    ground = {x.name: pin.SE3.Identity() for x in description.loops if x.grounded}
    loops = (*description.loops, *mechanism.idle.spins)
    model, frames = system.expansion.model, system.expansion.frames
    every = closures(loops, frames, model, None, description.couplings, ground)
    known = dict(zip(kept.labels, kept.lengths.tolist(), strict=True))
    own = zip(every.labels, every.lengths.tolist(), strict=True)
    lengths = np.array([known.get(label, length) for label, length in own])
    return replace(every, local=kept.local, lengths=lengths)
