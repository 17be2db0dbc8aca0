"""The box as a fit moves it: six faces, of which a ray from outside sees one.

All of its faces are what a cylinder's caps are. A ray spends an interval in each of
three slabs: it enters the box where it enters the last of them and leaves it where it
leaves the first. Past the outline, which is where it leaves one before it has entered
another, depth goes on in the plane that it enters last, and grows by how far the ray
passes beyond that face.
"""

__all__ = ["BoxBody", "box_body"]

import itertools
from collections import OrderedDict
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.compiling import computed_once
from impostor_jax.fit.body import (
    AbstractAxislessBody,
    Chord,
    FreeDirections,
    Margins,
    Passing,
    Rays,
    Readout,
    grown,
    local_ray,
)
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.so3 import rotation_by, turn_of
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, product, smallest_slope
from impostor_jax.primitives.box import Box

FACES = ((0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1))
"""Axis and side of each face."""

ENDS = tuple((axis + 1) * side for axis, side in FACES)
"""Their numbers: an axis, counted from 1, times a side."""

FARTHEST = 1e3
"""Sizes of the box within which a ray along a slab enters and leaves it."""

TURNS = np.array(
    [
        turn
        for order in itertools.permutations(np.eye(3))
        for sides in itertools.product((1, -1), repeat=3)
        if np.linalg.det(turn := np.array(order) * np.array(sides)[:, None]) > 0
    ]
)
"""The 24 rotations that leave a cube as it is."""


