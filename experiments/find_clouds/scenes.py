"""Clouds as a scanner sees them: forests, pipe racks, tables, and rooms without pipes.

The scanner is level, y points down. Everything is drawn anew for each cloud: sizes,
places, noise, how dense the scan is, and from how many places it was made.
"""

__all__ = ["KINDS", "DrawnCloud", "draw_cloud"]

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

import impostor_jax as ij
from impostor_jax.matching import Truth

SCANNER_HEIGHT = 1.6
"""Above the ground, in meters."""

COUNTED_POINTS = 150
"""Of a cylinder that must be found."""

COUNTED_WIDTH = 4.0
"""Its radius, over the distance of neighboring rays at it."""

COUNTED_LENGTH = 1.0
"""The same of what is seen of its length, over its radius."""


class Drawing(NamedTuple):
    """What is in front of a scanner.

    Attributes:
        targets: What is to be found, cylinders and stems.
        others: All else.
        size: Rows and columns of a scan.
        elevation: Of the lowest and the highest row, in radians, positive upward.
        azimuth: Of the first and the last column.
        places: Of the scanner.
        noise: Standard deviation of a range, in meters.
        rough: Height of the bumps of the ground, in meters.
    """

    targets: Sequence[ij.Cylinder | ij.Frustum]
    others: Sequence[ij.AbstractPrimitive]
    size: tuple[int, int]
    elevation: tuple[float, float]
    azimuth: tuple[float, float]
    places: Float[np.ndarray, "s 3"]
    noise: float
    rough: float = 0.0


class DrawnCloud(NamedTuple):
    """A cloud, and what is in it.

    Attributes:
        points: In meters.
        origins: Where each was seen from.
        target: Number of the target that each point is of; -1 of none.
        truth: The targets, as detections are compared with them.
        noise: Standard deviation of a range, in meters.
    """

    points: Float[np.ndarray, "n 3"]
    origins: Float[np.ndarray, "n 3"]
    target: Int[np.ndarray, " n"]
    truth: Truth
    noise: float


