"""What a fit returns."""

__all__ = [
    "AbstractFit",
    "Deviations",
    "Directions",
    "FitResult",
    "FitStatus",
    "FrustumDeviations",
    "FrustumFit",
    "SphereDeviations",
    "SphereFit",
    "TaperTest",
]

import abc
import enum
from collections import Counter
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from impostor_jax.fit.text import (
    cylinder_rows,
    frustum_rows,
    millimeters,
    sphere_rows,
)
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.text import described, text_or_repr


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
    FitStatus.NO_FIRST_GUESS: "No shape lies near the readings: no first guess.",
    FitStatus.POOR_FIT: "The readings do not lie on the fitted shape.",
    FitStatus.UNDETERMINED: "The readings do not determine radius and place.",
    FitStatus.NOT_FINITE: "The solver met a number that is not finite.",
}

NOTED_TIMES = 3.0
"""Noises from which the size of residuals is the reason of a poor fit."""

DISAGREEING = 50.0
"""Contradiction between border and rest, of 7 degrees of freedom in a cylinder, from
which something else is taken to lie at the border: by chance once in 1e8 fits."""

AGREEING = 20.0
"""Contradiction between border and rest below which nothing else lies there, once it
has been found to: by chance one in 200 is larger, and costs no more than some readings.
"""

STATUSES = tuple(FitStatus)
"""Order of the integer codes in which a compiled fit carries its status."""


