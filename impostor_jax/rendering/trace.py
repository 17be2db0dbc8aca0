"""Pictures of scenes by rays: shadows, mirrors and glass."""

__all__ = ["MOST_BOUNCES", "trace"]

from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.arguments import (
    float_array,
    is_concrete,
    one_of,
    whole_number,
    working_precision,
)
from impostor_jax.camera.base import AbstractCamera, not_accepted
from impostor_jax.camera.pixels import Pixels, Tile
from impostor_jax.compiling import kept
from impostor_jax.effort import Effort, effort_of
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.base import not_a_shape
from impostor_jax.primitives.local_world import seen_near
from impostor_jax.rendering.clipping import Clipping, clipping_of
from impostor_jax.rendering.edges import Cast, nearest_line
from impostor_jax.rendering.group import padded_size
from impostor_jax.rendering.half_pixels import halves
from impostor_jax.rendering.lights import AbstractLight
from impostor_jax.rendering.material import Material, stacked
from impostor_jax.rendering.paths import World, color_of, world_of
from impostor_jax.rendering.sampling import Sampling, framed, picture_of
from impostor_jax.rendering.scene import Scene, Shown
from impostor_jax.rendering.sides import check_edges

MOST_BOUNCES = 16


def trace(
    scene: Shown,
    camera: AbstractCamera,
    lights: Sequence[AbstractLight],
    materials: Material | Sequence[Material] | None = None,
    background: Any = (0.0, 0.0, 0.0),
    depth: int = 3,
    tile: Tile | None = None,
    effort: Effort | str = "balanced",
    edges: str = "hard",
    near: Any = None,
    far: Any = None,
) -> Float[Array, "h w 3"]:
    """Trace the rays of a picture: Lambert, Phong, shadows, mirrors and glass.

    Works inside `jax.jit`, `grad`, `jacfwd` and `vmap`. What no material has is not
    compiled; light from all sides alone casts no shadows, and no ray for them.

    Args:
        scene: A scene, or one shape, in the world frame.
        camera: The camera.
        lights: In the world frame.
        materials: One of each shape, in the order of the scene's indices (a batch
            counts as many); or a single one, no batch, of all. White and dull if None.
        background: Color of rays that meet nothing.
        depth: Most times that a ray is mirrored or bent. A surface that is met after
            as many shows its own color alone.
        tile: Block of pixels to trace, the whole image if None.
        effort: "fast", "balanced", "exact" or an `Effort`, of which `precision`,
            `stride`, `samples`, `adaptive` and `spacing` count.
        edges: "hard", a pixel is what its ray sees; or "area", one that an edge crosses
            is made of the two sides, each seen through its middle and weighted by its
            area. The edge is taken for a straight line, and of several in a pixel, or
            in each of its `samples` times `samples` parts, the one nearest to the
            middle counts. Edges seen in mirrors and through glass stay hard, and so do
            those of what `near` and `far` cut.
        near: Depth in meters, as `render` has it, in front of which the camera sees
            nothing; None for 0. Of a solid that is cut it sees the inside. Rays to
            lights, from mirrors and through glass meet all there is.
        far: Depth in meters behind which it sees the background; None for no end.

    Returns:
        Linear RGB from 0 up; nothing is clipped.

    Derivatives:
        In shapes, materials, lights, background and camera, exact for every pixel that
        keeps seeing the same. What moves across a pixel has none with hard edges. With
        edges="area" outlines, creases, cuts of two shapes and edges of shadows have
        their derivative, of first order; not those of a torus, a heightfield, a solid,
        and a cylinder or frustum that is open or a sector, which stay hard.

    Raises:
        ValueError: A value is out of range, there are not as many materials as shapes,
            something is none of what it should be, near is negative or far is not
            more, or several samples or edges="area"
            are asked for with a lens or a `SphericalCamera`.

    References:
        Whitted (1980), An improved illumination model for shaded display.
    """
    if not isinstance(scene, Shown):
        raise ValueError(
            f"scene must be an ij.Scene or a shape, got {not_a_shape(scene)}"
        )
    if not isinstance(camera, AbstractCamera):
        raise ValueError(
            "camera must be a camera, such as an ij.PinholeCamera, got "
            f"{not_accepted(camera)}"
        )
    if not isinstance(lights, Sequence):
        raise ValueError(
            f"lights must be a sequence of lights, got {type(lights).__name__}"
        )
    for light in lights:
        if not isinstance(light, AbstractLight):
            raise ValueError(
                f"lights must be lights, such as ij.PointLight, got {light!r}"
            )
    depth = whole_number("depth", depth, 0, MOST_BOUNCES, "bounces")
    scene = scene if isinstance(scene, Scene) else Scene([scene])
    made = stacked(Material() if materials is None else materials)
    is_one_of_all = isinstance(materials, Material) and materials.color.ndim == 1
    if not (materials is None or is_one_of_all):
        _check_count(scene, made)
    background = float_array("background", background, (3,))
    effort = effort_of(effort)
    one_of("edges", edges, ("hard", "area"))
    if edges == "area":
        check_edges(camera, 'edges must be "hard"')
    clipping = clipping_of(near, far, camera)
    given = (scene, camera, tile, list(lights), _padded(made), background, clipping)
    with working_precision(effort.precision, given) as converted:
        camera, scene, *lights = seen_near(camera, scene, *lights)
        given = (scene, camera, tile, lights, *given[4:])
        scene, camera, tile, *rest = converted(given)
        sampling = Sampling(effort.samples, effort.adaptive, effort.spacing)
        return _traced(
            scene, camera, tile, *rest,
            depth=depth, stride=effort.stride, sampling=sampling, edges=edges,
        )  # fmt: skip


