"""Boxes: their faces, what moves them, and what an image does not show of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import impostor_jax as ij
from impostor_jax.fit.body import Rays
from impostor_jax.fit.box_body import ENDS, BoxBody
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.so3 import rotation_by, turn_of
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from tests.fit.bodies import moved_then_turned, rays
from tests.fit.scenes import CAMERA, SIGMA, image_of
from tests.groups import FULL, RELEASE

TURN = Rotation.from_rotvec([0.4, 0.7, 0.2]).as_matrix()
CARTON = ij.Box((0.01, -0.01, 0.4), TURN, (0.06, 0.04, 0.1))
ROOM = ij.Box((0.3, -0.2, 0.5), TURN, (2.0, 2.5, 3.0))
BOXES = {"carton": CARTON, "room": ROOM}


@pytest.fixture(params=BOXES)
def double_box(request, double):
    shape = BOXES[request.param]
    # Single precision leaves its axes 1e-8 off a right angle.
    left, _, right = np.linalg.svd(np.asarray(shape.rotation, float))
    return ij.Box(
        np.asarray(shape.center, float), left @ right, np.asarray(shape.size, float)
    )


def fit_of(shape, seed=0, wall=0.6, **asked):
    depth, mask = image_of(shape, wall, seed)
    asked = {"mask": mask, "sigma": SIGMA} | asked
    return ij.fit_box(depth, CAMERA, **asked)


def scores_of(fit, true):
    """Errors of turn, center and size along the fit's edges, in deviations."""
    turn = np.asarray(fit.box.rotation, float).T @ np.asarray(true.rotation, float)
    order = np.argmax(np.abs(turn), axis=1)
    sides = np.zeros((3, 3))
    sides[range(3), order] = np.sign(turn[range(3), order])
    off = np.asarray(true.center - fit.box.center) @ np.asarray(fit.box.rotation)
    errors = {
        "rotation": np.asarray(turn_of(jnp.asarray(turn @ sides.T))),
        "along_edges": off,
        "size": np.asarray(true.size)[order] - np.asarray(fit.box.size),
    }
    return {name: x / np.asarray(getattr(fit.std, name)) for name, x in errors.items()}


def test_a_turn_is_the_vector_that_makes_it(double):
    turn = jnp.array([0.3, -0.2, 0.5])
    rotation = rotation_by(turn)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    assert float(jnp.linalg.det(rotation)) == pytest.approx(1)
    np.testing.assert_allclose(turn_of(rotation), turn, rtol=1e-14)
    length = float(jnp.linalg.norm(turn))
    angle = Rotation.from_matrix(np.asarray(rotation)).magnitude()
    assert angle == pytest.approx(2 * np.arctan(length / 2), rel=1e-12)


@jax.jit
def seen_and_hit(body, shape, direction):
    zero = jnp.zeros_like(direction.x)
    seen = body.passing(Rays(direction))
    hit = shape.intersect(Ray(Vec3(zero, zero, zero), direction))
    return seen, seen.depth, body.covers(seen), body.margins(seen).value, hit


@pytest.mark.parametrize("name", BOXES)
def test_a_body_is_what_its_primitive_shows(name, dtype):
    shape = jax.tree.map(lambda x: jnp.asarray(np.asarray(x), dtype), BOXES[name])
    direction = rays(shape, dtype)
    found = seen_and_hit(BoxBody.of(shape), shape, direction)
    seen, depth, covers, margins, hit = jax.tree.map(np.asarray, found)
    assert hit.mask.sum() > 10
    np.testing.assert_array_equal(covers, hit.mask & seen.outside)
    error = np.abs(depth - hit.t)[hit.mask] / hit.t[hit.mask]
    steep = seen.cos_incidence[hit.mask] > 0.1
    assert error[steep].max() < eps(dtype, 32)
    # The outline is where the largest margin is 0.
    np.testing.assert_array_equal(margins.max(axis=0) < 0, hit.mask)


