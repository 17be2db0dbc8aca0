"""How things look in color: what is drawn at random."""

__all__ = ["Appearance"]

import dataclasses

from data_synth.distribution import (
    Distribution,
    LogUniform,
    Uniform,
    check_not_negative,
    check_positive,
)
from impostor_jax.arguments import bounded_number, whole_number

MOST_LAMPS = 8
MOST_BOUNCES = 8
MOST_SAMPLES = 4


@dataclasses.dataclass(frozen=True)
class Appearance:
    """Materials and lights of color images, of which all that is drawn is recorded.

    A sensor of depth reads mirrors and glass as it reads what is dull: only color
    images show them.

    Attributes:
        saturation: Of the colors of things, from 0 to 1; hues are as likely as others.
        brightness: Largest of red, green and blue that a white light makes a thing.
        exponent: Of the highlights.
        mirrors: Share of the things that mirror.
        reflect: Part of the color of these that is mirrored.
        glasses: Share of the things, planes not among them, that light goes through.
        transmit: Part of the color of these that is seen through them.
        ior: Index of refraction of these.
        lamps: Number of lights that cast shadows.
        far: Distance of a lamp from what the camera looks at, over that of the camera.
        light: What all lamps together bring there to a white surface that faces them.
        ambient: Light from all sides.
        bounces: Most times that a ray is mirrored or bent.
        samples: Rays along each side of a pixel.
    """

    saturation: Distribution = Uniform(0.0, 0.8)
    brightness: Distribution = Uniform(0.2, 0.9)
    exponent: Distribution = LogUniform(5.0, 200.0)
    mirrors: float = 0.0
    reflect: Distribution = Uniform(0.1, 0.5)
    glasses: float = 0.0
    transmit: Distribution = Uniform(0.6, 0.9)
    ior: Distribution = Uniform(1.3, 1.7)
    lamps: int = 2
    far: Distribution = Uniform(1.0, 3.0)
    light: Distribution = Uniform(0.5, 0.9)
    ambient: Distribution = Uniform(0.1, 0.3)
    bounces: int = 3
    samples: int = 1

    def __post_init__(self) -> None:
        whole_number("lamps", self.lamps, 0, MOST_LAMPS)
        whole_number("bounces", self.bounces, 0, MOST_BOUNCES)
        whole_number("samples", self.samples, 1, MOST_SAMPLES)
        for name in ("mirrors", "glasses"):
            bounded_number(name, getattr(self, name), "a fraction from 0 to 1", 1.0)
        if self.mirrors + self.glasses > 1:
            raise ValueError(
                "mirrors and glasses must be at most 1 together, got "
                f"{self.mirrors} and {self.glasses}"
            )
        for name in ("saturation", "brightness", "reflect", "transmit"):
            low, high = getattr(self, name).ends
            if not 0 <= low <= high <= 1:
                raise ValueError(
                    f"{name} must be from 0 to 1, got {getattr(self, name)}"
                )
        for name in ("exponent", "ior", "far"):
            check_positive(name, getattr(self, name))
        for name in ("light", "ambient"):
            check_not_negative(name, getattr(self, name))
