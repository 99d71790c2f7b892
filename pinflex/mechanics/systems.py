"""The rigid and the flexible system of a scene, with the closure rows that are independent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.description.description import Description
from pinflex.description.drives import elastic
from pinflex.description.frames import WORLD
from pinflex.errors import DescriptionError, SingularityError
from pinflex.mechanics import assembly
from pinflex.mechanics.added_mass import added_masses
from pinflex.mechanics.assembly import LoopReport
from pinflex.mechanics.closing import Closed, Limits, assemble
from pinflex.mechanics.closure import Closures, closures
from pinflex.mechanics.cost import require_workspace
from pinflex.mechanics.damping import link_damping, rows_of
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.expanded import Expansion
from pinflex.mechanics.frames import Frame
from pinflex.mechanics.freedoms import Idle
from pinflex.mechanics.friction import joint_friction
from pinflex.mechanics.held import at_rest, elastic_rows, idle_of
from pinflex.mechanics.home_guess import given, home_guess
from pinflex.mechanics.joints import joint_springs
from pinflex.mechanics.loads import loads, require_apart
from pinflex.mechanics.loop_axes import axis_hint
from pinflex.mechanics.misfit import Misfit
from pinflex.mechanics.parts import FlexiblePart
from pinflex.mechanics.reference.placing import Placing
from pinflex.mechanics.slider import sleeves
from pinflex.mechanics.system import System


@dataclass(frozen=True)
class Assembled:
    """The rigid system, closed at home.

    Attributes:
        system: With independent closure rows and what level rigid holds.
        home: Closed pose q, shape (nq,).
        report: Ranks, redundant rows, mobility.
        idle: Freedoms that need no motor.
        ground: Places in the world of loops that are held there, by loop.
        misfit: What makes loops fit that are open at home.
    """

    system: System
    home: Array
    report: LoopReport
    idle: Idle
    ground: Mapping[str, pin.SE3]
    misfit: Misfit


def rigid_system(
    description: Description,
    tree: Expansion,
    parts: Mapping[str, FlexiblePart],
    motors: IntArray,
    names: Sequence[str],
    limits: Limits,
) -> Assembled:
    """Close the loops of the rigid mechanism at home and keep the independent rows.

    Returns:
        The system at home.
    Raises:
        AssemblyError, SingularityError: Loops that cannot close, or a singular home.
    """
    model = tree.model
    springs, dampers = joint_springs(description, model)
    held = sleeves(description.loops, parts, tree, description.name)
    coupled = description.couplings
    guess = home_guess(description, model)
    ground = _ground(description, tree, guess)
    every = closures(description.loops, tree.frames, model, held, coupled, ground)
    nv = int(model.nv)
    placed = loads(description.forces, description.springs, tree.frames)
    system = System(
        model, tree, every, np.zeros((nv, nv)), np.diag(dampers), springs, motors, placed,
        friction=joint_friction(description, model),
        added=added_masses(description.added_masses, tree.frames),
    )  # fmt: skip
    system = replace(system, closed=_with_lengths(system, guess))
    dynamics = Equations(system)
    where = f"{description.name}: home"
    closed = Closed(guess, 0)
    if every.n:
        named = given(description, model)
        closed = assemble(dynamics, guess, motors, where, limits, named, description.loops)
        every = closed.misfit.built_in(every)
        system = replace(system, closed=closed.misfit.built_in(system.closed))
        dynamics = Equations(system)
    home, fit = closed.pose, closed.misfit
    require_apart(placed, model, home, description.name)
    _, J = dynamics.close(home) if every.n else (None, np.zeros((0, nv)))
    kept, redundant = assembly.independent_rows(J, system.closed.labels, fit.rank)
    system = replace(system, closed=system.closed.select(kept))
    elastic = elastic_rows(J[kept], motors, springs)
    system = replace(system, held=elastic)
    home = at_rest(system, description, home, names)
    idle = idle_of(system, description, home)
    spun = len(idle.spins)
    if spun:
        loops = (*description.loops, *idle.spins)
        both = fit.built_in(closures(loops, tree.frames, model, held, coupled, ground))
        both = replace(both, lengths=_lengths_of(system.closed, description))
        rows = np.concatenate([kept, every.n + np.arange(spun)])
        system = replace(system, closed=both.select(rows))
    system = replace(system, held=np.union1d(elastic, idle.held).astype(np.intp))
    sigma = float("nan")
    if every.n:
        dynamics = Equations(system)
        dynamics.require_on_beams(home, where)
        if redundant:
            full = replace(every, lengths=_fill(dynamics, every))
            _refuse_singular_home(description, dynamics, home, redundant, full, fit.rank)
        if len(motors) + len(system.held) >= nv - len(kept) - spun:
            sigma = _sigma_at_home(dynamics, description, home, names, where)
    joined = len(coupled)
    report = LoopReport(
        every.n - joined,
        len(kept) - joined,
        redundant,
        nv - len(kept) - spun - len(system.held),
        sigma,
        closed.starts,
        joined,
        fit.gaps,
    )
    return Assembled(system, home, report, idle, ground, fit)


def _sigma_at_home(
    dynamics: Equations, description: Description, home: Array, names: Sequence[str], where: str
) -> float:
    """How far home is from a singular pose with motors and held joints locked; 1 is best."""
    system = dynamics.system
    locked = np.union1d(system.motors, system.held).astype(np.intp)
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


def flexible_system(
    description: Description,
    expansion: Expansion,
    parts: Mapping[str, FlexiblePart],
    assembled: Assembled,
) -> tuple[System, LoopReport]:
    """The system in which links bend and elastic joints give way, and its closure rows."""
    rigid, home, idle = assembled.system, assembled.home, assembled.idle
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
    held = sleeves(description.loops, parts, expansion, description.name)
    loops = (*description.loops, *idle.spins)
    coupled = description.couplings
    every = closures(loops, expansion.frames, expansion.model, held, coupled, assembled.ground)
    every = assembled.misfit.built_in(every)
    lengths = _lengths_of(rigid.closed, description)
    every = replace(every, lengths=lengths)
    placed = loads(description.forces, description.springs, expansion.frames)
    system = System(
        rigid.rigid, expansion, every, K, D, rigid.springs, rigid.motors, placed, idle.held,
        rigid.friction, added_masses(description.added_masses, expansion.frames),
    )  # fmt: skip
    require_workspace(description.name, system, description.limit)
    J = np.zeros((0, n + m))
    if every.n:
        _, J = Equations(system).close(np.concatenate([home, np.zeros(m)]))
    kept, redundant = assembly.independent_rows(J, every.labels, assembled.misfit.rank)
    spun = len(idle.spins)
    own = spun + len(coupled)
    report = LoopReport(every.n - own, len(kept) - own, redundant, 0, float("nan"))
    if redundant:
        system = replace(system, closed=every.select(kept))
    return system, report


def _lengths_of(closed: Closures, description: Description) -> Array:
    """Distances as assembled (a distance row is never redundant with itself)."""
    by_name = {
        closed.names[closed.loop_of[row]]: length
        for row, length in zip(closed.distance_rows, closed.lengths, strict=True)
    }
    return np.array([by_name[p.name] for p in description.loops if p.kind == "distance"])


def _with_lengths(system: System, guess: Array) -> Closures:
    """Distances that were not given are taken as they are at the home guess."""
    closed = system.closed
    if not np.any(np.isnan(closed.lengths)):
        return closed
    dynamics = Equations(
        replace(system, closed=replace(closed, lengths=np.ones(len(closed.lengths))))
    )
    origins = closed.frames(dynamics.joint_poses(guess))[0, :, :, 3]
    a, loops = closed.loop_of[closed.distance_rows], len(closed.names)
    measured = np.linalg.norm(origins[loops + a] - origins[a], axis=1)
    lengths = np.where(np.isnan(closed.lengths), measured, closed.lengths)
    if np.any(lengths < 1e-12):
        raise DescriptionError("loops: a distance of zero. Use kind: spherical for a common point.")
    return replace(closed, lengths=lengths)


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


def _fill(dynamics: Equations, every: Closures) -> Array:
    closed = dynamics.system.closed
    by_loop = {
        int(closed.loop_of[row]): length
        for row, length in zip(closed.distance_rows, closed.lengths, strict=True)
    }
    loops = every.loop_of[every.distance_rows]
    return np.array([by_loop.get(int(k), 1.0) for k in loops], dtype=float)
