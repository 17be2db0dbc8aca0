"""Light along rays: what each meets, is lit by, and sees mirrored or through glass.

Every ray is searched without a derivative and then followed with one, at every bounce:
`while` loops have no derivative in reverse mode, and need none. Mirrors alone make a
chain of rays. Where something lets light through, a ray may go on as two, so that one
of them waits on a stack of its own: a scene without glass has no stack in its program,
and one without mirrors no bounce.
"""

__all__ = [
    "TRAIL",
    "Path",
    "Surface",
    "World",
    "color_of",
    "met",
    "setting_out",
    "shadow_rays",
    "world_of",
]

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers
from impostor_jax.rendering.clipping import Clipping
from impostor_jax.rendering.follow import followed, member_of, placed, shape_of
from impostor_jax.rendering.group import Group
from impostor_jax.rendering.lights import AbstractLight, reflected
from impostor_jax.rendering.material import Material
from impostor_jax.rendering.search import Searched, first_met, is_blocked, searched
from impostor_jax.rendering.secondary import anchors, clearance, mirrored, refracted

LEAST_WEIGHT = 2.0**-12
"""Part of a pixel below which a ray is not cast: less than 8 bits of color show."""

State = TypeVar("State", bound=tuple[Any, ...])
"""Of which the first is a path."""

TRAIL = 1000003
"""By which a trail is multiplied for each thing that a ray meets: a prime."""


class World(NamedTuple):
    """All that rays can meet, in their frame.

    Attributes:
        shapes: The shapes.
        materials: Of each group's shapes.
        anchors: Of each group's shapes, by which hits are rounded.
        lights: That shine on them.
        background: Color of rays that meet nothing.
        clipping: Beyond which depth rays that set out meet nothing; None for no end.
    """

    shapes: Searched
    materials: Sequence[Material]
    anchors: Sequence[Float[Array, "n 4"]]
    lights: Sequence[AbstractLight]
    background: Vec3
    clipping: Clipping | None


class Path(NamedTuple):
    """Where rays are on their way from pixels.

    Attributes:
        ray: To be cast next, its direction of unit length.
        weight: Part of the pixel's color that it is.
        live: Whether there is one.
        level: How many bounces lie behind.
        color: Of the pixel so far.
        trail: Number of all that has been met, as good as never that of anything else.
    """

    ray: Ray
    weight: Float[Array, " n"]
    live: Bool[Array, " n"]
    level: Int[Array, " n"]
    color: Vec3
    trail: Int[Array, " n"]


class Surface(NamedTuple):
    """What rays have met; of no meaning where they meet nothing.

    Attributes:
        point: Where.
        normal: Unit normal, against the ray.
        off: Vector along it by which rays that start here are moved.
        material: Of each point.
        inside: Whether the ray came through the shape; None where nothing lets it.
        code: Of the shape and its part.
    """

    point: Vec3
    normal: Vec3
    off: Vec3
    material: Material
    inside: Bool[Array, " n"] | None
    code: Int[Array, " n"]


def world_of(
    groups: Sequence[Group],
    materials: Material,
    lights: Sequence[AbstractLight],
    background: Float[Array, "3"],
    clipping: Clipping | None = None,
) -> World:
    """Put together what rays can meet.

    Args:
        groups: Of a scene, in the frame of the rays.
        materials: Of its shapes in the order of the scene's indices; of a single one,
            all are made.
        lights: In the frame of the rays.
        background: Color of rays that meet nothing.
        clipping: What depths rays see that set out; None for all.
    """
    count = materials.color.shape[0]
    own = [
        jax.tree.map(lambda x, g=group: x[jnp.clip(g.index, 0, count - 1)], materials)
        for group in groups
    ]
    sky = Vec3.from_array(background)
    return World(searched(groups), own, anchors(groups), lights, sky, clipping)


def color_of(
    world: World, ray: Ray, cast: Bool[Array, " n"], depth: int
) -> tuple[Vec3, Int[Array, " n"]]:
    """Colors that rays see, and their trails.

    Rays whose trails are the same have met the same parts of the same shapes in the
    same order, and the same lights were hidden from them.

    Args:
        world: What they can meet.
        ray: (n,), of any lengths.
        cast: Whether each is cast at all; its color is 0 if not.
        depth: Most bounces.

    Derivatives:
        In all of the world and the rays, along the path that was found.
    """
    path = setting_out(ray, cast)
    material = world.materials[0]
    if material.transmit is not None and depth:
        path = _through_glass(world, path, depth)
    elif material.reflect is not None and depth:

        def step(state: tuple[Path]) -> tuple[Path]:
            return (_bounced(world, *state, depth),)

        (path,) = _repeated(step, (path,), depth + 1)
    else:
        path = _bounced(world, path, 0)
    return path.color, path.trail


