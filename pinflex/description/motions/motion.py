"""Motions of the joints or of the platform: position, velocity and acceleration of time.

A constructor's keyword arguments are the keys of the YAML mapping, which `from_spec` reads.
Platform coordinates: x y z, the world position [m], and rz ry rx, the intrinsic Z-Y-X Euler angles
alpha, beta, gamma [rad]. Only the coordinates a motion names are imposed; the others stay free.
"""

from __future__ import annotations

import ast
import copy
import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.motions import laws
from pinflex.description.motions import laws as keys
from pinflex.description.motions import trajectory as paths
from pinflex.description.motions.laws import PLATFORM_COORDINATES, SNAP, Kinematics, Moves
from pinflex.description.motions.trajectory import Motion, of_moves
from pinflex.description.reading import schema
from pinflex.description.reading.schema import shown
from pinflex.description.robots import urdf
from pinflex.description.trajectories import profiles
from pinflex.description.trajectories.profiles import Limit, ruckig, scurve, trapezoid_times
from pinflex.description.trajectories.waypoints import trajectory
from pinflex.errors import DescriptionError, nearest

__all__ = [
    "KINDS", "Motion", "circle", "cycloid", "formula", "from_spec", "harmonic", "hold",
    "nonic", "quintic", "ruckig", "sampled", "scurve", "spin_up", "trajectory", "trapezoid",
]  # fmt: skip


def _along(kind: str, law: Any, joints: Moves, platform: Moves, duration: float) -> Motion:
    """Displacements along a law of t/duration."""
    moves = keys.moves_of(joints, platform, kind)
    n = keys.options(kind, duration=duration)
    return of_moves(kind, moves, partial(laws.move, law, moves[2], n["duration"]), n)


# Constructors: joints or platform maps names to displacements from home (rad | m).
@public
def cycloid(*, joints: Moves = None, platform: Moves = None, duration: float) -> Motion:
    """Displacements along s(u) = u - sin(2 pi u)/(2 pi), u = t/duration [s]; then rest.

    Args:
        joints: Displacements by motor [rad | m].
        platform: Displacements by platform coordinate: x y z [m], rz ry rx [rad].
        duration: Of the motion [s].
    """
    return _along("cycloid", laws.cycloid, joints, platform, duration)


@public
def quintic(*, joints: Moves = None, platform: Moves = None, duration: float) -> Motion:
    """Displacements along s(u) = 10 u^3 - 15 u^4 + 6 u^5, u = t/duration [s]; then rest.

    Args: As of `cycloid`.
    """
    return _along("quintic", laws.quintic, joints, platform, duration)


@public
def nonic(*, joints: Moves = None, platform: Moves = None, duration: float) -> Motion:
    """Displacements along a polynomial of ninth degree in t/duration [s]; then rest.

    Speed, acceleration, jerk and its rate are zero at both ends: smooth enough for `command`.

    Args: As of `cycloid`.
    """
    return _along("nonic", laws.nonic, joints, platform, duration)


@public
def spin_up(*, joints: Moves = None, platform: Moves = None, duration: float) -> Motion:
    """Speeds [rad/s | m/s] reached in `duration` [s] along u - sin(2 pi u)/(2 pi), then kept.

    Source: Kane, Ryan and Banerjee (1987), the spin-up of a rotating beam.

    Args:
        joints, platform: Speeds by motor or by platform coordinate [rad/s | m/s].
        duration: Until the speed is reached [s].
    """
    moves = keys.moves_of(joints, platform, "spin_up")
    n = keys.options("spin_up", duration=duration)
    return of_moves("spin_up", moves, partial(laws.spin_up, moves[2], n["duration"]), n)


@public
def hold(*, duration: float) -> Motion:
    """Every motor rests at home; duration [s]."""
    n = keys.options("hold", duration=duration)
    law = partial(laws.move, laws.quintic, np.zeros(0), n["duration"])
    return of_moves("hold", ("joints", {}, None), law, n)


