import jax
import numpy as np
import pytest

import impostor_jax as ij
from tests.cases import CAMERAS
from tests.groups import FULL
from tests.rendering import exact

SHAPES = {
    "upright": ((0.02, -0.05, 1.0), (0.1, 0.9, 0.1), 0.1, 0.4),
    "toward the camera": ((0.02, -0.05, 1.0), (0.1, 0.2, 0.9), 0.1, 0.4),
    "end on": ((0.0, 0.0, 1.0), (0, 0, 1), 0.2, 0.4),
    "disc": ((-0.1, 0.05, 0.9), (0.5, 0.3, 0.7), 0.2, 0.01),
    "rod": ((0.0, 0.0, 1.2), (0.7, 0.7, 0.1), 0.01, 0.7),
    "partly out of view": ((0.45, 0.1, 1.0), (0.3, 0.8, 0.2), 0.2, 0.4),
}


outline_box = jax.jit(ij.outline_box)


@pytest.fixture(params=SHAPES)
def shape(request):
    return SHAPES[request.param]


@pytest.fixture(params=["pinhole", "distorted", "fisheye"])
def camera(request):
    return CAMERAS[request.param]()


def test_box_is_the_tightest_that_holds_the_mask(shape, camera):
    cylinder = ij.Cylinder(*shape)
    mask = ij.render(cylinder, camera, outputs=("mask",)).mask
    rows, cols = np.nonzero(np.asarray(mask))
    box = outline_box(cylinder, camera)
    found = [int(b) for b in (box.first_row, box.last_row, box.first_col, box.last_col)]
    mask_box = [rows.min(), rows.max(), cols.min(), cols.max()]
    low, high = np.array(found)[[0, 2]], np.array(found)[[1, 3]]
    assert (low <= np.array(mask_box)[[0, 2]]).all()
    assert (high >= np.array(mask_box)[[1, 3]]).all()
    if camera.ray_field is None:
        # The outline's extreme point may fall between pixel centers.
        assert np.abs(np.array(found) - mask_box).max() <= 2


@FULL
def test_tile_shows_all_of_the_cylinder(shape, camera):
    cylinder = ij.Cylinder(*shape)
    tile = ij.outline_tile(cylinder, camera)
    whole = ij.render(cylinder, camera, outputs=("mask",)).mask
    part = ij.render(cylinder, camera, outputs=("mask",), tile=tile).mask
    assert int(part.sum()) == int(whole.sum())
    assert tile.height == camera.height or tile.height % 16 == 0


@FULL
@pytest.mark.parametrize("interpolation", ["bilinear", "bicubic"])
def test_tile_around_a_heightfield_shows_all_of_it(interpolation):
    camera, hill = CAMERAS["distorted"](), [[0, 0.1, 0], [0.1, 0.4, 0.1], [0, 0.1, 0]]
    pose = ij.RigidTransform([[1, 0, 0], [0, 0, -1], [0, 1, 0]], (0.2, 0.1, 2.0))
    extent = ((-0.3, 0.3), (-0.2, 0.2))
    field = ij.Heightfield(hill, extent, interpolation, world_from_field=pose)
    tile = ij.outline_tile(field, camera)
    assert (tile.height, tile.width) < (camera.height, camera.width)
    whole, part = (
        ij.render(field, camera, effort=ij.Effort(extent=extent))
        for extent in ("frame", "tile")
    )
    assert whole.mask.sum() > 100
    np.testing.assert_array_equal(part.mask, whole.mask)
    np.testing.assert_allclose(part.depth, whole.depth, rtol=1e-6)


def test_tile_with_a_margin_holds_all_of_the_covered_area():
    camera = CAMERAS["pinhole"]()
    # 15.6 px high: 15 rows of pixel centers, and 17 rows that are covered in part.
    shape = ((0.0, 0.0, 1.0), (1, 0, 0), 0.126, 0.4)
    covered = exact.coverage(exact.silhouette(shape, camera), camera)
    held = []
    for margin in (0, 1):
        tile = ij.outline_tile(ij.Cylinder(*shape), camera, margin=margin)
        row, col = tile.pixels()
        held.append(covered[row, col].sum() / covered.sum())
    assert held[0] < 0.99
    assert held[1] == pytest.approx(1, abs=1e-12)


def test_cylinder_around_the_camera_takes_the_whole_image(camera):
    pipe = ij.Cylinder((0, 0, 0), (0, 0.2, 1), 1.0, 50.0)
    tile = ij.outline_tile(pipe, camera)
    assert (tile.height, tile.width) == (camera.height, camera.width)


def test_traced_cylinder_moves_a_tile_of_given_shape():
    camera = CAMERAS["pinhole"]()

    @jax.jit
    def seen(cylinder):
        tile = ij.outline_tile(cylinder, camera, shape=(32, 32))
        return ij.render(cylinder, camera, outputs=("mask",), tile=tile).mask.sum()

    cylinder = ij.Cylinder((-0.2, -0.1, 1.0), (0.1, 0.9, 0.1), 0.1, 0.3)
    whole = ij.render(cylinder, camera, outputs=("mask",)).mask
    assert int(seen(cylinder)) == int(whole.sum()) > 100


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((64, 64), "shape must be at most the image's 48 x 64"),
        ((0, 8), "shape must be"),
    ],
)
def test_bad_tile_shape_is_refused(shape, message):
    cylinder = ij.Cylinder(*SHAPES["upright"])
    with pytest.raises(ValueError, match=message):
        ij.outline_tile(cylinder, CAMERAS["pinhole"](), shape=shape)


def test_traced_cylinder_without_a_shape_is_refused():
    camera = CAMERAS["pinhole"]()
    with pytest.raises(ValueError, match="shape must be given"):
        jax.jit(lambda c: ij.outline_tile(c, camera).row)(
            ij.Cylinder(*SHAPES["upright"])
        )
