"""From a description to equations: load() gives a frozen Mechanism."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.bodies.basis import FlexibleBody
from pinflex.description.description import Description, read
from pinflex.description.flexible import FlexibleLink
from pinflex.description.schema import shown
from pinflex.errors import DescriptionError, SingularityError, nearest
from pinflex.mechanics import assembly, relevance
from pinflex.mechanics.assembly import LoopReport
from pinflex.mechanics.closing import Closed, Limits, assemble, limits_of
from pinflex.mechanics.closure import Closures, closures
from pinflex.mechanics.cost import require_workspace
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.expanded import Attachment, Expansion
from pinflex.mechanics.expansion import expand, of_model
from pinflex.mechanics.freedoms import Idle
from pinflex.mechanics.held import at_rest, elastic_rows, idle_of
from pinflex.mechanics.home_guess import given, home_guess
from pinflex.mechanics.loads import loads
from pinflex.mechanics.loop_axes import axis_hint
from pinflex.mechanics.parts import FlexiblePart, LeftOut, any_undecided, resolve
from pinflex.mechanics.plausible import require_size
from pinflex.mechanics.ride import end_riders
from pinflex.mechanics.slider import sleeves
from pinflex.mechanics.system import Springs, System
from pinflex.mechanics.tree import Link, link_tree
from pinflex.text import short

# Elastic coordinates above which `auto` is decided with a coarse model: it need not be exact.
_LOOK = 100


@dataclass(frozen=True)
class Mechanism:
    """A robot ready to be solved, rigid and flexible side by side; nothing in it changes.

    Attributes:
        description: What was read.
        links: Link tree.
        parts: Flexible links by name.
        rigid: The rigid mechanism (flexible links undeformed).
        flexible: The flexible mechanism: links bend, elastic joints give way; the same object as
            `rigid` where there are neither.
        home: Closed rigid pose q, shape (nq_rigid,).
        coordinates: Name of every rigid velocity row.
        report: Ranks, redundant rows, mobility of the rigid mechanism with elastic joints held.
        flexible_report: The same of the flexible one.
        idle: Freedoms that need no motor (see `pinflex.mechanics.freedoms`).
    """

    description: Description
    links: tuple[Link, ...]
    parts: Mapping[str, FlexiblePart]
    rigid: System
    flexible: System
    home: Array
    coordinates: tuple[str, ...]
    report: LoopReport
    flexible_report: LoopReport
    idle: Idle = field(default_factory=Idle)

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.description.name

    @property
    def elastic_joints(self) -> tuple[str, ...]:
        """Coordinates with a spring that nothing else determines: level rigid holds them."""
        held = np.setdiff1d(self.rigid.held, self.idle.held)
        return tuple(self.coordinates[k] for k in held)

    @property
    def compliant(self) -> bool:
        """Whether anything gives way: a flexible link or an elastic joint."""
        return self.flexible is not self.rigid

    @cached_property
    def loose(self) -> System:
        """The flexible mechanism of level coupled: a free base and loose bodies are let go."""
        let_go = np.union1d(self.idle.base, self.idle.loose)
        if not len(let_go):
            return self.flexible
        held = np.setdiff1d(self.flexible.held, let_go).astype(np.intp)
        return replace(self.flexible, held=held)

    @property
    def motors(self) -> tuple[str, ...]:
        """Names of the motor coordinates, in torque order."""
        return tuple(self.coordinates[k] for k in self.rigid.motors)

    def __repr__(self) -> str:
        name = short(self.name, 60)
        return (
            f"Mechanism({name}, {self.rigid.nv} joint coordinates, mobility "
            f"{self.report.mobility}, {len(self.motors)} motors, {len(self.parts)} flexible links)"
        )

    def undeformed(self, q: Array | None = None) -> Array:
        """y of the flexible mechanism at a rigid pose, eta = 0."""
        q = self.home if q is None else np.asarray(q)
        if q.shape != self.home.shape or q.dtype.kind not in "fi" or not np.all(np.isfinite(q)):
            raise DescriptionError(
                f"{self.name}: q: {shown(q.tolist())} is no rigid pose. Give the "
                f"{len(self.home)} numbers of a configuration, such as mechanism.home."
            )
        return np.concatenate([q, np.zeros(self.flexible.n_eta)])

    def held_at_home(self, q: Array) -> Array:
        """A rigid pose with its elastic joints where the rigid mechanism holds them."""
        pose, s = q.copy(), self.rigid.springs
        for k in np.flatnonzero(np.isin(s.v_at, self.rigid.held)):
            at = slice(s.q_at[k], s.q_at[k] + 1 + s.paired[k])
            pose[at] = self.home[at]
        return pose

    def frame(self, name: str) -> Attachment:
        """Attachment of a link frame in the flexible model."""
        frames = self.flexible.expansion.frames
        name = self.description.by_joint.get(name, name)
        if name not in frames:
            raise DescriptionError(
                f"{self.name}: {name}: no such frame in the model.{nearest(name, frames)}"
            )
        return frames[name]


def load(
    source: str | Path | Description,
    overrides: Sequence[str] = (),
    bodies: Mapping[str, FlexibleBody] | None = None,
) -> Mechanism:
    """Read a model (URDF + YAML) and assemble it.

    Args:
        source: Path of a YAML file or folder, the name of a shipped model, or a Description.
        overrides: "key.path=value" changes of the YAML, applied before validation.
        bodies: Stations, stiffness and damping of flexible links by name, from anywhere, in place
            of those that the description makes, with their own mass in place of the URDF's.
    Returns:
        The mechanism with its loops closed at home.
    Raises:
        DescriptionError: Bad input, with file, key path, value and nearest choice.
        AssemblyError, SingularityError: Loops that cannot close, or a singular home.
    """
    description = source if isinstance(source, Description) else read(source)
    if overrides:
        description = description.with_overrides(overrides)
    model = _pinocchio_model(description)
    links = link_tree(model, description.joints)
    require_size(links, description.urdf_name, description.allow)
    own = bodies or {}
    look = any_undecided(description, links, own)
    coarse = look and sum(_size(spec) for spec in description.flexible) > _LOOK
    parts = _parts(description, links, own, coarse=coarse)
    needed = _needed_frames(description)
    gravity = np.array(description.gravity, float)
    changed = any(extra.type for extra in description.joints.values())
    if parts or changed:
        tree = expand(links, parts, needed, None, gravity)
    else:
        tree = of_model(model, links)
    _add_rotors(tree.model, description)
    coordinates = _coordinates(tree.model)
    motors = _motors(description, tree.model)
    limits = limits_of(model, tree.model)
    rigid, home, report, idle = _rigid_system(description, tree, parts, motors, coordinates, limits)
    if not parts:
        elastic = len(rigid.held) > len(idle.held)
        flexible = replace(rigid, held=idle.held) if elastic else rigid
        return Mechanism(
            description, links, parts, rigid, flexible, home, coordinates, report, report, idle
        )

    def with_elasticity() -> tuple[System, LoopReport]:
        expansion = expand(links, parts, needed, rigid.rigid, gravity)
        require_workspace(description.name, int(expansion.model.nv), description.limit)
        expansion.model.armature[expansion.v_at] = rigid.rigid.armature
        return _flexible_system(description, expansion, parts, rigid, home, idle)

    flexible, flexible_report = with_elasticity()
    if look:
        out = relevance.left_out(description, links, parts, flexible, home, tuple(own))
        if coarse or any(out.values()):
            parts = _parts(description, links, own, out)
            tree = expand(links, parts, needed, None, gravity)
            _add_rotors(tree.model, description)
            if rigid.closed.contacts:  # a sleeve knows the beam that it is on
                rigid, home, report, idle = _rigid_system(
                    description, tree, parts, motors, coordinates, limits
                )
            else:  # the same joints, other masses at most
                rigid = replace(rigid, rigid=tree.model, expansion=tree)
            flexible, flexible_report = with_elasticity()
    return Mechanism(
        description,
        links,
        parts,
        rigid,
        flexible,
        home,
        coordinates,
        report,
        replace(
            flexible_report,
            mobility=report.mobility,
            sigma_min=report.sigma_min,
            starts=report.starts,
        ),
        idle,
    )


def _parts(
    description: Description,
    links: Sequence[Link],
    own: Mapping[str, FlexibleBody],
    without: Mapping[str, Sequence[LeftOut]] | None = None,
    coarse: bool = False,
) -> dict[str, FlexiblePart]:
    """Flexible links with their bodies, some of them given."""
    parts = resolve(description, links, without, coarse)
    for name, body in own.items():
        if name not in parts:
            known = nearest(name, parts)
            raise DescriptionError(f"{description.name}: bodies: {name} is not flexible.{known}")
        part = parts[name]
        ends = end_riders(part.spec, part.length)
        parts[name] = replace(part, bodies=(body,) * len(part.bodies), riders=ends, share=None)
    for part in parts.values():
        for patch in part.spec.patches:
            patch.require_on_beam(f"{description.name}: flexible.{part.link}", part.length)
    return parts


def _size(spec: FlexibleLink) -> int:
    """How many coordinates a beam has with every direction on, roughly."""
    basis = spec.basis
    most = {"craig_bampton": basis.internal + 2, "finite_element": 2 * basis.elements}
    return 4 * spec.segments * most.get(basis.kind, basis.modes)


def _pinocchio_model(description: Description) -> pin.Model:
    where = description.urdf_name
    try:
        if description.base == "free_flyer":
            model = pin.buildModelFromXML(description.urdf_text, pin.JointModelFreeFlyer())
        else:
            model = pin.buildModelFromXML(description.urdf_text)
    except Exception as error:
        raise DescriptionError(
            f"{where}: Pinocchio cannot read this URDF: {str(error).strip()}. "
            "Check it with a URDF checker; the names of links and joints must be unique."
        ) from error
    model.gravity.linear = np.array(description.gravity, float)
    return model


def _needed_frames(description: Description) -> frozenset[str]:
    frames = {f for loop in description.loops for f in (loop.frame_a, loop.frame_b)}
    frames.update(description.frames)
    frames.update(force.frame for force in description.forces)
    frames.update(f for spring in description.springs for f in (spring.frame_a, spring.frame_b))
    if description.platform is not None:
        frames.add(description.platform)
    return frozenset(frames)


def _coordinates(model: pin.Model) -> tuple[str, ...]:
    names: list[str] = []
    for joint, name in zip(model.joints[1:], model.names[1:], strict=True):
        names.extend([name] if joint.nv == 1 else [f"{name}[{k}]" for k in range(joint.nv)])
    return tuple(names)


def _motors(description: Description, model: pin.Model) -> IntArray:
    rows: list[int] = []
    for name in description.actuated:
        joint = model.joints[model.getJointId(name)] if model.existJointName(name) else None
        if joint is None:
            raise DescriptionError(
                f"{description.name}: actuated: {name} is not a moving joint."
                f"{nearest(name, list(model.names)[1:])}"
            )
        rows.extend(range(joint.idx_v, joint.idx_v + joint.nv))
    return np.array(rows, dtype=np.intp)


def _rows_of(model: pin.Model, name: str) -> list[int]:
    """Velocity rows of a URDF joint; a universal joint is two: NAME.1 and NAME.2."""
    rows: list[int] = []
    for joint_name in (name, f"{name}.1", f"{name}.2"):
        if model.existJointName(joint_name):
            joint = model.joints[model.getJointId(joint_name)]
            rows.extend(range(joint.idx_v, joint.idx_v + joint.nv))
    return rows


def _add_rotors(model: pin.Model, description: Description) -> None:
    for name, extra in description.joints.items():
        if extra.rotor_inertia:
            model.armature[_rows_of(model, name)] = extra.rotor_inertia


def _springs(description: Description, model: pin.Model) -> tuple[Springs, Array]:
    """Springs, and the dampers' diagonal, of the rigid joints."""
    damping = np.zeros(model.nv)
    found: list[tuple[int, int, int, float, float]] = []
    for name, extra in description.joints.items():
        if extra.damper:
            damping[_rows_of(model, name)] = extra.damper
        if extra.spring:
            rows = _rows_of(model, name)
            if len(rows) != 1:
                raise DescriptionError(
                    f"{description.name}: joints.{name}.spring: {len(rows)} axes in one joint. "
                    "Springs act on single-axis joints; split the joint in the URDF."
                )
            joint = model.joints[model.getJointId(name)]
            paired = int(joint.nq == 2)
            found.append((joint.idx_v, joint.idx_q, paired, extra.spring, extra.rest))
    springs = Springs(
        np.array([f[0] for f in found], dtype=np.intp),
        np.array([f[1] for f in found], dtype=np.intp),
        np.array([f[2] for f in found], dtype=np.intp),
        np.array([f[3] for f in found], dtype=float),
        np.array([f[4] for f in found], dtype=float),
    )
    return springs, damping


