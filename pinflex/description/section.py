"""Cross-sections of beams: areas, stiffnesses, and where the stress is largest.

Beam axes: x along the beam, y and z in the section. A rectangle has its width along z and its
thickness along y, so that it bends over its thickness in the plane of the link's joint.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pinflex import registered
from pinflex.description.reading import schema
from pinflex.description.reading.schema import RANGES
from pinflex.errors import DescriptionError, nearest
from pinflex.text import frozen

# St-Venant torsion: fields of shear stress for a torque of one, and torsion moduli.


def plane(section: Section, y: float, z: float) -> tuple[float, float]:
    """tau_xy, tau_xz [1/m^3] at (y, z) where sections stay plane: round ones."""
    return -z / section.J, y / section.J


def rectangle(section: Section, y: float, z: float) -> tuple[float, float]:
    """tau_xy, tau_xz [1/m^3] at (y, z) of a solid rectangle, from Prandtl's stress function."""
    size = dict(section.dimensions)
    if size["thickness"] <= size["width"]:
        ds, dl = _prandtl(size["thickness"] / 2, size["width"] / 2, y, z)
        return dl / section.J, -ds / section.J
    ds, dl = _prandtl(size["width"] / 2, size["thickness"] / 2, z, y)
    return ds / section.J, -dl / section.J


def _prandtl(a: float, b: float, s: float, long: float) -> tuple[float, float]:
    """d phi/ds and d phi/dl of the stress function for G twist = 1, half sides a <= b."""
    n = np.arange(1.0, 400.0, 2.0)  # ends at 1e-5 of the largest stress, beside the corners
    k = n * np.pi / (2 * a)
    sign = np.where(n % 4 == 1, 1.0, -1.0)
    far, near = np.exp(-k * (b - abs(long))), np.exp(-k * (b + abs(long)))
    whole = 1 + np.exp(-2 * k * b)
    cosh, sinh = (far + near) / whole, np.sign(long) * (far - near) / whole
    gain = 32 * a**2 / np.pi**3 * sign / n**3 * k
    # The part without cosh is the parabola a^2 - s^2, summed in closed form.
    ds = -2 * s + float(np.sum(gain * cosh * np.sin(k * s)))
    return ds, -float(np.sum(gain * sinh * np.cos(k * s)))


def rectangle_modulus(a: float, b: float) -> float:
    """Torsion modulus T / tau_max [m^3] of a rectangle a >= b.

    The largest stress is at the middle of the long side.

    J = a b^3/3 (1 - 192 b/(pi^5 a) sum tanh(n pi a/(2b)) / n^5)
    tau_max = G twist b (1 - 8/pi^2 sum 1 / (n^2 cosh(n pi a/(2b)))),  n = 1, 3, 5, ...

    Source: Timoshenko, Goodier, Theory of Elasticity (3rd ed.), section 109.
    """
    n = np.arange(1.0, 40.0, 2.0)  # the first term left out of J is 41^-5 = 1e-8 of the first
    x = n * np.pi * a / (2 * b)
    sech = 2 * np.exp(-x) / (1 + np.exp(-2 * x))
    J = a * b**3 / 3 * (1 - 192 * b / (np.pi**5 * a) * float(np.sum(np.tanh(x) / n**5)))
    return float(J / (b * (1 - 8 / np.pi**2 * float(np.sum(sech / n**2)))))


Points = tuple[tuple[float, float], ...]
_NU = 0.3  # Poisson's ratio in the shear factors of round sections; they change by 3 % over 0..0.5
_QUANTITIES = dict.fromkeys(
    ("width", "height", "thickness", "diameter", "wall", "flange", "web"), "length"
)
_QUANTITIES |= {"A": "area", "Wt": "modulus", "ky": "ratio", "kz": "ratio"}
_QUANTITIES |= dict.fromkeys(("Iy", "Iz", "J", "my", "mz"), "second moment")


