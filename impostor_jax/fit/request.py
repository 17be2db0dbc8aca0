"""Checks of what a fit is asked."""

__all__ = [
    "USUAL_SIGMA",
    "FitRequest",
    "Given",
    "ReadingsError",
    "TooFewReadingsError",
    "check_one_object",
    "check_readings",
    "check_types",
    "checked_depth",
    "checked_mask",
    "checked_noise",
    "checked_pose_sigma",
    "checked_prior",
    "checked_readings",
    "checked_settings",
    "is_trusted",
    "request_of_cylinder",
]

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Integer

from impostor_jax.arguments import (
    check_direction,
    described,
    float_array,
    is_concrete,
    one_of,
    real_number,
    unmasked,
    unread,
)
from impostor_jax.camera.base import AbstractRays, not_accepted
from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.effort import MIN_READINGS
from impostor_jax.fit.fittable import CYLINDER, Fittable
from impostor_jax.fit.options import Options
from impostor_jax.fit.per_pixel import PerPixelNoise, noise_of_pixels, read_with
from impostor_jax.fit.prior import Prior
from impostor_jax.fit.problem import DepthImage, Mask, PoseBelief, Settings
from impostor_jax.fit.result import Fit, each_of
from impostor_jax.numerics import safe_normalize
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.solid import Solid
from impostor_jax.primitives.tube import is_tube
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.gaussian import ConstantNoise
from impostor_jax.sensor.lateral import LateralNoise
from impostor_jax.sensor.scale_error import corrected

VECTORS = ("center", "axis", "size")
"""Parameters of three numbers."""

USUAL_SIGMA = 0.001
"""Standard deviation in meters that is taken where a caller names none."""

LARGEST_OF_16_BITS = 65.535
"""In meters of a file in millimeters: no sensor's reading, and some programs' code for
none. Beside an end of a can it would be background."""


class Given(NamedTuple):
    """An image as a caller gives it: the arguments of `fit_cylinder`, of one view."""

    depth: Any
    camera: Any
    mask: Any
    sigma: Any


class FitRequest(NamedTuple):
    """What a fit is asked: the shape, and the arguments of `fit_cylinder`."""

    kind: Fittable
    depth: Any
    camera: Any
    mask: Any
    sigma: Any
    initial: Any
    options: Options

    @property
    def values(self) -> tuple[Any, ...]:
        """All that may be traced."""
        return (*self[1:-1], self.options.prior)

    @property
    def views(self) -> list[Given]:
        """What is given, view by view.

        Of several images there are lists; a noise model may be that of all.

        Raises:
            ValueError: The lists are not of one length, or not there for the images.
        """
        return _views_given(self.depth, self.camera, self.mask, self.sigma)


class ReadingsError(ValueError):
    """Readings of an image that cannot be fitted; in a batch it fails alone."""


class TooFewReadingsError(ReadingsError):
    """An image, or its mask, holds too little for a fit."""


def _views_given(depth: Any, camera: Any, mask: Any, sigma: Any) -> list[Given]:
    """The views of a `FitRequest`."""
    if not isinstance(depth, list | tuple):
        unread("depth", depth)
        unread("mask", mask)
        if isinstance(camera, list | tuple) and not any(
            isinstance(one, AbstractRays) for one in camera
        ):
            raise ValueError(f"camera must be a camera, got {not_accepted(camera)}")
        for name, value in (("camera", camera), ("mask", mask), ("sigma", sigma)):
            if isinstance(value, list | tuple):
                raise ValueError(
                    f"{name} must be one, of the one depth image, got a list: give "
                    "depth as a list of images, too, as list(depth) of an array of them"
                    f", or np.asarray({name}) of lists of numbers"
                )
        return [Given(depth, camera, mask, sigma)]
    count = len(depth)
    if not count:
        raise ValueError("depth must be an image or a list of them, got an empty list")
    if isinstance(depth[0], list | tuple | float | int):
        raise ValueError(
            "depth must be an array, or a list of arrays, got a list of "
            f"{type(depth[0]).__name__}: np.asarray(depth) makes an array of numbers"
        )
    masks = [None] * count if mask is None else mask
    sigmas = sigma if isinstance(sigma, list | tuple) else [sigma] * count
    for name, value in (("camera", camera), ("mask", masks), ("sigma", sigmas)):
        if not isinstance(value, list | tuple) or len(value) != count:
            found = len(value) if isinstance(value, list | tuple) else type(value)
            raise ValueError(
                f"{name} must be a list of {count}, one for each depth image, got "
                f"{found}"
            )
    if any(image is None for image in depth):
        raise ValueError(
            "depth must be an image in each entry of a list, got None: an outline is "
            "fitted alone, with depth=None"
        )
    return [Given(*parts) for parts in zip(depth, camera, masks, sigmas, strict=True)]


