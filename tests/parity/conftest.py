"""One renderer for the tests of a module."""

import pytest

from impostor_jax.glsl.offscreen import DriverError, OffscreenRenderer


@pytest.fixture(scope="module")
def renderer():
    try:
        found = OffscreenRenderer()
    except DriverError as error:
        pytest.skip(str(error))
    with found:
        yield found
