"""What every primitive promises."""

__all__ = [
    "AbstractOnePiece",
    "AbstractPrimitive",
    "check_shapes",
    "check_single",
    "combines",
    "in_camera_frame",
    "in_world_frame",
    "not_a_shape",
]

import abc
import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Protocol, TypeVar, runtime_checkable

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from impostor_jax.camera.base import AbstractRays
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.hull import AbstractHull
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers
from impostor_jax.primitives.stretch import Stretch
from impostor_jax.text import described, text_or_repr

UNITS = {
    "axis": "",
    "unit_normal": "",
    "rotation": "",
    "zero": "",
    "start_angle": "rad",
    "end_angle": "rad",
    "lipschitz": "",
    "curvature": "1/m",
}
"""Of the fields of shapes that are not in meters."""


class AbstractPrimitive(eqx.Module):
    """A shape that rays are cast at: a solid, or an open sheet; lengths in meters.

    Of a place that is given in double precision and lies 64 m or more from the origin
    all digits are kept, in a NumPy array, until a camera nearby sees it.

    Attributes:
        measure: Name of a field that each of a batch has its own of, and that field's
            rank in a single shape.
    """

    measure: ClassVar[tuple[str, int]]

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """Shape of a batch of shapes; () for a single one."""
        name, rank = self.measure
        shape = getattr(self, name).shape
        return shape[: len(shape) - rank]

    @property
    def dtype(self) -> np.dtype:
        """Floating-point type in which rays meet the fields."""
        return jax.dtypes.canonicalize_dtype(getattr(self, self.measure[0]).dtype)

    @property
    @abc.abstractmethod
    def num_parts(self) -> int:
        """How many pieces `Hit.part` counts."""

    @property
    @abc.abstractmethod
    def is_bounded(self) -> bool:
        """Whether it has a `hull`, without computing one."""

    @property
    @abc.abstractmethod
    def hull(self) -> AbstractHull | None:
        """What holds it, or each of a batch; None if it has no end or none is known."""

    @abc.abstractmethod
    def intersect(self, ray: Ray) -> Hit:
        """First surface in front of the ray's origin.

        A ray that starts inside the solid sees the surface where it leaves. Values and
        derivatives are finite on every ray but for `t`, which is `+inf` on a miss.
        """

    @abc.abstractmethod
    def normal(self, ray: Ray, hit: Hit) -> Vec3:
        """Unit normal at a hit, turned towards the ray's origin; zero on a miss."""

    @abc.abstractmethod
    def stretches(self, ray: Ray) -> tuple[Stretch, ...] | None:
        """Stretches of rays in the solid, in order; what lies behind the origin, too.

        Of a plane, on the side that its normal points away from. None of what encloses
        nothing, and of a `Solid`, whose shapes have them.

        Derivatives:
            None.
        """

    def occluded(
        self, ray: Ray, t_max: float | Float[Array, "..."] = math.inf
    ) -> Bool[Array, "..."]:
        """Whether it is in the way of rays, before a ray parameter."""
        return self.intersect(ray).t < t_max

    @abc.abstractmethod
    def implicit(self, point: Vec3) -> Float[Array, "*batch"]:
        """Signed distance from the surface in meters, negative inside.

        Of a plane, negative on the side that its normal points away from. Of a
        heightfield, negative below, and of first order: right near the surface.
        """

    @abc.abstractmethod
    def outline_gap(self, ray: Ray) -> Numbers | None:
        """How far within the outline rays pass: positive where they meet the shape.

        The distance of the line from the outline near it, in meters; farther off any
        number of the same sign. Of a plane, whose outline is its horizon, the sine of
        the angle to it. What lies behind a ray's origin counts as if it were ahead.
        None where there is no formula.

        Derivatives:
            In rays and fields, finite on every ray, and on the outline the same from
            both sides but where it has a corner.
        """

    @abc.abstractmethod
    def crease_gap(
        self, ray: Ray, part: Int[Array, "..."], other: Int[Array, "..."]
    ) -> Numbers | None:
        """How far off the edge between two of its surfaces rays pass.

        Args:
            ray: That pass near it.
            part: What `Hit.part` tells on one side.
            other: And on the other.

        Returns:
            As `outline_gap`, of either sign. None where there is no formula.
        """

    @abc.abstractmethod
    def transformed(self, target_from_source: RigidTransform) -> "AbstractPrimitive":
        """Express the same shape in another frame."""

    def __or__(self, other: "AbstractPrimitive") -> "AbstractPrimitive":
        return _combined("union", self, other)

    def __and__(self, other: "AbstractPrimitive") -> "AbstractPrimitive":
        return _combined("intersection", self, other)

    def __sub__(self, other: "AbstractPrimitive") -> "AbstractPrimitive":
        return _combined("difference", self, other)

    def __str__(self) -> str:
        return text_or_repr(self, self._text)

    def _text(self) -> str:
        # Of a batch the plain form, with shapes and dtypes, says more.
        return repr(self) if self.batch_shape else described(self, UNITS)


