"""The search: propose, examine, take the best, again."""
import time
import numpy as np
import jax
import cv2
from impostor_jax.find.view import view_of
from impostor_jax.find.normals import normals_of, stray
from impostor_jax.find.planes import planes_of
from impostor_jax.find.objects import objects_of
from impostor_jax.find.patches import patches_of, gathered, spread
from impostor_jax.find.walls import propose, BATCH
from impostor_jax.find.evidence import examine, Candidate, deformation
import impostor_jax as ij

CLOCK = {}
class clock:
    def __init__(self, name): self.name = name
    def __enter__(self): self.t = time.perf_counter()
    def __exit__(self, *a): CLOCK[self.name] = CLOCK.get(self.name, 0) + time.perf_counter() - self.t


def proposals(view, normals, noise, objs, fewest, limits, levels, keep):
    made, owner = patches_of(view, normals, objs, fewest, levels)
    if not made:
        return []
    g = gathered(view, normals, noise, made)
    out = []
    for b in range(0, len(made), BATCH):
        part = jax.tree.map(lambda x: np.asarray(np.resize(x[b:b+BATCH], (BATCH, *x.shape[1:])), np.float32), g)
        out.append(jax.tree.map(np.asarray, propose(part, view.grazing, limits)))
    walls, sides, best, wide = jax.tree.map(lambda *x: np.concatenate(x)[:len(made)], *out)
    sizes = {k: len(p) for k, p in objs}
    found = []
    for number, _ in objs:
        rows = np.flatnonzero(owner == number)
        some = [(wide[i, k] * sizes[number], i, k) for i in rows for k in range(best.shape[1])]
        some.sort(key=lambda x: -x[0])
        kept = []
        for score, i, k in some:
            if not np.isfinite(score) or score < fewest / 3:
                break
            cand = Candidate(walls.center[i, k].astype(float), walls.axis[i, k].astype(float), float(np.exp(walls.log_radius[i, k])), float(sides[i, k]))
            if any(alike(cand, other) for other in kept):
                continue
            kept.append(cand)
            if len(kept) == keep:
                break
        found += kept
    return found


def alike(one, other):
    if one.side != other.side or abs(np.log(one.radius / other.radius)) > 0.15:
        return False
    if abs(one.axis @ other.axis) < np.cos(np.radians(8)):
        return False
    # At the nearer of the two middles.
    d = other.center - one.center
    d = d - (d @ one.axis) * one.axis
    return np.linalg.norm(d) < 0.2 * one.radius


def search(depth, camera, sensor, min_pixels=150, min_arc=50., radius_range=(0.003, 1.0)):
    CLOCK.clear()
    with clock("view"):
        view = view_of(depth, camera, sensor)
        usable = view.valid & ~stray(view)
    with clock("normals"):
        normals = normals_of(view, usable)
    with clock("planes"):
        planes = planes_of(view, usable)
    noise = planes.noise
    free = usable & (planes.labels == 0)
    limits = np.log(np.array(radius_range)).astype(np.float32)
    found, dead = [], np.zeros(free.shape, bool)
    for turn in range(3):
        with clock("objects"):
            labels = objects_of(view, free & ~dead, noise, min_pixels // 2)
            flat = labels.ravel()
            order = np.argsort(flat, kind="stable")
            cut = np.searchsorted(flat[order], np.arange(labels.max() + 2))
            objs = [(k, np.sort(order[cut[k]:cut[k+1]])) for k in range(1, labels.max() + 1)]
        if not objs:
            break
        with clock("propose"):
            cands = proposals(view, normals, noise, objs, min_pixels, limits, (1, 4, 9), 5)
        def look(c):
            pool = np.flatnonzero(free)
            if not len(pool):
                return None
            pool = pool[spread(len(pool), 8192)]
            return examine(view, normals, noise, c, free, usable, planes.labels, pool)
        with clock("examine"):
            seen = [look(c) for c in cands]
        seen = [e for e in seen if e is not None and e.explained >= min_pixels / 2 and e.gain > 0]
        got = False
        while seen:
            k = int(np.argmax([e.gain for e in seen]))
            e = seen.pop(k)
            with clock("fit"):
                fit = refit(view, depth, camera, sensor, e)
            ok = bool(fit.success)
            final = None
            if ok:
                wall = wall_of(fit, camera, e.wall.side)
                with clock("examine"):
                    final = look(wall)
                if final is not None and (final.explained < min_pixels / 2):
                    final = None
            if final is not None and final.gain > 0.5 * e.gain:
                found.append((fit, final, deformation(view, noise, final.wall, final.ends, final.region)))
                region = final.region
                grown = cv2.dilate(region.view(np.uint8), np.ones((3, 3), np.uint8)) > 0
                free = free & ~grown
                got = True
                with clock("examine"):
                    again = [x if not (x.region & region).any() else look(x.wall) for x in seen]
                seen = [x for x in again if x is not None and x.explained >= min_pixels / 2 and x.gain > 0]
            else:
                # Nothing that begins like this leads anywhere.
                seen = [x for x in seen if not alike(x.wall, e.wall)]
        if not got:
            break
    return view, normals, planes, found


def wall_of(fit, camera, side):
    c = fit.cylinder
    move = camera.camera_from_world
    center, axis = np.asarray(c.center, float), np.asarray(c.axis, float)
    if move is not None:
        center, axis = np.asarray(move.apply(center)), np.asarray(move.rotate(axis))
    return Candidate(center, axis, float(c.radius), side)


def refit(view, depth, camera, sensor, e):
    c, a, r, side = e.wall
    lo, hi = e.ends
    center = c + (lo + hi) / 2 * a
    initial = ij.Cylinder(center=center, axis=a, radius=r, height=max(hi - lo, 1e-4) * 1.02)
    mask = e.region
    return ij.fit_cylinder(depth, camera, mask, sensor, initial)
