"""What every primitive promises."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.geometry.rays import Ray
from impostor_jax.numerics import eps
from impostor_jax.primitives import PRIMITIVES as CLASSES
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.heightfield import Heightfield
from tests.cases import PRIMITIVES, is_decided, pose, rays_at
from tests.checks import all_finite, central_difference

# Further cases of a class run in single precision only, which is the harder one.
MORE = ("disc", "rod", "cylinder along z", "sector", "sheet")


@pytest.fixture(
    params=[(name, p) for name in PRIMITIVES for p in ("float32", "float64")
            if name not in MORE or p == "float32"],
    ids="-".join,
)  # fmt: skip
def case(request):
    """Name and default floating-point type."""
    with jax.enable_x64(request.param[1] == "float64"):
        yield request.param


@pytest.fixture
def dtype(case):
    return np.dtype(case[1])


@pytest.fixture
def primitive(case):
    return PRIMITIVES[case[0]]()


@pytest.fixture
def rays(primitive):
    return rays_at(primitive)


# One program for all tests of a case.
@jax.jit
def cast(primitive, rays):
    """Hit and normal."""
    hit = primitive.intersect(rays)
    return hit, primitive.normal(rays, hit)


@jax.jit
def distance_from(primitive, point):
    return primitive.implicit(point)


def reach(primitive, rays) -> float:
    """Largest length of the scene, which its rounding errors are in proportion to."""
    return float(jnp.max(rays.origin.norm() + rays.direction.norm()))


def test_every_class_has_a_case():
    kinds = {type(make()) for make in PRIMITIVES.values()}
    assert kinds == set(CLASSES.values())


def test_hits_lie_on_the_surface(primitive, rays, dtype):
    hit, _ = cast(primitive, rays)
    assert 20 < int(hit.mask.sum()) < hit.mask.size
    point = rays.at(jnp.where(hit.mask, hit.t, 0))
    distance = jnp.where(hit.mask, jnp.abs(distance_from(primitive, point)), 0)
    # A few roundings of the ray's length; grazing rays square-root them.
    assert float(jnp.median(distance)) < eps(dtype, 16) * reach(primitive, rays)
    assert float(distance.max()) < eps(dtype, 256) ** 0.9 * reach(primitive, rays)


def test_normals_are_unit_and_face_the_ray(primitive, rays, dtype):
    hit, normal = cast(primitive, rays)
    length = np.asarray(normal.norm())
    np.testing.assert_allclose(length[hit.mask], 1, atol=eps(dtype, 8))
    assert not length[~hit.mask].any()
    assert float((normal.dot(rays.direction)).max()) <= 0


def test_rays_leaving_a_hit_do_not_meet_the_solid_again(primitive, rays, dtype):
    hit, normal = cast(primitive, rays)
    outside = distance_from(primitive, rays.origin) > 0
    # Off the surface by more than its rounding errors.
    off = normal * (eps(dtype, 1024) ** 0.9 * reach(primitive, rays))
    start = rays.at(jnp.where(hit.mask, hit.t, 0)) + off
    again, _ = cast(primitive, Ray(start, normal))
    met = again.mask
    if isinstance(primitive, Heightfield):
        # A bent sheet may stand in the way farther on.
        met &= again.t < 0.01
    assert not (met & hit.mask & outside).any()


def test_a_miss_is_infinite(primitive, rays):
    hit, _ = cast(primitive, rays)
    assert np.isposinf(np.asarray(hit.t)[~hit.mask]).all()
    assert not (hit.on_cap & ~hit.mask).any()
    assert (np.asarray(hit.t)[hit.mask] > 0).all()


def visible_depth(primitive, rays):
    hit = primitive.intersect(rays)
    return jnp.where(hit.mask, hit.t, 0)


@pytest.mark.parametrize("name", PRIMITIVES)
def test_derivatives_are_finite_on_every_ray(name):
    # In single precision; each shape's own tests ask the same of double.
    primitive = PRIMITIVES[name]()
    rays = rays_at(primitive)
    forward = jax.jit(jax.jacfwd(visible_depth, argnums=(0, 1)))(primitive, rays)
    assert all_finite(forward)

    def loss(primitive, rays):
        hit = primitive.intersect(rays)
        normal = primitive.normal(rays, hit)
        return jnp.sum(jnp.where(hit.mask, hit.t, 0)) + jnp.sum(normal.stack() ** 3)

    assert all_finite(jax.jit(jax.grad(loss, argnums=(0, 1)))(primitive, rays))


@pytest.mark.parametrize("name", PRIMITIVES)
@pytest.mark.usefixtures("double")
def test_forward_reverse_and_finite_differences_agree(name):
    primitive = PRIMITIVES[name]()
    rays = rays_at(primitive)
    hit, normal = cast(primitive, rays)
    slant = np.asarray(-normal.dot(rays.direction) / rays.direction.norm())
    rng = np.random.default_rng(1)

    def random_like(tree):
        return jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), tree)

    tangents = random_like((primitive, rays))
    if isinstance(primitive, Cylinder):
        # The axis moves on the sphere.
        a, da = primitive.axis, tangents[0].axis
        on_sphere = da - a * jnp.dot(a, da)
        tangents = eqx.tree_at(lambda t: t[0].axis, tangents, on_sphere)

    @jax.jit
    def depth(pair):
        return visible_depth(*pair)

    @jax.jit
    def both_ways(pair, tangents, weight):
        _, forward = jax.jvp(depth, (pair,), (tangents,))
        _, pullback = jax.vjp(depth, pair)
        return forward, pullback(weight)

    weight = jnp.asarray(rng.normal(size=hit.t.shape))
    forward, (reverse,) = both_ways((primitive, rays), tangents, weight)
    forward = np.asarray(forward)
    numeric = central_difference(depth, (primitive, rays), tangents, 1e-7)
    # Differences across the outline or a rim jump; grazing rays are steep.
    same = np.asarray(hit.mask) & (slant > 0.05)
    # The tenth ray meets the rim, where the derivatives of cap and wall differ.
    same[9] = False
    same &= np.abs(numeric - forward) < 0.5 * (1 + np.abs(forward))
    assert same.sum() > 0.8 * np.sum(np.asarray(hit.mask) & (slant > 0.05))
    np.testing.assert_allclose(forward[same], numeric[same], rtol=2e-5, atol=2e-5)
    total = sum(
        float(jnp.vdot(g, t))
        for g, t in zip(
            jax.tree.leaves(reverse), jax.tree.leaves(tangents), strict=True
        )
    )
    assert total == pytest.approx(float(np.asarray(weight) @ forward), rel=1e-9)


def test_jit_and_vmap_agree_with_the_plain_call(primitive, rays, dtype):
    def both(ray):
        hit = primitive.intersect(ray)
        return jnp.where(hit.mask, hit.t, 0), primitive.normal(ray, hit).stack()

    plain, decided = both(rays), is_decided(primitive, rays)
    hit, normal = cast(primitive, rays)
    jitted = jnp.where(hit.mask, hit.t, 0), normal.stack()
    for other in (jitted, jax.jit(jax.vmap(both))(rays)):
        for expected, found in zip(plain, other, strict=True):
            # Fused multiplications may round a grazing square root differently.
            scale = eps(dtype, 64) ** 0.5
            found, expected = found[decided], expected[decided]
            np.testing.assert_allclose(found, expected, atol=scale, rtol=scale)


def test_transformed_primitive_is_hit_where_the_original_is(primitive, rays, dtype):
    transform = pose()

    def moved(vector, rotate):
        values = vector.stack()
        values = transform.rotate(values) if rotate else transform.apply(values)
        return type(vector).from_array(values)

    turned = Ray(moved(rays.origin, False), moved(rays.direction, True))
    expected, _ = cast(primitive, rays)
    found, _ = cast(primitive.transformed(transform), turned)
    same = np.asarray(expected.mask == found.mask)
    # Rays along the axis, in a cap's plane or grazing may fall either way.
    assert same[15:].mean() > 0.98
    both = np.asarray(expected.mask & found.mask)
    error = np.abs(np.asarray(expected.t)[both] - np.asarray(found.t)[both])
    assert np.median(error) < eps(dtype, 64)
