"""What pixels see on both sides of an edge, and how much of each: edges that move.

The center of a pixel sees one surface, whose depth does not change when an outline
crosses the pixel. The area that the surface covers in it does: that has a derivative in
whatever the edge belongs to, the outline of a shape in front or a cut of two. Of the
other side the depth is that of the ray through its middle. So a sum over pixels of what
both sides count, each by its area, follows an edge.
"""

__all__ = ["check_edges", "sides_of"]

import jax
import jax.numpy as jnp
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.geometry.rays import Ray
from impostor_jax.rendering.clipping import Clipping
from impostor_jax.rendering.edges import Places, nearest_line
from impostor_jax.rendering.follow import followed
from impostor_jax.rendering.half_pixels import halves
from impostor_jax.rendering.material import Material, stacked
from impostor_jax.rendering.paths import TRAIL, world_of
from impostor_jax.rendering.sampling import seen_at_edges
from impostor_jax.rendering.scene import Scene, Shown
from impostor_jax.rendering.search import SEARCHED, first_met

Pixels = Int[Array, "h w"]

Sides = tuple[Float[Array, "h w"], Float[Array, "h w"]]
"""Part of each pixel that what its center sees covers, and the depth of the rest."""


def check_edges(camera: AbstractCamera, what: str) -> None:
    """Raise a `ValueError` unless rays of a camera can be cast anywhere in a pixel.

    Args:
        camera: The camera.
        what: Needs them; the first words of the error.
    """
    has_lens = isinstance(camera, PinholeCamera) and camera.ray_field is not None
    if has_lens or camera.projection == "spherical":
        raise ValueError(
            f"{what} for a camera with a lens or a SphericalCamera, whose rays are "
            "known through the centers of pixels alone"
        )


def sides_of(
    primitive: Shown,
    camera: AbstractCamera,
    row: Pixels,
    col: Pixels,
    index: Pixels,
    part: Pixels,
    clipping: Clipping | None = None,
) -> Sides:
    """The two sides of the edge in each pixel; 1 and infinity where there is none.

    Args:
        primitive: One shape or a scene, in the world frame.
        camera: That `check_edges` passes.
        row: Rows of the pixels, those around the ones that are wanted among them: an
            edge is looked for where a neighbor sees something else.
        col: Columns of the pixels.
        index: Which shape each sees, -1 for none.
        part: And which part of it.
        clipping: What depths are seen; None for all.

    Derivatives:
        As of `trace` with `edges="area"`.
    """
    scene = primitive if isinstance(primitive, Scene) else Scene([primitive])
    dtype = scene.dtype
    plain = jax.tree.map(lambda x: x.astype(dtype), stacked(Material()))
    dark = jnp.zeros(3, dtype)
    world = world_of(scene.seen_by(camera).groups, plain, [], dark, clipping)

    def rays(row: Array, col: Array, place: Float[Array, "2"]) -> Ray:
        ray = camera.shifted(place[0], place[1]).rays(row, col, dtype)
        return ray if clipping is None else clipping.started(ray)

    def see_sides(
        row: Int[Array, " n"], col: Int[Array, " n"], place: Float[Array, "1 2"]
    ) -> tuple[tuple[Array, Array], Array]:
        def cast(place: Places) -> tuple[Ray, Bool[Array, " m"]]:
            times = place.shape[0] // row.shape[0]
            ray = jax.vmap(rays)(jnp.tile(row, times), jnp.tile(col, times), place)
            return ray, jnp.ones(place.shape[0], bool)

        center = jnp.broadcast_to(place.astype(dtype), (row.shape[0], 2))
        line = nearest_line(world, cast, center, 1.0)
        cut = halves(line.distance, line.normal)
        is_first = line.distance > 0
        share = jnp.where(is_first, cut.area, 1 - cut.area)
        first, second = cut.middles
        middle = jnp.where(is_first[:, None], second, first)
        # Held: a depth is compared with that of the pixel, wherever its edge is.
        ray, _ = cast(jax.lax.stop_gradient(center + middle))
        reach = jnp.where(line.crosses, jnp.inf, -jnp.inf).astype(dtype)
        found = checkpoint_name(first_met(world.shapes, ray, reach), SEARCHED)
        beside, _ = followed((world.shapes.groups, ray), *found)
        beside = beside if clipping is None else clipping.depth(beside)
        share = jnp.where(line.crosses, share, 1)
        beside = jnp.where(line.crosses, beside, jnp.inf)
        return (share[None], beside[None]), jnp.zeros((1, row.shape[0]), jnp.int32)

    blank = jnp.ones(row.shape, dtype), jnp.full(row.shape, jnp.inf, dtype)
    return seen_at_edges(see_sides, row, col, blank, index * TRAIL + part)