def _rigid_system(
    description: Description,
    tree: Expansion,
    parts: Mapping[str, FlexiblePart],
    motors: IntArray,
    names: Sequence[str],
    limits: Limits,
) -> tuple[System, Array, LoopReport, Idle]:
    model = tree.model
    springs, dampers = _springs(description, model)
    held = sleeves(description.loops, parts, tree, description.name)
    every = closures(description.loops, tree.frames, model, held)
    nv = int(model.nv)
    placed = loads(description.forces, description.springs, tree.frames)
    system = System(
        model, tree, every, np.zeros((nv, nv)), np.diag(dampers), springs, motors, placed
    )  # fmt: skip
    guess = home_guess(description, model)
    system = replace(system, closed=_with_lengths(system, guess))
    dynamics = Dynamics(system)
    where = f"{description.name}: home"
    closed = Closed(guess, 0)
    if every.n:
        named = given(description, model)
        closed = assemble(dynamics, guess, motors, where, limits, named, description.loops)
    home = closed.pose
    _, J = dynamics.close(home) if every.n else (None, np.zeros((0, nv)))
    kept, redundant = assembly.independent_rows(J, system.closed.labels)
    system = replace(system, closed=system.closed.select(kept))
    elastic = elastic_rows(J, motors, springs)
    system = replace(system, held=elastic)
    home = at_rest(system, description, home, names)
    idle = idle_of(system, description, home)
    spun = len(idle.spins)
    if spun:
        both = closures((*description.loops, *idle.spins), tree.frames, model, held)
        both = replace(both, lengths=_lengths_of(system.closed, description))
        rows = np.concatenate([kept, every.n + np.arange(spun)])
        system = replace(system, closed=both.select(rows))
    system = replace(system, held=np.union1d(elastic, idle.held).astype(np.intp))
    dynamics = Dynamics(system)
    if every.n:
        dynamics.close(home)
        dynamics.closed.require_on_beams(where)
    sigma = float("nan")
    if every.n:
        if redundant:
            _refuse_singular_home(description, dynamics, home, redundant, every, kept)
        if len(motors) + len(system.held) >= nv - len(kept) - spun:
            locked = np.union1d(motors, system.held).astype(np.intp)
            try:
                sigma = assembly.require_regular(dynamics, home, locked, names, where)
            except SingularityError as error:
                why = axis_hint(dynamics, description.loops, home)
                raise SingularityError(f"{error}{why}", **error.data) from None
    mobility = nv - len(kept) - spun - len(system.held)
    report = LoopReport(every.n, len(kept), redundant, mobility, sigma, closed.starts)
    return system, home, report, idle


