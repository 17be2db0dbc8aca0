"""Fit a shape to a depth image: the way that is the same for all of them.

Four steps: take the object's readings, guess shapes outside JAX, go to the fixed point
of a step, and say how sure the result is. The last two are one compiled function of
arrays that come in few sizes. Most images are explained by the first guess; where one
is not, or where the caller asks for it, the others are tried, too.
"""

__all__ = ["fit_from", "fit_shape", "pixels_shown"]

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.arguments import is_concrete, working_precision
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.compiling import quickly_compiled
from impostor_jax.effort import MIN_READINGS, Effort
from impostor_jax.fit.assess import Assessment, assess
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.border import fit_of_one_surface
from impostor_jax.fit.fittable import Fittable, no_guess
from impostor_jax.fit.options import Options
from impostor_jax.fit.prior import Prior
from impostor_jax.fit.problem import Settings, posed
from impostor_jax.fit.regions import (
    object_region,
    pixel_indices,
    traced_indices,
    typical_sigma,
    warn_of_units,
    without_edges,
)
from impostor_jax.fit.request import (
    DepthImage,
    Mask,
    check_types,
    checked_mask,
    checked_prior,
    checked_readings,
    checked_settings,
)
from impostor_jax.fit.result import Fit
from impostor_jax.fit.solve import solve
from impostor_jax.fit.status import FitStatus
from impostor_jax.fit.weighing import best_of, likeliest
from impostor_jax.primitives.base import AbstractPrimitive, in_camera_frame
from impostor_jax.sensor.base import AbstractDepthNoise

CLOSES = 3.0
"""Nats by which an image must be likelier without a bore that it does not show, for
that to be taken away: less than a reading of a lid costs, more than steps leave. Where
the fit with it did not converge it may be as much less likely."""

MOST_LOOKS = 2
"""Times that foreign readings are looked for: a fit that a floor spoils may not tell
its corner."""


def fit_shape(
    kind: Fittable,
    depth: Any,
    camera: PinholeCamera,
    mask: Any,
    sigma: Any,
    initial: AbstractPrimitive | None,
    options: Options,
) -> Fit:
    """Fit a shape; the arguments are those of `fit_cylinder`.

    A mask must be given unless something is traced.
    """
    effort, prior = options.effort, options.prior
    check_types(kind.shape, camera, initial)
    about = {"camera": camera, "initial": initial, "options": options}
    given = (depth, mask, camera, sigma, initial, prior)
    with working_precision(effort.precision, given) as converted:
        settings = checked_settings(kind, options, initial, sigma)
        beliefs = checked_prior(prior, kind.parameters, initial)
        image, noise, sigma = checked_readings(depth, camera, sigma)
        camera, noise, initial, beliefs = converted((camera, noise, initial, beliefs))
        mask = checked_mask(mask, camera)
        if not is_concrete((image, mask, initial, camera, noise, beliefs)):
            if initial is None:
                raise ValueError(
                    "initial must be given to a traced fit: the first guess runs "
                    "outside JAX"
                )
            start = kind.body.of(initial)
            return _fit_traced(
                image, mask, start, camera, noise, beliefs, settings, options
            )
        assert mask is not None
        image = np.asarray(image)
        region = object_region(image, np.asarray(mask), camera)
        warn_of_units(image, region, noise)

        # Without types of arrays, which would be looked up at each call, in 20 us.
        def fitted(image: np.ndarray, part: np.ndarray, correlated: bool) -> Fit:
            shown = pixels_shown(image, part, camera, noise, effort.readings)
            asked = settings
            if part is not region:
                # Only of the whole one a caller says that its edge is the silhouette.
                asked = dataclasses.replace(settings, is_outline=False)
            return _fit_pixels(kind, shown, initial, beliefs, asked, effort, correlated)

        correlated = options.correlated(noise)

        def fitted_to(image: np.ndarray) -> Fit:
            return fit_of_one_surface(
                partial(fitted, image),
                kind.body,
                image,
                region,
                camera,
                noise,
                correlated,
            )

        fit = fitted_to(image)
        if kind.foreign is not None:
            fit = _without_foreign(kind, fit, fitted_to, image, region, camera, noise)
        # A caller may write other pixels to a mask, and the depth is a copy.
        known = {"depth": image, "sigma": sigma, "mask": np.array(region)}
        fit.asked.arguments = about | known
        return fit


def _without_foreign(
    kind: Fittable,
    fit: Fit,
    fitted_to: Callable[[np.ndarray], Fit],
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
) -> Fit:
    """The fit without readings of the region that are not of the shape, if there are.

    Args:
        kind: What is fitted; it tells which they are.
        fit: To all readings.
        fitted_to: How to fit an image.
        image: In meters; 0 where there is no reading.
        region: Pixels of the object.
        camera: The camera.
        noise: Of its readings.
    """
    assert kind.foreign is not None
    row, col = pixel_indices(region)
    left_out = np.zeros_like(region)
    for _ in range(MOST_LOOKS):
        if fit.status in (FitStatus.NO_FIRST_GUESS, FitStatus.NOT_FINITE):
            break
        body = kind.body.of(fit.shape)
        foreign = kind.foreign(image, row, col, body, camera, noise)
        if not foreign.any() or np.array_equal(foreign, left_out):
            break
        kept = np.where(foreign, 0, image).astype(image.dtype)
        if np.count_nonzero(kept[region]) < MIN_READINGS:
            break
        left_out, fit = foreign, fitted_to(kept)
    return fit


