import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.numerics import eps
from tests.cases import pose


def test_inverse_undoes_the_transform(dtype):
    transform = pose()
    points = jnp.asarray(np.random.default_rng(0).normal(size=(5, 3)), dtype)
    back = transform.inverse().apply(transform.apply(points))
    np.testing.assert_allclose(back, points, atol=eps(dtype, 16))


def test_product_applies_the_right_factor_first(dtype):
    first, second = pose(), RigidTransform(np.eye(3)[[1, 2, 0]], (1, 2, 3))
    point = jnp.asarray([[0.3, -0.2, 1.1]], dtype)
    np.testing.assert_allclose(
        (second @ first).apply(point), second.apply(first.apply(point)), rtol=1e-6
    )


def test_homogeneous_matrix_is_read_as_rotation_and_translation(dtype):
    matrix = np.eye(4)
    matrix[:3, 3] = (1, 2, 3)
    transform = RigidTransform.from_matrix(matrix)
    np.testing.assert_array_equal(transform.translation, [1, 2, 3])


@pytest.mark.parametrize(
    ("rotation", "message"),
    [
        (2 * np.eye(3), "rotation must be orthogonal"),
        (np.diag([1, 1, -1.0]), "rotation must be orthogonal with determinant 1"),
        (np.eye(2), "rotation must be numbers of shape"),
        (np.full((3, 3), np.nan), "rotation must be finite"),
    ],
)
def test_bad_rotation_is_refused(rotation, message):
    with pytest.raises(ValueError, match=message):
        RigidTransform(rotation, (0, 0, 0))


def test_bad_last_row_is_refused():
    with pytest.raises(ValueError, match="matrix must end in the row 0 0 0 1"):
        RigidTransform.from_matrix(np.ones((4, 4)))


@pytest.mark.parametrize(
    "axis", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.6, 0, -0.8), (0.48, 0.6, 0.64)]
)
def test_tangent_basis_completes_a_right_handed_frame(axis, dtype):
    axis = jnp.asarray(axis, dtype)
    first, second = tangent_basis(axis)
    frame = np.stack([first, second, axis])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=eps(dtype, 8))
    np.testing.assert_allclose(np.cross(first, second), axis, atol=eps(dtype, 8))


def test_a_transform_that_reaches_far_keeps_its_digits():
    place = np.array([512345.678, 5412345.678, 250.0])
    rotation = np.asarray(pose().rotation, float)
    # Of a rotation of single precision: it is not orthogonal to double precision.
    far = RigidTransform(rotation, -rotation @ place)
    points = np.array([[0.25, -0.5, 2.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(
        far.apply(place + points), points @ rotation.T, atol=1e-8
    )
    back = far.inverse()
    np.testing.assert_allclose(back.translation, place, rtol=0, atol=1e-8)
    whole = far @ back
    np.testing.assert_allclose(whole.translation, np.zeros(3), atol=1e-8)
    # Beside what is near it is of JAX again.
    assert isinstance(far.apply(place + points), jnp.ndarray)
    assert isinstance(whole.translation, jnp.ndarray)
