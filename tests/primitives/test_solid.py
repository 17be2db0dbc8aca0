import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from experiments.oracle.solid import is_inside
from experiments.solids.judged import judge, rays_at
from experiments.solids.trees import KINDS, drawn, jax_solid
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from tests.cases import pose
from tests.checks import central_difference
from tests.groups import FULL, RELEASE

# All kinds once; and what is left of few.
TREES = {
    "all kinds": (
        ("difference", (("union", (0, 1, 2, 3)), ("intersection", (4, 5)), 6, 7)),
        ("cylinder", "box", "torus", "sector", "sphere", "frustum", "cone", "plane"),
    ),
    "a stepped shaft": (
        ("difference", (("union", (0, 1, 2)), 3)),
        ("cylinder", "cylinder", "cylinder", "cylinder"),
    ),
    "an overlap": (("intersection", (0, 1, 2)), ("box", "cylinder", "sphere")),
}
DISTANCES = (3.0, 100.0, 1000.0)


@pytest.mark.parametrize(
    "name", [pytest.param("all kinds", marks=RELEASE), "a stepped shaft"]
)
def test_rays_see_what_the_oracle_sees(name):
    # Many more stand in experiments/solids.
    tree, kinds = TREES[name]
    rng = np.random.default_rng(0)
    hits = 0
    for _ in range(4):
        solid = drawn(rng, tree, kinds)
        for distance in DISTANCES:
            where, origin, direction = rays_at(rng, distance, 1000)
            moved = jax_solid(solid).transformed(where)
            judged = judge(solid, moved, origin, direction, rng)
            hits += judged.hits.sum()
            assert not judged.is_wrong.any()
            assert judged.is_finite.all()
    assert hits > 1000


def test_every_kind_is_drawn():
    assert set(TREES["all kinds"][1]) == set(KINDS)


@FULL
@pytest.mark.parametrize("name", TREES)
def test_the_sign_of_the_distance_tells_inside(name):
    tree, kinds = TREES[name]
    rng = np.random.default_rng(1)
    solid = drawn(rng, tree, kinds)
    point = rng.uniform(-1, 1, (2000, 3))
    with jax.enable_x64(True):
        distance = np.asarray(jax_solid(solid).implicit(vectors(point)))
    inside = is_inside(tree, solid.shapes, point)
    assert 0 < inside.sum() < inside.size
    np.testing.assert_array_equal(distance < 0, inside)


def vectors(values) -> Vec3:
    return Vec3.from_array(jnp.asarray(values, float))


def ray(origin, direction) -> Ray:
    return Ray(vectors(origin), vectors(direction))


def can(radius, height=2.0, center=(0, 0, 0)):
    return ij.Cylinder(center, (0, 0, 1), radius, height)


@FULL
@pytest.mark.parametrize(
    ("solid", "origin", "direction", "t", "normal", "part"),
    [
        pytest.param(
            can(1) - can(0.5), (0.7, 0, -5), (0, 0, 1), 4, (0, 0, -1), 1,
            id="the rim of a bore",
        ),
        pytest.param(
            can(1) - can(0.5), (0.2, 0, -5), (0, 0, 1), np.inf, (0, 0, 0), None,
            id="through a bore whose ends lie flush",
        ),
        pytest.param(
            can(1) - can(0.5), (0, 0, -5), (0.1, 0, 1), 5, (-1, 0, 0), 2,
            id="the inner wall, which faces the ray",
        ),
        pytest.param(
            can(1) - can(0.5), (0.7, 0, 0), (1, 0, 0), 0.3, (-1, 0, 0), 0,
            id="out of the wall from within it",
        ),
        pytest.param(
            can(1) - can(0.5), (0, 0, 0), (1, 0, 0), 0.5, (-1, 0, 0), 2,
            id="from within the bore",
        ),
        pytest.param(
            can(1, center=(0, 0, -1)) | can(1, center=(0, 0, 1)),
            (0, 0, 0.5), (0, 0, 1), 1.5, (0, 0, -1), 3,
            id="no face between two cans that lie flush",
        ),
        pytest.param(
            ij.Sphere((0, 0, 0), 1) & ij.Plane((0, 0, 0), (0, 0, -1)),
            (0.5, 0, -5), (0, 0, 1), 5, (0, 0, -1), 1,
            id="a half-space is behind its plane",
        ),
        pytest.param(
            can(1) - ij.Box((0, 0, -1), np.eye(3), (0.5, 0.5, 1)),
            (0, 0, -5), (0, 0, 1), 4.5, (0, 0, -1), 7,
            id="the floor of a pocket",
        ),
    ],
)  # fmt: skip
def test_closed_forms(solid, origin, direction, t, normal, part):
    sight = ray(origin, direction)
    hit = solid.intersect(sight)
    assert float(hit.t) == pytest.approx(t, rel=1e-6)
    found = solid.normal(sight, hit).stack()
    np.testing.assert_allclose(found, normal, atol=1e-6)
    if part is not None:
        assert int(hit.part) == part