def _own_type() -> np.dtype:
    """JAX's own type of numbers, in a twentieth of the time of `jnp.result_type`."""
    return jax.dtypes.canonicalize_dtype(float)


def _made_once(make: Callable[..., Any]) -> Any:
    """A function whose results are made and brought to the device once.

    Both take 0.1 to 0.3 ms of each fit. They are of no trace, which may be over when
    they are taken next.
    """

    @functools.lru_cache(maxsize=64)
    def made(*args: Any, **kwargs: Any) -> Any:
        with jax.ensure_compile_time_eval():
            return jax.device_put(make(*args, **kwargs))

    return made


def checked_settings(
    kind: Fittable, options: Options, initial: AbstractPrimitive | None, sigma: Any
) -> Settings:
    """What is asked for, checked.

    Args:
        kind: What is fitted.
        options: As a caller gives them.
        initial: As a caller gives it.
        sigma: As a caller gives it.
    """
    fixed, effort = tuple(options.fixed), options.effort
    for name in fixed:
        one_of("fixed", name, kind.parameters)
        if isinstance(options.prior, Mapping) and name in options.prior:
            raise ValueError(
                f"prior must be of parameters that are free, got {name!r}, which "
                f"fixed={fixed} holds: leave it out of one of them"
            )
    if len(set(fixed)) == len(kind.parameters):
        raise ValueError(
            f"fixed must leave a parameter to fit, got all: {kind.parameters}"
        )
    if fixed and initial is None:
        raise ValueError(
            f"initial must be given with fixed={fixed}: held parameters keep their "
            "value in it"
        )
    return _settings(
        kind,
        fixed,
        _own_type(),
        tolerance=float(min(effort.tolerance, kind.most_tolerance)),
        max_steps=effort.max_steps,
        is_outline=options.mask_meaning == "outline",
        estimate_scale=options.scale == "estimated",
        keep_ends=isinstance(initial, Frustum),
        trusts_sigma=all(is_trusted(one) for one in each_of(sigma)),
        refutes=not effort.doubts,
        draws_in=not {"center", "height"} & {*fixed, *(options.prior or {})},
        one_sensor=not isinstance(sigma, list | tuple),
    )


@_made_once
def _settings(
    kind: Fittable, fixed: tuple[str, ...], dtype: DTypeLike, **asked: Any
) -> Settings:
    free = kind.blank.free_directions(fixed).astype(dtype)
    held: Any = {name: name in fixed for name in kind.parameters}
    return Settings(free=free, held=held, **asked)


def is_trusted(sigma: Any) -> bool:
    """Whether what is said of a sensor is all that its readings err by.

    Nothing is said by None, and less by a noise model that is, or wraps, a
    `LateralNoise`, whose `sigma` leaves out what slopes add.
    """
    parts = jax.tree.leaves(sigma, is_leaf=lambda part: isinstance(part, LateralNoise))
    return sigma is not None and not any(isinstance(one, LateralNoise) for one in parts)


