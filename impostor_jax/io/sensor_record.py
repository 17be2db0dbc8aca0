"""A noise model as JSON holds it: its type, and the arguments of its class.

{"type": "dropout", "sensor": {"type": "constant", "deviation": 0.001}, "rate": 0.01}
"""

__all__ = [
    "CAMERAS",
    "SENSORS",
    "read_sensor",
    "sensor_from_record",
    "sensor_record",
]

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

from impostor_jax.io.json_file import read_json_object, typed_record
from impostor_jax.sensor.aligned import AlignedDepth
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.correlated import CorrelatedNoise, LineNoise
from impostor_jax.sensor.dropout import Dropout
from impostor_jax.sensor.flying_pixels import FlyingPixels
from impostor_jax.sensor.gaussian import ConstantNoise
from impostor_jax.sensor.lateral import LateralNoise
from impostor_jax.sensor.matching_window import MatchingWindow
from impostor_jax.sensor.quantization import StereoDisparity
from impostor_jax.sensor.scale_error import ScaleError
from impostor_jax.sensor.structured_light import StructuredLight
from impostor_jax.sensor.time_of_flight import TimeOfFlight

SENSORS: dict[str, type[AbstractDepthNoise]] = {
    "constant": ConstantNoise,
    "structured_light": StructuredLight,
    "stereo": StereoDisparity,
    "time_of_flight": TimeOfFlight,
    "lateral_noise": LateralNoise,
    "flying_pixels": FlyingPixels,
    "dropout": Dropout,
    "matching_window": MatchingWindow,
    "correlated_noise": CorrelatedNoise,
    "line_noise": LineNoise,
    "scale_error": ScaleError,
    "aligned_depth": AlignedDepth,
}
"""By the name that a record has."""

CAMERAS: dict[str, Callable[..., AbstractDepthNoise]] = {
    "structured_light_camera": StructuredLight.sensor,
    "stereo_camera": StereoDisparity.sensor,
    "time_of_flight_camera": TimeOfFlight.sensor,
}
"""Names of whole cameras, that a record may be read from; it is written by its parts.
"""

STEREO = ("stereo", "stereo_camera")
"""Names of what depends on a focal length."""


def sensor_record(sensor: AbstractDepthNoise) -> dict[str, Any]:
    """The record of a noise model, whose numbers must be concrete.

    Raises:
        ValueError: The model is none of `SENSORS`.
    """
    names = [name for name, kind in SENSORS.items() if kind is type(sensor)]
    if not names:
        raise ValueError(
            f"sensor must be one of {', '.join(SENSORS)}; got {type(sensor).__name__}"
        )
    record: dict[str, Any] = {"type": names[0]}
    for field in dataclasses.fields(sensor):
        value = getattr(sensor, field.name)
        if value is None:
            # What is not known is left out, as what has its default.
            continue
        if isinstance(value, AbstractDepthNoise):
            record[field.name] = sensor_record(value)
        else:
            record[field.name] = value if isinstance(value, str) else float(value)
    return record


def sensor_from_record(
    record: Any, what: str, focal_length: float | None = None
) -> AbstractDepthNoise:
    """The noise model of a record; what is left out takes the default.

    Args:
        record: As `sensor_record` makes it.
        what: Names it in errors.
        focal_length: Default of a stereo camera's, in pixels; it has no other.

    Raises:
        ValueError: The type or a key is unknown or missing, or a value is out of range.
    """
    kinds = {**SENSORS, **CAMERAS}
    if focal_length is not None and isinstance(record, dict):
        if record.get("type") in STEREO:
            record = {"focal_length": focal_length, **record}
    name, values = typed_record(kinds, record, what)
    if "sensor" in values:
        values["sensor"] = sensor_from_record(values["sensor"], what, focal_length)
    return kinds[name](**values)


def read_sensor(path: Path, focal_length: float | None = None) -> AbstractDepthNoise:
    """The noise model of a JSON file.

    Args:
        path: Of the file.
        focal_length: As of `sensor_from_record`.

    Raises:
        ValueError: The file is not readable, or holds none.
    """
    what = f"sensor file {str(path)!r}"
    return sensor_from_record(read_json_object(path, what), what, focal_length)
