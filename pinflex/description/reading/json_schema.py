"""The JSON Schema of a description, for editors: keys, words and bounds as the readers have them.

Made of the tables that the readers use (fields of records, shapes, materials, kinds), so that a
shape or a kind that is registered is in it. What one key alone cannot tell is left to the readers.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Iterable, Mapping
from typing import Any

from pinflex.description import loops, section
from pinflex.description.blocks import control, external, flexible, joints, material
from pinflex.description.blocks.flexible import PATCH_KEYS as PATCH_KEYS
from pinflex.description.description import KEYS, Description
from pinflex.description.files import HOME_SIZES
from pinflex.description.motions import trajectory
from pinflex.description.motions.motion import KINDS
from pinflex.description.reading.schema import RANGES, UNITS
from pinflex.description.solve import SolveSpec

Form = dict[str, Any]
_TEXT: Form = {"type": "string"}
_NAMES: Form = {"type": "array", "items": _TEXT}
_PAIR: Form = {"type": "array", "items": _TEXT, "minItems": 2, "maxItems": 2}
_NUMBER: Form = {"type": "number"}
_MEASURE: Form = {"anyOf": [_NUMBER, _TEXT]}


def json_schema() -> Form:
    """The schema of a whole YAML file, as plain data."""
    top = _of_record(Description) | {
        "urdf": _TEXT,
        "xacro_args": _named({"type": ["string", "number", "boolean"]}),
        "joints": _named(_joint()),
        "actuated": _NAMES,
        "loops": _named(_block(_of_record(loops.Loop) | {
            "kind": {"enum": [*loops.LOOP_KINDS, loops.BUSHING]}, "between": _PAIR,
            "at": _place(), "stiffness": {}, "damping": {}, "friction": _friction(),
            "rest": {}})),
        "home": _named({"anyOf": [_MEASURE, {"type": "array", "items": _MEASURE,
                                             "maxItems": max(map(max, filter(None, _SIZES)))}]}),
        "platform": _TEXT,
        "frames": _NAMES,
        "flexible": _named(_link()),
        "damping": _damping(("rayleigh", "modal", "scope")),
        "forces": _named(_block(_any(external.FORCE_KEYS) | {"at": _TEXT}, ["at"])),
        "springs": _named(_block(
            {key: _measure(of) for key, of in external.SPRING_KEYS.items()}
            | {"between": _PAIR, "at": _place(), "table": {"type": "array"},
               "tension_only": {"type": "boolean"}},
            ["between"])),
        "added_masses": _named(_block(_any(external.ADDED_KEYS) | {"at": _TEXT}, ["at"])),
        "payload": _block(
            {key: _measure(of) if key == "mass" else {} for key, of in external.KEYS.items()}
            | {"at": _TEXT}, ["at", "mass"]),
        "control": _control(),
        "motion": _motion(),
        "solve": _block(_of_record(SolveSpec)),
    }  # fmt: skip
    ordered = {key: top.get(key, {}) for key in KEYS}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "pinflex description",
        **_block(ordered, ["urdf"]),
    }


_SIZES = tuple(HOME_SIZES.values())


def _empty(form: Form) -> Form:
    """The form, or nothing: an empty value counts as not written."""
    return {"anyOf": [form, {"type": "null"}]} if form else {}


def _any(keys: Iterable[str]) -> dict[str, Form]:
    """Keys whose values only the readers know."""
    return {key: {} for key in keys}


def _block(keys: Mapping[str, Form], required: Iterable[str] = ()) -> Form:
    properties = {key: _empty(form) for key, form in keys.items()}
    form: Form = {"type": "object", "properties": properties, "additionalProperties": False}
    return form | ({"required": [*required]} if required else {})


def _named(form: Form) -> Form:
    """A block with names of the user's own."""
    return {"type": "object", "additionalProperties": _empty(form)}


def _place() -> Form:
    """A point of the ground."""
    point: Form = {"type": "array", "items": _measure("place"), "minItems": 3, "maxItems": 3}
    return {"anyOf": [point, {"const": "home"}]}


