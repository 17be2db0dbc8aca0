import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.numerics import eps
from impostor_jax.primitives import PRIMITIVES
from impostor_jax.rendering.bounds import image_bounds
from impostor_jax.rendering.closest import _parts
from impostor_jax.rendering.follow import code_stride
from impostor_jax.rendering.render import _render
from tests.cases import CAMERAS
from tests.checks import all_finite, central_difference
from tests.groups import FULL

CAMERA = CAMERAS["pinhole"]()
OUTPUTS = ("depth", "normal", "mask", "index", "point", "range")


MAKERS = {
    "cylinder": lambda c, a, r: ij.Cylinder(c, a, r, 3 * r),
    "sphere": lambda c, a, r: ij.Sphere(c, r),
    "frustum": lambda c, a, r: ij.Frustum(c, c + 3 * r * a, r, 0.3 * r),
    "box": lambda c, a, r: ij.Box(c, np.eye(3), (r, 2 * r, 3 * r)),
    "torus": lambda c, a, r: ij.Torus(c, a, r, 0.3 * r),
    "triangle": lambda c, a, r: ij.Triangle(c + r * np.array([-2 * a, a, (0, 3, 1)])),
    "sector": lambda c, a, r: ij.Cylinder(c, a, r, 3 * r, 1.0, 4.0, caps=False),
}
ROUND = ("cylinder", "sphere")


def shapes_of(seed=0, count=12, types=ROUND):
    """A mix that overlaps."""
    rng = np.random.default_rng(seed)
    shapes = []
    for k in range(count):
        axis = rng.normal(size=3)
        center = rng.uniform((-1.2, -0.9, 2), (1.2, 0.9, 4))
        axis /= np.linalg.norm(axis)
        make = MAKERS[types[k % len(types)]]
        shapes.append(make(center, axis, rng.uniform(0.1, 0.35)))
    return shapes


def wall():
    return ij.Plane((0, 0, 4.5), (0, 0.1, -1))


def ground():
    """Uneven ground below, whose y is up."""
    relief = [[0.0, 0.2, -0.1], [0.3, -0.2, 0.1], [0.0, 0.1, 0.2]]
    pose = ((1, 0, 0, 0), (0, -1, 0, 1.0), (0, 0, -1, 3), (0, 0, 0, 1))
    return ij.Heightfield(relief, ((-1, 1), (-1, 1)), world_from_field=pose)


def nearest_of(shapes, camera):
    """Depth, normal and index, by every shape alone."""
    depth = np.full((camera.height, camera.width), np.inf)
    index, normal = np.full(depth.shape, -1), np.zeros((*depth.shape, 3))
    for k, shape in enumerate(shapes):
        maps = ij.render(shape, camera)
        nearer = np.asarray(maps.depth) < depth
        depth = np.where(nearer, maps.depth, depth)
        index = np.where(nearer, k, index)
        normal = np.where(nearer[..., None], maps.normal, normal)
    return depth, normal, index


@FULL
@pytest.mark.parametrize("name", ["distorted", "orthographic", "posed"])
def test_the_closest_of_all_shapes_is_seen(name):
    # All types for one camera: how each is cast does not depend on the camera. A lens
    # bends the rays of one type as of any.
    camera, shapes = CAMERAS[name](), [*shapes_of(), wall()]
    if name == "posed":
        shapes = [*shapes_of(types=tuple(MAKERS)), wall(), ground()]
    elif name == "distorted":
        shapes = [*shapes_of(types=("sphere",)), wall()]
    maps = ij.render(ij.Scene(shapes), camera, OUTPUTS)
    depth, normal, index = nearest_of(shapes, camera)
    # Parallel rays see a meter.
    assert len(np.unique(index)) > (10 if camera.is_central else 3)
    np.testing.assert_array_equal(maps.index, index)
    assert maps.index.dtype == np.int32
    np.testing.assert_array_equal(maps.mask, index >= 0)
    np.testing.assert_allclose(maps.depth, depth, rtol=eps("float32", 32))
    np.testing.assert_allclose(maps.normal, normal, atol=1e-4)
    hit = np.asarray(maps.mask)
    np.testing.assert_allclose(np.asarray(maps.point)[hit][:, 2], depth[hit], rtol=1e-6)


def test_the_part_that_is_seen_is_that_of_the_shape_alone():
    # Boxes side by side and a single sector: both ways to cast a scene.
    shapes = [*shapes_of(count=8, types=("box",)), *shapes_of(1, 1, ("sector",))]
    maps = ij.render(ij.Scene(shapes), CAMERA, ("index", "part"))
    index, part = np.asarray(maps.index), np.asarray(maps.part)
    for k, shape in enumerate(shapes):
        alone = np.asarray(ij.render(shape, CAMERA, ("part",)).part)
        np.testing.assert_array_equal(part[index == k], alone[index == k])
    np.testing.assert_array_equal(part < 0, index < 0)
    assert {0, 1, 2, 3, 4} <= set(part[index < 8]), "faces of boxes"
    assert part.dtype == np.int32


