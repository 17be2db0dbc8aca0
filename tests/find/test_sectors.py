"""Sectors of a scan: what is searched is what was read."""

import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find.normals import normals_of
from impostor_jax.find.planes import planes_of, primitives_of
from impostor_jax.find.sectors import sectors_of, view_of_sector
from tests.groups import FULL

SCANNER = ij.SphericalCamera.regular(720, 120, 0.5, -0.7)
NOISE = ij.ConstantNoise(0.002)


def views_of(ranges, camera=SCANNER, most_pixels=10**6):
    return [
        (sector, view_of_sector(sector, ranges, camera, NOISE, most_pixels))
        for sector in sectors_of(camera)
    ]


@pytest.mark.parametrize("start", [-np.pi, 0.3, 2.0])
def test_sectors_of_a_full_turn_overlap_all_around(start):
    azimuth = start + np.arange(360) * (2 * np.pi / 360)
    sectors = sectors_of(ij.SphericalCamera([0.1, 0.0], azimuth))
    assert len(sectors) == 6
    seen = np.zeros(360, int)
    for sector in sectors:
        assert len(sector.cols) in (80, 81)
        assert (np.diff(sector.azimuth) > 0).all()
        turned = np.angle(np.exp(1j * (azimuth[sector.cols] - sector.middle)))
        np.testing.assert_allclose(turned, sector.azimuth, atol=1e-9)
        seen[sector.cols] += 1
    assert set(seen) == {1, 2}


@pytest.mark.parametrize("span", [20, 80, 81, 140, 200, 300])
def test_sectors_of_a_part_of_a_turn_hold_all_of_it(span):
    azimuth = np.radians(np.linspace(0, -span, 101) + 100)
    sectors = sectors_of(ij.SphericalCamera([0.1, 0.0], azimuth))
    assert len(sectors) == 1 + max(0, np.ceil((span - 80) / 60))
    assert set(np.concatenate([s.cols for s in sectors])) == set(range(101))


def test_points_of_a_sector_are_those_of_the_scan():
    rng = np.random.default_rng(0)
    ranges = rng.uniform(1, 30, (120, 720)).astype(np.float32)
    ranges[20:30, 100:500] = 0
    row, col = SCANNER.frame.pixels()
    points = SCANNER.rays(row, col, np.float32).at(jnp.asarray(ranges)).stack()
    for sector, view in views_of(ranges):
        turned = sector.sector_from_camera.apply(points[:, sector.cols])
        np.testing.assert_allclose(view.points, turned, atol=1e-5)
        np.testing.assert_array_equal(view.valid, ranges[:, sector.cols] > 0)
        # Along z a reading errs by less than along the ray.
        forward = np.asarray(turned)[..., 2] / np.maximum(ranges[:, sector.cols], 1e-9)
        expected = np.where(view.valid, 0.002 * forward, 0)
        np.testing.assert_allclose(view.sigma, expected, rtol=1e-4, atol=1e-9)
        mask = np.zeros(view.depth.shape, bool)
        mask[3, 5] = True
        assert np.argwhere(sector.of_scan(mask)).tolist() == [[3, sector.cols[5]]]


def test_a_large_scan_is_searched_at_every_second_reading():
    ranges = np.full((120, 720), 5.0, np.float32)
    sector, view = views_of(ranges, most_pixels=6000)[0]
    assert view.stride == 2
    assert view.depth.shape == (60, -(-len(sector.cols) // 2))
    step = 2 * max(1.2 / 119, 2 * np.pi / 720)
    assert view.footprint == pytest.approx(step)


def test_steep_readings_are_not_searched():
    camera = ij.SphericalCamera(np.radians([80, 59, 0]), np.linspace(-0.4, 0.4, 9))
    ((_, view),) = views_of(np.full((3, 9), 5.0, np.float32), camera)
    assert not view.valid[0].any()
    assert view.valid[1:].all()
    assert np.isfinite(view.points).all()


def test_the_ground_is_the_same_plane_in_every_sector():
    ground = ij.Plane((0, 1.6, 0), (0.05, -1, 0.02))
    ranges = np.asarray(ij.render(ground, SCANNER, ("depth",), miss=0.0).depth)
    ranges = np.where(ranges < 25, ranges, 0).astype(np.float32)
    for sector, view in views_of(ranges):
        normals = normals_of(view, view.valid)
        known = np.isfinite(normals.error)
        move = sector.sector_from_camera
        expected = np.asarray(move.rotate(ground.unit_normal))
        assert np.median(normals.normal[known] @ expected) > 0.9999
        points, found = primitives_of(view, planes_of(view, view.valid))
        assert len(found) == 1
        assert found[0] @ expected > 0.99999
        back = move.inverse().apply(jnp.asarray(points, jnp.float32))
        (away,) = np.asarray(back - ground.point[None]) @ ground.unit_normal
        assert abs(away) < 0.005


@FULL
def test_stems_all_around_are_found_once():
    feet = [(-0.3, -5.0), (4.0, 2.5), (0.1, 4.0)]
    stems = [ij.Cylinder((x, 0, z), (0.05, 1, 0.02), 0.3, 6.0) for x, z in feet]
    scene = ij.Scene([*stems, ij.Plane((0, 1.6, 0), (0, -1, 0))])
    maps = ij.render(scene, SCANNER, ("depth", "index"), miss=0.0)
    rng = np.random.default_rng(0)
    noise = 0.002 * rng.standard_normal(maps.depth.shape).astype(np.float32)
    ranges = np.where((maps.depth > 0) & (maps.depth < 30), maps.depth + noise, 0)
    found = ij.find_cylinders(ranges, SCANNER, sigma=0.002)
    assert len(found) == 3
    index = np.asarray(maps.index)
    for fit, mask in zip(found.fits, found.masks, strict=True):
        number = np.bincount(index[mask]).argmax()
        assert abs(fit.cylinder.radius - 0.3) < 0.003
        assert abs(fit.cylinder.axis @ stems[number].axis) > 0.9999
