"""Shapes that can be fitted: what the way that is the same for all needs of each."""

__all__ = [
    "BOX",
    "CYLINDER",
    "FRUSTUM",
    "KINDS",
    "SPHERE",
    "TUBE",
    "Fittable",
    "no_guess",
]

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.camera.ray_table import Sight
from impostor_jax.fit.across import exact_rays
from impostor_jax.fit.alternatives import no_alternatives
from impostor_jax.fit.body import AbstractBody, coordinates_of
from impostor_jax.fit.box_body import BoxBody
from impostor_jax.fit.budget import BUDGET, Budget, Deviations
from impostor_jax.fit.floor import floor_pixels
from impostor_jax.fit.form import no_form
from impostor_jax.fit.guess_box import guess_boxes
from impostor_jax.fit.guess_round import guess_cylinders, guess_frusta
from impostor_jax.fit.guess_sphere import guess_spheres
from impostor_jax.fit.guess_tube import closed, guess_tubes
from impostor_jax.fit.mouth import mouth_pixels
from impostor_jax.fit.pixelwise import Pixelwise
from impostor_jax.fit.result import Directions, Fit
from impostor_jax.fit.round_body import RoundBody
from impostor_jax.fit.rounds import Guess
from impostor_jax.fit.solve import STAGE_TOLERANCE
from impostor_jax.fit.sphere_body import SphereBody
from impostor_jax.fit.status import STATUSES, FitStatus
from impostor_jax.fit.surface import Samples, samples_of
from impostor_jax.fit.tube_body import TubeBody
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.solid import Solid
from impostor_jax.primitives.sphere import Sphere


