"""Which deformations matter: `auto` is decided by what a deformation does in linear statics.

All that a scene may excite is first on. At home, its motors locked, that model bears a unit force
and moment at the platform along each axis of the base, its own weight and loads, a pull of each
spring between frames, the inertia forces of each motor's unit acceleration, and those of the
nominal motion at a few instants (as they are at home).
With linear elasticity the share of a deformation in the energy of a case is d ln C / d ln (1/k),
how much of the compliance C it makes; between two cases, as the platform's wrench and the weight,
the mutual energy is its part of the sag, and with a unit move of a motor its part of the holding
torque. What makes together less than `NEGLIGIBLE` of each of these is left out. Bending has to be
as small under the weight of the links in any direction too: a rod between two balls bends by
nothing else.

A truss determines the forces in its members, so that these shares are exact there.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array
from pinflex.description.description import Description
from pinflex.description.motions.motion import Motion, from_spec
from pinflex.errors import PinflexError
from pinflex.linalg import null_space
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import Frame, frame_pose
from pinflex.mechanics.model.loads import Attachment
from pinflex.mechanics.model.parts import FlexiblePart
from pinflex.mechanics.model.planes import LeftOut, undecided
from pinflex.mechanics.model.tree import Link
from pinflex.mechanics.reference.evaluator import falling

if TYPE_CHECKING:
    from pinflex.mechanics.model.system import System

NEGLIGIBLE = 1e-3
_HELD = 1e-9  # of the stretch of a single beam: a compliance below is round-off
_NO_LOAD = 1e-20  # of the squared load, its elastic rows scaled to unit stiffness: round-off
_LOOSE = 1e-11  # of the largest scaled stiffness: free to move, and held
_AXES = ("along x", "along y", "along z", "about x", "about y", "about z")
_BENDING = ("v", "w")
_INSTANTS = 4
Key = tuple[str, str]  # link, direction


def left_out(
    description: Description,
    links: Sequence[Link],
    parts: Mapping[str, FlexiblePart],
    system: System,
    home: Array,
    given: Sequence[str] = (),
) -> dict[str, tuple[LeftOut, ...]]:
    """What `auto` leaves out, by link."""
    cases = shares(description, links, parts, system, home)
    groups: dict[object, list[FlexiblePart]] = {}
    for name, part in parts.items():
        if name not in given:  # equal links stay equal, wherever they are and whatever their names
            like = replace(part.spec, link="", start=None, end=None)
            groups.setdefault((f"{part.length:.9g}", like), []).append(part)
    doubtful: list[tuple[Array, object, str]] = []
    every = {key: k for k, key in enumerate({key for case in cases.values() for key in case})}
    share = np.zeros((len(cases), len(every) + 1))  # a column of zeros for what no case has
    for row, case in zip(share, cases.values(), strict=True):
        row[[every[key] for key in case]] = [*case.values()]
    for group, equal in groups.items():
        for d in undecided(equal[0].spec, equal[0].planes):
            columns = [every.get((p.link, d), -1) for p in equal]
            doubtful.append((share[:, columns].sum(axis=1), group, d))
    spent, out = np.zeros(len(cases)), dict[object, list[str]]()
    for cost, group, d in sorted(doubtful, key=lambda x: float(np.max(x[0], initial=0.0))):
        already = out.setdefault(group, [])
        # a link that is described deforms somehow
        last = len(already) + 1 == len(groups[group][0].planes)
        if not last and np.all(spent + cost < NEGLIGIBLE):
            spent += cost
            already.append(d)
    return {
        part.link: tuple(_worst(cases, part.link, d) for d in "uvwp" if d in out.get(group, ()))
        for group, equal in groups.items()
        for part in equal
    }


def _worst(cases: Mapping[str, Mapping[Key, float]], link: str, direction: str) -> LeftOut:
    """The largest share of a deformation, and of what."""
    every = [(float(case.get((link, direction), 0.0)), of) for of, case in cases.items()]
    return LeftOut(direction, *max(every, default=(0.0, "")))


def shares(
    description: Description,
    links: Sequence[Link],
    parts: Mapping[str, FlexiblePart],
    system: System,
    home: Array,
) -> dict[str, dict[Key, float]]:
    """Shares of each deformation in compliance, sag, holding torques and inertia loads, by case."""
    look, base = _Look(system, home), base_axes(links, parts)
    found: dict[str, dict[Key, float]] = {}
    stretch = min(p.length / (p.spec.material.E * p.spec.section.A) for p in parts.values())
    reach = sum(p.length for p in parts.values())
    floor = _HELD * stretch * np.array([1.0] * 3 + [1.0 / reach**2] * 3)
    rest, load_cases = look.at_rest(), list(_load_cases(description, look, base))
    weight = look.solve(rest[:, None])[:, 0]
    loaded = look.energy(weight) > _NO_LOAD * look.size(rest)
    for name, place in _frames(description, links, system):
        x = look.solve((np.kron(np.eye(2), base.T) @ look.jacobian(place)).T)
        C = np.einsum("ij,ik,kj->j", x, look.K, x)
        for k in np.flatnonzero(floor < C):
            found[f"compliance of {name} {_AXES[k]}"] = _of(look.mutual(x[:, k], x[:, k]), C[k])
        if loaded:
            for rows, words in ((slice(0, 3), "sag of"), (slice(3, 6), "turn at rest of")):
                sag = _sag(look, x[:, rows], weight)
                if sag:
                    found[f"{words} {name}"] = sag
    if loaded:
        load_cases.append(("load at rest", rest, ""))
        found |= _torques(description, look, rest, weight)
    for words, force, directions in load_cases:
        x = look.solve(force[:, None])[:, 0]
        total = look.energy(x)
        if total > _NO_LOAD * look.size(force):
            every = _of(look.mutual(x, x), total)
            found[words] = {k: v for k, v in every.items() if not directions or k[1] in directions}
    return found


class _Look:
    """A system at home in linear statics, motors locked; what is free to move is held."""

    def __init__(self, system: System, home: Array) -> None:
        self.dynamics = dynamics = Equations(system)
        self.system, self.n = system, int(system.rigid.nv)
        self.y = np.concatenate([home, np.zeros(system.n_eta)])
        self.at, self.K = dynamics.kinematics(self.y), dynamics.structural_stiffness(self.y)
        self.J = dynamics.close(self.y).J
        # Rows of unit stiffness: stretch is 1e6 times stiffer than bending.
        self.scale = np.ones(system.nv)
        stiff = np.flatnonzero(np.diag(self.K)[self.n :] > 0) + self.n
        self.scale[stiff] = 1.0 / np.sqrt(np.diag(self.K)[stiff])
        s, free = self.scale[system.free], system.free
        self._Z = s[:, None] * null_space(self.J[:, free] * s)
        every = [
            ((slot.link, direction), slot.eta.start + at.start, slot.eta.start + at.stop)
            for slot in system.expansion.slots
            for direction, at in slot.body.slices.items()
            if at.stop > at.start
        ]
        self._keys, self._starts = [key for key, _, _ in every], [first for _, first, _ in every]
        # stiffness of each deformation by itself, of elastic rows
        self._apart = np.zeros((system.n_eta, system.n_eta))
        for _, first, last in every:
            at = slice(self.n + first, self.n + last)
            self._apart[first:last, first:last] = self.K[at, at]
        w, V = np.linalg.eigh(self._Z.T @ self.K[np.ix_(free, free)] @ self._Z)
        firm = w > _LOOSE * max(float(w[-1]), 0.0) if len(w) else np.zeros(0, bool)
        self._V = self._Z @ V[:, firm] / np.sqrt(w[firm])

    def solve(self, force: Array) -> Array:
        """Displacements under generalised forces, both of shape (nv, cases)."""
        x = np.zeros_like(force)
        free = self.system.free
        x[free] = self._V @ (self._V.T @ force[free])
        return x

    def imposed(self, row: int) -> Array:
        """Displacement when one coordinate moves by one and the other motors stay, shape (nv,)."""
        x, free = np.zeros(self.system.nv), self.system.free
        x[row] = 1.0
        if len(self.J):
            s = self.scale[free]
            x[free] = s * np.linalg.lstsq(self.J[:, free] * s, -self.J[:, row], rcond=1e-10)[0]
        return np.asarray(x + self.solve(-(self.K @ x)[:, None])[:, 0])

    def energy(self, x: Array) -> float:
        """Twice the elastic energy."""
        return float(x @ self.K @ x)

    def size(self, force: Array) -> float:
        """Squared size of a load, elastic rows scaled to unit stiffness."""
        return float(np.sum((self.scale * force) ** 2))

    def mutual(self, one: Array, other: Array) -> dict[Key, float]:
        """What each deformation has in one' K other."""
        found: dict[Key, float] = {}
        if not self._keys:
            return found
        parts = np.add.reduceat(one[self.n :] * (self._apart @ other[self.n :]), self._starts)
        for key, part in zip(self._keys, parts.tolist(), strict=True):
            found[key] = found.get(key, 0.0) + part
        return found

    def jacobian(self, place: Attachment) -> Array:
        """Of a frame's origin and its rotation, world axes, shape (6, nv)."""
        found: Array = Frame(self.dynamics.model, place).jacobian(self.at)[0]
        return found

    def at_rest(self) -> Array:
        """Generalised forces of gravity, loads and tensioned springs, shape (nv,)."""
        return self.moving(np.zeros(self.system.nv))

    def moving(self, v: Array) -> Array:
        """The same, with the inertia forces of speeds v (dampers left out)."""
        no_lam, still = np.zeros(self.system.closed.n), np.zeros(self.system.nv)
        r, _ = self.dynamics.residual(self.y, v, still, no_lam, 0.0)
        return np.asarray(self.system.D @ v - r)

    def falling(self) -> Array:
        """Generalised forces of a unit gravity along x, y and z, shape (nv, 3)."""
        pulled = falling(self.dynamics.model, self.at.poses[0], self.at.J[0])
        return self.at.here.times_map(pulled).T