@public
def trapezoid(
    *,
    joints: Moves = None,
    platform: Moves = None,
    ramp: float | None = None,
    duration: float | None = None,
    speed: float | None = None,
    velocity: Limit = None,
    acceleration: Limit = None,
) -> Motion:
    """Displacements at constant speed between two ramps [s] of constant acceleration; then rest.

    By its times, or the shortest within limits: of a short way without constant speed. In a YAML
    limits that are not written are those of the URDF; here `robot.limits` has them.

    Args:
        joints, platform: As of `cycloid`.
        ramp: Of each ramp [s]. duration: Of the motion [s]; None: from the speed.
        speed: Of the coordinate that moves furthest [rad/s | m/s], instead of a duration.
        velocity: Limit [rad/s | m/s], of all or {name: limit}, instead of times.
        acceleration: Limit [rad/s^2 | m/s^2], likewise.
    """
    moves = keys.moves_of(joints, platform, "trapezoid")
    if ramp is None and duration is None and speed is None:
        ramp, duration = trapezoid_times(moves[1], velocity, acceleration)
    elif velocity is not None or acceleration is not None:
        why = "times and limits are given. Give ramp with duration or speed, or the limits alone."
        raise keys.bad("trapezoid", why)
    n = keys.options("trapezoid", "ramp duration speed", ramp=ramp, duration=duration, speed=speed)
    if "ramp" not in n:
        raise keys.bad("trapezoid.ramp", "missing. Give it in s, or limits and no times.")
    if len(n) != 2:
        raise keys.bad("trapezoid", "give either duration in s or speed in rad/s or m/s.")
    if "speed" in n:
        n["duration"] = float(np.abs(moves[2]).max()) / n.pop("speed") + n["ramp"]
    ramp, end = n["ramp"], n["duration"]
    if not 0.0 < ramp <= end / 2.0 * (1.0 + SNAP):
        most = end / 2.0 if speed is None else end - ramp
        why = f"two ramps of {ramp:g} s do not fit into {end:g} s"
        raise keys.bad("trapezoid.ramp", f"{why}. Give more than 0 and at most {most:g} s.")
    shape = partial(laws.trapezoid, ramp / end)
    law = partial(laws.move, shape, moves[2], end)
    return of_moves("trapezoid", moves, law, n, (ramp, end - ramp))


@public
def harmonic(
    *,
    joints: Moves = None,
    platform: Moves = None,
    frequency: float,
    phase: float = 0.0,
    smooth: float = 0.0,
    duration: float | None = None,
) -> Motion:
    """Amplitudes by name times sin(2 pi frequency t + phase) - sin(phase), without end.

    Args:
        joints, platform: Amplitudes by motor or by platform coordinate [rad | m].
        frequency: [Hz]. phase: [rad].
        smooth: Length of the quintic fade-in [s].
        duration: End of the run [s]; default one period.
    """
    moves = keys.moves_of(joints, platform, "harmonic")
    given = {"frequency": frequency, "phase": phase}
    n = keys.options("harmonic", "duration", **given, smooth=smooth, duration=duration)
    n.setdefault("duration", n["smooth"] + 1.0 / n["frequency"])
    omega = 2.0 * np.pi * n["frequency"]
    law = partial(laws.harmonic, moves[2], omega, n["phase"], n["smooth"])
    return of_moves("harmonic", moves, law, n, (n["smooth"],))


@public
def circle(
    *,
    center: Sequence[float],
    radius: float,
    omega: float,
    plane: Sequence[str] = ("x", "y"),
    phase: float = 0.0,
    direction: int = 1,
    fixed: Moves = None,
    ramp: float = 0.0,
    duration: float | None = None,
) -> Motion:
    """Platform at center + radius (cos, sin)(phase + direction omega t) in a plane, without end.

    Args:
        center: Of the circle in its plane [m], two numbers.
        radius: [m]. omega: Angular speed [rad/s]. plane: Two of x y z.
        phase: Angle at the start [rad]. direction: 1 or -1. ramp: Start from rest [s].
        fixed: Further platform coordinates that are held [m | rad].
        duration: End of the run [s]; default one turn.
    """
    given = {"radius": radius, "omega": omega, "phase": phase, "ramp": ramp, "duration": duration}
    n = keys.options("circle", "duration", **given)
    if not isinstance(center, (list, tuple, np.ndarray)) or len(center) != 2:
        why = f"{shown(center)} is no point of the plane. Give two numbers [m]."
        raise keys.bad("circle.center", why)
    at = [keys.number(x, f"circle.center[{i}]", "m", "place") for i, x in enumerate(center)]
    axes = keys.names(plane, "platform", "circle.plane")
    if len({*axes} & {"x", "y", "z"}) != 2 or len(axes) != 2:
        raise keys.bad("circle.plane", f"{list(axes)} is no plane. Name two of x, y, z.")
    held = keys.numbers(fixed or {}, "circle.fixed")
    for name in held:
        others = [c for c in PLATFORM_COORDINATES if c not in axes]
        if name not in others:
            what = "it moves on the circle" if name in axes else "no such platform coordinate"
            raise keys.bad(f"circle.fixed.{name}", f"{what}.{nearest(name, others)}")
    if isinstance(direction, bool) or direction not in (1, -1):
        raise keys.bad("circle.direction", f"{shown(direction)} is no direction. Allowed: 1, -1.")
    n.setdefault("duration", 2.0 * np.pi / n["omega"] + 0.5 * n["ramp"])
    z0, rest = n["radius"] * np.exp(1j * n["phase"]), np.array([*at, *held.values()])
    law = partial(laws.circle, rest, z0, direction * n["omega"], n["ramp"])
    spec = {"kind": "circle", "center": at, "plane": list(axes), "direction": direction}
    spec |= {"fixed": held, **n}
    names = (*axes, *held)
    return Motion("circle", "platform", names, n["duration"], law, True, spec, (n["ramp"],))