def checked_noise(sigma: Any, camera: AbstractRays | None = None) -> AbstractDepthNoise:
    """Noise model of the sensor; a number is that of all readings, None a guess.

    Args:
        sigma: As a caller gives it.
        camera: That took the image, of which there may be a number for each pixel; none
            of what is no image.
    """
    if sigma is None:
        sigma = USUAL_SIGMA
    if isinstance(sigma, AbstractDepthNoise):
        return sigma
    dtype = _own_type()
    if not isinstance(sigma, float):
        is_array = isinstance(sigma, jax.Array | np.ndarray) and sigma.ndim > 0
        if is_array and camera is not None:
            return noise_of_pixels(sigma, camera)
        if np.ndim(sigma) or isinstance(sigma, str | type) or callable(sigma):
            raise ValueError(
                "sigma must be a positive number in meters, the same for all readings, "
                f"or a noise model such as ij.StructuredLight(), got {described(sigma)}"
            )
        sigma = real_number("sigma", sigma, positive=True, unit="meters")
        if not is_concrete(sigma):
            return ConstantNoise(jnp.asarray(sigma, dtype))
    return _of_all(sigma, dtype)


@_made_once
def _of_all(sigma: float, dtype: DTypeLike) -> ConstantNoise:
    """The same standard deviation of all readings."""
    sigma = real_number("sigma", sigma, positive=True, unit="meters")
    # An array, so that another value does not compile the fit again.
    return ConstantNoise(jnp.asarray(sigma, dtype))


def checked_prior(
    prior: Mapping[str, Any] | None,
    parameters: tuple[str, ...],
    initial: AbstractPrimitive | None,
) -> Prior:
    """Prior with arrays for values, infinitely wide where nothing is expected.

    So a fit is compiled once for all.
    """
    if prior is not None and not isinstance(prior, Mapping):
        raise ValueError(
            "prior must map names to a value and a standard deviation, as in "
            f"{{'radius': (0.04, 0.001)}}, got {prior!r}"
        )
    known = _nothing_known(parameters, _own_type())
    if not prior:
        return known
    beliefs = {}
    for name, belief in prior.items():
        one_of("prior", name, parameters)
        if name in ("radius1", "radius2", "size") and initial is None:
            part = "edge" if name == "size" else "end"
            raise ValueError(
                f"initial must be given with prior[{name!r}]: it tells which {part} is "
                "which"
            )
        if not isinstance(belief, tuple | list) or len(belief) != 2:
            raise ValueError(
                f"prior[{name!r}] must be a value and a standard deviation, got "
                f"{belief!r}"
            )
        label = f"prior[{name!r}]"
        value, deviation = belief
        what = f"standard deviation of {label}"
        if name in VECTORS and np.ndim(deviation):
            raise ValueError(
                f"{what} must be one number for all directions, got {deviation!r}"
            )
        real_number(what, deviation, positive=True)
        if name in VECTORS:
            value = float_array(label, value, (3,))
            if name == "axis":
                check_direction(label, value)
                value = safe_normalize(jnp.asarray(value))
        else:
            real_number(label, value, positive=True, unit="meters")
            value = jnp.asarray(value, jnp.result_type(float))
        beliefs[name] = (value, jnp.asarray(deviation, value.dtype))
    return dataclasses.replace(known, **beliefs)


@_made_once
def _nothing_known(parameters: tuple[str, ...], dtype: DTypeLike) -> Prior:
    beliefs = {}
    for name in parameters:
        size = (3,) if name in VECTORS else ()
        beliefs[name] = (np.zeros(size, dtype), np.array(np.inf, dtype))
    return Prior(**beliefs)


