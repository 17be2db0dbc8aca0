"""Fit a shape to a depth image: the way that is the same for all of them.

Four steps: take the object's readings, guess shapes outside JAX, minimize the whitened
residuals with optimistix, and say how sure the result is. The last two are one compiled
function of arrays that come in few sizes. Most images are explained by the first guess;
where one is not, or where the caller asks for it, the others are tried, too.
"""

__all__ = [
    "CYLINDER",
    "FRUSTUM",
    "SPHERE",
    "Fittable",
    "fit_shape",
    "no_guess",
    "pixels_shown",
]

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.arguments import is_concrete, working_precision
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.compiling import quickly_compiled
from impostor_jax.effort import Effort, effort_of
from impostor_jax.fit.assess import Start, deviations_of, result_of
from impostor_jax.fit.ball import Ball
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.border import fit_of_one_surface
from impostor_jax.fit.guess_sphere import guess_spheres
from impostor_jax.fit.initialize import first_guesses
from impostor_jax.fit.prior import Prior
from impostor_jax.fit.regions import (
    bucket,
    object_region,
    pixel_indices,
    some_pixels,
    surroundings,
    typical_sigma,
    warn_of_units,
    without_edges,
)
from impostor_jax.fit.request import (
    DepthImage,
    Mask,
    Request,
    check_types,
    checked_depth,
    checked_mask,
    checked_noise,
    checked_prior,
    checked_request,
)
from impostor_jax.fit.result import STATUSES, AbstractFit, FitStatus
from impostor_jax.fit.round_body import CylinderBody, FrustumBody, RoundBody
from impostor_jax.fit.solve import NUM_KEPT, STAGE_TOLERANCE, best_start, solve
from impostor_jax.primitives.base import (
    AbstractPrimitive,
    in_camera_frame,
    in_world_frame,
)
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.sensor.base import AbstractDepthNoise

TRACED_READINGS = 15872
"""Most readings that a traced fit uses, evenly spaced over its region."""


@dataclasses.dataclass(frozen=True)
class Fittable:
    """A shape that can be fitted.

    Attributes:
        shape: Its primitive.
        body: As a fit moves it.
        guesses: First guesses in the camera frame from depth, region, camera and the
            typical deviation of a reading: the fields of a body, the likeliest first.
        parameters: Names of what a caller may hold or expect.
        example: Fields of a body of one meter.
        most_tolerance: Largest tolerance of an `Effort` that ends its fits.
    """

    shape: type[AbstractPrimitive]
    body: type[AbstractBody]
    guesses: Callable[..., list[dict[str, Any]]]
    parameters: tuple[str, ...]
    example: dict[str, Any]
    most_tolerance: float = np.inf

    def body_at(
        self, fields: dict[str, Any], camera: PinholeCamera | None = None
    ) -> AbstractBody:
        """A body in the world, or a batch, from numbers in a camera's frame."""
        dtype = np.dtype(jnp.result_type(float))
        arrays = {name: np.asarray(field, dtype) for name, field in fields.items()}
        return _placed(self.body, arrays, camera)


@partial(jax.jit, static_argnums=0)
def _placed(
    body: type[AbstractBody],
    fields: dict[str, Float[Array, "..."]],
    camera: PinholeCamera | None,
) -> AbstractBody:
    """In one program: operation by operation it takes a millisecond."""
    local = body(**fields)
    return local if camera is None else in_world_frame(local, camera)


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
    body=CylinderBody,
    guesses=_cylinders,
    parameters=("center", "axis", "radius", "height"),
    example={"center": (0, 0, 1), "axis": (0, 0, 1), "radius": 1, "height": 1},
)
FRUSTUM = Fittable(
    shape=Frustum,
    body=FrustumBody,
    guesses=_frusta,
    parameters=("center", "axis", "radius1", "radius2", "height"),
    example=CYLINDER.example | {"growth": 0},
    # A taper settles slowly: with five times it 1 of 200 cups at 3 mm of noise ended 20
    # deviations away.
    most_tolerance=STAGE_TOLERANCE,
)
SPHERE = Fittable(
    shape=Sphere,
    body=Ball,
    guesses=_spheres,
    parameters=("center", "radius"),
    example={"center": (0, 0, 1), "radius": 1},
)


def fit_shape(
    kind: Fittable,
    depth: Any,
    camera: PinholeCamera,
    mask: Any,
    sigma: Any,
    initial: AbstractPrimitive | None,
    fixed: Sequence[str],
    prior: Mapping[str, Any] | None,
    mask_meaning: str,
    scale: str,
    errors: str,
    effort: Effort | str,
    is_whole: bool = False,
) -> AbstractFit:
    """Fit a shape; the arguments are those of `fit_cylinder`.

    With `is_whole` the mask is known to be of one surface, and the errors are what they
    are said to be.
    """
    effort = effort_of(effort)
    check_types(kind.shape, camera, initial)
    request = checked_request(
        kind.shape,
        kind.parameters,
        fixed,
        initial,
        mask_meaning,
        scale,
        errors,
        effort,
        sigma,
    )
    given = (depth, mask, camera, sigma, initial, prior)
    with working_precision(effort.precision, given) as converted:
        noise = checked_noise(sigma)
        beliefs = checked_prior(prior, kind.parameters, initial)
        image = checked_depth(depth, camera)
        camera, noise, initial, beliefs = converted((camera, noise, initial, beliefs))
        asked = (camera, noise, beliefs, request, effort)
        mask = checked_mask(mask, camera)
        if is_concrete((image, mask, initial, *asked[:3])):
            return _fit_concrete(kind, image, mask, initial, *asked, is_whole)
        if initial is None:
            raise ValueError(
                "initial must be given to a traced fit: the first guess runs outside "
                "JAX"
            )
        return _fit_traced(image, mask, kind.body.of(initial), *asked)