def _flexible_system(
    description: Description,
    expansion: Expansion,
    parts: Mapping[str, FlexiblePart],
    rigid: System,
    home: Array,
    idle: Idle,
) -> tuple[System, LoopReport]:
    n, m = int(rigid.rigid.nv), expansion.n_eta
    K, D = np.zeros((n + m, n + m)), np.zeros((n + m, n + m))
    D[:n, :n] = rigid.D
    for slot in expansion.slots:
        at = slice(n + slot.eta.start, n + slot.eta.stop)
        K[at, at], D[at, at] = slot.body.K, slot.body.D
    held = sleeves(description.loops, parts, expansion, description.name)
    loops = (*description.loops, *idle.spins)
    every = closures(loops, expansion.frames, expansion.model, held)
    lengths = _lengths_of(rigid.closed, description)
    every = replace(every, lengths=lengths)
    placed = loads(description.forces, description.springs, expansion.frames)
    system = System(
        rigid.rigid, expansion, every, K, D, rigid.springs, rigid.motors, placed, idle.held
    )  # fmt: skip
    J = np.zeros((0, n + m))
    if every.n:
        _, J = Dynamics(system).close(np.concatenate([home, np.zeros(m)]))
    kept, redundant = assembly.independent_rows(J, every.labels)
    spun = len(idle.spins)
    report = LoopReport(every.n - spun, len(kept) - spun, redundant, 0, float("nan"))
    return replace(system, closed=every.select(kept)), report


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
    dynamics = Dynamics(
        replace(system, closed=replace(closed, lengths=np.ones(len(closed.lengths))))
    )
    dynamics.close(guess)
    loops = closed.loop_of[closed.distance_rows]
    measured = np.linalg.norm(dynamics.closed.gap[loops], axis=1)
    lengths = np.where(np.isnan(closed.lengths), measured, closed.lengths)
    if np.any(lengths < 1e-12):
        raise DescriptionError("loops: a distance of zero. Use kind: spherical for a common point.")
    return replace(closed, lengths=lengths)


