"""Small videos of cans before a wall, and measurements that no image was made for."""

import numpy as np

import impostor_jax as ij
from impostor_jax.track.measured import Measured, basis_of
from tests.find.scenes import image_of
from tests.fit.scenes import CAMERA, SIGMA, camera_with

WALL = ij.Plane((0.0, 0.0, 0.8), (0.0, 0.0, -1.0))
RATE = 30.0
AXIS = np.array([0.2, 0.95, -0.24]) / np.linalg.norm([0.2, 0.95, -0.24])


def can(x=0.0, y=0.0, z=0.5, radius=0.04, height=0.12, axis=AXIS):
    return ij.Cylinder((x, y, z), axis, radius, height)


def frame(shapes, seed=0, camera=CAMERA, sigma=SIGMA):
    """A noisy image of some shapes before a wall."""
    return image_of([WALL, *shapes], camera, sigma, seed).depth


def moved(x):
    """The camera, to the right of where it was."""
    pose = np.eye(4)
    pose[0, 3] = -x
    return camera_with(camera_from_world=pose)


def measured(rng, center, axis, own, shared, radius=0.04, height=0.12, errors=None):
    """What a fit would say: the truth, with errors of its own and of what is shared.

    Args:
        rng: Of what is the image's own.
        center: True place, in meters.
        axis: True axis.
        own: Standard deviations in `COORDINATES`.
        shared: What a standard deviation of each shared error does.
        radius: True radius.
        height: True height.
        errors: Shared errors, in standard deviations.
    """
    errors = np.zeros(shared.shape[1]) if errors is None else errors
    off = shared @ errors + own * rng.normal(size=7)
    basis = np.vstack([basis_of(axis), axis])
    tilted = axis + off[:2] @ basis[:2]
    tilted /= np.linalg.norm(tilted)
    own_basis = np.vstack([basis_of(tilted), tilted])
    shared = shared.copy()
    shared[2:5] = own_basis @ basis.T @ shared[2:5]
    return Measured(
        center=center + off[2:5] @ basis,
        axis=tilted,
        radius=radius + off[5],
        height=height + off[6],
        basis=own_basis,
        own=np.diag(own**2),
        shared=shared,
        is_known=np.ones(7, bool),
        end=0,
        end_std=0.003,
    )
