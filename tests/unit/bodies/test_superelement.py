"""Reduced solids against full meshes, closed forms and beams; bad bodies are refused by name.

Claims:
    Machines
    - a rod by mesh: von Mises under pull and torsion; root moments of its weight to either side |
      strength of materials | 0.5 %; 0.1 % | passes
    - clamped block and rod by mesh: kept modes; mass, centre, inertia | full mesh, beam; closed
      form | 0.5 %; 1e-10 | passes
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

pytest.importorskip("skfem")
pytest.importorskip("meshio")

import meshio
import skfem
from scipy.io import mmwrite
from scipy.linalg import eigh
from scipy.sparse import kron
from scipy.sparse.linalg import eigsh

from pinflex.arrays import Array
from pinflex.bodies.basis import FlexibleBody, flexible_body
from pinflex.bodies.solid import Solid, checked, of_matrices, of_mesh, read, stepped_rod
from pinflex.bodies.superelement import _second_rotation, reduce
from pinflex.description.blocks.flexible import Basis, FlexibleLink
from pinflex.description.blocks.material import Material
from pinflex.description.section import Section
from pinflex.errors import DescriptionError
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.recovery import links
from pinflex.studies.checking.parts import modal_data, save, summary
from tests.finite import by_configuration, close, random_state
from tests.scenes import Body, load

STEEL = Material(2.07e11, 2.07e11 / 2.58, 7801.0, 0.29)
L, B, H = 0.2, 0.03, 0.02  # [m] the block
D, SPAN = 0.02, 0.5  # [m] the rod: slender enough for beam theory to 0.2 %
FACES = {"root": "flange", "tip": "end"}


def tetrahedra(n: tuple[int, int, int] = (10, 2, 2)) -> Any:
    axes = (np.linspace(0, L, n[0] + 1), *(np.linspace(-s / 2, s / 2, 3) for s in (B, H)))
    return skfem.MeshTet.init_tensor(*axes)


def write(path: Path, m: Any, points: Array | None = None) -> Path:
    """The block as Gmsh writes it, its ends as the physical surfaces "flange" and "end"."""
    f, x = m.facets.T, m.p[0][m.facets.T]
    ends = [f[np.all(np.abs(x - at) < 1e-12, axis=1)] for at in (0.0, L)]
    tags = [np.repeat([1, 2], [len(e) for e in ends]), np.full(m.t.shape[1], 3)]
    mesh = meshio.Mesh(
        m.p.T if points is None else points,
        [("triangle", np.vstack(ends)), ("tetra", m.t.T)],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={"flange": np.array([1, 2]), "end": np.array([2, 2])},
    )
    meshio.write(path, mesh, file_format="gmsh22", binary=False)
    return path


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Solid:
    path = write(tmp_path_factory.mktemp("block") / "block.msh", tetrahedra())
    return of_mesh(read(path, FACES, 1.0, "block"), STEEL, "block")


@pytest.fixture(scope="module")
def block_body(block: Solid) -> FlexibleBody:
    return reduce(block, 8, L)


@pytest.fixture(scope="module")
def rod() -> FlexibleBody:
    return reduce(of_mesh(stepped_rod([(D, SPAN)], None, "rod"), STEEL, "rod"), 12, SPAN)


def hertz(K: Array, M: Array) -> Array:
    return np.asarray(np.sqrt(eigh(K, M, eigvals_only=True)) / (2 * np.pi))


def tie(solid: Solid) -> Any:
    """Displacements of all nodes from free ones and six of the rigid tip; the root is held."""
    root, tip = solid.regions["root"], solid.regions["tip"]
    nn = len(solid.nodes)
    free = np.setdiff1d(np.arange(nn), np.concatenate([root, tip]))
    T = np.zeros((3 * nn, 6 + 3 * len(free)))
    T[(3 * free[:, None] + np.arange(3)).ravel(), 6:] = np.eye(3 * len(free))
    for i in tip:
        x, y, z = solid.nodes[i] - [L, 0, 0]
        T[3 * i : 3 * i + 3, :6] = [[1, 0, 0, 0, z, -y], [0, 1, 0, -z, 0, x], [0, 0, 1, y, -x, 0]]
    return T


def test_kept_modes_of_a_clamped_block_are_those_of_the_full_mesh(
    block: Solid, block_body: FlexibleBody
) -> None:
    T = tie(block)
    M = kron(block.mass, np.eye(3), format="csc")
    full = eigsh(T.T @ (block.K @ T), 6, T.T @ (M @ T), sigma=0.0, return_eigenvectors=False)
    full = np.sqrt(np.sort(full)) / (2 * np.pi)
    # 0.5 %: the project's limit for kept modes.
    np.testing.assert_allclose(hertz(block_body.K, block_body.M)[:6], full, rtol=5e-3)
    assert np.all(hertz(block_body.K, block_body.M)[:6] > full * (1 - 1e-9))  # Ritz: from above


def test_a_clamped_slender_rod_has_the_frequencies_of_a_beam(rod: FlexibleBody) -> None:
    found = hertz(rod.K, rod.M)
    unit = np.sqrt(STEEL.E * (D / 4) ** 2 / STEEL.rho) / SPAN**2 / (2 * np.pi)
    first = np.array([1.87510407, 1.87510407]) ** 2 * unit
    # 0.5 %: the clamp holds the section's breathing too, which a beam does not feel.
    np.testing.assert_allclose(found[:2], first, rtol=5e-3)
    twist = np.sqrt(STEEL.G / STEEL.rho) / (4 * SPAN)
    stretch = np.sqrt(STEEL.E / STEEL.rho) / (4 * SPAN)
    assert np.min(np.abs(found / twist - 1)) < 5e-3  # 12 modes hold one of torsion
    assert np.min(np.abs(found / stretch - 1)) < 1e-2  # and one of stretch
    # The second mode, against the same rod with rotary inertia and shear (Timoshenko).
    spec = FlexibleLink(
        "rod", STEEL, Section.circle(D), Basis(internal=4), rotary_inertia=True, shear=True
    )
    beam = flexible_body(spec, ("v", "w"), SPAN)
    np.testing.assert_allclose(found[2:4], hertz(beam.K, beam.M)[2:4], rtol=5e-3)


@pytest.mark.parametrize("kind", ["block", "stepped rod"])
def test_mass_centre_and_inertia_are_exact_to_1e_10(kind: str, block_body: FlexibleBody) -> None:
    if kind == "block":
        body, m = block_body, STEEL.rho * L * B * H
        centre = [L / 2, 0, 0]
        inertia = m / 12 * np.array([B**2 + H**2, L**2 + H**2, L**2 + B**2])
    else:
        one, two = (0.02, 0.3), (0.016, 0.04)
        solid = of_mesh(stepped_rod([one, two], None, "rod"), STEEL, "rod")
        body = reduce(solid, 2, 0.34, second_order=False)
        parts = [STEEL.rho * np.pi / 4 * d * d * x for d, x in (one, two)]
        m = sum(parts)
        centre = [(parts[0] * 0.15 + parts[1] * 0.32) / m, 0, 0]
        # Against the mesh itself: quadratic arcs have the area of the circle, and its second
        # moment to 5e-6.
        z = solid.nodes - solid.mass.sum(axis=0) @ solid.nodes / m
        second = z.T @ (solid.mass @ z)
        inertia = np.diag(np.trace(second) * np.eye(3) - second)
    data = modal_data(body)
    assert data["mass"] == pytest.approx(m, rel=1e-10)
    np.testing.assert_allclose(data["centre"], centre, atol=1e-10 * body.length)
    np.testing.assert_allclose(np.diag(data["inertia"]), inertia, rtol=1e-10)
    assert np.abs(data["inertia"] - np.diag(np.diag(data["inertia"]))).max() < 1e-10 * inertia[1]


def test_the_points_carry_every_coupling_of_rigid_and_elastic_motion(
    block: Solid, block_body: FlexibleBody
) -> None:
    body = block_body
    assert body.solid is not None
    assert np.all(body.mass > 0)
    assert len(body.mass) < 4 + 3 * body.n  # the rank of Z, never more
    M = np.einsum("k,kci,kcj->ij", body.mass, body.Phi, body.Phi)
    scale = np.sqrt(np.outer(np.diag(body.M), np.diag(body.M)))
    # What is left out of the elastic part is what the body reports, and small.
    assert np.abs((M - body.M) / scale).max() <= 3 * body.solid.inertia_error + 1e-12
    assert 0 < body.solid.inertia_error < 1e-4
    np.testing.assert_allclose(hertz(body.K, M)[:8], hertz(body.K, body.M)[:8], rtol=1e-4)


def test_shortening_of_a_bent_rod_is_that_of_a_beam(rod: FlexibleBody) -> None:
    assert rod.solid is not None
    G = rod.solid.nodes[0].G
    assert G is not None
    # Hermite end shapes: -int v'^2 dx = -6/(5 L), -2 L/15, and +1/10 between them; a short rod
    # differs by its shear, (d / L)^2.
    v, r = 1, 5
    found = [G[0, v, v] * SPAN, G[0, r, r] / SPAN, G[0, v, r]]
    np.testing.assert_allclose(found, [-6 / 5, -2 / 15, 1 / 10], rtol=2e-2)
    assert abs(G[0, v, 0]) * SPAN < 1e-2  # stretch and bending make no shortening together
    off = reduce(
        of_mesh(stepped_rod([(D, 0.1)], None, "r"), STEEL, "r"), 2, 0.1, second_order=False
    )
    assert off.G is None
    assert not off.second_order


def test_stress_of_a_pulled_and_bent_rod_is_that_of_strength_of_materials(
    rod: FlexibleBody,
) -> None:
    solid = rod.solid
    assert solid is not None
    assert solid.stress is not None
    free = 3 * len(rod.mass)
    A, W = np.pi * D**2 / 4, np.pi * D**3 / 32
    middle = np.abs(solid.corners[:, 0] - SPAN / 2) < 0.1
    # A force the tip needs pulls the other way: signs of "what hangs there needs".
    pull = -solid.stress[middle, 0, free]
    np.testing.assert_allclose(pull, 1 / A, rtol=1e-6)  # St-Venant: away from the rigid ends
    y = solid.corners[middle, 1]
    bend = solid.stress[middle, 0, free + 5]
    # 2 %: a parabola is not quite in the space of curved cells; it is 1.5 % on this mesh.
    assert np.abs(bend - y / (D / 2) / W).max() * W < 2e-2
    twist = solid.stress[middle][:, :, free + 3]
    tau = np.sqrt(twist[:, 3] ** 2 + twist[:, 4] ** 2 + twist[:, 5] ** 2)
    np.testing.assert_allclose(tau, 16 / (np.pi * D**3), rtol=5e-3)

    # The same by von Mises, of a force and a torque that the tip needs: sqrt(s^2 + 3 t^2).
    push, turn = np.zeros((1, 3)), np.zeros((1, 3))
    push[0, 0], turn[0, 0] = -1e3, -5.0
    found = links.surface(solid, np.zeros((1, len(rod.mass), 3)), [(push, turn)])
    expected = np.sqrt((1e3 / A) ** 2 + 3 * (16 * 5.0 / (np.pi * D**3)) ** 2)
    # As the torsion alone
    np.testing.assert_allclose(found["von_mises"][0, middle], expected, rtol=5e-3)


SCENE = """
gravity: [0, 0, -9.81]
frames: [tip]
flexible:
  rod:
    material: {E: 2.07e11, nu: 0.29, rho: 7801}
    %s
