import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.fit.ball import Ball
from impostor_jax.fit.residuals import residuals, surface_seen
from impostor_jax.fit.round_body import CylinderBody, FrustumBody
from impostor_jax.fit.rows import Kind, Rows
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.sphere import Sphere

BODIES = {
    "cylinder": lambda: CylinderBody.of(can()),
    "cylinder around the camera": lambda: CylinderBody.of(
        Cylinder((0.02, 0.01, 0.1), (0.3, 0.2, 0.9), 0.2, 0.6)
    ),
    "cylinder along the view": lambda: CylinderBody.of(
        Cylinder((0.0, 0.0, 0.8), (0, 0, 1), 0.1, 0.3)
    ),
    "frustum": lambda: FrustumBody.of(
        Frustum((0.0, -0.1, 0.75), (0.05, 0.1, 0.85), 0.12, 0.05)
    ),
    "frustum around the camera": lambda: FrustumBody.of(
        Frustum((0.0, -0.2, -0.2), (0.05, 0.2, 0.4), 0.15, 0.3)
    ),
    "frustum along the view": lambda: FrustumBody.of(
        Frustum((0.0, 0.01, 0.7), (0.0, 0.0, 1.0), 0.05, 0.12)
    ),
    "frustum from its wide end": lambda: FrustumBody.of(
        Frustum((0.0, 0.01, 0.7), (0.0, 0.0, 1.0), 0.12, 0.05)
    ),
    "sphere": lambda: Ball.of(Sphere((0.05, 0.0, 0.8), 0.15)),
    "sphere around the camera": lambda: Ball.of(Sphere((0.05, 0.0, 0.2), 0.5)),
}


def can():
    return Cylinder((0.02, 0.01, 0.8), (0.3, 0.8, 0.52), 0.1, 0.3)


def rows_of(dtype, count=800):
    """Rows of every kind, with all that weighs them."""
    rng = np.random.default_rng(0)

    def uniform(low, high):
        return jnp.asarray(rng.uniform(low, high, count), dtype)

    kind = rng.integers(0, len(Kind), count)
    is_end = kind == Kind.END
    # The ray along the view, too.
    x, y = uniform(-0.4, 0.4).at[0].set(0), uniform(-0.4, 0.4).at[0].set(0)
    square = jnp.asarray(kind == Kind.SQUARE)
    return Rows(
        direction=Vec3(x, y, jnp.ones_like(x)),
        kind=jnp.asarray(kind),
        end=jnp.asarray(np.where(is_end, rng.choice([-1, 1], count), 0), dtype),
        side=jnp.asarray(np.where(is_end, rng.choice([-1, 1], count), 0), dtype),
        target=jnp.where(square, 1e-3, uniform(0.7, 0.9)),
        weight=uniform(1, 2),
        slack=jnp.asarray(np.where(kind == Kind.WALL, 1e-4, 0), dtype),
        nearest=uniform(0.7, 0.9),
        half=uniform(0, 0.05),
        chord=uniform(0.001, 0.03),
    )


@pytest.fixture(params=BODIES)
def make(request):
    return BODIES[request.param]


def of_numbers(body, numbers):
    """The body whose center, axis, radius, height and slope are these."""
    names = ["center", "radius"] if isinstance(body, Ball) else ["center", "axis"]
    parts = [numbers[:3], numbers[3] if isinstance(body, Ball) else numbers[3:6]]
    if not isinstance(body, Ball):
        names += ["radius", "height"]
        parts += [numbers[6], numbers[7]]
    if isinstance(body, FrustumBody):
        names, parts = [*names, "growth"], [*parts, numbers[8] * numbers[7] / 2]
    return type(body)(**dict(zip(names, parts, strict=True)))


@pytest.mark.usefixtures("double")
def test_gradient_is_that_of_automatic_differentiation(make):
    body, rows = make(), rows_of(np.float64)

    @jax.jit
    def both(rows, numbers):
        plain = jax.jacfwd(lambda n: residuals(rows, of_numbers(body, n))[0])(numbers)
        return plain, residuals(rows, of_numbers(body, numbers))[1].T

    plain, found = both(rows, body.numbers)
    onto = np.eye(len(body.numbers))
    if not isinstance(body, Ball):
        # The axis only moves on the sphere.
        a = np.asarray(body.axis)
        onto[3:6, 3:6] -= a[:, None] * a[None]
    size = np.abs(plain).max(axis=1, keepdims=True)
    assert (size > 0).sum() > 100
    np.testing.assert_allclose((found @ onto) / size, (plain @ onto) / size, atol=1e-9)


def test_square_of_a_grazing_reading_is_unbiased():
    # A ray whose half-chord is one deviation; the depth itself would be off by a third
    # of a deviation on the mean of many readings.
    body = CylinderBody.of(Cylinder((0.0, 0.0, 0.8), (0, 1, 0), 0.04, 0.12))
    sigma, count = 0.001, 200_000
    x = np.sqrt(0.04**2 - sigma**2) / 0.8
    one = jnp.ones(count)
    direction = Vec3(one * np.float32(x), one * 0, one)
    seen = surface_seen(direction, body)
    half = jnp.sqrt(seen.square)
    noise = jnp.asarray(np.random.default_rng(0).normal(0, sigma, count), one.dtype)
    rows = Rows(
        direction=direction,
        kind=jnp.full(count, int(Kind.SQUARE)),
        end=one * 0,
        side=one * 0,
        target=(half - noise) ** 2 - sigma**2,
        weight=one / sigma,
        slack=one * 0,
        nearest=seen.nearest,
        half=half,
        chord=jnp.sqrt(seen.square + sigma**2 / 2),
    )
    found = np.asarray(residuals(rows, body)[0], float)
    # Four standard errors of a mean and of a deviation of a skewed residual.
    assert abs(found.mean()) < 4 / np.sqrt(count)
    assert found.std() == pytest.approx(1, abs=0.02)


def test_row_within_its_slack_has_neither_residual_nor_gradient():
    body, rows = CylinderBody.of(can()), rows_of(np.float32)
    rows = eqx.tree_at(lambda r: r.slack, rows, jnp.full_like(rows.slack, 1e9))
    value, gradient = jax.jit(residuals)(rows, body)
    assert not np.asarray(value).any()
    assert not np.asarray(gradient).any()


def test_surface_is_what_the_primitive_shows(make, dtype):
    body, rows = make(), rows_of(dtype)

    @jax.jit
    def both(direction):
        zero = jnp.zeros_like(direction.x)
        ray = Ray(Vec3(zero, zero, zero), direction)
        return surface_seen(direction, body), body.shape.intersect(ray)

    seen, hit = both(rows.direction)
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
        return CylinderBody.of(Cylinder((0, 0, 1), (0, 1, 0), radius, 1))

    zero, one = jnp.zeros(1), jnp.ones(1)
    direction = Vec3(one * 0.05, zero, one)
    depths = [
        float(surface_seen(direction, at_radius(r), 0.001).depth[0])
        for r in np.linspace(0.06, 0.04, 41)
    ]
    assert (np.diff(depths) > 0).all()
