"""Signed distance of image points from a shape's outline, in pixels.

The nearest point is searched along the outline itself, in the image: on the nearest of
its chords, then of shorter chords there. It shows a point of the body, and the distance
changes as that point moves along the normal; that the nearest point glides along the
outline does not matter to first order.
"""

__all__ = ["signed_distance"]

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.numerics import safe_divide, safe_norm
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.local_world import near_its_camera
from impostor_jax.rendering.image_curve import image_curve

CHORDS = 48
"""Number of chords of the outline, and again of each stretch that is searched."""
CLOSE = 0.05
"""Pixels within which the direction to the nearest point is taken from the tangent.

Image coordinates are rounded to 3e-5 px in single precision, which would turn a shorter
direction by more than 1e-3.
"""


@near_its_camera
@jax.jit
def signed_distance(
    primitive: AbstractPrimitive,
    camera: AbstractCamera,
    points: Float[Array, "*batch 2"],
) -> Float[Array, "*batch"]:
    """Distance of image points from the outline in pixels; negative inside.

    Unlike coverage it has a slope however far away the outline is.

    Args:
        primitive: A whole `Cylinder` or a `Sphere`, a single one, in the world frame;
            it may reach behind the camera.
        camera: The camera, with or without a lens.
        points: Image coordinates (u, v), in pixels.

    Returns:
        Distances, exact to rounding for an outline in or near the image: it is not
        followed farther from the optical axis than ten times the distance of the
        image's corners, or than a tenth beyond them through a lens. `+inf` where there
        is no outline in front of the camera, `-inf` from inside the solid.

    Derivatives:
        Exact, of first order, in every field of the shape and of the camera and in the
        points.

    Raises:
        ValueError: The shape is of another type, a batch, or a cylinder that is open
            or a sector; or the camera is no `PinholeCamera`.
    """
    frame = camera.frame
    reach = 10.0 if camera.sees(*frame.pixels()) is None else 1.1
    curve = image_curve(primitive, camera, frame, reach)
    queries = points.reshape(-1, 2)
    target = jax.lax.stop_gradient(queries)
    index = jnp.arange(CHORDS + 1, dtype=target.dtype)

    def narrow(_: Array, stretch: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = stretch
        part = (high - low) / CHORDS
        inner = (low[:, None] + part[:, None] * index[None]) % 4
        corners = curve.at(inner.reshape(-1)).pixels.reshape(*inner.shape, 2)
        best = _nearest_chord(target, corners).astype(part.dtype)
        return low + part * (best - 1), low + part * (best + 2)

    # A stretch is a sixteenth of the one before, until rounding hides the difference.
    turns = 5 if target.dtype.itemsize <= 4 else 10
    zero = jnp.zeros_like(target[:, 0])
    low, high = jax.lax.fori_loop(0, turns, narrow, (zero, zero + 4))
    parameter = (low + high) / 2
    nearest = curve.at(parameter % 4)
    place = curve.followed(nearest)
    # Where the curve was pulled it has no tangent, but a short chord.
    ahead, behind = curve.at((parameter + 0.02) % 4), curve.at((parameter - 0.02) % 4)
    chord = ahead.pixels - behind.pixels
    tangent = jnp.where(nearest.pulled[:, None], chord, curve.tangent(nearest))
    # The curve runs counterclockwise as one sees it.
    outward, _ = _unit(jnp.stack([-tangent[:, 1], tangent[:, 0]], axis=1))
    direction, gap = _unit(jax.lax.stop_gradient(queries - place))
    side = jnp.where(jnp.sum(direction * outward, axis=1) < 0, -1, 1)
    normal = jnp.where((gap > CLOSE)[:, None], direction * side[:, None], outward)
    distance = jnp.sum(jax.lax.stop_gradient(normal) * (queries - place), axis=1)
    nothing = jnp.where(curve.outline.inside, -jnp.inf, jnp.inf)
    distance = jnp.where(curve.visible, distance, nothing)
    return distance.reshape(points.shape[:-1])


def _unit(
    vectors: Float[Array, "n 2"],
) -> tuple[Float[Array, "n 2"], Float[Array, " n"]]:
    """Unit vectors and lengths; the zero vector stays."""
    length = safe_norm(vectors)
    return vectors * safe_divide(jnp.ones_like(length), length)[:, None], length


def _nearest_chord(
    target: Float[Array, "n 2"], corners: Float[Array, "#n m 2"]
) -> Int[Array, " n"]:
    """Which of the chords from corner to corner is nearest to each target."""
    start = corners[:, :-1]
    chord = corners[:, 1:] - start
    offset = target[:, None] - start
    along = jnp.sum(offset * chord, axis=2)
    foot = jnp.clip(safe_divide(along, jnp.sum(chord * chord, axis=2)), 0, 1)
    off = offset - foot[..., None] * chord
    return jnp.argmin(jnp.sum(off * off, axis=2), axis=1)
