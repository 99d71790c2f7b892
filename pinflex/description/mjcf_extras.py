"""What an MJCF says beyond a tree: springs, motors, equalities; and what is left out, by line."""

from __future__ import annotations

from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.mjcf import JointData, Robot, base_pose
from pinflex.description.mjcf_values import quaternion
from pinflex.description.tree_text import pose
from pinflex.description.xml_lines import Element, known, numbers, unused

_ONE = ("hinge", "slide")
_CONTROL = ("kp", "kv", "gainprm", "biasprm", "dyntype", "dynprm", "timeconst")
# Sections that say nothing about the mechanism itself.
_QUIET = ("compiler", "default", "worldbody", "asset", "equality", "actuator", "visual",
          "statistic", "size", "custom", "option", "tendon")  # fmt: skip


def joints(robot: Robot) -> None:
    """Springs, dampers and rotor inertias; positions at which the file draws its joints."""
    for name, data in robot.joints.items():
        extra: dict[str, Any] = {"type": "spherical"} if data.type == "ball" else {}
        for key, ours, of in (
            ("armature", "rotor_inertia", "inertia"), ("damping", "damper", "damping"),
        ):  # fmt: skip
            value = _first(robot, data, key, of)
            if value and data.type != "free":
                extra[ours] = value
        extra |= _spring(robot, name, data)
        if _first(robot, data, "frictionloss", "moment"):
            robot.note(
                data.element, f"frictionloss {data.given['frictionloss']} of {name} is not taken "
                "over."
            )  # fmt: skip
        if extra:
            robot.blocks.setdefault("joints", {})[name] = extra
        if data.ref or extra.get("rest", 0.0):  # an elastic joint would start at its rest
            robot.blocks.setdefault("home", {})[name] = data.ref


def _first(robot: Robot, data: JointData, key: str, of: str) -> float:
    """A number of a joint; of a polynomial its first coefficient."""
    if key not in data.given:
        return 0.0
    values = numbers(data.given[key], data.element, key, of=of)
    if len(values) > 1 and np.any(values[1:]):
        robot.note(data.element, f"{key} {data.given[key]}: only its first number is taken over.")
    return float(values[0]) if len(values) else 0.0


def _spring(robot: Robot, name: str, data: JointData) -> dict[str, Any]:
    stiffness = _first(robot, data, "stiffness", "stiffness")
    if not stiffness:
        return {}
    if data.type not in _ONE:
        robot.note(data.element, f"stiffness {stiffness:g} of {name} ({data.type}) is not taken "
                   "over: a spring needs a joint of one freedom.")  # fmt: skip
        return {}
    rest = float(numbers(data.given.get("springref", "0"), data.element, "springref", 1)[0])
    rest = float(robot.values.angle(rest)) if data.type == "hinge" else rest
    return {"spring": stiffness} | ({"rest": rest} if rest or data.ref else {})


# Motors --------------------------------------------------------------------------------------


def motors(robot: Robot) -> None:
    """Joints that actuators drive; a spring there acts beside the motor."""
    tendons = {
        t.get("name", ""): t
        for section in robot.values.root.all("tendon")
        for t in section.all("fixed")
    }
    driven: list[str] = []
    for section in robot.values.root.all("actuator"):
        for actuator in section.all():
            name = _driven(robot, actuator, tendons)
            if name is not None and name not in driven:
                driven.append(name)
    robot.blocks["actuated"] = driven
    for name in driven:
        extra = robot.blocks.get("joints", {}).get(name, {})
        if "spring" in extra:
            extra["parallel_spring"] = extra.pop("spring")


def _driven(robot: Robot, actuator: Element, tendons: dict[str, Element]) -> str | None:
    """The joint of an actuator."""
    given = robot.values.of(actuator, "main")
    label = given.get("name", actuator.tag)
    name = given.get("joint") or given.get("jointinparent") or ""
    tendon = tendons.get(given.get("tendon", ""))
    first = None if tendon is None else tendon.child("joint")
    if not name and first is not None and tendon is not None:
        name = first.get("joint", "")
        robot.note(actuator, f"the actuator {label} pulls the tendon {tendon.get('name')}; it is "
                   f"taken for a motor of its first joint, {name}.")  # fmt: skip
    if not name:
        robot.note(actuator, f"the actuator {label} drives no joint and is not taken over.")
        return None
    data = robot.joints[known(name, robot.joints, actuator, "joint")]
    if data.type not in _ONE:
        robot.note(actuator, f"the actuator {label} drives {name}, a {data.type} joint, and is not "
                   "taken over.")  # fmt: skip
        return None
    gear = float(numbers(given.get("gear", "1"), actuator, "gear", of="gain")[0])
    if gear != 1:
        robot.note(actuator, f"gear {gear:g} of {label} is not taken over: torques of {name} are "
                   "those at the joint.")  # fmt: skip
    law = [key for key in _CONTROL if key in given]
    if law or actuator.tag not in ("motor", "general"):
        robot.note(actuator, f"the control law of {label} ({', '.join(law) or actuator.tag}) is "
                   "not taken over: motors follow the motion.")  # fmt: skip
    return name


