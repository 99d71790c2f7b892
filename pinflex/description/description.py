"""A mechanism as its files describe it: a URDF, and a YAML that adds all a URDF cannot say."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pinflex.description import sources
from pinflex.description.blocks import control, curved, external, flexible
from pinflex.description.blocks.control import Control, read_control
from pinflex.description.blocks.external import AddedMass, FrameForce, FrameSpring, Payload
from pinflex.description.blocks.flexible import Basis, EndMass, FlexibleLink
from pinflex.description.blocks.joints import (
    FRICTION,
    JOINTS,
    SHARE,
    SINGLE,
    Coupling,
    JointExtra,
    Tension,
    couplings,
    read_actuated,
    read_joints,
    read_share,
    with_urdf_dynamics,
)
from pinflex.description.blocks.material import Material
from pinflex.description.files import HOME_SIZES, Source, nameable
from pinflex.description.loops import LOOPS, PIN, RESIST, Loop, read_loops, resists
from pinflex.description.motions import motion
from pinflex.description.reading import schema, yaml_text
from pinflex.description.reading.schema import Vec3
from pinflex.description.section import Section
from pinflex.description.solve import KEYS as SOLVE
from pinflex.description.solve import SolveSpec, read_solve
from pinflex.errors import DescriptionError, ModelNotFoundError, nearest
from pinflex.rotations import quaternion
from pinflex.text import brief

# The block `home` of a description: a guess of the configuration in Pinocchio's layout.

Home = dict[str, float | tuple[float, ...]]


def read_home(value: object, where: str, types: Mapping[str, str]) -> Home:
    """The home guess in Pinocchio's layout; the file may also say rotation vectors and angles."""
    home: Home = {}
    movable = tuple(name for name, kind in types.items() if HOME_SIZES[kind])
    for name, item in schema.mapping(value, where).items():
        place = schema.at(where, name)
        kind = types[schema.known(name, place, movable, "moving joint")]
        sizes = HOME_SIZES[kind]
        if sizes == (1,):
            home[name] = schema.number(item, place, of=schema.quantity(kind))
            continue
        if not isinstance(item, list) or len(item) not in sizes:
            raise DescriptionError(
                f"{place}: {schema.shown(item)} does not fit a {kind} joint, which takes a list of "
                f"{' or '.join(map(str, sizes))} numbers. Correct it."
            )
        lengths = {"planar": 2, "floating": 3}.get(kind, 0)
        values = tuple(
            schema.number(v, f"{place}[{i}]", of="place" if i < lengths else "angle")
            for i, v in enumerate(item)
        )
        if kind == "universal":
            home |= {f"{name}.{axis + 1}": angle for axis, angle in enumerate(values)}
        elif kind == "planar":
            home[name] = (*values[:2], math.cos(values[2]), math.sin(values[2]))
        elif len(item) in (3, 6):
            home[name] = (*values[:-3], *quaternion(np.array(values[-3:])).tolist())
        else:
            norm = math.hypot(*values[-4:])
            if abs(norm - 1) > 1e-3:  # three digits are enough to be meant as a unit quaternion
                raise DescriptionError(
                    f"{place}: the quaternion x y z w has the norm {norm:.4g}. It must be 1."
                )
            home[name] = values
    return home


# The file of a description: a path, a folder, or the name of a model that comes with pinflex.

_PACKAGE = Path(__file__).resolve().parents[1]
_MODEL_FOLDERS = (_PACKAGE / "models", _PACKAGE.parent / "models")


def model_names() -> tuple[str, ...]:
    """Names of the models that come with pinflex."""
    found = (yaml_path for folder in _MODEL_FOLDERS for yaml_path in folder.glob("*/*.yaml"))
    return tuple(sorted({p.stem for p in found if p.stem == p.parent.name}))