class BoxBody(AbstractAxislessBody):
    """A box. It turns about its own axes, and each of its faces moves along its normal.

    Where a face is not seen, exactly one coordinate has no effect on the readings.

    Attributes:
        center: Middle of the faces.
        frame: Its axes, unit vectors, one a row.
        half: Half the lengths of its edges.
    """

    center: Float[Array, "*batch 3"]
    frame: Float[Array, "*batch 3 3"]
    half: Float[Array, "*batch 3"]

    @staticmethod
    @override
    def of(shape: Box) -> "BoxBody":
        rotation = jnp.asarray(shape.rotation)
        return box_body(
            jnp.asarray(shape.center), jnp.swapaxes(rotation, -1, -2), shape.size / 2
        )

    @property
    @override
    def shape(self) -> Box:
        return eqx.tree_at(
            lambda b: (b.center, b.rotation, b.size),
            Box((0, 0, 0), np.eye(3), (1, 1, 1)),
            (self.center, self.rotation, self.edges),
        )

    @property
    def rotation(self) -> Float[Array, "*batch 3 3"]:
        """To the frame of the camera, or the world, from its own."""
        return jnp.swapaxes(self.frame, -1, -2)

    @property
    def edges(self) -> Float[Array, "*batch 3"]:
        """Full lengths."""
        return 2 * self.half

    @property
    @override
    def radius(self) -> Numbers:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Half the shortest edge."""
        return jnp.min(self.half, axis=-1)

    @property
    @override
    def size(self) -> Numbers:
        return jnp.mean(self.half, axis=-1)

    @property
    @override
    def coordinates(self) -> dict[str, tuple[str, ...]]:
        """First, second and third are along the box's own axes."""
        order = ("first", "second", "third")
        return {
            "rotation": tuple(f"rotation_{one}" for one in order),
            "along_edges": tuple(f"center_{one}" for one in order),
            "size": tuple(f"size_{one}" for one in order),
        }

    @property
    @override
    def ends(self) -> tuple[int, ...]:
        return ENDS

    @property
    @override
    def end_axes(self) -> Float[Array, "e 3"]:
        return jnp.stack([side * self.frame[k] for k, side in FACES])

    @property
    @override
    def is_long(self) -> Bool[Array, "*batch"]:
        return jnp.ones(self.radius.shape, bool)

    @property
    @override
    def bends(self) -> int:
        return 1

    @override
    def passing(self, rays: Rays, chord: Chord = 0.0, apart: bool = False) -> Passing:
        local, foot = local_ray(rays, self.center, self.frame)
        if apart:
            local, foot = computed_once(lambda: (local, foot))
        slabs = self._slabs(local)
        enter = _largest([first for first, _ in slabs])
        leave = -_largest([-last for _, last in slabs])
        outside = enter + foot > 0
        cap = jnp.where(outside, enter, leave)
        normal = self._seen(local, outside)
        facing = normal.dot(local.direction)
        length = jnp.sqrt(local.direction.dot(local.direction))
        beyond, r = _largest(self._beside(normal, local.at(cap))), self.radius
        # How far within the outline it passes.
        within = jnp.minimum(-_largest(self._overshoots(local)), r)
        zero = jnp.zeros_like(cap)
        return Passing(
            local=local,
            foot=foot,
            inverse=zero + 1,
            nearest=(enter + leave) / 2,
            square=(2 * r - within) * within,
            half=(leave - enter) / 2,
            half_slope=zero,
            outside=outside,
            within=jnp.zeros(cap.shape, bool),
            cos_incidence=jnp.minimum(jnp.abs(facing) / length, 1),
            cap=cap,
            on_cap=jnp.ones(cap.shape, bool),
            rim=r + beyond,
            cap_radius=r + zero,
            overshoot=jnp.maximum(beyond, 0),
            plane_weight=zero + 1,
            along=zero,
            enter_along=zero,
            leave_along=zero,
        )

    def _slabs(self, local: Ray) -> list[tuple[Numbers, Numbers]]:
        """Ray parameters at which each slab is entered and left, finite for every ray.

        A ray along a slab is in it all the way, within it or not: how far it passes
        beside is an overshoot.
        """
        far, found = FARTHEST * self.size, []
        for half, o, d in zip(self.half, *_along(local), strict=True):
            parallel = jnp.abs(d) < smallest_slope(d.dtype)
            per_step = jnp.where(parallel, 0, 1 / jnp.where(parallel, 1, d))
            reach = jnp.where(parallel, far, half * jnp.abs(per_step))
            found.append((-o * per_step - reach, -o * per_step + reach))
        return found

    def _seen(self, local: Ray, outside: Bool[Array, "*batch"]) -> Vec3:
        """Outward normal of the face that rays see, in the box's own frame."""
        slabs = self._slabs(local)
        enters = _first_largest([first for first, _ in slabs])
        leaves = _first_largest([-last for _, last in slabs])
        sides = [_side(d) for d in _parts(local.direction)]
        faces = zip(enters, leaves, sides, strict=True)
        return Vec3(
            *(
                jnp.where(outside, jnp.where(one, -side, 0), jnp.where(other, side, 0))
                for one, other, side in faces
            )
        )

    def _beside(self, normal: Vec3, point: Vec3) -> list[Numbers]:
        """How far points of a face's plane lie beyond it, along each of its edges."""
        return [
            jnp.where(n == 0, jnp.abs(x) - half, -jnp.inf)
            for n, x, half in zip(_parts(normal), _parts(point), self.half, strict=True)
        ]

    def _overshoots(self, local: Ray) -> list[Numbers]:
        """How far, along each axis, rays pass beyond the face by which they leave.

        There where they have entered both other slabs.
        """
        slabs, found = self._slabs(local), []
        for k, (half, o, d) in enumerate(zip(self.half, *_along(local), strict=True)):
            others = [first for j, (first, _) in enumerate(slabs) if j != k]
            found.append(_side(d) * (o + d * jnp.maximum(*others)) - half)
        return found

    @override
    def covers(self, passing: Passing) -> Bool[Array, "*batch"]:
        return (passing.half > 0) & passing.outside

    def _of_plane(
        self, local: Ray, reach: Numbers, normal: Vec3
    ) -> tuple[list[Numbers], list[Numbers]]:
        """Derivatives in all coordinates where a ray meets the plane of a face.

        With n the face's normal and x the point, n.x = h: turned by w, n.x grows by
        w.(n cross x), and the ray's parameter by that less, and h more, over n.d.

        Returns:
            Of the ray's parameter, and of n.x - h where the ray stays at the point.
        """
        facing = normal.dot(local.direction)
        per_facing = jnp.where(facing == 0, 0, 1 / jnp.where(facing == 0, 1, facing))
        held = _parts(normal.cross(local.at(reach)))
        for k, side in FACES:
            is_own = _parts(normal)[k] == side
            held.append(jnp.where(is_own, -1, 0).astype(facing.dtype))
        return [-one * per_facing for one in held], held

    @override
    def end_shown(self, passing: Passing, depth: Numbers, slack: Numbers) -> Numbers:
        normal = self._seen(passing.local, passing.outside)
        face = normal.x + 2 * normal.y + 3 * normal.z
        # Beside an edge readings may be of the other face, as where the image ends.
        enters, leaves = zip(*self._slabs(passing.local), strict=True)
        other = jnp.where(passing.outside, _middle(enters), _middle(leaves))
        is_own = jnp.abs(other + passing.foot - depth) > slack
        return jnp.where((passing.rim < passing.cap_radius) & is_own, face, 0)

    @override
    def width_of_ends(self, beside: Float[Array, ""]) -> Float[Array, " e"]:
        return jnp.zeros(len(self.ends), beside.dtype)

    @override
    def outward(self, passing: Passing) -> Float[Array, "e n"]:
        point = _parts(passing.local.at(passing.cap))
        return jnp.stack([side * point[k] for k, side in FACES])

    @override
    def far_side(self, passing: Passing) -> Numbers:
        return passing.nearest + passing.half

    @override
    def of_reading(
        self, passing: Passing, alpha: Numbers, beta: Numbers, on_cap: Bool[Array, "*b"]
    ) -> list[Numbers]:
        """Derivative of the depth where rays see a face, or pass beside it."""
        local, reach = passing.local, passing.cap
        normal = self._seen(local, passing.outside)
        of_reach, _ = self._of_plane(local, reach, normal)
        point, past = local.at(reach), passing.overshoot > 0
        is_farthest = _first_largest(self._beside(normal, point))
        pairs = zip(is_farthest, _parts(point), strict=True)
        farthest = Vec3(*(jnp.where(one & past, _side(x), 0) for one, x in pairs))
        _, of_side = self._of_plane(local, reach, farthest)
        slides = 1 + farthest.dot(local.direction)
        pairs = zip(of_reach, of_side, strict=True)
        told = [slides * one + other for one, other in pairs]
        return [jnp.where(on_cap, one, 0) for one in told]

    @override
    def moved_across(
        self, passing: Passing, square: Numbers, slide: Numbers
    ) -> Passing:
        # All that it has are faces, which do not bend.
        return passing

    @override
    def margins(self, passing: Passing) -> Margins:
        overshoots = self._overshoots(passing.local)
        step = _parts(passing.local.direction)
        value = jnp.stack([-jnp.ones_like(overshoots[0]), *overshoots])
        ends = [(k + 1) * _side(d[0]) for k, d in enumerate(step)]
        end = jnp.stack([jnp.zeros_like(ends[0]), *ends])
        tells = jnp.broadcast_to(passing.outside[None], value.shape)
        return Margins(value, tells, end, np.array([-1.0] * 4), end, (0, *ENDS))

    @override
    def of_end(
        self, passing: Passing, end: Numbers, side: Numbers
    ) -> tuple[Numbers, list[Numbers]]:
        """How far beyond a face rays meet the last of the two slabs across it."""
        local, slabs = passing.local, self._slabs(passing.local)
        step = _parts(local.direction)
        own = [jnp.where(jnp.abs(end) == k, jnp.sign(end), 0) for k in (1, 2, 3)]
        across = [
            jnp.where(n == 0, enter, -jnp.inf)
            for n, (enter, _) in zip(own, slabs, strict=True)
        ]
        pairs = zip(_first_largest(across), step, strict=True)
        entered = Vec3(*(jnp.where(one, -_side(d), 0) for one, d in pairs))
        reach, face = _largest(across), Vec3(*own)
        of_reach, _ = self._of_plane(local, reach, entered)
        _, held = self._of_plane(local, reach, face)
        slides = face.dot(local.direction)
        x, y, z = (jnp.abs(n) * half for n, half in zip(own, self.half, strict=True))
        error = face.dot(local.at(reach)) - (x + y + z)
        told = [slides * one + other for one, other in zip(of_reach, held, strict=True)]
        return error, told

    @override
    def retracted(self, tangent: Float[Array, " c"], free: FreeDirections) -> "BoxBody":
        lower, upper = tangent[3::2], tangent[4::2]
        half = self.half * grown((lower + upper) / (2 * self.half))
        center = self.center + product(self.frame.T, (upper - lower) / 2)
        return box_body(center, product(rotation_by(tangent[:3]).T, self.frame), half)

    @override
    def free_basis(
        self,
        free: FreeDirections,
        unit: Float[Array, ""],
        end_unit: Float[Array, ""],
    ) -> Float[Array, "c c"]:
        turns = jnp.full(3, unit / self.size)
        steps = jnp.concatenate([turns, jnp.full(len(FACES), end_unit)])
        return jnp.asarray(free) * steps[:, None]

    @override
    def free_directions(self, fixed: tuple[str, ...]) -> Float[np.ndarray, "c c"]:
        free = np.eye(3 + len(FACES))
        free[:3] *= "rotation" not in fixed
        # A held size moves both faces of an edge together, a held center apart.
        apart, together = float("size" not in fixed), float("center" not in fixed)
        if apart + together < 2:
            pair = np.array([[apart, -together], [apart, together]])
            free[3:, 3:] = np.kron(np.eye(3), pair)
        return free

    @override
    def transformed(self, target_from_source: RigidTransform) -> "BoxBody":
        center = jnp.asarray(target_from_source.apply(self.center))
        return box_body(center, target_from_source.rotate(self.frame), self.half)

    @override
    def carried(self, target_from_source: RigidTransform) -> Float[Array, "c c"]:
        # All motions are told in its own axes.
        return jnp.eye(3 + len(FACES), dtype=self.half.dtype)

    @override
    def magnified(self, change: Numbers) -> "BoxBody":
        factor = grown(change)
        return box_body(self.center * factor, self.frame, self.half * factor)

    @override
    def readout(self, near: "BoxBody", ends_seen: Bool[Array, " e"]) -> Readout:
        alike = self._as(near)
        return OrderedDict(
            center=self.center,
            along_edges=product(near.frame, self.center - near.center),
            rotation=turn_of(product(near.frame, alike.frame.T)),
            size=alike.edges,
        )

    def _as(self, near: "BoxBody") -> "BoxBody":
        """The same box with its axes named, and directed, as those of another."""
        turns = jnp.asarray(TURNS, self.half.dtype)
        beside = product(near.frame, self.frame.T)
        turn = turns[jnp.argmax(jnp.sum(beside[None] * turns, axis=(1, 2)))]
        half = product(jnp.abs(turn), self.half)
        return box_body(self.center, product(turn, self.frame), half)

    @override
    def drawn_in(
        self, ends_seen: Bool[Array, " e"], reach: Float[Array, " e"]
    ) -> tuple["BoxBody", Float[Array, "c c"]]:
        own = jnp.repeat(self.half, 2)
        reach = jnp.where(ends_seen | ~jnp.isfinite(reach), own, reach)
        lower, upper = reach[::2], reach[1::2]
        # Where all readings are beyond, it stays.
        is_any = lower + upper > 0
        lower, upper = (jnp.where(is_any, x, self.half) for x in (lower, upper))
        shift = (upper - lower) / 2
        center = self.center + product(self.frame.T, shift)
        body = box_body(center, self.frame, (upper + lower) / 2)
        # Turned about a center, faces move beside another one.
        normals = np.array([np.eye(3)[k] * side for k, side in FACES])
        carried = jnp.eye(3 + len(FACES), dtype=self.half.dtype)
        moved = jnp.cross(shift[None], jnp.asarray(normals, shift.dtype))
        return body, carried.at[:3, 3:].set(moved.T)


