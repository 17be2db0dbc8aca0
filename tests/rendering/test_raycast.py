import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.numerics import eps
from tests.cases import CAMERAS, pose
from tests.checks import compiled_cost
from tests.groups import FULL

OUTPUTS = ("depth", "range", "point", "normal", "mask")


def can():
    return ij.Cylinder((0.02, -0.05, 1.0), (0.3, 0.8, 0.52), 0.2, 0.5)


def test_maps_agree_with_each_other(dtype):
    camera = CAMERAS["pinhole"]()
    maps = ij.render(can(), camera, outputs=OUTPUTS)
    mask = np.asarray(maps.mask)
    assert 200 < mask.sum() < mask.size / 2
    for name in ("depth", "range", "point"):
        values = np.asarray(getattr(maps, name))
        assert np.isfinite(values[mask]).all()
        assert np.isposinf(values[~mask]).all()
        assert values.dtype == dtype
    point = np.asarray(maps.point)[mask]
    np.testing.assert_array_equal(point[:, 2], np.asarray(maps.depth)[mask])
    np.testing.assert_allclose(
        np.linalg.norm(point, axis=1), np.asarray(maps.range)[mask], rtol=eps(dtype, 8)
    )
    row, col = np.nonzero(mask)
    pixels = np.asarray(camera.project(jnp.asarray(point)))
    np.testing.assert_allclose(
        pixels, np.stack([col, row], 1), atol=eps(dtype, 64) * 64
    )
    normal = np.asarray(maps.normal)
    assert (np.einsum("ni,ni->n", normal[mask], point) < 0).all()
    assert not normal[~mask].any()


def test_outputs_not_asked_for_are_absent_and_not_computed():
    camera = CAMERAS["pinhole"]()
    maps = ij.render(can(), camera, outputs=("mask",))
    assert maps.depth is None
    assert maps.normal is None

    def cost(outputs):
        return compiled_cost(lambda c: ij.render(c, camera, outputs), can())[0]

    assert cost(("depth",)) < 0.8 * cost(("depth", "normal"))


def test_normals_are_those_of_the_depth_map():
    camera = ij.PinholeCamera(600.0, 600.0, 31.5, 23.5, 64, 48)
    maps = ij.render(can(), camera, outputs=("normal", "point", "mask"))
    point, normal = np.asarray(maps.point, float), np.asarray(maps.normal)
    assert bool(maps.mask.all())
    across = point[1:-1, 2:] - point[1:-1, :-2]
    down = point[2:, 1:-1] - point[:-2, 1:-1]
    numeric = np.cross(across, down)
    numeric /= -np.linalg.norm(numeric, axis=-1, keepdims=True)
    angle = np.einsum("ijk,ijk->ij", numeric, normal[1:-1, 1:-1])
    assert np.percentile(angle, 5) > 1 - 1e-5


@FULL
@pytest.mark.parametrize("name", CAMERAS)
def test_a_tile_is_a_block_of_the_whole_image(name):
    camera = CAMERAS[name]()
    whole = ij.render(can(), camera, outputs=("depth", "mask"))
    tile = ij.Tile(row=8, col=16, height=32, width=16)
    part = ij.render(can(), camera, outputs=("depth", "mask"), tile=tile)
    rows, cols = np.s_[8:40], np.s_[16:32]
    np.testing.assert_array_equal(part.mask, np.asarray(whole.mask)[rows, cols])
    expected = np.asarray(whole.depth)[rows, cols]
    np.testing.assert_allclose(part.depth, expected, rtol=1e-5)


def test_a_posed_camera_sees_what_a_moved_cylinder_shows(dtype):
    posed, plain = CAMERAS["posed"](), CAMERAS["pinhole"]()
    world = can().transformed(pose().inverse())
    expected = ij.render(can(), plain)
    found = ij.render(world, posed)
    same = np.asarray(expected.mask & found.mask)
    assert (np.asarray(expected.mask) != np.asarray(found.mask)).sum() <= 2
    np.testing.assert_allclose(
        np.asarray(found.depth)[same], np.asarray(expected.depth)[same],
        rtol=eps(dtype, 256),
    )  # fmt: skip


def test_vmap_over_cylinders_and_over_cameras():
    camera = CAMERAS["pinhole"]()
    radii = jnp.array([0.1, 0.2])
    cylinders = jax.vmap(lambda r: ij.Cylinder(can().center, can().axis, r, 0.5))(radii)
    depth = jax.vmap(lambda c: ij.render(c, camera, outputs=("depth",)).depth)(
        cylinders
    )
    single = ij.render(can(), camera, outputs=("depth",)).depth
    np.testing.assert_allclose(depth[1], single, rtol=1e-6)

    def seen(fx):
        zoomed = ij.PinholeCamera(fx, 62.0, 31.5, 23.0, 64, 48)
        return ij.render(can(), zoomed, outputs=("depth",)).depth

    np.testing.assert_allclose(
        jax.vmap(seen)(jnp.array([50.0, 60.0]))[1], single, rtol=1e-6
    )


def test_gradients_inside_the_callers_own_jit_are_finite():
    camera = CAMERAS["distorted"]()

    def loss(cylinder, camera):
        maps = ij.render(cylinder, camera, outputs=("depth", "normal", "mask"))
        depth = jnp.where(maps.mask, maps.depth, 0)
        return jnp.sum(depth**2) + jnp.sum(maps.normal**3)

    value, slopes = jax.jit(jax.value_and_grad(loss, (0, 1)))(can(), camera)
    assert np.isfinite(float(value))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slopes))
    assert float(jnp.abs(slopes[0].center).max()) > 0
    assert float(abs(slopes[1].fx)) > 0


def test_camera_inside_a_pipe_sees_its_wall_everywhere():
    pipe = ij.Cylinder((0, 0, 0), (0, 0.2, 1), 1.0, 50.0)
    maps = ij.render(pipe, CAMERAS["pinhole"](), outputs=("mask", "point", "normal"))
    assert bool(maps.mask.all())
    assert (np.einsum("ijk,ijk->ij", maps.normal, maps.point) < 0).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"outputs": ("depth", "color")}, "outputs must be one of .*; got 'color'"),
        ({"outputs": "depth"}, "outputs must be a sequence of names, got 'depth'"),
        (
            {
                "primitive": ij.Cylinder(
                    np.ones((2, 3)), np.ones((2, 3)), [1, 1], [1, 1]
                )
            },
            "primitive must be a single one, got a batch of shape",
        ),
    ],
)
def test_bad_argument_is_refused(arguments, message):
    given = {"primitive": can(), "camera": CAMERAS["pinhole"](), **arguments}
    with pytest.raises(ValueError, match=message):
        ij.render(**given)