def _fit_pixels(
    kind: Fittable,
    shown: tuple[Any, ...],
    initial: AbstractPrimitive | None,
    prior: Prior,
    settings: Settings,
    effort: Effort,
    correlated: bool,
) -> Fit:
    """Fit from the start that is given, or from guesses.

    Args:
        kind: What is fitted.
        shown: As `pixels_shown` returns it.
        initial: In the world frame.
        prior: In the world frame.
        settings: What is asked for.
        effort: How much work it takes.
        correlated: Whether the covariance allows for correlated residuals.
    """
    image, region, _, _, camera, noise = shown
    compiled = quickly_compiled(fit_from, static_argnames=("kernel", "correlated"))

    def fitted(start: AbstractBody) -> Assessment:
        return compiled(
            *shown, prior, settings, start, kernel=effort.kernel, correlated=correlated
        )

    if initial is not None:
        found = [fitted(_placed(kind.body, initial, camera))]
        found = _with_closed(kind, found, fitted)
        return found[0].fit if len(found) == 1 else best_of(found)
    guesses = kind.guesses(image, region, camera, typical_sigma(image, region, noise))
    if not guesses:
        return no_guess(kind, region)
    found, starts = [], guesses[: effort.starts]
    for guess in starts:
        found.append(fitted(guess))
        if not effort.all_starts and found[-1].is_clear.item():
            break
    else:
        # Noise may hide which of two tilts is the true one.
        if effort.starts > 1 and any(bool(one.hides_tilt) for one in found):
            found += [fitted(_mirrored(start)) for start in starts]
    found = _with_closed(kind, found, fitted)
    best, is_alone = likeliest(found), len(found) == 1
    if is_alone and not (bool(best.hides_turn) or bool(best.ends_early)):
        return best.fit
    bodies = [best.body]
    # And which of a short one's sides its axis is along.
    if effort.starts > 1 and bool(best.hides_turn):
        found.append(fitted(_turned(best.body)))
        bodies.append(found[-1].body)
    if not is_alone:
        # A guess that leads to one tilt may be too far off, mirrored, for the other.
        found += [fitted(_mirrored(body)) for body in bodies]
    # Where noise is deep, or an end shows little, a fit may end where readings that it
    # leaves out would not let it, 10 standard deviations off; its first stages lead on
    # from there.
    if not is_alone or any(bool(one.ends_early) for one in found):
        found.append(fitted(likeliest(found).body))
    return best_of(found)


def _with_closed(
    kind: Fittable,
    found: list[Assessment],
    fitted: Callable[[AbstractBody], Assessment],
) -> list[Assessment]:
    """What was found, and a fit without a bore where the best of a tube shows none.

    Readings of a lid are outliers in a bore; and where few are, an estimate may go to
    and fro between them for ever. It takes the place of all that explain no more.
    """
    best = likeliest(found)
    if kind.closed is None or np.isfinite(best.fit.std.inner_radius):
        return found
    other = fitted(_closed(kind.closed, best.body))
    more = CLOSES if bool(other.fit.success) and not bool(best.fit.success) else -CLOSES
    if float(other.cost) > float(best.cost) + more:
        return found
    return [one for one in found if float(one.cost) > float(other.cost)] + [other]


def fit_from(
    depth: Float[Array, "h w"],
    mask: Bool[Array, "h w"],
    row: Int[Array, " n"],
    col: Int[Array, " n"],
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
    prior: Prior,
    settings: Settings,
    start: AbstractBody,
    kernel: str,
    correlated: bool,
) -> Assessment:
    """All of a fit that is compiled, in one program; the arguments are of its parts."""
    problem = posed(depth, mask, row, col, camera, noise, prior, settings, kernel)
    return assess(problem, solve(problem, start), correlated)


@partial(jax.jit, static_argnums=0)
def _placed(
    body: type[AbstractBody], shape: AbstractPrimitive, camera: PinholeCamera
) -> AbstractBody:
    """In one program: operation by operation it takes a millisecond."""
    return in_camera_frame(body.of(shape), camera)


_closed = partial(jax.jit, static_argnums=0)(lambda close, body: close(body))
_mirrored = jax.jit(lambda body: body.mirrored())
_turned = jax.jit(lambda body: body.turned())


def pixels_shown(
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
    readings: int | None = None,
) -> tuple[Any, ...]:
    """The first arguments of `fit_from`: an image, an object's pixels, and how seen.

    Args:
        image: In meters; 0 where there is no reading.
        region: As `object_region` returns it.
        camera: The camera.
        noise: Of its readings.
        readings: Of an `Effort`.
    """
    image = np.asarray(without_edges(image, region, camera, noise))
    return image, region, *pixel_indices(region, readings), camera, noise


def _fit_traced(
    depth: DepthImage,
    mask: Mask | None,
    initial: AbstractBody,
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
    prior: Prior,
    settings: Settings,
    options: Options,
) -> Fit:
    """Fit with sizes that do not depend on any value."""
    row, col = camera.frame.pixels()
    if mask is None:
        ray = camera.rays(row, col, depth.dtype)
        mask = in_camera_frame(initial.shape, camera).intersect(ray).mask
    # A mask that is known stays so: its pixels are found before anything is compiled.
    region = np.asarray(mask) if is_concrete(mask) else mask
    depth = without_edges(depth, jnp.asarray(region), camera, noise)
    sees = camera.sees(row, col)
    if sees is not None:
        region = jnp.asarray(region) & sees
    if isinstance(region, np.ndarray):
        row, col = map(jnp.asarray, pixel_indices(region, options.effort.readings))
    else:
        row, col = traced_indices(region, options.effort.readings)
    settings = dataclasses.replace(settings, refutes=True)
    return fit_from(
        jnp.asarray(depth), jnp.asarray(region), row, col, camera, noise, prior,
        settings, in_camera_frame(initial, camera), options.effort.kernel,
        correlated=options.correlated(noise),
    ).fit  # fmt: skip