@jax.jit
def derivatives(body, direction):
    count = direction.x.shape[0]
    one, zero = jnp.ones(count), jnp.zeros(count)

    def compared(tangent):
        moved = body.retracted(tangent, body.free_directions(()))
        seen = moved.passing(Rays(direction))
        return jnp.stack(
            [seen.depth, *(moved.of_end(seen, one * end, one)[0] for end in ENDS)]
        )

    seen = body.passing(Rays(direction))
    found = [body.of_reading(seen, zero, zero, one > 0)]
    found += [body.of_end(seen, one * end, one)[1] for end in ENDS]
    plain = jax.jacfwd(compared)(jnp.zeros(len(found[0])))
    return plain, jnp.stack([jnp.stack(of) for of in found]).transpose(0, 2, 1)


@FULL
def test_gradients_are_those_of_forward_mode(double_box):
    direction = rays(double_box, np.float64)
    plain, found = map(np.asarray, derivatives(BoxBody.of(double_box), direction))
    scale = 1 + np.abs(plain).max(axis=2, keepdims=True)
    np.testing.assert_allclose(found / scale, plain / scale, atol=1e-9)


def test_motions_are_carried_to_other_frames(double_box):
    body = BoxBody.of(double_box)
    move = RigidTransform(Rotation.random(random_state=0).as_matrix(), (0.3, -0.2, 0.1))
    tangent = jnp.asarray(np.random.default_rng(1).normal(0, 1e-3, 9))
    one, other = moved_then_turned(body, tangent, move)
    for here, there in zip(*map(jax.tree.leaves, (one, other)), strict=True):
        np.testing.assert_allclose(there, here, atol=1e-12)


def test_faces_that_are_drawn_in_carry_motions_with_them(double_box):
    """A box that turns and is drawn in then is one that is drawn in and moves."""
    body = BoxBody.of(double_box)
    free = body.free_directions(())
    seen = jnp.array([True, False, True, True, False, True])
    reach = 0.8 * jnp.repeat(body.half, 2)
    drawn, carried = body.drawn_in(seen, reach)
    np.testing.assert_allclose(
        drawn.half[:2], body.half[:2] * np.array([0.9, 1.0]), rtol=1e-12
    )
    step = 1e-6
    # Of a turn; a face that is not seen goes with what is.
    for k in range(3):
        tangent = step * np.eye(9)[k]
        moved = body.retracted(jnp.asarray(tangent), free)
        shift = body.frame @ (drawn.center - body.center)
        center = moved.center + moved.rotation @ shift
        expected = drawn.retracted(jnp.asarray(tangent @ np.asarray(carried)), free)
        np.testing.assert_allclose(expected.center, center, atol=3 * step**2)


def test_a_box_is_read_alike_however_its_axes_are_named(double_box):
    body = BoxBody.of(double_box)
    turn = jnp.array([[0.0, -1, 0], [0, 0, 1], [-1, 0, 0]])
    other = BoxBody(body.center, turn @ body.frame, jnp.abs(turn) @ body.half)
    seen = jnp.ones(6, bool)
    for name, value in other.readout(body, seen).items():
        own = body.readout(body, seen)[name]
        np.testing.assert_allclose(value, own, atol=1e-12)


@FULL
def test_errors_are_those_that_the_fit_says():
    scores = []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        rotation = Rotation.random(random_state=seed).as_matrix()
        true = ij.Box((0.01, -0.01, 0.4), rotation, rng.uniform(0.03, 0.1, 3))
        fit = fit_of(true, seed)
        assert fit.success, (seed, fit.status)
        scores.append(scores_of(fit, true))
    for name in scores[0]:
        values = np.concatenate([score[name] for score in scores])
        known = values[np.isfinite(values) & (values != 0)]
        assert len(known) >= 40
        assert np.abs(known).max() < 4.5
        # Places of edges are uniform in their pixels: their errors have no tails.
        assert 0.5 < np.sqrt(np.mean(known**2)) < 1.3