def setting_out(ray: Ray, cast: Bool[Array, " n"]) -> Path:
    """Paths of rays of any lengths, of which some are not cast at all."""
    zero = jnp.zeros_like(ray.direction.x)
    return Path(
        ray=Ray(ray.origin, ray.direction.normalize()),
        weight=zero + 1,
        live=cast,
        level=jnp.zeros(cast.shape, jnp.int32),
        color=Vec3(zero, zero, zero),
        trail=jnp.zeros(cast.shape, jnp.int32),
    )


def _repeated(step: Callable[[State], State], state: State, times: int) -> State:
    """The path, and what goes with it, after steps; none is taken without a ray."""

    def once(state: State, _: None) -> tuple[State, None]:
        live = jnp.any(state[0].live)
        return jax.lax.cond(live, step, lambda state: state, state), None

    state, _ = jax.lax.scan(once, state, None, length=times)
    return state


def _bounced(world: World, path: Path, depth: int) -> Path:
    """The path with the next mirrored ray."""
    surface, path = met(world, path)
    material, more = surface.material, path.level < depth
    reflect = 0.0 if material.reflect is None or not depth else material.reflect
    reflect = jnp.where(more, reflect, 0)
    path = _lit(world, path, surface, 1 - reflect)
    weight = path.weight * reflect
    return path._replace(
        ray=_mirrored(path.ray, surface),
        weight=weight,
        live=path.live & (weight > LEAST_WEIGHT),
        level=path.level + 1,
    )


def met(world: World, path: Path) -> tuple[Surface, Path]:
    """What rays meet, and the paths of those that meet anything."""
    ray = path.ray
    t, code = first_met(world.shapes, ray, path.live)
    if world.clipping is not None:
        point = ray.at(jnp.where(jnp.isfinite(t), t, 0))
        code = jnp.where((path.level == 0) & world.clipping.is_beyond(point), -1, code)
    t, normal = followed((world.shapes.groups, ray), t, code, True)
    assert normal is not None
    hits = path.live & (code >= 0)
    t = jnp.where(hits, t, 0)
    point = ray.at(t)
    surface = _surface(world, ray, t, code, point, normal)
    behind = path.live & ~hits
    sky = jax.tree.map(
        lambda b: jnp.where(behind, path.weight * b, 0), world.background
    )
    return surface, path._replace(
        live=hits,
        color=path.color + sky,
        trail=path.trail * TRAIL + jnp.where(path.live, code + 1, 0),
    )


def _surface(
    world: World,
    ray: Ray,
    t: Numbers,
    code: Int[Array, " n"],
    point: Vec3,
    normal: Vec3,
) -> Surface:
    """Collect what is known of the shapes that rays have met."""
    anchor = jnp.zeros((*t.shape, 4), t.dtype)
    # That of any shape where nothing is met: 0 would be no index of refraction.
    material = jax.tree.map(
        lambda x: jnp.broadcast_to(x[0], (*t.shape, *x.shape[1:])),
        jax.lax.stop_gradient(world.materials[0]),
    )
    inside = jnp.zeros(t.shape, bool)
    middle = ray.at(t / 2)
    tells = material.transmit is not None
    for k, (group, mine, member) in enumerate(placed(world.shapes.groups, code)):

        def chosen(new, old, mine=mine):
            mine = mine.reshape(mine.shape + (1,) * (new.ndim - mine.ndim))
            return jnp.where(mine, new, old)

        own = member_of((world.materials[k], world.anchors[k]), member)
        material, anchor = jax.tree.map(chosen, own, (material, anchor))
        if tells:
            shape = shape_of(group, member)
            inside = jnp.where(mine, shape.implicit(middle) < 0, inside)
    size = anchor[..., 3]
    off = clearance(ray, t, normal, (Vec3.from_array(anchor[..., :3]), size))
    off = jax.lax.stop_gradient(normal) * off
    return Surface(point, normal, off, material, inside if tells else None, code)


def _lit(world: World, path: Path, surface: Surface, part: Numbers) -> Path:
    """The path with the light that a part of the surfaces' own colors reflects."""
    hidden = _hidden(world, path, surface)
    material = surface.material
    light = reflected(
        world.lights, surface.point, surface.normal, -path.ray.direction,
        material.exponent, hidden,
    )  # fmt: skip
    weight = jnp.where(path.live, path.weight * part, 0)
    red, green, blue = (material.color[..., k] * weight for k in range(3))
    more = Vec3(red * light.x, green * light.y, blue * light.z)
    trail = path.trail
    for dark in hidden:
        if dark is not None:
            trail = trail * TRAIL + dark.astype(jnp.int32)
    return path._replace(color=path.color + more, trail=trail)


def _hidden(
    world: World, path: Path, surface: Surface
) -> list[Bool[Array, " n"] | None]:
    """Of each light, the points in its shadow; None if it comes from all sides.

    What lets light through hides a light all the same.
    """
    cast = shadow_rays(world, path, surface)
    if not cast:
        return [None] * len(world.lights)
    each = jax.tree.map(lambda *x: jnp.stack(x), *cast.values())
    dark = jax.lax.map(lambda one: is_blocked(world.shapes, *one), each)
    found = iter(dark)
    return [next(found) if k in cast else None for k in range(len(world.lights))]


