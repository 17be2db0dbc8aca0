"""What an image says for and against a cylinder: its wall rendered, and compared."""

__all__ = ["Candidate", "Evidence", "examine", "deformation"]

from typing import NamedTuple

import cv2
import numpy as np

LIMIT = 3.5
MOST = 40_000
ANGLES = np.radians(np.arange(0, 90, 10)).astype(np.float32)


class Candidate(NamedTuple):
    center: np.ndarray
    axis: np.ndarray
    radius: float
    side: float


class Evidence(NamedTuple):
    wall: Candidate
    ends: tuple[float, float]
    region: np.ndarray      # (h, w) bool pixels of wall and caps
    caps: np.ndarray
    explained: float
    behind: float
    front: float
    unread: float
    arc: float
    cap: float
    gain: float
    fill: float
    off: float
    chi: float
    size: float
    rim: float


def deviations(view, noise, depth, sigma, cos):
    c = np.clip(np.abs(cos), 0.05, 1)
    factor = np.interp(np.arccos(c), ANGLES, view.grazing)
    tan2 = (1 - c * c) / (c * c)
    return np.sqrt((noise * sigma * factor) ** 2 + (view.width(depth) / 3) ** 2 * tan2)


def examine(view, normals, noise, wall, free, usable, planes, pool):
    """None where nothing is left.

    free: bool, pixels that may be its own; usable: readings that say something; pool: flat indices thinned of free.
    """
    c, a, r, side = wall
    # Ends of what may be seen of it.
    P = view.points(np.unravel_index(pool, free.shape))
    off = P - c
    t = off @ a
    across = off - t[:, None] * a
    rho = np.linalg.norm(across, axis=1)
    V = view.views(np.unravel_index(pool, free.shape))
    cos = -(across * V).sum(1) / np.maximum(rho, 1e-9)
    sg = view.sigma.ravel()[pool]
    s = deviations(view, noise, P[:, 2], sg, cos) * np.clip(np.abs(cos), .05, 1)
    near = (np.abs(rho - r) < LIMIT * s) & (side * cos > 0)
    if near.sum() < 5:
        return None
    low, high = t[near].min() - r, t[near].max() + r
    box = _box(view, c, a, r, low, high)
    if box is None:
        return None
    count = (box[0].stop - box[0].start) * (box[1].stop - box[1].start)
    step = max(1, int(np.ceil(np.sqrt(count / MOST))))
    pick = (slice(box[0].start, box[0].stop, step), slice(box[1].start, box[1].stop, step))
    z = view.depth[pick]
    hit, depth, along, cos, inside = _meet(view, pick, wall)
    hit &= (along > low) & (along < high)
    seen = usable[pick]
    own = free[pick]
    s = deviations(view, noise, np.where(hit, depth, 1), np.where(seen, view.sigma[pick], 0), cos)
    e = np.where(seen & hit, (z - depth) / np.maximum(s, 1e-9), 0)
    core = hit & (inside > 0.7)
    # Normals that disagree are of another surface.
    n = normals.normal[pick]
    agree = normals.error[pick] > 0.25
    u = _radial(view, pick, wall, depth, along)
    agree |= side * (n * u).sum(-1) > 0.6
    is_near = hit & seen & (np.abs(e) < LIMIT)
    explained = is_near & own & agree
    behind = core & seen & (e > LIMIT)
    front = core & seen & (e < -LIMIT)
    unread = core & ~seen
    other = core & is_near & ~explained
    # Along the axis.
    w0 = view.width(float(np.median(depth[hit]))) * step if hit.any() else 1
    nb = int(np.clip((high - low) / (2 * w0), 8, 128))
    place = np.clip(((along - low) / (high - low) * nb), 0, nb - 1).astype(int)

    def counts(mask):
        return np.bincount(place[mask], minlength=nb).astype(float)

    E, B, T = counts(explained & core), counts(behind), counts(core)
    O = counts(other)
    if E.sum() < 4:
        return None
    smooth = np.convolve(E, np.ones(5), "same")
    top = int(np.argmax(smooth))
    typical = np.median(E[E >= 0.25 * E.max()])
    supports = (E >= 0.25 * typical) & (E > B + O)
    # A bin or two tell little.
    E, B, T, O = (np.convolve(x, np.ones(3), "same") for x in (E, B, T, O))
    refutes = (B + O > E) & (B + O >= 0.25 * T) & (T > 0)
    first = last = top
    for k in range(top, -1, -1):
        if supports[k]:
            first = k
        elif refutes[k]:
            break
    for k in range(top, nb):
        if supports[k]:
            last = k
        elif refutes[k]:
            break
    width = (high - low) / nb
    lo, hi = low + first * width, low + (last + 1) * width
    within = explained & (along >= lo) & (along <= hi)
    if within.sum() < 4:
        return None
    lo2, hi2 = np.quantile(along[within], [0.005, 0.995])
    lo, hi = max(lo, lo2 - w0), min(hi, hi2 + w0)
    part = (along >= lo) & (along <= hi)
    explained &= part
    num = lambda mask: float(np.count_nonzero(mask & part)) * step * step
    # Arc: bins of the angle about the axis.
    b1, b2 = _basis(a)
    phi = np.arctan2(u @ b2, u @ b1)
    bins = ((phi[explained & core] + np.pi) / (2 * np.pi) * 72).astype(int) % 72
    expected = np.bincount((((phi[core & part] + np.pi) / (2 * np.pi) * 72).astype(int)) % 72, minlength=72)
    got = np.bincount(bins, minlength=72)
    arc = 5.0 * np.count_nonzero((got >= 2) & (got >= 0.3 * expected))
    # Caps.
    region = np.zeros(view.depth.shape, bool)
    region[pick] = explained
    if step > 1:
        region = _refined(view, noise, wall, (lo, hi), free, usable, normals, box)
    cap, rim = 0, 0.0
    caps = np.zeros(view.depth.shape, bool)
    if side > 0:
        for end, sign in ((lo, -1), (hi, 1)):
            q, count, turn = _cap(view, noise, wall, end, sign, usable, normals, free | (planes > 0))
            if count and turn >= 60:
                caps |= q
                cap += count
                rim = max(rim, turn)
    chi = float(np.mean(np.minimum(e[explained & core] ** 2, LIMIT**2))) if (explained & core).any() else 9.0
    ex, be, fr, un, ot = num(explained), num(behind), num(front), num(unread), num(other)
    return Evidence(wall, (lo, hi), region | caps, caps, ex, be, fr, un, arc, float(cap), ex + cap - 2 * be - ot, ex / max(ex + be + ot, 1), ot, chi, float(np.count_nonzero(core & part)) * step**2, rim)


