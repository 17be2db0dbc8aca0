import pytest

from impostor_jax.io.color_image import srgb

# Light of some levels of 8 bits, by the inverse formula of IEC 61966-2-1.
LEVELS = {
    0: 0.0,
    1: 0.00030353,
    10: 0.00303527,
    11: 0.00334654,
    188: 0.50288646,
    255: 1,
}


@pytest.mark.parametrize(("level", "light"), LEVELS.items())
def test_light_of_a_level_has_that_level(level, light):
    assert 255 * srgb(light) == pytest.approx(level, abs=1e-3)


def test_light_beyond_a_screen_is_clipped():
    assert srgb([-1.0, 7.0, float("inf")]) == pytest.approx([0, 1, 1])
