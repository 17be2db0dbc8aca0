import json
import sys

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.io.mesh_file import read_mesh
from impostor_jax.io.scene_file import read_scene

trimesh = pytest.importorskip("trimesh")

CORNERS = np.array([(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3)], float)
FACES = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
AWAY = np.array([[0, -1, 0, 5], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], float)


def tetrahedron():
    return trimesh.Trimesh(CORNERS, FACES, process=False)


@pytest.mark.parametrize("kind", ["ply", "obj", "stl", "glb", "off"])
def test_corners_come_in_order_and_in_meters(kind, tmp_path):
    path = tmp_path / f"given.{kind}"
    tetrahedron().export(path)
    found = ij.read_mesh(str(path), scale=0.001)
    assert isinstance(found, ij.Triangle)
    assert found.batch_shape == (4,)
    np.testing.assert_allclose(found.vertices, 1e-3 * CORNERS[FACES], atol=1e-9)


def test_parts_of_a_scene_are_where_it_places_them(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(tetrahedron())
    scene.add_geometry(tetrahedron(), transform=AWAY)
    scene.export(tmp_path / "two.glb")
    found = read_mesh(tmp_path / "two.glb").vertices
    moved = CORNERS @ AWAY[:3, :3].T + AWAY[:3, 3]
    expected = np.concatenate([CORNERS[FACES], moved[FACES]])
    # In the order of the file's nodes, which the format does not fix.
    assert sorted(np.asarray(found).tolist()) == sorted(expected.tolist())


def test_faces_without_area_are_left_out(tmp_path):
    faces = np.concatenate([FACES, [(0, 0, 1), (0, 4, 1)]])
    corners = np.concatenate([CORNERS, [(0.5, 1e-9, 0)]])
    trimesh.Trimesh(corners, faces, process=False).export(tmp_path / "thin.ply")
    assert read_mesh(tmp_path / "thin.ply").batch_shape == (4,)


def test_mesh_of_a_scene_file_lies_beside_it(tmp_path):
    (tmp_path / "parts").mkdir()
    tetrahedron().export(tmp_path / "parts" / "cup.stl")
    mesh = {"type": "mesh", "path": "parts/cup.stl", "scale": 0.1}
    ball = {"type": "sphere", "center": [0, 0, 1], "radius": 0.1}
    mesh["material"] = {"reflect": 0.5}
    record = {"version": 1, "shapes": [mesh, ball]}
    (tmp_path / "scene.json").write_text(json.dumps(record))
    found = read_scene(tmp_path / "scene.json")
    mesh, ball = found.shapes
    assert found.materials is not None
    assert [one.color.shape for one in found.materials] == [(4, 3), (3,)]
    np.testing.assert_array_equal(found.materials[0].reflect, [0.5] * 4)
    np.testing.assert_allclose(mesh.vertices, 0.1 * CORNERS[FACES], atol=1e-7)
    assert isinstance(ball, ij.Sphere)


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        ({"path": "none.ply"}, r"shapes\[0\] \(mesh\): mesh file .* does not exist"),
        ({"path": 3}, r"path of shapes\[0\] \(mesh\) must be a file name"),
        ({"path": "a.ply", "scale": 0}, "scale must be a positive number"),
        ({}, r"shapes\[0\] \(mesh\) lacks path"),
    ],
)
def test_mistake_in_a_scene_file_is_named(mesh, message, tmp_path):
    tetrahedron().export(tmp_path / "a.ply")
    record = {"version": 1, "shapes": [{"type": "mesh", **mesh}]}
    (tmp_path / "scene.json").write_text(json.dumps(record))
    with pytest.raises(ValueError, match=message):
        read_scene(tmp_path / "scene.json")


OFF = "OFF\n3 1 0\n0 0 0\n1 0 0\n{} 0\n3 0 1 2\n"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("given.ply", "nothing", "is not readable: "),
        ("given.glb", "nothing", "is not readable: "),
        ("given.obj", "", "must hold triangles, got none"),
        ("given.off", OFF.format("2 0"), "must hold triangles, got none"),
        ("given.off", OFF.format("0 1e30"), "must hold finite corners"),
        ("given.png", "", r"must end in one of .*\.ply"),
    ],
)
def test_file_that_holds_no_mesh_is_named(name, text, message, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=f"mesh file .*{name}' {message}"):
        read_mesh(tmp_path / name)


def test_folder_is_named_as_one(tmp_path):
    with pytest.raises(ValueError, match="must be a file, got a folder"):
        read_mesh(tmp_path)


def test_missing_extra_is_named(tmp_path, monkeypatch):
    tetrahedron().export(tmp_path / "a.ply")
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(ValueError, match=r"pip install 'impostor-jax\[mesh\]'"):
        read_mesh(tmp_path / "a.ply")


def test_corners_of_a_map_keep_their_digits(tmp_path):
    place = np.array([512345.678, 5412345.678, 250.0])
    path = tmp_path / "given.obj"
    rows = ["v " + " ".join(f"{x:.4f}" for x in place + x) for x in np.eye(3)]
    path.write_text("\n".join([*rows, "f 1 2 3"]))
    corners = ij.read_mesh(path).vertices
    np.testing.assert_allclose(corners - place, [np.eye(3)], rtol=0, atol=1e-8)