def _meet(view, pick, wall):
    c, a, r, side = wall
    x, y = view.x[pick], view.y[pick]
    if view.is_central:
        da = a[0] * x + a[1] * y + a[2]
        dx, dy, dz = x - da * a[0], y - da * a[1], 1 - da * a[2]
        w = c - (c @ a) * a
        wx, wy, wz = w
        start = 0.0
        begin = -(c @ a)
    else:
        da = a[2] + 0 * x
        dx, dy, dz = -da * a[0], -da * a[1], 1 - da * a[2]
        ox, oy, oz = c[0] - x, c[1] - y, c[2]
        oa = ox * a[0] + oy * a[1] + oz * a[2]
        wx, wy, wz = ox - oa * a[0], oy - oa * a[1], oz - oa * a[2]
        begin = -oa
    A = dx * dx + dy * dy + dz * dz
    bq = dx * wx + dy * wy + dz * wz
    cx, cy, cz = dy * wz - dz * wy, dz * wx - dx * wz, dx * wy - dy * wx
    disc = A * r * r - (cx * cx + cy * cy + cz * cz)
    hit = (disc > 0) & (A > 1e-8)
    root = np.sqrt(np.where(hit, disc, 0))
    A = np.where(A > 1e-8, A, 1)
    depth = (bq - side * root) / A
    hit &= depth > 0
    along = begin + depth * da
    cos = root / r / _length(view, x, y)
    # How far inside of the outline, in pixels.
    chord = np.minimum(root / np.sqrt(A) / r, 1)
    inside = r * (1 - np.sqrt(1 - chord * chord)) / view.width(np.where(hit, depth, 1))
    return hit, depth, along, cos, inside


