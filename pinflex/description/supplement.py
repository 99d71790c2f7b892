"""The blocks of a description that add to a URDF: `joints`, `loops` and `solve`."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinflex.description import schema
from pinflex.description.frames import frames
from pinflex.description.schema import Vec3
from pinflex.description.urdf import Urdf
from pinflex.errors import DescriptionError
from pinflex.text import brief

LEVELS = ("rigid", "quasistatic", "ked", "coupled")
INTEGRATORS = (
    *("generalized_alpha", "newmark", "hht"),
    *("central_difference", "houbolt", "wilson_theta", "mode_superposition"),
    "radau",
)
COUPLED_ONLY = ("radau",)
ASKED = ("torque", "deflection", "platform")
TOLERANCES = (
    1e-9,
    0.1,
)  # least and largest tol; a scene may have a higher floor, which a run finds
KED_ONLY = INTEGRATORS[3:-1]
KED_TERMS = ("full", "structural")
STARTS = ("auto", "straight", "static")
LOOP_KINDS = (
    "weld",
    "revolute",
    "prismatic",
    "cylindrical",
    "universal",
    "spherical",
    "planar",
    "distance",
    "slider",
)
_WITH_AXIS = ("revolute", "prismatic", "cylindrical", "universal", "planar")


@dataclass(frozen=True)
class JointExtra:
    """What a URDF cannot say about a joint.

    Attributes:
        name: URDF joint.
        type: spherical or universal, in place of the URDF's type; None keeps that.
        axes: The two unit axes of a universal joint in the joint frame; None: x, then y.
        rotor_inertia: Inertia of the motor, seen at the joint [kg m^2 | kg].
        spring: Stiffness [N m/rad | N/m].
        parallel_spring: Whether it acts beside a motor.
        rest: Position where the spring is slack [rad | m].
        damper: Viscous damping [N m s/rad | N s/m].
    """

    __repr__ = brief

    name: str
    type: str | None = None
    axes: tuple[Vec3, Vec3] | None = None
    rotor_inertia: float = 0.0
    spring: float = 0.0
    rest: float = 0.0
    damper: float = 0.0
    parallel_spring: bool = False


@dataclass(frozen=True)
class Loop:
    """A joint that closes a loop between two frames of the tree.

    Attributes:
        name: Name for reports.
        kind: One of `LOOP_KINDS`.
        frame_a: First frame.
        frame_b: Second frame.
        axis: Unit axis of the joint, in frame a and in frame b (universal: in frame a only).
        axis_b: universal: unit axis in frame b; None: x.
        length: distance: [m]; None: as it is at home.
        sleeve: slider: length of the sleeve [m]; 0: it touches the beam at a point.
        pivoting: slider: the sleeve turns freely on three points in line, instead of along the
            beam's tangent at its middle.
        turning: slider: the sleeve may turn against frame b; else it is fixed to it.
    """

    __repr__ = brief

    name: str
    kind: str
    frame_a: str
    frame_b: str
    axis: Vec3 = (0.0, 0.0, 1.0)
    axis_b: Vec3 | None = None
    length: float | None = None
    sleeve: float = 0.0
    pivoting: bool = False
    turning: bool = True


@dataclass(frozen=True)
class SolveSpec:
    """What to compute.

    Attributes:
        level: rigid, quasistatic, ked or coupled.
        until: End time [s]; None: the duration of the motion.
        dt: Time step [s]; None: chosen from the motion and the frequencies.
        samples: Number of instants to report; None: every step.
        integrator: generalized_alpha, newmark or hht; at level ked also central_difference,
            houbolt, wilson_theta and mode_superposition; at level coupled also radau, with tol.
            None: radau where a tol is asked for and it can, else generalized_alpha.
        tol: Error of time integration that torques, platform and deflections may have, relative to
            their largest deviation; steps follow from it. None: steps of dt.
        asked: Which of torque, deflection and platform tol is about; empty: all.
        rho_inf: Spectral radius at infinity [-], 0 to 1; None: the integrator's own.
        newmark: (gamma, beta) [-] of the integrator newmark; None: (1/2, 1/4).
        ked: Terms of level ked: full, or structural (M, the beams' K and the damping alone, the
            classical method).
        theta: Length of the step of wilson_theta over dt [-]; None: 1.4.
        modes: Number of modes of mode_superposition; None: 12.
        drive: prescribed (the motors follow the motion) or torque (they push).
        kp: Position gain of the torque drive [N m/rad | N/m].
        kd: Speed gain of the torque drive [N m s/rad | N s/m].
        start: straight (undeformed), static (in equilibrium), or auto (static where something
            acts and an equilibrium exists).
    """

    __repr__ = brief

    level: str = "coupled"
    until: float | None = None
    dt: float | None = None
    samples: int | None = None
    tol: float | None = None
    asked: tuple[str, ...] = ()
    integrator: str | None = None
    rho_inf: float | None = None
    newmark: tuple[float, float] | None = None
    ked: str = "full"
    theta: float | None = None
    modes: int | None = None
    drive: str = "prescribed"
    kp: float = 0.0
    kd: float = 0.0
    start: str = "auto"

    @property
    def by_steps(self) -> str:
        """The integrator of equal steps."""
        return self.integrator or "generalized_alpha"


_NUMBERS = {  # of the options that Python may give to `solve`: quantity, least (None: above 0)
    "until": ("time", None),
    "dt": ("time", None),
    "kp": ("stiffness", 0.0),
    "kd": ("damping", 0.0),
}
_WORDS = {"integrator": INTEGRATORS, "drive": ("prescribed", "torque")}
_WORDS |= {"start": ("straight", "static"), "ked": KED_TERMS}


def check_options(options: dict[str, Any]) -> dict[str, Any]:
    """Options of `solve` given in Python, each of the type and in the range of its YAML key."""
    checked: dict[str, Any] = {}
    for key, given in options.items():
        value = given.item() if isinstance(given, np.generic) else given
        place = f"solve.{key}"
        if key in _NUMBERS:
            quantity, least = _NUMBERS[key]
            if least is None:
                value = schema.number(value, place, above=0.0, of=quantity)
            else:
                value = schema.number(value, place, low=least, of=quantity)
        elif key in ("samples", "modes"):
            value = schema.integer(value, place, 2 if key == "samples" else 1)
        elif key in ("tol", "theta", "rho_inf"):
            value = schema.number(value, place)
        elif key == "newmark":
            value = schema.numbers(value, place, 2, low=0)
        elif key in _WORDS:
            value = schema.choice(value, place, _WORDS[key])
        elif key == "asked":
            value = tuple(schema.text(x, place) for x in schema.items(value, place))
        checked[key] = value
    return checked


def read_joints(value: object, where: str, urdf: Urdf) -> dict[str, JointExtra]:
    """The block `joints`, by joint name."""
    return {
        name: _joint(name, item, schema.at(where, name), urdf)
        for name, item in schema.mapping(value, where).items()
    }


def _joint(name: str, value: object, where: str, urdf: Urdf) -> JointExtra:
    schema.known(name, where, urdf.joints, f"joint in {urdf.file}")
    plain = {"rotor_inertia": "inertia", "spring": "stiffness", "parallel_spring": "stiffness"}
    plain |= {"rest": "position", "damper": "damping"}
    block = schema.mapping(value, where, ("type", "axes", *plain))
    kind = None
    written = urdf.joints[name].type
    if "type" in block:
        place = schema.at(where, "type")
        kind = schema.choice(block["type"], place, ("spherical", "universal"))
        if written not in ("fixed", "floating"):
            raise DescriptionError(
                f"{place}: {kind}, but {urdf.file} says {written}. Only a joint that is fixed or "
                "floating in the URDF can become another. Change the URDF, or remove the key."
            )
    fields: dict[str, Any] = {}
    for key in plain:
        if key in block:
            low = -math.inf if key == "rest" else 0.0
            fields[key] = schema.number(block[key], schema.at(where, key), low, of=plain[key])
            if key in ("spring", "parallel_spring", "rest") and (
                kind or written in ("floating", "planar")
            ):
                raise DescriptionError(
                    f"{schema.at(where, key)}: a {kind or written} joint has no one spring. "
                    "Springs act on joints of one degree of freedom. Split the joint in the URDF."
                )
            if written == "fixed" and kind is None:
                raise DescriptionError(
                    f"{schema.at(where, key)}: the joint is fixed in {urdf.file}, so it would do "
                    "nothing. Remove it, or give the joint a type."
                )
    if "parallel_spring" in block:
        if "spring" in block:
            place = schema.at(where, "parallel_spring")
            raise DescriptionError(f"{place}: beside `spring`. Remove one of them.")
        fields |= {"spring": fields.pop("parallel_spring"), "parallel_spring": True}
    if "rest" in block and "spring" not in fields:
        raise DescriptionError(f"{schema.at(where, 'rest')}: there is no spring. Add `spring`.")
    if "axes" in block:
        fields["axes"] = _axes(block["axes"], schema.at(where, "axes"), kind)
    return JointExtra(name, kind, **fields)


def _axes(value: object, where: str, kind: str | None) -> tuple[Vec3, Vec3]:
    if kind != "universal":
        raise DescriptionError(f"{where}: only a universal joint has two. Add type: universal.")
    pair = schema.items(value, where, 2)
    a, b = (schema.direction(axis, f"{where}[{i}]") for i, axis in enumerate(pair))
    if abs(sum(x * y for x, y in zip(a, b, strict=True))) > 1 - 1e-9:
        raise DescriptionError(f"{where}: {schema.shown(value)} are parallel. Turn one of them.")
    return a, b


def read_loops(value: object, where: str, urdf: Urdf) -> tuple[Loop, ...]:
    """The block `loops`, in file order."""
    return tuple(
        _loop(name, item, schema.at(where, name), urdf)
        for name, item in schema.mapping(value, where).items()
    )


def _loop(name: str, value: object, where: str, urdf: Urdf) -> Loop:
    keys = ("kind", "between", "axis", "axis_b", "length", "sleeve", "pivoting", "turning")
    block = schema.mapping(value, where, keys, ("kind", "between"))
    place = {key: schema.at(where, key) for key in keys}
    kind = schema.choice(block["kind"], place["kind"], LOOP_KINDS)
    schema.items(block["between"], place["between"], 2)
    a, b = frames(block["between"], place["between"], urdf)
    used = {"axis": _WITH_AXIS, "axis_b": ("universal",), "length": ("distance",)}
    used |= dict.fromkeys(("sleeve", "pivoting", "turning"), ("slider",))
    for key, kinds in used.items():
        if key in block and kind not in kinds:
            raise DescriptionError(
                f"{place[key]}: has no meaning for the kind {kind}, only for {', '.join(kinds)}. "
                "Remove it, or change the kind."
            )
    axis, axis_b, length = Loop.axis, None, None
    if "axis" in block:
        axis = schema.direction(block["axis"], place["axis"])
    if "axis_b" in block:
        axis_b = schema.direction(block["axis_b"], place["axis_b"])
    if "length" in block:
        length = schema.number(block["length"], place["length"], above=0, of="length")
    sleeve = schema.number(block.get("sleeve", 0), place["sleeve"], low=0, of="length")
    pivoting = schema.boolean(block.get("pivoting", False), place["pivoting"])
    if pivoting and sleeve == 0:
        raise DescriptionError(
            f"{place['pivoting']}: a sleeve of no length turns anyway. Give `sleeve` in m."
        )
    turning = schema.boolean(block.get("turning", True), place["turning"])
    if pivoting and not turning:
        raise DescriptionError(
            f"{place['turning']}: false, but `pivoting` lets the sleeve turn. Remove one of them."
        )
    return Loop(name, kind, a, b, axis, axis_b, length, sleeve, pivoting, turning)


def read_solve(value: object, where: str) -> SolveSpec:
    """The block `solve`; a key without effect is an error."""
    words = {
        "level": LEVELS,
        "integrator": INTEGRATORS,
        "ked": KED_TERMS,
        "drive": ("prescribed", "torque"),
        "start": STARTS,
    }
    keys = tuple(field.name for field in dataclasses.fields(SolveSpec))
    block = schema.mapping(value, where, keys)
    place = {key: schema.at(where, key) for key in keys}
    fields: dict[str, Any] = {}
    for key, allowed in words.items():
        if key in block:
            fields[key] = schema.choice(block[key], place[key], allowed)
    for key in block.keys() & {"until", "dt"}:
        fields[key] = schema.number(block[key], place[key], above=0, of="time")
    if "until" in fields and "dt" in fields and fields["dt"] > fields["until"]:
        raise DescriptionError(
            f"{place['dt']}: {fields['dt']:g} s is longer than the run, until = "
            f"{fields['until']:g} s. Make it smaller."
        )
    if "tol" in block:
        fields["tol"] = schema.number(block["tol"], place["tol"], *TOLERANCES)
        if "dt" in block:
            raise DescriptionError(f"{place['tol']}: dt follows from it. Remove one of them.")
    if "asked" in block:
        fields["asked"] = schema.names(block["asked"], place["asked"], ASKED, "output")
    if "samples" in block:
        fields["samples"] = schema.integer(block["samples"], place["samples"], low=2)
    if "newmark" in block:
        gamma, beta = schema.numbers(block["newmark"], place["newmark"], 2, low=0)
        if gamma > 1 or not 0 < beta <= 1:
            raise DescriptionError(
                f"{place['newmark']}: gamma = {gamma:g}, beta = {beta:g} are out of range. "
                "Allowed: 0 <= gamma <= 1 and 0 < beta <= 1; only gamma >= 1/2 can be stable."
            )
        fields["newmark"] = (gamma, beta)
        fields.setdefault("integrator", "newmark")
    if "rho_inf" in block:
        fields["rho_inf"] = schema.number(block["rho_inf"], place["rho_inf"], 0, 1)
    if "theta" in block:
        fields["theta"] = schema.number(block["theta"], place["theta"], 1.37, 4)
    if "modes" in block:
        fields["modes"] = schema.integer(block["modes"], place["modes"], low=1)
    integrator = fields.get("integrator") or SolveSpec().by_steps
    owners = {"newmark": ("newmark",), "rho_inf": ("generalized_alpha", "hht")}
    owners |= {"theta": ("wilson_theta",), "modes": ("mode_superposition",)}
    if integrator in KED_ONLY and fields.get("level", SolveSpec.level) != "ked":
        raise DescriptionError(
            f"{place['integrator']}: {integrator} is for linear systems: level ked only. "
            "Write `level: ked`, or integrator: generalized_alpha."
        )
    if "ked" in block and fields.get("level", SolveSpec.level) != "ked":
        raise DescriptionError(f"{place['ked']}: only for `level: ked`. Add it, or remove this.")
    for key, meant in ((key, integrator in names) for key, names in owners.items()):
        if key in block and not meant:
            raise DescriptionError(
                f"{place[key]}: has no meaning for the integrator {integrator}. Remove one of them."
            )
    for key in block.keys() & {"kp", "kd"}:
        quantity = "stiffness" if key == "kp" else "damping"
        fields[key] = schema.number(block[key], place[key], low=0, of=quantity)
        if fields.get("drive") != "torque":
            raise DescriptionError(
                f"{place[key]}: only for `drive: torque`. Add it, or remove this."
            )
    return SolveSpec(**fields)
