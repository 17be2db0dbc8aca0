"""What a dataset draws: scenes, cameras and the sensor, as one frozen record."""

__all__ = ["MAX_CYLINDERS", "Placement", "Preset", "Rules"]

import collections
import dataclasses
from typing import Any, Literal, get_args

from data_synth.appearance import Appearance
from data_synth.camera_draw import CameraDraw, ScannerDraw
from data_synth.catalogue import MAX_OBJECTS
from data_synth.distribution import (
    Choice,
    Distribution,
    Fixed,
    LogUniform,
    Uniform,
    Whole,
    check_not_negative,
    check_positive,
)
from data_synth.roughness import Roughness
from data_synth.scenery import SCENERY, Corners, Scenery, Things
from impostor_jax.arguments import one_of, whole_number
from impostor_jax.io.sensor_record import sensor_from_record, sensor_record
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.plane import Plane
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.gaussian import ConstantNoise

Placement = Literal["free", "standing", "lying", "stacked", "around", "surrounding"]
"""How a cylinder is put: anywhere; upright or on its side on the ground; upright on
another one that is, on the ground where none is; around the camera, which looks along
it; or upright on the ground on any side of a scanner."""

MAX_CYLINDERS = 255
"""Most cylinders of an image: 8 bits tell which of them, or none, a pixel shows."""


@dataclasses.dataclass(frozen=True)
class Rules:
    """When a drawn scene is rejected and drawn again; clutter is left out.

    Attributes:
        visible_fraction: Least part of a cylinder's silhouette that is seen, of that in
            an image with a margin of its own size on every side.
        smallest_outline: Fewest pixels of it that are seen.
        most_attempts: Scenes that are drawn for an image before the preset is called
            impossible.
    """

    visible_fraction: float = 0.3
    smallest_outline: int = 400
    most_attempts: int = 100

    def __post_init__(self) -> None:
        if not 0 <= self.visible_fraction <= 1:
            raise ValueError(
                "visible_fraction must be a fraction from 0 to 1, got "
                f"{self.visible_fraction}"
            )
        whole_number("smallest_outline", self.smallest_outline, 0)
        whole_number("most_attempts", self.most_attempts, 1)


