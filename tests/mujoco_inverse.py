"""Forces of all coordinates of an MJCF, by MuJoCo's inverse dynamics and by pinflex, at one state.

Equalities, contacts and limits are off on both sides: what is compared is the tree with its masses,
springs, dampers, friction and loads. Free bodies and balls are in; a state that both understand is
drawn from a seed.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

import pinflex as pf
from pinflex.description import description
from pinflex.description.robots.mjcf_model import compiled
from pinflex.mechanics.evaluation.equations import Equations

mujoco.set_mju_user_warning(lambda text: None)  # which would write MUJOCO_LOG.TXT
OFF = ("CONTACT", "LIMIT", "EQUALITY", "FRICTIONLOSS")


@dataclass(frozen=True)
class State:
    """Positions, speeds and accelerations of a model as MuJoCo has them."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


def state(model: Any, seed: int = 1) -> State:
    rng = np.random.default_rng(seed)
    q, v, a = model.qpos0.copy(), rng.normal(size=model.nv), rng.normal(size=model.nv)
    v += 0.1 * np.sign(v)  # beyond the speeds at which dry friction is smoothed
    q[model.jnt_qposadr[model.jnt_type > 1]] = 0.0  # whatever `ref` says
    mujoco.mj_integratePos(model, q, rng.normal(size=model.nv), 0.5)
    return State(q, v, a)


def theirs(model: Any, at: State) -> np.ndarray:
    """Generalised forces of MuJoCo; dry friction by hand, since MuJoCo's gives way."""
    model = copy.copy(model)
    slides = model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS)
    dry = 0.0 if slides else model.dof_frictionloss * np.sign(at.v)
    for what in OFF:
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{what}"))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = at.q, at.v, at.a
    mujoco.mj_inverse(model, data)
    return np.array(data.qfrc_inverse) + dry


def tree_of(path: Path) -> pf.Mechanism:
    """The robot of a file without its loops and couplings."""
    robot = description.read(path)
    lines = [f"urdf: {path.name}", "actuated: []"]
    if robot.loops:
        lines += ["loops:", *(f"  {loop.name}:" for loop in robot.loops)]
    if robot.couplings:
        lines += ["joints:", *(f"  {c.joint}: {{follows: false}}" for c in robot.couplings)]
    return pf.load(description.from_text("\n".join(lines), path.with_suffix(".yaml")))


def ours(path: Path, model: Any, at: State) -> np.ndarray:
    """Generalised forces of pinflex at the state, in MuJoCo's coordinates."""
    system = tree_of(path).rigid
    names = compiled(path.read_text("utf-8-sig"), path.name, path.parent).joints
    pinned = system.rigid
    q, v, a = pin.neutral(pinned), np.zeros(pinned.nv), np.zeros(pinned.nv)
    places = [_fill(pinned, names[j], model, j, at, (q, v, a)) for j in range(model.njnt)]
    force = Equations(system).residual(q, v, a, np.zeros(system.closed.n), 0.0).r
    out = np.zeros(model.nv)
    for own, row, turn in places:
        out[row] = force[own]
        if turn is not None:
            out[row][:3] = turn @ force[own][:3]
    return out


def _fill(pinned: Any, name: str, model: Any, j: int, at: State, to: Any) -> Any:
    """Write the state of one joint; rows of both sides, and the rotation of a free body."""
    kind, place, first = model.jnt_type[j], model.jnt_qposadr[j], model.jnt_dofadr[j]
    q, v, a = to
    known = pinned.existJointName(name)
    joint = pinned.joints[pinned.getJointId(name if known else "root_joint")]
    row = slice(first, first + (6, 3, 1, 1)[kind])
    own = slice(joint.idx_v, joint.idx_v + joint.nv)
    assert own.stop - own.start == row.stop - row.start
    to_q = slice(joint.idx_q, joint.idx_q + joint.nq)
    v[own], a[own] = at.v[row], at.a[row]
    if kind == 0:
        given = at.q[place : place + 7]
        pose = pin.XYZQUATToSE3(given[[0, 1, 2, 4, 5, 6, 3]])
        if known:  # drawn where it is at zero
            pose = pin.XYZQUATToSE3(model.qpos0[place : place + 7][[0, 1, 2, 4, 5, 6, 3]]).actInv(
                pose
            )
        turn = pin.XYZQUATToSE3(given[[0, 1, 2, 4, 5, 6, 3]]).rotation
        q[to_q] = pin.SE3ToXYZQUAT(pose)
        v[own][:3] = turn.T @ v[own][:3]
        a[own][:3] = turn.T @ a[own][:3] - np.cross(v[own][3:], v[own][:3])
        return own, row, turn
    if kind == 1:
        q[to_q] = at.q[[place + 1, place + 2, place + 3, place]]
    else:
        value = at.q[place]
        q[to_q] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
    return own, row, None


def difference(path: Path, seed: int = 1) -> float:
    """Largest difference of the two, of the largest force."""
    model = mujoco.MjModel.from_xml_path(str(path))
    at = state(model, seed)
    forces = theirs(model, at)
    return float(np.abs(ours(path, model, at) - forces).max() / np.abs(forces).max())