@FULL
def test_heightfields_of_a_batch_are_each_cast_alone():
    relief = np.array(
        [[[0, 0.3], [0.2, 0]], [[0.1, 0], [0, 0.4]], [[0, 0], [0.2, 0.1]]]
    )
    extent = np.array([[[x, x + 0.8], [2.5, 4.5]] for x in (-1.3, -0.4, 0.5)])
    scene = ij.Scene([ij.Heightfield(relief, extent)])
    assert [group.index.shape for group in scene.groups] == [(1,)] * 3
    grounds = [ij.Heightfield(*pair) for pair in zip(relief, extent, strict=True)]
    maps = ij.render(scene, CAMERA)
    depth, normal, _ = nearest_of(grounds, CAMERA)
    np.testing.assert_allclose(maps.depth, depth, rtol=eps("float32", 32))
    np.testing.assert_allclose(maps.normal, normal, atol=1e-4)


@FULL
def test_more_pairs_than_a_list_holds_take_more_rounds():
    # A sphere that reaches behind the camera is listed by all 24 cells; lists hold 4096
    # pairs. The last ones are seen, too.
    rng = np.random.default_rng(3)
    beside = [ij.Sphere((*(5 * rng.normal(size=2)), -9.0), 9.5) for _ in range(250)]
    beside = [s for s in beside if np.hypot(*s.center[:2]) > 4]
    shapes = [*beside, *shapes_of(types=("sphere",))]
    assert 24 * len(beside) > 4096
    camera = ij.PinholeCamera(60.0, 62.0, 31.5, 23.0, 64, 48)
    maps = ij.render(ij.Scene(shapes), camera, OUTPUTS)
    depth, normal, index = nearest_of(shapes, camera)
    assert len(np.unique(index)) > 5
    np.testing.assert_array_equal(maps.index, index)
    np.testing.assert_allclose(maps.depth, depth, rtol=eps("float32", 32))
    np.testing.assert_allclose(maps.normal, normal, atol=1e-4)


def test_a_group_is_cut_where_its_pairs_cannot_be_counted():
    (group,) = ij.Scene(shapes_of(types=("sphere",))).groups
    (whole,) = _parts(group, 2400)
    assert whole.index.shape == group.index.shape
    several = list(_parts(group, 1 << 28))
    assert [part.index.shape[0] for part in several] == [7, 7, 2]
    joined = np.concatenate([part.index for part in several])
    np.testing.assert_array_equal(joined, group.index)