def find_file(source: str | Path) -> Path:
    """The file that a path, a folder or the name of a shipped model means."""
    if not isinstance(source, (str, Path)) or "\0" in str(source) or not nameable(Path(source)):
        raise ModelNotFoundError(
            f"{schema.shown(source)}: no model. Give the path of a YAML file, its folder, or a "
            "shipped name."
        )
    path = Path(source)
    shown = str(source)
    if path.is_file():
        if path.suffix.lower() not in (".yaml", ".yml", *sources.READERS):
            raise DescriptionError(
                f'{shown}: not a YAML file. A description is a YAML with "urdf: {path.name}" or '
                "another URDF in it (models/README.md). Give that file."
            )
        return path
    named = (folder / shown / f"{shown}.yaml" for folder in _MODEL_FOLDERS if shown == path.name)
    shipped = next((file for file in named if file.is_file()), None)
    if path.is_dir():
        inside = path / f"{path.resolve().name}.yaml"
        if inside.is_file():
            return inside
        others = [p.name for p in sorted(path.glob("*.yaml"))]
        if others or shipped is None:  # a folder of meshes, say, hides no model of its name
            raise ModelNotFoundError(
                f"{shown}: the folder holds no {inside.name}.{nearest(inside.name, others)} "
                "Give the file itself."
            )
    if shipped is not None:
        return shipped
    beside = [
        p.name
        for p in (sorted(path.parent.glob("*.y*ml")) if path.parent.is_dir() else ())
        if not p.name.startswith(".")
    ]
    known = (*beside, *model_names())
    raise ModelNotFoundError(
        f"{shown}: no such file, folder or shipped model.{nearest(path.name, known)} "
        "Give the path of a YAML file."
    )


__all__ = ["Basis", "Description", "EndMass", "FlexibleLink", "JointExtra", "Loop", "Material"]
__all__ += ["Section", "SolveSpec", "model_names", "read"]

ALLOWED = ("wide", "heavy", "large")
_NAMES = schema.LIST | {"items": schema.TEXT}


def _named(table: schema.Table) -> schema.Form:
    return schema.named_form(schema.block_form(table))


def _joints_form() -> schema.Form:
    return _named({key: LOOPS[key] for key in PIN} | JOINTS)  # of joints with clearance


def _loops_form() -> schema.Form:
    resist = {key: schema.bare({}) for key in RESIST} | {"friction": schema.bare(FRICTION)}
    form = _named(LOOPS | resist)
    del form["additionalProperties"]["anyOf"][0]["required"]  # a robot's file may have the rest
    return form


def _home_form() -> schema.Form:
    number = schema.measure("angle")
    return schema.named_form({"anyOf": [number, schema.LIST | {"items": number, "maxItems": 7}]})


