"""From a description to equations: load() gives a frozen Mechanism."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial, wraps
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, distinct
from pinflex.bodies.basis import FlexibleBody
from pinflex.boundary import public
from pinflex.description.blocks.flexible import FlexibleLink
from pinflex.description.blocks.joints import elastic
from pinflex.description.description import Description, read
from pinflex.description.motions.motion import Motion
from pinflex.description.reading.parameters import assignments
from pinflex.description.reading.schema import shown
from pinflex.description.robots.urdf import MotorLimits, motor_limits
from pinflex.doors import door
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.assembly import LoopReport
from pinflex.mechanics.closing import limits_of
from pinflex.mechanics.evaluation.compiled import evaluated_by
from pinflex.mechanics.evaluation.equations import Followed, share
from pinflex.mechanics.kinks import with_clearance
from pinflex.mechanics.model.expansion import expand, of_model, weighed
from pinflex.mechanics.model.loads import Attachment, Expansion
from pinflex.mechanics.model.parts import FlexiblePart, require_size, resolve, with_damping
from pinflex.mechanics.model.planes import LeftOut, Plane, Spans, any_undecided, plane_of
from pinflex.mechanics.model.relevance import left_out
from pinflex.mechanics.model.system import Idle, System
from pinflex.mechanics.model.tree import (
    Joint,
    Link,
    add_rotors,
    coordinate_names,
    end_riders,
    joint_of,
    link_tree,
    model_of,
    motor_rows,
)
from pinflex.mechanics.systems import (
    Assembled,
    flexible_system,
    require_mass,
    rigid_system,
    weighed_system,
)
from pinflex.names import Names, Records
from pinflex.report import card, pairs
from pinflex.text import frozen, short

_KEPT = 4  # systems of other designs: what a beam leaves to riders makes two or three of a robot
# Elastic coordinates above which `auto` is decided with a coarse model: it need not be exact.
_LOOK = 100
# Keys of a description that say nothing of how the rigid mechanism is closed.
_APART = (
    *("yaml_text", "share", "control", "motion", "flexible", "system_damping", "solve", "limit"),
    *("allow", "notes"),
)
_ASKED = ("yaml_text", "share", "control", "system_damping", "solve", "notes")  # not of a model
_MOVING = (*_ASKED, "motion", "flexible")  # of its links, but not of how they are put together
P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class Mechanism:
    """A robot ready to be solved, rigid and flexible side by side; nothing in it changes.

    Attributes:
        description: What was read.
        links: Link tree; links["crank_1"] is one.
        parts: Flexible links by name.
        rigid: The rigid mechanism (flexible links undeformed).
        flexible: The flexible mechanism: links bend, elastic joints give way; the same object as
            `rigid` where there are neither.
        home: Closed rigid pose q, shape (nq_rigid,).
        coordinates: Name of every rigid velocity row.
        report: Ranks, redundant rows, mobility of the rigid mechanism with elastic joints held.
        flexible_report: The same of the flexible one.
        idle: Freedoms that need no motor (see `pinflex.mechanics.freedoms`).
        own: Bodies of flexible links that `load` was given.
        origin: What loading found that others of the same robot may have too.
    """

    description: Description
    links: Records[Link]
    parts: Mapping[str, FlexiblePart]
    rigid: System
    flexible: System
    home: Array
    coordinates: tuple[str, ...]
    report: LoopReport
    flexible_report: LoopReport
    idle: Idle = field(default_factory=Idle)
    own: Mapping[str, FlexibleBody] = field(default_factory=dict)
    origin: _Loading | None = field(default=None, repr=False, compare=False)

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.description.name

    @property
    def elastic_joints(self) -> tuple[str, ...]:
        """Coordinates with a spring that nothing else determines: level rigid holds them."""
        held = self.rigid.held[~np.isin(self.rigid.held, self.idle.held)]
        return tuple(self.coordinates[k] for k in held)

    @property
    def compliant(self) -> bool:
        """Whether anything gives way: a flexible link or an elastic joint."""
        return self.flexible is not self.rigid

    @cached_property
    def followed(self) -> Followed:
        """Its rigid motions, as far as they were asked for."""
        return Followed()

    @cached_property
    def loose(self) -> System:
        """The flexible mechanism of level coupled: a free base and loose bodies are let go.

        Joints that have clearance are held by contact.
        """
        let_go = distinct(self.idle.base, self.idle.loose)
        system = with_clearance(self.flexible, self.description.loops)
        if not len(let_go):
            return system
        held = system.held[~np.isin(system.held, let_go)]
        return replace(system, held=held)

    @cached_property
    def standing(self) -> System:
        """The flexible mechanism at rest: pins that have clearance are held by contact.

        Rigid stops, which only bounce, resist there.
        """
        ideal = all(loop.clearance is None for loop in self.description.loops)
        if ideal and not self.flexible.kinks.rigid:
            return self.flexible
        system = self.loose
        return replace(system, held=self.flexible.held, kinks=system.kinks.stiff)

    @property
    def motors(self) -> tuple[str, ...]:
        """Names of the motor coordinates, in torque order."""
        return tuple(self.coordinates[k] for k in self.rigid.motors)

    @property
    def limits(self) -> MotorLimits:
        """Speed, acceleration, jerk and effort that the URDF allows motors, as far as written."""
        return motor_limits(self.description.urdf_text, self.description.actuated)

    @property
    def motion(self) -> Motion:
        """The motion of the YAML, shaped where it says so; one second at rest where it has none."""
        made: Motion = door("levels.modes", "default_motion")(self)
        return made

    def __repr__(self) -> str:
        name = short(self.name, 60)
        return (
            f"Mechanism({name}, {self.rigid.nv} joint coordinates, mobility "
            f"{self.report.mobility}, {len(self.motors)} motors, {len(self.parts)} flexible links)"
        )

    @property
    def joints(self) -> Names[Joint]:
        """Names of the moving joints; robot.joints["motor_1"] is one, with its kind and place."""
        model = self.rigid.rigid
        return Names(list(model.names)[1:], partial(joint_of, model, self.home, self.motors))

    @property
    def frames(self) -> Names[Attachment]:
        """Names of the frames that runs report; robot.frames["tool"] is where one sits."""
        return Names(self.description.reported, self.frame)

    @public
    def with_(self, *changes: str | Mapping[str, object]) -> Mechanism:
        """The mechanism of the same files with other values in the YAML.

        The same as `load` with these overrides, in less time: the robot's file, the rigid mechanism
        and its motion are this one's, where the changes do not touch them.

            stiffer = robot.with_({"flexible.*.section.thickness": 3e-3}, "solve.dt=1e-4")

        Args:
            *changes: Mappings from key path to value, or texts "key.path=value"; a segment may be
                a glob, see `load`.
        """
        return self.described(self.description.with_overrides(assignments(*changes)))

    def described(self, description: Description) -> Mechanism:
        """The mechanism of another description, with all of this one that the two share."""
        if self.origin is not None and _models_alike(self.description, description):
            found = replace(self, description=description)
        else:
            found = _Loading(description, self.own, self.origin).mechanism()
        share(self, found)
        return found

    def _repr_html_(self) -> str:
        links = ", ".join(self.parts) or "none"
        return card(
            f"{self.name}: mechanism",
            pairs([
                ("mobility", self.report.mobility),
                ("joint coordinates", self.rigid.nv),
                ("motors", ", ".join(self.motors) or "none"),
                ("flexible links", f"{links} ({self.flexible.n_eta} elastic coordinates)"),
                ("loops", ", ".join(p.name for p in self.description.loops) or "none"),
                ("frames", ", ".join(self.frames) or "none"),
            ]),
        )  # fmt: skip

    @property
    def evaluated_by(self) -> str:
        """The equations that serve the flexible mechanism: compiled, or why not."""
        return evaluated_by(self.flexible)

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


@public
def load(
    source: str | Path | Description,
    overrides: Sequence[str] = (),
    bodies: Mapping[str, FlexibleBody] | None = None,
    damping: Mapping[str, Array] | None = None,
) -> Mechanism:
    """Read a model (URDF + YAML) and assemble it.

    Args:
        source: Path of a YAML file or folder, the name of a shipped model, or a Description.
        overrides: "key.path=value" changes of the YAML, applied before validation.
        bodies: Stations, stiffness and damping of flexible links by name, from anywhere, in place
            of those that the description makes, with their own mass in place of the URDF's.
        damping: Matrices of flexible links by name, N s/m in their elastic coordinates, shape
            (n, n) each, in place of what the description says of them.
    Returns:
        The mechanism with its loops closed at home.
    Raises:
        DescriptionError: Bad input, with file, key path, value and nearest choice.
        AssemblyError, SingularityError: Loops that cannot close, or a singular home; or, an error
            of pinflex, a model that does not weigh what the scene says.
    """
    description = source if isinstance(source, Description) else read(source)
    if overrides:
        description = description.with_overrides(overrides)
    found = _Loading(description, bodies or {}).mechanism()
    if not damping:
        return found
    damped = with_damping(found.flexible, found.name, damping)
    return replace(found, flexible=damped, origin=None)  # which other descriptions do not have


def takes_model(
    function: Callable[Concatenate[Mechanism, P], R],
) -> Callable[Concatenate[Mechanism | Description | str | Path, P], R]:
    """A function of a mechanism that also takes what `load` takes: a name, a path."""
    name = next(iter(inspect.signature(function).parameters))

    @wraps(function)
    def called(*args: Any, **kwargs: Any) -> R:
        given = args[0] if args else kwargs.get(name)
        if isinstance(given, str | Path | Description):
            if args:
                args = (load(given), *args[1:])
            else:
                kwargs[name] = load(given)
        return function(*args, **kwargs)

    called.__annotations__ = {
        **function.__annotations__,
        name: Mechanism | Description | str | Path,
    }
    return called


@frozen
class _Systems:
    """Parts of a model and the systems made of them."""

    parts: Mapping[str, FlexiblePart]
    rigid: Assembled
    flexible: System
    report: LoopReport


class _Loading:
    """One mechanism on its way: what its rigid, coarse and final models have in common.

    Attributes:
        model, links: Of the robot's file; not changed.
        assembled: The rigid system, once it is closed.
        first, last: Systems to look at what deforms, and those of the mechanism, with others like
            them that the same robot had, the newest first.
    """

    def __init__(
        self,
        description: Description,
        own: Mapping[str, FlexibleBody],
        like: _Loading | None = None,
    ) -> None:
        """`like`: another one, whose model, links and rigid system serve where they are equal."""
        self.description, self.own = description, own
        self.gravity = np.array(description.gravity, float)
        named = (*description.tied, *description.loaded, *description.reported)
        self.needed = frozenset(named)
        self.geared = frozenset(elastic(description.joints))
        self.assembled: Assembled | None = None
        self.first: tuple[_Systems, ...] = ()
        self.last: tuple[_Systems, ...] = ()
        pairs = [(one.joint, one.leader) for one in description.couplings]
        self.coupled = {name for pair in pairs for name in pair if name is not None}
        self.plane: Plane
        spans: Spans = {}
        self.model: pin.Model
        self.links: tuple[Link, ...]
        if like is not None and _closes_alike(description, like.description):
            self.model, self.links, self.assembled = like.model, like.links, like.assembled
            spans = like.plane.spans
            if _alike(description, like.description, _MOVING):
                self.first, self.last = like.first, like.last
        else:
            self.model = model_of(description)
            self.links = link_tree(self.model, description.joints, self.coupled)
        require_size(self.links, description.urdf_name, description.allow)
        self.plane = plane_of(description, self.links, spans)

    def __reduce__(self) -> tuple[type[None], tuple[()]]:
        return type(None), ()  # found again where it is needed

    def mechanism(self) -> Mechanism:
        """Rigid system, then the flexible one: first coarse where `auto` has to be decided."""
        look = any_undecided(self.description, self.links, self.plane, self.own)
        coarse = look and sum(_size(spec) for spec in self.description.flexible) > _LOOK
        known, found = self.last, self.systems(self.parts(coarse=coarse), self.first, coarse)
        self.first, made = found, found[0]
        if look:
            parts, flexible, home = made.parts, made.flexible, made.rigid.home
            out = left_out(self.description, self.links, parts, flexible, home, tuple(self.own))
            if coarse or any(out.values()):
                found = self.systems(self.parts(out), known)
        self.last, made = found, found[0]
        self.assembled, rigid, flexible = made.rigid, made.rigid, made.flexible
        if all(flexible is not one.flexible for one in known):
            given = made.parts, self.own, rigid.system, flexible, rigid.home
            require_mass(self.description, self.links, *given)
        names = coordinate_names(rigid.system.rigid)
        return Mechanism(
            self.description, Records(self.links), made.parts, rigid.system, flexible, rigid.home,
            names, rigid.report, made.report, rigid.idle, self.own, self,
        )  # fmt: skip

    def systems(
        self, parts: Mapping[str, FlexiblePart], known: tuple[_Systems, ...], coarse: bool = False
    ) -> tuple[_Systems, ...]:
        """The systems of parts, and behind them those known before.

        One whose parts are the same is them; one whose parts move alike lends its joints.
        `coarse`: to look at, where masses of the rigid system do not matter.
        """
        same = next((one for one in known if _made_alike(parts, one.parts)), None)
        like = same or next((one for one in known if _moving_alike(parts, one)), None)
        made = replace(same, parts=parts) if same else self._made(parts, like, coarse)
        return made, *[one for one in known if one is not like][: _KEPT - 1]

    def _made(
        self, parts: Mapping[str, FlexiblePart], like: _Systems | None, coarse: bool
    ) -> _Systems:
        rigid = self.assembled
        if rigid is None or not coarse or rigid.system.closed.contacts:
            rigid = self.about(self.tree(parts, like), parts)
        if not parts and not self.geared:
            return _Systems(parts, rigid, *_with_elastic_joints(rigid))
        if like is not None:
            known = self.description, self.links, parts, rigid.system, like.flexible
            return _Systems(parts, rigid, weighed_system(*known), like.report)
        model, gears = rigid.system.rigid, self.geared
        expansion = expand(self.links, parts, self.needed, model, self.gravity, gears)
        expansion.model.armature[expansion.v_at] = model.armature
        return _Systems(parts, rigid, *flexible_system(self.description, expansion, parts, rigid))

    def parts(
        self, without: Mapping[str, Sequence[LeftOut]] | None = None, coarse: bool = False
    ) -> dict[str, FlexiblePart]:
        """Flexible links with their bodies, some of them given."""
        name = self.description.name
        parts = resolve(self.description, self.links, without, coarse, self.plane)
        for link, body in self.own.items():
            if link not in parts:
                known = nearest(link, parts)
                raise DescriptionError(f"{name}: bodies: {link} is not flexible.{known}")
            part = parts[link]
            ends = end_riders(part.spec, part.length)
            bodies = (body,) * len(part.bodies)
            parts[link] = replace(part, bodies=bodies, riders=ends, share=None)
        for part in parts.values():
            for patch in part.spec.patches:
                patch.require_on_beam(f"{name}: flexible.{part.link}", part.length)
        return parts

    def tree(self, parts: Mapping[str, FlexiblePart], like: _Systems | None) -> Expansion:
        """The rigid model: Pinocchio's own where the description adds nothing to it."""
        if like is not None:
            return weighed(like.rigid.system.expansion, self.links, parts)
        joints = self.model.joints
        turning = any(joints[self.model.getJointId(name)].nq > 1 for name in self.coupled)
        changed = turning or any(extra.type for extra in self.description.joints.values())
        if parts or changed:
            tree = expand(self.links, parts, self.needed, None, self.gravity)
        else:
            tree = of_model(self.model, self.links)
        add_rotors(tree.model, self.description)
        return tree

    def about(self, tree: Expansion, parts: Mapping[str, FlexiblePart]) -> Assembled:
        """The rigid system of a tree: one that is known, where masses at most are others."""
        known = self.assembled
        if known is None or known.system.closed.contacts:  # a sleeve knows the beam that it is on
            motors = motor_rows(self.description, tree.model)
            limits = limits_of(self.model, tree.model)
            names = coordinate_names(tree.model)
            self.assembled = rigid_system(self.description, tree, parts, motors, names, limits)
        else:
            system = known.system.weighed(tree.model, tree, known.system.K, known.system.D)
            self.assembled = replace(known, system=system)
        return self.assembled