def test_shapes_whose_codes_32_bits_cannot_count_are_refused():
    assert code_stride(1000, 6) == 12
    assert code_stride((1 << 31) // 12, 6) == 12
    with pytest.raises(ValueError, match="at most 178956970 where one has 6 parts"):
        code_stride((1 << 31) // 12 + 1, 6)


@FULL
def test_batches_and_tiles_are_parts_of_the_same_image():
    shapes = [*shapes_of(1), wall()]
    whole = ij.render(ij.Scene(shapes), CAMERA, ("depth", "index"))
    spheres = [shape for shape in shapes if isinstance(shape, ij.Sphere)]
    batch = ij.Sphere(
        np.stack([s.center for s in spheres]), np.stack([s.radius for s in spheres])
    )
    others = [shape for shape in shapes if not isinstance(shape, ij.Sphere)]
    maps = ij.render(ij.Scene([batch, *others]), CAMERA, ("depth", "index"))
    np.testing.assert_array_equal(maps.depth, whole.depth)
    order = [*map(shapes.index, spheres), *map(shapes.index, others), -1]
    np.testing.assert_array_equal(np.take(order, maps.index), whole.index)
    tile = ij.Tile(10, 20, 17, 23)
    part = ij.render(ij.Scene(shapes), CAMERA, ("depth", "index"), tile)
    np.testing.assert_array_equal(part.index, whole.index[10:27, 20:43])
    # A program of its own: without optimizations it rounds a few pixels otherwise.
    inner = whole.depth[10:27, 20:43]
    np.testing.assert_allclose(part.depth, inner, rtol=eps("float32"))


def test_one_more_of_a_type_or_one_that_moves_compiles_nothing():
    spheres = [ij.Sphere((x, 0, 3), 0.1) for x in np.linspace(-1, 1, 7)]
    scene = ij.Scene([*spheres[:5], ij.Plane((0, 0, 4), (0, 0, 1))])
    before = ij.render(scene, CAMERA, ("index",))
    compiled = len(_render.programs)
    moved = [*spheres[:6], ij.Sphere((0, 0.5, 2), 0.2)]
    # Also in another order.
    scene = ij.Scene([ij.Plane((0, 0, 5), (0, 0.2, 1)), *moved])
    after = ij.render(scene, CAMERA, ("index",))
    assert len(_render.programs) == compiled
    assert set(np.unique(before.index)) == set(range(6))
    assert set(np.unique(after.index)) == set(range(8))


@FULL
def test_types_that_a_scene_does_not_hold_are_not_traced(monkeypatch):
    def fail(*_):
        raise AssertionError("traced")

    for name in set(PRIMITIVES) - {"sphere"}:
        monkeypatch.setattr(PRIMITIVES[name], "intersect", fail)
        monkeypatch.setattr(PRIMITIVES[name], "normal", fail)
    scene = ij.Scene([ij.Sphere((x, 0, 3), 0.123) for x in (-0.5, 0.0, 0.5)])
    assert ij.render(scene, CAMERA, OUTPUTS).mask.any()
    with pytest.raises(AssertionError, match="traced"):
        ij.render(ij.Scene([scene.groups[0].primitives, *shapes_of(count=1)]), CAMERA)


@FULL
@pytest.mark.usefixtures("double")
def test_derivatives_are_those_of_what_is_seen():
    shapes = [*shapes_of(2, count=10), wall(), ij.Sphere((0, 0, 9.0), 0.5)]
    camera = CAMERAS["pinhole"]()
    index = np.asarray(ij.render(ij.Scene(shapes), camera, ("index",)).index)
    rng = np.random.default_rng(3)
    inner = rng.uniform(size=index.shape)

    def value(shapes):
        maps = ij.render(ij.Scene(shapes), camera, ("depth", "normal", "index"))
        # Edges jump: only pixels that see the same before and after count.
        same = maps.index == index
        seen = jnp.where(same & jnp.isfinite(maps.depth), maps.depth, 0)
        return jnp.sum(inner * seen) + jnp.sum(
            jnp.where(same[..., None], maps.normal, 0)
        )

    total = jax.jit(jax.value_and_grad(value))
    _, slope = total(shapes)
    assert all_finite(slope)
    # The last sphere hides behind the wall.
    assert not np.any(slope[-1].radius)
    assert not np.any(slope[-1].center)
    for k in np.unique(index)[np.unique(index) >= 0]:
        assert any(np.any(leaf) for leaf in jax.tree.leaves(slope[k]))
    sphere = 1
    along = jax.tree.map(jnp.zeros_like, shapes)
    along[sphere] = jax.tree.map(jnp.ones_like, shapes[sphere])
    numeric = central_difference(lambda shapes: total(shapes)[0], shapes, along, 1e-7)
    expected = sum(np.sum(leaf) for leaf in jax.tree.leaves(slope[sphere]))
    assert float(numeric) == pytest.approx(float(expected), rel=1e-4)
    # What is drawn is the search's, its derivative that of a second cast.
    _, forward = jax.jit(lambda *x: jax.jvp(value, *x))((shapes,), (along,))
    assert float(forward) == pytest.approx(float(expected), rel=1e-9)


@FULL
@pytest.mark.parametrize("camera", ["pinhole", "orthographic"])
def test_bounds_hold_every_pixel_and_are_tight(camera):
    camera = CAMERAS[camera]()
    row, col = camera.frame.pixels()
    ray = camera.rays(row, col, "float32")
    across = ray.direction if camera.is_central else ray.origin
    bounds_of = jax.jit(lambda shape: image_bounds(shape, camera.projection))
    for shape in shapes_of(4, count=20, types=tuple(MAKERS)):
        mask = np.asarray(ij.render(shape, camera, ("mask",)).mask)
        bounds = bounds_of(shape)
        if not mask.any():
            continue
        whole = getattr(shape, "start_angle", None) is None
        border = mask.copy()
        border[1:-1, 1:-1] = False
        for k, x in enumerate((across.x, across.y)):
            seen = np.asarray(x)[mask]
            assert bounds.low[k] <= seen.min()
            assert seen.max() <= bounds.high[k]
            if whole and not border.any():
                # Two and a half pixels.
                assert seen.min() - bounds.low[k] < 2.5 / 60
                assert bounds.high[k] - seen.max() < 2.5 / 60


def test_shape_behind_the_camera_is_bounded_by_nothing():
    behind = ij.Sphere((0, 0, -3), 1)
    assert np.all(np.asarray(image_bounds(behind, "planar").low) == np.inf)
    around = image_bounds(ij.Sphere((0, 0, 0.5), 1), "planar")
    assert np.all(np.asarray(around.low) == -np.inf)


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        ([], "shapes must hold at least one primitive"),
        ([ij.Sphere(np.ones((2, 2, 3)), np.ones((2, 2)))], "shapes must be primitives"),
    ],
)
def test_what_is_no_scene_is_refused(shapes, message):
    with pytest.raises(ValueError, match=message):
        ij.Scene(shapes)
