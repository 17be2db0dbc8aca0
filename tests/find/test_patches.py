"""Walls that are proposed from patches of an object."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find.normals import normals_of
from impostor_jax.find.patches import Part, patches_of, proposed
from impostor_jax.find.walls import POINTS, WIDE
from tests.checks import angle_between
from tests.find.scenes import CAMERA, CAMERAS, SIGMA, image_of, seen

LIMITS = (0.002, 1.0)


def tilted(degrees):
    angle = np.radians(degrees)
    return 0.6 * np.sin(angle), 0.8 * np.sin(angle), np.cos(angle)


CASES = {
    "can": (ij.Cylinder((0.01, 0.0, 0.4), tilted(90), 0.04, 0.14), 1, "pinhole"),
    "oblique": (ij.Cylinder((0.01, 0.0, 0.4), tilted(40), 0.04, 0.14), 1, "pinhole"),
    "pipe": (ij.Cylinder((0.05, 0.02, 0.5), tilted(12), 0.2, 4.0), -1, "pinhole"),
    "rod": (ij.Cylinder((0.0, 0.01, 0.4), tilted(75), 0.006, 0.2), 1, "pinhole"),
    "orthographic": (
        ij.Cylinder((0.01, 0.0, 0.4), tilted(60), 0.04, 0.14), 1, "orthographic",
    ),
    "lens": (ij.Cylinder((0.01, 0.0, 0.4), tilted(70), 0.04, 0.14), 1, "lens"),
}  # fmt: skip


def walls_of(image, camera, levels=(4,)):
    """Walls that are proposed of all that an image shows, the best first."""
    view = seen(image.depth, camera)
    part = Part(np.flatnonzero(view.valid), levels)
    (found,) = proposed(view, normals_of(view, view.valid), 1.0, [part], LIMITS, 50)
    order = np.argsort(-found.score.ravel())
    return [x.reshape(len(order), -1)[order].astype(float) for x in found.wall]


@pytest.mark.parametrize("name", CASES)
def test_one_of_the_best_proposals_is_right(name):
    can, side, camera = CASES[name]
    image = image_of([can], CAMERAS[camera])
    centers, axes, log_radii, sides = walls_of(image, CAMERAS[camera])
    axis, radius = np.asarray(can.axis, float), float(can.radius)
    # Where it is seen, which for a pipe is not at its center.
    points = seen(image.depth, CAMERAS[camera]).points[image.owner == 0]
    middle = (
        np.asarray(can.center)
        + np.median((points - np.asarray(can.center)) @ axis) * axis
    )
    right = 0
    for k in range(5):
        off = middle - centers[k]
        off -= (off @ axes[k]) * axes[k]
        right += (
            angle_between(axes[k], axis) < 5
            and np.linalg.norm(off) < 0.15 * radius
            and abs(np.exp(log_radii[k, 0]) / radius - 1) < 0.1
            and sides[k, 0] == side
        )
    assert right > 0


def test_radii_are_within_their_limits():
    image = image_of([CASES["can"][0]], sigma=3 * SIGMA)
    log_radii = walls_of(image, CAMERA)[2]
    assert np.exp(log_radii.min()) > 0.999 * LIMITS[0]
    assert np.exp(log_radii.max()) < 1.001 * LIMITS[1]


def test_nothing_is_proposed_of_nothing():
    view = seen(np.zeros((120, 160), np.float32))
    assert proposed(view, normals_of(view, view.valid), 1.0, [], LIMITS, 50) == []


def test_patches_cover_a_part_and_have_points_of_it_alone():
    pixels = np.flatnonzero(np.pad(np.ones((40, 60), bool), ((30, 50), (20, 80))))
    patches = patches_of(Part(pixels, (4, 9)), 160, 50)
    assert len(patches) == 1 + 4 + 9
    for own, wide in patches:
        assert (len(own), len(wide)) == (POINTS, WIDE)
        assert np.isin(own, pixels).all()
        assert np.isin(wide, pixels).all()
    for level, some in ((4, patches[1:5]), (9, patches[5:])):
        spans = [np.ptp(own // 160) * np.ptp(own % 160) for own, _ in some]
        assert max(spans) < 3.5 * len(pixels) / level
        covered = np.zeros((120, 160), bool)
        for own, _ in some:
            row, col = np.divmod(own, 160)
            covered[row.min() : row.max() + 1, col.min() : col.max() + 1] = True
        assert covered.ravel()[pixels].mean() > 0.9


def test_a_small_part_is_not_cut():
    assert len(patches_of(Part(np.arange(150), (4, 9)), 160, 50)) == 1
