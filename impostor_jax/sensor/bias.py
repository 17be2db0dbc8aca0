"""What the readings of an image have in common: errors that no average takes away.

`sigma` is what each reading errs by on its own. Beside it real sensors mix readings at
edges, lean there, are off by a part of the depth, and by a field that is smooth over
many pixels. A noise model says of which kind and how large; draws follow it, and a fit
counts it in.
"""

__all__ = ["Bias", "Reach", "ScaleLaw", "is_none"]

import dataclasses
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from impostor_jax.numerics import Numbers, Scalar, safe_divide, safe_sqrt
from impostor_jax.sensor.fields import AbstractField

Reach = int | np.integer | Int[Array, ""]


class ScaleLaw(eqx.Module):
    """An error that all depths of an image share.

    Attributes:
        deviation: Standard deviation from image to image.
        mean: Over all images.
        law: As of `ScaleError`.
    """

    deviation: Scalar
    mean: Scalar
    law: str = eqx.field(static=True)

    def read(self, depth: Numbers, error: Float[Array, ""]) -> Numbers:
        """What is read of a depth, in meters; what is none stays."""
        if self.law == "scale":
            return depth * (1 + error)
        within = 1 + depth * error
        is_some = jnp.isfinite(depth) & (within > 0)
        return jnp.where(is_some, depth / jnp.where(is_some, within, 1), depth)

    def corrected(
        self, reading: Float[np.ndarray, "h w"] | Float[Array, "h w"]
    ) -> Float[np.ndarray, "h w"] | Float[Array, "h w"]:
        """Depth of a reading, in meters, without the mean error."""
        # On the host no program is made for an image's size.
        xp: Any = np if isinstance(reading, np.ndarray) else jnp
        mean = xp.asarray(self.mean, reading.dtype)
        if self.law == "scale":
            return reading / (1 + mean)
        within = 1 - reading * mean
        is_some = xp.isfinite(reading) & (within > 0)
        return xp.where(is_some, reading / xp.where(is_some, within, 1), 0)

    def shift(self, depth: Numbers) -> Numbers:
        """Change of a reading by one standard deviation, in meters."""
        deviation = jnp.asarray(self.deviation, depth.dtype)
        return deviation * (depth if self.law == "scale" else -depth * depth)