"""
RODS = [
    Body("rod", "base", "revolute", axis=(0, 1, 0), mass=1.0, inertia=(1e-3, 1e-3, 1e-3)),
    Body("tip", "rod", xyz=(0.5, 0, 0)),
    Body("load", "rod", xyz=(0.5, 0.02, 0), mass=0.5, com=(0.05, 0, 0), inertia=(1e-3, 2e-3, 3e-3)),
]
MESH = "basis: {kind: mesh, rod: {diameters: [0.02]}, modes: 4}\n    end: tip"
BEAM = "section: {shape: circle, diameter: 0.02}\n    axial: true\n    end: tip"


def test_a_solid_rod_and_a_beam_rod_make_the_same_robot(tmp_path: Path) -> None:
    from pinflex.levels.modes import modes
    from pinflex.levels.quasistatic import static_equilibrium

    solid = load(tmp_path, RODS, SCENE % MESH)
    beam = load(tmp_path, RODS, SCENE % BEAM)
    found, expected = (modes(m, count=6).frequencies for m in (solid, beam))
    np.testing.assert_allclose(found[:5], expected[:5], rtol=1e-2)  # slender: within 1 %
    torque = [static_equilibrium(m).r[0] for m in (solid, beam)]
    assert torque[0] == pytest.approx(torque[1], rel=1e-5)
    assert solid.parts["rod"].mass == pytest.approx(beam.parts["rod"].mass, rel=1e-9)


def test_mass_matrix_and_tangent_of_a_solid_are_exact(tmp_path: Path) -> None:
    m = load(tmp_path, RODS, SCENE % MESH)
    system, d = m.flexible, Equations(m.flexible)
    y, v, a, lam = random_state(system, m.undeformed(), 3)
    M = d.mass(y)
    zero = np.zeros(system.nv)
    base = d.residual(y, zero, zero, lam, 0.0).r.copy()
    columns = np.array([d.residual(y, zero, e, lam, 0.0).r - base for e in np.eye(system.nv)]).T
    close(M, columns, 1e-7)  # K eta is 1e7 N here, and its round-off 1e-9 N
    _, _, K, _ = d.tangent(y, v, a, lam, 0.0)
    close(K, by_configuration(d, lambda q: d.residual(q, v, a, lam, 0.0).r, y), 1e-6)
    flat = d.mass(m.undeformed())[1:, 1:]
    body = m.parts["rod"].bodies[0]
    tip = flat - body.M  # what is left is the load at the interface
    assert np.abs(tip[6:, 6:]).max() < 1e-4 * body.M[6:, 6:].max()
    assert tip[0, 0] == pytest.approx(0.5, rel=1e-3)


def test_results_of_a_solid_have_section_forces_and_stress_on_the_mesh(tmp_path: Path) -> None:
    import pinflex as pf

    m = load(tmp_path, RODS, SCENE % MESH)
    r = pf.solve(m, pf.hold(duration=0.1), level="quasistatic", samples=3)
    forces = r.array("link/rod/resultant")[-1]
    w = m.parts["rod"].mass * 9.81
    root = np.abs(forces[0])
    # Weight of the rod and of the load, at small deflection.
    assert root[1] == pytest.approx(w + 0.5 * 9.81, rel=1e-4)
    bent = w * SPAN / 2 + 0.5 * 9.81 * (SPAN + 0.05)
    assert root[5] == pytest.approx(bent, rel=1e-3)
    aside = load(tmp_path, RODS, (SCENE % MESH).replace("0, 0, -9.81", "0, -9.81, 0"))
    other = pf.solve(aside, pf.hold(duration=0.1), level="quasistatic", samples=3)
    # The other way too, of the same round rod.
    assert np.abs(other.array("link/rod/resultant")[-1, 0, 4]) == pytest.approx(bent, rel=1e-3)
    nodes, mises = r.array("link/rod/mesh/nodes"), r.array("link/rod/mesh/von_mises")
    triangles = r.array("link/rod/mesh/triangles").astype(int)
    assert mises.shape == (3, len(nodes))
    assert triangles.max() == len(nodes) - 1
    near = np.abs(nodes[:, 0] - 0.1) < 0.01
    at = float(nodes[near][0, 0])
    moment = np.interp(at, r.array("link/rod/x"), np.abs(forces[:, 5]))
    # Nominal bending stress, one diameter and more from the clamp; the load also twists (1 %).
    assert mises[-1][near].max() == pytest.approx(moment / (np.pi * D**3 / 32), rel=2e-2)
    # Triangles close the surface: each edge belongs to two of them.
    edges = np.sort(np.vstack([triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]), axis=1)
    assert np.all(np.unique(edges, axis=0, return_counts=True)[1] == 2)
    p = nodes[triangles]
    assert np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).min() > 0


def matrices(folder: Path, solid: Solid, **change: Any) -> Path:
    K = solid.K.tocsc()
    M = kron(solid.mass, np.eye(3), format="csc")
    data = {"K": K, "M": M, "nodes": solid.nodes, **solid.regions, **change}
    parts: dict[str, Any] = {}
    for key, value in data.items():
        if hasattr(value, "indptr"):
            parts |= {f"{key}_{p}": getattr(value, p) for p in ("data", "indices", "indptr")}
        else:
            parts[key] = value
    np.savez(folder / "body.npz", **parts)
    mmwrite(folder / "K.mtx", K)
    mmwrite(folder / "M.mtx", M)
    np.savetxt(folder / "nodes.txt", solid.nodes, fmt="%.17g")
    return folder


GIVEN = """
flexible:
  rod:
    material: steel
    end: tip
    basis: {kind: matrices, modes: 4, %s}
