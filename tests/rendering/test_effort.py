"""What the dials of an effort change in a render, and what they do not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.rendering.maps import MISSES, OUTPUTS
from tests.cases import CAMERAS
from tests.groups import FULL, RELEASE

# Edges are looked for beside pixels, and coverage of whole shapes.
ALL = tuple(n for n in OUTPUTS if n not in ("coverage", "share", "beside"))


def can():
    return ij.Cylinder((0.1, -0.05, 1.0), (0.3, 0.8, 0.52), 0.1, 0.3)


SEEN = {
    "cylinder": can,
    "out of the image": lambda: ij.Cylinder((0.45, 0.3, 1.0), (0, 1, 0), 0.1, 0.3),
    "plane": lambda: ij.Plane((0, 0, 1.2), (0.1, 0, -1)),
    "scene": lambda: ij.Scene([can(), ij.Sphere((-0.1, 0, 0.9), 0.1)]),
}


@FULL
@pytest.mark.parametrize(
    ("seen", "camera"),
    [
        ("cylinder", "distorted"),
        ("out of the image", "orthographic"),
        ("plane", "pinhole"),
        ("scene", "pinhole"),
    ],
)
def test_a_tile_gives_the_maps_of_the_frame(seen, camera):
    shape, camera = SEEN[seen](), CAMERAS[camera]()
    frame = ij.render(shape, camera, ALL)
    tile = ij.render(shape, camera, ALL, effort=ij.Effort(extent="tile"))
    for name in ALL:
        found, expected = (np.asarray(getattr(maps, name)) for maps in (tile, frame))
        if np.issubdtype(found.dtype, np.floating):
            np.testing.assert_allclose(found, expected, rtol=2e-5, atol=2e-5)
        else:
            np.testing.assert_array_equal(found, expected)
    assert np.asarray(frame.mask).any()


@FULL
@pytest.mark.parametrize(
    ("seen", "extent"), [("out of the image", "tile"), ("scene", "frame")]
)
def test_a_stride_gives_every_so_many_th_pixel(seen, extent):
    camera, shape = CAMERAS["pinhole"](), SEEN[seen]()
    full = ij.render(shape, camera, ALL)
    effort = ij.Effort(stride=3, extent=extent)
    strided = ij.render(shape, camera, ALL, effort=effort)
    own = ij.render(shape, camera.strided(3), ALL)
    for name in ALL:
        found = np.asarray(getattr(strided, name))
        assert found.shape[:2] == (16, 22)
        for other in (np.asarray(getattr(full, name))[::3, ::3], getattr(own, name)):
            np.testing.assert_allclose(found, other, rtol=2e-5, atol=2e-5)


def test_a_stride_begins_with_the_first_pixel_of_a_tile():
    camera, tile = CAMERAS["pinhole"](), ij.Tile(row=5, col=7, height=20, width=31)
    full = ij.render(can(), camera, ("depth",)).depth
    found = ij.render(can(), camera, ("depth",), tile, ij.Effort(stride=4)).depth
    np.testing.assert_allclose(found, full[5:25:4, 7:38:4], rtol=1e-6)


def test_coverage_is_hard_sampled_or_exact():
    camera = CAMERAS["pinhole"]()
    exact = ij.render(can(), camera, ("coverage",)).coverage
    np.testing.assert_array_equal(exact, ij.coverage(can(), camera))
    hard = ij.render(can(), camera, ("coverage", "mask"), effort="fast")
    strided = np.asarray(ij.render(can(), camera, ("mask",)).mask)[::2, ::2]
    np.testing.assert_array_equal(hard.coverage, strided.astype(float))
    errors = []
    for samples in (2, 8):
        effort = ij.Effort(samples=samples)
        found = ij.render(can(), camera, ("coverage",), effort=effort).coverage
        errors.append(np.abs(found - exact).max())
    # An edge may cut off a row of samples more or less on each side.
    assert errors[1] < 0.25
    assert errors[1] < errors[0]


@FULL
@pytest.mark.parametrize("extent", ["frame", "tile"])
def test_exact_coverage_on_a_tile_keeps_pixels_whose_center_misses(extent):
    camera = CAMERAS["pinhole"]()
    effort = ij.Effort(stride=2, extent=extent)
    found = ij.render(can(), camera, ("coverage", "mask"), effort=effort)
    expected = ij.coverage(can(), camera)[::2, ::2]
    # A smaller tile has its outline in other steps, whose bend is left out.
    np.testing.assert_allclose(found.coverage, expected, atol=5e-4)
    assert (np.asarray(found.coverage)[~np.asarray(found.mask)] > 0).any()


def test_coverage_of_a_scene_is_sampled():
    camera, scene = CAMERAS["pinhole"](), ij.Scene([can()])
    with pytest.raises(ValueError, match="effort must have samples of 2 or more"):
        ij.render(scene, camera, ("coverage",))
    found = ij.render(scene, camera, ("coverage",), effort=ij.Effort(samples=4))
    alone = ij.render(can(), camera, ("coverage",), effort=ij.Effort(samples=4))
    np.testing.assert_allclose(found.coverage, alone.coverage, atol=1 / 16)


def test_samples_are_refused_with_a_lens():
    effort = ij.Effort(samples=2)
    with pytest.raises(ValueError, match="effort must have samples of 1 for a camera"):
        ij.render(can(), CAMERAS["distorted"](), ("coverage",), effort=effort)


@FULL
def test_precision_is_that_of_the_effort(dtype):
    camera = CAMERAS["posed"]()
    for precision in ("float32", "float64"):
        effort = ij.Effort(precision=precision)
        for shape in (can(), ij.Scene([can(), can()])):
            maps = ij.render(shape, camera, ("depth", "normal"), effort=effort)
            assert maps.depth.dtype == maps.normal.dtype == precision
    own = ij.render(can(), camera, ("depth",), effort=ij.Effort(extent="tile"))
    assert own.depth.dtype == dtype


def test_double_precision_needs_no_setting():
    camera = CAMERAS["pinhole"]()
    single = np.asarray(ij.render(can(), camera, ("depth",)).depth)
    double = np.asarray(ij.render(can(), camera, ("depth",), effort="exact").depth)
    hit = np.isfinite(single) & np.isfinite(double)
    assert double.dtype == np.float64
    assert 0 < np.abs(single[hit] - double[hit]).max() < 1e-5


@FULL
def test_a_traced_shape_is_rendered_in_jaxs_precision_alone():
    camera = CAMERAS["pinhole"]()

    def depth(radius, effort):
        shape = ij.Cylinder((0, 0, 1), (0, 1, 0), radius, 0.2)
        return ij.render(shape, camera, ("depth",), effort=effort).depth

    traced = jax.jit(depth, static_argnums=1)
    with pytest.raises(ValueError, match="precision must be JAX's own, float32, in a"):
        traced(jnp.float32(0.1), ij.Effort(precision="float64"))
    # A tile whose size depends on the shape cannot be: the frame it is.
    found = traced(jnp.float32(0.1), ij.Effort(precision="float32", extent="tile"))
    np.testing.assert_allclose(found, depth(0.1, "balanced"), rtol=1e-5)


@RELEASE
def test_misses_are_what_maps_hold_where_nothing_is_hit():
    maps = ij.render(can(), CAMERAS["pinhole"](), OUTPUTS)
    seen = np.asarray(maps.mask) | (np.asarray(maps.coverage) > 0)
    # Of a pixel beside an edge, a straight line may leave less than a thousandth.
    around = np.lib.stride_tricks.sliding_window_view(np.pad(seen, 1), (3, 3))
    missed = ~around.any(axis=(-2, -1))
    for name, value in MISSES.items():
        assert (np.asarray(getattr(maps, name))[missed] == value).all(), name
