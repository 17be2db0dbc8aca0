"""How rays pass a body, how that changes as it moves, and how it moves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.body import Rays, change_of, grown
from impostor_jax.fit.round_body import RoundBody
from impostor_jax.fit.tube_body import TubeBody
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps, product
from tests.fit.bodies import (
    BODIES,
    FAR,
    body_of,
    in_double,
    moved_then_turned,
    rays,
)
from tests.fit.scenes import can
from tests.groups import FULL

CHORD = 0.003
DEPTH = 3


@pytest.fixture(params=BODIES)
def double_body(request, double):
    return body_of(in_double(request.param))


@jax.jit
def passed(body, direction):
    seen = body.passing(Rays(direction))
    return seen, seen.depth, body.covers(seen)


@jax.jit
def hits(shape, direction):
    zero = jnp.zeros_like(direction.x)
    return shape.intersect(Ray(Vec3(zero, zero, zero), direction))


def runs_along_the_wall(seen, direction):
    """Rays so nearly along a cone's wall that another is taken for it."""
    return np.abs(seen.inverse) * np.asarray(direction.dot(direction)) > 9e3


@FULL
@pytest.mark.parametrize("name", BODIES | FAR)
def test_a_body_is_what_its_primitive_shows(name, dtype):
    with jax.enable_x64(True):
        shape = in_double(name)
        hit = hits(shape, rays(shape, np.float64))
    # Exact in both: the numbers are those of single precision.
    shape = jax.tree.map(lambda x: jnp.asarray(np.asarray(x), dtype), shape)
    direction = rays(shape, dtype)
    seen, depth, covers = passed(body_of(shape), direction)
    plain = ~runs_along_the_wall(seen, direction)
    mask = np.asarray(hit.mask) & plain
    assert mask.sum() > 10
    # A ray that runs along the axis itself crosses no wall, and is not counted.
    told = plain & (np.asarray(seen.inverse) != 0)
    expected = (mask & np.asarray(seen.outside))[told]
    np.testing.assert_array_equal(np.asarray(covers)[told], expected)
    np.testing.assert_array_equal(
        np.asarray(seen.on_cap)[mask], np.asarray(hit.on_cap)[mask]
    )
    t = np.asarray(hit.t)[mask]
    error = np.abs(np.asarray(depth, float)[mask] - t)
    # Of rays that graze what they see, half-chords are roots of small differences; of
    # the others the worst is 35, of one that runs almost along a wall to a cap.
    steep = np.asarray(seen.cos_incidence)[mask] > 0.1
    assert (error / t)[steep].max() < eps(dtype, 64)
    assert np.median(error / t) < eps(dtype, 1)


def test_turned_twice_a_body_seen_from_the_side_is_itself(double):
    body = RoundBody.of(ij.Cylinder((0, 0, 0.5), (0.6, 0.8, 0), 0.04, 0.06))
    turned = body.turned()
    assert float(turned.axis @ body.axis) == pytest.approx(0, abs=1e-12)
    assert (turned.radius, turned.height) == (0.03, 0.08)
    # The front of its wall stays.
    assert turned.center[2] - turned.radius == pytest.approx(0.46)
    again = turned.turned()
    assert abs(float(again.axis @ body.axis)) == pytest.approx(1)
    np.testing.assert_allclose(again.center, body.center, atol=1e-12)
    assert (again.radius, again.height) == (body.radius, body.height)


def test_motions_are_carried_to_other_frames(double_body):
    rotation = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    move = RigidTransform(rotation * np.linalg.det(rotation), (0.3, -0.2, 0.1))
    size = len(double_body.free_directions(()))
    tangent = np.random.default_rng(1).normal(0, 1e-3, size)
    one, other = moved_then_turned(double_body, jnp.asarray(tangent), move)
    for here, there in zip(*map(jax.tree.leaves, (one, other)), strict=True):
        np.testing.assert_allclose(there, here, atol=1e-12)


@jax.jit
def from_elsewhere(body, direction, start):
    seen = body.passing(Rays(direction, start), CHORD)
    moved = RigidTransform(jnp.eye(3), -start.stack()[0])
    near = body.transformed(moved).passing(Rays(direction), CHORD)
    return seen, near, seen.depth, near.depth


