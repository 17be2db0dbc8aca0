"""Fits of real depth images, where IMPOSTOR_DATA names their folder."""

import os
from pathlib import Path

import pytest

import impostor_jax as ij
from impostor_jax.io.camera_file import read_camera
from impostor_jax.io.depth_image import read_depth, read_mask
from tests.groups import LARGE_IMAGES, RELEASE

DATA = os.environ.get("IMPOSTOR_DATA")
# The sensor's own pixels are 1.88 of the color image's, to which depth was warped.
KINECT = ij.MatchingWindow(ij.StructuredLight(), native_scale=1066.8 / 567.6)
STEREO = ij.MatchingWindow(ij.StereoDisparity(964.36))
CASES = [
    # Radii of the published YCB scan meshes; the mug's is what a PCL tutorial prints.
    ("ycb_table", "depth.png", "mask_master_chef_can.png", KINECT, 0.0498),
    ("ycb_table", "depth.png", "mask_soup_can_lying.png", KINECT, 0.0330),
    ("stereo_mug", "depth.tiff", "mask_mug.png", STEREO, 0.0396),
]

SEARCHED = [
    # A white cup on a chair, which tapers, is found as well.
    ("ycb_table", "depth.png", "camera.json", (0.0498, 0.0330, None)),
    ("field", "desk_depth.png", "desk_camera.json", (0.0330,)),
    # Another tin beside this one has not been measured.
    ("field", "tin35_depth.png", "tin_camera.json", (0.0984, None)),
    ("field", "tin36_depth.png", "tin_camera.json", (0.0984, None)),
]
"""Photographs of tables, and the radii of what is a cylinder in them."""

if DATA is not None:

    def fitted(folder, depth, mask, sensor=None):
        """The fit of a real image's can."""
        place = Path(DATA) / folder
        camera, scale = read_camera(place / "camera.json")
        return ij.fit_cylinder(
            read_depth(place / depth, scale),
            camera,
            mask=read_mask(place / mask),
            sigma=sensor,
        )

    @LARGE_IMAGES
    @RELEASE
    @pytest.mark.parametrize(("folder", "depth", "mask", "sensor", "radius"), CASES)
    def test_real_can_is_fitted_within_4_mm_of_its_radius(
        folder, depth, mask, sensor, radius
    ):
        fit = fitted(folder, depth, mask)
        assert fit.success
        assert float(fit.cylinder.radius) == pytest.approx(radius, abs=0.004)
        # The masks leave out the ends.
        assert not fit.height_observed

    @LARGE_IMAGES
    @pytest.mark.parametrize(
        ("folder", "depth", "mask", "sensor", "radius"),
        [CASES[0], *(pytest.param(*case, marks=RELEASE) for case in CASES[1:])],
    )
    def test_a_sensor_that_knows_its_window_is_within_1_5_mm_and_its_interval(
        folder, depth, mask, sensor, radius
    ):
        fit = fitted(folder, depth, mask, sensor)
        assert fit.success
        off = abs(float(fit.cylinder.radius) - radius)
        assert off < 0.0015
        assert off < 1.96 * float(fit.std.radius) < 0.003

    @LARGE_IMAGES
    @RELEASE
    @pytest.mark.parametrize(("folder", "depth", "camera", "radii"), SEARCHED)
    def test_real_cans_are_found_with_nothing_told(folder, depth, camera, radii):
        camera, scale = read_camera(Path(DATA) / folder / camera)
        found = ij.find_cylinders(
            read_depth(Path(DATA) / folder / depth, scale), camera
        )
        assert len(found.fits) == len(radii)
        for radius in filter(None, radii):
            off = [abs(float(fit.cylinder.radius) - radius) for fit in found.fits]
            nearest = found.fits[off.index(min(off))]
            assert min(off) < 1.96 * float(nearest.std.radius)