@frozen
class Section:
    """A cross-section. Build it with `rectangle`, `circle`, `tube`, `box`, `i_section` or `given`.

    Attributes:
        shape: rectangle, circle, tube, box, i or given.
        A: Area [m^2].
        Iy: Second moment int z^2 dA [m^4]; stiffness of bending along z.
        Iz: Second moment int y^2 dA [m^4]; stiffness of bending along y.
        J: St-Venant torsion constant [m^4]; torque = G J twist rate.
        ky: Shear factor along y [-]; shear force = ky G A shear angle.
        kz: Shear factor along z [-].
        Wt: Torsion modulus [m^3]; largest shear stress = torque / Wt.
        fibres: Points (y, z) [m] among which the largest normal stress is sought.
        outline: Polygon (y, z) [m] to draw, counter-clockwise about x.
        dimensions: What it was built from, (name, value) pairs.
        my, mz: Second moments of the mass over rho [m^4]; None: Iy, Iz (not so in a composite).
    """

    shape: str
    A: float
    Iy: float
    Iz: float
    J: float
    ky: float
    kz: float
    Wt: float
    fibres: Points
    outline: Points
    dimensions: tuple[tuple[str, float], ...]
    my: float | None = None
    mz: float | None = None

    @property
    def turning(self) -> tuple[float, float]:
        """Second moments [m^4] of rotary inertia about beam y and z."""
        return self.Iy if self.my is None else self.my, self.Iz if self.mz is None else self.mz

    @property
    def Ip(self) -> float:
        """Polar second moment [m^4]: inertia of the twist, not its stiffness."""
        return sum(self.turning)

    @classmethod
    def rectangle(cls, width: float, thickness: float, where: str = "section") -> Section:
        """A solid rectangle.

        J = a b^3 (1/3 - 0.21 (b/a) (1 - b^4 / (12 a^4))), a >= b (within 0.2 % of the series).

        Source: Young, Budynas, Roark's Formulas (7th ed.), table 10.1, case 4, for J; for Wt see
            `torsion.rectangle_modulus`; shear factors 5/6 from the shear energy.
        """
        a, b = max(width, thickness), min(width, thickness)
        y, z = thickness / 2, width / 2
        corners = ((-y, -z), (y, -z), (y, z), (-y, z))
        return cls(
            shape="rectangle",
            A=width * thickness,
            Iy=thickness * width**3 / 12,
            Iz=width * thickness**3 / 12,
            J=a * b**3 * (1 / 3 - 0.21 * (b / a) * (1 - (b / a) ** 4 / 12)),
            ky=5 / 6,
            kz=5 / 6,
            Wt=rectangle_modulus(a, b),
            fibres=corners,
            outline=corners,
            dimensions=(("width", width), ("thickness", thickness)),
        )

    @classmethod
    def circle(cls, diameter: float, where: str = "section") -> Section:
        """A solid circle of the given diameter [m].

        Source: shear factor 6 (1 + nu) / (7 + 6 nu), Cowper (1966), with nu = 0.3: 0.886.
        """
        return cls._round(diameter, 0.0, "circle", (("diameter", diameter),))

    @classmethod
    def tube(cls, diameter: float, wall: float, where: str = "section") -> Section:
        """A round tube of the given outer diameter and wall [m].

        Source: shear factor of Cowper (1966) for a hollow circle, with nu = 0.3.
        """
        if wall >= diameter / 2:
            raise DescriptionError(
                f"{schema.at(where, 'wall')}: {wall:g} leaves no bore in a tube of diameter "
                f"{diameter:g}. Allowed: 0 < wall < {diameter / 2:g}. For a rod use a circle."
            )
        dimensions = (("diameter", diameter), ("wall", wall))
        return cls._round(diameter, diameter - 2 * wall, "tube", dimensions)

    @classmethod
    def _round(
        cls, outer: float, bore: float, shape: str, dimensions: tuple[tuple[str, float], ...]
    ) -> Section:
        second = math.pi * (outer**4 - bore**4) / 64
        m2 = 1 + (bore / outer) ** 2
        k = 6 * (1 + _NU) * m2**2 / ((7 + 6 * _NU) * m2**2 + (20 + 12 * _NU) * (m2 - 1))
        return cls(
            shape=shape,
            A=math.pi * (outer**2 - bore**2) / 4,
            Iy=second,
            Iz=second,
            J=2 * second,
            ky=k,
            kz=k,
            Wt=4 * second / outer,
            fibres=_polygon(outer, 72),  # misses the largest stress by 1 - cos(2.5 deg) = 0.1 %
            outline=_polygon(outer, 24),
            dimensions=dimensions,
        )

    @classmethod
    def box(cls, width: float, height: float, wall: float, where: str = "section") -> Section:
        """A rectangular tube with sharp corners, its height along y and its width along z.

        Source: Bredt's closed cell for J and Wt (Roark's Formulas, 7th ed., table 10.1, case 16);
            shear factors of Cowper (1966) for a thin-walled box, with nu = 0.3.
        """
        inner, bore = height - 2 * wall, width - 2 * wall
        if min(inner, bore) <= 0:
            raise DescriptionError(
                f"{schema.at(where, 'wall')}: {wall:g} leaves no bore in a box of {width:g} by "
                f"{height:g}. Allowed: 0 < wall < {min(width, height) / 2:g}. For a full bar use "
                "a rectangle."
            )
        a, b, y, z = height - wall, width - wall, height / 2, width / 2
        corners = ((-y, -z), (y, -z), (y, z), (-y, z))
        return cls(
            shape="box",
            A=width * height - bore * inner,
            Iy=(height * width**3 - inner * bore**3) / 12,
            Iz=(width * height**3 - bore * inner**3) / 12,
            J=2 * wall * (a * b) ** 2 / (a + b),
            ky=_boxed(b / a),
            kz=_boxed(a / b),
            Wt=2 * wall * a * b,
            fibres=corners,
            outline=corners,
            dimensions=(("width", width), ("height", height), ("wall", wall)),
        )

    @classmethod
    def i_section(
        cls, width: float, height: float, flange: float, web: float, where: str = "section"
    ) -> Section:
        """A thin I with its height along y and its flanges along z.

        J = sum b t^3 / 3 over the centre lines (open thin walls; fillets and warping left out).

        Source: Timoshenko, Goodier, Theory of Elasticity, section 112, for J and tau = T t / J;
            the shear factors are area ratios: the web along y, 5/6 of the flanges along z.
        """
        if web >= width or 2 * flange >= height:
            key, value, limit = (
                ("web", web, width) if web >= width else ("flange", flange, height / 2)
            )
            raise DescriptionError(
                f"{schema.at(where, key)}: {value:g} fills the I section of width {width:g} and "
                f"height {height:g}. Allowed: 0 < {key} < {limit:g}. Correct it."
            )
        inner = height - 2 * flange
        area = 2 * width * flange + inner * web
        J = (2 * width * flange**3 + (height - flange) * web**3) / 3
        h, i, b, w = height / 2, inner / 2, width / 2, web / 2
        half = ((-h, -b), (-i, -b), (-i, -w), (i, -w), (i, -b), (h, -b))
        return cls(
            shape="i",
            A=area,
            Iy=(2 * flange * width**3 + inner * web**3) / 12,
            Iz=(width * height**3 - (width - web) * inner**3) / 12,
            J=J,
            ky=inner * web / area,
            kz=5 / 6 * 2 * width * flange / area,
            Wt=J / max(flange, web),
            fibres=((-h, -b), (h, -b), (h, b), (-h, b)),
            outline=half + tuple((-y, -z) for y, z in half),
            dimensions=(("width", width), ("height", height), ("flange", flange), ("web", web)),
        )

    @classmethod
    def given(
        cls,
        A: float,
        Iy: float,
        Iz: float,
        J: float,
        Wt: float | None = None,
        fibres: Sequence[tuple[float, float]] | None = None,
        where: str = "section",
    ) -> Section:
        """Any section, by its numbers."""
        if (Iy + Iz) * (1 + 1e-9) < J:  # St-Venant's J is largest, = Iy + Iz, for round sections
            raise DescriptionError(
                f"{schema.at(where, 'J')}: {J:g} is more than Iy + Iz = {Iy + Iz:g}, which no "
                "section reaches but a round one. Give the torsion constant in m^4."
            )
        y, z = math.sqrt(3 * Iz / A), math.sqrt(3 * Iy / A)
        corners = tuple(fibres) if fibres else ((-y, -z), (y, -z), (y, z), (-y, z))
        return cls(
            shape="given",
            A=A,
            Iy=Iy,
            Iz=Iz,
            J=J,
            ky=5 / 6,
            kz=5 / 6,
            Wt=J / (2 * min(y, z)) if Wt is None else Wt,
            fibres=corners,
            outline=corners,
            dimensions=(("A", A), ("Iy", Iy), ("Iz", Iz), ("J", J)),
        )