def _measure(quantity: str) -> Form:
    """A number of a quantity; its unit tells what it is."""
    form = dict(_MEASURE if quantity in UNITS else _NUMBER)
    return form | {"description": RANGES[quantity].unit}


def _of_record(record: type) -> dict[str, Form]:
    """The keys of a record, by the readers of its fields."""
    found = {}
    for one in dataclasses.fields(record):
        if "read" in one.metadata:
            form = dict(one.metadata.get("form", {}))
            if "enum" in form:
                form["enum"] = [*form["enum"]]
            found[one.name] = form
    return found


def _control() -> Form:
    """Entries of the user's names, and the times of a digital controller."""
    entry = _block(
        _any(control.KEYS) | {"forward": {"enum": [*control.FORWARD]},
                                    "limit": _NUMBER},
        ["measure", "drive"],
    )  # fmt: skip
    times = {key: _empty({"anyOf": [_NUMBER, entry]}) for key in control.DIGITAL}
    return _named(entry) | {"properties": times}


def _joint() -> Form:
    own: dict[str, Form] = {
        "type": {"enum": [*joints.TYPES]},
        "axes": {"type": "array"},
        "rest": _MEASURE,
        "drive": _block(
            _any(joints.DRIVE_KEYS) | _of_record(joints.Drive) | {"friction": _friction()}
        ),
        "friction": _friction(),
        "follows": {"anyOf": [_TEXT, {"const": False}]},
        "stops": _block(_of_record(joints.Stops)),
        "table": {"type": "array"},
    }
    loose = {key: form for key, form in _of_record(loops.Loop).items() if key in loops.PIN}
    return _block(_any(joints.KEYS) | loose | _of_record(joints.JointExtra) | own
                  | {"parallel_spring": _NUMBER})  # fmt: skip


def _friction() -> Form:
    """A block, or the sliding friction alone."""
    return {"anyOf": [_NUMBER, _block(_of_record(joints.Friction))]}


def _damping(keys: Iterable[str]) -> Form:
    return _block(_any(keys))


def _link() -> Form:
    basis = _any(key for keys in flexible.BASES.values() for key in keys)
    basis |= {"kind": {"enum": [*flexible.BASES]}}
    made: dict[str, Form] = _any(flexible.KEYS)
    made |= _of_record(flexible.FlexibleLink) | {
        "material": _material(),
        "section": _section(),
        "basis": _block(basis),
        "start": _TEXT,
        "end": _TEXT,
        "damping": _damping(("rayleigh", "modal")),
        "patches": _named(_block(_any(PATCH_KEYS), ["from", "to"])),
    }
    switches = {key: {"enum": ["auto", True, False]} for key in flexible.SWITCHES}
    return _block(made | switches, ["material"])


def _material() -> Form:
    names = {"enum": [*material.MATERIALS, *material.ALIASES]}
    return {"anyOf": [names, _block(_any(material.KEYS))]}


def _section() -> Form:
    shapes = []
    for shape in section.SHAPES.values():
        keys = {key: _measure(quantity) for key, quantity in shape.keys.items()}
        keys |= {key: {} for key in shape.optional} | {"shape": {"const": shape.name}}
        shapes.append(_block(keys, ["shape", *shape.keys]))
    return {"anyOf": shapes}


def _motion() -> Form:
    kinds = []
    for kind, make in KINDS.items():
        parameters = inspect.signature(make).parameters
        needed = [key for key, one in parameters.items() if one.default is one.empty]
        keys: dict[str, Form] = {key: {} for key in parameters} | {"shaper": _shaper()}
        kinds.append(_block(keys | {"kind": {"const": kind}}, ["kind", *needed]))
    return {"anyOf": kinds}


def _shaper() -> Form:
    kinds = {"enum": [*trajectory.KINDS]}
    return {"anyOf": [kinds, _block(_any(trajectory.KEYS) | {"kind": kinds})]}
