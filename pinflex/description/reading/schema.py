"""Checked reading of parsed YAML: a wrong value is named by file, key path, value and allowed ones.

Every reader takes the value and `where` it stands, as in "3rrr.yaml: flexible.distal_1.section".
"""

from __future__ import annotations

import dataclasses
import math
import re
import reprlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pinflex.errors import DescriptionError, nearest

# How large a number of a description may be: one wide range for each physical quantity.
#
# A range keeps out numbers that nothing can be built of, and with which products of a few of them
# would leave double precision (1e-308 to 1e308); what lies inside may still be unusual.


@dataclass(frozen=True)
class Range:
    """Magnitudes that a quantity may have; 0 and signs are up to the key.

    Attributes:
        least, most: Smallest magnitude but zero (0: any, as nothing is divided by it), and largest,
            in `unit`.
        unit: As messages say it.
        why: What lies beyond.
    """

    least: float
    most: float
    unit: str
    why: str


# One table for all keys: what the number is, and how far it may go.
RANGES = {
    "length": Range(1e-9, 1e6, "m", "an atom is 1e-10 m, the Earth 1e7 m across"),
    "place": Range(0.0, 1e6, "m", "the Earth is 1e7 m across"),
    "area": Range(1e-20, 1e12, "m^2", "the square of a length"),
    "modulus": Range(1e-28, 1e18, "m^3", "the third power of a length"),
    "second moment": Range(1e-36, 1e24, "m^4", "the fourth power of a length"),
    "elasticity": Range(1e-12, 1e30, "Pa", "gels have 1 Pa, diamond 1e12 Pa"),
    "density": Range(1e-30, 1e9, "kg/m^3", "osmium has 2e4 kg/m^3; 1e-20 is as good as none"),
    "mass": Range(0.0, 1e9, "kg", "a large ship is 1e8 kg"),
    "inertia": Range(0.0, 1e15, "kg m^2", "a large ship has 1e12 kg m^2"),
    "acceleration": Range(0.0, 1e15, "m/s^2", "the Sun's surface has 274 m/s^2"),
    "force": Range(0.0, 1e18, "N", "a rocket has 1e8 N"),
    "moment": Range(0.0, 1e18, "N m", "a force times a length"),
    "stiffness": Range(0.0, 1e30, "N/m or N m/rad", "a steel block of 1 m has 2e11 N/m"),
    "damping": Range(0.0, 1e24, "N s/m or N m s/rad", "a stiffness times a time"),
    "time": Range(1e-12, 1e9, "s", "light crosses 0.3 mm in 1e-12 s, and 1e9 s are 30 years"),
    "rate": Range(1e-12, 1e12, "1/s", "the inverse of a time"),
    "speed": Range(1e-12, 1e12, "rad/s or m/s", "light travels at 3e8 m/s"),
    "position": Range(0.0, 1e6, "rad or m", "1e6 rad are 160 000 turns"),
    "angle": Range(0.0, 1e6, "rad", "1e6 rad are 160 000 turns"),
    "voltage": Range(0.0, 1e12, "V", "lightning has 1e8 V"),
    "gain": Range(0.0, 1e15, "drive per measure", "a voltage over a micrometre"),
    "ratio": Range(1e-9, 1e9, "-", "a pure number"),
}


# Units that may be written behind a number; every other number is SI alone.
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180}
UNITS = {"length": _LENGTHS, "place": _LENGTHS, "angle": _ANGLES}
_MEASURE = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z]+)")


def measured(value: Any, of: str | None) -> Any:
    """The number in SI that a text such as "20 mm" or "3 deg" means; any other value as it is."""
    found = _MEASURE.fullmatch(value.strip()) if isinstance(value, str) else None
    factor = UNITS.get(of or "", {}).get(found[2]) if found else None
    return value if found is None or factor is None else float(found[1]) * factor


def units_of(of: str | None) -> str:
    """Sentence on the units that a quantity may have."""
    names = ", ".join(UNITS.get(of or "", ()))
    return f" Units that may be written: {names}." if names else " Units are SI and never written."


def within(value: float, where: str, of: str) -> float:
    """The number, if its quantity may be so large; zero passes."""
    allowed = RANGES[of]
    if value == 0 or allowed.least <= abs(value) <= allowed.most:
        return value
    raise DescriptionError(
        f"{where}: {value:.6g} {allowed.unit} is out of range. Allowed: magnitudes "
        f"{f'of {allowed.least:g} to' if allowed.least else 'up to'} {allowed.most:g} "
        f"{allowed.unit} ({allowed.why}).",
        value=value,
    )


def finite(value: float) -> float:
    """The number, or infinity where an integer is too long for one."""
    try:
        return float(value)
    except OverflowError:
        return math.inf


