"""Forces at the nodes of finite elements: P = M_e a + K_e d - F_e, element by element.

a is the absolute acceleration, rigid and elastic, F_e gravity: the forces, moments and the
generalised forces of the curvature coordinates that the neighbours put on an element.

Source: Liu et al. (2017), eq. 13 and 23. They leave damping out of P; here it is in, so that the
nodes balance, unless `damping=False`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.bodies.basis import FlexibleBody, cut
from pinflex.bodies.family import Family, hermite, quadrature
from pinflex.description.blocks.flexible import FlexibleLink
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.loads import Slot
from pinflex.recovery import links
from pinflex.recovery.kinematics import Samples, joint_poses, pose_of, samples_of
from pinflex.results.result import Result
from pinflex.text import brief

# Entry of a nodal triple, sign, of value, slope and curvature of each bending direction.
_BENDING = {"v": (1, 2, 1.0), "w": (2, 1, -1.0)}


@dataclass(frozen=True)
class NodalForces:
    """What each element of a link receives at its two nodes.

    Attributes:
        t: Times, shape (nt,), s.
        link: Link.
        x: Nodes of every element, shape (ne, 2), m.
        force: Fx, Fy, Fz, shape (nt, ne, 2, 3), N, in the element frame (x along the beam).
        moment: Mx, My, Mz, shape (nt, ne, 2, 3), N m.
        generalised: Conjugate to twist rate, psi_y' and psi_z', shape (nt, ne, 2, 3), N m^2; zero
            for cubic elements.
        rotation: Element frame to world, shape (nt, 3, 3).
    """

    __repr__ = brief

    t: Array
    link: str
    x: Array
    force: Array
    moment: Array
    generalised: Array
    rotation: Array

    def end(self, which: str) -> Array:
        """Force, moment and generalised forces at `root` or `tip` of the link, (nt, 9)."""
        if which not in ("root", "tip"):
            raise DescriptionError(f"end: {which}.{nearest(which, ('root', 'tip'))}")
        at = (0, 0) if which == "root" else (-1, 1)
        parts = (self.force, self.moment, self.generalised)
        return np.hstack([part[:, at[0], at[1]] for part in parts])

    def world(self) -> NodalForces:
        """The same in the world frame; generalised forces turn like the curvature vector."""
        force, moment, generalised = (
            np.einsum("tij,tenj->teni", self.rotation, part)
            for part in (self.force, self.moment, self.generalised)
        )
        return NodalForces(self.t, self.link, self.x, force, moment, generalised, self.rotation)


def nodal_forces(
    mechanism: Mechanism, result: Result, link: str, damping: bool = True
) -> NodalForces:
    """Nodal forces of a link made of finite elements.

    Directions in which the link does not deform follow from the balance of forces.

    Args:
        mechanism: The mechanism that was solved. result: A flexible run.
        link: Flexible link with `basis: {kind: finite_element}`.
        damping: Include the link's own and the system's Rayleigh damping.
    """
    part = mechanism.parts.get(link)
    if part is None:
        raise DescriptionError(
            f"nodal_forces: {link}: not flexible.{nearest(link, mechanism.parts)}"
        )
    spec = part.spec
    if spec.basis.kind != "finite_element" or spec.rotary_inertia or spec.shear:
        raise DescriptionError(
            f"nodal_forces: {link}: needs basis: {{kind: finite_element}} without rotary inertia "
            "or shear. Section forces of any basis are in result.link(name).resultant."
        )
    if any(0 < rider.x < part.length for rider in part.riders):
        raise DescriptionError(
            f"nodal_forces: {link}: part of the URDF's inertia rides between its nodes. Write "
            f"flexible.{link}.inertia: beam. Section forces are in result.link(name).resultant."
        )
    samples = samples_of(mechanism, result)
    run = samples.run
    slots = [s for s in run.system.expansion.slots if s.link == link]
    first = int(run.system.rigid.nv)
    rayleigh = (0.0, 0.0)
    if damping:
        extra = mechanism.description.system_damping if run.path is not None else (0.0, 0.0)
        rayleigh = (spec.rayleigh[0] + extra[0], spec.rayleigh[1] + extra[1])
    pieces = []
    for slot in slots:
        eta = run.y[:, int(run.system.rigid.nq) :][:, slot.eta]
        rate = run.v[:, first:][:, slot.eta]
        pieces.append(_body(samples, slot, spec, eta, rate, rayleigh, part.mass / part.length))
    x, force, moment, generalised = (
        np.concatenate([piece[k] for piece in pieces], axis=0 if k == 0 else 1) for k in range(4)
    )
    if run.linear and run.path is not None:
        frame = mechanism.rigid.expansion.frames[link]
        poses = pose_of(joint_poses(mechanism, run.path), frame)
        rotation = poses[:, :, :3] @ part.placement.rotation
    else:
        rotation = pose_of(samples.kinematics.poses, slots[0].root)[:, :, :3]
    return NodalForces(run.t, link, x, force, moment, generalised, rotation)


def _body(
    samples: Samples,
    slot: Slot,
    spec: FlexibleLink,
    eta: Array,
    rate: Array,
    rayleigh: tuple[float, float],
    rho_A: float,
) -> tuple[Array, Array, Array, Array]:
    """Nodes (ne, 2) and the three kinds of forces, (nt, ne, 2, 3) each, of one body."""
    body, elements = slot.body, spec.basis.elements
    nodes = np.linspace(0.0, body.length, elements + 1)
    x = slot.offset + np.column_stack([nodes[:-1], nodes[1:]])
    force, moment, generalised = _balance(samples, slot, eta, nodes)
    E, G, S = spec.material.E, spec.material.G, spec.section
    stiffness = {"u": E * S.A, "v": E * S.Iz, "w": E * S.Iy, "p": G * S.J}
    for direction, at in body.slices.items():
        p = direction == "p"
        inertia = float(body.It.sum()) / body.length if p else rho_A
        where = body.xt if p else body.x
        rows = slot.twists if p else slot.stations[:, "uvw".index(direction)]
        P = _elements(
            body, spec, direction, samples.forces.g[:, rows], where, eta[:, at], rate[:, at],
            (stiffness[direction], inertia), rayleigh,
        )  # fmt: skip
        if direction in _BENDING:
            line, turn, sign = _BENDING[direction]
            force[:, :, :, line], moment[:, :, :, turn] = P[..., 0], sign * P[..., 1]
            if P.shape[-1] == 3:
                generalised[:, :, :, turn] = sign * P[..., 2]
        elif p:
            moment[:, :, :, 0] = P[..., 0]
            if P.shape[-1] == 2:
                generalised[:, :, :, 0] = P[..., 1]
        else:
            force[:, :, :, 0] = P[..., 0]
    return x, force, moment, generalised


def _balance(samples: Samples, slot: Slot, eta: Array, nodes: Array) -> tuple[Array, Array, Array]:
    """Forces at the nodes from the section forces: for directions without coordinates."""
    body = slot.body
    linear = samples.run.linear
    section = cut(body, len(nodes))
    bent = links.section_deflections(section, eta) * (not linear)
    loads = [(i.x, *samples.interface_load(i)) for i in slot.interfaces]
    needed = links.needed_by_stations(samples, slot)
    R = links.section_resultants(section, body, bent, needed, loads, eta * (not linear))
    # On its inner node an element receives minus what the section passes on, on its outer plus.
    both = np.stack([-R[:, :-1], R[:, 1:]], axis=2)
    return both[..., :3].copy(), both[..., 3:].copy(), np.zeros_like(both[..., :3])


def _elements(
    body: FlexibleBody,
    spec: FlexibleLink,
    direction: str,
    g: Array,
    where: Array,
    eta: Array,
    rate: Array,
    moduli: tuple[float, float],
    rayleigh: tuple[float, float],
) -> Array:
    """Generalised nodal forces of one direction, shape (nt, ne, 2, coordinates of a node).

    Args:
        g: Forces that the stations need, (nt, ns). where: Their x, (ns,).
        eta, rate: Coordinates of the direction with its root held, (nt, n).
        moduli: Stiffness and inertia per length. rayleigh: (alpha, beta).
    """
    elements = spec.basis.elements
    free = hermite(body.length, elements, spec.basis.order, root="free", direction=direction)
    held = free.n - eta.shape[1]
    full, full_rate = (np.hstack([np.zeros((len(z), held)), z]) for z in (eta, rate))
    per_node = free.n // (elements + 1)
    size = body.length / elements
    one = hermite(size, 1, spec.basis.order, root="free", direction=direction)
    K, M = _matrices(one, *moduli)
    alpha, beta = rayleigh
    P = np.empty((len(eta), elements, 2 * per_node))
    for e in range(elements):
        at = slice(e * per_node, (e + 2) * per_node)
        inside = np.flatnonzero((where > e * size) & (where < (e + 1) * size))
        N = one.evaluate(where[inside] - e * size).f
        P[:, e] = g[:, inside] @ N + full[:, at] @ K
        P[:, e] += full_rate[:, at] @ (alpha * M + beta * K)
    return P.reshape(len(eta), elements, 2, per_node)


def _matrices(one: Family, stiffness: float, inertia: float) -> tuple[Array, Array]:
    x, weights = quadrature(one.breaks, one.gauss)
    F, w = one.evaluate(x.ravel()), weights.ravel()[:, None]
    return stiffness * F.curv.T @ (w * F.curv), inertia * F.f.T @ (w * F.f)