def _frames(
    description: Description, links: Sequence[Link], system: System
) -> Iterator[tuple[str, Attachment]]:
    """The platform; without one the frames to report; without those the ends of the tree."""
    names: Sequence[str] = tuple(description.frames)
    if description.platform is not None:
        names = (description.platform,)
    if not names:
        above = {link.parent for link in links}
        names = tuple(link.name for k, link in enumerate(links) if k not in above)
    for name in names:
        if name in system.expansion.frames:
            yield name, system.expansion.frames[name]


def _load_cases(
    description: Description, look: _Look, base: Array
) -> Iterator[tuple[str, Array, str]]:
    """Words, generalised forces and the directions that they are to judge ("": all)."""
    system, n = look.system, look.n
    for force, place in system.loads.forces:
        if force.timed:
            W = np.concatenate([force.force, force.moment])
            J = look.jacobian(place)
            if force.follower:
                pose = frame_pose(look.dynamics, look.y, place)
                W = np.kron(np.eye(2), pose.rotation) @ W
            yield f"load {force.name}", J.T @ W, ""
    for spring, *ends in system.loads.springs:
        # of unit tension: it may come under load later, and a damper as soon as it moves
        there, here = (frame_pose(look.dynamics, look.y, place).translation for place in ends)
        far, near = (look.jacobian(place)[:3] for place in ends)
        yield f"pull of spring {spring.name}", (here - there) @ (far - near), ""
    carried = 0.0 if description.payload is None else description.payload.start
    M, J = look.dynamics.mass(look.y, carried)[:, :n], look.J[:, :n]
    unit = np.eye(n)[system.motors]
    each = _follow(J, unit, np.eye(len(unit)))
    for k in range(len(unit)):
        yield f"acceleration of {_motor(description, k)}", -M @ each[:, k], ""
    yield from _nominal_cases(description, look, M, J)
    for axis, force in zip("xyz", (look.falling() @ base).T, strict=True):
        yield f"own weight along {axis}", force, "".join(_BENDING)


