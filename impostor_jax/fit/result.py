"""What a fit returns."""

__all__ = ["Deviations", "Directions", "FitResult", "FitStatus"]

import enum

import equinox as eqx
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.primitives.cylinder import Cylinder


class FitStatus(enum.StrEnum):
    """How a fit ended; only CONVERGED is a success."""

    CONVERGED = "converged"
    STEP_LIMIT = "step_limit"
    NO_FIRST_GUESS = "no_first_guess"
    POOR_FIT = "poor_fit"
    UNDETERMINED = "undetermined"
    NOT_FINITE = "not_finite"

    @property
    def meaning(self) -> str:
        """One sentence for a reader."""
        return _MEANINGS[self]


_MEANINGS = {
    FitStatus.CONVERGED: "The fit converged.",
    FitStatus.STEP_LIMIT: "The solver reached its step limit before it converged.",
    FitStatus.NO_FIRST_GUESS: "No cylinder lies near the readings: no first guess.",
    FitStatus.POOR_FIT: "The readings do not lie on the fitted cylinder.",
    FitStatus.UNDETERMINED: "The readings do not determine the radius and the axis.",
    FitStatus.NOT_FINITE: "The solver met a number that is not finite.",
}

STATUSES = tuple(FitStatus)
"""Order of the integer codes in which a compiled fit carries its status."""


class Deviations(eqx.Module):
    """Standard deviations of the estimate; `inf` where undetermined, 0 where held.

    Attributes:
        center: Along x, y and z of the world, in meters. Where an end is not seen, the
            center is free along the axis, so every direction that the axis has a part
            in is undetermined.
        across_axis: Of the center along the two vectors of `tangent_basis(axis)`, in
            meters; determined even where the ends are not.
        axis: Along the same two vectors, in radians.
        radius: In meters.
        height: In meters.
    """

    center: Float[Array, "*batch 3"]
    across_axis: Float[Array, "*batch 2"]
    axis: Float[Array, "*batch 2"]
    radius: Float[Array, "*batch"]
    height: Float[Array, "*batch"]


class Directions(eqx.Module):
    """What an image determines: the principal directions of the estimate's error.

    Attributes:
        coordinates: Whether each of `COORDINATES` is determined.
        vector: One direction a row, the least certain first, in `COORDINATES`, with
            angles times half the cylinder's size, so that all are motions of its
            surface in meters; of unit length.
        deviation: Standard deviation along each, in meters; `inf` where the image
            leaves it free. A slide along the axis has its weight in `center_along` and
            `height`, radius against distance in `radius` and `center_first` or
            `center_second`.
    """

    coordinates: Bool[Array, "*batch 7"]
    vector: Float[Array, "*batch 7 7"]
    deviation: Float[Array, "*batch 7"]


class FitResult(eqx.Module):
    """A fitted cylinder; read `success` and `status` first.

    Attributes:
        cylinder: The estimate, in the world frame. The axis is signed so that its
            largest component is positive. Where an end is not seen, the height is the
            visible extent and the center the middle of it.
        std: One standard deviation of each parameter, from `covariance`; all `inf`
            where the fit failed.
        covariance: (7, 7), of `COORDINATES`, in meters and radians; widened where the
            residuals are larger than `sigma` says. `inf` on the diagonal where
            undetermined, and 0 beside it; 0 where held.
        observed: Which directions the image determines.
        success: Whether the fit converged to a cylinder that explains the readings.
        status_code: Position of `status` in `FitStatus`; the form that can be traced.
        num_steps: Steps of the solver.
        num_starts: Starts that were tried.
        num_agreeing: Those among them that led to the same cylinder, the best included.
        residual: Reading less depth of the surface in meters, for each pixel that was
            used; 0 elsewhere.
        inliers: Pixels that were used and lie on the fitted cylinder.
        region: Pixels that were used: the mask's, or those of the object that was taken
            where no mask was given.
        ends_seen: Whether the image shows the ends at center - axis * height / 2 and at
            center + axis * height / 2.
        num_pixels: Number of pixels that were used.
        rms: Root mean square of the inliers' residuals, in meters.
    """

    cylinder: Cylinder
    std: Deviations
    covariance: Float[Array, "*batch 7 7"]
    observed: Directions
    success: Bool[Array, "*batch"]
    status_code: Int[Array, "*batch"]
    num_steps: Int[Array, "*batch"]
    num_starts: Int[Array, "*batch"]
    num_agreeing: Int[Array, "*batch"]
    residual: Float[Array, "*batch h w"]
    inliers: Bool[Array, "*batch h w"]
    region: Bool[Array, "*batch h w"]
    ends_seen: Bool[Array, "*batch 2"]
    num_pixels: Int[Array, "*batch"]
    rms: Float[Array, "*batch"]

    @property
    def status(self) -> FitStatus:
        """How the fit ended; needs a single, concrete result."""
        return STATUSES[int(self.status_code)]

    @property
    def height_observed(self) -> bool:
        """Whether both ends are seen; needs a single, concrete result."""
        return bool(self.ends_seen.all())
