"""What a model takes of a URDF's dynamics, what it does not, and limits that it exceeds."""

from __future__ import annotations

from pinflex.actuation.motors import motor_axes
from pinflex.description.description import Description
from pinflex.description.source import Source
from pinflex.description.urdf import Limits, limits
from pinflex.mechanics.mechanism import Mechanism

_SOME = 6  # names listed before "..."


def ignored(description: Description) -> list[str]:
    """Sentences on what the URDF says of joints and transmissions and has no effect."""
    tree = description.tree()
    geared = [
        f"{name} {joint.reduction:g}"
        for name, joint in tree.joints.items()
        if abs(joint.reduction or 1.0) != 1.0 and not _driven(description, name)
    ]
    leaders = {name: joint.mimic[0] for name, joint in tree.joints.items() if joint.mimic}
    notes = {
        **_unused_rubbing(tree, description.use_urdf_dynamics),
        "gear ratios of the URDF's transmissions are not used ({}): they count where "
        "joints.NAME.drive says what the motor is.": geared,
        "mimic in the URDF names joints that are not there ({}): these joints move by themselves. "
        "Write joints.NAME.follows in the YAML if they should not.": [
            name for name, leader in leaders.items() if leader not in tree.joints
        ],
    }
    return [text.format(_list(names)) for text, names in notes.items() if names]


def _unused_rubbing(tree: Source, dynamics: bool) -> dict[str, list[str]]:
    """Sentences on damping and friction without effect, with the joints that they are about."""
    moving = {key: _moving(tree, key) for key in ("damping", "friction")}
    if not dynamics:
        text = "{} in the URDF is not used ({{}}): use_urdf_dynamics is false."
        return {text.format(key): names for key, names in moving.items()}
    several = [
        name
        for names in moving.values()
        for name in names
        if tree.joints[name].type in ("floating", "planar")
    ]
    text = "damping and friction in the URDF are not used in joints of several freedoms ({})."
    return {text: several}


def used(description: Description) -> str:
    """Joints whose damping and friction are the URDF's, in words; "" for none."""
    if not description.use_urdf_dynamics:
        return ""
    tree = description.tree()
    parts = []
    for key in ("damping", "friction"):
        names = [name for name in _moving(tree, key) if _as_written(description, tree, name, key)]
        if names:
            parts.append(f"{key} of the URDF ({_list(names)})")
    if not parts:
        return ""
    return f"{' and '.join(parts)}; `use_urdf_dynamics: false` leaves them out"


def _moving(tree: Source, key: str) -> list[str]:
    """Joints with damping or friction of one freedom or more."""
    moving = (joint for joint in tree.joints.values() if joint.type != "fixed")
    return [joint.name for joint in moving if getattr(joint, key)]


def _as_written(description: Description, tree: Source, name: str, key: str) -> bool:
    """Whether a joint has what the URDF says of it, and not what the YAML says."""
    extra = description.joints.get(name)
    if extra is None:
        return False
    rubs = 0.0 if extra.friction is None else extra.friction.coulomb
    return bool((extra.damper if key == "damping" else rubs) == getattr(tree.joints[name], key))


def _driven(description: Description, name: str) -> bool:
    extra = description.joints.get(name)
    return extra is not None and extra.drive is not None


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


def _list(names: list[str]) -> str:
    return ", ".join(names[:_SOME]) + (", ..." if len(names) > _SOME else "")
