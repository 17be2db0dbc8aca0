"""Fit cans that models of whole cameras have drawn, with and without their bias."""

__all__ = ["Config", "measure"]

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from experiments.outcomes import counted, coverage
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.sensor_models.report import tables
from experiments.sensor_models.scenes import SENSORS, draw_image
from impostor_jax.evaluate import Outcome, evaluate
from impostor_jax.fit.fittable import CYLINDER

NUM_NOISE = 5
"""One image in so many is fitted with the noise of single readings alone, too."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how many intervals hold of images by whole cameras."""

    run: RunConfig = RunConfig()
    images: int = 1000
    """Of each camera."""
    seed: int = 0
    """Of all draws."""


def measure(config: Config) -> Iterator[Metric]:
    """Fit what each camera reads as its whole model says, and as its noise does."""
    names = list(SENSORS)[-1:] if config.run.quick else SENSORS
    for name in names:
        sensor = SENSORS[name]
        whole: list[Outcome] = []
        noise: list[Outcome] = []
        for number in range(config.images):
            image = draw_image(sensor.whole, config.seed, number)
            for outcomes in evaluate([image], sensor.whole):
                whole += outcomes
            # A trial of the code compiles one fit.
            if number % NUM_NOISE == 0 and not config.run.quick:
                for outcomes in evaluate([image], sensor.noise):
                    noise += outcomes
        yield from _counted(f"{name}.whole", whole)
        if noise:
            yield from _counted(f"{name}.noise", noise)


def _counted(label: str, outcomes: Sequence[Outcome]) -> Iterator[Metric]:
    """Coverage of all coordinates and of each, and the radius' bias, in spreads."""
    yield from counted(label, outcomes, CYLINDER.coordinates)
    every = CYLINDER.coordinates
    for name, some in {"all": every, **{one: [one] for one in every}}.items():
        yield coverage(f"{label}.coverage_95.{name}", outcomes, some)
    right = [one for one in outcomes if one.success]
    errors = np.array([o.errors["radius"] for o in right])
    if errors.size > 1:
        spread, count = float(errors.std()), len(errors)
        bias = float(errors.mean()) / spread
        error = count**-0.5
        yield Metric(f"{label}.radius.bias", bias, error, "spreads", "lower", count)
        yield Metric(f"{label}.radius.spread", 1e3 * spread, None, "mm", "lower", count)
        told = 1e3 * float(np.median([o.deviations["radius"] for o in right]))
        yield Metric(f"{label}.radius.std", told, None, "mm", "lower", count)


if __name__ == "__main__":
    main(Config, measure, tables, Config(images=2))