def _with_elastic_joints(rigid: Assembled) -> tuple[System, LoopReport]:
    """The flexible system where no link bends: elastic joints alone give way, if there are any."""
    system, held = rigid.system, rigid.idle.held
    elastic = len(system.held) > len(held)
    return (replace(system, held=held) if elastic else system), rigid.report


def _alike(a: Description, b: Description, apart: Sequence[str]) -> bool:
    """Whether two descriptions say the same but for some keys."""
    keys = (x.name for x in fields(a) if x.name not in apart)
    return all(getattr(a, key) == getattr(b, key) for key in keys)


def _closes_alike(a: Description, b: Description) -> bool:
    """Whether two descriptions have the same joints and loops, and links that deform."""
    deform = bool(a.flexible) and bool(b.flexible)  # else the rigid tree may be Pinocchio's own
    return deform and _alike(a, b, _APART)


def _models_alike(a: Description, b: Description) -> bool:
    """Whether two descriptions have the same model: what they ask to compute may differ."""
    # the motion up to its end and speeds at the start tell what deforms
    told = ((x.solve.until, x.solve.start_speeds) for x in (a, b))
    return len({*map(str, told)}) == 1 and _alike(a, b, _ASKED)


def _made_alike(a: Mapping[str, FlexiblePart], b: Mapping[str, FlexiblePart]) -> bool:
    """Whether parts of two descriptions that are put together alike are the same."""
    told = ([(x.planes, x.length, x.spec, x.share) for x in parts.values()] for parts in (a, b))
    return a.keys() == b.keys() and next(told) == next(told)


def _moving_alike(parts: Mapping[str, FlexiblePart], like: _Systems) -> bool:
    """Whether parts fit on the joints of systems; a sleeve knows its beam."""
    if like.flexible.closed.contacts or not parts or parts.keys() != like.parts.keys():
        return False
    return all(part.moves_as(like.parts[name]) for name, part in parts.items())


def _size(spec: FlexibleLink) -> int:
    """How many coordinates a beam has with every direction on, roughly."""
    basis = spec.basis
    most = {"craig_bampton": basis.internal + 2, "finite_element": 2 * basis.elements}
    return 4 * spec.segments * most.get(basis.kind, basis.modes)
