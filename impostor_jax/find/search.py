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
from impostor_jax.find.evidence import examine, Candidate, deformation, shown
import impostor_jax as ij
from impostor_jax.find.judge import WEIGHTS, confidence, features

CLOCK = {}
TRACE = []
SURE = 0.1
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


def guesses(view, depth, camera, sensor, labels, objs, radius_range, known):
    from impostor_jax.fit.fittable import CYLINDER
    from impostor_jax.fit.regions import typical_sigma
    if view.stride > 1 or not view.is_central:
        return []
    found = []
    for number, pixels in objs:
        region = labels == number
        for body in CYLINDER.guesses(depth, region, camera, typical_sigma(depth, region, sensor))[:6]:
            r = float(body.radius)
            if not radius_range[0] < r < radius_range[1]:
                continue
            center, axis = np.asarray(body.center, float), np.asarray(body.axis, float)
            near = np.linalg.norm(center - (center @ axis) * axis) < r
            cand = Candidate(center, axis, r, -1.0 if near else 1.0)
            if not any(alike(cand, other) for other in [*known, *found]):
                found.append(cand)
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
    TRACE.clear()
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
        with clock("guess"):
            cands += guesses(view, depth, camera, sensor, labels, objs, radius_range, cands)
        def look(c):
            pool = np.flatnonzero(free)
            if not len(pool):
                return None
            pool = pool[spread(len(pool), 8192)]
            return examine(view, normals, noise, c, free, usable, planes.labels, pool)
        TRACE.extend(("proposed", turn, c) for c in cands)
        with clock("examine"):
            seen = [look(c) for c in cands]
        seen = [e for e in seen if e is not None and e.explained + e.cap >= min_pixels / 2 and e.gain > 0]
        TRACE.extend(("seen", turn, e.wall) for e in seen)
        got = False
        while seen:
            k = int(np.argmax([e.gain for e in seen]))
            e = seen.pop(k)
            with clock("deform"):
                if refuted(e, deformation(view, noise, e.wall, e.ends, e.region)):
                    TRACE.append(("refuted", turn, e.wall))
                    continue
            with clock("fit"):
                fit = refit(view, depth, camera, sensor, e, noise, free | (view.valid & ~usable))
            ok = bool(fit.success)
            final = None
            if ok:
                wall = wall_of(fit, camera, e.wall.side)
                with clock("examine"):
                    final = look(wall)
                if final is not None and (final.explained + final.cap < min_pixels / 2):
                    final = None
            TRACE.append(("fit " + str(fit.status) + ("" if final is None else f" gain {final.gain:.0f} of {e.gain:.0f}"), turn, e.wall))
            p = 0.0
            if final is not None:
                d = deformation(view, noise, final.wall, final.ends, final.region)
                p = confidence(features(final, d, fit)) if WEIGHTS is not None else 1.0
                TRACE.append((f"judged {p:.2f}", turn, final.wall))
            if p >= SURE and not any(alike(final.wall, other[1].wall) for other in found):
                found.append((fit, final, d))
                region = final.region
                grown = cv2.dilate(region.view(np.uint8), np.ones((3, 3), np.uint8)) > 0
                free = free & ~grown
                got = True
                with clock("examine"):
                    again = [x if not (x.region & region).any() else look(x.wall) for x in seen]
                seen = [x for x in again if x is not None and x.explained + x.cap >= min_pixels / 2 and x.gain > 0]
            else:
                # Nothing that begins like this leads anywhere.
                seen = [x for x in seen if not alike(x.wall, e.wall)]
        if not got:
            break
    return view, normals, planes, found


def refuted(e, d):
    if e.chi > 3 or e.fill < 0.6 or max(e.arc, e.rim) < 30:
        return True
    if d is None:
        return e.rim < 90
    sol, dev, _ = d
    return bool(np.any(np.abs(sol[5:]) - 3 * dev[5:] > 0.3))


def wall_of(fit, camera, side):
    c = fit.cylinder
    move = camera.camera_from_world
    center, axis = np.asarray(c.center, float), np.asarray(c.axis, float)
    if move is not None:
        center, axis = np.asarray(move.apply(center)), np.asarray(move.rotate(axis))
    return Candidate(center, axis, float(c.radius), side)


def refit(view, depth, camera, sensor, e, noise, free):
    c, a, r, side = e.wall
    lo, hi = e.ends
    center = c + (lo + hi) / 2 * a
    initial = ij.Cylinder(center=center, axis=a, radius=r, height=max(hi - lo, 1e-4) * 1.02)
    reach = sensor.edge_reach
    mask = shown(view, noise, e.wall, e.ends, free, e.caps, not isinstance(reach, int) or reach > 0)
    return ij.fit_cylinder(depth, camera, mask, sensor, initial)
