"""First crossing of rays with a heightfield, in double precision, by brute force."""

__all__ = [
    "first_in_cells",
    "first_in_samples",
    "heights",
    "random_rays",
    "slant",
    "terrain",
]

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

Numbers = Float[np.ndarray, " n"]
Vectors = Float[np.ndarray, "n 3"]
Height = Callable[[np.ndarray, np.ndarray], np.ndarray]


def terrain(x, z, octaves: int = 10):
    """The published terrain, octave by octave."""
    height, amplitude, x, z = 0.0, 5.0, 0.2 * x, 0.2 * z
    for _ in range(octaves):
        height = height + amplitude * np.sin(x) * np.sin(z)
        amplitude, x, z = 0.5 * amplitude, 2.07 * x, 2.07 * z
    return height


def heights(grid, extent, interpolation: str) -> Height:
    """Heights between the samples, from the kernels of both interpolations."""
    grid = np.asarray(grid, float)
    n, m = grid.shape
    (x0, x1), (z0, z1) = np.asarray(extent, float)
    reach = {"bilinear": 1, "bicubic": 2}[interpolation]
    padded = np.pad(grid, 1, mode="reflect", reflect_type="odd")

    def at(x, z):
        parts = []
        for value, low, high, count in ((x, x0, x1, n), (z, z0, z1, m)):
            place = (np.asarray(value, float) - low) / (high - low) * (count - 1)
            cell = np.clip(np.floor(place), 0, count - 2).astype(int)
            near = np.stack([cell + k for k in range(1 - reach, reach + 1)])
            parts.append((near, _kernel(place - near, interpolation)))
        (i, weight_x), (j, weight_z) = parts
        values = padded[i[:, None] + 1, j[None] + 1]
        return np.sum(values * weight_x[:, None] * weight_z[None], axis=(0, 1))

    return at


def _kernel(distance, interpolation: str):
    d = np.abs(distance)
    if interpolation == "bilinear":
        return 1 - d
    # Keys (1981), Cubic convolution interpolation, with a = -1/2.
    inner = 1.5 * d**3 - 2.5 * d**2 + 1
    outer = -0.5 * d**3 + 2.5 * d**2 - 4 * d + 2
    return np.where(d <= 1, inner, outer)


def _span(
    origin: Vectors, direction: Vectors, box: Float[np.ndarray, "2 2"]
) -> tuple[Numbers, Numbers]:
    """Stretch of each ray over a rectangle, in front of its origin."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (box[None] - origin[:, [0, 2], None]) / direction[:, [0, 2], None]
    first, last = ends.min(axis=2), ends.max(axis=2)
    return np.maximum(first.max(axis=1), 0), last.min(axis=1)


def first_in_cells(grid, extent, origin: Vectors, direction: Vectors) -> Numbers:
    """Of a bilinear grid: the smallest root of the quadratics of all its cells."""
    grid = np.asarray(grid, float)
    n, m = grid.shape
    x, z = (
        np.linspace(*ends, count) for ends, count in zip(extent, (n, m), strict=True)
    )
    best = np.full(len(origin), np.inf)
    for i in range(n - 1):
        for j in range(m - 1):
            box = np.array([[x[i], x[i + 1]], [z[j], z[j + 1]]])
            enter, leave = _span(origin, direction, box)
            open_ = np.where((enter <= leave) & (enter < best))[0]
            if not len(open_):
                continue
            o, d = origin[open_], direction[open_]
            t0, t1 = enter[open_], leave[open_]
            size = box[:, 1] - box[:, 0]
            u, v = ((o + t0[:, None] * d)[:, [0, 2]] - box[:, 0]).T / size[:, None]
            p, q = d[:, [0, 2]].T / size[:, None]
            a, b = grid[i, j], grid[i + 1, j] - grid[i, j]
            c = grid[i, j + 1] - grid[i, j]
            e = grid[i + 1, j + 1] - grid[i + 1, j] - c
            # gap(s) = k0 + k1 s + k2 s^2 from the cell's border on.
            k0 = o[:, 1] + t0 * d[:, 1] - (a + b * u + c * v + e * u * v)
            k1 = d[:, 1] - (b * p + c * q + e * (u * q + v * p))
            k2 = -e * p * q
            for s in _roots(k2, k1, k0):
                fits = (s >= 0) & (s <= t1 - t0)
                t = np.where(fits, t0 + s, np.inf)
                best[open_] = np.minimum(best[open_], t)
    return best


def _roots(a: Numbers, b: Numbers, c: Numbers) -> tuple[Numbers, Numbers]:
    """Roots of a s^2 + b s + c; NaN where there is none."""
    with np.errstate(all="ignore"):
        half = -(b + np.copysign(np.sqrt(b * b - 4 * a * c), b)) / 2
        return half / a, c / half


def first_in_samples(
    height: Height, extent, origin: Vectors, direction: Vectors, count: int
) -> Numbers:
    """First change of sign between `count` samples of the gap, bisected.

    A fold finer than the samples is passed over: the answer may be too late, never too
    early.
    """
    enter, leave = _span(origin, direction, np.asarray(extent, float))
    best = np.full(len(origin), np.inf)

    def gap(k, t):
        point = origin[k] + t[..., None] * direction[k]
        return point[..., 1] - height(point[..., 0], point[..., 2])

    for k in np.where(enter < leave)[0]:
        # Not at the ends, where rounding may leave the extent.
        part = np.linspace(1e-9, 1 - 1e-9, count)
        t = enter[k] + part * (leave[k] - enter[k])
        side = np.sign(gap(k, t))
        change = np.where(side[1:] != side[0])[0]
        if len(change):
            low, high = t[change[0]], t[change[0] + 1]
            for _ in range(60):
                middle = (low + high) / 2
                same = np.sign(gap(k, np.array([middle]))[0]) == side[0]
                low, high = (middle, high) if same else (low, middle)
            best[k] = high
    return best


def slant(height: Height, origin, direction, t, step: float = 1e-6) -> Numbers:
    """Absolute cosine between ray and normal at t, by central differences."""
    x, _, z = (origin + np.where(np.isfinite(t), t, 0)[:, None] * direction).T
    by_x = (height(x + step, z) - height(x - step, z)) / (2 * step)
    by_z = (height(x, z + step) - height(x, z - step)) / (2 * step)
    normal = np.stack([-by_x, np.ones_like(x), -by_z], axis=1)
    lengths = np.linalg.norm(normal, axis=1) * np.linalg.norm(direction, axis=1)
    return np.abs(np.sum(normal * direction, axis=1)) / lengths


def random_rays(
    rng: np.random.Generator, count: int, extent, low: float, high: float
) -> tuple[Vectors, Vectors]:
    """Unit rays from in and around a box to points in it."""
    (x0, x1), (z0, z1) = np.asarray(extent, float)
    corner = np.array([x0, low, z0])
    size = np.array([x1 - x0, high - low, z1 - z0])
    origin = corner + size * rng.uniform(-0.3, 1.3, (count, 3))
    target = corner + size * rng.uniform(0, 1, (count, 3))
    direction = target - origin
    return origin, direction / np.linalg.norm(direction, axis=1, keepdims=True)