class Bias(eqx.Module):
    """Errors that readings share.

    Attributes:
        edge_reach: Pixels beside a jump in depth whose readings `sigma` does not speak
            for: one that lies no farther than this from another surface, counted along
            rows and columns, may be of that one, or of neither.
        window_reach: Pixels beside a jump in depth, an occluder or a hole whose
            readings are of their own surface, but all err to the same side.
        outline: Pixels by which a silhouette that the sensor shows may be off, all
            along.
        scales: Errors of all depths of an image.
        fields: Errors that are smooth over some pixels, or alike along lines.
        across: Standard deviation of a reading's place across its ray, along each of
            two directions, in meters; None where rays are exact.
        angle: The same of the ray's direction, in radians.
        lean: Standard deviation, in pixels, by which what is nearer reaches over what
            is farther, all over the image; None where it does not.
    """

    edge_reach: Reach = 0
    window_reach: Reach = 0
    outline: Reach = 0
    scales: tuple[ScaleLaw, ...] = ()
    fields: tuple[AbstractField, ...] = ()
    across: Scalar | None = None
    angle: Scalar | None = None
    lean: Scalar | None = None

    @staticmethod
    def of_rays(across: Scalar | None, angle: Scalar | None) -> "Bias":
        """Of a sensor whose readings share nothing; the arguments are attributes."""
        # It is asked for five times a fit, and takes 60 us to make.
        if across is None and angle is None:
            return EXACT
        return Bias(across=across, angle=angle)

    @property
    def has_exact_rays(self) -> bool:
        """Whether readings err along their rays alone; known before anything runs."""
        return self.across is None and self.angle is None

    @property
    def errs_at_edges(self) -> bool:
        """Whether it says how readings err at edges; known before anything runs."""
        return not (is_none(self.edge_reach) and is_none(self.window_reach))

    def across_at(self, reach: Numbers) -> Numbers:
        """Standard deviation across the ray at a distance along it, in meters."""
        across, angle = (
            jnp.asarray(0 if part is None else part, reach.dtype)
            for part in (self.across, self.angle)
        )
        return jnp.hypot(across, angle * reach)

    def score_covariance(
        self,
        score: Float[Array, "k n"],
        depth: Float[Array, " n"],
        row: Int[Array, " n"],
        col: Int[Array, " n"],
        middle: Float[Array, ""],
    ) -> Float[Array, "k k"]:
        """Covariance of sums over pixels of a score times the error of a reading.

        That is, of the smooth errors and of what errors of all depths add to a scale.

        Args:
            score: Per meter; 0 for what does not count.
            depth: Of the surface, in meters.
            row: Rows of the pixels.
            col: Columns of the pixels.
            middle: Depth at which all share a scale, in meters.
        """
        total = jnp.zeros((len(score), len(score)), score.dtype)
        for field in self.fields:
            total += field.score_covariance(score, depth, row, col)
        z = jnp.where(middle > 0, middle, 1)
        for law in self.scales:
            bent = law.shift(depth) - law.shift(z) / z * depth
            pull = jnp.sum(score * bent[None], axis=1)
            total += pull[:, None] * pull[None]
        return total

    def scale_pulls(
        self, score: Float[Array, "k n"], depth: Float[Array, " n"]
    ) -> Float[Array, "s k"]:
        """Sums over pixels of a score times a deviation of each error of all depths."""
        pulls = [jnp.sum(score * law.shift(depth)[None], axis=1) for law in self.scales]
        return jnp.stack(pulls) if pulls else jnp.zeros((0, len(score)), score.dtype)

    def lean_pull(
        self,
        score: Float[Array, "k n"],
        depth: Float[Array, " n"],
        cos_incidence: Float[Array, " n"],
        pixel: Float[Array, ""],
        radius: Float[Array, ""],
    ) -> Float[Array, " k"]:
        """Sum over pixels of a score times a deviation of what walls lean by.

        Args:
            score: Per meter; 0 for what does not count.
            depth: Of the surface, in meters.
            cos_incidence: Cosine between its normal and the ray.
            pixel: Distance of neighboring rays over the depth.
            radius: Of the surface, in meters.
        """
        if self.lean is None:
            return jnp.zeros(len(score), score.dtype)
        lean = jnp.asarray(self.lean, depth.dtype)
        counts = jnp.any(score != 0, axis=0)
        cosine = jnp.where(counts, cos_incidence, 1)
        sine = safe_sqrt(1 - cosine * cosine)
        outward = lean * pixel * jnp.where(counts, depth, 0) * sine
        # By e / cos, and less where that bends: a circle that is larger by e.
        bent = safe_sqrt(cosine * cosine + 2 * outward / radius)
        nearer = safe_divide(2 * outward, cosine + bent)
        return -jnp.sum(score * nearer[None], axis=1)

    @property
    def without_scales(self) -> "Bias":
        """The same but for errors of all depths."""
        return dataclasses.replace(self, scales=())

    def scale_at(self, depth: Float[Array, ""]) -> Float[Array, ""]:
        """Standard deviation of what depths around one share, relative to that."""
        z = jnp.where(depth > 0, depth, 1)
        squares = [(law.shift(z) / z) ** 2 for law in self.scales]
        return safe_sqrt(sum(squares, start=jnp.zeros_like(z)))


EXACT = Bias()
"""Of readings that err on their own, along their rays."""


def is_none(reach: Reach) -> bool:
    """Whether a reach is known to be 0 before anything runs."""
    return isinstance(reach, int) and reach == 0