def nested():
    """Nested solids of several types, among them one that was moved."""
    bored = (can(0.5, 1.4) | ij.Torus((0, 0, 0.3), (0, 0, 1), 0.6, 0.15)) - can(0.3)
    cup = ij.Frustum((0, 0, -0.5), (0, 0, 0.6), 0.2, 0.4).transformed(pose())
    ball = ij.Sphere((0.4, 0, 0), 0.3) & ij.Box((0.3, 0, 0), np.eye(3), (0.5, 0.4, 0.3))
    return (bored.transformed(pose()) | cup) - ball


@RELEASE
@pytest.mark.usefixtures("double")
def test_derivatives_are_those_of_differences():
    solid = nested()
    rng = np.random.default_rng(2)
    direction = rng.uniform(-1, 1, (500, 3))
    center = np.asarray(solid.hull.ball()[0])
    origin = vectors(center - 5 * direction)
    sight = Ray(
        origin, Vec3.from_array(jnp.asarray(direction + rng.normal(0, 0.05, 3)))
    )

    def depth(inputs):
        solid, sight = inputs
        hit = solid.intersect(sight)
        return jnp.where(hit.mask, hit.t, 0), (hit, solid.normal(sight, hit))

    inputs = solid, sight
    tangents = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), inputs)
    # A rotation stays one.
    tangents = jax.tree_util.tree_map_with_path(
        lambda path, x: x * 0 if "rotation" in str(path) else x, tangents
    )
    run = jax.jit(lambda inputs: jax.jvp(depth, (inputs,), (tangents,), has_aux=True))
    _, slope, (hit, normal) = run(inputs)
    steps = central_difference(lambda x: run(x)[0], inputs, tangents, 1e-6)
    slant = -np.asarray(normal.dot(sight.direction) / sight.direction.norm())
    # Where a difference jumps, or is steep, it tells nothing.
    smooth = np.asarray(hit.mask) & (slant > 0.2) & (np.abs(steps - slope) < 1e-3)
    assert smooth.sum() > 0.8 * np.sum(np.asarray(hit.mask) & (slant > 0.2)) > 100
    np.testing.assert_allclose(slope[smooth], steps[smooth], rtol=1e-6, atol=1e-6)
    assert len(np.unique(np.asarray(hit.part)[smooth])) >= 6


@FULL
def test_a_nested_solid_keeps_the_place_of_what_was_moved():
    bored = (can(0.5) - can(0.3)).transformed(pose())
    rays = rays_at(np.random.default_rng(3), 4.0, 300)[1:]
    sight = Ray(*map(vectors, rays))
    alone, joined = (s.intersect(sight) for s in (bored, bored | bored))
    both = np.asarray(alone.mask & joined.mask)
    assert both.sum() > 20
    np.testing.assert_array_equal(alone.mask, joined.mask)
    np.testing.assert_allclose(alone.t[both], joined.t[both], rtol=eps("float32", 16))


def test_a_batch_is_its_members_one_by_one():
    radii = np.array([0.5, 0.6, 0.7])
    outer = ij.Cylinder(np.zeros((3, 3)), np.tile([0, 0, 1], (3, 1)), radii, radii * 3)
    batch = outer - can(0.3, 9.0)
    assert batch.batch_shape == (3,)
    sight = ray((0.4, 0.05, -5), (0, 0.01, 1))
    seen = jax.jit(lambda solid: solid.intersect(sight).t)
    found = jax.vmap(seen)(batch)
    alone = [seen(can(r, 3 * r) - can(0.3, 9.0)) for r in radii]
    np.testing.assert_array_equal(found, jnp.stack(alone))


def test_solids_of_one_structure_are_one_group_of_a_scene():
    solids = [can(0.5, 1.0, (x, 0, 4)) - can(0.3, 1.0, (x, 0, 4)) for x in (-1, 1)]
    assert len(ij.Scene([*solids, ij.Sphere((0, 0, 5), 0.2)]).groups) == 2


def ground() -> ij.Heightfield:
    heights = [[0.0, 0.3, -0.2], [0.4, -0.3, 0.1], [-0.1, 0.5, 0.2], [0.2, -0.2, 0.0]]
    return ij.Heightfield(heights, ((-1, 1), (-1, 1)), "bilinear")


