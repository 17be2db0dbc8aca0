"""What the fit of one image says of a cylinder, as a filter takes it.

A fit's errors are of two kinds. Those of readings are its own, and average away from
image to image. Others it shares with the fits of the images before: the sensor's scale,
its smooth errors, walls that lean, and pixels, at which a still outline lies alike.
"""

__all__ = ["COORDINATES", "SHARED", "Measured", "basis_of"]

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.fit.budget import BUDGET
from impostor_jax.fit.result import Fit

COORDINATES = (
    "axis_first",
    "axis_second",
    "center_first",
    "center_second",
    "center_along",
    "radius",
    "height",
)
"""Of a fit's covariance, in its order; of the basis (first, second, along)."""

NAMES = ("axis", "across_axis", "along_axis", "radius", "height")
"""Of the same in a budget, in this order."""

SHARED = ("warp", "alignment", "outline")
"""Parts of a budget that neighboring images share, beside the scale."""

PART = 0.2
"""Of what is an image's own, as large a part do the fits of all images share: that by
which the estimate is off on average. Of 16 cans, of which each was fitted to 38 images
with new noise, the mean errors were 0.2 standard deviations of one fit (root mean
square)."""

LEAST = 1e-6
"""Smallest eigenvalue that a correlation matrix is taken to have: single precision."""


@dataclasses.dataclass(frozen=True)
class Measured:
    """A cylinder as an image shows it, with an axis of a given sign.

    Attributes:
        center: (3,), in the world frame, in meters, as the next but one.
        axis: Unit vector; it has the sign of the axis that was expected.
        radius: Of the wall.
        height: From end to end; of what is not seen whole, the visible extent.
        basis: First and second vector across the axis, then the axis, one a row.
        own: Covariance of what is this image's own, in `COORDINATES`.
        shared: What one standard deviation of each error that images share does to
            these; the scale's is the first column.
        is_known: Which of them the image determines.
        end: The only end that is seen, -1 or 1 times half the axis from the center; 0
            where both are, or none.
        end_std: Standard deviation of its place along the axis, in meters.
    """

    center: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    radius: float
    height: float
    basis: Float[np.ndarray, "3 3"]
    own: Float[np.ndarray, "7 7"]
    shared: Float[np.ndarray, "7 k"]
    is_known: Bool[np.ndarray, "7"]
    end: int
    end_std: float

    @staticmethod
    def of(
        fit: Fit,
        camera_center: Float[np.ndarray, "3"],
        pixel: float,
        axis: Float[np.ndarray, "3"] | None = None,
    ) -> "Measured":
        """What a successful fit of one image says.

        Args:
            fit: Of a cylinder.
            camera_center: Place of the camera in the world, in meters.
            pixel: Distance of neighboring rays at a distance of 1 m, in meters.
            axis: What is expected, in the world; a fit's axis has no sign of its own.
        """
        shape = fit.cylinder
        center, told = np.asarray(shape.center, float), np.asarray(shape.axis, float)
        told = told / np.linalg.norm(told)
        radius, height = float(shape.radius), float(shape.height)
        is_known = np.asarray(fit.observed.coordinates)
        parts = _by_coordinate(fit)
        own = np.sqrt(
            sum(
                parts[name] ** 2
                for name in BUDGET
                if name not in SHARED and name != "scale"
            )
        )
        shares = np.hypot.reduce([PART * own, *(parts[name] for name in SHARED)])
        basis = np.vstack([basis_of(told), told])
        full = np.where(np.outer(is_known, is_known), np.asarray(fit.covariance), 0)
        full = full.astype(float)
        offset = center - camera_center
        # As large as the radius is unsure by it.
        larger = parts["scale"][5] / radius
        pull = larger * np.concatenate([[0, 0], basis @ offset, [radius, height]])
        scale = _root_of_scale(full, parts["scale"], pull, is_known)
        related = _correlation(full - np.outer(scale, scale), is_known)
        ends = np.asarray(fit.ends_seen)
        turned = 1.0 if axis is None or told @ axis >= 0 else -1.0
        turn = _turn(told, turned)
        both = np.outer(own, own) * related
        others = shares[:, None] * np.linalg.cholesky(related)
        return Measured(
            center=center,
            axis=turned * told,
            radius=radius,
            height=height,
            basis=np.vstack([basis_of(turned * told), turned * told]),
            own=turn @ both @ turn.T,
            shared=turn @ np.column_stack([scale, others]),
            is_known=is_known,
            end=int(turned) * (int(ends[1]) - int(ends[0])),
            end_std=pixel * float(np.linalg.norm(offset)),
        )


def basis_of(axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2 3"]:
    """As `tangent_basis`, whose vectors a fit's covariance is along."""
    x, y, z = axis
    sign = -1.0 if z < 0 else 1.0
    a = -1 / (sign + z)
    b = x * y * a
    return np.array(
        [[1 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y]]
    )


def _by_coordinate(fit: Fit) -> dict[str, Float[np.ndarray, "7"]]:
    """Each part of a budget in the coordinates; 0 where those are not determined."""
    names = fit.std_budget.names
    place = [k for name in NAMES for k, one in enumerate(names) if one == name]
    parts = np.asarray(fit.std_budget.parts, float)[:, place]
    return dict(zip(BUDGET, np.where(np.isfinite(parts), parts, 0), strict=True))


def _root_of_scale(
    full: Float[np.ndarray, "7 7"],
    deviation: Float[np.ndarray, "7"],
    pull: Float[np.ndarray, "7"],
    is_known: Bool[np.ndarray, "7"],
) -> Float[np.ndarray, "7"]:
    """What one standard deviation of the scale does to the coordinates.

    Their own are in the budget; which of them go together, the covariance tells, where
    the scale is most of it. What is not determined goes as all that is larger.
    """
    if not pull.any():
        return pull
    variance = np.where(is_known, np.diagonal(full), 1)
    first = int(np.argmax(np.where(is_known, deviation**2 / variance, -1)))
    sign = np.sign(full[first]) * np.sign(pull[first] or 1)
    return np.where(is_known, deviation * sign, pull)


def _correlation(
    covariance: Float[np.ndarray, "7 7"], is_known: Bool[np.ndarray, "7"]
) -> Float[np.ndarray, "7 7"]:
    """Correlation matrix; what is not determined correlates with nothing."""
    variance = np.diagonal(covariance)
    is_some = is_known & (variance > 0)
    size = np.where(is_some, 1 / np.sqrt(np.where(is_some, variance, 1)), 0)
    related = covariance * np.outer(size, size)
    related[np.diag_indices(7)] = 1
    values, vectors = np.linalg.eigh(related)
    if values[0] >= LEAST:
        return related
    positive = (vectors * np.maximum(values, LEAST)) @ vectors.T
    size = 1 / np.sqrt(np.diagonal(positive))
    return positive * np.outer(size, size)


def _turn(axis: Float[np.ndarray, "3"], sign: float) -> Float[np.ndarray, "7 7"]:
    """From the coordinates of an axis to those of the same with another sign."""
    turn = np.eye(7)
    if sign < 0:
        across: Any = basis_of(-axis) @ basis_of(axis).T
        turn[:2, :2], turn[2:4, 2:4], turn[4, 4] = -across, across, -1
    return turn
