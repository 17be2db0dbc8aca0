"""Heightfield: the surface y = height(x, z) over a rectangle, seen from both sides.

Where a ray meets it is found by walking over the patches of a grid
(`impostor_jax.primitives.heightfield_cells`), or by marching where the height is a
function (`impostor_jax.primitives.heightfield_march`). Depth is not differentiated
through either but follows from the equation of the surface at the hit
(`impostor_jax.primitives.surface`).

Rounding. Walk and march run near the surface (`Ray.brought_near`). The hit is closed in
on from the ray's own side, by steps that provably do not cross, and a last step of
Newton's is kept where it lowers the gap. The gap is then no more than
its rounding, and the depth as exact as a change of ray and heights by a few eps leaves
it.
"""

__all__ = ["Heightfield"]

import itertools
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.arguments import float_array, is_concrete, one_of
from impostor_jax.compiling import compiled
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.hull import DiscHull
from impostor_jax.geometry.rays import Hit, Interval, Ray, plane_interval, slab_interval
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, eps, safe_divide, safe_sqrt
from impostor_jax.primitives.base import AbstractOnePiece, check_single
from impostor_jax.primitives.heightfield_cells import first_crossing
from impostor_jax.primitives.heightfield_grid import (
    INTERPOLATIONS,
    all_control_points,
    relief,
)
from impostor_jax.primitives.heightfield_height import (
    Function,
    as_tree,
    function_surface,
    grid_surface,
)
from impostor_jax.primitives.heightfield_march import advance
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.stretch import End, Stretch
from impostor_jax.primitives.surface import facing, hit_tangent

MOST_CROSSINGS = 4
"""Of a ray with a ground that is part of a solid; each is walked to anew."""


