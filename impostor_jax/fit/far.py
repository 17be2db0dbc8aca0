"""Fits to images of cameras that lie far from the origin of the world.

They run in the frame of a `LocalWorld`, in which start, prior and poses are near, and
what they find is told from the origin again: in double precision, of which single one
would round off more than a fit is unsure of.
"""

__all__ = ["fitted_near", "near_prior", "told_in_world"]

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from impostor_jax.arguments import is_concrete, working_precision
from impostor_jax.fit.request import FitRequest
from impostor_jax.fit.result import Fit, each_of
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.local_world import LocalWorld

FARTHEST_TRACED = 1000.0
"""Meters from the origin up to which a fit may be traced, which is told in single
precision: that rounds a place there by 0.03 mm."""


def fitted_near(function: Callable[..., Fit]) -> Callable[..., Fit]:
    """Let a fit run near the origin.

    Raises:
        ValueError: A camera is far off, and something is traced: the fit, told in
            single precision, would be rounded by more than it says.
    """

    @functools.wraps(function)
    def fitted(request: FitRequest, **also: Any) -> Fit:
        camera, start, options = request.camera, request.initial, request.options
        cameras = each_of(camera)
        world = LocalWorld.of(cameras)
        if world is None:
            return function(request, **also)
        is_too_far = np.linalg.norm(world.place) > FARTHEST_TRACED
        if is_too_far and not is_concrete(request.values):
            raise ValueError(
                "camera must be near the origin of the world in a traced fit, got one "
                f"at {world.place.tolist()} m, where single precision rounds the "
                "result: subtract an offset from poses and start, or set "
                "jax_enable_x64"
            )
        known = {"camera": camera, "initial": start, "options": options}
        with working_precision(options.effort.precision, ()):
            local = [world.seen_by(one) for one in cameras]
            if isinstance(start, AbstractPrimitive):
                start = world.near(start)
        prior = near_prior(world, options.prior)
        near = request._replace(
            camera=local if isinstance(camera, list | tuple) else local[0],
            initial=start,
            options=dataclasses.replace(options, prior=prior),
        )
        fit = function(near, **also)
        with working_precision(options.effort.precision, ()):
            return told_in_world(world, fit, known)

    return fitted


def near_prior(world: LocalWorld, prior: Any) -> Any:
    """A prior as a caller gives it, whose place is told in a local world."""
    # What is wrong, the fit says; what is traced, is single already.
    if not isinstance(prior, Mapping) or not is_concrete(prior):
        return prior
    match prior.get("center"):
        case (center, deviation) if np.shape(center) == (3,):
            place = np.asarray(center, np.float64) - world.place
            return {**prior, "center": (place, deviation)}
    return prior


def told_in_world(world: LocalWorld, fit: Fit, known: Mapping[str, Any]) -> Fit:
    """A fit in the world, of one in a local world.

    Args:
        world: The local world.
        fit: As it was found there.
        known: What the caller asked, by name.
    """
    others = fit.alternatives
    others = dataclasses.replace(others, shape=world.told_in_world(others.shape))
    fit = fit.having(shape=world.told_in_world(fit.shape), alternatives=others)
    if fit.asked.arguments is None:
        return fit
    return fit.noting(arguments={**fit.asked.arguments, **known})