def _fit_concrete(
    kind: Fittable,
    depth: DepthImage,
    mask: Mask | None,
    initial: AbstractPrimitive | None,
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
    prior: Prior,
    request: Request,
    effort: Effort,
    is_whole: bool,
) -> AbstractFit:
    """Fit to a region, or to what of it is of one surface."""
    image, given = np.asarray(depth), None if mask is None else np.asarray(mask)
    region = object_region(image, given, camera, noise)
    warn_of_units(image, region, noise)

    def fitted(part: Bool[np.ndarray, "h w"], correlated: bool) -> AbstractFit:
        start = None if initial is None else kind.body.of(initial)
        shown = pixels_shown(image, part, camera, noise, effort.stride)
        asked = dataclasses.replace(
            request,
            correlated=correlated,
            # Only of the whole region the caller says that its edge is the silhouette.
            is_outline=request.is_outline and part is region,
        )
        return _fit_pixels(kind, shown, start, prior, asked, effort)

    if is_whole:
        return fitted(region, request.correlated)
    return fit_of_one_surface(
        fitted, kind.body, image, region, camera, noise, request.correlated
    )


def _fit_pixels(
    kind: Fittable,
    shown: tuple[Any, ...],
    initial: AbstractBody | None,
    prior: Prior,
    request: Request,
    effort: Effort,
) -> AbstractFit:
    """Fit from the start that is given, or from guesses.

    Args:
        kind: What is fitted.
        shown: As `pixels_shown` returns it.
        initial: In the world frame.
        prior: In the world frame.
        request: What is asked for.
        effort: How much work it takes.
    """
    image, region, _, _, camera, noise = shown
    tolerance = min(effort.tolerance, kind.most_tolerance)
    tolerance = jnp.asarray(tolerance, jnp.result_type(float))
    solved = quickly_compiled(solve, static_argnames="request")

    def from_one(body: AbstractBody) -> tuple[AbstractFit, Bool[Array, ""]]:
        start = Start.at(body, NUM_KEPT)
        return solved(*shown, start, prior, request, tolerance, is_far=True)

    if initial is not None:
        return from_one(initial)[0]
    guesses = kind.guesses(image, region, camera, typical_sigma(image, region, noise))
    if not guesses:
        return no_guess(kind, region)
    if not effort.all_starts:
        fit, explained = from_one(kind.body_at(guesses[0], camera))
        if effort.starts == 1 or bool(explained):
            return fit
    some = [*guesses, *guesses[:1] * effort.starts][: effort.starts]
    fields = {name: [guess[name] for guess in some] for name in guesses[0]}
    starts = kind.body_at(fields, camera)
    best = quickly_compiled(best_start, static_argnames="estimate_scale")(
        image,
        *some_pixels(region),
        *surroundings(region),
        camera,
        noise,
        starts,
        prior,
        request.estimate_scale,
    )
    return solved(*shown, best, prior, request, tolerance, is_far=False)[0]


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


def no_guess(kind: Fittable, region: Bool[np.ndarray, "h w"]) -> AbstractFit:
    """Result of a fit that could not start; its shape has no meaning."""
    example = kind.body_at(kind.example)
    nothing = jax.tree.map(jnp.zeros_like, example)
    if isinstance(example, RoundBody):
        nothing = eqx.tree_at(lambda b: b.axis, nothing, example.axis)
    one = jnp.eye(example.free_directions(()).shape[1], dtype=nothing.radius.dtype)
    std, covariance, observed, _ = deviations_of(
        example, one, jnp.zeros_like(one), one, jnp.ones(len(one), bool)
    )
    zero = nothing.radius
    return result_of(
        nothing,
        std=std,
        ends_seen=jnp.zeros(2, bool),
        covariance=covariance,
        observed=observed,
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
    request: Request,
    effort: Effort,
) -> AbstractFit:
    """Fit with sizes that do not depend on any value."""
    row, col = camera.frame.pixels()
    if mask is None:
        ray = camera.rays(row, col, depth.dtype)
        mask = in_camera_frame(initial.shape, camera).intersect(ray).mask
    region = jnp.asarray(mask)
    depth = without_edges(depth, region, noise)
    if effort.stride > 1:
        region &= (row % effort.stride == 0) & (col % effort.stride == 0)
    sees = camera.sees(row, col)
    if sees is not None:
        region &= sees
    size = bucket(min(region.size, TRACED_READINGS))
    rank = jnp.cumsum(region.reshape(-1))
    count = rank[-1]
    # The first pixel of each rank; ranks are spread out where there are too many.
    wanted = jnp.arange(size) * jnp.maximum(count, size) // size + 1
    index = jnp.searchsorted(rank, wanted, side="left").astype(wanted.dtype)
    row, col = jnp.divmod(jnp.where(wanted <= count, index, region.size), camera.width)
    shown = (depth, region, row, col, camera, noise)
    request = dataclasses.replace(request, is_traced=True)
    # The derivatives are those at the minimum: with a tolerance of 1 they err by 6 %.
    tolerance = jnp.asarray(min(effort.tolerance, STAGE_TOLERANCE), depth.dtype)
    start = Start.at(initial)
    return solve(*shown, start, prior, request, tolerance, is_far=True)[0]