def _check_count(scene: Scene, made: Material) -> None:
    """Raise unless there is a material of each shape, and of nothing else."""
    if not is_concrete(scene):
        return
    # In numpy: jax.jit traces what is done to concrete arrays, too.
    count = sum(np.count_nonzero(np.asarray(g.index) >= 0) for g in scene.groups)
    if made.color.shape[0] != count:
        raise ValueError(
            f"materials must be as many as the scene's {count} shapes, or a single "
            f"one, got {made.color.shape[0]}"
        )


def _padded(made: Material) -> Material:
    """As many as the next size of a bucket, so that one more runs the same program."""
    count = made.color.shape[0]
    spare = padded_size(count) - count
    return jax.tree.map(
        lambda x: jnp.pad(x, ((0, spare), *((0, 0),) * (x.ndim - 1)), mode="edge"), made
    )


@partial(kept, static_argnames=("depth", "stride", "sampling", "edges"))
def _traced(
    scene: Scene,
    camera: AbstractCamera,
    tile: Tile | None,
    lights: list[AbstractLight],
    materials: Material,
    background: Float[Array, "3"],
    clipping: Clipping | None,
    depth: int,
    stride: int,
    sampling: Sampling,
    edges: str,
) -> Float[Array, "h w 3"]:
    tile = camera.frame if tile is None else tile
    row, col = (pixel[::stride, ::stride] for pixel in tile.pixels())
    if camera.camera_from_world is not None:
        lights = [light.transformed(camera.camera_from_world) for light in lights]
    groups = scene.seen_by(camera).groups
    materials = jax.tree.map(lambda x: x.astype(scene.dtype), materials)
    sky = background.astype(scene.dtype)
    world = world_of(groups, materials, lights, sky, clipping)

    def rays(row: Pixels, col: Pixels, place: Float[Array, "2"]) -> tuple[Ray, Array]:
        centered = sampling.samples == 1 and edges == "hard"
        place = place.astype(scene.dtype)
        moved = camera if centered else camera.shifted(place[0], place[1])
        ray = moved.rays(row, col, scene.dtype)
        ray = ray if clipping is None else clipping.started(ray)
        sees, cast = moved.sees(row, col), jnp.isfinite(ray.direction.x)
        return ray, cast if sees is None else cast & sees

    def see(
        row: Int[Array, " n"], col: Int[Array, " n"], places: Float[Array, "k 2"]
    ) -> tuple[Vec3, Int[Array, "k n"]]:
        each = jax.vmap(lambda place: rays(row, col, place))(places)
        # One after the other: a loop over a batch of rays takes every branch.
        ray, cast = jax.tree.map(lambda x: x.reshape(-1), each)
        seen = color_of(world, ray, cast, depth)
        return jax.tree.map(lambda x: x.reshape(len(places), -1), seen)

    if edges == "hard" and (sampling.samples == 1 or not sampling.adaptive):
        return picture_of(see, row, col, sampling).stack()

    def see_sides(
        row: Int[Array, " n"], col: Int[Array, " n"], places: Float[Array, "k 2"]
    ) -> tuple[Vec3, Int[Array, "k n"]]:
        count = len(places)

        def cast(place: Float[Array, "m 2"]) -> tuple[Ray, Bool[Array, " m"]]:
            times = place.shape[0] // row.shape[0]
            return jax.vmap(rays)(jnp.tile(row, times), jnp.tile(col, times), place)

        place = jnp.repeat(places.astype(scene.dtype), row.shape[0], axis=0)
        seen = _sides(world, cast, place, 1 / sampling.samples, depth)
        return jax.tree.map(lambda x: x.reshape(count, -1), seen)

    # One pixel more on each side, with which those at the border are compared.
    row, col = framed(row, stride, 0), framed(col, stride, 1)
    sides = see_sides if edges == "area" else None
    color = picture_of(see, row, col, sampling, sides)
    return color.stack()[1:-1, 1:-1]


def _sides(
    world: World, cast: Cast, place: Float[Array, "n 2"], size: float, depth: int
) -> tuple[Vec3, Int[Array, " n"]]:
    """Colors of squares in the image, of both sides of the edge in each, and trails.

    `place` is the center of each, `size` the length of its sides in pixels.
    """
    line = nearest_line(world, cast, place, size)
    cut = halves(line.distance, line.normal)
    # Middles move with the edge: so does what is seen there.
    places = [
        place + size * jnp.where(line.crosses[:, None], middle, 0)
        for middle in cut.middles
    ]
    (first, is_first), (second, is_second) = map(cast, places)
    both = jax.tree.map(lambda *x: jnp.concatenate(x), first, second)
    is_cast = jnp.concatenate([is_first, is_second & line.crosses])
    color, trail = color_of(world, both, is_cast, depth)
    count = place.shape[0]
    area = jnp.where(line.crosses, cut.area, 1)
    mixed = jax.tree.map(lambda x: x[:count] * area + x[count:] * (1 - area), color)
    return mixed, trail[:count]
