"""First surface of a solid made of solids on a ray, in double precision.

By points instead of stretches: wherever any shape's surface, continued without end, is
crossed, the ray is cut, and the middle of each piece is asked whether it lies in the
shapes, by their inequalities. The first piece at whose start the expression's answer
changes is seen. Pieces shorter than `SHORTEST` are none: faces that lie flush differ by
their rounding there. All is counted from the ray's point nearest to the solid.

Nothing of it is shared with the package, but for the numbers of the shapes.
"""

__all__ = ["Shape", "Tree", "answer", "is_inside"]

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

SHORTEST = 1e-7
"""Of a piece, in the solid's own lengths."""

Tree = int | tuple[str, tuple[Any, ...]]
"""Number of a shape, or the name of an operation and the trees that it joins."""

Points = Float[np.ndarray, "n 3"]


@dataclasses.dataclass(frozen=True)
class Shape:
    """A shape by its type's name and its numbers, as the package's class takes them."""

    kind: str
    values: dict[str, Any]


def answer(
    tree: Tree, shapes: Sequence[Shape], origin: Points, direction: Points
) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """What rays see first, in the shapes' frame.

    Returns:
        The ray parameter, `+inf` on a miss; the shape that is seen; and the cosine
        between its normal and the ray.
    """
    speed = np.linalg.norm(direction, axis=-1)
    foot = -np.sum(origin * direction, axis=-1) / speed**2
    foot = np.maximum(foot, 0)
    near, d = origin + foot[:, None] * direction, direction
    places, owners = [], []
    for number, shape in enumerate(shapes):
        crossings = CROSSINGS[shape.kind](shape.values, near, d)
        places += crossings
        owners += [np.full(len(near), number)] * len(crossings)
    place, owner = np.stack(places, axis=-1), np.stack(owners, axis=-1)
    ahead = np.isfinite(place) & (foot[:, None] + place > 0)
    place = np.where(ahead, place, np.inf)
    order = np.argsort(place, axis=-1)
    place = np.take_along_axis(place, order, axis=-1)
    owner = np.take_along_axis(owner, order, axis=-1)
    t, seen = np.full(len(near), np.inf), np.full(len(near), -1)
    begin, before = -foot, np.full(len(near), False)
    known = np.full(len(near), False)
    for k in range(place.shape[1] + 1):
        last = k == place.shape[1]
        end = np.full(len(near), np.inf) if last else place[:, k]
        # Beyond the last crossing nothing changes any more.
        far = np.where(np.isfinite(end), end, begin + 1)
        is_piece = far - begin > SHORTEST / speed
        middle = near + ((begin + far) / 2)[:, None] * d
        inside = is_inside(tree, shapes, middle)
        # Where the origin lies tells on which side the ray begins.
        changes = is_piece & known & (inside != before) & np.isinf(t)
        t = np.where(changes, begin, t)
        if k:
            seen = np.where(changes, owner[:, k - 1], seen)
        before = np.where(is_piece, inside, before)
        known |= is_piece
        begin = np.where(np.isfinite(end), end, begin)
    hit = np.isfinite(t)
    point = near + np.where(hit, t, 0)[:, None] * d
    cosine = np.full(len(near), 1.0)
    for number, shape in enumerate(shapes):
        mine = hit & (seen == number)
        cosine[mine] = _cosine(shape, point[mine], d[mine])
    return np.where(hit, foot + t, np.inf), seen, cosine


def is_inside(
    tree: Tree, shapes: Sequence[Shape], point: Points
) -> Bool[np.ndarray, " n"]:
    """Whether points are in a solid."""
    if isinstance(tree, int):
        shape = shapes[tree]
        return LEVELS[shape.kind](shape.values, point) < 0
    name, terms = tree
    found = [is_inside(term, shapes, point) for term in terms]
    if name == "union":
        return np.any(found, axis=0)
    if name == "intersection":
        return np.all(found, axis=0)
    return found[0] & ~np.any([np.zeros_like(found[0]), *found[1:]], axis=0)


