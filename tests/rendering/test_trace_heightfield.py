import jax
import numpy as np

import impostor_jax as ij
from tests.groups import FULL

CAMERA = ij.PinholeCamera(24.0, 24.0, 11.5, 7.5, 24, 16)


@FULL
def test_a_heightfield_is_traced_where_it_is_rendered():
    # Once every ray took a heightfield of its own, which cannot be cast; and glass
    # beside it asks which side of it a ray is on.
    turned = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    field = ij.Heightfield(
        [[0.0, 0.1], [0.1, 0.0]],
        ((-0.3, 0.3), (-0.2, 0.2)),
        world_from_field=ij.RigidTransform(turned, (0.1, 0.0, 1.5)),
    )
    scene = ij.Scene([field, ij.Sphere((-0.3, 0.0, 1.2), 0.1)])
    materials = [ij.Material((1.0, 0.5, 0.25)), ij.Material(transmit=1.0, ior=1.0)]
    # TODO: rays that wait in glass are promoted in rank and type, which tests forbid.
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        picture = ij.trace(scene, CAMERA, [ij.AmbientLight(1.0)], materials)
    # Glass that bends nothing is not seen.
    mask = ij.render(field, CAMERA, ("mask",)).mask
    assert mask is not None
    assert 50 < int(mask.sum()) < 300
    expected = np.where(np.asarray(mask)[..., None], (1.0, 0.5, 0.25), 0.0)
    np.testing.assert_allclose(picture, expected, atol=1e-6)
