"""A system as the flat tables of the compiled kernel; whatever it does not cover is named here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray, distinct
from pinflex.bodies.track import Series, Track
from pinflex.kernel.evaluate import Tables
from pinflex.kernel.library import constant
from pinflex.mechanics.closure import Closures, Contact, CoupledRows
from pinflex.mechanics.manifold import axis_of
from pinflex.mechanics.model.loads import DISTANCE, SLEEVE, Expansion, Loads
from pinflex.mechanics.model.strain import square_tables, strain_tables

if TYPE_CHECKING:
    from pinflex.mechanics.model.system import System

# Sleeves on beams as the flat tables of the compiled kernel.

_SORTS = ("hold", "right", "left", "pivot", "tilt", "chord", "twist")  # as in sleeve_rows.c
_ACROSS = {"v": 1, "w": 2}
_SHEAR = 6  # row of the shear strain in v at the far end; that in w comes next


def sleeve_tables(closed: Closures, node_of: IntArray) -> dict[str, Any]:
    """Tables of the sleeves among the closures."""
    loops, contacts = len(closed.names), closed.contacts
    each = [one.sleeve for one in contacts]
    on_b = [loops + one.loop for one in contacts]
    stretches = [_stretches(one, closed) for one in contacts]
    flat = [stretch for of in stretches for stretch in of]
    tracks = list({id(track): track for *_, track in flat}.values())
    number = {id(track): k for k, track in enumerate(tracks)}
    sorts = [sort for sleeve in each for sort in sleeve.sorts]
    return {
        "sleeve_node": node_of[closed.bodies[on_b]],
        "sleeve_loop": [one.loop for one in contacts],
        "sleeve_passes": [len(sleeve.segments) > 0 for sleeve in each],
        "sleeve_at": _starts([len(one.rows) for one in contacts]),
        "sleeve_row": np.concatenate([one.rows for one in contacts]),
        "sleeve_sort": [_SORTS.index(sort) for sort, _ in sorts],
        "sleeve_axis": [_ACROSS[direction] for _, direction in sorts],
        "sleeve_frame": closed.local[on_b],
        "sleeve_half": [sleeve.half for sleeve in each],
        "stretch_at": _starts([len(of) for of in stretches]),
        "stretch_node": [node_of[joint] for joint, *_ in flat],
        "stretch_frame": [frame for _, frame, *_ in flat],
        "stretch_eta": [eta for _, _, eta, *_ in flat],
        "stretch_from": [start for _, _, _, start, _ in flat],
        "stretch_length": [track.length for *_, track in flat],
        "stretch_track": [number[id(track)] for *_, track in flat],
        **_tracks(tracks),
    }


def _stretches(contact: Contact, closed: Closures) -> list[tuple[int, Array, int, float, Track]]:
    """Joint, frame, first coordinate, start (m) and track of the pieces of a sleeve's beam."""
    sleeve, loop = contact.sleeve, contact.loop
    if sleeve.segments:
        each = ((one, one.root) for one in sleeve.segments)
        return [
            (root.joint, root.placement.homogeneous[:3], one.eta.start, one.offset, one.track)
            for one, root in each
        ]
    straight = Series(np.array([0.0, sleeve.length]), np.zeros((1, 1, 0)))
    none = np.zeros(0, dtype=np.intp)
    track = sleeve.track or Track(0, sleeve.length, straight, none, none, none, np.zeros((2, 0)))
    return [(int(closed.bodies[loop]), closed.local[loop], sleeve.eta.start, 0.0, track)]


def _tracks(tracks: list[Track]) -> dict[str, Any]:
    """Their entries, Phi, then G with half its diagonal, then shear, and what these are made of."""
    made = [_entries(track) for track in tracks]
    breaks = [track.series.breaks for track in tracks]
    names = ("entry_row", "entry_i", "entry_j", "power")
    return {
        "track_n": [track.n for track in tracks],
        "track_degrees": [track.series.powers.shape[1] for track in tracks],
        "entry_at": _starts([len(of[0]) for of in made]),
        "piece_at": _starts([len(x) - 1 for x in breaks]),
        "power_at": _starts([of[3].size for of in made]),
        "piece_start": np.concatenate([x[:-1] for x in breaks]),
        "piece_half": np.concatenate([0.5 * np.diff(x) for x in breaks]),
        **{name: np.concatenate([of[k].ravel() for of in made]) for k, name in enumerate(names)},
    }