"""
NPZ = "file: body.npz, interfaces: {root: root, tip: tip}"
MTX = (
    "mass: M.mtx, stiffness: K.mtx, nodes: nodes.txt, interfaces: "
    "{root: [0, -1, -1, 0, 1, 1], tip: [0.2, -1, -1, 0.2, 1, 1]}"
)
BLOCK = [
    Body("rod", "base", "revolute", axis=(0, 1, 0)),
    Body("tip", "rod", xyz=(L, 0, 0), mass=0.1, inertia=(1e-4, 1e-4, 1e-4)),
]


def test_a_body_given_by_its_matrices_is_the_body_of_the_mesh(tmp_path: Path, block: Solid) -> None:
    matrices(tmp_path, block)
    mesh = reduce(block, 4, L, second_order=False)
    for keys in (NPZ, MTX):
        body = load(tmp_path, BLOCK, GIVEN % keys).parts["rod"].bodies[0]
        np.testing.assert_allclose(hertz(body.K, body.M), hertz(mesh.K, mesh.M), rtol=1e-7)
        assert not body.second_order  # no elements to take second-order strains from
        assert body.mass.sum() == pytest.approx(mesh.mass.sum(), rel=1e-12)


def test_a_mesh_in_the_frame_of_the_link_is_turned_into_the_beam(tmp_path: Path) -> None:
    m = tetrahedra()
    turned = 1e3 * np.column_stack([m.p[2], m.p[0], m.p[1]])  # along y, in mm
    write(tmp_path / "block.msh", m, turned)
    bodies = [Body("rod", "base", "revolute"), Body("tip", "rod", xyz=(0, L, 0), mass=0.1)]
    text = """