def checked_pose_sigma(pose_sigma: Any, count: int) -> list[PoseBelief | None]:
    """What is known of the poses of so many views.

    Args:
        pose_sigma: As a caller gives it.
        count: Number of views.

    Raises:
        ValueError: It is no pair of numbers, nor one for each view.
    """
    if pose_sigma is None:
        return [None] * count
    try:
        pairs = np.array(pose_sigma, float)
    except (TypeError, ValueError):
        pairs = np.array(None, float)
    if pairs.shape not in ((2,), (count, 2)):
        raise ValueError(
            "pose_sigma must be standard deviations in meters and in radians, as in "
            f"(0.0005, 0.001), or such a pair for each of {count} images, got "
            f"{pose_sigma!r}"
        )
    if not (np.isfinite(pairs).all() and (pairs >= 0).all()):
        raise ValueError(
            f"pose_sigma must be finite and not negative, got {pose_sigma!r}"
        )
    if not pairs.any():
        return [None] * count
    of_each = np.broadcast_to(pairs, (count, 2)).astype(_own_type())
    nothing = np.zeros(6, _own_type())
    return [PoseBelief(np.repeat(pair[::-1], 3), nothing) for pair in of_each]


def check_types(
    shape: type[AbstractPrimitive],
    camera: Any,
    initial: AbstractPrimitive | None,
    count: int | None = None,
) -> None:
    """Raise unless the objects are what their names say.

    Args:
        shape: What is fitted.
        camera: The camera.
        initial: One start, or a batch of `count`.
        count: Number of images; None for one image alone.
    """
    if not isinstance(camera, AbstractRays) or isinstance(camera, OrthographicCamera):
        raise ValueError(
            "camera must be a PinholeCamera or a SphericalCamera, got "
            f"{not_accepted(camera)}"
        )
    if initial is None:
        return
    batch = () if count is None else (count,)
    is_right = is_tube(initial) if shape is Solid else isinstance(initial, shape)
    if not is_right or initial.batch_shape != batch:
        name = "tube, as ij.tube makes it" if shape is Solid else shape.__name__
        need = f"one {name}" if count is None else f"a batch of {count} {name.lower()}s"
        raise ValueError(f"initial must be {need}, got {initial!r}")
    if isinstance(initial, Cylinder | Frustum):
        if not initial.caps or initial.start_angle is not None:
            raise ValueError(
                f"initial must be whole, with caps and no sector, got {initial!r}"
            )


def checked_depth(depth: Any, camera: AbstractRays) -> DepthImage:
    """Depth as a float image with 0 for missing readings.

    Missing are 0, NaN, infinity, and `LARGEST_OF_16_BITS`.
    """
    if not isinstance(depth, jax.Array):
        depth = np.asarray(unmasked(unread("depth", depth)))
    shape = (camera.height, camera.width)
    if depth.shape != shape:
        raise ValueError(
            f"depth must have the camera's shape {shape}, got {depth.shape}"
        )
    if not jnp.issubdtype(depth.dtype, np.floating):
        raise ValueError(
            f"depth must be floating-point meters, got {depth.dtype}; multiply integer "
            "readings by their depth scale"
        )
    dtype = _own_type()
    if is_concrete(depth):
        values = np.asarray(depth)
        low, high = values.min(), values.max()
        # NaN passes on, so that both are finite only where all are.
        if not (math.isfinite(low) and math.isfinite(high)):
            values = np.where(np.isfinite(values), values, 0)
            low, high = values.min(), values.max()
        if low < 0:
            raise ReadingsError(
                f"depth must not be negative, got {low} meters; missing readings are "
                "0, NaN or infinity"
            )
        largest = float(np.finfo(dtype).max) ** 0.5
        if float(high) > largest:
            raise ReadingsError(
                f"depth must be at most {largest:.3g} meters, got {high:.6g}; missing "
                "readings are 0, NaN or infinity"
            )
        if abs(high - LARGEST_OF_16_BITS) < 2e-7 * LARGEST_OF_16_BITS:
            values = np.where(values == high, 0, values)
        return values.astype(dtype)
    return jnp.where(jnp.isfinite(depth), depth, 0).astype(dtype)


