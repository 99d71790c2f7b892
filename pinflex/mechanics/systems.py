"""The rigid and the flexible system of a scene, with the closure rows that are independent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray, distinct
from pinflex.description.blocks.external import WORLD
from pinflex.description.blocks.joints import elastic
from pinflex.description.description import Description
from pinflex.description.loops import Loop
from pinflex.errors import AssemblyError, DescriptionError, SingularityError, nearest
from pinflex.linalg import independent_rows
from pinflex.mechanics import assembly
from pinflex.mechanics.assembly import LoopReport
from pinflex.mechanics.closing import Closed, Limits, Misfit, assemble, axis_hint
from pinflex.mechanics.closure import Closures, closures
from pinflex.mechanics.evaluation.compiled import require_workspace
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import Frame
from pinflex.mechanics.freedoms import INDEPENDENT, Freedoms, allowed
from pinflex.mechanics.kinks import kinks
from pinflex.mechanics.manifold import skew
from pinflex.mechanics.model.expansion import weighed
from pinflex.mechanics.model.loads import (
    Expansion,
    Springs,
    added_masses,
    joint_friction,
    loads,
    require_apart,
)
from pinflex.mechanics.model.parts import FlexiblePart, link_damping, rows_of
from pinflex.mechanics.model.slider import sleeve
from pinflex.mechanics.model.system import Idle, System
from pinflex.mechanics.model.tree import Link, end_riders, joint_springs
from pinflex.mechanics.reference.evaluator import Placing
from pinflex.text import frozen

# What the rigid mechanism holds beside its motors: elastic joints, idle freedoms, a free base.


def elastic_rows(J: Array, motors: IntArray, springs: Springs) -> IntArray:
    """Velocity rows of elastic joints: passive, with a spring, and held by nothing else.

    With the motors locked the closures leave the null space N of J's passive columns. Each row of
    a sprung joint in it takes one freedom away, the stiffest first; a sprung joint whose motion
    the loops determine anyway (a flexure hinge of a closed chain) is not among them.
    """
    sprung = ~np.isin(springs.v_at, motors)
    rows, stiffness = springs.v_at[sprung], springs.stiffness[sprung]
    if not len(rows):
        return rows
    N = allowed(J, motors)[rows]
    largest = float(np.sqrt(np.max(stiffness)))
    picked = independent_rows(np.sqrt(stiffness)[:, None] * N, INDEPENDENT, largest)
    return np.sort(rows[picked]).astype(np.intp)


def idle_of(system: System, description: Description, home: Array) -> Idle:
    """The idle freedoms at home, a free base among them."""
    if description.idle == "free":
        return Idle()
    # A loop to the ground determines the base as it does any other body.
    stands = any(loop.grounded for loop in description.loops)
    floats = description.base == "free_flyer" and not stands
    base = np.arange(6 if floats else 0, dtype=np.intp)  # velocity rows of a free one
    locked = distinct(system.motors, system.held, base)
    frames, found = system.expansion.frames, Idle()
    if len(locked) + system.closed.n < system.nv:
        dynamics, named = Equations(system), (*description.frames, *description.loaded)
        still = None if description.platform is None else frames[description.platform]
        J, every = dynamics.close(home).J.copy(), Freedoms(dynamics, home)
        found = every.idle(J, locked, [frames[name] for name in named], still)
    if not len(base):
        return found
    return replace(found, base=base, names=("free base", *found.names))


def at_rest(system: System, description: Description, home: Array, names: Sequence[str]) -> Array:
    """Home with the elastic joints where their springs are slack, unless `home` places them."""
    s = system.springs
    moved = home.copy()
    for k in np.flatnonzero(np.isin(s.v_at, system.held)):
        if names[s.v_at[k]] not in description.home:
            at, rest = s.q_at[k], s.rest[k]
            moved[at : at + 1 + s.paired[k]] = (np.cos(rest), np.sin(rest)) if s.paired[k] else rest
    if np.array_equal(moved, home) or not system.closed.n:
        return moved
    pose, size = assembly.close_loops(Equations(system), moved, system.free)
    return pose if size < 10 * assembly.CLOSED else home


# The home that a description gives: values of some coordinates of the rigid mechanism.


def home_guess(description: Description, model: pin.Model) -> tuple[Array, IntArray]:
    """q (nq,) with the given values, and their places; joints that are not named stand at zero."""
    q, given = pin.neutral(model), list[int]()
    for name, value in description.home.items():
        if not model.existJointName(name):
            raise DescriptionError(
                f"{description.name}: home.{name}: not a moving joint."
                f"{nearest(name, list(model.names)[1:])}"
            )
        joint = model.joints[model.getJointId(name)]
        values = np.atleast_1d(np.array(value, float))
        if joint.nv == 1 and joint.nq == 2 and len(values) == 1:
            values = np.array([np.cos(values[0]), np.sin(values[0])])
        if len(values) != joint.nq:
            raise DescriptionError(
                f"{description.name}: home.{name}: {len(values)} values, the joint has {joint.nq} "
                "coordinates (a spherical joint takes a quaternion x, y, z, w)."
            )
        q[joint.idx_q : joint.idx_q + joint.nq] = values
        given += range(joint.idx_q, joint.idx_q + joint.nq)
    _follow(q, description, model)
    return np.asarray(pin.normalize(model, q)), np.array(given, dtype=np.intp)


def _follow(q: Array, description: Description, model: pin.Model) -> None:
    """Put joints that follow others where they belong; a leader that is not named goes along."""
    place = {
        name: model.joints[model.getJointId(name)].idx_q
        for one in description.couplings
        for name in (one.joint, one.leader)
        if name is not None
    }
    for one in reversed(description.couplings):
        alone = one.joint in description.home and one.leader not in description.home
        if one.leader is not None and one.ratio and alone:
            q[place[one.leader]] = (q[place[one.joint]] - one.offset) / one.ratio
    for _ in description.couplings:  # chains in any order
        for one in description.couplings:
            led = 0.0 if one.leader is None else one.ratio * q[place[one.leader]]
            q[place[one.joint]] = led + one.offset


@frozen
class Assembled:
    """The rigid system, closed at home.

    Attributes:
        system: With independent closure rows and what level rigid holds.
        home: Closed pose q, shape (nq,).
        report: Ranks, redundant rows, mobility.
        idle: Freedoms that need no motor.
        loops: Those of the scene, with the lengths of all distances, and those of idle spins.
        ground: Places in the world of loops that are held there, by loop.
        misfit: What makes loops fit that are open at home.
    """

    system: System
    home: Array
    report: LoopReport
    idle: Idle
    loops: tuple[Loop, ...]
    ground: Mapping[str, pin.SE3]
    misfit: Misfit


def _closures(
    description: Description,
    loops: Sequence[Loop],
    parts: Mapping[str, FlexiblePart],
    expansion: Expansion,
    ground: Mapping[str, pin.SE3],
    fit: Misfit,
) -> Closures:
    """All rows of loops and couplings on a rigid or an expanded model, redundant ones included."""
    sleeves = {
        loop.name: sleeve(loop, parts, expansion, f"{description.name}: loops.{loop.name}")
        for loop in loops
        if loop.kind == "slider"
    }
    given = sleeves, description.couplings, ground
    return fit.built_in(closures(loops, expansion.frames, expansion.model, *given))


def rigid_system(
    description: Description,
    tree: Expansion,
    parts: Mapping[str, FlexiblePart],
    motors: IntArray,
    names: Sequence[str],
    limits: Limits,
) -> Assembled:
    """Close the loops of the rigid mechanism at home and keep the independent rows.

    Raises:
        AssemblyError, SingularityError: Loops that cannot close, or a singular home.
    """
    model = tree.model
    springs, dampers = joint_springs(description, model)
    guess, named = home_guess(description, model)
    ground, loops = _ground(description, tree, guess), description.loops
    every = _closures(description, loops, parts, tree, ground, Misfit())
    nv, coupled = int(model.nv), len(description.couplings)
    placed = loads(description, tree.frames)
    system = System(
        model, tree, every, np.zeros((nv, nv)), np.diag(dampers), springs, motors, placed,
        friction=joint_friction(description, model),
        added=added_masses(description, tree.frames),
        kinks=kinks(description, model, None),
    )  # fmt: skip
    if np.any(np.isnan(every.lengths)):
        loops = _with_lengths(loops, system, guess)
        every = _closures(description, loops, parts, tree, ground, Misfit())
        system = replace(system, closed=every)
    dynamics = Equations(system)
    where = f"{description.name}: home"
    closed = Closed(guess, 0)
    if every.n:
        closed = assemble(dynamics, guess, motors, where, limits, named, loops)
        every = closed.misfit.built_in(every)
        system = replace(system, closed=every)
        dynamics = Equations(system)
    home, fit = closed.pose, closed.misfit
    require_apart(placed, model, home, description.name)
    J = dynamics.close(home).J if every.n else np.zeros((0, nv))  # tables cost a millisecond
    kept, redundant = assembly.independent_rows(J, every.labels, fit.rank)
    system = replace(system, closed=every.select(kept))
    elastic = elastic_rows(J[kept], motors, springs)
    system = replace(system, held=elastic)
    home = at_rest(system, description, home, names)
    idle = idle_of(system, description, home)
    spun = len(idle.spins)
    if spun:
        loops = (*loops, *idle.spins)
        both = _closures(description, loops, parts, tree, ground, fit)
        rows = np.concatenate([kept, every.n + np.arange(spun)])
        system = replace(system, closed=both.select(rows))
    system = replace(system, held=distinct(elastic, idle.held))
    sigma = float("nan")
    if every.n:
        dynamics = Equations(system)
        dynamics.require_on_beams(home, where)
        if redundant:
            _refuse_singular_home(description, dynamics, home, redundant, every, fit.rank)
        if len(motors) + len(system.held) >= nv - len(kept) - spun:
            sigma = _sigma_at_home(dynamics, description, home, names, where)
    mobility = nv - len(kept) - spun - len(system.held)
    of = every.n - coupled, len(kept) - coupled, redundant
    report = LoopReport(*of, mobility, sigma, closed.starts, coupled, fit.gaps)
    return Assembled(system, home, report, idle, loops, ground, fit)


def _sigma_at_home(
    dynamics: Equations, description: Description, home: Array, names: Sequence[str], where: str
) -> float:
    """How far home is from a singular pose with motors and held joints locked; 1 is best."""
    system = dynamics.system
    locked = distinct(system.motors, system.held)
    try:
        return assembly.require_regular(dynamics, home, locked, names, where)
    except SingularityError as error:
        why = axis_hint(dynamics, description.loops, home)
        raise SingularityError(f"{error}{why}", **error.data) from None


def _ground(description: Description, tree: Expansion, guess: Array) -> dict[str, pin.SE3]:
    """Where loops hold frames to the ground: there, or where the guess of home has them."""
    loops = [loop for loop in description.loops if loop.grounded]
    if not loops:
        return {}
    places = {}
    poses = Placing(tree.model).poses(guess[None])
    for loop in loops:
        frame = tree.frames[loop.frame_b if loop.frame_a == WORLD else loop.frame_a]
        R, p = Frame(tree.model, frame).pose(poses)
        place = pin.SE3(R[0], p[0])
        if loop.at is not None:
            place = pin.SE3(place.rotation, np.array(loop.at))
        places[loop.name] = place
    return places


def _matrices(
    description: Description,
    expansion: Expansion,
    parts: Mapping[str, FlexiblePart],
    rigid: System,
) -> tuple[Array, Array]:
    """Stiffness and damping of links and gears, each (nv, nv)."""
    n, m = int(rigid.rigid.nv), expansion.n_eta
    K, D = np.zeros((n + m, n + m)), np.zeros((n + m, n + m))
    D[:n, :n] = rigid.D
    for slot in expansion.slots:
        at = slice(n + slot.eta.start, n + slot.eta.stop)
        K[at, at] = slot.body.K
    for link, eta in rows_of(expansion).items():
        D[np.ix_(n + eta, n + eta)] = link_damping(parts[link])
    gears = elastic(description.joints)
    for place in expansion.drives:
        gear, k = gears[place.joint], n + place.eta
        K[k, k], D[k, k] = gear.stiffness or 0.0, gear.damping
    return K, D


def weighed_system(
    description: Description,
    links: Sequence[Link],
    parts: Mapping[str, FlexiblePart],
    rigid: System,
    like: System,
) -> System:
    """The flexible system of parts that move as those of another: of it all but their numbers."""
    expansion = weighed(like.expansion, links, parts)
    return like.weighed(rigid.rigid, expansion, *_matrices(description, expansion, parts, rigid))


def flexible_system(
    description: Description,
    expansion: Expansion,
    parts: Mapping[str, FlexiblePart],
    assembled: Assembled,
) -> tuple[System, LoopReport]:
    """The system in which links bend and elastic joints give way, and its closure rows."""
    rigid, home, idle = assembled.system, assembled.home, assembled.idle
    K, D = _matrices(description, expansion, parts, rigid)
    m = expansion.n_eta
    ground, fit = assembled.ground, assembled.misfit
    every = _closures(description, assembled.loops, parts, expansion, ground, fit)
    placed = loads(description, expansion.frames)
    system = System(
        rigid.rigid, expansion, every, K, D, rigid.springs, rigid.motors, placed, idle.held,
        rigid.friction, added_masses(description, expansion.frames),
        kinks(description, rigid.rigid, expansion),
    )  # fmt: skip
    require_workspace(description.name, system, description.limit)
    J = np.zeros((0, system.nv))
    if every.n:
        # By the reference: once, where tables for the compiled kernel cost more than they save.
        J = Equations(system).reference.close(np.concatenate([home, np.zeros(m)])[None]).J[0]
    kept, redundant = assembly.independent_rows(J, every.labels, fit.rank)
    own = len(idle.spins) + len(description.couplings)
    rows, rank = every.n - own, len(kept) - own
    report = replace(assembled.report, rows=rows, rank=rank, redundant=redundant)
    if redundant:
        system = replace(system, closed=every.select(kept))
    return system, report


def _with_lengths(loops: Sequence[Loop], system: System, guess: Array) -> tuple[Loop, ...]:
    """Loops whose distances that were not given are as they are at the home guess."""
    closed = system.closed
    some = replace(closed, lengths=np.ones(closed.n))
    dynamics = Equations(replace(system, closed=some))
    a, b = np.split(closed.frames(dynamics.joint_poses(guess))[0, :, :, 3], 2)
    apart = dict(zip(closed.names, np.linalg.norm(b - a, axis=1).tolist(), strict=True))
    open_ = [loop for loop in loops if loop.kind == "distance" and loop.length is None]
    if any(apart[loop.name] < 1e-12 for loop in open_):
        raise DescriptionError("loops: a distance of zero. Use kind: spherical for a common point.")
    return tuple(replace(x, length=apart[x.name]) if x in open_ else x for x in loops)


def _refuse_singular_home(
    description: Description,
    dynamics: Equations,
    home: Array,
    redundant: Sequence[str],
    every: Closures,
    small: float,
) -> None:
    """Rows that are dependent only at home, not beside it, mean that home itself is singular."""
    full = Equations(replace(dynamics.system, closed=every))
    here = every.n - len(redundant)
    beside = assembly.rank_beside(dynamics, full, home, small)
    if beside > here:
        raise SingularityError(
            f"{description.name}: home: singular pose: the closures have rank {here} here "
            f"and {beside} beside it; dependent at home: {', '.join(redundant)}. "
            f"Give a `home` away from this pose.{axis_hint(full, description.loops, home)}",
            redundant=tuple(redundant),
        )


# What the model weighs, held against what the scene says: mass, first moment, inertia at home.
#
# The scene's side adds up the links of the description, each at its pose of the rigid tree; nothing
# of the expanded model goes into it. A link weighs
#
# - what the URDF says, and its end masses `root` and `tip`, where the URDF's inertia stays;
# - its beam or solid and what rides on it, where these take the place of the URDF's inertia, where
#   they are given (`bodies`), and where the link is another design than the one built (`as_built`).
#
# A payload is added at its frame. What cannot move, at the root of the ground, is in neither sum.

OFF = 1e-9  # of the largest entry: sums of a thousand stations are right to 1e-13


def require_mass(
    description: Description,
    links: Sequence[Link],
    parts: Mapping[str, FlexiblePart],
    given: Iterable[str],
    rigid: System,
    flexible: System,
    home: Array,
) -> None:
    """Refuse a model that does not weigh what the scene says: an error of pinflex."""
    y = np.concatenate([home, np.zeros(flexible.n_eta)])
    poses = Equations(rigid).joint_poses(home)
    said = of_scene(description, links, parts, given, rigid, flexible, poses)
    made = mass_of_model(
        flexible, poses if flexible is rigid else Equations(flexible).joint_poses(y)
    )
    rotors = _rotors(description, links), float(flexible.expansion.model.armature.sum())
    off = np.abs(made - said).max() / max(np.abs(said).max(), np.finfo(float).tiny)
    turns = abs(rotors[1] - rotors[0]) / max(abs(rotors[0]), np.finfo(float).tiny)
    if max(off, turns) > OFF:  # what is not finite is not judged here
        raise AssemblyError(
            f"{description.name}: internal error: the model made of this scene does not weigh what "
            f"the scene says: {made[0, 0]:.6g} kg for {said[0, 0]:.6g} kg; mass, first moment and "
            f"inertia at home are off by {off:.1e} of the largest of them, rotors by {turns:.1e}. "
            "Nothing computed with it would be right; please report it with the model.",
            made=made,
            said=said,
        )


def mass_of_model(system: System, poses: Array) -> Array:
    """Spatial inertia (6, 6) of a model about the world's origin [kg, kg m, kg m^2]."""
    own = np.array([inertia.matrix() for inertia in system.expansion.model.inertias.tolist()])
    own[0] = 0.0
    for joint, more in zip(system.added.joints, system.added.inertia, strict=True):
        own[joint] += more
    return _summed(poses[0, :, :, :3], poses[0, :, :, 3], own)