@public
def sampled(
    file: str | Path | None = None,
    *,
    t: Sequence[float] | Array | None = None,
    joints: Mapping[str, Any] | Sequence[str] | None = None,
    platform: Mapping[str, Any] | Sequence[str] | None = None,
    absolute: bool = True,
    periodic: bool = False,
) -> Motion:
    """Quintic spline through samples (rad | m), at rest at both ends or periodic; needs scipy.

    Args:
        file: CSV with the header t, name, ...
        t: Times [s], shape (n,), without a file.
        joints: Values by motor [rad | m], shape (n,) each; of a file the columns that are taken.
        platform: The same of platform coordinates [m | rad].
        absolute: Positions instead of displacements from home.
        periodic: The motion repeats.
    """
    from scipy.interpolate import make_interp_spline

    target, names, times, y = keys.sampled_data(file, t, joints, platform, absolute, periodic)
    end: Any = [(1, np.zeros(len(names))), (2, np.zeros(len(names)))]  # v = a = 0
    spline = make_interp_spline(times, y, k=5, bc_type="periodic" if periodic else (end, end))
    spec: dict[str, Any] = {"kind": "sampled", "t": times}
    spec |= {target: dict(zip(names, y.T.tolist(), strict=True))}
    spec |= {"absolute": absolute, "periodic": periodic}
    law = partial(laws.spline_law, spline, times[-1], periodic)
    return Motion("sampled", target, names, times[-1], law, absolute, spec)


@public
def formula(
    *,
    joints: Mapping[str, Any] | None = None,
    platform: Mapping[str, Any] | None = None,
    duration: float,
    absolute: bool = False,
) -> Motion:
    """Formulas of the time t [s] by name, such as {slide: "0.3*t^2"} (rad | m), without end.

    With + - * / ^, pi, sin cos tan atan exp log sqrt.

    Args:
        joints, platform: Formulas by motor or by platform coordinate [rad | m].
        duration: End of the run [s].
        absolute: Positions instead of displacements from home.
    """
    if not isinstance(absolute, bool):
        why = f"{shown(absolute)} is not allowed. Allowed: true, false."
        raise keys.bad("formula.absolute", why)
    n = keys.options("formula", duration=duration)
    target, given = keys.target_of(joints, platform, "formula")
    if not isinstance(given, Mapping):
        raise keys.bad(
            f"formula.{target}", f'{shown(given)} is no mapping. Write {{name: "0.3*t^2"}}.'
        )
    names = keys.names(given, target, f"formula.{target}")
    texts = {name: str(text) for name, text in given.items()}
    trees = []
    for name, text in texts.items():
        where = f"formula.{target}.{name}"
        trees.append(laws.parse(text, where))
        values = laws.evaluate(trees[-1], np.linspace(0.0, n["duration"], 101))
        if not np.all(np.isfinite(values)):
            raise keys.bad(
                where,
                f"{shown(text)} or its rates are not finite from 0 to {n['duration']:g} s. Write "
                "one that is smooth.",
            )
    law = partial(_formula_law, tuple(trees))
    spec = {"kind": "formula", target: texts, "absolute": absolute, **n}
    return Motion("formula", target, names, n["duration"], law, absolute, spec)


def _formula_law(trees: tuple[ast.expr, ...], t: Array) -> Kinematics:
    jets = [laws.evaluate(tree, t) for tree in trees]
    p, v, a = np.stack(jets, axis=2)
    return p, v, a


KINDS: dict[str, Callable[..., Motion]] = {
    make.__name__: make
    for make in (
        *(cycloid, quintic, hold, paths.moves, paths.adept, nonic, spin_up, formula, scurve),
        *(ruckig, trapezoid, harmonic, circle, sampled, trajectory),
    )
}


def form() -> schema.Form:
    """JSON Schema of the block `motion`."""
    forms = []
    for kind, make in KINDS.items():
        arguments = inspect.signature(make).parameters.items()
        table = {"kind": schema.bare({"const": kind}, required=True)} | {
            key: schema.bare({}, required=one.default is one.empty) for key, one in arguments
        }
        forms.append(schema.block_form(table | {"shaper": schema.bare(paths.shaper_form)}))
    return {"anyOf": forms}


