"""Which pixels a fit takes, and in which order."""

import jax
import numpy as np
import pytest

from impostor_jax.fit.problem import BLOCK
from impostor_jax.fit.regions import (
    BUCKETS,
    TRACED_READINGS,
    pixel_indices,
    traced_indices,
)

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
    row, col = pixel_indices(region, most)
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