def box_body(
    center: Float[Array, "*batch 3"],
    frame: Float[Array, "*batch 3 3"],
    half: Float[Array, "*batch 3"],
) -> BoxBody:
    """A body by its fields, of which a type checker takes the radius for one."""
    return BoxBody(center, frame, half)  # pyright: ignore[reportCallIssue]


def _parts(vector: Vec3) -> list[Numbers]:
    return [vector.x, vector.y, vector.z]


def _along(local: Ray) -> tuple[list[Numbers], list[Numbers]]:
    """Where rays begin and their directions, along each axis."""
    return _parts(local.origin), _parts(local.direction)


def _side(value: Numbers) -> Numbers:
    """-1 or 1."""
    return jnp.where(value < 0, -1, 1).astype(value.dtype)


def _middle(values: Sequence[Numbers]) -> Numbers:
    """The second of three by size."""
    first, second, third = values
    low, high = jnp.minimum(first, second), jnp.maximum(first, second)
    return jnp.maximum(low, jnp.minimum(high, third))


def _largest(values: list[Numbers]) -> Numbers:
    return jnp.maximum(jnp.maximum(values[0], values[1]), values[2])


def _first_largest(values: list[Numbers]) -> list[Bool[Array, "*batch"]]:
    """Which of three is the largest, the first of those that are equal."""
    a, b, c = values
    first = (a >= b) & (a >= c)
    second = ~first & (b >= c)
    return [first, second, ~first & ~second]
