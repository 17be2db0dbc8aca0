"""What of a region is of one surface: a mask may be too large.

A mask that was drawn by hand or comes from color goes on past the object. Its outermost
readings are of what lies beside that, and a table that touches a can pulls at the wall
without being an outlier. Where readings beside the border of a region disagree with the
others, only its core is fitted. The body that the core shows then tells which of the
other pixels are its own, and these are fitted once more.
"""

__all__ = ["FAILED", "MANY", "fit_of_one_surface", "without_others"]

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.fit.averaged import without_averaged
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.camera_poses import at_poses
from impostor_jax.fit.learned import SPEAKS
from impostor_jax.fit.regions import SQUARE
from impostor_jax.fit.result import AGREEING, DISAGREEING, Fit
from impostor_jax.fit.seam import departs_beyond
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.starts import leaves_no_doubt
from impostor_jax.fit.status import FitStatus
from impostor_jax.fit.touching import OFF, going_on, sigmas_off, with_unsure
from impostor_jax.opencv import cv2
from impostor_jax.primitives.cylinder import Cylinder

NARROWER = (2, 4, 6)
"""Pixels by which a region is made narrower, one after the other, until the readings
beside its border agree with the others."""

FAILED = (FitStatus.POOR_FIT, FitStatus.STEP_LIMIT)
"""Statuses of a fit to a region that may show more than one surface."""

MANY = 5000
"""Readings of a region from which on it takes longer to tell which of them are of the
body than to search the region: of a bottle, 54 s of 43,000 for .4."""

FEWEST_READINGS = 100
"""Readings that a core has at least."""

FAR = 50.0
"""Standard deviations from which one is of a surface that does not touch the body's
there."""

MOST_LEFT = 0.5
"""Readings of a region that may lie off the body and not far from it, over those on it:
of a can of 50 pixels whose mask is 4 pixels too large, 0.4, were all around it near."""

MOST_NEAR = 0.05
"""Those that may where the others do not scatter as their noise says."""

MOST_DOUBTFUL, SCATTERED = 0.15, 1.2
"""Part of the readings on a body that may be left out, because they lie beside readings
that are off it, where their median distance from it is as many standard deviations. Of
normal noise that is 0.7; of a cone and an egg that passed for a tube and a ball, 1.5 to
2.1."""

LEAST_P_VALUE = 1e-6
"""Of their scatter; NaN where the noise is not known, which refutes nothing."""

EDGE = 1
"""Pixels beside a border whose readings may be of two surfaces."""

MARGIN = 3
"""Pixels beside a surface that does, whose readings may be of that and look like the
body's."""

Fitted = Callable[..., Fit]
"""Fit of an object's pixels, with errors that are correlated or not, and given a fit of
the same and perhaps more pixels, or what it starts from."""


def fit_of_one_surface(
    fitted: Fitted,
    kind: type[AbstractBody],
    seen: Sequence[Seen],
    correlated: bool,
    is_exact: bool = False,
    is_trial: bool = False,
) -> Fit:
    """Fit to a region, or to what of it is of one surface.

    Args:
        fitted: How to fit what is seen of an object.
        kind: The body that is fitted.
        seen: The object in each of its images; its pixels, or more.
        correlated: Whether errors are taken for correlated. They are in any case where
            border and rest disagree and no mask is to blame: so they do by a sensor's
            bias, and independent errors do not.
        is_exact: Whether no pixel of the region is of what the object touches.
        is_trial: Whether a fit to many readings that fails is returned as it is.
    """
    whole = fitted(seen, correlated, None)
    if is_trial and whole.status in FAILED and _num_readings(seen) > MANY:
        return whole
    if whole.status.has_numbers:
        seen = at_poses(seen, whole)
        body = going_on(kind.of(whole.shape), whole.ends_seen)
        told = without_others(seen, body, _wider(whole), is_exact)
        if any(one.unsure is not None for one in told):
            # From the whole if that is near, for which no other program is compiled.
            is_near = leaves_no_doubt(whole) and whole.border_chi2 < DISAGREEING
            begin = (None, whole.shape) if is_near else (whole,)
            fit = fitted(told, correlated, *begin)
            if fit.status.has_numbers:
                whole, seen = fit, told
    return _of_one_surface(fitted, kind, seen, correlated, whole)


def without_others(
    seen: Sequence[Seen],
    body: AbstractBody,
    wider: float,
    is_exact: bool,
) -> list[Seen]:
    """An object without what it touches, and without what its images average.

    Args:
        seen: The object in each of its images.
        body: About what it is, in the world frame.
        wider: Factor on the deviations of the readings.
        is_exact: Whether no pixel of the region is of what the object touches.
    """
    told = seen if is_exact else [with_unsure(one, body, wider) for one in seen]
    return [without_averaged(one, body, wider, is_exact) for one in told]


