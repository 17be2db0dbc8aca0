"""Fit a shape to a depth image: the way that is the same for all of them.

Four steps: take the object's readings, guess shapes outside JAX, minimize the whitened
residuals with optimistix, and say how sure the result is. The last two are one compiled
function of arrays that come in few sizes. Most images are explained by the first guess;
where one is not, or where the caller asks for it, the others are tried, too.
"""

__all__ = [
    "CYLINDER",
    "FRUSTUM",
    "KINDS",
    "SPHERE",
    "Fittable",
    "fit_shape",
    "no_guess",
    "pixels_shown",
]

import dataclasses
import functools
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
from impostor_jax.effort import Effort
from impostor_jax.fit.assess import Assessment, assess
from impostor_jax.fit.ball import Ball
from impostor_jax.fit.body import AbstractBody, coordinates_of
from impostor_jax.fit.border import fit_of_one_surface
from impostor_jax.fit.guess_sphere import guess_spheres
from impostor_jax.fit.initialize import first_guesses
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
    checked_depth,
    checked_mask,
    checked_noise,
    checked_prior,
    checked_settings,
)
from impostor_jax.fit.result import (
    STATUSES,
    Deviations,
    Directions,
    Fit,
    FitStatus,
)
from impostor_jax.fit.round_body import RoundBody
from impostor_jax.fit.solve import STAGE_TOLERANCE, TRACED_TOLERANCE, solve
from impostor_jax.primitives.base import (
    AbstractPrimitive,
    in_camera_frame,
)
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.sensor.base import AbstractDepthNoise


