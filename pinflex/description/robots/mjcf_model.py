"""An MJCF compiled by MuJoCo: what every attribute, default, frame and mesh of it means.

Before MuJoCo opens a file it is looked through for what would not end: files that are no files,
and copies without bound.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from pinflex.arrays import Array
from pinflex.description.files import MOST_DATA, MOST_TEXT, require_regular
from pinflex.description.robots.tree_text import Element, Tree, parse, pose
from pinflex.errors import DescriptionError

FREE, BALL, SLIDE, HINGE = range(4)  # mjtJoint
_COPIES = ("replicate", "composite", "flexcomp")  # elements with a count
_MOST = 100_000  # elements once all copies are written out


@dataclass
class Robot:
    """A compiled MJCF on its way into a tree.

    Attributes:
        file: Its name.
        mujoco: The package.
        spec: Elements as the file writes them. model: What they come to.
        drawn: Poses of all bodies, geoms and sites in the world as the file draws them.
        links: Name of each body. joints: Name of each joint.
        tree: Links and joints. blocks: What a URDF cannot say. loops: Closures.
        refused: What equalities and motors are left out, and why, by what they are.
    """

    file: str
    mujoco: Any
    spec: Any
    model: Any
    drawn: Any
    links: list[str]
    joints: list[str]
    tree: Tree
    blocks: dict[str, Any] = field(default_factory=dict)
    loops: dict[str, Any] = field(default_factory=dict)
    refused: dict[str, list[str]] = field(default_factory=dict)

    @property
    def drives(self) -> list[tuple[int, int]]:
        """Actuators on joints of one freedom, with their joints."""
        model, on = self.model, (self.code("Trn.JOINT"), self.code("Trn.JOINTINPARENT"))
        return [
            (a, int(j))
            for a, (kind, j) in enumerate(
                zip(model.actuator_trntype, model.actuator_trnid[:, 0], strict=True)
            )
            if kind in on and model.jnt_type[j] > BALL
        ]

    def code(self, name: str) -> int:
        """A constant of MuJoCo."""
        kind, _, word = name.partition(".")
        return int(getattr(getattr(self.mujoco, f"mjt{kind}"), f"mj{kind.upper()}_{word}"))

    def body(self, k: int) -> Array:
        """Pose of a body in the world as drawn, shape (4, 4)."""
        return pose(self.drawn.xmat[k].reshape(3, 3), self.drawn.xpos[k])

    def enabled(self, what: str) -> bool:
        """Whether a <flag> leaves something on."""
        bits = self.mujoco.mjtDisableBit
        constraint = what in ("EQUALITY", "FRICTIONLOSS")
        whole = int(bits.mjDSBL_CONSTRAINT) if constraint else 0
        bit = int(getattr(bits, f"mjDSBL_{what}")) | whole
        return not self.model.opt.disableflags & bit

    def label(self, group: str, k: int) -> str:
        """Name of an element, or its line where it has none."""
        found = (e for e in getattr(self.spec, group) if e.id == k)
        return next((str(e.name or e.info) for e in found), f"number {k + 1}")

    def refuse(self, what: str, name: str) -> None:
        """Note what is left out."""
        self.refused.setdefault(what, []).append(name)


def compiled(text: str, file: str, folder: Path) -> Robot:
    """A file as MuJoCo understands it."""
    _look_through(text, file, folder)
    mujoco = _mujoco(file)
    path = folder / file
    try:
        kept = path.is_file() and path.read_text("utf-8-sig") == text
        with _silent(mujoco):
            spec = mujoco.MjSpec.from_file(str(path)) if kept else mujoco.MjSpec.from_string(text)
            _leave_pictures(mujoco, spec)
            for mesh in spec.meshes:
                for below in (spec.meshdir, "") if mesh.file else ():
                    require_regular(folder / below / mesh.file, MOST_DATA, f"{file}: {mesh.file}")
            model = spec.compile()
            data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
    except (ValueError, RuntimeError, TypeError, MemoryError, mujoco.FatalError) as error:
        raise DescriptionError(f"{file}: MuJoCo: {_sentence(error)} Correct the file.") from None
    links = [_name(model.body(k), f"body_{k}") for k in range(model.nbody)]
    return Robot(
        file, mujoco, spec, model, data, links, _joint_names(model, links),
        Tree(spec.modelname or Path(file).stem),
    )  # fmt: skip


def _mujoco(file: str) -> Any:
    """The package, of a version that says all that is read here."""
    try:
        mujoco = import_module("mujoco")
        old = not hasattr(mujoco.MjModel, "jnt_stiffnesspoly")
    except ImportError:
        old = True
    if old:
        raise DescriptionError(
            f"{file}: is an MJCF, which the package mujoco (3.17 or newer) reads, and that is not "
            'installed. Run `pip install "pinflex[mjcf]"`.'
        )
    return mujoco


@contextmanager
def _silent(mujoco: Any) -> Iterator[None]:
    """No warnings of what a later MuJoCo will not read, which it writes to a file as well."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        mujoco.set_mju_user_warning(before)