def _entries(track: Track) -> tuple[Array, ...]:
    shear = np.argwhere(track.shear)
    powers = track.series.powers * np.where(track.i == track.j, 0.5, 1.0)
    constant = np.zeros((*powers.shape[:2], len(shear)))
    constant[:, 0] = track.shear[tuple(shear.T)]
    return (
        np.append(track.row, _SHEAR + shear[:, 0]),
        np.append(track.i, shear[:, 1]),
        np.append(track.j, np.full(len(shear), -1)),
        np.concatenate([powers, constant], axis=2),
    )


def _starts(lengths: Sequence[int] | IntArray) -> IntArray:
    return np.append(0, np.cumsum(lengths, dtype=np.intp))


REVOLUTE, CIRCLE, SLIDE, TRANSLATION, BALL, FREE, PLANAR = range(7)
_LANES = constant("LANES")
_KINDS = {
    **dict.fromkeys(("RX", "RY", "RZ", "RevoluteUnaligned"), REVOLUTE),
    **dict.fromkeys(("RUBX", "RUBY", "RUBZ", "RevoluteUnboundedUnaligned"), CIRCLE),
    **dict.fromkeys(("PX", "PY", "PZ", "PrismaticUnaligned"), SLIDE),
    "Translation": TRANSLATION, "Spherical": BALL, "FreeFlyer": FREE, "Planar": PLANAR,
}  # fmt: skip
_PREFIX = "JointModel"


def uncovered(system: System) -> str | None:
    """What of a system the kernel does not cover; None: it covers the system."""
    if np.any(system.closed.sorts > SLEEVE):
        return "closure row of another sort"
    for joint in system.expansion.model.joints.tolist()[1:]:
        name = joint.shortname().removeprefix(_PREFIX)
        if name not in _KINDS:
            return f"joint of Pinocchio's kind {name}"
    return None


def node_of_joints(system: System) -> IntArray:
    """Node of each joint of the expanded model in the kernel's tree; -1: it is none."""
    nodes, *_ = system.sorted_joints
    node_of = np.full(int(system.expansion.model.njoints), -1)
    node_of[nodes] = np.arange(len(nodes))
    return node_of


def sorted_joints(system: System) -> tuple[list[int], list[int], list[int]]:
    """Joints that are nodes of the tree, mass points at its leaves, and twists there."""
    used = system.closed.joints | system.loads.joints
    used |= {int(joint) for joint in system.added.joints} | set(system.looked_at)
    model = system.expansion.model
    nodes, points, twists, armature = [], [], [], model.armature
    # as lists: each element of Pinocchio's vectors takes a microsecond
    joints, inertias, parents = (x.tolist() for x in (model.joints, model.inertias, model.parents))
    carrying, rows, counts = {*parents[1:]}, model.idx_vs.tolist(), model.nvs.tolist()
    for j in range(1, int(model.njoints)):
        if j in carrying or j in used:
            nodes.append(j)
            continue
        name, inertia = joints[j].shortname().removeprefix(_PREFIX), inertias[j]
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia.inertia.tolist()
        rest = xy, xz, yy, yz, zz
        light = not armature[rows[j] : rows[j] + counts[j]].any()
        if name == "Translation" and light and not any((xx, *rest, *inertia.lever.tolist())):
            points.append(j)
        elif name == "RX" and light and not any((inertia.mass, *rest)):
            twists.append(j)
        else:
            nodes.append(j)
    return nodes, points, twists


def tables(system: System) -> Tables:
    """Tables of a covered system."""
    model, expansion, closed = system.expansion.model, system.expansion, system.closed
    (nodes, points, twists), node_of = system.sorted_joints, system.node_of_joints
    nv_rigid = int(system.rigid.nv)
    arrays: dict[str, Any] = {
        "q_at": expansion.q_at, "v_at": expansion.v_at, "gravity": model.gravity.linear,
        "armature": model.armature,
        **_nodes(model, nodes, node_of), **_points(model, points, node_of),
        **_twists(model, twists, node_of), **_masses(model, nodes, points, twists),
        **_map(expansion), **_blocks(expansion, nodes),
        **_loops(closed, node_of), **strain_tables(system), **_beside(system, node_of),
        **_sparse(system.K[nv_rigid:, nv_rigid:], "k"), **_sparse(system.D, "d"),
    }  # fmt: skip
    arrays |= _chain(system, arrays)
    dampers = sum(spring.damper != 0.0 for spring, _, _ in system.loads.springs)
    sizes = {"nq": system.nq, "nv": system.nv, "nQ": int(model.nq)}
    return Tables(sizes | {"closures": closed.n, "dampers": dampers}, arrays)


