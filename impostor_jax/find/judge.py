"""How sure a found cylinder is."""
__all__ = ["FEATURES", "features", "confidence"]
import numpy as np

FEATURES = ("chi", "fit_chi", "fill", "taper", "barrel", "ellipse", "bend", "vague", "exact", "size", "arc", "hidden", "cap")


def features(e, d, fit):
    r = e.wall.radius
    if d is None:
        excess = np.full(4, 0.5)
        vague = 0.5
    else:
        sol, dev, _ = d
        c, s = np.abs(sol[5:]), dev[5:]
        over = np.maximum(c - 2 * s - 0.03, 0)
        excess = np.array([over[0], max(over[1] - 0.05, 0), max(over[2], over[3]), max(over[4], over[5])])
        vague = float(np.sqrt(np.mean(s[[0, 1, 2, 3]] ** 2)))
    total = e.explained + e.behind + e.off
    exact = np.clip(within(fit, e), 1e-3, 1 - 1e-3)
    return np.array([
        np.log(max(e.chi, 0.7) / 0.7),
        np.log(max(float(fit.chi2), 1.0)),
        np.sqrt((e.behind + e.off) / total),
        *np.sqrt(np.minimum(excess, 1)),
        np.log(vague / 0.02 + 1),
        np.log(exact / (1 - exact)),
        np.log((e.explained + e.cap) / 1000),
        min(max(e.arc, e.rim), 120) / 120,
        e.front / max(e.size, 1),
        min(e.rim, 180) / 180,
    ])


def within(fit, e):
    """Probability that the estimate is within 10 percent, 5 degrees and .15 radii."""
    from math import erf
    r = e.wall.radius
    a = float(np.max(fit.std.axis)); c = float(np.max(fit.std.across_axis))
    p = erf(0.1 * r / max(float(fit.std.radius), 1e-9) / 2**0.5)
    p *= erf(np.radians(5) / max(a, 1e-9) / 2**0.5)
    return p * erf(0.15 * r / max(c, 1e-9) / 2**0.5)


def confidence(x, w=None):
    w = WEIGHTS if w is None else w
    return float(1 / (1 + np.exp(-(w[0] + x @ w[1:]))))


try:
    WEIGHTS = np.load("/work/lab/find/w.npy")
except OSError:
    WEIGHTS = None
