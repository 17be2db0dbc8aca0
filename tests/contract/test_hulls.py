"""A hull holds all of its shape that a ray finds, to the last bit."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.primitives.base import UNITS
from impostor_jax.rendering.bounds import image_bounds
from tests.cases import PRIMITIVES
from tests.checks import AS_USERS_RUN
from tests.groups import FULL

COUNT = 400
"""Rays that are cast together."""

NEARLY_ALONG_X = (1, 3e-4, -1e-4)
BOUNDED = {
    **{name: make for name, make in PRIMITIVES.items() if name != "plane"},
    # Squares of the axis' components round to 1 and 0.
    "rod nearly along x": lambda: ij.Cylinder(
        (0.1, -0.2, 3.0), NEARLY_ALONG_X, 0.3, 0.1
    ),
    "torus nearly along x": lambda: ij.Torus(
        (0.1, -0.2, 3.0), NEARLY_ALONG_X, 0.5, 0.01
    ),
    "open": lambda: ij.Cylinder(
        (0.1, -0.2, 3.0), (0.3, 0.8, 0.5), 0.5, 1.4, caps=False
    ),
    # As far from a rotation as one may be: faces are across the columns.
    "box of no rotation": lambda: ij.Box(
        (0.1, -0.2, 3.0), [[1, 4e-4, 0], [4e-4, 1, 3e-4], [0, 3e-4, 1]], (2, 0.1, 1)
    ),
}


def placed(primitive, scale, away):
    """The shape in another unit of length, farther from the camera by so many meters
    of its own."""

    def scaled(path, x):
        is_length = not any(getattr(key, "name", "") in UNITS for key in path)
        return x * scale if is_length else x

    move = ij.RigidTransform(np.eye(3), (0.7 * away * scale, 0, away * scale))
    return jax.tree_util.tree_map_with_path(scaled, primitive).transformed(move)


@jax.jit(compiler_options=AS_USERS_RUN)
def hits_of(primitive, origin, direction):
    ray = Ray(Vec3.from_array(origin), Vec3.from_array(direction))
    hit = primitive.intersect(ray)
    return hit.mask, ray.at(jnp.where(hit.mask, hit.t, 0)).stack()


def cast(primitive, place, is_central):
    """Hits of the rays through places (n, 2) in the image."""
    places, ahead = np.insert(place, 2, 0, axis=1), np.float32([0, 0, 1])
    if is_central:
        return hits_of(primitive, np.zeros_like(places), places + ahead)
    return hits_of(primitive, places, np.broadcast_to(ahead, places.shape))


@jax.jit
def hull_of(primitive):
    """Box and ball of the hull, and the bounds by projection."""
    hull = primitive.hull
    bounds = {kind: image_bounds(primitive, kind) for kind in ("planar", "parallel")}
    return hull.box(), hull.ball(), bounds


def seen_at(primitive, is_central, radius, middle):
    """Places that hit, on the way out to the very last, and where they hit."""
    rng = np.random.default_rng(0)
    near = np.asarray(middle + radius * rng.uniform(-1, 1, (10, COUNT, 2)), np.float32)
    found = []
    for place in near:
        mask, point = map(np.asarray, cast(primitive, place, is_central))
        found.append((place[mask], point[mask]))
    inner = np.resize(np.concatenate([place for place, _ in found]), (COUNT, 2))
    outer = np.asarray(middle + 3 * radius * rng.normal(size=(COUNT, 2)), np.float32)
    for _ in range(30):
        half = (inner + outer) / 2
        mask, point = map(np.asarray, cast(primitive, half, is_central))
        found.append((half[mask], point[mask]))
        inner = np.where(mask[:, None], half, inner)
        outer = np.where(mask[:, None], outer, half)
    places, points = map(np.concatenate, zip(*found, strict=True))
    return places, points.astype(float)


@FULL
@pytest.mark.parametrize("is_central", [True, False], ids=["central", "parallel"])
@pytest.mark.parametrize("name", BOUNDED)
def test_a_hull_holds_every_hit(name, is_central):
    for scale in (1e-3, 1.0, 1e4):
        for away in (0.0, 30.0, 1000.0):
            shape = placed(BOUNDED[name](), scale, away)
            (low, high), (center, radius), bounds = hull_of(shape)
            bounds = bounds["planar" if is_central else "parallel"]
            depth = center[2] if is_central else 1
            place, point = seen_at(
                shape, is_central, float(radius / depth), np.asarray(center[:2] / depth)
            )
            assert len(place) > 600
            assert (np.asarray(low) <= point).all()
            assert (point <= np.asarray(high)).all()
            distance = np.linalg.norm(point - np.asarray(center, float), axis=1)
            assert distance.max() <= radius
            # A triangle is seen 8 eps of its distance beyond its corners, so that no
            # ray slips between two; who looks past its bounds sees its neighbor.
            beyond = eps(np.float32, 16) if name == "triangle" else 0.0
            assert (np.asarray(bounds.low) - beyond <= place).all()
            assert (place <= np.asarray(bounds.high) + beyond).all()


@pytest.mark.parametrize("name", PRIMITIVES)
def test_what_is_bounded_has_a_hull(name):
    primitive = PRIMITIVES[name]()
    assert primitive.is_bounded == (primitive.hull is not None) == (name != "plane")


def test_a_heightfield_of_a_function_has_none():
    hill = ij.Heightfield(lambda x, z: x * z, ((-1, 1), (-1, 1)), lipschitz=2.0)
    assert not hill.is_bounded
    assert hill.hull is None
    assert np.isposinf(image_bounds(hill, "planar").high).all()


@FULL
@pytest.mark.parametrize("name", BOUNDED)
def test_a_batch_has_the_hulls_of_its_members(name):
    shapes = [placed(BOUNDED[name](), 1.0, away) for away in (0.0, 2.0, -9.0)]
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *shapes)
    found, mapped = hull_of(batch), jax.vmap(hull_of)(batch)
    alone = [hull_of(shape) for shape in shapes]
    expected = jax.tree.map(lambda *leaves: np.stack(leaves), *alone)
    for other in (expected, mapped):
        for x, y in zip(*map(jax.tree.leaves, (found, other)), strict=True):
            np.testing.assert_allclose(x, y, rtol=1e-6, atol=1e-6)


@FULL
@pytest.mark.parametrize("name", BOUNDED)
def test_derivatives_of_a_hull_are_finite(name):
    def total(primitive):
        hull = primitive.hull
        numbers = hull.box(), hull.ball(), hull.reach()
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves(numbers))

    slope = jax.jit(jax.grad(total))
    # In front of the camera, around it and behind.
    for away in (0.0, -3.0, -9.0):
        leaves = jax.tree.leaves(slope(placed(BOUNDED[name](), 1.0, away)))
        assert all(np.isfinite(leaf).all() for leaf in leaves)