def base_axes(links: Sequence[Link], flexible: Collection[str]) -> Array:
    """Axes (3, 3) of what the mechanism stands on: a robot that is turned is judged as before."""
    for link in links:
        if link.steps or link.name in flexible:
            break
    number, turn = link.parent, np.eye(3)
    while number >= 0:
        turn, number = links[number].placement.rotation @ turn, links[number].parent
    return turn


def _follow(J: Array, rows: Array, rates: Array) -> Array:
    """Rates of the rigid joints, loops closed, at which `rows` have given rates, (n, cases)."""
    rates = np.concatenate([np.zeros((len(J), rates.shape[1])), rates])
    return np.asarray(np.linalg.lstsq(np.vstack([J, rows]), rates, rcond=1e-10)[0])


def _nominal_cases(
    description: Description, look: _Look, M: Array, J: Array
) -> Iterator[tuple[str, Array, str]]:
    """What the motion asks at a few instants, with its speeds and accelerations put at home."""
    try:
        folder = None if description.path is None else description.path.parent
        motion = from_spec(description.motion, "motion", folder) if description.motion else None
        t = description.solve.until or (motion.duration if motion else 0.0)
        if motion is None or not motion.names or not 0.0 < t < np.inf:
            return
        instants = t * (np.arange(_INSTANTS) + 0.5) / _INSTANTS
        _, speeds, accelerations = motion.evaluate(instants)
        rows = _imposed(description, look, motion)
    except PinflexError:
        return  # a motion that cannot be read says so where it is used
    each = _follow(J, rows, np.concatenate([speeds, accelerations]).T).T
    for t, v, a in zip(instants, each[:_INSTANTS], each[_INSTANTS:], strict=True):
        move = np.zeros(look.system.nv)
        move[: look.n] = v
        yield f"motion at {t:.3g} s", look.moving(move) - M @ a, ""