def _boxed(n: float) -> float:
    """Shear factor of a thin-walled box n times as wide as high, along its height."""
    webs = 12 + 72 * n + 150 * n**2 + 90 * n**3 + _NU * (11 + 66 * n + 135 * n**2 + 90 * n**3)
    return 10 * (1 + _NU) * (1 + 3 * n) ** 2 / (webs + 10 * n**2 * ((3 + _NU) * n + 3 * n**2))


@dataclass(frozen=True)
class Shape:
    """A shape of section that a file can name.

    Attributes:
        name: Value of the key `shape`.
        keys: Required numbers > 0: key to quantity, one of `ranges.RANGES`.
        build: The section of these numbers; called with them and `where`, all by keyword.
        shear: tau_xy and tau_xz [1/m^3] at a point (section, y, z) for a torque of one; None: only
            the largest shear stress is known, torque / Wt.
        optional: Further keys.
    """

    name: str
    keys: Mapping[str, str]
    build: Callable[..., Section]
    shear: Callable[[Section, float, float], tuple[float, float]] | None = None
    optional: tuple[str, ...] = ("ky", "kz", "J")

    @property
    def table(self) -> schema.Table:
        """The keys of the block."""
        word = schema.bare({"const": self.name}, required=True)
        numbers = {key: schema.real(schema.REQUIRED, of, above=0) for key, of in self.keys.items()}
        more = {key: schema.real(None, _QUANTITIES[key], above=0)
                for key in self.optional if key != "fibres"}  # fmt: skip
        fibres = schema.key(None, _fibres, form=schema.LIST)
        return {"shape": word} | numbers | {key: more.get(key, fibres) for key in self.optional}