@dataclass(frozen=True, kw_only=True)
class Description:
    """Everything a YAML and its URDF say, checked; models/README.md explains every key.

    Attributes:
        name: Name of the YAML file without its ending.
        path: The YAML file.
        urdf_name: File name of the URDF.
        urdf_text: The URDF.
        yaml_text: The YAML, with the overrides in it.
        package_dirs: Folders in which `package://` meshes are looked up.
        gravity: [m/s^2], world frame.
        base: fixed or free_flyer.
        joints: What the YAML adds to joints, by joint name; do not change it.
        couplings: Joints that follow others.
        actuated: Joints with a motor.
        share: How level rigid shares forces among more motors than freedoms: least, or
            those that pull.
        loops: Closures.
        idle: held or free: what becomes of freedoms that nothing hangs on.
        forces: Loads at frames.
        control: Feedback of level coupled.
        springs: Springs between frames.
        added_masses: Inertia at frames that differs with the direction.
        payload: What a frame carries.
        home: Guess of the configuration (rad | m), by joint name, as Pinocchio lays it out: a
            quaternion x y z w, a planar angle as cosine and sine; the axes of a universal joint
            are NAME.1 and NAME.2. Do not change it.
        platform: Frame whose motion matters, if any.
        frames: Further frames to report.
        by_joint: Link of each joint that the YAML names for a frame; do not change it.
        flexible: Links that deform.
        system_damping: Rayleigh (alpha [1/s], beta [s]) of the whole linear system of level ked.
        motion: The checked YAML block of the motion, for `motion.from_spec`.
        solve: What to compute.
        limit: Factor on the memory and the steps that are taken without asking.
        allow: What looks like a slip of units and is meant: some of `ALLOWED`.
        use_urdf_dynamics: Whether damping and friction of the URDF are in `joints`.
        notes: Features of the robot's file that are not taken over.
    """

    __repr__ = brief

    name: str
    path: Path | None
    urdf_name: str
    urdf_text: str
    yaml_text: str
    package_dirs: tuple[str, ...] = ()
    gravity: Vec3 = schema.triple((0.0, 0.0, -9.81), "acceleration")
    base: str = schema.word("fixed", ("fixed", "free_flyer"))
    joints: dict[str, JointExtra] = schema.bare(_joints_form, schema.REQUIRED, required=False)
    couplings: tuple[Coupling, ...] = ()
    actuated: tuple[str, ...] = schema.bare(_NAMES, ())
    share: str | Tension = schema.key("least", read_share, form=SHARE)
    loops: tuple[Loop, ...] = schema.bare(_loops_form, ())
    idle: str = schema.word("held", ("held", "free"))
    home: Home = schema.bare(_home_form, schema.REQUIRED, required=False)
    platform: str | None = schema.key(None, external.frame, given=True, form=schema.TEXT)
    frames: tuple[str, ...] = schema.key((), external.frames, given=True, form=_NAMES)
    by_joint: dict[str, str]
    flexible: tuple[FlexibleLink, ...] = schema.bare(lambda: _named(flexible.KEYS), ())
    system_damping: tuple[float, float] = (0.0, 0.0)
    forces: tuple[FrameForce, ...] = schema.key(
        (), external.read_forces, given=True, form=_named(external.FORCES)
    )
    springs: tuple[FrameSpring, ...] = schema.key(
        (), external.read_springs, given=True, form=_named(external.SPRINGS)
    )
    added_masses: tuple[AddedMass, ...] = schema.key(
        (), external.read_added_masses, given=True, form=_named(external.ADDED_MASSES)
    )
    payload: Payload | None = schema.key(
        None, external.read_payload, given=True, form=schema.block_form(external.PAYLOAD)
    )
    control: Control | None = schema.bare(control.form)
    motion: dict[str, Any] | None = schema.bare(motion.form)
    solve: SolveSpec = schema.key(SolveSpec(), read_solve, form=lambda: schema.block_form(SOLVE))
    limit: float = schema.real(1.0, "ratio", above=0)
    allow: tuple[str, ...] = schema.words(ALLOWED, "word")
    use_urdf_dynamics: bool = schema.flag(True)
    notes: tuple[str, ...] = ()

    @property
    def sources(self) -> dict[str, str]:
        """The texts this was read from, by file name."""
        return {self.urdf_name: self.urdf_text, f"{self.name}.yaml": self.yaml_text}

    @property
    def reported(self) -> tuple[str, ...]:
        """Frames to report: the platform first, where it is not among the others."""
        if self.platform is None or self.platform in self.frames:
            return self.frames
        return (self.platform, *self.frames)

    @property
    def tied(self) -> tuple[str, ...]:
        """Frames that loops tie, once each."""
        return tuple(dict.fromkeys(f for x in self.loops for f in (x.frame_a, x.frame_b)))

    @property
    def loaded(self) -> tuple[str, ...]:
        """Frames that forces, springs, added masses and the payload act on, once each."""
        springs = (f for x in self.springs for f in x.frames)
        carried = () if self.payload is None else (self.payload,)
        acting = (x.frame for x in (*self.forces, *self.added_masses, *carried))
        return tuple(dict.fromkeys([*acting, *springs]))

    def flexible_blocks(self) -> dict[str, Any]:
        """The YAML block of every flexible link, by link."""
        blocks = self.blocks().get("flexible") or {}
        return flexible.expand(blocks, f"{self.name}.yaml: flexible", self.tree())

    def blocks(self) -> dict[str, Any]:
        """The YAML as plain data, the caller's own."""
        return copy.deepcopy(self._blocks)

    @cached_property
    def _blocks(self) -> dict[str, Any]:
        label = f"{self.name}.yaml"
        return schema.mapping(yaml_text.load(self.yaml_text, label), label)

    def tree(self) -> Source:
        """The robot's file as every later step reads it."""
        return self._tree

    @cached_property
    def _tree(self) -> Source:
        return sources.read(self.urdf_text, self.urdf_name, self.package_dirs)

    def replace(self, **changes: Any) -> Description:
        """A copy with other fields; nothing is checked, unlike in `with_overrides`."""
        return dataclasses.replace(self, **changes)

    def with_overrides(self, assignments: Iterable[str]) -> Description:
        """The description of the same YAML with some values changed, checked like a file."""
        if isinstance(assignments, str) or not isinstance(assignments, Iterable):
            raise DescriptionError(
                f'overrides: {schema.shown(assignments)} is no list. Give ["key.path=value", ...].'
            )
        changes = [schema.text(change, "overrides") for change in assignments]
        if not changes:
            return self
        raw, tree = self.blocks(), dataclasses.replace(self.tree(), notes=self.notes)
        links: dict[str, list[str]] = {}
        if "flexible" in raw and any(c.strip().startswith("flexible") for c in changes):
            place = f"{self.name}.yaml: flexible"
            links = flexible.groups(schema.mapping(raw["flexible"], place), place, tree)
            raw["flexible"] = flexible.expand(raw["flexible"], place, tree)
        before = _robot(raw)
        for assignment in changes:
            yaml_text.set_path(raw, assignment)
        if links and _robot(raw) == before and isinstance(raw.get("flexible"), dict):
            raw["flexible"] = flexible.gathered(raw["flexible"], links)
        return _describe(
            _dumped(raw), self.name, self.path, tree if _robot(raw) == before else None, raw
        )


