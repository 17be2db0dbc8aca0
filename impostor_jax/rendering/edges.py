"""Edges that cross pixels, and how far the centers of these are from them.

A picture is smooth but for its edges: where a shape ends before what is behind it,
where two of its surfaces meet, where two shapes cut into each other, and where a shadow
ends. On each of them a gap is 0, a smooth function of the place in the image and of all
shapes and lights:

- of the outline and of the crease between two surfaces, the shape's own
  (`AbstractPrimitive.outline_gap`, `crease_gap`);
- of a cut, the way along the ray from one shape to the other;
- of a shadow, the outline gap of what throws it, of the ray from the point of the
  surface to the light.

Which edges there are is searched: a pixel's ray and its four neighbors' meet different
things on both sides of one. Then the one that is nearest to the pixel's center is taken
for a straight line, at the distance gap / |grad gap|, with grad gap held.
"""

__all__ = ["Cast", "Line", "Places", "nearest_line"]

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.geometry.rays import Ray
from impostor_jax.numerics import Numbers, safe_divide, safe_norm
from impostor_jax.rendering.follow import placed, shape_of, stride_of
from impostor_jax.rendering.group import Group
from impostor_jax.rendering.half_pixels import reach
from impostor_jax.rendering.paths import World, found, setting_out, shadowing
from impostor_jax.rendering.search import SEARCHED

Places = Float[Array, "n 2"]
"""In columns and rows."""

Cast = Callable[[Places], tuple[Ray, Bool[Array, " n"]]]
"""From places, of all pixels once or several times over, counted from their centers, to
rays, and whether each is cast at all."""