def weighed(known: Tables, system: System) -> Tables:
    """Tables of a system on the joints of another, whose tables are known, with its own numbers."""
    nodes, points, twists = system.sorted_joints
    n = int(system.rigid.nv)
    entries = _sparse(system.K[n:, n:], "k") | _sparse(system.D, "d")
    numbers = {name: entries.pop(name) for name in ("k", "d")}
    if not all(np.array_equal(known.arrays[name], at) for name, at in entries.items()):
        return tables(system)
    model = system.expansion.model
    numbers |= _masses(model, nodes, points, twists) | {"armature": model.armature}
    numbers |= {"rest": strain_tables(system)["rest"]}
    return Tables(known.counts, known.arrays | numbers)


def _beside(system: System, node_of: IntArray) -> dict[str, Any]:
    """Tables of what many systems have none of."""
    loads, closed, added, found = system.loads, system.closed, system.added, dict[str, Any]()
    if closed.contacts:
        found |= sleeve_tables(closed, node_of)
    if len(closed.coupled.rows):
        found |= _couplings(closed.coupled, system.expansion.model)
    if added.joints:
        forces, clocks = [force for force, _ in loads.forces], added.clocks
        of = (forces.index(clocks[k]) if k in clocks else -1 for k in range(len(added.joints)))
        found |= {
            "added_node": node_of[list(added.joints)], "added_inertia": added.inertia,
            "added_force": [*of],
        }  # fmt: skip
    if loads.present:
        found |= _loads(loads, node_of)
    if len(system.springs.v_at):
        found |= _joint_springs(system)
    if system.friction.present:
        found |= system.friction.tables()
    if system.kinks.rows or loads.springs:
        found |= system.kinks.tables(len(loads.springs))
    return found


def _kind(joint: Any) -> tuple[int, Sequence[float]]:
    """Kind of a joint, and its axis, where it has one."""
    kind = _KINDS[joint.shortname().removeprefix(_PREFIX)]
    if kind not in (REVOLUTE, CIRCLE, SLIDE):
        return kind, (0.0, 0.0, 0.0)
    return kind, axis_of(joint).tolist()


def _about(kind: tuple[int, Sequence[float]], R0: Array, p0: Array) -> int:
    """The axis of the node before, about which a joint turns at its origin; -1: none."""
    turns = kind[0] in (REVOLUTE, CIRCLE) and list(kind[1]).count(0.0) == 2 and max(kind[1]) == 1.0
    plain = turns and not p0.any() and np.array_equal(R0, np.eye(3))
    return list(kind[1]).index(1.0) if plain else -1


def _rows_of(model: pin.Model, joints: list[int], prefix: str) -> dict[str, Any]:
    return {
        f"{prefix}_q": np.array(model.idx_qs.tolist())[joints],
        f"{prefix}_v": np.array(model.idx_vs.tolist())[joints],
    }


def _nodes(model: pin.Model, joints: list[int], node_of: IntArray) -> dict[str, Any]:
    every = model.joints.tolist(), model.jointPlacements.tolist()
    own, places = ([of[j] for j in joints] for of in every)
    kinds = [_kind(joint) for joint in own]
    R0, p0 = ([getattr(place, x) for place in places] for x in ("rotation", "translation"))
    return {
        "parent": node_of[model.parents.tolist()][joints],
        "kind": [kind for kind, _ in kinds],
        "axis": [axis for _, axis in kinds],
        "about": [_about(*of) for of in zip(kinds, R0, p0, strict=True)],
        "R0": R0,
        "p0": p0,
        **_rows_of(model, joints, "node"),
    }


def _masses(
    model: pin.Model, nodes: list[int], points: list[int], twists: list[int]
) -> dict[str, Any]:
    every = model.inertias.tolist()
    bodies = [every[j] for j in nodes]
    return {
        "mass": [body.mass for body in bodies],
        "com": [body.lever for body in bodies],
        "inertia": [body.inertia for body in bodies],
        "point_mass": [every[j].mass for j in points],
        "twist_inertia": [every[j].inertia[0, 0] for j in twists],
    }