KEYS = schema.keys(
    Description, "urdf", "xacro_args", "gravity", "base", "joints", "actuated", "share", "loops",
    "idle", "home", "platform", "frames", "flexible", "damping",
    urdf=schema.bare(schema.TEXT, required=True),
    xacro_args=schema.bare(schema.named_form({"type": ["string", "number", "boolean"]})),
    damping=schema.bare(schema.block_form(flexible.DAMPING | {"scope": schema.bare({})})),
)  # fmt: skip


def json_schema() -> schema.Form:
    """The JSON Schema of a YAML file, for editors: keys, words and bounds as the readers have them.

    Shapes and kinds that are registered are in it. What one key alone cannot tell is left to the
    readers.
    """
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "pinflex description",
        **schema.block_form(KEYS),
    }


def read(source: str | Path) -> Description:
    """Read and check a description."""
    if sources.is_packaged(source):
        name = str(source).partition(":")[2]
        return _describe(_dumped({"urdf": str(source)}), name, None, None)
    path = find_file(source)
    if sources.is_robot(path):
        return _describe(_dumped({"urdf": path.name}), path.stem, path, None)
    return _describe(sources.read_text(path, str(source)), path.stem, path, None)


def from_text(text: str, path: Path) -> Description:
    """A description of a YAML text that is to stand at `path`; the file need not be there."""
    return _describe(text, path.stem, path, None)


def _describe(
    text: str, name: str, path: Path | None, tree: Source | None, raw: Any = None
) -> Description:
    """Check the whole YAML; `tree` spares reading the robot again, `raw` parsing the text."""
    file = f"{name}.yaml" if path is None else path.name
    raw = yaml_text.load(text, file) if raw is None else raw
    block = schema.Block(raw, file, KEYS)
    folder = Path() if path is None else path.parent
    if tree is None:
        named, args = schema.text(block["urdf"], block.at("urdf")), block.at("xacro_args")
        arguments = {
            name: _argument(value, schema.at(args, name))
            for name, value in schema.mapping(block.get("xacro_args", {}), args).items()
        }
        tree = sources.find(named, folder, block.at("urdf"), arguments)
    block, tree, text = _written_out(block, text, tree)
    values = block.read(tree)
    joints = read_joints(block.get("joints", {}), block.at("joints"), tree)
    types = _joint_types(tree, joints, values.get("base", "fixed"))
    loops = read_loops(block.get("loops", {}), block.at("loops"), tree)
    coupled = couplings(tree, joints, types, block.at("joints"))
    motors = read_actuated(block.get("actuated"), block.at("actuated"), types, bool(loops), coupled)
    _beside_motors(joints, motors, coupled, block.at("joints"))
    if values.get("use_urdf_dynamics", True):
        single = tuple(name for name in tree.joints if types[name] in SINGLE)
        joints = with_urdf_dynamics(joints, block.get("joints", {}), tree, single)
    values["system_damping"], values["flexible"] = flexible.read(block, tree)
    if "motion" in block:
        values["motion"] = motion.read(
            motion.without_units(block["motion"], types), block.at("motion"), folder, motors,
            "platform" in block, tree.text,
        )  # fmt: skip
    return Description(
        name=name,
        path=path,
        urdf_name=tree.file,
        urdf_text=tree.text,
        yaml_text=text,
        package_dirs=tree.package_dirs,
        joints=joints,
        couplings=coupled,
        actuated=motors,
        loops=loops,
        control=read_control(block.get("control", {}), block.at("control"), tree, motors),
        home=read_home(block.get("home", {}), block.at("home"), types),
        by_joint=external.by_joint(block, tree),
        notes=tree.notes,
        **values,
    )


