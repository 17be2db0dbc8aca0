"""Ends that stand on something: a table around a foot, and what only looks like one."""

from typing import Any

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.round_body import RoundBody
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.standing import standing_on
from impostor_jax.geometry.so3 import directions_across
from impostor_jax.opencv import cv2
from tests.fit.scenes import CAMERA, SIGMA, can
from tests.groups import FULL, SMALL_IMAGES

pytestmark = SMALL_IMAGES

CAN = can()
AXIS = np.asarray(CAN.axis, float)
HALF = float(CAN.height) / 2
FOOT = np.asarray(CAN.center, float) + HALF * AXIS
ROW, COL = np.mgrid[: CAMERA.height, : CAMERA.width]
RAYS = np.stack(
    [(COL - 79.5) / 150.0, (ROW - 59.5) / 150.0, np.ones(ROW.shape)], axis=-1
)
UPPER_SEEN = np.array([True, False])


def plane_depth(normal=AXIS, through=FOOT):
    """Of a table below."""
    return (through @ normal) / (RAYS @ normal)


def depth_of(shape):
    maps = ij.render(shape, CAMERA, outputs=("depth", "mask"))
    return np.where(np.asarray(maps.mask), np.asarray(maps.depth), np.inf)


def seen_of(shape: Any = CAN, *others, table=None, sigma=SIGMA):
    """Depth of a thing among others on a table, and its mask."""
    table = plane_depth() if table is None else table
    table = np.where(table > 0, table, np.inf)
    behind = np.minimum.reduce([np.full(table.shape, 2.0), table, *others])
    mask = depth_of(shape) < behind
    noise = np.random.default_rng(0).normal(0, sigma, table.shape)
    depth = np.minimum(depth_of(shape), behind) + noise
    return depth.astype(np.float32), mask


def block(front, height):
    """A box on the table in front of the can, and its rotation."""
    toward = -RAYS[60, 80] + (RAYS[60, 80] @ AXIS) * AXIS
    toward /= np.linalg.norm(toward)
    rotation = np.stack([toward, np.cross(AXIS, toward), AXIS], axis=1)
    center = FOOT - AXIS * height / 2 + toward * (float(CAN.radius) + front + 0.02)
    return depth_of(ij.Box(center, rotation, (0.04, 0.2, height)))


def test_a_can_on_a_table_has_a_height_and_says_what_it_rests_on():
    depth, mask = seen_of()
    fit = ij.fit_cylinder(depth, CAMERA, mask, sigma=SIGMA)
    assert fit.success
    assert fit.ends_seen.all()
    off = float(fit.cylinder.height - CAN.height)
    assert abs(off) < 4 * float(fit.std.height) < 0.002
    assert fit.stands
    assert fit.to_dict()["stands"] is True
    assert "a plane that is seen around its foot" in str(fit)


@FULL
@pytest.mark.parametrize("wider", [-2, 3])
def test_a_foot_does_not_depend_on_the_mask(wider):
    depth, mask = seen_of()
    change = cv2.dilate if wider > 0 else cv2.erode
    marks = change(mask.astype(np.uint8), np.ones((3, 3)), iterations=abs(wider))
    fit = ij.fit_cylinder(depth, CAMERA, marks > 0, sigma=SIGMA)
    assert fit.success
    assert abs(float(fit.cylinder.height - CAN.height)) < 4 * float(fit.std.height)


@FULL
def test_boxes_and_cups_stand_on_tables_too():
    rotation = np.stack([*directions_across(AXIS), AXIS], axis=1)
    box = ij.Box(FOOT - HALF * AXIS, rotation, (0.06, 0.07, 2 * HALF))
    depth, mask = seen_of(box)
    fit = ij.fit_box(depth, CAMERA, mask, sigma=SIGMA)
    assert fit.success
    assert fit.ends_seen.all()
    upright = np.argmax(np.abs(AXIS @ np.asarray(fit.box.rotation)))
    off = float(fit.box.size[upright]) - 2 * HALF
    assert abs(off) < 4 * float(fit.std.size[upright])
    cup = ij.Frustum(FOOT - 2 * HALF * AXIS, FOOT, 0.045, 0.035)
    depth, mask = seen_of(cup)
    fit = ij.fit_frustum(depth, CAMERA, mask, sigma=SIGMA)
    assert fit.success
    assert fit.ends_seen.all()
    off = float(np.linalg.norm(fit.frustum.p2 - fit.frustum.p1)) - 2 * HALF
    assert abs(off) < 4 * float(fit.std.height)


def sloping(degrees):
    """A table that slopes against the can, through the middle of its foot."""
    angle = np.radians(degrees)
    aside = np.cross(AXIS, (0.0, 0.0, 1.0))
    aside /= np.linalg.norm(aside)
    return plane_depth(np.cos(angle) * AXIS + np.sin(angle) * aside)


@pytest.mark.parametrize(
    ("around", "is_found"),
    [
        (lambda: seen_of(), True),
        # Its foot is hidden, or met along one line.
        (lambda: seen_of(CAN, block(0.0, 0.05)), False),
        (lambda: seen_of(CAN, block(0.01, 0.05)), False),
        (lambda: seen_of(table=sloping(8.0)), False),
        # Nothing is below, or far below.
        (lambda: seen_of(table=np.full(RAYS.shape[:2], 0.6)), False),
        (lambda: seen_of(table=plane_depth(through=FOOT + 0.05 * AXIS)), False),
        (lambda: seen_of(table=plane_depth(through=FOOT + 0.006 * AXIS)), False),
        # Beside what surrounds it, at the height of a ring, the table is lower.
        (lambda: seen_of(CAN, depth_of(ring(1.6))), False),
        # A crescent: the edge of what it stands on is near.
        (
            lambda: seen_of(
                CAN, depth_of(stand(1.15)), table=plane_depth(through=FOOT + 0.1 * AXIS)
            ),
            False,
        ),
    ],
    ids=[
        *("table", "touching", "in front", "sloping", "wall", "floating"),
        *("hovering", "ring", "stand"),
    ],
)
def test_an_end_is_where_a_plane_goes_around_the_foot(around, is_found):
    depth, mask = around()
    seen = Seen(depth, mask, CAMERA, ij.ConstantNoise(SIGMA))
    standing = standing_on(seen, RoundBody.of(CAN), UPPER_SEEN)
    assert (standing is not seen) == is_found
    if is_found:
        background = standing.image > seen.image + 0.1
        assert standing.feet is not None
        assert (standing.feet[background] >= 0).all()
        assert not (background & standing.region).any()
        assert np.count_nonzero(standing.region ^ mask) < 0.02 * np.count_nonzero(mask)


def ring(wider):
    """A cylinder that the can stands in."""
    radius = wider * float(CAN.radius)
    return ij.Cylinder(FOOT - 0.01 * AXIS, AXIS, radius=radius, height=0.02)


def stand(wider):
    """A cylinder that the can stands on."""
    center = FOOT + 0.05 * AXIS
    return ij.Cylinder(center, AXIS, radius=wider * float(CAN.radius), height=0.1)
