"""What every noise model promises: one model makes data and weighs a fit."""

__all__ = ["AbstractDepthNoise"]

import abc

import equinox as eqx
from jaxtyping import Array, Float, PRNGKeyArray

from impostor_jax.camera.base import AbstractCamera


class AbstractDepthNoise(eqx.Module):
    """Noise of depth readings along z of the camera frame."""

    @abc.abstractmethod
    def sigma(
        self,
        depth: Float[Array, "*batch"],
        cos_incidence: Float[Array, "*batch"],
    ) -> Float[Array, "*batch"]:
        """Standard deviation of a reading, in meters.

        Args:
            depth: Camera-frame z, in meters; `+inf` where nothing is hit.
            cos_incidence: Cosine between surface normal and viewing ray, in (0, 1].

        Returns:
            One sigma a pixel; `+inf` where nothing is hit, so its weight is zero.
        """

    @abc.abstractmethod
    def sample(
        self,
        key: PRNGKeyArray,
        depth: Float[Array, "h w"],
        normal: Float[Array, "h w 3"],
        camera: AbstractCamera,
    ) -> Float[Array, "h w"]:
        """Readings of a scene, in meters; `+inf` stays where nothing is hit.

        Args:
            key: Random key.
            depth: Camera-frame z, in meters; `+inf` where nothing is hit.
            normal: Unit normals that face the camera, in its frame.
            camera: The camera that sees them.
        """
