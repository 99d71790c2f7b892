"""Parts of a URDF that pinflex does not use, and its limits that the model exceeds."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from pinflex.actuation.motors import motor_axes
from pinflex.description.description import Description
from pinflex.description.urdf import Limits, limits
from pinflex.mechanics.mechanism import Mechanism

_SOME = 6  # names listed before "..."


def ignored(description: Description) -> list[str]:
    """Sentences on joint damping, friction and mimic tags of the URDF that have no effect."""
    root = ET.fromstring(description.urdf_text.strip())
    damped, rubbing, mimicking = [], [], []
    names = {joint.get("name", "") for joint in root.findall("joint")}
    for joint in root.findall("joint"):
        name, dynamics = joint.get("name", ""), joint.find("dynamics")
        if dynamics is not None:
            extra = description.joints.get(name)
            if _value(dynamics, "damping") and not (extra is not None and extra.damper):
                damped.append(name)
            if _value(dynamics, "friction"):
                rubbing.append(name)
        mimic = joint.find("mimic")
        if mimic is not None and (mimic.get("joint") or "").strip() not in names:
            mimicking.append(name)
    found = []
    if damped:
        found.append(
            f"damping in the URDF is not used ({_list(damped)}): write joints.NAME.damper in the "
            "YAML if it matters."
        )
    if rubbing:
        found.append(
            f"friction in the URDF is not used ({_list(rubbing)}): there is no dry friction."
        )
    if mimicking:
        found.append(
            f"mimic in the URDF names joints that are not there ({_list(mimicking)}): these joints "
            "move by themselves. Write joints.NAME.follows in the YAML if they should not."
        )
    return found


def beyond_limits(
    description: Description, mechanism: Mechanism, holding: tuple[float, ...] | None
) -> list[str]:
    """Motors whose home position or holding torque is beyond the URDF's limits."""
    known = limits(description.urdf_text)
    at_home = motor_axes(mechanism).read(mechanism.home)
    found = []
    for k, name in enumerate(description.actuated):
        limit = known.get(name, Limits())
        lower, upper = limit.lower, limit.upper
        if lower < upper and not lower - 1e-9 <= at_home[k] <= upper + 1e-9:
            at = f"{at_home[k]:.4g}"
            found.append(f"{name}: home {at} is outside the URDF's limits {lower:g} to {upper:g}.")
        effort = limit.effort
        if holding is not None and 0 < effort < abs(holding[k]):
            found.append(
                f"{name}: holding needs {abs(holding[k]):.4g}, more than the URDF's effort limit "
                f"{effort:g}."
            )
    return found


def _value(element: ET.Element, key: str) -> float:
    try:
        return float(element.get(key, "0"))
    except ValueError:
        return 0.0


def _list(names: list[str]) -> str:
    return ", ".join(names[:_SOME]) + (", ..." if len(names) > _SOME else "")