def _cosine(shape: Shape, point: Points, d: Points) -> Float[np.ndarray, " n"]:
    """Between the gradient of a shape's level and a ray, by differences."""
    step, level = 1e-6, LEVELS[shape.kind]
    slopes = [
        level(shape.values, point + way) - level(shape.values, point - way)
        for way in step * np.eye(3)
    ]
    n = np.stack(slopes, axis=-1)
    length = np.maximum(np.linalg.norm(n, axis=-1), 1e-300)
    return np.abs(np.sum(n * d, axis=-1)) / length / np.linalg.norm(d, axis=-1)


def _along(values: dict[str, Any], q: Points) -> tuple[np.ndarray, np.ndarray]:
    """Along and across the axis."""
    a = np.asarray(values["axis"]) / np.linalg.norm(values["axis"])
    along = q @ a
    return along, q - along[..., None] * a


def _ball(values: dict[str, Any], p: Points) -> np.ndarray:
    return np.linalg.norm(p - values["center"], axis=-1) - values["radius"]


def _can(values: dict[str, Any], p: Points) -> np.ndarray:
    along, out = _along(values, p - values["center"])
    wall = np.linalg.norm(out, axis=-1) - values["radius"]
    return np.maximum(wall, np.abs(along) - values["height"] / 2)


def _cuboid(values: dict[str, Any], p: Points) -> np.ndarray:
    q = (p - values["center"]) @ np.asarray(values["rotation"])
    return np.max(np.abs(q) - np.asarray(values["size"]) / 2, axis=-1)


def _half_space(values: dict[str, Any], p: Points) -> np.ndarray:
    return (p - values["point"]) @ np.asarray(values["normal"])


def _ring(values: dict[str, Any], p: Points) -> np.ndarray:
    along, out = _along(values, p - values["center"])
    beside = np.linalg.norm(out, axis=-1) - values["major_radius"]
    return np.hypot(beside, along) - values["minor_radius"]


def _cone_frame(values: dict[str, Any]) -> tuple[np.ndarray, float, float]:
    p1, p2 = np.asarray(values["p1"]), np.asarray(values["p2"])
    length = float(np.linalg.norm(p2 - p1))
    return (p2 - p1) / length, length, (values["radius2"] - values["radius1"]) / length


def _faces(values: dict[str, Any]) -> tuple[np.ndarray, np.ndarray] | None:
    """Normals of a sector's faces, into the sector and out of it."""
    if "start_angle" not in values:
        return None
    a, _, _ = _cone_frame(values)
    zero = np.asarray(values["zero"])
    x = zero - (zero @ a) * a
    x /= np.linalg.norm(x)
    y = np.cross(a, x)
    return tuple(
        y * np.cos(values[name]) - x * np.sin(values[name])
        for name in ("start_angle", "end_angle")
    )  # pyright: ignore[reportReturnType]


def _cone(values: dict[str, Any], p: Points) -> np.ndarray:
    a, length, slope = _cone_frame(values)
    q = p - values["p1"]
    along = q @ a
    out = np.linalg.norm(q - along[..., None] * a, axis=-1)
    wall = (out - values["radius1"] - slope * along) / np.hypot(1, slope)
    level = np.maximum(wall, np.abs(along - length / 2) - length / 2)
    faces = _faces(values)
    if faces is None:
        return level
    start, end = faces
    cuts = np.stack([-q @ start, q @ end])
    is_convex = np.cross(start, end) @ a >= 0
    cut = np.max(cuts, axis=0) if is_convex else np.min(cuts, axis=0)
    return np.maximum(level, cut)


