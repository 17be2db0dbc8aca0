"""What every primitive promises."""

import functools

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
from impostor_jax.primitives.solid import Solid
from impostor_jax.primitives.torus import Torus
from tests.cases import PRIMITIVES, is_decided, pose, rays_at
from tests.checks import AS_USERS_RUN, all_finite, central_difference
from tests.groups import FULL

# Further cases of a class run in single precision only, which is the harder one; all
# others in double precision with --full.
MORE = ("disc", "rod", "cylinder along z", "sector", "sheet")


@pytest.fixture(
    params=[(name, "float32") for name in PRIMITIVES]
    + [
        pytest.param((name, "float64"), marks=FULL)
        for name in PRIMITIVES
        if name not in MORE
    ],
    ids="-".join,
)
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
@jax.jit(compiler_options=AS_USERS_RUN)
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
    assert kinds == {*CLASSES.values(), Solid}


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
    if isinstance(primitive, Heightfield | Solid | Torus):
        # A bent sheet, or the other side of a hole, may stand in the way farther on.
        met &= again.t < 0.01
    assert not (met & hit.mask & outside).any()


def test_a_miss_is_infinite(primitive, rays):
    hit, _ = cast(primitive, rays)
    assert np.isposinf(np.asarray(hit.t)[~hit.mask]).all()
    assert not (hit.on_cap & ~hit.mask).any()
    assert (np.asarray(hit.t)[hit.mask] > 0).all()


def test_parts_are_fewer_than_their_number(primitive, rays):
    hit, _ = cast(primitive, rays)
    part = np.asarray(hit.part)[hit.mask]
    assert 0 <= part.min() <= part.max() < primitive.num_parts


# One program for all cases of a class.
@jax.jit
def cast_both_ways(inputs, tangents, weights):
    """Depth and normal, their derivatives along tangents and of a weighted sum."""

    def seen(primitive, rays):
        hit = primitive.intersect(rays)
        depth = jnp.where(hit.mask, hit.t, 0)
        return (depth, primitive.normal(rays, hit)), hit.mask

    value, forward, mask = jax.jvp(seen, inputs, tangents, has_aux=True)
    _, pullback, _ = jax.vjp(seen, *inputs, has_aux=True)
    return value, forward, pullback(weights), mask


def random_like(tree, rng):
    return jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape), x.dtype), tree)


@FULL
@pytest.mark.parametrize("name", PRIMITIVES)
def test_derivatives_are_finite_on_every_ray(name):
    # In single precision; each shape's own tests ask the same of double.
    primitive = PRIMITIVES[name]()
    rays = rays_at(primitive)
    rng = np.random.default_rng(1)
    # No zero among them: an infinite partial derivative makes the sum infinite.
    tangents = random_like((primitive, rays), rng)
    weights = random_like((rays.origin.x, rays.direction), rng)
    _, forward, reverse, _ = cast_both_ways((primitive, rays), tangents, weights)
    assert all_finite(forward)
    assert all_finite(reverse)


@FULL
@pytest.mark.parametrize("name", PRIMITIVES)
@pytest.mark.usefixtures("double")
def test_forward_reverse_and_finite_differences_agree(name):
    primitive = PRIMITIVES[name]()
    inputs = primitive, rays_at(primitive)
    rng = np.random.default_rng(1)
    tangents = random_like(inputs, rng)
    if isinstance(primitive, Cylinder):
        # The axis moves on the sphere.
        a, da = primitive.axis, tangents[0].axis
        on_sphere = da - a * jnp.dot(a, da)
        tangents = eqx.tree_at(lambda t: t[0].axis, tangents, on_sphere)
    weights = random_like((inputs[1].origin.x, inputs[1].direction), rng)
    value, slopes, reverse, mask = cast_both_ways(inputs, tangents, weights)

    def depth(inputs):
        return cast_both_ways(inputs, tangents, weights)[0][0]

    d = inputs[1].direction
    slant = np.asarray(-value[1].dot(d) / d.norm())
    forward = np.asarray(slopes[0])
    numeric = central_difference(depth, inputs, tangents, 1e-7)
    # Differences across the outline or a rim jump; grazing rays are steep.
    same = np.asarray(mask) & (slant > 0.05)
    # The tenth ray meets the rim, where the derivatives of cap and wall differ.
    same[9] = False
    same &= np.abs(numeric - forward) < 0.5 * (1 + np.abs(forward))
    assert same.sum() > 0.8 * np.sum(np.asarray(mask) & (slant > 0.05))
    np.testing.assert_allclose(forward[same], numeric[same], rtol=2e-5, atol=2e-5)

    def product(first, second):
        pairs = zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True)
        return sum(float(jnp.vdot(a, b)) for a, b in pairs)

    assert product(reverse, tangents) == pytest.approx(
        product(weights, slopes), rel=1e-9
    )


# Compiled quickly: what is compared differs by far more than rounding, if at all.
@jax.jit
@functools.partial(jax.vmap, in_axes=(None, 0))
def cast_one_by_one(primitive, ray):
    hit = primitive.intersect(ray)
    return hit, primitive.normal(ray, hit)


@FULL
@pytest.mark.parametrize("name", PRIMITIVES)
def test_jit_and_vmap_agree_with_the_plain_call(name, pytestconfig):
    # In single precision, the harder one.
    primitive = PRIMITIVES[name]()
    rays = rays_at(primitive)

    def visible(hit, normal):
        return jnp.where(hit.mask, hit.t, 0), normal.stack()

    hit = primitive.intersect(rays)
    plain = visible(hit, primitive.normal(rays, hit))
    decided = is_decided(primitive, rays)
    if isinstance(primitive, Torus) and not pytestconfig.getoption("--optimized"):
        # It grazes the top, and no option makes XLA optimize the plain call alone.
        decided[4] = False
    touching = np.arange(decided.size) == 7
    for compiled, kept in (
        (cast, decided),
        # Rounding tells whether a ray meets the wall that it touches.
        (cast_one_by_one, decided & ~touching),
    ):
        other = visible(*compiled(primitive, rays))
        for expected, found in zip(plain, other, strict=True):
            # Fused multiplications may round a grazing square root differently.
            scale = eps("float32", 64) ** 0.5
            found, expected = found[kept], expected[kept]
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