class Deviations(eqx.Module):
    """Standard deviations of a cylinder; `inf` where undetermined, 0 where held.

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

    def __str__(self) -> str:
        return text_or_repr(self, lambda: described(self, {"axis": "rad"}))


class FrustumDeviations(eqx.Module):
    """Standard deviations of a frustum; `inf` where undetermined, 0 where held.

    Attributes:
        p1: Along x, y and z of the world, in meters; all undetermined where the end is
            not seen.
        p2: The same of the other end.
        across_axis: Of the midpoint along the two vectors of `tangent_basis(axis)`, in
            meters; determined even where the ends are not.
        axis: Along the same two vectors, in radians.
        radius1: In meters.
        radius2: In meters.
        height: In meters.
    """

    p1: Float[Array, "*batch 3"]
    p2: Float[Array, "*batch 3"]
    across_axis: Float[Array, "*batch 2"]
    axis: Float[Array, "*batch 2"]
    radius1: Float[Array, "*batch"]
    radius2: Float[Array, "*batch"]
    height: Float[Array, "*batch"]

    def __str__(self) -> str:
        return text_or_repr(self, lambda: described(self, {"axis": "rad"}))


class SphereDeviations(eqx.Module):
    """Standard deviations of a sphere; 0 where held.

    Attributes:
        center: Along x, y and z of the world, in meters.
        radius: In meters.
    """

    center: Float[Array, "*batch 3"]
    radius: Float[Array, "*batch"]

    def __str__(self) -> str:
        return text_or_repr(self, lambda: described(self, {}))


class Directions(eqx.Module):
    """What an image determines: the principal directions of the estimate's error.

    Attributes:
        coordinates: Whether each coordinate of the covariance is determined.
        vector: One direction a row, the least certain first, in these coordinates, with
            angles times half the shape's size, so that all are motions of its surface
            in meters; of unit length.
        deviation: Standard deviation along each, in meters; `inf` where the image
            leaves it free. Of a cylinder, a slide along the axis has its weight in
            `center_along` and `height`, radius against distance in `radius` and
            `center_first` or `center_second`.
    """

    coordinates: Bool[Array, "*batch m"]
    vector: Float[Array, "*batch m m"]
    deviation: Float[Array, "*batch m"]


class AbstractFit(eqx.Module):
    """What every fit says; read `success` and `status` first.

    Attributes:
        std: One standard deviation of each parameter, from `covariance`; all `inf`
            where the fit failed.
        covariance: Of the shape's coordinates, in meters and radians; widened where the
            residuals are larger than `sigma` says. `inf` on the diagonal where
            undetermined, and 0 beside it; 0 where held.
        observed: Which directions the image determines.
        success: Whether the fit converged to a shape that explains the readings.
        status_code: Position of `status` in `FitStatus`; the form that can be traced.
        num_steps: Steps of the solver.
        num_starts: Starts that were tried.
        num_agreeing: Those among them that led to the same shape, the best included.
        residual: Reading less depth of the surface in meters, for each pixel that was
            used; 0 elsewhere.
        inliers: Pixels that were used and lie on the fitted shape.
        region: Pixels that were used: of the mask, or of the object that was taken
            where none was given, those with a reading that is of the shape's surface.
        num_pixels: Number of pixels that were used.
        rms: Root mean square of the inliers' residuals, in meters.
        chi2: Mean square of the inliers' residuals, in deviations of the noise: 1 where
            that is right.
        p_value: Probability of a larger `chi2` if the noise is what `sigma` says and no
            two readings share an error, to a normal approximation; NaN where no `sigma`
            was given. Of thousands of readings it tells a noise that is 5 percent too
            large, so the status goes by `chi2`.
        border_chi2: Chi-squared, of as many degrees of freedom as there are
            coordinates or less, by which readings beside the region's border contradict
            the others; `inf` where many of them lie elsewhere.
    """

    std: eqx.AbstractVar[Any]
    covariance: Float[Array, "*batch m m"]
    observed: Directions
    success: Bool[Array, "*batch"]
    status_code: Int[Array, "*batch"]
    num_steps: Int[Array, "*batch"]
    num_starts: Int[Array, "*batch"]
    num_agreeing: Int[Array, "*batch"]
    residual: Float[Array, "*batch h w"]
    inliers: Bool[Array, "*batch h w"]
    region: Bool[Array, "*batch h w"]
    num_pixels: Int[Array, "*batch"]
    rms: Float[Array, "*batch"]
    chi2: Float[Array, "*batch"]
    p_value: Float[Array, "*batch"]
    border_chi2: Float[Array, "*batch"]

    @property
    def status(self) -> FitStatus:
        """How the fit ended; needs a single, concrete result."""
        return STATUSES[int(self.status_code)]

    @property
    def reason(self) -> str:
        """What is behind `status`, in words; needs a single, concrete result."""
        if self.status is not FitStatus.POOR_FIT:
            return self.status.meaning
        times = float(np.sqrt(self.chi2))
        if times >= NOTED_TIMES and not np.isnan(self.p_value):
            return (
                f"The residuals are {times:.1f} times the noise given: the shape or "
                "sigma is wrong."
            )
        if 2 * int(np.count_nonzero(self.inliers)) < int(self.num_pixels):
            return "Most readings lie off the shape."
        if self.border_chi2 >= AGREEING:
            return (
                "Readings beside the region's border contradict the others: the mask "
                "is too large, or errors are correlated."
            )
        return "Part of the region lies off the shape: it, or the mask, is wrong."

    def failed(self, status: FitStatus) -> "AbstractFit":
        """The same estimate as a failure, with infinite deviations."""
        return eqx.tree_at(
            lambda fit: (fit.success, fit.status_code, fit.std),
            self,
            (
                jnp.zeros_like(self.success),
                jnp.full_like(self.status_code, STATUSES.index(status)),
                jax.tree.map(lambda x: jnp.full_like(x, jnp.inf), self.std),
            ),
        )

    @property
    @abc.abstractmethod
    def shape(self) -> AbstractPrimitive:
        """The estimate, whatever is fitted, in the world frame."""

    @property
    @abc.abstractmethod
    def rows(self) -> list[str]:
        """Lines of the estimate and its deviations; of a single, concrete fit."""

    @property
    @abc.abstractmethod
    def notes(self) -> list[str]:
        """Lines of what else there is to say."""

    def summary(self, seconds: float | None = None) -> str:
        """A few lines for a reader; lengths in millimeters, angles in degrees.

        Args:
            seconds: Time that the fit took; left out if None.
        """
        time = "" if seconds is None else f", {seconds:.2f} s"
        head = (
            f"{self.status}: {self.reason} {int(self.num_steps)} steps, "
            f"{int(self.num_agreeing)} of {int(self.num_starts)} starts agree, "
            f"{int(self.num_pixels)} pixels{time}"
        )
        if not bool(self.success):
            return head
        rms = (
            f"  rms     {millimeters(self.rms)} mm over "
            f"{int(np.count_nonzero(self.inliers))} inliers, chi-squared "
            f"{float(self.chi2):.2f}"
        )
        return "\n".join([head, *self.rows, rms, *self.notes])

    def __str__(self) -> str:
        return text_or_repr(self, self._text)

    def _text(self) -> str:
        codes = np.asarray(self.status_code)
        if codes.ndim == 0:
            return self.summary()
        count = Counter(str(STATUSES[int(code)]) for code in codes.ravel())
        found = ", ".join(f"{number} {status}" for status, number in count.items())
        return f"{codes.size} fits: {found}"


class FrustumFit(AbstractFit):
    """A fitted frustum, and what `AbstractFit` lists.

    Attributes:
        frustum: The estimate, in the world frame. The end p1 is that of `initial`, or,
            without one, such that the largest component of the axis from p1 to p2 is
            positive. Where an end is not seen, it is put where the wall was last seen,
            and its radius is the wall's there.
        std: One standard deviation of each parameter, from `covariance`; all `inf`
            where the fit failed.
        ends_seen: Whether the image shows p1 and p2.
    """

    frustum: Frustum
    std: FrustumDeviations
    ends_seen: Bool[Array, "*batch 2"]

    @property
    @override
    def shape(self) -> Frustum:
        return self.frustum

    @property
    @override
    def rows(self) -> list[str]:
        return frustum_rows(self.frustum, self.std)

    @property
    @override
    def notes(self) -> list[str]:
        if bool(self.ends_seen.all()):
            return []
        across = millimeters(self.std.across_axis)
        return [
            "  An end is not seen: it is put where the wall was last seen; across the "
            f"axis the middle's std is {across} mm."
        ]


class SphereFit(AbstractFit):
    """A fitted sphere, and what `AbstractFit` lists.

    Attributes:
        sphere: The estimate, in the world frame.
        std: One standard deviation of each parameter, from `covariance`; all `inf`
            where the fit failed.
    """

    sphere: Sphere
    std: SphereDeviations

    @property
    @override
    def shape(self) -> Sphere:
        return self.sphere

    @property
    @override
    def rows(self) -> list[str]:
        return sphere_rows(self.sphere, self.std)

    @property
    @override
    def notes(self) -> list[str]:
        return []


class TaperTest(eqx.Module):
    """Test of a cylinder, a frustum without taper, against a frustum.

    Attributes:
        frustum: Fit of the frustum.
        statistic: Twice the logarithm of the likelihood ratio, in the scale of the
            frustum's residuals; of a cylinder it is chi-squared with one degree of
            freedom.
        p_value: Probability that a cylinder's noise gives as much; NaN where the
            frustum's fit failed.
    """

    frustum: FrustumFit
    statistic: Float[Array, "*batch"]
    p_value: Float[Array, "*batch"]

    def is_needed(self, level: float = 0.01) -> Bool[Array, "*batch"]:
        """Whether the readings reject a cylinder.

        Args:
            level: Share of cylinders that are taken for frusta.
        """
        return self.p_value < level

    def __str__(self) -> str:
        return text_or_repr(self, self._text)

    def _text(self) -> str:
        found = self.frustum
        if not bool(found.success):
            return f"  taper   not tested: the frustum's fit ended as {found.status}"
        ends = found.frustum.radius1, found.frustum.radius2
        radius1, radius2 = map(millimeters, ends)
        answer = "needed" if bool(self.is_needed()) else "not needed"
        return (
            f"  taper   {answer}: radius {radius1} to {radius2} mm along the axis, "
            f"likelihood ratio {float(self.statistic):.2f}, p-value "
            f"{float(self.p_value):.2g}"
        )


class FitResult(AbstractFit):
    """A fitted cylinder, and what `AbstractFit` lists.

    Attributes:
        cylinder: The estimate, in the world frame. The axis is signed so that its
            largest component is positive. Where an end is not seen, the height is the
            visible extent and the center the middle of it.
        std: One standard deviation of each parameter, from `covariance`; all `inf`
            where the fit failed.
        ends_seen: Whether the image shows the ends at center - axis * height / 2 and at
            center + axis * height / 2.
        taper: Whether a frustum is needed; None unless that was asked.
    """

    cylinder: Cylinder
    std: Deviations
    ends_seen: Bool[Array, "*batch 2"]
    taper: TaperTest | None = None

    @property
    @override
    def shape(self) -> Cylinder:
        return self.cylinder

    @property
    @override
    def rows(self) -> list[str]:
        return cylinder_rows(self.cylinder, self.std)

    @property
    @override
    def notes(self) -> list[str]:
        notes = [] if self.taper is None else [str(self.taper)]
        if not self.height_observed:
            across = millimeters(self.std.across_axis)
            notes.append(
                "  An end is not seen: height is the visible extent, center its "
                f"middle; across the axis the center's std is {across} mm."
            )
        return notes

    @property
    def height_observed(self) -> bool:
        """Whether both ends are seen; needs a single, concrete result."""
        return bool(self.ends_seen.all())