@dataclasses.dataclass(frozen=True, eq=False)
class Fittable:
    """A shape that can be fitted.

    Attributes:
        shape: Its primitive.
        body: As a fit moves it.
        guess: Makes first guesses from what is looked at of a region, the likeliest
            first.
        parameters: Names of what a caller may hold or expect.
        nothing: Fields of a body without a size.
        most_tolerance: Largest tolerance of an `Effort` that ends its fits.
        closed: Of a shape with a bore, what it is without, where none is seen.
        foreign: Which pixels of a region are not of the shape, by its estimate, as
            those of a bore's floor or of what an open end shows; None where it looks
            for none.
        most_of_face: Part of an image that one of its plane faces takes at most, where
            no mask tells: a table that is seen as a whole takes more. 0 of what has
            none.
    """

    shape: type[AbstractPrimitive]
    body: type[AbstractBody]
    guess: Callable[[Samples], list[Guess]]
    parameters: tuple[str, ...]
    nothing: dict[str, Any]
    most_tolerance: float = np.inf
    closed: Callable[[Any], Any] | None = None
    foreign: Callable[..., Bool[np.ndarray, "h w"]] | None = None
    most_of_face: float = 0.0

    @property
    def expectable(self) -> tuple[str, ...]:
        """Names of what a prior may be of."""
        return tuple(name for name in self.parameters if name != "rotation")

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Of its covariance."""
        # Known without a device.
        return coordinates_of(jax.eval_shape(lambda: self.blank))

    @property
    def blank(self) -> AbstractBody:
        """A body without a size, that says what is true of all."""
        dtype = np.dtype(jnp.result_type(float))
        arrays = {name: np.asarray(x, dtype) for name, x in self.nothing.items()}
        # All at once: a fifth of the time that they take one by one.
        return self.body(**jax.device_put(arrays))

    def guesses(
        self,
        depth: Float[np.ndarray, "h w"],
        region: Bool[np.ndarray, "h w"],
        camera: Sight,
        sigma: float,
    ) -> list[Any]:
        """First guesses from a region's readings; none where these admit none.

        Args:
            depth: As in `samples_of`, like the others.
            region: Pixels of the object.
            camera: Concrete.
            sigma: Typical standard deviation of a reading, in meters.
        """
        # What is not there is NaN on the way.
        with np.errstate(all="ignore"):
            samples = samples_of(depth, region, camera, sigma)
            found = [] if samples is None else self.guess(samples)
        dtype = np.dtype(jnp.result_type(float))
        names, structure = self._fields
        return [
            jax.tree.unflatten(structure, [np.asarray(one[x], dtype) for x in names])
            for one in found
        ]

    @functools.cached_property
    def _fields(self) -> tuple[list[str], Any]:
        """Names of a body's fields in its tree, and that tree's structure."""
        names = [field.name for field in dataclasses.fields(self.body)]
        own = [name for name in names if name in self.nothing]
        return own, jax.tree.structure(self.blank)


CYLINDER = Fittable(
    shape=Cylinder,
    body=RoundBody,
    guess=guess_cylinders,
    parameters=("center", "axis", "radius", "height"),
    nothing={"center": (0, 0, 0), "axis": (0, 0, 1), "radius": 0, "height": 0},
    foreign=mouth_pixels,
)
FRUSTUM = Fittable(
    shape=Frustum,
    body=RoundBody,
    guess=guess_frusta,
    parameters=("center", "axis", "radius1", "radius2", "height"),
    nothing=CYLINDER.nothing | {"growth": 0},
    # A taper settles slowly: with five times it 1 of 200 cups at 3 mm of noise ended 20
    # standard deviations away.
    most_tolerance=STAGE_TOLERANCE,
    foreign=mouth_pixels,
    most_of_face=0.1,
)
SPHERE = Fittable(
    shape=Sphere,
    body=SphereBody,
    guess=guess_spheres,
    parameters=("center", "radius"),
    nothing={"center": (0, 0, 0), "radius": 0},
)
TUBE = Fittable(
    shape=Solid,
    body=TubeBody,
    guess=guess_tubes,
    parameters=("center", "axis", "outer_radius", "inner_radius", "height"),
    nothing=CYLINDER.nothing | {"inner_radius": 0},
    closed=closed,
    foreign=floor_pixels,
    most_of_face=0.1,
)
BOX = Fittable(
    shape=Box,
    body=BoxBody,
    guess=guess_boxes,
    parameters=("center", "rotation", "size"),
    nothing={"center": (0, 0, 0), "frame": np.eye(3), "half": (0, 0, 0)},
    most_of_face=1.0,
)
KINDS = {kind.shape: kind for kind in (BOX, CYLINDER, FRUSTUM, SPHERE, TUBE)}
"""What can be fitted, by its primitive."""


def no_guess(kind: Fittable, *regions: Bool[np.ndarray, "..."]) -> Fit:
    """Result of a fit that could not start; its shape has no meaning.

    Args:
        kind: What was fitted.
        regions: Pixels of the object, of one image or each of several.
    """
    counts = [np.count_nonzero(region) for region in regions]
    nothing = kind.blank
    names, zero = coordinates_of(nothing), nothing.radius
    seen = jnp.zeros(len(nothing.ends), bool)
    read = jax.eval_shape(nothing.readout, nothing, seen)
    unknown = Deviations.of(
        {name: np.full(part.shape, np.inf, part.dtype) for name, part in read.items()}
    )
    infinite = np.diag(np.full(len(names), np.inf, zero.dtype))
    return Fit(
        shape=nothing.shape,
        std=unknown,
        std_budget=Budget(jnp.tile(unknown.vector, (len(BUDGET), 1)), unknown.names),
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
        pixelwise=tuple(Pixelwise.of_region(x, zero.dtype) for x in regions),
        num_pixels=jnp.array(sum(counts)),
        rms=jnp.full_like(zero, jnp.inf),
        chi2=jnp.full_like(zero, jnp.inf),
        tail=jnp.full_like(zero, -1),
        border_chi2=zero,
        alternatives=no_alternatives(nothing.shape),
        across=exact_rays(zero.dtype),
        form=no_form(zero.dtype),
    )