def _length(view, x, y):
    return np.sqrt(1 + x * x + y * y) if view.is_central else np.ones_like(x)


def _radial(view, pick, wall, depth, along):
    c, a, r, _ = wall
    x, y = view.x[pick], view.y[pick]
    px, py = (x * depth, y * depth) if view.is_central else (x, y)
    u = np.stack([px - c[0] - along * a[0], py - c[1] - along * a[1], depth - c[2] - along * a[2]], -1)
    return (u / r).astype(np.float32)


def _basis(a):
    k = np.eye(3)[np.argmin(np.abs(a))]
    b = np.cross(a, k)
    b /= np.linalg.norm(b)
    return b, np.cross(a, b)


def _box(view, c, a, r, low, high):
    b1, b2 = _basis(a)
    ang = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    ring = r * 1.05 * (np.cos(ang)[:, None] * b1 + np.sin(ang)[:, None] * b2)
    ts = np.linspace(low, high, 8)
    pts = (c + ts[:, None] * a)[:, None] + ring
    pts = pts.reshape(-1, 3)
    if view.is_central:
        front = pts[:, 2] > 0.02
        if not front.any():
            return None
        if not front.all():
            return np.s_[0 : view.depth.shape[0]], np.s_[0 : view.depth.shape[1]]
        xy = pts[:, :2] / pts[:, 2:]
    else:
        xy = pts[:, :2]
    x0, y0 = xy.min(0)
    x1, y1 = xy.max(0)
    inside = (view.x >= x0) & (view.x <= x1) & (view.y >= y0) & (view.y <= y1)
    rows, cols = np.flatnonzero(inside.any(1)), np.flatnonzero(inside.any(0))
    if not len(rows):
        return None
    return np.s_[rows[0] : rows[-1] + 1], np.s_[cols[0] : cols[-1] + 1]


def _refined(view, noise, wall, ends, free, usable, normals, box):
    z = view.depth[box]
    hit, depth, along, cos, _ = _meet(view, box, wall)
    hit &= (along >= ends[0]) & (along <= ends[1])
    s = deviations(view, noise, np.where(hit, depth, 1), view.sigma[box], cos)
    ok = hit & usable[box] & free[box] & (np.abs(z - depth) < LIMIT * s)
    u = _radial(view, box, wall, depth, along)
    ok &= (normals.error[box] > 0.25) | (wall.side * (normals.normal[box] * u).sum(-1) > 0.6)
    region = np.zeros(view.depth.shape, bool)
    region[box] = ok
    return region


def _cap(view, noise, wall, end, sign, usable, normals, free):
    """Pixels of a cap, how many, and the angle along which its rim is seen, in degrees."""
    c, a, r, _ = wall
    middle = c + end * a
    towards = -middle / np.linalg.norm(middle) if view.is_central else np.array([0, 0, -1.0])
    facing = sign * (a @ towards)
    if facing < 0.05 or middle[2] <= 0:
        return None, 0, 0.0
    w = view.width(middle[2])
    box = _box(view, c, a, 1.4 * r, end - w, end + w)
    if box is None:
        return None, 0, 0.0
    P = view.points(box)
    off = P - middle
    t = off @ a
    s = deviations(view, noise, P[..., 2], view.sigma[box], np.full(P.shape[:2], facing)) * facing
    rho = np.sqrt(np.maximum((off**2).sum(-1) - t * t, 0))
    flat = usable[box] & (np.abs(t) < LIMIT * s + w)
    flat &= (normals.error[box] > 0.25) | (sign * (normals.normal[box] @ a) > 0.7)
    ok = flat & free[box] & (rho < r)
    count = int(ok.sum())
    expected = np.pi * r * r * facing / w**2
    if count < 0.2 * expected or count < 5:
        return None, 0, 0.0
    # Where rays meet the cap's plane, whatever they read.
    x, y = view.x[box], view.y[box]
    if view.is_central:
        d = (middle @ a) / (x * a[0] + y * a[1] + a[2])
        q = np.stack([x * d, y * d, d], -1) - middle
    else:
        d = (middle[2] * a[2] - (x - middle[0]) * a[0] - (y - middle[1]) * a[1]) / a[2]
        q = np.stack([x, y, d], -1) - middle
    far = np.sqrt((q**2).sum(-1)) / r
    b1, b2 = _basis(a)
    turn = ((np.arctan2(q @ b2, q @ b1) + np.pi) / (2 * np.pi) * 36).astype(int) % 36
    step = max(0.05, 1.0 * w / r / facing**0.5)

    def binned(mask):
        return np.bincount(turn[mask], minlength=36)

    inner, outer = (far < 1 - step) & (far > 0.5), (far > 1 + step) & (far < 1.35 + step)
    on_inner, on_outer = binned(inner & flat), binned(outer & flat)
    all_inner, all_outer = binned(inner & usable[box]), binned(outer & usable[box])
    rim = (on_inner >= 0.6 * all_inner) & (on_outer <= 0.3 * all_outer) & (all_inner > 0)
    region = np.zeros(view.depth.shape, bool)
    region[box] = ok
    return region, count, 10.0 * np.count_nonzero(rim)