@dataclasses.dataclass(frozen=True)
class Fittable:
    """A shape that can be fitted.

    Attributes:
        shape: Its primitive.
        body: As a fit moves it.
        guesses: First guesses in the camera frame from depth, region, camera and the
            typical deviation of a reading: the fields of a body, the likeliest first.
        parameters: Names of what a caller may hold or expect.
        nothing: Fields of a body without a size.
        most_tolerance: Largest tolerance of an `Effort` that ends its fits.
    """

    shape: type[AbstractPrimitive]
    body: type[AbstractBody]
    guesses: Callable[..., list[dict[str, Any]]]
    parameters: tuple[str, ...]
    nothing: dict[str, Any]
    most_tolerance: float = np.inf

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Of its covariance."""
        # Known without a device.
        return coordinates_of(jax.eval_shape(lambda: self.body_at(self.nothing)))

    @functools.cached_property
    def blank(self) -> AbstractBody:
        """A body that says what is true of all."""
        return self.body_at(self.nothing)

    def body_at(self, fields: dict[str, Any]) -> AbstractBody:
        """A body from NumPy's or Python's numbers."""
        dtype = np.dtype(jnp.result_type(float))
        arrays = {name: np.asarray(field, dtype) for name, field in fields.items()}
        # All at once: a fifth of the time that they take one by one.
        return self.body(**jax.device_put(arrays))


def _cylinders(*asked: Any) -> list[dict[str, Any]]:
    return [
        {"center": g.center, "axis": g.axis, "radius": g.radius, "height": g.height}
        for g in first_guesses(*asked)
    ]


def _frusta(*asked: Any) -> list[dict[str, Any]]:
    return [
        {
            "center": g.center,
            "axis": g.axis,
            "radius": g.radius,
            "height": g.height,
            "growth": g.slope * g.height / 2,
        }
        for g in first_guesses(*asked, tapered=True)
    ]


def _spheres(*asked: Any) -> list[dict[str, Any]]:
    return [
        {"center": center, "radius": radius} for center, radius in guess_spheres(*asked)
    ]


CYLINDER = Fittable(
    shape=Cylinder,
    body=RoundBody,
    guesses=_cylinders,
    parameters=("center", "axis", "radius", "height"),
    nothing={"center": (0, 0, 0), "axis": (0, 0, 1), "radius": 0, "height": 0},
)
FRUSTUM = Fittable(
    shape=Frustum,
    body=RoundBody,
    guesses=_frusta,
    parameters=("center", "axis", "radius1", "radius2", "height"),
    nothing=CYLINDER.nothing | {"growth": 0},
    # A taper settles slowly: with five times it 1 of 200 cups at 3 mm of noise ended 20
    # deviations away.
    most_tolerance=STAGE_TOLERANCE,
)
SPHERE = Fittable(
    shape=Sphere,
    body=Ball,
    guesses=_spheres,
    parameters=("center", "radius"),
    nothing={"center": (0, 0, 0), "radius": 0},
)
KINDS = {kind.shape: kind for kind in (CYLINDER, FRUSTUM, SPHERE)}
"""What can be fitted, by its primitive."""


def fit_shape(
    kind: Fittable,
    depth: Any,
    camera: PinholeCamera,
    mask: Any,
    sigma: Any,
    initial: AbstractPrimitive | None,
    options: Options,
    is_whole: bool = False,
) -> Fit:
    """Fit a shape; the arguments are those of `fit_cylinder`.

    With `is_whole` the mask is known to be of one surface, and the errors are what they
    are said to be.
    """
    effort, prior = options.effort, options.prior
    check_types(kind.shape, camera, initial)
    settings = checked_settings(kind.blank, kind.parameters, options, initial, sigma)
    settings = dataclasses.replace(
        settings, tolerance=min(effort.tolerance, kind.most_tolerance)
    )
    about = {"camera": camera, "sigma": sigma, "initial": initial, "options": options}
    given = (depth, mask, camera, sigma, initial, prior)
    with working_precision(effort.precision, given) as converted:
        noise = checked_noise(sigma)
        beliefs = checked_prior(prior, kind.parameters, initial)
        image = checked_depth(depth, camera)
        camera, noise, initial, beliefs = converted((camera, noise, initial, beliefs))
        asked = (camera, noise, beliefs, settings, options)
        mask = checked_mask(mask, camera)
        if is_concrete((image, mask, initial, *asked[:3])):
            shown = np.asarray(image), None if mask is None else np.asarray(mask)
            region = object_region(*shown, camera, noise)
            fit = _fit_concrete(kind, shown[0], region, initial, *asked, is_whole)
            # A caller may write other pixels to a mask, and the depth is a copy.
            own = {"depth": shown[0], "mask": np.array(region)}
            fit.asked.arguments = about | own
            return fit
        if initial is None:
            raise ValueError(
                "initial must be given to a traced fit: the first guess runs outside "
                "JAX"
            )
        return _fit_traced(image, mask, kind.body.of(initial), *asked)


def _fit_concrete(
    kind: Fittable,
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    initial: AbstractPrimitive | None,
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
    prior: Prior,
    settings: Settings,
    options: Options,
    is_whole: bool,
) -> Fit:
    """Fit to a region, or to what of it is of one surface."""
    warn_of_units(image, region, noise)
    effort = options.effort

    def fitted(part: Bool[np.ndarray, "h w"], correlated: bool) -> Fit:
        shown = pixels_shown(image, part, camera, noise, effort.stride)
        # Only of the whole region the caller says that its edge is the silhouette.
        is_outline = settings.is_outline and part is region
        asked = dataclasses.replace(settings, is_outline=is_outline)
        return _fit_pixels(kind, shown, initial, prior, asked, effort, correlated)

    correlated = options.errors == "correlated"
    if is_whole:
        return fitted(region, correlated)
    return fit_of_one_surface(
        fitted, kind.body, image, region, camera, noise, correlated
    )


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
        correlated: Whether deviations allow for correlated residuals.
    """
    image, region, _, _, camera, noise = shown
    compiled = quickly_compiled(fit_from, static_argnames=("kernel", "correlated"))

    def fitted(start: AbstractBody) -> Assessment:
        return compiled(
            *shown, prior, settings, start, kernel=effort.kernel, correlated=correlated
        )

    if initial is not None:
        return fitted(_placed(kind.body, initial, camera)).fit
    guesses = kind.guesses(image, region, camera, typical_sigma(image, region, noise))
    if not guesses:
        return no_guess(kind, region)
    found, starts = [], []
    for guess in guesses[: effort.starts]:
        starts.append(kind.body_at(guess))
        found.append(fitted(starts[-1]))
        if not effort.all_starts and bool(found[-1].is_clear):
            break
    else:
        # Noise may hide which of two tilts is the true one.
        if effort.starts > 1 and any(bool(one.hides_tilt) for one in found):
            found += [fitted(_mirrored(start)) for start in starts]
    return found[0].fit if len(found) == 1 else _best_of(found)


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


