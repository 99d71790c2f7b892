"""The block `home` of a description: a guess of the configuration in Pinocchio's layout."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from pinflex.description import schema
from pinflex.description.source import HOME_SIZES
from pinflex.errors import DescriptionError
from pinflex.rotations import quaternion

Home = dict[str, float | tuple[float, ...]]


def read_home(value: object, where: str, types: Mapping[str, str]) -> Home:
    """The home guess in Pinocchio's layout; the file may also say rotation vectors and angles."""
    home: Home = {}
    movable = tuple(name for name, kind in types.items() if HOME_SIZES[kind])
    for name, item in schema.mapping(value, where).items():
        place = schema.at(where, name)
        schema.known(name, place, movable, "moving joint")
        sizes = HOME_SIZES[types[name]]
        if sizes == (1,):
            home[name] = schema.number(item, place, of=schema.quantity(types[name]))
            continue
        if not isinstance(item, list) or len(item) not in sizes:
            raise DescriptionError(
                f"{place}: {schema.shown(item)} does not fit a {types[name]} joint, which takes a "
                f"list of {' or '.join(map(str, sizes))} numbers. Correct it."
            )
        lengths = len(item) if types[name] in ("planar", "floating") else 0
        lengths = {3: 2, 6: 3, 7: 3}.get(lengths, 0)
        of = [*["place"] * lengths, *["angle"] * (len(item) - lengths)]
        values = tuple(schema.number(v, f"{place}[{i}]", of=of[i]) for i, v in enumerate(item))
        if types[name] == "universal":
            home |= {f"{name}.{axis + 1}": angle for axis, angle in enumerate(values)}
        elif types[name] == "planar":
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