@FULL
@pytest.mark.parametrize("sign", [1, pytest.param(-1, marks=RELEASE)])
def test_ground_counts_as_solid(sign):
    # A block of ground, or what is above it; up is y, along which rays are cast.
    block = ij.Box((0, 0, 0), np.eye(3), (1.5, 1.5, 1.6))
    solid = block & ground() if sign > 0 else block - ground()
    rng = np.random.default_rng(4)
    origin = rng.uniform((-1, 2, -1), (1, 4, 1), (300, 3))
    direction = rng.uniform(-0.7, 0.7, (300, 3)) - origin
    # Of about unit length, as a camera's, which start near the solid.
    direction /= 3
    sight = Ray(vectors(origin), vectors(direction))
    hit = jax.jit(lambda solid: solid.intersect(sight))(solid)
    t = np.linspace(0, 6, 12001)
    at = jax.jit(jax.vmap(lambda t: solid.implicit(sight.at(jnp.full(300, t))) < 0))
    inside = np.asarray(at(t))
    first = np.where(inside.any(axis=0), t[np.argmax(inside, axis=0)], np.inf)
    # Samples miss what is thinner than their step.
    both = np.isfinite(first) & np.asarray(hit.mask)
    assert both.sum() > 100
    assert np.sum(np.isfinite(first) != np.asarray(hit.mask)) <= 3
    off = np.abs(first - np.where(both, hit.t, 0))[both]
    assert np.mean(off < 1e-3) > 0.99


@FULL
def test_ground_ends_beside_its_extent():
    block = ground() & ij.Box((0, 0, 0), np.eye(3), (4, 1.2, 4))
    sight = ray((-5, -0.5, 0.2), (1, 0, 0))
    hit = block.intersect(sight)
    assert float(hit.t) == pytest.approx(4)
    np.testing.assert_allclose(block.normal(sight, hit).stack(), (-1, 0, 0), atol=1e-6)


@RELEASE
def test_bounds_hold_what_is_seen():
    camera = ij.PinholeCamera(60.0, 60.0, 31.5, 23.5, 64, 48)
    solid = nested().transformed(ij.RigidTransform(np.eye(3), (0.2, 0, 3)))
    whole = ij.render(solid, camera, outputs=("depth", "mask"))
    tile = ij.render(solid, camera, ("depth", "mask"), effort=ij.Effort(extent="tile"))
    box = ij.outline_box(solid, camera)
    rows, cols = np.nonzero(np.asarray(whole.mask))
    assert rows.size > 100
    assert int(box.first_row) <= rows.min() <= rows.max() <= int(box.last_row)
    assert int(box.first_col) <= cols.min() <= cols.max() <= int(box.last_col)
    np.testing.assert_array_equal(whole.mask, tile.mask)
    np.testing.assert_allclose(whole.depth, tile.depth, rtol=eps("float32", 8))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: can(1) - ij.Triangle(np.eye(3)), "closed.*Triangle"),
        (
            lambda: can(1) | ij.Cylinder((0, 0, 0), (0, 0, 1), 1, 1, caps=False),
            "closed.*Cylinder",
        ),
        (ij.union, "one or more"),
        (lambda: ij.union(can(1), 3), "primitives.*int"),
        (
            lambda: ij.union(
                ij.Sphere(np.zeros((2, 3)), np.ones(2)),
                ij.Sphere(np.zeros((3, 3)), np.ones(3)),
            ),
            "batches of one size",
        ),
        (
            lambda: ij.Heightfield(np.zeros((2, 2, 2)), ((-1, 1), (-1, 1))) & can(1),
            "no batch of heightfields",
        ),
    ],
)
def test_what_cannot_be_joined_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_an_operator_takes_primitives_only():
    with pytest.raises(TypeError):
        can(1) - 3


def test_an_endless_solid_has_no_hull():
    assert (can(1) | ij.Plane((0, 0, 0), (0, 0, 1))).hull is None
    assert (ij.Plane((0, 0, 0), (0, 0, 1)) - can(1)).hull is None
    assert (ij.Plane((0, 0, 0), (0, 0, 1)) & can(1)).is_bounded


def test_a_solid_prints_what_it_is_made_of():
    assert str(can(1) - can(0.5)) == (
        "Solid: expression ('difference', (0, 1)), "
        "rotation ((1, 0, 0), (0, 1, 0), (0, 0, 1)), translation (0, 0, 0) m\n"
        "  0 Cylinder: center (0, 0, 0) m, axis (0, 0, 1), radius 1 m, height 2 m\n"
        "  1 Cylinder: center (0, 0, 0) m, axis (0, 0, 1), radius 0.5 m, height 2 m"
    )


def test_scenes_without_solids_hold_nothing_of_them(monkeypatch):
    def refuse(*_):
        raise AssertionError("a search for solids is traced")

    monkeypatch.setattr("impostor_jax.primitives.solid.first_change", refuse)
    scene = ij.Scene([can(0.5, 1.0, (0, 0, 4)), ij.Sphere((0, 0, 5), 0.2)])
    sight = ray((0, 0, 0), (0, 0, 1))
    jax.eval_shape(lambda scene: scene.intersect(sight), scene)
    with pytest.raises(AssertionError, match="traced"):
        jax.eval_shape(
            lambda scene: scene.intersect(sight), ij.Scene([can(1) - can(0.5)])
        )
