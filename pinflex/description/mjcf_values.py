"""Attributes of an MJCF element: defaults by class, angles, orientations, masses of geoms.

Source: MuJoCo documentation, XML reference (compiler, default, body orientations, geom).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.files import MOST_TEXT, require_regular
from pinflex.description.tree_text import Inertia, Visual, pose
from pinflex.description.xml_lines import Element, known, numbers, parse
from pinflex.errors import DescriptionError
from pinflex.rotations import axis_turn

_DENSITY = 1000.0  # kg/m^3, MuJoCo's
_SHORTEST = 1e-12  # [m] of a direction


@dataclass
class Values:
    """What the attributes of a file mean.

    Attributes:
        root: The file with its includes in place.
        folder: Where its meshes are.
        classes: Attributes by class and tag, those of outer classes included.
        meshes: The <mesh> assets by name.
        notes: Sentences on what is left out.
    """

    root: Element
    folder: Path
    classes: dict[str, dict[str, dict[str, str]]] = field(default_factory=dict)
    meshes: dict[str, Element] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    compiler: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for element in self.root.all("compiler"):
            self.compiler |= element.attrib
        self.classes["main"] = {}
        for element in self.root.all("default"):
            self._read_class(element, element.get("class") or "main", {})
        for asset in self.root.all("asset"):
            for mesh in asset.all("mesh"):
                file = self.of(mesh, "main").get("file", "")
                self.meshes[mesh.get("name") or Path(file).stem] = mesh

    def _read_class(self, element: Element, name: str, outer: dict[str, dict[str, str]]) -> None:
        own = {tag: dict(values) for tag, values in {**self.classes["main"], **outer}.items()}
        if name == "main":
            own = {tag: dict(values) for tag, values in self.classes["main"].items()}
        for child in element.all():
            if child.tag != "default":
                own.setdefault(child.tag, {}).update(child.attrib)
        self.classes[name] = own
        for child in element.all("default"):
            if not child.get("class"):
                raise DescriptionError(f"{child.place}: <default> without a class. Name one.")
            self._read_class(child, child.get("class", ""), own)

    def of(self, element: Element, childclass: str) -> dict[str, str]:
        """Attributes of an element, with the defaults of its class under them.

        Args:
            element: An element.
            childclass: Default class of the body around it, for an element that names none.
        """
        name = element.get("class") or childclass
        known(name, self.classes, element, "default class")
        return {**self.classes[name].get(element.tag, {}), **element.attrib}

    def angle(self, values: Any) -> Any:
        """Angles of the file in rad."""
        return values if self.compiler.get("angle") == "radian" else np.radians(values)

    # Poses -----------------------------------------------------------------------------------

    def pose(self, element: Element, values: dict[str, str]) -> Array:
        """The pose of a body, inertial, geom or site.

        Args:
            element: An element, for messages.
            values: Its attributes, defaults included.
        """
        shift = numbers(values.get("pos", "0 0 0"), element, "pos", 3)
        return pose(self._rotation(element, values), shift)

    def _rotation(self, element: Element, values: dict[str, str]) -> Array:
        if "quat" in values:
            return quaternion(numbers(values["quat"], element, "quat", 4), element)
        if "axisangle" in values:
            *axis, angle = numbers(values["axisangle"], element, "axisangle", 4)
            return axis_turn(unit(np.array(axis), element, "axisangle"), float(self.angle(angle)))
        if "xyaxes" in values:
            six = numbers(values["xyaxes"], element, "xyaxes", 6)
            x = unit(six[:3], element, "xyaxes")
            y = unit(six[3:] - x * (x @ six[3:]), element, "xyaxes")
            return np.stack([x, y, np.cross(x, y)], axis=1)
        if "zaxis" in values:
            return along_z(unit(numbers(values["zaxis"], element, "zaxis", 3), element, "zaxis"))
        if "euler" in values:
            return self._euler(numbers(values["euler"], element, "euler", 3))
        return np.eye(3)

    def _euler(self, angles: Array) -> Array:
        total = np.eye(3)
        order = self.compiler.get("eulerseq", "xyz")
        for letter, angle in zip(order, self.angle(angles), strict=True):
            step = axis_turn(np.eye(3)["xyz".index(letter.lower())], float(angle))
            total = total @ step if letter.islower() else step @ total
        return total

    # Geoms -----------------------------------------------------------------------------------

    def ends(self, element: Element, values: dict[str, str]) -> tuple[Array, float | None]:
        """Pose of a geom, and its half length where `fromto` gives it.

        Args:
            element: A geom, for messages.
            values: Its attributes, defaults included.
        """
        if "fromto" not in values:
            return self.pose(element, values), None
        six = numbers(values["fromto"], element, "fromto", 6)
        a, b = six[:3], six[3:]
        # MuJoCo points z from the second end to the first
        axis = unit(a - b, element, "fromto")
        return pose(along_z(axis), (a + b) / 2), float(np.linalg.norm(a - b) / 2)

    def mesh_file(self, element: Element, name: str) -> tuple[str, Array]:
        """File of a mesh asset, relative to the model's folder, and its scale.

        Args:
            element: The geom that names the mesh.
            name: Of the asset.
        """
        mesh = self.meshes[known(name, self.meshes, element, "mesh")]
        values = self.of(mesh, "main")
        below = self.compiler.get("meshdir", self.compiler.get("assetdir", ""))
        file = values.get("file", "")
        scale = numbers(values.get("scale", "1 1 1"), mesh, "scale", 3)
        return str(Path(below) / file) if file else "", scale


def read_root(text: str, file: str, folder: Path, depth: int = 0) -> Element:
    """The root of an MJCF with its <include> files in place.

    Args:
        text: The XML.
        file: Its name, for messages.
        folder: Folder that included files are named from.
        depth: How many files include this one.
    """
    if depth > 8:
        raise DescriptionError(f"{file}: <include> goes 8 files deep. Break the circle.")
    root = parse(text, file, "mujoco", "an MJCF")
    _include(root, folder, depth)
    return root


def _include(element: Element, folder: Path, depth: int) -> None:
    for k, child in reversed(list(enumerate(element.all()))):
        if child.tag != "include":
            _include(child, folder, depth)
            continue
        path = folder / (child.get("file") or "")
        require_regular(path, MOST_TEXT, f"{child.place}: include: {path.name}")
        try:
            text = path.read_text("utf-8-sig")
        except (OSError, UnicodeDecodeError):
            raise DescriptionError(
                f"{child.place}: include: cannot read {path.name}. Put it beside the model."
            ) from None
        inside = read_root(text, path.name, folder, depth + 1)
        element[k : k + 1] = list(inside.all())


def unit(vector: Array, element: Element, key: str) -> Array:
    """The vector with length 1.

    Args:
        vector: Not zero, shape (3,).
        element: Where it stands, for messages.
        key: Its attribute.
    """
    size = float(np.linalg.norm(vector))
    if size < _SHORTEST:
        raise DescriptionError(
            f"{element.place}: <{element.tag}> {key}: {vector} has no direction. Correct it."
        )
    return np.asarray(vector / size)


def quaternion(values: Array, element: Element) -> Array:
    """Rotation matrix of a quaternion w x y z, not necessarily of length 1.

    Args:
        values: w x y z, shape (4,).
        element: Where it stands, for messages.
    """
    w, x, y, z = unit(values, element, "quat")
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def along_z(axis: Array) -> Array:
    """The smallest rotation that takes z to the unit axis, shape (3, 3)."""
    cross, c = np.cross([0.0, 0.0, 1.0], axis), float(axis[2])
    size = float(np.linalg.norm(cross))
    if size < _SHORTEST:
        return np.eye(3) if c > 0 else np.diag([1.0, -1.0, -1.0])
    return axis_turn(cross / size, math.atan2(size, c))


def inertial(values: Values, element: Element) -> Inertia:
    """The <inertial> of a body, in the body's frame.

    Args:
        values: What attributes mean.
        element: The <inertial>.
    """
    mass = float(numbers(element.get("mass"), element, "mass", 1, "mass")[0])
    if "fullinertia" in element.attrib:
        xx, yy, zz, xy, xz, yz = numbers(
            element.get("fullinertia"), element, "fullinertia", 6, "inertia"
        )
        about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    else:
        key = "diaginertia"
        about = np.diag(numbers(element.get(key, "0 0 0"), element, key, 3, "inertia"))
    return Inertia(mass, about=about).moved(values.pose(element, dict(element.attrib)))


def geom(values: Values, element: Element, given: dict[str, str]) -> tuple[Inertia, Visual | None]:
    """Inertia of a geom in the body's frame, and what it looks like.

    Args:
        values: Of the file. element: The <geom>. given: Its attributes with defaults.
    """
    kind = given.get("type", "mesh" if "mesh" in given else "sphere")
    matrix, half = values.ends(element, given)
    if kind == "mesh":
        return _mesh(values, element, given, matrix)
    if kind not in _SHAPES:
        return Inertia(), None
    count = 1 if half is not None and kind in ("capsule", "cylinder") else _SHAPES[kind]
    size = numbers(given.get("size"), element, "size", of="length")
    if len(size) < count:
        raise DescriptionError(
            f"{element.place}: a {kind} needs {count} numbers as size, and has {len(size)}."
        )
    sizes = [float(x) for x in size[:count]] + ([half] if half is not None else [])
    volume, square = _solid(kind, sizes)
    mass = _mass(element, given, volume)
    made = Inertia(mass, about=mass * np.diag(square)).moved(matrix)
    return made, _drawn(kind, sizes, matrix)


_SHAPES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}


def _mass(element: Element, given: dict[str, str], volume: float) -> float:
    if "mass" in given:
        return float(numbers(given["mass"], element, "mass", 1, "mass")[0])
    if "density" in given:
        return float(numbers(given["density"], element, "density", 1, "density")[0]) * volume
    return _DENSITY * volume


def _solid(kind: str, s: list[float]) -> tuple[float, Array]:
    """Volume of a shape, and its moments about x, y, z over its mass."""
    if kind == "sphere":
        return 4 / 3 * math.pi * s[0] ** 3, np.full(3, 0.4 * s[0] ** 2)
    if kind in ("box", "ellipsoid"):
        volume = 8 * s[0] * s[1] * s[2] * (1.0 if kind == "box" else math.pi / 6)
        a, b, c = (x**2 / (3 if kind == "box" else 5) for x in s)
        return volume, np.array([b + c, a + c, a + b])
    r, h = s  # z along the axis, h half of the straight part
    tube, ball = 2 * math.pi * r**2 * h, 4 / 3 * math.pi * r**3
    across, spin = r**2 / 4 + h**2 / 3, r**2 / 2
    if kind == "cylinder":
        return tube, np.array([across, across, spin])
    # two half balls, each with its centre 3/8 r beyond an end of the tube
    ends = 0.4 * r**2 + h**2 + 0.75 * r * h
    whole = tube + ball
    side = (tube * across + ball * ends) / whole
    return whole, np.array([side, side, (tube * spin + ball * 0.4 * r**2) / whole])


def _drawn(kind: str, s: list[float], matrix: Array) -> Visual:
    if kind == "box":
        return Visual("box", matrix, {"size": " ".join(repr(2 * x) for x in s)})
    if kind in ("capsule", "cylinder"):
        length = 2 * (s[1] + (s[0] if kind == "capsule" else 0.0))
        return Visual("cylinder", matrix, {"radius": repr(s[0]), "length": repr(length)})
    return Visual("sphere", matrix, {"radius": repr(math.prod(s) ** (1 / len(s)))})


def _mesh(
    values: Values, element: Element, given: dict[str, str], matrix: Array
) -> tuple[Inertia, Visual | None]:
    file, scale = values.mesh_file(element, given.get("mesh", ""))
    text = " ".join(repr(float(x)) for x in scale)
    visual = Visual("mesh", matrix, {"filename": file, "scale": text}) if file else None
    return Inertia(), visual


def mesh_inertia(values: Values, element: Element, given: dict[str, str]) -> Inertia:
    """Inertia of a closed mesh of even density, by the divergence theorem (coal).

    Args:
        values: What attributes mean.
        element: The geom.
        given: Its attributes, defaults included.
    """
    file, scale = values.mesh_file(element, given.get("mesh", ""))
    try:
        import coal  # type: ignore[import-untyped,unused-ignore]

        model = coal.MeshLoader(coal.NODE_TYPE.BV_AABB).load(str(values.folder / file), scale)
    except Exception:
        raise DescriptionError(
            f"{element.place}: the mesh {file or given.get('mesh')} gives the body its mass, and "
            "cannot be read. Put the file there, or write <inertial>."
        ) from None
    sign = float(np.sign(np.prod(scale)))  # a mirrored mesh is inside out
    volume = sign * float(model.computeVolume())
    if volume <= 0:
        raise DescriptionError(
            f"{element.place}: the mesh {file} encloses no volume. Write <inertial> for the body."
        )
    mass, centre = _mass(element, given, volume), np.array(model.computeCOM()).ravel()
    about = sign * np.array(model.computeMomentofInertiaRelatedToCOM()) * mass / volume
    matrix, _ = values.ends(element, given)
    return replace(Inertia(mass, centre, about)).moved(matrix)