def _points(model: pin.Model, joints: list[int], node_of: IntArray) -> dict[str, Any]:
    places = model.jointPlacements.tolist()
    return {
        "point_node": node_of[model.parents.tolist()][joints],
        "point_R": [places[j].rotation for j in joints],
        "point_p": [places[j].translation for j in joints],
        **_rows_of(model, joints, "point"),
    }


def _twists(model: pin.Model, joints: list[int], node_of: IntArray) -> dict[str, Any]:
    places = model.jointPlacements.tolist()
    return {
        "twist_node": node_of[model.parents.tolist()][joints],
        "twist_axis": [places[j].rotation[:, 0] for j in joints],
        **_rows_of(model, joints, "twist"),
    }


def _map(expansion: Expansion) -> dict[str, Any]:
    """Phi and the upper triangles of G, row by row; their diagonal is halved."""
    rows: dict[str, list[Any]] = {"row_q": [], "row_v": [], "phi": [], "phi_i": []}
    rows |= {"phi_n": [], "g": [], "g_i": [], "g_j": [], "g_n": []}  # n: entries of each row
    for block in expansion.blocks:
        count, first = len(block.rows), block.eta.start
        rows["row_q"].append(block.q_rows)
        rows["row_v"].append(block.rows)
        r, i = np.nonzero(block.Phi)
        rows["phi"].append(block.Phi[r, i])
        rows["phi_i"].append(first + i)
        rows["phi_n"].append(np.bincount(r, minlength=count))
        r, i, j = np.nonzero(np.triu(block.G))
        rows["g"].append(np.where(i == j, 0.5, 1.0) * block.G[r, i, j])
        rows["g_i"].append(first + i)
        rows["g_j"].append(first + j)
        rows["g_n"].append(np.bincount(r, minlength=count))
    whole = {name: np.concatenate([np.zeros(0), *parts]) for name, parts in rows.items()}
    for name in ("phi", "g"):
        counts = whole.pop(f"{name}_n").astype(np.intp)
        whole[f"{name}_at"] = np.concatenate([[0], np.cumsum(counts)])
    return whole | square_tables(expansion, whole["g_at"])


