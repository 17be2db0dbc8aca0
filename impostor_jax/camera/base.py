"""What every camera promises."""

__all__ = [
    "AbstractCamera",
    "AbstractRays",
    "Projection",
    "check_central",
    "check_depth_along_z",
    "check_planar",
    "not_accepted",
    "posed",
]

import abc
from typing import Any, Literal, TypeVar

import equinox as eqx
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.arguments import described
from impostor_jax.camera.pixels import PixelBox, Pixels, Tile
from impostor_jax.geometry.frames import Points, RigidTransform
from impostor_jax.geometry.rays import Ray

Projection = Literal["planar", "parallel", "spherical"]
"""By which two coordinates rays lie in an image, (first, second):

- planar: (x, y) where one from the origin meets the plane z = 1;
- parallel: (x, y) where one along z starts;
- spherical: azimuth, from +z towards +x, in [-pi, pi], and elevation, above the plane
  y = 0, in [-pi/2, pi/2], of one from the origin in any direction.
"""


class AbstractRays(eqx.Module):
    """What casts a ray through each pixel of an image.

    Attributes:
        width: Number of columns of the image.
        height: Number of rows of the image.
        camera_from_world: Pose; None where the camera frame is the world frame.
    """

    width: eqx.AbstractVar[int]
    height: eqx.AbstractVar[int]
    camera_from_world: eqx.AbstractVar[RigidTransform | None]

    @property
    @abc.abstractmethod
    def is_central(self) -> bool:
        """Whether all rays start in one point, the origin of the camera frame."""

    @property
    def frame(self) -> Tile:
        """The whole image as a tile."""
        return Tile(row=0, col=0, height=self.height, width=self.width)

    @abc.abstractmethod
    def rays(self, row: Pixels, col: Pixels, dtype: DTypeLike) -> Ray:
        """Rays through pixel centers, in the camera frame.

        Directions have z = 1, so the ray parameter of a point is its depth; those of a
        spherical projection have length 1, and the parameter is the range.

        Args:
            row: Rows of the pixels, which must lie in the image.
            col: Columns of the pixels.
            dtype: Floating-point type of the rays.

        Derivatives:
            In every field of the camera, its lens coefficients included.
        """

    @abc.abstractmethod
    def sees(self, row: Pixels, col: Pixels) -> Bool[Array, "*batch"] | None:
        """Whether light reaches the pixels; None where it reaches all of them."""


class AbstractCamera(AbstractRays):
    """A camera looks along +z of its own frame: x right, y down, z forward."""

    @property
    @abc.abstractmethod
    def projection(self) -> Projection:
        """By which coordinates the rays lie in the image."""

    @property
    @override
    def is_central(self) -> bool:
        return self.projection != "parallel"

    @abc.abstractmethod
    def shifted(
        self, cols: Float[Array, ""], rows: Float[Array, ""]
    ) -> "AbstractCamera":
        """The same camera with the centers of its pixels to the right and below.

        Args:
            cols: By how much of a column.
            rows: By how much of a row.

        Raises:
            ValueError: Its rays are known at the centers alone, as those of a lens,
                which are solved for, or of a scanner.
        """

    @abc.abstractmethod
    def strided(self, stride: int) -> "AbstractCamera":
        """The camera of every n-th row and column, from the first on.

        Its images are those that `render` makes with this stride of an `Effort`.
        """

    @abc.abstractmethod
    def pixel_box(self, low: Float[Array, "2"], high: Float[Array, "2"]) -> PixelBox:
        """Smallest block of pixels that holds every ray of a box of the projection.

        Args:
            low: Smallest of both coordinates of the `projection`.
            high: Largest of both.
        """

    @abc.abstractmethod
    def project(self, points: Points) -> Float[Array, "*batch 2"]:
        """Image coordinates (u, v), in pixels, of points of the camera frame.

        Of a planar projection those with z > 0 have some, of a spherical one all but
        the origin.
        """


Posed = TypeVar("Posed", bound=AbstractRays)


def posed(camera: Posed, pose: RigidTransform | None) -> Posed:
    """The same camera with another pose, from the world to it, or without any."""
    return eqx.tree_at(
        lambda c: c.camera_from_world, camera, pose, is_leaf=lambda x: x is None
    )


def not_accepted(camera: Any) -> str:
    """What is given for a camera, for an error; where it is none, how to make one."""
    told = described(camera)
    if isinstance(camera, AbstractRays):
        return told
    return f"{told}; ij.camera_from makes one of a matrix K, or of another program's"


def check_central(camera: AbstractCamera) -> None:
    """Raise a `ValueError` unless the camera's rays start in one point."""
    if not camera.is_central:
        raise ValueError(
            "camera must have a center where its rays start, as a PinholeCamera has, "
            f"got {type(camera).__name__}"
        )


def check_planar(camera: AbstractCamera) -> None:
    """Raise a `ValueError` unless the camera sees the plane z = 1 from the origin."""
    if camera.projection != "planar":
        raise ValueError(
            "camera must see the plane z = 1 from a center, as a PinholeCamera does, "
            f"got {type(camera).__name__}"
        )


def check_depth_along_z(camera: AbstractCamera) -> None:
    """Raise a `ValueError` where the depth of the camera's images is the range."""
    if camera.projection == "spherical":
        raise ValueError(
            "camera must measure depth along z, as a PinholeCamera does, got "
            f"{type(camera).__name__}, whose depth is the range along the ray"
        )
