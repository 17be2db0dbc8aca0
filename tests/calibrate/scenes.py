"""Images of a wall and a table, at many distances and slants."""

import jax
import numpy as np

import impostor_jax as ij

CAMERA = ij.PinholeCamera(fx=140.0, fy=140.0, cx=79.5, cy=59.5, width=160, height=120)

LAW = ij.StructuredLight(floor=0.001, growth=0.002, grazing=0.0002)
NATIVE_SCALE = 0.5
"""So that a matching window is of a size with these images."""

SENSOR = ij.CorrelatedNoise(
    ij.CorrelatedNoise(
        ij.MatchingWindow(LAW, native_scale=NATIVE_SCALE), deviation=0.0006, length=2.0
    ),
    deviation=0.0012,
    length=14.0,
)


def image_of(sensor, distance, turn, elevation, seed=0, shapes=()):
    """Readings of a wall that is turned and a table that is looked down upon."""
    wall = ij.Plane((0.0, 0.0, distance), (np.sin(turn), 0.0, -np.cos(turn)))
    down = 0.0, -np.cos(elevation), -np.sin(elevation)
    table = ij.Plane((0.0, 0.1 * distance, 0.95 * distance), down)
    scene = ij.Scene([wall, table, *shapes])
    maps = ij.render(scene, CAMERA, outputs=("depth", "normal", "index"))
    key = jax.random.key(seed)
    return np.asarray(sensor.sample(key, maps.depth, maps.normal, CAMERA)), maps


def images_of(sensor, count=20, seed=0, nearest=0.5, farthest=1.7):
    """Some of them."""
    rng = np.random.default_rng(seed)
    turns = np.radians(rng.uniform(-35, 35, count))
    elevations = np.radians(rng.uniform(25, 60, count))
    distances = np.linspace(nearest, farthest, count)
    return np.stack(
        [
            image_of(sensor, *drawn, seed=1000 * seed + number)[0]
            for number, drawn in enumerate(
                zip(distances, turns, elevations, strict=True)
            )
        ]
    )