def test_edges_along_columns_are_known_to_a_part_of_a_pixel_alone():
    """Upright boxes before a level camera: all rows show an edge in the same place."""
    scores = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        yaw = Rotation.from_rotvec([0, rng.uniform(0.3, 1.2), 0]).as_matrix()
        center = (*rng.uniform(-0.01, 0.01, 2), 0.4)
        true = ij.Box(center, yaw, rng.uniform(0.04, 0.1, 3))
        fit = fit_of(true, seed)
        assert fit.success, (seed, fit.status)
        assert (np.asarray(fit.std.size) > 5e-5).all()
        scores.append(scores_of(fit, true))
    for name in ("along_edges", "size"):
        values = np.concatenate([score[name] for score in scores])
        assert np.isfinite(values).all()
        # Each row as a place of its own, they were off by 3.4 deviations and up to 9.
        assert np.abs(values).max() < 3.5
        assert 0.4 < np.sqrt(np.mean(values**2)) < 1.3


@FULL
def test_a_room_is_fitted_from_inside():
    some = np.zeros((120, 160), bool)
    some[::3, ::3] = True
    fit = fit_of(ROOM, wall=None, mask=some)
    assert fit.success
    assert np.abs(scores_of(fit, ROOM)["rotation"]).max() < 4.5
    # What is behind the camera is not seen.
    assert not fit.ends_seen.all()
    assert np.isinf(fit.std.size).any()


@FULL
def test_a_plate_is_no_room():
    # Its normals are off by more than it is thick, and so they looked inward.
    turn = Rotation.random(random_state=8).as_matrix()
    fit = fit_of(ij.Box((0.0, 0.0, 0.35), turn, (0.2, 0.05, 0.008)), 8)
    assert fit.success
    np.testing.assert_allclose(np.sort(fit.shape.size), (0.008, 0.05, 0.2), atol=0.004)


