"""Meta of a result: names, units, settings, cost, warnings, sources, versions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description.blocks.joints import SPEED, Drive, JointExtra
from pinflex.integrators.problem import Run
from pinflex.mechanics.evaluation.compiled import evaluated_by
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.system import System
from pinflex.mechanics.model.tree import sliding
from pinflex.recovery import validity
from pinflex.results.drawing import urdf_parts
from pinflex.results.quantities import KEYS, SLIDING, joint_unit
from pinflex.text import percent, plural

# What the motors behind their gears do: torque, speed and power on both sides of each drive.
#
# With q the motor angle over the gear ratio n, eta the gear's deflection, tau the torque of the
# equations in q, I the inertia of rotor and gear at the joint and F friction and damper:
#
#     joint side   speed q' + eta',   torque  T = tau - I q'' - F(q')
#     motor side   speed n q',        torque  (I q'' + F + T c(T q')) / n
#
# T is what the gear gives out, -(K eta + D eta') of an elastic one. A gear of efficiency e takes c
# = 1/e times as much where the motor drives and c = e times where it is driven; the change between
# the two is smooth in the speed, as friction is, and c = 1 at rest.


def drives(mechanism: Mechanism, run: Run) -> dict[str, Array]:
    """Arrays of a Result by flat key, drive/JOINT/...; empty where no joint has a drive."""
    out: dict[str, Array] = {}
    for name, extra in mechanism.description.joints.items():
        if extra.drive is not None:
            out |= {f"drive/{name}/{k}": x for k, x in _of(mechanism, run, name, extra).items()}
    return out


def _of(mechanism: Mechanism, run: Run, name: str, extra: JointExtra) -> dict[str, Array]:
    n = (extra.drive or Drive()).gear
    model, system = mechanism.rigid.rigid, run.system
    joint = model.joints[model.getJointId(name)]
    row, motor = int(joint.idx_v), mechanism.motors.index(name)
    q, v, a = _angle(run.y, int(joint.idx_q), int(joint.nq)), run.v[:, row], run.a[:, row]
    needed, given, _ = motor_side(system, row, extra, run.torque[:, motor], v, a)
    deflection, rate = np.zeros_like(v), np.zeros_like(v)
    for gear in system.expansion.drives:
        if gear.joint == name:
            deflection = run.y[:, int(system.rigid.nq) + gear.eta]
            rate = run.v[:, int(system.rigid.nv) + gear.eta]
    torque = needed / n
    return {
        "motor_position": n * q, "motor_speed": n * v, "motor_torque": torque,
        "motor_power": torque * n * v, "position": q + deflection, "speed": v + rate,
        "torque": given, "power": given * (v + rate), "deflection": deflection,
    }  # fmt: skip


def motor_side(
    system: System, row: int, extra: JointExtra, torque: Array, v: Array, a: Array
) -> tuple[Array, Array, Array]:
    """Motor torque times the ratio, what the gear gives out, and c, of a torque in a joint's row.

    All (nt,), as are the joint's speed and acceleration.
    """
    speeds, lost = np.zeros((len(v), len(system.D))), np.zeros((len(v), len(system.D)))
    speeds[:, row] = v
    lost[:, system.friction.rows] = system.friction.force(speeds)
    inner = extra.armature * a + lost[:, row] + system.D[row, row] * v
    given = torque - inner
    gain = _gain(extra.drive or Drive(), extra, given, v)
    return np.asarray(inner + given * gain), given, gain


def _gain(drive: Drive, extra: JointExtra, given: Array, v: Array) -> Array:
    """Torque into the gear over torque out of it, times the ratio."""
    smooth = SPEED if extra.friction is None else extra.friction.speed
    way = np.tanh(v / smooth) * np.sign(given)
    e = drive.efficiency
    return np.asarray(1.0 + np.where(way > 0, way * (1.0 / e - 1.0), way * (1.0 - e)))


def _angle(y: Array, at: int, size: int) -> Array:
    """Position of a joint of one freedom [rad | m], continuous over turns."""
    return y[:, at] if size == 1 else np.unwrap(np.arctan2(y[:, at + 1], y[:, at]))


def describe_drives(mechanism: Mechanism) -> dict[str, Any]:
    """The drives for the meta of a result."""
    found: dict[str, Any] = {}
    for name, extra in mechanism.description.joints.items():
        drive = extra.drive
        if drive is not None:
            found[name] = {
                "gear": drive.gear,
                "efficiency": drive.efficiency,
                "stiffness": drive.stiffness,
                "limit_curve": [list(point) for point in drive.limit_curve],
            }
    return found


# Stick and slip: what the Stribeck speed of a joint's friction leaves of it.
#
# A joint breaks away where the load meets the top of its friction, and is late there by a time that
# goes with the cube root of (stribeck^2 / rate of the load): its swings and periods are off by
#
#     0.6 (stribeck / fastest slip)^(2/3)
#
# 0.6 by masses on belts (tests/verification/test_stick_slip.py), over sixteen of which it is 0.5 to
# 2.6 times the true error.

_SHARE = 0.6
_TELL = 0.01  # errors below are not worth a sentence
_ASK = 0.003  # error of the Stribeck speed that is proposed


def sticking(mechanism: Mechanism, run: Run) -> list[str]:
    """Sentences on joints that stick and slip, where friction changes too slowly with speed."""
    system, rubs = run.system, run.system.friction
    pushed = run.settings.get("drive") == "torque"
    if not np.any(rubs.excess) or (
        not pushed and mechanism.report.mobility <= len(system.motors)
    ):  # a joint whose speed the motors determine does not choose to stick
        return []
    moving, texts = (system.unheld if pushed else system.free), []
    for row, excess, stribeck in zip(rubs.rows, rubs.excess, rubs.stribeck, strict=True):
        speed = np.abs(run.v[:, row])
        fastest = float(np.max(speed, initial=0.0))
        if not excess or row not in moving or fastest <= stribeck:
            continue
        slow = speed < stribeck
        leaves = slow[:-2] & slow[1:-1] & ~slow[2:]
        error = _SHARE * (stribeck / fastest) ** (2 / 3)
        if not np.any(leaves) or error < _TELL:
            continue
        ask = float(f"{fastest * (_ASK / _SHARE) ** 1.5:.1g}")
        texts.append(
            f"{mechanism.coordinates[row]}: it sticks and slips, at {fastest:.2g} at the most, and "
            f"its friction falls from breakaway to sliding over stribeck = {stribeck:g}: swings "
            f"and periods are off by about {percent(error)} for it. Unless that speed was "
            f"measured, write friction: {{stribeck: {ask:g}, speed: {ask:g}, ...}} there "
            "(smaller ones cost steps)."
        )
    return texts


_LAID_OUT = {  # by number of coordinates, as Pinocchio has them
    2: "cos, sin",
    4: "qx, qy, qz, qw",
    7: "m, m, m, qx, qy, qz, qw",
}
_DRIVE = {of.key.partition("/NAME/")[2]: of.unit for of in KEYS if of.key.startswith("drive/")}
ASSESSED = ("energy_balance", "grades", "warnings", "limits", "monitors")  # keys of `assess`


@cache
def version() -> str:
    """Installed version of pinflex, or "0+checkout"."""
    from importlib import metadata  # slow to import: of a run that is kept, or --version

    try:
        return metadata.version("pinflex")
    except metadata.PackageNotFoundError:
        return "0+checkout"


def describe(
    mechanism: Mechanism,
    run: Run,
    level: str,
    cost: dict[str, float],
    stopped: str,
) -> dict[str, Callable[[], Any]]:
    """Functions that find the meta of a Result, key by key, but for what `assess` says."""
    description, model = mechanism.description, mechanism.rigid.rigid
    return {
        "name": lambda: mechanism.name,
        "level": lambda: level,
        "status": lambda: "stopped" if stopped else "complete",
        "message": lambda: stopped,
        "joints": lambda: list(model.names)[1:],
        "joint_index": lambda: _joint_index(model),
        "coordinates": lambda: list(mechanism.coordinates),
        "actuated": lambda: list(mechanism.motors),
        "frames": lambda: list(description.reported),
        "platform": lambda: description.platform,
        "loops": lambda: _loops(mechanism, run),
        "links": lambda: _links(mechanism) if run.system.n_eta else {},
        "drives": lambda: describe_drives(mechanism),
        "bodies": lambda: _bodies(mechanism),
        "gravity": lambda: list(description.gravity),
        "settings": lambda: _settings(run),
        "resume": lambda: None if run.s is None else run.s[-1].tolist(),
        "cost": lambda: {k: int(v) if float(v).is_integer() else float(v) for k, v in cost.items()},
        "units": lambda: _units(mechanism),
        "evaluated_by": lambda: evaluated_by(run.system, _marched(run, level)),
        "versions": _versions,
        "drawing": lambda: urdf_parts(description.urdf_text),
        "sources": lambda: dict(description.sources),
    }


def _marched(run: Run, level: str) -> bool:
    """Whether the full equations were marched in time: level coupled, or rigid under torques."""
    return level == "coupled" or (level == "rigid" and "integrator" in run.settings)


def _versions() -> dict[str, str]:
    return {"pinflex": version(), "pinocchio": pin.__version__, "numpy": np.__version__}


def assess(
    mechanism: Mechanism, run: Run, arrays: Mapping[str, Array], spins: Mapping[int, Array]
) -> dict[str, Any]:
    """The rest of the meta mapping: how far a run can be trusted, from all of its arrays."""
    monitors = validity.monitors(mechanism, run, arrays, spins)
    limits = validity.warnings(mechanism, run, monitors)
    balance = _energy_balance(arrays)
    graded = validity.grades(run, arrays, balance)
    poor = validity.sentences(run, arrays, balance, graded)
    return {
        "energy_balance": balance,
        "grades": graded,
        "warnings": [
            *run.warnings,
            *run.loop(),
            *poor,
            *_redundant(mechanism, run),
            *_held(mechanism, run),
            *sticking(mechanism, run),
            *validity.beyond_joint_limits(mechanism, run),
            *limits,
        ],
        "limits": limits,
        "monitors": {name: asdict(found) for name, found in monitors.items()},
    }


def _settings(run: Run) -> dict[str, Any]:
    """What the level used, with the estimated errors of forces where there are some."""
    settings = dict(run.settings)
    known = settings.get("error")
    if run.judged is not None and isinstance(known, Mapping) and known:
        settings["error"] = {**known, **run.judged()}
    return settings


def _joint_index(model: pin.Model) -> dict[str, list[int]]:
    return {
        name: [joint.idx_q, joint.nq, joint.idx_v, joint.nv]
        for name, joint in zip(model.names[1:], model.joints[1:], strict=True)
    }


def _loops(mechanism: Mechanism, run: Run) -> list[dict[str, Any]]:
    closed = run.system.closed
    flexible = run.system is not mechanism.rigid
    report = mechanism.flexible_report if flexible else mechanism.report
    between = {p.name: [p.frame_a, p.frame_b] for p in mechanism.description.loops}
    between |= {p.name: [p.frame_a, p.frame_b] for p in mechanism.idle.spins}
    return [
        {
            "name": name,
            "kind": kind,
            "between": between[name],
            "rows": [r for r, k in zip(closed.labels, closed.loop_of, strict=True) if k == number],
            "redundant": [r for r in report.redundant if r.startswith(f"{name}: ")],
        }
        for number, (name, kind) in enumerate(zip(closed.names, closed.kinds, strict=True))
        if kind != "coupling"
    ]


def _links(mechanism: Mechanism) -> dict[str, Any]:
    links = {}
    for name, part in mechanism.parts.items():
        section, material = part.spec.section, part.spec.material
        body = part.bodies[0]
        links[name] = {
            "length": part.length,
            "mass": part.mass,
            "section": {one.name: getattr(section, one.name) for one in fields(section)},
            "material": {
                key: getattr(material, key) for key in ("name", "E", "G", "rho", "yield_strength")
            },
            "frame": [[float(x) for x in row] for row in part.placement.rotation],
            "origin": [float(x) for x in part.placement.translation],
            "planes": list(part.planes),
            "reason": part.reason,
            "basis": f"{part.spec.basis.kind}, {body.n} coordinates x {len(part.bodies)}",
        }
    return links


def _bodies(mechanism: Mechanism) -> dict[str, Any]:
    """Skeleton of every rigid link: its own joint and where other links hang, in its frame."""
    bodies: dict[str, Any] = {}
    for number, link in enumerate(mechanism.links):
        if link.name in mechanism.parts:
            continue
        points = [[0.0, 0.0, 0.0]] if link.parent >= 0 else []
        points += [
            [float(x) for x in child.placement.translation]
            for child in mechanism.links
            if child.parent == number
        ]
        bodies[link.name] = {"points": points, "mass": float(link.inertia.mass)}
    size = max(
        (float(np.max(np.abs(b["points"]))) for b in bodies.values() if b["points"]), default=0.1
    )
    size = max([size, *(part.length for part in mechanism.parts.values())])
    for body in bodies.values():
        body["radius"] = 0.02 * size
    return bodies


def _energy_balance(arrays: Mapping[str, Array]) -> float:
    """Largest |E - E0 - work + dissipated| over the largest energy in play.

    Work is that of the motors, and of loads without a potential where there are some.
    """
    stored = sum(arrays[f"energy/{k}"] for k in ("kinetic", "gravity", "elastic", "spring"))
    flow = arrays["energy/work"] - arrays["energy/dissipated"]
    parts = [np.ptp(arrays[f"energy/{k}"]) for k in ("kinetic", "gravity", "elastic", "work")]
    if "energy/loads" in arrays:
        flow = flow + arrays["energy/loads"]
        parts.append(np.ptp(arrays["energy/loads"]))
    drift = np.abs(np.asarray(stored) - np.asarray(stored)[0] - (flow - flow[0]))
    # Below 1e-15 J, and far below the energies themselves, there is only the rounding of a run that
    # does not move: an energy of 40 J is known to 7e-15 J.
    rounding = 1e-12 * float(np.max(np.abs(np.asarray(stored)), initial=0.0))
    # Links that are pressed all the time work on the round-off of places: 1e-12 of what they hold.
    pressed = 1e-9 * float(np.min(arrays["energy/elastic"]))
    scale = max([float(p) for p in parts] + [1e-15, rounding, pressed])
    return float(np.max(drift, initial=0.0)) / scale


def _redundant(mechanism: Mechanism, run: Run) -> list[str]:
    report = mechanism.report if run.system is mechanism.rigid else mechanism.flexible_report
    said = list(filter(None, [report.built_in]))
    if not report.redundant:
        return said
    return [
        *said,
        f"{plural(len(report.redundant), 'redundant closure row')} left out "
        f"({', '.join(report.redundant[:4])}{', ...' if len(report.redundant) > 4 else ''}): "
        "the motion is exact, reactions in these directions are not unique.",
    ]


def _held(mechanism: Mechanism, run: Run) -> list[str]:
    if not len(mechanism.idle.base) or not np.isin(mechanism.idle.base[0], run.system.held):
        return []
    return ["the free base is held where home has it: only level coupled lets it go."]


def _units(mechanism: Mechanism) -> dict[str, str]:
    units = {"t": "s"}
    for name, extra in mechanism.description.joints.items():
        if extra.drive is not None:
            units |= {f"drive/{name}/{key}": unit for key, unit in _DRIVE.items()}
    model, slides = mechanism.rigid.rigid, sliding(mechanism.rigid.rigid)
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        if joint.nq > joint.nv:  # on a circle or a sphere: no rad among its coordinates
            flat = joint.shortname() == "JointModelPlanar"
            units[f"joint/q/{name}"] = "m, m, cos, sin" if flat else _LAID_OUT[joint.nq]
        if name in slides:
            keys = ("torque", "joint/q", "joint/v", "joint/a")
            units |= {f"{key}/{name}": joint_unit(key, True) for key in keys}
            units |= {
                f"drive/{name}/{key}": SLIDING[unit]
                for key, unit in _DRIVE.items()
                if unit in SLIDING and not key.startswith("motor_")
            }
    return units
