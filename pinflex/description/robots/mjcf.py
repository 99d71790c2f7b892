"""Reading an MJCF as MuJoCo compiles it: bodies, joints, springs, equalities and motors.

Joint positions are MuJoCo's: a `ref` is the position at which the file draws the joint, and `home`
starts there. Equalities hold exactly here, where MuJoCo has stiff springs (solref, solimp).

Source: MuJoCo documentation, XML reference and mjModel.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array, BoolArray
from pinflex.description.files import Source
from pinflex.description.robots import urdf
from pinflex.description.robots.mjcf_model import BALL, FREE, HINGE, Robot, compiled
from pinflex.description.robots.tree_text import Inertia, Joint, Visual, inverse, pose, triple
from pinflex.errors import DescriptionError

# What of an MJCF is not taken over: a line for each kind, those that move most first.

_LINES = 10
_NAMES = 4  # of one kind are written out
_Kinds = dict[str, list[str]]  # sentences in which {} stands for names, and the names


def left_out(robot: Robot) -> tuple[str, ...]:
    """Sentences, at most ten: what would be more shares the last one."""
    kinds = {**_bodies(robot), **_tendons(robot), **_of_joints(robot)}
    named = {what: list(dict.fromkeys(names))
             for what, names in {**kinds, **robot.refused, **_quiet(robot)}.items()}  # fmt: skip
    lines = [what.replace("{}", _listed(names)) for what, names in named.items() if names]
    if len(lines) > _LINES:
        lines[_LINES - 1 :] = ["; ".join(lines[_LINES - 1 :])]
    return tuple(f"{robot.file}: not taken over: {line}." for line in lines)


def _listed(names: Collection[str]) -> str:
    more = f" and {len(names) - _NAMES} more" if len(names) > _NAMES else ""
    return ", ".join(list(names)[:_NAMES]) + more


def _of(robot: Robot, group: str, which: Iterable[int]) -> list[str]:
    """Names of elements of a group of MjSpec, or their lines."""
    return [robot.label(group, int(k)) for k in which]


def _set(model: Any, *keys: str) -> BoolArray:
    """Which rows of any of these arrays are not zero."""
    arrays = [np.asarray(getattr(model, key)) for key in keys]
    return np.asarray(np.any([a.any(axis=tuple(range(1, a.ndim))) for a in arrays], axis=0))


def _bodies(robot: Robot) -> _Kinds:
    """Deformable bodies, plugins and fluids."""
    model = robot.model
    fluid = [key for key in ("density", "viscosity") if getattr(model.opt, key)]
    return {
        "the deformable bodies {}": _of(robot, "flexes", range(model.nflex)),
        "the plugins {}": _of(robot, "plugins", range(model.nplugin)),
        "the fluid around the bodies ({} of <option>)": fluid,
    }


def _tendons(robot: Robot) -> _Kinds:
    model = robot.model
    acts = _set(model, "tendon_armature", "tendon_frictionloss")
    if robot.enabled("SPRING"):
        acts |= _set(model, "tendon_stiffness", "tendon_stiffnesspoly")
    if robot.enabled("DAMPER"):
        acts |= _set(model, "tendon_damping", "tendon_dampingpoly")
    acts = acts & (model.ntendon > 0)
    heavy = _set(model, "actuator_armature", "actuator_damping")
    heavy[[a for a, _ in robot.drives]] = False
    heavy |= _set(model, "actuator_dampingpoly")
    pulling, still = (_of(robot, "tendons", np.flatnonzero(which)) for which in (acts, ~acts))
    return {
        "springs, dampers, masses and friction of the tendons {}": pulling,
        "the tendons {}": still,
        "armature and damping, or polynomials of it, of the actuators {}": _of(
            robot, "actuators", np.flatnonzero(heavy)
        ),
    }


def _of_joints(robot: Robot) -> _Kinds:
    """Properties of joints that no key of the YAML has."""
    model, kind, rows = robot.model, robot.model.jnt_type, robot.model.jnt_dofadr
    several, free = kind <= BALL, kind == FREE
    sprung, damped = robot.enabled("SPRING"), robot.enabled("DAMPER")
    springs = _set(model, "jnt_stiffness", "jnt_stiffnesspoly") & several & sprung
    curved = _set(model, "jnt_stiffnesspoly") & ~several & sprung
    bent = _set(model, "dof_dampingpoly")[rows] & damped
    carried = model.jnt_actgravcomp.astype(bool) & bool(model.body_gravcomp.any())
    found = {
        "springs of the joints {}, which have several freedoms": springs,
        "dampers of the free joints {}": _set(model, "dof_damping")[rows] & free & damped,
        "armature of the free joints {}": _set(model, "dof_armature")[rows] & free,
        "frictionloss of the joints {}, which have several freedoms":
            _set(model, "dof_frictionloss")[rows] & several,
        "polynomials of stiffness or damping of the joints {} beyond their first numbers":
            curved | bent,
        # since MuJoCo 4
        "that springs of the joints {} yield":
            _set(model, "jnt_springyield") if hasattr(model, "jnt_springyield") else free & False,
        "that the motors of {} carry gravcomp, which acts beside them here": carried,
        "the range of the joints {}": model.jnt_limited.astype(bool) & several,
    }  # fmt: skip
    return {
        what: [name for name, one in zip(robot.joints, which, strict=True) if one]
        for what, which in found.items()
    }


def _quiet(robot: Robot) -> _Kinds:
    """Entries that do not describe the mechanism itself."""
    model = robot.model
    named = _of(robot, "actuators", range(model.nu))
    geared = [named[a] for a, _ in robot.drives if model.actuator_gear[a, 0] != 1]
    law = _set(model, "actuator_dyntype", "actuator_gaintype", "actuator_biastype")
    law |= np.asarray(model.actuator_gainprm[:, 0] != 1)
    held = robot.loops or any(carrier.mimic for _, carrier in robot.tree.carriers.values())
    touch = model.geom_contype.any() or model.geom_conaffinity.any() or model.npair
    parts = {
        "sensors": model.nsensor, "keyframes": model.nkey,
        "shapes of the world": model.body_geomnum[0],
    }  # fmt: skip
    return {
        "the gears of {}: torques are those at the joints": geared,
        "the control laws of {}: motors follow the motion": [named[a] for a in np.flatnonzero(law)],
        "{} of equalities: they hold exactly": ["solref", "solimp"] if held else [],
        "{}: geoms do not touch each other here": ["contacts"] if touch else [],
        "{}": [name for name, count in parts.items() if count],
    }


_TYPES = ("floating", "fixed", "prismatic", "continuous")
_GROUPS = 3  # geoms of the groups 0 to 2 are drawn, as in MuJoCo


def read(text: str, file: str, package_dirs: tuple[str, ...]) -> Source:
    """Read an MJCF."""
    robot = compiled(text, file, Path(package_dirs[0]) if package_dirs else Path())
    model = robot.model
    if model.nbody < 2:
        raise DescriptionError(f"{file}: no <body>. A robot has at least one.")
    top = np.flatnonzero(model.body_parentid[1:] == 0) + 1
    free = len(top) == 1 and model.njnt > 0 and model.jnt_type[0] == FREE
    if free:
        _free_root(robot)
    else:
        robot.tree.root(robot.links[0])
    for k in range(2 if free else 1, model.nbody):
        _body(robot, k)
    for k in range(1, model.nbody):
        _mass_and_shapes(robot, k)
    _joints(robot)
    _motors(robot)
    _equalities(robot)
    _gravity(robot)
    checked = urdf.check(robot.tree.text(), file, package_dirs)
    notes = left_out(robot)
    return replace(checked, loops=robot.loops, blocks=robot.blocks, notes=notes)


# Bodies --------------------------------------------------------------------------------------


def _free_root(robot: Robot) -> None:
    """One free body in the world is a free base, which starts where the file draws it."""
    matrix = robot.body(1)
    robot.tree.root(robot.links[1], matrix)
    robot.blocks["base"] = "free_flyer"
    if not np.array_equal(matrix, np.eye(4)):
        place = [float(x) for x in matrix[:3, 3]]
        w, x, y, z = (float(q) for q in robot.drawn.xquat[1])
        robot.blocks["home"] = {"root_joint": [*place, x, y, z, w]}


def _body(robot: Robot, k: int) -> None:
    """A body, with one link for each of its joints."""
    model, name, matrix = robot.model, robot.links[k], robot.body(k)
    link = robot.links[model.body_parentid[k]]
    first, count = int(model.body_jntadr[k]), int(model.body_jntnum[k])
    for j in range(first, first + count):
        own = name if j == first + count - 1 else f"{name}.{j - first + 1}"
        robot.tree.add(own, link, _carrier(robot, j), matrix @ pose(shift=model.jnt_pos[j]))
        link = own
    if not count:
        robot.tree.add(name, link, Joint(f"{name}_mount"), matrix)


def _carrier(robot: Robot, j: int) -> Joint:
    model, kind, name = robot.model, int(robot.model.jnt_type[j]), robot.joints[j]
    if kind in (FREE, BALL):
        return Joint(name, _TYPES[kind])
    limits = None
    if model.jnt_limited[j]:
        limits = float(model.jnt_range[j, 0]), float(model.jnt_range[j, 1])
    word = "revolute" if kind == HINGE and limits is not None else _TYPES[kind]
    return Joint(name, word, model.jnt_axis[j], limits, offset=_drawn(robot, j))


def _drawn(robot: Robot, j: int) -> float:
    """Position of a joint of one freedom as the file draws it [rad | m]."""
    return float(robot.model.qpos0[robot.model.jnt_qposadr[j]])


def _mass_and_shapes(robot: Robot, k: int) -> None:
    model, drawn, name = robot.model, robot.drawn, robot.links[k]
    inertia = Inertia(float(model.body_mass[k]), about=np.diag(model.body_inertia[k]))
    frame = pose(drawn.ximat[k].reshape(3, 3), drawn.xipos[k])
    robot.tree.load(name, inertia, (), frame)
    first = int(model.body_geomadr[k])
    geoms = range(first, first + int(model.body_geomnum[k]))
    shapes = (_shape(robot, g) for g in geoms if model.geom_group[g] < _GROUPS)
    visuals = tuple(shape for shape in shapes if shape is not None)
    robot.tree.load(name, Inertia(), visuals, np.eye(4))


def _shape(robot: Robot, g: int) -> Visual | None:
    """Shape of a geom, in the world as drawn; None for one that is not drawn."""
    model, code = robot.model, robot.code
    matrix = pose(robot.drawn.geom_xmat[g].reshape(3, 3), robot.drawn.geom_xpos[g])
    kind, size = int(model.geom_type[g]), [float(x) for x in model.geom_size[g]]
    if kind == code("Geom.BOX"):
        return Visual("box", matrix, {"size": triple(2 * x for x in size)})
    if kind in (code("Geom.CAPSULE"), code("Geom.CYLINDER")):
        length = 2 * (size[1] + (size[0] if kind == code("Geom.CAPSULE") else 0.0))
        return Visual("cylinder", matrix, {"radius": repr(size[0]), "length": repr(length)})
    if kind in (code("Geom.SPHERE"), code("Geom.ELLIPSOID")):
        mean = size[0] if kind == code("Geom.SPHERE") else float(np.prod(size) ** (1 / 3))
        return Visual("sphere", matrix, {"radius": repr(mean)})
    mesh = int(model.geom_dataid[g])
    if kind != code("Geom.MESH") or mesh < 0 or model.mesh_pathadr[mesh] < 0:
        return None
    # MuJoCo moves a mesh to its principal axes
    own = pose(_turned(robot, model.mesh_quat[mesh]), model.mesh_pos[mesh])
    file = model.paths[model.mesh_pathadr[mesh] :].split(b"\0")[0].decode()
    scale = triple(model.mesh_scale[mesh])
    return Visual("mesh", matrix @ inverse(own), {"filename": file, "scale": scale})


def _turned(robot: Robot, quaternion: Array) -> Array:
    """Rotation matrix of a quaternion w x y z."""
    flat = np.zeros(9)
    robot.mujoco.mju_quat2Mat(flat, np.asarray(quaternion, float))
    return flat.reshape(3, 3)


# Joints --------------------------------------------------------------------------------------


def _joints(robot: Robot) -> None:
    """Springs, dampers, friction and rotor inertias; positions at which joints are drawn."""
    model = robot.model
    armature, damping = model.dof_armature.copy(), model.dof_damping.copy()
    for a, j in robot.drives:  # MuJoCo 4 has both in an actuator too, at its side of the gear
        row, gear = model.jnt_dofadr[j], model.actuator_gear[a, 0]
        for total, key in ((armature, "actuator_armature"), (damping, "actuator_damping")):
            total[row] += gear**2 * getattr(model, key, np.zeros(model.nu))[a]
    for j, name in enumerate(robot.joints):
        kind, row = int(model.jnt_type[j]), int(model.jnt_dofadr[j])
        if kind == FREE:
            continue
        extra: dict[str, Any] = {"type": "spherical"} if kind == BALL else {}
        values = {"rotor_inertia": armature[row]}
        if robot.enabled("DAMPER"):
            values["damper"] = damping[row]
        if kind != BALL and robot.enabled("SPRING"):
            values["parallel_spring"] = model.jnt_stiffness[j]
        extra |= {key: float(value) for key, value in values.items() if value}
        rest = float(model.qpos_spring[model.jnt_qposadr[j]]) if kind != BALL else 0.0
        at = _drawn(robot, j) if kind != BALL else 0.0
        if "parallel_spring" in extra and (rest or at):
            extra["rest"] = rest
        rubs = float(model.dof_frictionloss[row]) if robot.enabled("FRICTIONLOSS") else 0.0
        if kind != BALL and rubs:
            extra["friction"] = {"coulomb": rubs}
        if extra:
            robot.blocks.setdefault("joints", {})[name] = extra
        if at or extra.get("rest", 0.0):  # an elastic joint would start at its rest
            robot.blocks.setdefault("home", {})[name] = at


def _motors(robot: Robot) -> None:
    """Joints that actuators drive, in the order of the actuators."""
    model, driven = robot.model, dict(robot.drives)
    for a in range(model.nu):
        name = robot.label("actuators", a)
        first = _first_of(robot, a)
        if first is not None:
            driven[a] = first
            robot.refuse(
                "the tendons that the actuators {} pull, taken for motors of their first joints",
                name,
            )
        elif a not in driven:
            robot.refuse("the actuators {}, which drive no joint of one freedom", name)
    joints = (robot.joints[driven[a]] for a in sorted(driven))
    robot.blocks["actuated"] = list(dict.fromkeys(joints))


def _first_of(robot: Robot, a: int) -> int | None:
    """The first joint of a fixed tendon that an actuator pulls."""
    model, tendon = robot.model, int(robot.model.actuator_trnid[a, 0])
    if model.actuator_trntype[a] != robot.code("Trn.TENDON"):
        return None
    wrap = int(model.tendon_adr[tendon])
    joint = int(model.wrap_objid[wrap])
    fixed = model.wrap_type[wrap] == robot.code("Wrap.JOINT")
    return joint if fixed and model.jnt_type[joint] > BALL else None


# Equalities ----------------------------------------------------------------------------------


def _equalities(robot: Robot) -> None:
    """Loops of <connect> and <weld>; couplings of <joint>."""
    model = robot.model
    joint, connect, weld = (robot.code(f"Eq.{word}") for word in ("JOINT", "CONNECT", "WELD"))
    for k in range(model.neq):
        kind = int(model.eq_type[k])
        word = robot.mujoco.mjtEq(kind).name.rpartition("_")[2].lower()
        name = model.equality(k).name or f"{word}_{k + 1}"
        if not (model.eq_active0[k] and robot.enabled("EQUALITY")):
            robot.refuse("the equalities {}, which are not active", name)
        elif kind in (connect, weld):
            _loop(robot, k, name, kind == weld)
        elif kind == joint:
            _coupling(robot, k, name)
        else:
            robot.refuse("the equalities {} of tendons or deformable bodies", name)


def _loop(robot: Robot, k: int, name: str, weld: bool) -> None:
    """A loop between two bodies, or between one and the ground under a free base."""
    model, data = robot.model, robot.model.eq_data[k]
    a, b = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
    if model.eq_objtype[k] == robot.code("Obj.SITE"):
        ends = [
            pose(robot.drawn.site_xmat[s].reshape(3, 3), robot.drawn.site_xpos[s]) for s in (a, b)
        ]
        a, b = int(model.site_bodyid[a]), int(model.site_bodyid[b])
    elif weld:  # data: anchor in the second body, then its pose in the first
        ends = [pose(_turned(robot, data[6:10]), data[3:6]), pose(shift=data[:3])]
        ends = [robot.body(a) @ ends[0], robot.body(b) @ ends[1]]
    else:  # data: the point in each body
        ends = [robot.body(a) @ pose(shift=data[:3]), robot.body(b) @ pose(shift=data[3:6])]
    kind = "weld" if weld else "spherical"
    if 0 in (a, b) and robot.links[0] not in robot.tree.links:
        body, own, ground = (a, ends[0], ends[1]) if b == 0 else (b, ends[1], ends[0])
        if weld:  # at the body, where MuJoCo may have it at the origin
            own, ground = robot.body(body), ground @ inverse(own) @ robot.body(body)
        if weld and not np.allclose(own[:3, :3], ground[:3, :3], atol=1e-9):
            robot.refuse(
                "the welds {}, which turn a body against the file's drawing (a loop to the ground "
                "keeps the direction of home)",
                name,
            )
            return
        frame = robot.tree.mark(f"{name}_a", robot.links[body], own)
        at = [float(x) for x in ground[:3, 3]]
        robot.loops[name] = {"kind": kind, "between": [frame, "world"], "at": at}
        return
    marks = [
        robot.tree.mark(f"{name}_{end}", robot.links[body], frame)
        for end, body, frame in (("a", a, ends[0]), ("b", b, ends[1]))
    ]
    robot.loops[name] = {"kind": kind, "between": marks}


def _coupling(robot: Robot, k: int, name: str) -> None:
    """y - y0 = a0 + a1 (x - x0), with the positions x0, y0 as the file draws them."""
    model = robot.model
    c, one, other = model.eq_data[k], int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
    first, driven = robot.joints[one], robot.blocks["actuated"]
    if other < 0:  # held: it follows a joint that does not move
        frame = robot.tree.mark(f"{name}_held", next(iter(robot.tree.links)), np.eye(4))
        robot.tree.follow(first, f"{frame}_mount", 0.0, _drawn(robot, one) + float(c[0]))
        if first in driven:
            driven.remove(first)
        return
    second = robot.joints[other]
    if c[2:5].any():
        robot.refuse("the equalities {}, whose joints follow a curve", name)
        return
    ratio = float(c[1])
    offset = _drawn(robot, one) + float(c[0]) - ratio * _drawn(robot, other)
    if first in driven and second in driven:
        driven.remove(first)
        robot.refuse("the motors of {}, which follow others: torques add up there", first)
    elif first in driven and ratio:  # the one with the motor leads
        first, second, ratio, offset = second, first, 1 / ratio, -offset / ratio
    robot.tree.follow(first, second, ratio, offset)


# Gravity -------------------------------------------------------------------------------------


def _gravity(robot: Robot) -> None:
    """Gravity; and what holds bodies against it, as forces at their centres of mass."""
    model = robot.model
    vector = model.opt.gravity if robot.enabled("GRAVITY") else np.zeros(3)
    robot.blocks["gravity"] = [float(x) for x in vector]
    for k in np.flatnonzero(model.body_gravcomp * model.body_mass):
        force = -model.body_gravcomp[k] * model.body_mass[k] * vector
        if force.any():
            name = f"{robot.links[k]}_gravcomp"
            frame = robot.tree.mark(name, robot.links[k], pose(shift=robot.drawn.xipos[k]))
            forces = robot.blocks.setdefault("forces", {})
            forces[name] = {"at": frame, "force": [float(x) for x in force]}
