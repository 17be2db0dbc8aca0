"""Checks of what a caller hands in: a `ValueError` names argument, value and need.

Concrete values are checked; traced ones pass, because their numbers are not known yet.
Shapes and dtypes are known while tracing and are always checked.
"""

__all__ = [
    "FAR",
    "angle_below_grazing",
    "bounded_number",
    "check_direction",
    "check_positive",
    "check_rotation",
    "described",
    "float_array",
    "float_arrays",
    "image_size",
    "is_concrete",
    "is_exact",
    "one_of",
    "place_of",
    "real_number",
    "unmasked",
    "unread",
    "users_level",
    "whole_number",
    "working_precision",
]

import contextlib
import inspect
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.plain_arguments import (
    image_size,
    number_in_range,
    number_needed,
    one_of,
    whole_number,
)

Values = TypeVar("Values")

FAR = 64.0
"""Meters from the origin from which a place keeps double precision: single precision
rounds it there by 4 micrometers, and by more beyond; a good fit is sure to 40."""


@contextlib.contextmanager
def working_precision(
    precision: str | None, given: Any
) -> Iterator[Callable[[Values], Values]]:
    """Let JAX's default floating-point type be the one of an `Effort`.

    Args:
        precision: "float32", "float64", or None to change nothing.
        given: All that the caller handed in.

    Yields:
        What converts arrays to that type.

    Raises:
        ValueError: The precision is not JAX's own, and something is traced.
    """
    if precision is None:
        yield lambda values: values
        return
    own = jnp.result_type(float)
    if precision != own and not is_concrete(given):
        raise ValueError(
            f"precision must be JAX's own, {own}, in a traced call, got {precision!r}; "
            "jax_enable_x64 decides it"
        )

    def convert(x: Any) -> Any:
        is_float = eqx.is_array(x) and jnp.issubdtype(x.dtype, np.floating)
        return jnp.asarray(x, precision) if is_float else x

    with jax.enable_x64(precision == "float64"):
        yield lambda values: jax.tree.map(convert, values)


def is_concrete(value: Any) -> bool:
    """Tell whether every leaf of `value` has numbers that Python can read now."""
    return not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(value))


def users_level() -> int:
    """The `stacklevel` at which a warning names the line that called this package."""
    package = __name__.split(".")[0]
    names = [one.frame.f_globals.get("__name__", "") for one in inspect.stack(0)]
    # But for this function's own frame.
    own = [k for k, name in enumerate(names) if k and name.split(".")[0] == package]
    return own[-1] - own[0] + 2


def described(value: Any) -> str:
    """What is given in place of something else, in a few words for an error."""
    if isinstance(value, type):
        return f"the class {value.__name__}, of which an instance is needed"
    if isinstance(value, str | Path):
        return f"the text {str(value)!r}"
    if inspect.isroutine(value):
        return f"the function {value.__name__}, whose result is needed"
    if isinstance(value, jax.Array | np.ndarray):
        return f"an array of shape {value.shape}"
    return type(value).__name__


def unread(name: str, value: Any) -> Any:
    """The value; a `ValueError` where it is the path of a file.

    Args:
        name: Name of the argument, for the error.
        value: An array that is expected.
    """
    if isinstance(value, str | Path):
        raise ValueError(
            f"{name} must be an array, got {described(value)}: read the file first, an "
            "image by cv2.imread(path, cv2.IMREAD_UNCHANGED)"
        )
    return value


def unmasked(values: Any) -> Any:
    """Zeros, which are no readings and no object, for what a NumPy masked array masks.

    Masked values have numbers below, and `np.asarray` returns them without a word.
    """
    if not isinstance(values, np.ma.MaskedArray):
        return values
    return values.filled(values.dtype.type(0))


