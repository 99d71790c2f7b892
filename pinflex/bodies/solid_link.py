"""From the `basis` of a solid link to its flexible body: read, checked for units, reduced."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinflex.arrays import Array, IntArray
from pinflex.bodies import solid as mesh
from pinflex.bodies.basis import FlexibleBody
from pinflex.bodies.solid import Region, Solid, of_matrices, of_mesh
from pinflex.bodies.superelement import reduce
from pinflex.description.blocks.flexible import Basis, FlexibleLink
from pinflex.description.blocks.material import Material
from pinflex.description.section import Section
from pinflex.errors import DescriptionError, nearest

_OFF = 20.0  # a mesh this many times larger or smaller than the span is in another unit
_SOUND = (1e-1, 1e6)  # first frequency times size of a body given by matrices [m/s]


def solid_body(
    spec: FlexibleLink, placement: pin.SE3, length: float, folder: Path, where: str
) -> FlexibleBody:
    """The flexible body of a link whose basis is a mesh, a stepped rod or matrices."""
    place = f"{where}.basis"
    pose = np.column_stack([placement.rotation, placement.translation])
    basis = spec.basis
    stamp = tuple(
        (folder / name).stat().st_mtime_ns if name and (folder / name).is_file() else 0
        for name in (basis.file, basis.mass, basis.stiffness, basis.nodes)
    )
    frame = tuple(map(tuple, np.round(pose, 12).tolist()))  # equal links differ by round-off
    options = spec.second_order, spec.rayleigh, spec.modal_damping
    return _reduced(
        spec.basis, spec.material, frame, round(length, 12), folder, stamp, options, _Where(place)
    )


class _Where(str):
    """The place of a link in the description; all places are equal, as are bodies in them."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Where)

    def __hash__(self) -> int:
        return 0


@lru_cache(maxsize=16)
def _reduced(
    basis: Basis,
    material: Material,
    pose: tuple[tuple[float, ...], ...],
    length: float,
    folder: Path,
    stamp: tuple[int, ...],
    options: tuple[bool, tuple[float, float], float],
    where: _Where,
) -> FlexibleBody:
    """Equal links in equal frames are reduced once; `stamp` notices files that changed."""
    del stamp
    P = np.array(pose)
    if basis.rod:
        solid = of_mesh(_rod(basis, length, where), material, where)
    elif basis.kind == "mesh":
        path = folder / (basis.file or "")
        drawn = mesh.read(path, dict(basis.interfaces), basis.scale, where)
        _right_size(drawn.cells.doflocs.T, length, where)
        moved = P[:, :3].T @ (drawn.cells.doflocs - P[:, 3:])
        cells = type(drawn.cells)(np.ascontiguousarray(moved), drawn.cells.t)
        solid = of_mesh(mesh.Mesh(cells, drawn.element, drawn.regions), material, where)
    else:
        solid = _turned(_matrices(basis, folder, where), P)
        _right_size(solid.nodes, length, where)
    second_order, rayleigh, modal = options
    body = reduce(
        solid, basis.modes, length, second_order=second_order, rayleigh=rayleigh,
        modal_damping=modal, where=where,
    )  # fmt: skip
    if basis.kind == "matrices":
        _plausible(body, solid, where)
    return body


def _rod(basis: Basis, length: float, where: str) -> mesh.Mesh:
    segments = [(d, x if x else length) for d, x in basis.rod]
    total = sum(x for _, x in segments)
    if abs(total - length) > 1e-6 * length:
        raise DescriptionError(
            f"{where}.rod.lengths: they add up to {total:.6g} m, but the link's span is "
            f"{length:.6g} m. Make them agree."
        )
    return mesh.stepped_rod(segments, basis.size, where)


def _right_size(nodes: Array, length: float, where: str) -> None:
    size = float(np.ptp(nodes, axis=0).max())
    if not 1.0 / _OFF < size / length < _OFF:
        guess = next(
            (u for s, u in ((1e-3, "mm"), (2.54e-2, "inch")) if 0.5 < size * s / length < 2.0), ""
        )
        advice = f"It looks like {guess}: " if guess else ""
        raise DescriptionError(
            f"{where}: the body is {size:.4g} m large, but the link's span is {length:.4g} m. "
            f"{advice}Give lengths in m, or for a mesh `scale` (metres per unit of the file).",
            size=size,
        )