class AbstractOnePiece(AbstractPrimitive):
    """A shape whose surface is all one piece, without an edge between two."""

    @property
    @override
    def num_parts(self) -> int:
        return 1

    @override
    def crease_gap(
        self, ray: Ray, part: Int[Array, "..."], other: Int[Array, "..."]
    ) -> None:
        return None


Operator = TypeVar("Operator", bound=Callable[[str, Sequence[Any]], AbstractPrimitive])

_operator: list[Callable[[str, Sequence[Any]], AbstractPrimitive]] = []


def combines(operator: Operator) -> Operator:
    """Let a function make solids of solids, for the operators `|`, `&` and `-`.

    What it returns is a primitive itself, so that it cannot be imported here.
    """
    _operator[:] = [operator]
    return operator


def _combined(name: str, *shapes: AbstractPrimitive) -> AbstractPrimitive:
    if not isinstance(shapes[1], AbstractPrimitive):
        return NotImplemented
    return _operator[0](name, shapes)


def check_single(primitive: AbstractPrimitive, name: str = "primitive") -> None:
    """Raise a `ValueError` where a shape is a batch; `name` is the argument's."""
    if primitive.batch_shape:
        raise ValueError(
            f"{name} must be a single one, got a batch of shape "
            f"{primitive.batch_shape}; map over it with jax.vmap"
        )


def check_shapes(shapes: Sequence[Any]) -> None:
    """Raise a `ValueError` unless all are shapes, or batches (n,) of one type."""
    for shape in shapes:
        if not isinstance(shape, AbstractPrimitive) or len(shape.batch_shape) > 1:
            raise ValueError(
                "shapes must be primitives, single ones or batches (n,), got "
                f"{not_a_shape(shape)}"
            )


def not_a_shape(value: Any) -> str:
    """What is given for a shape, for an error; which of its attributes is one."""
    told = type(value).__name__
    # Of a tube; its value is not asked for, which may be of other things than arrays.
    if hasattr(type(value), "solid"):
        return f"{told}, whose shape is its attribute solid"
    return told


@runtime_checkable
class Movable(Protocol):
    """What has a place, and can be expressed in another frame."""

    def transformed(self, target_from_source: RigidTransform) -> "Movable":
        """Express the same in another frame."""
        ...


Placed = TypeVar("Placed", bound=Movable)


def in_camera_frame(placed: Placed, camera: AbstractRays) -> Placed:
    """Express what has a place in the world in the frame of a camera."""
    if camera.camera_from_world is None:
        return placed
    # A thing stays what it is; its method cannot say so.
    return placed.transformed(camera.camera_from_world)  # pyright: ignore[reportReturnType]


def in_world_frame(placed: Placed, camera: AbstractRays) -> Placed:
    """Express what has a place in the frame of a camera in the world."""
    if camera.camera_from_world is None:
        return placed
    return placed.transformed(camera.camera_from_world.inverse())  # pyright: ignore[reportReturnType]