@dataclasses.dataclass(frozen=True)
class Preset:
    """Distribution of the images of a dataset.

    Attributes:
        sentence: What it draws, for a reader.
        objects: Number of sizes in the catalogue.
        count: Number of cylinders in an image that keep the rules.
        clutter: Number of further ones, between the camera and what it looks at, of
            which some may be hidden or out of the image.
        radius: In meters.
        aspect: Height over radius.
        placement: How cylinders are put, each way as likely; one may stand there twice.
        distance: From the camera to what it looks at, in meters; from the foot of a
            scanner to that of each cylinder.
        elevation: Angle at which the camera looks down on the ground, in degrees.
        spread: Of the cylinders around what the camera looks at, in meters.
        tilt: Largest angle of an upright cylinder from upright, and of a pipe around
            the camera from its view, in degrees.
        ground: Whether there is a plane that cylinders stand or lie on.
        wall: Distance of a wall behind, in meters; None for none.
        camera: The cameras, or the scanners.
        sensor: The noise model that reads depths, and weighs them in a fit.
        projector_baseline: Distance in meters, along x of the camera, of the projector
            without whose light there is no reading; None for none.
        roughness: Of all surfaces as the sensor reads them, and as the clean depth
            leaves out; None for smooth ones.
        scenery: What is among the cylinders on the ground, and is none.
        touching: Share of cylinders and scenery that are put in contact with another
            thing; those that stand or lean on one come on top.
        depth_scale_mm: Millimeters a unit of depth files; 65534 of them are the
            farthest reading.
        rules: When a scene is rejected.
        appearance: Materials and lights of images in color; None for no such images.
    """

    sentence: str
    objects: int = 20
    count: Distribution = Fixed(1)
    clutter: Distribution = Fixed(0)
    radius: Distribution = Fixed(0.04)
    aspect: Distribution = Fixed(3.0)
    placement: tuple[Placement, ...] = ("free",)
    distance: Distribution = Fixed(0.8)
    elevation: Distribution = Fixed(45.0)
    spread: float = 0.1
    tilt: float = 0.0
    ground: bool = False
    wall: Distribution | None = None
    camera: CameraDraw | ScannerDraw = CameraDraw()
    sensor: AbstractDepthNoise = ConstantNoise(0.001)
    projector_baseline: float | None = None
    roughness: Roughness | None = None
    scenery: tuple[Scenery, ...] = ()
    touching: float = 0.0
    depth_scale_mm: float = 0.1
    rules: Rules = Rules()
    appearance: Appearance | None = None

    def __post_init__(self) -> None:
        for name in ("count", "clutter"):
            check_not_negative(name, getattr(self, name))
        most = self.most_cylinders
        whole_number("objects", self.objects, min(most, 1), MAX_OBJECTS)
        unknown = sorted(set(self.placement) - set(get_args(Placement)))
        if unknown or not self.placement:
            raise ValueError(
                f"placement must be some of {', '.join(get_args(Placement))}; got "
                f"{list(self.placement)}"
            )
        if not 0 <= self.touching <= 1:
            raise ValueError(
                f"touching must be a fraction from 0 to 1, got {self.touching}"
            )
        on_ground = {"standing", "lying", "stacked", "surrounding"}
        on_ground = sorted(on_ground & set(self.placement))
        if on_ground and not self.ground:
            raise ValueError(f"ground must be True for cylinders that are {on_ground}")
        if (self.is_mixed or self.scenery) and not self.ground:
            raise ValueError("ground must be True for scenery and things in contact")
        if self.is_mixed and "around" in self.placement:
            raise ValueError(
                "placement must not be around where there are scenery and things in "
                "contact"
            )
        self._check_scanner()
        samples = 1 if self.appearance is None else self.appearance.samples
        camera = self.camera
        has_lens = isinstance(camera, CameraDraw) and camera.distortion is not None
        if samples > 1 and has_lens:
            raise ValueError(
                f"samples must be 1 for cameras with a lens, got {samples}"
            )
        for name in ("radius", "aspect", "distance", "depth_scale_mm"):
            check_positive(name, getattr(self, name))
        if most > MAX_CYLINDERS:
            raise ValueError(
                f"count and clutter must be at most {MAX_CYLINDERS} cylinders "
                f"together, got up to {most}"
            )

    def _check_scanner(self) -> None:
        """Raise where a scanner is asked for what it cannot have."""
        is_scanner = isinstance(self.camera, ScannerDraw)
        if is_scanner != (self.placement == ("surrounding",)):
            raise ValueError(
                "placement must be surrounding, and nothing else, for a scanner and no "
                f"other camera, got {list(self.placement)}"
            )
        if not is_scanner:
            return
        for name in ("appearance", "projector_baseline", "wall"):
            if getattr(self, name) is not None:
                raise ValueError(f"{name} must be None for a scanner")
        if self.is_mixed or self.clutter.ends[1]:
            raise ValueError(
                "clutter, things in contact and things on a table must be none for a "
                "scanner"
            )

    @property
    def is_mixed(self) -> bool:
        """Whether things are on one ground, and may touch."""
        things = any(isinstance(kind, Things | Corners) for kind in self.scenery)
        return bool(things or self.touching or "stacked" in self.placement)

    @property
    def most_cylinders(self) -> int:
        """Most cylinders of an image."""
        return int(self.count.ends[1] + self.clutter.ends[1])

    @property
    def most_others(self) -> dict[type[AbstractPrimitive], int]:
        """Most other shapes of an image, by type; none of a type that it never has."""
        most: collections.Counter[type[AbstractPrimitive]] = collections.Counter()
        most[Plane] = self.ground + (self.wall is not None)
        for kind in self.scenery:
            primitive, number = kind.shapes
            most[primitive] += number * int(kind.count.ends[1])
        return {primitive: number for primitive, number in most.items() if number}

    def record(self) -> dict[str, Any]:
        """All of it as JSON holds it: what a manifest keeps."""
        return _record_of(self)

    @staticmethod
    def from_record(record: dict[str, Any]) -> "Preset":
        """The preset of a record.

        Raises:
            ValueError: The record is not one of a preset, or a value is out of range.
        """
        try:
            preset = _from_record(record)
        except (TypeError, AttributeError) as error:
            raise ValueError(f"preset must be the record of one: {error}") from error
        if not isinstance(preset, Preset):
            raise ValueError(
                "preset must be of the kind Preset, as `impostor-synth describe bench "
                f"--json` prints one, got {type(preset).__name__}"
            )
        return preset


def _record_of(value: Any) -> Any:
    if isinstance(value, AbstractDepthNoise):
        return sensor_record(value)
    if dataclasses.is_dataclass(value):
        fields = {
            field.name: _record_of(getattr(value, field.name))
            for field in dataclasses.fields(value)
        }
        return {"kind": type(value).__name__, **fields}
    return [_record_of(part) for part in value] if isinstance(value, tuple) else value


def _from_record(record: Any) -> Any:
    if isinstance(record, list):
        return tuple(_from_record(part) for part in record)
    if not isinstance(record, dict):
        return record
    if "type" in record:
        return sensor_from_record(record, "sensor")
    fields = {name: _from_record(value) for name, value in record.items()}
    kind = fields.pop("kind", None)
    if kind is None:
        raise ValueError(
            "preset must say the kind of each part, as `impostor-synth describe bench "
            f"--json` prints one, got a part of {', '.join(fields) or 'nothing'}"
        )
    one_of("kind of a part of a preset", kind, RECORD_KINDS)
    known = [field.name for field in dataclasses.fields(RECORD_KINDS[kind])]
    for name in fields:
        one_of(f"name in a {kind} of a preset", name, known)
    return RECORD_KINDS[kind](**fields)


RECORD_KINDS = {
    kind.__name__: kind
    for kind in (
        *(Preset, CameraDraw, ScannerDraw, Rules, Appearance, Roughness),
        *(Fixed, Uniform, LogUniform, Whole, Choice),
        *SCENERY,
    )
}
"""What a record may hold, by name."""