Vec3 = tuple[float, float, float]
_LETTERS: dict[str, Vec3] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_MOST = 10**9  # of whole numbers


def at(where: str, key: object) -> str:
    """Where a key of the block at `where` stands: "x.yaml" + "urdf" -> "x.yaml: urdf"."""
    return f"{where}.{key}" if ": " in where else f"{where}: {key}"


def shown(value: object) -> str:
    """The value as text for a message, cut short: aliases can make a small file endless."""
    short = reprlib.Repr()
    short.maxlevel = 2
    text = short.repr(value)
    return text if len(text) <= 120 else text[:117] + "..."


def mapping(
    value: object, where: str, keys: Collection[str] | None = None, required: Iterable[str] = ()
) -> dict[str, Any]:
    """A block `key: value`; empty values count as not written."""
    if not isinstance(value, dict):
        hint = f" Its keys: {', '.join(keys)}." if keys else ""
        raise DescriptionError(f"{where}: {shown(value)} is not a block of `key: value`.{hint}")
    for key in value:
        if not isinstance(key, str):
            raise DescriptionError(f"{where}: the key {shown(key)} is not text. Put it in quotes.")
        if keys is not None and key not in keys:
            name, colon, rest = key.partition(":")
            if colon and name in keys and value[key] is None:  # {kind:zvd} is one key of no value
                raise DescriptionError(
                    f"{at(where, name)}: {key} has no blank after its colon. "
                    f"Write `{name}: {rest}`."
                )
            raise DescriptionError(f"{at(where, key)}: no such key.{nearest(key, keys)}")
    written = {key: item for key, item in value.items() if item is not None}
    for key in required:
        if key not in written:
            raise DescriptionError(
                f"{at(where, key)}: missing. Required here: {', '.join(required)}. Write it."
            )
    return written


def number(
    value: object,
    where: str,
    low: float = -math.inf,
    high: float = math.inf,
    above: float = -math.inf,
    of: str | None = None,
) -> float:
    """A finite number with low <= value <= high and value > above."""
    edges = ((">", above), (">=", low), ("<=", high))
    bounds = " and ".join(f"{sign} {edge:g}" for sign, edge in edges if math.isfinite(edge))
    allowed = f"Allowed: a finite number {bounds}".rstrip() + "."
    value = measured(value, of)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        hint = units_of(of) if isinstance(value, str) else ""
        raise DescriptionError(f"{where}: {shown(value)} is not a number. {allowed}{hint}")
    result = finite(value)
    if not (math.isfinite(result) and low <= result <= high and result > above):
        raise DescriptionError(f"{where}: {shown(value)} is out of range. {allowed}", value=value)
    return result if of is None else within(result, where, of)


def quantity(kind: str) -> str:
    """Quantity (a key of `RANGES`) of a position of a joint of one freedom."""
    return "place" if kind == "prismatic" else "angle"


def integer(value: object, where: str, low: int, high: int | None = None) -> int:
    """A whole number, low <= value <= high (None: a thousand million)."""
    most = _MOST if high is None else high
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= most:
        large = isinstance(value, int) and value > most
        bounds = f">= {low}" + (f" and <= {most}" if large or high is not None else "")
        raise DescriptionError(
            f"{where}: {shown(value)} is not valid. Allowed: a whole number {bounds}.", value=value
        )
    return value


def boolean(value: object, where: str) -> bool:
    """true or false."""
    if not isinstance(value, bool):
        raise DescriptionError(f"{where}: {shown(value)} is not valid. Allowed: true, false.")
    return value


def text(value: object, where: str) -> str:
    """A non-empty text."""
    if not isinstance(value, str) or not value.strip():
        raise DescriptionError(f"{where}: {shown(value)} is not a text. Write a name.")
    return value.strip()


def choice(value: object, where: str, names: Collection[str]) -> str:
    """One of the given words."""
    if not isinstance(value, str) or value not in names:
        raise DescriptionError(
            f"{where}: {shown(value)} is not known.{nearest(str(value)[:80], names)}", value=value
        )
    return value


def known(value: object, where: str, names: Collection[str], what: str) -> str:
    """A name that exists in the URDF, or another list."""
    name = text(value, where)
    if name not in names:
        raise DescriptionError(
            f'{where}: no such {what}: "{name[:80]}".{nearest(name[:80], names)}', name=name
        )
    return name


def items(value: object, where: str, size: int | None = None) -> list[Any]:
    """A list, of `size` entries if given."""
    if not isinstance(value, (list, tuple)) or (size is not None and len(value) != size):
        what = "a list" if size is None else f"a list of {size}"
        raise DescriptionError(f"{where}: {shown(value)} is not {what}. Write [a, b, ...].")
    return list(value)