def of_scene(
    description: Description,
    links: Sequence[Link],
    parts: Mapping[str, FlexiblePart],
    given: Iterable[str],
    rigid: System,
    flexible: System,
    poses: Array,
) -> Array:
    """The same of what the scene says: of its links, at their poses in the rigid tree, and of
    the masses added to frames.
    """
    frames = rigid.expansion.frames
    own: list[tuple[str, Array]] = []
    carried = description.payload
    for link in links:
        if carried is not None and link.name == carried.name:
            continue  # the model's; the scene's own is below
        part = parts.get(link.name)
        attachments = [s.expansion.frames.get(link.name) for s in (rigid, flexible)]
        still = all(at is not None and at.joint == 0 for at in attachments)
        if part is not None:
            own.append((link.name, _of_part(link, part, link.name in given, still)))
        elif link.weighs and not still:
            own.append((link.name, link.inertia.matrix()))
    own += [(one.frame, np.diag([*one.mass, *one.inertia])) for one in description.added_masses]
    if carried is not None and any(
        s.expansion.frames[carried.frame].joint for s in (rigid, flexible)
    ):
        own.append((carried.frame, carried.spatial))
    if not own:
        return np.zeros((6, 6))
    placed = [Frame(rigid.rigid, frames[name]).pose(poses) for name, _ in own]
    turn, place = (np.concatenate(values) for values in zip(*placed, strict=True))
    return _summed(turn, place, np.array([inertia for _, inertia in own]))