STENCIL = np.array([(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
"""Of a pixel and its four neighbors. A line that crosses the pixel separates one."""

NONE, OUTLINE, CREASE, CUT, SHADOW = range(5)
"""Kinds of edges; SHADOW + k is that of the light k."""

_shape_of = partial(shape_of, by_index=True)
"""Formulas that read a choice several times are compiled with a copy of it in each
place: 512 pixels beside six cans take 550 ms so, and 15 by an index."""


class Line(NamedTuple):
    """An edge of each pixel.

    Attributes:
        crosses: Whether there is one within the pixel.
        distance: Of the pixel's center, in pixels, of the sign of the gap.
        normal: Unit vector in columns and rows along which the gap grows, held.
    """

    crosses: Bool[Array, " n"]
    distance: Float[Array, " n"]
    normal: Places


class _Edge(NamedTuple):
    """What is on both sides of an edge.

    Attributes:
        kind: Of the edge.
        first: Code of the shape that ends; of a shadow, of that which it falls on.
        second: Code of the other; of a shadow, of that which throws it.
    """

    kind: Int[Array, "*batch"]
    first: Int[Array, "*batch"]
    second: Int[Array, "*batch"]


def nearest_line(world: World, cast: Cast, place: Places, size: float) -> Line:
    """The edge that is nearest to the center of each pixel.

    Args:
        world: What rays can meet.
        cast: Rays of the image.
        place: Centers of the pixels.
        size: Length of their sides.

    Derivatives:
        Of the distance, of first order: in all of the world and the rays.
    """
    held = jax.lax.stop_gradient(world)
    edges = _edges_near(held, cast, place, size)
    count = edges.kind.shape[0]

    def gaps(place: Places) -> Numbers:
        every = jax.tree.map(lambda x: jnp.tile(x, count), cast(place)[0])
        flat = jax.tree.map(lambda x: x.reshape(-1), edges)
        return _gap(held, flat, every).reshape(count, -1)

    along = [
        jnp.broadcast_to(jnp.asarray(axis, place.dtype), place.shape)
        for axis in ((size, 0), (0, size))
    ]
    (gap, across), (_, down) = (jax.jvp(gaps, (place,), (axis,)) for axis in along)
    grow = jnp.stack([across, down], axis=-1)
    speed = safe_norm(grow)
    normal = grow * safe_divide(jnp.ones_like(speed), speed)[..., None]
    distance = safe_divide(gap, speed)
    off = jnp.where((edges.kind != NONE) & (speed > 0), jnp.abs(distance), jnp.inf)
    best = jnp.argmin(off, axis=0)[None]

    def chosen(x: Array) -> Array:
        return jnp.take_along_axis(x, best.reshape(1, -1, *(1,) * (x.ndim - 2)), 0)[0]

    off, speed, normal = (chosen(x) for x in (off, speed, normal))
    nearest = jax.tree.map(chosen, edges), off < reach(normal), speed, normal
    nearest = checkpoint_name(jax.lax.stop_gradient(nearest), SEARCHED)
    edge, crosses, speed, normal = nearest
    gap = _gap(world, edge, cast(place)[0])
    return Line(crosses, jnp.where(crosses, safe_divide(gap, speed), 0), normal)


def _edges_near(world: World, cast: Cast, place: Places, size: float) -> _Edge:
    """All that may cross each pixel, (k, n): some of each neighbor."""
    around = place[None] + size * jnp.asarray(STENCIL, place.dtype)[:, None]
    ray, is_cast = cast(around.reshape(-1, 2))
    ray, is_cast = jax.lax.stop_gradient((ray, is_cast))
    here, hiders = found(world, setting_out(ray, is_cast), any_hider=False)
    sides = len(STENCIL)

    def parted(x: Array) -> tuple[Array, Array]:
        """Of the pixel, as often as it has neighbors, and of these."""
        x = x.reshape(sides, -1)
        return jnp.broadcast_to(x[:1], (sides - 1, x.shape[1])), x[1:]

    edges = [_seen_edges(world, ray, here.code, parted)]
    own, other = parted(here.code)
    for number, hider in zip(shadowing(world), hiders, strict=True):
        own_hider, other_hider = parted(hider)
        ends = (own == other) & (own >= 0) & ((own_hider < 0) != (other_hider < 0))
        kind = jnp.where(ends, SHADOW + number, NONE)
        edges.append(_Edge(kind, own, jnp.maximum(own_hider, other_hider)))
    return jax.tree.map(lambda *x: jnp.concatenate(x), *edges)


def _seen_edges(
    world: World,
    ray: Ray,
    code: Int[Array, " n"],
    parted: Callable[[Array], tuple[Array, Array]],
) -> _Edge:
    """Where shapes end, or surfaces of one, between a pixel and each neighbor."""
    groups, stride = world.shapes.groups, stride_of(world.shapes.groups)
    near, far = (
        jax.tree.map(lambda x, k=k: parted(x)[k].reshape(-1), ray) for k in range(2)
    )
    shape = parted(code)[0].shape
    own, other = (x.reshape(-1) for x in parted(code))
    (gap, is_known), (other_gap, other_is_known) = (
        _outline(groups, own, far),
        _outline(groups, other, near),
    )
    ends, other_ends = gap <= 0, other_gap <= 0
    is_nearer = _way(groups, own, near) < _way(groups, other, far)
    ends_first = ends & (~other_ends | is_nearer)
    both = (own >= 0) & (other >= 0)
    is_one = both & (own // stride == other // stride)
    cuts = both & ~ends & ~other_ends & is_known & other_is_known
    kind = jnp.where(
        is_one,
        jnp.where(own == other, NONE, CREASE),
        jnp.where(ends | other_ends, OUTLINE, jnp.where(cuts, CUT, NONE)),
    )
    swap = ~ends_first & other_ends & ~is_one
    edge = _Edge(kind, jnp.where(swap, other, own), jnp.where(swap, own, other))
    return jax.tree.map(lambda x: x.reshape(shape), edge)


def _gap(world: World, edge: _Edge, ray: Ray) -> Numbers:
    """The gap of an edge at each ray; 1 where there is none or no formula."""
    groups, stride = world.shapes.groups, stride_of(world.shapes.groups)
    is_shadow = edge.kind >= SHADOW
    t, other_t = (_way(groups, code, ray) for code in (edge.first, edge.second))
    is_met = jnp.isfinite(t)
    point = ray.at(jnp.where(is_met, t, 0))
    way = ray.direction
    for number, light in enumerate(world.lights):
        to_light = light.towards(point)
        if to_light is not None:
            way = to_light.where(edge.kind == SHADOW + number, way)
    seen = Ray(point.where(is_shadow, ray.origin), way)
    solid = jnp.where(is_shadow, edge.second, edge.first)
    outline, _ = _outline(groups, solid, seen)
    # Of a shadow on what the ray misses nothing is known.
    ends = (edge.kind == OUTLINE) | (is_shadow & is_met)
    gap = jnp.where(ends, outline, 1)
    part, other_part = (code % stride // 2 for code in (edge.first, edge.second))
    for group, mine, member in placed(groups, edge.first):
        crease = _shape_of(group, member).crease_gap(ray, part, other_part)
        if crease is not None:
            gap = jnp.where(mine & (edge.kind == CREASE), crease, gap)
    both = is_met & jnp.isfinite(other_t)
    cut = jnp.where(both, other_t, 0) - jnp.where(both, t, 0)
    return jnp.where((edge.kind == CUT) & both, cut, gap)


def _outline(
    groups: Sequence[Group], code: Int[Array, "*batch"], ray: Ray
) -> tuple[Numbers, Bool[Array, "*batch"]]:
    """Outline gaps of shapes, 1 where there is no formula, and whether there is one."""
    gap = jnp.ones_like(ray.direction.x)
    known = jnp.zeros(code.shape, bool)
    for group, mine, member in placed(groups, code):
        outline = _shape_of(group, member).outline_gap(ray)
        if outline is not None:
            gap, known = jnp.where(mine, outline, gap), known | mine
    return gap, known


def _way(groups: Sequence[Group], code: Int[Array, "*batch"], ray: Ray) -> Numbers:
    """Ray parameters at which shapes alone are met; `+inf` on a miss."""
    t = jnp.full_like(ray.direction.x, jnp.inf)
    for group, mine, member in placed(groups, code):
        t = jnp.where(mine, _shape_of(group, member).intersect(ray).t, t)
    return t
