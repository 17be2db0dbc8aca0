"""What the tests of pages share: a fit that was made, others like it, and tracks."""

import dataclasses
import functools
import json
import re

import jax.numpy as jnp
import numpy as np

import impostor_jax as ij
from impostor_jax.track.followed import TOLD
from impostor_jax.track.track import Track, TrackStatus
from tests.fit.scenes import CAMERA, SIGMA, image

STD = 0.002


@functools.cache
def can_fit():
    """Of a can, with its mask."""
    depth, mask = image()
    return ij.fit_cylinder(depth, CAMERA, mask, SIGMA)


def fit_of(shape, **std):
    """A fit that found a shape, with standard deviations of its sizes."""
    given = {name: jnp.asarray(value) for name, value in std.items()}
    names = ("center", "axis", "across_axis", "along_axis", "p1", "p2", "size")
    names += ("rotation", "along_edges")
    sizes = ("radius", "radius1", "radius2", "outer_radius", "inner_radius", "height")
    lines = {name: jnp.full(3, STD) for name in names}
    lines |= {name: jnp.asarray(STD) for name in sizes}
    return dataclasses.replace(
        can_fit(), shape=shape, std=ij.Deviations.of(lines | given)
    )


SHAPES = {
    "can": ij.Cylinder((-0.1, 0.0, 0.5), (0.2, 0.9, 0.3), 0.03, 0.1),
    "cup": ij.Frustum((0.0, -0.05, 0.5), (0.01, 0.06, 0.47), 0.02, 0.035),
    "ball": ij.Sphere((0.1, 0.05, 0.55), 0.03),
    "pipe": ij.tube((0.1, -0.06, 0.5), (0.5, 0.4, 0.7), 0.035, 0.025, 0.08),
}


def scene_of(page):
    """What the script of a page, its HTML, is told."""
    text = re.search(r'id="scene">(.*?)</script>', page, re.DOTALL)
    return json.loads(text[1])


def track_of(identity, shape, status="tracked"):
    """A track of a cylinder, 3 mm unsure of its place, that moves by 0.1 m/s."""
    is_lost = status == "lost"
    known = np.diag([0.01**2] * 2 + [0.003**2] * 3 + [STD**2] * 2 + [0.02**2] * 3)
    own = np.sqrt(np.diagonal(known))
    by_name = {
        "center": np.full(3, 0.003),
        "axis": own[:2],
        "radius": own[5:6],
        "height": np.array([np.inf]),
    }
    names = [name for name, values in by_name.items() for _ in values]
    return Track(
        identity=identity,
        status=TrackStatus(status),
        reason="something hides it" if is_lost else "",
        cylinder=shape,
        velocity=np.array([0.1, 0.0, 0.0]),
        std=ij.Deviations(np.concatenate([*by_name.values()]), tuple(names)),
        covariance=known,
        coordinates=TOLD,
        time=0.0,
        first_seen=0.0,
        last_seen=0.0,
        num_fits=4,
        visible=0.5,
        mask=np.zeros((120, 160), bool),
        fit=None,
    )
