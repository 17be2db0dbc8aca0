"""Meshes: no ray slips through between triangles, and the nearest one is seen."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.parity.flat_cases import icosahedron
from impostor_jax.primitives.triangle import Triangle
from tests.cases import pose
from tests.checks import AS_USERS_RUN
from tests.groups import FULL

FACES = 128
"""Of every mesh, some of them there twice: one program casts at all."""


def icosphere():
    """80 triangles of radius 1; what two of them share is the same in every bit."""
    a, b, c = icosahedron().swapaxes(0, 1)
    p, q, r = ((v + w) / np.linalg.norm(v + w, axis=1, keepdims=True)
               for v, w in ((a, b), (b, c), (c, a)))  # fmt: skip
    parts = [(a, p, r), (p, b, q), (r, q, c), (p, q, r)]
    return np.concatenate([np.stack(part, axis=1) for part in parts])


def fans():
    """Two fans of 64 thin triangles with one rim, about corners at +-1."""
    angle = np.arange(65) % 64 * (2 * np.pi / 64)
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    faces = [(rim[k], rim[k + 1], (0, 0, 1)) for k in range(64)]
    faces += [(rim[k + 1], rim[k], (0, 0, -1)) for k in range(64)]
    return np.array(faces)


MESHES = {"icosphere": icosphere, "fans": fans}


@jax.jit(compiler_options=AS_USERS_RUN)
def first_hit(faces, origin, direction):
    """Ray parameter of the nearest of all faces."""
    ray = Ray(Vec3.from_array(origin), Vec3.from_array(direction))
    return jnp.min(
        jax.vmap(lambda face: Triangle(face).intersect(ray).t)(faces), axis=0
    )


def aimed(faces, count, rng):
    """Points on edges; every fourth is a corner."""
    face, corner = rng.integers(len(faces), size=count), rng.integers(3, size=count)
    start, end = faces[face, corner], faces[face, (corner + 1) % 3]
    part = rng.uniform(size=(count, 1)) * (np.arange(count)[:, None] % 4 > 0)
    return start + part * (end - start)


def directions(rng, count):
    v = rng.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


@FULL
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("name", MESHES)
def test_no_ray_slips_through_an_edge_or_a_corner(name, scale):
    # 10^6 rays, all cases together. Of corners without a width 131110 are lost, of one
    # of 1 eps 74, and of 2 eps none.
    rng, count = np.random.default_rng(0), 24000
    center = scale * np.array((0.3, -0.7, 2.1))
    faces = (MESHES[name]() * scale + center).astype(np.float32)
    # Each lists its corners in an order of its own, every other one clockwise.
    given = [face[rng.permutation(3)] for face in faces]
    given = jnp.asarray(np.array(given)[np.arange(FACES) % len(faces)])
    # Distances from the center, and then from the point outside: the triangles there
    # face the ray, which may not be let through to those behind.
    for distance in (0.0, 0.1, 0.4, -1e-2, -1.0, -30.0, -3e3):
        goal = aimed(faces.astype(float), count, rng)
        if distance >= 0:
            origin = center + scale * distance * directions(rng, count)
        else:
            away = (goal - center) / np.linalg.norm(goal - center, axis=1)[:, None]
            away += 0.3 * directions(rng, count)
            origin = goal - scale * distance * away
        origin = origin.astype(np.float32)
        direction = (goal - origin).astype(np.float32)
        t = first_hit(given, jnp.asarray(origin), jnp.asarray(direction))
        assert jnp.isfinite(t).all()
        beyond = (np.asarray(t) - 1) * np.linalg.norm(direction, axis=1)
        # Of the slanted one, as far as the point is rounded to from so far.
        assert np.abs(beyond).max() < 1e-2 * scale


@FULL
def test_mesh_around_a_posed_camera_fills_its_image():
    # The pose rounds what two triangles share, each by itself.
    place = pose().inverse().apply(jnp.asarray((0.1, 0.2, -0.1)))
    mesh = Triangle(0.5 * icosphere() + np.asarray(place, float))
    camera = ij.PinholeCamera(60.0, 62.0, 31.5, 23.0, 64, 48, camera_from_world=pose())
    maps = ij.render(ij.Scene([mesh]), camera, ("mask", "depth"))
    assert maps.mask.all()
    assert float(maps.depth.max()) < 0.8


def crossings(faces, o, d):
    """Ray parameters of all faces after Moeller and Trumbore, in double precision."""
    a, b, c = np.asarray(faces, float).swapaxes(0, 1)[:, :, None, None]
    across = np.cross(d, c - a)
    slope = np.sum(across * (b - a), axis=-1)
    u = np.sum(across * (o - a), axis=-1) / slope
    other = np.cross(o - a, b - a)
    v = np.sum(other * d, axis=-1) / slope
    t = np.sum(other * (c - a), axis=-1) / slope
    return np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)


@FULL
def test_nearest_triangle_of_a_heap_is_seen():
    rng = np.random.default_rng(1)
    center = rng.uniform((-1.2, -0.9, 2), (1.2, 0.9, 4), (60, 3))
    faces = center[:, None] + 0.4 * rng.normal(size=(60, 3, 3))
    faces[0] = (-5, 1.2, 1), (5, 1.2, 1), (0, 1.2, -9)
    # No row of pixels is level with the floor.
    camera = ij.PinholeCamera(60.0, 62.0, 31.5, 23.5, 64, 48)
    heap = Triangle(faces)
    maps = ij.render(ij.Scene([heap]), camera, ("depth", "index", "normal"))
    v, u = np.mgrid[:48, :64]
    d = np.stack([(u - 31.5) / 60, (v - 23.5) / 62, np.ones(u.shape)], axis=-1)
    found = crossings(heap.vertices, np.zeros(3), d)
    index = np.where(np.isfinite(found.min(axis=0)), found.argmin(axis=0), -1)
    # No ray of this image is within rounding of an edge.
    np.testing.assert_array_equal(maps.index, index)
    assert len(np.unique(index)) > 40
    depth = found.min(axis=0)
    np.testing.assert_allclose(maps.depth, depth, rtol=eps("float32", 256))
    a, b, c = np.asarray(heap.vertices, float).swapaxes(0, 1)
    n = np.cross(b - a, c - a)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    n = n[index] * np.where(np.sum(n[index] * d, axis=-1) > 0, -1, 1)[..., None]
    hit = index >= 0
    np.testing.assert_allclose(np.asarray(maps.normal)[hit], n[hit], atol=1e-5)


@FULL
def test_depth_of_a_mesh_is_differentiable_in_its_corners():
    # All that a corner of the mesh is moved by, of the triangles that share it.
    faces, camera = icosphere(), ij.PinholeCamera(60.0, 60.0, 31.5, 23.5, 64, 48)
    corners, where = np.unique(faces.reshape(-1, 3), axis=0, return_inverse=True)

    @jax.jit
    @jax.value_and_grad
    def total(corners):
        mesh = Triangle(corners[where.reshape(faces.shape[:2])])
        depth = ij.render(ij.Scene([mesh]), camera, ("depth",)).depth
        return jnp.sum(depth)

    # All of it nearer by a part of itself: every depth is.
    corners = jnp.asarray(corners + 0.01)
    value, slope = total(corners)
    assert float(jnp.vdot(slope, corners)) == pytest.approx(float(value), rel=1e-4)