def _of_one_surface(
    fitted: Fitted,
    kind: type[AbstractBody],
    seen: Sequence[Seen],
    correlated: bool,
    whole: Fit,
) -> Fit:
    """The same, of which the `whole` region is fitted."""
    # As Python's number: JAX takes 0.2 ms to compare its own.
    contradiction = whole.border_chi2.item()
    # Without a guess, or without numbers, nothing disagrees.
    if not contradiction >= DISAGREEING:
        return whole
    if not correlated and np.isfinite(contradiction):
        # No more of the border's readings lie elsewhere than of the others.
        whole = fitted(seen, True, whole)
        return _of_one_surface(fitted, kind, seen, True, whole)
    core, narrow = whole, seen
    for width in NARROWER:
        # Without the pixels beside its border, but for the image's.
        narrow = [one._replace(region=_narrower(one.region, width)) for one in seen]
        if _num_readings(narrow) < FEWEST_READINGS:
            break
        core = fitted(narrow, correlated, whole)
        if core.border_chi2 < AGREEING:
            break
    if not core.border_chi2 < AGREEING:
        if correlated:
            return _refuted(core)
        whole = fitted(seen, True, whole)
        return _of_one_surface(fitted, kind, seen, True, whole)
    if not bool(core.success):
        return _refuted(whole)
    body = kind.of(core.shape)
    away = [np.abs(sigmas_off(one, body)) / _wider(core) for one in seen]
    best, kept = core, narrow
    own = [
        one._replace(region=_own_pixels(far, one.region))
        for one, far in zip(seen, away, strict=True)
    ]
    if _num_readings(own) >= FEWEST_READINGS:
        larger = fitted(own, correlated, core)
        if bool(larger.success) and larger.border_chi2 < AGREEING:
            best, kept = larger, own
    # Beside a mask's object are its surroundings. Of another shape a part looks like
    # this one, but not to the noise, and leaves the rest.
    near = on_body = 0
    rest = []
    for one, far, own in zip(seen, away, kept, strict=True):
        on = one.region & (one.image > 0) & (far <= OFF)
        near += np.count_nonzero(one.region & (far > OFF) & (far < FAR))
        on_body += int(np.count_nonzero(on))
        rest.append(far[on & ~own.region])
    share = near / max(on_body, 1)
    is_part = share > MOST_NEAR and best.p_value < LEAST_P_VALUE
    is_part |= share > MOST_LEFT
    if not is_part and _errs_alone(best, seen):
        is_part = _scatters(np.concatenate(rest), on_body) or _departs(best, seen, kept)
    return _refuted(best) if is_part else best


def _wider(fit: Fit) -> float:
    """Factor on deviations of readings that scatter more than their noise says."""
    return max(float(fit.chi2), 1.0) ** 0.5


def _errs_alone(fit: Fit, seen: Sequence[Seen]) -> bool:
    """Whether what a sensor says of its readings is all that moves them.

    One whose readings share smooth errors bends a wall where it has none, and so do
    rays that err, of which is to be learned yet.
    """
    biases = [one.noise.bias for one in seen]
    is_smooth = any(bias.fields or bias.lean is not None for bias in biases)
    return not is_smooth and fit.across.score.item() <= SPEAKS


def _departs(fit: Fit, seen: Sequence[Seen], kept: Sequence[Seen]) -> bool:
    """Whether a wall seems to be a cylinder's for what was left out of its readings."""
    if not isinstance(fit.shape, Cylinder) or bool(fit.form.departs):
        return False
    # Readings that mix two surfaces, beside the border, bend a wall as well.
    inner = [one._replace(region=_narrower(one.region, EDGE)) for one in seen]
    return departs_beyond(fit.shape, inner, [one.region for one in kept])


def _scatters(off: Float[np.ndarray, " n"], on_body: int) -> bool:
    """Whether readings of the body that were left out are beside it by more than noise.

    They are of another shape's, of which the part that is left looks like this one.

    Args:
        off: By how many standard deviations.
        on_body: How many readings lie on the body, with these.
    """
    return len(off) > MOST_DOUBTFUL * on_body and bool(np.median(off) > SCATTERED)


def _num_readings(seen: Sequence[Seen]) -> int:
    return sum(one.num_readings for one in seen)


def _narrower(region: Bool[np.ndarray, "h w"], width: int) -> Bool[np.ndarray, "h w"]:
    return cv2.erode(region.astype(np.uint8), SQUARE, iterations=width) > 0


def _refuted(fit: Fit) -> Fit:
    """A fit as a failure; the status of one stays."""
    return fit.failed(FitStatus.POOR_FIT) if bool(fit.success) else fit


def _own_pixels(
    away: Float[np.ndarray, "h w"], region: Bool[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """Pixels of a region that are a body's own beyond doubt.

    Only what is connected with the region's border by readings off the body is not its
    own: an outlier within is no border.
    """
    off = away > OFF
    # A margin outside, which all that lies beside the image is connected by.
    other = np.pad(off | ~region, 1, constant_values=True).astype(np.uint8)
    _, labels = cv2.connectedComponents(other, connectivity=8)
    beside = (labels == labels[0, 0])[1:-1, 1:-1]
    touching = (beside & off & (away < FAR)).astype(np.uint8)
    doubtful = cv2.dilate(touching, SQUARE, iterations=MARGIN) > 0
    return region & ~beside & ~doubtful
