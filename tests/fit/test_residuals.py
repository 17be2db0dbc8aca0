import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.fit.residuals import (
    Rows,
    residual_gradient,
    residuals,
    surface_seen,
)
from impostor_jax.fit.robust import pseudo_huber_residual
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.primitives.cylinder import Cylinder

CYLINDERS = {
    "seen from outside": ((0.02, 0.01, 0.8), (0.3, 0.8, 0.52), 0.1, 0.3),
    "camera inside": ((0.02, 0.01, 0.1), (0.3, 0.2, 0.9), 0.2, 0.6),
    "along the view": ((0.0, 0.0, 0.8), (0, 0, 1), 0.1, 0.3),
}


def rows_of(dtype, count=800):
    rng = np.random.default_rng(0)
    x, y = jnp.asarray(rng.uniform(-0.4, 0.4, (2, count)), dtype)
    # The ray along the view, too.
    x, y = x.at[0].set(0), y.at[0].set(0)
    one = jnp.ones_like(x)
    return Rows(
        direction=Vec3(x, y, one),
        end=jnp.asarray(rng.choice([0, 0, -1, 1], count), dtype).at[0].set(0),
        target=one,
        weight=one,
    )


@pytest.fixture(params=CYLINDERS)
def shape(request):
    return CYLINDERS[request.param]


@pytest.mark.parametrize("soft", [0.03, 0.001])
@pytest.mark.usefixtures("double")
def test_gradient_is_that_of_automatic_differentiation(shape, soft):
    cylinder, rows = Cylinder(*shape), rows_of(np.float64)
    soft = jnp.asarray(soft)
    # Without the custom rule.
    plain = jax.jacfwd(lambda c: residuals.fun(rows, c, soft))(cylinder)
    found = residual_gradient(rows, cylinder, soft)
    a = cylinder.axis
    # The axis only moves on the sphere.
    onto = jnp.eye(3) - a[:, None] * a[None]
    for expected, part in (
        (plain.center, found[:, :3]),
        (plain.axis @ onto, found[:, 3:6] @ onto),
        (plain.radius, found[:, 6]),
        (plain.height, found[:, 7]),
    ):
        np.testing.assert_allclose(part, expected, atol=1e-9, rtol=1e-9)


@pytest.mark.usefixtures("double")
def test_derivatives_in_depth_and_rays_are_automatic():
    cylinder, rows = Cylinder(*CYLINDERS["seen from outside"]), rows_of(np.float64)
    tangent = jax.tree.map(lambda x: jnp.ones_like(x) * 0.1, rows)
    # What kind of row it is does not move.
    tangent = eqx.tree_at(lambda t: t.end, tangent, jnp.zeros_like(rows.end))

    def at(step):
        moved = jax.tree.map(lambda x, t: x + step * t, rows, tangent)
        return residuals(moved, cylinder, 0.01)

    _, forward = jax.jvp(at, (0.0,), (1.0,))
    numeric = (at(1e-7) - at(-1e-7)) / 2e-7
    # A difference may cross the edge of a cap.
    close = np.abs(numeric - forward) < 1e-5 * (1 + np.abs(forward))
    assert close.mean() > 0.99


def test_surface_is_what_the_primitive_shows(shape, dtype):
    cylinder, rows = Cylinder(*shape), rows_of(dtype)
    seen = surface_seen(rows.direction, cylinder)
    zero = jnp.zeros_like(rows.end)
    hit = cylinder.intersect(Ray(Vec3(zero, zero, zero), rows.direction))
    # The far end has no part here; from outside its rim hides nothing.
    mask = np.asarray(hit.mask)
    assert mask.sum() > 20
    error = np.abs(np.asarray(seen.depth) - np.asarray(hit.t))[mask]
    assert np.median(error) < eps(dtype, 8)
    np.testing.assert_array_equal(
        np.asarray(seen.on_cap)[mask], np.asarray(hit.on_cap)[mask]
    )


def test_depth_grows_steadily_as_the_wall_recedes_from_a_ray():
    def at_radius(radius):
        return Cylinder((0, 0, 1), (0, 1, 0), radius, 1)

    zero, one = jnp.zeros(1), jnp.ones(1)
    direction = Vec3(one * 0.05, zero, one)
    depths = [
        float(surface_seen(direction, at_radius(r), 0.001).depth[0])
        for r in np.linspace(0.06, 0.04, 41)
    ]
    assert (np.diff(depths) > 0).all()


def test_pseudo_huber_has_its_loss_and_a_derivative_at_zero(dtype):
    r = jnp.asarray([-30.0, -1.0, 0.0, 1e-4, 2.0, 1e6], dtype)
    width = 2.0
    loss = 2 * width**2 * (np.sqrt(1 + (np.asarray(r, float) / width) ** 2) - 1)
    found = np.asarray(pseudo_huber_residual(r, width), float)
    # The cancellation is in the reference.
    np.testing.assert_allclose(found**2, loss, rtol=1e-6, atol=1e-14)
    slope = jax.grad(lambda r: pseudo_huber_residual(r, width))(jnp.zeros((), dtype))
    assert float(slope) == 1