@FULL
def test_rays_may_begin_elsewhere(double_body):
    direction = rays(double_body.shape, np.float64)
    one = jnp.ones_like(direction.x)
    start = Vec3(0.02 * one, -0.01 * one, 0.03 * one)
    seen, near, depth, same = from_elsewhere(double_body, direction, start)
    np.testing.assert_allclose(depth, same, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(seen.outside, near.outside)
    np.testing.assert_allclose(seen.along, near.along, rtol=1e-7, atol=1e-7)


@jax.jit
def derivatives(body, direction):
    """Of what is compared: by forward mode, and as the body gives them."""
    count = direction.x.shape[0]
    one, zero = jnp.ones(count), jnp.zeros(count)
    never = jnp.zeros(count, bool)
    ends = [(end, side) for end in body.ends for side in (-1, 1)]

    def compared(tangent):
        moved = body.retracted(tangent, body.free_directions(()))
        seen = moved.passing(Rays(direction), CHORD)
        beyond = [moved.of_end(seen, one * e, one * s)[0] for e, s in ends]
        first = [seen.nearest + seen.foot, seen.square, seen.half, seen.depth]
        return jnp.stack([*first, *beyond])

    seen = body.passing(Rays(direction), CHORD)
    of_wall = jnp.where(seen.on_cap, 1 - seen.plane_weight, 1)
    asked = [
        (one, zero, never),
        (zero, one, never),
        (zero, seen.half_slope, never),
        (of_wall, seen.sign * of_wall * seen.half_slope, seen.on_cap),
    ]
    found = [body.of_reading(seen, *one) for one in asked]
    found += [body.of_end(seen, one * e, one * s)[1] for e, s in ends]
    plain = jax.jacfwd(compared)(jnp.zeros(len(found[0])))
    return plain, jnp.stack([jnp.stack(of) for of in found]).transpose(0, 2, 1), seen


@FULL
def test_gradients_are_those_of_forward_mode(double_body):
    direction = rays(double_body.shape, np.float64)
    plain, found, seen = jax.tree.map(np.asarray, derivatives(double_body, direction))
    kept = ~runs_along_the_wall(seen, direction)
    # Along the axis there is no nearest approach; the depth of a cap is there.
    is_cap = (np.arange(len(plain)) == DEPTH)[:, None] & seen.on_cap
    kept = kept & ((seen.inverse != 0) | is_cap)
    size = np.abs(plain).max(axis=2, keepdims=True) + 1e-3
    np.testing.assert_allclose(
        (found / size)[kept], (plain / size)[kept], atol=1e-9, equal_nan=False
    )


def test_rays_of_every_kind_are_among_those():
    kinds = set()
    with jax.enable_x64(True):
        for name in BODIES:
            shape = in_double(name)
            seen, _, _ = passed(body_of(shape), rays(shape, np.float64))
            side = np.asarray(seen.outside)
            kinds |= {
                (bool(out), bool(cap), bool(past), bool(within))
                for out, cap, past, within in zip(
                    side,
                    np.asarray(seen.on_cap),
                    np.asarray(seen.is_past_rim),
                    np.asarray(seen.inverse < 0),
                    strict=True,
                )
            }
    # Walls and caps from both sides, past the rim from outside, and within a cone.
    assert {(o, c, False, False) for o in (True, False) for c in (True, False)} < kinds
    assert {(True, True, True, False), (True, True, False, True)} < kinds


def test_depth_grows_steadily_as_the_wall_recedes_from_a_ray():
    def depth(radius):
        body = RoundBody.of(ij.Cylinder((0, 0, 1), (0, 1, 0), 0.05, 1))
        direction = Vec3(jnp.full(1, 0.05), jnp.zeros(1), jnp.ones(1))
        return (
            body.retracted(
                jnp.zeros(7).at[4].set(jnp.log(radius / 0.05)), body.free_directions(())
            )
            .passing(Rays(direction), 0.001)
            .depth[0]
        )

    depths = jax.jit(jax.vmap(depth))(jnp.linspace(0.06, 0.04, 41))
    assert (np.diff(depths) > 0).all()


KINDS = {
    "cylinder": can,
    "frustum": lambda: ij.Frustum((0.0, -0.05, 0.3), (0.02, 0.06, 0.4), 0.03, 0.05),
    "tube": lambda: ij.tube((0.01, 0.005, 0.35), (0.3, 0.4, 0.87), 0.04, 0.03, 0.12),
    "sphere": lambda: ij.Sphere((0.01, 0.02, 0.4), 0.05),
}
UNIT, END_UNIT = 1e-4, 3e-4


@jax.jit
def moved_by(body, free, vector):
    """The body at free coordinates."""
    basis = body.free_basis(free, jnp.asarray(UNIT), jnp.asarray(END_UNIT))
    return body.retracted(product(basis, vector), free)


def radii_of(body):
    if isinstance(body, TubeBody):
        return body.outer_radius, body.inner_radius
    return body.radius1, body.radius2


def at(kind, vector, fixed=()):
    body = body_of(KINDS[kind]())
    free = jnp.asarray(body.free_directions(fixed), body.radius.dtype)
    vector = jnp.asarray(np.resize(vector, len(free)), body.radius.dtype)
    return body, moved_by(body, free, vector)


@pytest.mark.parametrize("kind", KINDS)
def test_at_zero_a_body_is_where_it_was(kind, dtype):
    body, moved = at(kind, [0])
    for one, other in zip(jax.tree.leaves(moved), jax.tree.leaves(body), strict=True):
        np.testing.assert_allclose(one, other, rtol=eps(dtype, 4))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sign", [-1, 1])
def test_any_step_leads_to_a_body(kind, sign):
    # Of meters, and of a hundred radii; a growth by e to that had no number.
    vector = sign * np.array([9000, -300, 500, 7, 60000, 40000, -400, 50000.0])
    _, moved = at(kind, vector)
    assert 0 < float(moved.radius) < 100
    if kind != "sphere":
        assert 0 < float(moved.height) < 100
        assert float(jnp.linalg.norm(moved.axis)) == pytest.approx(1, abs=1e-6)
        assert all(float(radius) > 0 for radius in radii_of(moved))
    if kind == "tube":
        assert float(moved.inner_radius) < float(moved.outer_radius)


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("kind", KINDS)
def test_a_unit_moves_the_surface_as_much_in_every_coordinate(kind):
    body = body_of(KINDS[kind]())
    for number in range(len(body.free_directions(()))):
        _, moved = at(kind, np.eye(8)[number])
        change = {
            "center": np.linalg.norm(moved.center - body.center),
            "radius": abs(moved.radius - body.radius),
        }
        if kind == "sphere":
            name = "radius" if number == 3 else "center"
            assert change[name] == pytest.approx(UNIT, rel=0.01)
            continue
        turn = np.linalg.norm(moved.axis - body.axis) * body.size
        half = [b.axis * (b.height / 2) for b in (moved, body)]
        ends = [
            np.linalg.norm(moved.center + sign * half[0] - body.center - sign * half[1])
            for sign in (-1, 1)
        ]
        pairs = zip(radii_of(moved), radii_of(body), strict=True)
        radii = [abs(one - other) for one, other in pairs]
        expected = {0: turn, 1: turn, 2: change["center"], 3: change["center"]}
        lengths = [radii[0]] if kind == "cylinder" else radii
        expected |= dict(enumerate(lengths, start=4))
        if number in expected:
            assert expected[number] == pytest.approx(UNIT, rel=0.01), number
            continue
        # An end moves alone, along the wall that is there.
        moves = number - 4 - len(lengths)
        assert ends[moves] == pytest.approx(END_UNIT, rel=0.01)
        assert ends[1 - moves] < 0.01 * END_UNIT
        if kind == "frustum":
            assert float(moved.slope) == pytest.approx(float(body.slope), rel=0.01)


@pytest.mark.parametrize(
    ("kind", "fixed", "size"),
    [
        ("cylinder", (), 7),
        ("cylinder", ("radius",), 6),
        ("cylinder", ("height",), 6),
        ("cylinder", ("axis",), 5),
        ("cylinder", ("center",), 4),
        ("cylinder", ("center", "height"), 3),
        ("cylinder", ("center", "axis", "radius"), 1),
        ("frustum", (), 8),
        ("frustum", ("radius1",), 7),
        ("frustum", ("radius2", "height"), 6),
        ("frustum", ("radius1", "radius2"), 6),
        ("frustum", ("center", "axis", "height"), 2),
        ("tube", (), 8),
        ("tube", ("inner_radius",), 7),
        ("tube", ("outer_radius", "height"), 6),
        ("tube", ("center", "axis", "outer_radius"), 2),
        ("sphere", (), 4),
        ("sphere", ("radius",), 3),
        ("sphere", ("center",), 1),
    ],
)
def test_held_parameters_do_not_move(kind, fixed, size, dtype):
    body, moved = at(kind, np.arange(1.0, 9), fixed)
    assert np.linalg.matrix_rank(body.free_directions(fixed)) == size
    own_radii = getattr(body, "names_of_radii", ("radius",))
    if kind == "tube":
        own_radii = "outer_radius", "inner_radius"
    radii = "radius", "radius1", "radius2", "outer_radius", "inner_radius"
    for name in ("center", "axis", *radii, "height"):
        is_own = name in own_radii
        if not hasattr(body, name) or (name.startswith("radius") and not is_own):
            continue
        found, own = (np.asarray(getattr(b, name)) for b in (moved, body))
        assert np.allclose(found, own, rtol=eps(dtype, 4), atol=0) == (name in fixed)


@jax.jit
def of_wall(body, direction):
    """Nearest approach and square, and their gradients."""
    seen = body.passing(Rays(direction))
    one, never = jnp.ones_like(seen.square), jnp.zeros(seen.square.shape, bool)
    gradients = [
        jnp.stack(body.of_reading(seen, a * one, b * one, never))
        for a, b in ((1, 0), (0, 1))
    ]
    values = jnp.stack([seen.nearest + seen.foot, seen.square])
    return values, jnp.stack(gradients)


@jax.jit
def of_free(body, direction, free):
    """Derivatives of the same in free coordinates: by forward mode, and by basis."""

    def values(vector):
        return of_wall(moved_by(body, free, vector), direction)[0]

    basis = body.free_basis(free, jnp.asarray(UNIT), jnp.asarray(END_UNIT))
    plain = jax.jacfwd(values)(jnp.zeros(len(free)))
    return plain, jnp.einsum("ckn,kf->cnf", of_wall(body, direction)[1], basis)


@FULL
@pytest.mark.usefixtures("double")
@pytest.mark.parametrize(
    ("kind", "fixed"),
    [
        ("cylinder", ("radius", "center")),
        ("frustum", ()),
        # It does not follow the wall to where its end goes.
        ("frustum", ("radius1",)),
        ("frustum", ("radius1", "radius2", "height")),
        ("tube", ("inner_radius", "center")),
        ("sphere", ("radius",)),
    ],
)
def test_gradients_are_those_of_what_is_free_to_move(kind, fixed):
    body = body_of(KINDS[kind]())
    free = jnp.asarray(body.free_directions(fixed))
    plain, found = of_free(body, rays(body.shape, np.float64), free)
    size = np.abs(plain).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(found / size, plain / size, atol=1e-9)


@FULL
@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("kind", ["cylinder", "frustum", "tube"])
@pytest.mark.parametrize(
    ("seen", "height"), [((False, False), 0.04), ((True, False), None)]
)
def test_a_body_that_is_drawn_in_keeps_its_wall(kind, seen, height):
    body = body_of(KINDS[kind]())
    reach = jnp.asarray([0.01, 0.03])
    drawn, carried = body.drawn_in(jnp.asarray(seen), reach)
    expected = float(body.height) / 2 + 0.03 if height is None else height
    assert float(drawn.height) == pytest.approx(expected)
    direction = rays(body.shape, np.float64)
    # The mouth of a bore moves with the end.
    same = passed(body, direction)[0].within == passed(drawn, direction)[0].within
    assert jnp.mean(same) > 0.9
    values, gradients = (x[..., same] for x in of_wall(body, direction))
    kept, found = (x[..., same] for x in of_wall(drawn, direction))
    np.testing.assert_allclose(kept, values, atol=1e-12)
    carried = np.asarray(carried) @ np.asarray(gradients)
    size = np.abs(carried).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(found / size, carried / size, atol=1e-9)
    # Nothing of the wall is seen: no extent to draw in to.
    same, _ = body.drawn_in(jnp.asarray(seen), jnp.full(2, -jnp.inf))
    assert float(same.height) == pytest.approx(float(body.height))


def test_a_change_of_size_is_that_which_grows_by_its_factor():
    factor = jnp.array([0.01, 0.5, 1.0, 1.5, 100.0])
    np.testing.assert_allclose(grown(change_of(factor)), factor, rtol=1e-5)