# Equalities ----------------------------------------------------------------------------------


def equalities(robot: Robot) -> None:
    """Loops of <connect> and <weld>; couplings of <joint>."""
    soft = None
    for section in robot.values.root.all("equality"):
        for k, element in enumerate(section.all()):
            given = robot.values.of(element, "main")
            name = given.get("name") or f"{element.tag}_{k + 1}"
            if given.get("active") == "false":
                robot.note(element, f"the equality {name} is not active and not taken over.")
            elif element.tag in ("connect", "weld"):
                _loop(robot, element, given, name)
            elif element.tag == "joint":
                _coupling(robot, element, given, name)
            else:
                robot.note(element, f"the equality {name} (<{element.tag}>) is not taken over.")
            soft = soft or (element if {"solref", "solimp"} & {*given} else None)
    if soft is not None:
        robot.note(soft, "equalities hold exactly: solref and solimp are not taken over.")


def _loop(robot: Robot, element: Element, given: dict[str, str], name: str) -> None:
    """A loop between two bodies, or between one and the ground under a free base."""
    if "site1" in given:
        (a, at), (b, beside) = (
            robot.sites[known(given.get(key, ""), robot.sites, element, "site")]
            for key in ("site1", "site2")
        )
    else:
        a, b = given.get("body1", ""), given.get("body2", "world")
        for body in (a, b):
            known(body, {**robot.poses, "world": np.eye(4)}, element, "body")
        at, beside = _frames(robot, element, given, a, b)
    if "world" in (a, b) and "world" not in robot.poses:
        body, own, ground = (a, at, beside) if b == "world" else (b, beside, at)
        _grounded(robot, element, name, body, own, ground)
        return
    ends = [
        robot.tree.mark(f"{name}_a", a, at),
        robot.tree.mark(f"{name}_b", b, beside),
    ]
    kind = "spherical" if element.tag == "connect" else "weld"
    robot.loops[name] = {"kind": kind, "between": ends}


def _grounded(
    robot: Robot, element: Element, name: str, body: str, own: Array, ground: Array
) -> None:
    """A body of a robot with a free base, held to the ground.

    Args:
        robot: It. element: Of the file. name: Of the loop. body: What is held.
        own: Frame of the body that is held, in the world as drawn. ground: Where it is held.
    """
    weld = element.tag == "weld"
    if weld and not np.allclose(own[:3, :3], ground[:3, :3], atol=1e-9):
        robot.note(
            element,
            f"the weld {name} holds {body} turned otherwise than the file draws it, and is not "
            "taken over: a loop to the ground keeps the direction of home.",
        )
        return
    base = robot.blocks.setdefault("home", {})
    if "root_joint" not in base:  # places on the ground are those of the file
        base["root_joint"] = base_pose(next(iter(robot.poses.values())))
    frame = robot.tree.mark(f"{name}_a", body, own)
    at = [float(x) for x in ground[:3, 3]]
    kind = "weld" if weld else "spherical"
    robot.loops[name] = {"kind": kind, "between": [frame, "world"], "at": at}


def _frames(
    robot: Robot, element: Element, given: dict[str, str], a: str, b: str
) -> tuple[Array, Array]:
    """The two frames that meet, in the world as the file draws it."""
    first, second = (robot.poses.get(body, np.eye(4)) for body in (a, b))
    if element.tag == "connect":
        anchor = numbers(given.get("anchor"), element, "anchor", 3)
        both = first @ pose(shift=anchor)
        return both, both
    relative = numbers(given.get("relpose", "0 1 0 0 0 0 0"), element, "relpose", 7)
    if not relative[3:].any():  # as the file draws the two bodies
        both = first if b == "world" else second
        return both, both
    step = pose(quaternion(relative[3:], element), relative[:3])
    return first @ step, second