def _imposed(description: Description, look: _Look, motion: Motion) -> Array:
    """Rows of rigid velocities that a motion names; rz, ry, rx as turns about the world's axes."""
    n = look.n
    if motion.target == "platform":
        place = look.system.expansion.frames[str(description.platform)]
        at = ["x", "y", "z", "rx", "ry", "rz"]
        return look.jacobian(place)[[at.index(name) for name in motion.names], :n]
    model = look.system.rigid
    return np.eye(n)[[model.joints[model.getJointId(name)].idx_v for name in motion.names]]


def _sag(look: _Look, x: Array, weight: Array) -> dict[Key, float]:
    """Of the displacement of a frame under the load at rest.

    Legs may cancel each other by symmetry: then against what they do one by one.
    """
    each = [look.mutual(column, weight) for column in x.T]
    parts = {key: float(np.linalg.norm([e[key] for e in each])) for key in each[0]}
    whole = float(np.linalg.norm(x.T @ look.K @ weight))
    size = max(whole, float(np.linalg.norm(list(parts.values()))))
    return _of(parts, size) if size > 0 else {}


def _torques(
    description: Description, look: _Look, rest: Array, weight: Array
) -> dict[str, dict[Key, float]]:
    """Of the holding torques, against the largest of them."""
    moves = [look.imposed(int(row)) for row in look.system.motors]
    torques = [abs(float(x @ (look.K @ weight - rest))) for x in moves]
    most, found = max(torques, default=0.0), {}
    for k, x in enumerate(moves):
        if most > 0:
            parts = {key: abs(value) for key, value in look.mutual(x, weight).items()}
            found[f"holding torque of {_motor(description, k)}"] = _of(parts, most)
    return found


def _motor(description: Description, k: int) -> str:
    return description.actuated[min(k, len(description.actuated) - 1)]


def _of(parts: Mapping[Key, float], total: float) -> dict[Key, float]:
    return {key: value / total for key, value in parts.items()}
