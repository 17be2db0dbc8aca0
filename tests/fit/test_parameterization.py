import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.fit.parameterization import Chart
from impostor_jax.numerics import eps
from tests.fit.scenes import can


def chart(fixed=()):
    return Chart.around(can(), jnp.asarray(1e-3), jnp.asarray(2e-3), fixed)


def test_zero_is_the_reference(dtype):
    moved = chart().cylinder(jnp.zeros(7))
    for one, other in zip(jax.tree.leaves(moved), jax.tree.leaves(can()), strict=True):
        np.testing.assert_allclose(one, other, rtol=eps(dtype, 4))


def test_any_vector_gives_a_cylinder():
    moved = chart().cylinder(jnp.asarray([90.0, -300, 5, 7, -200, 400, -500]))
    assert float(moved.radius) > 0
    assert float(moved.height) > 0
    assert float(jnp.linalg.norm(moved.axis)) == pytest.approx(1, abs=1e-6)


def test_an_end_moves_alone(dtype):
    moved = chart().cylinder(jnp.asarray([0, 0, 0, 0, 0, 0, 0.5], dtype))
    low = can().center - can().axis * can().height / 2
    found = moved.center - moved.axis * moved.height / 2
    # The height is an exponential: to first order in 1 mm of 120.
    np.testing.assert_allclose(found, low, atol=1e-5)
    assert float(moved.height) == pytest.approx(0.121, abs=1e-5)


@pytest.mark.parametrize(
    ("fixed", "size"),
    [
        ((), 7),
        (("radius",), 6),
        (("height",), 6),
        (("axis",), 5),
        (("center",), 4),
        (("center", "height"), 3),
        (("center", "axis", "radius"), 1),
    ],
)
def test_held_parameters_do_not_move(fixed, size, dtype):
    held = chart(fixed)
    assert held.size == size
    moved = held.cylinder(jnp.arange(1.0, size + 1))
    for name in ("center", "axis", "radius", "height"):
        same = np.allclose(getattr(moved, name), getattr(can(), name), rtol=1e-6)
        assert same == (name in fixed)


@pytest.mark.usefixtures("double")
def test_tangent_is_the_derivative_at_zero():
    derivative = jax.jacfwd(chart().cylinder)(jnp.zeros(7))
    stacked = jnp.concatenate(
        [derivative.center, derivative.axis, derivative.radius[None],
         derivative.height[None]]
    )  # fmt: skip
    found = chart().natural() @ chart().scale
    np.testing.assert_allclose(found, stacked, atol=1e-12)
