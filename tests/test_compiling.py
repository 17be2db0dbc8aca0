import jax.numpy as jnp
import pytest

from impostor_jax import compiling


@pytest.fixture(autouse=True)
def forget():
    """Options are asked for once in a process."""
    compiling._known_options.cache_clear()
    yield
    compiling._known_options.cache_clear()


def times(array, factor):
    return array * factor


def test_the_older_generator_is_asked_for_where_there_is_one():
    assert compiling._known_options() == compiling.OLDER_GENERATOR
    assert compiling.quickly_compiled(times) is compiling.quickly_compiled(times)


def test_an_option_that_xla_does_not_know_is_left_out(monkeypatch):
    monkeypatch.setattr(compiling, "OLDER_GENERATOR", {"xla_cpu_no_such": False})
    doubled = compiling.quickly_compiled(times, static_argnames="factor")
    assert compiling._known_options() is None
    assert doubled(jnp.ones(3), factor=2).tolist() == [2, 2, 2]
