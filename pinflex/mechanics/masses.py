"""What the model weighs, held against what the scene says: mass, first moment, inertia at home.

The scene's side adds up the links of the description, each at its pose of the rigid tree; nothing
of the expanded model goes into it. A link weighs

- what the URDF says, and its end masses `root` and `tip`, where the URDF's inertia stays;
- its beam or solid and what rides on it, where these take the place of the URDF's inertia, where
  they are given (`bodies`), and where the link is another design than the one built (`as_built`).

A payload is added at its frame. What cannot move, at the root of the ground, is in neither sum.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array
from pinflex.description.description import Description
from pinflex.errors import AssemblyError
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import Frame
from pinflex.mechanics.model.parts import FlexiblePart
from pinflex.mechanics.model.ride import end_riders
from pinflex.mechanics.model.system import System
from pinflex.mechanics.model.tree import Link
from pinflex.mechanics.poses import skew

OFF = 1e-9  # of the largest entry: sums of a thousand stations are right to 1e-13


def require_mass(
    description: Description,
    links: Sequence[Link],
    parts: Mapping[str, FlexiblePart],
    given: Iterable[str],
    rigid: System,
    flexible: System,
    home: Array,
) -> None:
    """Refuse a model that does not weigh what the scene says.

    Raises:
        AssemblyError: An error of pinflex, not of the scene.
    """
    y = np.concatenate([home, np.zeros(flexible.n_eta)])
    poses = Equations(rigid).joint_poses(home)
    said = of_scene(description, links, parts, given, rigid, flexible, poses)
    made = of_model(flexible, poses if flexible is rigid else Equations(flexible).joint_poses(y))
    rotors = _rotors(description, links), float(flexible.expansion.model.armature.sum())
    off = np.abs(made - said).max() / max(np.abs(said).max(), np.finfo(float).tiny)
    turns = abs(rotors[1] - rotors[0]) / max(abs(rotors[0]), np.finfo(float).tiny)
    if max(off, turns) > OFF:  # what is not finite is not judged here
        raise AssemblyError(
            f"{description.name}: internal error: the model made of this scene does not weigh what "
            f"the scene says: {made[0, 0]:.6g} kg for {said[0, 0]:.6g} kg; mass, first moment and "
            f"inertia at home are off by {off:.1e} of the largest of them, rotors by {turns:.1e}. "
            "Nothing computed with it would be right; please report it with the model.",
            made=made,
            said=said,
        )


def of_model(system: System, poses: Array) -> Array:
    """Spatial inertia (6, 6) of a model about the world's origin [kg, kg m, kg m^2]."""
    turn, place = poses[0, :, :9].reshape(-1, 3, 3).swapaxes(1, 2), poses[0, :, 9:]
    own = np.array([inertia.matrix() for inertia in system.expansion.model.inertias])
    own[0] = 0.0
    for joint, more in zip(system.added.joints, system.added.inertia, strict=True):
        own[joint] += more
    return _summed(turn, place, own)


def of_scene(
    description: Description,
    links: Sequence[Link],
    parts: Mapping[str, FlexiblePart],
    given: Iterable[str],
    rigid: System,
    flexible: System,
    poses: Array,
) -> Array:
    """The same of what the scene says: of its links, at their poses in the rigid tree, and of
    the masses added to frames.
    """
    frames = rigid.expansion.frames
    own: list[tuple[str, Array]] = []
    carried = description.payload
    for link in links:
        if carried is not None and link.name == carried.name:
            continue  # the model's; the scene's own is below
        part = parts.get(link.name)
        attachments = [s.expansion.frames.get(link.name) for s in (rigid, flexible)]
        still = all(at is not None and at.joint == 0 for at in attachments)
        if part is not None:
            own.append((link.name, _of_part(link, part, link.name in given, still)))
        elif link.weighs and not still:
            own.append((link.name, link.inertia.matrix()))
    own += [(one.frame, np.diag([*one.mass, *one.inertia])) for one in description.added_masses]
    if carried is not None and any(
        s.expansion.frames[carried.frame].joint for s in (rigid, flexible)
    ):
        own.append((carried.frame, carried.spatial))
    if not own:
        return np.zeros((6, 6))
    placed = [Frame(rigid.rigid, frames[name]).pose(poses) for name, _ in own]
    turn, place = (np.concatenate(values) for values in zip(*placed, strict=True))
    return _summed(turn, place, np.array([inertia for _, inertia in own]))


def _of_part(link: Link, part: FlexiblePart, given: bool, still: bool) -> Array:
    """Spatial inertia (6, 6) of a flexible link in its own frame; `still`: fixed to the ground."""
    if part.share is not None and part.spec.as_built is None and not given:
        own = [link.inertia]
        own += [_on_beam(part, r.x, r.inertia) for r in end_riders(part.spec, part.length)]
    else:
        own = [*part.rigid_inertias()]
    total = sum((inertia.matrix() for inertia in own), np.zeros((6, 6)))
    if still and not part.bodies[0].root_moves:  # what rides on its root cannot move
        at_root = [_on_beam(part, r.x, r.inertia) for r in part.riders if r.x <= 0]
        total -= sum((inertia.matrix() for inertia in at_root), np.zeros((6, 6)))
    return np.asarray(total)


def _on_beam(part: FlexiblePart, x: float, inertia: pin.Inertia) -> pin.Inertia:
    """An inertia on the section at x [m], in the frame of the link."""
    return (part.placement * pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))).act(inertia)


def _summed(turn: Array, place: Array, own: Array) -> Array:
    """Sum of inertias (n, 6, 6), each in axes (n, 3, 3) at a place (n, 3), about the origin."""
    to = np.zeros((len(own), 6, 6))  # twists at the origin to those of the frames
    to[:, :3, :3] = to[:, 3:, 3:] = turn.swapaxes(1, 2)
    to[:, :3, 3:] = -turn.swapaxes(1, 2) @ skew(place)
    return np.asarray((to.swapaxes(1, 2) @ own @ to).sum(axis=0))


def _rotors(description: Description, links: Sequence[Link]) -> float:
    """Sum of the rotors' inertias over the axes of their joints [kg m^2, kg]."""
    axes = {link.joint: sum(step.model.nv for step in link.steps) for link in links}
    return float(sum(e.armature * axes.get(name, 0) for name, e in description.joints.items()))