def _name(item: Any, default: str) -> str:
    return str(item.name) or default


def _joint_names(model: Any, links: list[str]) -> list[str]:
    names = []
    for k, body in enumerate(model.jnt_bodyid):
        which = k - int(model.body_jntadr[body])
        default = f"{links[body]}_joint" + (f"_{which + 1}" if which else "")
        names.append(_name(model.joint(k), default))
    return names


def _sentence(error: Exception) -> str:
    """MuJoCo's message on one line."""
    parts = [part.strip(" .") for part in str(error).splitlines()]
    words = ", ".join(part for part in parts if part)
    return re.sub(r"^((XML )?Error: |XML parse error \d+:, .*?: )+", "", words) + "."


def _leave_pictures(mujoco: Any, spec: Any) -> None:
    """Take textures and height fields away: they can be missing or huge, and carry no mass.

    Bodies that a file fuses stay apart, so that they have their names, and shapes that it drops
    after taking their mass are drawn.
    """
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    for geom in list(spec.geoms):
        if geom.type == mujoco.mjtGeom.mjGEOM_HFIELD:
            spec.delete(geom)
    for owner in ("geoms", "sites", "tendons", "skins", "flexes"):
        for element in getattr(spec, owner):
            element.material = ""
    for unused in ("textures", "materials", "hfields", "skins"):
        for element in list(getattr(spec, unused)):
            spec.delete(element)


# Before MuJoCo -------------------------------------------------------------------------------


def _look_through(text: str, file: str, folder: Path) -> None:
    """Refuse what would not end."""
    root = parse(text, file, ("mujoco", "mujocoinclude"), "an MJCF")
    pending: list[tuple[Element, int]] = [(root, 1)]
    total, files = 0, {file}
    while pending:
        element, copies = pending.pop()
        if element.tag in _COPIES:
            copies *= _count(element)
        total += copies
        if total > _MOST:
            raise DescriptionError(
                f"{element.place}: <{element.tag}> comes to more than {_MOST} elements. Write "
                "fewer copies."
            )
        if element.tag == "include" and element.get("file"):
            pending.append((_included(element, folder, files), copies))
        pending += [(child, copies) for child in element.all()]


def _count(element: Element) -> int:
    """Copies that an element stands for; what is no number is for MuJoCo to refuse."""
    product = 1
    for part in element.get("count", "1").split():
        product *= max(1, int(part)) if part.isdecimal() and len(part) < 9 else 1
        if len(part) >= 9:
            return _MOST + 1
    return product


def _included(element: Element, folder: Path, files: set[str]) -> Element:
    """The root of a file that is included."""
    name = element.get("file", "")
    path = folder / name
    if name in files:
        raise DescriptionError(f"{element.place}: {name} is included before. Name it once.")
    files.add(name)
    require_regular(path, MOST_TEXT, f"{element.place}: include: {path.name}")
    try:
        text = path.read_text("utf-8-sig")
    except (OSError, ValueError):
        raise DescriptionError(
            f"{element.place}: include: cannot read {path.name}. Put it beside the model."
        ) from None
    return parse(text, path.name, (), "an MJCF")
