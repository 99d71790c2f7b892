"""Meshes of a URDF: found, read, made light, and never read from anywhere else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pinflex.arrays import Array, IntArray
from pinflex.errors import DescriptionError
from pinflex.results.result import Result
from pinflex.viewer.collada import read_collada
from pinflex.viewer.surfaces import TRIANGLES, packed, simplify, surfaces

DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.01"/><up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">0 0 0  1 0 0  0 1 0  0 0 1</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles material="red" count="2"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="NORMAL" source="#p" offset="1"/><p>0 0 2 0 1 0 0 0 1 0 3 0</p></triangles>
<polylist material="blue" count="1"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>4</vcount><p>0 1 2 3</p></polylist>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><translate>10 0 0</translate>
<node><scale>2 2 2</scale><instance_geometry url="#g"/></node></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def test_a_collada_file_is_read_with_its_units_axes_nodes_and_materials(tmp_path: Path) -> None:
    (tmp_path / "z.dae").write_text(DAE.format(up="Z_UP"))
    (tmp_path / "y.dae").write_text(DAE.format(up="Y_UP"))
    vertices, faces = read_collada(tmp_path / "z.dae")
    corners = 0.01 * (np.array([10, 0, 0]) + 2 * np.vstack([np.zeros(3), np.eye(3)]))
    # 1e-15: one rounding of numbers of 0.1
    assert vertices[faces[:2]] == pytest.approx(corners[[[0, 2, 1], [0, 1, 3]]], abs=1e-15)
    assert vertices[faces[2:]] == pytest.approx(corners[[[0, 1, 2], [0, 2, 3]]], abs=1e-15)
    lying, _ = read_collada(tmp_path / "y.dae")
    assert lying == pytest.approx(vertices @ [[1, 0, 0], [0, 0, 1], [0, -1, 0]], abs=1e-15)


def test_a_mesh_keeps_its_shape_when_it_loses_triangles() -> None:
    vertices, faces = _cylinder(200, 100)
    less, fewer = simplify(vertices, faces, 3000)
    assert 1500 < len(fewer) <= 3000
    # a facet of a turn cut into n falls short of the circle by 1 - cos(pi/n): 0.2 % for n = 50
    away = np.hypot(less[:, 0], less[:, 1])
    assert np.all((away < 1.001) & ((away > 0.99) | (np.abs(np.abs(less[:, 2]) - 2) < 1e-6)))
    assert _volume(less, fewer) == pytest.approx(_volume(vertices, faces), rel=0.01)


def test_a_small_mesh_stays_whole() -> None:
    vertices, faces = _cylinder(12, 2)
    assert simplify(vertices, faces, 1000)[1] is faces


def test_packing_merges_equal_vertices_and_is_right_to_a_step_of_16_bits() -> None:
    from pinflex.viewer.surfaces import Surface

    vertices, faces = _cylinder(40, 10)
    soup = Surface(vertices[faces.ravel()], np.arange(faces.size).reshape(-1, 3), True)
    found, first = packed(soup)
    assert found is not None
    assert (soup.vertices[first] == vertices[np.lexsort(vertices.T[::-1])]).all()
    assert len(found["points"]) == len(vertices)
    back = found["points"] / 32767 * found["half"] + np.array(found["centre"])
    assert back[found["faces"]] == pytest.approx(vertices[faces], abs=found["half"] / 32767)


def test_meshes_are_looked_for_in_the_folders_given_only(tmp_path: Path) -> None:
    inside, outside = tmp_path / "robot" / "meshes", tmp_path / "secret"
    for folder in (inside, outside):
        folder.mkdir(parents=True)
        (folder / "part.dae").write_text(DAE.format(up="Z_UP"))
    (inside / "way_out.dae").symlink_to(outside / "part.dae")
    names = {
        "good": "package://robot/meshes/part.dae",
        "relative": "meshes/part.dae",
        "climbing": "package://robot/../secret/part.dae",
        "absolute": str(outside / "part.dae"),
        "linked": "package://robot/meshes/way_out.dae",
        "no_mesh": "package://robot/meshes/../../../etc/passwd",
    }
    found, notes = surfaces(_result(names), [tmp_path / "robot"])
    assert set(found) == {"good", "relative"}
    assert any("mesh not found" in note and "3 more" in note for note in notes)
    assert surfaces(_result(names))[0] == {}
    with pytest.raises(DescriptionError, match="no such folder"):
        surfaces(_result(names), [tmp_path / "robbot"])


def test_a_broken_mesh_is_told_and_the_link_drawn_otherwise(tmp_path: Path) -> None:
    (tmp_path / "a.dae").write_text("<COLLADA>")
    (tmp_path / "b.stl").write_bytes(b"solid nothing")
    found, notes = surfaces(_result({"a": "a.dae", "b": "b.stl"}), [tmp_path])
    assert found == {}
    assert "mesh not found: a.dae and 1 more" in notes[0]


def test_simple_shapes_of_a_urdf_have_their_volume() -> None:
    shapes = {
        "box": ('<box size="1 2 3"/>', 6.0),
        "rod": ('<cylinder radius="0.5" length="2"/>', np.pi / 2),
        "ball": ('<sphere radius="1"/>', 4 * np.pi / 3),
    }
    text = "".join(
        f'<link name="{k}"><visual><origin xyz="1 2 3" rpy="0.1 0.2 0.3"/>'
        f"<geometry>{v[0]}</geometry></visual></link>"
        for k, v in shapes.items()
    )
    found, _ = surfaces(_urdf(text))
    for name, (_, volume) in shapes.items():
        # 3 %: 28 facets a turn lose 0.8 %, 12 bands of a ball 2 % more
        assert _volume(found[name].vertices, found[name].faces) == pytest.approx(volume, rel=0.03)


def test_a_known_robot_has_all_its_meshes_within_the_budget() -> None:
    pytest.importorskip("example_robot_data")
    import pinflex as pf

    sources = dict(pf.load("ur5").description.sources)
    found, _ = surfaces(Result(np.zeros(1), {}, {"sources": sources}))
    assert len(found) == 7
    assert sum(len(s.faces) for s in found.values()) <= TRIANGLES
    reach = {k: np.ptp(s.vertices, axis=0).max() for k, s in found.items()}
    # 10 %: the mesh is the joint distance and a housing of about 0.06 m at either end
    assert reach["forearm_link"] == pytest.approx(0.392 + 0.1, rel=0.1)


def _result(names: dict[str, str]) -> Result:
    return _urdf(
        "".join(
            f'<link name="{k}"><visual><geometry><mesh filename="{v}"/></geometry></visual></link>'
            for k, v in names.items()
        )
    )


def _urdf(links: str) -> Result:
    return Result(np.zeros(1), {}, {"sources": {"r.urdf": f"<robot name='r'>{links}</robot>"}})


def _cylinder(around: int, up: int) -> tuple[Array, IntArray]:
    """Radius 1, height 4, closed."""
    turn = np.linspace(0, 2 * np.pi, around, endpoint=False)
    rings = [
        np.column_stack([np.cos(turn), np.sin(turn), 0 * turn + z]) for z in np.linspace(-2, 2, up)
    ]
    vertices = np.concatenate([*rings, [[0, 0, -2], [0, 0, 2]]])
    i, j = np.arange(around), (np.arange(around) + 1) % around
    faces = []
    for k in range(up - 1):
        a, b = k * around, (k + 1) * around
        faces += [np.column_stack([a + i, a + j, b + j]), np.column_stack([a + i, b + j, b + i])]
    low, high = len(vertices) - 2, len(vertices) - 1
    last = (up - 1) * around
    faces += [
        np.column_stack([0 * i + low, j, i]),
        np.column_stack([0 * i + high, last + i, last + j]),
    ]
    return vertices, np.concatenate(faces)


def _volume(vertices: Array, faces: IntArray) -> float:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)
