"""Elastic materials, by name or by numbers. SI units: Pa, kg/m^3."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pinflex.description.reading import schema
from pinflex.errors import DescriptionError
from pinflex.text import frozen


def _density(value: object, where: str) -> float | None:
    if isinstance(value, str):
        schema.choice(value, where, ("urdf",))
        return None
    return schema.number(value, where, above=0, of="density")


_DENSITY = {"anyOf": [schema.measure("density"), {"const": "urdf"}]}


def _modulus(default: Any) -> Any:
    return schema.real(default, "elasticity", above=0, required=False)


@frozen
class Material:
    """A linear elastic material, as a beam needs it.

    Attributes:
        E: Young's modulus (along the beam) [Pa].
        G: Shear modulus [Pa].
        rho: Density [kg/m^3]; None means "urdf": such that the beam weighs what the URDF link does.
        nu: Poisson's ratio [-].
        name: Name for reports.
        yield_strength: Stress at which it yields or breaks [Pa], None if not known; colours the
            stress in pictures and enters no equation.
        thermal_expansion: Strain along the beam per temperature [1/K]; None if not known.
    """

    E: float = _modulus(schema.REQUIRED)
    G: float = _modulus(schema.REQUIRED)
    rho: float | None = schema.key(schema.REQUIRED, _density, form=_DENSITY, required=False)
    nu: float = schema.real(schema.REQUIRED, high=0.5, above=-1, required=False)
    name: str = schema.key("custom", schema.text, form=schema.TEXT)
    yield_strength: float | None = _modulus(None)
    thermal_expansion: float | None = schema.real(None, low=-1e-2, high=1e-2)


def _isotropic(
    name: str, E: float, nu: float, rho: float, yield_strength: float | None, alpha: float | None
) -> Material:
    return Material(E, E / (2 * (1 + nu)), rho, nu, name, yield_strength, alpha)


# Expansion of 7075, 6061, titanium, brass: Callister, Fundamentals of Materials Science, table B.6.
MATERIALS: dict[str, Material] = {
    material.name: material
    for material in (
        # Structural steel S235: EN 1993-1-1, 3.2.6 and table 3.1; rho from EN 1991-1-1.
        _isotropic("steel", 2.10e11, 0.30, 7850.0, 2.35e8, 12e-6),
        # 1.4301 (AISI 304): EN 1993-1-4, 2.1.3 and table 2.1; rho and expansion from EN 10088-1.
        _isotropic("stainless_steel", 2.00e11, 0.30, 7900.0, 2.10e8, 16e-6),
        # Any wrought alloy: EN 1999-1-1, 3.2.5. Strength depends on the alloy, so none is given.
        _isotropic("aluminium", 7.0e10, 0.30, 2700.0, None, 23e-6),
        # 7075-T6: ASM Metals Handbook, vol. 2.
        _isotropic("aluminium_7075", 7.17e10, 0.33, 2810.0, 5.03e8, 23.4e-6),
        # 6061-T6: ASM Metals Handbook, vol. 2.
        _isotropic("aluminium_6061", 6.89e10, 0.33, 2700.0, 2.76e8, 23.6e-6),
        # Ti-6Al-4V, annealed: ASM Materials Properties Handbook: Titanium Alloys.
        _isotropic("titanium", 1.138e11, 0.342, 4430.0, 8.80e8, 8.6e-6),
        # Unidirectional AS4/3501-6 along the fibres: Soden, Hinton, Kaddour (1998), table 1; the
        # strength is the compressive one, which is the smaller. Not isotropic: G is its own number.
        Material(1.26e11, 6.6e9, 1600.0, 0.28, "carbon_epoxy", 1.48e9, -1e-6),
        # Free-cutting brass C36000, annealed: ASM Metals Handbook, vol. 2.
        _isotropic("brass", 9.7e10, 0.31, 8490.0, 1.24e8, 20.5e-6),
        # Bulk polylactide: Farah, Anderson, Langer (2016). Printed parts are softer and weaker.
        _isotropic("pla", 3.5e9, 0.36, 1252.0, 7.0e7, None),
    )
}
ALIASES = {"aluminum": "aluminium", "aluminum_7075": "aluminium_7075"}
ALIASES["aluminum_6061"] = "aluminium_6061"
KEYS = schema.keys(
    Material, "like", "E", "nu", "G", "rho", "yield_strength", "thermal_expansion",
    like=schema.bare(lambda: _NAMED),
)  # fmt: skip
_NAMED: schema.Form = {"enum": [*MATERIALS, *ALIASES]}
FORM: schema.Form = {"anyOf": [_NAMED, schema.block_form(KEYS)]}


def named(name: object, where: str = "material") -> Material:
    """The material of that name."""
    spelled = ALIASES.get(name, name) if isinstance(name, str) else name
    return MATERIALS[schema.choice(spelled, where, MATERIALS)]


def from_spec(spec: object, where: str = "material") -> Material:
    """A material from the YAML: a name, or a block of numbers.

    A block needs E and one of nu and G, unless it starts from a named material with `like`. G and
    nu together are taken as they are (a composite); one alone gives the other by G = E/(2(1+nu)).
    """
    if isinstance(spec, str):
        return named(spec, where)
    block = schema.Block(spec, where, KEYS)
    base = named(block["like"], block.at("like")) if "like" in block else None
    if base is None and ("E" not in block or not block.keys() & {"nu", "G"}):
        missing = "E" if "E" not in block else "nu (or G)"
        raise DescriptionError(
            f"{where}: {missing} is missing. Write {{E, nu, rho}}, {{E, G, rho}} or a name: "
            f"{', '.join(MATERIALS)}."
        )
    changes = block.read()
    given: dict[str, float] = {key: changes[key] for key in ("E", "nu", "G") if key in changes}
    changes |= zip(("E", "nu", "G"), _elastic(given, base, where), strict=True)
    return Material(**{"rho": None} | changes) if base is None else replace(base, **changes)


def _elastic(
    given: dict[str, float], base: Material | None, where: str
) -> tuple[float, float, float]:
    """E, nu, G from those given and the material they change."""
    if base is not None and not given:
        return base.E, base.nu, base.G
    E = given["E"] if base is None or "E" in given else base.E
    if base is not None and abs(base.G - base.E / (2 * (1 + base.nu))) > 1e-6 * base.G:
        return E, given.get("nu", base.nu), given.get("G", base.G)  # a composite: three numbers
    if "G" not in given:
        nu = given["nu"] if base is None or "nu" in given else base.nu
        return E, nu, E / (2 * (1 + nu))
    nu = given["nu"] if "nu" in given else E / (2 * given["G"]) - 1
    if not -1 < nu <= 0.5:
        raise DescriptionError(
            f"{where}: E = {E:g} and G = {given['G']:g} give nu = {nu:.3g}. An isotropic material "
            "has -1 < nu <= 0.5. Correct one, or add nu if the material is not isotropic."
        )
    return E, nu, given["G"]
