"""The block `flexible` of a description: which links bend, of what they are, in which basis."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any, Literal

from pinflex.description import section
from pinflex.description.blocks import material
from pinflex.description.blocks.external import frame
from pinflex.description.blocks.material import Material
from pinflex.description.files import Source
from pinflex.description.reading import schema, yaml_text
from pinflex.description.reading.schema import Vec3
from pinflex.description.section import Section
from pinflex.errors import DescriptionError, nearest
from pinflex.text import frozen

# Keys of the block `flexible`: link names, lists of them, or globs, and the links they mean.


def expand(value: object, where: str, urdf: Source) -> dict[str, Any]:
    """One block per link, from keys that are link names, lists of them, or globs."""
    blocks = schema.mapping(value, where)
    links = groups(blocks, where, urdf)
    return {name: copy.deepcopy(blocks[key]) for key, names in links.items() for name in names}


def groups(blocks: Mapping[str, Any], where: str, urdf: Source) -> dict[str, list[str]]:
    """The links of every key of the block `flexible`."""
    found: dict[str, list[str]] = {}
    written: dict[str, str] = {}
    for key in blocks:
        found[key] = _links(key, schema.at(where, key), urdf)
        for name in found[key]:
            if name in written:
                raise DescriptionError(
                    f'{schema.at(where, key)}: the link "{name}" is already described under '
                    f'"{written[name]}". Describe each link once.'
                )
            written[name] = key
    return found


def gathered(blocks: Mapping[str, Any], links: Mapping[str, list[str]]) -> dict[str, Any]:
    """One block for the links of a key again, where theirs are still alike."""
    found, left = dict[str, Any](), dict(blocks)
    for key, names in links.items():
        alike: list[tuple[Any, list[str]]] = []
        for name in (name for name in names if name in left):
            block = left.pop(name)
            some = next((some for other, some in alike if other == block), None)
            if some is None:
                alike.append((block, [name]))
            else:
                some.append(name)
        found |= {
            key if len(some) == len(names) else ", ".join(some): block for block, some in alike
        }
    return found | left


def _links(key: str, where: str, urdf: Source) -> list[str]:
    links: list[str] = []
    for part in (p.strip() for p in key.split(",")):
        matches = [part] if part in urdf.links else []
        if not matches and yaml_text.WILD.search(part):
            matches = [link for link in urdf.links if fnmatchcase(link, part)]
        if not matches:
            raise DescriptionError(
                f"{where}: no such link in {urdf.file}.{nearest(part, urdf.links)}", link=part
            )
        links += matches
    return links


# Mass of a flexible link beside its own beam: rigid masses at its ends, the beam as built.


@dataclass(frozen=True)
class EndMass:
    """A rigid mass at an end of a flexible link: mass [kg], moments of inertia [kg m^2]."""

    mass: float = schema.real(0.0, "mass", low=0)
    inertia: Vec3 = schema.triple((0.0, 0.0, 0.0), "inertia", 0.0)


@dataclass(frozen=True)
class AsBuilt:
    """The beam of the link whose inertia the URDF has; None or 0: as described.

    Attributes:
        material: Its density counts. section: Its area and moments.
        length: Its span [m].
    """

    material: Material | None = schema.key(None, material.from_spec, form=lambda: material.FORM)
    section: Section | None = schema.key(None, section.from_spec, form=section.form)
    length: float | None = schema.real(None, "length", above=0)


# Piezoelectric patches on a flexible link: a voltage that bends it. The block `patches`.
#
# A patch from x1 to x2 does the virtual work  dW = k V (f'(x2) - f'(x1)) : two opposite moments k
# V.


@dataclass(frozen=True)
class Patch:
    """A patch that bends its link along beam y.

    Attributes:
        name: Name of the actuator.
        start, end: Where it begins and ends along the beam [m].
        constant: k, bending moment per volt [N m/V].
    """

    name: str
    start: float = schema.real(schema.REQUIRED, "place", key="from")
    end: float = schema.real(schema.REQUIRED, "place", key="to")
    constant: float = schema.real(schema.REQUIRED, "moment", required=False)

    def require_on_beam(self, where: str, length: float) -> None:
        """Raise where the patch does not lie on a beam of a length [m]."""
        if 0.0 <= self.start < self.end <= length * (1.0 + 1e-9):
            return
        raise DescriptionError(
            f"{where}.patches.{self.name}: it lies from {self.start:g} to {self.end:g} m, the beam "
            f"from 0 to {length:g} m. Give 0 <= from < to <= {length:g}."
        )


def piezo_constant(
    d31: float, E_patch: float, width: float, thickness: float, E: float, b: float, h: float
) -> float:
    """Bending moment per volt of a patch on one face, k = -d31 E Ep h^2 b bp / (E h b + Ep hp bp).

    Source: Sharifnia, Akbarzadeh (2016), eq. 32.
    """
    stretch = E * h * b + E_patch * thickness * width
    return -d31 * E * E_patch * h**2 * b * width / stretch


_SIZES = {
    "d31": schema.real(None, low=-1, high=1), "E": schema.real(None, "elasticity", above=0),
    "width": schema.real(None, "length", above=0),
    "thickness": schema.real(None, "length", above=0),
}  # fmt: skip
PATCH = schema.keys(Patch, **_SIZES)


def read_patches(value: object, where: str, E: float, section: Section) -> tuple[Patch, ...]:
    """The block `patches` of a link, in file order."""
    found = []
    for name, block in schema.entries(value, where, PATCH):
        values = block.read()
        sizes = {key: values.pop(key) for key in _SIZES if key in values}
        if "constant" in values:
            block.only(_SIZES, "redundant with `constant`. Give one.")
        else:
            schema.mapping(block, block.where, None, _SIZES)
            y, z = zip(*section.outline, strict=True)
            h, b = max(y) - min(y), max(z) - min(z)
            d31, E_patch, width, thickness = sizes.values()
            values["constant"] = piezo_constant(d31, E_patch, width, thickness, E, b, h)
        found.append(Patch(name, **values))
    return tuple(found)


# The shapes in which a link deforms: of a beam, or of a solid (the kinds mesh and matrices).

# Keys of each kind of basis.
BASES: dict[str, tuple[str, ...]] = {
    "craig_bampton": ("internal",),
    "finite_element": ("elements", "order", "boundary"),
    "assumed": ("boundary", "modes", "stretch"),
    "ritz8": (),
    "mesh": ("file", "scale", "rod", "size", "interfaces", "modes"),
    "matrices": ("file", "mass", "stiffness", "nodes", "interfaces", "modes"),
}
ORDERS = ("cubic", "quintic")
STRETCHES = ("sines", "polynomials")
BOUNDARIES = (
    "clamped_free",
    "pinned_free",
    "pinned_pinned",
    "clamped_pinned",
    "clamped_clamped",
    "free_free",
)
_SOLIDS = ("mesh", "matrices")
_BEAM_KEYS = (
    *("bending_y", "bending_z", "torsion", "axial", "rotary_inertia", "third_order", "shear"),
    *("root", "tip", "section", "patches"),
)


def _refuse_beam_keys(block: schema.Block) -> None:
    """Keys that mean something for beams only."""
    block.only(
        _BEAM_KEYS,
        "a solid deforms in every direction and has its own inertia, so this has no meaning for "
        "it. Remove it.",
    )
    if block.get("inertia", "beam") == "urdf":
        raise block.error("inertia", "a solid has the mass of its mesh or matrices. Remove it.")
    if block.get("segments", 1) != 1:
        raise block.error("segments", "a solid is one body. Remove it.")


def _regions(value: object, where: str) -> tuple[tuple[str, str | tuple[float, ...]], ...]:
    """Interfaces of a solid by name: a group, or a box."""
    return tuple(
        (name, item if isinstance(item, str)
         else schema.numbers(item, f"{where}.{name}", 6, of="place"))
        for name, item in schema.mapping(value, where).items()
    )  # fmt: skip


def _rod(value: object, where: str) -> tuple[tuple[float, float], ...]:
    """(diameter, length) of each segment from {diameters: [...], lengths: [...]}."""
    block = schema.mapping(value, where, ("diameters", "lengths"), ("diameters",))
    count = len(schema.items(block["diameters"], f"{where}.diameters"))
    if "lengths" not in block and count != 1:
        raise DescriptionError(
            f"{where}.lengths: missing. Give the length [m] of each of the {count} diameters."
        )
    found = {"lengths": [0.0]}  # that of the span
    for key in ("lengths", "diameters"):
        if key in block:
            many = schema.items(block[key], f"{where}.{key}", count)
            found[key] = [
                schema.number(x, f"{where}.{key}[{k}]", above=0, of="length")
                for k, x in enumerate(many)
            ]
    return tuple(zip(found["diameters"], found["lengths"], strict=True))


def _check_solid(kind: str, block: schema.Block) -> None:
    """A solid comes from one source, and has at least the interface at which it is held."""
    sources = {"mesh": ("file", "rod"), "matrices": ("file", "mass")}[kind]
    given = [key for key in sources if key in block]
    if len(given) != 1:
        raise block.error(
            "",
            f"{' and '.join(given) or 'nothing'} given for the body. Give one of "
            f"{', '.join(sources)}.",
        )
    if "mass" in block and not {"stiffness", "nodes"} <= block.keys():
        raise block.error("", "mass needs stiffness and nodes beside it. Give all.")
    if "rod" in block and block.keys() & {"interfaces", "scale"}:
        raise block.error(
            "",
            "a rod is built in m, and its ends are the interfaces. Remove interfaces and scale.",
        )
    if "rod" not in block and not block.get("interfaces"):
        raise block.error(
            "interfaces",
            "missing. Name the rigid regions, first the one fixed to the link's frame: {root: "
            "GROUP, tip: GROUP}.",
        )


Switch = bool | Literal["auto"]
INERTIAS = ("urdf", "beam")


def _modes(value: object, where: str, kind: str) -> int:
    return schema.integer(value, where, 1, 1000 if kind in _SOLIDS else 200)


def _file() -> Any:
    return schema.key(None, schema.text, form=schema.TEXT)


@frozen
class Basis:
    """The shapes in which a link deforms.

    Attributes:
        kind: craig_bampton, finite_element, assumed, ritz8, mesh or matrices.
        internal: craig_bampton: internal modes per direction beside the static end shapes.
        elements: finite_element: number of beam elements.
        order: finite_element: cubic (12 coordinates) or quintic (18).
        boundary: assumed: end conditions of the analytic modes, root first; finite_element:
            clamped_free, or free_free, of which a `slider` or a loop holds the root.
        modes: assumed: number of modes per bending direction; mesh, matrices: number of modes with
            all interfaces held.
        stretch: assumed: what stretch and twist are made of, sines of a bar held at its root or
            polynomials of degree 1 to `modes`.
        file: mesh: a mesh in a format of meshio; matrices: a .npz. Relative to the YAML.
        scale: mesh: metres per unit of the file.
        rod: mesh: instead of a file, (diameter, length) [m] of the segments of a round rod along
            the span; a length of 0 is the span.
        size: mesh: length of the cells of a rod [m]; None: its smallest diameter.
        interfaces: mesh, matrices: name and region of each rigid interface, the one that is fixed
            to the link's frame first. A region is a group of faces (matrices: an array of node
            numbers), or a box x0 y0 z0 x1 y1 z1 [m].
        mass: matrices: Matrix Market file of M, instead of a .npz.
        stiffness: matrices: that of K.
        nodes: matrices: text or .csv file of their places, x y z [m] a line.
    """

    kind: str = schema.bare(lambda: {"enum": [*BASES]}, "craig_bampton")
    internal: int = schema.whole(2, 0, 200)
    elements: int = schema.whole(4, 1, 10_000)
    order: str = schema.word("cubic", ORDERS)
    boundary: str = schema.word("clamped_free", BOUNDARIES)
    modes: int = schema.key(3, _modes, given=True, form={"type": "integer", "minimum": 1})
    stretch: str = schema.word("sines", STRETCHES)
    file: str | None = _file()
    scale: float = schema.real(1.0, "ratio", above=0)
    rod: schema.Points = schema.key((), _rod, form={})
    size: float | None = schema.real(None, "length", above=0)
    interfaces: tuple[tuple[str, str | tuple[float, ...]], ...] = schema.key((), _regions, form={})
    mass: str | None = _file()
    stiffness: str | None = _file()
    nodes: str | None = _file()

    @property
    def solid(self) -> bool:
        """Whether the link is a solid, not a beam."""
        return self.kind in _SOLIDS


_BASIS = schema.keys(Basis, "kind", *(key for keys in BASES.values() for key in keys))


def basis_from_spec(spec: object, where: str) -> Basis:
    """A basis from {kind, ...}; a key of another kind is an error, as it would have no effect."""
    block = schema.Block(spec, where, _BASIS)
    kind = schema.choice(block.get("kind", Basis.kind), block.at("kind"), BASES)
    for key in block:
        if key != "kind" and key not in BASES[kind]:
            owner = next(name for name, keys in BASES.items() if key in keys)
            raise block.error(
                key,
                f"has no meaning for the kind {kind}, which takes {', '.join(BASES[kind])}. Remove "
                f"it, or write kind: {owner}.",
            )
    if kind == "finite_element" and "boundary" in block:
        schema.choice(block["boundary"], block.at("boundary"), ("clamped_free", "free_free"))
    values = block.read(kind)
    if kind in _SOLIDS:
        _check_solid(kind, block)
        values.setdefault("modes", 6)
    return Basis(kind, **values)


def _switch(value: object, where: str) -> Switch:
    """auto, or true or false."""
    if value == "auto":
        return "auto"
    if not isinstance(value, bool):
        schema.choice(value, where, ("auto", "true", "false"))
    return schema.boolean(value, where)


def _switch_key() -> Any:
    return schema.key("auto", _switch, form={"enum": ["auto", True, False]})


@frozen
class FlexibleLink:
    """A link of the URDF that deforms as a beam.

    Attributes:
        link: URDF link.
        material: Elastic constants and density.
        section: Cross-section.
        basis: Shapes.
        inertia: "urdf": mass, centre and inertia of the URDF link stay, shared between the beam
            and riders on it; "beam": the beam's own take their place.
        as_built: The beam that the URDF's link has, where this one is another design: what the link
            carries beside that beam stays, and a lighter section makes a lighter link.
        start: Frame where the span begins; None: the link's own joint.
        end: Frame where it ends; None: the joint of the child link.
        length: Span [m], if not the distance of start and end.
        up: Direction of the beam's z axis in the link frame; None: the axis of the link's joint.
        bending_y: Deflects along beam y; "auto": where the mechanism moves or loads it.
        bending_z: Deflects along beam z.
        torsion: Twists.
        axial: Stretches.
        rotary_inertia: Sections have rotary inertia in bending; "auto": where the link is short.
        second_order: Foreshortening and bending-torsion coupling to second order.
        third_order: Curvature to third order: the stiffness of bends that are not small.
        shear: Timoshenko shear flexibility; "auto": where the link is short.
        free_shear: With both, shear strains have coordinates of their own, beside those that
            balance the curvatures; `auto` does without, which costs no coordinates.
        segments: Number of flexible bodies the link is cut into.
        temperature: Above that at which it is free of stress [K]; it stretches then.
        root: Rigid mass at the start.
        tip: Rigid mass at the end.
        rayleigh: Damping alpha M + beta K: (alpha [1/s], beta [s]).
        modal_damping: Damping ratio of every mode [-].
        patches: Piezoelectric patches that bend it along beam y.
    """

    link: str
    material: Material = schema.bare(lambda: material.FORM, schema.REQUIRED, required=True)
    section: Section = schema.bare(section.form, schema.REQUIRED, required=False)
    basis: Basis = schema.key(Basis(), basis_from_spec, form=lambda: schema.block_form(_BASIS))
    inertia: Literal["urdf", "beam"] = schema.word("urdf", INERTIAS)
    as_built: AsBuilt | None = schema.part(None, AsBuilt)
    start: str | None = schema.key(None, frame, given=True, form=schema.TEXT)
    end: str | None = schema.key(None, frame, given=True, form=schema.TEXT)
    length: float | None = schema.real(None, "length", above=0)
    up: Vec3 | None = schema.direction_key(None)
    bending_y: Switch = _switch_key()
    bending_z: Switch = _switch_key()
    torsion: Switch = _switch_key()
    axial: Switch = _switch_key()
    rotary_inertia: Switch = _switch_key()
    second_order: bool = schema.flag(True)
    third_order: bool = schema.flag(False)
    shear: Switch = _switch_key()
    free_shear: bool = True
    segments: int = schema.whole(1, 1)
    temperature: float = schema.real(0.0, low=-5e3, high=5e3)
    root: EndMass | None = schema.part(None, EndMass)
    tip: EndMass | None = schema.part(None, EndMass)
    rayleigh: tuple[float, float] = (0.0, 0.0)
    modal_damping: float = 0.0
    patches: tuple[Patch, ...] = schema.bare(schema.named_form(schema.block_form(PATCH)), ())


SWITCHES = ("bending_y", "bending_z", "torsion", "axial")
DAMPING = {
    "rayleigh": schema.key(
        None, lambda x, at: schema.numbers(x, at, 2, 0, "rate"), form=schema.LIST
    ),
    "modal": schema.real(None, low=0, high=1),
}
KEYS = schema.keys(
    FlexibleLink, "material", "section", "basis", "inertia", "as_built", "start", "end", "length",
    "up", *SWITCHES, "rotary_inertia", "second_order", "shear", "segments", "temperature", "root",
    "tip", "damping", "patches", "third_order",
    damping=schema.bare(schema.block_form(DAMPING)),
    polyline=schema.bare(schema.LIST), arc=schema.bare({"type": "object"}),  # curved
)  # fmt: skip


def read(block: schema.Block, urdf: Source) -> tuple[tuple[float, float], tuple[FlexibleLink, ...]]:
    """Damping of the whole system, and the flexible links, of a description."""
    system, damping = (0.0, 0.0), ((0.0, 0.0), 0.0)
    if "damping" in block:
        spec, scope = damping_scope(block["damping"], block.at("damping"))
        damping = damping_from_spec(spec, block.at("damping"))
        if scope == "system":
            system, damping = damping[0], ((0.0, 0.0), 0.0)
    place, raw = block.at("flexible"), block.get("flexible", {})
    blocks, links = schema.mapping(raw, place), list[FlexibleLink]()
    for key, names in groups(blocks, place, urdf).items():
        first, *others = names
        one = from_spec(blocks[key], first, schema.at(place, first), urdf, damping)
        links += [one, *(replace(one, link=name) for name in others)]
    return system, tuple(links)


def from_spec(
    spec: object, link: str, where: str, urdf: Source, damping: tuple[tuple[float, float], float]
) -> FlexibleLink:
    """A flexible link from its YAML block."""
    basis = spec.get("basis") if isinstance(spec, dict) else None
    solid = isinstance(basis, dict) and basis.get("kind") in _SOLIDS
    block = schema.Block(spec, where, KEYS, "material", *(() if solid else ("section",)))
    values: dict[str, Any] = {"rayleigh": damping[0], "modal_damping": damping[1]}
    values |= block.read(urdf)
    if all(values.get(key) is False for key in SWITCHES):
        raise block.error(
            "",
            f"{', '.join(SWITCHES)} are all false, so nothing deforms. Leave one of them on, or "
            "remove the link from `flexible`.",
        )
    if "damping" in block:
        rayleigh, modal = damping_from_spec(block["damping"], block.at("damping"))
        values |= {"rayleigh": rayleigh, "modal_damping": modal}
    if solid:
        _refuse_beam_keys(block)
    elif "basis" in values and values["basis"].kind == "ritz8":
        values.setdefault("axial", True)
    made = material.from_spec(block["material"], block.at("material"))
    # A solid has no section of its own; one of its volume takes the place when it is read.
    shape = block.get("section", {"shape": "circle", "diameter": 1.0})
    cut = section.from_spec(shape, block.at("section"))
    if "patches" in block:
        values["patches"] = read_patches(block["patches"], block.at("patches"), made.E, cut)
    if values.get("shear") is True:
        _require_shear(values.get("basis", Basis()), block)
    if "temperature" in block:
        _require_stretch(solid, values.get("axial"), made, block)
        values["axial"] = True
    return FlexibleLink(link, made, cut, **values)


def _require_shear(basis: Basis, block: schema.Block) -> None:
    """Only some bases have functions with shear."""
    what = {"assumed": "assumed modes", "finite_element": f"{basis.order} elements"}
    if what.get(basis.kind, "cubic elements") != "cubic elements":
        raise block.error(
            "shear",
            f"{what[basis.kind]} have no shear. Use finite_element of order cubic, or "
            "craig_bampton.",
        )


def _require_stretch(
    solid: bool, axial: Switch | None, made: Material, block: schema.Block
) -> None:
    """A link with a temperature is a beam of known expansion that may stretch."""
    if solid:
        raise block.error("temperature", "only beams take one. Remove it, or make it a beam.")
    if axial is False:
        raise block.error(
            "temperature",
            "a warm link stretches, and axial: false forbids it. Remove one of them.",
        )
    if made.thermal_expansion is None:
        raise block.error(
            "temperature",
            f"the expansion of {made.name} is not known. Give "
            f"{block.at('material')}.thermal_expansion [1/K].",
        )


def damping_scope(spec: object, where: str) -> tuple[object, str]:
    """The block without `scope`, and the scope: links (default), or system (Rayleigh only)."""
    if not isinstance(spec, dict) or "scope" not in spec:
        return spec, "links"
    rest = {key: value for key, value in spec.items() if key != "scope"}
    place = schema.at(where, "scope")
    scope = schema.choice(spec["scope"], place, ("links", "system"))
    if scope == "system" and "rayleigh" not in rest:
        raise DescriptionError(
            f"{place}: system takes Rayleigh damping only. Write {{rayleigh: [alpha, beta], "
            "scope: system}}."
        )
    return rest, scope


def damping_from_spec(spec: object, where: str) -> tuple[tuple[float, float], float]:
    """(rayleigh, modal) from {rayleigh: [alpha, beta]} or {modal: zeta}."""
    block = schema.Block(spec, where, DAMPING)
    if len(block) != 1:
        text = "is not one kind of damping. Write {rayleigh: [alpha, beta]} or {modal: zeta}."
        raise block.error("", f"{schema.shown(spec)} {text}")
    found = block.read()
    return found.get("rayleigh", (0.0, 0.0)), found.get("modal", 0.0)
