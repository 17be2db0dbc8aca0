"""Light along rays: what each meets, is lit by, and sees mirrored or through glass.

Every ray is searched without a derivative and then followed with one, at every bounce:
`while` loops have no derivative in reverse mode, and need none. Mirrors alone make a
chain of rays. Where something lets light through, a ray may go on as two, so that one
of them waits on a stack of its own: a scene without glass has no stack in its program,
and one without mirrors no bounce.
"""

__all__ = [
    "TRAIL",
    "Found",
    "Path",
    "World",
    "color_of",
    "found",
    "setting_out",
    "shadowing",
    "world_of",
]

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers
from impostor_jax.rendering.clipping import Clipping
from impostor_jax.rendering.follow import Seen, followed, member_of, normals_of, of_seen
from impostor_jax.rendering.group import Group
from impostor_jax.rendering.lights import AbstractLight, reflected
from impostor_jax.rendering.material import Material
from impostor_jax.rendering.search import SEARCHED, Searched, first_met, searched
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


class Found(NamedTuple):
    """What a search has found that rays meet; of no meaning where they meet nothing.

    Attributes:
        t: Ray parameter.
        code: Of the shape and its part; below 0 where nothing is met.
        normal: Unit normal, against the ray.
        clearance: Length by which rays that start here are moved along it.
        inside: Whether the ray came through the shape; None where nothing lets it.
    """

    t: Float[Array, " n"]
    code: Int[Array, " n"]
    normal: Vec3
    clearance: Float[Array, " n"]
    inside: Bool[Array, " n"] | None


class Surface(NamedTuple):
    """What rays have met, with derivatives; of no meaning where they meet nothing.

    Attributes:
        point: Where.
        normal: Unit normal, against the ray.
        off: Vector along it by which rays that start here are moved.
        material: Of each point.
        inside: As of `Found`.
        hidden: Of each light that casts shadows, where it is hidden.
    """

    point: Vec3
    normal: Vec3
    off: Vec3
    material: Material
    inside: Bool[Array, " n"] | None
    hidden: dict[int, Bool[Array, " n"]]


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
    surface, path = _met(world, path)
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


def found(
    world: World, path: Path, any_hider: bool = True
) -> tuple[Found, Int[Array, "lights n"]]:
    """Search what rays meet, and what hides the lights there; without a derivative.

    One program searches all, turn by turn: the rays, then those to each light.

    Args:
        world: What they can meet.
        path: Where they are.
        any_hider: Whether any shape does that hides a light, be it the first or not.

    Returns:
        What is met, and of each light in `shadowing` the code of what hides it, below 0
        where nothing does. What lets light through hides a light all the same.
    """
    world, path = jax.lax.stop_gradient((world, path))
    forward = jnp.where(path.live, jnp.inf, -jnp.inf).astype(path.weight.dtype)

    def to_light(light: AbstractLight, here: Found) -> tuple[Ray, Float[Array, " n"]]:
        start = path.ray.at(here.t) + here.normal * here.clearance
        way = light.towards(start)
        assert way is not None
        # Where a surface faces away, no ray need be cast.
        faces = (here.code >= 0) & (way.dot(here.normal) > 0)
        end = 1.0 if light.is_near else jnp.inf
        return Ray(start, way), jnp.where(faces, end, -jnp.inf).astype(forward.dtype)

    ways = [lambda _: (path.ray, forward)]
    ways += [partial(to_light, world.lights[k]) for k in shadowing(world)]

    def turn(here: Found, number: Int[Array, ""]) -> tuple[Found, Int[Array, " n"]]:
        ray, reach = jax.lax.switch(number, ways, here)
        is_first = number == 0
        t, code = first_met(world.shapes, ray, reach, any_hider & ~is_first)
        here = jax.lax.cond(
            is_first, lambda: _found(world, path, t, code), lambda: here
        )
        return here, code

    nothing = jax.eval_shape(lambda: _found(world, path, forward, path.trail))
    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), nothing)
    turns = jnp.arange(len(ways), dtype=jnp.int32)
    here, codes = jax.lax.scan(turn, nothing, turns)
    return here, codes[1:]


def shadowing(world: World) -> list[int]:
    """Numbers of the lights that cast shadows: all but those from all sides."""
    anywhere = world.background
    towards = [light.towards(anywhere) for light in world.lights]
    return [k for k, way in enumerate(towards) if way is not None]


def _found(
    world: World, path: Path, t: Float[Array, " n"], code: Int[Array, " n"]
) -> Found:
    """What is known of the surfaces that rays meet."""
    ray, groups = path.ray, world.shapes.groups
    t = jnp.where(code < 0, 0, t)
    if world.clipping is not None:
        is_beyond = (path.level == 0) & world.clipping.is_beyond(ray.at(t))
        code = jnp.where(is_beyond, -1, code)
        t = jnp.where(is_beyond, 0, t)
    normal = normals_of(groups, ray, t, code)
    tells = world.materials[0].transmit is not None

    def put(number: int, seen: Seen, values: Any) -> Any:
        size = member_of(world.anchors[number], seen.member)
        anchor = Vec3.from_array(size[..., :3]), size[..., 3]
        inside = seen.shape.implicit(ray.at(t / 2)) < 0 if tells else None
        own = clearance(ray, t, normal, anchor), inside
        return jax.tree.map(partial(jnp.where, seen.mine), own, values)

    none = jnp.zeros_like(t), jnp.zeros(t.shape, bool) if tells else None
    off, inside = of_seen(groups, code, put, none)
    return Found(t, code, normal, off, inside)


def _met(world: World, path: Path) -> tuple[Surface, Path]:
    """What rays meet, and the paths of those that meet anything."""
    ray = path.ray
    here, hiders = found(world, path)
    here, dark = checkpoint_name((here, hiders >= 0), SEARCHED)
    t, normal = followed((world.shapes.groups, ray), here.t, here.code, here.normal)
    assert normal is not None
    hits = here.code >= 0
    # That of any shape where nothing is met: 0 would be no index of refraction.
    any_material = jax.tree.map(
        lambda x: jnp.broadcast_to(x[0], (*t.shape, *x.shape[1:])),
        jax.lax.stop_gradient(world.materials[0]),
    )
    surface = Surface(
        point=ray.at(jnp.where(hits, t, 0)),
        normal=normal,
        off=jax.lax.stop_gradient(normal) * here.clearance,
        material=of_seen(
            world.shapes.groups, here.code, partial(_put_material, world), any_material
        ),
        inside=here.inside,
        hidden=dict(zip(shadowing(world), dark, strict=True)),
    )
    behind = path.live & ~hits
    sky = jax.tree.map(
        lambda b: jnp.where(behind, path.weight * b, 0), world.background
    )
    return surface, path._replace(
        live=hits,
        color=path.color + sky,
        trail=path.trail * TRAIL + jnp.where(path.live, here.code + 1, 0),
    )


def _put_material(
    world: World, number: int, seen: Seen, material: Material
) -> Material:
    """The materials of rays, where a group's stand in their place."""

    def chosen(new: Array, old: Array) -> Array:
        mine = seen.mine.reshape(seen.mine.shape + (1,) * (new.ndim - 1))
        return jnp.where(mine, new, old)

    own = member_of(world.materials[number], seen.member)
    return jax.tree.map(chosen, own, material)


def _lit(world: World, path: Path, surface: Surface, part: Numbers) -> Path:
    """The path with the light that a part of the surfaces' own colors reflects."""
    hidden = [surface.hidden.get(k) for k in range(len(world.lights))]
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
    surface, path = _met(world, path)
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