def _plausible(body: FlexibleBody, solid: Solid, where: str) -> None:
    assert body.solid is not None
    size = float(np.ptp(solid.nodes, axis=0).max())
    first = float(body.solid.held_frequencies[0])
    if not _SOUND[0] < first * size < _SOUND[1]:
        raise DescriptionError(
            f"{where}: a body of {size:.3g} m and {float(body.mass.sum()):.3g} kg with the first "
            f"frequency {first:.3g} Hz: no solid is so {'slow' if first * size < 1 else 'fast'}. "
            "Give K in N/m, M in kg, nodes in m.",
            frequency=first,
        )


def _turned(solid: Solid, P: Array) -> Solid:
    """The solid in the beam frame, from the link's frame."""
    from scipy.sparse import csc_array, eye_array, kron

    R = P[:, :3]
    nodes = (solid.nodes - P[:, 3]) @ R
    block = csc_array(kron(eye_array(len(nodes)), csc_array(R)))
    return Solid(nodes, csc_array(block.T @ solid.K @ block), solid.mass, solid.regions)


def _matrices(basis: Basis, folder: Path, where: str) -> Solid:
    """M, K, nodes and interfaces from one .npz, or from Matrix Market files and a table."""
    from scipy.io import mmread

    found: dict[str, Any] = {}
    if basis.file:
        text = "not a .npz of arrays ({})."
        found = _loaded(folder / basis.file, f"{where}.file", _npz, text)
    for key, name in (("M", basis.mass), ("K", basis.stiffness)):
        if name:
            text = "not a Matrix Market file ({})."
            found[key] = _loaded(folder / name, f"{where}.{key}", mmread, text)
    if basis.nodes:
        text = "{}. Write x y z [m] per line."
        found["nodes"] = _loaded(folder / basis.nodes, f"{where}.nodes", _table, text)
    for key in ("M", "K", "nodes"):
        if key not in found:
            raise DescriptionError(
                f"{where}: {key} is missing. Add it to {', '.join(found) or 'the block'}."
            )
    nodes = np.atleast_2d(np.asarray(found["nodes"], dtype=np.float64))
    regions: dict[str, IntArray] = {}
    for name, region in basis.interfaces:
        regions[name] = _node_set(found, nodes, region, f"{where}.interfaces.{name}")
    return of_matrices(nodes, found["K"], found["M"], regions, where)


def _node_set(found: Mapping[str, Any], nodes: Array, region: Region, where: str) -> IntArray:
    if isinstance(region, str):
        known = [key for key in found if key not in ("M", "K", "nodes")]
        if region not in known:
            raise DescriptionError(
                f"{where}: the file has no array {region!r} of node numbers."
                f"{nearest(region, known)} Name one, or give a box [x0, y0, z0, x1, y1, z1] in m.",
                name=region,
            )
        numbers = np.unique(np.asarray(found[region]).ravel()).astype(np.intp)
        if len(numbers) and not 0 <= numbers[0] <= numbers[-1] < len(nodes):
            raise DescriptionError(
                f"{where}: node numbers {numbers[0]} to {numbers[-1]}; there are {len(nodes)} "
                "nodes, counted from 0."
            )
    else:
        numbers = mesh.inside(nodes, region)
    return mesh.require_area(nodes, numbers, where)


def _loaded(path: Path, where: str, read: Callable[[Path], Any], text: str) -> Any:
    """What is in a file, or the error that names it and says what is wrong."""
    path = mesh.existing(path, where)
    try:
        return read(path)
    except (OSError, ValueError, EOFError, TypeError) as error:
        raise DescriptionError(f"{where}: {path.name}: {text.format(error)}") from None


def _table(path: Path) -> Array:
    return np.loadtxt(path, delimiter="," if path.suffix == ".csv" else None)


def _npz(path: Path) -> dict[str, Any]:
    """Arrays of a .npz; a sparse matrix A may stand as A_data, A_indices, A_indptr (CSC)."""
    from scipy.sparse import csc_array

    with np.load(path, allow_pickle=False) as data:
        found: dict[str, Any] = {key: data[key] for key in data.files}
    for key in ("M", "K"):
        parts = tuple(f"{key}_{part}" for part in ("data", "indices", "indptr"))
        if all(part in found for part in parts):
            found[key] = csc_array(tuple(found.pop(part) for part in parts))
    return found


def equivalent_section(body: FlexibleBody, density: float | None) -> Section:
    """The round section of a uniform rod with the span and the volume of the body.

    For pictures and the nominal stresses along the span; stresses of the solid are at its nodes.
    """
    volume = float(body.mass.sum()) / (density or 7850.0)
    return Section.circle(2.0 * float(np.sqrt(volume / (np.pi * body.length))))
