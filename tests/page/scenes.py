"""Fits that the tests of pages share: one that was made, and others like it."""

import dataclasses
import functools
import json
import re

import jax.numpy as jnp

import impostor_jax as ij
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