def _coupling(robot: Robot, element: Element, given: dict[str, str], name: str) -> None:
    """y - y0 = a0 + a1 (x - x0), with the positions x0, y0 as the file draws them."""
    first = known(given.get("joint1", ""), robot.joints, element, "joint")
    values = numbers(given.get("polycoef", "0 1 0 0 0"), element, "polycoef", of="gain")
    c = [*(float(v) for v in values), 0.0, 0.0, 0.0, 0.0, 0.0][:5]
    if any(c[2:]):
        robot.note(element, f"the equality {name} of {first} is not linear (polycoef "
                   f"{given.get('polycoef')}) and not taken over.")  # fmt: skip
        return
    y0 = robot.joints[first].ref
    if "joint2" not in given:
        robot.note(element, f"the equality {name} holds {first} at {y0 + c[0]:g}; it is not taken "
                   "over. Write joints.NAME.type: fixed.")  # fmt: skip
        return
    second = known(given["joint2"], robot.joints, element, "joint")
    ratio, offset = c[1], y0 + c[0] - c[1] * robot.joints[second].ref
    driven = robot.blocks["actuated"]
    if first in driven and second in driven:
        driven.remove(first)
        robot.note(element, f"{first} follows {second}, and its motor is left out: torques add up "
                   f"there.")  # fmt: skip
    elif first in driven and ratio:  # the one with the motor leads
        first, second, ratio, offset = second, first, 1 / ratio, -offset / ratio
    robot.tree.follow(first, second, ratio, offset)


# What is left out ----------------------------------------------------------------------------

# Attributes by tag that are taken over, or that say nothing about the mechanism.
_POSE = ("name", "class", "childclass", "pos", "quat", "axisangle", "xyaxes", "zaxis", "euler")
_LABELS = ("name", "class", "group", "user")
_TAKEN = {
    "compiler": ("angle", "eulerseq", "meshdir", "assetdir", "texturedir", "autolimits",
                 "inertiafromgeom", "discardvisual", "usethread"),
    "option": ("gravity", "timestep", "integrator", "cone", "jacobian", "solver", "iterations",
               "tolerance", "impratio", "ls_iterations", "noslip_iterations"),
    "body": (*_POSE, "user"),
    "inertial": (*_POSE, "mass", "diaginertia", "fullinertia"),
    "joint": (*_LABELS, "type", "pos", "axis", "ref", "range", "limited", "armature", "damping",
              "stiffness", "springref", "frictionloss", "margin", "solreflimit", "solimplimit"),
    "connect": (*_LABELS, "body1", "body2", "anchor", "site1", "site2", "active", "solref",
                "solimp"),
    "weld": (*_LABELS, "body1", "body2", "relpose", "anchor", "site1", "site2", "active", "solref",
             "solimp", "torquescale"),
    "mesh": ("name", "class", "file", "scale", "smoothnormal", "maxhullvert", "content_type"),
}  # fmt: skip


def rest(robot: Robot) -> None:
    """Gravity; and sections and geoms without a meaning here, a sentence each."""
    for option in robot.values.root.all("option"):
        if "gravity" in option.attrib:
            vector = numbers(option.get("gravity"), option, "gravity", 3, "acceleration")
            robot.blocks["gravity"] = [float(x) for x in vector]
    for section in robot.values.root.all():
        if section.tag not in _QUIET:
            robot.note(section, f"<{section.tag}> is not taken over.")
        elif section.tag == "tendon":
            for tendon in section.all():
                robot.note(tendon, f"the tendon {tendon.get('name', '')} (<{tendon.tag}>) is not "
                           "taken over.")  # fmt: skip
    _attributes(robot)
    for geom in robot.values.root.iter("geom"):
        assert isinstance(geom, Element)
        if geom.get("contype", "1") != "0":
            robot.note(geom, "geoms do not touch each other here: contacts are not taken over.")
            break


def _attributes(robot: Robot) -> None:
    """Attributes of elements that are taken over but for these."""
    pending = [robot.values.root]
    while pending:
        element = pending.pop()
        pending += [child for child in element.all() if element.tag not in ("tendon", "equality")]
        if element.tag == "equality":
            pending += [child for child in element.all() if child.tag != "joint"]
        if element.tag in _TAKEN and not (element.tag == "mesh" and not element.get("file")):
            robot.values.notes += unused(element, _TAKEN[element.tag])
    for name, data in robot.joints.items():
        if data.type == "ball" and "range" in data.given:
            robot.note(data.element, f"range of {name}, a ball joint, is not taken over.")