def checked_readings(
    depth: Any, camera: AbstractRays, sigma: Any
) -> tuple[DepthImage, AbstractDepthNoise, Any]:
    """Depth as a float image, its noise, and what is handed on for sigma.

    The mean errors that a sensor knows are taken off the depth, and off the sensor:
    whoever gets both does not take them off again.
    """
    noise, image = checked_noise(sigma, camera), checked_depth(depth, camera)
    if isinstance(noise, PerPixelNoise):
        image = read_with(noise, image)
    if not noise.bias.scales:
        return image, noise, sigma
    image, noise = corrected(image, noise)
    return image, noise, noise


def checked_mask(mask: Any, camera: AbstractRays) -> Mask | None:
    """Mask as booleans of the camera's shape; None stays."""
    if mask is None:
        return None
    if not isinstance(mask, jax.Array):
        mask = np.asarray(unmasked(mask))
    shape = (camera.height, camera.width)
    if mask.shape != shape:
        raise ValueError(f"mask must have the camera's shape {shape}, got {mask.shape}")
    if not (mask.dtype == bool or jnp.issubdtype(mask.dtype, np.integer)):
        raise ValueError(f"mask must be of booleans or integers, got {mask.dtype}")
    if mask.dtype == bool:
        return mask
    if is_concrete(mask):
        check_one_object(np.asarray(mask), "mask", "fit_labels fits each")
    return mask != 0


def check_one_object(mask: Integer[np.ndarray, "h w"], what: str, cure: str) -> None:
    """Raise where a mask of integers has several values: the labels of many objects.

    Merged into one object they would be fitted without a word.

    Args:
        mask: 0 where the object is not.
        what: Names it in the error.
        cure: What to do with labels.
    """
    least, largest = mask.min(initial=0), mask.max(initial=0)
    if least < 0:
        raise ValueError(
            f"{what} must be 0 where the object is not, and positive where it is, got "
            f"{least}"
        )
    if np.any((mask != 0) & (mask != largest)):
        count = len(np.unique(mask[mask != 0]))
        raise ValueError(
            f"{what} must be of one object, one value beside 0, got {count} values up "
            f"to {largest}: is it a label image? {cure}, mask == {largest} is one of "
            "them"
        )


def request_of_cylinder(fit: Fit, what: str) -> tuple[FitRequest, Any]:
    """What `fit_shape` was asked for a cylinder, and its `places`, to test it anew.

    Args:
        fit: As `fit_cylinder` returned it.
        what: Of the cylinder, that is tested.

    Raises:
        ValueError: It is of another shape, of an outline or of a traced call, or it was
            stacked or made anew since.
    """
    if not isinstance(fit.shape, Cylinder):
        raise ValueError(
            f"fit must be of a cylinder to test its {what}, got a {fit.kind}'s"
        )
    if fit.source == "outline":
        raise ValueError(
            f"fit must be of depths to test its {what}, got a fit to an outline"
        )
    if fit.asked.arguments is None:
        raise ValueError(
            f"fit must be as fit_cylinder returned it to test its {what}: one that was "
            "traced or stacked does not hold its image, nor one of too few readings"
        )
    arguments = dict(fit.asked.arguments)
    places = arguments.pop("places", None)
    return FitRequest(CYLINDER, **arguments), places


def check_readings(views: Sequence[Given]) -> None:
    """Raise a `TooFewReadingsError` where there are too few readings for a fit.

    Args:
        views: Checked and concrete; of no mask all readings count.
    """
    count, is_masked = 0, False
    for view in views:
        depth, mask = np.asarray(view.depth), view.mask
        is_masked |= mask is not None
        count += np.count_nonzero(depth if mask is None else depth[np.asarray(mask)])
    if is_masked and not any(view.mask is None or view.mask.any() for view in views):
        raise TooFewReadingsError("mask must hold at least one pixel, got an empty one")
    if count < MIN_READINGS:
        where = " inside the mask" if is_masked else ""
        raise TooFewReadingsError(
            f"depth must hold at least {MIN_READINGS} readings{where}, got {count}"
        )
