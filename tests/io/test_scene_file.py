import json

import equinox as eqx
import jax
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.io.scene_file import read_scene, write_scene
from impostor_jax.primitives import PRIMITIVES as CLASSES
from impostor_jax.primitives.tube import as_tube
from tests.cases import PRIMITIVES, pose

CAMERA = ij.PinholeCamera(60.0, 62.0, 31.5, 23.0, 64, 48, camera_from_world=pose())


def test_every_shape_is_read_as_it_was_written(tmp_path):
    shapes = [make() for make in PRIMITIVES.values()]
    shapes.append(ij.Cylinder((0, 0, 1), (0, 1, 0), 1, 2, 0.5, 2.0, caps=False))
    assert {type(shape) for shape in shapes} == {*CLASSES.values(), ij.Solid}
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


GLASS = ij.Material((0.5, 0.75, 1.0), 20.0, 0.25, 0.5, 1.25, fresnel=True)
LIGHTS = [
    ij.AmbientLight(0.25),
    ij.PointLight((1.0, -2.0, 0.5), (0.5, 0.25, 1.0), "inverse_square"),
    ij.PointLight((1.0, 0.0, 0.5), 2.0),
    ij.DirectionalLight((0.0, -1.0, -0.5), (1.0, 0.5, 0.25)),
]


def check_same(given, found):
    assert jax.tree.structure(given) == jax.tree.structure(found)
    for x, y in zip(jax.tree.leaves(given), jax.tree.leaves(found), strict=True):
        np.testing.assert_array_equal(x, y)


def test_materials_and_lights_are_read_as_they_were_written(tmp_path):
    path = tmp_path / "scene.json"
    shapes = [make() for make in PRIMITIVES.values()][:3]
    materials = [ij.Material(), GLASS, ij.Material(reflect=0.5)]
    write_scene(path, shapes, None, materials, LIGHTS, (0.25, 0.5, 1.0))
    found = read_scene(path)
    check_same(materials, found.materials)
    check_same(LIGHTS, found.lights)
    assert found.background == (0.25, 0.5, 1.0)
    entries = json.loads(path.read_text())["shapes"]
    assert entries[0]["material"] == {}
    assert entries[2]["material"] == {"reflect": 0.5}
    # A batch counts as many, as `trace` has it, and a single one is of all.
    balls = ij.Sphere([(0, 0, 1), (0, 0, 2)], [0.1, 0.2])
    both = ij.Material([(0.5, 0.5, 0.5), (1, 1, 1)], transmit=(0.5, 0.25))
    write_scene(path, [balls, shapes[0]], materials=[both, GLASS])
    first, second, third = read_scene(path).materials or ()
    np.testing.assert_array_equal([first.transmit, second.transmit], both.transmit)
    check_same(GLASS, third)
    write_scene(path, [balls], materials=GLASS)
    check_same([GLASS, GLASS], read_scene(path).materials)
    with pytest.raises(ValueError, match=r"as many as the 2 shapes, .* got 1"):
        write_scene(path, [balls], materials=[GLASS])


def test_a_shape_without_material_beside_one_with_it_has_the_default(tmp_path):
    record = {"version": 1, "shapes": [SPHERE, SPHERE | {"material": {"reflect": 1}}]}
    (tmp_path / "scene.json").write_text(json.dumps(record))
    found = read_scene(tmp_path / "scene.json")
    check_same([ij.Material(), ij.Material(reflect=1)], found.materials)


def test_a_file_without_materials_and_lights_has_none(tmp_path):
    write_scene(tmp_path / "scene.json", [ij.Sphere((0, 0, 1), 0.1)])
    found = read_scene(tmp_path / "scene.json")
    assert found.materials is None
    assert (found.lights, found.background) == ([], (0.0, 0.0, 0.0))


def test_function_is_not_written(tmp_path):
    hills = ij.Heightfield(lambda x, z: x * z, ((0, 1), (0, 1)), lipschitz=2.0)
    with pytest.raises(ValueError, match="height of a heightfield must be numbers"):
        write_scene(tmp_path / "scene.json", [hills])
    assert not (tmp_path / "scene.json").exists()


