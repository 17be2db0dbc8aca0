"""Which pixels a fit takes, and in which order."""

import jax
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.problem import BLOCK
from impostor_jax.fit.regions import (
    BUCKETS,
    MOST_READINGS,
    TRACED_READINGS,
    chosen_pixels,
    most_readings,
    pixel_indices,
    traced_indices,
)
from impostor_jax.fit.seen import Seen, all_shown_by, shown_by
from impostor_jax.sensor.gaussian import ConstantNoise

NOISE, SENSOR = ConstantNoise(0.001), ij.StructuredLight.sensor()

CAMERA = ij.PinholeCamera(300.0, 300.0, 109.5, 99.5, 220, 200)

traced = jax.jit(traced_indices, static_argnums=1)


def spread_evenly(values, size):
    """Whether sorted numbers of `size` are as far apart as can be, to two of them."""
    steps = np.diff(np.sort(values))
    wanted = size / len(values)
    return np.all(np.abs(steps - wanted) < 2)


@pytest.mark.parametrize(("side", "most"), [(10, None), (60, None), (60, 900)])
def test_indices_end_with_pixels_that_speak_for_all(side, most):
    region = np.zeros((80, 90), bool)
    region[5 : 5 + side, 7 : 7 + side] = True
    chosen = chosen_pixels(np.ones(region.shape), region, most or MOST_READINGS)
    row, col = pixel_indices(chosen, most)
    assert len(row) == (1024 if most else BUCKETS[0])
    used = row < 80
    assert region[row[used], col[used]].all()
    assert len(set(zip(row[used], col[used], strict=True))) == used.sum()
    assert used.sum() == (most or side * side)
    # From all over the region, and after all that only fills up.
    few = np.s_[-min(BLOCK, used.sum()) :]
    assert used[few].all()
    assert np.ptp(row[few]) >= side - 2
    assert np.ptp(col[few]) >= side - 6


def test_half_of_few_readings_are_beside_the_border_of_all():
    region = np.zeros((200, 220), bool)
    region[20:180, 30:190] = True
    image = np.where(region, 1.0, 0.0)
    # What a sensor mixes there has no reading, and a hole is no border.
    image[20:22], image[178:180], image[60, 60] = 0, 0, 0
    chosen = chosen_pixels(image, region, 1000)
    assert chosen.sum() == 1000
    assert (chosen <= region).all()
    ends = np.zeros_like(region)
    ends[20, 30:190] = ends[179, 30:190] = True
    ends[20:22, [30, 189]] = ends[178:180, [30, 189]] = True
    assert (chosen & (image == 0) == (chosen & ends)).all()
    num_ends = np.count_nonzero(chosen & ends)
    assert num_ends == 250
    beside = np.zeros_like(region)
    beside[[22, 177], 30:190] = beside[22:178, [30, 189]] = True
    assert np.count_nonzero(chosen & beside) == (1000 - num_ends) // 2
    inner = np.argwhere(chosen & ~beside & ~ends)
    # Evenly over the rest, to a tenth of it.
    assert np.allclose(inner.mean(axis=0), [99.5, 109.5], atol=5)
    assert np.allclose(inner.std(axis=0), 155 / np.sqrt(12), atol=5)


def test_no_more_readings_are_taken_than_there_are_sizes_for():
    region = np.ones((400, 300), bool)
    assert chosen_pixels(np.ones(region.shape), region, MOST_READINGS).sum() == 65536
    # Points are an image of one row.
    row = np.ones((1, 70000), bool)
    places = np.flatnonzero(chosen_pixels(np.ones(row.shape), row, MOST_READINGS))
    assert len(places) == 65536
    assert np.diff(places).max() <= 2
    few = np.ones((40, 30), bool)
    assert chosen_pixels(np.ones(few.shape), few, MOST_READINGS) is few


def test_of_readings_that_share_errors_fewer_are_taken():
    asked = [most_readings(None, noise) for noise in (NOISE, SENSOR)]
    assert asked == [65536, 16384]
    assert most_readings(20000, SENSOR) == 20000
    region = np.ones((CAMERA.height, CAMERA.width), bool)
    seen = Seen(np.ones(region.shape), region, CAMERA, SENSOR)
    assert not seen.is_taken(None)
    assert seen.is_taken(1 << 20)
    assert len(shown_by(seen).row) == 16384


def test_all_images_of_an_object_have_places_for_as_many_pixels():
    # Each pair of sizes was compiled anew.
    regions = np.zeros((2, CAMERA.height, CAMERA.width), bool)
    regions[0, :10, :10], regions[1, :80, :80] = True, True
    seen = [Seen(np.ones(one.shape), one, CAMERA, NOISE) for one in regions]
    for order in (1, -1):
        tables = all_shown_by(seen[::order])
        assert [len(one.row) for one in tables] == [16384] * 2
        read = [np.count_nonzero(one.rays.exists[:16384]) for one in tables]
        assert read == [100, 6400][::order]
        assert len({one.inside.shape for one in tables}) == 1


@pytest.mark.parametrize("most", [None, 1000])
@pytest.mark.parametrize(
    "count", [0, 1, 100, 511, 512, 513, 1023, 3000, 15871, 15872, 15873, 20000, 40000]
)
def test_traced_indices_take_each_pixel_once(count, most):
    region = np.zeros(40000, bool)
    chosen = np.random.default_rng(count).choice(40000, count, replace=False)
    region[chosen] = True
    # Column after column, as they are counted.
    row, col = (np.asarray(x) for x in traced(region.reshape(200, 200).T, most))
    used = row < 200
    index = col[used] * 200 + row[used]
    assert region[index].all()
    assert len(set(index)) == len(index) == min(count, most or TRACED_READINGS)
    # The last of them are evenly spread over the region's pixels, in their order.
    few = np.s_[-BLOCK:]
    assert used[few].sum() == min(count, BLOCK)
    last = (col[few] * 200 + row[few])[used[few]]
    rank = np.searchsorted(np.flatnonzero(region), last)
    thinned = max(count / (most or TRACED_READINGS), 1)
    assert not count or spread_evenly(rank / thinned, count / thinned)
    if count >= BLOCK:
        assert used[few].all()
    elif count:
        assert len(row) % BLOCK == 0


def test_all_of_a_small_image_may_be_the_region():
    row, col = (np.asarray(x) for x in traced(np.ones((20, 30), bool)))
    used = row < 20
    assert len(set(zip(row[used], col[used], strict=True))) == used.sum() == 600


def test_few_readings_stand_for_all_beside_the_border():
    row, col = np.indices((200, 220))
    region = (row - 100) ** 2 + (col - 110) ** 2 < 80**2
    image = np.where(region, np.float32(1), np.float32(0))
    seen = Seen(image, region, CAMERA, ij.ConstantNoise(0.001))
    whole, few = shown_by(seen), shown_by(seen, 1000)
    assert set(np.unique(whole.beside)) == {0, 1}
    taken, own = np.count_nonzero(few.beside), np.count_nonzero(whole.beside)
    assert 500 < taken < 0.4 * own
    assert few.beside.sum() == pytest.approx(own, rel=1e-5)