def _roots(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> list[np.ndarray]:
    """Where a t^2 + 2 b t + c is 0, NaN where it never is."""
    with np.errstate(all="ignore"):
        root = np.sqrt(b * b - a * c)
        far = -(b + np.where(b < 0, -root, root))
        return [far / a, c / far]


def _plane(normal: np.ndarray, level: Any, o: Points, d: Points) -> np.ndarray:
    with np.errstate(all="ignore"):
        return (level - o @ normal) / (d @ normal)


def _of_ball(values: dict[str, Any], o: Points, d: Points) -> list[np.ndarray]:
    q = o - values["center"]
    squares = np.sum(q * q, axis=-1) - values["radius"] ** 2
    return _roots(np.sum(d * d, axis=-1), np.sum(q * d, axis=-1), squares)


def _of_can(values: dict[str, Any], o: Points, d: Points) -> list[np.ndarray]:
    q = o - values["center"]
    (_, e), (_, p) = _along(values, d), _along(values, q)
    a = np.asarray(values["axis"]) / np.linalg.norm(values["axis"])
    half = values["height"] / 2
    ends = [_plane(a, end, q, d) for end in (-half, half)]
    squares = np.sum(p * p, axis=-1) - values["radius"] ** 2
    return ends + _roots(np.sum(e * e, axis=-1), np.sum(e * p, axis=-1), squares)


def _of_cuboid(values: dict[str, Any], o: Points, d: Points) -> list[np.ndarray]:
    q, columns = o - values["center"], np.asarray(values["rotation"]).T
    return [
        _plane(column, side * size / 2, q, d)
        for column, size in zip(columns, values["size"], strict=True)
        for side in (-1, 1)
    ]


def _of_half_space(values: dict[str, Any], o: Points, d: Points) -> list[np.ndarray]:
    return [_plane(np.asarray(values["normal"]), 0.0, o - values["point"], d)]


def _of_cone(values: dict[str, Any], o: Points, d: Points) -> list[np.ndarray]:
    a, length, slope = _cone_frame(values)
    q = o - values["p1"]
    along, speed = q @ a, d @ a
    p, e = q - along[:, None] * a, d - speed[:, None] * a
    rho, k = values["radius1"] + slope * along, slope * speed
    found = [_plane(a, end, q, d) for end in (0.0, length)]
    found += _roots(
        np.sum(e * e, axis=-1) - k * k,
        np.sum(e * p, axis=-1) - rho * k,
        np.sum(p * p, axis=-1) - rho * rho,
    )
    return found + [_plane(face, 0.0, q, d) for face in _faces(values) or ()]


def _of_ring(values: dict[str, Any], o: Points, d: Points) -> list[np.ndarray]:
    """Roots of (|q|^2 + R^2 - r^2)^2 = 4 R^2 |q across the axis|^2."""
    speed = np.linalg.norm(d, axis=-1)
    q, d = o - values["center"], d / speed[:, None]
    (_, e), (_, p) = _along(values, d), _along(values, q)
    major, minor = values["major_radius"], values["minor_radius"]
    half = np.sum(q * d, axis=-1)
    rest = np.sum(q * q, axis=-1) + major**2 - minor**2
    four = 4 * major**2
    c3 = 4 * half
    c2 = 2 * rest + 4 * half**2 - four * np.sum(e * e, axis=-1)
    c1 = 4 * half * rest - 2 * four * np.sum(e * p, axis=-1)
    c0 = rest**2 - four * np.sum(p * p, axis=-1)
    matrix = np.zeros((len(o), 4, 4))
    matrix[:, 1:, :3] = np.eye(3)
    matrix[:, :, 3] = np.stack([-c0, -c1, -c2, -c3], axis=-1)
    roots = np.linalg.eigvals(matrix)
    real = np.where(np.abs(roots.imag) < 1e-4, roots.real, np.nan)
    for _ in range(3):
        x = real + 0
        value = (((x + c3[:, None]) * x + c2[:, None]) * x + c1[:, None]) * x
        value += c0[:, None]
        slope = ((4 * x + 3 * c3[:, None]) * x + 2 * c2[:, None]) * x + c1[:, None]
        with np.errstate(all="ignore"):
            step = value / slope
        real = np.where(np.abs(step) < 1e-3, x - step, x)
    return [real[:, k] / speed for k in range(4)]


LEVELS: dict[str, Callable[[dict[str, Any], Points], np.ndarray]] = {
    "box": _cuboid,
    "cylinder": _can,
    "frustum": _cone,
    "plane": _half_space,
    "sphere": _ball,
    "torus": _ring,
}
"""Functions that are negative inside."""

CROSSINGS: dict[str, Callable[[dict[str, Any], Points, Points], list[np.ndarray]]] = {
    "box": _of_cuboid,
    "cylinder": _of_can,
    "frustum": _of_cone,
    "plane": _of_half_space,
    "sphere": _of_ball,
    "torus": _of_ring,
}
"""Where rays cross the surfaces, and what continues them; NaN where they do not."""