def solids():
    """Solids in solids, one with a pose, one with a ground and a plane, and a batch."""
    can = ij.Cylinder((0.1, 0.2, 3), (0.3, 0.8, 0.52), 0.5, 1.4)
    ball = ij.Sphere((0.3, 0.2, 3), 0.4)
    ground = ij.Heightfield(
        [[0.0, 0.3], [0.4, -0.3], [0.1, 0.2]],
        ((-1, 1), (-1, 2)),
        world_from_field=ij.RigidTransform(pose().rotation, (0.1, 0.2, 3)),
    )
    table = ij.Plane((0, 0.5, 0), (0, -1, 0))
    box = ij.Box((0, 0, 3), np.eye(3), (1, 2, 3))
    tiles = ij.Box([(0, 0, 3), (0, 0, 4)], [np.eye(3)] * 2, [(1, 1, 1), (1, 2, 1)])
    return [
        (can - (ball | box)).transformed(pose()),
        ij.union(ij.intersection(box - ground, table), ball, ij.union(can)),
        tiles - ball,
    ]


def test_solids_are_read_as_they_were_written(tmp_path):
    path = tmp_path / "scene.json"
    turned, ground, tiles = solids()
    write_scene(path, [turned, ground, tiles], materials=GLASS)
    found = read_scene(path)
    check_same([turned, ground], found.shapes[:2])
    check_same([GLASS] * 4, found.materials)
    for k, tile in enumerate(found.shapes[2:]):
        check_same(jax.tree.map(lambda x, k=k: x[k], tiles), tile)
    first, second, *_ = json.loads(path.read_text())["shapes"]
    assert first["type"] == "difference"
    assert [part["type"] for part in first["shapes"]] == ["cylinder", "union"]
    assert set(first["shapes"][1]) == {"type", "shapes"}
    assert first["world_from_shapes"][3] == [0, 0, 0, 1]
    # The ground is a heightfield as it was given, without the sides that it got.
    assert "world_from_shapes" not in second
    cut = second["shapes"][0]
    assert [part["type"] for part in cut["shapes"]] == ["difference", "plane"]
    assert [part["type"] for part in cut["shapes"][0]["shapes"]] == [
        "box",
        "heightfield",
    ]


def test_a_tube_is_read_by_its_own_numbers(tmp_path):
    sizes = {"outer_radius": 0.04, "inner_radius": 0.03, "height": 0.1}
    entry = {"type": "tube", "center": [0, 0, 1], "axis": [0, 0, 1], **sizes}
    path = tmp_path / "scene.json"
    path.write_text(json.dumps({"version": 1, "shapes": [entry]}))
    (read,) = read_scene(path).shapes
    assert float(as_tube(read).inner_radius) == pytest.approx(0.03)
    write_scene(path, [read])
    (again,) = read_scene(path).shapes
    assert eqx.tree_equal(again, read)


def test_a_ground_that_was_moved_with_a_solid_keeps_its_sides(tmp_path):
    # Its sides are rounded apart from it by the pose, and are new where it is read.
    _, ground, _ = solids()
    both = ij.union(ground.transformed(pose()), ij.Sphere((0, 0, 9), 1))
    write_scene(tmp_path / "scene.json", [both])
    (found,) = read_scene(tmp_path / "scene.json").shapes
    assert jax.tree.structure(found) == jax.tree.structure(both)
    for x, y in zip(jax.tree.leaves(both), jax.tree.leaves(found), strict=True):
        np.testing.assert_allclose(x, y, atol=3e-6)


def test_a_ground_whose_sides_were_moved_away_is_not_written(tmp_path):
    _, ground, _ = solids()
    side = ground.shapes[2]
    moved = eqx.tree_at(lambda s: s.shapes[2].point, ground, side.point + 0.1)
    with pytest.raises(ValueError, match="must have the sides of its extent"):
        write_scene(tmp_path / "scene.json", [moved])


def nested(depth):
    found = ij.Sphere((0, 0, 1), 0.1)
    for _ in range(depth):
        found = ij.union(found)
    return found


def test_solids_are_written_as_deep_as_they_are_read(tmp_path):
    path = tmp_path / "scene.json"
    write_scene(path, [nested(48)])
    check_same([nested(48)], read_scene(path).shapes)
    with pytest.raises(ValueError, match="must not be nested more than 100 deep"):
        write_scene(path, [nested(60)])
    check_same([nested(48)], read_scene(path).shapes)


SPHERE = {"type": "sphere", "center": [0, 0, 1], "radius": 0.1}
TWO = {"type": "sphere", "center": [[0, 0, 1], [0, 0, 2]], "radius": [1, 2]}

AMBIENT = {"type": "ambient", "intensity": 1}
POINT = {"type": "point", "position": [0, 0, 0], "intensity": 1}
SUN = {"type": "directional", "direction": [0, 0, -1], "intensity": 1}


def made_of(material):
    return {"version": 1, "shapes": [SPHERE, SPHERE | {"material": material}]}


TRIANGLE = {"type": "triangle", "vertices": [[0, 0, 1], [0, 1, 1], [1, 0, 1]]}