def _of_part(link: Link, part: FlexiblePart, given: bool, still: bool) -> Array:
    """Spatial inertia (6, 6) of a flexible link in its own frame; `still`: fixed to the ground."""
    if part.share is not None and part.spec.as_built is None and not given:
        own = [link.inertia]
        own += [_on_beam(part, r.x, r.inertia) for r in end_riders(part.spec, part.length)]
    else:
        own = [*part.rigid_inertias()]
    total = sum((inertia.matrix() for inertia in own), np.zeros((6, 6)))
    if still and not part.bodies[0].root_moves:  # what rides on its root cannot move
        at_root = [_on_beam(part, r.x, r.inertia) for r in part.riders if r.x <= 0]
        total -= sum((inertia.matrix() for inertia in at_root), np.zeros((6, 6)))
    return np.asarray(total)


def _on_beam(part: FlexiblePart, x: float, inertia: pin.Inertia) -> pin.Inertia:
    """An inertia on the section at x [m], in the frame of the link."""
    return (part.placement * pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))).act(inertia)


def _summed(turn: Array, place: Array, own: Array) -> Array:
    """Sum of inertias (n, 6, 6), each in axes (n, 3, 3) at a place (n, 3), about the origin."""
    to = np.zeros((len(own), 6, 6))  # twists at the origin to those of the frames
    to[:, :3, :3] = to[:, 3:, 3:] = turn.swapaxes(1, 2)
    to[:, :3, 3:] = -turn.swapaxes(1, 2) @ skew(place)
    return np.asarray((to.swapaxes(1, 2) @ own @ to).sum(axis=0))


def _rotors(description: Description, links: Sequence[Link]) -> float:
    """Sum of the rotors' inertias over the axes of their joints [kg m^2, kg]."""
    axes = {link.joint: sum(step.model.nv for step in link.steps) for link in links}
    return float(sum(e.armature * axes.get(name, 0) for name, e in description.joints.items()))
