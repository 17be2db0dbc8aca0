import numpy as np
import pytest

from impostor_jax.sensor.dropout import Dropout
from impostor_jax.sensor.gaussian import ConstantNoise
from impostor_jax.sensor.lateral import LateralNoise
from tests.sensor.scenes import SHAPE, bands, readings

# Less than what single precision resolves of a depth of 1 m.
STILL = ConstantNoise(1e-9)


@pytest.mark.parametrize(
    ("degrees", "deviation"),
    [
        pytest.param(0, 0.8, id="normal incidence"),
        pytest.param(72, 0.94, id="72 degrees: the ratio is 4"),
        pytest.param(88, 1.08, id="held constant from 80 degrees: the ratio is 8"),
    ],
)
def test_readings_come_from_pixels_as_far_away_as_the_paper_says(degrees, deviation):
    # Depth numbers the pixels.
    numbers = np.arange(SHAPE[0] * SHAPE[1]).reshape(SHAPE)
    sample = readings(LateralNoise(STILL), 1 + 1e-4 * numbers, np.radians(degrees))
    found = np.rint((sample - 1) / 1e-4).astype(int)
    np.testing.assert_allclose(sample, 1 + 1e-4 * found, atol=1e-6)
    row, col = np.divmod(found, SHAPE[1])
    here_row, here_col = np.divmod(numbers, SHAPE[1])
    inner = np.s_[:, 8:-8, 8:-8]
    # Rounding to whole pixels adds 1/12 to the variance.
    spread = np.sqrt(deviation**2 + 1 / 12)
    for shift in ((row - here_row)[inner], (col - here_col)[inner]):
        # 4.5 standard errors of 24576 draws.
        assert abs(shift.mean()) < 4.5 * spread / np.sqrt(shift.size)
        assert abs(shift.std() / spread - 1) < 4.5 / np.sqrt(2 * shift.size)


def test_an_edge_is_ragged_and_a_facing_surface_is_not_moved():
    depth = bands([0.8, 1.2, np.inf], 1)
    sample = readings(LateralNoise(STILL), depth)
    edges = np.flatnonzero(depth[0, 1:] != depth[0, :-1])
    assert len(edges) == 2
    own = np.isclose(sample, depth[None], atol=1e-6)
    beside = np.zeros(SHAPE[1], bool)
    for edge, sides in zip(edges, ([0.8, 1.2], [1.2, np.inf]), strict=True):
        beside[edge - 5 : edge + 7] = True
        for col in (edge, edge + 1):
            seen = sample[..., col]
            assert np.isclose(seen[..., None], sides, atol=1e-6).any(-1).all()
            # A shift of half a pixel or more: 0.266, and 4.5 standard errors of 768.
            other = 1 - own[..., col].mean()
            assert abs(other - 0.266) < 4.5 * np.sqrt(0.266 * 0.734 / seen.size)
    assert own[..., ~beside].all()


def test_the_sensor_reads_depth_and_normal_of_one_place():
    # With its own normal, that of nothing, a pixel beside the object drops the reading.
    noise = LateralNoise(Dropout(STILL, rate=0))
    sample = readings(noise, bands([1.0, np.inf], 1))
    assert np.isfinite(sample[..., SHAPE[1] // 2]).any()
    assert not (sample == 0).any()


def test_noise_of_neighbors_is_independent():
    # The scene is shifted and not the readings, which two pixels would share.
    sample = readings(LateralNoise(ConstantNoise(0.002)), 1.0)
    first, second = sample[..., :-1].ravel() - 1, sample[..., 1:].ravel() - 1
    # 4.5 standard errors of 48384 pairs.
    assert abs(np.corrcoef(first, second)[0, 1]) < 4.5 / np.sqrt(first.size)
