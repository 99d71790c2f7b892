"""Outputs of a scene by name, for derivatives, limits and fits.

Peaks are over motors, links and time.

- frequency.1 ...: natural frequencies at home, motors locked [Hz]
- mass: of all moving links [kg]
- sag: of the platform under gravity and loads, motors locked [m]
- stiffness.AXIS: 1/C of the platform along x, y, z [N/m], rx, ry, rz [N m/rad]
- deviation.peak: of the platform from the rigid run [m]; deviation.rotation [rad]
- torque.peak, torque.rms: largest of any motor; torque.peak.MOTOR of one [N m | N]
- stress.peak: von Mises [Pa]; stress.yield: share of the strength [-]
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from pinflex.description.description import Description
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.pose_map import AXES, free_stiffness
from pinflex.results.quantities import joint_unit
from pinflex.results.result import Result
from pinflex.studies.checking.parts import statics
from pinflex.studies.outputs import prismatic, scene_outputs
from pinflex.studies.pose import platform_compliance
from pinflex.variation.peaks import over_time

RUNS = ("deviation", "torque", "stress")
AT = " at "  # between a peak's name and the number of a sample
_SHORT = {"deviation.peak": "deviation.position"}
_FREQUENCIES = 12
DEFAULT = ("frequency.1", "mass", "sag", "deviation.peak", "torque.peak", "stress.peak")


def is_peak(name: str) -> bool:
    """Whether an output is the largest value of a run over time."""
    return of_a_run(name) and not name.startswith("torque.rms")


def of_a_run(name: str) -> bool:
    """Whether an output is one of a run, not of a pose."""
    return name.partition(".")[0] in RUNS


def units(names: Iterable[str], description: Description) -> dict[str, str]:
    """Units of outputs by name, as in the head of this file; "" where there is none."""
    slides = prismatic(description)
    each = {motor: joint_unit("torque", motor in slides) for motor in description.actuated}
    return {name: _unit(name, each) for name in names}


def _unit(name: str, motors: Mapping[str, str]) -> str:
    head, _, rest = name.partition(".")
    if head == "torque":  # of one motor, or the largest of all
        motor = rest.partition(".")[2]
        return motors[motor] if motor in motors else " | ".join(dict.fromkeys(motors.values()))
    if head == "stiffness":
        return "N m/rad" if rest.startswith("r") else "N/m"
    if name == "deviation.rotation":
        return "rad"
    units = {"frequency": "Hz", "mass": "kg", "sag": "m", "deviation": "m", "stress": "Pa"}
    return "" if name == "stress.yield" else units[head]


def check_names(names: Iterable[str], mechanism: Mechanism) -> tuple[str, ...]:
    """The names, if each is an output.

    Raises:
        DescriptionError: Another name, with the nearest.
    """
    allowed = [
        *(f"frequency.{k}" for k in range(1, _FREQUENCIES + 1)), "mass", "sag",
        *(f"stiffness.{axis}" for axis in AXES), "deviation.peak", "deviation.position",
        "deviation.rotation", "torque.peak", "torque.rms",
        *(f"torque.{kind}.{motor}" for kind in ("peak", "rms") for motor in mechanism.motors),
        "stress.peak", "stress.yield",
    ]  # fmt: skip
    found = tuple(names)
    for name in found:
        if name not in allowed:
            raise DescriptionError(f"output {name}: no such output.{nearest(name, allowed)}")
    if not found:
        raise DescriptionError(f"outputs: none. Give some of {', '.join(DEFAULT)}.")
    return found


def measure(
    mechanism: Mechanism,
    names: Iterable[str],
    level: str | None = None,
    rigid: Result | None = None,
    every: Iterable[str] = (),
) -> dict[str, float]:
    """The outputs of a scene.

    Returns:
        By name, SI units.

    Raises:
        DescriptionError: An output that the scene does not have, such as a sag without a platform.
    """
    wanted = check_names(names, mechanism)
    found = available(mechanism, wanted, level, rigid, every)
    missing = [name for name in wanted if name not in found]
    if missing:
        raise DescriptionError(
            f"{mechanism.name}: output {missing[0]}: the scene has none. It has "
            f"{', '.join(sorted(found)) or 'none of those asked'}."
        )
    return found


def available(
    mechanism: Mechanism,
    names: Iterable[str],
    level: str | None = None,
    rigid: Result | None = None,
    every: Iterable[str] = (),
) -> dict[str, float]:
    """Those of the outputs that a scene has, as `measure`."""

    def samples(run: Result, reference: Result | None) -> dict[str, float]:
        each = {name: over_time(name, mechanism, run, reference) for name in every}
        return {f"{name}{AT}{k}": x for name, c in each.items() for k, x in enumerate(c.tolist())}

    wanted = tuple(names)
    heads = {name.partition(".")[0] for name in wanted}
    found: dict[str, float] = {}
    for head, values in _OF_HOME.items():
        if head in heads:
            found |= values(mechanism)
    groups = [group for group in ("frequency", *RUNS) if group in heads]
    if mechanism.description.motion is None and mechanism.description.solve.until is None:
        groups = [group for group in groups if group not in RUNS]
    if groups:
        found |= _numbers(scene_outputs(mechanism, level, groups, rigid, samples))
    found |= {short: found[full] for short, full in _SHORT.items() if full in found}
    found |= _of_all_motors(found)
    told = {name: x for name, x in found.items() if AT in name}
    return {name: found[name] for name in wanted if name in found} | told


def _of_all_motors(found: Mapping[str, float]) -> dict[str, float]:
    """Largest torque of any motor, by kind."""
    each = {
        kind: [value for name, value in found.items() if name.startswith(f"{kind}.")]
        for kind in ("torque.peak", "torque.rms")
    }
    return {kind: max(values) for kind, values in each.items() if values}


def _mass(mechanism: Mechanism) -> dict[str, float]:
    bodies = mechanism.flexible.expansion.model.inertias
    return {"mass": float(sum(body.mass for body in bodies))}


def _stiffness(mechanism: Mechanism) -> dict[str, float]:
    values = free_stiffness(platform_compliance(mechanism))
    return {f"stiffness.{axis}": float(k) for axis, k in zip(AXES, values, strict=True)}


def _sag(mechanism: Mechanism) -> dict[str, float]:
    found = statics(mechanism)
    return {} if found.full is None else {"sag": float(np.linalg.norm(found.full.position))}


# Outputs that need neither modes nor a run.
_OF_HOME = {"mass": _mass, "sag": _sag, "stiffness": _stiffness}


def _numbers(values: Mapping[str, object]) -> dict[str, float]:
    return {
        name: float(value)
        for name, value in values.items()
        if isinstance(value, (int, float)) and not isinstance(value, bool)
    }
