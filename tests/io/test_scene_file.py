import json

import jax
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.io.scene_file import read_scene, write_scene
from impostor_jax.primitives import PRIMITIVES as CLASSES
from tests.cases import PRIMITIVES, pose

CAMERA = ij.PinholeCamera(60.0, 62.0, 31.5, 23.0, 64, 48, camera_from_world=pose())


def test_every_shape_is_read_as_it_was_written(tmp_path):
    shapes = [make() for make in PRIMITIVES.values()]
    shapes.append(ij.Cylinder((0, 0, 1), (0, 1, 0), 1, 2, 0.5, 2.0, caps=False))
    assert {type(shape) for shape in shapes} == set(CLASSES.values())
    write_scene(tmp_path / "scene.json", shapes, CAMERA)
    found = read_scene(tmp_path / "scene.json")
    for shape, again in zip(shapes, found.shapes, strict=True):
        assert jax.tree.structure(shape) == jax.tree.structure(again)
        for x, y in zip(jax.tree.leaves(shape), jax.tree.leaves(again), strict=True):
            np.testing.assert_allclose(x, y, atol=1e-7)
    assert found.camera is not None
    assert (found.camera.fx, found.camera.width) == (60.0, 64)
    np.testing.assert_allclose(
        found.camera.camera_from_world.rotation, pose().rotation, atol=1e-7
    )


def test_batch_is_written_one_by_one_and_the_camera_left_out(tmp_path):
    spheres = ij.Sphere([(0, 0, 1), (0, 0, 2)], [0.1, 0.2])
    write_scene(tmp_path / "scene.json", [spheres])
    record = json.loads((tmp_path / "scene.json").read_text())
    assert set(record) == {"version", "shapes"}
    assert [shape["type"] for shape in record["shapes"]] == ["sphere", "sphere"]
    assert read_scene(tmp_path / "scene.json").camera is None


def test_function_is_not_written(tmp_path):
    hills = ij.Heightfield(lambda x, z: x * z, ((0, 1), (0, 1)), lipschitz=2.0)
    with pytest.raises(ValueError, match="height of a heightfield must be numbers"):
        write_scene(tmp_path / "scene.json", [hills])
    assert not (tmp_path / "scene.json").exists()


SPHERE = {"type": "sphere", "center": [0, 0, 1], "radius": 0.1}
TWO = {"type": "sphere", "center": [[0, 0, 1], [0, 0, 2]], "radius": [1, 2]}


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ([], "must hold one JSON object"),
        ({"shapes": [SPHERE]}, "lacks version"),
        ({"version": 2, "shapes": [SPHERE]}, "version of .* must be 1, got 2"),
        ({"version": 1, "shapes": []}, "must be a list that is not empty"),
        ({"version": 1, "shapes": [SPHERE], "light": 1}, "unknown keys: light"),
        ({"version": 1, "shapes": [{"type": "knot"}]}, r"type of shapes\[0\] must be"),
        ({"version": 1, "shapes": [{"type": "sphere"}]}, "lacks center, radius"),
        ({"version": 1, "shapes": [SPHERE | {"size": 1}]}, "unknown keys: size"),
        (
            {"version": 1, "shapes": [SPHERE, SPHERE | {"radius": -1}]},
            r"shapes\[1\] \(sphere\): radius must be positive",
        ),
        ({"version": 1, "shapes": [TWO]}, "must be one shape"),
        ({"version": 1, "shapes": [SPHERE], "camera": {}}, "camera of .* lacks fx"),
    ],
)  # fmt: skip
def test_mistake_is_named(record, message, tmp_path):
    (tmp_path / "scene.json").write_text(json.dumps(record))
    with pytest.raises(ValueError, match=message):
        read_scene(tmp_path / "scene.json")


def test_missing_file_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"scene file .*none.json' does not exist"):
        read_scene(tmp_path / "none.json")
