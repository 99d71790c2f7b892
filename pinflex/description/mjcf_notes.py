"""What of an MJCF is not taken over: a line for each kind, those that move most first."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import Any

import numpy as np

from pinflex.arrays import BoolArray
from pinflex.description.mjcf_model import BALL, FREE, Robot

_LINES = 10
_NAMES = 4  # of one kind are written out
_Kind = tuple[str, Iterable[str]]  # a sentence in which {} stands for names, and the names


def left_out(robot: Robot) -> tuple[str, ...]:
    """Sentences, at most ten: what would be more shares the last one."""
    kinds = [*_bodies(robot), *_tendons(robot), *_joints(robot), *robot.refused.items()]
    named = [(what, list(dict.fromkeys(names))) for what, names in [*kinds, *_quiet(robot)]]
    lines = [what.replace("{}", _listed(names)) for what, names in named if names]
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


def _bodies(robot: Robot) -> Iterator[_Kind]:
    """What acts on bodies by itself."""
    model = robot.model
    yield "the deformable bodies {}", _of(robot, "flexes", range(model.nflex))
    yield "the plugins {}", _of(robot, "plugins", range(model.nplugin))
    yield (
        "the fluid around the bodies ({} of <option>)",
        [key for key in ("density", "viscosity") if getattr(model.opt, key)],
    )


def _tendons(robot: Robot) -> Iterator[_Kind]:
    model = robot.model
    acts = _set(model, "tendon_armature", "tendon_frictionloss")
    if robot.enabled("SPRING"):
        acts |= _set(model, "tendon_stiffness", "tendon_stiffnesspoly")
    if robot.enabled("DAMPER"):
        acts |= _set(model, "tendon_damping", "tendon_dampingpoly")
    acts = acts & (model.ntendon > 0)
    yield (
        "springs, dampers, masses and friction of the tendons {}",
        _of(robot, "tendons", np.flatnonzero(acts)),
    )
    yield "the tendons {}", _of(robot, "tendons", np.flatnonzero(~acts))
    heavy, bent = (
        _set(model, "actuator_armature", "actuator_damping"),
        _set(model, "actuator_dampingpoly"),
    )
    heavy[[a for a, _ in robot.drives]] = False
    names = _of(robot, "actuators", np.flatnonzero(heavy | bent))
    yield "armature and damping, or polynomials of it, of the actuators {}", names


def _joints(robot: Robot) -> Iterator[_Kind]:
    """What of a joint no key says."""
    model, names, kind = robot.model, robot.joints, robot.model.jnt_type
    several, free = kind <= BALL, kind == FREE
    springs = _set(model, "jnt_stiffness", "jnt_stiffnesspoly") & several & robot.enabled("SPRING")
    yield "springs of the joints {}, which have several freedoms", _at(names, springs)
    rows = model.jnt_dofadr
    damped = _set(model, "dof_damping")[rows] & free & robot.enabled("DAMPER")
    yield "dampers of the free joints {}", _at(names, damped)
    yield "armature of the free joints {}", _at(names, _set(model, "dof_armature")[rows] & free)
    rubs = _set(model, "dof_frictionloss")[rows] & several
    yield "frictionloss of the joints {}, which have several freedoms", _at(names, rubs)
    curved = _set(model, "jnt_stiffnesspoly") & ~several & robot.enabled("SPRING")
    bent = _set(model, "dof_dampingpoly")[rows] & robot.enabled("DAMPER")
    yield (
        "polynomials of stiffness or damping of the joints {} beyond their first numbers",
        _at(names, curved | bent),
    )
    if hasattr(model, "jnt_springyield"):  # since MuJoCo 4
        yield "that springs of the joints {} yield", _at(names, _set(model, "jnt_springyield"))
    carried = model.jnt_actgravcomp.astype(bool) & bool(model.body_gravcomp.any())
    yield "that the motors of {} carry gravcomp, which acts beside them here", _at(names, carried)
    yield "the range of the joints {}", _at(names, model.jnt_limited.astype(bool) & several)


def _at(names: list[str], which: BoolArray) -> list[str]:
    return [name for name, one in zip(names, which, strict=True) if one]


def _quiet(robot: Robot) -> Iterator[_Kind]:
    """What says nothing about the mechanism itself."""
    model = robot.model
    named = _of(robot, "actuators", range(model.nu))
    yield (
        "the gears of {}: torques are those at the joints",
        [named[a] for a, _ in robot.drives if model.actuator_gear[a, 0] != 1],
    )
    law = _set(model, "actuator_dyntype", "actuator_gaintype", "actuator_biastype")
    law |= np.asarray(model.actuator_gainprm[:, 0] != 1)
    yield (
        "the control laws of {}: motors follow the motion",
        [named[a] for a in np.flatnonzero(law)],
    )
    if robot.loops or any(carrier.mimic for _, carrier in robot.tree.carriers.values()):
        yield "{} of equalities: they hold exactly", ["solref", "solimp"]
    if model.geom_contype.any() or model.geom_conaffinity.any() or model.npair:
        yield "{}: geoms do not touch each other here", ["contacts"]
    parts = {
        "sensors": model.nsensor, "keyframes": model.nkey,
        "shapes of the world": model.body_geomnum[0],
    }  # fmt: skip
    yield "{}", [name for name, count in parts.items() if count]
