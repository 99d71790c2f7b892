"""How large a number of a description may be: one wide range for each physical quantity.

A range keeps out numbers that nothing can be built of, and with which products of a few of them
would leave double precision (1e-308 to 1e308); what lies inside may still be unusual.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

from pinflex.errors import DescriptionError


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
