"""Fits of real depth images, where IMPOSTOR_DATA names their folder."""

import os
from pathlib import Path

import pytest

import impostor_jax as ij
from impostor_jax.io.camera_file import read_camera
from impostor_jax.io.depth_image import read_depth, read_mask
from tests.groups import LARGE_IMAGES

DATA = os.environ.get("IMPOSTOR_DATA")
CASES = [
    # Radii of the published YCB scan meshes; the mug's is what a PCL tutorial prints.
    ("ycb_table", "depth.png", "mask_master_chef_can.png", 0.0498),
    ("ycb_table", "depth.png", "mask_soup_can_lying.png", 0.0330),
    ("stereo_mug", "depth.tiff", "mask_mug.png", 0.0396),
]

if DATA is not None:

    @LARGE_IMAGES
    @pytest.mark.parametrize(("folder", "depth", "mask", "radius"), CASES)
    def test_real_can_is_fitted_within_4_mm_of_its_radius(folder, depth, mask, radius):
        place = Path(DATA) / folder
        camera, scale = read_camera(place / "camera.json")
        fit = ij.fit_cylinder(
            read_depth(place / depth, scale), camera, mask=read_mask(place / mask)
        )
        assert fit.success
        assert float(fit.cylinder.radius) == pytest.approx(radius, abs=0.004)
        # The masks leave out the ends.
        assert not fit.height_observed