def _refuse_singular_home(
    description: Description,
    dynamics: Dynamics,
    home: Array,
    redundant: Sequence[str],
    every: Closures,
    kept: IntArray,
) -> None:
    """Rows that are dependent only at home, not beside it, mean that home itself is singular."""
    full = Dynamics(replace(dynamics.system, closed=replace(every, lengths=_fill(dynamics, every))))
    _, J = dynamics.close(home)
    _, _, Vt = np.linalg.svd(J) if len(J) else (None, None, np.eye(dynamics.n_rigid))
    for motion in Vt[len(J) :]:
        # Far enough to lift a dependent row over round-off, near enough to keep the branch.
        beside = dynamics.integrate(home, 1e-3 * motion)
        beside, size = assembly.close_loops(dynamics, beside, np.arange(dynamics.n_rigid))
        if size > 1e-9:
            continue
        _, J_beside = full.close(beside)
        rank = len(assembly.independent_rows(J_beside, every.labels)[0])
        if rank > len(kept):
            raise SingularityError(
                f"{description.name}: home: singular pose: the closures have rank {len(kept)} here "
                f"and {rank} beside it; dependent at home: {', '.join(redundant)}. "
                f"Give a `home` away from this pose.{axis_hint(full, description.loops, home)}",
                redundant=tuple(redundant),
            )


def _fill(dynamics: Dynamics, every: Closures) -> Array:
    closed = dynamics.system.closed
    by_loop = {
        int(closed.loop_of[row]): length
        for row, length in zip(closed.distance_rows, closed.lengths, strict=True)
    }
    loops = every.loop_of[every.distance_rows]
    return np.array([by_loop.get(int(k), 1.0) for k in loops], dtype=float)