def _of(*keys: str) -> dict[str, str]:
    return {key: _QUANTITIES[key] for key in keys}


SHAPES: dict[str, Shape] = {
    row.name: row
    for row in (
        Shape("rectangle", _of("width", "thickness"), Section.rectangle, rectangle),
        Shape("circle", _of("diameter"), Section.circle, plane),
        Shape("tube", _of("diameter", "wall"), Section.tube, plane),
        Shape("box", _of("width", "height", "wall"), Section.box),
        Shape("i", _of("width", "height", "flange", "web"), Section.i_section),
        Shape(
            "given",
            _of("A", "Iy", "Iz", "J"),
            Section.given,
            optional=("ky", "kz", "Wt", "fibres", "my", "mz"),
        ),
    )
}


def register_shape(shape: Shape) -> None:
    """Add a shape of section; from then on `{shape: NAME, ...}` is read, solved and drawn.

    Raises: DescriptionError: The name is taken, or a key has no quantity of `ranges.RANGES`.
    """
    if shape.name in SHAPES:
        raise DescriptionError(f"shape {shape.name}: there is one of that name. Choose another.")
    for key, quantity in shape.keys.items():
        if quantity not in RANGES:
            why = f"key {key}: {quantity}.{nearest(quantity, RANGES)}"
            raise DescriptionError(f"shape {shape.name}: {why}")
    SHAPES[shape.name] = shape
    registered.note(register_shape, shape.name, shape)


def form() -> schema.Form:
    """JSON Schema of the block `section`."""
    return {"anyOf": [schema.block_form(shape.table) for shape in SHAPES.values()]}


def from_spec(spec: object, where: str = "section") -> Section:
    """A section from the YAML block {shape, dimensions, ky, kz, J}."""
    if not isinstance(spec, dict) or spec.get("shape") is None:
        raise DescriptionError(
            f"{where}: {schema.shown(spec)} has no shape. Write {{shape: rectangle, width: 0.02, "
            f"thickness: 0.002}}; shapes: {', '.join(SHAPES)}."
        )
    shape = SHAPES[schema.choice(spec["shape"], schema.at(where, "shape"), SHAPES)]
    value = schema.Block(spec, where, shape.table, *shape.keys).read()
    given = ("Wt", "fibres") if shape.name == "given" else ()
    chosen = {key: value.get(key) for key in (*shape.keys, *given)}
    section = shape.build(**chosen, where=where)
    for key in ("A", "Iy", "Iz", "J", "ky", "kz"):  # a shape may be anybody's
        schema.number(getattr(section, key), schema.at(where, key), above=0)
    changes: dict[str, Any] = {key: value[key] for key in ("ky", "kz", "my", "mz") if key in value}
    if "J" in value and "J" not in shape.keys:
        # The stress at a given twist is kept, so a corrected J changes Wt in proportion.
        changes |= {"J": value["J"], "Wt": section.Wt * value["J"] / section.J}
    return replace(section, **changes) if changes else section


def _fibres(value: object, where: str) -> Points:
    rows = [
        schema.numbers(row, f"{where}[{i}]", 2, of="place")
        for i, row in enumerate(schema.items(value, where))
    ]
    if len(rows) < 3:
        raise DescriptionError(
            f"{where}: {len(rows)} points. A section has 3 or more (y, z) corners."
        )
    return tuple((y, z) for y, z in rows)


def _polygon(diameter: float, count: int) -> Points:
    angles = (2 * math.pi * k / count for k in range(count))
    return tuple((diameter / 2 * math.cos(a), diameter / 2 * math.sin(a)) for a in angles)
