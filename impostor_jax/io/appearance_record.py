"""Materials and lights as records of JSON: the arguments of their classes, by name."""

__all__ = [
    "color_from_record",
    "light_from_record",
    "light_record",
    "material_from_record",
    "material_record",
]

from typing import Any

import equinox as eqx
import numpy as np

from impostor_jax.arguments import float_array
from impostor_jax.io.json_file import arguments_of, check_keys, typed_record
from impostor_jax.rendering.lights import (
    AbstractLight,
    AmbientLight,
    DirectionalLight,
    PointLight,
)
from impostor_jax.rendering.material import Material

LIGHTS: dict[str, type[AbstractLight]] = {
    "ambient": AmbientLight,
    "point": PointLight,
    "directional": DirectionalLight,
}
"""What a light may be made by."""


def material_from_record(record: Any, where: str) -> Material:
    """Make the material of one shape.

    Args:
        record: The arguments of `Material`; what is left out takes the default.
        where: Names it in errors.

    Raises:
        ValueError: The record is no object, or holds a key or a value that is not
            understood; the message names it.
    """
    if not isinstance(record, dict):
        raise ValueError(f"{where} must be a JSON object, got {record!r}")
    check_keys(record, (), arguments_of(Material), where)
    if not isinstance(record.get("fresnel", False), bool):
        raise ValueError(f"fresnel of {where} must be true or false")
    return _single(Material, record, where)


def material_record(material: Material) -> dict[str, Any]:
    """What `material_from_record` makes the material of one shape from."""
    record = {}
    for name, parameter in arguments_of(Material).items():
        value, default = getattr(material, name), parameter.default
        value = None if value is None else np.asarray(value)
        # Below 0 is the exponent of one without a highlight, stacked with others.
        missing = value is None or (name == "exponent" and value < 0)
        if not missing and (default is None or np.any(value != np.asarray(default))):
            record[name] = bool(value) if name == "fresnel" else _listed(value)
    return record


def light_from_record(record: Any, where: str) -> AbstractLight:
    """Make a light.

    Args:
        record: The key `type`, and the arguments of its class.
        where: Names it in errors.

    Raises:
        ValueError: The record holds a type, a key or a value that is not understood;
            the message names it.
    """
    name, values = typed_record(LIGHTS, record, where)
    where = f"{where} ({name})"
    if not isinstance(values.get("falloff", ""), str):
        raise ValueError(f"falloff of {where} must be a name")
    return _single(LIGHTS[name], values, where)


def light_record(light: AbstractLight) -> dict[str, Any]:
    """What `light_from_record` makes a light from."""
    name = next(name for name, kind in LIGHTS.items() if kind is type(light))
    record: dict[str, Any] = {"type": name}
    for argument, parameter in arguments_of(type(light)).items():
        value = getattr(light, argument)
        if isinstance(value, str):
            if value != parameter.default:
                record[argument] = value
        else:
            record[argument] = _listed(value)
    return record


def color_from_record(record: Any, where: str) -> tuple[float, float, float]:
    """Red, green and blue from 0 up; `where` names them in errors.

    Raises:
        ValueError: They are something else.
    """
    color = float_array(where, record, (3,))
    if color.ndim > 1 or bool((color < 0).any()):
        raise ValueError(
            f"{where} must be red, green and blue, not negative, got {record!r}"
        )
    red, green, blue = np.asarray(color).tolist()
    return red, green, blue


def _single(kind: type[Any], values: dict[str, Any], where: str) -> Any:
    """Make an object of a class whose arrays are of one, and not of a batch."""
    try:
        made = kind(**values)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
    for name in values:
        value = getattr(made, name)
        if eqx.is_array(value) and value.shape not in ((), (3,)):
            raise ValueError(
                f"{name} of {where} must be of one, got shape {value.shape}"
            )
    return made


def _listed(value: Any) -> Any:
    """A number, or a list of them."""
    return np.asarray(value).tolist()