def _robot(raw: Mapping[str, Any]) -> str:
    """Text that changes with the robot: its file, the arguments, the loops that become joints."""
    return f"{raw.get('urdf')} {raw.get('xacro_args')}{_resisting(raw) or ''}"


def _resisting(raw: Mapping[str, Any]) -> dict[str, Any]:
    """Loops that become joints of the tree (`pinflex.description.blocks.bushing`)."""
    loops = raw.get("loops")
    named = loops.items() if isinstance(loops, dict) else ()
    return {name: spec for name, spec in named if isinstance(spec, dict) and resists(spec)}


def _argument(value: object, where: str) -> str:
    """An argument of a xacro as the text that a command line would give."""
    if isinstance(value, bool):
        return str(value).lower()
    return str(value) if isinstance(value, int | float) else schema.text(value, where)


def _written_out(block: schema.Block, text: str, tree: Source) -> tuple[schema.Block, Source, str]:
    """Block and robot with all that is short for more (chains, joints that are cut or yield).

    And the YAML text, which says all that the robot's file does not: loops, chains.
    """
    written: Mapping[str, Any] = block
    if tree.loops or tree.blocks:
        written = block = schema.Block(tree.joined(block), block.where, KEYS)
        text = _dumped(block)
    straight = curved.straightened(block, block.at("flexible"), tree)
    if straight is not None:
        written, tree = straight
        text = _dumped(written)
    joined = written.get("joints")
    extras = joined.values() if isinstance(joined, Mapping) else ()
    loose = any(isinstance(x, Mapping) and "clearance" in x for x in extras)
    if loose or _resisting(written):
        from pinflex.description.blocks import bushing  # late: few scenes have any

        written, tree = bushing.cut(written, tree, block.where) if loose else (written, tree)
        written, tree = bushing.yielding(schema.Block(written, block.where, KEYS), tree)
    return schema.Block(written, block.where, KEYS), tree, text


def _joint_types(tree: Source, joints: Mapping[str, JointExtra], base: str) -> dict[str, str]:
    """Type of every joint: the URDF's, unless the YAML says another."""
    types = {joint.name: joint.type for joint in tree.joints.values()}
    types |= {name: extra.type for name, extra in joints.items() if extra.type is not None}
    return types | ({"root_joint": "floating"} if base == "free_flyer" else {})


def _dumped(raw: Mapping[str, Any]) -> str:
    """The YAML text of parsed data."""
    quick = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # libyaml: a sixth of the time
    return str(
        yaml.dump(dict(raw), Dumper=quick, sort_keys=False, allow_unicode=True,
                  default_flow_style=None)
    )  # fmt: skip


def _beside_motors(
    joints: Mapping[str, JointExtra],
    actuated: tuple[str, ...],
    coupled: tuple[Coupling, ...],
    where: str,
) -> None:
    """A spring in a joint with a motor acts from link to link, and only a motor has a drive."""
    leaders = {one.joint: one.leader for one in coupled}
    for name, extra in joints.items():
        if extra.drive is not None and leaders.get(name) is not None:
            raise DescriptionError(
                f"{schema.at(where, name)}.drive: it follows {leaders[name]}, whose motor moves "
                "both. Write the drive there; rotor_inertia, spring, damper and friction may "
                "stand here."
            )
        if extra.drive is not None and name not in actuated:
            raise DescriptionError(
                f"{schema.at(where, name)}.drive: this joint has no motor. List it in `actuated`, "
                "or write `spring` and `damper` for a joint that gives way."
            )
        if extra.spring and not extra.parallel_spring and name in actuated:
            raise DescriptionError(
                f"{schema.at(where, name)}.spring: this joint has a motor, and the spring would "
                "act beside it, not between motor and link. For an elastic gear write drive: "
                "{gear: ..., motor_inertia: ..., stiffness: ...}. A spring that does act beside "
                "the motor is `parallel_spring`."
            )