def joined(*shapes, **more):
    solid = {"type": "union", "shapes": list(shapes), **more}
    return {"version": 1, "shapes": [solid]}


def lit_by(lights, **more):
    return {"version": 1, "shapes": [SPHERE], "lights": lights, **more}


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
        # It was no error with a line, but one of Python's.
        ({"version": 1, "shapes": ["sphere"]}, r"shapes\[0\] must be a JSON object"),
        ({"version": 1, "shapes": [SPHERE | {"size": 1}]}, "unknown keys: size"),
        (
            {"version": 1, "shapes": [SPHERE, SPHERE | {"radius": -1}]},
            r"shapes\[1\] \(sphere\): radius must be positive",
        ),
        ({"version": 1, "shapes": [TWO]}, "must be one shape"),
        ({"version": 1, "shapes": [SPHERE], "camera": {}}, "camera of .* lacks fx"),
        (joined(), r"shapes of shapes\[0\] must be a list that is not empty"),
        (joined(SPHERE, shapes={}), r"shapes of shapes\[0\] must be a list"),
        (joined(SPHERE, size=1), r"shapes\[0\] \(union\) holds unknown keys: size"),
        (joined(SPHERE, {"type": "knot"}), r"type of shapes\[0\]\.shapes\[1\] must"),
        (
            joined(joined(SPHERE, SPHERE | {"radius": -1})["shapes"][0]),
            r"shapes\[0\]\.shapes\[0\]\.shapes\[1\] \(sphere\): radius must be pos",
        ),
        (joined(SPHERE, TRIANGLE), r"shapes\[0\]\.shapes\[1\]: shapes must be closed"),
        (
            joined(SPHERE, SPHERE | {"material": {}}),
            r"material of shapes\[0\]\.shapes\[1\] must be that of the outermost",
        ),
        (joined(SPHERE, world_from_shapes=[1]), r"\(union\): matrix must be numbers"),
        (made_of(3), r"material of shapes\[1\] must be a JSON object, got 3"),
        (made_of({"shine": 1}), r"shapes\[1\] holds unknown keys: shine"),
        (made_of({"color": [1, 2]}), r"material of shapes\[1\]: color must be"),
        (made_of({"color": [[1, 1, 1]]}), r"color of material of shapes\[1\] must be"),
        (made_of({"exponent": "high"}), r"shapes\[1\]: exponent must be"),
        (made_of({"reflect": -1}), r"shapes\[1\]: reflect must not be negative"),
        (made_of({"transmit": True}), r"shapes\[1\]: transmit must be"),
        (made_of({"ior": 1.5}), "transmit must be given with an ior"),
        (made_of({"transmit": 1, "ior": 0}), r"shapes\[1\]: ior must be positive"),
        (made_of({"transmit": 1, "fresnel": 1}), "fresnel of .* must be true"),
        (lit_by({}), r"lights of .* must be a list, got {}"),
        (lit_by([3]), r"type of lights\[0\] must be one of ambient, point"),
        (lit_by([{"type": "lamp"}]), r"type of lights\[0\] must be .* got 'lamp'"),
        (lit_by([AMBIENT, {"type": "point"}]), r"lights\[1\] \(point\) lacks position"),
        (lit_by([AMBIENT | {"color": 1}]), r"lights\[0\] .* unknown keys: color"),
        (lit_by([AMBIENT | {"intensity": -1}]), r"lights\[0\] .*: intensity must be"),
        (lit_by([AMBIENT | {"intensity": [[1], [1, 2]]}]), "intensity must hold"),
        (lit_by([POINT | {"position": [1]}]), r"lights\[0\] .*: position must be"),
        (lit_by([POINT | {"position": [[1, 1, 1]]}]), "position of .* must be of one"),
        (lit_by([POINT | {"falloff": "fast"}]), "falloff must be one of none, inverse"),
        (lit_by([POINT | {"falloff": 2}]), r"falloff of lights\[0\] .* must be a name"),
        (lit_by([SUN | {"direction": [0, 0, 0]}]), "direction must not be the zero"),
        (lit_by([], background=[1, 2]), "background must be numbers of shape"),
        (lit_by([], background=[1, 1, -1]), "background must be red, green and blue"),
        (lit_by([], background=None), "background must be"),
    ],
)  # fmt: skip
def test_mistake_is_named(record, message, tmp_path):
    (tmp_path / "scene.json").write_text(json.dumps(record))
    with pytest.raises(ValueError, match=message):
        read_scene(tmp_path / "scene.json")


def test_missing_file_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"scene file .*none.json' does not exist"):
        read_scene(tmp_path / "none.json")