class Heightfield(AbstractOnePiece):
    """Open surface y = height(x, z) over a rectangle of its own frame, whose y is up.

    It has no sides and no bottom: a ray from below sees its underside, and beside the
    extent there is nothing. In a batch every one has its own grid; map it with
    `jax.vmap`.

    Args:
        height: Heights in meters: an array (*batch, n, m), n samples along x and m
            along z, at least 2 each, the outermost at the ends of the extent; or a
            function of two arrays x and z of one shape, elementwise. The arrays and
            numbers that a function holds as a pytree, as an `eqx.Module` does, are
            differentiated in.
        extent: ((x0, x1), (z0, z1)) in meters, for one or for each; of a function it
            sets the dtype.
        interpolation: Of an array: "bilinear", or "bicubic" (Catmull-Rom, one-sided
            slopes at the border). Both pass through the samples.
        lipschitz: Bound of the slope of a function, in meters per meter, which needs
            one: no crossing is passed over as long as it holds.
        curvature: Bound of a function's second derivative along any horizontal
            direction, in 1/m. A ray then closes in by tens of steps and not hundreds.
        world_from_field: Pose of its own frame; None where that is the world.

    Derivatives:
        The depth of a pixel is smooth in the ray, the pose and the heights while the
        same fold is seen, and jumps where a crest crosses the pixel. It grows without
        bound as a ray grazes; on a ray that grazes to rounding it is 0. A bilinear
        surface has creases at its samples: there it is that of one side.

    Raises:
        ValueError: An argument is out of range or missing, or a shape does not fit.
    """

    measure: ClassVar = "extent", 2
    height: Float[Array, "*batch n m"] | Function
    extent: Float[Array, "*batch 2 2"]
    lipschitz: Float[Array, ""] | None
    curvature: Float[Array, ""] | None
    world_from_field: RigidTransform | None
    interpolation: str = eqx.field(static=True)

    def __init__(
        self,
        height: Any,
        extent: Any,
        interpolation: str = "bilinear",
        lipschitz: Any = None,
        curvature: Any = None,
        world_from_field: Any = None,
    ):
        one_of("interpolation", interpolation, INTERPOLATIONS)
        extent = _checked_extent(extent)
        if callable(height):
            self.height = as_tree(height)
            if lipschitz is None:
                raise ValueError(
                    "lipschitz must bound the slope of height where that is a "
                    "function, got None"
                )
        else:
            grid = float_array("height", height, (None, None), "meters")
            if min(grid.shape[-2:]) < 2:
                raise ValueError(
                    "height must have at least 2 samples along x and z, "
                    f"got shape {grid.shape}"
                )
            if lipschitz is not None or curvature is not None:
                raise ValueError(
                    "lipschitz and curvature must be None for an array of heights, "
                    f"whose bounds are known; got {lipschitz} and {curvature}"
                )
            dtype = jnp.result_type(grid, extent)
            self.height, extent = grid.astype(dtype), extent.astype(dtype)
            if extent.ndim == 2:
                extent = jnp.broadcast_to(extent, (*grid.shape[:-2], 2, 2))
        self.extent = extent
        self.lipschitz = _checked_bound("lipschitz", lipschitz, extent.dtype)
        self.curvature = _checked_bound("curvature", curvature, extent.dtype)
        self.world_from_field = RigidTransform.of(world_from_field)
        self.interpolation = interpolation

    @property
    @override
    def is_bounded(self) -> bool:
        return not callable(self.height)

    @property
    @override
    def hull(self) -> DiscHull | None:
        if callable(self.height):
            return None
        bottom, top = relief(self.height, self.interpolation)
        low, high = (
            jnp.stack([self.extent[..., 0, end], level, self.extent[..., 1, end]], -1)
            for end, level in enumerate((bottom, top))
        )
        rotation, translation = jnp.eye(3), jnp.zeros(3)
        if self.world_from_field is not None:
            rotation = self.world_from_field.rotation
            translation = self.world_from_field.translation
        rotation = jnp.broadcast_to(rotation, (*low.shape, 3)).astype(self.dtype)
        translation = jnp.broadcast_to(translation, low.shape).astype(self.dtype)
        return DiscHull.of_cuboid(low, high, rotation, translation)

    @override
    def intersect(self, ray: Ray) -> Hit:
        check_single(self, "heightfield")
        return Hit.on_one_piece(_first_hit(ray, self))

    @override
    @compiled
    def normal(self, ray: Ray, hit: Hit) -> Vec3:
        point = self._hit_point(ray, hit)
        _, by_x, by_z = self.surface(point.x, point.z)
        n = Vec3(-by_x, jnp.ones_like(by_x), -by_z).normalize()
        if self.world_from_field is not None:
            n = Vec3.from_array(self.world_from_field.rotate(n.stack()))
        return facing(n, ray.direction, hit.mask)

    @override
    def stretches(self, ray: Ray) -> tuple[Stretch, Stretch]:
        """Stretches in the ground, which goes down without end.

        It ends beside the extent, which is no surface of its own: there a stretch goes
        on without an end (`sides` are the planes that cut it). Four crossings are found
        at most; after the last a ray counts as above the ground.
        """
        check_single(self, "heightfield")
        return _ground_stretches(ray, self)

    @property
    def sides(self) -> tuple[Plane, ...]:
        """The four planes beside the extent, with normals that point away from it."""
        pose = self.world_from_field
        found = []
        for axis, end in itertools.product((0, 1), (0, 1)):
            way = np.zeros(3)
            way[2 * axis] = 2 * end - 1
            normal = jnp.asarray(way, self.dtype)
            point = jnp.abs(normal) * self.extent[axis, end]
            if pose is not None:
                point, normal = pose.apply(point), pose.rotate(normal)
            found.append(Plane(point, normal))
        return tuple(found)

    @override
    @compiled
    def implicit(self, point: Vec3) -> Float[Array, "*batch"]:
        """First-order signed distance in meters: the gap over sqrt(1 + slope^2).

        Negative below. Beside the extent it is positive: the distance from the extent
        put together with that of the surface at its border.
        """
        still = Vec3(*(jnp.zeros_like(point.x) for _ in range(3)))
        p = self._own_ray(Ray(point, still)).origin
        (x0, x1), (z0, z1) = self.extent
        x, z = jnp.clip(p.x, x0, x1), jnp.clip(p.z, z0, z1)
        height, by_x, by_z = self.surface(x, z)
        distance = (p.y - height) / jnp.sqrt(1 + by_x * by_x + by_z * by_z)
        beside = (p.x - x) ** 2 + (p.z - z) ** 2
        return jnp.where(beside > 0, safe_sqrt(beside + distance * distance), distance)

    @override
    def outline_gap(self, ray: Ray) -> None:
        return None

    @override
    def transformed(self, target_from_source: RigidTransform) -> "Heightfield":
        pose = self.world_from_field
        pose = target_from_source if pose is None else target_from_source @ pose
        return eqx.tree_at(
            lambda h: h.world_from_field, self, pose, is_leaf=lambda x: x is None
        )

    def surface(self, x: Numbers, z: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        """Height at points of its own frame, and its derivatives in x and z.

        Beside the extent the patches of a grid are continued.
        """
        if callable(self.height):
            return function_surface(self.height, x, z)
        return grid_surface(self.height, self.extent, self.interpolation, x, z)

    def _own_ray(self, ray: Ray) -> Ray:
        """The ray in its own frame."""
        if self.world_from_field is None:
            return ray
        own = self.world_from_field.inverse()
        return Ray(
            origin=Vec3.from_array(own.apply(ray.origin.stack())),
            direction=Vec3.from_array(own.rotate(ray.direction.stack())),
        )

    def _hit_point(self, ray: Ray, hit: Hit) -> Vec3:
        """Hit in its own frame; on a miss the middle of the extent.

        There a function has a height, which it may not have where a miss ends.
        """
        point = self._own_ray(ray).at(jnp.where(hit.mask, hit.t, 0))
        x, z = jax.lax.stop_gradient(jnp.mean(self.extent, axis=-1))
        return point.where(hit.mask, Vec3(x, jnp.zeros_like(x), z))


@jax.jit
def _ground_stretches(ray: Ray, field: Heightfield) -> tuple[Stretch, Stretch]:
    own = field._own_ray(ray)
    center, half_x, half_z, relief, radius = _bounds(field)
    # Before all of it, wherever the origin is.
    away = (own.origin - center).norm() + relief + half_x + half_z + radius
    start = -away / own.direction.norm()
    over = _over_extent(own, field)
    begin = jnp.maximum(over.lower, start)
    middle = jnp.where(begin < over.upper, (begin + over.upper) / 2, begin)
    middle = jnp.where(jnp.isfinite(middle), middle, 0)

    def level(t: Numbers) -> tuple[Numbers, Numbers]:
        """Height above the ground, and how fast it grows across that."""
        p, d = own.at(t), own.direction
        (x0, x1), (z0, z1) = field.extent
        height, by_x, by_z = field.surface(jnp.clip(p.x, x0, x1), jnp.clip(p.z, z0, z1))
        rise = d.y - by_x * d.x - by_z * d.z
        return p.y - height, rise / jnp.sqrt(1 + by_x * by_x + by_z * by_z)

    def cross(t: Numbers, is_open: Bool[Array, "*batch"]) -> tuple[Numbers, Numbers]:
        """The next crossing, and the slope there."""
        from_here = Ray(ray.at(t), ray.direction)
        at = jnp.where(is_open, t + field.intersect(from_here).t, jnp.inf)
        return at, level(jnp.where(jnp.isfinite(at), at, middle))[1]

    t, is_open, found = start, jnp.ones(middle.shape, bool), []
    for _ in range(MOST_CROSSINGS):
        at, slope = cross(t, is_open)
        is_open = jnp.isfinite(at)
        found.append((at, slope))
        # Off the surface by the rounding of where it was found: there and back again.
        way = jnp.where(is_open, jnp.abs(t) + jnp.abs(at - t), 0)
        room = eps(t.dtype, 4) * (own.origin.norm() + way * own.direction.norm())
        t = jnp.where(is_open, at + safe_divide(room, jnp.abs(slope)), 0)
    # Whether the ray begins below is told by how it first crosses, or where it never
    # does, by any place.
    first, slope = found[0]
    begins_below = jnp.where(jnp.isfinite(first), slope > 0, level(middle)[0] < 0)
    piece = jnp.zeros(t.shape, int), jnp.zeros(t.shape, bool)
    nowhere = jnp.full_like(t, -jnp.inf), jnp.zeros_like(t)
    ends = [
        jax.tree.map(lambda x, y: jnp.where(begins_below, x, y), *pair)
        for pair in itertools.pairwise([nowhere, *found])
    ]
    enter, leave, again, out = (End(at, *piece, jnp.abs(n)) for at, n in ends)
    return Stretch(enter, leave), Stretch(again, out)


def _over_extent(own: Ray, field: Heightfield) -> Interval:
    """Stretch of a ray of the field's own frame that is above or below its extent."""
    x, z = (
        Vec3.from_array(jnp.eye(3, dtype=field.dtype)[0]),
        Vec3.from_array(jnp.eye(3, dtype=field.dtype)[2]),
    )
    (x0, x1), (z0, z1) = field.extent
    return plane_interval(own, x, x0, x1).overlap(plane_interval(own, z, z0, z1))


class _Bounds(NamedTuple):
    """Where a surface is, in its own frame.

    Attributes:
        center: A point amid it.
        half_x: Half of its extent along x.
        half_z: Likewise along z.
        relief: How far it rises above the point, at most, or falls below.
        radius: Half the diagonal of the extent.
    """

    center: Vec3
    half_x: Float[Array, ""]
    half_z: Float[Array, ""]
    relief: Float[Array, ""]
    radius: Float[Array, ""]


def _bounds(field: Heightfield) -> _Bounds:
    x, z = jnp.mean(field.extent, axis=-1)
    half_x, half_z = (field.extent[:, 1] - field.extent[:, 0]) / 2
    radius = jnp.sqrt(half_x * half_x + half_z * half_z)
    if callable(field.height):
        assert field.lipschitz is not None
        y, relief = field.surface(x, z)[0], field.lipschitz * radius
    else:
        points = all_control_points(field.height, field.interpolation)
        low, high = jnp.min(points), jnp.max(points)
        y, relief = (low + high) / 2, (high - low) / 2
    return _Bounds(Vec3(x, y, z), half_x, half_z, relief, radius)


@jax.custom_jvp
@jax.jit
def _first_hit(ray: Ray, field: Heightfield) -> Float[Array, "*batch"]:
    """Ray parameter of the first hit, `+inf` on a miss."""
    ray = field._own_ray(ray)
    center, half_x, half_z, relief, radius = _bounds(field)
    slope, points, y = field.lipschitz, None, center.y
    if not callable(field.height):
        points = all_control_points(field.height, field.interpolation)
    near, foot = ray.brought_near(center, center, radius)
    span = Interval(lower=-foot, upper=jnp.full_like(foot, jnp.inf))
    # From above the surface by its size, so that a ray begins clearly on one side.
    for axis, half in enumerate((half_x, relief + radius, half_z)):
        across = Vec3.from_array(jnp.eye(3, dtype=field.dtype)[axis])
        span = span.overlap(slab_interval(near, across, half))

    def gap(near: Ray, t: Numbers) -> Numbers:
        p = near.at(t)
        # A function may have no height beside the extent.
        x, z = jnp.clip(p.x, -half_x, half_x), jnp.clip(p.z, -half_z, half_z)
        return p.y + center.y - field.surface(x + center.x, z + center.z)[0]

    if points is not None:
        t = first_crossing(points - y, near, half_x, half_z, span)
    else:
        assert slope is not None
        # Rounding of x and z, which the slope multiplies, and of the heights.
        reach = slope * jnp.sum(jnp.max(jnp.abs(field.extent), axis=1)) + 2 * jnp.abs(y)
        t = advance(gap, near, span, reach, slope, field.curvature)
    return jnp.where(jnp.isfinite(t), foot + t, jnp.inf)


@_first_hit.defjvp
def _first_hit_jvp(primals, tangents):
    t = _first_hit(*primals)
    return t, _hit_tangent(t, primals, tangents)


@jax.jit
def _hit_tangent(t: Numbers, primals: Any, tangents: Any) -> Numbers:
    hit = Hit.on_one_piece(t)

    def gap(ray: Ray, field: Heightfield) -> tuple[Numbers, Numbers]:
        """Gap at the held hit, and its slope along the ray."""
        p, d = field._hit_point(ray, hit), field._own_ray(ray).direction
        height, by_x, by_z = field.surface(p.x, p.z)
        return p.y - height, d.y - by_x * d.x - by_z * d.z

    _, d_gap, slope = jax.jvp(gap, primals, tangents, has_aux=True)
    return hit_tangent(-d_gap, slope, hit.mask)


def _checked_extent(value: Any) -> Float[Array, "*batch 2 2"]:
    extent = float_array("extent", value, (2, 2), "meters")
    if is_concrete(extent):
        ends = np.asarray(extent)
        if not np.all(ends[..., 0] < ends[..., 1]):
            raise ValueError(
                "extent must be ((x0, x1), (z0, z1)) in meters with x0 < x1 and "
                f"z0 < z1, got {ends.tolist()}"
            )
    return extent


def _checked_bound(name: str, value: Any, dtype: Any) -> Float[Array, ""] | None:
    """A number that is not negative, or None."""
    if value is None:
        return None
    bound = float_array(name, value, ()).astype(dtype)
    if bound.shape != () or (is_concrete(bound) and float(bound) < 0):
        raise ValueError(f"{name} must be a number, not negative, got {value}")
    return bound