def numbers(
    value: object, where: str, size: int, low: float = -math.inf, of: str | None = None
) -> tuple[float, ...]:
    """A list of `size` finite numbers >= low, each as in `number`."""
    entries = enumerate(items(value, where, size))
    return tuple(number(v, f"{where}[{i}]", low, of=of) for i, v in entries)


def vector(value: object, where: str, low: float = -math.inf, of: str | None = None) -> Vec3:
    """Three finite numbers >= low, each as in `number`."""
    x, y, z = numbers(value, where, 3, low, of)
    return x, y, z


def direction(value: object, where: str) -> Vec3:
    """A unit vector, from x, y, z, -x, -y, -z or three numbers that are not all zero."""
    if isinstance(value, str):
        letter = choice(value, where, ("x", "y", "z", "-x", "-y", "-z"))
        x, y, z = _LETTERS[letter[-1]]
        return (x, y, z) if len(letter) == 1 else (-x, -y, -z)
    x, y, z = vector(value, where)
    size = math.hypot(x, y, z)
    if not 1e-150 < size < 1e150:
        raise DescriptionError(
            f"{where}: {shown(value)} has no direction. Write x, y, z or [x, y, z]."
        )
    return x / size, y / size, z / size


def names(value: object, where: str, allowed: Collection[str], what: str) -> tuple[str, ...]:
    """A list of different names, each one of those allowed."""
    found: list[str] = []
    for i, item in enumerate(items(value, where)):
        name = known(item, f"{where}[{i}]", allowed, what)
        if name in found:
            raise DescriptionError(f'{where}[{i}]: "{name}" is listed twice. Keep one.', name=name)
        found.append(name)
    return tuple(found)


Points = tuple[tuple[float, float], ...]


def points(
    value: object, where: str, of: str, force: str, low: float = -math.inf, curve: bool = False
) -> Points:
    """Two or more points [place, force], by increasing place; `curve`: of speeds and torques."""
    found: list[tuple[float, float]] = []
    pair, by, what = "place, force", "place", "table"
    if curve:
        pair, by, what = "motor speed rad/s, motor torque N m", "speed", "curve"
    for k, item in enumerate(items(value, where)):
        here = f"{where}[{k}]"
        both = items(item, here, 2)
        place = number(both[0], f"{here}[0]", low, of=of)
        found.append((place, number(both[1], f"{here}[1]", low, of=force)))
        if k and place <= found[-2][0]:
            raise DescriptionError(
                f"{here}: {'the speed ' * curve}{place:g} does not follow {found[-2][0]:g}. Write "
                f"the points [{pair}] by increasing {by}."
            )
    if len(found) < 2:
        raise DescriptionError(f"{where}: one point is no {what}. Write two or more.")
    return tuple(found)


# One reader of blocks. A block is a table of its keys, each a dataclass field that carries how its
# value is read, its default, range and choices, and what it looks like in the JSON Schema:
#
#     dt: float | None = schema.real(None, of="time", above=0)
#
# A record whose fields are made so is such a table; `keys` adds what the record itself does not
# keep. What one key alone cannot tell (two keys that exclude each other) is checked by the record's
# own module.

Reader = Callable[..., Any]  # of the value, of where it stands, and of what `given` says
Form = dict[str, Any]
REQUIRED: Any = dataclasses.MISSING  # as a default
TEXT: Form = {"type": "string"}
PAIR: Form = {"type": "array", "items": TEXT, "minItems": 2, "maxItems": 2}
LIST: Form = {"type": "array"}


def key(default: Any, reader: Reader | None, **about: Any) -> Any:
    """A field that a reader reads; without one the block's own module does.

    `about` is further metadata: `form`, what the value looks like as JSON Schema says it, or a
    function that gives it; `key`, its name in the YAML; `given`, whether the reader takes too what
    the block is read with (the robot whose links and joints it names); `required`.
    """
    return dataclasses.field(default=default, metadata={"read": reader, **about})


def bare(form: Form | Callable[[], Form], default: Any = None, **about: Any) -> Any:
    """A key that the block's own module reads."""
    return key(default, None, form=form, **about)


def real(
    default: Any,
    of: str | None = None,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    above: float = -math.inf,
    **about: Any,
) -> Any:
    """A finite number in bounds and in the range of its quantity (`RANGES`)."""
    bounds = {"minimum": low, "maximum": high, "exclusiveMinimum": above}
    form = measure(of, **{k: v for k, v in bounds.items() if math.isfinite(v)})
    about = {"form": form} | about
    return key(default, lambda v, at: number(v, at, low, high, above, of), **about)


def measure(of: str | None, **bounds: float) -> Form:
    """A number of a quantity; its unit tells what it is, and may be written behind some."""
    plain: Form = {"type": "number"} | bounds
    form: Form = {"anyOf": [plain, TEXT]} if of in UNITS else plain
    return form if of is None else form | {"description": RANGES[of].unit}