def _as_array(name: str, value: Any) -> jax.Array | np.ndarray:
    if isinstance(value, jax.Array):
        return value
    try:
        # A list that holds tracers has no numbers for numpy to read.
        array = np.asarray(value) if is_concrete(value) else jnp.asarray(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must hold numbers, got {value!r}") from error
    return array


def _is_real(array: jax.Array | np.ndarray) -> bool:
    return jnp.issubdtype(array.dtype, np.integer) or jnp.issubdtype(
        array.dtype, np.floating
    )


def real_number(
    name: str, value: Any, *, positive: bool = False, unit: str | None = None
) -> Any:
    """Return `value` as a Python float, or as it is where it is traced.

    A Python float takes the precision of whatever it meets, so one camera serves
    single and double precision; its square must be in the range of both.
    """
    need = number_needed(positive=positive, unit=unit)
    array = _as_array(name, value)
    if array.shape != () or not _is_real(array):
        raise ValueError(f"{name} must be {need}, got {value!r}")
    if not is_concrete(value):
        return value
    return number_in_range(name, float(array), need, positive=positive)


def bounded_number(name: str, value: Any, need: str, high: float = math.inf) -> Any:
    """Return `value` as `real_number` does; a `ValueError` unless from 0 to `high`.

    Args:
        name: Name of the argument, for the error.
        value: A number; a traced one passes.
        need: What the value must be, with its unit, for the error.
        high: Largest value.
    """
    number = real_number(name, value)
    if is_concrete(number) and not 0 <= number <= high:
        raise ValueError(f"{name} must be {need}, got {number}")
    return number


def angle_below_grazing(name: str, value: Any) -> Any:
    """Return `value` as `real_number` does; a `ValueError` unless in 0 to 89.5 degrees.

    At 90 degrees the laws of the incidence are infinite or divide by 0, and so close to
    it no sensor was ever measured.
    """
    need = "an angle from 0 to 1.562 radians (89.5 degrees)"
    return bounded_number(name, value, need, math.radians(89.5))


def float_array(
    name: str, value: Any, shape: Sequence[int | None], unit: str = "numbers"
) -> Float[Array, "..."]:
    """Return `value` as a finite floating-point array whose last axes are `shape`.

    Args:
        name: Name of the argument, for the error.
        value: Numbers, or a traced array.
        shape: Expected trailing shape; `None` stands for any length.
        unit: Unit of the numbers, for the error. Of meters the square counts, too, and
            must be a number of the array's type.
    """
    array = _as_array(name, value)
    trailing = (
        array.shape[array.ndim - len(shape) :] if array.ndim >= len(shape) else ()
    )
    fits = len(trailing) == len(shape) and all(
        need is None or need == have for need, have in zip(shape, trailing, strict=True)
    )
    if not fits or not _is_real(array):
        raise ValueError(
            f"{name} must be {unit} of shape {tuple(shape)}, "
            f"got {array.dtype} of shape {array.shape}"
        )
    if is_concrete(array) and not np.all(np.isfinite(np.asarray(array))):
        raise ValueError(f"{name} must be finite {unit}, got {np.asarray(array)}")
    # A plain Python or numpy number has no precision of its own: take jax's default.
    own = (array.dtype,) if isinstance(array, jax.Array) else ()
    dtype = jnp.result_type(float, *own)
    if is_concrete(array) and array.size:
        largest = float(np.finfo(dtype).max) ** (0.5 if unit == "meters" else 1.0)
        # In double precision: in single one a number above it is infinite already.
        found = np.abs(np.asarray(array, np.float64)).max()
        if found > largest:
            raise ValueError(
                f"{name} must be {unit} of at most {largest:.3g} in {dtype}, "
                f"got {found:.6g}"
            )
    return jnp.asarray(array, dtype)


def float_arrays(
    **values: tuple[Any, Sequence[int | None], str],
) -> list[Float[Array, "..."]]:
    """Return every value as `float_array` does, all with one dtype and batch shape.

    Args:
        values: By name: the value, its trailing shape and its unit.
    """
    arrays = [float_array(name, *value) for name, value in values.items()]
    dtype = jnp.result_type(*arrays)
    ranks = [len(shape) for _, shape, _ in values.values()]
    batches = [a.shape[: a.ndim - k] for a, k in zip(arrays, ranks, strict=True)]
    if len(set(batches)) > 1:
        *names, last = values
        raise ValueError(
            f"{', '.join(names)} and {last} must have one batch shape, got "
            f"{', '.join(map(str, batches))}"
        )
    return [array.astype(dtype) for array in arrays]


def place_of(
    given: Any, rounded: Float[Array, "..."] | Float[np.ndarray, "..."]
) -> Float[Array, "..."] | Float[np.ndarray, "..."]:
    """A place in double precision where it is known so, and single one would round it.

    It is a NumPy array then: it takes the precision of what it meets, and is rounded
    where a program is compiled for it. What has a camera is moved near before that.

    Args:
        given: Concrete numbers, in meters, the last axis x, y and z; or traced ones.
        rounded: The same in JAX's precision.
    """
    if rounded.dtype == np.float64 or not is_concrete(given):
        return rounded
    values = np.asarray(given)
    if values.dtype in (np.float16, np.float32):
        return rounded
    values = np.array(values, np.float64)
    # NaN, which a failed fit has, stays in the type of its camera's world.
    is_near = np.all(np.linalg.norm(values, axis=-1) < FAR)
    return rounded if is_near else values


def is_exact(place: Any) -> bool:
    """Whether a place keeps double precision beside JAX's own; see `place_of`."""
    return isinstance(place, np.ndarray) and place.dtype == np.float64


def check_positive(name: str, value: Float[Array, "..."], unit: str) -> None:
    """Raise unless all of a concrete `value` is positive."""
    if is_concrete(value) and not np.all(np.asarray(value) > 0):
        raise ValueError(f"{name} must be positive, in {unit}, got {value}")


def check_direction(name: str, value: Float[Array, "*batch 3"]) -> None:
    """Raise if any of the concrete vectors is the zero vector."""
    if is_concrete(value) and not np.all(np.any(np.asarray(value) != 0, axis=-1)):
        raise ValueError(f"{name} must not be the zero vector, got {value}")


def check_rotation(name: str, value: Float[Array, "*batch 3 3"]) -> None:
    """Raise unless all concrete matrices are rotations to within 1e-3."""
    if not is_concrete(value):
        return
    matrix = np.asarray(value, dtype=float)
    square = matrix @ np.swapaxes(matrix, -1, -2)
    rigid = np.allclose(square, np.eye(3), atol=1e-3)
    if not rigid or np.any(np.linalg.det(matrix) < 0):
        raise ValueError(
            f"{name} must be orthogonal with determinant 1, got {matrix.tolist()}"
        )
