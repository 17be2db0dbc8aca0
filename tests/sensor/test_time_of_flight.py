import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij


def test_sigma_grows_as_light_gets_less():
    noise = ij.TimeOfFlight(floor=0.001, growth=0.002)
    depth, cosine = np.meshgrid(np.float32([0.5, 2.0, 4.0]), np.float32([1, 0.5]))
    found = noise.sigma(jnp.asarray(depth), jnp.asarray(cosine))
    np.testing.assert_allclose(found, 0.001 + 0.002 * depth**2 / cosine, rtol=1e-6)
    grazing = noise.sigma(jnp.float32(1), jnp.float32(1e-3))
    assert float(grazing) == pytest.approx(0.001 + 0.002 / np.cos(np.radians(80)))


@pytest.mark.parametrize(
    ("sensor", "edges", "window", "length"),
    [
        (ij.TimeOfFlight.sensor(), 1, 0, 120),
        (ij.StructuredLight.sensor(), 0, 5, 20),
        (ij.StructuredLight.sensor(native_scale=1.88), 0, 9, 37.6),
        (ij.StereoDisparity.sensor(500.0), 0, 5, 20),
    ],
)
def test_whole_cameras_know_their_bias(sensor, edges, window, length):
    bias = sensor.bias
    assert (bias.edge_reach, bias.window_reach) == (edges, window)
    assert bias.fields[0].length == pytest.approx(length)
