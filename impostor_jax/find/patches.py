"""Patches of objects, at several scales."""
__all__ = ["patches_of"]
import numpy as np
from impostor_jax.find.walls import POINTS, WIDE, Patches

GOLDEN = (np.sqrt(5) - 1) / 2


def spread(count, most):
    """Evenly spread places among `count`, `most` of them, some several times."""
    return (np.sort(np.arange(most) * GOLDEN % 1) * count).astype(int)


def patches_of(view, normals, objects, fewest, levels=(1, 4, 9, 16)):
    """Patches of each object: list of (object, index arrays)."""
    made, owner = [], []
    h, w = view.depth.shape
    for number, pixels in objects:
        count = len(pixels)
        row, col = np.divmod(pixels, w)
        wide = pixels[spread(count, WIDE)]
        for level in levels:
            if level > 1 and count < level * fewest / 2:
                break
            if level == 1:
                made.append((pixels[spread(count, POINTS)], wide)); owner.append(number)
                continue
            # Seeds: the middle of blocks along the pixels' principal directions.
            seeds = _seeds(row, col, level)
            for s in seeds:
                d = (row - row[s]) ** 2 + (col - col[s]) ** 2
                k = min(count - 1, max(int(1.2 * count / level), fewest // 3))
                near = np.flatnonzero(d <= np.partition(d, k)[k])
                made.append((pixels[near[spread(len(near), POINTS)]], wide)); owner.append(number)
    return made, np.array(owner, int)


def _seeds(row, col, level):
    """Farthest-point seeds."""
    index = spread(len(row), min(len(row), 512))
    r, c = row[index].astype(float), col[index].astype(float)
    first = np.argmin((r - r.mean()) ** 2 + (c - c.mean()) ** 2)
    chosen = [first]
    d = (r - r[first]) ** 2 + (c - c[first]) ** 2
    for _ in range(level - 1):
        k = int(np.argmax(d)); chosen.append(k)
        d = np.minimum(d, (r - r[k]) ** 2 + (c - c[k]) ** 2)
    # Lloyd, twice.
    centers = np.stack([r[chosen], c[chosen]], 1)
    for _ in range(3):
        near = np.argmin((r[:, None] - centers[:, 0]) ** 2 + (c[:, None] - centers[:, 1]) ** 2, axis=1)
        for k in range(level):
            some = near == k
            if some.any():
                centers[k] = r[some].mean(), c[some].mean()
    best = np.argmin((r[:, None] - centers[:, 0]) ** 2 + (c[:, None] - centers[:, 1]) ** 2, axis=0)
    return index[best]


def gathered(view, normals, noise, made):
    own = np.array([m[0] for m in made]); wide = np.array([m[1] for m in made])
    flat = lambda x: x.reshape(-1, *x.shape[2:])
    pts = flat(view.points()); vws = flat(view.views())
    sg = (view.sigma * noise).ravel(); wd = view.width(view.depth).ravel().astype(np.float32)
    return Patches(pts[own], vws[own], sg[own], wd[own], flat(normals.normal)[own].astype(np.float32), normals.error.ravel()[own],
                   pts[wide], vws[wide], sg[wide], wd[wide])