_mirrored = jax.jit(lambda body: body.mirrored())


@jax.jit
def _is_alike(best: Assessment, other: Assessment) -> Bool[Array, ""]:
    least = jnp.maximum(best.nominal, best.body.radius / 50)
    return best.body.distance(other.body) < least


def _best_of(found: list[Assessment]) -> Fit:
    """The fit that explains the image best, and how many others agree with it."""
    best = found[int(np.argmin([float(one.cost) for one in found]))]
    agreeing = sum(bool(_is_alike(best, one)) for one in found)
    return dataclasses.replace(
        best.fit,
        num_steps=jnp.array(sum(int(one.fit.num_steps) for one in found)),
        num_starts=jnp.array(len(found)),
        num_agreeing=jnp.array(max(agreeing, 1)),
    )


def pixels_shown(
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
    stride: int = 1,
) -> tuple[Any, ...]:
    """The first arguments of `solve`: an image, the pixels of an object, and how seen.

    Args:
        image: In meters; 0 where there is no reading.
        region: As `object_region` returns it.
        camera: The camera.
        noise: Of its readings.
        stride: Of an `Effort`.
    """
    image = np.asarray(without_edges(image, region, noise))
    return image, region, *pixel_indices(region, stride), camera, noise


def no_guess(kind: Fittable, region: Bool[np.ndarray, "h w"]) -> Fit:
    """Result of a fit that could not start; its shape has no meaning."""
    nothing = kind.body_at(kind.nothing)
    names, zero = coordinates_of(nothing), nothing.radius
    seen = jnp.zeros(len(nothing.ends), bool)
    read = jax.eval_shape(nothing.readout, nothing, seen)
    infinite = np.diag(np.full(len(names), np.inf, zero.dtype))
    return Fit(
        shape=nothing.shape,
        std=Deviations(
            jax.tree.map(lambda part: jnp.full(part.shape, jnp.inf, part.dtype), read)
        ),
        covariance=jnp.asarray(infinite),
        coordinates=names,
        ends_seen=seen,
        observed=Directions(
            coordinates=jnp.zeros(len(names), bool),
            vector=jnp.asarray(np.eye(len(names), dtype=zero.dtype)),
            deviation=jnp.asarray(np.diagonal(infinite)),
        ),
        success=jnp.array(False),
        status_code=jnp.array(STATUSES.index(FitStatus.NO_FIRST_GUESS)),
        num_steps=jnp.array(0),
        num_starts=jnp.array(0),
        num_agreeing=jnp.array(0),
        residual=jnp.zeros(region.shape, zero.dtype),
        inliers=jnp.zeros(region.shape, bool),
        region=jnp.asarray(region),
        num_pixels=jnp.array(np.count_nonzero(region)),
        rms=jnp.full_like(zero, jnp.inf),
        chi2=jnp.full_like(zero, jnp.inf),
        p_value=jnp.full_like(zero, jnp.nan),
        border_chi2=jnp.full_like(zero, jnp.nan),
    )


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
    region = jnp.asarray(mask)
    depth = without_edges(depth, region, noise)
    stride = options.effort.stride
    if stride > 1:
        region &= (row % stride == 0) & (col % stride == 0)
    sees = camera.sees(row, col)
    if sees is not None:
        region &= sees
    if is_concrete(region):
        row, col = pixel_indices(np.asarray(region))
    else:
        row, col = traced_indices(region)
    settings = dataclasses.replace(
        settings, tolerance=min(settings.tolerance, TRACED_TOLERANCE), refutes=True
    )
    shown = (depth, region, row, col, camera, noise)
    problem = posed(*shown, prior, settings, kernel=options.effort.kernel)
    solution = solve(problem, in_camera_frame(initial, camera))
    return assess(problem, solution, correlated=options.errors == "correlated").fit
