"""Poses of several cameras that err: what they are off by is unknown, as a body is.

A camera on a robot's hand, or on a rig, stands where its pose says to a part of a
millimeter, and views that are taken for exact then know a place to a tenth of that:
errors of 0.05 mm and 0.007 degrees moved one center in five by more than four standard
deviations, with nothing in the readings that said so. So each pose has six coordinates
more in a fit, a turn and a shift of its camera, which are known to what a caller says,
and what the views tell of the body they tell at the poses that fit best.
"""

__all__ = [
    "as_they_disagree",
    "at_poses",
    "in_cameras",
    "told_of_poses",
    "with_usual_poses",
]

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from impostor_jax.camera.base import posed
from impostor_jax.camera.spherical import SphericalCamera
from impostor_jax.fit.pose import in_double
from impostor_jax.fit.problem import PoseBelief
from impostor_jax.fit.result import Fit, PoseErrors
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.status import FitStatus
from impostor_jax.geometry.frames import moved_by

USUAL = 2e-4
"""What poses err by of which nobody tells, in radians, and in distances to the object:
a good calibration. They err by more where the views say so."""

MOST = 2.5e-3
"""The same up to which they may, in so far: what disagrees by more is a pose that is
wrong, or a sensor that shows walls elsewhere than they are."""

LARGER = 3.0
"""Factor on it that is tried where views contradict each other."""

SAME = 1.2
"""That from which a fit is repeated."""

MOST_TRIALS = 5
"""Times that it is: while views pull, what poses are off by is drawn to none."""

NOTED = 2.0
"""Times that poses err more than a caller says, from which a reader is told."""

FEW, LEAST_TOLD = 3.0, 0.1
"""Part of n that is divided by at least, and that itself: of a few it is none."""


def with_usual_poses(seen: Sequence[Seen]) -> list[Seen]:
    """An object in several images, of cameras whose poses err as usual ones do."""
    told = []
    for one in seen:
        read = one.image[one.region & (one.image > 0)]
        distance = float(np.median(read)) if len(read) else 0.0
        sigma = USUAL * np.repeat([1, distance], 3).astype(one.image.dtype)
        told.append(one._replace(pose=PoseBelief(sigma, np.zeros_like(sigma))))
    return told


def at_poses(seen: Sequence[Seen], fit: Fit) -> Sequence[Seen]:
    """An object in several images, of cameras at the poses that a fit found.

    Those are compared with its estimate, and a fit of the same starts with them.
    """
    if fit.pose_errors is None or not fit.status.has_numbers:
        return seen
    moved = []
    for one, found in zip(seen, np.asarray(fit.pose_errors.value), strict=True):
        sigma, known = _belief_of(one)
        off = found / np.where(sigma > 0, sigma, 1)
        camera, pose = one.camera, one.camera.camera_from_world
        more = moved_by(jnp.asarray(sigma * (off - known)))
        camera = posed(camera, more if pose is None else more @ pose)
        moved.append(one._replace(camera=camera, pose=PoseBelief(sigma, off)))
    return moved


def as_they_disagree(
    fit: Fit,
    seen: Sequence[Seen],
    fitted: Callable[[Sequence[Seen]], Fit],
) -> tuple[Fit, Sequence[Seen]]:
    """The fit with poses that err by as much as the views disagree, and what is seen.

    Args:
        fit: With poses that err as usual.
        seen: What it is of.
        fitted: How to fit that.
    """
    told, here = fit, at_poses(seen, fit)
    for _ in range(MOST_TRIALS):
        level = float(_belief_of(here[0]).sigma[0]) / USUAL
        if told.is_shape:
            times = max(times_off(told, here), 1 / level)
        elif told.status is FitStatus.POOR_FIT:
            times = LARGER
        else:
            break
        times = min(times, MOST / USUAL / level)
        if 1 / SAME < times < SAME:
            break
        wider = [one._replace(pose=_belief_of(one).grown(times)) for one in here]
        told = fitted(wider)
        here = at_poses(wider, told)
        # Of what is off by more than that a fit still says that it is.
        if told.is_shape and times_off(told, here, 0.0) < NOTED:
            fit, seen = told, wider
    return fit, at_poses(seen, fit)


def times_off(fit: Fit, seen: Sequence[Seen], lost: float = 3.0) -> float:
    """By how much more poses err than is believed, as what they are off by tells.

    The sum of its squares, in deviations, is chi-squared, of as many degrees of freedom
    n as views tell. With any size as likely before, what it then tells of a place has
    Student's distribution of n - 1, whose variance is that sum over n - 3.

    Args:
        fit: Of a shape.
        seen: What it is of, `at_poses` of that.
        lost: By how much less than n it is divided by.
    """
    assert fit.pose_errors is not None
    number = float(fit.pose_errors.freedom)
    squares = sum(float(np.sum(_belief_of(one).known ** 2)) for one in seen)
    return (squares / max(number - lost, number / FEW, LEAST_TOLD)) ** 0.5


def _belief_of(one: Seen) -> PoseBelief:
    assert one.pose is not None
    return one.pose


def told_of_poses(fit: Fit, seen: Sequence[Seen], is_given: bool) -> tuple[str, str]:
    """What a reader is told of poses that err; and of what views disagree by.

    Args:
        fit: Of several views.
        seen: As of `times_off`.
        is_given: Whether the caller says what poses err by.
    """
    if not fit.is_shape or seen[0].pose is None:
        return "", ""
    times = times_off(fit, seen, 0.0)
    if is_given:
        told = f"Views disagree by {times:.1f} times what pose_sigma says"
        return "", told if times > NOTED else ""
    turn, shift = np.max([_belief_of(one).sigma[[0, -1]] for one in seen], axis=0)
    err = f"oses are taken to err by {1e3 * shift:.2g} mm and {np.degrees(turn):.2g} "
    err += "degrees{}; pose_sigma tells how well they are known"
    if turn > SAME * USUAL:
        return "", "Views disagree: p" + err.format(", or depths are off")
    return f"P{err.format('')}.", ""


def in_cameras(
    errors: PoseErrors, cameras: Sequence[Any], seen: Sequence[Seen]
) -> PoseErrors:
    """What poses are off by, in the frames of the cameras as they were given.

    Args:
        errors: In those of what is `seen`.
        cameras: As they were given; one that looks all around was turned to the object.
        seen: By their rays.
    """
    value = np.array(errors.value)
    for k, (camera, one) in enumerate(zip(cameras, seen, strict=True)):
        if isinstance(camera, SphericalCamera):
            back = in_double(camera.camera_from_world)[0]
            back = back @ in_double(one.camera.camera_from_world)[0].T
            value[k] = (value[k].reshape(2, 3) @ back.T).ravel()
    return dataclasses.replace(errors, value=jnp.asarray(value))