def triple(default: Any, of: str, low: float = -math.inf) -> Any:
    """Three numbers of a quantity."""
    return key(default, lambda v, at: vector(v, at, low, of), form=LIST)


def direction_key(default: Any) -> Any:
    """A unit vector."""
    return key(default, direction, form={})


def points_key(of: str, force: str, low: float = -math.inf, curve: bool = False) -> Any:
    """A table of points [place, force]."""
    return key((), lambda v, at: points(v, at, of, force, low, curve), form=LIST)


def place_form() -> Form:
    """A point of the ground."""
    three: Form = {"type": "array", "items": measure("place"), "minItems": 3, "maxItems": 3}
    return {"anyOf": [three, {"const": "home"}]}


def whole(default: Any, low: int, high: int | None = None) -> Any:
    """A whole number in bounds."""
    form = {"type": "integer", "minimum": low} | ({} if high is None else {"maximum": high})
    return key(default, lambda v, at: integer(v, at, low, high), form=form)


def word(default: Any, choices: Collection[str]) -> Any:
    """One of the choices, which may be a table that grows."""
    return key(default, lambda v, at: choice(v, at, choices), form=lambda: {"enum": [*choices]})


def words(choices: Collection[str], what: str) -> Any:
    """A list of some of the choices, which are each `what`."""
    form = LIST | {"items": {"enum": [*choices]}}
    return key((), lambda v, at: names(v, at, choices, what), form=form)


def flag(default: Any) -> Any:
    """true or false."""
    return key(default, boolean, form={"type": "boolean"})


Field = dataclasses.Field[Any]
Table = Mapping[str, Field]


def keys(record: type, *order: str, **more: Field) -> dict[str, Field]:
    """The table of a record: its fields that say how they are read, `more`; `order`: the first."""
    own = {f.metadata.get("key", f.name): f for f in dataclasses.fields(record) if f.metadata}
    table = own | more
    return {key: table[key] for key in dict.fromkeys((*order, *table))}


class Block(dict[str, Any]):
    """The written keys of a block, and where it stands.

    Attributes:
        where: Its place, as in "3rrr.yaml: flexible.distal_1".
    """

    def __init__(
        self,
        value: object,
        where: str,
        table: Table | None = None,
        *required: str,
        before: str = "",
    ) -> None:
        need = required or [k for k, f in (table or {}).items() if _needed(f)]
        super().__init__(mapping(value, where, table, need))
        self.where, self._table = where, table or {}
        self._before = before or at(where, "")

    def at(self, key: str) -> str:
        """Where a key of it stands."""
        return self._before + key

    def error(self, key: str, text: str, **data: Any) -> DescriptionError:
        """The error of a key; of the block itself where that is empty."""
        return DescriptionError(f"{self.at(key) if key else self.where}: {text}", **data)

    def only(self, keys: Iterable[str], text: str) -> None:
        """Raise at the first of some keys that is written."""
        for key in self:
            if key in keys:
                raise self.error(key, text)

    def read(self, given: Any = None) -> dict[str, Any]:
        """The written keys that have a reader, by the names of their fields."""
        values = {}
        for key, field in self._table.items():
            reader = field.metadata["read"]
            if reader is not None and key in self:
                more = (given,) if "given" in field.metadata else ()
                values[field.name or key] = reader(self[key], self.at(key), *more)
        return values


def _needed(field: Field) -> bool:
    return bool(field.metadata.get("required", field.default is REQUIRED))


def part(default: Any, record: type) -> Any:
    """A block that its table alone makes a record of."""
    table = keys(record)
    return key(
        default, lambda v, at: record(**Block(v, at, table).read()),
        form=lambda: block_form(table),
    )  # fmt: skip


def entries(value: object, where: str, table: Table | None = None) -> Iterator[tuple[str, Block]]:
    """The blocks of a block of names of the user's own, in file order."""
    for name, item in mapping(value, where).items():
        yield name, Block(item, at(where, name), table)


def block_form(table: Table) -> Form:
    """A block as JSON Schema says it; an empty value counts as not written."""
    properties = {}
    for key, field in table.items():
        form = field.metadata["form"]
        form = form() if callable(form) else form
        properties[key] = {"anyOf": [form, {"type": "null"}]} if form else {}
    whole: Form = {"type": "object", "properties": properties, "additionalProperties": False}
    need = [key for key, field in table.items() if _needed(field)]
    return whole | ({"required": need} if need else {})


def named_form(form: Form) -> Form:
    """A block with names of the user's own."""
    return {"type": "object", "additionalProperties": {"anyOf": [form, {"type": "null"}]}}