def from_spec(spec: Any, where: str, folder: str | Path | None = None) -> Motion:
    """The motion of a YAML mapping {kind: ..., keyword arguments of its constructor, shaper}.

    A shaper without frequencies, which only the mechanism knows, is left to
    `levels.modes.default_motion`.
    """
    if not isinstance(spec, Mapping):
        raise keys.bad(
            where, f"{shown(spec)} is no mapping. Write {{kind: cycloid, joints: {{...}}, ...}}."
        )
    kind, given = spec.get("kind"), {str(k): x for k, x in spec.items() if k != "kind"}
    asked = paths.read(given.pop("shaper", None), f"{where}.shaper")
    if not isinstance(kind, str) or kind not in KINDS:
        raise keys.bad(f"{where}.kind", f"{shown(kind)} is no motion.{nearest(str(kind), KINDS)}")
    _require_keys(given, kind, where)
    if isinstance(given.get("file"), str):
        given["file"] = Path(folder or ".") / given["file"]
    try:
        made = KINDS[kind](**given)
    except DescriptionError as error:  # a constructor starts its key paths with the kind
        raise DescriptionError(where + str(error).removeprefix(kind), where=where) from None
    if asked is None or not asked.frequencies:
        return made
    return made.shaped(asked.kind, asked.frequencies, asked.damping)


def _require_keys(given: Mapping[str, Any], kind: str, where: str) -> None:
    """Keys are the arguments of the kind's constructor, and those without a default are there."""
    known = inspect.signature(KINDS[kind]).parameters
    needed = [key for key, p in known.items() if p.default is p.empty]
    for key in (*given, *needed):
        if key not in known:
            raise keys.bad(
                f"{where}.{key}", f"no such key of a {kind} motion.{nearest(key, known)}"
            )
        if key not in given:
            raise keys.bad(f"{where}.{key}", f"missing. A {kind} motion needs {', '.join(needed)}.")


# The block `motion` of a YAML file, checked against the robot that it moves.


def without_units(motion: object, types: Mapping[str, str]) -> object:
    """A motion whose displacements have no units: "3 deg" is a number of rad."""
    if not isinstance(motion, dict) or motion.get("kind") == "spin_up":  # those are speeds
        return motion
    found = dict(motion)
    kinds = {"platform": dict.fromkeys("xyz", "prismatic"), "joints": types}
    for target, of in kinds.items():
        if isinstance(found.get(target), dict):
            found[target] = {
                name: schema.measured(value, schema.quantity(of.get(name, "")))
                for name, value in found[target].items()
            }
    return found


def read(
    value: object,
    where: str,
    folder: Path,
    actuated: tuple[str, ...],
    has_platform: bool,
    urdf_text: str,
) -> dict[str, Any]:
    """The checked block, for `from_spec`, with the limits that only the URDF writes."""
    block = copy.deepcopy(schema.mapping(value, where))
    if isinstance(block.get("file"), str):
        block["file"] = str(folder.resolve() / block["file"])  # found from any folder
    _fill_limits(block, where, urdf_text)
    checked = from_spec(block, where)
    if checked.target == "platform" and not has_platform:
        raise DescriptionError(
            f"{where}: moves the platform, but the description names none. Add `platform: FRAME`."
        )
    if checked.target == "joints":
        place = schema.at(where, "joints")
        for name in checked.names:
            schema.known(name, place, actuated, "joint with a motor")
    return block


def _fill_limits(block: dict[str, Any], where: str, urdf_text: str) -> None:
    """Put limits of the URDF under those that a profile of joints by limits leaves out."""
    moves, times = block.get("joints"), {"ramp", "duration", "speed"}
    quantities = profiles.KINDS.get(str(block.get("kind")), ())
    if not isinstance(moves, dict) or (block.get("kind") == "trapezoid" and times & set(block)):
        return
    for quantity in quantities:
        own = block.get(quantity)
        if own is not None and not isinstance(own, dict):
            continue
        known = getattr(urdf.motor_limits(urdf_text, moves), quantity)
        block[quantity] = known | (own or {})
        for name in moves:
            if block[quantity].get(name) is None:
                raise DescriptionError(
                    f"{where}.{quantity}: {name} has no {quantity} limit here, and none in the "
                    f"URDF. Write {quantity}: {{{name}: ...}} in {profiles.UNITS[quantity]}.",
                    where=f"{where}.{quantity}",
                )