def draw_cloud(kind: str, seed: int, quick: bool = False) -> DrawnCloud:
    """A cloud of one of `KINDS`.

    Args:
        kind: Its name.
        seed: Of all draws.
        quick: Whether with a sixteenth of the points, for a trial of the code.
    """
    rng = np.random.default_rng([seed, list(KINDS).index(kind)])
    drawing = KINDS[kind](rng)
    if quick:
        drawing = drawing._replace(size=(drawing.size[0] // 4, drawing.size[1] // 4))
    scene = ij.Scene([*drawing.targets, *drawing.others])
    parts = [_scanned(scene, drawing, place, rng) for place in drawing.places]
    points, origins, index = map(np.concatenate, zip(*parts, strict=True))
    target = np.where(index < len(drawing.targets), index, -1)
    if drawing.rough:
        _roughen(points, target, drawing.rough, rng)
    truth = _truth(drawing, points, target)
    return DrawnCloud(points, origins, target, truth, drawing.noise)


def _scanned(
    scene: ij.Scene,
    drawing: Drawing,
    place: Float[np.ndarray, "3"],
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points that are seen from a place, that place, and what each is of."""
    camera = ij.SphericalCamera(
        np.linspace(*drawing.elevation, drawing.size[0]),
        np.linspace(*drawing.azimuth, drawing.size[1]),
        camera_from_world=ij.RigidTransform(np.eye(3), -place),
    )
    maps = ij.render(scene, camera, outputs=("depth", "mask", "index"))
    mask = np.asarray(maps.mask)
    distance = np.asarray(maps.depth, float)[mask]
    distance += rng.normal(0, drawing.noise, len(distance))
    elevation = np.asarray(camera.elevation, float)[:, None]
    azimuth = np.asarray(camera.azimuth, float)[None]
    direction = np.stack(
        [
            np.cos(elevation) * np.sin(azimuth),
            -np.sin(elevation) + 0 * azimuth,
            np.cos(elevation) * np.cos(azimuth),
        ],
        axis=-1,
    )[mask]
    points = place + distance[:, None] * direction
    return points, np.broadcast_to(place, points.shape), np.asarray(maps.index)[mask]


def _roughen(
    points: Float[np.ndarray, "n 3"],
    target: Int[np.ndarray, " n"],
    height: float,
    rng: np.random.Generator,
) -> None:
    """Move the points of the ground up and down, by bumps of all sizes."""
    low = (target < 0) & (points[:, 1] > SCANNER_HEIGHT - 0.05)
    ground = points[low][:, [0, 2]]
    for size in (0.3, 1.0, 4.0):
        way, phase = rng.normal(0, 2 * np.pi / size, (2, 2)), rng.uniform(0, 7, 2)
        waves = np.sin(ground @ way.T + phase).prod(axis=1)
        points[low, 1] += height * size / 4 * waves


def _truth(
    drawing: Drawing, points: Float[np.ndarray, "n 3"], target: Int[np.ndarray, " n"]
) -> Truth:
    """Targets where most of each is seen, and whether it must be found."""
    axes, places, radii, counted = [], [], [], []
    step = (drawing.azimuth[1] - drawing.azimuth[0]) / drawing.size[1]
    for number, shape in enumerate(drawing.targets):
        first, axis, length, ends = _of(shape)
        own = points[target == number]
        along = (own - first) @ axis if len(own) else np.array([length / 2])
        middle = float(np.median(along))
        radius = float(np.interp(middle, (0, length), ends))
        place = first + middle * axis
        reach = np.linalg.norm(drawing.places - place, axis=1).min()
        seen = float(np.ptp(np.percentile(along, [2, 98])))
        axes.append(axis)
        places.append(place)
        radii.append(radius)
        counted.append(
            len(own) >= COUNTED_POINTS
            and radius >= COUNTED_WIDTH * step * reach
            and seen >= COUNTED_LENGTH * radius
        )
    shape = (-1, 3)
    return Truth(
        np.reshape(axes, shape),
        np.reshape(places, shape),
        np.array(radii, float),
        np.array(counted, bool),
    )


def _of(
    shape: ij.Cylinder | ij.Frustum,
) -> tuple[np.ndarray, np.ndarray, float, tuple[float, float]]:
    """First end, axis, length, and the radii of both ends."""
    if isinstance(shape, ij.Frustum):
        first, last = (np.asarray(end, float) for end in (shape.p1, shape.p2))
        length = float(np.linalg.norm(last - first))
        ends = float(shape.radius1), float(shape.radius2)
        return first, (last - first) / length, length, ends
    axis, center = np.asarray(shape.axis, float), np.asarray(shape.center, float)
    axis, length = axis / np.linalg.norm(axis), float(shape.height)
    radius = float(shape.radius)
    return center - length / 2 * axis, axis, length, (radius, radius)


def _forest(rng: np.random.Generator) -> Drawing:
    """Stems that taper and lean, twigs, bushes, and rough ground."""
    extent = 14.0
    scans = int(rng.integers(1, 4))
    places = np.zeros((scans, 3))
    places[1:, [0, 2]] = rng.uniform(-6, 6, (scans - 1, 2))
    stems, twigs, taken = [], [], []
    for _ in range(int(rng.integers(10, 60))):
        foot = rng.uniform(-extent, extent, 2)
        if not _is_free(foot, [*taken, *places[:, [0, 2]]], 0.8):
            continue
        taken.append(foot)
        radius, length = rng.uniform(0.04, 0.3), rng.uniform(5, 16)
        lean = rng.normal(0, 0.04, 2)
        axis = np.array([lean[0], -1.0, lean[1]])
        axis /= np.linalg.norm(axis)
        first = np.array([foot[0], SCANNER_HEIGHT + 0.1, foot[1]])
        top = max(radius - rng.uniform(0.001, 0.008) * length, 0.4 * radius)
        stems.append(ij.Frustum(first, first + length * axis, radius, top))
        for _ in range(int(rng.integers(2, 9))):
            begin = first + axis * length * rng.uniform(0.15, 0.95)
            way = _direction(rng) * np.array([1, 0.4, 1])
            long = rng.uniform(0.3, 1.5)
            middle = begin + way / np.linalg.norm(way) * long / 2
            twigs.append(ij.Cylinder(middle, way, rng.uniform(0.005, 0.02), long))
    bushes = []
    for _ in range(int(rng.integers(0, 25))):
        place = rng.uniform(-extent, extent, 2)
        if _is_free(place, [*places[:, [0, 2]]], 1.2):
            bottom = SCANNER_HEIGHT - rng.uniform(0, 0.3)
            center = (place[0], bottom, place[1])
            bushes.append(ij.Sphere(center, rng.uniform(0.1, 0.5)))
    return Drawing(
        targets=stems,
        others=[*twigs, *bushes, _ground(rng)],
        size=(400, 1600),
        elevation=(-0.9, 0.9),
        azimuth=(-np.pi, np.pi - 2 * np.pi / 1600),
        places=places,
        noise=rng.uniform(0.002, 0.01),
        rough=rng.uniform(0.0, 0.15),
    )


def _rack(rng: np.random.Generator) -> Drawing:
    """Pipes along and across, beside each other, before a wall; and boxes."""
    pipes = []
    for number in range(int(rng.integers(3, 14))):
        way = np.eye(3)[number % 2] + rng.normal(0, 0.02, 3)
        center = rng.uniform((-1.8, -1.0, 3.2), (1.8, 1.0, 5.3))
        pipes.append(
            ij.Cylinder(center, way, rng.uniform(0.015, 0.15), rng.uniform(0.6, 4))
        )
    boxes = [
        _box(rng, rng.uniform((-2.2, 0.5, 3.0), (2.2, 1.3, 5.5)), (0.1, 0.7))
        for _ in range(int(rng.integers(0, 6)))
    ]
    others = [*boxes, ij.Plane((0, 0, 6), (0.0, 0.0, -1.0)), _ground(rng)]
    dense = rng.uniform(0.5, 1.2)
    return Drawing(
        targets=pipes,
        others=others,
        size=(int(500 * dense), int(700 * dense)),
        elevation=(-0.6, 0.5),
        azimuth=(-0.7, 0.7),
        places=np.zeros((1, 3)),
        noise=rng.uniform(0.0005, 0.005),
    )


def _table(rng: np.random.Generator) -> Drawing:
    """Cans among boxes, balls and cones on a table, seen from above."""
    top, taken = 0.35, []
    cans, others = [], []

    def place() -> np.ndarray:
        spot = rng.uniform((-0.35, 0.7), (0.35, 1.3))
        while not _is_free(spot, taken, 0.14) and rng.random() > 0.005:
            spot = rng.uniform((-0.35, 0.7), (0.35, 1.3))
        taken.append(spot)
        return spot

    for _ in range(int(rng.integers(1, 7))):
        x, z = place()
        radius, height = rng.uniform(0.02, 0.06), rng.uniform(0.05, 0.2)
        if rng.random() < 0.25:
            turn = rng.uniform(0, 2 * np.pi)
            way, up = (np.cos(turn), 0.0, np.sin(turn)), radius
        else:
            way, up = (0.0, -1.0, 0.0), height / 2
        cans.append(ij.Cylinder((x, top - up, z), way, radius, height))
    for _ in range(int(rng.integers(1, 7))):
        others.append(_thing(rng, place(), top))
    others += [ij.Plane((0, top, 0), (0.0, -1.0, 0.0))]
    others += [ij.Plane((0, 0, rng.uniform(1.6, 3)), (0.0, 0.0, -1.0))]
    dense = rng.uniform(0.5, 1.2)
    return Drawing(
        targets=cans,
        others=others,
        size=(int(400 * dense), int(500 * dense)),
        elevation=(-0.55, 0.1),
        azimuth=(-0.45, 0.45),
        places=np.zeros((1, 3)),
        noise=rng.uniform(0.0003, 0.002),
    )


def _no_cylinders(rng: np.random.Generator) -> Drawing:
    """Boxes, balls, cones, rings and arms in a room, or on a table."""
    others: list[ij.AbstractPrimitive] = []
    taken: list[np.ndarray] = []
    if rng.random() < 0.5:
        for _ in range(int(rng.integers(4, 12))):
            spot = rng.uniform((-0.35, 0.7), (0.35, 1.3))
            if _is_free(spot, taken, 0.12):
                taken.append(spot)
                others.append(_thing(rng, spot, 0.35))
        others.append(ij.Plane((0, 0.35, 0), (0.0, -1.0, 0.0)))
        others.append(ij.Plane((0, 0, 2.5), (0.0, 0.0, -1.0)))
        size, elevation, azimuth = (400, 500), (-0.55, 0.1), (-0.45, 0.45)
        noise = rng.uniform(0.0003, 0.002)
    else:
        for _ in range(int(rng.integers(4, 14))):
            center = rng.uniform((-2.2, -0.5, 3.0), (2.2, 1.3, 5.5))
            others.append(_box(rng, center, (0.05, 0.9)))
        for _ in range(int(rng.integers(0, 5))):
            center = rng.uniform((-2.2, -0.5, 3.0), (2.2, 1.3, 5.5))
            others.append(ij.Sphere(center, rng.uniform(0.05, 0.5)))
        others.append(ij.Plane((0, 0, 6), (0.0, 0.0, -1.0)))
        others.append(ij.Plane((-2.5, 0, 0), (1.0, 0.0, 0.0)))
        others.append(_ground(rng))
        size, elevation, azimuth = (450, 600), (-0.6, 0.5), (-0.7, 0.7)
        noise = rng.uniform(0.0005, 0.005)
    return Drawing([], others, size, elevation, azimuth, np.zeros((1, 3)), noise)


KINDS: dict[str, Callable[[np.random.Generator], Drawing]] = {
    "forest": _forest,
    "pipe_rack": _rack,
    "table": _table,
    "no_cylinders": _no_cylinders,
}
"""By name: how a drawing of each kind is made."""


def _is_free(
    spot: Float[np.ndarray, "2"], taken: Sequence[np.ndarray], apart: float
) -> bool:
    return all(np.linalg.norm(spot - other) > apart for other in taken)


def _direction(rng: np.random.Generator) -> Float[np.ndarray, "3"]:
    way = rng.normal(size=3)
    return way / np.linalg.norm(way)


def _ground(rng: np.random.Generator) -> ij.Plane:
    tilt = rng.normal(0, 0.02, 2)
    return ij.Plane((0.0, SCANNER_HEIGHT, 0.0), (tilt[0], -1.0, tilt[1]))


def _box(
    rng: np.random.Generator,
    center: Float[np.ndarray, "3"],
    sides: tuple[float, float],
) -> ij.Box:
    """A box that stands, turned anyhow."""
    turn = rng.uniform(0, 2 * np.pi)
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    return ij.Box(center, rotation, rng.uniform(*sides, 3))


def _thing(
    rng: np.random.Generator, spot: Float[np.ndarray, "2"], top: float
) -> ij.AbstractPrimitive:
    """What stands on a table and is no cylinder."""
    x, z = spot
    size = rng.uniform(0.02, 0.06)
    match rng.integers(4):
        case 0:
            center = np.array([x, top - size, z])
            return _box(rng, center, (0.6 * size, 2 * size))
        case 1:
            return ij.Sphere((x, top - size, z), size)
        case 2:
            height = rng.uniform(1.5, 3) * size
            end = (x, top - height, z)
            return ij.Frustum((x, top, z), end, size, rng.uniform(0.1, 0.7) * size)
        case _:
            ring = (x, top - 0.3 * size, z)
            return ij.Torus(ring, (0.0, 1.0, 0.0), size, 0.3 * size)
