"""What a fit tells of each reading, and images of it, which are made when asked for."""

__all__ = ["Image", "Pixelwise", "alike"]

import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Int8, Shaped

from impostor_jax.arguments import is_concrete

Values = Shaped[Array, "*batch n"] | Shaped[np.ndarray, "*batch n"]
Image = Shaped[Array, "*image"] | Shaped[np.ndarray, "*image"]


class Pixelwise(eqx.Module):
    """What a fit tells of the readings of an image, or of points.

    Attributes:
        residual: Reading less depth of the surface in meters; 0 of what was not used.
        marks: 2 of those on the shape, 1 of others that were used, 0 of the rest.
        place: Where each is in the image, row by row; what only fills up lies beyond.
        shape: Of the image.
    """

    residual: Float[Array, "*batch n"] | Float[np.ndarray, "*batch n"]
    marks: Int8[Array, "*batch n"] | Int8[np.ndarray, "*batch n"]
    place: Int[Array, "*batch n"] | Int[np.ndarray, "*batch n"]
    shape: tuple[int, ...] = eqx.field(static=True)

    @staticmethod
    def of_region(region: Bool[np.ndarray, "*image"], dtype: np.dtype) -> "Pixelwise":
        """Of pixels that no fit says more of than that they were to be used."""
        (place,) = np.nonzero(region.ravel())
        blank = np.zeros(place.shape, dtype)
        return Pixelwise(
            blank, np.ones(place.shape, np.int8), place.astype(np.int32), region.shape
        )

    @staticmethod
    def of_points(
        parts: Sequence["Pixelwise"], places: Sequence[Int[np.ndarray, " _"]]
    ) -> "Pixelwise":
        """Of points that were fitted as images of one row.

        Args:
            parts: Of the images.
            places: Which points the first pixels of each are; all together are those
                that there are.
        """
        count = sum(map(len, places))
        found = []
        for part, own in zip(parts, places, strict=True):
            # All that only fills up lies behind the points.
            at = np.minimum(np.asarray(part.place), len(own))
            found.append(np.append(own, count)[at])
        residual, marks = (
            np.concatenate([np.asarray(getattr(part, name)) for part in parts])
            for name in ("residual", "marks")
        )
        place = np.concatenate(found).astype(np.int32)
        return Pixelwise(residual, marks, place, (count,))

    def image(self, values: Values) -> Image:
        """An image of what is told of each reading; 0 elsewhere."""
        size = math.prod(self.shape)
        batch = self.place.shape[:-1]
        if is_concrete((self.place, values)):
            # A place beyond the image is one behind it, which is dropped.
            full = np.zeros((*batch, size + 1), values.dtype)
            place = np.minimum(np.asarray(self.place), size)
            np.put_along_axis(full, place, np.asarray(values), axis=-1)
            return full[..., :size].reshape(*batch, *self.shape)

        def placed(place: Values, values: Values) -> Array:
            blank = jnp.zeros(size, values.dtype)
            return blank.at[place].set(values, mode="drop")

        for _ in batch:
            placed = jax.vmap(placed)
        return placed(self.place, values).reshape(*batch, *self.shape)

    @property
    def residuals(self) -> Image:
        """Of each pixel; 0 where none was used."""
        return self.image(self.residual)

    @property
    def inliers(self) -> Image:
        """Which pixels are on the shape."""
        return self.image(self.marks == 2)

    @property
    def region(self) -> Image:
        """Which pixels were used."""
        return self.image(self.marks > 0)

    def filled(self, count: int) -> "Pixelwise":
        """The same with so many entries, of which the last only fill up."""
        more = count - self.place.shape[-1]
        if not more:
            return self
        residual, marks = (np.pad(x, (0, more)) for x in (self.residual, self.marks))
        place = np.pad(self.place, (0, more), constant_values=math.prod(self.shape))
        return Pixelwise(residual, marks, place, self.shape)


def alike(parts: Sequence[Pixelwise]) -> list[Pixelwise]:
    """The same with equally many entries, so that they can be stacked."""
    count = max(part.place.shape[-1] for part in parts)
    return [part.filled(count) for part in parts]