flexible:
  rod:
    material: {E: 2.07e11, nu: 0.29, rho: 7801}
    end: tip
    basis: {kind: mesh, file: block.msh, scale: 1e-3, modes: 4, interfaces: %s}
"""
    scene = load(tmp_path, bodies, text % "{root: flange, tip: end}")
    body = scene.parts["rod"].bodies[0]
    straight = reduce(
        of_mesh(read(write(tmp_path / "b.msh", m), FACES, 1.0, "b"), STEEL, "b"), 4, L
    )
    np.testing.assert_allclose(hertz(body.K, body.M), hertz(straight.K, straight.M), rtol=1e-7)
    total = pin.Inertia.Zero()
    for inertia in scene.parts["rod"].rigid_inertias():
        total = total + inertia
    np.testing.assert_allclose(total.lever, [0, L / 2, 0], atol=1e-12)
    with pytest.raises(DescriptionError, match="looks like mm"):
        load(tmp_path, bodies, text % "{root: flange, tip: end}", ["flexible.rod.basis.scale=1"])


def test_the_summary_declares_units_and_is_saved(tmp_path: Path, rod: FlexibleBody) -> None:
    text = summary(rod)
    for word in ("kg", "centre", "kg m^2", "Hz", "second-order rows", "point inertia"):
        assert word in text
    data = modal_data(rod)
    # The modes of a cantilever carry 61.3 %, 18.8 %, 6.5 % of its mass: tables of beams.
    side = data["effective_mass"][:, 1:].sum(axis=1) / data["mass"]
    np.testing.assert_allclose([side[0], side[2]], [0.6131, 0.1883], atol=5e-3)
    with np.load(save(rod, tmp_path / "rod.npz")) as saved:
        assert saved["mass"] == data["mass"]
        assert "frequencies: Hz" in saved["units"].tolist()


def test_ritz8_has_the_stiffness_of_its_source_and_the_motion_of_one_element() -> None:
    spec = FlexibleLink("rod", STEEL, Section.circle(D), Basis("ritz8"))
    body = flexible_body(spec, ("u", "v", "w", "p"), SPAN)
    one = FlexibleLink("rod", STEEL, Section.circle(D), Basis("finite_element", elements=1))
    element = flexible_body(one, ("u", "v", "w", "p"), SPAN)
    assert body.labels == ("u q5", "v q2", "v q6", "w q3", "w q7", "p q8")
    S = spec.section
    EI = STEEL.E * S.Iz / SPAN
    np.testing.assert_allclose(body.K[1:3, 1:3], EI * np.array([[4, 2], [2, 4]]), rtol=1e-10)
    assert body.K[0, 0] == pytest.approx(STEEL.E * S.A / SPAN)
    assert body.K[5, 5] == pytest.approx(STEEL.G * S.J / SPAN)
    np.testing.assert_allclose(hertz(body.K, body.M), hertz(element.K, element.M), rtol=1e-9)


# Bodies that are none.


def test_a_mesh_without_the_named_interface_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "block.msh", tetrahedra())
    with pytest.raises(DescriptionError, match=r"no group of faces 'flnge'.*\"flange\""):
        read(path, {"root": "flnge"}, 1.0, "block")
    with pytest.raises(DescriptionError, match="span no area"):
        read(path, {"root": (0.0, 0.5, 0.0, 0.0, 0.6, 0.0)}, 1.0, "block")
    with pytest.raises(DescriptionError, match="no such file"):
        read(tmp_path / "blok.msh", FACES, 1.0, "block")
    (tmp_path / "not.msh").write_text("hello")
    with pytest.raises(DescriptionError, match="meshio cannot read"):
        read(tmp_path / "not.msh", FACES, 1.0, "block")


def test_cells_without_volume_and_loose_parts_are_refused() -> None:
    m, P2 = tetrahedra(), skfem.ElementTetP2()
    flat = m.p.copy()
    k = m.t[0, 7]
    flat[:, k] = flat[:, m.t[1, 7]] + 1e-12
    with pytest.raises(DescriptionError, match="have no volume"):
        checked(skfem.MeshTet(flat, m.t), P2, {}, "block")
    two = np.hstack([m.p, m.p + np.array([[1], [0], [0]])])
    with pytest.raises(DescriptionError, match="2 parts"):
        checked(skfem.MeshTet(two, np.hstack([m.t, m.t + m.p.shape[1]])), P2, {}, "block")


def test_matrices_that_are_not_those_of_a_solid_are_refused(block: Solid) -> None:
    K, M = block.K.tocsc(), kron(block.mass, np.eye(3), format="csc")

    def body(K: Any, M: Any, nodes: Array = block.nodes) -> Solid:
        return of_matrices(nodes, K, M, block.regions, "block")

    body(K, M)
    for name, pair in (("K", (1.0, 0.0)), ("M", (0.0, 1.0))):
        skew = [A.tolil() for A in (K, M)]
        for A, by in zip(skew, pair, strict=True):
            A[3, 0] += 0.1 * by * abs(A[3, 3])
        with pytest.raises(DescriptionError, match=f"{name} is not symmetric: entry"):
            body(*skew)
    with pytest.raises(DescriptionError, match="has shape"):
        body(K[:-3, :-3], M)
    held = K.tolil()
    held[0, 0] += held[0, 0]
    with pytest.raises(DescriptionError, match="resists a translation along x"):
        body(held, M)
    with pytest.raises(DescriptionError, match="resists a rotation"):
        body(K, M, block.nodes * [1.0, 2.0, 1.0])
    wrong = M.tolil()
    wrong[1, 1] *= 2
    with pytest.raises(DescriptionError, match="same mass along x, y and z"):
        body(K, wrong)


def test_absurd_units_are_refused(tmp_path: Path, block: Solid) -> None:
    with pytest.raises(DescriptionError, match="sound would travel"):
        of_mesh(
            stepped_rod([(D, SPAN)], None, "rod"),
            Material(2.07e5, 2.07e5 / 2.58, 7.8e-9, 0.29),
            "rod",
        )
    matrices(tmp_path, block, nodes=1e3 * block.nodes)
    with pytest.raises(DescriptionError, match="looks like mm"):
        load(tmp_path, BLOCK, GIVEN % NPZ)
    matrices(tmp_path, block, K=1e-12 * block.K)
    with pytest.raises(DescriptionError, match="no solid is so slow"):
        load(tmp_path, BLOCK, GIVEN % NPZ)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("basis: {kind: mesh}", "nothing given for the body"),
        ("basis: {kind: mesh, file: a.msh}", "interfaces: missing"),
        ("basis: {kind: mesh, rod: {diameters: [0.02, 0.01]}}", "lengths: missing"),
        ("basis: {kind: mesh, rod: {diameters: [0.02], lengths: [0.3]}}", "span is 0.5 m"),
        (
            "basis: {kind: mesh, rod: {diameters: [0.02]}}\n    shear: true",
            "has no meaning for it",
        ),
        ("basis: {kind: matrices, mass: M.mtx}", "needs stiffness and nodes"),
    ],
)
def test_a_solid_that_is_not_described_is_refused(tmp_path: Path, keys: str, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        load(tmp_path, RODS, SCENE % (keys + "\n    end: tip"))


def test_a_second_rotation_is_that_of_the_joints_of_an_interface() -> None:
    """R = Rz Ry Rx, one joint after the other: its mixed derivatives, by Pinocchio's rotations."""
    h = 1e-3

    def turned(angles: Array) -> Array:
        x, y, z = (pin.AngleAxis(a, e).matrix() for a, e in zip(angles, np.eye(3), strict=True))
        return np.asarray(z @ y @ x)

    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        a, b = h * np.eye(3)[i], h * np.eye(3)[j]
        mixed = turned(a + b) - turned(a - b) - turned(b - a) + turned(-a - b)
        expected = mixed / (4 * h * h)
        found = _second_rotation(np.eye(3)[i], np.eye(3)[j])
        np.testing.assert_allclose(found, expected, atol=2e-6)  # h^2, two derivatives further