def shadow_rays(
    world: World, path: Path, surface: Surface
) -> dict[int, tuple[Ray, Float[Array, " n"]]]:
    """Rays to each light but those from all sides, and how far they reach.

    That is below 0 where a surface faces away, and no ray need be cast.
    """
    start, found = surface.point + surface.off, {}
    for number, light in enumerate(world.lights):
        way = light.towards(start)
        if way is not None:
            faces = path.live & (way.dot(surface.normal) > 0)
            end = 1.0 if light.is_near else jnp.inf
            found[number] = Ray(start, way), jnp.where(faces, end, -jnp.inf)
    return found


def _mirrored(ray: Ray, surface: Surface) -> Ray:
    return Ray(surface.point + surface.off, mirrored(ray.direction, surface.normal))


class _Ray(NamedTuple):
    """A ray, its part of a pixel's color, and how many bounces lie behind it."""

    ray: Ray
    weight: Float[Array, "*batch"]
    level: Int[Array, "*batch"]


class _Stack(NamedTuple):
    """Rays that wait, (depth, n), and how many of each pixel there are."""

    rays: _Ray
    height: Int[Array, " n"]


def _through_glass(world: World, path: Path, depth: int) -> Path:
    """The path after all rays of the tree that mirrors and glass make of each."""
    blank = jnp.zeros((depth, *path.live.shape), path.weight.dtype)
    nowhere = Vec3(blank, blank, blank)
    none = jnp.zeros(blank.shape, jnp.int32)
    stack = _Stack(_Ray(Ray(nowhere, nowhere), blank, none), none[0])

    def step(state: tuple[Path, _Stack]) -> tuple[Path, _Stack]:
        return _split(world, *state, depth)

    path, _ = _repeated(step, (path, stack), 2 ** (depth + 1) - 1)
    return path


def _split(world: World, path: Path, stack: _Stack, depth: int) -> tuple[Path, _Stack]:
    """Go on behind the surfaces, and keep the mirrored rays for later."""
    surface, path = met(world, path)
    material, more = surface.material, path.level < depth
    assert material.transmit is not None
    assert material.ior is not None
    assert surface.inside is not None
    through = jnp.where(more, material.transmit, 0)
    back = 0.0 if material.reflect is None else material.reflect
    back = jnp.where(more, back, 0)
    path = _lit(world, path, surface, 1 - back - through)
    ior = jnp.where(surface.inside, material.ior, 1 / material.ior)
    bent, cos_out, glance = refracted(path.ray.direction, surface.normal, ior)
    turned = jnp.where(cos_out > 0, 0, 1)
    if material.fresnel is not None:
        turned = jnp.where(material.fresnel > 0, glance, turned)
    first = path.weight * through * (1 - turned)
    second = path.weight * (back + through * turned)
    goes_on = path.live & (first > LEAST_WEIGHT)
    goes_back = path.live & (second > LEAST_WEIGHT)
    ahead = Ray(surface.point - surface.off, bent)
    behind = _mirrored(path.ray, surface)
    # What goes on is cast next, and what goes back after it, or next if it is alone.
    waits = _Ray(behind, second, path.level + 1)
    stack = _pushed(stack, waits, goes_on & goes_back)
    waited, was_there, stack = _popped(stack, ~(goes_on | goes_back))
    following = jax.tree.map(
        lambda on, back, old: jnp.where(goes_on, on, jnp.where(goes_back, back, old)),
        _Ray(ahead, first, path.level + 1),
        waits,
        waited,
    )
    live = goes_on | goes_back | was_there
    return path._replace(**following._asdict(), live=live), stack


def _pushed(stack: _Stack, waits: _Ray, chosen: Bool[Array, " n"]) -> _Stack:
    """The stack with one more of each chosen pixel's rays."""
    here = (_slots(stack) == stack.height[None]) & chosen[None]
    rays = jax.tree.map(lambda x, new: jnp.where(here, new[None], x), stack.rays, waits)
    return _Stack(rays, stack.height + chosen.astype(jnp.int32))


def _popped(
    stack: _Stack, chosen: Bool[Array, " n"]
) -> tuple[_Ray, Bool[Array, " n"], _Stack]:
    """The last of each chosen pixel's rays, whether there was one, and the rest."""
    there = chosen & (stack.height > 0)
    here = _slots(stack) == jnp.maximum(stack.height - 1, 0)[None]
    last = jax.tree.map(
        lambda x: jnp.sum(jnp.where(here, x, 0), axis=0, dtype=x.dtype), stack.rays
    )
    return last, there, stack._replace(height=stack.height - there.astype(jnp.int32))


def _slots(stack: _Stack) -> Int[Array, "depth n"]:
    """Numbers of the places of a stack."""
    return jax.lax.broadcasted_iota(jnp.int32, stack.rays.weight.shape, 0)