def test_a_face_that_nothing_shows_is_open():
    depth, mask = image_of(CARTON)
    rows = np.flatnonzero(mask.any(axis=1))
    part = mask.copy()
    part[: rows[len(rows) // 2]] = False
    fit = ij.fit_box(depth, CAMERA, mask=part, sigma=SIGMA)
    assert fit.success
    assert np.isfinite(fit.std.rotation).all()
    # The mask goes on beyond neither side's end but where there is background.
    is_open = np.isinf(fit.std.size)
    assert is_open.any()
    assert "A face is not seen: size is the visible extent" in str(fit)
    known = scores_of(fit, CARTON)["size"][~is_open]
    assert np.all(np.abs(known) < 4.5)


@FULL
def test_a_face_beyond_the_image_is_not_seen():
    # Where the image ends, readings of one face are as well of the next: with an edge
    # there, that one was seen, and the size 4 mm too small by ten deviations.
    camera = ij.PinholeCamera(150.0, 150.0, 79.5, 59.5, 160, 120)
    random = np.random.default_rng(143)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    box = ij.Box((0.38, 0, 0.75), turn, random.uniform(0.08, 0.4, 3))
    maps = ij.render(box, camera, outputs=("depth", "mask"))
    depth, mask = np.asarray(maps.depth), np.asarray(maps.mask)
    depth = np.where(mask, depth, 1.3) + random.normal(0, 0.0015, mask.shape)
    fit = ij.fit_box(depth.astype(np.float32), camera, mask=mask, sigma=0.0015)
    assert fit.success
    assert not np.all(fit.ends_seen)
    assert all(np.all(np.abs(x) < 4) for x in scores_of(fit, box).values())


@FULL
def test_one_face_is_no_box():
    face = ij.Box((0, 0, 0.4), np.eye(3), (0.06, 0.1, 0.04))
    fit = fit_of(face)
    assert fit.status == ij.FitStatus.UNDETERMINED
    assert np.isinf(fit.std.size).all()


@FULL
@pytest.mark.parametrize(
    "shape",
    [
        pytest.param(
            ij.Cylinder((0.01, 0, 0.4), (0.3, 0.8, 0.5), 0.04, 0.12), id="can"
        ),
        pytest.param(ij.Sphere((0.01, 0, 0.4), 0.05), id="ball", marks=RELEASE),
    ],
)
def test_what_is_round_is_no_box(shape):
    assert not fit_of(shape).success


@FULL
def test_what_is_held_stays_and_is_tested():
    fit = fit_of(CARTON, initial=CARTON, fixed=("size",))
    assert fit.success
    np.testing.assert_array_equal(fit.box.size, CARTON.size)
    np.testing.assert_array_equal(fit.std.size, 0)
    wrong = ij.Box(CARTON.center, CARTON.rotation, (0.07, 0.04, 0.1))
    fit = fit_of(CARTON, initial=wrong, fixed=("size",))
    assert fit.status == ij.FitStatus.CONTRADICTED
    assert "Fixed states size as 70.000 40.000 100.000 mm" in fit.reason
    about = Rotation.from_rotvec([0.4, 0.8, 0.2]).as_matrix()
    wrong = ij.Box(CARTON.center, about, CARTON.size)
    fit = fit_of(CARTON, initial=wrong, fixed=("rotation",))
    assert fit.status == ij.FitStatus.CONTRADICTED
    assert "Fixed states rotation as" in fit.reason
    assert "degrees" in fit.reason


def test_a_prior_of_its_size_counts():
    fit = fit_of(CARTON, initial=CARTON, prior={"size": (CARTON.size, 1e-5)})
    assert fit.success
    assert np.all(np.asarray(fit.std.size) < 1.1e-5)
    with pytest.raises(ValueError, match="tells which edge is which"):
        fit_of(CARTON, prior={"size": (CARTON.size, 1e-5)})
    with pytest.raises(ValueError, match="prior must be one of center, size"):
        fit_of(CARTON, prior={"rotation": (TURN, 0.1)})
    with pytest.raises(ValueError, match="depth must be given to fit a box"):
        ij.fit_box(None, CAMERA, mask=image_of(CARTON)[1], mask_meaning="outline")


@FULL
def test_two_views_are_better_than_one():
    depth, mask = image_of(CARTON)
    given = [depth, depth], [CAMERA, CAMERA], [mask, mask]
    exact = {"sigma": SIGMA, "pose_sigma": (0.0, 0.0)}
    both = ij.fit_box(given[0], given[1], mask=given[2], **exact)
    alone = fit_of(CARTON)
    ratio = np.asarray(both.std.rotation) / np.asarray(alone.std.rotation)
    np.testing.assert_allclose(ratio, 2**-0.5, rtol=0.05)


@RELEASE
def test_a_traced_fit_grows_with_its_depths():
    depth, mask = image_of(CARTON)

    @jax.jit
    def along(depth):
        def size(depth):
            fit = ij.fit_box(depth, CAMERA, mask, SIGMA, CARTON)
            return fit.box.size, fit.success

        return jax.jvp(size, (depth,), (depth,))

    (size, success), (change, _) = along(jnp.asarray(depth))
    assert success
    # Three edges end at background, whose places in the image do not scale.
    np.testing.assert_allclose(change, size, rtol=0.02)


def test_it_is_told_with_its_axes():
    fit = fit_of(CARTON)
    assert fit.kind == "box"
    text = str(fit)
    assert "  size    " in text
    assert "degrees)" in text
    np.testing.assert_allclose(fit.pose[:3, :3], fit.box.rotation)
    record = fit.to_dict()
    assert record["shape"] == "box"
    assert np.shape(record["rotation"]) == (3, 3)
    assert np.shape(record["std"]["rotation_rad"]) == (3,)
    with pytest.raises(AttributeError, match="got that of a box"):
        fit.cylinder  # noqa: B018
    found = ij.fit_labels(
        *(image_of(CARTON)[0], CAMERA, image_of(CARTON)[1].astype(int)),
        fit=ij.fit_box,
        sigma=SIGMA,
    )
    np.testing.assert_allclose(found[1].box.size, fit.box.size)