def _blocks(expansion: Expansion, nodes: list[int]) -> dict[str, Any]:
    """Columns that the rows of a joint depend on, block by block, and the blocks on its path.

    The joints of a link depend on the coordinates of that link, which follow each other, and bodies
    beyond it on the link as a whole: of a body, the blocks on the way to it stand in a row.
    """
    model, nv = expansion.model, len(expansion.v_at)
    first = np.zeros(int(model.nv), dtype=np.intp)  # column of each row of X
    first[expansion.v_at] = np.arange(nv)
    for block in expansion.blocks:
        first[block.rows] = nv + block.eta.start
    at = zip(model.idx_vs.tolist(), model.nvs.tolist(), strict=True)
    rows = [slice(row, row + count) for row, count in at][1:]
    starts = distinct([first[at].min() for at in rows])
    ends = np.append(starts[1:], nv + expansion.n_eta)
    of = np.searchsorted(starts, first, side="right") - 1
    lanes = -(-(ends - starts) // _LANES)
    above, depth = np.full(len(starts), -1), np.zeros(len(starts), dtype=np.intp)
    path = np.full(int(model.njoints), -1)  # the last block on the way to each joint
    parents = model.parents.tolist()
    for j, at_joint in enumerate(rows, start=1):
        before = path[parents[j]]
        path[j] = last = of[at_joint.start]
        if before not in (last, above[last]):
            above[last] = before
            depth[last] = depth[before] + ends[before] - starts[before]
    return {
        "x_at": np.append(0, np.cumsum(_LANES * lanes[of])),
        "block_of": of, "block_at": np.append(starts, ends[-1]), "block_above": above,
        "block_depth": depth, "node_block": path[nodes],
    }  # fmt: skip


_LONG = 40.0  # coordinates before a block, from which elimination block by block pays


def _chain(system: System, arrays: dict[str, Any]) -> dict[str, Any]:
    """Numbers that each block has in a tree which is eliminated block by block (`chain.c`).

    None of them where blocks see each other by more than their path, or where paths are short.
    """
    of, above, depth = (arrays[f"block_{name}"] for name in ("at", "above", "depth"))
    n, loads, closed = np.diff(of).astype(np.intp), system.loads, system.closed
    order, none = np.argsort(depth, kind="stable"), np.zeros(len(n) + 1, dtype=np.intp)
    block = np.repeat(np.arange(len(n)), n)
    at = np.append(0, np.cumsum(n**2 + 15 * n + 69))  # see `Block` in chain.c
    crossed = closed.n or loads.present or system.added.joints or system.kinks.rows
    # Room of the factors, and `chain_room`.
    small = at[-1] + 4 * system.nv > system.n_eta**2
    if (
        crossed
        or small
        or depth @ n < _LONG * system.nv
        or any(np.any(block[i] != block[j]) for i, j in map(np.nonzero, (system.D, system.K)))
    ):
        return {"block_order": order, "joined_at": none, "chain_at": none}
    joined = np.append(0, np.cumsum(21 * (n + np.where(above < 0, 0, n[above]))))
    return {"block_order": order, "joined_at": joined, "chain_at": at}


def _sparse(matrix: Array, name: str) -> dict[str, Any]:
    """The entries of a matrix row by row."""
    i, j = np.nonzero(matrix)
    at = np.concatenate([[0], np.cumsum(np.bincount(i, minlength=len(matrix)))])
    return {f"{name}_at": at, f"{name}_j": j, name: matrix[i, j]}


def _loops(closed: Closures, node_of: IntArray) -> dict[str, Any]:
    """Frames and rows of the loops, the rows of one loop side by side."""
    loops = len(closed.names)
    rows = np.flatnonzero(closed.sorts <= DISTANCE)
    rows = rows[np.lexsort((closed.sorts[rows], closed.loop_of[rows]))]
    return {
        "node_a": node_of[closed.bodies[:loops]], "node_b": node_of[closed.bodies[loops:]],
        "frame_a": closed.local[:loops], "frame_b": closed.local[loops:],
        "loop_at": _starts(np.bincount(closed.loop_of[rows], minlength=loops)),
        "row_kind": closed.sorts[rows], "row_number": rows, "row_a": closed.a[rows],
        "row_b": closed.b[rows], "row_length": closed.lengths[rows],
    }  # fmt: skip


def _couplings(coupled: CoupledRows, model: pin.Model) -> dict[str, Any]:
    """Joints of each coupling, with their factors."""
    v_of = dict(zip(model.idx_qs.tolist(), model.idx_vs.tolist(), strict=True))
    entries = _sparse(coupled.A, "couple")
    at = coupled.at[entries["couple_j"]]
    return {
        "couple_row": coupled.rows, "couple_at": entries["couple_at"], "couple_q": at,
        "couple_v": [v_of[int(q)] for q in at], "couple_factor": entries["couple"],
        "couple_offset": coupled.offset,
    }  # fmt: skip


def _loads(loads: Loads, node_of: IntArray) -> dict[str, Any]:
    turned = []
    for force, place in loads.forces:
        R = place.placement.rotation if force.follower else np.eye(3)
        turned.append(np.concatenate([R @ np.array(force.force), R @ np.array(force.moment)]))
    return {
        "force_node": [node_of[place.joint] for _, place in loads.forces],
        "force_follows": [force.follower for force, _ in loads.forces],
        "force_works": [not force.potential for force, _ in loads.forces],
        "force_place": [place.placement.translation for _, place in loads.forces],
        "force_load": turned,
        "spring_a": [node_of[a.joint] for _, a, _ in loads.springs],
        "spring_b": [node_of[b.joint] for _, _, b in loads.springs],
        "spring_place_a": [a.placement.translation for _, a, _ in loads.springs],
        "spring_place_b": [b.placement.translation for _, _, b in loads.springs],
        "spring_law": [(s.stiffness, s.damper, s.length) for s, _, _ in loads.springs],
        "touch_a": [node_of[one.a.joint] for one in loads.touches],
        "touch_b": [node_of[one.b.joint] for one in loads.touches],
        "touch_shape": [one.shape for one in loads.touches],
        "touch_kink": [one.law for one in loads.touches],
        "touch_place_a": [one.a.placement.translation for one in loads.touches],
        "touch_place_b": [one.b.placement.translation for one in loads.touches],
        "touch_axis": [one.axis for one in loads.touches],
        "touch_law": [
            (x.gap, x.friction, x.speed, x.radius, x.excess, x.stribeck) for x in loads.touches
        ],
    }


def _joint_springs(system: System) -> dict[str, Any]:
    s = system.springs
    return {
        "joint_spring_v": s.v_at, "joint_spring_q": s.q_at, "joint_spring_paired": s.paired,
        "joint_spring_law": np.column_stack([s.stiffness, s.rest]),
    }  # fmt: skip
