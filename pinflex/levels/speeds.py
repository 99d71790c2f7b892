"""Start speeds of joints and links, with what closures make of the others.

Joints take the speeds given to them, all other open joints and all deflections stay as they are,
and the closures determine the rest, J v = 0; what they leave open (one crank of two) and what a
bent pose needs beside it takes the least kinetic energy:

    min 1/2 dv' M dv,     J (v + dv) = 0,     w (v + dv) = given

The speed of a link is that of its frame's origin in the world. It comes about as by a blow there:
the least kinetic energy over all that may move, deflections too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.description.solve import Speeds
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.frames import frame_jacobian
from pinflex.mechanics.mechanism import Mechanism

_MISSED = 1e-9  # of the largest speed: round-off of a constraint that can be met is 1e-15


def with_speeds(
    mechanism: Mechanism,
    dynamics: Equations,
    y: Array,
    v: Array,
    speeds: Speeds,
    driven: bool = False,
) -> Array:
    """Velocities at the start with the given ones among them.

    Returns:
        Shape (nv,).
    Raises:
        DescriptionError: An unknown name, a prescribed one, or speeds that closures do not allow.
    """
    if not speeds:
        return v
    system = dynamics.system
    fixed = system.held if driven else np.union1d(system.held, system.motors)
    joints, links = _sorted(mechanism, speeds)
    v, named = v.copy(), list[int]()
    for name, at, values in joints:
        if np.any(np.isin(at, fixed)):
            raise _prescribed(mechanism, name, at, system.motors)
        for row, value in zip(at, values, strict=True):
            if value is not None:
                v[row] = value
                named.append(row)
    free = np.setdiff1d(np.arange(system.nv), [*fixed, *named]).astype(np.intp)
    rows, given = _link_rows(dynamics, y, links)
    J = dynamics.close(y)[1].copy() if dynamics.looped else np.zeros((0, system.nv))
    A, b = np.vstack([J, rows]), np.concatenate([np.zeros(len(J)), given])
    if not links:
        rigid = free[free < dynamics.n_rigid]
        looped = rigid[np.any(J[:, rigid] != 0, axis=0)]
        v = corrected(dynamics, y, v, A, b, looped)
        if not misses(A, b, v):
            return v
    v = corrected(dynamics, y, v, A, b, free)
    if misses(A, b, v):
        raise DescriptionError(
            f"{mechanism.name}: solve.start_speeds: {', '.join(name for name, _ in speeds)}: the "
            "loops and motors do not allow these speeds together; they miss by "
            f"{np.max(np.abs(A @ v - b)):.3g} (m/s or rad/s). Name fewer of them: what is not "
            "named follows."
        )
    return v


def misses(A: Array, b: Array, v: Array, share: float = _MISSED) -> bool:
    """Whether v misses A v = b by more than a share of the largest velocity."""
    size = max(float(np.max(np.abs(v), initial=0.0)), 1e-300)
    return float(np.max(np.abs(A @ v - b), initial=0.0)) > share * size


def corrected(dynamics: Equations, y: Array, v: Array, A: Array, b: Array, free: IntArray) -> Array:
    """v with the rows `free` moved by the least kinetic energy so that A v = b, if that can be."""
    if not len(free) or not len(A):
        return v
    M, A_free = dynamics.mass(y)[np.ix_(free, free)], A[:, free]
    # Massless coordinates are moved as little as can be: a share of round-off of the largest mass.
    values, V = np.linalg.eigh(M)
    root = V / np.sqrt(np.maximum(values, 1e-12 * max(values[-1], 1e-300)))
    step = root @ np.linalg.lstsq(A_free @ root, b - A @ v, rcond=1e-11)[0]
    moved = v.copy()
    moved[free] += step
    return moved


def _sorted(
    mechanism: Mechanism, speeds: Speeds
) -> tuple[
    list[tuple[str, list[int], Sequence[float | None]]],
    list[tuple[str, Sequence[float | None]]],
]:
    """Joints with their velocity rows, and links."""
    model = mechanism.rigid.rigid
    joints = list[tuple[str, list[int], Sequence[float | None]]]()
    links = list[tuple[str, Sequence[float | None]]]()
    frames = mechanism.flexible.expansion.frames
    for name, values in speeds:
        parts = [x for x in (name, f"{name}.1", f"{name}.2") if model.existJointName(x)]
        steps = [model.joints[model.getJointId(x)] for x in parts]
        rows = [row for step in steps for row in range(step.idx_v, step.idx_v + step.nv)]
        if rows:
            count = len(rows)
            joints.append((name, rows, values))
        elif name in frames:
            count = 3
            links.append((name, values))
        else:
            known = nearest(name, [*list(model.names)[1:], *frames])
            raise DescriptionError(
                f"{mechanism.name}: solve.start_speeds: no such moving joint or link: "
                f'"{name}".{known}'
            )
        if len(values) != count:
            what = "velocity of its origin" if not rows else "speed for each freedom"
            raise DescriptionError(
                f"{mechanism.name}: solve.start_speeds.{name}: {len(values)} values. Allowed: "
                f"{count}, the {what}."
            )
    return joints, links


def _prescribed(
    mechanism: Mechanism, name: str, rows: Sequence[int], motors: IntArray
) -> DescriptionError:
    if np.any(np.isin(rows, motors)):
        why, advice = "is a motor, and follows the motion", "Change the motion, or drive: torque"
    else:
        why, advice = "is idle or a base that is held", "Write idle: free"
    return DescriptionError(
        f"{mechanism.name}: solve.start_speeds.{name}: {name} {why}. {advice}, or leave it out."
    )


def _link_rows(
    dynamics: Equations, y: Array, links: Sequence[tuple[str, Sequence[float | None]]]
) -> tuple[Array, Array]:
    """Rows (k, nv) that make the given components of the links' velocities, and those (k,)."""
    rows, given = [np.zeros((0, dynamics.system.nv))], list[float]()
    for name, values in links:
        moved = frame_jacobian(dynamics, y, dynamics.system.expansion.frames[name])[:3]
        kept = [k for k, value in enumerate(values) if value is not None]
        rows.append(moved[kept])
        given += [float(x) for x in values if x is not None]
    return np.vstack(rows), np.array(given)