def shown(view, noise, wall, ends, free, caps, mixed):
    """Pixels that show a cylinder: inside of its outline, and nothing in front.

    Args:
        free: Readings that may be its own.
        caps: Pixels of its caps.
        mixed: Whether readings beside the outline may be of what is behind it; a fit
            knows, and leaves them out.
    """
    c, a, r, side = wall
    low, high = ends
    box = _box(view, c, a, r, low, high)
    region = caps.copy()
    if box is None:
        return region
    z = view.depth[box]
    hit, depth, along, cos, inside = _meet(view, box, wall)
    hit &= (along > low) & (along < high)
    ray = deviations(view, noise, np.where(hit, depth, 1), view.sigma[box], cos)
    e = (z - depth) / np.maximum(ray, 1e-9)
    ok = hit & free[box] & (np.abs(e) < 4)
    if mixed:
        ok |= hit & (((z > depth) & (inside < 1.5)) | (z == 0))
    region[box] |= ok
    return region


NAMES = ("taper", "barrel", "ellipse", "ellipse2", "bend1", "bend2", "cubic1", "cubic2")


def deformation(view, noise, wall, ends, region):
    """Departures from a cylinder over the radius, and their standard deviations."""
    c, a, r, side = wall
    index = np.flatnonzero(region)
    index = index[:: max(1, len(index) // 3000)]
    P = view.points(np.unravel_index(index, region.shape)).astype(float)
    V = view.views(np.unravel_index(index, region.shape)).astype(float)
    off = P - c
    t = off @ a
    across = off - t[:, None] * a
    rho = np.linalg.norm(across, axis=1)
    u = across / np.maximum(rho, 1e-9)[:, None]
    cos = -(u * V).sum(1)
    half = max((ends[1] - ends[0]) / 2, 1e-9)
    on_wall = (np.abs(rho - r) < 0.3 * r) & (side * cos > 0.1) & (t > ends[0]) & (t < ends[1])
    if on_wall.sum() < 20:
        return None
    t, u, rho, cos = t[on_wall], u[on_wall], rho[on_wall], cos[on_wall]
    s = deviations(view, noise, P[on_wall, 2], view.sigma.ravel()[index[on_wall]], cos) * np.abs(cos)
    x = (t - (ends[0] + ends[1]) / 2) / half
    b1, b2 = _basis(a)
    f1, f2 = u @ b1, u @ b2
    base = np.stack([np.ones_like(x), f1, f2, x * f1, x * f2,
                     x, x * x, f1 * f1 - f2 * f2, 2 * f1 * f2, x * x * f1, x * x * f2], 1)
    e = (rho - r) / r
    sr = s / r
    w = 1 / sr
    for _ in range(3):
        A = base * w[:, None]
        N = A.T @ A
        N += np.diag(1e-9 * np.trace(N) * np.ones(11))
        # A prior so wide that it says nothing.
        N += np.eye(11) / 1.0**2
        cov = np.linalg.inv(N)
        sol = cov @ (A.T @ (e * w))
        rest = (e - base @ sol) / sr
        w = 1 / sr / (1 + (rest / 3) ** 2)
    chi = float(np.median(np.abs(rest)) * 1.4826)
    dev = np.sqrt(np.diag(cov)) * max(chi, 1)
    return sol, dev, chi
